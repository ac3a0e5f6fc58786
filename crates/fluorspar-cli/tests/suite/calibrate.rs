//! A camera is simulated, shoots its own calibration, and is found again from the frames alone.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::{Said, fluorspar};

/// What the true camera is other than `own-camera.toml` says: electronics, glass, the strength of its light.
const TRUE_CAMERA: &str = r#"
format = 1
base = "own-camera.toml"
unset = ["capture", "analysis", "material.patch.concentrations"]
[render]
width_px = 32
height_px = 24
samples_per_pixel = 4
[lens]
transmittance = 0.7
vignetting = "none"
[sensor]
columns = 96
rows = 72
relative_illumination = { all = [-0.3, 0.05] }
[sensor.emva1288]
gain_e_per_dn = 3.1
dark_noise_e = 4.0
black_level_dn = 80.0
prnu_percent = 1.2
dark_current_e_per_s = 40.0
dsnu_e = 3.0
[[material]]
name = "patch"
reflectance = 0.95
[[light]]
name = "blue"
strength.irradiance_w_per_m2 = 800.0
"#;

/// Frames of one kind.
struct Shots {
    /// Their folder.
    kind: &'static str,
    times_ms: &'static [f64],
    /// Of each exposure time.
    frames: usize,
    /// Group of lights that is on.
    light: &'static str,
    is_filtered: bool,
}

const fn shots(
    kind: &'static str,
    times_ms: &'static [f64],
    light: &'static str,
    is_filtered: bool,
) -> Shots {
    Shots { kind, times_ms, frames: 4, light, is_filtered }
}

/// Shoots frames into their folders. Filtered ones have the filter of the captures, and the viewing filter `view`.
fn shoot(folder: &Path, camera: &str, (filter, view): (&str, &str), all: &[Shots]) {
    let mut captures = String::new();
    for Shots { kind, times_ms, frames, light, is_filtered } in all {
        for (number, ms) in times_ms.iter().enumerate() {
            for frame in 0..*frames {
                captures += &format!("[[capture]]\nname = \"{kind}_{number}_{frame}\"\nexposure_ms = {ms}\n");
                if !light.is_empty() {
                    captures += &format!("light_groups = {{ {light} = 1.0 }}\n");
                }
                captures += if *is_filtered { filter } else { "" };
            }
        }
    }
    fs::write(folder.join("shoot.toml"), format!("{camera}{captures}")).unwrap();
    fluorspar(folder, ["render", "shoot.toml", "--components", "--out", "shoot.exr", "-q"]).well();
    for (out, view) in [("filtered", view), ("open", "view_filter.filters=[]")] {
        fluorspar(folder, ["capture", "shoot.exr", "--set", view, "--out", out, "-q"]).well();
    }
    for Shots { kind, is_filtered, .. } in all {
        fs::create_dir_all(folder.join(kind)).unwrap();
        for file in fs::read_dir(folder.join(if *is_filtered { "filtered" } else { "open" })).unwrap() {
            let file = file.unwrap().path();
            let name = file.file_name().unwrap().to_str().unwrap().to_owned();
            let is_it = name.strip_prefix(&format!("raw_{kind}_"));
            if is_it.is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit())) {
                fs::copy(&file, folder.join(kind).join(name)).unwrap();
            }
        }
    }
}

fn prepared() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fluorspar(folder.path(), ["new", "own-camera", "-q"]).well();
    fluorspar(folder.path(), ["new", "calibration", "-q"]).well();
    let all = [
        shots("dark", &[0.005, 5000.0], "", true),
        shots("flat", &[0.005, 0.01, 0.02, 0.03, 0.04, 0.3], "blue", false),
        shots("tile", &[0.03], "blue", false),
        shots("tile_filtered", &[50.0], "blue", true),
    ];
    let filters = ("filters = [\"band_pass_525_45\"]\n", "view_filter.filters=[\"view_475_700\"]");
    shoot(folder.path(), TRUE_CAMERA, filters, &all);
    folder
}

