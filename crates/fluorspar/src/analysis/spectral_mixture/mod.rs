//! Measured spectra as sums of known ones with weights that can't be negative: how well the data fix each weight, and which sets of
//! components describe them as well.
//!
//! | type | what it is |
//! |---|---|
//! | [`SpectralMixture`] | the components, and what blood before them does |
//! | [`MixtureFit`] | weights with intervals of 95 %, the amount of blood, residuals |
//! | [`ResidualCorrelation`] | how far residuals go together, as estimated from them |
//! | [`ComponentSets`] | the sets of components that the data can't tell apart |
//!
//! **Weights** are those of ordinary least squares (Lawson and Hanson, 1974). **Intervals** hold all weights with which some sum,
//! whatever its other weights of zero or more and its blood, leaves little more than the nearest (Rust and Burrus 1972; O'Leary and
//! Rust, SIAM J. Sci. Stat. Comput. 7, 473, 1986): they end at zero where the bound does, and stay finite where others make up a
//! component. How much more follows from the scatter of the residuals and from how far they go together: the excess that counts as
//! one degree of freedom is multiplied by the design effect of the weight (Chandler and Bate, Biometrika 94, 167, 2007).

mod blood;
mod correlation;
mod fitting;
mod least_squares;
mod sets;
#[cfg(test)]
mod tests;

use serde::Serialize;
use thiserror::Error;

pub use blood::BloodBefore;
pub use correlation::ResidualCorrelation;
pub use sets::{ComponentSet, ComponentSets, SetMembership};

use fitting::Fitting;
use least_squares::LeastSquares;

/// Samples beside the weights, at least.
const SPARE_SAMPLES: usize = 3;

/// Spectra that can't be fitted.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum FitError {
    /// More unknowns than knowns.
    #[error(
        "{samples} samples can't fix {terms} weights; give at least {} more samples than weights",
        SPARE_SAMPLES
    )]
    FewSamples {
        /// Samples of the data.
        samples: usize,
        /// Weights.
        terms: usize,
    },
    /// A component on another grid than the data.
    #[error(
        "component {term} has {found} samples where {wanted} are wanted; sample all spectra at the same wavelengths"
    )]
    Length {
        /// Number of the component, from 0.
        term: usize,
        /// Its samples.
        found: usize,
        /// Samples of the data.
        wanted: usize,
    },
    /// A value that is no number.
    #[error("a spectrum holds values that are not finite; leave such wavelengths out")]
    NotFinite,
    /// Wavelengths that do not rise.
    #[error("the wavelengths must rise; sort the samples")]
    Wavelengths,
    /// Nothing to fit with.
    #[error("there is no component to fit with; give at least one")]
    NoComponent,
    /// A component without light.
    #[error("{name} sends no light at these wavelengths; leave it out")]
    Dark {
        /// Name of the component.
        name: String,
    },
    /// Data without light.
    #[error("the spectrum is zero throughout; there is nothing to fit")]
    NoSignal,
    /// Standard errors that are none.
    #[error("standard errors must be above zero at every wavelength")]
    StandardErrors,
    /// Blood that can't be fitted.
    #[error(
        "blood needs an extinction of 0 or more, amounts that rise from above 0, and components that lie below it"
    )]
    Blood,
    /// Too many sets.
    #[error("{components} components make {} sets, more than are compared; give {} components at most", 2f64.powi(*components as i32), sets::MOST_COMPONENTS)]
    ManySets {
        /// Components.
        components: usize,
    },
}

/// A spectrum that may be part of a measured one.
#[derive(Clone, Debug, PartialEq)]
pub struct MixtureComponent {
    /// Name.
    pub name: String,
    /// Its values at each wavelength for a weight of 1, in the unit of the data over that of the weight.
    pub values: Vec<f64>,
}

