//! Intervals that hold a wanted part of a population, made from a sample of it.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, Continuous, ContinuousCDF, Normal};
use statrs::function::beta::beta_reg;

/// Which values a quantity can take: its sample is taken as normal after this is undone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ValueRange {
    /// Any: normal.
    Real,
    /// Above 0: the logarithm is normal.
    Positive,
    /// Between 0 and 1: the log odds are normal.
    Share,
}

impl ValueRange {
    /// The number that is normal, `None` outside the range or at its ends.
    #[must_use]
    pub fn straightened(self, value: f64) -> Option<f64> {
        let straight = match self {
            Self::Real => value,
            Self::Positive => value.ln(),
            Self::Share => (value / (1.0 - value)).ln(),
        };
        straight.is_finite().then_some(straight)
    }

    /// The number whose [`Self::straightened`] is given.
    #[must_use]
    pub fn bent(self, straight: f64) -> f64 {
        match self {
            Self::Real => straight,
            Self::Positive => straight.exp(),
            Self::Share => 1.0 / (1.0 + (-straight).exp()),
        }
    }
}

/// Where the ends of a tolerance interval come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToleranceMethod {
    /// Mean and standard deviation, the number, its logarithm or its log odds being normal, by the exact factor.
    Normal,
    /// Values of the sample, whatever the distribution (Wilks 1941).
    OrderStatistics,
}

/// Two-sided tolerance interval: with 95 % confidence it holds 95 % of the population. A range of normal values is one of these; the
/// percentiles of a sample hold less in half of all samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ToleranceInterval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Values in the sample.
    pub n: usize,
    /// Where the ends come from.
    pub method: ToleranceMethod,
}

/// Part of the population, and confidence.
pub(super) const CONTENT: f64 = 0.95;

impl ToleranceInterval {
    /// Fewest values: below, the factor on the standard deviation is above 3.4 and itself hardly known.
    pub const LEAST: usize = 10;

    /// The interval of a sample: by order statistics where it is large enough (93 values), otherwise by mean and standard deviation.
    ///
    /// `None` of fewer than [`Self::LEAST`] values, and of a small sample that has values at the ends of their range, where nothing
    /// is normal.
    #[must_use]
    pub fn of(values: &[f64], range: ValueRange) -> Option<Self> {
        let n = values.len();
        if n < Self::LEAST || values.iter().any(|value| !value.is_finite()) {
            return None;
        }
        if let Some(rank) = rank_from_end(n) {
            let mut sorted = values.to_vec();
            sorted.sort_unstable_by(f64::total_cmp);
            let [low, high] = [sorted[rank - 1], sorted[n - rank]];
            return Some(Self { low, high, n, method: ToleranceMethod::OrderStatistics });
        }
        let straight: Vec<f64> =
            values.iter().map(|value| range.straightened(*value)).collect::<Option<_>>()?;
        let mean = straight.iter().sum::<f64>() / n as f64;
        let squares: f64 = straight.iter().map(|value| (value - mean).powi(2)).sum();
        let reach = normal_factor(1.0 / n as f64, (n - 1) as f64) * (squares / (n - 1) as f64).sqrt();
        let [low, high] = [mean - reach, mean + reach].map(|end| range.bent(end));
        Some(Self { low, high, n, method: ToleranceMethod::Normal })
    }
}

/// Half of the nodes by which the error of a mean is integrated, fewest and most, and how many of its standard deviations they reach.
const NODES: [f64; 2] = [24.0, 4000.0];
const REACH: f64 = 6.0;

/// Exact factor on a standard deviation of so many degrees of freedom: to both sides of a mean whose variance is `leverage` times that of a
/// value it holds [`CONTENT`] of all values with a confidence of [`CONTENT`] (Krishnamoorthy and Mathew, Statistical Tolerance Regions, 2009,
/// section 2.3): over all errors of the mean, the chance that the standard deviation is large enough for this one.
pub(super) fn normal_factor(leverage: f64, degrees: f64) -> f64 {
    let Ok(chi) = ChiSquared::new(degrees) else { return f64::NAN };
    let normal = Normal::standard();
    let reach_of = |shift: f64| {
        let content = |reach: f64| normal.cdf(reach - shift) - normal.cdf(-reach - shift);
        let density = |reach: f64| normal.pdf(reach - shift) + normal.pdf(reach + shift);
        root(0.0, shift + 1.96, |reach| (content(reach) - CONTENT, density(reach)))
    };
    // Where the standard deviation is known better than the mean, the chance falls within a small part of an error of the mean
    let count = (REACH / 0.7 * (degrees * leverage).sqrt()).ceil().clamp(NODES[0], NODES[1]);
    let step = REACH / count;
    let node = |k: usize| {
        let z = k as f64 * step;
        let weight = normal.pdf(z) * step * if k == 0 { 1.0 } else { 2.0 };
        (weight, degrees * reach_of(z * leverage.sqrt()).powi(2))
    };
    let nodes: Vec<(f64, f64)> = (0..=count as usize).map(node).collect();
    // In the inverse square of the factor; the start is Howe's approximation (J. Am. Stat. Assoc. 64, 610, 1969)
    let sum = |f: &dyn Fn(f64) -> f64| nodes.iter().map(|(weight, scaled)| weight * f(*scaled)).sum::<f64>();
    let howe = chi.inverse_cdf(1.0 - CONTENT) / (degrees * (1.0 + leverage) * 1.96f64.powi(2));
    let inverse_square = root(0.0, howe, |u| {
        (CONTENT - sum(&|scaled| chi.sf(scaled * u)), sum(&|scaled| scaled * chi.pdf(scaled * u)))
    });
    inverse_square.sqrt().recip()
}

