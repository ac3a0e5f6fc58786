//! The file of a design problem: what may be chosen, what is assumed, what counts.

use std::collections::BTreeMap;

use fluorspar::design::{Assumptions, ContrastDefinition, LibraryError, Split, Tolerances};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::part_file::sample::SampleMaterial;
use crate::schema::{ExperimentFile, FilePath, SpectrumReference};

/// A design problem: an experiment from which everything fixed is taken, fields of it that may be chosen, and the question. Its sections
/// are those of an experiment and those of the question.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DesignFile {
    /// Light, filters, sensor, lens, wavelengths, fluorophores, tissues and, for rendered regions, the scene.
    #[serde(flatten)]
    pub experiment: ExperimentFile,
    /// What is asked.
    #[serde(flatten)]
    pub question: DesignQuestion,
}

/// The question of a design problem: what may be chosen, what is assumed, what counts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DesignQuestion {
    /// Fields of the experiment that may be chosen. Every combination of their values is a design. Default: none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub vary: Vec<VarySection>,
    /// Wavelengths of the excitation.
    pub excitation: ExcitationSection,
    /// Regions that are measured; a design is as good as in the worst of them.
    pub region: Vec<RegionSection>,
    /// People in two states, whom a design should tell apart. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cohort: Option<CohortSection>,
    /// Exposures.
    pub exposure: ExposuresSection,
    /// What is not known besides the weights of the fluorophores.
    pub unknown: UnknownsSection,
    /// Ratios of amounts whose error is wanted.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub contrast: Vec<ContrastDefinition>,
    /// What designs are ranked by. Default "minimax".
    pub criterion: CriterionChoice,
    /// Name of the contrast that designs are ranked by where the criterion is "contrast". Default: the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub criterion_contrast: Option<String>,
    /// What designs must keep to.
    pub limit: LimitsSection,
    /// An eye that looks into the lights of flat regions, for their margin; of a rendered scene that of `[safety]`. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eye: Option<EyeSection>,
    /// How designs are searched.
    pub search: SearchSection,
    /// Manufacturing tolerances, for the worst case of the best design.
    pub tolerance: Tolerances,
    /// A design to compare the best with. Default: the first value of every variable.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub compare: Vec<ComparedDesignSection>,
}

/// A variable of the design: a field of the experiment and its values.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct VarySection {
    /// Name in results and in the paths of changes. Default: the last word of the field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Path of the field: of a light (`light.blue`, its `spectrum`, `filters` or `strength`), `view_filter.filters`, `sensor`,
    /// `lens.f_number`; or of what a rendered region shows, in `camera`, `mouth`, `object`, `material` or the place of a light.
    pub field: String,
    /// Values. A table is put on top of what the experiment says, as a file on top of its base; all else takes its place.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(with = "Vec<serde_json::Value>")]
    pub values: Vec<toml::Value>,
    /// LEDs as further values, for a field such as `light.blue`. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub led: Option<LedSeriesSection>,
    /// Long-pass edges behind the viewing filters of the experiment as further values, for the field `view_filter`. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub long_pass: Option<LongPassSection>,
    /// Sensors of ideal bands as further values, for the field `sensor`. Default: none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bands: Vec<IdealBandsSection>,
    /// Sensor files as further values, for the field `sensor`. Default: none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sensor_files: Vec<FilePath>,
    /// Names of all values. Default: what they say.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub names: Vec<String>,
    /// Prices, in any unit, 0 or more: of each value, or one for all. Default 0.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub costs: Vec<f64>,
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
    /// Where the region lies in the rendered scene. Default: none, the region is flat.
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

/// People with healthy tissue, and the same people with the tissue in another state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CohortSection {
    /// Tissue of the healthy: a `[[tissue]]`, or a site of the catalogue.
    pub tissue: String,
    /// State of the others, for instance "dysplasia_moderate".
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

/// Generic LEDs: Gaussian spectra, named by their peaks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LedSeriesSection {
    /// Wavelengths of the peaks, nm, 250 to 1100. Default: 340 to 500 nm by 5 nm.
    pub peaks_nm: Vec<f64>,
    /// Full width at half maximum, nm, 1 to 100. Default 12.
    pub fwhm_nm: f64,
    /// Short-pass filter of each, so many nanometers above its peak, 1 to 200; 10 % to 90 % over 5 nm, optical density 5.
    /// Default: the filters of the light in the experiment.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub short_pass_after_peak_nm: Option<f64>,
}

impl Default for LedSeriesSection {
    fn default() -> Self {
        let peaks_nm = (0..=32).map(|k| 340.0 + 5.0 * f64::from(k)).collect();
        Self { peaks_nm, fwhm_nm: 12.0, short_pass_after_peak_nm: None }
    }
}

