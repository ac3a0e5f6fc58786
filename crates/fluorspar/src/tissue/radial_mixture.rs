//! Light that leaves tissue around a beam, as a mixture of Gaussians in the plane (d'Eon, Luebke and Enderton, Efficient Rendering of
//! Human Skin, EGSR 2007): positive, of known integral, and easy to sample.

use std::sync::LazyLock;

/// Gaussians of a mixture.
pub const GAUSSIANS: usize = 16;
/// Standard deviation of the narrowest, mm, and how much wider each one is than that before.
const NARROWEST_MM: f64 = 0.012;
const WIDER: f64 = 1.55;
/// Rings in which light is counted: the first has the outer radius `FIRST_RING_MM`, each other one is wider by `RING_RATIO`.
pub(super) const RINGS: usize = 40;
const FIRST_RING_MM: f64 = 0.01;
const RING_RATIO: f64 = 1.23;
/// Steps of the fit from an even mixture: few, so that it stays smooth where counts are noisy.
const STEPS: usize = 80;

/// Shares of the Gaussians; they add up to 1.
pub(super) type Shares = [f32; GAUSSIANS];

/// Standard deviation of a Gaussian along each axis, mm.
#[must_use]
pub fn gaussian_mm(number: usize) -> f64 {
    NARROWEST_MM * WIDER.powi(number as i32)
}

/// Ring in which a distance from the beam lies, mm; beyond the outermost the number of rings.
pub(super) fn ring(radius_mm: f32) -> usize {
    let rings = (f64::from(radius_mm).max(1e-9) / FIRST_RING_MM).ln() / RING_RATIO.ln();
    ((rings + 1.0).max(0.0) as usize).min(RINGS)
}

/// Shares of each Gaussian in each ring, `[ring][gaussian]`.
static IN_RINGS: LazyLock<Vec<[f64; GAUSSIANS]>> = LazyLock::new(|| {
    let beyond = |radius_mm: f64, number: usize| (-0.5 * (radius_mm / gaussian_mm(number)).powi(2)).exp();
    let edge = |ring: usize| if ring == 0 { 0.0 } else { FIRST_RING_MM * RING_RATIO.powi(ring as i32 - 1) };
    let share = |ring: usize, number: usize| beyond(edge(ring), number) - beyond(edge(ring + 1), number);
    (0..RINGS).map(|ring| std::array::from_fn(|number| share(ring, number))).collect()
});

/// The mixture that meets the light counted in rings best: maximum likelihood, by expectation and maximization. Where there is no
/// light it is the narrowest Gaussian.
pub(super) fn fit(counted: &[f64; RINGS]) -> Shares {
    let total: f64 = counted.iter().sum();
    if total <= 0.0 || !total.is_finite() {
        return std::array::from_fn(|number| if number == 0 { 1.0 } else { 0.0 });
    }
    let mut shares = [1.0 / GAUSSIANS as f64; GAUSSIANS];
    for _ in 0..STEPS {
        let mut next = [0.0; GAUSSIANS];
        for (light, of_gaussians) in counted.iter().zip(IN_RINGS.iter()) {
            let sum: f64 = shares.iter().zip(of_gaussians).map(|(share, part)| share * part).sum();
            if *light > 0.0 && sum > 0.0 {
                let factor = light / (total * sum);
                for ((next, share), part) in next.iter_mut().zip(&shares).zip(of_gaussians) {
                    *next += factor * share * part;
                }
            }
        }
        let norm: f64 = next.iter().sum();
        shares = next.map(|share| share / norm);
    }
    shares.map(|share| share as f32)
}

/// Light per area at a distance, 1/mm², of all that a mixture holds.
#[must_use]
pub fn density_per_mm2(shares: &[f32; GAUSSIANS], radius_mm: f64) -> f64 {
    let of_gaussian = |(number, share): (usize, &f32)| {
        let variance = gaussian_mm(number).powi(2);
        f64::from(*share) * (-0.5 * radius_mm * radius_mm / variance).exp()
            / (2.0 * std::f64::consts::PI * variance)
    };
    shares.iter().enumerate().map(of_gaussian).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mixtures_are_found_again() {
        let truth: Shares =
            std::array::from_fn(|number| [0.2, 0.5, 0.3].get(number.wrapping_sub(6)).copied().unwrap_or(0.0));
        let counted: [f64; RINGS] = std::array::from_fn(|ring| {
            let parts = IN_RINGS[ring].iter().zip(&truth);
            1e4 * parts.map(|(part, share)| part * f64::from(*share)).sum::<f64>()
        });
        let found = fit(&counted);
        assert!((found.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        for radius_mm in [0.05, 0.1, 0.2, 0.4, 0.6] {
            let [found, truth] = [&found, &truth].map(|shares| density_per_mm2(shares, radius_mm));
            assert!((found / truth - 1.0).abs() < 0.05, "{radius_mm} mm: {found} for {truth}");
        }
    }

    #[test]
    fn rings_follow_each_other() {
        assert_eq!([0.0, 0.005, 0.0099].map(ring), [0; 3]);
        assert_eq!([0.0101, 0.0122, 0.0124].map(ring), [1, 1, 2]);
        assert_eq!(ring(1e3), RINGS);
    }
}
