//! Spectra as sums of known spectra with weights that can't be negative, and how well the data fix each weight.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use thiserror::Error;

/// Two-sided 95 % quantile of the standard normal distribution.
const Z_95: f64 = 1.959_963_984_540_054;

/// Spectra that can't be fitted.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum FitError {
    /// More unknowns than knowns.
    #[error("{samples} samples can't fix {terms} weights; give more samples than terms")]
    FewSamples {
        /// Samples of the data.
        samples: usize,
        /// Terms of the sum.
        terms: usize,
    },
    /// A term on another grid than the data.
    #[error(
        "term {term} has {found} samples and the data {wanted}; sample all spectra at the same wavelengths"
    )]
    Length {
        /// Number of the term, from 0.
        term: usize,
        /// Its samples.
        found: usize,
        /// Samples of the data.
        wanted: usize,
    },
    /// A value that is no number.
    #[error("a spectrum holds values that are not finite; leave such wavelengths out")]
    NotFinite,
}

/// Weight of one term of a sum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FittedTerm {
    /// Its weight, 0 or more, in the unit of data over term.
    pub weight: f64,
    /// Its standard error from the scatter of the residuals; of a term at zero, that it would have if it were free.
    pub standard_error: f64,
    /// Interval that holds 95 % where the residuals are independent noise; its lower end is never below 0.
    pub interval: [f64; 2],
    /// Whether the weight is free (above zero) or held at zero.
    pub is_free: bool,
}

/// A sum of terms with non-negative weights that is nearest to some data by least squares.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NonnegativeFit {
    /// Weight of each term.
    pub terms: Vec<FittedTerm>,
    /// The sum, at each sample.
    pub fitted: Vec<f64>,
    /// Data less sum, at each sample.
    pub residual: Vec<f64>,
    /// Root mean square of the residuals.
    pub rms: f64,
}

/// Fits `data[i] = sum_j w_j terms[j][i]` with `w_j >= 0` by the active-set method of Lawson and Hanson (Solving Least
/// Squares Problems, 1974, chapter 23).
///
/// Standard errors are those of ordinary least squares on the free terms, `s² (AᵀA)⁻¹` with `s² = RSS / (n - free)`. They hold
/// noise only: where the residuals show structure, the terms are not the right ones, and the intervals are too narrow.
///
/// # Errors
/// Fewer samples than terms, terms of another length than the data, values that are not finite.
pub fn fit_nonnegative(terms: &[Vec<f64>], data: &[f64]) -> Result<NonnegativeFit, FitError> {
    let solved = Solved::new(terms, data)?;
    let residual = solved.residual();
    Ok(NonnegativeFit {
        terms: (0..terms.len()).map(|term| solved.fitted_term(term)).collect(),
        fitted: (&solved.target - &residual).iter().copied().collect(),
        rms: solved.rms(),
        residual: residual.iter().copied().collect(),
    })
}

/// The weights that were found, before anything is said about them.
struct Solved {
    /// One column for each term, of length 1: terms of very different size would lose digits.
    matrix: DMatrix<f64>,
    /// What the columns were multiplied with.
    scales: Vec<f64>,
    target: DVector<f64>,
    /// Columns whose weight is not held at zero, rising.
    free: Vec<usize>,
    /// Weights of the columns.
    weights: DVector<f64>,
}

impl Solved {
    fn new(terms: &[Vec<f64>], data: &[f64]) -> Result<Self, FitError> {
        check(terms, data)?;
        let scale = |term: &Vec<f64>| if length(term) > 0.0 { 1.0 / length(term) } else { 0.0 };
        let scales: Vec<f64> = terms.iter().map(scale).collect();
        let matrix = DMatrix::from_fn(data.len(), terms.len(), |i, j| terms[j][i] * scales[j]);
        let target = DVector::from_column_slice(data);
        let (free, weights) = active_set(&matrix, &target);
        Ok(Self { matrix, scales, target, free, weights })
    }

    fn residual(&self) -> DVector<f64> {
        &self.target - &self.matrix * &self.weights
    }

    fn rms(&self) -> f64 {
        (self.residual().norm_squared() / self.target.len() as f64).sqrt()
    }

