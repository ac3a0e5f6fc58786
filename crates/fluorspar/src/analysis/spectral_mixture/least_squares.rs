//! Least squares with weights that can't be negative.

use nalgebra::{DMatrix, DVector};

/// A column that others make up but for this part of its length depends on them.
const DEPENDENT: f64 = 1e-9;
/// Steps of a search by halves: a 3e-14th of its range is left.
const HALVINGS: usize = 45;
/// Doublings until a weight is too large at last.
const DOUBLINGS: usize = 200;

/// Data, and the columns whose sum is to be nearest to them.
///
/// Rows are turned so that one more than there are columns are left, which keeps every distance; columns have length 1, since
/// columns of very different size would lose digits.
pub(super) struct LeastSquares {
    matrix: DMatrix<f64>,
    /// What the columns were multiplied with.
    scales: Vec<f64>,
    target: DVector<f64>,
}

/// The nearest sum of some columns.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Nearest {
    /// Weights of these columns.
    pub(super) weights: Vec<f64>,
    /// Whether each is above zero, not held there.
    pub(super) is_free: Vec<bool>,
    /// Sum of the squares that are left.
    pub(super) squares: f64,
}

impl LeastSquares {
    pub(super) fn new(columns: &[Vec<f64>], data: &[f64]) -> Self {
        let count = columns.len();
        let scale = |column: &Vec<f64>| {
            let length = column.iter().map(|v| v * v).sum::<f64>().sqrt();
            if length > 0.0 { 1.0 / length } else { 0.0 }
        };
        let scales: Vec<f64> = columns.iter().map(scale).collect();
        let cell = |i: usize, j: usize| if j < count { columns[j][i] * scales[j] } else { data[i] };
        let mut all = DMatrix::from_fn(data.len(), count + 1, cell);
        if data.len() > count + 1 {
            all = all.qr().r();
        }
        let target = all.column(count).into_owned();
        Self { matrix: all.remove_column(count), scales, target }
    }

    /// The nearest sum of some of the columns.
    pub(super) fn nearest(&self, columns: &[usize]) -> Nearest {
        let matrix = self.matrix.select_columns(columns);
        let (free, weights) = active_set(&matrix, &self.target);
        Nearest {
            squares: (&self.target - &matrix * &weights).norm_squared(),
            weights: columns.iter().zip(weights.iter()).map(|(&j, w)| self.scales[j] * w.max(0.0)).collect(),
            is_free: (0..columns.len()).map(|place| free.contains(&place)).collect(),
        }
    }

    /// The nearest sum of all columns.
    pub(super) fn nearest_of_all(&self) -> Nearest {
        self.nearest(&(0..self.scales.len()).collect::<Vec<_>>())
    }

    /// Squares that are left where the weight of one column is given and all others are free.
    fn squares_with(&self, column: usize, weight: f64) -> f64 {
        let others: Vec<usize> = (0..self.scales.len()).filter(|&other| other != column).collect();
        let matrix = self.matrix.select_columns(&others);
        let target = &self.target - self.matrix.column(column) * (weight / self.scales[column]);
        let (_, weights) = active_set(&matrix, &target);
        (target - matrix * weights).norm_squared()
    }

    /// Least and largest weight of one column with which no more than `limit` is left, whatever the others are; `None` where more is
    /// left of the nearest sum.
    pub(super) fn range(&self, column: usize, limit: f64) -> Option<[f64; 2]> {
        let best = self.nearest_of_all();
        if best.squares > limit {
            return None;
        }
        let weight = best.weights[column];
        let fits = |weight: f64| self.squares_with(column, weight) <= limit;
        let low = if fits(0.0) { 0.0 } else { border(weight, 0.0, &fits) };
        let mut step = ((limit - best.squares).sqrt() * self.scales[column]).max(1e-12 * weight);
        for _ in 0..DOUBLINGS {
            if !fits(weight + step) {
                return Some([low, border(weight, weight + step, &fits)]);
            }
            step *= 2.0;
        }
        Some([low, f64::INFINITY])
    }
}

