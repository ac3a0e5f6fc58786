//! Estimates against their truth.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::sampling::Z_95;

/// An estimate with its 95 % interval, and the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimateOfTruth {
    /// Estimate; `None` where there is an interval only.
    pub estimate: Option<f64>,
    /// Its interval, if it has one.
    pub interval: Option<[f64; 2]>,
    /// What it is of.
    pub truth: f64,
}

/// Agreement of estimates with the truth after Bland and Altman (Stat. Methods Med. Res. 8, 135, 1999): mean and spread of estimate
/// less truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// Estimates.
    pub n: usize,
    /// Cases without an estimate. Bias and limits leave them out, and would be others with them where it is small or large truths that have none.
    pub without_estimate: usize,
    /// Mean difference.
    pub bias: f64,
    /// Its 95 % interval, by Student's t.
    pub bias_interval: [f64; 2],
    /// Limits of agreement: bias -+ 1.96 standard deviations, between which 95 % of differences lie if they are normal.
    pub limits: [f64; 2],
    /// 95 % intervals of the lower and of the upper limit.
    pub limit_intervals: [[f64; 2]; 2],
    /// Estimates that have an interval.
    pub with_interval: usize,
    /// Intervals that hold the truth.
    pub held: usize,
}

impl Agreement {
    /// Fewest estimates.
    pub const LEAST: usize = 3;

    /// The agreement of at least [`Self::LEAST`] estimates; `None` of fewer. Intervals without an estimate are counted only.
    #[must_use]
    pub fn of(cases: &[EstimateOfTruth]) -> Option<Self> {
        let differences: Vec<f64> =
            cases.iter().filter_map(|case| Some(case.estimate? - case.truth)).collect();
        let n = differences.len();
        if n < Self::LEAST {
            return None;
        }
        let number = n as f64;
        let bias = differences.iter().sum::<f64>() / number;
        let variance = differences.iter().map(|d| (d - bias).powi(2)).sum::<f64>() / (number - 1.0);
        let t = StudentsT::new(0.0, 1.0, number - 1.0).ok()?.inverse_cdf(0.975);
        let around = |center: f64, variance: f64| {
            let reach = t * variance.sqrt();
            [center - reach, center + reach]
        };
        let limits = [-Z_95, Z_95].map(|z| bias + z * variance.sqrt());
        // Of the mean, and of the standard deviation, which is independent of it
        let of_limit = variance * (1.0 / number + Z_95 * Z_95 / (2.0 * (number - 1.0)));
        let intervals = cases.iter().filter_map(|case| Some((case.interval?, case.truth)));
        let held = intervals.clone().filter(|([low, high], truth)| (*low..=*high).contains(truth)).count();
        Some(Self {
            n,
            without_estimate: cases.len() - n,
            bias,
            bias_interval: around(bias, variance / number),
            limits,
            limit_intervals: limits.map(|limit| around(limit, of_limit)),
            with_interval: intervals.count(),
            held,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Differences -1, 0, 1, 2, 3: mean 1, variance 2.5, t of 4 degrees 2.776445 (tables).
    #[test]
    fn bias_and_limits_are_those_by_hand() {
        let case = |k: i32| EstimateOfTruth {
            estimate: Some(f64::from(k) + 10.0),
            interval: Some([10.0 - 0.5, 10.0 + f64::from(k)]),
            truth: 10.0,
        };
        let mut cases: Vec<EstimateOfTruth> = (-1..=3).map(case).collect();
        cases.push(EstimateOfTruth { estimate: None, interval: Some([0.0, 20.0]), truth: 10.0 });
        let found = Agreement::of(&cases).unwrap();
        let (sd, t) = (2.5f64.sqrt(), 2.776_445);
        assert_eq!((found.n, found.without_estimate, found.bias), (5, 1, 1.0));
        assert_eq!((found.with_interval, found.held), (6, 5));
        assert!((found.bias_interval[1] - (1.0 + t * (0.5f64).sqrt())).abs() < 1e-5);
        assert!((found.limits[0] - (1.0 - 1.959_964 * sd)).abs() < 1e-6);
        let reach = t * (2.5 * (0.2 + 1.959_964f64.powi(2) / 8.0)).sqrt();
        assert!((found.limit_intervals[1][1] - found.limits[1] - reach).abs() < 1e-5);
        assert_eq!(Agreement::of(&cases[..2]), None);
    }
}
