//! Least squares by the method of Levenberg and Marquardt.

use nalgebra::DMatrix;

use super::{Derivatives, TissueFitError, Unknowns};

/// Residuals at some unknowns, in standard deviations, and their derivatives.
pub(super) struct Linearized {
    pub(super) residuals: Unknowns,
    pub(super) derivatives: Derivatives,
}

/// Where the sum of squares is least.
pub(super) struct Minimum {
    pub(super) unknowns: Unknowns,
    pub(super) linearized: Linearized,
    /// Inverse of half the curvature of the sum of squares.
    pub(super) covariance: DMatrix<f64>,
    pub(super) steps: usize,
    pub(super) converged: bool,
}

/// Largest step, in the unit of the unknowns: linear models do not reach farther.
const LONGEST_STEP: f64 = 1.5;
/// A step below this is no change: a thousandth of a standard deviation.
const SHORTEST_STEP: f64 = 1e-3;

/// Searches from a start.
pub(super) fn minimize(
    start: Unknowns,
    linearize: impl Fn(&Unknowns) -> Result<Linearized, TissueFitError>,
    most_steps: usize,
) -> Result<Minimum, TissueFitError> {
    let mut unknowns = start;
    let mut here = linearize(&unknowns)?;
    let mut damping = 1e-2;
    let mut converged = false;
    let mut steps = 0;
    while steps < most_steps && !converged {
        steps += 1;
        let step = damped_step(&here, damping)?;
        let next = &unknowns + &step;
        let there = linearize(&next)?;
        let [before, after] = [&here, &there].map(|l| l.residuals.norm_squared());
        if after <= before {
            // Converged also where rounding keeps steps from getting shorter.
            converged = step.amax() < SHORTEST_STEP || before - after < 1e-9 * before;
            (unknowns, here) = (next, there);
            damping = (0.2 * damping).max(1e-9);
        } else {
            converged = step.amax() < 0.1 * SHORTEST_STEP;
            damping *= 8.0;
        }
    }
    let normal = here.derivatives.tr_mul(&here.derivatives);
    let covariance = normal.cholesky().ok_or(TissueFitError::NotFinite)?.inverse();
    Ok(Minimum { unknowns, linearized: here, covariance, steps, converged })
}

/// `-(J'J + damping diag(J'J))^-1 J' r`, shortened to what a linear model can reach.
fn damped_step(at: &Linearized, damping: f64) -> Result<Unknowns, TissueFitError> {
    let mut normal = at.derivatives.tr_mul(&at.derivatives);
    for i in 0..normal.nrows() {
        normal[(i, i)] += damping * normal[(i, i)];
    }
    let step =
        -normal.cholesky().ok_or(TissueFitError::NotFinite)?.solve(&at.derivatives.tr_mul(&at.residuals));
    let longest = step.amax();
    if !longest.is_finite() {
        return Err(TissueFitError::NotFinite);
    }
    Ok(step * (LONGEST_STEP / longest.max(LONGEST_STEP)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(values: &[f64]) -> Unknowns {
        Unknowns::from_row_slice(values)
    }

    fn rows(columns: usize, values: &[f64]) -> Derivatives {
        Derivatives::from_row_slice(values.len() / columns, columns, values)
    }

    /// The valley of Rosenbrock (1960), whose least value is 0 at (1, 1).
    #[test]
    fn the_end_of_a_curved_valley_is_found() {
        let linearize = |x: &Unknowns| {
            Ok(Linearized {
                residuals: column(&[10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]]),
                derivatives: rows(2, &[-20.0 * x[0], 10.0, -1.0, 0.0]),
            })
        };
        let minimum = minimize(column(&[-1.2, 1.0]), linearize, 100).unwrap();
        assert!((&minimum.unknowns - column(&[1.0, 1.0])).amax() < 1e-3, "{}", minimum.unknowns);
        assert!(minimum.converged && minimum.steps < 60, "{}", minimum.steps);
    }

    #[test]
    fn a_line_has_the_covariance_of_the_textbook() {
        // y = a + b x at x = -1, 0, 1: variances 1/3 and 1/2.
        let design = rows(2, &[1.0, -1.0, 1.0, 0.0, 1.0, 1.0]);
        let data = column(&[1.0, 2.0, 4.0]);
        let linearize =
            |x: &Unknowns| Ok(Linearized { residuals: &design * x - &data, derivatives: design.clone() });
        let minimum = minimize(column(&[0.0, 0.0]), linearize, 50).unwrap();
        assert!((&minimum.unknowns - column(&[7.0 / 3.0, 1.5])).amax() < 1e-3, "{}", minimum.unknowns);
        let expected = rows(2, &[1.0 / 3.0, 0.0, 0.0, 0.5]);
        assert!((minimum.covariance - expected).amax() < 1e-9);
    }
}
