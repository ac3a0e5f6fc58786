//! Sensor chromaticity: what is left of a color when the amount of light is divided out.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::image::ChannelImage;

/// Least sum of the three channels, in standard deviations of that sum in the dark, for which a chromaticity is given.
///
/// At five, the denominator of Eq. (7) is known to 20 % from dark noise alone, and the bias of a ratio of noisy numbers, `1/k²`
/// of its value, stays at 4 %.
pub const DEFAULT_NOISE_THRESHOLD: f64 = 5.0;

/// Sensor chromaticity `(r, g)` of linear, black-subtracted R, G, B.
///
/// `r = R / (R + G + B)`, `g = G / (R + G + B)`: Eq. (7) of Lyu et al., Biomed. Opt. Express 12(7), 4276-4292 (2021).
/// Independent of the absolute light level and fluorophore concentration. `None` where the sum is not positive.
pub fn sensor_chromaticity([r, g, b]: [f64; 3]) -> Option<[f64; 2]> {
    let sum = r + g + b;
    (sum > 0.0 && sum.is_finite()).then(|| [r / sum, g / sum])
}

/// Covariance matrix of `(r, g)` to first order in the noise, from that of the channels.
///
/// `dr/dR = (1 - r)/S`, `dr/dG = dr/dB = -r/S` with `S = R + G + B`, and the same with `g`. Good where the noise of
/// the sum is small compared with the sum.
pub fn chromaticity_covariance(rgb: [f64; 3], covariance: [[f64; 3]; 3]) -> Option<[[f64; 2]; 2]> {
    let [r, g] = sensor_chromaticity(rgb)?;
    let inverse_square = rgb.iter().sum::<f64>().powi(-2);
    let by_r = [1.0 - r, -r, -r];
    let by_g = [-g, 1.0 - g, -g];
    let product = |a: [f64; 3], b: [f64; 3]| -> f64 {
        let of_row = |row: usize| (0..3).map(|col| a[row] * b[col] * covariance[row][col]).sum::<f64>();
        (0..3).map(of_row).sum::<f64>() * inverse_square
    };
    let cross = product(by_r, by_g);
    Some([[product(by_r, by_r), cross], [cross, product(by_g, by_g)]])
}

/// Whether a pixel has a chromaticity, and if not, why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PixelValidity {
    /// It has one.
    Valid,
    /// A raw value that entered was saturated: the ratio is wrong by an unknown amount.
    Saturated,
    /// The sum of the channels is not positive.
    Undefined,
    /// The sum of the channels is positive but lost in dark noise.
    BelowNoiseFloor,
}

/// Counts of pixels with a chromaticity, and of those without, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExclusionCounts {
    /// Pixels with a chromaticity.
    pub valid: usize,
    /// Pixels left out because a raw value was saturated.
    pub saturated: usize,
    /// Pixels left out because the sum of the channels is not positive.
    pub undefined: usize,
    /// Pixels left out because the sum of the channels is lost in dark noise.
    pub below_noise_floor: usize,
}

impl ExclusionCounts {
    /// Counts validities.
    pub fn count(validities: impl IntoIterator<Item = PixelValidity>) -> Self {
        let mut counts = Self::default();
        for validity in validities {
            *match validity {
                PixelValidity::Valid => &mut counts.valid,
                PixelValidity::Saturated => &mut counts.saturated,
                PixelValidity::Undefined => &mut counts.undefined,
                PixelValidity::BelowNoiseFloor => &mut counts.below_noise_floor,
            } += 1;
        }
        counts
    }

    /// All pixels of the region.
    pub fn total(&self) -> usize {
        self.valid + self.excluded()
    }

    /// Share of the pixels that are saturated, where they are more than one in a hundred, which is more than hot pixels and highlights
    /// explain: statistics of the others are then those of the dim part of the region.
    pub fn saturated_share(&self) -> Option<f64> {
        (self.saturated * 100 > self.total()).then(|| self.saturated as f64 / self.total() as f64)
    }

    /// All pixels left out.
    pub fn excluded(&self) -> usize {
        self.saturated + self.undefined + self.below_noise_floor
    }
}

/// A channel that the image does not have.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error(
    "the image \"{image}\" has no channel \"{wanted}\", only {}; sensor chromaticity needs R, G and B", list(.available)
)]
pub struct MissingChannel {
    /// Name of the frame.
    pub image: String,
    /// The channel looked for.
    pub wanted: String,
    /// The channels there are.
    pub available: Vec<String>,
}

fn list(names: &[String]) -> String {
    names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ")
}

