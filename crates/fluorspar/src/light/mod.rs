//! Light sources with absolute power, emission pattern, area and position.
//!
//! One file per shape of light: its data and their check, its prepared form with ray intersection, sampling and density,
//! its irradiance and its apparent size, and the test that samples follow their density. This page dispatches over the
//! shapes and is the only place that does.

mod annulus;
mod apparent_size;
mod cosine_lobe;
#[cfg(test)]
mod density_tests;
mod disc;
mod distant;
mod emitter_error;
mod emitter_sample;
mod environment;
mod environment_map;
mod light_name;
mod mesh;
mod point;
mod rectangle;
mod sphere;
mod spot_cone;

use std::borrow::Cow;
use std::sync::Arc;

use glam::Vec3;

pub use annulus::AnnulusEmitter;
pub(crate) use apparent_size::ApparentSize;
pub use disc::DiscEmitter;
pub(crate) use disc::emissive_disc_factor;
pub use distant::DistantEmitter;
pub use emitter_error::EmitterError;
pub(crate) use emitter_sample::{Emission, EmitterSample, LightBounds};
pub use environment_map::{EnvironmentLayer, EnvironmentMap, EnvironmentMapError};
pub use light_name::LightName;
pub(crate) use mesh::emissive_triangles_factor;
pub use point::{PointEmitter, PointPattern};
pub use rectangle::RectangleEmitter;
pub use sphere::SphereEmitter;
pub(crate) use sphere::emissive_sphere_factor;
pub use spot_cone::{ConeEdge, SpotCone};

use crate::geometry::{OrientedPoint, TriangleMesh};
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
    pub name: LightName,
    /// Index into the scene's light groups.
    pub group: usize,
    /// Absolute spectrum behind all filters of the light; what it measures depends on the emitter.
    pub spectrum: Curve,
    /// Whether its light passes a polarizer that is crossed with one of the camera: what the first surface mirrors does not reach the
    /// camera. Other light has lost its polarization, so that the spectrum may stand for what passes both.
    pub crossed_polarizers: bool,
    /// Shape and pattern.
    pub emitter: Emitter,
}

/// Where and how a light emits. Every shape states the quantity of its light's spectrum.
#[derive(Clone, Debug, PartialEq)]
pub enum Emitter {
    /// A flat disc that emits to one side.
    Disc(DiscEmitter),
    /// A flat ring that emits to one side.
    Annulus(AnnulusEmitter),
    /// A flat rectangle that emits to one side.
    Rectangle(RectangleEmitter),
    /// A sphere that emits evenly outward.
    Sphere(SphereEmitter),
    /// A point.
    Point(PointEmitter),
    /// Parallel light from far away.
    Distant(DistantEmitter),
    /// The same radiance from every direction beyond the scene. Spectrum: radiance, W/(sr m² nm).
    Environment,
    /// Radiance that depends on the direction. Spectrum: a factor on those of the layers of the map; the product is
    /// radiance, W/(sr m² nm).
    EnvironmentMap(Arc<EnvironmentMap>),
}

impl Light {
    /// Spectra of the light: one, and for an environment map one per layer.
    pub(crate) fn spectra(&self) -> Vec<Cow<'_, Curve>> {
        match &self.emitter {
            Emitter::EnvironmentMap(map) => {
                map.layers().iter().map(|layer| Cow::Owned(self.spectrum.times(&layer.spectrum))).collect()
            }
            _ => vec![Cow::Borrowed(&self.spectrum)],
        }
    }

    /// The spectrum of the light as a whole; for an environment map the mean over all directions.
    pub fn whole_spectrum(&self) -> Cow<'_, Curve> {
        match &self.emitter {
            Emitter::EnvironmentMap(map) => Cow::Owned(self.spectrum.times(&map.mean_spectrum())),
            _ => Cow::Borrowed(&self.spectrum),
        }
    }
}

impl Emitter {
    /// Exponent of `cos^g` whose intensity falls to one half at `half_angle_deg` from the axis: `ln 0.5 / ln cos`.
    /// 60 degrees is Lambertian.
    pub fn exponent_from_half_angle(half_angle_deg: f64) -> f64 {
        0.5_f64.ln() / half_angle_deg.to_radians().cos().ln()
    }

