//! What a fit found.

use nalgebra::DMatrix;

use super::forward::Forward;
use super::least_squares::Minimum;
use super::{Derivatives, TissueFitError};
use crate::sampling::Z_95;
use crate::tissue::Site;

/// The most probable tissue.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The tissue.
    pub site: Site,
    /// What was free, with intervals.
    pub parameters: Vec<FittedParameter>,
    /// The spectra: reflectances, then fluorescences, in the order given.
    pub spectra: Vec<FittedSpectrum>,
    /// Sum of the squares of all residuals of the data, in standard deviations.
    pub chi_square: f64,
    /// Steps of the search.
    pub steps: usize,
    /// Whether the search ended by itself.
    pub converged: bool,
    /// Deviations of the variations from the typical tissue, in standard deviations of the prior.
    pub(super) deviations: Vec<f64>,
    /// Their covariance.
    pub(super) covariance: DMatrix<f64>,
}

/// A parameter that was free.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedParameter {
    /// Name of the variation.
    pub name: &'static str,
    /// The parameter whose values follow, the first of those that vary together.
    pub parameter: &'static str,
    /// The most probable value.
    pub value: f64,
    /// It lies within these with a probability of 95 %.
    pub interval_95: [f64; 2],
    /// Typical value of the prior.
    pub prior: f64,
    /// Interval of 95 % of the prior.
    pub prior_interval_95: [f64; 2],
    /// Standard deviation relative to that of the prior, of the logarithm for factors: 1 where the data say nothing.
    pub relative_deviation: f64,
}

/// A spectrum and its fit.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedSpectrum {
    /// Name.
    pub name: String,
    /// Rising, nm.
    pub wavelengths_nm: Vec<f64>,
    /// As measured.
    pub measured: Vec<f64>,
    /// Of the tissue, with its scale.
    pub model: Vec<f64>,
    /// Factor on the model: 1 for reflectance.
    pub scale: f64,
    /// Interval of 95 % of the scale, where it was free.
    pub scale_interval_95: Option<[f64; 2]>,
}

impl FittedSpectrum {
    /// Root mean square of model minus measured, over that of the measured.
    #[must_use]
    pub fn relative_rms(&self) -> f64 {
        let square = |(model, measured): (&f64, &f64)| (model - measured).powi(2);
        let left: f64 = self.model.iter().zip(&self.measured).map(square).sum();
        (left / self.measured.iter().map(|v| v * v).sum::<f64>()).sqrt()
    }
}

pub(super) fn describe(forward: &Forward<'_>, minimum: Minimum) -> Result<Fit, TissueFitError> {
    let number = forward.deviations();
    let models = forward.scaled(&minimum.unknowns)?;
    let reflected = forward.reflectances.iter().map(|r| (&r.name, &r.wavelengths_nm, &r.values, None));
    let emitted = forward
        .fluorescences
        .iter()
        .enumerate()
        .map(|(i, r)| (&r.name, &r.wavelengths_nm, &r.values, forward.scale_at(i)));
    let spectra = reflected.chain(emitted).zip(models).map(|((name, nm, measured, scale_at), model)| {
        let ends = |at: usize| {
            let reach = Z_95 * minimum.covariance[(at, at)].sqrt();
            [-reach, reach].map(|shift| (minimum.unknowns[at] + shift).exp())
        };
        FittedSpectrum {
            name: name.clone(),
            wavelengths_nm: nm.clone(),
            measured: measured.clone(),
            model,
            scale: scale_at.map_or(1.0, |at| minimum.unknowns[at].exp()),
            scale_interval_95: scale_at.map(ends),
        }
    });
    let spectra: Vec<FittedSpectrum> = spectra.collect();
    let data: usize = spectra.iter().map(|spectrum| spectrum.measured.len()).sum();
    let deviations: Vec<f64> = minimum.unknowns.as_slice()[..number].to_vec();
    let covariance = minimum.covariance.view((0, 0), (number, number)).into_owned();
    Ok(Fit {
        site: forward.prior().tissue_at(&deviations),
        parameters: parameters(forward, &deviations, &covariance),
        spectra,
        chi_square: minimum.linearized.residuals.rows(0, data).norm_squared(),
        steps: minimum.steps,
        converged: minimum.converged,
        deviations,
        covariance,
    })
}

fn parameters(forward: &Forward<'_>, deviations: &[f64], covariance: &DMatrix<f64>) -> Vec<FittedParameter> {
    let prior = forward.prior();
    let fitted = |(v, variation): (usize, &crate::tissue::Variation)| {
        let present = |name: &&&str| prior.typical().get(name).is_ok_and(|value| value != 0.0);
        let parameter = *variation.parameters.iter().find(present)?;
        let at = |deviation: f64| {
            let mut moved = vec![0.0; deviations.len()];
            moved[v] = deviation;
            prior.tissue_at(&moved).get(parameter).unwrap_or(f64::NAN)
        };
        let deviation = covariance[(v, v)].sqrt();
        Some(FittedParameter {
            name: variation.name,
            parameter,
            value: at(deviations[v]),
            interval_95: [-Z_95, Z_95].map(|z| at(deviations[v] + z * deviation)),
            prior: at(0.0),
            prior_interval_95: [-Z_95, Z_95].map(at),
            relative_deviation: deviation,
        })
    };
    prior.variations().iter().enumerate().filter_map(fitted).collect()
}

/// A spectrum that was not measured.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictedFluorescence {
    /// Rising, nm.
    pub wavelengths_nm: Vec<f64>,
    /// Energy per nm per unit of the light, 1/nm.
    pub values: Vec<f64>,
    derivatives: Derivatives,
    covariance: DMatrix<f64>,
    /// Relative error of the model itself.
    model_errors: Vec<f64>,
}

impl PredictedFluorescence {
    pub(super) fn new(
        wavelengths_nm: Vec<f64>,
        values: Vec<f64>,
        derivatives: Derivatives,
        covariance: DMatrix<f64>,
        model_errors: Vec<f64>,
    ) -> Self {
        Self { wavelengths_nm, values, derivatives, covariance, model_errors }
    }

    /// The spectrum over its value at one of its samples, and the standard deviation of each ratio: what the fit leaves open of
    /// the shape, and where the model is known to be off. Empty where there is no such sample or it is dark.
    #[must_use]
    pub fn shape(&self, norm: usize) -> Vec<(f64, f64)> {
        let Some(&level) = self.values.get(norm).filter(|value| **value > 0.0) else { return Vec::new() };
        let ratio = |(i, value): (usize, &f64)| {
            let ratio = value / level;
            let slope = (self.derivatives.row(i) - self.derivatives.row(norm) * ratio) / level;
            let open = (&slope * &self.covariance).dot(&slope).max(0.0).sqrt();
            (ratio, open.hypot(ratio * self.model_errors[i]))
        };
        self.values.iter().enumerate().map(ratio).collect()
    }
}
