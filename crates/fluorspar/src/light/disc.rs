//! Flat discs: lights with one emitting side, and emissive discs of a scene.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::cosine_lobe::{FlatPattern, check_exponent, irradiance_factor, point_irradiance_per_watt};
use super::emitter_error::check_length;
use super::emitter_sample::toward;
use super::{ApparentSize, Emission, EmitterError, EmitterSample, LightBounds};
use crate::geometry::{OrientedPoint, intersect_disc};
use crate::sampling::{SphericalEllipse, warp};

/// A flat disc that emits to one side. Spectrum: radiant power, W/nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscEmitter {
    /// Center, m.
    pub center: Vec3,
    /// Unit normal of the emitting side.
    pub normal: Vec3,
    /// Radius, m.
    pub radius_m: f32,
    /// Exponent g of the radiant intensity `I(theta) = I0 cos^g(theta)`; 1 is Lambertian.
    pub exponent: f32,
}

impl DiscEmitter {
    pub(super) fn check(&self) -> Result<(), EmitterError> {
        check_length("radius", self.radius_m)?;
        check_exponent(self.exponent, 1.0)
    }

    pub(super) fn irradiance_factor(&self, at: OrientedPoint) -> f64 {
        let normal = self.normal.as_dvec3();
        let samples = disc_samples(self.center.as_dvec3(), normal, f64::from(self.radius_m));
        irradiance_factor(at, &samples, normal, f64::from(self.exponent))
    }

    pub(super) fn irradiance_per_watt(&self, at: OrientedPoint) -> f64 {
        let pattern = (self.normal.as_dvec3(), f64::from(self.exponent));
        point_irradiance_per_watt(at, self.center.as_dvec3(), Some(pattern))
    }

    pub(super) fn apparent_size(&self, at: OrientedPoint) -> ApparentSize {
        let radius = f64::from(self.radius_m);
        let area = PI * radius * radius;
        ApparentSize::of_patch(
            at,
            self.center.as_dvec3(),
            Some(self.normal.as_dvec3()),
            area,
            [2.0 * radius; 2],
        )
    }

    pub(super) fn prepare(&self) -> PreparedDisc {
        let pattern = FlatPattern::Lobe { exponent: self.exponent };
        PreparedDisc::new(self.center, self.normal, self.radius_m, pattern)
    }
}

/// Rings of equal area, and points on each, at which a round emitter is sampled.
const RINGS: (usize, usize) = (3, 8);

/// Points of equal area on a disc.
fn disc_samples(center: DVec3, normal: DVec3, radius_m: f64) -> Vec<DVec3> {
    let (u, v) = normal.any_orthonormal_pair();
    let (rings, spokes) = RINGS;
    let mut samples = Vec::with_capacity(rings * spokes);
    for ring in 0..rings {
        let radius = radius_m * ((ring as f64 + 0.5) / rings as f64).sqrt();
        for spoke in 0..spokes {
            let angle = 2.0 * PI * (spoke as f64 + 0.5 * (ring % 2) as f64) / spokes as f64;
            samples.push(center + radius * (u * angle.cos() + v * angle.sin()));
        }
    }
    samples
}

/// Irradiance per unit of radiance of a disc that emits to both sides, or to the front, sr.
pub(crate) fn emissive_disc_factor(
    center: Vec3,
    normal: Vec3,
    radius_m: f32,
    is_one_sided: bool,
    at: OrientedPoint,
) -> f64 {
    let (normal, radius) = (normal.as_dvec3(), f64::from(radius_m));
    let samples = disc_samples(center.as_dvec3(), normal, radius);
    let area = PI * radius * radius / samples.len() as f64;
    samples.into_iter().map(|sample| emissive_patch_factor(sample, normal, area, is_one_sided, at)).sum()
}

/// Irradiance per unit of radiance of a small patch that emits to both sides, or to the front, sr: `cos cos' A / r²`, with A bounded by the
/// distance so that a point on the emitter itself gets no more than a hemisphere.
pub(super) fn emissive_patch_factor(
    center: DVec3,
    normal: DVec3,
    area: f64,
    is_one_sided: bool,
    at: OrientedPoint,
) -> f64 {
    let way = at.position - center;
    let Some(direction) = way.try_normalize() else { return 0.0 };
    let arriving = (-direction.dot(at.normal)).max(0.0);
    let cos = direction.dot(normal);
    let leaving = if is_one_sided { cos.max(0.0) } else { cos.abs() };
    leaving * arriving * area / way.length_squared().max(area / PI)
}

