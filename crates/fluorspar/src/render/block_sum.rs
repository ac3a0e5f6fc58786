//! Sums of a block of samples of a few pixels, before they are rounded to the quanta of the film.

use std::ops::Range;

use fluorspar_accel::bands::{BandBlock, add_bands, add_scaled_range};

use super::camera_sample::{LARGEST_BATCH, PixelSampler};
use super::compiled_scene::CompiledScene;
use super::settings::RenderSettings;

/// Memory for sums, bytes: no more than stays in the second-level cache.
const SUMS_BYTES: usize = 128 << 10;

/// Plain sums of some samples of a few pixels: what one worker reuses from pixel to pixel.
pub(super) struct BlockSum {
    sampler: PixelSampler,
    bands: usize,
    /// `[pixel][component][band]`.
    pub(super) values: Vec<f32>,
    /// `[pixel][component]`.
    lit: Vec<bool>,
}

impl BlockSum {
    pub(super) fn new(scene: &CompiledScene) -> Self {
        Self { sampler: PixelSampler::new(scene), bands: scene.bands, values: Vec::new(), lit: Vec::new() }
    }

    /// Values per pixel.
    pub(super) fn pixel_len(&self) -> usize {
        self.sampler.components() * self.bands
    }

    /// Pixels per batch.
    pub(super) fn pixels_at_a_time(&self, samples: &Range<u32>) -> usize {
        let wanted = LARGEST_BATCH / samples.len().max(1);
        wanted.min(SUMS_BYTES / (size_of::<f32>() * self.pixel_len().max(1))).max(1)
    }

    /// Renders the same samples of some pixels. The plain sum of those of each, in order, is in `values` afterwards.
    pub(super) fn render(
        &mut self,
        scene: &CompiledScene,
        settings: &RenderSettings,
        pixels: impl ExactSizeIterator<Item = (usize, usize)>,
        samples: Range<u32>,
    ) {
        let (components, bands, len) = (self.sampler.components(), self.bands, self.pixel_len());
        self.values.clear();
        self.values.resize(pixels.len() * len, 0.0);
        self.lit.clear();
        self.lit.resize(pixels.len() * components, false);
        let (values, lit) = (&mut self.values, &mut self.lit);
        let add = |pixel: usize, component: usize, range: Range<usize>, weight: f32, light: &[BandBlock]| {
            lit[pixel * components + component] = true;
            let start = pixel * len + component * bands;
            let sums = &mut values[start..start + bands];
            if weight == 1.0 && range.len() == bands {
                add_bands(light, sums);
            } else {
                add_scaled_range(weight, light, range, sums);
            }
        };
        self.sampler.render(scene, settings, pixels, samples, add);
    }

    /// The sums of each pixel, and which of its components are lit.
    pub(super) fn pixels(&self) -> impl Iterator<Item = (&[f32], &[bool])> {
        self.values.chunks(self.pixel_len()).zip(self.lit.chunks(self.sampler.components()))
    }
}