    /// Checks lengths and exponents.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), EmitterError> {
        match self {
            Self::Disc(disc) => disc.check(),
            Self::Annulus(annulus) => annulus.check(),
            Self::Rectangle(rectangle) => rectangle.check(),
            Self::Sphere(sphere) => sphere.check(),
            Self::Point(point) => point.check(),
            Self::Distant(_) | Self::Environment | Self::EnvironmentMap(_) => Ok(()),
        }
    }

    /// Whether light comes from every direction beyond the scene.
    pub fn is_environment(&self) -> bool {
        matches!(self, Self::Environment | Self::EnvironmentMap(_))
    }

    /// Whether its light is parallel.
    pub fn is_distant(&self) -> bool {
        matches!(self, Self::Distant(_))
    }

    /// Irradiance on a surface point per unit of each of its spectra: 1/m² for spectra in W/nm, 1 for irradiance, sr
    /// for radiance. Unoccluded; an environment fills the hemisphere.
    pub fn irradiance_factors(&self, at: OrientedPoint) -> Vec<f64> {
        let factor = match self {
            Self::Disc(disc) => disc.irradiance_factor(at),
            Self::Annulus(annulus) => annulus.irradiance_factor(at),
            Self::Rectangle(rectangle) => rectangle.irradiance_factor(at),
            Self::Sphere(sphere) => sphere.irradiance_factor(at),
            Self::Point(point) => point.irradiance_factor(at),
            Self::Distant(distant) => distant.irradiance_factor(at),
            Self::Environment => environment::IRRADIANCE_FACTOR,
            Self::EnvironmentMap(map) => return map.irradiance_factors(at.normal),
        };
        vec![factor]
    }

    /// Irradiance per watt at a point on the axis, 1/m², by which a light is calibrated from a measured irradiance; 0 for
    /// lights that have no power. Discs and rectangles are taken as points, which is good to 1 % from five diameters on.
    pub fn irradiance_per_watt(&self, at: OrientedPoint) -> f64 {
        match self {
            Self::Disc(disc) => disc.irradiance_per_watt(at),
            Self::Annulus(annulus) => annulus.irradiance_factor(at),
            Self::Rectangle(rectangle) => rectangle.irradiance_per_watt(at),
            Self::Sphere(sphere) => sphere.irradiance_per_watt(at),
            Self::Point(point) => point.irradiance_per_watt(at),
            Self::Distant(_) | Self::Environment | Self::EnvironmentMap(_) => 0.0,
        }
    }

    /// Apparent size of the light from a point: one size for each of [`Light::spectra`], whose irradiance factors are
    /// `factors`.
    pub(crate) fn apparent_sizes(&self, at: OrientedPoint, factors: &[f64]) -> Vec<ApparentSize> {
        let size = match self {
            Self::Disc(disc) => disc.apparent_size(at),
            Self::Annulus(annulus) => annulus.apparent_size(at),
            Self::Rectangle(rectangle) => rectangle.apparent_size(at),
            Self::Sphere(sphere) => sphere.apparent_size(at),
            Self::Point(point) => point.apparent_size(at),
            Self::Distant(distant) => distant.apparent_size(),
            Self::Environment => environment::apparent_size(at),
            Self::EnvironmentMap(map) => return map.apparent_sizes(at, factors),
        };
        vec![size]
    }

    /// The form that is traced and sampled; `None` for an even environment, which rays find that leave the scene.
    pub(crate) fn prepare(&self) -> Option<PreparedEmitter> {
        Some(match self {
            Self::Disc(disc) => PreparedEmitter::Disc(disc.prepare()),
            Self::Annulus(annulus) => PreparedEmitter::Annulus(annulus.prepare()),
            Self::Rectangle(rectangle) => PreparedEmitter::Rectangle(rectangle.prepare()),
            Self::Sphere(sphere) => PreparedEmitter::Sphere(sphere.prepare()),
            Self::Point(point) => PreparedEmitter::Point(*point),
            Self::Distant(distant) => PreparedEmitter::Distant(*distant),
            Self::Environment => return None,
            Self::EnvironmentMap(map) => PreparedEmitter::EnvironmentMap(Arc::clone(map)),
        })
    }
}

impl From<DiscEmitter> for Emitter {
    fn from(disc: DiscEmitter) -> Self {
        Self::Disc(disc)
    }
}

impl From<AnnulusEmitter> for Emitter {
    fn from(annulus: AnnulusEmitter) -> Self {
        Self::Annulus(annulus)
    }
}

impl From<RectangleEmitter> for Emitter {
    fn from(rectangle: RectangleEmitter) -> Self {
        Self::Rectangle(rectangle)
    }
}

impl From<SphereEmitter> for Emitter {
    fn from(sphere: SphereEmitter) -> Self {
        Self::Sphere(sphere)
    }
}

impl From<PointEmitter> for Emitter {
    fn from(point: PointEmitter) -> Self {
        Self::Point(point)
    }
}

impl From<DistantEmitter> for Emitter {
    fn from(distant: DistantEmitter) -> Self {
        Self::Distant(distant)
    }
}

impl From<EnvironmentMap> for Emitter {
    fn from(map: EnvironmentMap) -> Self {
        Self::EnvironmentMap(Arc::new(map))
    }
}

/// An emitter ready for intersection and sampling: a light, or the emissive surface of an object.
#[derive(Debug)]
pub(crate) enum PreparedEmitter {
    Disc(disc::PreparedDisc),
    Annulus(annulus::PreparedAnnulus),
    Rectangle(rectangle::PreparedRectangle),
    Sphere(sphere::PreparedSphere),
    Point(PointEmitter),
    Distant(DistantEmitter),
    Mesh(mesh::PreparedMesh),
    EnvironmentMap(Arc<EnvironmentMap>),
}

