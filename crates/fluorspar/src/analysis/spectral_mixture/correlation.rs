//! How residuals of a fit go together from wavelength to wavelength.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// Shares of the variance that are tried.
const SHARES: [f64; 8] = [0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 1.0];
/// Lengths that are tried.
const LENGTHS: usize = 12;
/// The longest that is tried, relative to the range: slower errors can't be told from the level of the spectrum.
const LONGEST: f64 = 0.25;

/// Correlation of the residuals at two wavelengths: 1 at the same, `share exp(-distance / length)` else. What is left is noise of each
/// sample by itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ResidualCorrelation {
    /// Part of the variance that neighbors share, 0 to 1.
    pub share: f64,
    /// Distance over which that part falls to 1/e, nm; 0 where nothing is shared.
    pub length_nm: f64,
}

impl ResidualCorrelation {
    /// Independent residuals.
    pub const NONE: Self = Self { share: 0.0, length_nm: 0.0 };

    /// The correlation under which some data are most probable that are a sum of columns of any weights and residuals, by restricted
    /// maximum likelihood (Patterson and Thompson, Biometrika 58, 545, 1971): what the columns have taken out of the residuals does
    /// not count as independence.
    pub(super) fn estimate(wavelengths_nm: &[f64], columns: &[Vec<f64>], data: &[f64]) -> Self {
        let count = wavelengths_nm.len();
        let range = wavelengths_nm[count - 1] - wavelengths_nm[0];
        let step = range / (count - 1) as f64;
        let (shortest, longest) = (0.7 * step, (LONGEST * range).max(0.7 * step));
        let length = |i: usize| shortest * (longest / shortest).powf(i as f64 / (LENGTHS - 1) as f64);
        let tried = (0..LENGTHS).flat_map(|i| SHARES.map(|share| Self { share, length_nm: length(i) }));
        let mut best = (Self::NONE, Self::NONE.likelihood(wavelengths_nm, columns, data));
        for correlation in tried {
            let likelihood = correlation.likelihood(wavelengths_nm, columns, data);
            if likelihood > best.1 + 1e-9 {
                best = (correlation, likelihood);
            }
        }
        best.0
    }

    /// Logarithm of the restricted likelihood, up to a constant.
    fn likelihood(&self, wavelengths_nm: &[f64], columns: &[Vec<f64>], data: &[f64]) -> f64 {
        let (rows, count) = (data.len(), columns.len());
        let mut all: Vec<Vec<f64>> = columns.to_vec();
        all.push(data.to_vec());
        let log_determinant = self.whiten(wavelengths_nm, &mut all);
        let upper = DMatrix::from_fn(rows, count + 1, |i, j| all[j][i]).qr().r();
        let parts = upper.diagonal();
        let of_columns: f64 = parts.iter().take(count).map(|part| 2.0 * part.abs().ln()).sum();
        let left = 2.0 * parts[count].abs().ln();
        -0.5 * (log_determinant + of_columns + (rows - count) as f64 * left)
    }

    /// Turns columns into innovations of variance 1 by a Kalman filter, in as many steps as there are samples; the result is the
    /// logarithm of the determinant of the correlation.
    fn whiten(&self, wavelengths_nm: &[f64], columns: &mut [Vec<f64>]) -> f64 {
        let mut expected = vec![0.0; columns.len()];
        let (mut variance, mut log_determinant) = (self.share, 0.0);
        for i in 0..wavelengths_nm.len() {
            if i > 0 {
                let fade = self.fade(wavelengths_nm[i] - wavelengths_nm[i - 1]);
                variance = fade * fade * variance + self.share * (1.0 - fade * fade);
                expected.iter_mut().for_each(|value| *value *= fade);
            }
            let total = (variance + 1.0 - self.share).max(1e-12);
            let gain = variance / total;
            for (column, expected) in columns.iter_mut().zip(&mut expected) {
                let innovation = column[i] - *expected;
                *expected += gain * innovation;
                column[i] = innovation / total.sqrt();
            }
            variance *= 1.0 - gain;
            log_determinant += total.ln();
        }
        log_determinant
    }

