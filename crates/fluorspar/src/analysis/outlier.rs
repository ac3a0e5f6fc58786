//! Values that lie apart from the others.

use super::statistics::median;

/// Distance from the median, in robust standard deviations, beyond which a value lies apart (Iglewicz and Hoaglin, How to Detect and
/// Handle Outliers, 1993).
const FAR: f64 = 3.5;
/// Fewest values among which one can lie apart.
const LEAST: usize = 5;

/// Which values lie apart from the others: more than 3.5 times their median absolute deviation, made that of a normal distribution, from
/// their median. None of fewer than five values.
#[must_use]
pub fn lie_apart(values: &[f64]) -> Vec<bool> {
    let (Some(middle), true) = (median(values.iter().copied()), values.len() >= LEAST) else {
        return vec![false; values.len()];
    };
    let spread = median(values.iter().map(|value| (value - middle).abs())).unwrap_or(0.0);
    values.iter().map(|value| 0.6745 * (value - middle).abs() > FAR * spread).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: median 3, deviations 2, 1, 0, 1, 97, their median 1; 3.5 / 0.6745 is 5.19.
    #[test]
    fn one_that_is_far_lies_apart() {
        assert_eq!(lie_apart(&[1.0, 2.0, 3.0, 4.0, 100.0]), [false, false, false, false, true]);
        assert_eq!(lie_apart(&[1.0, 2.0, 3.0, 4.0, 8.1]), [false; 5]);
        assert_eq!(lie_apart(&[1.0, 2.0, 3.0, 100.0]), [false; 4]);
        assert_eq!(lie_apart(&[]), [false; 0]);
    }
}
