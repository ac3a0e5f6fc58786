//! Light sources with absolute power, emission pattern, area and position.

mod environment_map;

use std::borrow::Cow;
use std::sync::Arc;

use glam::Vec3;

pub use environment_map::{EnvironmentLayer, EnvironmentMap, EnvironmentMapError};

use crate::spectral::Curve;

/// Lights that are switched together and kept apart from the others in a component image: one excitation channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LightGroup {
    /// Name, for instance "blue".
    pub name: String,
}

/// One light source.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Name for messages.
    pub name: String,
    /// Index into the scene's light groups.
    pub group: usize,
    /// Absolute spectrum behind all filters of the light; what it measures depends on the emitter.
    pub spectrum: Curve,
    /// Shape and pattern.
    pub emitter: Emitter,
}

/// Where and how a light emits.
#[derive(Clone, Debug, PartialEq)]
pub enum Emitter {
    /// A flat disc that emits to one side. Spectrum: radiant power, W/nm.
    Disc {
        /// Centre, m.
        center: Vec3,
        /// Unit normal of the emitting side.
        normal: Vec3,
        /// Radius, m.
        radius_m: f32,
        /// Exponent g of the radiant intensity `I(theta) = I0 cos^g(theta)`; 1 is Lambertian.
        exponent: f32,
    },
    /// A flat rectangle that emits to the side of `edge_u x edge_v`. Spectrum: radiant power, W/nm.
    Rectangle {
        /// One corner, m.
        corner: Vec3,
        /// First edge, m.
        edge_u: Vec3,
        /// Second edge, m, at a right angle to the first.
        edge_v: Vec3,
        /// As for a disc.
        exponent: f32,
    },
    /// A sphere that emits evenly outward. Spectrum: radiant power, W/nm.
    Sphere {
        /// Centre, m.
        center: Vec3,
        /// Radius, m.
        radius_m: f32,
    },
    /// A point. Spectrum: radiant power, W/nm.
    Point {
        /// Position, m.
        position: Vec3,
        /// Axis and exponent of `I0 cos^g`; `None` emits evenly in all directions.
        pattern: Option<(Vec3, f32)>,
    },
    /// Parallel light from far away. Spectrum: irradiance on a surface that faces it, W/(m² nm).
    Distant {
        /// Unit vector along which light travels.
        direction: Vec3,
    },
    /// The same radiance from every direction beyond the scene. Spectrum: radiance, W/(sr m² nm).
    Environment,
    /// Radiance that depends on the direction. Spectrum: a factor on those of the layers of the map; the product is
    /// radiance, W/(sr m² nm).
    EnvironmentMap(Arc<EnvironmentMap>),
}

impl Light {
    /// The spectrum of the light as a whole; for an environment map the mean over all directions.
    pub fn whole_spectrum(&self) -> Cow<'_, Curve> {
        match &self.emitter {
            Emitter::EnvironmentMap(map) => Cow::Owned(self.spectrum.times(&map.mean_spectrum())),
            _ => Cow::Borrowed(&self.spectrum),
        }
    }
}

impl Emitter {
    /// Largest exponent of an emission pattern that is accepted: a half angle of about 3 degrees.
    pub const MAX_EXPONENT: f32 = 1000.0;

    /// Exponent of `cos^g` whose intensity falls to one half at `half_angle_deg` from the axis: `ln 0.5 / ln cos`.
    /// 60 degrees is Lambertian.
    pub fn exponent_from_half_angle(half_angle_deg: f64) -> f64 {
        0.5_f64.ln() / half_angle_deg.to_radians().cos().ln()
    }
}
