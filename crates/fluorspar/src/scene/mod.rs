//! A scene: objects, materials, fluorophores, lights and the camera that looks at them.

mod check;
pub(crate) mod irradiance;
mod texture_mean;

pub use check::{EmissionOutsideData, ExcitationOutsideData, LightOutsideGrid, SceneError, SceneWarning};
pub use texture_mean::{rough_surface_mean, surface_mean};

use std::sync::Arc;

use glam::Vec3;

use crate::geometry::{MeshInstances, TriangleMesh};
use crate::light::{Light, LightGroup};
use crate::material::Material;
use crate::optics::PerspectiveCamera;
use crate::spectral::{Curve, Fluorophore, WavelengthGrid};

/// Everything that a render needs, in meters, watts and nanometers.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Wavelength bins of the render.
    pub grid: WavelengthGrid,
    /// Named surfaces.
    pub objects: Vec<Object>,
    /// Materials that objects refer to by index.
    pub materials: Vec<Material>,
    /// Fluorophores that materials refer to by index; each becomes a component per light group.
    pub fluorophores: Vec<Fluorophore>,
    /// Excitation channels.
    pub light_groups: Vec<LightGroup>,
    /// Light sources.
    pub lights: Vec<Light>,
    /// The camera.
    pub camera: PerspectiveCamera,
}

/// A named surface with a material.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Name: a part of the mouth, for instance "tongue_dorsum".
    pub name: String,
    /// Its surface.
    pub shape: Shape,
    /// Index into the scene's materials.
    pub material: usize,
    /// Light that the surface emits by itself, if any.
    pub emission: Option<SurfaceEmission>,
}

/// The surface of an object.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Triangles.
    Mesh(Arc<TriangleMesh>),
    /// Triangle meshes, each kept once, at many places. They are one object: one name, one material.
    Instances(Arc<MeshInstances>),
    /// An exact sphere; texture coordinates are longitude and latitude.
    Sphere {
        /// Center, m.
        center: Vec3,
        /// Radius, m.
        radius_m: f32,
    },
    /// An exact flat disc; texture coordinates span its bounding square.
    Disc {
        /// Center, m.
        center: Vec3,
        /// Unit normal.
        normal: Vec3,
        /// Radius, m.
        radius_m: f32,
    },
}

/// Lambertian emission of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceEmission {
    /// Index into the scene's light groups.
    pub group: usize,
    /// Radiance, W/(sr m² nm).
    pub radiance: Curve,
    /// Whether only the side of the geometric normal emits.
    pub is_one_sided: bool,
}
