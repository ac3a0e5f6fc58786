//! Experiment files with a traced lens, from text to frames: both ways of image formation, filters, their own light.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::experiment::{ResolvedExperiment, parse, resolve};
use fluorspar::pipeline::capture;
use fluorspar::preset;
use fluorspar::render::{RenderControl, render};

/// The flat patch, small and without noise, with another lens section.
fn experiment(lens: &str, changes: &[&str]) -> ResolvedExperiment {
    let mut overrides: Vec<String> = [
        "sensor.mode.kind=\"noise_free\"",
        "capture.blue.exposure_ms=1",
        "render.width_px=16",
        "render.height_px=12",
        "render.samples_per_pixel=512",
        "sensor.columns=32",
        "sensor.rows=24",
    ]
    .map(String::from)
    .to_vec();
    overrides.extend(changes.iter().map(|c| (*c).to_owned()));
    let text = preset::experiment("flat-patch").unwrap().text;
    let ideal = "focal_length_mm = 3.0\nf_number = 4.0\nvignetting = \"none\"\n";
    assert!(text.contains(ideal));
    let text = text.replace(ideal, lens);
    resolve(&parse(&text, "flat-patch", Path::new("."), &overrides).unwrap()).unwrap()
}

/// Mean signal of the channels of the blue frame, DN.
fn signal(experiment: &ResolvedExperiment) -> [f64; 3] {
    let stop = AtomicBool::new(false);
    let control = RenderControl { stop: &stop, progress: &|_| {} };
    let image = render(&experiment.scene, &experiment.render, &control).unwrap();
    let frames = capture(experiment, &image).unwrap();
    let data = &frames.iter().find(|f| f.raw.label == "blue").unwrap().developed.data;
    [0, 1, 2].map(|channel| {
        let values = data.iter().skip(channel).step_by(3);
        values.map(|v| f64::from(*v)).sum::<f64>() / (data.len() / 3) as f64
    })
}

const TRACED: &str = "type = \"traced\"\nprescription = \"wide_3_5mm\"\n";

#[test]
fn both_ways_and_the_camera_equation_give_the_same_signal() {
    let rendered = signal(&experiment(TRACED, &[]));
    let spread = signal(&experiment(TRACED, &["lens.image_formation=\"point_spread\""]));
    let traced = experiment(TRACED, &[]);
    assert!(traced.scene.camera.lens.is_some() && traced.traced_lens.is_some());
    // An ideal lens of the same focal length, working f-number and no falloff: the film is small beside the focal length.
    let ideal = "focal_length_mm = 3.502\nf_number = 4.002\nvignetting = \"none\"\n";
    let ideal = signal(&experiment(ideal, &[]));
    println!("{rendered:?} {spread:?} {ideal:?}");
    for channel in 0..3 {
        assert!((spread[channel] / rendered[channel] - 1.0).abs() < 0.01, "{rendered:?} {spread:?}");
        // f (1 + |m|) of an ideal lens has pupils of the same size; this one has larger exit than entrance pupils: 3 %.
        assert!((ideal[channel] / rendered[channel] - 1.0).abs() < 0.05, "{rendered:?} {ideal:?}");
    }
}

#[test]
fn filters_act_at_the_angles_of_the_lens_and_add_their_own_light() {
    let spread = "lens.image_formation=\"point_spread\"";
    let fixed = signal(&experiment(TRACED, &[spread]));
    // Behind an f/4 lens the cone is 7 degrees wide: the edge of the long-pass moves by less than 1 nm, more light passes.
    let rear = ["view_filter.angles=\"lens\"", "view_filter.position=\"rear\""];
    let cone = signal(&experiment(TRACED, &[spread, rear[0], rear[1]]));
    println!("{fixed:?} {cone:?}");
    assert!(cone[2] > fixed[2] && cone[2] < 1.05 * fixed[2], "{fixed:?} {cone:?}");
    let own = "view_filter.autofluorescence={ photon_yield = 0.01, spectrum = \"led_450\" }";
    let veiled = signal(&experiment(TRACED, &[spread, own]));
    assert!((0..3).all(|c| veiled[c] > fixed[c]), "{fixed:?} {veiled:?}");
    // The veil is as strong as its yield.
    let twice = signal(&experiment(TRACED, &[spread, &own.replace("0.01", "0.02")]));
    for channel in 0..3 {
        let ratio = (twice[channel] - fixed[channel]) / (veiled[channel] - fixed[channel]);
        assert!((ratio - 2.0).abs() < 0.02, "{channel}: {ratio}");
    }
}
