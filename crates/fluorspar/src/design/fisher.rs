//! Fisher information of a design, and the bound that it sets to every unbiased estimate.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::Serialize;

/// Smallest eigenvalue of the information, relative to the largest, that still counts as information; below it rounding of the
/// Schur complement can't be told from it.
const RANK_TOLERANCE: f64 = 1e-12;

/// Overlap with what can't be seen from which on a direction counts as unseen.
const BLIND_OVERLAP: f64 = 1e-6;

/// Fisher information of parameters of interest, in the units that derivatives are given in, with nuisances.
///
/// A datum of mean `y` and variance `v` adds `(dy/da)(dy/da)^T / v`, a prior of standard deviation `s` adds `1/s²`. What the
/// variance itself tells of the mean, `(dv/da)² / (2 v²)`, is below 1 % of the rest from 50 electrons on and is left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Information {
    matrix: DMatrix<f64>,
    interest: usize,
}

impl Information {
    /// No information yet on `interest` parameters, which come first, and on nuisances behind them.
    pub fn new(interest: usize, nuisances: usize) -> Self {
        let all = interest + nuisances;
        Self { matrix: DMatrix::zeros(all, all), interest }
    }

    /// Adds a datum: derivatives of its mean by all parameters, and its variance.
    pub fn observe(&mut self, derivatives: &[f64], variance: f64) {
        let weight = 1.0 / variance;
        for (j, &b) in derivatives.iter().enumerate() {
            if b != 0.0 {
                let scaled = weight * b;
                // Columns are contiguous; only the upper triangle is kept up
                for (element, &a) in self.matrix.column_mut(j).iter_mut().zip(&derivatives[..=j]) {
                    *element += a * scaled;
                }
            }
        }
    }

    /// Adds what is known of a parameter before: the standard deviation of a normal prior.
    pub fn know(&mut self, parameter: usize, standard_deviation: f64) {
        self.matrix[(parameter, parameter)] += 1.0 / (standard_deviation * standard_deviation);
    }

    /// Information on the parameters of interest that is left when the nuisances are not known: the Schur complement
    /// `I_aa - I_an I_nn^-1 I_na`. Nuisances that nothing depends on cost nothing.
    pub fn effective(&self) -> DMatrix<f64> {
        let (n, all) = (self.interest, self.matrix.nrows());
        let full = DMatrix::from_fn(all, all, |row, col| self.matrix[(row.min(col), row.max(col))]);
        let interest = full.view((0, 0), (n, n)).into_owned();
        let held: Vec<usize> = (n..all).filter(|&k| full[(k, k)] > 0.0).collect();
        if held.is_empty() {
            return interest;
        }
        // Scale nuisances to a unit diagonal, so that their units do not matter
        let scale: Vec<f64> = held.iter().map(|&k| full[(k, k)].sqrt().recip()).collect();
        let own =
            DMatrix::from_fn(held.len(), held.len(), |i, j| full[(held[i], held[j])] * scale[i] * scale[j]);
        let cross = DMatrix::from_fn(held.len(), n, |i, j| full[(held[i], j)] * scale[i]);
        let solved = match own.clone().cholesky() {
            Some(factor) => factor.solve(&cross),
            None => pseudo_solve(own, &cross),
        };
        let effective = interest - cross.transpose() * solved;
        0.5 * (&effective + effective.transpose())
    }

    /// The bound on every unbiased estimate of the parameters of interest.
    pub fn bound(&self) -> Bound {
        Bound::of(self.effective())
    }
}

/// Data of a design, with nuisances whose priors are known.
#[derive(Clone, Debug, PartialEq)]
pub struct UncertainData {
    interest: usize,
    /// Derivatives by the parameters of interest, row by row.
    derivatives: Vec<f64>,
    variances: Vec<f64>,
}

impl UncertainData {
    /// No data yet on so many parameters.
    pub fn new(interest: usize) -> Self {
        Self { interest, derivatives: Vec::new(), variances: Vec::new() }
    }

    /// Adds a datum: derivatives of its mean by the parameters, and its variance.
    pub fn observe(&mut self, derivatives: impl Iterator<Item = f64>, variance: f64) {
        self.derivatives.extend(derivatives.take(self.interest));
        self.variances.push(variance);
    }