    fn fade(&self, distance_nm: f64) -> f64 {
        if self.length_nm > 0.0 { (-distance_nm / self.length_nm).exp() } else { 0.0 }
    }

    /// The matrix of correlations times a vector.
    fn times(&self, wavelengths_nm: &[f64], vector: &[f64]) -> Vec<f64> {
        let count = vector.len();
        let fade = |i: usize| self.fade(wavelengths_nm[i] - wavelengths_nm[i - 1]);
        let mut product: Vec<f64> = vector.iter().map(|value| (1.0 - self.share) * value).collect();
        let mut carried = 0.0;
        for i in 0..count {
            carried = vector[i] + if i > 0 { fade(i) * carried } else { 0.0 };
            product[i] += self.share * carried;
        }
        carried = 0.0;
        for i in (0..count.saturating_sub(1)).rev() {
            carried = fade(i + 1) * (vector[i + 1] + carried);
            product[i] += self.share * carried;
        }
        product
    }

    /// Sum of the squares of all entries of the matrix of correlations.
    fn sum_of_squares(&self, wavelengths_nm: &[f64]) -> f64 {
        // Beside the diagonal they fall twice as fast.
        let beside = Self { share: 1.0, length_nm: 0.5 * self.length_nm };
        let ones = vec![1.0; wavelengths_nm.len()];
        let sum: f64 = beside.times(wavelengths_nm, &ones).iter().map(|value| value - 1.0).sum();
        wavelengths_nm.len() as f64 + self.share * self.share * sum
    }
}

/// What correlated residuals do to a fit by ordinary least squares.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spread {
    /// What the sum of squares is in the mean, over the variance of a residual.
    pub(super) expected_squares: f64,
    /// Independent residuals whose sum of squares would scatter as much (Satterthwaite, Biometrics Bulletin 2, 110, 1946).
    pub(super) freedom: f64,
    /// Of the weight of each column.
    pub(super) weights: Vec<WeightSpread>,
}

/// How well the weight of one column is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WeightSpread {
    /// Its variance over that under independent residuals, the design effect.
    pub(super) effect: f64,
    /// Its variance over that of a residual.
    pub(super) variance: f64,
}

impl Spread {
    /// Of a fit of some columns; `None` where these depend on each other.
    ///
    /// With `Q` an orthonormal base of the columns, `M = 1 - Q Qᵀ` and `R` the correlations, the squares have the mean `tr(M R)`
    /// and the variance `2 tr(M R M R)` of residuals of variance 1; weights have the covariance `B R Bᵀ` with `B = (AᵀA)⁻¹ Aᵀ`.
    pub(super) fn of(
        correlation: &ResidualCorrelation,
        wavelengths_nm: &[f64],
        columns: &[Vec<f64>],
    ) -> Option<Self> {
        let (rows, count) = (wavelengths_nm.len(), columns.len());
        let total = rows as f64;
        let squares = correlation.sum_of_squares(wavelengths_nm);
        if count == 0 {
            return Some(Self { expected_squares: total, freedom: total * total / squares, weights: vec![] });
        }
        let lengths: Vec<f64> = columns.iter().map(|c| DVector::from_column_slice(c).norm()).collect();
        let qr = DMatrix::from_fn(rows, count, |i, j| columns[j][i] / lengths[j]).qr();
        let (base, upper) = (qr.q(), qr.r());
        if !upper.diagonal().iter().all(|part| part.abs() > 1e-9) {
            return None;
        }
        let products: Vec<DVector<f64>> = (0..count)
            .map(|j| correlation.times(wavelengths_nm, base.column(j).into_owned().as_slice()).into())
            .collect();
        let products = DMatrix::from_columns(&products);
        let within = base.transpose() * &products;
        let expected_squares = total - within.trace();
        let scatter = squares - 2.0 * products.norm_squared() + within.norm_squared();
        let inverse = upper.solve_upper_triangular(&DMatrix::identity(count, count))?;
        let weight = |j: usize| {
            let row = inverse.row(j);
            let variance = (row * &within * row.transpose())[(0, 0)];
            WeightSpread {
                effect: variance / row.norm_squared(),
                variance: variance / (lengths[j] * lengths[j]),
            }
        };
        Some(Self {
            expected_squares,
            freedom: (expected_squares * expected_squares / scatter).max(1.0),
            weights: (0..count).map(weight).collect(),
        })
    }