/// The end, between a number that holds and one that does not, of what holds.
pub(super) fn border(mut inside: f64, mut outside: f64, holds: &dyn Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (inside + outside);
        if holds(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    inside
}

/// Least squares with some columns alone; the other weights are zero. `None` where they depend on each other.
fn unbounded(matrix: &DMatrix<f64>, target: &DVector<f64>, columns: &[usize]) -> Option<DVector<f64>> {
    let mut solution = DVector::zeros(matrix.ncols());
    if columns.is_empty() {
        return Some(solution);
    }
    let qr = matrix.select_columns(columns).qr();
    let upper = qr.r();
    if upper.diagonal().iter().any(|part| part.abs() < DEPENDENT) {
        return None;
    }
    let weights = upper.solve_upper_triangular(&(qr.q().transpose() * target))?;
    for (&column, weight) in columns.iter().zip(weights.iter()) {
        solution[column] = *weight;
    }
    Some(solution)
}

/// Free columns, rising, and the weights, by the active-set method of Lawson and Hanson (Solving Least Squares Problems, 1974,
/// chapter 23).
fn active_set(matrix: &DMatrix<f64>, target: &DVector<f64>) -> (Vec<usize>, DVector<f64>) {
    let columns = matrix.ncols();
    let mut free: Vec<usize> = Vec::new();
    // Columns that the free ones make up.
    let mut dependent: Vec<usize> = Vec::new();
    let mut weights = DVector::zeros(columns);
    // Below this a gradient is rounding: columns have length 1.
    let least = 1e-12 * target.norm();
    for _ in 0..3 * columns + 1 {
        // Free the column along which the error falls fastest
        let gradient = matrix.transpose() * (target - matrix * &weights);
        let candidate = (0..columns)
            .filter(|j| !free.contains(j) && !dependent.contains(j) && gradient[*j] > least)
            .max_by(|a, b| gradient[*a].total_cmp(&gradient[*b]));
        let Some(candidate) = candidate else { break };
        let mut wider = free.clone();
        wider.push(candidate);
        wider.sort_unstable();
        match step_inside(matrix, target, &mut wider, weights.clone()) {
            Some(next) => (free, weights) = (wider, next),
            None => dependent.push(candidate),
        }
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
        let wanted = unbounded(matrix, target, free)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    fn bands(samples: usize) -> Vec<Vec<f64>> {
        let band = |center: f64| {
            (0..samples).map(|i| (-((i as f64 - center) / 12.0).powi(2)).exp()).collect::<Vec<f64>>()
        };
        vec![band(20.0), band(38.0), band(70.0)]
    }

    fn sum(columns: &[Vec<f64>], weights: &[f64]) -> Vec<f64> {
        (0..columns[0].len()).map(|i| columns.iter().zip(weights).map(|(c, w)| w * c[i]).sum()).collect()
    }

    #[test]
    fn exact_mixtures_come_back() {
        let columns = bands(100);
        for weights in [[2.0, 0.0, 1e-3], [0.0, 0.0, 0.0], [1.0, 3.0, 2e4]] {
            let found = LeastSquares::new(&columns, &sum(&columns, &weights)).nearest_of_all();
            for (found, weight) in found.weights.iter().zip(weights) {
                // Double precision, and a condition of the bands below 10.
                assert!((found - weight).abs() <= 1e-12 * weights.iter().sum::<f64>(), "{found} {weight}");
            }
        }
    }

    /// The conditions of Karush, Kuhn and Tucker decide whether a point is the minimum.
    #[test]
    fn a_negative_component_is_held_at_zero_and_the_rest_is_the_best_without_it() {
        let columns = bands(100);
        let data = sum(&columns, &[1.0, -0.5, 0.7]);
        let found = LeastSquares::new(&columns, &data).nearest_of_all();
        assert_eq!(found.is_free, [true, false, true]);
        let residual: Vec<f64> =
            data.iter().zip(sum(&columns, &found.weights)).map(|(data, fit)| data - fit).collect();
        for (column, is_free) in columns.iter().zip(found.is_free) {
            let gradient: f64 = column.iter().zip(&residual).map(|(t, r)| t * r).sum();
            assert!(if is_free { gradient.abs() < 1e-10 } else { gradient < 0.0 }, "{gradient}");
        }
        let squares: f64 = residual.iter().map(|r| r * r).sum();
        assert!((found.squares - squares).abs() < 1e-12 * squares, "turned rows keep every distance");
    }

    #[test]
    fn columns_that_others_make_up_share_their_weight() {
        let mut columns = bands(100);
        columns.push(columns[0].clone());
        let problem = LeastSquares::new(&columns, &sum(&bands(100), &[2.0, 0.0, 1.0]));
        let found = problem.nearest_of_all();
        assert!((found.weights[0] + found.weights[3] - 2.0).abs() < 1e-9, "{found:?}");
        // Either may be anything between nothing and all of it.
        for twin in [0, 3] {
            let [low, high] = problem.range(twin, 1e-12).unwrap();
            assert!(low == 0.0 && (high - 2.0).abs() < 1e-5, "{low} {high}");
        }
    }
}
