//! The file of a design problem: what may be chosen, what is assumed, what counts.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::part_file::sample::SampleMaterial;
use crate::schema::{
    FilePath, FluorophoreSection, FormatVersion, SpectralSection, SpectrumReference, TissueSection,
};

/// A design problem. Every list of choices is searched; designs are ranked by one criterion and kept within limits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DesignFile {
    /// Version of the form of this file: 1.
    pub format: FormatVersion,
    /// Name for people. Default: empty.
    #[serde(default)]
    pub title: String,
    /// Description of the problem. Default: empty.
    #[serde(default)]
    pub description: String,
    /// Wavelength bands of the emission. Default: 350 to 750 nm by 5 nm.
    #[serde(default)]
    pub spectral: SpectralSection,
    /// Wavelengths of the excitation.
    #[serde(default)]
    pub excitation: ExcitationSection,
    /// Regions that are measured; a design is as good as in the worst of them.
    #[serde(default)]
    pub region: Vec<RegionSection>,
    /// The scene in which rendered regions lie. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<RenderedSceneSection>,
    /// What is chosen of the scene itself: each value is rendered. All values of several variables are combined.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub geometry: Vec<GeometrySection>,
    /// Fluorophores besides those of the catalogue, or variants of those.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fluorophore: Vec<FluorophoreSection>,
    /// Layered tissues besides those of the catalogue, or in other states.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tissue: Vec<TissueSection>,
    /// People in two states, whom a design should tell apart. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cohort: Option<CohortSection>,
    /// Lights to choose from.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub light: Vec<LightChoiceSection>,
    /// A series of generic LEDs to choose from. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub led: Option<LedSeriesSection>,
    /// Viewing filters to choose from. Default: none in front of the lens.
    #[serde(default)]
    pub view_filter: Vec<FilterChoiceSection>,
    /// Sensors to choose from.
    #[serde(default)]
    pub sensor: Vec<SensorChoiceSection>,
    /// Lens.
    #[serde(default)]
    pub lens: LensChoiceSection,
    /// Exposures.
    #[serde(default)]
    pub exposure: ExposuresSection,
    /// What is not known besides the weights of the fluorophores.
    #[serde(default)]
    pub unknown: UnknownsSection,
    /// Ratios of amounts whose error is wanted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub contrast: Vec<ContrastSection>,
    /// What designs are ranked by. Default "minimax".
    #[serde(default)]
    pub criterion: CriterionChoice,
    /// Name of the contrast that designs are ranked by where the criterion is "contrast". Default: the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub criterion_contrast: Option<String>,
    /// What designs must keep to.
    #[serde(default)]
    pub limit: LimitsSection,
    /// An eye that looks into the lights, for their margin. Default: in a rendered scene that of `[safety]`, otherwise none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eye: Option<EyeSection>,
    /// How designs are searched.
    #[serde(default)]
    pub search: SearchSection,
    /// Manufacturing tolerances, for the worst case of the best design.
    #[serde(default)]
    pub tolerance: TolerancesSection,
    /// A design to compare the best with. Default: the first light behind the first filter on the first sensor.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub compare: Vec<ComparedDesignSection>,
}

/// Nodes between which the response to light is linear in its wavelength.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExcitationSection {
    /// First wavelength, nm, 200 to 1200. Default 320.
    pub first_nm: f64,
    /// Last wavelength, nm, 200 to 1200. Default 520.
    pub last_nm: f64,
    /// Distance of the nodes, nm, 0.5 to 20. Default 2.
    pub step_nm: f64,
}

impl Default for ExcitationSection {
    fn default() -> Self {
        Self { first_nm: 320.0, last_nm: 520.0, step_nm: 2.0 }
    }
}

/// A region that is measured: a flat material, or a part of a rendered scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegionSection {
    /// Name.
    pub name: String,
    /// What a flat region is made of: `{ reflectance = ..., concentrations = { ... } }` or `{ tissue = "dorsal_tongue" }`. The weights of
    /// its fluorophores are what is estimated. Default: none, the region is rendered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<SampleMaterial>,
    /// Fluorophores of a flat region with weights of their own; all others together are one, called "bulk". Default: each has its own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub apart: Vec<String>,
    /// Where the region lies in the rendered `[scene]`. Default: none, the region is flat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rendered: Option<RenderedRegionSection>,
}

