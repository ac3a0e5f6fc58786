//! How well scores tell two groups apart: d', the area under the ROC curve, and what rates of a detector say of both.

use statrs::distribution::{ContinuousCDF, Normal};

/// Area under the ROC curve of two normal distributions of equal variance whose means lie `d_prime` standard deviations
/// apart: `Phi(d' / sqrt 2)` (Green and Swets, Signal Detection Theory and Psychophysics, 1966).
///
/// 0.5 where nothing separates them, 1 in the limit.
pub fn auc_of_d_prime(d_prime: f64) -> f64 {
    Normal::standard().cdf(d_prime / 2f64.sqrt())
}

/// d' of a detector with these rates, each above 0 and below 1: `z(sensitivity) + z(specificity)` with `z` the quantile of the
/// standard normal distribution. `None` for other rates: 0 and 1 are consistent with any separation.
pub fn d_prime_of_rates(sensitivity: f64, specificity: f64) -> Option<f64> {
    let quantile = |rate: f64| (rate > 0.0 && rate < 1.0).then(|| Normal::standard().inverse_cdf(rate));
    Some(quantile(sensitivity)? + quantile(specificity)?)
}

/// Area under the ROC curve of two groups of scores: the chance that a score of `positive` exceeds one of `negative`, ties
/// counted half (Mann and Whitney). `None` where a group is empty or holds what is no number.
pub fn auc_of_scores(positive: &[f64], negative: &[f64]) -> Option<f64> {
    let usable = |scores: &[f64]| !scores.is_empty() && scores.iter().all(|score| !score.is_nan());
    if !(usable(positive) && usable(negative)) {
        return None;
    }
    let mut sorted = negative.to_vec();
    sorted.sort_by(f64::total_cmp);
    let below = |score: f64| sorted.partition_point(|other| *other < score);
    let not_above = |score: f64| sorted.partition_point(|other| *other <= score);
    let wins: usize = positive.iter().map(|&score| below(score) + not_above(score)).sum();
    Some(0.5 * wins as f64 / (positive.len() * negative.len()) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_area_is_known_at_some_separations() {
        assert!((auc_of_d_prime(0.0) - 0.5).abs() < 1e-12);
        // Phi(1), Abramowitz and Stegun table 26.1.
        assert!((auc_of_d_prime(2f64.sqrt()) - 0.841_344_746).abs() < 1e-9);
        assert!((auc_of_d_prime(-1.0) + auc_of_d_prime(1.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn published_pairs_of_rates_have_their_separation() {
        // Rounded to two decimals.
        for (sensitivity, specificity, d_prime) in
            [(0.959, 0.962, 3.51), (0.979, 0.923, 3.46), (0.969, 0.773, 2.62)]
        {
            let found = d_prime_of_rates(sensitivity, specificity).unwrap();
            assert!((found - d_prime).abs() < 0.005 + 1e-9, "{found}");
        }
        assert_eq!((d_prime_of_rates(1.0, 0.9), d_prime_of_rates(0.9, 0.0)), (None, None));
    }

    #[test]
    fn scores_win_lose_and_tie() {
        assert_eq!(auc_of_scores(&[3.0, 4.0], &[1.0, 2.0]), Some(1.0));
        assert_eq!(auc_of_scores(&[1.0, 3.0], &[2.0]), Some(0.5));
        assert_eq!(auc_of_scores(&[2.0, 2.0], &[2.0, 2.0, 2.0]), Some(0.5));
        assert_eq!(auc_of_scores(&[], &[1.0]), None);
        assert_eq!(auc_of_scores(&[f64::NAN], &[1.0]), None);
    }
}
