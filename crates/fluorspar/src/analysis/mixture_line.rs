//! The line that mixtures of bulk and porphyrin fluorescence follow in sensor chromaticity, and where on it a pixel lies.

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{
    Analyte, ChannelNoise, MissingChannel, PixelSelection, chromaticity_covariance, rgb_channels,
    sensor_chromaticity,
};
use crate::image::ChannelImage;
use crate::sampling::Z_95;
use crate::spectral::{GridMismatch, QuantumEfficiency, Radiance, Spectrum};

/// Standard deviations of the blank at which a signal is detected with errors of 5 % either way: `2 * 1.645` (Currie, Anal. Chem.
/// 40, 586, 1968).
pub const DETECTION_Z: f64 = 3.29;

/// Channel values that a spectral radiance gives, up to the factor of exposure and optics that all channels share:
/// `sum L lambda/(hc) QE_c dlambda`. Photons are counted here, as the sensor does.
///
/// # Errors
/// When a quantum efficiency is on another grid than the radiance.
pub fn channel_response(
    radiance: &Spectrum<Radiance>,
    quantum_efficiency: [&Spectrum<QuantumEfficiency>; 3],
) -> Result<[f64; 3], GridMismatch> {
    let photons = radiance.to_photons();
    let mut response = [0.0; 3];
    for (channel, efficiency) in response.iter_mut().zip(quantum_efficiency) {
        let product: Spectrum<QuantumEfficiency> = efficiency.zip(radiance, |qe, _| qe)?;
        *channel = product
            .values()
            .iter()
            .zip(&photons)
            .enumerate()
            .map(|(bin, (qe, photons))| qe * photons * radiance.grid().width_nm(bin))
            .sum();
    }
    Ok(response)
}

/// Response of the three channels to a single fluorophore.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FluorophoreResponse {
    /// Name.
    pub name: String,
    /// R, G, B per unit amount, in any unit that all fluorophores share.
    pub rgb_per_amount: [f64; 3],
}

impl FluorophoreResponse {
    /// Sensor chromaticity of this fluorophore alone.
    pub fn chromaticity(&self) -> Option<[f64; 2]> {
        sensor_chromaticity(self.rgb_per_amount)
    }
}

/// Why two responses make no line.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MixtureError {
    /// One end gives no light in the channels.
    #[error(
        "the {end} response R, G, B = {rgb:?} has no positive sum, so it has no chromaticity; is its emission outside the \
         filter's pass band, or its weight zero?"
    )]
    Dark {
        /// Which end.
        end: MixtureEnd,
        /// The response.
        rgb: [f64; 3],
    },
    /// Nothing forms the bulk.
    #[error(
        "no fluorophore is named as the bulk of the tissue, so there is no line; name a region or a material that holds \
         some, or give their concentrations in analysis.bulk"
    )]
    NoBulk,
    /// Both ends have the same chromaticity.
    #[error(
        "bulk and {analyte} have the same sensor chromaticity ({r:.4}, {g:.4}) through these filters and this sensor; \
         mixtures cannot be distinguished; change the filters or the sensor"
    )]
    SameChromaticity {
        /// What is told from the bulk.
        analyte: Analyte,
        /// r of both.
        r: f64,
        /// g of both.
        g: f64,
    },
    /// A fluorophore that is not among the responses.
    #[error("there is no response for the fluorophore \"{name}\", only for: {}", .available.join(", "))]
    UnknownFluorophore {
        /// The name.
        name: String,
        /// All names.
        available: Vec<String>,
    },
}

/// An end of the line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MixtureEnd {
    /// The bulk of the tissue.
    Bulk,
    /// The fluorophore whose share is estimated.
    Analyte(Analyte),
}

impl fmt::Display for MixtureEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bulk => f.write_str("bulk"),
            Self::Analyte(analyte) => analyte.fmt(f),
        }
    }
}

impl MixtureError {
    /// The same error of the line to another fluorophore than the porphyrin.
    #[must_use]
    pub fn of(self, analyte: &Analyte) -> Self {
        match self {
            Self::Dark { end: MixtureEnd::Analyte(_), rgb } => {
                Self::Dark { end: MixtureEnd::Analyte(analyte.clone()), rgb }
            }
            Self::SameChromaticity { r, g, .. } => Self::SameChromaticity { analyte: analyte.clone(), r, g },
            other => other,
        }
    }
}

