//! How surfaces turn arriving light into leaving light: Lambertian reflection, a rough dielectric coat, clear bodies,
//! metals, mixtures of these, fluorescence.

pub mod coat;
pub mod conductor;
pub mod dielectric;
pub mod microfacet;
mod normal_map;
mod texture;

pub use coat::{Coat, CoatAlbedo, CoatSample};
pub use conductor::{Conductor, ConductorReflectance};
pub use dielectric::{Dielectric, DielectricAlbedo};
pub use microfacet::{AlbedoTable, MIN_ROUGHNESS};
pub use normal_map::{NormalMap, NormalMapError};
pub use texture::{ImageTexture, ScalarTexture, TextureError};

use crate::spectral::Curve;

/// A surface material, Eq. 5 of the paper: `L = reflection + fluorescence`.
///
/// - Reflection and transmission as [`Scattering`] says; by default a Lambertian base below an optional rough
///   dielectric coat (saliva, enamel gloss).
/// - Fluorescence comes from the irradiance that is not reflected by the coat, the metal or the surface of the clear
///   body, is independent of the diffuse reflectance, and leaves as Lambertian light:
///   `L_f = (1/pi) sum_j c_j integral Y_j(lo|li) E(li) dli`. On clear bodies one half leaves to either side.
/// - Both sides of a surface are alike, but for [`Scattering::TwoSided`] and for clear bodies, whose inside is behind
///   the geometric normal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Material {
    /// Name for error messages and maps.
    pub name: String,
    /// How light is sent on.
    pub scattering: Scattering,
    /// Diffuse reflectance as a weighted sum of spectra; weights may vary over the surface. Diffuse materials only.
    pub reflectance: Vec<ReflectanceTerm>,
    /// Rough dielectric coat, if any. Diffuse materials only.
    pub coat: Option<Coat>,
    /// Fluorophores and their concentrations, relative to the catalogue's unit. Not on mixtures: on their parts.
    pub fluorophores: Vec<FluorophoreAmount>,
    /// Share of the surface that is there at all, 0 to 1: holes are 0. `None` is 1 everywhere.
    pub opacity: Option<ScalarTexture>,
    /// Directions of the shading normal over the surface, if any. Not on mixtures: on their parts.
    pub normal_map: Option<NormalMap>,
}

/// How a material sends light on.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Scattering {
    /// A Lambertian base below an optional coat.
    #[default]
    Diffuse,
    /// A clear body.
    Dielectric(Dielectric),
    /// A metal.
    Conductor(Conductor),
    /// Two materials side by side, finer than a pixel: at every hit one of them is drawn.
    Mix {
        /// Index of the first material of the scene.
        first: usize,
        /// Index of the second one.
        second: usize,
        /// Share of the second one, 0 to 1.
        amount: ScalarTexture,
    },
    /// One material on either side.
    TwoSided {
        /// Index of the material on the side of the geometric normal.
        front: usize,
        /// Index of the one on the other side.
        back: usize,
    },
}

/// One term of a reflectance: `weight(u, v) * spectrum(lambda)`.
#[derive(Clone, Debug, PartialEq)]
pub struct ReflectanceTerm {
    /// Reflectance spectrum, 0 to 1.
    pub spectrum: Curve,
    /// Factor over the surface.
    pub weight: ScalarTexture,
}

/// How much of a fluorophore a material holds.
#[derive(Clone, Debug, PartialEq)]
pub struct FluorophoreAmount {
    /// Index into the scene's fluorophores.
    pub fluorophore: usize,
    /// Concentration over the surface, in the catalogue's unit.
    pub concentration: ScalarTexture,
}

impl Material {
    /// A matte material of one reflectance.
    pub fn lambertian(name: &str, reflectance: Curve) -> Self {
        Self {
            name: name.into(),
            reflectance: vec![ReflectanceTerm {
                spectrum: reflectance,
                weight: ScalarTexture::Constant(1.0),
            }],
            ..Self::default()
        }
    }
}
