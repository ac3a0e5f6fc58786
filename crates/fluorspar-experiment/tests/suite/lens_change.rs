//! Frames taken from one component image with other lenses and sensors: what is seen, and which part is where.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]

use std::path::Path;

use fluorspar::image::{Component, ComponentImage, FeatureMaps, LightPath};
use fluorspar::pipeline::{analyze, capture};
use fluorspar::study::Study;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{parse, resolve};

const RENDER: (usize, usize) = (64, 48);

/// The flat patch under 475-700 nm light of its own, taken without noise.
fn experiment(changes: &[&str]) -> Study {
    let mut overrides: Vec<String> =
        ["sensor.mode.type=\"noise_free\"", "capture.blue.exposure_ms=1"].map(String::from).to_vec();
    overrides.extend(changes.iter().map(|c| (*c).to_owned()));
    let text = preset::text(PresetKind::Experiment, "flat-patch").unwrap();
    resolve(&parse(text, "flat-patch", Path::new("."), &overrides).unwrap()).unwrap().study
}

/// Bright in the middle half of both axes ("middle"), dim around it ("rim"), as `rendered` would have seen it.
fn image(rendered: &Study) -> ComponentImage {
    let label = Component::of_group("blue", LightPath::Fluorescence("fad".into()));
    let (width, height) = RENDER;
    let mut image = ComponentImage::zeros(rendered.scene.grid.clone(), width, height, vec![label]);
    let is_middle = |pixel: usize| {
        let (row, col) = (pixel / width, pixel % width);
        (width / 4..3 * width / 4).contains(&col) && (height / 4..3 * height / 4).contains(&row)
    };
    let bands = image.grid.len();
    for (pixel, values) in image.data.chunks_exact_mut(bands).enumerate() {
        values.fill(if is_middle(pixel) { 0.04 } else { 0.01 });
    }
    image.features = FeatureMaps {
        part: (0..width * height).map(|pixel| if is_middle(pixel) { 1 } else { 2 }).collect(),
        part_names: vec!["middle".into(), "rim".into()],
        view: rendered.scene.camera.view(),
        ..FeatureMaps::default()
    };
    image
}

/// Share of the pixels of the blue frame that are brighter than half of the brightest.
fn bright_share(taken_with: &Study, image: &ComponentImage) -> f64 {
    let frames = capture(taken_with, image).unwrap();
    let frame = frames.iter().find(|f| f.raw.label == "blue").unwrap();
    let green: Vec<f32> = frame.developed.data.iter().skip(1).step_by(3).copied().collect();
    let brightest = green.iter().copied().fold(0.0, f32::max);
    green.iter().filter(|&&v| v > 0.5 * brightest).count() as f64 / green.len() as f64
}

#[test]
fn a_longer_lens_sees_less_and_a_shorter_one_more() {
    let rendered = experiment(&[]);
    let image = image(&rendered);
    assert!((bright_share(&rendered, &image) - 0.25).abs() < 0.02);
    // Image distance f d / (d - f), and so the scale, doubles at f = 6 f0 d / (3 d + 3 f0) of f0 = 3, d = 100.
    let scale = |f: f64| f * 100.0 / (100.0 - f);
    let f = 2.0 * scale(3.0) * 100.0 / (100.0 + 2.0 * scale(3.0));
    assert!((scale(f) / scale(3.0) - 2.0).abs() < 1e-12);
    let longer = experiment(&[&format!("lens.focal_length_mm={f}")]);
    assert!(bright_share(&longer, &image) > 0.999, "{}", bright_share(&longer, &image));
    // A quarter of the sensor sees the middle only; four times the sensor sees the image in its middle quarter.
    let cropped = experiment(&["sensor.columns=160", "sensor.rows=120"]);
    assert!(bright_share(&cropped, &image) > 0.999);
    let larger = experiment(&["sensor.columns=640", "sensor.rows=480"]);
    assert!((bright_share(&larger, &image) - 0.0625).abs() < 0.01);
}

#[test]
fn parts_stay_where_they_are_seen() {
    let rendered = experiment(&[]);
    let image = image(&rendered);
    for (change, share) in [(vec![], 0.25), (vec!["sensor.columns=640", "sensor.rows=480"], 0.0625)] {
        let mut changes: Vec<&str> = change;
        changes.push("analysis.parts=[\"patch\"]");
        let mut taken_with = experiment(&changes);
        taken_with.analysis.as_mut().unwrap().parts = vec!["middle".into()];
        let frames = capture(&taken_with, &image).unwrap();
        let analyzed = analyze(&taken_with, Some(&image), &frames).unwrap().unwrap();
        let pixels = analyzed.region.width * analyzed.region.height;
        let seen = analyzed.region.pixels.len() as f64 / pixels as f64;
        assert!((seen - share).abs() < 0.01, "{seen} of the sensor");
        let green = analyzed.analysis.channels.iter().find(|c| c.name == "G").unwrap();
        let s = green.statistics.as_ref().unwrap();
        // Samples are larger than pixels: those on the border have some of what lies beyond it
        assert!(s.p25 > 0.98 * s.p95 && s.min > 0.5 * s.p95, "the region holds bright pixels only: {s:?}");
    }
}

#[test]
fn a_moved_camera_is_refused() {
    let image = image(&experiment(&[]));
    let moved = experiment(&["camera.position_mm=[0, 0, 120]"]);
    let error = capture(&moved, &image).unwrap_err().to_string();
    assert!(error.contains("Render the experiment again"), "{error}");
}
