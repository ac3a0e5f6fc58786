//! The shapes from any side: clay, parts, distance. The camera of the experiment is turned about the middle of what it sees.

use std::time::Instant;

use fluorspar::pipeline::{SurfaceView, depth_range_m, surface_view};
use fluorspar::render::visible_surfaces;
use fluorspar::scene::Scene;
use fluorspar_session::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::picture::{Legend, View, png_of};
use crate::server::Shown;

/// From where which picture is wanted.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct OrbitRequest {
    #[serde(default)]
    pub(crate) set: Vec<String>,
    view: View,
    /// Turn of the camera to its right and above, degrees, and how many times as near it is.
    yaw_deg: f32,
    pitch_deg: f32,
    zoom: f32,
    /// Columns of the picture.
    width_px: usize,
    /// A place that is asked about, as shares of width and height.
    at: Option<[f32; 2]>,
}

/// What is told beside a picture.
#[derive(Serialize)]
pub(crate) struct OrbitFacts {
    legend: Option<Legend>,
    /// What is seen at the place that is asked about.
    picked: Option<Picked>,
    milliseconds: f64,
}

#[derive(Serialize)]
struct Picked {
    part: String,
    material: String,
    distance_mm: f32,
}

/// Least and largest width of a picture, px.
const WIDTHS: std::ops::RangeInclusive<usize> = 16..=1600;
/// The same of how near the camera comes.
const ZOOMS: std::ops::RangeInclusive<f32> = 0.2..=8.0;

/// Draws the shapes: what is told of them, and the PNG.
///
/// # Errors
/// A change that can't be made; another view than one of shapes, a camera that can't be.
pub(crate) fn orbit(shown: &Shown, request: &OrbitRequest) -> Result<(OrbitFacts, Vec<u8>)> {
    let begun = Instant::now();
    let OrbitRequest { yaw_deg, pitch_deg, zoom, width_px, .. } = *request;
    if !(yaw_deg.is_finite()
        && pitch_deg.abs() <= 90.0
        && ZOOMS.contains(&zoom)
        && WIDTHS.contains(&width_px))
    {
        return Err(Error::Input(format!(
            "the camera can't be there: pitch_deg within 90, zoom {} to {}, width_px {} to {}",
            ZOOMS.start(),
            ZOOMS.end(),
            WIDTHS.start(),
            WIDTHS.end()
        )));
    }
    let view = match request.view {
        View::Clay => SurfaceView::Clay,
        View::Part => SurfaceView::Part,
        View::Depth => SurfaceView::Depth,
        _ => return Err(Error::Input("only clay, part and depth are seen from any side".into())),
    };
    let shapes = shown.first.shapes(&shown.changes)?;
    let own = &shapes.scene.camera;
    let mut camera = own.orbited(shapes.distance_m, yaw_deg.to_radians(), pitch_deg.to_radians(), zoom);
    // Of a high image the height is bounded
    let height_px = (width_px * own.height / own.width).clamp(1, *WIDTHS.end());
    let width_px = (height_px * own.width / own.height.max(1)).clamp(1, width_px);
    (camera.width, camera.height) = (width_px, height_px);
    let maps = visible_surfaces(&shapes.scene, &camera);
    let legend = (view == SurfaceView::Depth).then(|| Legend::of_depth(depth_range_m(&maps)));
    let picked = request.at.and_then(|[x, y]| {
        let place = |share: f32, count: usize| ((share * count as f32).max(0.0) as usize).min(count - 1);
        let pixel = place(y, camera.height) * camera.width + place(x, camera.width);
        let part = usize::from(maps.part[pixel]).checked_sub(1)?;
        Some(picked(&shapes.scene, shown, part, maps.depth_m[pixel]))
    });
    let png = png_of(&surface_view(&maps, camera.width, view))?;
    Ok((OrbitFacts { legend, picked, milliseconds: 1e3 * begun.elapsed().as_secs_f64() }, png))
}

/// A part with what it is made of.
fn picked(scene: &Scene, shown: &Shown, part: usize, depth_m: f32) -> Picked {
    let object = &scene.objects[part];
    let name = &scene.materials[object.material].name;
    let experiment = shown.first.experiment(&shown.changes).ok();
    let section = experiment
        .as_ref()
        .and_then(|experiment| experiment.file.material.iter().find(|section| section.name == *name));
    let tissue = section.and_then(|section| section.tissue());
    Picked {
        part: object.name.clone(),
        material: tissue.map_or_else(|| name.clone(), |tissue| format!("{name} (layered tissue {tissue})")),
        distance_mm: 1e3 * depth_m,
    }
}