/// Long-pass edges. They are ideal: they pass everything beyond, where a filter of the catalogue passes less (`long_pass_475`: 0.95), and have
/// the optical density below that is assumed here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LongPassSection {
    /// Edges, nm, 200 to 1200. Default: none.
    pub edges_nm: Vec<f64>,
    /// Edges above the peak of the light of each exposure, nm, 0 to 400; every exposure has a filter of its own. Default: none.
    pub after_peak_nm: Vec<f64>,
    /// Distance from 10 % to 90 %, nm, 0.1 to 100. Default 8.
    pub width_nm: f64,
    /// Optical density below the edge, 0 to 12, assumed: the leak of a light that ends before the edge follows from it. Default 5.
    pub optical_density: f64,
}

impl Default for LongPassSection {
    fn default() -> Self {
        Self { edges_nm: Vec::new(), after_peak_nm: Vec::new(), width_nm: 8.0, optical_density: 5.0 }
    }
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

/// A sensor of Gaussian bands with nothing but read noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct IdealBandsSection {
    /// Centers, nm, 200 to 1200; one channel each.
    pub centers_nm: Vec<f64>,
    /// Standard deviations, nm: one for all, or one for each.
    pub sigma_nm: Vec<f64>,
    /// Electrons per photon at the center, up to 1. Default 0.5.
    pub peak: f64,
    /// Read noise, e- rms, 0 or more. Default 2.
    pub read_noise_e: f64,
    /// Electrons that a pixel holds, 1 or more. Default 10000.
    pub full_well_e: f64,
    /// Side of a pixel, um. Default 3.
    pub pixel_size_um: f64,
}

impl Default for IdealBandsSection {
    fn default() -> Self {
        Self {
            centers_nm: Vec::new(),
            sigma_nm: Vec::new(),
            peak: 0.5,
            read_noise_e: 2.0,
            full_well_e: 10_000.0,
            pixel_size_um: 3.0,
        }
    }
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
    /// How two or more of them share it, to choose from: a rule, or the share of the time for the shortest wavelength, 0.001 to 0.999.
    /// Default "equal_time".
    pub splits: Vec<Split>,
    /// Factors on all lights to choose from, 1e-6 to 1e6. Default 1.
    pub drives: Vec<f64>,
    /// Filters of a wheel before sensors of one channel: the time of every exposure is shared evenly among them, and each is a channel.
    /// Default: none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub wheel: Vec<WheelFilterSection>,
    /// A frame under white light, whose data count as well. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub white: Option<WhiteFrameSection>,
}

impl Default for ExposuresSection {
    fn default() -> Self {
        Self {
            counts: vec![1],
            total: ExposureTotal::default(),
            splits: vec![Split::EqualTime],
            drives: vec![1.0],
            wheel: Vec::new(),
            white: None,
        }
    }
}

/// A frame under a light of the experiment without the viewing filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WhiteFrameSection {
    /// Name of the light; in rendered regions it shines in the place of the light that is designed. Default "white".
    pub light: String,
    /// Filters in front of the sensor. Default: none.
    pub filters: Vec<SpectrumReference>,
    /// Signal of the brightest channel in the first region, share of what a pixel holds, 0.001 to 1. Default 0.5.
    pub level: f64,
    /// Price of the light, in any unit, 0 or more. Default 0.
    pub cost: f64,
}

impl Default for WhiteFrameSection {
    fn default() -> Self {
        Self { light: "white".into(), filters: Vec::new(), level: 0.5, cost: 0.0 }
    }
}

/// What is not known besides the weights: standard deviations of normal priors; 0 is known exactly. With all of them 0 results are best cases.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(deny_unknown_fields)]
pub struct UnknownsSection {
    /// What is not known of exposures, and how large and bright a region is.
    #[serde(flatten)]
    pub assumptions: Assumptions,
    /// What is not known of the spectra of fluorophores.
    #[serde(flatten)]
    pub library: LibraryError,
    /// Factor on the spread of layered tissue among people (blood, oxygen, thickness, melanin), and among the sites where a rendered
    /// region may be of several, 0 to 10; 0: the tissue is known. Default 0.
    pub tissue: f64,
    /// Thickness of whole blood that light passes on its way into a surface and again out of it, um, 0 to 1000. Default 0.
    pub blood_um: f64,
    /// What is known of weights before, by fluorophore: standard deviation over the amount that the region holds, 1e-6 to 1e6. With them
    /// a design of few channels tells more fluorophores apart. Default: nothing.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub weights: BTreeMap<String, f64>,
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
            tissue_safety_factor: 10.0,
            leak: None,
            saturation: 1.0,
            total_ms: None,
            cost: None,
        }
    }
}

/// An eye that looks into the lights of flat regions: how much light it gets, and how large its source is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EyeSection {
    /// Angle that the light source subtends for the eye, mrad, 0.1 to 3000: a small one is worse for the retina.
    #[schemars(extend("x-expected" = "its diameter over its distance, mrad"))]
    pub source_mrad: f64,
    /// Irradiance of the eye over that of flat regions, 1e-6 to 1e6. Default 1: the eye is where the region is.
    #[serde(default = "as_bright")]
    pub irradiance_share: f64,
}

fn as_bright() -> f64 {
    1.0
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

/// A design by the names of its choices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ComparedDesignSection {
    /// Name.
    pub name: String,
    /// Names of its lights.
    pub lights: Vec<String>,
    /// Viewing filter, as results call it, and so on. Default: the first.
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
