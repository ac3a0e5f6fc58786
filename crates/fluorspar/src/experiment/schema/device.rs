//! Camera, lens, viewing filter and sensor.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::SpectrumReference;
use crate::optics::Vignetting;
use crate::sensor::SensorModel;

/// Horizontal field of view: degrees, or what lens and sensor see.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FieldOfView {
    /// The field of view of the sensor behind the lens.
    #[default]
    FromLens,
    /// Degrees.
    Degrees(f64),
}

impl Serialize for FieldOfView {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Degrees(value) => serializer.serialize_f64(*value),
            Self::FromLens => serializer.serialize_str("from_lens"),
        }
    }
}

struct FieldVisitor;

impl Visitor<'_> for FieldVisitor {
    type Value = FieldOfView;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number of degrees or \"from_lens\"")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Self::Value, E> {
        Ok(FieldOfView::Degrees(value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
        Ok(FieldOfView::Degrees(value as f64))
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
        match text {
            "from_lens" => Ok(FieldOfView::FromLens),
            _ => Err(E::invalid_value(serde::de::Unexpected::Str(text), &self)),
        }
    }
}

impl<'de> Deserialize<'de> for FieldOfView {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(FieldVisitor)
    }
}

impl JsonSchema for FieldOfView {
    fn schema_name() -> Cow<'static, str> {
        "FieldOfView".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "anyOf": [
                { "type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 179 },
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
    /// Horizontal field of view, degrees, above 0 and below 179, or "from_lens": what `lens` and `sensor` see.
    /// Default "from_lens".
    pub horizontal_field_deg: FieldOfView,
}

impl Default for CameraSection {
    fn default() -> Self {
        Self {
            position_mm: [0.0, 0.0, 100.0],
            look_at_mm: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            horizontal_field_deg: FieldOfView::FromLens,
        }
    }
}

/// A lens without aberrations: `E = pi L T / (1 + 4 N² (1 + |m|)²)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LensSection {
    /// Focal length, mm, above 0. Default 3.
    pub focal_length_mm: f64,
    /// Focal length over the diameter of the entrance pupil, 0.5 to 1000. Default 4.
    pub f_number: f64,
    /// Transmittance of the glass, without filters. Default 1.
    pub transmittance: SpectrumReference,
    /// How irradiance falls off away from the axis. Default "cos4".
    pub vignetting: Vignetting,
    /// Distance of the plane in focus, mm, beyond the focal length. Default: the distance from camera to `look_at_mm`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focus_distance_mm: Option<f64>,
}

impl Default for LensSection {
    fn default() -> Self {
        Self {
            focal_length_mm: 3.0,
            f_number: 4.0,
            transmittance: SpectrumReference::Constant(1.0),
            vignetting: Vignetting::Cos4,
            focus_distance_mm: None,
        }
    }
}

/// Filters in front of the lens.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ViewFilterSection {
    /// Transmittances that are multiplied. Default: none.
    pub filters: Vec<SpectrumReference>,
    /// Angle at which light passes them, degrees, 0 to 60; interference filters pass shorter wavelengths there.
    /// Default 0.
    pub angle_deg: f64,
}

/// Sensor: a preset of the catalogue and fields that override it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorSection {
    /// Sensor of the catalogue whose fields hold where this section gives none. On a base or by an override, another
    /// preset than before takes the place of the whole section: size, quantum efficiency and all. Default: Table 1 of
    /// Lyu et al. 2021.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// Quantum efficiency: a name of the catalogue, or the path of a CSV file with one column per channel of the
    /// mosaic. Default "consumer_rgb_cmos".
    #[serde(default = "quantum_efficiency")]
    pub quantum_efficiency: String,
    /// Filters on the sensor, for instance an infrared cut. Default: none.
    #[serde(default)]
    pub filters: Vec<SpectrumReference>,
    /// Geometry, electronics and noise.
    #[serde(flatten)]
    pub model: SensorModel,
}

fn quantum_efficiency() -> String {
    "consumer_rgb_cmos".into()
}
