//! Point lights: even in all directions, or spots with a cosine power or a cone as intensity.

use std::f32::consts::PI;

use glam::{DVec3, Vec3};

use super::cosine_lobe::{check_exponent, irradiance_factor, point_irradiance_per_watt};
use super::emitter_sample::toward;
use super::spot_cone::SpotCone;
use super::{ApparentSize, EmitterError, EmitterSample, LightBounds};
use crate::geometry::OrientedPoint;

/// A point. Spectrum: radiant power, W/nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointEmitter {
    /// Position, m.
    pub position: Vec3,
    /// How its intensity depends on the direction.
    pub pattern: PointPattern,
}

/// Radiant intensity of a point by direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PointPattern {
    /// The same in all directions.
    Even,
    /// `I0 cos^g` about an axis.
    Lobe {
        /// Unit vector.
        axis: Vec3,
        /// The exponent g, 0 to 1000.
        exponent: f32,
    },
    /// The same within a cone, and falling to none at its edge.
    Cone(SpotCone),
}

impl PointEmitter {
    pub(super) fn check(&self) -> Result<(), EmitterError> {
        match &self.pattern {
            PointPattern::Even => Ok(()),
            PointPattern::Lobe { exponent, .. } => check_exponent(*exponent, 0.0),
            PointPattern::Cone(cone) => cone.check(),
        }
    }

    pub(super) fn irradiance_factor(&self, at: OrientedPoint) -> f64 {
        let source = self.position.as_dvec3();
        match &self.pattern {
            PointPattern::Even => point_factor(at, source, None),
            PointPattern::Lobe { axis, exponent } => {
                point_factor(at, source, Some((axis.as_dvec3(), f64::from(*exponent))))
            }
            PointPattern::Cone(cone) => cone.irradiance_factor(at, source),
        }
    }

    pub(super) fn irradiance_per_watt(&self, at: OrientedPoint) -> f64 {
        let source = self.position.as_dvec3();
        match &self.pattern {
            PointPattern::Even => point_irradiance_per_watt(at, source, None),
            PointPattern::Lobe { axis, exponent } => {
                point_irradiance_per_watt(at, source, Some((axis.as_dvec3(), f64::from(*exponent))))
            }
            PointPattern::Cone(cone) => cone.irradiance_factor(at, source),
        }
    }

    pub(super) fn apparent_size(&self, at: OrientedPoint) -> ApparentSize {
        ApparentSize::of_patch(at, self.position.as_dvec3(), None, 0.0, [0.0; 2])
    }

    pub(super) fn bounds(&self) -> LightBounds {
        let lobe = match &self.pattern {
            PointPattern::Even => None,
            PointPattern::Lobe { axis, exponent } => Some((*axis, *exponent)),
            PointPattern::Cone(cone) => cone.lobe(),
        };
        LightBounds::Local { center: self.position, radius: 0.0, lobe }
    }

    /// The one direction, with the radiance times solid angle `I / r²`.
    #[inline]
    pub(super) fn sample(&self, position: Vec3, choice: f32) -> Option<EmitterSample> {
        let (direction, distance) = toward(position, self.position)?;
        let intensity = match &self.pattern {
            PointPattern::Even => 1.0 / (4.0 * PI),
            PointPattern::Lobe { axis, exponent } => {
                let cos = (-direction.dot(*axis)).max(0.0);
                (exponent + 1.0) / (2.0 * PI) * cos.powf(*exponent)
            }
            PointPattern::Cone(cone) => cone.intensity(-direction),
        };
        let scale = intensity / (distance * distance);
        (scale > 0.0).then_some(EmitterSample {
            direction,
            distance,
            scale,
            pdf: choice,
            delta: true,
            pixel: 0,
        })
    }
}

/// Irradiance per watt of a point, 1/m²: `I cos' / r²`.
pub(super) fn point_factor(at: OrientedPoint, source: DVec3, pattern: Option<(DVec3, f64)>) -> f64 {
    match pattern {
        Some((axis, exponent)) => irradiance_factor(at, &[source], axis, exponent),
        None => {
            let way = at.position - source;
            let Some(direction) = way.try_normalize() else { return 0.0 };
            (-direction.dot(at.normal)).max(0.0) / (4.0 * std::f64::consts::PI * way.length_squared())
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::light::density_tests::{UP, assert_close};

    /// `I(0) cos / r²`, and the sample holds the same irradiance.
    #[test]
    fn irradiance_follows_the_closed_form() {
        let spot = PointEmitter {
            position: Vec3::Z * 0.1,
            pattern: PointPattern::Lobe { axis: Vec3::NEG_Z, exponent: 3.0 },
        };
        let expected = 4.0 / (2.0 * PI * 0.01);
        assert_close(spot.irradiance_factor(UP), expected, 1e-6);
        assert_close(spot.irradiance_per_watt(UP), expected, 1e-6);
        let sample = spot.sample(Vec3::ZERO, 1.0).unwrap();
        assert!(sample.delta);
        assert_close(f64::from(sample.scale * sample.direction.z), expected, 1e-5);
        // From below nothing arrives.
        let below = OrientedPoint { normal: DVec3::NEG_Z, ..UP };
        assert_eq!(spot.irradiance_factor(below), 0.0);
    }
}