    /// A weight with what the data say about it. One that is held at zero is freed for its error and its upper limit.
    fn fitted_term(&self, term: usize) -> FittedTerm {
        let is_free = self.free.contains(&term);
        let mut columns = self.free.clone();
        if !is_free {
            columns.push(term);
            columns.sort_unstable();
        }
        let solution = solve(&self.matrix, &self.target, &columns);
        let known = solution.and_then(|solution| {
            standard_error(&self.matrix, &self.target, &columns, &solution, term).map(|e| (solution[term], e))
        });
        // A term that the others make up is not fixed by the data at all.
        let (center, error) = known.unwrap_or((0.0, f64::INFINITY));
        let scale = self.scales[term];
        let end = |sign: f64| (scale * (center + sign * Z_95 * error)).max(0.0);
        FittedTerm {
            weight: scale * self.weights[term].max(0.0),
            standard_error: scale * error,
            interval: [end(-1.0), end(1.0)],
            is_free,
        }
    }
}

fn length(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn check(terms: &[Vec<f64>], data: &[f64]) -> Result<(), FitError> {
    if let Some(term) = terms.iter().position(|term| term.len() != data.len()) {
        return Err(FitError::Length { term, found: terms[term].len(), wanted: data.len() });
    }
    if data.len() <= terms.len() {
        return Err(FitError::FewSamples { samples: data.len(), terms: terms.len() });
    }
    let finite = terms.iter().flatten().chain(data).all(|value| value.is_finite());
    if finite { Ok(()) } else { Err(FitError::NotFinite) }
}

/// Least squares with the named columns alone; the other weights are zero. `None` where they depend on each other.
fn solve(matrix: &DMatrix<f64>, target: &DVector<f64>, columns: &[usize]) -> Option<DVector<f64>> {
    let mut solution = DVector::zeros(matrix.ncols());
    if columns.is_empty() {
        return Some(solution);
    }
    let part = matrix.select_columns(columns);
    let qr = part.qr();
    let weights = qr.r().solve_upper_triangular(&(qr.q().transpose() * target))?;
    for (&column, weight) in columns.iter().zip(weights.iter()) {
        solution[column] = *weight;
    }
    solution.iter().all(|weight| weight.is_finite()).then_some(solution)
}

/// Free columns, rising, and the weights.
fn active_set(matrix: &DMatrix<f64>, target: &DVector<f64>) -> (Vec<usize>, DVector<f64>) {
    let columns = matrix.ncols();
    let mut free: Vec<usize> = Vec::new();
    let mut weights = DVector::zeros(columns);
    // Below this a gradient is rounding: columns have length 1.
    let least = 1e-12 * target.norm();
    for _ in 0..3 * columns + 1 {
        // Free the column along which the error falls fastest
        let gradient = matrix.transpose() * (target - matrix * &weights);
        let candidate = (0..columns)
            .filter(|j| !free.contains(j) && gradient[*j] > least)
            .max_by(|a, b| gradient[*a].total_cmp(&gradient[*b]));
        let Some(candidate) = candidate else { break };
        free.push(candidate);
        free.sort_unstable();
        weights = match step_inside(matrix, target, &mut free, weights.clone()) {
            Some(next) => next,
            // The candidate adds nothing to the others.
            None => {
                free.retain(|&j| j != candidate);
                break;
            }
        };
    }
    (free, weights)
}

/// Moves from feasible weights to the least-squares solution of the free columns; those that reach zero on the way are held.
fn step_inside(
    matrix: &DMatrix<f64>,
    target: &DVector<f64>,
    free: &mut Vec<usize>,
    mut weights: DVector<f64>,
) -> Option<DVector<f64>> {
    loop {
        let wanted = solve(matrix, target, free)?;
        let blocked = free.iter().copied().filter(|&j| wanted[j] <= 0.0);
        let share = blocked.map(|j| weights[j] / (weights[j] - wanted[j])).reduce(f64::min);
        let Some(share) = share.filter(|share| share.is_finite()) else {
            return Some(wanted);
        };
        weights += share * (wanted - &weights);
        free.retain(|&j| weights[j] > 1e-15);
        (0..weights.len()).filter(|j| !free.contains(j)).for_each(|j| weights[j] = 0.0);
    }
}

fn standard_error(
    matrix: &DMatrix<f64>,
    target: &DVector<f64>,
    columns: &[usize],
    solution: &DVector<f64>,
    term: usize,
) -> Option<f64> {
    let residual = target - matrix * solution;
    let freedom = (target.len() - columns.len()) as f64;
    let part = matrix.select_columns(columns);
    let inverse = (part.transpose() * &part).try_inverse()?;
    let place = columns.iter().position(|&column| column == term)?;
    Some((residual.norm_squared() / freedom * inverse[(place, place)]).max(0.0).sqrt())
}

/// A sum one of whose terms lies below an absorber of unknown strength.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AttenuatedFit {
    /// Optical density where the extinction is 1.
    pub optical_density: f64,
    /// The weights and residuals at that density; the weight of the covered term is that before attenuation.
    pub fit: NonnegativeFit,
}

