//! How well the pixels of two spots are told apart.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};

use crate::sampling::Z_95;

/// Fewest cases of a group per number of a case, below which a covariance means little.
const LEAST_CASES_PER_NUMBER: usize = 4;

/// Separation from which on what is left between equal cases is rounding.
const LARGEST: f64 = 1e6;

/// What of the pixels of two spots is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpotScale {
    /// Logarithms of the values: a slope of the light or of the surface changes all channels by one factor.
    #[default]
    Logarithms,
    /// The values themselves, where some pixel of a spot is so dark that its logarithm is noise.
    Values,
}

impl SpotScale {
    /// What is compared, in words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Logarithms => "the logarithms of the channels",
            Self::Values => "the values of the channels, as a spot is dark",
        }
    }
}

/// How well some channels of some frames tell the pixels of two spots apart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpotSeparation {
    /// Frames whose pixels are compared.
    pub frames: Vec<String>,
    /// Channels of each.
    pub channels: Vec<String>,
    /// What of the pixels is compared.
    #[serde(default)]
    pub scale: SpotScale,
    /// Distance of the means in standard deviations of a pixel, channels together (Mahalanobis distance).
    pub d_prime: f64,
    /// Its 95 % interval, by the jackknife over pixels.
    pub d_prime_interval: [f64; 2],
    /// Share of single pixels that an ideal observer assigns to the right spot: `Phi(d' / 2)`.
    pub right: f64,
}

impl SpotSeparation {
    /// Compares cases of two groups, each a list of numbers of equal length. `None` for too few cases, and where some numbers
    /// do not vary.
    #[must_use]
    pub fn new(
        frames: Vec<String>,
        channels: Vec<String>,
        scale: SpotScale,
        groups: &[Vec<Vec<f64>>; 2],
    ) -> Option<Self> {
        let numbers = groups[0].first()?.len();
        let enough = LEAST_CASES_PER_NUMBER * numbers.max(1);
        if groups.iter().any(|cases| cases.len() < enough || cases.iter().any(|c| c.len() != numbers)) {
            return None;
        }
        let d_prime = d_prime(groups, None).filter(|d| *d < LARGEST)?;
        let reach = Z_95 * jackknife_error(groups)?;
        Some(Self {
            frames,
            channels,
            scale,
            d_prime,
            d_prime_interval: [(d_prime - reach).max(0.0), d_prime + reach],
            right: Normal::standard().cdf(0.5 * d_prime),
        })
    }
}

/// Distance of the means of two groups in standard deviations of their pooled covariance, one case left out or none.
fn d_prime(groups: &[Vec<Vec<f64>>; 2], without: Option<(usize, usize)>) -> Option<f64> {
    let n = groups[0].first()?.len();
    let mut means = [DVector::zeros(n), DVector::zeros(n)];
    let mut covariance = DMatrix::zeros(n, n);
    let mut freedom = 0.0;
    for (group, cases) in groups.iter().enumerate() {
        let kept =
            || cases.iter().enumerate().filter(move |(i, _)| without != Some((group, *i))).map(|(_, c)| c);
        let count = kept().count() as f64;
        freedom += count - 1.0;
        kept().for_each(|case| means[group] += DVector::from_column_slice(case) / count);
        for case in kept() {
            let offset = DVector::from_column_slice(case) - &means[group];
            covariance += &offset * offset.transpose();
        }
    }
    let difference = &means[0] - &means[1];
    let factor = (covariance / freedom).cholesky()?;
    Some(difference.dot(&factor.solve(&difference)).max(0.0).sqrt())
}

/// Standard error of [`d_prime`] by leaving out every case once (Efron, The Jackknife, 1982).
fn jackknife_error(groups: &[Vec<Vec<f64>>; 2]) -> Option<f64> {
    let mut squares = 0.0;
    for (group, cases) in groups.iter().enumerate() {
        let left =
            (0..cases.len()).map(|i| d_prime(groups, Some((group, i)))).collect::<Option<Vec<f64>>>()?;
        let count = left.len() as f64;
        let mean = left.iter().sum::<f64>() / count;
        squares += (count - 1.0) / count * left.iter().map(|d| (d - mean).powi(2)).sum::<f64>();
    }
    Some(squares.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::random::Key;
    use rand::RngExt;
    use rand_distr::StandardNormal;

    /// Two groups of correlated numbers whose means lie apart by `shift` in the first: noise 1 in the first, the second shares 0.8 of it.
    fn groups(cases: usize, shift: f64) -> [Vec<Vec<f64>>; 2] {
        let mut rng = Key::new(3).rng();
        [0.0, shift].map(|shift| {
            let case = |_| {
                let [a, b]: [f64; 2] = [rng.sample(StandardNormal), rng.sample(StandardNormal)];
                vec![shift + a, 0.8 * a + 0.6 * b]
            };
            (0..cases).map(case).collect()
        })
    }

    fn separation(groups: &[Vec<Vec<f64>>; 2]) -> Option<SpotSeparation> {
        SpotSeparation::new(vec!["blue".into()], vec!["R".into(), "G".into()], SpotScale::Logarithms, groups)
    }

    /// The covariance [[1, 0.8], [0.8, 1]] has the inverse element 1 / 0.36: d' = shift / 0.6.
    #[test]
    fn channels_that_share_noise_separate_better_together() {
        let found = separation(&groups(400, 1.2)).unwrap();
        let [low, high] = found.d_prime_interval;
        assert!(low < 2.0 && 2.0 < high && high - low < 0.8, "{found:?}");
        assert!((found.right - 0.841).abs() < 0.03, "{found:?}");
    }

    #[test]
    fn nothing_that_differs_and_nothing_that_varies_are_told() {
        assert!(separation(&groups(400, 0.0)).unwrap().d_prime < 0.25);
        assert_eq!(separation(&groups(5, 1.0)), None);
        assert_eq!(separation(&[vec![vec![1.0, 2.0]; 20], vec![vec![2.0, 1.0]; 20]]), None);
        assert_eq!(separation(&[Vec::new(), Vec::new()]), None);
    }
}
