//! Means with standard errors.

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

#[cfg(test)]
mod tests {
    use super::*;

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