/// Fits `w_0 terms[0] 10^(-D extinction) + sum_j w_j terms[j]` with weights that are not negative and `D` between 0 and
/// `largest`: the one-layer term of blood with which Farrell, Mou and Wandell describe tongues and lips.
///
/// # Errors
/// As [`fit_nonnegative`].
pub fn fit_attenuated(
    terms: &[Vec<f64>],
    extinction: &[f64],
    data: &[f64],
    largest: f64,
) -> Result<AttenuatedFit, FitError> {
    let optical_density = common_optical_density(terms, extinction, &[data.to_vec()], largest)?;
    let fit = fit_nonnegative(&covered(terms, extinction, optical_density), data)?;
    Ok(AttenuatedFit { optical_density, fit })
}

/// The optical density `D` with which [`fit_attenuated`] describes several spectra best that have it in common, each with weights of
/// its own: the least sum of all squares.
///
/// The density is searched on a grid of 0.25 and refined by golden section to 1e-6 of `largest`.
///
/// # Errors
/// As [`fit_nonnegative`].
pub fn common_optical_density(
    terms: &[Vec<f64>],
    extinction: &[f64],
    spectra: &[Vec<f64>],
    largest: f64,
) -> Result<f64, FitError> {
    let squares = |density: f64| -> Result<f64, FitError> {
        let terms = covered(terms, extinction, density);
        let of = |data: &Vec<f64>| Solved::new(&terms, data).map(|solved| solved.residual().norm_squared());
        spectra.iter().map(of).sum()
    };
    let steps = (largest / 0.25).ceil().max(2.0) as usize;
    let density = |step: usize| largest * step as f64 / steps as f64;
    let mut best = (0, f64::INFINITY);
    for step in 0..=steps {
        let found = squares(density(step))?;
        if found < best.1 {
            best = (step, found);
        }
    }
    // Golden section between the neighbors of the best node
    let (mut low, mut high) = (density(best.0.saturating_sub(1)), density((best.0 + 1).min(steps)));
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    while high - low > 1e-6 * largest {
        let (left, right) = (high - ratio * (high - low), low + ratio * (high - low));
        if squares(left)? <= squares(right)? {
            high = right;
        } else {
            low = left;
        }
    }
    Ok(0.5 * (low + high))
}

