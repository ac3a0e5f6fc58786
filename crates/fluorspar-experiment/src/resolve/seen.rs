//! What of a scene the analysis of its frames refers to.

use super::context::{Context, Resolved};
use super::fluorophore::Fluorophores;
use super::lesion::Lesions;
use crate::error::Place;
use fluorspar::material::{Material, StateGrid};
use fluorspar::optics::PerspectiveCamera;
use fluorspar::scene::Object;
use fluorspar::sensor::Sensor;
use fluorspar::spectral::WavelengthGrid;

/// What an analysis may refer to.
pub(super) struct Seen<'a> {
    pub(super) objects: &'a [Object],
    pub(super) materials: &'a [Material],
    pub(super) camera: &'a PerspectiveCamera,
    pub(super) grid: &'a WavelengthGrid,
    pub(super) sensor: Option<&'a Sensor>,
    /// Fluorophores of the scene.
    pub(super) fluorophores: &'a Fluorophores,
    /// What the lesions of the mouth left behind.
    pub(super) lesions: &'a Lesions,
}

impl Seen<'_> {
    /// States of a material that is layered tissue.
    pub(super) fn states(&self, material: usize) -> Option<&StateGrid> {
        self.materials[material].diffuse()?.states.as_ref()
    }

    /// Number of the material of the file that a material was made from.
    pub(super) fn original(&self, mut material: usize) -> usize {
        let copied = &self.lesions.copied_materials;
        let of_file = self.materials.len() - copied.len();
        while let Some(copy) = material.checked_sub(of_file) {
            material = copied[copy];
        }
        material
    }
}

/// Refuses parts that do not exist.
pub(super) fn check_parts(
    context: &Context<'_>,
    at: &Place,
    parts: &[String],
    seen: &Seen<'_>,
) -> Resolved<()> {
    let known = seen.objects.iter().map(|object| object.name.as_str());
    context.check_names(at, parts, known, "the scene has no part of this name")
}