/// A region of a rendered scene: parts, a rectangle, or where both hold.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RenderedRegionSection {
    /// Names of parts of the scene. Default: all.
    pub parts: Vec<String>,
    /// Column, row, width and height in pixels of the render. Default: the whole image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rectangle_px: Option<[u32; 4]>,
    /// Fluorophores with weights of their own; all others together are one, called "bulk". Default: each has its own.
    pub apart: Vec<String>,
    /// Changes of the scene for this region, for instance another person or pose: `["mouth.person=3"]`. Default: none.
    pub set: Vec<String>,
    /// Tissue of the region, for `unknown.tissue`: a `[[tissue]]` of this file or a site of the catalogue; several where it is not known
    /// which of them it is. Default: none, the tissue is known.
    pub tissue: Vec<String>,
}

/// The scene in which rendered regions lie. It is rendered with an excitation basis, once for each combination of the geometry and of what
/// regions change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct RenderedSceneSection {
    /// Where it comes from.
    #[serde(flatten)]
    pub source: SceneSource,
    /// Changes of the experiment, for instance `["render.width_px=96"]`. Default: none.
    #[serde(default)]
    pub set: Vec<String>,
    /// Light group whose place the lights of a design take. Default: the only one with a narrow spectrum.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_group: Option<String>,
    /// Range of the peaks of lights that the renders must serve, nm. Default: that of the lights of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peaks_nm: Option<[f64; 2]>,
}

/// Where a rendered scene comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum SceneSource {
    /// An experiment of the catalogue.
    Preset {
        /// Experiment of the catalogue.
        preset: String,
    },
    /// An experiment of a file.
    File {
        /// Path of an experiment file.
        file: FilePath,
    },
}

/// A variable of the scene, such as the radius of a ring of lights or the place of the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GeometrySection {
    /// Field of the experiment, for instance "light.blue.ring_radius_mm".
    pub field: String,
    /// Its values to choose from: numbers, lists of numbers, or texts.
    pub values: Vec<GeometryValue>,
    /// Working distance of the lens at each value, mm, where the values move the camera; beyond the focal length. Default: that of
    /// `[lens]` at all of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub working_distance_mm: Vec<f64>,
    /// Name in results. Default: the last word of the field.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
}

/// A value of a field: a number, a list of numbers, or a text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum GeometryValue {
    /// A number.
    Number(f64),
    /// A list of numbers, such as a position.
    List(Vec<f64>),
    /// A text.
    Text(String),
}

impl GeometryValue {
    /// As a change writes it.
    pub(super) fn text(&self) -> String {
        match self {
            Self::Number(value) => value.to_string(),
            Self::List(values) => format!("{values:?}"),
            Self::Text(text) => toml::Value::String(text.clone()).to_string(),
        }
    }
}

/// People with healthy tissue, and the same people with the tissue in another state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CohortSection {
    /// Tissue of the healthy: a `[[tissue]]`, or a site of the catalogue.
    pub tissue: String,
    /// State of the others, for instance "dysplasia".
    pub state: String,
    /// People in each group, 4 to 200. Default 24.
    #[serde(default = "cohort_size")]
    pub people: u32,
    /// Seed of the people. Default 1.
    #[serde(default = "cohort_seed")]
    pub seed: u64,
}

fn cohort_size() -> u32 {
    24
}

fn cohort_seed() -> u64 {
    1
}

/// A light to choose from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LightChoiceSection {
    /// Name.
    pub name: String,
    /// Spectrum, relative.
    pub spectrum: SpectrumReference,
    /// Filters on the light. Default: none.
    #[serde(default)]
    pub filters: Vec<SpectrumReference>,
    /// Irradiance of flat regions behind the filters, W/m², 1e-12 to 1e12. Default 10.
    #[serde(default = "default_irradiance")]
    pub irradiance_w_per_m2: f64,
    /// Power in the place of the first light of the group in a rendered scene, behind the filters, mW, 1e-12 to 1e12. Default: as much as
    /// that light has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub power_mw: Option<f64>,
    /// Price, in any unit, 0 or more. Default 0.
    #[serde(default)]
    pub cost: f64,
}

