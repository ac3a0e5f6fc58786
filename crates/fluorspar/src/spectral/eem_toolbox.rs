//! The normalization under which the paper's weights are quoted: "peak 1 on 365:5:705 nm in energy".

use super::Curve;

/// First wavelength of the authors' renderer grid, nm.
pub const TOOLBOX_START_NM: f64 = 365.0;
/// Step of that grid, nm.
pub const TOOLBOX_STEP_NM: f64 = 5.0;
/// Samples of that grid.
pub const TOOLBOX_SAMPLES: usize = 69;

/// An energy EEM sampled at 365:5:705 nm, strictly lower triangular, with largest entry 1: what the authors'
/// toolbox hands to their renderer (`fluorophoreGet(fl, 'eem energy normalize')`).
///
/// Emission is `sum_i E_ji L_i` without a wavelength step, so its level depends on the grid. It exists so that
/// published weights can be quoted and checked; [`super::PhotonEem`] is the physical matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolboxEem {
    /// `[emission][excitation]`, peak 1.
    values: Vec<f64>,
}

impl ToolboxEem {
    /// From a relative photon yield density `Y(lo, li)` before the Stokes triangle: `tril(Y li / lo, -1)` over its maximum.
    /// `None` when nothing is left.
    pub fn from_density(density: impl Fn(f64, f64) -> f64) -> Option<Self> {
        let n = TOOLBOX_SAMPLES;
        let wavelengths = Self::wavelengths_nm();
        let mut values = vec![0.0; n * n];
        for row in 1..n {
            for col in 0..row {
                let (emission_nm, excitation_nm) = (wavelengths[row], wavelengths[col]);
                values[row * n + col] = density(emission_nm, excitation_nm) * excitation_nm / emission_nm;
            }
        }
        let peak = values.iter().copied().fold(0.0, f64::max);
        if !(peak > 0.0 && peak.is_finite()) {
            return None;
        }
        values.iter_mut().for_each(|value| *value /= peak);
        Some(Self { values })
    }

    /// The grid, nm.
    pub fn wavelengths_nm() -> Vec<f64> {
        (0..TOOLBOX_SAMPLES).map(|i| TOOLBOX_START_NM + TOOLBOX_STEP_NM * i as f64).collect()
    }

    /// Entry for one pair of samples.
    pub fn at(&self, emission: usize, excitation: usize) -> f64 {
        self.values[emission * TOOLBOX_SAMPLES + excitation]
    }

    /// Emission in the units of the light, one value per grid sample.
    pub fn emission(&self, light: &Curve) -> Vec<f64> {
        let light: Vec<f64> = Self::wavelengths_nm().iter().map(|&nm| light.at(nm)).collect();
        self.values
            .chunks_exact(TOOLBOX_SAMPLES)
            .map(|row| row.iter().zip(&light).map(|(value, light)| value * light).sum())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_strictly_triangular_with_peak_one() {
        let eem = ToolboxEem::from_density(|_, _| 1.0).unwrap();
        assert_eq!(eem.at(3, 3), 0.0);
        assert_eq!(eem.at(3, 4), 0.0);
        let peak =
            (0..69).flat_map(|r| (0..69).map(move |c| (r, c))).map(|(r, c)| eem.at(r, c)).fold(0.0, f64::max);
        assert_eq!(peak, 1.0);
        // Flat spectra: the largest energy ratio li/lo is that of neighbors at the long end.
        assert!((eem.at(68, 67) - 1.0).abs() < 1e-12);
    }
}
