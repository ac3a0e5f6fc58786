//! Spectra and textures as they are written in a file: a number, a name, a path or a table.

use std::collections::BTreeMap;
use std::ops::Not;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{FilePath, NameOrTable};
use fluorspar::spectral::CurveModel;
use fluorspar_anatomy::{SurfaceMap, Tissue};
use fluorspar_format::ValueUnit;

/// A spectrum: a number, a name of the catalogue, the path of a CSV or MATLAB file, a table with `csv` or `mat` (one
/// column of a file), or an equation such as { type = "led", ... }.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(extend("x-merge" = "replace"))]
pub enum SpectrumReference {
    /// The same value at every wavelength.
    Constant(f64),
    /// A name of the catalogue, or the path of a CSV file (with a slash or the ending `.csv`) or of a MATLAB file (the
    /// ending `.mat`), whose first column of values is used.
    Text(NameOrTable),
    /// One column of a CSV file.
    Table(SpectrumTable),
    /// One column of a MATLAB file.
    Matlab(MatlabSpectrum),
    /// An equation, as in the files of the catalogue: `{ type = "led", peak_nm = 385.0, ... }`.
    Model(CurveModel),
}

impl SpectrumReference {
    /// A name of the catalogue.
    pub(crate) fn named(name: &str) -> Self {
        Self::Text(NameOrTable::Name(name.into()))
    }

    /// Whether it is data of a file.
    pub(crate) fn names_file(&self) -> bool {
        matches!(self, Self::Text(NameOrTable::File(_)) | Self::Table(_) | Self::Matlab(_))
    }

    /// The name of the catalogue, if it is one.
    pub(crate) fn catalogue_name(&self) -> Option<&str> {
        match self {
            Self::Text(NameOrTable::Name(name)) => Some(name),
            _ => None,
        }
    }
}

impl Default for SpectrumReference {
    fn default() -> Self {
        Self::Constant(1.0)
    }
}

/// One column of a table, as instruments and spreadsheets write it. The header names the unit of the values; transmittances and reflectances
/// become fractions, lights power per nm, quantum efficiencies electrons per photon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpectrumTable {
    /// Path of the file.
    pub csv: FilePath,
    /// Header of the column. Default: the only one, that which the instrument computed, or the first.
    pub column: Option<String>,
    /// Unit of the values. Default: what the header says.
    pub unit: Option<TableUnit>,
    /// Factor on the values; without a unit, on those that the file holds, whatever its header says. Default 1.
    pub scale: Option<f64>,
    /// Value at wavelengths beyond the data, where else there is nothing. A viewing filter needs it where a light shines beyond its data.
    pub outside: Option<f64>,
}

/// Unit of the values of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TableUnit {
    /// Fractions of 1.
    Fraction,
    /// Percent.
    Percent,
    /// Optical density or absorbance, decimal.
    Od,
    /// Decibels.
    Db,
    /// Amperes per watt.
    APerW,
    /// Photons or moles of photons.
    Photons,
    /// Counts of a spectrometer, taken for photons.
    Counts,
    /// Energy or power.
    Energy,
}

impl From<TableUnit> for ValueUnit {
    fn from(unit: TableUnit) -> Self {
        match unit {
            TableUnit::Fraction => Self::Fraction,
            TableUnit::Percent => Self::Percent,
            TableUnit::Od => Self::OpticalDensity,
            TableUnit::Db => Self::Decibel,
            TableUnit::APerW => Self::AmperesPerWatt,
            TableUnit::Photons => Self::Photons,
            TableUnit::Counts => Self::Counts,
            TableUnit::Energy => Self::Energy,
        }
    }
}

/// One column of a MATLAB file of spectra, as ISET saves them: variables `wavelength` (nm) and `data`, a column a spectrum.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MatlabSpectrum {
    /// Path of the file, version 5 to 7.3.
    pub mat: FilePath,
    /// Number of the column of `data`, from 1 up. Default 1.
    pub column: Option<u32>,
    /// Factor on the values, for instance 0.01 for percent. Default 1.
    pub scale: Option<f64>,
}

/// A reflectance: a number from 0 to 1, a name of the catalogue, the path of a CSV file, a table that describes a
/// spectrum, or a list of { spectrum, weight }.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(extend("x-merge" = "replace"))]
pub enum ReflectanceReference {
    /// One spectrum.
    Spectrum(SpectrumReference),
    /// A weighted sum.
    Sum(Vec<ReflectanceTermSection>),
}

/// One term of a reflectance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReflectanceTermSection {
    /// Reflectance spectrum, 0 to 1.
    pub spectrum: SpectrumReference,
    /// Factor over the surface. Default 1.
    #[serde(default = "full_weight")]
    pub weight: TextureReference,
}

/// A number, or a map such as { image = "x.png" }, { checker = [8, 8] } or { noise = [5, 5] }.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(extend("x-merge" = "replace"))]
pub enum TextureReference {
    /// The same everywhere.
    Constant(f64),
    /// A map over texture coordinates.
    Map(Box<TextureTable>),
}

/// A map over texture coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum TextureTable {
    /// An image.
    Image(ImageMap),
    /// A checkerboard.
    Checker(CheckerMap),
    /// Smooth noise.
    Noise(NoiseMap),
    /// Porphyrin on the back of the tongue.
    DorsalTongue(TongueMap),
    /// A map of the mouth's anatomy.
    Anatomy(AnatomyMap),
}

