//! Sums of a block of samples of a few pixels, before they are rounded to the quanta of the film.

use std::ops::Range;

use fluorspar_accel::bands::{BLOCK, BandBlock, add_bands, add_combination, add_scaled_range};
use fluorspar_accel::{Lanes, Work};

use super::camera_sample::{LARGEST_BATCH, PixelSampler};
use super::compiled_scene::CompiledScene;
use super::settings::RenderSettings;
use crate::image::ComponentBases;

/// Memory for sums, bytes: no more than stays in the second-level cache.
const SUMS_BYTES: usize = 128 << 10;

/// Plain sums of some samples of a few pixels: what one worker reuses from pixel to pixel.
pub(super) struct BlockSum {
    sampler: PixelSampler,
    bands: usize,
    /// Of each component that has a basis its projection, `[block of coefficients][band]`; empty where none has.
    projections: Vec<Option<Vec<BandBlock>>>,
    /// First value of each component, and the end of the last.
    starts: Vec<usize>,
    /// `[pixel][component][band]`.
    sums: Vec<f32>,
    /// `[pixel][component][coefficient]`, or all bands.
    pub(super) values: Vec<f32>,
    /// `[pixel][component]`.
    lit: Vec<bool>,
}

impl BlockSum {
    /// Sums of all bands.
    pub(super) fn new(scene: &CompiledScene) -> Self {
        Self::on_bases(scene, &Vec::new())
    }

    /// Coefficients of the sums, of components that have a basis.
    pub(super) fn on_bases(scene: &CompiledScene, bases: &ComponentBases) -> Self {
        let (sampler, bands) = (PixelSampler::new(scene), scene.bands);
        let mut starts = vec![0];
        for component in 0..sampler.components() {
            let basis = bases.get(component).and_then(Option::as_ref);
            starts.push(starts[component] + basis.map_or(bands, |basis| basis.len()));
        }
        let projections =
            bases.iter().map(|basis| basis.as_ref().map(|basis| basis.projection_blocks())).collect();
        Self { sampler, bands, projections, starts, sums: Vec::new(), values: Vec::new(), lit: Vec::new() }
    }

    /// Values per pixel.
    pub(super) fn pixel_len(&self) -> usize {
        self.starts[self.sampler.components()]
    }

    /// Pixels per batch.
    pub(super) fn pixels_at_a_time(&self, samples: &Range<u32>) -> usize {
        let wanted = LARGEST_BATCH / samples.len().max(1);
        let bytes = size_of::<f32>() * self.bands * self.sampler.components();
        wanted.min(SUMS_BYTES / bytes.max(1)).max(1)
    }

    /// Renders the same samples of some pixels. The plain sum of those of each, in order, is in `values` afterwards.
    pub(super) fn render(
        &mut self,
        scene: &CompiledScene,
        settings: &RenderSettings,
        pixels: impl ExactSizeIterator<Item = (usize, usize)>,
        samples: Range<u32>,
    ) {
        let (components, bands) = (self.sampler.components(), self.bands);
        let count = pixels.len();
        self.sums.clear();
        self.sums.resize(count * components * bands, 0.0);
        self.lit.clear();
        self.lit.resize(count * components, false);
        let Self { sampler, sums, lit, .. } = self;
        let add = |pixel: usize, component: usize, range: Range<usize>, weight: f32, light: &[BandBlock]| {
            let number = pixel * components + component;
            lit[number] = true;
            let sums = &mut sums[number * bands..(number + 1) * bands];
            if weight == 1.0 && range.len() == bands {
                add_bands(light, sums);
            } else {
                add_scaled_range(weight, light, range, sums);
            }
        };
        sampler.render(scene, settings, pixels, samples, add);
        if self.projections.is_empty() {
            std::mem::swap(&mut self.sums, &mut self.values);
        } else {
            self.values.clear();
            self.values.resize(count * self.pixel_len(), 0.0);
            scene.simd.run(Projected(self));
        }
    }

    /// The sums of each pixel, and which of its components are lit.
    pub(super) fn pixels(&self) -> impl Iterator<Item = (&[f32], &[bool])> {
        self.values.chunks(self.pixel_len().max(1)).zip(self.lit.chunks(self.sampler.components()))
    }
}

/// Makes coefficients of sums.
struct Projected<'a>(&'a mut BlockSum);

impl Work for Projected<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let len = self.0.pixel_len();
        let BlockSum { projections, starts, sums, values, lit, bands, .. } = self.0;
        let components = projections.len();
        for (number, sums) in sums.chunks_exact(*bands).enumerate().filter(|(number, _)| lit[*number]) {
            let (pixel, component) = (number / components, number % components);
            let values = &mut values[pixel * len..][starts[component]..starts[component + 1]];
            let Some(projection) = &projections[component] else {
                values.copy_from_slice(sums);
                continue;
            };
            for (values, projection) in values.chunks_mut(BLOCK).zip(projection.chunks_exact(*bands)) {
                let mut block = BandBlock::ZERO;
                add_combination(lanes, sums, projection, std::slice::from_mut(&mut block));
                values.copy_from_slice(&block.0[..values.len()]);
            }
            // What left the range of numbers must not be lost behind a weight of 0
            if values.iter().any(|value| !value.is_finite()) {
                values.fill(f32::INFINITY);
            }
        }
    }
}