/// Mixtures `a_b B + a_p P` of a bulk response `B` and a porphyrin response `P`.
///
/// All mixtures lie on the straight line between the two chromaticities (Sec. 4.1 of Lyu et al. 2021). At a fraction `s`
/// of the way from bulk to porphyrin, the amounts obey `a_p / (a_b + a_p) = s k_b / (s k_b + (1 - s) k_p)`, where
/// `k = R + G + B` per unit amount: the brighter end pulls harder.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MixtureLine {
    bulk_rgb: [f64; 3],
    porphyrin_rgb: [f64; 3],
    bulk: [f64; 2],
    porphyrin: [f64; 2],
}

/// Where a pixel lies along the bulk-porphyrin line. Intervals hold 95 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LineEstimate {
    /// Position of the nearest point of the line: 0 at bulk, 1 at porphyrin; may lie outside. It is the share of the electrons
    /// in R, G and B that come from the porphyrin.
    pub position: f64,
    /// Standard error of the position.
    pub position_standard_error: f64,
    /// `a_p / (a_b + a_p)` at that position, 0 to 1.
    pub fraction: f64,
    /// Standard error of the fraction.
    pub fraction_standard_error: f64,
    /// 95 % interval of the fraction by the sensor's noise: around `fraction`, so that it keeps its width where the position lies
    /// outside, limited to the line.
    pub fraction_interval: [f64; 2],
    /// Whether the position lay outside 0 to 1 and was moved to the nearer end.
    pub clamped: bool,
    /// Signed distance from the line in chromaticity; positive on the side of larger r + g.
    pub distance: f64,
    /// Standard error of that distance.
    pub distance_standard_error: f64,
}

impl LineEstimate {
    /// 95 % interval of the position by the sensor's noise; it may reach beyond 0 and 1, as the position may.
    #[must_use]
    pub fn position_interval(&self) -> [f64; 2] {
        [-1.0, 1.0].map(|sign| self.position + sign * Z_95 * self.position_standard_error)
    }

    /// Whether the pixel lies farther off the line than noise explains: more than three standard errors, as 0.3 % do by
    /// chance. Something else is in its light then, for instance a highlight, and its fraction means little.
    pub fn is_off_line(&self) -> bool {
        self.distance.abs() > 3.0 * self.distance_standard_error
    }
}

impl MixtureLine {
    /// The line between two responses, R, G, B per unit amount.
    ///
    /// # Errors
    /// When an end is dark or both have the same chromaticity.
    pub fn new(bulk_rgb: [f64; 3], porphyrin_rgb: [f64; 3]) -> Result<Self, MixtureError> {
        let end = |end: MixtureEnd, rgb| sensor_chromaticity(rgb).ok_or(MixtureError::Dark { end, rgb });
        let bulk = end(MixtureEnd::Bulk, bulk_rgb)?;
        let porphyrin = end(MixtureEnd::Analyte(Analyte::default()), porphyrin_rgb)?;
        if (bulk[0] - porphyrin[0]).hypot(bulk[1] - porphyrin[1]) < 1e-6 {
            let analyte = Analyte::default();
            return Err(MixtureError::SameChromaticity { analyte, r: bulk[0], g: bulk[1] });
        }
        Ok(Self { bulk_rgb, porphyrin_rgb, bulk, porphyrin })
    }

    /// The line between the weighted sum of some fluorophores and another one. One unit of bulk is the sum with these weights.
    ///
    /// # Errors
    /// When nothing forms the bulk, a name has no response, an end is dark or both have the same chromaticity.
    pub fn from_fluorophores(
        responses: &[FluorophoreResponse],
        bulk_weights: &[(String, f64)],
        porphyrin: &str,
    ) -> Result<Self, MixtureError> {
        let find = |name: &str| {
            responses.iter().find(|response| response.name == name).map(|r| r.rgb_per_amount).ok_or_else(
                || MixtureError::UnknownFluorophore {
                    name: name.to_owned(),
                    available: responses.iter().map(|response| response.name.clone()).collect(),
                },
            )
        };
        if bulk_weights.iter().all(|(_, weight)| *weight == 0.0) {
            return Err(MixtureError::NoBulk);
        }
        let mut bulk = [0.0; 3];
        for (name, weight) in bulk_weights {
            for (sum, value) in bulk.iter_mut().zip(find(name)?) {
                *sum += weight * value;
            }
        }
        Self::new(bulk, find(porphyrin)?)
    }

