//! Camera, lens, viewing filter and sensor.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

use super::number_or_word::NumberOrWord;
use super::{EfficiencyReference, NameOrFile, SpectrumReference};
use fluorspar::optics::Vignetting;
use fluorspar::sensor::SensorModel;

/// A number, or what the lens gives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "NumberOrWord", into = "NumberOrWord")]
pub enum LensOrNumber {
    /// What the lens gives.
    #[default]
    FromLens,
    /// The number.
    Number(f64),
}

impl TryFrom<NumberOrWord> for LensOrNumber {
    type Error = String;

    fn try_from(value: NumberOrWord) -> Result<Self, String> {
        Ok(value.number("from_lens")?.map_or(Self::FromLens, Self::Number))
    }
}

impl From<LensOrNumber> for NumberOrWord {
    fn from(value: LensOrNumber) -> Self {
        match value {
            LensOrNumber::Number(value) => Self::Number(value),
            LensOrNumber::FromLens => Self::Word("from_lens".into()),
        }
    }
}

impl JsonSchema for LensOrNumber {
    fn schema_name() -> Cow<'static, str> {
        "LensOrNumber".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "A number, or \"from_lens\".",
            "anyOf": [
                { "type": "number", "minimum": 0 },
                { "const": "from_lens" }
            ]
        })
    }
}

/// Where the radiance image is rendered from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSection {
    /// Position of the entrance pupil, mm. Default [0, 0, 100].
    pub position_mm: [f64; 3],
    /// Point in the middle of the image, mm. Default [0, 0, 0].
    pub look_at_mm: [f64; 3],
    /// Direction that is up in the image. Default [0, 1, 0].
    pub up: [f64; 3],
    /// Horizontal field of view, degrees, at least 1e-6 and below 179, or "from_lens": what `lens` and `sensor` see.
    /// Default "from_lens".
    pub horizontal_field_deg: LensOrNumber,
    /// Diameter of the aperture, mm, or "from_lens": focal length over f-number of an ideal lens. What lies off the plane in focus
    /// blurs, and so does everything by diffraction (Airy pattern at 550 nm). The plane in focus is that of the lens, or else goes through
    /// `look_at_mm`. With "from_lens" another f-number or focus of the lens can be tried on a finished render, which keeps its blur.
    /// Default 0: a pinhole, all is sharp.
    pub aperture_mm: LensOrNumber,
    /// Width of the image in the scene, mm, where all rays are parallel (an orthographic camera, for a scene without lens and
    /// sensor); takes the place of the field of view. Default: none.
    pub parallel_width_mm: Option<f64>,
}

impl Default for CameraSection {
    fn default() -> Self {
        Self {
            position_mm: [0.0, 0.0, 100.0],
            look_at_mm: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            horizontal_field_deg: LensOrNumber::FromLens,
            aperture_mm: LensOrNumber::Number(0.0),
            parallel_width_mm: None,
        }
    }
}

/// How a traced lens makes its image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ImageFormation {
    /// Every path of the render starts on the film and goes through the lens: depth of field, aberrations, vignetting.
    #[default]
    Rendered,
    /// The render sees a pinhole; distortion, point spreads (diffraction included) and relative illumination of the
    /// plane in focus are applied to its image. The lens can be changed without a new render, within the field.
    PointSpread,
}

/// The types of lenses, each with its fields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[schemars(extend("x-default" = "ideal"))]
pub enum LensSection {
    /// Without aberrations. The type of a lens that names none.
    Ideal(IdealLensSection),
    /// Surfaces and glasses, traced.
    Traced(TracedLensSection),
}

/// A lens without aberrations: `E = pi L T / (1 + 4 N² (1 + |m|)²)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct IdealLensSection {
    /// Focal length, mm, above 0. Default 3.
    pub focal_length_mm: f64,
    /// Focal length over the diameter of the axial beam, 0.5 to 1000. Default 4.
    pub f_number: f64,
    /// Transmittance of the glass, without filters. Default 1.
    pub transmittance: SpectrumReference,
    /// How irradiance falls off away from the axis. Default "cos4".
    pub vignetting: Vignetting,
    /// Distance of the plane in focus from the camera's position, mm, beyond the focal length. Default: the distance from
    /// camera to `look_at_mm`.
    pub focus_distance_mm: Option<f64>,
}

impl Default for IdealLensSection {
    fn default() -> Self {
        Self {
            focal_length_mm: 3.0,
            f_number: 4.0,
            transmittance: SpectrumReference::default(),
            vignetting: Vignetting::default(),
            focus_distance_mm: None,
        }
    }
}

