//! Fluorophores and materials.

use std::collections::BTreeMap;
use std::ops::Not;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{FilePath, ReflectanceReference, SpectrumReference, TextureReference};
use fluorspar::spectral::{Stokes, YieldUnit};
use fluorspar_format::EmptyCells;

/// The photon yield of a measured fluorophore whose yield nobody stated: the order of those of the catalogue.
pub const ASSUMED_PHOTON_YIELD: f64 = 1e-3;

/// A fluorophore.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("x-renamed" = {
    "from": "source = \"...\"",
    "csv": "source = { csv = \"...\" }",
    "eem_csv": "source = { eem_csv = \"...\" }",
    "mat": "source = { mat = \"...\" }",
    "excitation_csv": "source = { excitation_csv = \"...\", emission_csv = \"...\" }",
    "emission_csv": "source = { excitation_csv = \"...\", emission_csv = \"...\" }",
    "unit": "source = { ..., unit = \"...\" }",
    "empty_as_zero": "empty_cells = \"zero\""
}))]
pub struct FluorophoreSection {
    /// Name by which materials refer to it.
    pub name: String,
    /// Name for people. Default: that of the source.
    pub title: Option<String>,
    /// Where its spectra come from.
    pub source: FluorophoreSource,
    /// Photons out per photon in at the best excitation, at concentration 1, before the Stokes mask; above 0, at
    /// most 1. Default: that of the catalogue; needed for files.
    pub photon_yield: Option<f64>,
    /// Whether emission below the excitation wavelength is masked. Default: as in the catalogue, otherwise "mask".
    pub stokes: Option<Stokes>,
    /// Take negative values of its files as zero instead of refusing them. Default false.
    #[serde(default, skip_serializing_if = "Not::not")]
    pub allow_negative: bool,
    /// Accept values of a matrix below their excitation, scattered light for instance, which the Stokes mask then leaves out, instead of
    /// refusing them. Default false; with stokes = "off" they are part of the matrix.
    #[serde(default, skip_serializing_if = "Not::not")]
    pub allow_anti_stokes: bool,
    /// What becomes of empty cells of a matrix. Default "refuse".
    #[serde(default, skip_serializing_if = "is_refused")]
    pub empty_cells: EmptyCells,
}

fn is_refused(cells: &EmptyCells) -> bool {
    *cells == EmptyCells::Refuse
}

/// A name of the catalogue, or a table with `eem_csv`, `csv`, `mat`, or `excitation_csv` and `emission_csv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum FluorophoreSource {
    /// A name of the catalogue.
    Catalogue(String),
    /// A matrix.
    Matrix(MatrixSource),
    /// Excitation and emission in one table.
    Table(TableSource),
    /// A file of isetfluorescence.
    Mat(MatSource),
    /// Excitation and emission in tables of their own.
    Spectra(SpectraSource),
}

impl FluorophoreSource {
    /// The files that it names.
    pub fn files_mut(&mut self) -> Vec<&mut FilePath> {
        match self {
            Self::Catalogue(_) => Vec::new(),
            Self::Matrix(source) => vec![&mut source.eem_csv],
            Self::Table(source) => vec![&mut source.csv],
            Self::Mat(source) => vec![&mut source.mat],
            Self::Spectra(source) => vec![&mut source.excitation_csv, &mut source.emission_csv],
        }
    }
}

/// A matrix.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MatrixSource {
    /// Path of a matrix: rows emission, columns excitation, corner cell `em_nm\ex_nm`.
    pub eem_csv: FilePath,
    /// Unit of its values; needed where the file does not state it. "energy" is energy out per energy in, and becomes
    /// photons by the factor emission over excitation wavelength.
    pub unit: Option<YieldUnit>,
    /// Name of the sample that is meant, of a file of several.
    pub sample: Option<String>,
}

