//! How well scores tell two groups apart: d', the area under the ROC curve, and what rates of a detector say of both.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};

use crate::sampling::Z_95;

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

/// The area under the ROC curve of two groups of scores.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RocArea {
    /// The area, 0 to 1 ([`auc_of_scores`]).
    pub area: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// 95 % interval ([`Self::interval_of_best`] of one).
    pub interval: [f64; 2],
    /// Scores of each group, positive and negative.
    pub n: [usize; 2],
}

impl RocArea {
    /// The area with its error after DeLong, DeLong and Clarke-Pearson (Biometrics 44, 837, 1988): each score's share of wins against the
    /// other group, and the variances of these shares over the sizes of the groups. `None` of fewer than two scores in a group, and of
    /// what is no number.
    #[must_use]
    pub fn of(positive: &[f64], negative: &[f64]) -> Option<Self> {
        let area = auc_of_scores(positive, negative)?;
        let variance = |scores: &[f64], others: &[f64], sign: f64| {
            let turned: Vec<f64> = others.iter().map(|other| sign * other).collect();
            let wins = scores.iter().map(|score| auc_of_scores(&[sign * score], &turned));
            let wins = wins.collect::<Option<Vec<f64>>>()?;
            let n = wins.len() as f64;
            let squares: f64 = wins.iter().map(|win| (win - area).powi(2)).sum();
            (wins.len() > 1).then(|| squares / (n - 1.0) / n)
        };
        let variance = variance(positive, negative, 1.0)? + variance(negative, positive, -1.0)?;
        let standard_error = variance.sqrt();
        let n = [positive.len(), negative.len()];
        Some(Self { area, standard_error, interval: score_interval(area, n, Z_95), n })
    }

    /// Interval of an area that is the largest of `tried`, each above a half after the fact: of all of them 95 % of the largest hold
    /// (Bonferroni). Areas from which the observed one is no farther than its standard error there times the quantile, with the variance
    /// of Hanley and McNeil (Newcombe, Stat. Med. 25, 559, 2006, method 5): DeLong's error holds 0.87 to 0.90 of areas near 0.9 of ten
    /// people a group, and is 0 where groups do not overlap.
    #[must_use]
    pub fn interval_of_best(&self, tried: usize) -> [f64; 2] {
        let tail = 0.025 / tried.max(1) as f64;
        score_interval(self.area, self.n, -Normal::standard().inverse_cdf(tail))
    }
}

/// The areas that lie within `z` of their own standard errors, in which both groups have their mean size, of an observed one.
fn score_interval(observed: f64, [positive, negative]: [usize; 2], z: f64) -> [f64; 2] {
    let (m, n) = (positive as f64, negative as f64);
    let is_near = |area: f64| {
        let pairs = (1.0 - area) / (2.0 - area) + area / (1.0 + area);
        let variance = area * (1.0 - area) / (m * n) * (1.0 + (0.5 * (m + n) - 1.0) * pairs);
        (observed - area).abs() <= z * variance.sqrt()
    };
    [0.0, 1.0].map(|end: f64| {
        // The observed area is near itself
        let (mut near, mut far) = (observed, end);
        for _ in 0..60 {
            let middle = 0.5 * (near + far);
            if is_near(middle) { near = middle } else { far = middle }
        }
        near
    })
}

