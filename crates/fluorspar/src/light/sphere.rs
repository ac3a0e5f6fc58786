//! Spheres: lights that emit outward, and emissive spheres of a scene.

use std::f32::consts::PI;

use glam::Vec3;

use super::cosine_lobe::point_irradiance_per_watt;
use super::emitter_error::check_length;
use super::point::point_factor;
use super::{ApparentSize, Emission, EmitterError, EmitterSample, LightBounds};
use crate::geometry::{OrientedPoint, intersect_sphere};
use crate::sampling::warp;

/// A sphere that emits evenly outward. Spectrum: radiant power, W/nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereEmitter {
    /// Center, m.
    pub center: Vec3,
    /// Radius, m.
    pub radius_m: f32,
}

impl SphereEmitter {
    pub(super) fn check(&self) -> Result<(), EmitterError> {
        check_length("radius", self.radius_m)
    }

    /// Exact for a sphere that lies wholly above the surface's horizon.
    pub(super) fn irradiance_factor(&self, at: OrientedPoint) -> f64 {
        point_factor(at, self.center.as_dvec3(), None)
    }

    pub(super) fn irradiance_per_watt(&self, at: OrientedPoint) -> f64 {
        point_irradiance_per_watt(at, self.center.as_dvec3(), None)
    }

    pub(super) fn apparent_size(&self, at: OrientedPoint) -> ApparentSize {
        let radius = f64::from(self.radius_m);
        let area = std::f64::consts::PI * radius * radius;
        ApparentSize::of_patch(at, self.center.as_dvec3(), None, area, [2.0 * radius; 2])
    }

    pub(super) fn prepare(&self) -> PreparedSphere {
        let (center, radius) = (self.center, self.radius_m);
        // L = P / (pi 4 pi r^2).
        PreparedSphere { center, radius, scale: 1.0 / (4.0 * PI * PI * radius * radius), both_sides: false }
    }
}

/// Irradiance per unit of radiance of a sphere that emits to both sides, sr: `pi r² cos / d²`, and a hemisphere inside.
pub(crate) fn emissive_sphere_factor(center: Vec3, radius_m: f32, at: OrientedPoint) -> f64 {
    let way = at.position - center.as_dvec3();
    let radius = f64::from(radius_m);
    let Some(direction) = way.try_normalize() else { return 0.0 };
    std::f64::consts::PI * radius * radius * (-direction.dot(at.normal)).max(0.0)
        / way.length_squared().max(radius * radius)
}

/// A sphere ready for intersection and sampling.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedSphere {
    center: Vec3,
    radius: f32,
    /// Radiance per unit of the light's spectrum.
    scale: f32,
    both_sides: bool,
}

impl PreparedSphere {
    /// The sphere of an object whose spectrum is radiance, to both sides or outward.
    pub(super) fn emissive(center: Vec3, radius: f32, is_one_sided: bool) -> Self {
        Self { center, radius, scale: 1.0, both_sides: !is_one_sided }
    }

    pub(super) fn bounds(&self) -> LightBounds {
        LightBounds::Local { center: self.center, radius: self.radius, lobe: None }
    }

    #[inline]
    pub(super) fn intersect(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<f32> {
        intersect_sphere(origin, direction, self.center, self.radius, limit)
    }

    /// From outside uniform in the cone that the sphere fills, from inside (or on it) by its area.
    pub(super) fn sample(&self, position: Vec3, u: [f32; 2], choice: f32) -> Option<EmitterSample> {
        let Self { center, radius, scale, both_sides } = *self;
        let offset = center - position;
        let distance2 = offset.length_squared();
        if distance2 > radius * radius * 1.000_1 {
            let axis = offset / distance2.sqrt();
            let drop_max = cone_drop(radius, distance2);
            // 1 - cos, kept apart from 1: small and far spheres would lose their digits.
            let drop = u[0] * drop_max;
            let sin2 = drop * (2.0 - drop);
            let (sin_phi, cos_phi) = (2.0 * PI * u[1]).sin_cos();
            let (t0, t1) = warp::tangents(axis);
            let direction = (t0 * cos_phi + t1 * sin_phi) * sin2.sqrt() + axis * (1.0 - drop);
            let distance =
                (1.0 - drop) * distance2.sqrt() - (radius * radius - sin2 * distance2).max(0.0).sqrt();
            let pdf = choice / (2.0 * PI * drop_max);
            return EmitterSample::by_solid_angle(direction, distance, pdf, scale);
        }
        let normal = warp::uniform_sphere(u);
        let to_point = center + normal * radius - position;
        let distance = to_point.length();
        let direction = to_point.try_normalize()?;
        let cos = if both_sides { direction.dot(normal).abs() } else { -direction.dot(normal) };
        EmitterSample::by_area(choice, (direction, distance), cos, 4.0 * PI * radius * radius, scale)
    }

    pub(super) fn emission(&self, position: Vec3, direction: Vec3, distance: f32) -> Option<Emission> {
        let Self { center, radius, scale, both_sides } = *self;
        let offset = direction * distance;
        let distance = offset.length();
        let cos = -offset.dot(position + offset - center) / (distance * radius);
        if cos <= 0.0 && !both_sides {
            return None;
        }
        let distance2 = (center - position).length_squared();
        let density = if distance2 > radius * radius * 1.000_1 {
            1.0 / (2.0 * PI * cone_drop(radius, distance2))
        } else {
            distance * distance / (4.0 * PI * radius * radius * cos.abs().max(1e-6))
        };
        Some(Emission { scale, density })
    }
}

/// `1 - cos` of the cone that a sphere fills from a squared distance, without cancellation.
fn cone_drop(radius: f32, distance2: f32) -> f32 {
    let sin2 = radius * radius / distance2;
    sin2 / (1.0 + (1.0 - sin2).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::density_tests::{EYE, UP, assert_close, check_density, check_prepared};
    use crate::light::{Emitter, PreparedEmitter};

    #[test]
    fn directions_follow_their_density() {
        check_density(
            &Emitter::from(SphereEmitter { center: Vec3::new(0.0, 1.5, 0.5), radius_m: 1.0 }),
            EYE,
            2,
        );
        // Inside of an emissive sphere.
        check_prepared(&PreparedEmitter::sphere(Vec3::ZERO, 1.7, false), EYE, 2);
    }

    #[test]
    fn irradiance_follows_closed_forms() {
        use std::f64::consts::PI;
        let sphere = SphereEmitter { center: Vec3::Z * 0.1, radius_m: 0.05 };
        assert_close(sphere.irradiance_factor(UP), 1.0 / (4.0 * PI * 0.01), 1e-6);
        assert_close(sphere.irradiance_per_watt(UP), 1.0 / (4.0 * PI * 0.01), 1e-6);
        assert_close(emissive_sphere_factor(Vec3::Z * 0.1, 0.02, UP), PI * 0.04, 1e-5);
    }
}