/// Excitation and emission in one table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TableSource {
    /// Path of a table with the columns `wavelength_nm`, `excitation`, `emission`; or `NAME ex`, `NAME em`.
    pub csv: FilePath,
    /// Unit of the values, of emission and excitation alike. Default "photons".
    pub unit: Option<YieldUnit>,
    /// Name of the dye that is meant, of a file of several.
    pub sample: Option<String>,
}

/// A file of isetfluorescence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MatSource {
    /// Path of a MATLAB file of isetfluorescence.
    pub mat: FilePath,
    /// Unit of the values. Default "photons".
    pub unit: Option<YieldUnit>,
}

/// Excitation and emission in tables of their own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpectraSource {
    /// Path of a table whose first column of values is the excitation spectrum.
    pub excitation_csv: FilePath,
    /// Path of a table whose first column of values is the emission spectrum.
    pub emission_csv: FilePath,
    /// Unit of the values, of emission and excitation alike. Default "photons".
    pub unit: Option<YieldUnit>,
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
    /// Length over which a liquid film evens out the relief of a mesh, mm, 0.01 to 5: it mirrors by a normal of its own, while the
    /// surface below keeps its bumps. Of the parts of a mixture the longest counts. Default 0: it follows them.
    #[serde(default)]
    pub smoothing_mm: f64,
}

impl Default for GlossSection {
    fn default() -> Self {
        Self { refractive_index: mucosa_index(), roughness: mucosa_roughness(), smoothing_mm: 0.0 }
    }
}

/// The types of materials, each with its fields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[schemars(extend("x-default" = "diffuse"))]
pub enum ScatteringSection {
    /// Diffuse, with or without gloss. The type of a material that names none.
    Diffuse(DiffuseSection),
    /// Layered tissue with blood and depth, below its wet surface.
    Tissue(TissueMaterialSection),
    /// A dielectric: a body that refracts, such as glass, water, plastic.
    Dielectric(DielectricSection),
    /// A metal.
    Conductor(ConductorSection),
    /// Two materials side by side, finer than a pixel.
    Mix(MixSection),
    /// One material on either side of a surface.
    TwoSided(TwoSidedSection),
}

/// A diffuse surface, with or without a clear layer on top.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DiffuseSection {
    /// Diffuse reflectance.
    pub reflectance: ReflectanceReference,
    /// Clear layer on top. Default: none.
    pub gloss: Option<GlossSection>,
    /// Concentration of each fluorophore, relative to the unit of the catalogue, 0 or more. On a base, fluorophores that
    /// are not named here keep their concentration; give 0 to leave one out. Default: none.
    #[serde(default)]
    pub concentrations: BTreeMap<String, TextureReference>,
}

/// Layered tissue below its wet surface: reflectance and fluorescence are those that light in its layers gives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TissueMaterialSection {
    /// Name of a `[[tissue]]`, or of a site of the catalogue.
    pub tissue: String,
    /// Factors on parameters of the tissue over the surface, by name, at most 3: `superficial_blood_fraction = { noise = [8, 8], low = 0.5, high
    /// = 3.0 }`. Amounts of fluorophores are `concentrations`. Default: none.
    #[serde(default)]
    pub vary: BTreeMap<String, TextureReference>,
    /// The wet surface; its refractive index is that of the tissue. Default: that index, roughness 0.2.
    pub gloss: Option<GlossSection>,
    /// Whether light leaves at some distance from where it enters, so that edges are soft; otherwise it leaves where it enters.
    /// Default: true.
    #[serde(default = "translucent", skip_serializing_if = "Clone::clone")]
    pub translucent: bool,
    /// Factor on what the tissue holds of each fluorophore, 0 or more. Default: 1.
    #[serde(default)]
    pub concentrations: BTreeMap<String, TextureReference>,
}

fn translucent() -> bool {
    true
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
    /// Whether light is lost that a rough surface scatters more than once, as in renderers without it. Default false.
    #[serde(default, skip_serializing_if = "Not::not")]
    pub single_scattering: bool,
    /// Concentration of each fluorophore, relative to the unit of the catalogue, 0 or more. On a base, fluorophores that
    /// are not named here keep their concentration; give 0 to leave one out. Default: none.
    #[serde(default)]
    pub concentrations: BTreeMap<String, TextureReference>,
}