    /// The same line between ends of other colors, each as bright as before: R + G + B per unit amount stays.
    ///
    /// # Errors
    /// When an end is dark or both have the same chromaticity.
    pub fn with_colors(&self, bulk_rgb: [f64; 3], porphyrin_rgb: [f64; 3]) -> Result<Self, MixtureError> {
        let scaled = |color: [f64; 3], bright: [f64; 3]| {
            let factor = bright.iter().sum::<f64>() / color.iter().sum::<f64>();
            if factor.is_finite() { color.map(|value| factor * value) } else { color }
        };
        Self::new(scaled(bulk_rgb, self.bulk_rgb), scaled(porphyrin_rgb, self.porphyrin_rgb))
    }

    /// `(r, g)` of bulk alone.
    pub fn bulk_point(&self) -> [f64; 2] {
        self.bulk
    }

    /// `(r, g)` of porphyrin alone.
    pub fn porphyrin_point(&self) -> [f64; 2] {
        self.porphyrin
    }

    /// Distance between the two ends in chromaticity: what separates them.
    pub fn length(&self) -> f64 {
        (self.porphyrin[0] - self.bulk[0]).hypot(self.porphyrin[1] - self.bulk[1])
    }

    /// R, G, B of given amounts.
    pub fn rgb(&self, bulk_amount: f64, porphyrin_amount: f64) -> [f64; 3] {
        std::array::from_fn(|c| bulk_amount * self.bulk_rgb[c] + porphyrin_amount * self.porphyrin_rgb[c])
    }

    /// `a_p / (a_b + a_p)` at a position between 0 and 1 on the line, and its slope.
    pub(super) fn fraction(&self, position: f64) -> (f64, f64) {
        let k_bulk: f64 = self.bulk_rgb.iter().sum();
        let k_porphyrin: f64 = self.porphyrin_rgb.iter().sum();
        let denominator = position * k_bulk + (1.0 - position) * k_porphyrin;
        (position * k_bulk / denominator, k_bulk * k_porphyrin / denominator.powi(2))
    }

    /// Projects a pixel's chromaticity onto the line. `None` where the pixel has no chromaticity.
    ///
    /// `variance` is that of R, G and B, independent of each other; reflected light, if known, must have been subtracted. Errors are of
    /// first order in the noise.
    pub fn project(&self, rgb: [f64; 3], variance: [f64; 3]) -> Option<LineEstimate> {
        self.project_shared(rgb, variance, [[0.0; 3]; 3])
    }

    /// [`Self::project`] with a covariance of R, G and B on top, of noise that they share.
    pub fn project_shared(
        &self,
        rgb: [f64; 3],
        variance: [f64; 3],
        mut shared: [[f64; 3]; 3],
    ) -> Option<LineEstimate> {
        let point = sensor_chromaticity(rgb)?;
        (0..3).for_each(|c| shared[c][c] += variance[c]);
        let covariance = chromaticity_covariance(rgb, shared)?;
        let length = self.length();
        let along = [0, 1].map(|i| (self.porphyrin[i] - self.bulk[i]) / length);
        let across = if along[0] >= along[1] { [-along[1], along[0]] } else { [along[1], -along[0]] };
        let offset = [point[0] - self.bulk[0], point[1] - self.bulk[1]];
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        let spread =
            |direction: [f64; 2]| dot(direction, covariance.map(|row| dot(row, direction))).max(0.0).sqrt();

        let position = dot(offset, along) / length;
        let position_standard_error = spread(along) / length;
        let on_line = position.clamp(0.0, 1.0);
        let (fraction, slope) = self.fraction(on_line);
        let ends = interval_on_line(position, position_standard_error);
        Some(LineEstimate {
            position,
            position_standard_error,
            fraction,
            fraction_standard_error: slope * position_standard_error,
            fraction_interval: ends.map(|end| self.fraction(end).0),
            clamped: on_line != position,
            distance: dot(offset, across),
            distance_standard_error: spread(across),
        })
    }
}

/// 95 % interval of a position that lies between 0 and 1, from a measured one with normal noise, which may lie beyond.
///
/// It is taken around the nearest position on the line: one measured below 0 says that the true one is small, not that it is known.
/// Were the interval cut off instead, it would shrink to nothing there. The truth `t` is missed only where the measured position is
/// more than 1.96 standard errors from it, so that the interval holds it in 95 % of cases or more.
fn interval_on_line(position: f64, standard_error: f64) -> [f64; 2] {
    let nearest = position.clamp(0.0, 1.0);
    [-1.0, 1.0].map(|sign| (nearest + sign * Z_95 * standard_error).clamp(0.0, 1.0))
}

