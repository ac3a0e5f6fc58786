//! The spectroradiometer as a second instrument, and what a safety assessment needs to know.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SpectrumReference;

/// A spectroradiometer in the place of the camera, pointed at a spot or at parts of the scene.
///
/// The defaults describe a spot instrument of the class of the PR-670; noise floor, dynamic range and stray light are
/// assumed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpectroradiometerSection {
    /// Name, unique among the spectroradiometers.
    pub name: String,
    /// Capture whose lights are on.
    pub capture: String,
    /// Where the middle of the spot lies in the image, from its left and its top edge, 0 to 1. Default: the middle,
    /// unless `parts` are given.
    pub aim: Option<[f64; 2]>,
    /// Parts of the scene over which the reading is averaged, by object name, instead of a spot.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<String>,
    /// Full angle of the round spot, degrees, 0.01 to 60. Default 1.
    #[serde(default = "default_acceptance_deg")]
    pub acceptance_deg: f64,
    /// Filters in front of the instrument. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub filters: Vec<SpectrumReference>,
    /// First wavelength that is read, nm, 200 to 1200. Default 380.
    #[serde(default = "default_first_nm")]
    pub first_nm: f64,
    /// Last wavelength that is read, nm, 200 to 1200. Default 780. Wavelengths whose slit reaches beyond the rendered bands
    /// are left out.
    #[serde(default = "default_last_nm")]
    pub last_nm: f64,
    /// Spacing of the readings, nm, 0.1 to 100. Default 2.
    #[serde(default = "default_step_nm")]
    pub step_nm: f64,
    /// Full width at half maximum of the triangular slit function, nm, 0.1 to 100. Default 8.
    #[serde(default = "default_bandwidth_nm")]
    pub bandwidth_nm: f64,
    /// Noise of a reading without light, W/(sr m² nm) rms, 0 to 1e6. Default 5e-7.
    #[serde(default = "default_noise_floor")]
    pub noise_floor_w_per_sr_m2_nm: f64,
    /// Largest ratio of signal to noise floor at every wavelength: the darkest part of a spectrum that can be told
    /// beside its peak, 1 to 1e12. Default 1e4.
    #[serde(default = "default_dynamic_range")]
    pub dynamic_range: f64,
    /// Share of the mean signal that is scattered evenly over all wavelengths, 0 to 0.1. Default 1e-5.
    #[serde(default = "default_stray_light")]
    pub stray_light: f64,
    /// Readings that are averaged, 1 to 1 000 000. Default 1.
    #[serde(default = "one_reading")]
    pub readings: u32,
}

/// Settings of the photobiological safety assessment. Without a distance there is no margin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SafetySection {
    /// Distance from the camera's pupil, along its axis, at which a patient's eye may look into the lights, mm, above 0.
    /// Default: unknown.
    pub patient_eye_distance_mm: Option<f64>,
    /// Distance from the lit mouth to the eye of the operator, who sees it by reflected light, mm, above 0. Default: unknown.
    pub operator_eye_distance_mm: Option<f64>,
    /// Distance from the camera's pupil, along its axis, to the nearest mucosa, mm, above 0. Default: the distance from the
    /// camera to the point that it looks at.
    pub mucosa_distance_mm: Option<f64>,
    /// Diameter of what the operator sees lit, mm, above 0. Default 60.
    pub lit_diameter_mm: f64,
    /// Diffuse reflectance of what the operator sees, 0 to 1. Default 1, the upper bound.
    pub reflectance: f64,
    /// Factor by which limits for skin are divided for mucosa, for which there are none, 1 to 1000. Default 10 (assumed) where
    /// a mouth is lit, else 1. A scene without a mouth counts as one where this is given.
    pub mucosa_safety_factor: Option<f64>,
    /// Whether the patient may be an infant or have no lens in the eye. Default false.
    pub aphakic: bool,
}

impl Default for SafetySection {
    fn default() -> Self {
        Self {
            patient_eye_distance_mm: None,
            operator_eye_distance_mm: None,
            mucosa_distance_mm: None,
            lit_diameter_mm: 60.0,
            reflectance: 1.0,
            mucosa_safety_factor: None,
            aphakic: false,
        }
    }
}

defaults! {
    default_acceptance_deg: f64 = 1.0;
    default_first_nm: f64 = 380.0;
    default_last_nm: f64 = 780.0;
    default_step_nm: f64 = 2.0;
    default_bandwidth_nm: f64 = 8.0;
    default_noise_floor: f64 = 5e-7;
    default_dynamic_range: f64 = 1e4;
    default_stray_light: f64 = 1e-5;
    one_reading: u32 = 1;
}
