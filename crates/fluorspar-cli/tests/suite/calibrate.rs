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

/// Frames of each kind: folder, exposure times in ms, frames of each, whether the light is on, the viewing filter.
const SHOTS: [(&str, &[f64], usize, bool, bool); 4] = [
    ("dark", &[0.005, 5000.0], 6, false, true),
    ("flat", &[0.005, 0.01, 0.02, 0.03, 0.04, 0.3], 4, true, false),
    ("tile", &[0.03], 3, true, false),
    ("tile_filtered", &[50.0], 3, true, true),
];

/// Shoots all frames into their folders.
fn shoot(folder: &Path, camera: &str) {
    let mut captures = String::new();
    for (kind, times, frames, is_lit, has_filter) in SHOTS {
        for (number, ms) in times.iter().enumerate() {
            for frame in 0..frames {
                let light = if is_lit { "light_groups = { blue = 1.0 }" } else { "" };
                let filter = if has_filter { "filters = [\"band_pass_525_45\"]" } else { "" };
                captures += &format!(
                    "[[capture]]\nname = \"{kind}_{number}_{frame}\"\nexposure_ms = {ms}\n{light}\n{filter}\n"
                );
            }
        }
    }
    fs::write(folder.join("shoot.toml"), format!("{camera}{captures}")).unwrap();
    fluorspar(folder, ["render", "shoot.toml", "--components", "--out", "shoot.exr", "-q"]).well();
    fluorspar(folder, ["capture", "shoot.exr", "--out", "filtered", "-q"]).well();
    let open = "view_filter.filters=[]";
    fluorspar(folder, ["capture", "shoot.exr", "--set", open, "--out", "open", "-q"]).well();
    for (kind, _, _, _, has_filter) in SHOTS {
        fs::create_dir_all(folder.join(kind)).unwrap();
        for file in fs::read_dir(folder.join(if has_filter { "filtered" } else { "open" })).unwrap() {
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
    shoot(folder.path(), TRUE_CAMERA);
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
    refused("flat = \"flat\"", "flat = \"dark\"", "does not rise with the light");
    refused("\"green_band\" # of", "\"green_bnad\" # of", "did you mean \"green_band\"?");
    refused("reflectance = 0.95 #", "reflectance = 95 #", "reflectance = 95 is outside");
    refused("reflectance = 0.95 #", "# ", "give what is known of it");
    refused("# region_px = [100, 80, 120, 80]", "region_px = [90, 0, 9, 9]", "leaves the frame of 96 x 72");
    refused("format = 1", "format = 1\nflats = 3", "unknown field `flats`");
    // Another gain, and another size
    let gained = folder.join("flat/raw_flat_1_0.tiff.json");
    let described = fs::read_to_string(&gained).unwrap();
    let mut other: Value = serde_json::from_str(&described).unwrap();
    other["gain"] = 4.0.into();
    fs::write(&gained, other.to_string()).unwrap();
    refused("flat = \"flat\"", "flat = \"flat\" ", "calibrate each gain (ISO) by itself");
    fs::write(&gained, described).unwrap();
    fluorspar(folder, ["capture", "shoot.exr", "--set", "sensor.columns=64", "--out", "small", "-q"]).well();
    let small = "flat = [\"flat\", \"small/raw_flat_1_0.tiff\"]";
    refused("flat = \"flat\"", small, "take both with one sensor");
    // Without a long dark frame, and of a black level that cuts
    let short =
        told("dark = \"dark\"", "dark = [\"dark/raw_dark_0_0.tiff\", \"dark/raw_dark_0_1.tiff\"]").well();
    assert!(short.stderr.contains("dark current is not measured"), "{}", short.stderr);
}
