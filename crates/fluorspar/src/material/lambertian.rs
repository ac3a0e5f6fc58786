//! Diffuse reflection.

use glam::{Vec2, Vec3};

use super::bsdf::{BsdfSample, BsdfValue, SpectralTerm, cosine_lobe};
use super::state_grid::StateGrid;
use super::texture::ScalarTexture;
use crate::sampling::warp;
use crate::spectral::{Curve, WavelengthGrid};

/// Lambertian reflection: `f = R / pi` with the diffuse reflectance `R(lambda) = sum_k weight_k(u, v) spectrum_k(lambda)`.
///
/// Without terms the surface is black. Of layered tissue the terms are the states of a grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lambertian {
    /// Terms of the diffuse reflectance, at most 1 in all at any wavelength.
    pub reflectance: Vec<ReflectanceTerm>,
    /// The grid whose states the terms are, in its order; it weights them in place of their own weights.
    pub states: Option<StateGrid>,
}

/// One term of a reflectance: `weight(u, v) * spectrum(lambda)`.
#[derive(Clone, Debug, PartialEq)]
pub struct ReflectanceTerm {
    /// Reflectance spectrum, 0 to 1.
    pub spectrum: Curve,
    /// Factor over the surface.
    pub weight: ScalarTexture,
}

impl Lambertian {
    /// The same reflectance, 0 to 1, everywhere.
    pub fn uniform(reflectance: Curve) -> Self {
        Self {
            reflectance: vec![ReflectanceTerm {
                spectrum: reflectance,
                weight: ScalarTexture::Constant(1.0),
            }],
            states: None,
        }
    }

    /// The reflectances of the states of a grid, 0 to 1, in its order.
    pub fn of_states(reflectances: Vec<Curve>, states: StateGrid) -> Self {
        let term = |spectrum| ReflectanceTerm { spectrum, weight: ScalarTexture::Constant(1.0) };
        Self { reflectance: reflectances.into_iter().map(term).collect(), states: Some(states) }
    }

    /// Weights of the terms at a point, in their order.
    pub fn weights_at(&self, uv: Vec2) -> Vec<f32> {
        match &self.states {
            None => self.reflectance.iter().map(|term| term.weight.at(uv)).collect(),
            Some(states) => states.weights_at(uv),
        }
    }

    /// Sum of a value over the terms where their weights are largest: of the states of a tissue, whose weights add up to
    /// 1, the largest value.
    pub(super) fn upper_bound(&self, value: impl Fn(usize) -> f32) -> f32 {
        let values = self.reflectance.iter().enumerate();
        match &self.states {
            None => values.map(|(index, term)| value(index) * term.weight.max()).sum(),
            Some(_) => values.map(|(index, _)| value(index)).fold(0.0, f32::max),
        }
    }

    /// The spectrum of the surface on the bands of a grid.
    pub(super) fn prepare(&self, grid: &WavelengthGrid) -> Vec<SpectralTerm> {
        let term = |term: &ReflectanceTerm| SpectralTerm::new(&term.spectrum, term.weight.clone(), grid);
        self.reflectance.iter().map(term).collect()
    }

    /// Diffuse reflectance at a wavelength, where textures have the given values.
    pub(super) fn albedo(&self, wavelength_nm: f64, value: impl Fn(&ScalarTexture) -> f64) -> f64 {
        self.reflectance.iter().map(|term| term.spectrum.at(wavelength_nm) * value(&term.weight)).sum()
    }

    pub(super) fn textures(&self) -> impl Iterator<Item = &ScalarTexture> {
        self.reflectance.iter().map(|term| &term.weight)
    }
}

/// A Lambertian surface at a point.
pub(crate) struct LambertianBsdf;

impl LambertianBsdf {
    /// Value for light from a direction.
    #[inline]
    pub(super) fn evaluate(&self, incident: Vec3) -> BsdfValue {
        if incident.z <= 0.0 {
            return BsdfValue::default();
        }
        let lambert = cosine_lobe(incident);
        BsdfValue { diffuse: lambert, fluorescent: lambert, gloss: 0.0, pdf: lambert }
    }

    /// Draws a direction by the cosine.
    #[inline]
    pub(super) fn sample(&self, u: [f32; 2]) -> Option<BsdfSample> {
        let incident = warp::cosine_hemisphere(u);
        BsdfSample::of_density(incident, self.evaluate(incident))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Scattering;
    use super::super::bsdf_tests::{assert_furnace, assert_samples_follow_density, plain_and_fluorescent};
    use super::*;

    fn gray(reflectance: f64) -> Scattering {
        Scattering::Lambertian(Lambertian::uniform(Curve::constant(reflectance)))
    }

    #[test]
    fn sampled_directions_follow_their_density() {
        for material in plain_and_fluorescent(gray(0.5)) {
            assert_samples_follow_density(&material, true, 0.6, 2);
        }
    }

    #[test]
    fn the_reflectance_comes_back() {
        for (reflectance, cos) in [(1.0, 1.0), (0.5, 0.3), (0.0, 0.8)] {
            for material in plain_and_fluorescent(gray(reflectance)) {
                assert_furnace(&material, true, cos, 0.0, reflectance, 1e-6);
            }
        }
    }

    #[test]
    fn weights_of_terms_multiply_their_spectra() {
        let term = |value, weight| ReflectanceTerm {
            spectrum: Curve::constant(value),
            weight: ScalarTexture::Constant(weight),
        };
        let sum = Lambertian { reflectance: vec![term(0.5, 0.4), term(0.8, 0.25)], states: None };
        assert!((sum.albedo(550.0, |texture| f64::from(texture.max())) - 0.4).abs() < 1e-7);
        for material in plain_and_fluorescent(Scattering::Lambertian(sum)) {
            assert_furnace(&material, true, 0.5, 0.0, 0.4, 1e-6);
        }
    }
}
