//! From the tree of a file to a scene.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fluorspar::light::{Light, LightGroup};
use fluorspar::material::{Material, ScalarTexture};
use fluorspar::render::RenderSettings;
use fluorspar::scene::{Object, Scene};
use fluorspar::spectral::{Fluorophore, WavelengthGrid};
use fluorspar::study::Study;
use fluorspar_format::{
    PbrtError, PbrtPlace, PbrtScene, PbrtVersion, TextureImage, digest_bounded, read_pbrt,
};
use glam::{DMat4, DVec3};

use crate::texture::Terms;

/// A directive or parameter without counterpart: where, and what becomes of it.
pub use fluorspar_format::PbrtRemark as Remark;

/// What the spectra of lights mean that a file gives wavelength by wavelength.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Emission {
    /// Radiometric quantities as they stand: W/(sr m² nm), W/(sr nm) of points, W/(m² nm) of distant lights.
    #[default]
    Absolute,
    /// In version 4, shapes of spectra: each is scaled to 1 nit (1 candela, 1 lux), then by `scale`, `power` and
    /// `illuminance`, as pbrt-v4 does.
    Photometric,
}

/// How a scene of pbrt is taken.
#[derive(Clone, Debug, PartialEq)]
pub struct PbrtOptions {
    /// Length of one unit of the file, m.
    pub unit_m: f64,
    /// Meaning of the spectra of lights.
    pub emission: Emission,
    /// Wavelength bins of the render.
    pub grid: WavelengthGrid,
    /// Whether rough metals and glass lose the light that they scatter more than once, as in pbrt.
    pub single_scattering: bool,
}

impl Default for PbrtOptions {
    /// Meters, absolute spectra, 350 to 750 nm by 5 nm, all scattering.
    fn default() -> Self {
        let grid = WavelengthGrid::default();
        Self { unit_m: 1.0, emission: Emission::default(), grid, single_scattering: false }
    }
}

/// A scene of pbrt as a study.
#[derive(Clone, Debug, PartialEq)]
pub struct PbrtStudy {
    /// Scene and render settings; no lens equation, no sensor, no captures.
    pub study: Study,
    /// What has no counterpart, in the order of the file: where, and what becomes of it.
    pub remarks: Vec<Remark>,
    /// The same with places written out: `FILE:LINE:COLUMN: text`.
    pub messages: Vec<String>,
    /// All files that were read, with the SHA-256 of their contents.
    pub files: Vec<(PathBuf, String)>,
}

/// Reads a scene and makes a study of it.
///
/// # Errors
/// Files that can't be read, values without meaning, cameras that have no counterpart; each with its place.
pub fn load(path: &Path, options: &PbrtOptions) -> Result<PbrtStudy, PbrtError> {
    let tree = read_pbrt(path)?;
    if !(options.unit_m.is_finite() && options.unit_m > 0.0) {
        let message = format!("the unit of length is {} m; give a positive one", options.unit_m);
        return Err(PbrtError { file: path.into(), at: None, message });
    }
    let mut convert = Convert::new(&tree, options);
    let (camera, render) = convert.camera()?;
    convert.lights()?;
    convert.shapes()?;
    convert.note_darkness();
    let Convert { mut remarks, materials, fluorophores, lights, objects, read, .. } = convert;
    let groups = vec![LightGroup { name: "light".into() }];
    let grid = options.grid.clone();
    let scene = Scene { grid, objects, materials, fluorophores, light_groups: groups, lights, camera };
    check(&tree, &scene)?;
    remarks.extend(tree.remarks.iter().cloned());
    remarks.sort_by_key(|remark| remark.at);
    remarks.dedup();
    let messages =
        remarks.iter().map(|remark| format!("{}: {}", tree.place(remark.at), remark.text)).collect();
    let mut study = Study::new(scene);
    study.render = render;
    let files = digests(&tree, read)?;
    Ok(PbrtStudy { study, remarks, messages, files })
}

/// What is said of a scene whose image would be black.
const NO_LIGHTS: &str = "the scene has no lights; add a LightSource, or an AreaLightSource before a Shape";

/// Whether nothing shines.
fn is_dark(lights: &[Light], objects: &[Object]) -> bool {
    lights.is_empty() && objects.iter().all(|object| object.emission.is_none())
}

/// Refuses a scene that is to be rendered and in which nothing shines.
///
/// # Errors
/// What it lacks.
pub fn check_light(scene: &Scene) -> Result<(), &'static str> {
    if is_dark(&scene.lights, &scene.objects) { Err(NO_LIGHTS) } else { Ok(()) }
}

