//! Materials on the bands of a scene, with their spectra in the forms that paths and accumulation need.

use fluorspar_accel::bands::to_blocks;

use super::emitters::Matrices;
use crate::material::PreparedMaterials;
use crate::render::compiled_scene::{Emitter, MaterialSpectra};
use crate::render::survival_probability::RouletteModel;
use crate::scene::Scene;

/// Prepares the materials of a scene.
pub(super) fn compile(
    scene: &Scene,
    matrices: &Matrices<'_>,
    roulette: &RouletteModel,
) -> (PreparedMaterials, Vec<MaterialSpectra>) {
    let materials = PreparedMaterials::new(&scene.materials, &scene.grid);
    let spectra = materials
        .iter()
        .map(|material| {
            let emitters: Vec<Emitter> =
                material.fluorophores.iter().map(|amount| matrices.emitter(amount)).collect();
            let mut fluorophores: Vec<usize> = emitters.iter().map(|emitter| emitter.fluorophore).collect();
            fluorophores.sort_unstable();
            fluorophores.dedup();
            MaterialSpectra {
                terms: material.terms.iter().map(|term| to_blocks(&term.bands)).collect(),
                coarse_terms: material.terms.iter().map(|term| roulette.coarse(&term.spectrum)).collect(),
                emitters,
                fluorophores,
            }
        })
        .collect();
    (materials, spectra)
}
