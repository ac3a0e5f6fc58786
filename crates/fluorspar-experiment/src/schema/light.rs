//! Light sources.

use fluorspar::light::ConeEdge;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{FilePath, SpectrumReference};

/// Frame of positions and directions of a light.
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[schemars(extend("x-renamed" = {
    "power_mw": "strength.power_mw",
    "irradiance_w_per_m2": "strength.irradiance_w_per_m2",
    "at_distance_mm": "strength.at_distance_mm",
    "radiance_w_per_sr_m2": "strength.radiance_w_per_sr_m2",
    "measured": "strength.measured",
    "direction": "aim.direction",
    "look_at_mm": "aim.look_at_mm",
    "map_rotation_deg": "map = { file = \"...\", rotation_deg = ... }"
}))]
pub struct LightSection {
    /// Name, unique among the lights.
    pub name: String,
    /// Lights of one group are switched together and form one excitation channel. Default: the name.
    pub group: Option<String>,
    /// Relative spectral power: its scale does not matter, the strength sets it.
    pub spectrum: SpectrumReference,
    /// Filters on the light, in any order. Default: none.
    #[serde(default)]
    pub filters: Vec<SpectrumReference>,
    /// Angle at which light passes the filters, degrees, 0 to 60; interference filters cut at shorter wavelengths
    /// there. Default 0.
    #[serde(default)]
    pub filter_angle_deg: f64,
    /// Whether the light passes a polarizer, crossed with one of the camera that holds back what wet surfaces and enamel mirror, as in
    /// dental photography. The strength is then that of light which both let pass. Default false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub crossed_polarizers: bool,
    /// Shape, place and strength.
    #[serde(flatten)]
    pub emitter: EmitterSection,
}

/// The types of lights, each with its fields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum EmitterSection {
    /// Discs evenly around a circle.
    Ring(RingLight),
    /// A flat disc.
    Disc(DiscLight),
    /// A flat ring with an even surface, as a ring light behind a diffuser.
    Annulus(AnnulusLight),
    /// A flat rectangle.
    Rectangle(RectangleLight),
    /// A sphere that emits evenly.
    Sphere(SphereLight),
    /// A point that emits evenly in all directions.
    Point(PointLight),
    /// A point that emits about an axis.
    Spot(SpotLight),
    /// Parallel light.
    Distant(DistantLight),
    /// Light from all directions: the same radiance, or a map of one spectrum.
    Environment(EnvironmentLight),
    /// Light from all directions: a map of spectral radiances.
    SpectralEnvironment(SpectralEnvironmentLight),
}

impl EmitterSection {
    /// Radiant power of each emitter before the filters, mW, where the strength is stated so.
    #[must_use]
    pub fn power_mw(&self) -> Option<f64> {
        let strength = match self {
            Self::Ring(RingLight { strength, .. })
            | Self::Disc(DiscLight { strength, .. })
            | Self::Annulus(AnnulusLight { strength, .. })
            | Self::Rectangle(RectangleLight { strength, .. })
            | Self::Sphere(SphereLight { strength, .. })
            | Self::Point(PointLight { strength, .. })
            | Self::Spot(SpotLight { strength, .. }) => strength,
            Self::Distant(_) | Self::Environment(_) | Self::SpectralEnvironment(_) => return None,
        };
        match strength {
            SourceStrength::Power { power_mw } => Some(*power_mw),
            SourceStrength::Irradiance { .. } => None,
        }
    }

    /// Number of equal emitters.
    #[must_use]
    pub fn count(&self) -> u32 {
        if let Self::Ring(ring) = self { ring.count } else { 1 }
    }
}

