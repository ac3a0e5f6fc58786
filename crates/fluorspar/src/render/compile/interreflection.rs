//! Interreflection gain, estimated from rays that leave the visible surfaces.

use glam::Vec3;

use super::visible_points::VIEW_RAYS;
use crate::material::FilmFrame;
use crate::render::compiled_scene::CompiledScene;
use crate::render::survival_probability::{BINS, Coarse};
use crate::sampling::{SampleStream, warp};

/// Mean reflectance beyond which a room is not taken to be brighter.
const LARGEST_REFLECTANCE: f32 = 0.95;

/// Interreflection gain on coarse bins: all light that arrives at the visible surfaces over the light that arrives
/// directly. That of a closed room, `1 / (1 - r)`, with the mean reflectance `r` of what rays find that leave the
/// visible surfaces diffusely; rays that miss count as a reflectance of 0.
pub(super) fn gain(scene: &CompiledScene) -> Coarse {
    let (mut sum, mut rays) = ([0.0_f32; BINS], 0.0_f32);
    for (number, (origin, direction)) in scene.camera.ray_grid(VIEW_RAYS).enumerate() {
        // Find a visible surface, and what a ray finds that leaves it diffusely
        let surface = |origin: Vec3, direction: Vec3| {
            scene.closest(origin, direction).and_then(|hit| scene.surface(origin, direction, &hit))
        };
        let Some(seen) = surface(origin, direction) else { continue };
        let mut stream = SampleStream::new(0, number as u64, 0);
        let [u, v, mut choice, _] = stream.next_4d();
        let away = seen.to_world(warp::cosine_hemisphere([u, v]));
        rays += 1.0;
        let Some(hit) = surface(seen.leave(away, scene.clearance), away) else { continue };

        // Sum the reflectance found there
        let outermost = scene.object_material[hit.object];
        let chosen = scene.materials.choose(outermost, hit.uv, hit.front, &mut choice);
        let material = &scene.materials[chosen.index];
        let bsdf = material.bsdf(hit.uv, hit.front, hit.to_local(-away), FilmFrame::default(), 0.0);
        let coarse_terms = &scene.material_spectra[chosen.index].coarse_terms;
        material.term_weights(hit.uv, &bsdf, |index, weight| {
            sum.iter_mut().zip(&coarse_terms[index]).for_each(|(sum, value)| *sum += weight * value);
        });
    }
    sum.map(|sum| 1.0 / (1.0 - (sum / rays.max(1.0)).clamp(0.0, LARGEST_REFLECTANCE)))
}
