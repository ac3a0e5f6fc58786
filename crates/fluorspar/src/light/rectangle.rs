//! Flat rectangles with one emitting side.

use glam::{DVec3, Vec3};

use super::cosine_lobe::{check_exponent, irradiance_factor, lobe_radiance, point_irradiance_per_watt};
use super::emitter_error::check_length;
use super::emitter_sample::toward;
use super::{ApparentSize, Emission, EmitterError, EmitterSample, LightBounds};
use crate::geometry::{OrientedPoint, intersect_plane};
use crate::sampling::{FlatRectangle, SphericalRectangle};

/// A flat rectangle that emits to the side of `edge_u x edge_v`. Spectrum: radiant power, W/nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RectangleEmitter {
    /// One corner, m.
    pub corner: Vec3,
    /// First edge, m.
    pub edge_u: Vec3,
    /// Second edge, m, at a right angle to the first.
    pub edge_v: Vec3,
    /// Exponent g of the radiant intensity `I(theta) = I0 cos^g(theta)`; 1 is Lambertian.
    pub exponent: f32,
}

/// Points along each side at which irradiance is sampled.
const SIDE: usize = 5;

impl RectangleEmitter {
    pub(super) fn check(&self) -> Result<(), EmitterError> {
        check_length("first edge", self.edge_u.length())?;
        check_length("second edge", self.edge_v.length())?;
        check_exponent(self.exponent, 1.0)
    }

    pub(super) fn irradiance_factor(&self, at: OrientedPoint) -> f64 {
        let (corner, u, v) = (self.corner.as_dvec3(), self.edge_u.as_dvec3(), self.edge_v.as_dvec3());
        let Some(normal) = u.cross(v).try_normalize() else { return 0.0 };
        let at_step = |step: usize| (step as f64 + 0.5) / SIDE as f64;
        let samples: Vec<DVec3> =
            (0..SIDE * SIDE).map(|i| corner + u * at_step(i % SIDE) + v * at_step(i / SIDE)).collect();
        irradiance_factor(at, &samples, normal, f64::from(self.exponent))
    }

    pub(super) fn irradiance_per_watt(&self, at: OrientedPoint) -> f64 {
        let center = self.corner + 0.5 * (self.edge_u + self.edge_v);
        let normal = self.edge_u.cross(self.edge_v).normalize();
        let pattern = (normal.as_dvec3(), f64::from(self.exponent));
        point_irradiance_per_watt(at, center.as_dvec3(), Some(pattern))
    }

    pub(super) fn apparent_size(&self, at: OrientedPoint) -> ApparentSize {
        let (u, v) = (self.edge_u.as_dvec3(), self.edge_v.as_dvec3());
        let center = self.corner.as_dvec3() + 0.5 * (u + v);
        let cross = u.cross(v);
        ApparentSize::of_patch(at, center, cross.try_normalize(), cross.length(), [u.length(), v.length()])
    }

    pub(super) fn prepare(&self) -> PreparedRectangle {
        let shape = FlatRectangle::new(self.corner, self.edge_u, self.edge_v);
        PreparedRectangle { shape, exponent: self.exponent }
    }
}

/// A rectangle ready for intersection and sampling.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedRectangle {
    shape: FlatRectangle,
    exponent: f32,
}

impl PreparedRectangle {
    pub(super) fn bounds(&self) -> LightBounds {
        LightBounds::Local {
            center: self.shape.center(),
            radius: self.shape.radius(),
            lobe: Some((self.shape.normal(), self.exponent)),
        }
    }

    #[inline]
    pub(super) fn intersect(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<f32> {
        let t = intersect_plane(origin, direction, self.shape.corner(), self.shape.normal(), limit)?;
        self.shape.contains(origin + direction * t).then_some(t)
    }

    /// Uniform in solid angle; by area where the image on the sphere of directions degenerates.
    #[inline]
    pub(super) fn sample(&self, position: Vec3, u: [f32; 2], choice: f32) -> Option<EmitterSample> {
        let shape = &self.shape;
        let (normal, area) = (shape.normal(), shape.area());
        // The back is dark.
        if (position - shape.corner()).dot(normal) <= 0.0 {
            return None;
        }
        if let Some(view) = SphericalRectangle::new(shape, position) {
            let offset = view.sample(u);
            let distance = offset.length();
            let direction = offset / distance;
            let scale = lobe_radiance(-direction.dot(normal), self.exponent, area);
            return EmitterSample::by_solid_angle(direction, distance, choice / view.solid_angle(), scale);
        }
        let way = toward(position, shape.at(u))?;
        let cos = -way.0.dot(normal);
        EmitterSample::by_area(choice, way, cos, area, lobe_radiance(cos, self.exponent, area))
    }

    #[inline]
    pub(super) fn emission(&self, position: Vec3, direction: Vec3, distance: f32) -> Option<Emission> {
        let (cos, area) = (-direction.dot(self.shape.normal()), self.shape.area());
        let scale = lobe_radiance(cos, self.exponent, area);
        if cos <= 0.0 || scale <= 0.0 {
            return None;
        }
        let view = SphericalRectangle::new(&self.shape, position);
        let density = view.map(|view| 1.0 / view.solid_angle());
        let density = density.unwrap_or_else(|| distance * distance / (area * cos));
        Some(Emission { scale, density })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::light::Emitter;
    use crate::light::density_tests::{EYE, UP, assert_close, check_density};

    #[test]
    fn directions_follow_their_density() {
        let (edge_u, edge_v) = (Vec3::new(0.0, 3.0, 0.0), Vec3::new(3.0, 0.0, 0.0));
        for exponent in [1.0, 2.0] {
            let corner = Vec3::new(-1.0, -1.0, 1.0);
            check_density(&Emitter::from(RectangleEmitter { corner, edge_u, edge_v, exponent }), EYE, 2);
        }
    }

    /// A small rectangle: `P / (pi d²)`.
    #[test]
    fn irradiance_on_the_axis_follows_the_closed_form() {
        let edge = 0.001f32;
        let rectangle = RectangleEmitter {
            corner: Vec3::new(-0.5 * edge, -0.5 * edge, 0.1),
            edge_u: Vec3::Y * edge,
            edge_v: Vec3::X * edge,
            exponent: 1.0,
        };
        assert_close(rectangle.irradiance_factor(UP), 1.0 / (PI * 0.01), 1e-3);
        assert_close(rectangle.irradiance_per_watt(UP), 1.0 / (PI * 0.01), 1e-6);
        assert_close(rectangle.apparent_size(UP).solid_angle_sr, 1e-4, 1e-5);
    }
}