/// A disc ready for intersection and sampling.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedDisc {
    center: Vec3,
    normal: Vec3,
    tangents: (Vec3, Vec3),
    radius: f32,
    pattern: FlatPattern,
}

impl PreparedDisc {
    fn new(center: Vec3, normal: Vec3, radius: f32, pattern: FlatPattern) -> Self {
        Self { center, normal, tangents: warp::tangents(normal), radius, pattern }
    }

    /// The disc of an object whose spectrum is radiance, to both sides or to the front.
    pub(super) fn emissive(center: Vec3, normal: Vec3, radius: f32, is_one_sided: bool) -> Self {
        let pattern = if is_one_sided { FlatPattern::Front } else { FlatPattern::BothSides };
        Self::new(center, normal, radius, pattern)
    }

    /// Center, normal and radius.
    pub(super) fn shape(&self) -> (Vec3, Vec3, f32) {
        (self.center, self.normal, self.radius)
    }

    #[inline]
    fn area(&self) -> f32 {
        std::f32::consts::PI * self.radius * self.radius
    }

    pub(super) fn bounds(&self) -> LightBounds {
        LightBounds::Local { center: self.center, radius: self.radius, lobe: self.pattern.lobe(self.normal) }
    }

    #[inline]
    pub(super) fn intersect(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<f32> {
        intersect_disc(origin, direction, self.center, self.normal, self.radius, limit)
    }

    /// By the image of the disc on the sphere of directions; by area where that image degenerates.
    #[inline]
    pub(super) fn sample(&self, position: Vec3, u: [f32; 2], choice: f32) -> Option<EmitterSample> {
        let area = self.area();
        if let Some(view) = SphericalEllipse::new(self.center, self.normal, self.radius, position) {
            let (direction, density) = view.sample(u);
            let cos = -direction.dot(self.normal);
            let distance = -(self.center - position).dot(self.normal) / cos;
            let scale = self.pattern.radiance(cos, area);
            return EmitterSample::by_solid_angle(direction, distance, choice * density, scale);
        }
        let d = warp::concentric_disc(u) * self.radius;
        let way = toward(position, self.center + self.tangents.0 * d.x + self.tangents.1 * d.y)?;
        let cos = -way.0.dot(self.normal);
        EmitterSample::by_area(choice, way, self.pattern.facing(cos), area, self.pattern.radiance(cos, area))
    }

    #[inline]
    pub(super) fn emission(&self, position: Vec3, direction: Vec3, distance: f32) -> Option<Emission> {
        let (cos, area) = (-direction.dot(self.normal), self.area());
        let (facing, scale) = (self.pattern.facing(cos), self.pattern.radiance(cos, area));
        if facing <= 0.0 || scale <= 0.0 {
            return None;
        }
        let view = SphericalEllipse::new(self.center, self.normal, self.radius, position);
        let density = view.map(|view| view.pdf(direction));
        let density = density.unwrap_or_else(|| distance * distance / (area * facing));
        Some(Emission { scale, density })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::Emitter;
    use crate::light::density_tests::{EYE, UP, assert_close, check_density};

    #[test]
    fn directions_follow_their_density() {
        for (center, exponent) in [(Vec3::new(0.0, 0.0, 2.0), 1.0), (Vec3::new(0.5, 1.0, 2.0), 6.0)] {
            let disc = DiscEmitter { center, normal: -center.normalize(), radius_m: 1.5, exponent };
            check_density(&Emitter::from(disc), EYE, 2);
        }
    }

    /// A Lambertian disc on the axis: `E = M R² / (R² + d²)` with `M = P / (pi R²)`. Twelve diameters away, and at one
    /// radius, where three rings leave 2 %.
    #[test]
    fn irradiance_on_the_axis_follows_the_closed_form() {
        for (radius_m, distance_m, tolerance) in [(0.0025f32, 0.06f32, 1e-4), (0.02, 0.02, 0.02)] {
            let center = Vec3::Z * distance_m;
            let disc = DiscEmitter { center, normal: Vec3::NEG_Z, radius_m, exponent: 1.0 };
            let (r2, d2) = (f64::from(radius_m).powi(2), f64::from(distance_m).powi(2));
            assert_close(disc.irradiance_factor(UP), 1.0 / (PI * (r2 + d2)), tolerance);
            assert_close(disc.irradiance_per_watt(UP), 1.0 / (PI * d2), 1e-6);
        }
        let factor = emissive_disc_factor(Vec3::Z * 0.1, Vec3::Z, 0.005, false, UP);
        assert_close(factor, PI * 0.0025 / (1.0 + 0.0025), 1e-3);
    }
}
