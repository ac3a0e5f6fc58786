//! Light sources.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SpectrumReference;

/// Shape of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LightType {
    /// `count` discs evenly around a circle.
    Ring,
    /// One flat disc.
    Disc,
    /// One flat ring with an even surface, as a ring light behind a diffuser.
    Annulus,
    /// One flat rectangle.
    Rectangle,
    /// A sphere that emits evenly.
    Sphere,
    /// A point.
    Point,
    /// Parallel light.
    Distant,
    /// The same radiance from all directions.
    Environment,
}

/// What positions and directions of a light refer to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LightFrame {
    /// The scene.
    #[default]
    Scene,
    /// The camera: origin at its pupil, +x right, +y up, -z forward (the direction of view). The light moves with it.
    Camera,
}

/// A light source, or a ring of equal ones.
///
/// Its strength is `power_mw`, `irradiance_w_per_m2` or `radiance_w_per_sr_m2`: exactly one, by type.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LightSection {
    /// Name, unique among the lights.
    pub name: String,
    /// Lights of one group are switched together and form one excitation channel. Default: the name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// Relative spectral power: its scale does not matter, the strength below sets it.
    pub spectrum: SpectrumReference,
    /// Filters on the light, in any order. Default: none.
    #[serde(default)]
    pub filters: Vec<SpectrumReference>,
    /// Angle at which light passes the filters, degrees, 0 to 60; interference filters cut at shorter wavelengths
    /// there. Default 0.
    #[serde(default)]
    pub filter_angle_deg: f64,
    /// Shape.
    #[serde(rename = "type")]
    pub kind: LightType,
    /// What positions and directions refer to. Default "scene".
    #[serde(default)]
    pub frame: LightFrame,
    /// Radiant power of each emitter before the filters, mW, over 200 to 1200 nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub power_mw: Option<f64>,
    /// Irradiance behind the filters, W/m², over 200 to 1200 nm: for a distant light on a surface that faces it,
    /// for others on the axis at `at_distance_mm`, from all emitters together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub irradiance_w_per_m2: Option<f64>,
    /// Distance at which the irradiance was measured, mm from the centre of the light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_distance_mm: Option<f64>,
    /// Radiance of an environment behind the filters, W/(sr m²), over 200 to 1200 nm; with a grey map that of white.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radiance_w_per_sr_m2: Option<f64>,
    /// Map of the radiance of an environment, equirectangular: path of a grey PNG image, whose white has the radiance
    /// and the spectrum given, or of a spectral OpenEXR image of radiance, W/(sr m² nm), on which `spectrum` and the
    /// filters are factors. Rows from the top (+y); the middle lies towards -z, the right half towards +x.
    /// Default: the same radiance everywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<String>,
    /// Turn of the map about +y, degrees: at 90 the middle lies towards -x. Default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_rotation_deg: Option<f64>,
    /// Emitters of a ring, 1 to 10 000. Default 8.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub count: Option<u32>,
    /// Radius of the circle on which the centres of the emitters lie, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ring_radius_mm: Option<f64>,
    /// Angle of the first emitter from the x axis of the ring, degrees. Default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_angle_deg: Option<f64>,
    /// Distance in front of the ring at which its emitters aim, mm. Default: they aim parallel to its axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aim_distance_mm: Option<f64>,
    /// Radius of a disc, of each emitter of a ring or of a sphere, outer radius of an annulus, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
    /// Radius of the hole of an annulus, mm; smaller than `radius_mm`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inner_radius_mm: Option<f64>,
    /// Width and height of a rectangle, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size_mm: Option<[f64; 2]>,
    /// Centre of the light, mm. Default: the origin of its frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position_mm: Option<[f64; 3]>,
    /// Direction in which it shines, of any length. Default: forward for the camera frame, otherwise needed (or
    /// `look_at_mm`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f64; 3]>,
    /// Point at which it shines, mm, instead of `direction`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub look_at_mm: Option<[f64; 3]>,
    /// Angle from the axis at which the radiant intensity is one half, degrees. Flat emitters: 2.2 to 60, default
    /// 60 (Lambertian). Points: 2.2 to 90; without it they emit evenly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub half_angle_deg: Option<f64>,
}