    /// How many independent samples would fix the weights as well: the samples that are left beside the weights, over the mean
    /// design effect, and one for each weight.
    pub(super) fn effective_samples(&self, correlation: &ResidualCorrelation, wavelengths_nm: &[f64]) -> f64 {
        let count = self.weights.len() as f64;
        let effect = if self.weights.is_empty() {
            let ones = vec![1.0; wavelengths_nm.len()];
            correlation.times(wavelengths_nm, &ones).iter().sum::<f64>() / wavelengths_nm.len() as f64
        } else {
            self.weights.iter().map(|weight| weight.effect).sum::<f64>() / count
        };
        (count + self.expected_squares / effect).min(wavelengths_nm.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The recursions against the matrices that they stand for.
    #[test]
    fn recursions_are_the_matrices() {
        let nm: Vec<f64> = [500.0, 503.0, 504.5, 510.0, 518.0, 519.0, 530.0].to_vec();
        let correlation = ResidualCorrelation { share: 0.7, length_nm: 6.0 };
        let matrix =
            DMatrix::from_fn(
                7,
                7,
                |i, j| {
                    if i == j { 1.0 } else { 0.7 * (-(nm[i] - nm[j]).abs() / 6.0f64).exp() }
                },
            );
        let vector: Vec<f64> = (0..7).map(|i| (i as f64 * 1.7).sin()).collect();
        let product = &matrix * DVector::from_column_slice(&vector);
        for (a, b) in correlation.times(&nm, &vector).iter().zip(product.iter()) {
            assert!((a - b).abs() < 1e-13, "{a} {b}");
        }
        assert!((correlation.sum_of_squares(&nm) - matrix.norm_squared()).abs() < 1e-12);
        let mut whitened = [vector.clone()];
        let log_determinant = correlation.whiten(&nm, &mut whitened);
        let cholesky = matrix.cholesky().unwrap();
        assert!((log_determinant - cholesky.determinant().ln()).abs() < 1e-12);
        let quadratic = DVector::from_column_slice(&vector).dot(&cholesky.solve(&DVector::from_vec(vector)));
        let sum: f64 = whitened[0].iter().map(|v| v * v).sum();
        assert!((sum - quadratic).abs() < 1e-12, "{sum} {quadratic}");
    }

    #[test]
    fn independent_residuals_have_the_spread_of_the_textbook() {
        let nm: Vec<f64> = (0..20).map(|i| 500.0 + f64::from(i)).collect();
        let columns = [vec![1.0; 20], nm.iter().map(|nm| nm - 500.0).collect()];
        let spread = Spread::of(&ResidualCorrelation::NONE, &nm, &columns).unwrap();
        assert!((spread.expected_squares - 18.0).abs() < 1e-12 && (spread.freedom - 18.0).abs() < 1e-9);
        assert!(spread.weights.iter().all(|weight| (weight.effect - 1.0).abs() < 1e-12), "{spread:?}");
        assert!((spread.effective_samples(&ResidualCorrelation::NONE, &nm) - 20.0).abs() < 1e-9);
        assert_eq!(Spread::of(&ResidualCorrelation::NONE, &nm, &[vec![1.0; 20], vec![2.0; 20]]), None);
    }
}
