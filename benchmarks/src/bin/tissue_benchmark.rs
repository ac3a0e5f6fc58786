//! Measures how long layered tissue takes on one core, and prints one line of JSON.
//!
//! `tissue_benchmark [RUNS]`
//!
//! The dorsal tongue of the catalogue at 70 wavelengths: reflectance and the excitation-emission matrices of all its
//! fluorophores in all its layers, 70 x 70, with as many directions as diffuse light needs, as collimated light needs, and
//! with 64 per hemisphere. Then the tables of all sites, as a scene takes them, every 2.5 nm from 350 to 750 nm. Shortest of
//! RUNS times (default 5), in seconds.

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use fluorspar::spectral::{Fluorophore, WavelengthGrid};
use fluorspar::tissue::{DiscreteOrdinates, EffectiveTissue, LayeredTissue, Level, Site};
use fluorspar_accel::Allocator;
use fluorspar_experiment::preset;
use serde_json::json;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

type Fallible<T> = Result<T, Box<dyn Error + Send + Sync>>;

fn catalogue(name: &str) -> Option<Arc<Fluorophore>> {
    preset::fluorophore(name).ok().map(|known| Arc::new(known.fluorophore()))
}

/// Shortest time of some runs, s.
fn shortest(runs: u32, mut job: impl FnMut() -> Fallible<()>) -> Fallible<f64> {
    let mut best = f64::MAX;
    for _ in 0..runs {
        let start = Instant::now();
        job()?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    Ok(best)
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
    let tongue = Site::named("dorsal_tongue")?.tissue(&catalogue)?;
    let wavelengths_nm: Vec<f64> = (0..70).map(|i| 365.0 + 5.0 * f64::from(i)).collect();
    let seconds = |solver| shortest(runs, || matrices(&tongue, &wavelengths_nm, solver));
    let [diffuse, working, precise] =
        [DiscreteOrdinates::DIFFUSE, DiscreteOrdinates::WORKING, DiscreteOrdinates::PRECISE].map(seconds);
    let mut tissues = Vec::new();
    for name in Site::names() {
        tissues.push(Site::named(name)?.tissue(&catalogue)?);
    }
    let all = shortest(runs, || {
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
            "seconds_16_directions": diffuse?,
            "seconds_32_directions": working?,
            "seconds_64_directions": precise?,
            "sites": tissues.len(),
            "seconds_all_sites": all,
        })
    );
    Ok(())
}

fn main() -> Fallible<()> {
    let runs = std::env::args().nth(1).map_or(Ok(5), |word| word.parse())?;
    let one_core = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    one_core.install(|| measure(runs))
}
