//! What a simulation is asked for: light, scoring bins, photons, error.

use std::sync::atomic::AtomicBool;

use crate::tissue::tissue_error::{TissueError, check};

/// Allowed width of bins of depth and radius, mm.
const STEP_MM: [f64; 2] = [1e-6, 1e4];
/// Allowed number of photons.
const PHOTONS: [f64; 2] = [1.0, 1e13];
/// Allowed relative standard error to stop at.
const RELATIVE_STANDARD_ERROR: [f64; 2] = [1e-5, 0.5];

/// Bins that light is scored in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoringGrid {
    /// Largest width of bins of depth, mm; 1e-6 to 1e4. Every layer is divided into equal bins of its own.
    pub depth_step_mm: f64,
    /// Depth to which fluence is scored, mm; 1e-6 to 1e4.
    pub depth_limit_mm: f64,
    /// Width of the rings that leaving light is scored in, mm; 1e-6 to 1e4.
    pub radial_step_mm: f64,
    /// Number of rings. Light that leaves farther out counts in the totals.
    pub radial_bins: usize,
}

impl Default for ScoringGrid {
    /// Bins of 10 um to a depth of 5 mm, 500 rings of 20 um.
    fn default() -> Self {
        Self { depth_step_mm: 0.01, depth_limit_mm: 5.0, radial_step_mm: 0.02, radial_bins: 500 }
    }
}

/// A result whose standard error may end a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScoredQuantity {
    /// Light that leaves upward after it has entered.
    DiffuseReflectance,
    /// Light that leaves downward.
    Transmittance,
    /// Light absorbed in one layer, counted from zero.
    Absorbed(usize),
    /// Fluorescence that leaves upward; in simulations of fluorescence only.
    Fluorescence,
}

/// When to stop early.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StandardErrorTarget {
    /// Which result counts.
    pub quantity: ScoredQuantity,
    /// Its standard error over its mean; 1e-5 to 0.5.
    pub relative_standard_error: f64,
}

/// Photons, seed, bins and end of a simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MonteCarloSettings {
    /// Seed: the same one gives the same bits for any number of threads.
    pub seed: u64,
    /// Photons to trace, 1 to 1e13, rounded up to a multiple of 256; with an error target the most.
    pub photons: u64,
    /// Relative standard error at which to stop.
    pub target: Option<StandardErrorTarget>,
    /// Bins.
    pub grid: ScoringGrid,
}

impl Default for MonteCarloSettings {
    /// Seed 0, a million photons, no error target.
    fn default() -> Self {
        Self { seed: 0, photons: 1_000_000, target: None, grid: ScoringGrid::default() }
    }
}

/// How far a simulation has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MonteCarloProgress {
    /// Photons traced.
    pub photons_done: u64,
    /// Photons in all; with an error target, as many as the error so far lets expect.
    pub photons_total: u64,
}

/// Reporting and interruption of a simulation.
pub struct MonteCarloControl<'a> {
    /// Set to stop: the photons of the last complete round are returned.
    pub stop: &'a AtomicBool,
    /// Called now and then, from any thread.
    pub progress: &'a (dyn Fn(MonteCarloProgress) + Sync),
}

impl MonteCarloSettings {
    pub(super) fn validate(&self, layers: usize, is_fluorescence: bool) -> Result<(), TissueError> {
        let place = "Monte Carlo";
        check(place, "photons", self.photons as f64, PHOTONS, "a million give standard errors near 0.2 %")?;
        let hint = "tissue needs some µm to 0.1 mm";
        check(place, "depth_step_mm", self.grid.depth_step_mm, STEP_MM, hint)?;
        check(place, "depth_limit_mm", self.grid.depth_limit_mm, STEP_MM, "light reaches some mm deep")?;
        check(place, "radial_step_mm", self.grid.radial_step_mm, STEP_MM, hint)?;
        let Some(StandardErrorTarget { quantity, relative_standard_error }) = self.target else {
            return Ok(());
        };
        let hint = "it is a share: 0.001 for 0.1 %";
        check(place, "relative_standard_error", relative_standard_error, RELATIVE_STANDARD_ERROR, hint)?;
        match quantity {
            ScoredQuantity::Absorbed(layer) if layer >= layers => {
                Err(TissueError::NoSuchLayer { layer, layers })
            }
            ScoredQuantity::Fluorescence if !is_fluorescence => Err(TissueError::NoFluorescence),
            _ => Ok(()),
        }
    }
}
