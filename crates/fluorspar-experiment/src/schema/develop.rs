//! Motion between exposures and the development of raw frames.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SpectrumReference;
use fluorspar::sensor::Demosaicing;

/// How the image moves on the sensor between exposures: a hand that holds the camera, a tongue that does not keep still.
///
/// The whole image shifts, evenly. With a global shutter it is at rest within an exposure; with a rolling shutter it drifts
/// on while row after row is exposed, so that it leans and blurs. Rotation and parallax are left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MotionSection {
    /// Steady motion of the image, pixels of the sensor per second: to the right, downward; -1e6 to 1e6. Default [0, 0].
    pub drift_px_per_s: [f64; 2],
    /// Random shift of each exposure, standard deviation in either direction, pixels, 0 to 1000. Default 0.
    pub jitter_px: f64,
    /// Time between the end of an exposure and the start of the next, ms, 0 to 1e6. Default 200.
    pub interval_ms: f64,
}

impl Default for MotionSection {
    fn default() -> Self {
        Self { drift_px_per_s: [0.0; 2], jitter_px: 0.0, interval_ms: 200.0 }
    }
}

/// Frames of even light from which the response of each pixel, the shading of the lens and bad pixels are known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlatFieldSection {
    /// Frames that are averaged, 1 to 1000. Default 16.
    #[serde(default = "default_frames")]
    pub frames: u32,
    /// Signal of the brightest channel on the axis, share of full scale, 0.01 to 0.95. Default 0.5.
    #[serde(default = "default_level")]
    pub level: f64,
    /// Spectrum of the light, of any scale. Default "equal_energy".
    #[serde(default = "equal_energy")]
    pub spectrum: SpectrumReference,
}

/// How raw frames become linear channels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DevelopSection {
    /// Interpolation of the colors: "bilinear", or "gradient_corrected" (Malvar, He, Cutler 2004; Bayer arrays only).
    /// Default "bilinear".
    pub demosaic: Demosaicing,
    /// Dark frames that are averaged and subtracted in place of the black level, for each exposure time and gain, 0 to
    /// 1000. Default 0: none are taken.
    pub dark_frames: u32,
    /// Flat field that every frame is divided by. Default: none.
    pub flat_field: Option<FlatFieldSection>,
    /// Pixels whose dark signal or response lies farther from the others than this many robust standard deviations are
    /// replaced by their neighbors, 1 to 1000; needs dark frames or a flat field. Default: none are replaced.
    pub bad_pixel_sigma: Option<f64>,
}

defaults! {
    default_frames: u32 = 16;
    default_level: f64 = 0.5;
    equal_energy: SpectrumReference = SpectrumReference::named("equal_energy");
}