#[test]
fn the_template_finds_a_camera_that_differs_from_its_data_sheet() {
    let folder = prepared();
    let folder = folder.path();
    let said = fluorspar(folder, ["calibrate", "calibration.toml", "--json"]);
    let (told, found) = (said.stderr.clone(), said.json());
    let near = |path: &str, set: f64, errors: f64| {
        let number = found.pointer(path).unwrap_or_else(|| panic!("{path}: {found:#}"));
        let of = |key: &str| number[key].as_f64().unwrap();
        let error = (of("high") - of("low")) / 3.92;
        assert!((of("value") - set).abs() < errors * error, "{path}: {number}, set {set}");
        assert!(error > 0.0 && error < 0.06 * set.abs(), "{path}: {number}");
    };
    // Of a dozen numbers the farthest may be 3.5 errors off in one of 200 such tests
    for (path, set) in [
        ("/camera/gain_dn_per_e", 1.0 / 3.1),
        ("/camera/dark_noise_e", 4.0),
        ("/camera/black_level_dn", 80.0),
        ("/camera/dark_current_e_per_s", 40.0),
        ("/camera/dsnu_e", 3.0),
        ("/camera/prnu_percent", 1.2),
        ("/camera/channels/0/corner", 0.75),
        // Light and glass are not told apart without a known radiance
        ("/scales/lights/0/factor", 0.8 * 0.7 / 0.9),
    ] {
        near(path, set, 3.5);
    }
    assert_eq!(found["scales"]["lights"][0]["is_absolute"], false);
    assert!(told.contains("absolute quantum efficiency is not measured"), "{told}");
    // Nothing leaks through a filter of 475 nm at 385 nm
    assert!(found["scales"]["leaks"][0]["passed"]["low"].as_f64().unwrap() < 1e-4, "{found:#}");
    let out = folder.join("fluorspar-out/calibrate-calibration");
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    for row in
        ["Linearity", "Uniformity", "Signal to background", "Resolution", "Not measured by these frames"]
    {
        assert!(page.contains(row), "{row}");
    }
    // A fluorescent reference behind the filter tells the same of the light as the tile before it
    let fluorescent =
        TRUE_CAMERA.replace("reflectance = 0.95", "reflectance = 0.95\nconcentrations = { fad = 2.0 }");
    let filters = ("filters = [\"band_pass_525_45\"]\n", "view_filter.filters=[\"view_475_700\"]");
    shoot(folder, &fluorescent, filters, &[shots("reference", &[1.0], "blue", true)]);
    let text = fs::read_to_string(folder.join("calibration.toml")).unwrap();
    let (before, tile) = text.split_once("viewing_filter = false").unwrap();
    let reference = before
        .replace("frames = \"tile\"", "frames = \"reference\"\nfluorophore = \"fad\"\nconcentration = 2.0");
    fs::write(folder.join("reference.toml"), format!("{reference}{tile}")).unwrap();
    let of_reference = fluorspar(folder, ["calibrate", "reference.toml", "--json"]).json();
    let factor = &of_reference["scales"]["lights"][0]["factor"];
    let [value, low, high] = ["value", "low", "high"].map(|key| factor[key].as_f64().unwrap());
    let set = 0.8 * 0.7 / 0.9;
    assert!((value - set).abs() < 3.5 * (high - low) / 3.92 && high - low < 0.12 * set, "{of_reference:#}");
    assert_eq!(of_reference["scales"]["leaks"].as_array().map(Vec::len), Some(0));
    // One light in two captures; without a known radiance it is the sensor that is less sensitive
    let text = fs::read_to_string(out.join("camera.toml")).unwrap();
    assert_eq!(text.matches("blue = 1.0\n").count(), 2, "{text}");
    // Commands take the camera
    let camera = out.join("camera.toml").display().to_string();
    let sensor = fluorspar(folder, ["catalog", "show", "sensor", &camera, "--json"]).json();
    assert!(sensor.to_string().contains("80."), "{sensor}");
    fluorspar(folder, ["check", &camera]).well();
    let frame = format!("green_band={}", folder.join("tile/raw_tile_0_0.tiff").display());
    let place = ["--set", "analysis.rectangle_px=[30, 20, 30, 30]", "--unset", "analysis.parts"];
    let frames =
        ["analyze", "--experiment", &camera, "--frame", &frame, "--set", "analysis.frame=green_band"];
    let more = ["--unset", "analysis.further_frames"];
    fluorspar(folder, frames.iter().chain(&place).chain(&more)).well();
}

