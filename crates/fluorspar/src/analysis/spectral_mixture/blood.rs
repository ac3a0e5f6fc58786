//! Blood before the components of a spectrum, in one unknown amount.

use super::{FitError, MixtureComponent};

/// Amounts that a search looks at first; between the best three it goes on by golden section.
const NODES: usize = 40;
/// Least amount of the nodes but zero, relative to the largest.
const LEAST: f64 = 1e-3;

/// Blood that absorbs before the components of a spectrum reach the instrument.
#[derive(Clone, Debug, PartialEq)]
pub enum BloodBefore {
    /// None.
    None,
    /// One layer before some components, which become `values 10^(-D extinction)`: how Farrell, Mou and Wandell describe tongues
    /// and lips. The amount is the optical density `D`.
    Layer {
        /// Extinction at each wavelength, relative to that where the optical density is stated; 0 or more.
        extinction: Vec<f64>,
        /// Numbers of the components that lie below the layer.
        below: Vec<usize>,
        /// Largest optical density that is looked for, above 0.
        largest: f64,
    },
    /// Components in tissue that was solved with several amounts of blood. Between these the logarithms of the values are
    /// interpolated over the logarithm of the amount.
    Tissue {
        /// Amounts of blood, rising, above 0, at least two.
        amounts: Vec<f64>,
        /// Values of each component at each wavelength, for each amount.
        values: Vec<Vec<Vec<f64>>>,
    },
}

impl BloodBefore {
    /// # Errors
    /// Lists whose lengths do not fit together; amounts that are no amounts.
    pub(super) fn check(&self, samples: usize, components: usize) -> Result<(), FitError> {
        match self {
            Self::None => Ok(()),
            Self::Layer { extinction, below, largest } => {
                check_length(extinction.len(), samples)?;
                let is_extinction = |value: &f64| value.is_finite() && *value >= 0.0;
                let names = !below.is_empty() && below.iter().all(|&term| term < components);
                let is_amount = *largest > 0.0 && largest.is_finite();
                if names && is_amount && extinction.iter().all(is_extinction) {
                    Ok(())
                } else {
                    Err(FitError::Blood)
                }
            }
            Self::Tissue { amounts, values } => check_solved(amounts, values, samples, components),
        }
    }

    /// Least and largest amount; `None` without blood.
    pub(super) fn range(&self) -> Option<[f64; 2]> {
        match self {
            Self::None => None,
            Self::Layer { largest, .. } => Some([0.0, *largest]),
            Self::Tissue { amounts, .. } => Some([amounts[0], amounts[amounts.len() - 1]]),
        }
    }

    /// Whether the amount changes a sum of some components.
    pub(super) fn matters(&self, components: &[usize]) -> bool {
        match self {
            Self::None => false,
            Self::Layer { below, .. } => components.iter().any(|component| below.contains(component)),
            Self::Tissue { .. } => !components.is_empty(),
        }
    }

    /// The components behind an amount of blood.
    pub(super) fn values(&self, components: &[MixtureComponent], amount: f64) -> Vec<Vec<f64>> {
        match self {
            Self::None => components.iter().map(|component| component.values.clone()).collect(),
            Self::Layer { extinction, below, .. } => {
                let passed: Vec<f64> = extinction.iter().map(|e| 10f64.powf(-amount * e)).collect();
                let value = |(number, component): (usize, &MixtureComponent)| {
                    let values = component.values.iter();
                    match below.contains(&number) {
                        true => values.zip(&passed).map(|(value, passed)| value * passed).collect(),
                        false => values.copied().collect(),
                    }
                };
                components.iter().enumerate().map(value).collect()
            }
            Self::Tissue { amounts, values } => between(amounts, values, amount),
        }
    }

    /// Amounts that a search looks at, rising.
    pub(super) fn nodes(&self) -> Vec<f64> {
        let geometric = |low: f64, high: f64| {
            (0..NODES).map(move |i| low * (high / low).powf(i as f64 / (NODES - 1) as f64))
        };
        match self {
            Self::None => vec![0.0],
            Self::Layer { largest, .. } => {
                std::iter::once(0.0).chain(geometric(LEAST * largest, *largest)).collect()
            }
            Self::Tissue { amounts, .. } => geometric(amounts[0], amounts[amounts.len() - 1]).collect(),
        }
    }
}

/// Checks components that were solved with several amounts of blood, and the amounts.
fn check_solved(
    amounts: &[f64],
    values: &[Vec<Vec<f64>>],
    samples: usize,
    components: usize,
) -> Result<(), FitError> {
    check_length(values.len(), amounts.len())?;
    values.iter().try_for_each(|terms| {
        check_length(terms.len(), components)?;
        terms.iter().try_for_each(|term| check_length(term.len(), samples))
    })?;
    let rise = amounts.len() > 1 && amounts.windows(2).all(|pair| pair[1] > pair[0]);
    let known = |value: &f64| value.is_finite() && *value >= 0.0;
    let is_known = values.iter().flatten().flatten().all(known);
    if rise && amounts[0] > 0.0 && is_known { Ok(()) } else { Err(FitError::Blood) }
}

fn check_length(found: usize, wanted: usize) -> Result<(), FitError> {
    if found == wanted { Ok(()) } else { Err(FitError::Length { term: 0, found, wanted }) }
}

fn between(amounts: &[f64], values: &[Vec<Vec<f64>>], amount: f64) -> Vec<Vec<f64>> {
    let after = amounts.partition_point(|&known| known <= amount).clamp(1, amounts.len() - 1);
    let [low, high] = [amounts[after - 1], amounts[after]];
    let t = ((amount / low).ln() / (high / low).ln()).clamp(0.0, 1.0);
    let value = |(a, b): (&f64, &f64)| match a.min(*b) > 0.0 {
        true => a * (b / a).powf(t),
        false => a + t * (b - a),
    };
    let terms = values[after - 1].iter().zip(&values[after]);
    terms.map(|(low, high)| low.iter().zip(high).map(value).collect()).collect()
}

/// The amount with the least value of a function, to a share of the range between nodes: that with the least value of the nodes is
/// refined by golden section between its neighbors.
pub(super) fn least(nodes: &[f64], at_nodes: &[f64], precision: f64, value: &dyn Fn(f64) -> f64) -> f64 {
    let best = (0..nodes.len()).min_by(|&a, &b| at_nodes[a].total_cmp(&at_nodes[b])).unwrap_or_default();
    let (mut low, mut high) = (nodes[best.saturating_sub(1)], nodes[(best + 1).min(nodes.len() - 1)]);
    let width = precision * (high - low);
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    let (mut left, mut right) = (high - ratio * (high - low), low + ratio * (high - low));
    let (mut of_left, mut of_right) = (value(left), value(right));
    while high - low > width && high > low {
        if of_left <= of_right {
            (high, right, of_right) = (right, left, of_left);
            left = high - ratio * (high - low);
            of_left = value(left);
        } else {
            (low, left, of_left) = (left, right, of_right);
            right = low + ratio * (high - low);
            of_right = value(right);
        }
    }
    let middle = 0.5 * (low + high);
    // The ends of the nodes themselves may be best.
    if value(middle) <= at_nodes[best] { middle } else { nodes[best] }
}
