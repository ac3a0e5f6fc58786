//! Traces photons through benchmark media on one thread, for `benchmarks/compare_with_mcml.py`.
//!
//! `tissue_photons media` prints the media as JSON: name, photons to trace, layers as `[refractive index, absorption 1/cm,
//! scattering 1/cm, anisotropy, thickness cm]` between air, bins of depth and radius. `tissue_photons MEDIUM PHOTONS SEED`
//! traces a medium under a normal beam and prints reflectance and transmittance with their standard errors.
#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

use std::error::Error;
use std::sync::atomic::AtomicBool;

use fluorspar::tissue::monte_carlo::{MonteCarloControl, MonteCarloSettings, ScoringGrid, simulate};
use fluorspar::tissue::{Incidence, OpticalLayer, OpticalStack};
use serde_json::json;

struct Medium {
    name: &'static str,
    /// About as many as take some seconds.
    photons: u64,
    layers: &'static [[f64; 5]],
}

/// A slab of van de Hulst (1980), a half-space of Giovanelli (1955), three layers of Gardner et al. (1992), and a tongue of
/// keratin, epithelium, superficial and deep stroma under violet and red light.
const MEDIA: [Medium; 5] = [
    Medium { name: "slab", photons: 4_000_000, layers: &[[1.0, 10.0, 90.0, 0.75, 0.02]] },
    Medium { name: "half-space", photons: 500_000, layers: &[[1.5, 10.0, 90.0, 0.0, 100.0]] },
    Medium {
        name: "three layers",
        photons: 300_000,
        layers: &[[1.37, 1.0, 100.0, 0.9, 0.1], [1.37, 1.0, 10.0, 0.0, 0.1], [1.37, 2.0, 10.0, 0.7, 0.2]],
    },
    Medium {
        name: "tongue at 405 nm",
        photons: 200_000,
        layers: &[
            [1.4, 1.75, 182.8, 0.97, 0.004],
            [1.4, 1.75, 59.15, 0.97, 0.016],
            [1.4, 4.58, 241.0, 0.88, 0.03],
            [1.4, 25.5, 241.0, 0.88, 0.5],
        ],
    },
    Medium {
        name: "tongue at 635 nm",
        photons: 60_000,
        layers: &[
            [1.4, 0.26, 74.4, 0.97, 0.004],
            [1.4, 0.26, 24.06, 0.97, 0.016],
            [1.4, 0.27, 140.0, 0.88, 0.03],
            [1.4, 0.72, 140.0, 0.88, 0.5],
        ],
    },
];

/// Bins of both programs, mm.
const GRID: ScoringGrid =
    ScoringGrid { depth_step_mm: 0.02, depth_limit_mm: 6.0, radial_step_mm: 0.02, radial_bins: 500 };

fn stack(layers: &[[f64; 5]]) -> OpticalStack {
    let layer =
        |&[refractive_index, absorption, scattering, anisotropy, thickness]: &[f64; 5]| OpticalLayer {
            thickness_mm: 10.0 * thickness,
            absorption_per_mm: 0.1 * absorption,
            scattering_per_mm: 0.1 * scattering,
            anisotropy,
            refractive_index,
        };
    OpticalStack { layers: layers.iter().map(layer).collect(), index_above: 1.0, index_below: 1.0 }
}

/// The media, for a program that shall trace the same.
fn media() -> serde_json::Value {
    let medium = |m: &Medium| json!({ "name": m.name, "photons": m.photons, "layers": m.layers });
    let bins = (GRID.depth_limit_mm / GRID.depth_step_mm).round();
    let grid =
        json!({ "step_cm": 0.1 * GRID.radial_step_mm, "depth_bins": bins, "radial_bins": GRID.radial_bins });
    json!({ "media": MEDIA.iter().map(medium).collect::<Vec<_>>(), "grid": grid })
}

fn trace(name: &str, photons: u64, seed: u64) -> Result<serde_json::Value, Box<dyn Error>> {
    let medium = MEDIA.iter().find(|m| m.name == name).ok_or("no such medium; see: tissue_photons media")?;
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let settings = MonteCarloSettings { seed, photons, target: None, grid: GRID };
    let control = MonteCarloControl { stop: &AtomicBool::new(false), progress: &|_| () };
    let result = simulate(&stack(medium.layers), Incidence::NORMAL, &settings, &control)?;
    let (reflected, transmitted) = (result.diffuse_reflectance, result.transmittance);
    Ok(json!({
        "photons": result.photons,
        "reflectance": [reflected.mean, reflected.standard_error],
        "transmittance": [transmitted.mean, transmitted.standard_error],
    }))
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let answer = match words.as_slice() {
        [word] if word == "media" => media(),
        [medium, photons, seed] => trace(medium, photons.parse()?, seed.parse()?)?,
        _ => return Err("usage: tissue_photons media | tissue_photons MEDIUM PHOTONS SEED".into()),
    };
    println!("{answer}");
    Ok(())
}