fn default_irradiance() -> f64 {
    10.0
}

/// Generic LEDs: Gaussian spectra, named by their peaks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LedSeriesSection {
    /// Wavelengths of the peaks, nm. Default: 340 to 500 nm by 5 nm.
    #[serde(default = "generic_peaks_nm")]
    pub peaks_nm: Vec<f64>,
    /// Full width at half maximum, nm, 1 to 100. Default 12.
    #[serde(default = "led_width")]
    pub fwhm_nm: f64,
    /// Short-pass filter of each, so many nanometers above its peak, 1 to 200; 10 % to 90 % over 5 nm, optical density 5.
    /// Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub short_pass_after_peak_nm: Option<f64>,
    /// Irradiance of flat regions by each, behind its filter, W/m², 1e-12 to 1e12. Default 10.
    #[serde(default = "default_irradiance")]
    pub irradiance_w_per_m2: f64,
    /// Power of each in a rendered scene, as that of a light, mW, 1e-12 to 1e12. Default: as much as the light in its place has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub power_mw: Option<f64>,
    /// Price of each, in any unit, 0 or more. Default 0.
    #[serde(default)]
    pub cost: f64,
}

fn generic_peaks_nm() -> Vec<f64> {
    (0..=32).map(|k| 340.0 + 5.0 * f64::from(k)).collect()
}

fn led_width() -> f64 {
    12.0
}

/// Viewing filters to choose from: one for each edge. An edge given in nm is ideal: it passes everything beyond, where a filter of the catalogue
/// passes less (`long_pass_475`: 0.95), and has the optical density below that is assumed here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FilterChoiceSection {
    /// Name.
    pub name: String,
    /// Filters that are the same for all exposures. Default: none.
    #[serde(default)]
    pub filters: Vec<SpectrumReference>,
    /// Long-pass edges, nm, 200 to 1200, one choice each. Default: none.
    #[serde(default)]
    pub long_pass_nm: Vec<f64>,
    /// Long-pass edges above the peak of the light of each exposure, nm, 0 to 400, one choice each; every exposure has a filter of
    /// its own. Default: none.
    #[serde(default)]
    pub long_pass_after_peak_nm: Vec<f64>,
    /// Distance from 10 % to 90 % of the long-pass edges, nm, 0.1 to 100. Default 8.
    #[serde(default = "edge_width")]
    pub edge_width_nm: f64,
    /// Optical density below the long-pass edges, 0 to 12, assumed: the leak of a light that ends before the edge follows from it. Default 5.
    #[serde(default = "edge_density")]
    pub optical_density: f64,
    /// Price of one, in any unit, 0 or more. Default 0.
    #[serde(default)]
    pub cost: f64,
}

fn edge_width() -> f64 {
    8.0
}

fn edge_density() -> f64 {
    5.0
}

/// A sensor to choose from: one of the catalogue, one of a file, or ideal bands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct SensorChoiceSection {
    /// Name.
    pub name: String,
    /// What it is.
    #[serde(flatten)]
    pub source: SensorSource,
    /// Filters on the sensor. Default: none.
    #[serde(default)]
    pub filters: Vec<SpectrumReference>,
    /// Filters of a wheel before a sensor of one channel: the time of every exposure is shared evenly among them, and each is a channel.
    /// Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub wheel: Vec<WheelFilterSection>,
    /// Analog gain, 0.01 to 1000. Default 1.
    #[serde(default = "unity")]
    pub gain: f64,
    /// Price, in any unit, 0 or more. Default 0.
    #[serde(default)]
    pub cost: f64,
}

/// What a sensor to choose from is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum SensorSource {
    /// One of the catalogue.
    Preset {
        /// Sensor of the catalogue.
        preset: String,
    },
    /// One of a file.
    File {
        /// Path of a sensor file.
        file: FilePath,
    },
    /// Ideal bands.
    Bands {
        /// Ideal Gaussian bands.
        bands: IdealBandsSection,
    },
}

/// A filter of a wheel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WheelFilterSection {
    /// Name of its channel.
    pub name: String,
    /// What it is made of, one behind the other.
    pub filters: Vec<SpectrumReference>,
}

