//! Results of sampling a light, and of a scattered ray that hits one.

use glam::Vec3;

/// A direction toward an emitter, drawn for next-event estimation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EmitterSample {
    /// Unit direction from the point to the emitter.
    pub(crate) direction: Vec3,
    /// Distance to the emitter, m; infinite for distant lights and environments.
    pub(crate) distance: f32,
    /// Factor on the light's spectrum: radiance for emitters with area, radiance times solid angle for delta lights,
    /// 1 for environment maps, whose pixel holds the factors.
    pub(crate) scale: f32,
    /// Pixel of an environment map.
    pub(crate) pixel: usize,
    /// Density, 1/sr, times the probability with which the emitter was chosen; for delta lights that probability alone.
    pub(crate) pdf: f32,
    /// Delta light: a point or parallel light, which no scattered ray meets.
    pub(crate) delta: bool,
}

impl EmitterSample {
    /// A direction of density `pdf`; `None` where the emitter is dark.
    #[inline]
    pub(super) fn by_solid_angle(direction: Vec3, distance: f32, pdf: f32, scale: f32) -> Option<Self> {
        (scale > 0.0).then_some(Self { direction, distance, scale, pdf, delta: false, pixel: 0 })
    }

    /// A direction to a point drawn evenly over `area`, which is seen at the cosine `cos`: the density is
    /// `choice * distance^2 / (area * cos)`. `None` where the emitter is dark or seen from behind.
    #[inline]
    pub(super) fn by_area(
        choice: f32,
        (direction, distance): (Vec3, f32),
        cos: f32,
        area: f32,
        scale: f32,
    ) -> Option<Self> {
        (cos > 0.0 && scale > 0.0).then(|| Self {
            direction,
            distance,
            scale,
            pdf: choice * distance * distance / (area * cos),
            delta: false,
            pixel: 0,
        })
    }
}

/// Emission that a scattered ray hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Emission {
    /// Radiance per unit of the light's spectrum.
    pub(crate) scale: f32,
    /// Density, 1/sr, with which sampling the emitter draws this direction.
    pub(crate) density: f32,
}

/// Unit direction and distance from one point to another; `None` where they coincide.
#[inline]
pub(super) fn toward(position: Vec3, point: Vec3) -> Option<(Vec3, f32)> {
    let offset = point - position;
    let distance = offset.length();
    (distance > 0.0).then(|| (offset / distance, distance))
}

/// Where an emitter is and how it is directed: what choosing among lights needs to know.
#[derive(Clone, Copy, Debug)]
pub(crate) enum LightBounds {
    /// Parallel light that travels along a unit vector.
    Distant {
        /// Unit vector along which light travels.
        direction: Vec3,
    },
    /// Light from all directions.
    Environment,
    /// An emitter within a sphere.
    Local {
        /// Center of the sphere, m.
        center: Vec3,
        /// Radius of the sphere, m.
        radius: f32,
        /// Axis and exponent of an intensity `cos^g`; `None` for emitters that send light to all sides.
        lobe: Option<(Vec3, f32)>,
    },
}

impl LightBounds {
    /// Center and radius of the sphere that an emitter with a place lies in, m.
    pub(crate) fn sphere(&self) -> Option<(Vec3, f32)> {
        match self {
            Self::Local { center, radius, .. } => Some((*center, *radius)),
            Self::Distant { .. } | Self::Environment => None,
        }
    }
}