/// Porphyrin fraction of each pixel, `[row, col]`.
#[derive(Clone, Debug, PartialEq)]
pub struct PorphyrinMap {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Pixels with their estimates, by pixel; there is none outside the region and where there is no chromaticity.
    pub estimates: Vec<(usize, LineEstimate)>,
    /// The line on which they lie.
    pub line: MixtureLine,
}

/// Numbers of each pixel of a region, `[row, col]`. Not a number outside of the region, without a chromaticity, and off the line, where
/// a share is an artifact.
#[derive(Clone, Debug, PartialEq)]
pub struct PorphyrinLayers {
    /// Share of the porphyrin in the light on the mixture line, [`LineEstimate::position`]: below 0 and above 1 where noise moves it there.
    pub share: Vec<f32>,
    /// Lower end of its 95 % interval by the sensor's noise.
    pub low: Vec<f32>,
    /// Upper end.
    pub high: Vec<f32>,
    /// Detection limit: the share that this pixel's noise mistakes for none, and none for it, in 5 % of cases.
    pub detection_limit: Vec<f32>,
}

impl PorphyrinMap {
    /// Projects each valid pixel of a region onto the line.
    ///
    /// `reflected` is known reflected light in the same channels and DN as the image (for instance the noise-free image of the
    /// reflected component); it is subtracted first. The noise stays that of the whole value.
    ///
    /// # Errors
    /// When an image lacks one of the channels R, G, B.
    pub fn new(
        image: &ChannelImage,
        valid: impl Fn(usize) -> bool,
        region: &PixelSelection,
        line: &MixtureLine,
        noise: &ChannelNoise,
        reflected: Option<&ChannelImage>,
    ) -> Result<Self, MissingChannel> {
        let channels = rgb_channels(image)?;
        let reflected =
            reflected.map(|leak| rgb_channels(leak).map(|channels| (leak, channels))).transpose()?;
        let mut estimates = Vec::with_capacity(region.pixels.len());
        for &pixel in region.pixels.iter().filter(|&&pixel| valid(pixel)) {
            let rgb = pixel_rgb(image, channels, pixel);
            let fluorescence = match reflected {
                Some((leak, leak_channels)) => {
                    let leak = pixel_rgb(leak, leak_channels, pixel);
                    std::array::from_fn(|c| rgb[c] - leak[c])
                }
                None => rgb,
            };
            let estimate = line.project(fluorescence, noise.of_pixel(image, channels, pixel));
            estimates.extend(estimate.map(|estimate| (pixel, estimate)));
        }
        estimates.sort_by_key(|(pixel, _)| *pixel);
        Ok(Self { width: image.width, height: image.height, estimates, line: *line })
    }

    /// The estimate of a pixel.
    pub fn at(&self, pixel: usize) -> Option<LineEstimate> {
        let found = self.estimates.binary_search_by_key(&pixel, |(pixel, _)| *pixel).ok()?;
        Some(self.estimates[found].1)
    }

    /// The numbers of all pixels, one list each.
    #[must_use]
    pub fn layers(&self) -> PorphyrinLayers {
        let of = |value: &dyn Fn(&LineEstimate) -> f64| -> Vec<f32> {
            let mut values = vec![f32::NAN; self.width * self.height];
            for (pixel, estimate) in self.estimates.iter().filter(|(_, e)| !e.is_off_line()) {
                values[*pixel] = value(estimate) as f32;
            }
            values
        };
        PorphyrinLayers {
            share: of(&|e| e.position),
            low: of(&|e| e.position_interval()[0]),
            high: of(&|e| e.position_interval()[1]),
            detection_limit: of(&|e| DETECTION_Z * e.position_standard_error),
        }
    }

    /// Fractions, `[row, col]`, for an image, without pixels off the line, whose fraction is an artifact: rims of highlights, for instance.
    pub fn fractions_on_line(&self) -> Vec<Option<f32>> {
        let mut fractions = vec![None; self.width * self.height];
        for (pixel, estimate) in self.estimates.iter().filter(|(_, e)| !e.is_off_line()) {
            fractions[*pixel] = Some(estimate.fraction as f32);
        }
        fractions
    }
}

fn pixel_rgb(image: &ChannelImage, channels: [usize; 3], pixel: usize) -> [f64; 3] {
    let n = image.channels.len();
    channels.map(|channel| f64::from(image.data[pixel * n + channel]))
}

#[cfg(test)]
mod tests;