/// Indices of R, G and B among the channels of an image; upper and lower case count the same.
///
/// # Errors
/// When one of them is missing.
pub fn rgb_channels(image: &ChannelImage) -> Result<[usize; 3], MissingChannel> {
    let find = |wanted: &str| {
        image.channels.iter().position(|name| name.eq_ignore_ascii_case(wanted)).ok_or_else(|| {
            MissingChannel {
                image: image.label.clone(),
                wanted: wanted.to_owned(),
                available: image.channels.clone(),
            }
        })
    };
    Ok([find("R")?, find("G")?, find("B")?])
}

/// Sensor chromaticity of every pixel of an image, `[row, col]`.
#[derive(Clone, Debug, PartialEq)]
pub struct ChromaticityMap {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `(r, g)`; zero where the pixel has none, empty where the image has no R, G and B.
    pub chromaticity: Vec<[f32; 2]>,
    /// Whether the pixel has a chromaticity, or in an image without R, G and B light in the sum of its channels.
    pub validity: Vec<PixelValidity>,
    /// Least sum of the channels, DN, that counted as light.
    pub least_sum_dn: f64,
}

impl ChromaticityMap {
    /// Sensor chromaticity of every pixel that is unsaturated and whose channel sum is positive and reaches
    /// `noise_threshold * sqrt(3) * noise_floor_dn`: so many standard deviations of the sum of three dark values.
    ///
    /// # Errors
    /// When the image lacks one of the channels R, G, B.
    pub fn new(image: &ChannelImage, noise_threshold: f64) -> Result<Self, MissingChannel> {
        let channels = rgb_channels(image)?;
        let least_sum_dn = noise_threshold * 3f64.sqrt() * image.noise_floor_dn;
        let pixels = image.width * image.height;
        let mut map = Self {
            width: image.width,
            height: image.height,
            chromaticity: Vec::with_capacity(pixels),
            validity: Vec::with_capacity(pixels),
            least_sum_dn,
        };
        for (pixel, &saturated) in image.data.chunks_exact(image.channels.len()).zip(&image.saturated) {
            let rgb = channels.map(|channel| f64::from(pixel[channel]));
            let (validity, chromaticity) = match sensor_chromaticity(rgb) {
                _ if saturated => (PixelValidity::Saturated, [0.0; 2]),
                None => (PixelValidity::Undefined, [0.0; 2]),
                Some(_) if rgb.iter().sum::<f64>() < least_sum_dn => {
                    (PixelValidity::BelowNoiseFloor, [0.0; 2])
                }
                Some(rg) => (PixelValidity::Valid, rg.map(|v| v as f32)),
            };
            map.validity.push(validity);
            map.chromaticity.push(chromaticity);
        }
        Ok(map)
    }

    /// The same of any image: of one without R, G and B, whether the sum of its channels is light, and no chromaticity.
    #[must_use]
    pub fn of(image: &ChannelImage, noise_threshold: f64) -> Self {
        if let Ok(map) = Self::new(image, noise_threshold) {
            return map;
        }
        let channels = image.channels.len().max(1);
        let least_sum_dn = noise_threshold * (channels as f64).sqrt() * image.noise_floor_dn;
        let validity_of = |(pixel, &saturated): (&[f32], &bool)| {
            let sum: f64 = pixel.iter().map(|&value| f64::from(value)).sum();
            match sum {
                _ if saturated => PixelValidity::Saturated,
                sum if sum.is_nan() || sum <= 0.0 => PixelValidity::Undefined,
                sum if sum < least_sum_dn => PixelValidity::BelowNoiseFloor,
                _ => PixelValidity::Valid,
            }
        };
        Self {
            width: image.width,
            height: image.height,
            chromaticity: Vec::new(),
            validity: image.data.chunks_exact(channels).zip(&image.saturated).map(validity_of).collect(),
            least_sum_dn,
        }
    }

    /// Chromaticity of a pixel by its number `row * width + col`, if it has one.
    pub fn at(&self, pixel: usize) -> Option<[f64; 2]> {
        let chromaticity = self.chromaticity.get(pixel)?;
        (self.validity[pixel] == PixelValidity::Valid).then(|| chromaticity.map(f64::from))
    }

    /// Pixels that count in the mean of a region, if any has a chromaticity: all but saturated ones. Were those lost in noise left out, noise
    /// would choose the brighter ones, whose mean is grayer than the light.
    pub(crate) fn measured<'a>(&'a self, pixels: &'a [usize]) -> impl Iterator<Item = usize> + 'a {
        let has_light = pixels.iter().any(|pixel| self.validity[*pixel] == PixelValidity::Valid);
        let counts = move |pixel: &usize| has_light && self.validity[*pixel] != PixelValidity::Saturated;
        pixels.iter().copied().filter(counts)
    }