fn unity() -> f64 {
    1.0
}

/// A sensor of Gaussian bands with nothing but read noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IdealBandsSection {
    /// Centers, nm, 200 to 1200; one channel each.
    pub centers_nm: Vec<f64>,
    /// Standard deviations, nm, 0.5 to 200: one for all, or one for each.
    pub sigma_nm: Vec<f64>,
    /// Electrons per photon at the center, 1e-6 to 1. Default 0.5.
    #[serde(default = "half_of_full")]
    pub peak: f64,
    /// Read noise, e- rms, 0 to 1e6. Default 2.
    #[serde(default = "default_read_noise_e")]
    pub read_noise_e: f64,
    /// Electrons that a pixel holds, 1 to 1e9. Default 10000.
    #[serde(default = "default_full_well_e")]
    pub full_well_e: f64,
    /// Side of a pixel, um, 0.1 to 1000. Default 3.
    #[serde(default = "default_pixel_size_um")]
    pub pixel_size_um: f64,
}

fn half_of_full() -> f64 {
    0.5
}

fn default_read_noise_e() -> f64 {
    2.0
}

fn default_pixel_size_um() -> f64 {
    3.0
}

fn default_full_well_e() -> f64 {
    10_000.0
}

/// An ideal lens and its apertures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LensChoiceSection {
    /// Focal length, mm, 0.001 to 1e6. Default 3.
    pub focal_length_mm: f64,
    /// Apertures to choose from, 0.5 to 1000: focal length over the diameter of the pupil. Default 4.
    pub f_numbers: Vec<f64>,
    /// Distance of the region, mm, beyond the focal length. Default: infinity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_mm: Option<f64>,
    /// Transmittance of the glass. Default 1.
    pub transmittance: SpectrumReference,
}

impl Default for LensChoiceSection {
    fn default() -> Self {
        Self {
            focal_length_mm: 3.0,
            f_numbers: vec![4.0],
            distance_mm: None,
            transmittance: SpectrumReference::default(),
        }
    }
}

/// How exposures share the budget: a rule, or the share of the time for the shortest wavelength, between 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum SplitChoice {
    /// Share of the time for the first exposure; the others have equal parts of the rest.
    First(f64),
    /// A rule.
    Rule(SplitRule),
}

/// A rule by which exposures share the budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SplitRule {
    /// Equal times.
    EqualTime,
    /// Equal electrons in the first region.
    EqualElectrons,
}

/// What all exposures have together: `ms`, or `electrons`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, deny_unknown_fields)]
#[schemars(extend("x-merge" = "replace"))]
pub enum ExposureTotal {
    /// A time.
    Time {
        /// Time, ms, 1e-3 to 3 600 000.
        ms: f64,
    },
    /// Light that arrives, whatever time it takes.
    Electrons {
        /// Electrons of all channels of all exposures in the first region, one pixel of each channel, 1 to 1e12.
        electrons: f64,
    },
}

impl Default for ExposureTotal {
    fn default() -> Self {
        Self::Time { ms: 30.0 }
    }
}

/// Numbers of exposures under different lights, and what they have together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend("x-renamed" = { "total_ms": "total.ms", "total_electrons": "total.electrons" }))]
pub struct ExposuresSection {
    /// Numbers of exposures to choose from, 1 to 6, each under another light. Default 1.
    pub counts: Vec<u32>,
    /// What all of them have together. Default 30 ms.
    pub total: ExposureTotal,
    /// How two or more of them share it, to choose from. Default "equal_time".
    pub splits: Vec<SplitChoice>,
    /// Factors on all lights to choose from, 1e-6 to 1e6. Default 1.
    pub drives: Vec<f64>,
    /// A frame under white light, whose data count as well. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub white: Option<WhiteFrameSection>,
}

impl Default for ExposuresSection {
    fn default() -> Self {
        Self {
            counts: vec![1],
            total: ExposureTotal::default(),
            splits: vec![SplitChoice::Rule(SplitRule::EqualTime)],
            drives: vec![1.0],
            white: None,
        }
    }
}

