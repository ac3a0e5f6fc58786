//! Parallel light from far away.

use glam::Vec3;

use super::{ApparentSize, EmitterSample, LightBounds};
use crate::geometry::OrientedPoint;

/// Parallel light from far away. Spectrum: irradiance on a surface that faces it, W/(m² nm).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistantEmitter {
    /// Unit vector along which light travels.
    pub direction: Vec3,
}

impl DistantEmitter {
    pub(super) fn irradiance_factor(&self, at: OrientedPoint) -> f64 {
        (-self.direction.as_dvec3().dot(at.normal)).max(0.0)
    }

    /// A point source: no extent is known.
    pub(super) fn apparent_size(&self) -> ApparentSize {
        ApparentSize { direction: -self.direction.as_dvec3(), subtense_rad: 0.0, solid_angle_sr: 0.0 }
    }

    pub(super) fn bounds(&self) -> LightBounds {
        LightBounds::Distant { direction: self.direction }
    }

    #[inline]
    pub(super) fn sample(&self, choice: f32) -> EmitterSample {
        EmitterSample {
            direction: -self.direction,
            distance: f32::INFINITY,
            scale: 1.0,
            pdf: choice,
            delta: true,
            pixel: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::light::density_tests::{UP, assert_close};

    #[test]
    fn irradiance_falls_with_the_cosine() {
        let slanted = DistantEmitter { direction: Vec3::new(0.0, 0.6, -0.8) };
        assert_close(slanted.irradiance_factor(UP), 0.8, 1e-6);
        assert_eq!(slanted.irradiance_factor(OrientedPoint { normal: DVec3::NEG_Z, ..UP }), 0.0);
    }
}
