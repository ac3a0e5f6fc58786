//! How uncertain one developed channel value is.

use serde::{Deserialize, Serialize};

use crate::image::ChannelImage;

/// Variance of a channel value, in digital numbers (DN): dark noise, shot noise and pixel gain spread.
///
/// `Var(v) = floor² + K v + (p v)²`: the photon-transfer relation of EMVA 1288, with `K` in DN per electron and `p` the
/// photo-response non-uniformity. Each channel value counts as measured on its own. A bilinear demosaic
/// averages two to four raw values into the missing channels and correlates neighbours, so for such images the variance is an
/// upper bound.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelNoise {
    /// Standard deviation of a dark value, DN.
    pub floor_dn: f64,
    /// Digital numbers per electron.
    pub dn_per_electron: f64,
    /// Relative pixel gain spread (0.0229 in Table 1 of the paper); 0 where a flat field was divided out.
    pub gain_spread: f64,
}

impl ChannelNoise {
    /// The noise of a developed image: its own dark noise, with the conversion factor and the gain spread of its sensor.
    pub fn of_image(image: &ChannelImage, dn_per_electron: f64, gain_spread: f64) -> Self {
        Self { floor_dn: image.noise_floor_dn, dn_per_electron, gain_spread }
    }

    /// Variance of a value, DN². Values below zero count as dark.
    pub fn variance(&self, value_dn: f64) -> f64 {
        let signal = value_dn.max(0.0);
        self.floor_dn.powi(2) + self.dn_per_electron * signal + (self.gain_spread * signal).powi(2)
    }

    /// Variances of the three channels of a pixel, DN².
    pub fn variances(&self, rgb: [f64; 3]) -> [f64; 3] {
        rgb.map(|value| self.variance(value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_1_sensor_has_the_variance_worked_out_by_hand() {
        // 1000 electrons at 0.4496 DN per electron: 6.25² + 0.4496 * 449.6 + (0.0229 * 449.6)².
        let noise = ChannelNoise { floor_dn: 6.25, dn_per_electron: 0.4496, gain_spread: 0.0229 };
        let expected = 39.0625 + 202.140_16 + 106.004_177;
        assert!((noise.variance(449.6) - expected).abs() < 1e-3, "{}", noise.variance(449.6));
        assert_eq!(noise.variance(-3.0), 39.0625);
    }
}
