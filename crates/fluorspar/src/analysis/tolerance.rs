//! Intervals that hold a wanted part of a population, made from a sample of it.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use statrs::function::beta::beta_reg;

use crate::sampling::Z_95;

/// Which values a quantity can take: its sample is taken as normal after this is undone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// Mean and standard deviation, the number, its logarithm or its log odds being normal (Howe 1969).
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
const CONTENT: f64 = 0.95;

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
        let reach = howe_factor(n)? * (squares / (n - 1) as f64).sqrt();
        let [low, high] = [mean - reach, mean + reach].map(|end| range.bent(end));
        Some(Self { low, high, n, method: ToleranceMethod::Normal })
    }
}

/// Howe's factor on the standard deviation of a normal sample: `z sqrt((n - 1)(1 + 1/n) / chi²)` with the lower 5 % quantile of
/// chi-square of `n - 1` degrees (J. Am. Stat. Assoc. 64, 610, 1969).
fn howe_factor(n: usize) -> Option<f64> {
    let degrees = (n - 1) as f64;
    let quantile = ChiSquared::new(degrees).ok()?.inverse_cdf(1.0 - CONTENT);
    Some(Z_95 * (degrees * (1.0 + 1.0 / n as f64) / quantile).sqrt())
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

    /// Published factors for 95 % of the population with 95 % confidence, two decimals; least samples of extremes (Wilks).
    #[test]
    fn factors_and_ranks_are_the_published_ones() {
        for (n, factor) in [(10, 3.38), (20, 2.75), (40, 2.44), (60, 2.33), (120, 2.20), (240, 2.12)] {
            let found = howe_factor(n).unwrap();
            assert!((found - factor).abs() < 0.0051, "{n}: {found}");
        }
        // One from either end from 93 on, two from 153 on
        let ranks = [92, 93, 152, 153].map(rank_from_end);
        assert_eq!(ranks, [None, Some(1), Some(1), Some(2)]);
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

    /// Of 2000 samples of 30 and of 100 log-normal people at least 95 % hold 95 % of them, but for four standard errors (0.0195) and
    /// the 0.2 % by which Howe's factor is small.
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
            assert!(share > 0.95 - 0.0195 - 0.002, "{n}: {share}");
        }
    }
}
