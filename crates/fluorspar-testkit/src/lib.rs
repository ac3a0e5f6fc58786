//! Statistical tests for stochastic code: fixed seeds, derived thresholds, failures that say where to look.
//!
//! | test | question |
//! |---|---|
//! | [`chi_square`] | do counts follow expected counts? |
//! | [`chi_square_over_sphere`] | do directions follow their density? |
//! | [`kolmogorov_smirnov`] | do samples follow a distribution function? |
//! | [`z_score`], [`z_limit`] | does a mean lie where it should, given its standard error? |
//! | [`welch_t_test`] | do two sets of measurements have the same mean? |

mod chi_square;
mod kolmogorov_smirnov;
mod z_test;

pub use chi_square::{ChiSquare, chi_square, chi_square_over_sphere};
pub use kolmogorov_smirnov::kolmogorov_smirnov;
pub use z_test::{MeanEstimate, welch_t_test, z_limit, z_score};

/// Significance of each of `tests` independent tests such that all together reject a true hypothesis with
/// probability `overall` (Sidak 1967): `1 - (1 - overall)^(1/tests)`.
pub fn sidak(overall: f64, tests: usize) -> f64 {
    1.0 - (1.0 - overall).powf(1.0 / tests as f64)
}
