//! From samples of the film to pixels: spectra become electron rates, rates are integrated over pixel areas.

use std::ops::Range;

use super::SensorProblem;
use crate::image::Mosaic;

/// Size of an irradiance image on the film, mm; its center lies on the center of the sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmExtent {
    /// Width of all columns of the image, mm.
    pub width_mm: f64,
    /// Height of all rows of the image, mm.
    pub height_mm: f64,
}

impl FilmExtent {
    /// Extent of an image with square samples.
    pub fn of_width(width_mm: f64, columns: usize, rows: usize) -> Self {
        Self { width_mm, height_mm: width_mm * rows as f64 / columns as f64 }
    }

    pub(super) fn validate(&self) -> Result<(), SensorProblem> {
        for (field, value) in [("film.width_mm", self.width_mm), ("film.height_mm", self.height_mm)] {
            SensorProblem::unless_within(field, value, [1e-6, 1e7], "give mm")?;
        }
        Ok(())
    }
}

/// Samples under a pixel from which on they are boxes.
const COARSE: f64 = 0.5 + 1e-9;

/// Along one axis, the samples under each pixel and the share of the pixel that each covers.
///
/// The samples are boxes of constant value, so the mean over a pixel is exact whether pixels are larger or smaller
/// than samples. Between the middles of samples at least twice as large as a pixel values are linear: boxes would be steps in the
/// frame, which demosaicing colors. Both conserve light. A pixel outside the image has no samples and sees no light.
pub(super) struct AxisWeights {
    ranges: Vec<(Range<usize>, usize)>,
    weights: Vec<f32>,
}

impl AxisWeights {
    /// `pixels` of `pitch_mm` that collect light over `aperture_mm` in their middle, against `samples` over `extent_mm`,
    /// both centered on zero.
    pub(super) fn new(
        pixels: usize,
        pitch_mm: f64,
        aperture_mm: f64,
        samples: usize,
        extent_mm: f64,
    ) -> Self {
        let samples_per_pixel = pitch_mm * samples as f64 / extent_mm;
        let border = 0.5 * (1.0 - aperture_mm / pitch_mm);
        // An edge within rounding of a sample's edge is that edge: no slivers.
        let snap = |x: f64| if (x - x.round()).abs() < 1e-9 * samples as f64 { x.round() } else { x };
        let edge = |i: f64| snap((i - 0.5 * pixels as f64) * samples_per_pixel + 0.5 * samples as f64);
        let mut axis = Self { ranges: Vec::with_capacity(pixels), weights: Vec::new() };
        for pixel in 0..pixels {
            let (start, end) = (edge(pixel as f64 + border), edge((pixel + 1) as f64 - border));
            let (inner_start, inner_end) = (start.max(0.0), end.min(samples as f64));
            let first_weight = axis.weights.len();
            if inner_end <= inner_start {
                axis.ranges.push((0..0, first_weight));
                continue;
            }
            let share = 1.0 / (end - start);
            let range = if samples_per_pixel > COARSE {
                axis.add_boxes(inner_start..inner_end, share)
            } else {
                axis.add_linear(inner_start..inner_end, share, samples)
            };
            axis.ranges.push((range, first_weight));
        }
        axis
    }

    /// Adds the weights of boxes over a part of the axis, in samples, and gives the samples.
    fn add_boxes(&mut self, part: Range<f64>, share: f64) -> Range<usize> {
        let range = part.start.floor() as usize..part.end.ceil() as usize;
        self.weights.extend(range.clone().map(|sample| {
            let covered = part.end.min(sample as f64 + 1.0) - part.start.max(sample as f64);
            (covered * share) as f32
        }));
        range
    }

    /// As [`AxisWeights::add_boxes`] of a part no longer than a sample, with values linear between the middles of samples and constant
    /// beyond the outermost.
    fn add_linear(&mut self, part: Range<f64>, share: f64, samples: usize) -> Range<usize> {
        let held = |sample: f64| sample.clamp(0.0, samples as f64 - 1.0) as usize;
        let left = (part.start - 0.5).floor();
        let range = held(left)..held(left + 2.0) + 1;
        let mut weights = [0.0; 3];
        // Between two middles the mean is the value halfway
        for left in [left, left + 1.0] {
            let (from, to) = (part.start.max(left + 0.5), part.end.min(left + 1.5));
            if to > from {
                let (t, length) = (0.5 * (from + to) - left - 0.5, (to - from) * share);
                weights[held(left) - range.start] += (1.0 - t) * length;
                weights[held(left + 1.0) - range.start] += t * length;
            }
        }
        self.weights.extend(weights[..range.len()].iter().map(|weight| *weight as f32));
        range
    }

    /// Samples under a pixel and their weights.
    pub(super) fn of(&self, pixel: usize) -> (Range<usize>, &[f32]) {
        let (range, first) = &self.ranges[pixel];
        (range.clone(), &self.weights[*first..*first + range.len()])
    }
}

