//! Materials on the bands of a scene, with their spectra in the forms that paths and accumulation need.

use fluorspar_accel::bands::to_blocks;

use super::emitters::Matrices;
use super::spread;
use crate::material::PreparedMaterials;
use crate::render::compiled_scene::{Emitter, MaterialSpectra};
use crate::render::survival_probability::RouletteModel;
use crate::scene::Scene;
use crate::spectral::Curve;

/// Prepares the materials of a scene.
pub(super) fn compile(
    scene: &Scene,
    matrices: &Matrices<'_>,
    roulette: &RouletteModel,
    light: &[Option<Curve>],
) -> (PreparedMaterials, Vec<MaterialSpectra>) {
    let materials = PreparedMaterials::new(&scene.materials, &scene.grid);
    let spectra = materials
        .iter()
        .map(|material| {
            let numbered = material.fluorophores.iter().enumerate();
            let emitters: Vec<Emitter> =
                numbered.map(|(number, amount)| Emitter { number, ..matrices.emitter(amount) }).collect();
            let mut fluorophores: Vec<usize> = emitters.iter().map(|emitter| emitter.fluorophore).collect();
            fluorophores.sort_unstable();
            fluorophores.dedup();
            MaterialSpectra {
                terms: material.terms.iter().map(|term| to_blocks(&term.bands)).collect(),
                coarse_terms: material.terms.iter().map(|term| roulette.coarse(&term.spectrum)).collect(),
                emitters,
                fluorophores,
                spread: spread::compile(material, &scene.grid, light),
            }
        })
        .collect();
    (materials, spectra)
}