/// `count` discs evenly around a circle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RingLight {
    /// Frame of position and direction. Default "scene".
    #[serde(default)]
    pub frame: LightFrame,
    /// Center, mm. Default: the origin of its frame.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Where it shines. Default: forward in the frame of the camera, otherwise needed.
    pub aim: Option<Aim>,
    /// Number of emitters, 1 to 10 000. Default 8.
    #[serde(default = "ring_count")]
    pub count: u32,
    /// Radius of the circle on which the centers of the emitters lie, mm.
    pub ring_radius_mm: f64,
    /// Radius of each emitter, mm.
    pub radius_mm: f64,
    /// Angle of the first emitter from the x axis of the ring, degrees. Default 0.
    #[serde(default)]
    pub start_angle_deg: f64,
    /// Distance in front of the ring at which its emitters aim, mm. Default: they aim parallel to its axis.
    pub aim_distance_mm: Option<f64>,
    /// Angle from the axis at which the radiant intensity is one half, degrees, 2.2 to 60. Default 60 (Lambertian).
    #[serde(default = "lambertian")]
    pub half_angle_deg: f64,
    /// Power or irradiance.
    pub strength: SourceStrength,
}

/// One flat disc.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DiscLight {
    /// Frame of position and direction. Default "scene".
    #[serde(default)]
    pub frame: LightFrame,
    /// Center, mm. Default: the origin of its frame.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Where it shines. Default: forward in the frame of the camera, otherwise needed.
    pub aim: Option<Aim>,
    /// Radius, mm.
    pub radius_mm: f64,
    /// Angle from the axis at which the radiant intensity is one half, degrees, 2.2 to 60. Default 60 (Lambertian).
    #[serde(default = "lambertian")]
    pub half_angle_deg: f64,
    /// Power or irradiance.
    pub strength: SourceStrength,
}

/// One flat ring with an even surface, as a ring light behind a diffuser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AnnulusLight {
    /// Frame of position and direction. Default "scene".
    #[serde(default)]
    pub frame: LightFrame,
    /// Center, mm. Default: the origin of its frame.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Where it shines. Default: forward in the frame of the camera, otherwise needed.
    pub aim: Option<Aim>,
    /// Outer radius, mm.
    pub radius_mm: f64,
    /// Radius of the hole, mm; smaller than `radius_mm`.
    pub inner_radius_mm: f64,
    /// Angle from the axis at which the radiant intensity is one half, degrees, 2.2 to 60. Default 60 (Lambertian).
    #[serde(default = "lambertian")]
    pub half_angle_deg: f64,
    /// Power or irradiance.
    pub strength: SourceStrength,
}

/// One flat rectangle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RectangleLight {
    /// Frame of position and direction. Default "scene".
    #[serde(default)]
    pub frame: LightFrame,
    /// Center, mm. Default: the origin of its frame.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Where it shines. Default: forward in the frame of the camera, otherwise needed.
    pub aim: Option<Aim>,
    /// Width and height, mm.
    pub size_mm: [f64; 2],
    /// Angle from the axis at which the radiant intensity is one half, degrees, 2.2 to 60. Default 60 (Lambertian).
    #[serde(default = "lambertian")]
    pub half_angle_deg: f64,
    /// Power or irradiance.
    pub strength: SourceStrength,
}

/// A sphere that emits evenly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereLight {
    /// Frame of position and direction. Default "scene".
    #[serde(default)]
    pub frame: LightFrame,
    /// Center, mm. Default: the origin of its frame.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Radius, mm.
    pub radius_mm: f64,
    /// Power, or irradiance toward -z of its frame.
    pub strength: SourceStrength,
}

/// A point that emits evenly in all directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointLight {
    /// Frame of position and direction. Default "scene".
    #[serde(default)]
    pub frame: LightFrame,
    /// Center, mm. Default: the origin of its frame.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Power or irradiance.
    pub strength: SourceStrength,
}

