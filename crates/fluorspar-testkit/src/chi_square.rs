//! Pearson's chi-square test.

use std::f64::consts::PI;

use statrs::distribution::{ChiSquared, ContinuousCDF, DiscreteCDF, Poisson};

/// Result of a chi-square test.
#[derive(Clone, Debug, PartialEq)]
pub struct ChiSquare {
    /// The statistic.
    pub statistic: f64,
    /// Degrees of freedom.
    pub degrees_of_freedom: usize,
    /// Probability of a statistic at least this large if the hypothesis is true.
    pub p_value: f64,
    /// Cell with the largest contribution, its expected and its observed count.
    pub worst: (usize, f64, f64),
}

impl ChiSquare {
    /// Panics with all figures unless `p_value >= significance`.
    ///
    /// # Panics
    /// When the hypothesis is rejected.
    pub fn assert_accepted(&self, significance: f64) {
        assert!(self.p_value >= significance, "rejected at {significance:e}: {self:?}");
    }
}

/// Cells with fewer expected counts are pooled.
const LEAST_EXPECTED: f64 = 5.0;

/// Compares observed with expected counts. Cells that expect fewer than 5 are pooled into one. When the pool itself
/// expects fewer, it is judged by its own two-sided Poisson tail: the smaller p-value of the two is doubled. So counts
/// where (almost) nothing is expected reject, however many other cells there are.
pub fn chi_square(observed: &[f64], expected: &[f64]) -> ChiSquare {
    let mut statistic = 0.0;
    let mut cells = 0_usize;
    let mut pooled = (0.0, 0.0);
    let mut worst = (0, 0.0, 0.0);
    let mut worst_term = -1.0;
    let mut pool_p = None;
    for (cell, (&o, &e)) in observed.iter().zip(expected).enumerate() {
        if e < LEAST_EXPECTED {
            pooled.0 += o;
            pooled.1 += e;
            continue;
        }
        let term = (o - e) * (o - e) / e;
        statistic += term;
        cells += 1;
        if term > worst_term {
            (worst_term, worst) = (term, (cell, e, o));
        }
    }
    if pooled.1 > 0.0 || pooled.0 > 0.0 {
        if pooled.1 >= LEAST_EXPECTED {
            statistic += (pooled.0 - pooled.1) * (pooled.0 - pooled.1) / pooled.1;
            cells += 1;
        } else {
            pool_p = Some(poisson_p(pooled.0, pooled.1));
        }
    }
    let degrees_of_freedom = cells.saturating_sub(1).max(1);
    let mut p_value = ChiSquared::new(degrees_of_freedom as f64).map_or(0.0, |d| d.sf(statistic));
    if let Some(pool) = pool_p {
        // Two tests at once (Bonferroni).
        p_value = (2.0 * p_value.min(pool)).min(1.0);
    }
    ChiSquare { statistic, degrees_of_freedom, p_value, worst }
}

/// Probability of a count as far out as the one observed, both tails.
fn poisson_p(observed: f64, expected: f64) -> f64 {
    let Ok(poisson) = Poisson::new(expected.max(1e-9)) else { return 0.0 };
    let observed = observed as u64;
    let above = if observed == 0 { 1.0 } else { poisson.sf(observed - 1) };
    (2.0 * above.min(poisson.cdf(observed))).min(1.0)
}

/// Tests directions on the unit sphere against a density per steradian.
///
/// The sphere is divided into `rows` bands of equal cosine by `columns` sectors; the density is integrated in each cell
/// by a midpoint rule of `points` x `points`; densities with sharp edges need many. Draws that return `None` must be matched by missing density.
pub fn chi_square_over_sphere(
    samples: usize,
    rows: usize,
    columns: usize,
    points: usize,
    mut draw: impl FnMut(usize) -> Option<[f64; 3]>,
    density: impl Fn([f64; 3]) -> f64,
) -> ChiSquare {
    let mut observed = vec![0.0; rows * columns + 1];
    // Count the samples in equal cells of z and azimuth; the last cell counts absorbed ones
    for index in 0..samples {
        let cell = match draw(index) {
            None => rows * columns,
            Some([x, y, z]) => {
                let row = ((z.clamp(-1.0, 1.0) + 1.0) * 0.5 * rows as f64) as usize;
                let column = ((y.atan2(x) + PI) / (2.0 * PI) * columns as f64) as usize;
                row.min(rows - 1) * columns + column.min(columns - 1)
            }
        };
        observed[cell] += 1.0;
    }
    let mut expected = vec![0.0; rows * columns + 1];
    // Integrate the density over the cells
    let solid_angle = 4.0 * PI / (rows * columns) as f64;
    let mut total = 0.0;
    for row in 0..rows {
        for column in 0..columns {
            let mut sum = 0.0;
            for i in 0..points {
                for j in 0..points {
                    let z = -1.0 + 2.0 * (row as f64 + (i as f64 + 0.5) / points as f64) / rows as f64;
                    let phi =
                        -PI + 2.0 * PI * (column as f64 + (j as f64 + 0.5) / points as f64) / columns as f64;
                    let r = (1.0 - z * z).sqrt();
                    sum += density([r * phi.cos(), r * phi.sin(), z]);
                }
            }
            let probability = sum / (points * points) as f64 * solid_angle;
            total += probability;
            expected[row * columns + column] = probability * samples as f64;
        }
    }
    expected[rows * columns] = (1.0 - total).max(0.0) * samples as f64;
    chi_square(&observed, &expected)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_counts_are_accepted_and_skewed_ones_are_not() {
        assert!(chi_square(&[100.0, 104.0, 96.0], &[100.0; 3]).p_value > 0.5);
        assert!(chi_square(&[150.0, 50.0, 100.0], &[100.0; 3]).p_value < 1e-6);
        // Chi-square of 3.841 with one degree of freedom is the 5 % point.
        let p = chi_square(&[100.0 + 13.859, 100.0 - 13.859], &[100.0; 2]).p_value;
        assert!((p - 0.05).abs() < 1e-3, "{p}");
    }

    #[test]
    fn a_few_draws_where_none_are_expected_are_caught() {
        // 300 good cells must not hide eight forbidden draws.
        let (mut observed, mut expected) = (vec![60.0; 300], vec![60.0; 300]);
        observed.push(8.0);
        expected.push(0.0);
        assert!(chi_square(&observed, &expected).p_value < 1e-9);
        (observed[300], expected[300]) = (3.0, 2.5);
        assert!(chi_square(&observed, &expected).p_value > 0.5);
    }

    #[test]
    fn a_wrong_density_on_the_sphere_is_caught() {
        // A regular spiral is even over the sphere; a hemisphere density is not what it follows.
        let spiral = |i: usize| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / 20_000.0;
            let (r, phi) = ((1.0 - z * z).sqrt(), i as f64 * 2.399_963_229_728_653);
            Some([r * phi.cos(), r * phi.sin(), z])
        };
        assert!(chi_square_over_sphere(20_000, 8, 8, 16, spiral, |_| 0.25 / PI).p_value > 0.01);
        assert!(chi_square_over_sphere(20_000, 8, 8, 16, spiral, |d| d[2].max(0.0) / PI).p_value < 1e-9);
    }
}