/// A metal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ConductorSection {
    /// Refractive index.
    pub metal: MetalReference,
    /// GGX roughness, 0 to 1; below 0.01 the surface is a mirror. Default 0.2 (brushed).
    #[serde(default = "mucosa_roughness")]
    pub roughness: TextureReference,
    /// Whether light is lost that a rough surface scatters more than once, as in renderers without it. Default false.
    #[serde(default, skip_serializing_if = "Not::not")]
    pub single_scattering: bool,
    /// Concentration of each fluorophore, relative to the unit of the catalogue, 0 or more. On a base, fluorophores that
    /// are not named here keep their concentration; give 0 to leave one out. Default: none.
    #[serde(default)]
    pub concentrations: BTreeMap<String, TextureReference>,
}

/// A metal of the catalogue, or a table of `n` and `k`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum MetalReference {
    /// A name of the catalogue.
    Name(String),
    /// Its complex refractive index.
    Index(MetalIndex),
}

/// Complex refractive index of a metal, `n + ik`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MetalIndex {
    /// Real part of the refractive index: a number, a table or a CSV file.
    #[schemars(extend("x-expected" = "a number, { csv = \"FILE\" } or a table of wavelengths and values"))]
    pub n: SpectrumReference,
    /// Extinction coefficient: a number, a table or a CSV file.
    #[schemars(extend("x-expected" = "a number, { csv = \"FILE\" } or a table of wavelengths and values"))]
    pub k: SpectrumReference,
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

/// Directions of the normal over the surface, from an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NormalMapSection {
    /// Path of an RGB PNG image in tangent space: x along u is red, y along v green, outward blue, each
    /// `2 value - 1`.
    pub image: FilePath,
    /// Factor on the slopes, 0 to 10. Default 1.
    #[serde(default = "as_stored")]
    pub strength: f64,
}

/// A material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[schemars(extend("x-renamed" = {
    "dielectric": "type = \"dielectric\" and its fields in the material itself",
    "conductor": "type = \"conductor\" and its fields in the material itself",
    "mix": "type = \"mix\" and its fields in the material itself",
    "two_sided": "type = \"two_sided\" and its fields in the material itself",
    "n": "metal = { n = ..., k = ... }",
    "k": "metal = { n = ..., k = ... }"
}))]
pub struct MaterialSection {
    /// Name by which objects refer to it.
    pub name: String,
    /// Opacity (alpha mask), 0 to 1; 0 is a hole. That of a mixture multiplies those of its parts. Default 1.
    pub opacity: Option<TextureReference>,
    /// Directions of the normal over the surface. That of a mixture holds for parts without one. Default: those of the
    /// shape.
    pub normal_map: Option<NormalMapSection>,
    /// How it sends light on.
    #[serde(flatten)]
    pub scattering: ScatteringSection,
}

impl MaterialSection {
    /// Name of the tissue that it is made of.
    pub fn tissue(&self) -> Option<&str> {
        match &self.scattering {
            ScatteringSection::Tissue(section) => Some(&section.tissue),
            _ => None,
        }
    }

    /// Concentrations of its fluorophores; a mixture has none of its own.
    pub(crate) fn concentrations(&self) -> Option<&BTreeMap<String, TextureReference>> {
        match &self.scattering {
            ScatteringSection::Diffuse(section) => Some(&section.concentrations),
            ScatteringSection::Tissue(section) => Some(&section.concentrations),
            ScatteringSection::Dielectric(section) => Some(&section.concentrations),
            ScatteringSection::Conductor(section) => Some(&section.concentrations),
            ScatteringSection::Mix(_) | ScatteringSection::TwoSided(_) => None,
        }
    }
}

defaults! {
    mucosa_index: f64 = 1.4;
    mucosa_roughness: TextureReference = TextureReference::Constant(0.2);
    smooth: TextureReference = TextureReference::Constant(0.0);
    as_stored: f64 = 1.0;
}
