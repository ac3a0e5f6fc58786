//! Measured spectra, and how they were seen.

use thiserror::Error;

use crate::spectral::Curve;
use crate::tissue::{EffectiveTissue, LayerFluorophore, Level, TissueError};

/// Step of the lines that stand for a light, nm.
const LINE_STEP_NM: f64 = 5.0;
/// Wavelengths that can be fitted, nm.
const RANGE_NM: [f64; 2] = [350.0, 800.0];
/// Lines weaker than this, relative to the strongest, are left out.
const WEAKEST_LINE: f64 = 1e-4;
/// Light above 600 nm that no fluorophore of the catalogue gives under 450 nm, relative to what they give.
const RED_UNDER_BLUE: f64 = 0.15;
/// Samples of a spectrum at least.
const FEWEST: usize = 5;

/// A fit that cannot be made.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum TissueFitError {
    /// The tissue itself.
    #[error(transparent)]
    Tissue(#[from] TissueError),
    /// No spectrum.
    #[error("nothing was measured; give reflectance, fluorescence or both")]
    NothingMeasured,
    /// A population without variations.
    #[error("nothing of the tissue may vary; free at least one parameter")]
    NothingVaries,
    /// Wavelengths that are few, do not rise or lie outside what is known.
    #[error("{name}: give at least {FEWEST} samples at rising wavelengths within {} to {} nm", RANGE_NM[0], RANGE_NM[1])]
    Wavelengths {
        /// The spectrum.
        name: String,
    },
    /// A spectrum that is dark or not finite.
    #[error("{name}: the values must be finite and not all zero")]
    Values {
        /// The spectrum.
        name: String,
    },
    /// An error that is not one.
    #[error("{name}: the error is {error}; give a number within 0.0001 to 10")]
    MeasurementError {
        /// The spectrum.
        name: String,
        /// The error.
        error: f64,
    },
    /// A light without energy.
    #[error("the light has no energy between {} and {} nm", RANGE_NM[0], RANGE_NM[1])]
    DarkLight,
    /// No step leads to a finite result.
    #[error(
        "the search for the tissue found no finite result; narrow the prior or look for wrong values in the spectra"
    )]
    NotFinite,
}

/// A light, and what stands before the instrument.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewing {
    /// Wavelengths, nm, and the share of the energy at each; together 1.
    lines: Vec<(f64, f64)>,
    filter: Curve,
    leak: Option<Curve>,
}

impl Viewing {
    /// A light by its spectral energy, of any scale, and the transmittance of the filter before the instrument. Negative values
    /// of the light count as none.
    ///
    /// # Errors
    /// A light without energy within 350 to 800 nm.
    pub fn new(light: &Curve, filter: Curve) -> Result<Self, TissueFitError> {
        let number = ((RANGE_NM[1] - RANGE_NM[0]) / LINE_STEP_NM) as usize;
        // Each line takes what lies around it with the weight of linear interpolation, so that energy and mean wavelength stay.
        let line = |i: usize| {
            let nm = RANGE_NM[0] + LINE_STEP_NM * i as f64;
            let fine = (-9..=9).map(|k| 0.5 * f64::from(k));
            let energy: f64 = fine.map(|d| (1.0 - d.abs() / LINE_STEP_NM) * light.at(nm + d).max(0.0)).sum();
            (nm, energy)
        };
        let mut lines: Vec<(f64, f64)> = (0..=number).map(line).collect();
        let strongest = lines.iter().map(|line| line.1).fold(0.0, f64::max);
        if !(strongest > 0.0 && strongest.is_finite()) {
            return Err(TissueFitError::DarkLight);
        }
        lines.retain(|line| line.1 > WEAKEST_LINE * strongest);
        let total: f64 = lines.iter().map(|line| line.1).sum();
        lines.iter_mut().for_each(|line| line.1 /= total);
        Ok(Self { lines, filter, leak: None })
    }

    /// With light that leaks through the filter: what the instrument sees of a white target, energy per nm and per unit of the
    /// light. The tissue reflects it.
    #[must_use]
    pub fn with_leak(mut self, leak: Curve) -> Self {
        self.leak = Some(leak);
        self
    }

    /// What the instrument sees of a tissue at some wavelengths: energy per nm per unit of the energy of the light, 1/nm. That is
    /// the radiance of the tissue over that of a white target under the whole light.
    #[must_use]
    pub fn spectrum(&self, tissue: &EffectiveTissue, wavelengths_nm: &[f64]) -> Vec<f64> {
        let reflectance = tissue.reflectance(Level::AboveSurface);
        let mut sum: Vec<f64> =
            wavelengths_nm.iter().map(|&nm| reflectance.at(nm) * self.leaked(nm)).collect();
        for emitter in tissue.parts() {
            let emitted = self.fluorescence(tissue, emitter, wavelengths_nm);
            sum.iter_mut().zip(emitted).for_each(|(sum, emitted)| *sum += emitted);
        }
        sum
    }

