//! Parameters of a tissue from measured reflectance and fluorescence.
//!
//! | type | what it is |
//! |---|---|
//! | [`Viewing`] | a light, the filter before the instrument, and light that leaks through it |
//! | [`MeasuredReflectance`], [`MeasuredFluorescence`] | spectra, with their errors |
//! | [`TissueFit`] | fits a [`Population`], which is the prior, to spectra; predicts other spectra |
//! | [`Fit`] | the most probable tissue, its parameters with intervals of 95 %, and what is left of each spectrum |
//! | [`PredictedFluorescence`] | a spectrum under another light, with its standard deviation |
//!
//! **Prior.** Each [`Variation`](super::Variation) of the population is one unknown: how many standard deviations the tissue lies
//! from the typical one. What does not vary in the population is held. **Data.** A residual is (model - measured) / error; the
//! model is off by smooth curves rather than by noise, so samples nearer than [`CORRELATION_NM`] share one degree of freedom.
//! **Optimum.** Levenberg (1944) and Marquardt (1963): strengths of fluorophores are exact factors on spectra, derivatives by the
//! other unknowns are differences of solutions. **Intervals** follow from the curvature at the optimum (Laplace): they hold what
//! data and prior say together, and are those of the prior where the data say nothing.

mod forward;
mod least_squares;
mod measurement;
mod outcome;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::discrete_ordinates::DiscreteOrdinates;
use super::population::Population;
use crate::spectral::Fluorophore;
use forward::Forward;
use least_squares::{Linearized, minimize};

pub(crate) use measurement::missing_red;
pub use measurement::{MeasuredFluorescence, MeasuredReflectance, TissueFitError, Viewing};
pub use outcome::{Fit, FittedParameter, FittedSpectrum, PredictedFluorescence};

/// Distance over which residuals of a spectrum are taken as one, nm: half the width of the bands of hemoglobin.
pub const CORRELATION_NM: f64 = 20.0;
/// Steps of the search at most; five to fifteen are usual.
const MOST_STEPS: usize = 40;

/// Fits tissues of one population.
#[derive(Clone, Copy)]
pub struct TissueFit<'a> {
    /// The prior: the typical tissue, and how far it may lie from that.
    pub prior: &'a Population,
    /// Fluorophores by their names.
    pub find: &'a (dyn Fn(&str) -> Option<Arc<Fluorophore>> + Sync),
    /// The solver; 16 directions do.
    pub solver: DiscreteOrdinates,
}

impl TissueFit<'_> {
    /// The most probable tissue under some spectra, of which there must be at least one.
    ///
    /// # Errors
    /// No spectrum; spectra that are too short, not finite, or dark; a light that is dark; a population that does not vary; a
    /// tissue that cannot be solved.
    pub fn fit(
        &self,
        reflectances: &[MeasuredReflectance],
        fluorescences: &[MeasuredFluorescence],
    ) -> Result<Fit, TissueFitError> {
        if reflectances.is_empty() && fluorescences.is_empty() {
            return Err(TissueFitError::NothingMeasured);
        }
        if self.prior.variations().is_empty() {
            return Err(TissueFitError::NothingVaries);
        }
        reflectances.iter().try_for_each(MeasuredReflectance::check)?;
        fluorescences.iter().try_for_each(MeasuredFluorescence::check)?;
        let forward = Forward::new(self, reflectances, fluorescences)?;
        let start = forward.start()?;
        let minimum = minimize(start, |unknowns| forward.linearize(unknowns), MOST_STEPS)?;
        outcome::describe(&forward, minimum)
    }

    /// What would be seen of a fitted tissue under some light, per unit of the light, with the standard deviation that the
    /// fit leaves.
    ///
    /// # Errors
    /// As of [`Self::fit`]; the fit must be of the same population.
    pub fn predict(
        &self,
        fit: &Fit,
        viewing: &Viewing,
        wavelengths_nm: &[f64],
    ) -> Result<PredictedFluorescence, TissueFitError> {
        let record = MeasuredFluorescence {
            name: String::new(),
            viewing: viewing.clone(),
            wavelengths_nm: wavelengths_nm.to_vec(),
            values: vec![1.0; wavelengths_nm.len()],
            relative_error: 1.0,
            scale_uncertainty: 0.0,
        };
        record.check()?;
        let forward = Forward::new(self, &[], std::slice::from_ref(&record))?;
        let model_errors = wavelengths_nm.iter().map(|&nm| viewing.model_error(nm)).collect();
        let (values, derivatives) = forward.spectrum(&fit.deviations, 0)?;
        Ok(PredictedFluorescence::new(
            wavelengths_nm.to_vec(),
            values,
            derivatives,
            fit.covariance.clone(),
            model_errors,
        ))
    }
}

/// Unknowns: deviations of the variations, then logarithms of free scales.
type Unknowns = DVector<f64>;
/// Derivatives by the unknowns, one column each.
type Derivatives = DMatrix<f64>;
