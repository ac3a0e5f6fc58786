//! Whether two estimates differ by more than their intervals leave open.

/// 95 % interval of the difference `b - a` of two independent estimates, each with its own 95 % interval, which need not be
/// symmetric.
///
/// `L = (b - a) - sqrt((b - b_low)² + (a_high - a)²)`, `U = (b - a) + sqrt((b_high - b)² + (a - a_low)²)` (Zou and Donner, Construction of
/// confidence limits about effect measures, Stat. Med. 27, 1693, 2008; cited from memory): for normal errors the interval of the difference itself.
/// Where it leaves out 0, the intervals tell the two apart. Errors that both have in common make it wider than it need be. An end that
/// is infinite makes one of it infinite.
///
/// ```
/// use fluorspar::analysis::interval_of_difference;
/// // 1 +- 0.3 and 2 +- 0.4: the root of the sum of the squares is 0.5.
/// let [low, high] = interval_of_difference((1.0, [0.7, 1.3]), (2.0, [1.6, 2.4]));
/// assert!((low - 0.5).abs() < 1e-12 && (high - 1.5).abs() < 1e-12);
/// ```
#[must_use]
pub fn interval_of_difference(a: (f64, [f64; 2]), b: (f64, [f64; 2])) -> [f64; 2] {
    let ((a, [a_low, a_high]), (b, [b_low, b_high])) = (a, b);
    // An estimate beyond an end of its own interval has no reach toward that end
    let reach = |from: f64, to: f64| (to - from).max(0.0);
    [b - a - reach(b_low, b).hypot(reach(a, a_high)), b - a + reach(b, b_high).hypot(reach(a_low, a))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_come_from_the_sides_that_face_each_other() {
        // Upward reach of a, downward reach of b: 3 and 4
        let [low, high] = interval_of_difference((1.0, [0.0, 4.0]), (10.0, [6.0, 10.5]));
        assert!((low - (9.0 - 5.0)).abs() < 1e-12, "{low}");
        assert!((high - (9.0 + 1.25f64.sqrt())).abs() < 1e-12, "{high}");
    }

    #[test]
    fn an_open_end_tells_nothing_apart_on_its_side() {
        let [low, high] = interval_of_difference((1.0, [0.9, f64::INFINITY]), (5.0, [4.9, 5.1]));
        assert!(low == f64::NEG_INFINITY && high.is_finite(), "{low} {high}");
    }

    #[test]
    fn swapping_them_mirrors_the_interval() {
        let (a, b) = ((0.2, [0.1, 0.5]), (0.3, [0.25, 0.9]));
        let ([low, high], [back_low, back_high]) =
            (interval_of_difference(a, b), interval_of_difference(b, a));
        assert!((low + back_high).abs() < 1e-15 && (high + back_low).abs() < 1e-15);
    }
}
