//! How surfaces turn arriving light into leaving light: Lambertian reflection, a rough dielectric coat, fluorescence.

pub mod coat;
mod texture;

pub use coat::{Coat, CoatAlbedo, CoatSample, MIN_ROUGHNESS};
pub use texture::{ImageTexture, ScalarTexture, TextureError};

use crate::spectral::Curve;

/// A surface material, Eq. 5 of the paper: `L = reflection + fluorescence`.
///
/// - Reflection is a Lambertian base below an optional rough dielectric coat (saliva, enamel gloss).
/// - Fluorescence comes from the irradiance that reaches the base, is independent of the reflectance, and leaves
///   as Lambertian light: `L_f = (1/pi) sum_j c_j integral Y_j(lo|li) E(li) dli`.
/// - Materials are opaque and two-sided.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name for error messages and maps.
    pub name: String,
    /// Diffuse reflectance as a weighted sum of spectra; weights may vary over the surface.
    pub reflectance: Vec<ReflectanceTerm>,
    /// Rough dielectric coat, if any.
    pub coat: Option<Coat>,
    /// Fluorophores and their concentrations, relative to the catalogue's unit.
    pub fluorophores: Vec<FluorophoreAmount>,
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
            coat: None,
            fluorophores: Vec::new(),
        }
    }
}
