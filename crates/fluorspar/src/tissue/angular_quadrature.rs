//! Directions of discrete ordinates, shared by all media of a stack.

use std::f64::consts::PI;
use std::ops::Range;

/// Nodes and weights of the quadrature of Gauss and Legendre on 0 to `end`, nodes rising.
pub(super) fn gauss_legendre(number: usize, end: f64) -> Vec<(f64, f64)> {
    (0..number)
        .map(|i| {
            let mut x = -((i as f64 + 0.75) / (number as f64 + 0.5) * PI).cos();
            // Newton's method converges in four steps from this start.
            for _ in 0..8 {
                let (value, slope) = legendre(number, x);
                x -= value / slope;
            }
            let (_, slope) = legendre(number, x);
            let weight = 2.0 / ((1.0 - x * x) * slope * slope);
            (0.5 * end * (1.0 + x), 0.5 * end * weight)
        })
        .collect()
}

/// Legendre polynomial of a degree above 0, and its derivative.
fn legendre(degree: usize, x: f64) -> (f64, f64) {
    let (mut before, mut value) = (1.0, x);
    for l in 2..=degree {
        let l = l as f64;
        (before, value) = (value, ((2.0 * l - 1.0) * x * value - (l - 1.0) * before) / l);
    }
    (value, degree as f64 * (x * value - before) / (x * x - 1.0))
}

/// Legendre polynomials of degree 0 to `number - 1`.
pub(super) fn legendre_series(number: usize, x: f64) -> Vec<f64> {
    let mut series = vec![1.0; number];
    if number > 1 {
        series[1] = x;
    }
    for degree in 2..number {
        let l = degree as f64;
        series[degree] = ((2.0 * l - 1.0) * x * series[degree - 1] - (l - 1.0) * series[degree - 2]) / l;
    }
    series
}

/// Cosine in a medium of index `index` of light with `index sin(theta) = lateral`; 0 where there is no such direction.
pub(super) fn cosine(lateral: f64, index: f64) -> f64 {
    (1.0 - (lateral / index).powi(2)).max(0.0).sqrt()
}

/// One direction in every medium that has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ordinate {
    /// `n sin(theta)`, which refraction keeps.
    pub(super) lateral: f64,
    /// `n^2 mu w`, which refraction keeps, too.
    pub(super) etendue: f64,
}

/// Ordinates between the critical angles of two media.
struct Interval {
    /// Index of the medium in which they reach the grazing direction.
    index: f64,
    ordinates: Range<usize>,
}

/// Directions of one hemisphere, from the normal to the grazing one.
///
/// They are split where some medium of the stack begins to reflect totally. In each interval they are Gauss nodes in the
/// cosine of the medium that has its grazing direction there: in that variable Fresnel's equations are smooth, while in
/// any other they begin with a square root, which no polynomial follows.
pub(super) struct AngularQuadrature {
    pub(super) ordinates: Vec<Ordinate>,
    intervals: Vec<Interval>,
}

impl AngularQuadrature {
    /// About `nodes` directions for layers of these indices between two outer media.
    pub(super) fn new(nodes: usize, layer_indices: &[f64], outside: [f64; 2]) -> Self {
        let highest = layer_indices.iter().copied().fold(0.0, f64::max);
        let mut media: Vec<f64> =
            layer_indices.iter().copied().chain(outside).filter(|&n| n <= highest).collect();
        media.sort_by(f64::total_cmp);
        media.dedup();
        let mut ordinates: Vec<Ordinate> = Vec::new();
        let mut intervals = Vec::with_capacity(media.len());
        let mut denied_below = 0.0;
        for index in media {
            let first = ordinates.len();
            let steepest = cosine(denied_below, index);
            // As many as the interval has of the right angle in the densest medium.
            let angle = (index / highest).min(1.0).asin() - (denied_below / highest).asin();
            let number = ((nodes as f64 * angle / (0.5 * PI)).round() as usize).max(4);
            ordinates.extend(gauss_legendre(number, steepest).into_iter().rev().map(|(mu, weight)| {
                Ordinate { lateral: index * (1.0 - mu * mu).sqrt(), etendue: index * index * mu * weight }
            }));
            intervals.push(Interval { index, ordinates: first..ordinates.len() });
            denied_below = index;
        }
        Self { ordinates, intervals }
    }

    /// How many of the ordinates, counted from the normal, exist in a medium of the stack.
    pub(super) fn number_in(&self, index: f64) -> usize {
        self.intervals.iter().take_while(|i| i.index <= index).last().map_or(0, |i| i.ordinates.end)
    }

    /// Value in any direction of what is known at the ordinates, by the polynomial through those of its interval.
    pub(super) fn interpolate(&self, values: &[f64], lateral: f64) -> f64 {
        let Some(interval) =
            self.intervals.iter().find(|i| lateral <= i.index).or_else(|| self.intervals.last())
        else {
            return 0.0;
        };
        let at = cosine(lateral, interval.index);
        let nodes: Vec<f64> = self.ordinates[interval.ordinates.clone()]
            .iter()
            .map(|o| cosine(o.lateral, interval.index))
            .collect();
        let others = |i: usize| nodes.iter().enumerate().filter(move |(j, _)| *j != i).map(|(_, x)| x);
        let known = &values[interval.ordinates.clone()];
        let factor = |i: usize| others(i).map(|x| (at - x) / (nodes[i] - x)).product::<f64>();
        known.iter().enumerate().map(|(i, value)| value * factor(i)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauss_integrates_polynomials_exactly() {
        for number in [1, 2, 5, 32] {
            let nodes = gauss_legendre(number, 0.7);
            for power in 0..2 * number as i32 {
                let sum: f64 = nodes.iter().map(|(x, w)| w * x.powi(power)).sum();
                let exact = 0.7f64.powi(power + 1) / f64::from(power + 1);
                assert!((sum / exact - 1.0).abs() < 1e-12, "{number} nodes, power {power}");
            }
        }
    }

    #[test]
    fn every_medium_has_the_etendue_of_a_hemisphere() {
        let quadrature = AngularQuadrature::new(24, &[1.4, 1.6], [1.0, 1.5]);
        for index in [1.0, 1.4, 1.5, 1.6] {
            let number = quadrature.number_in(index);
            let sum: f64 = quadrature.ordinates[..number].iter().map(|o| o.etendue).sum();
            assert!((sum / (0.5 * index * index) - 1.0).abs() < 1e-12, "{index}: {sum}");
        }
        assert_eq!(quadrature.number_in(1.6), quadrature.ordinates.len());
    }

    #[test]
    fn polynomials_of_the_outer_cosine_are_interpolated_exactly() {
        let quadrature = AngularQuadrature::new(16, &[1.4], [1.0, 1.4]);
        let f = |lateral: f64| {
            let mu = cosine(lateral, 1.0);
            1.0 + mu - 2.0 * mu.powi(5)
        };
        let values: Vec<f64> = quadrature.ordinates.iter().map(|o| f(o.lateral)).collect();
        for mu in [0.02, 0.3, 0.77, 1.0f64] {
            let lateral = (1.0 - mu * mu).sqrt();
            assert!((quadrature.interpolate(&values, lateral) - f(lateral)).abs() < 1e-12);
        }
    }
}
