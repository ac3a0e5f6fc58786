//! Elementary functions from additions, multiplications, divisions and square roots alone, so that a mouth has the
//! same bits on every platform, and the small curve tools of the generator.

use glam::DVec3;

pub(super) const PI: f64 = std::f64::consts::PI;

/// Sine and cosine of an angle in radians, to about 1e-13.
pub(super) fn sin_cos(angle: f64) -> (f64, f64) {
    let quarter_turns = (angle / (PI / 2.0)).round();
    let x = angle - quarter_turns * (PI / 2.0);
    let x2 = x * x;
    let (mut sine, mut cosine) = (0.0, 0.0);
    for k in (1..=8).rev() {
        let n = f64::from(2 * k);
        sine = -x2 / (n * (n + 1.0)) * (1.0 + sine);
        cosine = -x2 / ((n - 1.0) * n) * (1.0 + cosine);
    }
    let (sine, cosine) = (x * (1.0 + sine), 1.0 + cosine);
    match quarter_turns.rem_euclid(4.0) as u8 {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

/// Exponential function; arguments below -700 give 0.
pub(super) fn exp(x: f64) -> f64 {
    if x < -700.0 {
        return 0.0;
    }
    let whole = (x / std::f64::consts::LN_2).round().clamp(-1000.0, 1000.0);
    let rest = x - whole * std::f64::consts::LN_2;
    let mut sum = 1.0;
    for k in (1..=12).rev() {
        sum = 1.0 + rest / f64::from(k) * sum;
    }
    sum * f64::from_bits(((1023 + whole as i64) as u64) << 52)
}

/// Natural logarithm of a positive normal number.
pub(super) fn ln(x: f64) -> f64 {
    let bits = x.to_bits();
    let mut exponent = ((bits >> 52) & 0x7ff) as i64 - 1023;
    let mut mantissa = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) | 0x3ff0_0000_0000_0000);
    if mantissa > std::f64::consts::SQRT_2 {
        mantissa *= 0.5;
        exponent += 1;
    }
    let y = (mantissa - 1.0) / (mantissa + 1.0);
    let y2 = y * y;
    let mut sum = 0.0;
    for k in (0..=11).rev() {
        sum = 1.0 / f64::from(2 * k + 1) + y2 * sum;
    }
    exponent as f64 * std::f64::consts::LN_2 + 2.0 * y * sum
}

/// `base` to the power `exponent` for a base that is zero or positive.
pub(super) fn pow(base: f64, exponent: f64) -> f64 {
    if base <= 1e-300 { 0.0 } else { exp(exponent * ln(base)) }
}

/// `|base|^exponent` with the sign of the base: the coordinate of a superellipse.
pub(super) fn signed_pow(base: f64, exponent: f64) -> f64 {
    if base < 0.0 { -pow(-base, exponent) } else { pow(base, exponent) }
}

/// A bell of unit height: `exp(-x²)`, and 0 where that is below 1e-16.
pub(super) fn bell(x: f64) -> f64 {
    if x.abs() > 6.07 { 0.0 } else { exp(-x * x) }
}

pub(super) fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// 0 below `low`, 1 above `high`, a cubic between them.
pub(super) fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Smooth interpolation of a table of increasing abscissae: cubic Hermite with limited slopes, constant outside.
pub(super) fn curve(table: &[(f64, f64)], x: f64) -> f64 {
    let last = table.len() - 1;
    if x <= table[0].0 {
        return table[0].1;
    }
    if x >= table[last].0 {
        return table[last].1;
    }
    let i = table.iter().rposition(|&(knot, _)| knot <= x).unwrap_or(0).min(last - 1);
    let secant = |k: usize| (table[k + 1].1 - table[k].1) / (table[k + 1].0 - table[k].0);
    let slope = |k: usize| {
        if k == 0 {
            return secant(0);
        }
        if k == last {
            return secant(last - 1);
        }
        let (before, after) = (secant(k - 1), secant(k));
        if before * after <= 0.0 { 0.0 } else { 2.0 * before * after / (before + after) }
    };
    let width = table[i + 1].0 - table[i].0;
    let t = (x - table[i].0) / width;
    let (t2, t3) = (t * t, t * t * t);
    table[i].1 * (2.0 * t3 - 3.0 * t2 + 1.0)
        + slope(i) * width * (t3 - 2.0 * t2 + t)
        + table[i + 1].1 * (3.0 * t2 - 2.0 * t3)
        + slope(i + 1) * width * (t3 - t2)
}

/// `of` every value with its neighbors up to `reach` places away.
pub(super) fn window(values: &[f64], reach: usize, of: &dyn Fn(&[f64]) -> f64) -> Vec<f64> {
    (0..values.len())
        .map(|i| of(&values[i.saturating_sub(reach)..(i + reach + 1).min(values.len())]))
        .collect()
}

/// Mean of the values.
pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Point of the Catmull-Rom curve through `knots` with centripetal spacing; `x` counts knots from 0.
pub(super) fn spline(knots: &[DVec3], x: f64) -> DVec3 {
    let last = knots.len() - 1;
    let i = (x.floor().max(0.0) as usize).min(last - 1);
    let t = x - i as f64;
    let (b, c) = (knots[i], knots[i + 1]);
    let a = if i > 0 { knots[i - 1] } else { b * 2.0 - c };
    let d = if i + 2 <= last { knots[i + 2] } else { c * 2.0 - b };
    let gap = |p: DVec3, q: DVec3| (q - p).length().max(1e-9).sqrt();
    let (ab, bc, cd) = (gap(a, b), gap(b, c), gap(c, d));
    let start = ((b - a) / ab - (c - a) / (ab + bc) + (c - b) / bc) * bc;
    let end = ((c - b) / bc - (d - b) / (bc + cd) + (d - c) / cd) * bc;
    let (t2, t3) = (t * t, t * t * t);
    b * (2.0 * t3 - 3.0 * t2 + 1.0)
        + start * (t3 - 2.0 * t2 + t)
        + c * (3.0 * t2 - 2.0 * t3)
        + end * (t3 - t2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_elementary_functions_agree_with_the_standard_library() {
        for k in -400..400 {
            let x = f64::from(k) * 0.037;
            let (sine, cosine) = sin_cos(x);
            assert!((sine - x.sin()).abs() < 1e-12 && (cosine - x.cos()).abs() < 1e-12, "angle {x}");
            assert!((exp(x) / x.exp() - 1.0).abs() < 1e-12, "exp {x}");
            let positive = x.abs() + 1e-3;
            assert!((ln(positive) - positive.ln()).abs() < 1e-12, "ln {positive}");
            assert!((pow(positive, 0.7) / positive.powf(0.7) - 1.0).abs() < 1e-11, "pow {positive}");
        }
    }

    #[test]
    fn curves_pass_through_their_knots() {
        let table = [(0.0, 1.0), (0.3, 2.0), (1.0, -1.0)];
        for (x, y) in table {
            assert!((curve(&table, x) - y).abs() < 1e-12);
        }
        let knots = [DVec3::ZERO, DVec3::X, DVec3::new(2.0, 1.0, 0.0), DVec3::new(2.0, 5.0, 0.0)];
        for (i, knot) in knots.iter().enumerate() {
            assert!((spline(&knots, i as f64) - *knot).length() < 1e-12);
        }
    }
}