/// Components that a measured spectrum may be made of.
///
/// ```
/// use fluorspar::analysis::{BloodBefore, MixtureComponent, SpectralMixture};
/// let nm: Vec<f64> = (0..41).map(|i| 500.0 + 5.0 * f64::from(i)).collect();
/// let band = |center: f64| nm.iter().map(|nm| (-((nm - center) / 30.0).powi(2)).exp()).collect::<Vec<f64>>();
/// let component = |name: &str, center| MixtureComponent { name: name.into(), values: band(center) };
/// let components = vec![component("green", 520.0), component("red", 640.0)];
/// let mixture = SpectralMixture::new(nm.clone(), components, BloodBefore::None)?;
/// let measured: Vec<f64> = band(520.0).iter().map(|value| 2.0 * value + 0.01).collect();
/// let fit = mixture.fit(&measured, None)?;
/// assert!((fit.weights[0].weight - 2.0).abs() < 0.05 && fit.weights[1].interval[0] >= 0.0);
/// # Ok::<(), fluorspar::analysis::FitError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SpectralMixture {
    wavelengths_nm: Vec<f64>,
    components: Vec<MixtureComponent>,
    blood: BloodBefore,
}

/// Weight of one component.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FittedWeight {
    /// Name of the component.
    pub name: String,
    /// Its weight, 0 or more, in the unit of data over component.
    pub weight: f64,
    /// Interval of 95 %; its lower end is never below 0.
    pub interval: [f64; 2],
    /// Standard error as if there were no bound, of a component at zero that which it would have if it were free; `None` where
    /// others make up the component.
    pub standard_error: Option<f64>,
    /// Variance of the weight over that under independent residuals.
    pub design_effect: Option<f64>,
    /// Whether the weight is free (above zero) or held at zero: free ones are the active set.
    pub is_free: bool,
    /// Share of the component in the fitted sum, both added up over all samples.
    pub share: f64,
}

/// The amount of blood that fits best.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FittedBlood {
    /// Amount: the optical density of a layer, or that of [`BloodBefore::Tissue`].
    pub amount: f64,
    /// Interval of 95 %, within the amounts that are looked for.
    pub interval: [f64; 2],
}

/// What the residuals say of their own scatter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ResidualScatter {
    /// How they go together.
    pub correlation: ResidualCorrelation,
    /// Independent samples that would fix the weights as well.
    pub effective_bands: f64,
    /// Degrees of freedom of their variance.
    pub degrees_of_freedom: f64,
    /// Standard deviation of a residual that intervals rest on, in the unit of the data; where standard errors are given a factor on
    /// these, 1 or more.
    pub standard_deviation: f64,
}

/// Sum of squares over given standard errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FitChiSquare {
    /// The sum.
    pub chi_square: f64,
    /// What it is in the mean where the errors are right and as correlated as the residuals are.
    pub expected: f64,
    /// Probability of such a sum or a larger one, if the errors are right.
    pub probability: f64,
}

/// The sum of components with weights that are not negative that is nearest to a spectrum.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MixtureFit {
    /// Weight of each component.
    pub weights: Vec<FittedWeight>,
    /// Blood before them; `None` without.
    pub blood: Option<FittedBlood>,
    /// The sum, at each sample.
    pub fitted: Vec<f64>,
    /// Data less sum, at each sample.
    pub residual: Vec<f64>,
    /// What each component adds to the sum, at each sample.
    pub contributions: Vec<Vec<f64>>,
    /// Root mean square of the residuals.
    pub rms: f64,
    /// The same over the largest value of the data.
    pub relative_rms: f64,
    /// Scatter of the residuals.
    pub scatter: ResidualScatter,
    /// Where standard errors were given.
    pub chi_square: Option<FitChiSquare>,
}

impl SpectralMixture {
    /// Components at some wavelengths, nm, rising.
    ///
    /// # Errors
    /// No component; components or blood of other lengths than the wavelengths, that are dark or not finite.
    pub fn new(
        wavelengths_nm: Vec<f64>,
        components: Vec<MixtureComponent>,
        blood: BloodBefore,
    ) -> Result<Self, FitError> {
        let samples = wavelengths_nm.len();
        if components.is_empty() {
            return Err(FitError::NoComponent);
        }
        if !wavelengths_nm.windows(2).all(|pair| pair[1] > pair[0]) {
            return Err(FitError::Wavelengths);
        }
        for (term, component) in components.iter().enumerate() {
            if component.values.len() != samples {
                return Err(FitError::Length { term, found: component.values.len(), wanted: samples });
            }
            if !component.values.iter().all(|value| value.is_finite()) {
                return Err(FitError::NotFinite);
            }
            if component.values.iter().all(|value| *value == 0.0) {
                return Err(FitError::Dark { name: component.name.clone() });
            }
        }
        if samples < components.len() + SPARE_SAMPLES {
            return Err(FitError::FewSamples { samples, terms: components.len() });
        }
        blood.check(samples, components.len())?;
        Ok(Self { wavelengths_nm, components, blood })
    }

