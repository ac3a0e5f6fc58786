//! Flat rings with one emitting side: an annulus, as of an LED ring light behind a diffuser.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::cosine_lobe::{check_exponent, irradiance_factor, lobe_radiance};
use super::emitter_error::check_length;
use super::emitter_sample::toward;
use super::{ApparentSize, Emission, EmitterError, EmitterSample, LightBounds};
use crate::geometry::{OrientedPoint, intersect_plane};
use crate::sampling::warp;

/// A flat ring that emits to one side. Spectrum: radiant power, W/nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnnulusEmitter {
    /// Center, m.
    pub center: Vec3,
    /// Unit normal of the emitting side.
    pub normal: Vec3,
    /// Radius of the hole, m; smaller than `radius_m`.
    pub inner_radius_m: f32,
    /// Outer radius, m.
    pub radius_m: f32,
    /// Exponent g of the radiant intensity `I(theta) = I0 cos^g(theta)`; 1 is Lambertian.
    pub exponent: f32,
}

/// Rings of equal area, and points on each, at which irradiance is sampled.
const RINGS: (usize, usize) = (4, 24);

impl AnnulusEmitter {
    pub(super) fn check(&self) -> Result<(), EmitterError> {
        check_length("inner radius", self.inner_radius_m)?;
        check_length("outer radius", self.radius_m)?;
        if self.inner_radius_m >= self.radius_m {
            return Err(EmitterError::Hole { inner_m: self.inner_radius_m, outer_m: self.radius_m });
        }
        check_exponent(self.exponent, 1.0)
    }

    /// Points of equal area.
    fn samples(&self) -> Vec<DVec3> {
        let (center, normal) = (self.center.as_dvec3(), self.normal.as_dvec3());
        let [inner2, outer2] = [self.inner_radius_m, self.radius_m].map(|radius| f64::from(radius).powi(2));
        let (u, v) = normal.any_orthonormal_pair();
        let (rings, spokes) = RINGS;
        (0..rings * spokes)
            .map(|index| {
                let (ring, spoke) = (index / spokes, index % spokes);
                let radius = (inner2 + (outer2 - inner2) * (ring as f64 + 0.5) / rings as f64).sqrt();
                let angle = 2.0 * PI * (spoke as f64 + 0.5 * (ring % 2) as f64) / spokes as f64;
                center + radius * (u * angle.cos() + v * angle.sin())
            })
            .collect()
    }

    pub(super) fn irradiance_factor(&self, at: OrientedPoint) -> f64 {
        irradiance_factor(at, &self.samples(), self.normal.as_dvec3(), f64::from(self.exponent))
    }

    /// The outer diameter, with the solid angle of the ring itself: radiance is not diluted by the hole. A Lambertian
    /// source of one watt has `E = omega / (pi A)`.
    pub(super) fn apparent_size(&self, at: OrientedPoint) -> ApparentSize {
        let outer = f64::from(self.radius_m);
        let normal = self.normal.as_dvec3();
        let round = ApparentSize::of_patch(at, self.center.as_dvec3(), Some(normal), 0.0, [2.0 * outer; 2]);
        let area = PI * (outer.powi(2) - f64::from(self.inner_radius_m).powi(2));
        let solid_angle_sr = PI * area * irradiance_factor(at, &self.samples(), normal, 1.0);
        ApparentSize { solid_angle_sr, ..round }
    }

    pub(super) fn prepare(&self) -> PreparedAnnulus {
        PreparedAnnulus {
            center: self.center,
            normal: self.normal,
            tangents: warp::tangents(self.normal),
            inner2: self.inner_radius_m * self.inner_radius_m,
            outer2: self.radius_m * self.radius_m,
            exponent: self.exponent,
        }
    }
}

/// An annulus ready for intersection and sampling.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedAnnulus {
    center: Vec3,
    normal: Vec3,
    tangents: (Vec3, Vec3),
    /// Squared radii.
    inner2: f32,
    outer2: f32,
    exponent: f32,
}

impl PreparedAnnulus {
    #[inline]
    fn area(&self) -> f32 {
        std::f32::consts::PI * (self.outer2 - self.inner2)
    }

    pub(super) fn bounds(&self) -> LightBounds {
        let lobe = Some((self.normal, self.exponent));
        LightBounds::Local { center: self.center, radius: self.outer2.sqrt(), lobe }
    }