/// A frame under white light without the viewing filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WhiteFrameSection {
    /// Spectrum, relative. Default "white_led".
    #[serde(default = "white_led")]
    pub spectrum: SpectrumReference,
    /// Irradiance of flat regions, W/m², 1e-12 to 1e12. Default 10.
    #[serde(default = "default_irradiance")]
    pub irradiance_w_per_m2: f64,
    /// Power in a rendered scene, in the place of the lights of the design, mW, 1e-12 to 1e12. Default: as much as the light there has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub power_mw: Option<f64>,
    /// Filters in front of the sensor. Default: none.
    #[serde(default)]
    pub filters: Vec<SpectrumReference>,
    /// Signal of the brightest channel in the first region, share of what a pixel holds, 0.001 to 1. Default 0.5.
    #[serde(default = "half_of_full")]
    pub level: f64,
    /// Price of the light, in any unit, 0 or more. Default 0.
    #[serde(default)]
    pub cost: f64,
}

fn white_led() -> SpectrumReference {
    SpectrumReference::named("white_led")
}

/// What is not known besides the weights: standard deviations of normal priors; 0 is known exactly. With all of them 0 results are best cases.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct UnknownsSection {
    /// Factor common to all exposures, relative, 0 to 10, which is as good as no knowledge: distance, shading. Default 0.
    pub gain: f64,
    /// Factor of each exposure, relative, 0 to 10: current and age of its light. Default 0.
    pub drive: f64,
    /// Reflected light that passes the filters, relative, 0 to 10. Default 0.
    pub leak: f64,
    /// Factor on the spread of layered tissue among people (blood, oxygen, thickness, melanin), and among the sites where a rendered
    /// region may be of several, 0 to 10; 0: the tissue is known. Default 0.
    pub tissue: f64,
    /// Thickness of whole blood that light passes on its way into a surface and again out of it, um, 0 to 1000. Default 0.
    pub blood_um: f64,
    /// What is known of weights before, by fluorophore: standard deviation over the amount that the region holds, 1e-6 to 1e6. With them
    /// a design of few channels tells more fluorophores apart. Default: nothing.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub weights: BTreeMap<String, f64>,
    /// Shift of the emission of each fluorophore, nm, 0 to 100: libraries differ by 5 to 25 nm. Default 0.
    pub emission_shift_nm: f64,
    /// Shift of its excitation, nm, 0 to 100. Default 0.
    pub excitation_shift_nm: f64,
    /// Smooth relative error of its emission and of its excitation spectrum, 0 to 1. Default 0.
    pub spectrum: f64,
    /// Distance over which that error is alike, nm, 5 to 500. Default 40.
    pub correlation_nm: f64,
    /// Pixels of the sensor that a region is averaged over, 1 to 1e9. Default 1000.
    pub pixels: f64,
    /// Brightest fluorescence of the scene over that of the region, 1 to 1e6. Default 1.
    pub brightest_fluorescence: f64,
    /// Brightest reflection of the scene, highlights included, over that of the region, 1 to 1e6. Default 1.
    pub brightest_reflection: f64,
}

impl Default for UnknownsSection {
    fn default() -> Self {
        Self {
            gain: 0.0,
            drive: 0.0,
            leak: 0.0,
            tissue: 0.0,
            blood_um: 0.0,
            weights: BTreeMap::new(),
            emission_shift_nm: 0.0,
            excitation_shift_nm: 0.0,
            spectrum: 0.0,
            correlation_nm: 40.0,
            pixels: 1000.0,
            brightest_fluorescence: 1.0,
            brightest_reflection: 1.0,
        }
    }
}

/// A ratio of amounts, such as NADH / (NADH + FAD). In layered tissue and in rendered scenes an amount is the light that a fluorophore sends between
/// 500 and 700 nm under 405 nm.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ContrastSection {
    /// Name.
    pub name: String,
    /// Fluorophores of the numerator.
    pub part: Vec<String>,
    /// Fluorophores of the denominator. Default: all.
    #[serde(default)]
    pub whole: Vec<String>,
}

/// What designs are ranked by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CriterionChoice {
    /// Worst relative standard deviation of a weight.
    #[default]
    Minimax,
    /// Volume of the error ellipsoid.
    D,
    /// Mean variance.
    A,
    /// Worst combination of weights.
    E,
    /// Standard deviation of a contrast.
    Contrast,
    /// `d'` of the cohort.
    Detection,
    /// Reflected electrons per fluorescent electron.
    Leak,
}

