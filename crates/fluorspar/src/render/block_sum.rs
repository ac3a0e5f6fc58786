//! Sums of a block of samples of a few pixels, before they are rounded to the quanta of the film.

use std::ops::Range;

use fluorspar_accel::bands::{BLOCK, BandBlock, add_bands, add_scaled_range};

use super::camera_sample::{LARGEST_BATCH, PixelSampler};
use super::compiled_scene::CompiledScene;
use super::settings::RenderSettings;
use crate::image::StoredBands;

/// Memory for sums, bytes: no more than stays in the second-level cache.
const SUMS_BYTES: usize = 128 << 10;

/// Plain sums of some samples of a few pixels: what one worker reuses from pixel to pixel.
pub(super) struct BlockSum {
    sampler: PixelSampler,
    bands: usize,
    /// Bands of each component that are summed; empty where all are.
    stored: StoredBands,
    /// First value of each component, and the end of the last.
    starts: Vec<usize>,
    /// `[pixel][component][stored band]`.
    pub(super) values: Vec<f32>,
    /// `[pixel][component]`.
    lit: Vec<bool>,
}

impl BlockSum {
    /// Sums of all bands.
    pub(super) fn new(scene: &CompiledScene) -> Self {
        Self::of_stored(scene, &Vec::new())
    }

    /// Sums of the bands that are stored of each component.
    pub(super) fn of_stored(scene: &CompiledScene, stored: &StoredBands) -> Self {
        let (sampler, bands) = (PixelSampler::new(scene), scene.bands);
        let mut starts = vec![0];
        for component in 0..sampler.components() {
            let basis = stored.get(component).and_then(Option::as_ref);
            starts.push(starts[component] + basis.map_or(bands, |basis| basis.stored().len()));
        }
        Self { sampler, bands, stored: stored.clone(), starts, values: Vec::new(), lit: Vec::new() }
    }

    /// Values per pixel.
    pub(super) fn pixel_len(&self) -> usize {
        self.starts[self.sampler.components()]
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
        let Self { sampler, values, lit, starts, stored, .. } = self;
        let add = |pixel: usize, component: usize, range: Range<usize>, weight: f32, light: &[BandBlock]| {
            lit[pixel * components + component] = true;
            let sums = &mut values[pixel * len + starts[component]..pixel * len + starts[component + 1]];
            if let Some(basis) = stored.get(component).and_then(Option::as_ref) {
                for (sum, band) in
                    sums.iter_mut().zip(basis.stored()).filter(|(_, band)| range.contains(band))
                {
                    *sum += weight * light[band / BLOCK].0[band % BLOCK];
                }
            } else if weight == 1.0 && range.len() == bands {
                add_bands(light, sums);
            } else {
                add_scaled_range(weight, light, range, sums);
            }
        };
        sampler.render(scene, settings, pixels, samples, add);
    }

    /// The sums of each pixel, and which of its components are lit.
    pub(super) fn pixels(&self) -> impl Iterator<Item = (&[f32], &[bool])> {
        self.values.chunks(self.pixel_len().max(1)).zip(self.lit.chunks(self.sampler.components()))
    }
}