    #[inline]
    pub(super) fn intersect(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<f32> {
        let t = intersect_plane(origin, direction, self.center, self.normal, limit)?;
        let radius2 = (origin + direction * t - self.center).length_squared();
        (self.inner2..=self.outer2).contains(&radius2).then_some(t)
    }

    /// Uniform by area.
    #[inline]
    pub(super) fn sample(&self, position: Vec3, u: [f32; 2], choice: f32) -> Option<EmitterSample> {
        let area = self.area();
        let radius = (self.inner2 + (self.outer2 - self.inner2) * u[0]).sqrt();
        let (sin, cos) = (2.0 * std::f32::consts::PI * u[1]).sin_cos();
        let point = self.center + (self.tangents.0 * cos + self.tangents.1 * sin) * radius;
        let way = toward(position, point)?;
        let cos = -way.0.dot(self.normal);
        EmitterSample::by_area(choice, way, cos, area, lobe_radiance(cos, self.exponent, area))
    }

    #[inline]
    pub(super) fn emission(&self, direction: Vec3, distance: f32) -> Option<Emission> {
        let (cos, area) = (-direction.dot(self.normal), self.area());
        let scale = lobe_radiance(cos, self.exponent, area);
        (scale > 0.0).then(|| Emission { scale, density: distance * distance / (area * cos) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::density_tests::{EYE, UP, assert_close, check_density};
    use crate::light::{DiscEmitter, Emitter};

    fn ring(inner_radius_m: f32, radius_m: f32, distance_m: f32) -> AnnulusEmitter {
        let center = Vec3::Z * distance_m;
        AnnulusEmitter { center, normal: Vec3::NEG_Z, inner_radius_m, radius_m, exponent: 1.0 }
    }

    #[test]
    fn directions_follow_their_density() {
        for (center, inner_radius_m, exponent) in
            [(Vec3::new(0.0, 0.0, 2.0), 0.8, 1.0), (Vec3::new(0.5, 1.0, 1.0), 1.2, 4.0)]
        {
            let normal = -center.normalize();
            let ring = AnnulusEmitter { center, normal, inner_radius_m, radius_m: 1.5, exponent };
            check_density(&Emitter::from(ring), EYE, 2);
        }
    }

    /// `E = M (R² / (R² + d²) - r² / (r² + d²))` with `M = P / (pi (R² - r²))`, by quadrature and by samples.
    #[test]
    fn irradiance_on_the_axis_follows_the_closed_form() {
        const SIDE: usize = 64;
        for (inner, outer, distance) in [(0.03f32, 0.04f32, 0.1f32), (0.001, 0.02, 0.02), (0.05, 0.051, 0.01)]
        {
            let ring = ring(inner, outer, distance);
            let [r2, outer2, d2] = [inner, outer, distance].map(|length| f64::from(length).powi(2));
            let expected = (outer2 / (outer2 + d2) - r2 / (r2 + d2)) / (PI * (outer2 - r2));
            // Four rings of equal area leave 0.9 % where the squared distance doubles from hole to edge.
            assert_close(ring.irradiance_factor(UP), expected, 0.01);
            assert_close(Emitter::from(ring).irradiance_per_watt(UP), expected, 0.01);

            // The midpoint rule over the numbers that samples are made of.
            let prepared = ring.prepare();
            let mut sum = 0.0;
            for i in 0..SIDE * SIDE {
                let u = [i % SIDE, i / SIDE].map(|k| (k as f32 + 0.5) / SIDE as f32);
                let sample = prepared.sample(Vec3::ZERO, u, 1.0).unwrap();
                sum += f64::from(sample.scale * sample.direction.z / sample.pdf) / (SIDE * SIDE) as f64;
            }
            assert_close(sum, expected, 1e-3);
        }
    }

    /// A disc less its middle, all of the same exitance. Five outer radii away, where each is good to 1e-4.
    #[test]
    fn irradiance_on_the_axis_is_that_of_a_disc_less_its_middle() {
        let (inner_radius_m, radius_m, distance_m) = (0.01f32, 0.02f32, 0.1f32);
        let per_exitance = |radius_m: f32| {
            let center = Vec3::Z * distance_m;
            let disc = DiscEmitter { center, normal: Vec3::NEG_Z, radius_m, exponent: 1.0 };
            PI * f64::from(radius_m).powi(2) * disc.irradiance_factor(UP)
        };
        let area = PI * (f64::from(radius_m).powi(2) - f64::from(inner_radius_m).powi(2));
        let expected = (per_exitance(radius_m) - per_exitance(inner_radius_m)) / area;
        assert_close(ring(inner_radius_m, radius_m, distance_m).irradiance_factor(UP), expected, 1e-3);
    }

    /// Irradiance over projected solid angle is the radiance of a Lambertian watt, `1 / (pi A)`.
    #[test]
    fn the_apparent_radiance_is_that_of_the_ring_alone() {
        let ring = ring(0.03, 0.04, 0.1);
        let size = ring.apparent_size(UP);
        let area = PI * (0.04f64.powi(2) - 0.03f64.powi(2));
        assert_close(ring.irradiance_factor(UP) / size.solid_angle_sr, 1.0 / (PI * area), 1e-5);
        assert_close(size.subtense_rad, 0.8, 1e-6);
    }

    #[test]
    fn rays_pass_through_the_hole() {
        let ring = ring(0.03, 0.04, 0.1).prepare();
        let meets = |x: f32| ring.intersect(Vec3::X * x, Vec3::Z, f32::INFINITY).is_some();
        assert_eq!([0.0, 0.029, 0.031, 0.039, 0.041].map(meets), [false, false, true, true, false]);
    }

    #[test]
    fn the_hole_is_smaller_than_the_ring() {
        assert_eq!(ring(0.03, 0.04, 0.1).check(), Ok(()));
        let error = ring(0.04, 0.04, 0.1).check();
        assert_eq!(error, Err(EmitterError::Hole { inner_m: 0.04, outer_m: 0.04 }));
        assert!(ring(0.0, 0.04, 0.1).check().is_err());
    }
}
