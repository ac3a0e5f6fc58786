//! A lamp whose own short-pass ends where the viewing filter begins: what leaks through both must not depend on how wide the
//! bands are, though both edges fall within one of them.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::experiment::{ResolvedExperiment, parse, parse_sample, resolve};
use fluorspar::image::ComponentImage;
use fluorspar::pipeline::{FlatSample, RegionRadiance, capture, predict, read_spectroradiometers};
use fluorspar::preset;
use fluorspar::render::{RenderControl, render};

/// Reflectance and emission differ a little over 10 nm; products of bin averages were off by factors of 1.3 and 2.2.
const TOLERANCE: f64 = 0.03;

fn assert_invariant(what: &str, value: impl Fn(f64) -> f64) {
    let fine = value(1.0);
    for step_nm in [5.0, 10.0] {
        let coarse = value(step_nm);
        assert!((coarse / fine - 1.0).abs() < TOLERANCE, "{what}, {step_nm} nm: {coarse}, at 1 nm {fine}");
    }
}

/// The flat patch under the steep pair, rendered with one path a pixel: direct parallel light has no noise.
fn patch(step_nm: f64, changes: &[&str]) -> (ResolvedExperiment, ComponentImage) {
    let mut overrides: Vec<String> = [
        "light.blue.spectrum=led_450",
        "light.blue.filters=[\"short_pass_475\"]",
        "render.width_px=4",
        "render.height_px=3",
        "render.samples_per_pixel=1",
        "sensor.mode.kind=\"noise_free\"",
        "sensor.columns=4",
        "sensor.rows=4",
        "capture.blue.exposure_ms=1",
    ]
    .map(String::from)
    .to_vec();
    overrides.extend(changes.iter().map(|change| (*change).to_string()));
    overrides.push(format!("spectral.step_nm={step_nm}"));
    let text = preset::experiment("flat-patch").unwrap().text;
    let experiment = resolve(&parse(text, "flat-patch", Path::new("."), &overrides).unwrap()).unwrap();
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let image = render(&experiment.scene, &experiment.render, &control).unwrap();
    (experiment, image)
}

#[test]
fn the_leak_of_a_sample_does_not_depend_on_the_bands() {
    assert_invariant("sample", |step_nm| {
        let overrides = [
            "light.spectrum=led_450".to_string(),
            "light.filters=[\"short_pass_475\"]".to_string(),
            format!("spectral.step_nm={step_nm}"),
        ];
        let text = preset::sample("tongue-385nm").unwrap().text;
        let sample = parse_sample(text, "test", Path::new("."), &overrides).unwrap();
        predict(&FlatSample::new(&sample).unwrap()).unwrap().leak_ratio.unwrap()
    });
}

#[test]
fn the_leak_of_a_region_does_not_depend_on_the_bands() {
    assert_invariant("region", |step_nm| {
        let (experiment, image) = patch(step_nm, &[]);
        let frame = &experiment.captures.iter().find(|c| c.frame.label == "blue").unwrap().frame;
        let region = RegionRadiance::new(&image, frame, &[5, 6]);
        region.leak_ratio(&experiment).unwrap()
    });
}

#[test]
fn frames_of_leaking_light_do_not_depend_on_the_bands() {
    // Nothing fluoresces, so all that the sensor sees is lamp.
    assert_invariant("frame", |step_nm| {
        let (experiment, image) = patch(
            step_nm,
            &[
                "material.patch.concentrations={}",
                "analysis={ frame = \"blue\", parts = [\"patch\"] }",
                "capture.blue.exposure_ms=2000",
            ],
        );
        let frames = capture(&experiment, &image).unwrap();
        let frame = frames.iter().find(|f| f.raw.label == "blue").unwrap();
        let signal: f32 = frame.developed.data.iter().sum();
        assert!(signal > 300.0, "{signal}");
        f64::from(signal)
    });
}

#[test]
fn readings_behind_a_filter_do_not_depend_on_the_bands() {
    assert_invariant("spectroradiometer", |step_nm| {
        let spot = "spectroradiometer=[{ name = \"spot\", capture = \"blue\", filters = [\"long_pass_475\"], \
                    bandwidth_nm = 20.0, aim = [0.5, 0.5] }]";
        let (experiment, image) = patch(step_nm, &[spot]);
        let reading = &read_spectroradiometers(&experiment, &image).unwrap()[0].reading;
        // Around the two edges the lamp is all that there is.
        let near = |nm: &f64| (455.0..=485.0).contains(nm);
        let seen = reading.wavelength_nm.iter().zip(&reading.expected).filter(|(nm, _)| near(nm));
        seen.map(|(_, value)| value).sum()
    });
}