    /// The bound with nuisances, of which each moves the data by a column at one standard deviation of its normal prior. With more
    /// nuisances than data they become a covariance of the data, `I_eff = A^T (V + U U^T)^-1 A`, otherwise parameters of an
    /// [`Information`], whose Schur complement is the same by Woodbury's identity.
    pub fn bound(&self, nuisances: &[Vec<f64>]) -> Bound {
        let count = self.variances.len();
        if nuisances.len() > count
            && let Some(bound) = self.bound_by_covariance(nuisances)
        {
            return bound;
        }
        let mut information = Information::new(self.interest, nuisances.len());
        (0..nuisances.len()).for_each(|k| information.know(self.interest + k, 1.0));
        let mut row = vec![0.0; self.interest + nuisances.len()];
        for (datum, &variance) in self.variances.iter().enumerate() {
            let start = datum * self.interest;
            row[..self.interest].copy_from_slice(&self.derivatives[start..start + self.interest]);
            row[self.interest..].iter_mut().zip(nuisances).for_each(|(slot, column)| *slot = column[datum]);
            information.observe(&row, variance);
        }
        information.bound()
    }

    fn bound_by_covariance(&self, nuisances: &[Vec<f64>]) -> Option<Bound> {
        let count = self.variances.len();
        // Scale data to unit variance
        let scale: Vec<f64> = self.variances.iter().map(|v| v.sqrt().recip()).collect();
        let mut covariance = DMatrix::<f64>::identity(count, count);
        let mut scaled = vec![0.0; count];
        for column in nuisances {
            scaled.iter_mut().zip(column.iter().zip(&scale)).for_each(|(slot, (u, s))| *slot = u * s);
            for (j, &b) in scaled.iter().enumerate() {
                if b != 0.0 {
                    covariance
                        .column_mut(j)
                        .iter_mut()
                        .zip(&scaled)
                        .for_each(|(element, a)| *element += a * b);
                }
            }
        }
        let derivatives =
            DMatrix::from_fn(count, self.interest, |d, k| self.derivatives[d * self.interest + k] * scale[d]);
        let factor = covariance.cholesky()?;
        let whitened = factor.l().solve_lower_triangular(&derivatives)?;
        Some(Bound::of(whitened.transpose() * whitened))
    }
}

/// `A^+ B` of a symmetric matrix that may be singular.
fn pseudo_solve(matrix: DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = SymmetricEigen::new(matrix);
    let largest = eigen.eigenvalues.max();
    let inverse = eigen.eigenvalues.map(|v| if v > RANK_TOLERANCE * largest { 1.0 / v } else { 0.0 });
    &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose() * right
}

/// Cramér-Rao bound of parameters, in the units of the derivatives: relative ones for relative derivatives.
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// Eigenvalues of the effective information, rising.
    eigenvalues: DVector<f64>,
    /// Their directions, by column.
    directions: DMatrix<f64>,
    /// How many of the first are nothing but rounding.
    unseen: usize,
}

/// Parameters that a design does not tell apart: a direction in which they can change while no datum does.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WeakDirection {
    /// Relative changes of the parameters, of unit length; the largest is positive.
    pub changes: Vec<f64>,
    /// Standard deviation along it; null where nothing bounds it.
    pub standard_deviation: Option<f64>,
}

impl Bound {
    fn of(information: DMatrix<f64>) -> Self {
        let count = information.nrows();
        let eigen = SymmetricEigen::new(information);
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let eigenvalues = DVector::from_iterator(count, order.iter().map(|&k| eigen.eigenvalues[k]));
        let directions = DMatrix::from_fn(count, count, |row, col| eigen.eigenvectors[(row, order[col])]);
        let largest = eigenvalues.iter().copied().fold(0.0, f64::max);
        let seen = |value: &&f64| **value > RANK_TOLERANCE * largest && **value > 0.0;
        let unseen = count - eigenvalues.iter().filter(seen).count();
        Self { eigenvalues, directions, unseen }
    }

