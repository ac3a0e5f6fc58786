//! The photon-transfer curve of a pixel in closed form: temporal variance against mean signal, up to saturation.

use std::f64::consts::PI;

use statrs::function::erf::erfc;

/// Absolute sensitivity threshold of EMVA 1288 (release 4, Eq. 26) in electrons, the mean signal at which signal and
/// temporal noise are equal: `sqrt(dark noise² + 1 / (12 K²) + 1/4) + 1/2`.
pub fn sensitivity_threshold_e(dark_noise_e: f64, dn_per_electron: f64) -> f64 {
    (dark_noise_e.powi(2) + 1.0 / (12.0 * dn_per_electron.powi(2)) + 0.25).sqrt() + 0.5
}

/// Where a signal ends, and the noise that is there before it ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// Electrons of a full well, or at which the converter reaches its last code.
    pub electrons: f64,
    /// Temporal noise besides shot noise that is cut with the signal, e- rms: 0 for a well, the read noise for a
    /// converter.
    pub noise_e: f64,
}

impl Limit {
    /// A well that fills before anything is read.
    pub fn well(electrons: f64) -> Self {
        Self { electrons, noise_e: 0.0 }
    }
}

/// Variance of `min(X, limit)` for a normal X of mean `mean_e`, shot noise and the noise of the limit.
///
/// With `a = (limit - mean) / sigma`: `E[min(Z, a)]` and its square are integrals of the normal density. Good to the
/// skewness of the Poisson distribution, `1 / sqrt(mean)`.
fn clipped_variance_e2(mean_e: f64, limit: Limit) -> f64 {
    let variance_e2 = mean_e.max(0.0) + limit.noise_e.powi(2);
    if variance_e2 <= 0.0 {
        return 0.0;
    }
    let a = (limit.electrons - mean_e) / variance_e2.sqrt();
    let below = 0.5 * erfc(-a / std::f64::consts::SQRT_2);
    let density = (-0.5 * a * a).exp() / (2.0 * PI).sqrt();
    // Moments of min(X - limit, 0) in units of sigma.
    let first = -a * below - density;
    let second = (a * a + 1.0) * below + a * density;
    variance_e2 * (second - first * first).max(0.0)
}

/// Mean over the pixels of the temporal variance, e-², at a mean number of electrons that light frees. The pixels'
/// responsivities are normal with a relative deviation `prnu`, so they reach the limit one after the other.
pub fn temporal_variance_e2(mean_e: f64, limit: Limit, prnu: f64) -> f64 {
    if prnu <= 0.0 {
        return clipped_variance_e2(mean_e, limit);
    }
    // Rectangle sum over five standard deviations: exact to rounding for a smooth integrand.
    const STEPS: i32 = 20;
    let (mut sum, mut weight) = (0.0, 0.0);
    for step in -STEPS..=STEPS {
        let deviation = 5.0 * f64::from(step) / f64::from(STEPS);
        let density = (-0.5 * deviation * deviation).exp();
        sum += density * clipped_variance_e2(mean_e * (1.0 + prnu * deviation), limit);
        weight += density;
    }
    sum / weight
}

/// Saturation capacity of EMVA 1288, e-: the mean signal of the largest temporal variance.
pub fn saturation_capacity_e(limit: Limit, prnu: f64) -> f64 {
    let well_e = limit.electrons;
    // The variance rises with the mean and falls when pixels fill: one maximum. Golden-section search.
    let shrink = 0.5 * (5f64.sqrt() - 1.0);
    let (mut low, mut high) = (0.3 * well_e, 1.2 * well_e);
    while high - low > 1e-7 * well_e {
        let (left, right) = (high - shrink * (high - low), low + shrink * (high - low));
        if temporal_variance_e2(left, limit, prnu) < temporal_variance_e2(right, limit, prnu) {
            low = left;
        } else {
            high = right;
        }
    }
    0.5 * (low + high)
}

/// The well whose [`saturation_capacity_e`] is a given one, e-.
pub fn well_for_saturation_e(saturation_e: f64, prnu: f64) -> f64 {
    let (mut low, mut high) = (saturation_e, 3.0 * saturation_e);
    while high - low > 1e-6 * saturation_e {
        let middle = 0.5 * (low + high);
        if saturation_capacity_e(Limit::well(middle), prnu) < saturation_e {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_below_the_well_the_variance_is_the_mean_and_far_above_nothing() {
        for prnu in [0.0, 0.02] {
            assert!((temporal_variance_e2(5000.0, Limit::well(10_000.0), prnu) / 5000.0 - 1.0).abs() < 1e-9);
            assert!(temporal_variance_e2(14_000.0, Limit::well(10_000.0), prnu) < 1e-6);
        }
        // At the well: Var(min(Z, 0)) = 1/2 - 1 / (2 pi).
        let expected = 10_000.0 * (0.5 - 0.5 / PI);
        assert!((temporal_variance_e2(10_000.0, Limit::well(10_000.0), 0.0) / expected - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_well_and_its_saturation_capacity_belong_together() {
        for (saturation, prnu) in [(9000.0, 0.0229), (10_300.0, 0.006), (100_000.0, 0.0), (500.0, 0.01)] {
            let well = well_for_saturation_e(saturation, prnu);
            assert!(well > saturation);
            assert!(
                (saturation_capacity_e(Limit::well(well), prnu) / saturation - 1.0).abs() < 1e-4,
                "{saturation} {prnu}"
            );
        }
    }

    #[test]
    fn the_threshold_of_an_ideal_pixel_is_one_electron() {
        assert!((sensitivity_threshold_e(0.0, 1e9) - 1.0).abs() < 1e-12);
    }
}
