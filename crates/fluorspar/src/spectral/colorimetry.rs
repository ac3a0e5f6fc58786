//! CIE 1931 colorimetry of rendered spectra, for previews and photometric checks.

use std::sync::LazyLock;

use super::cie_tables::{
    COLOR_MATCHING_FUNCTIONS, D65_FIRST_NM, D65_STEP_NM, ILLUMINANT_D65, OBSERVER_FIRST_NM,
};
use super::{Curve, WavelengthGrid};
use crate::units::LUMINOUS_EFFICACY_LM_PER_W;

/// From tristimulus values to linear sRGB: the inverse of the matrix of its primaries, (0.64, 0.33), (0.30, 0.60) and
/// (0.15, 0.06), scaled to the white (0.3127, 0.3290); IEC 61966-2-1:1999.
const XYZ_TO_SRGB: [[f64; 3]; 3] = [
    [3.240_969_941_904_52, -1.537_383_177_570_09, -0.498_610_760_293_00],
    [-0.969_243_636_280_88, 1.875_967_501_507_72, 0.041_555_057_407_18],
    [0.055_630_079_696_99, -0.203_976_958_888_98, 1.056_971_514_242_88],
];

/// The CIE 1931 standard observer on a wavelength grid: turns radiance into tristimulus values.
#[derive(Clone, Debug, PartialEq)]
pub struct StandardObserver {
    /// Contribution of unit spectral radiance in each band: cd/m² for `Y`.
    weights: Vec<[f64; 3]>,
}

impl StandardObserver {
    /// Averages the color-matching functions over the bins of a grid. They are tabulated every nanometer from 360 to
    /// 830 nm, linear in between and zero outside.
    pub fn new(grid: &WavelengthGrid) -> Self {
        let channel = |channel: usize| {
            let values = COLOR_MATCHING_FUNCTIONS.iter().map(|xyz| xyz[channel]);
            Curve::evenly_spaced(OBSERVER_FIRST_NM, 1.0, values).bin_averages(grid)
        };
        let averages = [0, 1, 2].map(channel);
        let weights = (0..grid.len())
            .map(|band| {
                [0, 1, 2].map(|c: usize| LUMINOUS_EFFICACY_LM_PER_W * averages[c][band] * grid.width_nm(band))
            })
            .collect();
        Self { weights }
    }

    /// Tristimulus values of a spectral radiance, one value per band, W/(sr m² nm); `Y` is the luminance in cd/m².
    pub fn xyz(&self, radiance: &[f32]) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for (weight, &value) in self.weights.iter().zip(radiance) {
            for (sum, w) in sums.iter_mut().zip(weight) {
                *sum += w * f64::from(value);
            }
        }
        sums
    }
}

/// CIE standard illuminant D65 from 300 to 830 nm, relative spectral power, 100 at 560 nm.
pub fn daylight_d65() -> Curve {
    Curve::evenly_spaced(D65_FIRST_NM, D65_STEP_NM, ILLUMINANT_D65)
}

/// Linear sRGB of tristimulus values; components outside the gamut are negative or exceed the scale.
pub fn linear_srgb(xyz: [f64; 3]) -> [f64; 3] {
    XYZ_TO_SRGB.map(|row| row.iter().zip(xyz).map(|(weight, value)| weight * value).sum())
}

/// sRGB transfer function (IEC 61966-2-1:1999): linear 0 to 1 to 8 bits, clipped.
#[inline]
pub fn encode_srgb(linear: f64) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let Codes { edges, codes } = &*CODES;
    // A step holds one edge at most: the curve rises by 0.8 codes in the steepest
    let code = codes[(linear * (codes.len() - 1) as f64) as usize];
    code + u8::from(linear >= edges[usize::from(code)])
}

/// The equation of [`encode_srgb`], for 0 to 1.
fn srgb_code(linear: f64) -> u8 {
    let encoded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}

/// The transfer function of sRGB as a table: powers take most of the time of a preview.
struct Codes {
    /// Least linear value of each code from 1 on; none is 256.
    edges: [f64; 256],
    /// Codes at equal steps from 0 to 1.
    codes: [u8; 4097],
}

