//! Figure 2: poses of jaw and tongue, seen from different sides.

use fluorspar::image::FeatureMaps;
use fluorspar::pipeline::light_group_preview;

use super::check::{Check, Outcome, Verdict, number};
use super::setup::{Setup, ValidationError};
use fluorspar_report::Raster;
use fluorspar_report::figures::pictures;

/// Pixels of each picture, and paths per pixel.
const PICTURE: [usize; 2] = [120, 90];
const SAMPLES: usize = 8;

/// A pose: name, jaw opening and protrusion, shift and curl of the tongue, place of the camera, mm.
struct Pose {
    name: &'static str,
    jaw_opening_mm: f64,
    tongue_protrusion_mm: f64,
    tongue_shift_mm: f64,
    tongue_curl: f64,
    camera_mm: [f64; 3],
}

const POSES: [Pose; 4] = [
    Pose {
        name: "mouth open",
        jaw_opening_mm: 42.0,
        tongue_protrusion_mm: 0.0,
        tongue_shift_mm: 0.0,
        tongue_curl: 0.0,
        camera_mm: [0.0, 20.0, 98.0],
    },
    Pose {
        name: "half open, from the side",
        jaw_opening_mm: 26.0,
        tongue_protrusion_mm: 0.0,
        tongue_shift_mm: 0.0,
        tongue_curl: 0.0,
        camera_mm: [45.0, 12.0, 92.0],
    },
    Pose {
        name: "tongue out and aside, from above",
        jaw_opening_mm: 42.0,
        tongue_protrusion_mm: 20.0,
        tongue_shift_mm: 15.0,
        tongue_curl: 0.0,
        camera_mm: [0.0, 50.0, 95.0],
    },
    Pose {
        name: "tip of the tongue raised",
        jaw_opening_mm: 45.0,
        tongue_protrusion_mm: 0.0,
        tongue_shift_mm: 0.0,
        tongue_curl: 0.8,
        camera_mm: [-40.0, 8.0, 98.0],
    },
];

pub(super) fn run(setup: &Setup<'_>) -> Result<Outcome, ValidationError> {
    let (mut shown, mut maps) = (Vec::new(), Vec::new());
    for pose in &POSES {
        let (raster, map) = picture(setup, pose)?;
        shown.extend(raster.map(|raster| (pose.name.to_owned(), raster)));
        maps.push(map);
    }
    let pairs = (0..maps.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let differing = pairs.map(|(a, b)| share(&maps[a], |i| maps[a][i] != maps[b][i])).fold(1.0, f64::min);
    let moved_edge = maps.iter().map(|map| edges(map)).fold(0.0, f64::max);
    let seen =
        |part: &str| maps.iter().map(|map| share(map, |i| map[i].starts_with(part))).fold(1.0, f64::min);
    let (teeth, tongue) = (seen("tooth"), seen("tongue"));
    let reason = format!(
        "Four poses of jaw and tongue from four sides: any two differ in {} % of the pixels or more, teeth fill {} % and the tongue \
         {} % of each picture at least. The paper's mesh is not public, so that pictures can't be compared in numbers.",
        number(100.0 * differing),
        number(100.0 * teeth),
        number(100.0 * tongue)
    );
    Ok(Outcome::new(Verdict::Reproduced, reason)
        .checks(checks([differing, moved_edge], [teeth, tongue]))
        .show("figure_2_poses", pictures("Mouth in various poses, white light", shown, 2)))
}

/// A pose under white light, and the material of each pixel.
fn picture(setup: &Setup<'_>, pose: &Pose) -> Result<(Option<Raster>, Vec<String>), ValidationError> {
    let changes = [
        format!("render.width_px={}", PICTURE[0]),
        format!("render.height_px={}", PICTURE[1]),
        format!("render.samples_per_pixel={SAMPLES}"),
        format!("mouth.jaw_opening_mm={:?}", pose.jaw_opening_mm),
        format!("mouth.tongue_protrusion_mm={:?}", pose.tongue_protrusion_mm),
        format!("mouth.tongue_shift_mm={:?}", pose.tongue_shift_mm),
        format!("mouth.tongue_curl={:?}", pose.tongue_curl),
        "mouth.tongue_elevation_mm=0.0".to_owned(),
        "mouth.detail=0.4".to_owned(),
        format!("camera.position_mm={:?}", pose.camera_mm),
    ];
    let study = setup.mouth(&changes)?;
    let image = setup.render(&study)?;
    let white = image.recombine(|component| f64::from(u8::from(component.light_group == "white")));
    let preview = light_group_preview(&white, &study, "white");
    let raster = Raster::from_rgb8(preview.width, preview.height, &preview.rgb);
    Ok((raster, materials(&image.features)))
}

fn checks([differing, moved_edge]: [f64; 2], [teeth, tongue]: [f64; 2]) -> [Check; 3] {
    // A patch of 5 mm in a picture of 78 mm by 58 mm
    let patch = 25.0 / (78.0 * 58.0);
    let visible = "a patch of 5 mm by 5 mm in the camera's field of 78 mm by 58 mm";
    let what = "smallest share of pixels that show another tissue in another pose";
    let why = "more than a shift by one pixel changes: the share of pixels at borders between tissues";
    [
        Check::at_least(what, moved_edge, differing, "", why).said("various poses"),
        Check::at_least("smallest share of teeth in a picture", patch, teeth, "", visible),
        Check::at_least("smallest share of the tongue in a picture", patch, tongue, "", visible),
    ]
}

/// Name of the material that each pixel shows; empty where nothing is seen.
fn materials(features: &FeatureMaps) -> Vec<String> {
    let name = |&part: &u16| {
        let index = usize::from(part).checked_sub(1);
        index.and_then(|index| features.material_names.get(index)).cloned().unwrap_or_default()
    };
    features.part.iter().map(name).collect()
}

fn share(map: &[String], wanted: impl Fn(usize) -> bool) -> f64 {
    (0..map.len()).filter(|&pixel| wanted(pixel)).count() as f64 / map.len().max(1) as f64
}

/// Share of pixels whose right or lower neighbor shows another material.
fn edges(map: &[String]) -> f64 {
    let [width, height] = PICTURE;
    share(map, |pixel| {
        let (row, column) = (pixel / width, pixel % width);
        (column + 1 < width && map[pixel] != map[pixel + 1])
            || (row + 1 < height && map[pixel] != map[pixel + width])
    })
}
