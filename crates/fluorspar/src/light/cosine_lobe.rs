//! Emission patterns `I(theta) = I0 cos^g(theta)` of flat lights and of spots.
//!
//! A source of one watt has `I0 = (g + 1) / (2 pi)`; a flat one of area A the radiance
//! `L = (g + 1) / (2 pi A) cos^(g-1)(theta)`. With `g = 1` it is Lambertian.

use std::f64::consts::PI;

use glam::DVec3;

use super::emitter_error::{EmitterError, MAX_EXPONENT};
use crate::geometry::OrientedPoint;

/// Checks an exponent against its range.
pub(super) fn check_exponent(exponent: f32, lowest: f32) -> Result<(), EmitterError> {
    if (lowest..=MAX_EXPONENT).contains(&exponent) {
        return Ok(());
    }
    Err(EmitterError::Exponent { exponent, lowest })
}

/// Radiance per unit power of a flat source, 1/(sr m²).
#[inline]
pub(super) fn lobe_radiance(cos: f32, exponent: f32, area: f32) -> f32 {
    if cos <= 0.0 {
        return 0.0;
    }
    let shape = if exponent == 1.0 { 1.0 } else { cos.powf(exponent - 1.0) };
    (exponent + 1.0) / (2.0 * std::f32::consts::PI * area) * shape
}

/// How a flat emitter shines.
#[derive(Clone, Copy, Debug)]
pub(super) enum FlatPattern {
    /// A light given by its power: one side, intensity `I0 cos^g`.
    Lobe {
        /// The exponent g.
        exponent: f32,
    },
    /// The surface of an object given by its radiance: both sides, Lambertian.
    BothSides,
    /// The same on the side of the normal only.
    Front,
}

impl FlatPattern {
    /// Cosine of emission; not positive on a dark side.
    #[inline]
    pub(super) fn facing(self, cos: f32) -> f32 {
        match self {
            Self::Lobe { .. } | Self::Front => cos,
            Self::BothSides => cos.abs(),
        }
    }

    /// Radiance per unit of the light's spectrum.
    #[inline]
    pub(super) fn radiance(self, cos: f32, area: f32) -> f32 {
        match self {
            Self::Lobe { exponent } => lobe_radiance(cos, exponent, area),
            Self::BothSides => 1.0,
            Self::Front => f32::from(u8::from(cos > 0.0)),
        }
    }

    /// Axis and exponent, for [`super::LightBounds`].
    pub(super) fn lobe(self, normal: glam::Vec3) -> Option<(glam::Vec3, f32)> {
        match self {
            Self::Lobe { exponent } => Some((normal, exponent)),
            Self::BothSides => None,
            Self::Front => Some((normal, 1.0)),
        }
    }
}

/// Irradiance factor of a flat emitter that is sampled at points of equal area:
/// `E = sum P/n (g + 1) / (2 pi) cos^g cos' / r²`, per watt of power, 1/m².
pub(super) fn irradiance_factor(at: OrientedPoint, samples: &[DVec3], normal: DVec3, exponent: f64) -> f64 {
    let one = |sample: &DVec3| {
        let way = at.position - *sample;
        let Some(direction) = way.try_normalize() else { return 0.0 };
        let (leaving, arriving) = (direction.dot(normal).max(0.0), -direction.dot(at.normal));
        if leaving <= 0.0 || arriving <= 0.0 {
            return 0.0;
        }
        (exponent + 1.0) / (2.0 * PI) * leaving.powf(exponent) * arriving / way.length_squared()
    };
    samples.iter().map(one).sum::<f64>() / samples.len().max(1) as f64
}

/// Irradiance per watt, 1/m², of an emitter taken as a point with an axis and an exponent, or without both as even in
/// all directions.
pub(super) fn point_irradiance_per_watt(
    at: OrientedPoint,
    source: DVec3,
    pattern: Option<(DVec3, f64)>,
) -> f64 {
    let way = at.position - source;
    let Some(direction) = way.try_normalize() else { return 0.0 };
    let intensity = match pattern {
        None => 1.0 / (4.0 * PI),
        Some((axis, exponent)) => {
            let cosine = direction.dot(axis).max(0.0);
            (exponent + 1.0) / (2.0 * PI) * cosine.powf(exponent)
        }
    };
    intensity * (-direction.dot(at.normal)).max(0.0) / way.length_squared()
}