    /// Number of independent combinations that the design sees.
    pub fn rank(&self) -> usize {
        self.eigenvalues.len() - self.unseen
    }

    /// Whether some combination of the parameters changes no datum: the Fisher matrix is singular.
    pub fn is_singular(&self) -> bool {
        self.unseen > 0
    }

    /// Variance of a linear combination of the parameters; infinite where it is not seen.
    pub fn variance_of(&self, combination: &[f64]) -> f64 {
        let length2: f64 = combination.iter().map(|c| c * c).sum();
        if length2 == 0.0 {
            return 0.0;
        }
        let mut variance = 0.0;
        for (k, &value) in self.eigenvalues.iter().enumerate() {
            let overlap: f64 = self.directions.column(k).iter().zip(combination).map(|(v, c)| v * c).sum();
            if k >= self.unseen {
                variance += overlap * overlap / value;
            } else if overlap * overlap > BLIND_OVERLAP * BLIND_OVERLAP * length2 {
                return f64::INFINITY;
            }
        }
        variance
    }

    /// Standard deviation of each parameter; infinite where it is not seen.
    pub fn standard_deviations(&self) -> Vec<f64> {
        let count = self.eigenvalues.len();
        let unit = |k: usize| (0..count).map(|j| f64::from(u8::from(j == k))).collect::<Vec<f64>>();
        (0..count).map(|k| self.variance_of(&unit(k)).sqrt()).collect()
    }

    /// Logarithm of the determinant of the information; minus infinity where it is singular.
    pub fn log_determinant(&self) -> f64 {
        if self.is_singular() { f64::NEG_INFINITY } else { self.eigenvalues.iter().map(|v| v.ln()).sum() }
    }

    /// Largest variance of any combination of unit length; infinite where one is not seen.
    pub fn largest_variance(&self) -> f64 {
        if self.is_singular() { f64::INFINITY } else { 1.0 / self.eigenvalues[0] }
    }

