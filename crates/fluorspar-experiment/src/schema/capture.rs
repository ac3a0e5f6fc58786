//! Exposures, analysis and output.

use std::borrow::Cow;
use std::collections::BTreeMap;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

use super::number_or_word::NumberOrWord;
use super::{RegionReference, SensorRegionSection, SpectrumReference};
use fluorspar::sensor::AutoExposure;
use fluorspar::study::{AnalysisPlan, TissuePrior};

/// Name of the porphyrin in the catalogue.
pub const DEFAULT_PORPHYRIN: &str = "protoporphyrin_ix";

/// Exposure time: milliseconds, or chosen by the camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "NumberOrWord", into = "NumberOrWord")]
pub enum ExposureTime {
    /// Milliseconds.
    Milliseconds(f64),
    /// So that the brightest part of the image is just below saturation.
    Auto,
}

impl TryFrom<NumberOrWord> for ExposureTime {
    type Error = String;

    fn try_from(value: NumberOrWord) -> Result<Self, String> {
        Ok(value.number("auto")?.map_or(Self::Auto, Self::Milliseconds))
    }
}

impl From<ExposureTime> for NumberOrWord {
    fn from(time: ExposureTime) -> Self {
        match time {
            ExposureTime::Milliseconds(value) => Self::Number(value),
            ExposureTime::Auto => Self::Word("auto".into()),
        }
    }
}

impl JsonSchema for ExposureTime {
    fn schema_name() -> Cow<'static, str> {
        "ExposureTime".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "A number of milliseconds, or \"auto\".",
            "anyOf": [{ "type": "number", "exclusiveMinimum": 0 }, { "const": "auto" }]
        })
    }
}

/// One exposure of the sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaptureSection {
    /// Name, unique among the captures: letters, digits, `_`, `-`, `+`, `.` and spaces between them; files carry it.
    pub name: String,
    /// Light groups that are on, with their drive relative to the stated power, 0 or more. Default: all dark.
    #[serde(default)]
    #[schemars(extend("x-merge" = "replace"))]
    pub light_groups: BTreeMap<String, f64>,
    /// Exposure time in milliseconds, 1e-6 to 3 600 000, or "auto". Default "auto".
    #[serde(default = "auto")]
    pub exposure_ms: ExposureTime,
    /// Target of automatic exposure. Default: the 99th percentile of the pixels at 80 % of saturation, 0.01 to 1000 ms.
    pub auto_exposure: Option<AutoExposure>,
    /// Analog gain, 0.01 to 1000. Default 1.
    #[serde(default = "unity")]
    pub gain: f64,
    /// Filters in front of the sensor in this capture only, at normal incidence, multiplied: a place of a filter wheel. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub filters: Vec<SpectrumReference>,
    /// Name of an earlier capture whose image is subtracted, scaled by exposure time: ambient light. Default: none.
    pub subtract: Option<String>,
    /// Further exposures of the same view and gain, in stops (factors of two in time) from the exposure time, -16 to 16; all
    /// of them are merged to one frame of higher dynamic range, weighted by their noise. At most 31. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bracket_ev: Vec<f64>,
    /// How long the lights are on, ms, 1e-6 to 3 600 000: what the safety assessment counts. Default: the sum of the
    /// exposure times.
    pub light_on_ms: Option<f64>,
}