    /// Counts of valid pixels of the whole image, and of the others by reason.
    pub fn counts(&self) -> ExclusionCounts {
        ExclusionCounts::count(self.validity.iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) fn image(pixels: &[[f32; 3]]) -> ChannelImage {
        ChannelImage {
            width: pixels.len(),
            height: 1,
            channels: ["R", "G", "B"].map(String::from).to_vec(),
            data: pixels.iter().flatten().copied().collect(),
            saturated: vec![false; pixels.len()],
            noise_floor_dn: 2.0,
            full_scale_dn: 4000.0,
            shares: vec![0.25, 0.5, 0.25],
            interpolation: None,
            subtracted: None,
            calibration: None,
            label: "blue".into(),
        }
    }

    #[test]
    fn chromaticity_ignores_the_amount_of_light() {
        assert_eq!(sensor_chromaticity([1.0, 2.0, 1.0]), Some([0.25, 0.5]));
        for scale in [1e-9, 0.3, 7.0, 1e9] {
            let [r, g] = sensor_chromaticity([0.2 * scale, 0.5 * scale, 0.3 * scale]).unwrap();
            assert!((r - 0.2).abs() < 1e-15 && (g - 0.5).abs() < 1e-15);
        }
    }

    #[test]
    fn chromaticity_is_undefined_without_light() {
        for dark in [[0.0; 3], [1.0, -2.0, 0.5], [f64::NAN, 1.0, 1.0], [f64::INFINITY, 1.0, 1.0]] {
            assert_eq!(sensor_chromaticity(dark), None, "{dark:?}");
        }
    }

    #[test]
    fn covariance_equals_the_numerical_derivative() {
        let rgb = [120.0, 310.0, 70.0];
        let of_channels = [[25.0, 3.0, -2.0], [3.0, 16.0, 4.0], [-2.0, 4.0, 9.0]];
        let step = 1e-4;
        let slopes = [0, 1, 2].map(|channel| {
            let (mut up, mut down) = (rgb, rgb);
            up[channel] += step;
            down[channel] -= step;
            let (up, down) = (sensor_chromaticity(up).unwrap(), sensor_chromaticity(down).unwrap());
            [0, 1].map(|i| (up[i] - down[i]) / (2.0 * step))
        });
        let covariance = chromaticity_covariance(rgb, of_channels).unwrap();
        let mut expected = [[0.0; 2]; 2];
        for i in 0..2 {
            for j in 0..2 {
                for (a, row) in of_channels.iter().enumerate() {
                    expected[i][j] += (0..3).map(|b| slopes[a][i] * slopes[b][j] * row[b]).sum::<f64>();
                }
                // Central differences are exact to step², relative 1e-12 here; rounding adds 1e-16 / step.
                assert!((covariance[i][j] / expected[i][j] - 1.0).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn every_pixel_without_a_chromaticity_has_a_reason() {
        // The threshold is 5 * sqrt(3) * 2 = 17.3 DN.
        let mut image = image(&[[10.0, 20.0, 10.0], [4000.0, 10.0, 10.0], [0.0, -1.0, 0.0], [6.0, 6.0, 5.0]]);
        image.saturated[1] = true;
        let map = ChromaticityMap::new(&image, DEFAULT_NOISE_THRESHOLD).unwrap();
        use PixelValidity::{BelowNoiseFloor, Saturated, Undefined, Valid};
        assert_eq!(map.validity, [Valid, Saturated, Undefined, BelowNoiseFloor]);
        assert_eq!(
            map.counts(),
            ExclusionCounts { valid: 1, saturated: 1, undefined: 1, below_noise_floor: 1 }
        );
        assert_eq!((map.counts().total(), map.counts().excluded()), (4, 3));
        assert_eq!(map.at(0), Some([0.25, 0.5]));
        assert_eq!(map.at(1), None);
        assert!((map.least_sum_dn - 17.320_508).abs() < 1e-6);
    }

    #[test]
    fn channels_are_found_by_name_in_any_order() {
        let mut image = image(&[[30.0, 10.0, 20.0]]);
        image.channels = ["b", "r", "g"].map(String::from).to_vec();
        assert_eq!(rgb_channels(&image), Ok([1, 2, 0]));
        let map = ChromaticityMap::new(&image, 0.0).unwrap();
        assert!((map.at(0).unwrap()[0] - 1.0 / 6.0).abs() < 1e-7);
    }

    #[test]
    fn a_monochrome_image_is_refused_with_its_channels_named() {
        let mut image = image(&[[1.0; 3]]);
        image.channels = vec!["mono".into(), "nir".into(), "x".into()];
        assert_eq!(
            ChromaticityMap::new(&image, 5.0).unwrap_err().to_string(),
            "the image \"blue\" has no channel \"R\", only \"mono\", \"nir\", \"x\"; \
             sensor chromaticity needs R, G and B"
        );
    }
}