/// Sum of products in eight single-precision lanes that are joined in double precision: for 81 bands each lane adds
/// eleven terms, so the error stays below 11 * 2^-24 = 7e-7 of the sum at worst and near 1e-7 in practice.
#[inline]
pub(super) fn dot(spectrum: &[f32], weights: &[f32]) -> f64 {
    let mut lanes = [0f32; 8];
    let (spectra, weight_chunks) = (spectrum.chunks_exact(8), weights.chunks_exact(8));
    let mut rest = 0.0;
    for (value, weight) in spectra.remainder().iter().zip(weight_chunks.remainder()) {
        rest += f64::from(value * weight);
    }
    for (values, weights) in spectra.zip(weight_chunks) {
        for lane in 0..8 {
            lanes[lane] += values[lane] * weights[lane];
        }
    }
    lanes.iter().map(|&lane| f64::from(lane)).sum::<f64>() + rest
}

/// Channels that one row of a mosaic holds, each once.
pub(super) fn channels_in_row(mosaic: &Mosaic, row: usize) -> Vec<usize> {
    let mut channels: Vec<usize> = (0..mosaic.cols).map(|col| mosaic.channel(row, col)).collect();
    channels.sort_unstable();
    channels.dedup();
    channels
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resample(pixels: usize, pitch_mm: f64, values: &[f32], extent_mm: f64) -> Vec<f64> {
        let axis = AxisWeights::new(pixels, pitch_mm, pitch_mm, values.len(), extent_mm);
        let mean = |pixel| {
            let (range, weights) = axis.of(pixel);
            values[range].iter().zip(weights).map(|(v, w)| f64::from(v * w)).sum::<f64>()
        };
        (0..pixels).map(mean).collect()
    }

    #[test]
    fn pixels_average_the_samples_below_them() {
        let values = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
        assert_eq!(resample(6, 1.0, &values, 6.0), [1.0, 2.0, 4.0, 8.0, 16.0, 32.0]);
        assert_eq!(resample(3, 2.0, &values, 6.0), [1.5, 6.0, 24.0]);
        let fine = resample(12, 0.5, &values, 6.0);
        assert_eq!(fine[..5], [1.0, 1.25, 1.75, 2.5, 3.5]);
        assert_eq!(fine[10..], [28.0, 32.0]);
        // Four pixels of 1.5 samples each.
        let wide = resample(4, 1.5, &values, 6.0);
        assert!((wide[0] - (1.0 + 0.5 * 2.0) / 1.5).abs() < 1e-6, "{wide:?}");
        // The image covers the middle two of four pixels.
        let beyond = resample(4, 3.0, &values, 6.0);
        for (mean, expected) in beyond.iter().zip([0.0, 7.0 / 3.0, 56.0 / 3.0, 0.0]) {
            assert!((mean - expected).abs() < 1e-6 * expected + 1e-12, "{beyond:?}");
        }
    }

    #[test]
    fn a_small_aperture_sees_the_middle_of_its_pixel() {
        let values: Vec<f64> = (0..24).map(|i| f64::from(i * i)).collect();
        let axis = AxisWeights::new(6, 4.0, 2.0, 24, 24.0);
        for pixel in 0..6 {
            let (range, weights) = axis.of(pixel);
            assert_eq!(range, 4 * pixel + 1..4 * pixel + 3);
            let mean: f64 = values[range].iter().zip(weights).map(|(v, w)| v * f64::from(*w)).sum();
            assert!((mean - 0.5 * (values[4 * pixel + 1] + values[4 * pixel + 2])).abs() < 1e-9);
        }
    }

    #[test]
    fn light_is_conserved_at_any_ratio() {
        let values: Vec<f32> = (0..37).map(|i| (i * i % 11) as f32).collect();
        let light: f64 = values.iter().map(|&v| f64::from(v)).sum::<f64>() / 37.0;
        for pixels in [1, 5, 36, 37, 38, 74, 90, 100] {
            let means = resample(pixels, 1.0 / pixels as f64, &values, 1.0);
            let sum = means.iter().sum::<f64>() / pixels as f64;
            // Weights are rounded to single precision.
            assert!((sum / light - 1.0).abs() < 1e-6, "{pixels} pixels: {sum} of {light}");
        }
    }

    #[test]
    fn lanes_add_up_to_the_exact_sum() {
        for bands in [1, 7, 8, 9, 81, 401] {
            let spectrum: Vec<f32> = (0..bands).map(|i| 1.0 + (i as f32 * 0.37).sin()).collect();
            let weights: Vec<f32> = (0..bands).map(|i| 2.0 + (i as f32 * 0.11).cos()).collect();
            let exact: f64 = spectrum.iter().zip(&weights).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum();
            // Worst case of the documented bound, (bands / 8 + 1) roundings of 2^-24.
            let bound = (bands as f64 / 8.0 + 1.0) * 2f64.powi(-24);
            assert!((dot(&spectrum, &weights) / exact - 1.0).abs() <= bound);
        }
    }
}
