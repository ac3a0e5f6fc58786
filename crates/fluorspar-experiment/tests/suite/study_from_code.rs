//! A study from a file and the same study from code give the same bits.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::pipeline::evaluate;
use fluorspar::render::{RenderControl, render};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{parse, resolve};

#[allow(dead_code, reason = "the main function of the example")]
#[path = "../../examples/study_from_code.rs"]
mod example;

#[test]
fn a_flat_patch_is_the_same_from_file_and_from_code() {
    let text = preset::text(PresetKind::Experiment, "flat-patch").unwrap();
    let from_file = resolve(&parse(text, "flat-patch", Path::new("."), &[]).unwrap()).unwrap().study;
    let from_code = example::study().unwrap();
    assert_eq!(from_code.scene.fluorophores, from_file.scene.fluorophores);
    assert_eq!(from_code.scene.camera, from_file.scene.camera);
    assert!(from_code.scene == from_file.scene, "the scenes differ");

    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let [file, code] = [&from_file, &from_code].map(|study| {
        let components = render(&study.scene, &study.render, &control).unwrap();
        let evaluation = evaluate(study, &components).unwrap();
        (components, evaluation)
    });
    assert!(file.0 == code.0, "the component images differ");
    assert_eq!(file.1.analysis.as_ref().unwrap().analysis, code.1.analysis.as_ref().unwrap().analysis);
    assert!(file.1 == code.1, "the evaluations differ");
    let fraction = code.1.analysis.unwrap().analysis.mixture.unwrap().region.unwrap().estimate.fraction;
    // 0.1 units of porphyrin beside one unit of bulk; reflected light that leaks through the filter biases it.
    assert!((fraction - 0.1 / 1.1).abs() < 0.02, "{fraction}");
}
