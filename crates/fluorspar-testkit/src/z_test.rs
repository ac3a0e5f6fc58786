//! Means with standard errors.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// A mean and its standard error, from independent samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeanEstimate {
    /// Mean.
    pub mean: f64,
    /// Standard error of the mean.
    pub standard_error: f64,
}

impl MeanEstimate {
    /// From independent samples; the standard error is zero for fewer than two.
    pub fn of(samples: &[f64]) -> Self {
        let n = samples.len() as f64;
        let mean = samples.iter().sum::<f64>() / n;
        let variance = samples.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0).max(1.0);
        Self { mean, standard_error: (variance / n).sqrt() }
    }
}

/// Standard errors between an estimate and the truth. An absolute `rounding` allowance is taken off the distance.
/// Infinite for an estimate that is not finite.
pub fn z_score(estimate: MeanEstimate, truth: f64, rounding: f64) -> f64 {
    if !(estimate.mean.is_finite() && estimate.standard_error.is_finite() && truth.is_finite()) {
        return f64::INFINITY;
    }
    let distance = ((estimate.mean - truth).abs() - rounding).max(0.0);
    if distance == 0.0 { 0.0 } else { distance / estimate.standard_error }
}

/// Standard errors that the estimate of a true mean exceeds, either way, with the probability `significance`: the
/// two-sided quantile of the standard normal distribution. 1.96 at 0.05.
pub fn z_limit(significance: f64) -> f64 {
    Normal::standard().inverse_cdf(1.0 - 0.5 * significance)
}

/// Probability that two sets of independent, nearly normal measurements with equal means differ in their means by as
/// much as these do, both tails: Welch's t-test, which lets the variances differ (B. L. Welch, Biometrika 34, 28 (1947)).
/// Zero when both sets are constant and differ; not a number when a set has fewer than two members or one that is not
/// finite.
pub fn welch_t_test(a: &[f64], b: &[f64]) -> f64 {
    let (x, y) = (MeanEstimate::of(a), MeanEstimate::of(b));
    if a.len() < 2 || b.len() < 2 || !(x.mean - y.mean).is_finite() {
        return f64::NAN;
    }
    let (vx, vy) = (x.standard_error.powi(2), y.standard_error.powi(2));
    if vx + vy == 0.0 {
        return if x.mean == y.mean { 1.0 } else { 0.0 };
    }
    let t = (x.mean - y.mean).abs() / (vx + vy).sqrt();
    let freedom = (vx + vy).powi(2) / (vx * vx / (a.len() - 1) as f64 + vy * vy / (b.len() - 1) as f64);
    StudentsT::new(0.0, 1.0, freedom).map_or(f64::NAN, |distribution| 2.0 * distribution.sf(t))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn welch_of_a_known_pair() {
        // t = -2.8530 with 27.887 degrees of freedom; the tail integrated numerically: p = 0.008072.
        let a = [27.5, 21.0, 19.0, 23.6, 17.0, 17.9, 16.9, 20.1, 21.9, 22.6, 23.1, 19.6, 19.0, 21.7, 21.4];
        let b = [27.1, 22.0, 20.8, 23.4, 23.4, 23.5, 25.8, 22.0, 24.8, 20.2, 21.9, 22.1, 22.9, 30.5, 24.4];
        assert!((welch_t_test(&a, &b) - 0.008_072).abs() < 1e-6, "{}", welch_t_test(&a, &b));
        assert_eq!(welch_t_test(&[1.0, 1.0], &[1.0, 1.0]), 1.0);
        assert_eq!(welch_t_test(&[1.0, 1.0], &[2.0, 2.0]), 0.0);
        assert!(welch_t_test(&[1.0], &[2.0, 2.0]).is_nan());
    }

    #[test]
    fn limits_of_the_normal_distribution() {
        // Abramowitz and Stegun, table 26.6.
        for (significance, z) in [(0.05, 1.959_963_985), (1e-3, 3.290_526_731), (1e-6, 4.891_638_476)] {
            assert!((z_limit(significance) - z).abs() < 1e-6, "{}", z_limit(significance));
        }
    }

    #[test]
    fn standard_error_of_a_known_sample() {
        let estimate = MeanEstimate::of(&[1.0, 2.0, 3.0, 4.0]);
        assert_eq!(estimate.mean, 2.5);
        assert!((estimate.standard_error - (5.0_f64 / 3.0 / 4.0).sqrt()).abs() < 1e-12);
        assert!((z_score(estimate, 2.5 + 2.0 * estimate.standard_error, 0.0) - 2.0).abs() < 1e-12);
        assert_eq!(z_score(estimate, 2.4, 0.2), 0.0);
        assert_eq!(z_score(MeanEstimate::of(&[1.0, f64::NAN]), 2.4, 0.2), f64::INFINITY);
    }
}