/// Where a function that rises from below 0 at `low` is 0: by Newton's steps from `start`, where these stay between what is known to lie
/// below and above, otherwise by halves. `f` gives value and slope.
fn root(mut low: f64, start: f64, f: impl Fn(f64) -> (f64, f64)) -> f64 {
    let (mut at, mut high) = (start, f64::INFINITY);
    for _ in 0..200 {
        let (value, slope) = f(at);
        if value < 0.0 {
            low = at
        } else {
            high = at
        }
        let next = at - value / slope;
        let middle = if high.is_finite() { 0.5 * (low + high) } else { 2.0 * at };
        let next = if next > low && next < high { next } else { middle };
        if (next - at).abs() <= 1e-12 * at.abs() {
            return next;
        }
        at = next;
    }
    at
}

/// The largest rank from either end of `n` sorted values between which 95 % of the population lie with 95 % confidence. Between these
/// ranks lies a share that has a beta distribution of `n + 1 - 2 rank` and `2 rank`. `None` where even the extremes are too near.
fn rank_from_end(n: usize) -> Option<usize> {
    let confidence = |rank: usize| 1.0 - beta_reg((n + 1 - 2 * rank) as f64, (2 * rank) as f64, CONTENT);
    (1..=n / 2).take_while(|&rank| confidence(rank) >= CONTENT).last()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::random::Key;

    /// Published factors for 95 % of the population with 95 % confidence (ISO 16269-6); least samples of extremes (Wilks).
    #[test]
    fn factors_and_ranks_are_the_published_ones() {
        for (n, factor) in [(10, 3.393), (20, 2.760), (40, 2.448), (60, 2.335), (120, 2.206)] {
            let found = normal_factor(1.0 / f64::from(n), f64::from(n - 1));
            assert!((found - factor).abs() < 0.0035, "{n}: {found}");
        }
        // A mean that is hardly known, of many people: over all its errors, from a bracket alone
        for (leverage, degrees) in [(1e-3, 1e6), (0.3, 3000.0), (3.0, 1000.0), (30.0, 1000.0), (100.0, 1.0)] {
            let found = normal_factor(leverage, degrees);
            let confidence = confidence_of(found, leverage, degrees);
            assert!((confidence - CONTENT).abs() < 1e-4, "{leverage} {degrees}: {found} {confidence}");
        }
        // One from either end from 93 on, two from 153 on
        let ranks = [92, 93, 152, 153].map(rank_from_end);
        assert_eq!(ranks, [None, Some(1), Some(1), Some(2)]);
    }

    /// The chance that mean +- factor sd holds 95 %, by a sum over 4000 errors of the mean and bisection for each.
    fn confidence_of(factor: f64, leverage: f64, degrees: f64) -> f64 {
        let (normal, chi) = (Normal::standard(), ChiSquared::new(degrees).unwrap());
        let of_error = |k: u32| {
            let z = -8.0 + 16.0 * (f64::from(k) + 0.5) / 4000.0;
            let shift = (z * leverage.sqrt()).abs();
            let [mut low, mut high] = [0.0, shift + 10.0];
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                let content = normal.cdf(middle - shift) - normal.cdf(-middle - shift);
                if content < CONTENT { low = middle } else { high = middle }
            }
            normal.pdf(z) * 16.0 / 4000.0 * chi.sf(degrees * (low / factor).powi(2))
        };
        (0..4000).map(of_error).sum()
    }

    #[test]
    fn small_samples_and_values_at_the_ends_have_no_interval() {
        let values: Vec<f64> = (1..=9).map(f64::from).collect();
        assert_eq!(ToleranceInterval::of(&values, ValueRange::Real), None);
        let shares: Vec<f64> = (0..20).map(|k| f64::from(k) / 40.0).collect();
        assert_eq!(ToleranceInterval::of(&shares, ValueRange::Share), None);
        let many: Vec<f64> = (0..93).map(|k| f64::from(k) / 93.0).collect();
        let found = ToleranceInterval::of(&many, ValueRange::Share).unwrap();
        assert_eq!((found.low, found.method), (0.0, ToleranceMethod::OrderStatistics));
    }

    /// Of 2000 samples of 30 and of 100 log-normal people at least 95 % hold 95 % of them, but for four standard errors (0.0195).
    #[test]
    fn intervals_hold_the_population_as_often_as_they_say() {
        for n in [30u64, 100] {
            let holds = |sample: &u64| {
                let value = |k| (0.5 * Key::new(11).with(n).with(*sample).with(k).normal()).exp();
                let values: Vec<f64> = (0..n).map(value).collect();
                let found = ToleranceInterval::of(&values, ValueRange::Positive).unwrap();
                let below = |end: f64| crate::analysis::auc_of_d_prime(2f64.sqrt() * end.ln() / 0.5);
                below(found.high) - below(found.low) >= CONTENT
            };
            let share = (0..2000).filter(holds).count() as f64 / 2000.0;
            assert!(share > 0.95 - 0.0195, "{n}: {share}");
        }
    }
}