    /// The components.
    #[must_use]
    pub fn components(&self) -> &[MixtureComponent] {
        &self.components
    }

    /// The same with a known amount of blood.
    #[must_use]
    pub fn behind(&self, amount: f64) -> Self {
        let values = self.blood.values(&self.components, amount);
        let components = self.components.iter().zip(values);
        let components =
            components.map(|(component, values)| MixtureComponent { name: component.name.clone(), values });
        Self {
            wavelengths_nm: self.wavelengths_nm.clone(),
            components: components.collect(),
            blood: BloodBefore::None,
        }
    }

    fn check(&self, data: &[f64], errors: Option<&[f64]>) -> Result<(), FitError> {
        let wanted = self.wavelengths_nm.len();
        if data.len() != wanted {
            return Err(FitError::Length { term: 0, found: data.len(), wanted });
        }
        if !data.iter().all(|value| value.is_finite()) {
            return Err(FitError::NotFinite);
        }
        if data.iter().all(|value| *value == 0.0) {
            return Err(FitError::NoSignal);
        }
        let is_error = |error: &f64| *error > 0.0 && error.is_finite();
        match errors {
            Some(errors) if errors.len() != wanted || !errors.iter().all(is_error) => {
                Err(FitError::StandardErrors)
            }
            _ => Ok(()),
        }
    }

    /// The components behind an amount of blood, over the standard errors.
    fn scaled_components(&self, amount: f64, errors: Option<&[f64]>) -> Vec<Vec<f64>> {
        self.blood.values(&self.components, amount).into_iter().map(|values| over(&values, errors)).collect()
    }

    /// The amount of blood with which the components describe several spectra best that have it in common, each with weights of its
    /// own: the least sum of all squares over errors. 0 without blood.
    ///
    /// # Errors
    /// Spectra of another length, dark or not finite; standard errors that are none.
    pub fn common_blood(&self, spectra: &[(&[f64], Option<&[f64]>)]) -> Result<f64, FitError> {
        spectra.iter().try_for_each(|(data, errors)| self.check(data, *errors))?;
        let scaled: Vec<Vec<f64>> = spectra.iter().map(|(data, errors)| over(data, *errors)).collect();
        let squares = |amount: f64| {
            let each = spectra.iter().zip(&scaled).map(|((_, errors), data)| {
                LeastSquares::new(&self.scaled_components(amount, *errors), data).nearest_of_all().squares
            });
            each.sum::<f64>()
        };
        let nodes = self.blood.nodes();
        let at_nodes: Vec<f64> = nodes.iter().map(|&amount| squares(amount)).collect();
        Ok(if self.blood.range().is_some() { blood::least(&nodes, &at_nodes, 1e-7, &squares) } else { 0.0 })
    }

    /// The nearest sum to a spectrum. `errors` are its standard errors, where they are known: they weigh the samples, and intervals are
    /// no narrower than they say.
    ///
    /// # Errors
    /// As [`Self::common_blood`].
    pub fn fit(&self, data: &[f64], errors: Option<&[f64]>) -> Result<MixtureFit, FitError> {
        let amount = self.common_blood(&[(data, errors)])?;
        Ok(Fitting::new(self, data, errors, amount).judged())
    }

    /// The sets of components that describe a spectrum as well as the best set does, within a difference of the criterion: all sets
    /// are compared. `fit` is the fit of all components to the same data.
    ///
    /// # Errors
    /// As [`Self::fit`]; more than twelve components.
    pub fn sets(
        &self,
        data: &[f64],
        errors: Option<&[f64]>,
        fit: &MixtureFit,
        within: f64,
    ) -> Result<ComponentSets, FitError> {
        self.check(data, errors)?;
        sets::compare(self, data, errors, fit, within)
    }
}

/// Values over standard errors.
fn over(values: &[f64], errors: Option<&[f64]>) -> Vec<f64> {
    match errors {
        None => values.to_vec(),
        Some(errors) => values.iter().zip(errors).map(|(value, error)| value / error).collect(),
    }
}
