//! Surfaces that emit on one side or on both, from the file to the light.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::f64::consts::PI;
use std::sync::atomic::AtomicBool;

use fluorspar::render::{RenderControl, render};
use fluorspar_experiment::{parse, resolve};

/// Mean radiance of a white patch that sees nothing but a disc of 10 mm, 100 mm above it, which emits 5 W/(sr m²). `normal` is that
/// of the disc.
fn radiance(normal: &str, sides: &str) -> f64 {
    let text = format!(
        r#"
format = 1
[spectral]
first_nm = 500
last_nm = 520
step_nm = 10
[render]
width_px = 4
height_px = 4
samples_per_pixel = 256
max_depth = 1
[camera]
position_mm = [0.0, 30.0, 100.0]
look_at_mm = [0.0, 0.0, 0.0]
horizontal_field_deg = 0.5
[[material]]
name = "white"
reflectance = 1.0
[[object]]
name = "patch"
material = "white"
type = "disc"
center_mm = [0.0, 0.0, 0.0]
normal = [0.0, 0.0, 1.0]
radius_mm = 2.0
[[object]]
name = "lamp"
material = "white"
type = "disc"
center_mm = [0.0, 0.0, 100.0]
normal = {normal}
radius_mm = 10.0
emission = {{ group = "lamp", spectrum = 1.0, radiance_w_per_sr_m2 = 5.0{sides} }}
"#
    );
    let study = resolve(&parse(&text, "test", std::path::Path::new("."), &[]).unwrap()).unwrap().study;
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| () };
    let image = render(&study.scene, &study.render, &control).unwrap().recombine(|_| 1.0);
    // Over 200 to 1200 nm, on which the radiance of the file is.
    image.mean_spectrum().values().iter().sum::<f64>() / 3.0 * 1000.0
}

/// The irradiance below the middle of a disc is `pi L r² / (r² + h²)`, and a white patch sends on `E / pi`. A lamp that turns its
/// back sends nothing, unless it emits on both sides.
#[test]
fn one_side_or_both_emit() {
    let expected = 5.0 * 0.01 / (0.01 + 1.0);
    let (down, up) = ("[0.0, 0.0, -1.0]", "[0.0, 0.0, 1.0]");
    let (front, both) = (", sides = \"front\"", ", sides = \"both\"");
    // The radiance of the disc hardly changes over the few milliradians that the patch sees of it: 256 stratified samples of each of 16
    // pixels leave less than 1e-3, and the patch of 0.5 degrees sees it from 0.4 mm beside the axis at most.
    for (normal, sides) in [(down, front), (down, both), (up, both), (up, "")] {
        let found = radiance(normal, sides);
        assert!((found / expected - 1.0).abs() < 3e-3, "{normal} {sides}: {found} {expected} {}", PI);
    }
    assert_eq!(radiance(up, front), 0.0);
}