#[test]
fn what_frames_do_not_tell_is_refused_by_name() {
    let folder = prepared();
    let folder = folder.path();
    let text = fs::read_to_string(folder.join("calibration.toml")).unwrap();
    let told = |from: &str, to: &str| -> Said {
        assert!(text.contains(from), "{from}");
        fs::write(folder.join("other.toml"), text.replacen(from, to, 1)).unwrap();
        fluorspar(folder, ["calibrate", "other.toml"])
    };
    let refused = |from: &str, to: &str, why: &str| {
        let said = told(from, to);
        assert!(said.code == Some(2) && said.stderr.contains(why), "{to}: {}", said.stderr);
        assert!(!folder.join("fluorspar-out/calibrate-other").exists());
    };
    refused("dark = \"dark\"", "dark = \"drak\"", "dark: there is no file or folder drak");
    refused("flat = \"flat\"", "flat = \"flat/raw_flat_2_0.tiff\"", "twice or more");
    refused("flat = \"flat\"", "flat = \"dark\"", "light an even white surface that fills the frame");
    refused("\"green_band\" # of", "\"green_bnad\" # of", "did you mean \"green_band\"?");
    refused("reflectance = 0.95 #", "reflectance = 95 #", "reflectance = 95 is outside");
    refused("reflectance = 0.95 #", "# ", "give what is known of it");
    refused("reflectance = 0.95 #", "concentration = 2\nreflectance = 0.95 #", "of which `fluorophore`?");
    refused("reflectance = 0.95 #", "fluorophore = \"fda\"\nreflectance = 0.95 #", "did you mean \"fad\"?");
    refused("reflectance = 0.95 #", "fluorophore = \"dye.csv\"\nreflectance = 0.95 #", "tell no yield");
    refused("# region_px = [100, 80, 120, 80]", "region_px = [90, 0, 9, 9]", "leaves the frame of 96 x 72");
    refused("format = 1", "format = 1\nflats = 3", "unknown field `flats`");
    // Another gain, and another size
    let gained = folder.join("flat/raw_flat_1_0.tiff.json");
    let described = fs::read_to_string(&gained).unwrap();
    let mut other: Value = serde_json::from_str(&described).unwrap();
    other["gain"] = 4.0.into();
    fs::write(&gained, other.to_string()).unwrap();
    refused("flat = \"flat\"", "flat = \"flat\" ", "calibrate each gain (ISO) by itself");
    // A lamp that was made stronger from frame to frame
    let longer = fs::read_to_string(folder.join("flat/raw_flat_2_0.tiff.json")).unwrap();
    let mut other: Value = serde_json::from_str(&described).unwrap();
    other["exposure_s"] = serde_json::from_str::<Value>(&longer).unwrap()["exposure_s"].clone();
    fs::write(&gained, other.to_string()).unwrap();
    refused("flat = \"flat\"", "flat = \"flat\"  ", "leave the light alone and vary the exposure time");
    fs::write(&gained, described).unwrap();
    fluorspar(folder, ["capture", "shoot.exr", "--set", "sensor.columns=64", "--out", "small", "-q"]).well();
    let small = "flat = [\"flat\", \"small/raw_flat_1_0.tiff\"]";
    refused("flat = \"flat\"", small, "take both with one sensor");
    // Without a long dark frame, and of a black level that cuts
    let short =
        told("dark = \"dark\"", "dark = [\"dark/raw_dark_0_0.tiff\", \"dark/raw_dark_0_1.tiff\"]").well();
    assert!(short.stderr.contains("dark current is not measured"), "{}", short.stderr);
}

/// A camera of the same kind: colors, electronics, shading, the strength of its excitation.
fn camera_of_kind(factors: [f64; 3], sheet: &str, shading: &str, w_per_m2: f64) -> String {
    let curves = [[0.0, 0.02, 0.03, 0.45, 0.35], [0.02, 0.1, 0.5, 0.1, 0.05], [0.25, 0.45, 0.1, 0.02, 0.03]];
    let efficiency: String = ["R", "G", "B"]
        .into_iter()
        .zip(curves)
        .zip(factors)
        .map(|((name, curve), factor)| {
            format!(
                "[sensor.quantum_efficiency.{name}]\ntype = \"table\"\nwavelength_nm = [350.0, 450.0, 530.0, 610.0, 750.0]\nvalue = {:?}\n",
                curve.map(|value| value * factor)
            )
        })
        .collect();
    format!(
        "format = 1\nbase = \"flat-patch\"\nunset = [\"sensor\", \"capture\", \"analysis\"]\n[render]\nwidth_px = 32\nheight_px = 24\n\
         [sensor]\ncolumns = 96\nrows = 72\npixel_size_um = 3.0\nmosaic = \"rggb\"\nrelative_illumination = {{ all = {shading} }}\n{efficiency}\
         [sensor.emva1288]\nbit_depth = 12\nprnu_percent = 1.0\n{sheet}[[light]]\nname = \"blue\"\nstrength.irradiance_w_per_m2 = {w_per_m2}\n\
         [[light]]\nname = \"white\"\ntype = \"distant\"\naim.direction = [0.0, 0.0, -1.0]\nspectrum = \"equal_energy\"\n\
         strength.irradiance_w_per_m2 = 100.0\n"
    )
}

const TARGETS: &str = r#"
format = 1
experiment = "sheet.toml"
dark = "dark"
flat = "flat"
[[target]]
name = "sphere"
frames = "sphere"
capture = "white"
spectrum = "equal_energy"
uncertainty_percent = 2.0
viewing_filter = false
[[target]]
name = "tile"
frames = "tile"
capture = "blue"
reflectance = 0.95
uncertainty_percent = 1.0
viewing_filter = false
[[target]]
name = "tile behind the filter"
frames = "tile_filtered"
capture = "blue"
reflectance = 0.95
uncertainty_percent = 1.0
"#;

