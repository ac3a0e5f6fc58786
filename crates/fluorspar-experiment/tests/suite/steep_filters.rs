//! A light whose own short-pass ends where the viewing filter begins: what leaks through both must not depend on how wide the
//! bands are, though both edges fall within one of them.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::analysis::PixelSelection;
use fluorspar::image::{ComponentFactors, ComponentImage};
use fluorspar::pipeline::{
    CapturePlanes, RegionRadiance, SeenComponents, capture, frame_leak, predict, read_spectroradiometers,
};
use fluorspar::render::{RenderControl, render};
use fluorspar::study::Study;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{parse, parse_sample, resolve};

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
fn patch(step_nm: f64, changes: &[&str]) -> (Study, ComponentImage) {
    let mut overrides: Vec<String> = [
        "light.blue.spectrum=led_450",
        "light.blue.filters=[\"short_pass_475\"]",
        "render.width_px=4",
        "render.height_px=3",
        "render.samples_per_pixel=1",
        "sensor.mode.type=\"noise_free\"",
        "sensor.columns=4",
        "sensor.rows=4",
        "capture.blue.exposure_ms=1",
    ]
    .map(String::from)
    .to_vec();
    overrides.extend(changes.iter().map(|change| (*change).to_string()));
    overrides.push(format!("spectral.step_nm={step_nm}"));
    let text = preset::text(PresetKind::Experiment, "flat-patch").unwrap();
    let study = resolve(&parse(text, "flat-patch", Path::new("."), &overrides).unwrap()).unwrap().study;
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let image = render(&study.scene, &study.render, &control).unwrap();
    (study, image)
}

#[test]
fn the_leak_of_a_sample_does_not_depend_on_the_bands() {
    assert_invariant("sample", |step_nm| {
        let overrides = [
            "light.spectrum=led_450".to_string(),
            "light.filters=[\"short_pass_475\"]".to_string(),
            format!("spectral.step_nm={step_nm}"),
        ];
        let text = preset::text(PresetKind::Sample, "tongue-385nm").unwrap();
        let sample = parse_sample(text, "test", Path::new("."), &overrides).unwrap();
        predict(&sample.sample).unwrap().leak_ratio.unwrap()
    });
}

#[test]
fn the_leak_of_a_region_does_not_depend_on_the_bands() {
    assert_invariant("region", |step_nm| {
        let (study, image) = patch(step_nm, &[]);
        let frame = &study.captures.iter().find(|c| c.frame.label == "blue").unwrap().frame;
        let region = RegionRadiance::new(&image, frame, &[5, 6]);
        region.leak_ratio(&study).unwrap()
    });
}

/// The split of a frame is complete: reflected and fluorescent electrons of each channel add up to what the noise-free
/// sensor writes down, and their ratio is that of the region's radiance.
#[test]
fn electrons_of_a_frame_are_leak_or_fluorescence() {
    let (study, image) = patch(5.0, &[]);
    let settings = study.captures.iter().find(|c| c.frame.label == "blue").unwrap();
    let frames = capture(&study, &image).unwrap();
    let raw = &frames.iter().find(|f| f.raw.label == "blue").unwrap().raw;
    let planes = CapturePlanes::new(&study, &image).unwrap();
    let factors = ComponentFactors::ones(image.components.len());
    let seen =
        SeenComponents { image: &image, planes: &planes, captures: &study.captures, factors: &factors };
    let leak = frame_leak(&study, &image, &seen, settings, raw.exposure_s, None).unwrap().unwrap();
    assert_eq!(leak.pixels, 16);
    assert!(raw.data.iter().all(|&dn| dn < raw.white_level), "{:?}", raw.data);
    for (channel, part) in leak.channels.iter().enumerate() {
        let own = |i: &usize| raw.mosaic.channel(i / raw.width, i % raw.width) == channel;
        let values: Vec<f64> = (0..raw.data.len()).filter(own).map(|i| f64::from(raw.data[i])).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let seen_e = (mean - raw.black_level) / raw.dn_per_electron;
        let expected_e = part.reflected_e + part.fluorescent_e;
        // Digital numbers are rounded; a mean of rounded values is off by half a step at most. Samples have 24 bits.
        let tolerance = 0.5 / raw.dn_per_electron + 1e-4 * expected_e;
        assert!((seen_e - expected_e).abs() <= tolerance, "{}: {seen_e}, expected {expected_e}", part.name);
        assert!(part.reflected_e > 0.0 && part.fluorescent_e > 0.0, "{part:?}");
    }
    let all: Vec<usize> = (0..image.width * image.height).collect();
    let region = RegionRadiance::new(&image, &settings.frame, &all).leak_ratio(&study).unwrap();
    // The film is larger than the sensor, and light falls off toward its corners alike for both kinds of light.
    assert!((leak.leak_ratio.unwrap() / region - 1.0).abs() < 0.01, "{leak:?}, {region}");
    assert!(!leak.is_reflectance());
    // What a subtracted frame has of the same light is neither
    let mut halved = study.clone();
    let dark = settings.subtract.clone().unwrap();
    let other = halved.captures.iter_mut().find(|c| c.frame.label == dark).unwrap();
    other.frame.lights =
        settings.frame.lights.iter().map(|(name, drive)| (name.clone(), 0.5 * drive)).collect();
    let half = frame_leak(&halved, &image, &seen, settings, raw.exposure_s, None).unwrap().unwrap();
    for (half, all) in half.electrons().iter().zip(leak.electrons()) {
        assert!((half / all - 0.5).abs() < 1e-6, "{half} {all}");
    }
    // A selection of one pixel has one channel; a frame without light has no leak.
    let one = PixelSelection { width: raw.width, height: raw.height, pixels: vec![5] };
    let one = frame_leak(&study, &image, &seen, settings, raw.exposure_s, Some(&one)).unwrap().unwrap();
    assert_eq!((one.pixels, one.channels.len()), (1, 1));
    let mut dark = settings.clone();
    dark.frame.lights.clear();
    assert_eq!(frame_leak(&study, &image, &seen, &dark, 0.03, None).unwrap(), None);
}

#[test]
fn frames_of_leaking_light_do_not_depend_on_the_bands() {
    // Nothing fluoresces, so the sensor sees excitation light only.
    assert_invariant("frame", |step_nm| {
        let (study, image) = patch(
            step_nm,
            &[
                "material.patch.concentrations={}",
                "analysis={ frame = \"blue\", parts = [\"patch\"] }",
                "capture.blue.exposure_ms=2000",
            ],
        );
        let frames = capture(&study, &image).unwrap();
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
        let (study, image) = patch(step_nm, &[spot]);
        let reading = &read_spectroradiometers(&study, &image).unwrap()[0].reading;
        // Around the two edges there is nothing but excitation light.
        let near = |nm: &f64| (455.0..=485.0).contains(nm);
        let seen = reading.wavelength_nm.iter().zip(&reading.expected).filter(|(nm, _)| near(nm));
        seen.map(|(_, value)| value).sum()
    });
}