/// Terms of which the first lies below an absorber.
fn covered(terms: &[Vec<f64>], extinction: &[f64], density: f64) -> Vec<Vec<f64>> {
    let mut terms = terms.to_vec();
    if let Some(covered) = terms.first_mut() {
        covered.iter_mut().zip(extinction).for_each(|(v, e)| *v *= 10f64.powf(-density * e));
    }
    terms
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bands(samples: usize) -> Vec<Vec<f64>> {
        let band = |center: f64| {
            (0..samples).map(|i| (-((i as f64 - center) / 12.0).powi(2)).exp()).collect::<Vec<f64>>()
        };
        vec![band(20.0), band(38.0), band(70.0)]
    }

    fn sum(terms: &[Vec<f64>], weights: &[f64]) -> Vec<f64> {
        (0..terms[0].len()).map(|i| terms.iter().zip(weights).map(|(t, w)| w * t[i]).sum()).collect()
    }

    #[test]
    fn exact_mixtures_come_back() {
        let terms = bands(100);
        for weights in [[2.0, 0.0, 1e-3], [0.0, 0.0, 0.0], [1.0, 3.0, 2e4]] {
            let fit = fit_nonnegative(&terms, &sum(&terms, &weights)).unwrap();
            for (term, weight) in fit.terms.iter().zip(weights) {
                // Double precision, and a condition of the bands below 10.
                assert!((term.weight - weight).abs() <= 1e-12 * weights.iter().sum::<f64>(), "{fit:?}");
            }
        }
    }

    /// The conditions of Karush, Kuhn and Tucker decide whether a point is the minimum.
    #[test]
    fn a_negative_component_is_held_at_zero_and_the_rest_is_the_best_without_it() {
        let terms = bands(100);
        let data = sum(&terms, &[1.0, -0.5, 0.7]);
        let fit = fit_nonnegative(&terms, &data).unwrap();
        assert_eq!(fit.terms.iter().map(|t| t.is_free).collect::<Vec<_>>(), [true, false, true]);
        for (term, spectrum) in fit.terms.iter().zip(&terms) {
            let gradient: f64 = spectrum.iter().zip(&fit.residual).map(|(t, r)| t * r).sum();
            assert!(if term.is_free { gradient.abs() < 1e-10 } else { gradient < 0.0 }, "{gradient}");
        }
        assert_eq!(fit.terms[1].interval, [0.0, 0.0]);
    }

    #[test]
    fn intervals_hold_the_truth_as_often_as_they_say() {
        let terms = bands(60);
        let weights = [1.0, 0.4, 0.3];
        let clean = sum(&terms, &weights);
        let mut state = 1u64;
        // Sums of twelve evenly distributed numbers are normal enough.
        let mut even = move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut normal = move || (0..12).map(|_| even()).sum::<f64>() - 6.0;
        let (mut held, runs) = (0, 2000);
        for _ in 0..runs {
            let data: Vec<f64> = clean.iter().map(|v| v + 0.05 * normal()).collect();
            let fit = fit_nonnegative(&terms, &data).unwrap();
            let within = |(t, w): (&FittedTerm, &f64)| (t.interval[0]..=t.interval[1]).contains(w);
            held += fit.terms.iter().zip(&weights).filter(|pair| within(*pair)).count();
        }
        let share = held as f64 / (3 * runs) as f64;
        // Standard error of the share 0.003; with 57 degrees of freedom 1.96 holds 94.5 % instead of 95 %.
        assert!((share - 0.945).abs() < 0.012, "{share}");
    }

    #[test]
    fn an_absorber_in_front_of_one_term_is_found() {
        let terms = bands(100);
        let extinction: Vec<f64> = (0..100).map(|i| (-((i as f64 - 25.0) / 6.0).powi(2)).exp()).collect();
        let mut covered = terms.clone();
        covered[0].iter_mut().zip(&extinction).for_each(|(v, e)| *v *= 10f64.powf(-1.7 * e));
        let found = fit_attenuated(&terms, &extinction, &sum(&covered, &[2.0, 0.1, 0.5]), 40.0).unwrap();
        assert!((found.optical_density - 1.7).abs() < 1e-4, "{}", found.optical_density);
        assert!((found.fit.terms[0].weight - 2.0).abs() < 1e-3);
        // Spectra of other weights, and one that does not show the covered term, have the density in common.
        let spectra: Vec<Vec<f64>> =
            [[2.0, 0.1, 0.5], [0.3, 2.0, 0.0], [0.0, 1.0, 1.0]].iter().map(|w| sum(&covered, w)).collect();
        let common = common_optical_density(&terms, &extinction, &spectra, 40.0).unwrap();
        assert!((common - 1.7).abs() < 1e-4, "{common}");
    }

    #[test]
    fn what_cannot_be_fitted_is_told() {
        let says = |terms: &[Vec<f64>], data: &[f64]| fit_nonnegative(terms, data).unwrap_err().to_string();
        assert!(says(&[vec![1.0; 2], vec![2.0; 2]], &[1.0; 2]).contains("2 samples can't fix 2 weights"));
        assert!(says(&[vec![1.0; 3]], &[1.0; 2]).contains("term 0 has 3 samples and the data 2"));
        assert!(says(&[vec![f64::NAN; 2]], &[1.0; 2]).contains("not finite"));
    }
}
