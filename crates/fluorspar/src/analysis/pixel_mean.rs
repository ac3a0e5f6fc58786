//! The mean of a region, and how certain the sensor's noise leaves it.

use nalgebra::{DMatrix, DVector};
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
    /// Covariance of the means by what lines share, DN².
    pub lines_dn2: DMatrix<f64>,
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
        let of_channel = |&channel: &usize| {
            let weights = raw_weights(image, channel, pixels);
            let own = variance_of_mean(image, channel, &weights, noise);
            (own + scale_variance_dn2(image, channel, mean(channel)), weights)
        };
        let (own, weights): (Vec<f64>, Vec<_>) = channels.par_iter().map(of_channel).unzip();
        let lines_dn2 = noise.lines.covariance(image, channels, &weights, &dn);
        let variance_dn2 = own.iter().zip(&lines_dn2.diagonal()).map(|(own, lines)| own + lines).collect();
        (!pixels.is_empty()).then_some(Self { dn, variance_dn2, lines_dn2 })
    }

    /// Covariance of the means, DN².
    #[must_use]
    pub fn covariance_dn2(&self) -> DMatrix<f64> {
        let mut covariance = self.lines_dn2.clone();
        covariance.set_diagonal(&DVector::from_column_slice(&self.variance_dn2));
        covariance
    }
}

/// Raw pixels with their weights in the mean of a channel over pixels; the pixels themselves where interpolation is not known.
pub(super) fn raw_weights(image: &ChannelImage, channel: usize, pixels: &[usize]) -> Vec<(usize, f64)> {
    match &image.interpolation {
        Some(taps) => taps.weights_of_mean(pixels, channel, [image.width, image.height]),
        None => pixels.iter().map(|&pixel| (pixel, 1.0 / pixels.len() as f64)).collect(),
    }
}

/// Variance of the mean with these weights by what differs from pixel to pixel.
fn variance_of_mean(
    image: &ChannelImage,
    channel: usize,
    weights: &[(usize, f64)],
    noise: &ChannelNoise,
) -> f64 {
    let Some(taps) = &image.interpolation else {
        let n = weights.len() as f64;
        let sum: f64 = weights.iter().map(|(pixel, _)| noise.of_value(image, channel, *pixel)).sum();
        return sum / (n * (n * image.shares[channel]).max(1.0));
    };
    // A pixel keeps the value of the channel that it measured.
    let variance = |raw: usize| noise.of_value(image, taps.channel_of(raw, image.width), raw);
    weights.iter().map(|&(raw, weight)| weight * weight * variance(raw)).sum()
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
    let mean = rgb_mean(image, pixels, noise, reflected)?;
    Ok(mean.map(|mean| [[0, 1, 2].map(|c| mean.dn[c]), [0, 1, 2].map(|c| mean.variance_dn2[c])]))
}

/// The same with what lines share.
pub(super) fn rgb_mean(
    image: &ChannelImage,
    pixels: &[usize],
    noise: &ChannelNoise,
    reflected: Option<&ChannelImage>,
) -> Result<Option<PixelMean>, MissingChannel> {
    let Some(mut mean) = PixelMean::new(image, &rgb_channels(image)?, pixels, noise) else { return Ok(None) };
    if let Some(reflected) = reflected {
        let leak = PixelMean::new(reflected, &rgb_channels(reflected)?, pixels, noise);
        let leak = leak.into_iter().flat_map(|leak| leak.dn);
        mean.dn.iter_mut().zip(leak).for_each(|(dn, leak)| *dn -= leak);
    }
    Ok(Some(mean))
}