    /// The worst directions first: what the design tells apart least.
    pub fn weakest_directions(&self, count: usize) -> Vec<WeakDirection> {
        let direction = |k: usize| {
            let column: Vec<f64> = self.directions.column(k).iter().copied().collect();
            let largest = column.iter().copied().fold(0.0, |m: f64, v| if v.abs() > m.abs() { v } else { m });
            let sign = if largest < 0.0 { -1.0 } else { 1.0 };
            WeakDirection {
                changes: column.into_iter().map(|v| sign * v).collect(),
                standard_deviation: (k >= self.unseen).then(|| self.eigenvalues[k].recip().sqrt()),
            }
        };
        (0..count.min(self.eigenvalues.len())).map(direction).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(got: f64, expected: f64) {
        assert!((got - expected).abs() <= 1e-9 * expected.abs(), "{got}, expected {expected}");
    }

    /// Two colors, two dyes: the inverse of a two by two matrix by hand.
    #[test]
    fn two_dyes_in_two_channels() {
        let mut information = Information::new(2, 0);
        information.observe(&[10.0, 2.0], 12.0);
        information.observe(&[1.0, 8.0], 9.0);
        let (a, b, c) = (100.0 / 12.0 + 1.0 / 9.0, 20.0 / 12.0 + 8.0 / 9.0, 4.0 / 12.0 + 64.0 / 9.0);
        let determinant = a * c - b * b;
        let bound = information.bound();
        let [x, y] = bound.standard_deviations()[..] else { panic!() };
        near(x * x, c / determinant);
        near(y * y, a / determinant);
        near(bound.log_determinant(), determinant.ln());
        near(bound.variance_of(&[1.0, -1.0]), (c + a + 2.0 * b) / determinant);
        let half = 0.5 * (a + c) - (0.25 * (a - c) * (a - c) + b * b).sqrt();
        near(bound.largest_variance(), 1.0 / half);
    }

    /// A straight line through points: variance of slope with a free offset is `1 / sum (x - mean)²`, with a prior on the offset
    /// `1 / (sum x² - (sum x)² / (n + 1/s²))`.
    #[test]
    fn a_nuisance_costs_what_the_closed_form_says() {
        let x = [0.0, 1.0, 3.0, 4.0];
        let line = |prior: Option<f64>| {
            let mut information = Information::new(1, 1);
            x.iter().for_each(|&x| information.observe(&[x, 1.0], 1.0));
            prior.into_iter().for_each(|s| information.know(1, s));
            information.bound().variance_of(&[1.0])
        };
        near(line(None), 1.0 / 10.0);
        near(line(Some(0.5)), 1.0 / (26.0 - 64.0 / 8.0));
        near(line(Some(1e-9)), 1.0 / 26.0);
    }

    /// Three data can't tell five weights: rank 3, two blind directions, each in the null space of the derivatives.
    #[test]
    fn fewer_data_than_parameters_are_told_as_singular() {
        let rows = [[5.0, 1.0, 2.0, 3.0, 0.1], [2.0, 6.0, 2.5, 2.0, 0.3], [0.3, 1.0, 0.2, 0.4, 4.0]];
        let mut information = Information::new(5, 1);
        for row in rows {
            let with_gain: Vec<f64> = row.iter().copied().chain([row.iter().sum()]).collect();
            information.observe(&with_gain, 3.0);
        }
        information.know(5, 0.1);
        let bound = information.bound();
        assert!(bound.is_singular() && bound.rank() == 3, "{}", bound.rank());
        assert!(bound.standard_deviations().iter().all(|s| s.is_infinite()));
        assert_eq!(bound.log_determinant(), f64::NEG_INFINITY);
        for blind in bound.weakest_directions(2) {
            assert_eq!(blind.standard_deviation, None);
            for row in rows {
                let change: f64 = row.iter().zip(&blind.changes).map(|(r, c)| r * c).sum();
                assert!(change.abs() < 1e-7, "{change}");
            }
        }
        // What is seen stays bounded: a combination of the rows.
        assert!(bound.variance_of(&rows[2]).is_finite());
        assert!(bound.weakest_directions(3)[2].standard_deviation.is_some());
    }

    /// Nuisances with priors as parameters, and as a covariance of the data: the same by Woodbury's identity.
    #[test]
    fn many_nuisances_are_a_covariance_of_the_data() {
        let number = |k: usize| ((k * 37 + 11) % 97) as f64 / 97.0 - 0.3;
        let mut data = UncertainData::new(3);
        for datum in 0..5 {
            data.observe((0..3).map(|k| number(3 * datum + k)), 0.2 + number(datum + 50).abs());
        }
        let nuisances: Vec<Vec<f64>> =
            (0..9).map(|k| (0..5).map(|datum| 0.5 * number(7 * k + datum)).collect()).collect();
        let by_covariance = data.bound_by_covariance(&nuisances).unwrap();
        let mut information = Information::new(3, 9);
        (0..9).for_each(|k| information.know(3 + k, 1.0));
        for datum in 0..5 {
            let row: Vec<f64> = (0..3)
                .map(|k| data.derivatives[3 * datum + k])
                .chain(nuisances.iter().map(|column| column[datum]))
                .collect();
            information.observe(&row, data.variances[datum]);
        }
        let by_parameters = information.bound();
        let pairs = by_covariance.standard_deviations().into_iter().zip(by_parameters.standard_deviations());
        pairs.for_each(|(a, b)| near(a, b));
        assert_eq!(data.bound(&nuisances), by_covariance);
        near(data.bound(&nuisances[..4]).standard_deviations()[0], {
            data.bound_by_covariance(&nuisances[..4]).unwrap().standard_deviations()[0]
        });
    }

    #[test]
    fn nuisances_without_effect_cost_nothing_and_doubled_ones_no_more_than_one() {
        let with = |copies: usize, idle: usize| {
            let mut information = Information::new(1, copies + idle);
            for (x, g) in [(1.0, 1.0), (2.0, 0.5), (3.0, 2.0)] {
                let row: Vec<f64> = [x].into_iter().chain(vec![g; copies]).chain(vec![0.0; idle]).collect();
                information.observe(&row, 1.0);
            }
            information.bound().variance_of(&[1.0])
        };
        near(with(0, 3), with(0, 0));
        near(with(2, 1), with(1, 0));
        assert!(with(1, 0) > with(0, 0));
    }
}