/// A gray image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageMap {
    /// Path of a gray PNG image: black is `low`, white is `high`.
    pub image: FilePath,
    /// Whether the image is stored with the sRGB curve; otherwise its numbers are linear. Default false.
    #[serde(default, skip_serializing_if = "Not::not")]
    pub srgb: bool,
    /// Lowest value of the map. Default 0.
    #[serde(default)]
    pub low: f64,
    /// Highest value of the map. Default 1.
    #[serde(default = "unity")]
    pub high: f64,
    /// Another map by which this one is multiplied.
    pub times: Option<TextureReference>,
}

/// A checkerboard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CheckerMap {
    /// Fields along u and v, 1 to 10 000.
    pub checker: [u32; 2],
    /// Value of the first field. Default 0.
    #[serde(default)]
    pub low: f64,
    /// Value of the field next to it. Default 1.
    #[serde(default = "unity")]
    pub high: f64,
    /// Another map by which this one is multiplied.
    pub times: Option<TextureReference>,
}

/// Smooth noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NoiseMap {
    /// Cells along u and v, 0.1 to 10 000.
    pub noise: [f64; 2],
    /// Which noise. Default 1.
    #[serde(default = "seed")]
    pub seed: u32,
    /// Lowest value of the map. Default 0.
    #[serde(default)]
    pub low: f64,
    /// Highest value of the map. Default 1.
    #[serde(default = "unity")]
    pub high: f64,
    /// Another map by which this one is multiplied.
    pub times: Option<TextureReference>,
}

/// Porphyrin on the back of the tongue: most along the midline and far back, none at the tip and the sides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TongueMap {
    /// Where the porphyrin lies.
    pub dorsal_tongue: DorsalTongueMap,
    /// Another map by which this one is multiplied.
    pub times: Option<TextureReference>,
}

/// A map of the mouth's anatomy, on the texture coordinates of its parts. Needs a `[mouth]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AnatomyMap {
    /// Which map: `redness` (vessels, margins), `fungiform` (papillae of the dorsal tongue), `pallor` (keratin, coating),
    /// `porphyrin` (dorsal tongue), `plaque`, `dentin` and `crown` (teeth), `dryness` (film of saliva).
    pub anatomy: SurfaceMap,
    /// Tissue whose map it is. Default: the tissue that uses the material.
    pub tissue: Option<Tissue>,
    /// Seed of the map. Default: that of the mouth.
    pub seed: Option<u32>,
    /// Lowest value of the map. Default 0.
    #[serde(default)]
    pub low: f64,
    /// Highest value of the map. Default 1.
    #[serde(default = "unity")]
    pub high: f64,
    /// Another map by which this one is multiplied.
    pub times: Option<TextureReference>,
}

impl TextureTable {
    /// The map by which this one is multiplied.
    pub(crate) fn times(&self) -> Option<&TextureReference> {
        match self {
            Self::Image(map) => map.times.as_ref(),
            Self::Checker(map) => map.times.as_ref(),
            Self::Noise(map) => map.times.as_ref(),
            Self::DorsalTongue(map) => map.times.as_ref(),
            Self::Anatomy(map) => map.times.as_ref(),
        }
    }

    /// Lowest and highest value, of maps that have them as fields.
    pub(crate) fn range(&self) -> Option<[f64; 2]> {
        match self {
            Self::Image(ImageMap { low, high, .. })
            | Self::Checker(CheckerMap { low, high, .. })
            | Self::Noise(NoiseMap { low, high, .. })
            | Self::Anatomy(AnatomyMap { low, high, .. }) => Some([*low, *high]),
            Self::DorsalTongue(_) => None,
        }
    }
}

/// Where porphyrin lies on the back of a tongue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DorsalTongueMap {
    /// Largest concentration, in the unit of the catalogue; 0.5 to 0.7 is a strong patch.
    pub peak: f64,
    /// Standard deviation across the tongue, as a fraction of its width, 0.01 to 10. Default 0.3 (assumed).
    #[serde(default = "sigma")]
    pub sigma: f64,
    /// Fraction of the length from the tip at which the map reaches its full height, 0.01 to 1. Default 0.6.
    #[serde(default = "full_at")]
    pub full_at: f64,
    /// 0 = smooth, 1 = broken into patches. Default 0.6 (assumed).
    #[serde(default = "patchiness")]
    pub patchiness: f64,
    /// Which patches. Default 1.
    #[serde(default = "seed")]
    pub seed: u32,
}

/// A name of the catalogue, the path of a CSV file with one column per channel, or a table with one spectrum per channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(extend("x-merge" = "replace"))]
pub enum EfficiencyReference {
    /// A name of the catalogue, or the path of a CSV file with one column per channel.
    Text(NameOrTable),
    /// Such a file in a unit that its header does not name.
    Columns(EfficiencyColumns),
    /// A number, an equation or a column of a CSV file by channel, in electrons per photon.
    Channels(BTreeMap<String, SpectrumReference>),
}

/// A CSV file with one column per channel: `{ csv = "FILE", unit = "percent", scale = 0.9 }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EfficiencyColumns {
    /// Path of the file.
    pub csv: FilePath,
    /// Unit of the values. Default: what the header says.
    pub unit: Option<TableUnit>,
    /// Factor on the values, above 0. Default 1.
    pub scale: Option<f64>,
}

impl Default for EfficiencyReference {
    fn default() -> Self {
        Self::Text(NameOrTable::Name("consumer_rgb_cmos".into()))
    }
}

defaults! {
    full_weight: TextureReference = TextureReference::Constant(1.0);
    unity: f64 = 1.0;
    sigma: f64 = 0.3;
    full_at: f64 = 0.6;
    patchiness: f64 = 0.6;
    seed: u32 = 1;
}