/// What designs must keep to. Default: a pixel does not overflow, nothing else.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LimitsSection {
    /// Smallest photobiological margin of the tissue under all exposures together, 0.001 to 1e9. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tissue_margin: Option<f64>,
    /// Smallest photobiological margin of an eye that looks into the lights of all exposures (`[eye]`), 0.001 to 1e9. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eye_margin: Option<f64>,
    /// Former name of `tissue_margin`. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub safety_margin: Option<f64>,
    /// Factor by which mucosa is taken to be more sensitive than skin, 1 to 1000. Default 10.
    pub tissue_safety_factor: f64,
    /// Largest ratio of reflected to fluorescent electrons, 0 to 1e6. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leak: Option<f64>,
    /// Largest share of what a pixel holds in the brightest one, highlights included, 1e-6 to 1e6. Default 1: what saturates is no measurement.
    /// A larger number lets designs saturate.
    pub saturation: f64,
    /// Longest time of all exposures, the white frame included, ms, 1e-6 to 1e9. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub total_ms: Option<f64>,
    /// Highest price. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
}

impl Default for LimitsSection {
    fn default() -> Self {
        Self {
            tissue_margin: None,
            eye_margin: None,
            safety_margin: None,
            tissue_safety_factor: 10.0,
            leak: None,
            saturation: 1.0,
            total_ms: None,
            cost: None,
        }
    }
}

/// An eye that looks into the lights of a design: before flat regions by the light that it gets and the size of its source, in a rendered
/// scene by its place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EyeSection {
    /// Angle that the light source subtends for the eye, mrad, 0.1 to 3000: a small one is worse for the retina. Flat regions need it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source_mrad: Option<f64>,
    /// Irradiance of the eye over that of flat regions, 1e-6 to 1e6. Default 1: the eye is where the region is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub irradiance_share: Option<f64>,
    /// Place of the eye in a rendered scene: distance from the camera's pupil along its axis, mm, 1 to 100 000. Default:
    /// `safety.patient_eye_distance_mm` of the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_mm: Option<f64>,
    /// Whether it may be that of an infant, or without its lens. Default false.
    pub aphakic: bool,
}

/// How designs are searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SearchSection {
    /// Most designs that `optimize` evaluates all of; of more it searches by exchange. 1 to 100 000 000. Default 1 000 000.
    pub most_exhaustive: u64,
    /// Evaluations of a search by exchange, 1 to 10 000 000. Default 1000.
    pub evaluations: u64,
    /// Seed of the search by exchange. Default 1.
    pub seed: u64,
    /// Best designs that are written in full, 1 to 10 000. Default 50.
    pub keep: u32,
}

impl Default for SearchSection {
    fn default() -> Self {
        Self { most_exhaustive: 1_000_000, evaluations: 1000, seed: 1, keep: 50 }
    }
}

/// Manufacturing tolerances.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TolerancesSection {
    /// Peak of a light, nm, 0 to 50. Default 3.
    pub light_nm: f64,
    /// Edge of a filter, nm, 0 to 50. Default 2.
    pub filter_nm: f64,
    /// Largest angle at which light passes an interference filter, degrees, 0 to 60. Default 15.
    pub angle_deg: f64,
    /// Effective refractive index of the filter, 1 to 4. Default 1.8.
    pub effective_index: f64,
}

impl Default for TolerancesSection {
    fn default() -> Self {
        Self { light_nm: 3.0, filter_nm: 2.0, angle_deg: 15.0, effective_index: 1.8 }
    }
}

/// A design by the names of its choices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ComparedDesignSection {
    /// Name.
    pub name: String,
    /// Names of its lights.
    pub lights: Vec<String>,
    /// Viewing filter. Default: the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view_filter: Option<String>,
    /// Sensor. Default: the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<String>,
    /// Aperture. Default: the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub f_number: Option<f64>,
    /// Geometry, as results call it, for instance "ring_radius_mm 35". Default: the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub geometry: Option<String>,
}
