//! CIE 1931 colorimetry of rendered spectra, for previews and photometric checks.

use colorimetry::observer::Observer;
use colorimetry::rgb::RgbSpace;

use super::{Curve, Dimensionless, WavelengthGrid};
use crate::units::LUMINOUS_EFFICACY_LM_PER_W;

/// Range of the observer's colour-matching functions, nm.
const OBSERVER_RANGE_NM: std::ops::RangeInclusive<u16> = 380..=780;

/// The CIE 1931 standard observer on a wavelength grid: turns radiance into tristimulus values.
#[derive(Clone, Debug, PartialEq)]
pub struct StandardObserver {
    /// Contribution of unit spectral radiance in each band: cd/m² for `Y`.
    weights: Vec<[f64; 3]>,
}

impl StandardObserver {
    /// Averages the colour-matching functions (1 nm tables of the `colorimetry` crate) over the bins of a grid.
    pub fn new(grid: &WavelengthGrid) -> Self {
        let nodes: Vec<u16> = OBSERVER_RANGE_NM.collect();
        let table: Vec<[f64; 3]> = nodes
            .iter()
            .map(|&nm| {
                Observer::Cie1931.xyz_at_wavelength(usize::from(nm)).map_or([0.0; 3], |c| c.to_array())
            })
            .collect();
        let wavelengths: Vec<f64> = nodes.iter().map(|&nm| f64::from(nm)).collect();
        let mut weights = vec![[0.0; 3]; grid.len()];
        for channel in 0..3 {
            let values = table.iter().map(|xyz| xyz[channel]).collect();
            let Ok(curve) = Curve::new(wavelengths.clone(), values) else { continue };
            let binned = curve.on_grid::<Dimensionless>(grid);
            for (band, weight) in weights.iter_mut().enumerate() {
                weight[channel] = LUMINOUS_EFFICACY_LM_PER_W * binned[band] * grid.width_nm(band);
            }
        }
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

/// CIE standard illuminant D65 from 380 to 780 nm, 100 at 560 nm.
pub fn daylight_d65() -> Curve {
    let table: &colorimetry::spectrum::Spectrum = colorimetry::illuminant::D65.as_ref();
    Curve::from_fn(380.0, 780.0, |nm| {
        let (below, share) = (nm.floor(), nm.fract());
        let at = |nm: f64| table[(nm as usize).clamp(380, 780)];
        at(below) + share * (at(below + 1.0) - at(below))
    })
}

/// Linear sRGB of tristimulus values; components outside the gamut are negative or exceed the scale.
pub fn linear_srgb(xyz: [f64; 3]) -> [f64; 3] {
    let matrix = Observer::Cie1931.xyz2rgb_matrix(RgbSpace::SRGB);
    std::array::from_fn(|row| (0..3).map(|col| matrix[(row, col)] * xyz[col]).sum())
}

/// sRGB transfer function: linear 0 to 1 to 8 bits, clipped.
pub fn encode_srgb(linear: f64) -> u8 {
    (RgbSpace::SRGB.gamma().encode(linear.clamp(0.0, 1.0)) * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn d65_white_is_white() {
        let rgb = linear_srgb([0.950_47, 1.0, 1.088_83]);
        assert!(rgb.iter().all(|c| (c - 1.0).abs() < 2e-3), "{rgb:?}");
        assert_eq!(encode_srgb(1.0), 255);
        assert_eq!(encode_srgb(0.5), 188);
    }
}