/// d' of two groups of scores: distance of their means over the root of the mean of their variances. `None` of fewer than two scores in a
/// group, and where nothing varies.
#[must_use]
pub fn d_prime_of_scores(positive: &[f64], negative: &[f64]) -> Option<f64> {
    let moments = |scores: &[f64]| {
        let n = scores.len() as f64;
        let mean = scores.iter().sum::<f64>() / n;
        let variance = scores.iter().map(|score| (score - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (scores.len() > 1).then_some((mean, variance))
    };
    let ((a, of_a), (b, of_b)) = (moments(positive)?, moments(negative)?);
    let d_prime = (a - b) / (0.5 * (of_a + of_b)).sqrt();
    d_prime.is_finite().then_some(d_prime)
}

/// Points of the ROC curve of two groups of scores, false over true positives from (0, 0) to (1, 1): a threshold at each score.
#[must_use]
pub fn roc_curve(positive: &[f64], negative: &[f64]) -> Vec<[f64; 2]> {
    let mut thresholds: Vec<f64> = positive.iter().chain(negative).copied().collect();
    thresholds.sort_by(|a, b| b.total_cmp(a));
    thresholds.dedup();
    let share = |scores: &[f64], least: f64| {
        scores.iter().filter(|score| **score >= least).count() as f64 / scores.len().max(1) as f64
    };
    let point = |least: f64| [share(negative, least), share(positive, least)];
    std::iter::once([0.0, 0.0]).chain(thresholds.into_iter().map(point)).collect()
}

/// Scores in each of two equal groups for which an area under the ROC curve, above 0 and below 1, has a 95 % interval of this half width,
/// by the variance that Hanley and McNeil give for exponential scores (Radiology 143, 29, 1982). `None` for other areas and widths that
/// are not above 0.
#[must_use]
pub fn group_size_for_area(area: f64, half_width: f64) -> Option<u64> {
    if !(area > 0.0 && area < 1.0 && half_width > 0.0) {
        return None;
    }
    // An area below a half is one above it with the groups exchanged
    let area = area.max(1.0 - area);
    let [won_twice, won_by_both] = [area / (2.0 - area), 2.0 * area * area / (1.0 + area)];
    let variance = |n: f64| {
        let pairs = won_twice + won_by_both - 2.0 * area * area;
        (area * (1.0 - area) + (n - 1.0) * pairs) / (n * n)
    };
    let wanted = (half_width / Z_95).powi(2);
    // n² wanted - n pairs - (A (1 - A) - pairs) = 0
    let pairs = variance(2.0) * 4.0 - area * (1.0 - area);
    let rest = area * (1.0 - area) - pairs;
    let n = (pairs + (pairs * pairs + 4.0 * wanted * rest).max(0.0).sqrt()) / (2.0 * wanted);
    Some((n.ceil() as u64).max(2))
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

    /// By hand: 3 and 5 against 1, 3 and 4 win (1 + 1/2 + 0) / 3 and 3 / 3; 1, 3 and 4 lose 2 / 2, 1.5 / 2 and 1 / 2. Area 0.75; variances
    /// 0.125 / 2 and 0.0625 / 3.
    #[test]
    fn the_error_of_an_area_is_that_by_hand() {
        let found = RocArea::of(&[3.0, 5.0], &[1.0, 3.0, 4.0]).unwrap();
        assert!((found.area - 0.75).abs() < 1e-15);
        assert!((found.standard_error - (0.0625f64 + 0.0625 / 3.0).sqrt()).abs() < 1e-15);
        assert_eq!(found.n, [2, 3]);
        assert_eq!(RocArea::of(&[3.0], &[1.0, 2.0]), None);
        // Apart: at the lower end the distance to 1 is 1.96 standard errors
        let apart = RocArea::of(&[3.0, 4.0], &[1.0, 2.0]).unwrap();
        let [low, high] = apart.interval;
        let variance = low * (1.0 - low) / 4.0 * (1.0 + (1.0 - low) / (2.0 - low) + low / (1.0 + low));
        assert!(
            (1.0 - low - Z_95 * variance.sqrt()).abs() < 1e-9 && high == 1.0 && (0.3..0.7).contains(&low),
            "{low}"
        );
        let below = RocArea::of(&[1.0, 2.0], &[3.0, 4.0]).unwrap();
        assert!(below.interval[0] == 0.0 && (below.interval[1] - (1.0 - low)).abs() < 1e-12);
        // Alike: nothing is known of a half; the best of many is known less well than one
        let alike = RocArea::of(&[2.0, 2.0], &[2.0, 2.0]).unwrap().interval;
        assert!(alike[0] < 0.2 && alike[1] > 0.8, "{alike:?}");
        let best_of = |tried| apart.interval_of_best(tried)[0];
        assert!(best_of(6) < low - 0.02 && (best_of(1) - low).abs() < 1e-3, "{}", best_of(6));
    }

    /// Pairs of normal groups d' apart.
    fn areas_of_pairs(pairs: u64, size: u64, d_prime: f64) -> Vec<RocArea> {
        use crate::sampling::random::Key;

        let area = |pair: u64| {
            let key = Key::new(5).with(pair);
            let group = |id: u64, mean: f64| -> Vec<f64> {
                (0..size).map(|k| mean + key.with(id).with(k).normal()).collect()
            };
            RocArea::of(&group(1, d_prime), &group(2, 0.0)).unwrap()
        };
        (0..pairs).map(area).collect()
    }

    /// Of 1000 pairs, at least 95 % but four standard errors.
    #[test]
    fn intervals_of_small_groups_hold_the_true_area() {
        for (size, d_prime) in [(10, 2.0), (6, 1.0), (20, 3.0)] {
            let truth = auc_of_d_prime(d_prime);
            let all = areas_of_pairs(1000, size, d_prime);
            let held = all.iter().filter(|of| (of.interval[0]..=of.interval[1]).contains(&truth)).count();
            assert!(held as f64 / 1000.0 > 0.95 - 4.0 * (0.95f64 * 0.05 / 1000.0).sqrt(), "{size}: {held}");
        }
    }

    /// 400 pairs of normal groups of 40 at d' = 1: the mean area is that of the normal distribution, intervals hold it in 95 %, both
    /// to four standard errors, and the mean variance is that of the areas (its error sqrt(2 / 399), four of them).
    #[test]
    fn intervals_of_areas_hold_the_true_one() {
        let truth = auc_of_d_prime(1.0);
        let all = areas_of_pairs(400, 40, 1.0);
        let mean = all.iter().map(|of| of.area).sum::<f64>() / 400.0;
        let variance = all.iter().map(|of| (of.area - mean).powi(2)).sum::<f64>() / 399.0;
        let told = all.iter().map(|of| of.standard_error.powi(2)).sum::<f64>() / 400.0;
        assert!((mean - truth).abs() < 4.0 * (variance / 400.0).sqrt(), "{mean}");
        assert!((told / variance - 1.0).abs() < 4.0 * (2.0f64 / 399.0).sqrt(), "{told} {variance}");
        let held = all.iter().filter(|of| (of.interval[0]..=of.interval[1]).contains(&truth)).count();
        assert!((held as f64 / 400.0 - 0.95).abs() < 4.0 * (0.95f64 * 0.05 / 400.0).sqrt(), "{held}");
        let d_prime = d_prime_of_scores(&[1.0, 3.0], &[0.0, 2.0]).unwrap();
        assert!((d_prime - 1.0 / 2f64.sqrt()).abs() < 1e-15);
        assert_eq!(roc_curve(&[2.0], &[1.0]), [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
    }

    /// Hanley and McNeil's variance solved by a second program: a half width of 0.05.
    #[test]
    fn the_size_of_a_study_is_the_published_one() {
        for (area, n) in [(0.80, 151), (0.85, 117), (0.90, 79), (0.95, 40)] {
            assert_eq!(group_size_for_area(area, 0.05), Some(n), "{area}");
        }
        assert_eq!(group_size_for_area(0.2, 0.05), Some(151));
        assert_eq!(group_size_for_area(1.0, 0.05), None);
    }
}
