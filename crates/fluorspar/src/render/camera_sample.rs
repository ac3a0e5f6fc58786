//! Samples of one pixel: rays of the camera, paths, spectra back along them. A lens with dispersion needs a path per
//! group of bands; every other camera needs one.

use std::ops::Range;

use fluorspar_accel::bands::BandBlock;

use super::RenderSettings;
use super::compiled_scene::CompiledScene;
use super::path_batch::PathBatch;
use super::spectral_accumulation::SpectralState;
use crate::sampling::SampleStream;

/// Most paths in step: enough for rays to take turns, few enough to stay in the first-level cache.
const BATCH: usize = 16;

/// Renders samples of one pixel, one after the other, with buffers that are reused.
#[derive(Debug)]
pub(super) struct PixelSampler {
    batch: PathBatch,
    /// Group of bands of each path of the batch, and its weight.
    seen: Vec<(usize, f32)>,
    state: SpectralState,
}

impl PixelSampler {
    pub(super) fn new(scene: &CompiledScene<'_>) -> Self {
        Self { batch: PathBatch::default(), seen: Vec::new(), state: SpectralState::new(scene) }
    }

    /// How many components there are.
    pub(super) fn components(&self) -> usize {
        self.state.components()
    }

    /// Renders samples and hands every lit component of each, in order, to `add`: its number, the bands to take, the
    /// weight that the lens gives them, and the values of all bands.
    pub(super) fn render(
        &mut self,
        scene: &CompiledScene<'_>,
        settings: &RenderSettings,
        (row, col): (usize, usize),
        samples: Range<u32>,
        mut add: impl FnMut(usize, Range<usize>, f32, &[BandBlock]),
    ) {
        let camera = &scene.scene.camera;
        for sample in samples {
            let mut stream = SampleStream::new(settings.seed, (row * camera.width + col) as u64, sample);
            let [x, y, u, v] = stream.next_4d();
            for group in 0..camera.band_groups() {
                let ray = camera.sample(group, col as f32 + x, row as f32 + y, [u, v]);
                if ray.weight == 0.0 {
                    continue;
                }
                // The groups of a pixel sample share their random numbers, so colours differ by the lens only.
                self.batch.start(ray.origin, ray.direction, stream.clone());
                self.seen.push((group, ray.weight));
                if self.batch.len() == BATCH {
                    self.finish(scene, settings, &mut add);
                }
            }
        }
        self.finish(scene, settings, &mut add);
    }

    /// Traces the batch and empties it.
    fn finish(
        &mut self,
        scene: &CompiledScene<'_>,
        settings: &RenderSettings,
        add: &mut impl FnMut(usize, Range<usize>, f32, &[BandBlock]),
    ) {
        let Self { batch, seen, state } = self;
        scene.trace(batch, settings.max_depth, settings.estimator);
        for (path, (group, weight)) in batch.paths().zip(seen.drain(..)) {
            state.gather(scene, path);
            let bands = match &scene.scene.camera.lens {
                Some(lens) => lens.groups()[group].0.clone(),
                None => 0..scene.bands,
            };
            for component in (0..state.components()).filter(|&component| state.is_lit(component)) {
                add(component, bands.clone(), weight, state.component(component));
            }
        }
        batch.clear();
    }
}
