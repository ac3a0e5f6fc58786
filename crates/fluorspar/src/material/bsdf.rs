//! Values and samples of a BSDF (bidirectional scattering distribution function), all scalar.
//!
//! Directions are unit vectors in the local frame, whose +z is the shading normal on the side of the viewer, and point
//! away from the surface. `outgoing` leads to the viewer, `incident` to where light comes from.
//!
//! A lobe that depends on the wavelength is written as `diffuse * spectrum + gloss`, with one spectrum per point: the
//! diffuse reflectance, the reflectance of a metal at the angle of view, the transmittance of a dielectric. So
//! directions depend on no wavelength and no concentration.

use std::f32::consts::PI;

use glam::Vec3;

use super::texture::ScalarTexture;
use crate::spectral::{Curve, Reflectance, WavelengthGrid};

/// Value of a BSDF for one incident direction: throughput factors times the cosine of that direction, 1/sr; of a delta
/// lobe without the delta function.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct BsdfValue {
    /// Times the spectrum of the point. May be negative where `gloss` outweighs it.
    pub(crate) diffuse: f32,
    /// Of the fluorescence operators.
    pub(crate) fluorescent: f32,
    /// The same for all wavelengths. May be negative where `diffuse` outweighs it.
    pub(crate) gloss: f32,
    /// Density with which the direction is drawn, 1/sr; of a delta lobe the probability of drawing it.
    pub(crate) pdf: f32,
}

/// A direction drawn for the path to continue in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BsdfSample {
    /// Direction of the arriving light.
    pub(crate) incident: Vec3,
    pub(crate) value: BsdfValue,
    /// Delta lobe: skipped by next-event estimation.
    pub(crate) delta: bool,
}

impl BsdfSample {
    /// A sample of a lobe that is not a delta; `None` where its density is zero.
    #[inline]
    pub(super) fn of_density(incident: Vec3, value: BsdfValue) -> Option<Self> {
        (value.pdf > 0.0).then_some(Self { incident, value, delta: false })
    }

    /// A mirror reflection of `outgoing`.
    #[inline]
    pub(super) fn mirrored(outgoing: Vec3, value: BsdfValue) -> Self {
        Self { incident: Vec3::new(-outgoing.x, -outgoing.y, outgoing.z), value, delta: true }
    }
}

/// Least share of samples for the light that rough microfacets scatter more than once.
pub(super) const LEAST_COSINE: f32 = 0.02;
/// Share of samples for the fluorescence of dielectrics and metals.
const FLUORESCENT_SHARE: f32 = 0.4;

/// Share of samples for fluorescence.
#[inline]
pub(super) fn fluorescent_share(fluoresces: bool) -> f32 {
    if fluoresces { FLUORESCENT_SHARE } else { 0.0 }
}

/// Which lobe a direction is drawn from, with what is left of the random number.
pub(super) enum Lobe {
    Cosine(f32),
    Specular(f32),
}

/// Draws from the cosine lobe with a probability, otherwise from the specular one.
#[inline]
pub(super) fn choose_lobe(choice: f32, cosine_probability: f32) -> Lobe {
    let specular_probability = 1.0 - cosine_probability;
    if choice >= specular_probability {
        Lobe::Cosine((choice - specular_probability) / cosine_probability)
    } else {
        Lobe::Specular(choice / specular_probability)
    }
}

/// Density of the cosine lobe on the side of `incident`, and BRDF times cosine of a white Lambertian surface, 1/sr.
#[inline]
pub(super) fn cosine_lobe(incident: Vec3) -> f32 {
    incident.z.abs() / PI
}

/// One term of the spectrum of a material: `weight(u, v) * spectrum(lambda)`.
#[derive(Clone, Debug)]
pub(crate) struct SpectralTerm {
    /// The spectrum as a curve.
    pub(crate) spectrum: Curve,
    /// Its mean over every band of a grid.
    pub(crate) bands: Vec<f32>,
    /// Factor over the surface.
    pub(crate) weight: ScalarTexture,
}

impl SpectralTerm {
    /// Averages a spectrum over the bands of a grid.
    pub(super) fn new(spectrum: &Curve, weight: ScalarTexture, grid: &WavelengthGrid) -> Self {
        let bands =
            spectrum.on_grid::<Reflectance>(grid).values().iter().map(|&value| value as f32).collect();
        Self { spectrum: spectrum.clone(), bands, weight }
    }
}
