//! How uncertain one developed channel value is.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
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
    /// Standard deviation of a dark value by what no line shares, DN.
    pub floor_dn: f64,
    /// Digital numbers per electron.
    pub dn_per_electron: f64,
    /// Relative pixel gain spread (0.0229 in Table 1 of the paper); 0 where a flat field was divided out.
    pub gain_spread: f64,
    /// What rows and columns share.
    #[serde(default, skip_serializing_if = "LineNoise::is_none")]
    pub lines: LineNoise,
}

/// Noise that all pixels of a line share, of all channels: it averages over the lines of a region, not over its pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LineNoise {
    /// Standard deviation of what a row adds to one frame, DN.
    pub row_dn: f64,
    /// The same of a column.
    pub column_dn: f64,
    /// The same of what rows and columns add to all frames.
    #[serde(default)]
    pub fixed_dn: [f64; 2],
    /// Relative spread of the gains of columns.
    pub column_gain: f64,
}

impl LineNoise {
    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Variance of one value, DN².
    fn of_value(&self, value_dn: f64) -> f64 {
        let [row_dn, column_dn] = self.fixed_dn;
        let squares = [self.row_dn, self.column_dn, row_dn, column_dn, self.column_gain * value_dn];
        squares.iter().map(|dn| dn * dn).sum()
    }

    /// Covariance of sums over values of some channels, by their numbers, DN²: `s_r² sum over rows W_c W_d` with the sum `W_c` of a channel's
    /// weights in a row, and the same of columns, of gains times the levels. `weights` are raw pixels with their weights, by channel.
    pub(super) fn covariance(
        &self,
        image: &ChannelImage,
        channels: &[usize],
        weights: &[Vec<(usize, f64)>],
        level_dn: &[f64],
    ) -> DMatrix<f64> {
        let n = channels.len();
        let mut covariance = DMatrix::zeros(n, n);
        if self.is_none() {
            return covariance;
        }
        let level = DVector::from_column_slice(level_dn);
        let of_rows = [self.row_dn, self.fixed_dn[0], 0.0];
        for (is_row, scales) in
            [(true, of_rows), (false, [self.column_dn, self.fixed_dn[1], self.column_gain])]
        {
            let mut lines: BTreeMap<usize, [DVector<f64>; 2]> = BTreeMap::new();
            for (c, weights) in weights.iter().enumerate() {
                for &(pixel, weight) in weights {
                    let line = if is_row { pixel / image.width } else { pixel % image.width };
                    let sums = lines.entry(line).or_insert_with(|| [DVector::zeros(n), DVector::zeros(n)]);
                    sums[0][c] += weight * line_variance(image, channels[c], pixel).sqrt();
                    sums[1][c] += weight;
                }
            }
            for [changing, fixed] in lines.into_values() {
                let signal = fixed.component_mul(&level);
                for (scale, sums) in scales.iter().zip([changing, fixed, signal]) {
                    covariance.ger(scale * scale, &sums, &sums, 1.0);
                }
            }
        }
        covariance
    }
}

/// Variance of what changes from frame to frame of a line in a raw value, over that without calibration frames and other exposures.
fn line_variance(image: &ChannelImage, channel: usize, pixel: usize) -> f64 {
    let Some(calibration) = &image.calibration else { return 1.0 };
    let value = if image.interpolation.is_some() { pixel } else { pixel * image.channels.len() + channel };
    calibration.line_variance.get(value).map_or(1.0, |variance| f64::from(*variance))
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
        self.variance_over(value_dn, 0.0, 0.0) + self.lines.of_value(value_dn)
    }

    /// Variance of a value that is left after `subtracted_dn` of an exposure `exposure_ratio` times shorter was taken off, DN², without what
    /// lines share.
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
            let of_pixel = self.of_value(image, channel, pixel) + self.lines.of_value(value);
            of_pixel + scale_variance_dn2(image, channel, value)
        })
    }

    /// Variance of a value by what differs from pixel to pixel, DN²: neither lines nor the error of a channel's scale are in it.
    pub(super) fn of_value(&self, image: &ChannelImage, channel: usize, pixel: usize) -> f64 {
        let index = pixel * image.channels.len() + channel;
        let value = f64::from(image.data[index]);
        let own = match &image.subtracted {
            None => self.variance_over(value, 0.0, 0.0),
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
