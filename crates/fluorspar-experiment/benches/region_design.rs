//! Time to capture and analyze one region for one design, on plain values, and to prepare what designs share.
//!
//! `cargo bench -p fluorspar-experiment --bench region_design`
//!
//! 81 bands, five fluorophores, the camera of the catalogue's flat patch. A search over exposures, drives or
//! concentrations pays `electrons` and `porphyrin_of_a_region` for each design, one over filters or sensors
//! `another_camera` as well, one over lights `another_light`.

#![allow(clippy::unwrap_used, reason = "this is a benchmark")]

#[allow(dead_code, reason = "the main function of the example")]
#[path = "../examples/study_from_code.rs"]
mod study_from_code;

use divan::{Bencher, black_box};
use fluorspar::pipeline::{CameraResponse, MixtureSpectra, estimate_porphyrin};
use fluorspar::spectral::Curve;
use fluorspar::study::Study;

fn main() {
    divan::main();
}

const EXPOSURE_S: f64 = 0.03;
const PIXELS: f64 = 1000.0;

fn camera(study: &Study) -> CameraResponse {
    let lens = study.camera.lens_behind_filters().unwrap();
    CameraResponse::new(&lens, study.camera.sensor.as_ref().unwrap(), &study.scene.grid, None)
}

fn spectra(study: &Study, light: &Curve) -> MixtureSpectra {
    let analysis = study.analysis.as_ref().unwrap();
    let scene = &study.scene;
    MixtureSpectra::new(
        &scene.fluorophores,
        &analysis.bulk,
        analysis.porphyrin.as_ref().unwrap(),
        &scene.grid,
        light,
    )
    .unwrap()
}

/// One unit of bulk with 0.1 units of porphyrin.
fn radiance(spectra: &MixtureSpectra) -> Vec<f64> {
    spectra.bulk.iter().zip(&spectra.porphyrin).map(|(b, p)| b + 0.1 * p).collect()
}

/// Mean radiance to electrons in all channels.
#[divan::bench]
fn electrons(bencher: Bencher) {
    let study = study_from_code::study().unwrap();
    let camera = camera(&study);
    let radiance = radiance(&spectra(&study, &study.scene.lights[0].spectrum));
    bencher.bench_local(|| camera.electrons(black_box(&radiance), black_box(EXPOSURE_S)));
}

/// Mean radiance to the porphyrin fraction with its interval: the whole of one design.
#[divan::bench]
fn porphyrin_of_a_region(bencher: Bencher) {
    let study = study_from_code::study().unwrap();
    let camera = camera(&study);
    let spectra = spectra(&study, &study.scene.lights[0].spectrum);
    let radiance = radiance(&spectra);
    bencher.bench_local(|| {
        estimate_porphyrin(black_box(&camera), black_box(&spectra), black_box(&radiance), EXPOSURE_S, PIXELS)
    });
}

/// Another lens, filter or sensor.
#[divan::bench]
fn another_camera(bencher: Bencher) {
    let study = study_from_code::study().unwrap();
    bencher.bench_local(|| camera(black_box(&study)));
}

/// Another light on the same fluorophores.
#[divan::bench]
fn another_light(bencher: Bencher) {
    let study = study_from_code::study().unwrap();
    let light = &study.scene.lights[0].spectrum;
    bencher.bench_local(|| spectra(black_box(&study), black_box(light)));
}