    /// Wavelengths, nm, and photons in units of 1 / (h c) per unit of energy.
    pub(super) fn photons(&self) -> Vec<(f64, f64)> {
        self.lines.iter().map(|&(nm, energy)| (nm, energy * nm)).collect()
    }

    /// Energy that one emitter of a tissue adds to [`Self::spectrum`].
    #[must_use]
    pub fn fluorescence(
        &self,
        tissue: &EffectiveTissue,
        emitter: LayerFluorophore,
        wavelengths_nm: &[f64],
    ) -> Vec<f64> {
        // Photons in units of 1 / (h c) to energy.
        let photons = tissue.emission(emitter, &self.photons(), wavelengths_nm, Level::AboveSurface);
        photons.iter().zip(wavelengths_nm).map(|(emitted, nm)| self.passed(*nm) * emitted / nm).collect()
    }

    /// Relative error of the model where it is known to be off: under blue light the tongues of people emit something red that
    /// the catalogue lacks, a tenth to a sixth of the light there.
    #[must_use]
    pub fn model_error(&self, nm: f64) -> f64 {
        let mean: f64 = self.lines.iter().map(|(nm, energy)| nm * energy).sum();
        missing_red(mean, nm)
    }

    pub(super) fn passed(&self, nm: f64) -> f64 {
        self.filter.at(nm)
    }

    pub(super) fn leaked(&self, nm: f64) -> f64 {
        self.leak.as_ref().map_or(0.0, |leak| leak.at(nm))
    }
}

/// Relative error of the model at a wavelength, nm, under light of a mean wavelength, nm: [`Viewing::model_error`].
pub(crate) fn missing_red(light_nm: f64, nm: f64) -> f64 {
    // Fades in from violet to blue light, and from orange to red.
    let [blue, red] = [(light_nm - 420.0) / 20.0, (nm - 600.0) / 20.0].map(|t| t.clamp(0.0, 1.0));
    RED_UNDER_BLUE * blue * red
}

/// Reflectance against a white target, surface reflection excluded.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredReflectance {
    /// Name in messages.
    pub name: String,
    /// Rising, nm.
    pub wavelengths_nm: Vec<f64>,
    /// 0 to 1.
    pub values: Vec<f64>,
    /// Standard deviation of each value, of the measurement and of the model; 0.005 is usual.
    pub error: f64,
}

/// Fluorescence under one light.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredFluorescence {
    /// Name in messages.
    pub name: String,
    /// How it was seen.
    pub viewing: Viewing,
    /// Rising, nm.
    pub wavelengths_nm: Vec<f64>,
    /// Energy per nm that leaves per unit of energy that arrives, 1/nm: radiance of the tissue over that of a white target
    /// under the whole light. Any scale where [`Self::scale_uncertainty`] is infinite.
    pub values: Vec<f64>,
    /// Standard deviation of the shape, of the measurement and of the model, relative to the root mean square of value and
    /// mean; 0.05 is usual. [`Viewing::model_error`] adds to it.
    pub relative_error: f64,
    /// Standard deviation of the logarithm of the scale: 0 where it is known exactly, 0.3 where distance or spot differ between
    /// records, infinite where it is unknown.
    pub scale_uncertainty: f64,
}

fn check(name: &str, wavelengths_nm: &[f64], values: &[f64], error: f64) -> Result<(), TissueFitError> {
    let rise = wavelengths_nm.windows(2).all(|pair| pair[1] > pair[0]);
    let inside = wavelengths_nm.iter().all(|nm| (RANGE_NM[0]..=RANGE_NM[1]).contains(nm));
    let name = || name.to_string();
    if wavelengths_nm.len() < FEWEST || wavelengths_nm.len() != values.len() || !rise || !inside {
        return Err(TissueFitError::Wavelengths { name: name() });
    }
    if !values.iter().all(|value| value.is_finite()) || values.iter().all(|value| *value == 0.0) {
        return Err(TissueFitError::Values { name: name() });
    }
    if !(1e-4..=10.0).contains(&error) {
        return Err(TissueFitError::MeasurementError { name: name(), error });
    }
    Ok(())
}

impl MeasuredReflectance {
    pub(super) fn check(&self) -> Result<(), TissueFitError> {
        check(&self.name, &self.wavelengths_nm, &self.values, self.error)
    }
}

impl MeasuredFluorescence {
    pub(super) fn check(&self) -> Result<(), TissueFitError> {
        check(&self.name, &self.wavelengths_nm, &self.values, self.relative_error)
    }

    /// Standard deviation of each value.
    pub(super) fn errors(&self) -> Vec<f64> {
        let mean_square = self.values.iter().map(|v| v * v).sum::<f64>() / self.values.len() as f64;
        let error = |(value, nm): (&f64, &f64)| {
            let smooth = self.relative_error * (0.5 * (value * value + mean_square)).sqrt();
            smooth.hypot(self.viewing.model_error(*nm) * value)
        };
        self.values.iter().zip(&self.wavelengths_nm).map(error).collect()
    }

    /// Whether the scale is one of the unknowns.
    pub(super) fn has_free_scale(&self) -> bool {
        self.scale_uncertainty > 0.0
    }
}
