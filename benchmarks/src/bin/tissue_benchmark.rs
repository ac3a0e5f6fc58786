//! Measures how long layered tissue takes on one core, and prints one line of JSON.
//!
//! `tissue_benchmark [RUNS]`
//!
//! The dorsal tongue of the catalogue at 70 wavelengths: reflectance and the excitation-emission matrices of all its
//! fluorophores in all its layers, 70 x 70, with as many directions as diffuse light needs, as collimated light needs, and
//! with 64 per hemisphere. Then the tables of all sites, as a scene takes them, every 2.5 nm from 350 to 750 nm. CPU seconds,
//! mean of RUNS (default 20).

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use fluorspar::spectral::{Fluorophore, WavelengthGrid};
use fluorspar::tissue::{DiscreteOrdinates, EffectiveTissue, LayeredTissue, Level};
use fluorspar_accel::Allocator;
use fluorspar_benchmarks::cpu_seconds;
use fluorspar_experiment::preset::{self, PresetKind};
use serde_json::json;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

type Fallible<T> = Result<T, Box<dyn Error + Send + Sync>>;

fn catalogue(name: &str) -> Option<Arc<Fluorophore>> {
    preset::fluorophore(name).ok().map(|known| Arc::new(known.fluorophore()))
}

/// CPU seconds of a job, mean of some runs.
fn mean_time(runs: u32, mut job: impl FnMut() -> Fallible<()>) -> Fallible<f64> {
    let start = Instant::now();
    let before = cpu_seconds(start);
    for _ in 0..runs {
        job()?;
    }
    Ok((cpu_seconds(start) - before) / f64::from(runs))
}

/// Solves a tissue and forms the matrix of every part of it.
fn matrices(tissue: &LayeredTissue, wavelengths_nm: &[f64], solver: DiscreteOrdinates) -> Fallible<()> {
    let effective = EffectiveTissue::new(tissue, wavelengths_nm, solver)?;
    for part in effective.parts() {
        effective.eem(part, Level::BelowSurface)?;
    }
    Ok(())
}

fn measure(runs: u32) -> Fallible<()> {
    let tongue = preset::site("dorsal_tongue")?.tissue(&catalogue)?;
    let wavelengths_nm: Vec<f64> = (0..70).map(|i| 365.0 + 5.0 * f64::from(i)).collect();
    let seconds = |solver| mean_time(runs, || matrices(&tongue, &wavelengths_nm, solver));
    let [diffuse, working, precise] =
        [DiscreteOrdinates::DIFFUSE, DiscreteOrdinates::WORKING, DiscreteOrdinates::PRECISE].map(seconds);
    let mut tissues = Vec::new();
    for name in preset::names(PresetKind::Site) {
        tissues.push(preset::site(name)?.tissue(&catalogue)?);
    }
    let all = mean_time(runs, || {
        for tissue in &tissues {
            let effective = EffectiveTissue::for_grid(tissue, &WavelengthGrid::default())?;
            for part in effective.parts() {
                effective.eem(part, Level::BelowSurface)?;
            }
        }
        Ok(())
    })?;
    println!(
        "{}",
        json!({
            "layers": tongue.layers.len(),
            "wavelengths": wavelengths_nm.len(),
            "cpu_seconds_16_directions": diffuse?,
            "cpu_seconds_32_directions": working?,
            "cpu_seconds_64_directions": precise?,
            "sites": tissues.len(),
            "cpu_seconds_all_sites": all,
        })
    );
    Ok(())
}

fn main() -> Fallible<()> {
    let runs = std::env::args().nth(1).map_or(Ok(20), |word| word.parse())?;
    let one_core = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    one_core.install(|| measure(runs))
}
