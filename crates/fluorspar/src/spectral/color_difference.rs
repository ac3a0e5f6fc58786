//! CIE colour spaces and differences from tristimulus values.

/// Share of the white above which lightness is a cube root, `(6 / 29)³`, and the slope below, `(29 / 3)³ / 100`.
const EPSILON: f64 = 216.0 / 24_389.0;
const KAPPA: f64 = 24_389.0 / 27.0;

/// CIE 1976 lightness of a relative luminance.
fn lightness(y: f64) -> f64 {
    if y > EPSILON { 116.0 * y.cbrt() - 16.0 } else { KAPPA * y }
}

/// CIE 1976 L*a*b* of tristimulus values under a white (CIE 15:2018, section 8.2.1).
pub fn cie_lab(xyz: [f64; 3], white: [f64; 3]) -> [f64; 3] {
    let f = |channel: usize| {
        let t = xyz[channel] / white[channel];
        if t > EPSILON { t.cbrt() } else { (KAPPA * t + 16.0) / 116.0 }
    };
    let [x, y, z] = [0, 1, 2].map(f);
    [lightness(xyz[1] / white[1]), 500.0 * (x - y), 200.0 * (y - z)]
}

/// CIE 1976 chromaticity `(u', v')`; CIE 1960 has `u = u'`, `v = 2/3 v'`. `None` for black.
pub fn cie_uv_1976([x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
    let sum = x + 15.0 * y + 3.0 * z;
    (sum > 0.0).then(|| [4.0 * x / sum, 9.0 * y / sum])
}

/// CIE 1960 chromaticity `(u, v)`, in which correlated colour temperatures are found. `None` for black.
pub fn cie_uv_1960(xyz: [f64; 3]) -> Option<[f64; 2]> {
    cie_uv_1976(xyz).map(|[u, v]| [u, 2.0 / 3.0 * v])
}

/// CIE 1976 L*u*v* of tristimulus values under a white (CIE 15:2018, section 8.2.2). `None` for a black white.
pub fn cie_luv(xyz: [f64; 3], white: [f64; 3]) -> Option<[f64; 3]> {
    let [u_white, v_white] = cie_uv_1976(white)?;
    // Black has no chromaticity and no saturation.
    let [u, v] = cie_uv_1976(xyz).unwrap_or([u_white, v_white]);
    let l = lightness(xyz[1] / white[1]);
    Some([l, 13.0 * l * (u - u_white), 13.0 * l * (v - v_white)])
}

/// CIE 1976 colour difference of two L*a*b* values.
pub fn delta_e_1976(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const D65: [f64; 3] = [95.047, 100.0, 108.883];

    #[test]
    fn white_and_black_are_where_they_belong() {
        assert!(cie_lab(D65, D65).iter().zip([100.0, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-9));
        assert!(cie_luv(D65, D65).unwrap().iter().zip([100.0, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-9));
        assert!(cie_lab([0.0; 3], D65).iter().all(|v| v.abs() < 1e-9));
        assert_eq!(cie_luv([0.0; 3], D65).unwrap(), [0.0; 3]);
        assert_eq!(cie_uv_1976([0.0; 3]), None);
    }

    #[test]
    fn the_two_branches_of_lightness_meet() {
        let step = 1e-9;
        assert!((lightness(EPSILON + step) - lightness(EPSILON)).abs() < 2.0 * KAPPA * step);
        let at = |y: f64| cie_lab([D65[0] * y, D65[1] * y, D65[2] * y], D65);
        assert!(delta_e_1976(at(EPSILON + step), at(EPSILON)) < 1e-5);
    }

    #[test]
    fn d65_has_its_published_chromaticity() {
        // CIE 15: u' = 0.1978, v' = 0.4683.
        let [u, v] = cie_uv_1976(D65).unwrap();
        assert!((u - 0.1978).abs() < 1e-4 && (v - 0.4683).abs() < 1e-4);
    }
}
