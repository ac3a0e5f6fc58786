//! Distinct excitation-emission matrices of a scene: those of its fluorophores, and those of fluorophores in tissue.

use std::sync::Arc;

use crate::material::FluorophoreAmount;
use crate::render::compiled_scene::Emitter;
use crate::scene::Scene;
use crate::spectral::PhotonEem;

/// The matrices of a scene: first those of its fluorophores in their order, then those of tissues, each once.
pub(super) struct Matrices<'a> {
    fluorophores: usize,
    pub(super) list: Vec<&'a PhotonEem>,
}

impl<'a> Matrices<'a> {
    pub(super) fn new(scene: &'a Scene) -> Self {
        let mut list: Vec<&PhotonEem> =
            scene.fluorophores.iter().map(|fluorophore| &fluorophore.eem).collect();
        for amount in scene.materials.iter().flat_map(|material| &material.fluorophores) {
            if let Some(state) = &amount.in_tissue
                && !list[scene.fluorophores.len()..].iter().any(|known| std::ptr::eq(*known, &*state.eem))
            {
                list.push(&state.eem);
            }
        }
        Self { fluorophores: scene.fluorophores.len(), list }
    }

    /// How a fluorophore of a material of the scene emits.
    pub(super) fn emitter(&self, amount: &FluorophoreAmount) -> Emitter {
        let of_tissue = |eem: &Arc<PhotonEem>| {
            let place = self.list[self.fluorophores..].iter().position(|known| std::ptr::eq(*known, &**eem));
            place.map(|place| self.fluorophores + place)
        };
        let matrix = amount.in_tissue.as_ref().and_then(|state| of_tissue(&state.eem));
        Emitter { fluorophore: amount.fluorophore, matrix: matrix.unwrap_or(amount.fluorophore), number: 0 }
    }
}
