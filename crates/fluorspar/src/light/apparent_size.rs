//! Apparent size of a light source, on which the limits for the eye depend.

use std::f64::consts::PI;

use glam::DVec3;

use crate::geometry::OrientedPoint;

/// How a light looks from a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ApparentSize {
    /// Unit direction from the place to the light.
    pub(crate) direction: DVec3,
    /// Angle that the light subtends: the mean of its length and its width, rad.
    pub(crate) subtense_rad: f64,
    /// Solid angle projected on the plane of the place, as irradiance is, so that their ratio is the radiance, sr.
    pub(crate) solid_angle_sr: f64,
}

impl ApparentSize {
    /// Light from the whole hemisphere.
    pub(super) fn hemisphere(at: OrientedPoint) -> Self {
        Self { direction: at.normal, subtense_rad: PI, solid_angle_sr: PI }
    }

    /// A flat patch, or a sphere without a normal: its area, length and width in m² and m.
    pub(super) fn of_patch(
        at: OrientedPoint,
        center: DVec3,
        normal: Option<DVec3>,
        area: f64,
        sides: [f64; 2],
    ) -> Self {
        let way = center - at.position;
        let Some(direction) = way.try_normalize() else { return Self::hemisphere(at) };
        let leaving = normal.map_or(1.0, |normal| (-direction.dot(normal)).max(0.0));
        let arriving = direction.dot(at.normal).max(0.0);
        Self {
            direction,
            subtense_rad: 0.5 * (sides[0] + sides[1]) / way.length(),
            solid_angle_sr: area * leaving * arriving / way.length_squared(),
        }
    }

    /// A round source of even radiance whose projected solid angle is known: subtense of the cone `pi alpha² / 4`.
    pub(crate) fn of_solid_angle(direction: DVec3, solid_angle_sr: f64) -> Self {
        Self { direction, subtense_rad: 2.0 * (solid_angle_sr / PI).sqrt(), solid_angle_sr }
    }
}