/// A lens of surfaces and glasses, traced.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TracedLensSection {
    /// A lens of the catalogue, or the path of a lens file (.toml, .dat of pbrt, .json of ISET, .zmx of Zemax).
    pub prescription: NameOrFile,
    /// Focal length, mm, above 0, to which the lens is scaled. Default: that of the prescription.
    pub focal_length_mm: Option<f64>,
    /// Focal length over the diameter of the axial beam, 0.5 to 1000. Default: wide open.
    pub f_number: Option<f64>,
    /// Transmittance of the glass, without filters. Default 1.
    #[serde(default)]
    pub transmittance: SpectrumReference,
    /// Distance of the plane in focus from the camera's position, mm, beyond the focal length. Default: the distance from
    /// camera to `look_at_mm`.
    pub focus_distance_mm: Option<f64>,
    /// Shift of the film from the paraxial focus, away from the lens, mm. Default 0.
    #[serde(default)]
    pub film_shift_mm: f64,
    /// How it makes its image. Default "rendered".
    pub image_formation: Option<ImageFormation>,
    /// Groups of bands that are traced apart, 1 to 64, to see dispersion; a render takes as many times as long. Default 1:
    /// all bands at the design wavelength.
    #[serde(default = "one_group")]
    pub band_groups: u32,
}

impl LensSection {
    /// Distance of the plane in focus, mm.
    pub(crate) fn focus_distance_mm(&mut self) -> &mut Option<f64> {
        match self {
            Self::Ideal(lens) => &mut lens.focus_distance_mm,
            Self::Traced(lens) => &mut lens.focus_distance_mm,
        }
    }

    /// How a traced lens makes its image.
    pub(crate) fn image_formation(&self) -> Option<ImageFormation> {
        match self {
            Self::Ideal(_) => None,
            Self::Traced(lens) => lens.image_formation,
        }
    }
}

/// Where the viewing filters are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FilterPosition {
    /// In front of the lens: light passes at the angle of the field.
    #[default]
    Front,
    /// Between lens and film: light passes in the cone of the f-number about the chief ray.
    Rear,
}

/// At which angles light passes the viewing filters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FilterAngles {
    /// All light at `angle_deg`.
    #[default]
    Fixed,
    /// At the angles of the rays that the lens takes to each point of the film, averaged.
    Lens,
}

/// Fluorescence of the viewing filter itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AutofluorescenceSection {
    /// Photons emitted per photon that the filters stop, 0 to 1.
    pub photon_yield: f64,
    /// Emission spectrum, photons per nm, any scale.
    pub spectrum: SpectrumReference,
}

/// Filters in front of the lens, or behind it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ViewFilterSection {
    /// Transmittances that are multiplied. Default: none.
    pub filters: Vec<SpectrumReference>,
    /// Angle at which light passes them, degrees, 0 to 60; interference filters pass shorter wavelengths there.
    /// Default 0.
    pub angle_deg: f64,
    /// At which angles light passes them. Default "fixed".
    #[serde(skip_serializing_if = "is_default")]
    pub angles: FilterAngles,
    /// Where they are; has an effect with `angles = "lens"` only. Default "front".
    #[serde(skip_serializing_if = "is_default")]
    pub position: FilterPosition,
    /// Effective refractive index, 1 to 4, of those filters that have none of their own (CSV files and equations). Default:
    /// they do not move with the angle.
    pub effective_index: Option<f64>,
    /// Fluorescence of the filters themselves. Default: none.
    pub autofluorescence: Option<AutofluorescenceSection>,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Sensor: a preset of the catalogue and fields that override it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("x-identity" = "preset"))]
pub struct SensorSection {
    /// Sensor of the catalogue whose fields hold where this section gives none. On a base or by an override, another
    /// preset than before takes the place of the whole section: size, quantum efficiency and all. Default: Table 1 of
    /// Lyu et al. 2021.
    pub preset: Option<String>,
    /// Quantum efficiency: a name of the catalogue, the path of a CSV file with one column per channel of the mosaic,
    /// { csv = "FILE", unit = "percent" } of one in another unit, or a table of spectra by channel. Default "consumer_rgb_cmos".
    #[serde(default)]
    pub quantum_efficiency: EfficiencyReference,
    /// Filters on the sensor, for instance an infrared cut. Default: none.
    #[serde(default)]
    pub filters: Vec<SpectrumReference>,
    /// Geometry, electronics and noise.
    #[serde(flatten)]
    pub model: SensorModel,
}

defaults! {
    one_group: u32 = 1;
}
