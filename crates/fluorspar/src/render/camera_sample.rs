//! Samples of pixels: rays of the camera, paths, spectra back along them. A lens with dispersion needs a path per group
//! of bands; every other camera needs one.

use std::ops::Range;

use fluorspar_accel::bands::BandBlock;

use super::compiled_scene::CompiledScene;
use super::path::DirectLight;
use super::path_integrator::PathBatch;
use super::settings::RenderSettings;
use super::spectral_accumulation::SpectralState;
use crate::sampling::SampleStream;

/// Largest batch of paths: large enough for traversals to be interleaved until the last paths end.
pub(super) const LARGEST_BATCH: usize = 128;
/// Memory for the direct light of a batch, bytes: little compared with the images, for any number of sources.
const DIRECT_LIGHT_BYTES: usize = 256 << 10;
/// Vertices that the memory of a path is planned for: few paths are longer, whatever `max_depth` allows.
const LONG_PATH: u32 = 32;

/// Number of paths in a batch. No result depends on it.
fn batch_size(sources: usize, max_depth: u32) -> usize {
    let bytes = size_of::<DirectLight>() * sources.max(1) * max_depth.clamp(1, LONG_PATH) as usize;
    (DIRECT_LIGHT_BYTES / bytes).clamp(1, LARGEST_BATCH)
}

/// Where a path of the batch comes from.
#[derive(Clone, Copy, Debug)]
struct Origin {
    pixel: usize,
    /// Group of bands of the lens.
    group: usize,
    weight: f32,
}

/// Renders samples of pixels with buffers that are reused.
#[derive(Debug)]
pub(super) struct PixelSampler {
    batch: PathBatch,
    /// Of each path of the batch.
    origins: Vec<Origin>,
    state: SpectralState,
}

impl PixelSampler {
    pub(super) fn new(scene: &CompiledScene) -> Self {
        Self { batch: PathBatch::default(), origins: Vec::new(), state: SpectralState::new(scene) }
    }

    /// Number of components.
    pub(super) fn components(&self) -> usize {
        self.state.components()
    }

    /// Renders the same samples of several pixels, pixel by pixel, and hands every lit component of each sample, in order,
    /// to `add`: index of the pixel, number of the component, the bands to take, the weight that the lens gives them, and
    /// the values of all bands.
    pub(super) fn render(
        &mut self,
        scene: &CompiledScene,
        settings: &RenderSettings,
        pixels: impl Iterator<Item = (usize, usize)>,
        samples: Range<u32>,
        mut add: impl FnMut(usize, usize, Range<usize>, f32, &[BandBlock]),
    ) {
        let camera = &scene.camera;
        let batch_size = batch_size(scene.sources.len(), settings.max_depth);
        for (pixel, (row, col)) in pixels.enumerate() {
            for sample in samples.clone() {
                let mut stream = SampleStream::new(settings.seed, (row * camera.width + col) as u64, sample);
                let [x, y, u, v] = stream.next_4d();
                for group in 0..camera.band_groups() {
                    let (x, y) = (col as f32 + x, row as f32 + y);
                    let ray = camera.sample(group, x, y, [u, v], || stream.next_4d());
                    if ray.weight == 0.0 {
                        continue;
                    }
                    // The groups of a pixel sample share their random numbers, so colors differ by the lens only.
                    self.batch.start(ray.origin, ray.direction, stream.clone());
                    self.origins.push(Origin { pixel, group, weight: ray.weight });
                    if self.batch.len() == batch_size {
                        self.finish(scene, settings, &mut add);
                    }
                }
            }
        }
        self.finish(scene, settings, &mut add);
    }

    /// Traces the batch and empties it.
    fn finish(
        &mut self,
        scene: &CompiledScene,
        settings: &RenderSettings,
        add: &mut impl FnMut(usize, usize, Range<usize>, f32, &[BandBlock]),
    ) {
        let Self { batch, origins, state } = self;
        scene.sample_paths(batch, settings.max_depth, settings.estimator);
        for (path, Origin { pixel, group, weight }) in batch.paths().zip(origins.drain(..)) {
            state.gather(scene, path);
            let bands = match &scene.camera.lens {
                Some(lens) => lens.groups()[group].0.clone(),
                None => 0..scene.bands,
            };
            for component in (0..state.components()).filter(|&component| state.is_lit(component)) {
                add(pixel, component, bands.clone(), weight, state.component(component));
            }
        }
        batch.clear();
    }
}
