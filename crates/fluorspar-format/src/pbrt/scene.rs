//! What a scene file says, as plain data.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DMat4;

use super::error::{PbrtError, PbrtPlace};
use super::parameter::{PbrtKind, PbrtParameter, PbrtValues};

/// The version of the format that a scene is written in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PbrtVersion {
    /// Version 3, with the extensions of pbrt-v3-spectral.
    #[default]
    V3,
    /// Version 4.
    V4,
}

/// A directive with a type and parameters: a camera, a shape, a material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PbrtEntity {
    /// Its type, for instance "perspective".
    pub class: String,
    /// Its parameters.
    pub parameters: Vec<PbrtParameter>,
    /// Where it stands.
    pub at: PbrtPlace,
}

impl PbrtEntity {
    /// The parameter of a name.
    pub fn find(&self, name: &str) -> Option<&PbrtParameter> {
        self.parameters.iter().find(|parameter| parameter.name == name)
    }

    /// The first number of a parameter.
    pub fn number(&self, name: &str) -> Option<f64> {
        let parameter = self.parameters.iter().find(|parameter| {
            parameter.name == name && matches!(parameter.kind, PbrtKind::Float | PbrtKind::Integer)
        })?;
        parameter.numbers()?.first().copied()
    }

    /// The numbers of a parameter.
    pub fn numbers(&self, name: &str) -> Option<&[f64]> {
        self.parameters.iter().filter(|parameter| parameter.name == name).find_map(PbrtParameter::numbers)
    }

    /// The first text of a parameter that is a string.
    pub fn text(&self, name: &str) -> Option<&str> {
        let strings = self.parameters.iter().filter(|parameter| parameter.kind == PbrtKind::String);
        Some(strings.filter(|p| p.name == name).find_map(PbrtParameter::texts)?.first()?.as_str())
    }

    /// The truth value of a parameter.
    pub fn flag(&self, name: &str) -> Option<bool> {
        self.parameters.iter().filter(|parameter| parameter.name == name).find_map(|parameter| {
            match &parameter.values {
                PbrtValues::Flags(values) => values.first().copied(),
                _ => None,
            }
        })
    }
}

/// A directive at a place of the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct PbrtPlaced {
    /// The directive.
    pub entity: PbrtEntity,
    /// From its own frame to the world.
    pub to_world: DMat4,
}

/// A texture.
#[derive(Clone, Debug, PartialEq)]
pub struct PbrtTexture {
    /// Its name.
    pub name: String,
    /// Whether its values are spectra instead of numbers.
    pub of_spectra: bool,
    /// Its class and parameters.
    pub entity: PbrtEntity,
}

/// A material.
#[derive(Clone, Debug, PartialEq)]
pub struct PbrtMaterial {
    /// Its name, unless it stands where it is used.
    pub name: Option<String>,
    /// Its type and parameters.
    pub entity: PbrtEntity,
}

/// A shape.
#[derive(Clone, Debug, PartialEq)]
pub struct PbrtShape {
    /// Its type and parameters.
    pub entity: PbrtEntity,
    /// From its own frame to the world, or to that of its object.
    pub to_world: DMat4,
    /// Whether its normals point to the other side.
    pub is_reversed: bool,
    /// Index into [`PbrtScene::materials`]; none is the default of the format.
    pub material: Option<usize>,
    /// Index into [`PbrtScene::area_lights`] of what it emits.
    pub area_light: Option<usize>,
    /// Index into [`PbrtScene::objects`] of the object that it is part of; such shapes show only through instances.
    pub object: Option<usize>,
}

/// An object at a place.
#[derive(Clone, Debug, PartialEq)]
pub struct PbrtInstance {
    /// Index into [`PbrtScene::objects`].
    pub object: usize,
    /// From the frame of the object to the world.
    pub to_world: DMat4,
    /// Where it stands.
    pub at: PbrtPlace,
}

/// What is said once for a whole scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PbrtSettings {
    /// The camera; `to_world` is its frame: x to the right of the image, y up, z forward.
    pub camera: Option<PbrtPlaced>,
    /// The film.
    pub film: Option<PbrtEntity>,
    /// The sampler.
    pub sampler: Option<PbrtEntity>,
    /// The integrator.
    pub integrator: Option<PbrtEntity>,
    /// Seed that `Option` gives.
    pub seed: Option<u64>,
}

/// A scene file and all that it includes: what they say, without physics.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PbrtScene {
    /// The files that were read, the scene itself first.
    pub files: Vec<PathBuf>,
    /// Version that the directives show.
    pub version: PbrtVersion,
    /// Camera, film, sampler, integrator.
    pub settings: PbrtSettings,
    /// Materials, in order.
    pub materials: Vec<PbrtMaterial>,
    /// The last material of each name.
    pub named_materials: BTreeMap<String, usize>,
    /// Textures, in order.
    pub textures: Vec<PbrtTexture>,
    /// Lights without a shape.
    pub lights: Vec<PbrtPlaced>,
    /// What shapes emit.
    pub area_lights: Vec<PbrtEntity>,
    /// Shapes.
    pub shapes: Vec<PbrtShape>,
    /// Names of objects.
    pub objects: Vec<String>,
    /// Places of objects.
    pub instances: Vec<PbrtInstance>,
    /// Directives that say nothing about the light, and those that a plain tree can't hold: where, and what they are.
    pub remarks: Vec<PbrtRemark>,
}

/// A directive that is not part of the tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PbrtRemark {
    /// Where it stands.
    pub at: PbrtPlace,
    /// What it is, and what becomes of it.
    pub text: String,
    /// Whether the picture may differ without it.
    pub matters: bool,
}

impl PbrtScene {
    /// An error at a place.
    pub fn error(&self, at: PbrtPlace, message: impl Into<String>) -> PbrtError {
        let file = self.files.get(at.file as usize).cloned().unwrap_or_default();
        PbrtError { file, at: Some([at.line, at.column]), message: message.into() }
    }

    /// A place in words: `FILE:LINE:COLUMN`.
    pub fn place(&self, at: PbrtPlace) -> String {
        let file =
            self.files.get(at.file as usize).map_or_else(String::new, |file| file.display().to_string());
        format!("{file}:{}:{}", at.line, at.column)
    }

    /// The path of a file that is named at a place: beside the file that names it, else beside the scene.
    pub fn path_of(&self, at: PbrtPlace, name: &str) -> PathBuf {
        let beside =
            |file: Option<&PathBuf>| file.and_then(|file| file.parent()).unwrap_or(Path::new("")).join(name);
        let near = beside(self.files.get(at.file as usize));
        let main = beside(self.files.first());
        if !near.exists() && main.exists() { main } else { near }
    }
}
