//! The mean of a region, and how certain the sensor's noise leaves it.

use rayon::prelude::*;

use super::channel_noise::{ChannelNoise, scale_variance_dn2};
use super::chromaticity::{MissingChannel, rgb_channels};
use crate::image::ChannelImage;

/// Mean of some channels over pixels and the variance of that mean by the sensor's noise.
#[derive(Clone, Debug, PartialEq)]
pub struct PixelMean {
    /// Mean of each channel, DN.
    pub dn: Vec<f64>,
    /// Variance of each mean, DN².
    pub variance_dn2: Vec<f64>,
}

impl PixelMean {
    /// Means of channels, by their numbers; `None` without pixels.
    ///
    /// Interpolated values share raw ones. The mean is `sum over raw pixels of w_j v_j` with the weights that interpolation gives
    /// them, raw values are independent, so its variance is `sum of w_j² Var(v_j)`: exact at rims of regions and for single pixels. What lines
    /// share comes on top ([`super::LineNoise`]).
    /// Where it is not known how the image was interpolated, `n` pixels count as `n * share` measurements
    /// ([`ChannelImage::shares`]). The error of a channel's scale, of a flat field, is common to all of them.
    #[must_use]
    pub fn new(
        image: &ChannelImage,
        channels: &[usize],
        pixels: &[usize],
        noise: &ChannelNoise,
    ) -> Option<Self> {
        let n = pixels.len() as f64;
        let value =
            |channel: usize, pixel: usize| f64::from(image.data[pixel * image.channels.len() + channel]);
        let mean = |channel: usize| pixels.iter().map(|&pixel| value(channel, pixel)).sum::<f64>() / n;
        let dn: Vec<f64> = channels.iter().map(|&channel| mean(channel)).collect();
        let variance = |&channel: &usize| {
            variance_of_mean(image, channel, pixels, noise, mean(channel))
                + scale_variance_dn2(image, channel, mean(channel))
        };
        let variance_dn2 = channels.par_iter().map(variance).collect();
        (!pixels.is_empty()).then_some(Self { dn, variance_dn2 })
    }
}

fn variance_of_mean(
    image: &ChannelImage,
    channel: usize,
    pixels: &[usize],
    noise: &ChannelNoise,
    mean_dn: f64,
) -> f64 {
    let variance = |channel: usize, pixel: usize| noise.of_value(image, channel, pixel);
    let (lines, width) = (&noise.lines, image.width);
    let Some(taps) = &image.interpolation else {
        let n = pixels.len() as f64;
        let sum: f64 = pixels.iter().map(|&pixel| variance(channel, pixel)).sum();
        let of_lines = lines.variance_of_mean(pixels.iter().map(|&pixel| (pixel, 1.0 / n)), width, mean_dn);
        return sum / (n * (n * image.shares[channel]).max(1.0)) + of_lines;
    };
    // A pixel keeps the value of the channel that it measured.
    let weights = taps.weights_of_mean(pixels, channel, [image.width, image.height]);
    let of_lines = lines.variance_of_mean(weights.iter().copied(), width, mean_dn);
    let raw = |(raw, weight): (usize, f64)| weight * weight * variance(taps.channel_of(raw, width), raw);
    weights.into_iter().map(raw).sum::<f64>() + of_lines
}

/// Mean R, G, B of some pixels and the variance of that mean by the sensor's noise, DN and DN². `reflected` is subtracted; `None`
/// without pixels.
///
/// # Errors
/// An image without R, G or B.
pub fn mean_of_pixels(
    image: &ChannelImage,
    pixels: &[usize],
    noise: &ChannelNoise,
    reflected: Option<&ChannelImage>,
) -> Result<Option<[[f64; 3]; 2]>, MissingChannel> {
    let channels = rgb_channels(image)?;
    let Some(mean) = PixelMean::new(image, &channels, pixels, noise) else { return Ok(None) };
    let mut leak = [0.0; 3];
    if let Some(reflected) = reflected {
        let channels = rgb_channels(reflected)?;
        if let Some(mean) = PixelMean::new(reflected, &channels, pixels, noise) {
            leak.copy_from_slice(&mean.dn);
        }
    }
    Ok(Some([[0, 1, 2].map(|c| mean.dn[c] - leak[c]), [0, 1, 2].map(|c| mean.variance_dn2[c])]))
}