/// Analysis of the captures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields, extend("x-renamed" = {
    "bulk_material": "bulk = \"...\""
}))]
pub struct AnalysisSection {
    /// Capture that is analyzed.
    pub frame: String,
    /// Where the region of interest lies.
    #[serde(flatten)]
    pub place: SensorRegionSection,
    /// Pixels of the sensor by which the region keeps away from the rim of these parts, 0 to 64: pixels at the rim hold light of
    /// what lies beside, as of teeth and lips. Default 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub inset_px: u32,
    /// Two regions of the sensor whose pixels are compared: how well the frames tell them apart. Default: none.
    pub compared_px: Option<[RegionReference; 2]>,
    /// Further regions of the frame, each analyzed by itself. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub region: Vec<AnalysisRegionSection>,
    /// Fluorophore whose share is estimated; "none" for no such estimate. Default: the porphyrin that the region holds, else that of
    /// the scene; where there is none "protoporphyrin_ix", but "none" if the scene holds a fluorophore that no tissue has.
    pub porphyrin: Option<String>,
    /// Fluorophores that form the bulk of the tissue: the name of a material, whose fluorophores count without the
    /// porphyrin (where a concentration is a map, with its mean over the region), or a table of concentrations. Default: the
    /// material of the first part.
    pub bulk: Option<BulkReference>,
    /// Tissue of the region, for an estimate that knows how tissue varies: a `[[tissue]]` or a site of the catalogue; "none" for no
    /// such estimate. Default: the site that the material of the first part is made of, if it is layered tissue.
    pub tissue: Option<String>,
    /// Probability beforehand that the region is this tissue, 0.01 to 1. The estimate is an average over it and the tissues
    /// `dorsal_tongue`, `buccal_mucosa`, `hard_palate` and `lip`, which share the rest; 1: none of these is compared. Default 0.9.
    #[serde(default = "tissue_probability")]
    pub tissue_probability: f64,
    /// Further captures that enter this estimate, by name. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub further_frames: Vec<String>,
    /// How various the tissue is thought to be, over what people differ by, 0.01 to 10. Default 1.25.
    #[serde(default = "prior_width")]
    pub prior_width: f64,
    /// Relative error of the spectra of the library at each wavelength, 0 to 1; channels average over it. Default 0.03.
    #[serde(default = "library_error")]
    pub library_error: f64,
    /// d' that a target shall reach, 0.1 to 100: how many frames it takes, and the smallest diameter. Default 3.29, which errs in 5 % of
    /// cases either way.
    #[serde(default = "wanted_d_prime")]
    pub wanted_d_prime: f64,
    /// Pixels whose R + G + B is below this many standard deviations of its noise have no chromaticity, 0 to 1000.
    /// Default 5.
    #[serde(default = "noise_threshold")]
    pub noise_threshold: f64,
}

/// A region that is analyzed by itself, beside that of `[analysis]` and in the same frame: parts of the scene, a shape on the sensor, or
/// where both hold. What it does not say is as in `[analysis]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct AnalysisRegionSection {
    /// Name, unique among regions.
    pub name: String,
    /// Where it lies.
    #[serde(flatten)]
    pub place: SensorRegionSection,
    /// Pixels of the sensor by which the region keeps away from the rim of its parts, 0 to 64. Default: as in `[analysis]`.
    pub inset_px: Option<u32>,
    /// Fluorophore whose share is estimated; "none" for no such estimate. Default: as in `[analysis]`; where that names none the porphyrin
    /// that this region holds.
    pub porphyrin: Option<String>,
    /// Fluorophores that form the bulk of the tissue, as in `[analysis]`. Default: the material of its first part; of a region without
    /// parts what `[analysis]` names.
    pub bulk: Option<BulkReference>,
    /// Tissue of the region, a `[[tissue]]` or a site of the catalogue; "none" for no estimate that knows tissue. Default: the site that
    /// the material of its first part is made of; of a region without parts what `[analysis]` names.
    pub tissue: Option<String>,
    /// Probability beforehand that the region is this tissue, 0.01 to 1. Default: as in `[analysis]`.
    pub tissue_probability: Option<f64>,
    /// Further captures that enter this estimate, by name. Default: as in `[analysis]`.
    pub further_frames: Option<Vec<String>>,
    /// How various the tissue is thought to be, over what people differ by, 0.01 to 10. Default: as in `[analysis]`.
    pub prior_width: Option<f64>,
    /// Relative error of the spectra of the library at each wavelength, 0 to 1. Default: as in `[analysis]`.
    pub library_error: Option<f64>,
    /// Pixels whose R + G + B is below this many standard deviations of its noise have no chromaticity, 0 to 1000. Default: as in
    /// `[analysis]`.
    pub noise_threshold: Option<f64>,
}

/// The name of a material, or a table of concentrations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum BulkReference {
    /// A material.
    Material(String),
    /// Concentrations by fluorophore.
    Concentrations(BTreeMap<String, f64>),
}

fn is_zero(value: &u32) -> bool {
    *value == 0
}

/// Where results go.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OutputSection {
    /// Folder for the results, relative to where the program runs. Default: chosen by the program.
    pub folder: Option<String>,
}

defaults! {
    auto: ExposureTime = ExposureTime::Auto;
    unity: f64 = 1.0;
    prior_width: f64 = TissuePrior::WIDTH;
    tissue_probability: f64 = TissuePrior::SITE_PROBABILITY;
    library_error: f64 = TissuePrior::LIBRARY_ERROR;
    wanted_d_prime: f64 = AnalysisPlan::WANTED_D_PRIME;
    noise_threshold: f64 = 5.0;
}
