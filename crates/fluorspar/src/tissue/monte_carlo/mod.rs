//! Monte Carlo of light in layered tissue: packets of photons, one wavelength at a time.
//!
//! | call | gives |
//! |---|---|
//! | [`simulate`] | reflectance, transmittance, absorption by layer, fluence by depth, leaving light by radius |
//! | [`simulate_fluorescence`] | the same of the excitation, and its fluorescence, traced forward |
//! | [`fluorescence_by_reciprocity`] | fluorescence of a pair of wavelengths from two fluences |
//!
//! It is the second, independent solver: slow and noisy beside a deterministic one, but any layer may have any refractive
//! index, light spreads sideways, and every number comes with its standard error.
//!
//! The method is that of Wang, Jacques and Zheng, MCML - Monte Carlo modeling of light transport in multi-layered tissues,
//! Computer Methods and Programs in Biomedicine 47 (1995) 131-146: exponential free paths, absorption by weight, scattering
//! after Henyey and Greenstein, Fresnel's equations for unpolarized light at every interface, Russian roulette. The code is
//! our own. Photon `i` of group `g` draws from the stream (seed, g, i), and groups are summed in order: results have the same
//! bits for any number of threads. The spread of the 256 groups gives the standard errors.
//!
//! ```
//! use std::sync::atomic::AtomicBool;
//! use fluorspar::tissue::monte_carlo::{MonteCarloControl, MonteCarloSettings, simulate};
//! use fluorspar::tissue::{Incidence, OpticalLayer, OpticalStack};
//! let layer = OpticalLayer {
//!     thickness_mm: 0.2,
//!     absorption_per_mm: 1.0,
//!     scattering_per_mm: 9.0,
//!     anisotropy: 0.75,
//!     refractive_index: 1.0,
//! };
//! let stack = OpticalStack { layers: vec![layer], index_above: 1.0, index_below: 1.0 };
//! let settings = MonteCarloSettings { photons: 20_000, ..MonteCarloSettings::default() };
//! let control = MonteCarloControl { stop: &AtomicBool::new(false), progress: &|_| () };
//! let result = simulate(&stack, Incidence::NORMAL, &settings, &control)?;
//! // Van de Hulst (1980): 0.09739.
//! let reflectance = result.diffuse_reflectance;
//! assert!((reflectance.mean - 0.09739).abs() < 4.0 * reflectance.standard_error);
//! # Ok::<(), fluorspar::tissue::TissueError>(())
//! ```

mod engine;
mod estimate;
mod fluorescence;
mod medium;
mod recorded_ways;
mod scattering;
mod settings;
mod simulation;
mod walk;

pub use engine::Ending;
pub use estimate::Estimate;
pub use fluorescence::{
    FluorescenceResult, ReciprocalFluorescence, fluorescence_by_reciprocity, simulate_fluorescence,
};
pub(super) use recorded_ways::{Recorded, Ways, trace_ways};
pub use settings::{
    MonteCarloControl, MonteCarloProgress, MonteCarloSettings, ScoredQuantity, ScoringGrid,
    StandardErrorTarget,
};
pub use simulation::{MonteCarloResult, Ring, Slice, simulate};
