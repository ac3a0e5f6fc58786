//! What a frame holds follows the time in which light fell and the pixels that are joined: estimates of a strobe's frame and of joined pixels are
//! those of a plain frame.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::analysis::{Analysis, Unmixing};
use fluorspar::findings::{FindingId, region_findings};
use fluorspar::pipeline::{evaluate, predict};
use fluorspar::render::{RenderControl, render};
use fluorspar_experiment::{parse, parse_sample, resolve};

/// A sensor without colors behind two filters, one after the other.
const TWO_FRAMES: &str = r#"
format = 1
base = "flat-patch"
unset = ["capture", "analysis", "sensor"]
render = { width_px = 8, height_px = 6, samples_per_pixel = 1 }
[view_filter]
filters = ["long_pass_475"]
[sensor]
preset = "monochrome_3_45um"
columns = 32
rows = 24
mode.type = "noise_free"
[[capture]]
name = "green"
light_groups = { blue = 1.0 }
filters = ["band_pass_525_45"]
exposure_ms = 10.0
[[capture]]
name = "red"
light_groups = { blue = 1.0 }
filters = ["band_pass_635_50"]
exposure_ms = 30.0
[analysis]
frame = "red"
further_frames = ["green"]
parts = ["patch"]
porphyrin = "protoporphyrin_ix"
bulk = "patch"
"#;

fn analyzed(changes: &[&str]) -> Analysis {
    let changes: Vec<String> = changes.iter().map(|change| (*change).to_owned()).collect();
    let study = resolve(&parse(TWO_FRAMES, "two", Path::new("."), &changes).unwrap()).unwrap().study;
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let image = render(&study.scene, &study.render, &control).unwrap();
    evaluate(&study, &image).unwrap().analysis.unwrap().analysis
}

fn unmixed(changes: &[&str]) -> (Unmixing, f64) {
    let summary = analyzed(changes).signals.unwrap();
    (summary.unmixing.unwrap(), summary.ratios[0].ratio)
}

#[test]
fn amounts_are_those_of_the_time_in_which_light_fell() {
    let (plain, ratio) = unmixed(&[]);
    // A strobe leaves each frame as much light, however long it is open
    let strobe = unmixed(&["sensor.strobe={ duration_ms = 5.0 }"]);
    let joined = unmixed(&["sensor.binning={ type = \"charge\", columns = 2, rows = 2 }"]);
    let added = unmixed(&["sensor.binning={ type = \"digital_sum\", columns = 2, rows = 2 }"]);
    let averaged = unmixed(&["sensor.binning={ type = \"digital_average\", columns = 2, rows = 2 }"]);
    for (found, of) in [strobe, joined, added, averaged] {
        assert!((of / ratio - 1.0).abs() < 0.01, "{of} {ratio}");
        for (term, wanted) in found.terms.iter().zip(&plain.terms) {
            assert!((term.amount / wanted.amount - 1.0).abs() < 0.02, "{found:?} {plain:?}");
        }
    }
}

/// The share of all signals, and not that of the analyzed frame, stands beside what is estimated from all of them.
#[test]
fn the_truth_beside_an_unmixed_share_is_that_of_all_signals() {
    let analysis = analyzed(&[]);
    let findings = region_findings(&analysis);
    let last = |id| findings.iter().rfind(|finding| finding.id == id).unwrap();
    let truth = last(FindingId::TrueShare).value.unwrap();
    assert_eq!(last(FindingId::UnmixedShare).reference, Some(truth));
    assert!(analysis.truth.unwrap().share > 1.2 * truth, "{truth}");
}

#[test]
fn parts_of_a_prediction_add_up_under_a_strobe_and_where_pixels_are_joined() {
    let sample = |exposure_ms: f64, more: &str| {
        let text = format!(
            "format = 1\nlight = {{ spectrum = \"led_385\", strength.irradiance_w_per_m2 = 100.0 }}\n\
             sample = {{ reflectance = 0.2, concentrations = {{ fad = 0.1, protoporphyrin_ix = 0.05 }} }}\n\
             view_filter.filters = [\"view_475_700\"]\nlens.f_number = 4.0\nsensor = {{ preset = \"lyu_2021_table_1\"{more} }}\n\
             exposure.exposure_ms = {exposure_ms:.1}\n"
        );
        predict(&parse_sample(&text, "sample", Path::new("."), &[]).unwrap().sample).unwrap()
    };
    let (lit, plain) = (sample(30.0, ", strobe = { duration_ms = 6.0 }"), sample(6.0, ""));
    let joined = sample(6.0, ", binning = { type = \"digital_sum\", columns = 2, rows = 2 }");
    for (found, pixels) in [(&lit, 1.0), (&joined, 4.0)] {
        for (name, channel) in &found.channels {
            let parts = channel.electrons_reflected + channel.electrons_fluorescence.values().sum::<f64>();
            assert!((parts / channel.electrons - 1.0).abs() < 1e-3, "{name}: {channel:?}");
            let other = &plain.channels[name];
            let alone = pixels * other.electrons;
            assert!((channel.electrons / alone - 1.0).abs() < 1e-9, "{name}: {channel:?} {other:?}");
        }
    }
    assert_eq!((lit.exposure_s, lit.porphyrin), (Some(0.03), plain.porphyrin));
}