static CODES: LazyLock<Codes> = LazyLock::new(|| {
    // Bits of positive numbers increase with the numbers
    let edge = |code: u8| {
        let (mut below, mut above) = (0, 1.0_f64.to_bits());
        while above - below > 1 {
            let middle = below + (above - below) / 2;
            if srgb_code(f64::from_bits(middle)) >= code { above = middle } else { below = middle }
        }
        f64::from_bits(above)
    };
    Codes {
        edges: std::array::from_fn(|index| u8::try_from(index + 1).map_or(f64::INFINITY, edge)),
        codes: std::array::from_fn(|step| srgb_code(step as f64 / 4096.0)),
    }
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_of_the_table_are_those_of_the_equation() {
        for i in 0..=1_000_000 {
            let linear = f64::from(i) * 1e-6;
            assert_eq!(encode_srgb(linear), srgb_code(linear), "{linear}");
        }
        for edge in &CODES.edges[..255] {
            assert!(
                encode_srgb(*edge) == srgb_code(*edge)
                    && encode_srgb(edge.next_down()) + 1 == encode_srgb(*edge)
            );
        }
        assert_eq!([-1.0, f64::NAN, 2.0].map(encode_srgb), [0, 0, 255]);
    }

    #[test]
    fn one_watt_of_555_nm_light_gives_683_candela() {
        let grid = WavelengthGrid::uniform(545.0, 565.0, 1.0).unwrap();
        let mut radiance = vec![0.0; grid.len()];
        radiance[10] = 1.0;
        let y = StandardObserver::new(&grid).xyz(&radiance)[1];
        assert!((y - 683.0).abs() < 0.5, "{y}");
    }

    #[test]
    fn equal_energy_light_has_equal_tristimulus_values_on_any_grid() {
        for step in [1.0, 5.0, 10.0] {
            let grid = WavelengthGrid::uniform(360.0, 800.0, step).unwrap();
            let [x, y, z] = StandardObserver::new(&grid).xyz(&vec![1.0; grid.len()]);
            let sum = x + y + z;
            assert!((x / sum - 1.0 / 3.0).abs() < 2e-4 && (y / sum - 1.0 / 3.0).abs() < 2e-4, "{x} {y} {z}");
        }
    }

    #[test]
    fn the_tables_sum_to_their_published_checksums() {
        // CIE 018:2019, sums over 360 to 830 nm every nanometer.
        for (channel, sum) in [106.865_469, 106.856_917, 106.892_251].into_iter().enumerate() {
            let ours: f64 = COLOR_MATCHING_FUNCTIONS.iter().map(|xyz| xyz[channel]).sum();
            assert!((ours - sum).abs() < 1e-6, "{ours}, {sum}");
        }
        // ȳ is V(λ): 1 at 555 nm.
        assert_eq!(COLOR_MATCHING_FUNCTIONS[555 - 360][1], 1.0);
        // Published at 5 nm, CIE 15:2018, Table 6: 400, 450, 500, 600, 700 nm.
        for (nm, xyz) in [
            (400, [0.014_31, 0.000_396, 0.067_850_01]),
            (450, [0.336_2, 0.038, 1.772_11]),
            (500, [0.004_9, 0.323, 0.272]),
            (600, [1.062_2, 0.631, 0.000_8]),
            (700, [0.011_359_16, 0.004_102, 0.0]),
        ] {
            assert_eq!(COLOR_MATCHING_FUNCTIONS[nm - 360], xyz, "{nm} nm");
        }
        let d65 = daylight_d65();
        assert_eq!((d65.at(560.0), d65.range_nm()), (100.0, (300.0, 830.0)));
    }

    #[test]
    fn d65_has_its_published_chromaticity() {
        let grid = WavelengthGrid::uniform(360.0, 830.0, 1.0).unwrap();
        let radiance: Vec<f32> = daylight_d65().bin_averages(&grid).iter().map(|v| *v as f32).collect();
        let [x, y, z] = StandardObserver::new(&grid).xyz(&radiance);
        let sum = x + y + z;
        // CIE 15:2018, Table 11.1: x = 0.31272, y = 0.32903. Half a digit, and the bins of 1 nm.
        assert!(
            (x / sum - 0.312_72).abs() < 1e-5 && (y / sum - 0.329_03).abs() < 1e-5,
            "{} {}",
            x / sum,
            y / sum
        );
        // Its white in sRGB, whose white has four digits: 2e-4.
        let white = linear_srgb([x / y, 1.0, z / y]);
        assert!(white.iter().all(|c| (c - 1.0).abs() < 5e-4), "{white:?}");
    }

    #[test]
    fn the_primaries_of_srgb_are_pure() {
        let white_y = [0.212_639_005_871_510, 0.715_168_678_767_756, 0.072_192_315_360_734];
        for (channel, (x, y)) in [(0.64, 0.33), (0.30, 0.60), (0.15, 0.06)].into_iter().enumerate() {
            let scale = white_y[channel] / y;
            let rgb = linear_srgb([scale * x, scale * y, scale * (1.0 - x - y)]);
            for (other, value) in rgb.into_iter().enumerate() {
                let expected = f64::from(u8::from(other == channel));
                assert!((value - expected).abs() < 1e-12, "{channel}: {rgb:?}");
            }
        }
    }

    #[test]
    fn the_transfer_function_of_srgb() {
        // 0.0031308 is where its two branches meet; 0.21404 is the middle of the encoded scale, 127.5.
        let encoded = [0.0, 0.003_130_8, 0.213, 0.215, 0.5, 1.0, 2.0, -1.0].map(encode_srgb);
        assert_eq!(encoded, [0, 10, 127, 128, 188, 255, 255, 0]);
    }
}
