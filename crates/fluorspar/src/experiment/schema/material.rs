//! Fluorophores and materials.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{ReflectanceReference, TextureReference};
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

/// A material: diffuse reflectance, gloss and fluorophores.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialSection {
    /// Name by which objects refer to it.
    pub name: String,
    /// Diffuse reflectance.
    pub reflectance: ReflectanceReference,
    /// Clear layer on top. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gloss: Option<GlossSection>,
    /// Concentration of each fluorophore, relative to the unit of the catalogue, 0 or more. On a base, fluorophores that
    /// are not named here keep their concentration; give 0 to leave one out. Default: none.
    #[serde(default)]
    pub concentrations: BTreeMap<String, TextureReference>,
}
