//! What a design is judged by.

use super::fisher::Bound;

/// A ratio of amounts that an estimate is wanted of, such as NADH / (NADH + FAD): its value and its gradient by the weights,
/// which are relative to what the region holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Contrast {
    /// Name.
    pub name: String,
    /// Amount of each fluorophore that counts in the numerator.
    pub part: Vec<f64>,
    /// The same of the denominator.
    pub whole: Vec<f64>,
}

impl Contrast {
    /// Its value in the region: `sum part / sum whole`; `None` where nothing counts.
    pub fn value(&self) -> Option<f64> {
        let whole: f64 = self.whole.iter().sum();
        (whole > 0.0).then(|| self.part.iter().sum::<f64>() / whole)
    }

    /// Bound on its standard deviation by the delta method: `g^T C g`, `g = (part - value whole) / sum whole`.
    pub fn standard_deviation(&self, bound: &Bound) -> Option<f64> {
        let (value, whole) = (self.value()?, self.whole.iter().sum::<f64>());
        let gradient = self.part.iter().zip(&self.whole).map(|(part, all)| (part - value * all) / whole);
        Some(bound.variance_of(&gradient.collect::<Vec<f64>>()).sqrt())
    }
}

/// A figure of merit as a loss: less is better, infinite where a design can't do it at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Criterion {
    /// Volume of the error ellipsoid: `det(C)^(1 / 2n)`, a geometric mean of relative standard deviations.
    D,
    /// Mean variance: `sqrt(tr C / n)`.
    A,
    /// Worst combination of weights: `sqrt(largest eigenvalue of C)`.
    E,
    /// Worst relative standard deviation of a weight.
    Minimax,
    /// Standard deviation of the contrast of this number (c-optimal).
    Contrast(usize),
    /// `1 / d'` between the states of a cohort.
    Detection,
    /// Reflected electrons per fluorescent electron, of the worst exposure through a filter.
    Leak,
}

impl Criterion {
    /// The loss of one region from its bound; `None` of a criterion that takes more than a bound.
    pub fn of_bound(self, bound: &Bound, contrasts: &[Contrast]) -> Option<f64> {
        let deviations = bound.standard_deviations();
        let count = deviations.len().max(1) as f64;
        match self {
            Self::D => Some((-0.5 * bound.log_determinant() / count).exp()),
            Self::A => Some((deviations.iter().map(|s| s * s).sum::<f64>() / count).sqrt()),
            Self::E => Some(bound.largest_variance().sqrt()),
            Self::Minimax => Some(deviations.iter().copied().fold(0.0, f64::max)),
            Self::Contrast(number) => contrasts.get(number)?.standard_deviation(bound),
            Self::Detection | Self::Leak => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Information;
    use super::*;

    /// Two independent weights of 2 % and 10 %: every criterion by hand.
    #[test]
    fn criteria_of_independent_weights() {
        let mut information = Information::new(2, 0);
        information.know(0, 0.02);
        information.know(1, 0.1);
        let bound = information.bound();
        let redox = Contrast { name: "redox".into(), part: vec![1.0, 0.0], whole: vec![1.0, 3.0] };
        let contrasts = [redox];
        for (criterion, expected) in [
            (Criterion::D, (0.02f64 * 0.1).sqrt()),
            (Criterion::A, ((0.0004f64 + 0.01) / 2.0).sqrt()),
            (Criterion::E, 0.1),
            (Criterion::Minimax, 0.1),
            // f = 1/4; g = (1 - 1/4, -3/4) / 4
            (Criterion::Contrast(0), 0.1875 * (0.0004f64 + 0.01).sqrt()),
        ] {
            let loss = criterion.of_bound(&bound, &contrasts).unwrap();
            assert!((loss / expected - 1.0).abs() < 1e-9, "{criterion:?} {loss} {expected}");
        }
        assert_eq!(contrasts[0].value(), Some(0.25));
        assert_eq!(Criterion::Contrast(1).of_bound(&bound, &contrasts), None);
    }

    /// What changes no ratio is not seen by it: a common factor of all weights.
    #[test]
    fn a_contrast_outlives_an_unknown_gain() {
        let mut information = Information::new(2, 1);
        for row in [[3.0, 1.0], [1.0, 2.0], [2.0, 2.0]] {
            information.observe(&[row[0], row[1], row[0] + row[1]], 1.0);
        }
        let bound = information.bound();
        let ratio = Contrast { name: "ratio".into(), part: vec![1.0, 0.0], whole: vec![1.0, 1.0] };
        assert!(bound.is_singular() && bound.rank() == 1);
        assert!(Criterion::Minimax.of_bound(&bound, &[]).unwrap().is_infinite());
        assert!(ratio.standard_deviation(&bound).unwrap().is_finite());
    }
}