impl PreparedEmitter {
    /// An object with the shape of a sphere that emits to both sides, or outward.
    pub(crate) fn sphere(center: Vec3, radius: f32, is_one_sided: bool) -> Self {
        Self::Sphere(sphere::PreparedSphere::emissive(center, radius, is_one_sided))
    }

    /// Center, normal and radius of a disc; `None` of another shape.
    pub(crate) fn as_disc(&self) -> Option<(Vec3, Vec3, f32)> {
        match self {
            Self::Disc(disc) => Some(disc.shape()),
            _ => None,
        }
    }

    /// An object with the shape of a disc that emits to both sides, or to the front.
    pub(crate) fn disc(center: Vec3, normal: Vec3, radius: f32, is_one_sided: bool) -> Self {
        Self::Disc(disc::PreparedDisc::emissive(center, normal, radius, is_one_sided))
    }

    /// A mesh that emits to both sides, or to the front; `first_triangle` is the number of its first triangle in the renderer's list.
    pub(crate) fn mesh(mesh: &TriangleMesh, first_triangle: usize, is_one_sided: bool) -> Self {
        Self::Mesh(mesh::PreparedMesh::new(mesh, first_triangle, is_one_sided))
    }

    /// The map, if it is one.
    #[inline]
    pub(crate) fn environment_map(&self) -> Option<&EnvironmentMap> {
        match self {
            Self::EnvironmentMap(map) => Some(map),
            _ => None,
        }
    }

    /// Place and direction, by which renderers weight lights against each other.
    pub(crate) fn bounds(&self) -> LightBounds {
        match self {
            Self::Disc(disc) => disc.bounds(),
            Self::Annulus(annulus) => annulus.bounds(),
            Self::Rectangle(rectangle) => rectangle.bounds(),
            Self::Sphere(sphere) => sphere.bounds(),
            Self::Point(point) => point.bounds(),
            Self::Distant(distant) => distant.bounds(),
            Self::Mesh(mesh) => mesh.bounds(),
            Self::EnvironmentMap(_) => LightBounds::Environment,
        }
    }

    /// Distance along a ray to the emitter, below `limit`; both of its sides block. Meshes are found by the renderer.
    #[inline]
    pub(crate) fn intersect(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<f32> {
        match self {
            Self::Disc(disc) => disc.intersect(origin, direction, limit),
            Self::Annulus(annulus) => annulus.intersect(origin, direction, limit),
            Self::Rectangle(rectangle) => rectangle.intersect(origin, direction, limit),
            Self::Sphere(sphere) => sphere.intersect(origin, direction, limit),
            Self::Point(_) | Self::Distant(_) | Self::Mesh(_) | Self::EnvironmentMap(_) => None,
        }
    }

    /// A direction from a point toward the emitter, from two uniform numbers. `choice` is the probability with which the
    /// emitter was chosen, a factor on the density; `corners` gives the triangles of meshes. `None` when the emitter
    /// does not shine there.
    #[inline]
    pub(crate) fn sample(
        &self,
        position: Vec3,
        u: [f32; 2],
        choice: f32,
        corners: impl Fn(usize) -> [Vec3; 3],
    ) -> Option<EmitterSample> {
        match self {
            Self::Disc(disc) => disc.sample(position, u, choice),
            Self::Annulus(annulus) => annulus.sample(position, u, choice),
            Self::Rectangle(rectangle) => rectangle.sample(position, u, choice),
            Self::Sphere(sphere) => sphere.sample(position, u, choice),
            Self::Point(point) => point.sample(position, choice),
            Self::Distant(distant) => Some(distant.sample(choice)),
            Self::Mesh(mesh) => mesh.sample(position, u, choice, corners),
            Self::EnvironmentMap(map) => Some(map.sample_emitter(u, choice)),
        }
    }

    /// Emission that a ray from `position` meets at a distance, and the density with which [`Self::sample`] draws its
    /// direction. `corners` gives the corners of the triangle of a mesh that was hit. `None` for a dark side, and for
    /// delta lights and environments, which have no surface.
    #[inline]
    pub(crate) fn emission(
        &self,
        position: Vec3,
        direction: Vec3,
        distance: f32,
        corners: impl Fn() -> Option<[Vec3; 3]>,
    ) -> Option<Emission> {
        match self {
            Self::Disc(disc) => disc.emission(position, direction, distance),
            Self::Annulus(annulus) => annulus.emission(direction, distance),
            Self::Rectangle(rectangle) => rectangle.emission(position, direction, distance),
            Self::Sphere(sphere) => sphere.emission(position, direction, distance),
            Self::Mesh(mesh) => mesh.emission(direction, distance, corners()?),
            Self::Point(_) | Self::Distant(_) | Self::EnvironmentMap(_) => None,
        }
    }
}
