//! Fluorophores and materials.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{ReflectanceReference, SpectrumReference, TextureReference};
use crate::spectral::Stokes;

/// What the values of a measured matrix or emission spectrum count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum YieldUnit {
    /// Photons out per photon in.
    Photons,
    /// Energy out per energy in.
    Energy,
}

/// A fluorophore: exactly one of `from`, `eem_csv`, `csv`, `mat`, or `excitation_csv` with `emission_csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FluorophoreSection {
    /// Name by which materials refer to it.
    pub name: String,
    /// Name for people. Default: that of the source.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
    /// Name in the catalogue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
    /// Path of a matrix: rows emission, columns excitation, corner cell `em_nm\ex_nm`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eem_csv: Option<String>,
    /// Path of a table with the columns `wavelength_nm`, `excitation`, `emission`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub csv: Option<String>,
    /// Path of a MATLAB file of isetfluorescence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mat: Option<String>,
    /// Path of a table whose first column of values is the excitation spectrum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub excitation_csv: Option<String>,
    /// Path of a table whose first column of values is the emission spectrum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emission_csv: Option<String>,
    /// What the values count, emission and excitation alike; needed for matrices that do not say so. "energy" is energy
    /// out per energy in, and becomes photons by the factor emission over excitation wavelength. Spectra: default photons.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<YieldUnit>,
    /// Photons out per photon in at the best excitation, at concentration 1, before the Stokes mask; above 0, at
    /// most 1. Default: that of the catalogue; needed for files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photon_yield: Option<f64>,
    /// Whether emission below the excitation wavelength is masked. Default: as in the catalogue, otherwise "mask".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stokes: Option<Stokes>,
}

/// Clear rough layer on a surface: saliva, enamel gloss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GlossSection {
    /// Refractive index against air, 1 to 3. Default 1.4 (wet mucosa, assumed).
    #[serde(default = "mucosa_index")]
    pub refractive_index: f64,
    /// GGX roughness, 0.01 (mirror-like) to 1. Default 0.2 (assumed).
    #[serde(default = "mucosa_roughness")]
    pub roughness: TextureReference,
}

fn mucosa_index() -> f64 {
    1.4
}

fn mucosa_roughness() -> TextureReference {
    TextureReference::Constant(0.2)
}

/// A dielectric: a body that refracts, such as glass, water, plastic. The side of the geometric normal is air.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DielectricSection {
    /// Refractive index against air, above 1 to 3; the same for all wavelengths.
    pub refractive_index: f64,
    /// GGX roughness, 0 to 1; below 0.01 the surface is smooth. Default 0.
    #[serde(default = "smooth")]
    pub roughness: TextureReference,
    /// Share of light that crosses the surface without being absorbed there, a spectrum from 0 to 1. Default 1.
    #[serde(default)]
    pub transmittance: SpectrumReference,
}

/// A metal: either `metal`, or `n` and `k`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ConductorSection {
    /// Name of a metal of the catalogue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metal: Option<String>,
    /// Real part of the refractive index: a number, a table or a CSV file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub n: Option<SpectrumReference>,
    /// Extinction coefficient: a number, a table or a CSV file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub k: Option<SpectrumReference>,
    /// GGX roughness, 0 to 1; below 0.01 the surface is a mirror. Default 0.2 (brushed).
    #[serde(default = "mucosa_roughness")]
    pub roughness: TextureReference,
}

/// Two materials side by side, finer than a pixel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MixSection {
    /// Name of the first material.
    pub first: String,
    /// Name of the second material.
    pub second: String,
    /// Share of the second one, 0 to 1.
    pub amount: TextureReference,
}

/// One material on either side of a surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TwoSidedSection {
    /// Name of the material on the side of the geometric normal.
    pub front: String,
    /// Name of the material on the other side.
    pub back: String,
}

/// Directions of the normal over the surface, from a picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NormalMapSection {
    /// Path of an RGB PNG image in tangent space, relative to the experiment file: x along u is red, y along v green,
    /// outward blue, each `2 value - 1`.
    pub image: String,
    /// Factor on the slopes, 0 to 10. Default 1.
    #[serde(default = "as_stored")]
    pub strength: f64,
}

fn smooth() -> TextureReference {
    TextureReference::Constant(0.0)
}

fn as_stored() -> f64 {
    1.0
}

/// A material: exactly one of `reflectance` (with an optional gloss), `dielectric`, `conductor`, `mix`, `two_sided`;
/// and fluorophores.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialSection {
    /// Name by which objects refer to it.
    pub name: String,
    /// Diffuse reflectance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reflectance: Option<ReflectanceReference>,
    /// Clear layer on top of a diffuse material. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gloss: Option<GlossSection>,
    /// A dielectric: a body that refracts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dielectric: Option<DielectricSection>,
    /// A metal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conductor: Option<ConductorSection>,
    /// Two materials side by side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mix: Option<MixSection>,
    /// One material on either side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_sided: Option<TwoSidedSection>,
    /// Opacity (alpha mask), 0 to 1; 0 is a hole. That of a mixture multiplies those of its parts. Default 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opacity: Option<TextureReference>,
    /// Directions of the normal over the surface. That of a mixture holds for parts without one. Default: those of the
    /// shape.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal_map: Option<NormalMapSection>,
    /// Concentration of each fluorophore, relative to the unit of the catalogue, 0 or more. On a base, fluorophores that
    /// are not named here keep their concentration; give 0 to leave one out. Default: none.
    #[serde(default)]
    pub concentrations: BTreeMap<String, TextureReference>,
}
