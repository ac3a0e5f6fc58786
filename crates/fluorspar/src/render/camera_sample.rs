//! One sample of one pixel: a ray of the camera, a path, spectra back along it. A lens with dispersion needs a path per
//! group of bands; every other camera needs one.

use std::ops::Range;

use fluorspar_accel::bands::BandBlock;

use super::RenderSettings;
use super::compiled_scene::CompiledScene;
use super::path::Path;
use super::spectral_accumulation::SpectralState;
use crate::sampling::SampleStream;

/// Renders a sample and hands every lit component to `add`: its number, the bands to take, the weight that the
/// lens gives them, and the values of all bands.
pub(super) fn render_sample(
    scene: &CompiledScene<'_>,
    settings: &RenderSettings,
    (row, col): (usize, usize),
    sample: u32,
    path: &mut Path,
    state: &mut SpectralState,
    mut add: impl FnMut(usize, Range<usize>, f32, &[BandBlock]),
) {
    let camera = &scene.scene.camera;
    let mut stream = SampleStream::new(settings.seed, (row * camera.width + col) as u64, sample);
    let [x, y, u, v] = stream.next_4d();
    for group in 0..camera.band_groups() {
        let ray = camera.sample(group, col as f32 + x, row as f32 + y, [u, v]);
        if ray.weight == 0.0 {
            continue;
        }
        // The groups of a pixel sample share their random numbers, so colours differ by the lens only.
        let mut numbers = stream.clone();
        scene.trace(path, ray.origin, ray.direction, &mut numbers, settings.max_depth, settings.estimator);
        state.gather(scene, path);
        let bands = match &camera.lens {
            Some(lens) => lens.groups()[group].0.clone(),
            None => 0..scene.bands,
        };
        for component in (0..state.components()).filter(|&component| state.is_lit(component)) {
            add(component, bands.clone(), ray.weight, state.component(component));
        }
    }
}
