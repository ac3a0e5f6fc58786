//! The diffraction pattern of a round aperture.

use std::f64::consts::PI;

/// Encircled energy of the Airy pattern, `1 - J0² - J1²` at `v = pi r / (lambda N)`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Airy {
    energy: Vec<f64>,
}

/// Largest `v` of the table: 97.9 % of the energy lie inside; the rest is left out and the pattern normalized.
const REACH: f64 = 30.0;
const STEPS: usize = 600;

impl Airy {
    pub(super) fn new() -> Self {
        let energy = |step: usize| {
            let v = REACH * step as f64 / STEPS as f64;
            1.0 - bessel(0, v).powi(2) - bessel(1, v).powi(2)
        };
        let last = energy(STEPS);
        Self { energy: (0..=STEPS).map(|step| energy(step) / last).collect() }
    }

    /// A random place in the pattern, in wavelengths times the f-number.
    pub(super) fn sample(&self, [u, v]: [f32; 2]) -> [f64; 2] {
        let (radius, angle) = (self.radius(f64::from(u)), 2.0 * PI * f64::from(v));
        [radius * angle.cos(), radius * angle.sin()]
    }

    /// The radius that a share of the energy lies within, in wavelengths times the f-number.
    fn radius(&self, share: f64) -> f64 {
        let right = self.energy.partition_point(|e| *e < share).clamp(1, STEPS);
        let (low, high) = (self.energy[right - 1], self.energy[right]);
        let part = if high > low { (share - low) / (high - low) } else { 0.0 };
        let step = (right - 1) as f64 + part.clamp(0.0, 1.0);
        REACH / PI * step / STEPS as f64
    }
}

/// Bessel function of the first kind by its integral, `(1/pi) integral cos(n t - x sin t)`; the trapezoidal rule is exact
/// to rounding for `x` below the number of its nodes.
fn bessel(order: i32, x: f64) -> f64 {
    const NODES: usize = 96;
    let sum: f64 = (0..NODES)
        .map(|i| {
            let t = 2.0 * PI * (i as f64 + 0.5) / NODES as f64;
            (f64::from(order) * t - x * t.sin()).cos()
        })
        .sum();
    sum / NODES as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_airy_pattern_holds_84_percent_in_its_first_dark_ring() {
        // First zero of J1 at 3.8317; Lord Rayleigh: 83.8 % inside. The table leaves the outermost 2 % out.
        let inside = |v: f64| 1.0 - bessel(0, v).powi(2) - bessel(1, v).powi(2);
        assert!((inside(3.831_706) - 0.8378).abs() < 1e-4);
        let airy = Airy::new();
        // Radii come back from their shares: v = pi r / (lambda N). Not at a dark ring itself, where the share stands still.
        for v in [0.5, 1.0, 2.0, 3.0, 4.5, 12.0] {
            let ours = airy.radius(inside(v) / inside(REACH)) * PI;
            assert!((ours / v - 1.0).abs() < 5e-3, "{v}: {ours}");
        }
        assert!(airy.radius(0.0) < 1e-30);
    }

    #[test]
    fn bessel_functions_have_their_table_values() {
        for (order, x, value) in
            [(0, 1.0, 0.765_197_686_6), (1, 1.0, 0.440_050_585_7), (0, 25.0, 0.096_266_783_3)]
        {
            assert!((bessel(order, x) - value).abs() < 1e-9);
        }
    }
}
