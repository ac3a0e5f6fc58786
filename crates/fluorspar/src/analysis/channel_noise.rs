//! How uncertain one developed channel value is.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::image::ChannelImage;

/// Variance of a channel value, in digital numbers (DN): dark noise, shot noise and pixel gain spread.
///
/// `Var(v) = floor² + K (v + b) + K b q + (p v)²`: the photon-transfer relation of EMVA 1288, with `K` in DN per electron, `p`
/// the photo-response non-uniformity, and `b` the level of the light of another frame that was subtracted, taken in
/// `1/q` of the exposure time. Its shot noise is in both frames; its fixed pattern cancels. What the noise of calibration frames adds, an
/// image tells of itself ([`crate::image::CalibrationNoise`]).
///
/// Each value counts as measured on its own. A bilinear demosaic averages two to four raw values into the missing
/// channels, so for one pixel of such an image the variance is an upper bound. Neighbors are correlated, so for a
/// mean over many the raw values count: see [`super::PixelMean`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelNoise {
    /// Standard deviation of a dark value, DN.
    pub floor_dn: f64,
    /// Digital numbers per electron.
    pub dn_per_electron: f64,
    /// Relative pixel gain spread (0.0229 in Table 1 of the paper); 0 where a flat field was divided out.
    pub gain_spread: f64,
    /// What rows and columns share.
    #[serde(default, skip_serializing_if = "LineNoise::is_none")]
    pub lines: LineNoise,
}

/// Noise that all pixels of a line share: it averages over the lines of a region, not over its pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LineNoise {
    /// Standard deviation of the offset of a row, DN.
    pub row_dn: f64,
    /// Standard deviation of the offset of a column, DN.
    pub column_dn: f64,
    /// Relative spread of the gains of columns.
    pub column_gain: f64,
}

impl LineNoise {
    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Variance of a mean of `mean_dn` over pixels of an image of `width` columns, DN²: `s_r² sum over rows (sum of w)²`, and the same of
    /// columns. `weights` are pixels with their weights in the mean.
    pub(super) fn variance_of_mean(
        &self,
        weights: impl Iterator<Item = (usize, f64)>,
        width: usize,
        mean_dn: f64,
    ) -> f64 {
        if self.is_none() {
            return 0.0;
        }
        let mut of_lines = [BTreeMap::new(), BTreeMap::new()];
        for (pixel, weight) in weights {
            for (lines, line) in of_lines.iter_mut().zip([pixel / width, pixel % width]) {
                *lines.entry(line).or_insert(0.0) += weight;
            }
        }
        let [rows, columns] = of_lines.map(|lines| lines.values().map(|weight| weight * weight).sum::<f64>());
        let column_dn = self.column_dn.hypot(self.column_gain * mean_dn);
        rows * self.row_dn.powi(2) + columns * column_dn.powi(2)
    }
}

impl ChannelNoise {
    /// The noise of a developed image: its own dark noise, with the conversion factor and the gain spread of its sensor.
    /// `dark_spread_dn` is the dark signal non-uniformity; it counts where no frame was subtracted that holds it, too. Lines have none.
    pub fn of_image(
        image: &ChannelImage,
        dn_per_electron: f64,
        gain_spread: f64,
        dark_spread_dn: f64,
    ) -> Self {
        let pattern = if image.subtracted.is_some() { 0.0 } else { dark_spread_dn };
        Self {
            floor_dn: image.noise_floor_dn.hypot(pattern),
            dn_per_electron,
            gain_spread,
            lines: LineNoise::default(),
        }
    }

    /// Variance of a value from which nothing was subtracted, DN². Values below zero count as dark.
    pub fn variance(&self, value_dn: f64) -> f64 {
        self.variance_over(value_dn, 0.0, 0.0)
    }

    /// Variance of a value that is left after `subtracted_dn` of an exposure `exposure_ratio` times shorter was taken off, DN².
    pub fn variance_over(&self, value_dn: f64, subtracted_dn: f64, exposure_ratio: f64) -> f64 {
        let (signal, background) = (value_dn.max(0.0), subtracted_dn.max(0.0));
        let shot = self.dn_per_electron * (signal + background * (1.0 + exposure_ratio));
        self.floor_dn.powi(2) + shot + (self.gain_spread * signal).powi(2)
    }

    /// Variances of some channels of a pixel of an image, DN², with what calibration frames add.
    pub fn of_pixel<const N: usize>(
        &self,
        image: &ChannelImage,
        channels: [usize; N],
        pixel: usize,
    ) -> [f64; N] {
        channels.map(|channel| {
            let value = f64::from(image.data[pixel * image.channels.len() + channel]);
            self.of_value(image, channel, pixel) + scale_variance_dn2(image, channel, value)
        })
    }

    /// Variance of a value by what differs from pixel to pixel, DN²: the error of a channel's scale is not in it.
    pub(super) fn of_value(&self, image: &ChannelImage, channel: usize, pixel: usize) -> f64 {
        let index = pixel * image.channels.len() + channel;
        let value = f64::from(image.data[index]);
        let own = match &image.subtracted {
            None => self.variance(value),
            Some(light) => self.variance_over(value, f64::from(light.dn[index]), light.exposure_ratio),
        };
        let added = image.calibration.as_ref().map_or(0.0, |added| f64::from(added.variance_dn2[index]));
        // Interpolated in the dark, what merged exposures take off may be more than there is
        (own + added).max(LEAST_LEFT * own)
    }
}

/// Share of its variance that a value keeps at least: less than any factor of a flat field leaves.
const LEAST_LEFT: f64 = 1e-3;

/// Variance of a value, or of a mean of values, by the error of its channel's scale, DN².
pub(super) fn scale_variance_dn2(image: &ChannelImage, channel: usize, value_dn: f64) -> f64 {
    image.calibration.as_ref().map_or(0.0, |added| added.scale_variance[channel] * value_dn * value_dn)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_1_sensor_has_the_variance_worked_out_by_hand() {
        // 1000 electrons at 0.4496 DN per electron: 6.25² + 0.4496 * 449.6 + (0.0229 * 449.6)².
        let noise = ChannelNoise {
            floor_dn: 6.25,
            dn_per_electron: 0.4496,
            gain_spread: 0.0229,
            lines: LineNoise::default(),
        };
        let expected = 39.0625 + 202.140_16 + 106.004_177;
        assert!((noise.variance(449.6) - expected).abs() < 1e-3, "{}", noise.variance(449.6));
        assert_eq!(noise.variance(-3.0), 39.0625);
    }

    #[test]
    fn subtracted_light_leaves_its_shot_noise() {
        // 100 DN over 1000 DN of ambient light, both frames with the same exposure and 6.25 DN of dark noise.
        let noise = ChannelNoise {
            floor_dn: 6.25 * 2f64.sqrt(),
            dn_per_electron: 0.455,
            gain_spread: 0.0229,
            lines: LineNoise::default(),
        };
        let expected = 2.0 * 39.0625 + 0.455 * (1100.0 + 1000.0) + (2.29f64).powi(2);
        assert!((noise.variance_over(100.0, 1000.0, 1.0) - expected).abs() < 1e-9);
    }
}