#[test]
fn two_cameras_give_the_same_estimate_once_they_are_calibrated() {
    let sheet = "gain_e_per_dn = 3.0\ndark_noise_e = 5.0\nsaturation_capacity_e = 10000\ndsnu_e = 1.0\n";
    let described = camera_of_kind([1.0; 3], sheet, "[]", 400.0)
        + "[[capture]]\nname = \"white\"\nlight_groups = { white = 1.0 }\n[[capture]]\nname = \"blue\"\nlight_groups = { blue = 1.0 }\n\
           [analysis]\nframe = \"blue\"\nrectangle_px = [20, 12, 56, 48]\nbulk = \"patch\"\nporphyrin = \"protoporphyrin_ix\"\n";
    let first = "gain_e_per_dn = 3.4\ndark_noise_e = 6.0\nsaturation_capacity_e = 10000\nblack_level_dn = 70\ndsnu_e = 3.0\n";
    let second = "gain_e_per_dn = 2.2\ndark_noise_e = 4.0\nsaturation_capacity_e = 8000\nblack_level_dn = 90\ndsnu_e = 2.0\n";
    // The second leaks 3e-4 of its excitation
    let leaking = "view_filter.filters=[{ type = \"table\", wavelength_nm = [300.0, 465.0, 476.0, 700.0, 705.0, 1100.0], \
                   value = [3e-4, 3e-4, 0.95, 0.95, 3e-4, 3e-4] }]";
    let tight = "view_filter.filters=[\"view_475_700\"]";
    let all = [
        shots("dark", &[0.05, 5000.0], "", true),
        shots("flat", &[0.5, 1.0, 2.0, 3.0, 4.0, 30.0], "white", false),
        shots("sphere", &[1.0], "white", false),
        shots("tile", &[0.5], "blue", false),
        shots("tile_filtered", &[100.0], "blue", true),
    ];
    let shares = [
        (camera_of_kind([0.75, 1.0, 1.0], first, "[-0.3, 0.05]", 500.0), tight),
        (camera_of_kind([1.0, 0.9, 1.25], second, "[-0.1]", 300.0), leaking),
    ]
    .map(|(camera, view)| {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let tile = camera.replace("\"analysis\"]", "\"analysis\", \"material.patch.concentrations\"]")
            + "[[material]]\nname = \"patch\"\nreflectance = 0.95\n";
        shoot(folder, &tile, ("", view), &all);
        fs::write(folder.join("sheet.toml"), &described).unwrap();
        fs::write(folder.join("targets.toml"), TARGETS).unwrap();
        let patient =
            camera + "[[capture]]\nname = \"blue\"\nexposure_ms = 100.0\nlight_groups = { blue = 1.0 }\n";
        fs::write(folder.join("patient.toml"), patient).unwrap();
        fluorspar(folder, ["render", "patient.toml", "--components", "--out", "patient.exr", "-q"]).well();
        fluorspar(folder, ["capture", "patient.exr", "--set", view, "--out", "patient", "-q"]).well();
        fluorspar(folder, ["calibrate", "targets.toml", "--out", "calibrated", "-q"]).well();
        // Of an experiment of the catalogue
        let built_in = "format = 1\nexperiment = \"oraleye-2021\"\ndark = \"dark\"\nflat = \"flat\"\n";
        fs::write(folder.join("built_in.toml"), built_in).unwrap();
        fluorspar(folder, ["calibrate", "built_in.toml", "--out", "built-in", "-q"]).well();
        fluorspar(folder, ["check", "built-in/camera.toml", "-q"]).well();
        // The folder of both may be moved
        let camera = fs::read_to_string(folder.join("calibrated/camera.toml")).unwrap();
        assert!(camera.contains("base = \"../sheet.toml\""), "{camera}");
        ["sheet.toml", "calibrated/camera.toml"].map(|by| {
            let frame = ["--frame", "blue=patient/raw_blue.tiff", "--json"];
            let found = fluorspar(folder, ["analyze", "--experiment", by].iter().chain(&frame)).json();
            let share =
                found["findings"].as_array().unwrap().iter().find(|finding| finding["id"] == "line_share");
            let share = share.unwrap_or_else(|| panic!("{found:#}"));
            [&share["value"], &share["interval"][0], &share["interval"][1]].map(|end| end.as_f64().unwrap())
        })
    });
    let [[sheet_a, a], [sheet_b, b]] = shares;
    assert!((sheet_a[0] - sheet_b[0]).abs() > 0.1, "by the data sheet they differ: {shares:?}");
    assert!(a[1] < b[2] && b[1] < a[2], "intervals by sensor noise alone overlap: {shares:?}");
}