/// Checks that are those of every scene.
fn check(tree: &PbrtScene, scene: &Scene) -> Result<(), PbrtError> {
    let main = tree.files.first().cloned().unwrap_or_default();
    if scene.objects.is_empty() {
        let message = "the scene has no objects; add a Shape".into();
        return Err(PbrtError { file: main, at: None, message });
    }
    scene.check().map_err(|error| {
        let hint = match &error {
            fluorspar::scene::SceneError::CreatesPhotons { .. } => {
                ". Matrices of pbrt-v3-spectral have peak 1, so that concentrations of 0.01 and less are usual"
            }
            _ => "",
        };
        PbrtError { file: main, at: None, message: format!("{error}{hint}") }
    })
}

/// The files of the scene and those that it names, each once.
fn digests(tree: &PbrtScene, read: Vec<PathBuf>) -> Result<Vec<(PathBuf, String)>, PbrtError> {
    let mut files: Vec<PathBuf> = tree.files.iter().cloned().chain(read).collect();
    files.sort();
    files.dedup();
    let digest = |path: PathBuf| match digest_bounded(&path, u64::MAX - 1) {
        Ok(digest) => Ok((path, digest)),
        Err(error) => Err(PbrtError { message: error.problem().to_string(), file: path, at: None }),
    };
    files.into_iter().map(digest).collect()
}

/// A scene as it grows.
pub(crate) struct Convert<'a> {
    pub(crate) tree: &'a PbrtScene,
    pub(crate) options: &'a PbrtOptions,
    pub(crate) remarks: Vec<Remark>,
    pub(crate) materials: Vec<Material>,
    pub(crate) fluorophores: Vec<Fluorophore>,
    pub(crate) lights: Vec<Light>,
    pub(crate) objects: Vec<Object>,
    /// Materials that were made of those of the file; `None` for one that has no surface.
    pub(crate) material_of: HashMap<usize, Option<usize>>,
    pub(crate) default_material: Option<usize>,
    pub(crate) weights: HashMap<usize, ScalarTexture>,
    pub(crate) terms: HashMap<usize, Terms>,
    pub(crate) images: HashMap<(PathBuf, String), Arc<TextureImage>>,
    /// Images that were sampled from textures.
    pub(crate) sampled: usize,
    /// Files that were read besides those of the scene.
    pub(crate) read: Vec<PathBuf>,
}

impl<'a> Convert<'a> {
    fn new(tree: &'a PbrtScene, options: &'a PbrtOptions) -> Self {
        Self {
            tree,
            options,
            remarks: Vec::new(),
            materials: Vec::new(),
            fluorophores: Vec::new(),
            lights: Vec::new(),
            objects: Vec::new(),
            material_of: HashMap::new(),
            default_material: None,
            weights: HashMap::new(),
            terms: HashMap::new(),
            images: HashMap::new(),
            sampled: 0,
            read: Vec::new(),
        }
    }

    pub(crate) fn is_v4(&self) -> bool {
        self.tree.version == PbrtVersion::V4
    }

    pub(crate) fn error(&self, at: PbrtPlace, message: impl Into<String>) -> PbrtError {
        self.tree.error(at, message)
    }

    /// Names what is left out or changed, and may show.
    pub(crate) fn remark(&mut self, at: PbrtPlace, text: impl Into<String>) {
        self.remarks.push(Remark { at, text: text.into(), matters: true });
    }

    /// Names that nothing shines, as in scenes that are parts of others.
    fn note_darkness(&mut self) {
        if is_dark(&self.lights, &self.objects) {
            let at = self.tree.shapes.first().map(|shape| shape.entity.at).unwrap_or_default();
            let text = match self.tree.lights.is_empty() && self.tree.area_lights.is_empty() {
                true => NO_LIGHTS,
                false => {
                    "the scene has no lights left: those that it has are left out or dark; add one that is read"
                }
            };
            self.remark(at, text);
        }
    }

    /// Names what has no effect on the light.
    pub(crate) fn note(&mut self, at: PbrtPlace, text: impl Into<String>) {
        self.remarks.push(Remark { at, text: text.into(), matters: false });
    }

    /// From the world of the file to that of the scene, m. The world of pbrt is left-handed as its camera sees it: where
    /// its camera does not mirror the image itself, the scene is mirrored at z = 0, so that pictures are the same.
    pub(crate) fn scene_from_world(&self) -> DMat4 {
        let camera = self.tree.settings.camera.as_ref().map_or(DMat4::IDENTITY, |camera| camera.to_world);
        let depth = if camera.determinant() > 0.0 { -1.0 } else { 1.0 };
        DMat4::from_scale(self.options.unit_m * DVec3::new(1.0, 1.0, depth))
    }

    /// The same for directions.
    pub(crate) fn turn(&self) -> DMat4 {
        let map = self.scene_from_world();
        DMat4::from_scale(DVec3::new(1.0, 1.0, map.z_axis.z.signum()))
    }
}

/// Settings of a render that files leave open.
pub(crate) fn usual_settings() -> RenderSettings {
    RenderSettings { samples_per_pixel: 16, max_depth: 5, ..RenderSettings::default() }
}
