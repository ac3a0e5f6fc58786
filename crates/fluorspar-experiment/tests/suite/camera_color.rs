//! The color matrix of the paper's camera.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use fluorspar::pipeline::CameraColor;
use fluorspar_experiment::{parse, resolve};

/// The camera of the paper without its viewing filter: white stays white to 2 %, and the colors of tissues come out
/// within some per cent of white.
#[test]
fn a_camera_matrix_predicts_the_channels() {
    let text = "format = 1\nbase = \"oraleye-2021\"\n[view_filter]\nfilters = [\"uv_ir\"]";
    let study = resolve(&parse(text, "test", std::path::Path::new("."), &[]).unwrap()).unwrap().study;
    let capture = study.captures.iter().find(|c| c.frame.label == "white").unwrap();
    let color = CameraColor::of_frame(&study, capture).unwrap();
    let xyz_of_d65 = [0.9505, 1.0, 1.0888];
    let camera: Vec<f64> =
        color.xyz_to_camera.iter().map(|row| row.iter().zip(xyz_of_d65).map(|(m, x)| m * x).sum()).collect();
    let largest = camera.iter().copied().fold(0.0, f64::max);
    assert!((largest - 1.0).abs() < 0.02, "{camera:?}");
    // Green is the most sensitive channel under daylight; red of XYZ goes mostly to red.
    assert!(camera[1] >= camera[0] && camera[1] >= camera[2], "{camera:?}");
    assert!(color.xyz_to_camera[0][0] > 0.0 && color.xyz_to_camera[2][2] > 0.0);
    assert!(color.neutral.iter().all(|v| (0.05..=1.0).contains(v)), "{:?}", color.neutral);
    // A frame without visible light takes the neutral of daylight.
    let blue = study.captures.iter().find(|c| c.frame.label == "blue").unwrap();
    let neutral = CameraColor::of_frame(&study, blue).unwrap().neutral;
    for (n, c) in neutral.iter().zip(&camera) {
        assert!((n - c / largest).abs() < 0.05, "{neutral:?} {camera:?}");
    }
}
