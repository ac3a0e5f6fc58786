//! A flat, homogeneous, matte sample under even light: a study without geometry.

use super::Camera;
use crate::sensor::CaptureFrame;
use crate::spectral::{Curve, Fluorophore, WavelengthGrid};

/// How fluorescence is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FluorescenceModel {
    /// `L_f = (1/pi) integral Y_e(lo|li) E(li) dli` with physical yields.
    #[default]
    Physical,
    /// The authors' toolbox: each EEM on 365:5:705 nm with energy peak 1, `L_f(j) = c sum_i E_ji L_i` without a
    /// wavelength step, `L` being the radiance of a perfect white under the light. Spectra are sampled at bin centers,
    /// not averaged, and the sample's own grid must be 365:5:705 nm.
    Toolbox,
}

/// A flat, evenly lit sample before a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatSample {
    /// Wavelength bins.
    pub grid: WavelengthGrid,
    /// Irradiance on the sample behind all filters of the light, W/(m² nm).
    pub irradiance: Curve,
    /// Diffuse reflectance.
    pub reflectance: Curve,
    /// Fluorophores at unit concentration, and their concentrations.
    pub fluorophores: Vec<(Fluorophore, f64)>,
    /// Name of the fluorophore whose fraction is estimated; all others form the bulk.
    pub porphyrin: Option<String>,
    /// How fluorescence is computed.
    pub model: FluorescenceModel,
    /// The camera. Without a lens radiances are all that is predicted, without a sensor the irradiance on the film is the
    /// last thing.
    pub camera: Camera,
    /// Time, or the rule that finds it for the sensor's brightest channel, and gain.
    pub exposure: CaptureFrame,
}
