//! The intensity of pbrt's spots: even within a cone, with an edge that falls to nothing.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::EmitterError;
use super::emitter_error::MAX_EXPONENT;
use crate::geometry::OrientedPoint;

/// An intensity that is the same up to an angle from the axis and falls to nothing at another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpotCone {
    axis: Vec3,
    inner_deg: f64,
    outer_deg: f64,
    edge: ConeEdge,
    /// `1 - cos` of both angles: exact where the cosine is not.
    inner: f32,
    outer: f32,
    /// Intensity on the axis per watt, 1/sr.
    on_axis: f32,
}

/// How the intensity falls between the angles of a cone, over `t`, which falls from 1 to 0 evenly in the cosine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ConeEdge {
    /// `t² (3 - 2 t)`, as in pbrt-v4.
    #[default]
    SmoothStep,
    /// `t⁴`, as in pbrt-v3.
    FourthPower,
}

impl ConeEdge {
    /// Mean over t.
    const fn mean(self) -> f64 {
        match self {
            Self::SmoothStep => 0.5,
            Self::FourthPower => 0.2,
        }
    }

    #[inline]
    fn at(self, t: f32) -> f32 {
        match self {
            Self::SmoothStep => t * t * (3.0 - 2.0 * t),
            Self::FourthPower => t.powi(4),
        }
    }
}

/// `1 - cos`.
fn versine(degrees: f64) -> f64 {
    2.0 * (0.5 * degrees.to_radians()).sin().powi(2)
}

impl SpotCone {
    /// A cone about an axis, even up to `inner_deg` from it and dark from `outer_deg` on.
    #[must_use]
    pub fn new(axis: Vec3, [inner_deg, outer_deg]: [f64; 2], edge: ConeEdge) -> Self {
        let cone = Self {
            axis: axis.normalize_or_zero(),
            inner_deg,
            outer_deg,
            edge,
            inner: versine(inner_deg) as f32,
            outer: versine(outer_deg) as f32,
            on_axis: 0.0,
        };
        Self { on_axis: (1.0 / cone.solid_angle_sr()) as f32, ..cone }
    }

    /// Unit vector of the axis.
    #[must_use]
    pub fn axis(&self) -> Vec3 {
        self.axis
    }

    /// Angles from the axis up to which the intensity is even, and from which on there is none, degrees.
    #[must_use]
    pub fn angles_deg(&self) -> [f64; 2] {
        [self.inner_deg, self.outer_deg]
    }

    /// The form of the edge.
    #[must_use]
    pub fn edge(&self) -> ConeEdge {
        self.edge
    }

    /// Power over the intensity on the axis, sr: `2 pi ((1 - cos inner) + m (cos inner - cos outer))` with the mean m of the edge.
    #[must_use]
    pub fn solid_angle_sr(&self) -> f64 {
        let [inner, outer] = self.angles_deg().map(versine);
        2.0 * PI * (inner + self.edge.mean() * (outer - inner))
    }

    pub(super) fn check(&self) -> Result<(), EmitterError> {
        let [inner, outer] = self.angles_deg();
        if (0.0..=outer).contains(&inner) && (0.01..=180.0).contains(&outer) && self.axis != Vec3::ZERO {
            return Ok(());
        }
        Err(EmitterError::Cone { inner_deg: inner, outer_deg: outer })
    }

    /// Intensity per watt in a unit direction, 1/sr.
    #[inline]
    pub(super) fn intensity(&self, direction: Vec3) -> f32 {
        // |a - b|² / 2 of unit vectors is 1 - cos without the rounding of a cosine near 1
        let versine = 0.5 * (direction - self.axis).length_squared();
        if versine >= self.outer {
            return 0.0;
        }
        if versine <= self.inner {
            return self.on_axis;
        }
        self.on_axis * self.edge.at((self.outer - versine) / (self.outer - self.inner))
    }

    /// Irradiance per watt, 1/m².
    pub(super) fn irradiance_factor(&self, at: OrientedPoint, source: DVec3) -> f64 {
        let way = at.position - source;
        let Some(direction) = way.try_normalize() else { return 0.0 };
        let arriving = (-direction.dot(at.normal)).max(0.0);
        f64::from(self.intensity(direction.as_vec3())) * arriving / way.length_squared()
    }

    /// Axis and exponent of a lobe about as wide; `None` of a cone that reaches behind.
    pub(super) fn lobe(&self) -> Option<(Vec3, f32)> {
        let middle = 1.0 - 0.5 * f64::from(self.inner + self.outer);
        let exponent = 0.5_f64.ln() / middle.clamp(0.1, 1.0 - 1e-6).ln();
        (self.outer_deg < 90.0).then_some((self.axis, (exponent as f32).min(MAX_EXPONENT)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over all directions the intensity of a watt is a watt: Simpson's rule over the versine.
    #[test]
    fn a_watt_stays_a_watt() {
        for edge in [ConeEdge::SmoothStep, ConeEdge::FourthPower] {
            for angles in [[1.0, 2.0], [0.0, 0.5], [4.0, 5.0], [25.0, 30.0], [60.0, 150.0]] {
                let cone = SpotCone::new(Vec3::new(0.48, 0.6, 0.64), angles, edge);
                assert_eq!(cone.check(), Ok(()));
                let across = cone.axis.any_orthonormal_vector();
                let steps = 20_000;
                let outer = angles[1].to_radians();
                let ring = |k: usize| {
                    let theta = outer * k as f64 / steps as f64;
                    let direction = cone.axis.as_dvec3() * theta.cos() + across.as_dvec3() * theta.sin();
                    2.0 * PI * theta.sin() * f64::from(cone.intensity(direction.normalize().as_vec3()))
                };
                let sum: f64 = (1..steps).map(|k| if k % 2 == 1 { 4.0 } else { 2.0 } * ring(k)).sum();
                let power = (ring(0) + sum + ring(steps)) * outer / steps as f64 / 3.0;
                assert!((power - 1.0).abs() < 2e-4, "{edge:?} {angles:?}: {power}");
            }
        }
    }

    /// Halfway in the cosine a smooth step is one half, a fourth power one sixteenth.
    #[test]
    fn the_edge_falls_as_in_pbrt() {
        let middle = (0.5 * (25_f64.to_radians().cos() + 30_f64.to_radians().cos())).acos();
        let direction = Vec3::new(middle.sin() as f32, 0.0, middle.cos() as f32);
        for (edge, expected) in [(ConeEdge::SmoothStep, 0.5), (ConeEdge::FourthPower, 0.0625)] {
            let cone = SpotCone::new(Vec3::Z, [25.0, 30.0], edge);
            let share = cone.intensity(direction) / cone.intensity(Vec3::Z);
            assert!((share - expected).abs() < 1e-4, "{edge:?}: {share}");
            assert_eq!(cone.intensity(Vec3::new(0.51, 0.0, 0.86).normalize()), 0.0);
        }
        for angles in [[3.0, 2.0], [-1.0, 2.0], [0.0, 0.0], [0.0, f64::NAN]] {
            assert!(SpotCone::new(Vec3::Z, angles, ConeEdge::SmoothStep).check().is_err(), "{angles:?}");
        }
    }
}