/// A point that emits about an axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpotLight {
    /// Frame of position and direction. Default "scene".
    #[serde(default)]
    pub frame: LightFrame,
    /// Center, mm. Default: the origin of its frame.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Where it shines. Default: forward in the frame of the camera, otherwise needed.
    pub aim: Option<Aim>,
    /// Angle from the axis at which the radiant intensity is one half, degrees, 2.2 to 90: it is a power of the cosine. Needed without
    /// `cone_deg`.
    #[schemars(extend("x-mutually-exclusive-with" = ["cone_deg", "edge"]))]
    pub half_angle_deg: Option<f64>,
    /// A cone in place of a power of the cosine: angles from the axis up to which the radiant intensity is even, and from which on there is
    /// none, degrees, 0 to 180.
    pub cone_deg: Option<[f64; 2]>,
    /// How the intensity falls between the angles of the cone. Default "smooth_step".
    pub edge: Option<ConeEdge>,
    /// Power or irradiance.
    pub strength: SourceStrength,
}

/// Parallel light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DistantLight {
    /// Frame of position and direction. Default "scene".
    #[serde(default)]
    pub frame: LightFrame,
    /// Where it shines. Default: forward in the frame of the camera, otherwise needed. A point is seen from the origin of the frame.
    pub aim: Option<Aim>,
    /// Irradiance of a surface that faces it.
    pub strength: DistantStrength,
}

/// The same radiance from all directions, or a map of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentLight {
    /// Radiance; with a map that of white.
    pub strength: EnvironmentStrength,
    /// Gray map of the radiance. Default: the same everywhere.
    pub map: Option<EnvironmentMapReference>,
}

/// A map of spectral radiances, on which the spectrum and the filters of the light are factors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpectralEnvironmentLight {
    /// Spectral image of radiance (OpenEXR, or NumPy with its description), W/(sr m² nm).
    pub map: EnvironmentMapReference,
}

/// The path of an equirectangular map, or a table of `file` and `rotation_deg`.
///
/// Rows from the top (+y); the middle lies toward -z, the right half toward +x.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum EnvironmentMapReference {
    /// As it is.
    File(FilePath),
    /// Turned.
    Turned(TurnedMap),
}

/// A map and its turn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TurnedMap {
    /// Path of the map: a gray PNG image, or a spectral image (.exr, .npy) for a spectral environment.
    pub file: FilePath,
    /// Turn about +y, degrees: at 90 the middle lies toward -x. Default 0.
    #[serde(default)]
    pub rotation_deg: f64,
}

impl EnvironmentMapReference {
    /// The file.
    pub fn file(&self) -> &FilePath {
        match self {
            Self::File(file) | Self::Turned(TurnedMap { file, .. }) => file,
        }
    }

    /// The turn, degrees.
    pub fn rotation_deg(&self) -> f64 {
        match self {
            Self::File(_) => 0.0,
            Self::Turned(map) => map.rotation_deg,
        }
    }
}

/// Where a light shines: a `direction` or a point, `look_at_mm`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, deny_unknown_fields)]
pub enum Aim {
    /// A direction.
    Direction {
        /// The direction, of any length.
        direction: [f64; 3],
    },
    /// A point.
    Point {
        /// The point, mm.
        look_at_mm: [f64; 3],
    },
}

/// Strength of a light: `power_mw`, or `irradiance_w_per_m2` with `at_distance_mm`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, deny_unknown_fields)]
pub enum SourceStrength {
    /// By its power.
    Power {
        /// Radiant power of each emitter before the filters, mW, over 200 to 1200 nm.
        power_mw: f64,
    },
    /// By its effect.
    Irradiance {
        /// Irradiance behind the filters on the axis, from all emitters together, W/m², over 200 to 1200 nm.
        irradiance_w_per_m2: f64,
        /// Distance at which it holds, mm from the center of the light.
        at_distance_mm: f64,
    },
}

/// Strength of parallel light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DistantStrength {
    /// Irradiance behind the filters on a surface that faces the light, W/m², over 200 to 1200 nm.
    pub irradiance_w_per_m2: f64,
}

/// Strength of light from everywhere.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentStrength {
    /// Radiance behind the filters, W/(sr m²), over 200 to 1200 nm; with a map that of white.
    pub radiance_w_per_sr_m2: f64,
}

defaults! {
    ring_count: u32 = 8;
    lambertian: f64 = 60.0;
}
