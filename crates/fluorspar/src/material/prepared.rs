//! Materials on the bands of a wavelength grid, ready to be evaluated at points.

use std::ops::Index;

use glam::{Vec2, Vec3};

use super::bsdf::{BsdfSample, BsdfValue, SpectralTerm};
use super::coated::{CoatedBsdf, FilmFrame, PreparedCoated};
use super::conductor::{ConductorBsdf, PreparedConductor};
use super::dielectric::{DielectricBsdf, PreparedDielectric};
use super::lambertian::LambertianBsdf;
use super::mixture::{Mixture, TwoSided};
use super::normal_map::NormalMap;
use super::state_grid::StateGrid;
use super::texture::ScalarTexture;
use super::{FluorophoreAmount, Material, Scattering};
use crate::spectral::WavelengthGrid;

/// All materials of a scene, by their indices there.
#[derive(Debug)]
pub(crate) struct PreparedMaterials {
    materials: Vec<PreparedMaterial>,
    /// Whether a material, or any that it is made of, has an opacity.
    has_opacity: Vec<bool>,
}

/// A material with its tables.
#[derive(Debug)]
pub(crate) struct PreparedMaterial {
    scattering: PreparedScattering,
    /// Terms of the spectrum of a point: of the diffuse reflectance, the transmittance of a dielectric, the basis of
    /// the reflectances of a metal.
    pub(crate) terms: Vec<SpectralTerm>,
    /// The grid that weights the terms of layered tissue.
    pub(crate) states: Option<StateGrid>,
    /// Fluorophores with their concentrations.
    pub(crate) fluorophores: Vec<FluorophoreAmount>,
    /// Number of the first fluorophore whose concentration has the same texture, of each.
    same_concentration: Vec<usize>,
    opacity: Option<ScalarTexture>,
    normal_map: Option<NormalMap>,
}

/// Concentrations of a point that are looked up once, whatever number of fluorophores has them.
const KNOWN_CONCENTRATIONS: usize = 32;

#[derive(Debug)]
enum PreparedScattering {
    Lambertian,
    Coated(PreparedCoated),
    Dielectric(PreparedDielectric),
    Conductor(PreparedConductor),
    Mixture(Mixture),
    TwoSided(TwoSided),
}

/// The material of a point: one that is not a mixture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChosenMaterial<'a> {
    /// Index of the material.
    pub(crate) index: usize,
    /// Its normal map, otherwise that of the innermost mixture around it that has one.
    pub(crate) normal_map: Option<&'a NormalMap>,
}

impl PreparedMaterials {
    /// Prepares the materials of a scene that passed its check.
    pub(crate) fn new(materials: &[Material], grid: &WavelengthGrid) -> Self {
        let has_opacity = |material: &Material| material.any(materials, |part| part.opacity.is_some());
        Self {
            materials: materials.iter().map(|material| PreparedMaterial::new(material, grid)).collect(),
            has_opacity: materials.iter().map(has_opacity).collect(),
        }
    }

    /// All materials, in their order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &PreparedMaterial> {
        self.materials.iter()
    }

    /// Whether paths ever choose between lobes or parts.
    pub(crate) fn has_discrete_choices(&self) -> bool {
        self.materials.iter().any(|material| !matches!(material.scattering, PreparedScattering::Lambertian))
    }

    /// Whether a material has holes, its own or those of what it is made of.
    pub(crate) fn has_opacity(&self, material: usize) -> bool {
        self.has_opacity[material]
    }

    /// The material of a point of a surface: draws a part of mixtures by `choice`, even in [0, 1), and reuses what is
    /// left of the number.
    #[inline]
    pub(crate) fn choose(
        &self,
        mut index: usize,
        uv: Vec2,
        front: bool,
        choice: &mut f32,
    ) -> ChosenMaterial<'_> {
        let mut normal_map = None;
        loop {
            let material = &self.materials[index];
            normal_map = material.normal_map.as_ref().or(normal_map);
            index = match &material.scattering {
                PreparedScattering::Mixture(mixture) => {
                    mixture.choose(self.amount_of_visible(mixture, uv, front), choice)
                }
                PreparedScattering::TwoSided(sides) => sides.side(front),
                _ => return ChosenMaterial { index, normal_map },
            };
        }
    }

    /// Share of the second material in what is there of a mixture at a point: of the two, weighted by their opacities.
    #[inline]
    fn amount_of_visible(&self, mixture: &Mixture, uv: Vec2, front: bool) -> f32 {
        let amount = mixture.amount(uv);
        if !(self.has_opacity[mixture.first] || self.has_opacity[mixture.second]) {
            return amount;
        }
        let (first, second) = self.opacities_of_parts(mixture, amount, uv, front);
        if first + second > 0.0 { second / (first + second) } else { amount }
    }

    /// Opacities of the parts of a mixture, times their shares.
    fn opacities_of_parts(&self, mixture: &Mixture, amount: f32, uv: Vec2, front: bool) -> (f32, f32) {
        let opacity = |part: usize| self.opacity(part, uv, front);
        ((1.0 - amount) * opacity(mixture.first), amount * opacity(mixture.second))
    }

    /// Opacity of a material at a point, 0 to 1: its own times that of what it is made of.
    pub(crate) fn opacity(&self, index: usize, uv: Vec2, front: bool) -> f32 {
        if !self.has_opacity[index] {
            return 1.0;
        }
        let material = &self.materials[index];
        let own = material.opacity.as_ref().map_or(1.0, |opacity| opacity.at(uv).clamp(0.0, 1.0));
        let of_parts = match &material.scattering {
            PreparedScattering::Mixture(mixture)
                if self.has_opacity[mixture.first] || self.has_opacity[mixture.second] =>
            {
                let (first, second) = self.opacities_of_parts(mixture, mixture.amount(uv), uv, front);
                first + second
            }
            PreparedScattering::TwoSided(sides) => self.opacity(sides.side(front), uv, front),
            _ => 1.0,
        };
        own * of_parts
    }
}

impl Index<usize> for PreparedMaterials {
    type Output = PreparedMaterial;

    #[inline]
    fn index(&self, material: usize) -> &PreparedMaterial {
        &self.materials[material]
    }
}

impl PreparedMaterial {
    fn new(material: &Material, grid: &WavelengthGrid) -> Self {
        let fluoresces = !material.fluorophores.is_empty();
        let (scattering, terms) = match &material.scattering {
            Scattering::Lambertian(lambertian) => (PreparedScattering::Lambertian, lambertian.prepare(grid)),
            Scattering::Coated(coated) => {
                let terms = coated.base.prepare(grid);
                (PreparedScattering::Coated(coated.prepare(&terms, grid.len(), fluoresces)), terms)
            }
            Scattering::Dielectric(dielectric) => {
                let (dielectric, terms) = dielectric.prepare(grid, fluoresces);
                (PreparedScattering::Dielectric(dielectric), terms)
            }
            Scattering::Conductor(conductor) => {
                let (conductor, terms) = conductor.prepare(grid, fluoresces);
                (PreparedScattering::Conductor(conductor), terms)
            }
            Scattering::Mixture(mixture) => (PreparedScattering::Mixture(mixture.clone()), Vec::new()),
            Scattering::TwoSided(sides) => (PreparedScattering::TwoSided(*sides), Vec::new()),
        };
        let amounts = &material.fluorophores;
        let first_same = |amount: &FluorophoreAmount| {
            amounts
                .iter()
                .position(|first| first.concentration.is_same(&amount.concentration))
                .unwrap_or_default()
        };
        Self {
            scattering,
            terms,
            same_concentration: amounts.iter().map(first_same).collect(),
            states: material.diffuse().and_then(|base| base.states.clone()),
            fluorophores: material.fluorophores.clone(),
            opacity: material.opacity.clone(),
            normal_map: material.normal_map.clone(),
        }
    }

    /// Calls `each` with the number and the weight of every term of the spectrum at a point, in order.
    #[inline]
    pub(crate) fn term_weights(&self, uv: Vec2, bsdf: &Bsdf<'_>, mut each: impl FnMut(usize, f32)) {
        if let Some(states) = &self.states {
            return states.weights(uv, each);
        }
        for (index, term) in self.terms.iter().enumerate() {
            each(index, bsdf.term_weight(index, term.weight.at(uv)));
        }
    }

    /// Calls `each` with the number and the concentration of every fluorophore that is present at a point, in order. `weight` is that
    /// of a term of the spectrum there.
    #[inline]
    pub(crate) fn concentrations(
        &self,
        uv: Vec2,
        weight: impl Fn(usize) -> f32,
        mut each: impl FnMut(usize, f32),
    ) {
        // States of a tissue share their textures: each is looked up once
        let mut known = [f32::NAN; KNOWN_CONCENTRATIONS];
        for (number, amount) in self.fluorophores.iter().enumerate() {
            let share = amount.in_tissue.as_ref().map_or(1.0, |state| weight(state.term));
            if share <= 0.0 {
                continue;
            }
            let concentration = match known.get_mut(self.same_concentration[number]) {
                Some(known) if known.is_nan() => {
                    *known = amount.concentration.at(uv);
                    *known
                }
                Some(known) => *known,
                None => amount.concentration.at(uv),
            };
            if share * concentration > 0.0 {
                each(number, share * concentration);
            }
        }
    }

    /// The frame of the film on a surface, as far as the material has a film.
    #[inline]
    pub(crate) fn film(&self, on_surface: FilmFrame) -> FilmFrame {
        match &self.scattering {
            PreparedScattering::Coated(coated) if coated.is_film() => on_surface,
            _ => FilmFrame::default(),
        }
    }

    /// Refractive index of the coat, of a material that has one.
    pub(crate) fn coat_index(&self) -> Option<f32> {
        match &self.scattering {
            PreparedScattering::Coated(coated) => Some(coated.refractive_index()),
            _ => None,
        }
    }

    /// The BSDF of a material that is not a mixture at a point, seen from `outgoing` on the front or on the back, below a film.
    #[inline]
    pub(crate) fn bsdf(
        &self,
        uv: Vec2,
        front: bool,
        outgoing: Vec3,
        film: FilmFrame,
        least_alpha: f32,
    ) -> Bsdf<'_> {
        match &self.scattering {
            PreparedScattering::Coated(coated) => Bsdf::Coated(coated.bsdf(uv, outgoing, film, least_alpha)),
            PreparedScattering::Dielectric(dielectric) => {
                Bsdf::Dielectric(dielectric.bsdf(uv, front, outgoing))
            }
            PreparedScattering::Conductor(conductor) => Bsdf::Conductor(conductor.bsdf(uv, outgoing)),
            // Parts of mixtures are chosen before.
            PreparedScattering::Lambertian
            | PreparedScattering::Mixture(_)
            | PreparedScattering::TwoSided(_) => Bsdf::Lambertian(LambertianBsdf),
        }
    }
}

/// A material at a point, seen from one direction.
pub(crate) enum Bsdf<'a> {
    Lambertian(LambertianBsdf),
    Coated(CoatedBsdf<'a>),
    Dielectric(DielectricBsdf<'a>),
    Conductor(ConductorBsdf<'a>),
}

impl Bsdf<'_> {
    /// Whether light may arrive from behind.
    #[inline]
    pub(crate) fn transmits(&self) -> bool {
        matches!(self, Self::Dielectric(_))
    }

    /// Whether it scatters light from some directions much more than from others.
    #[inline]
    pub(crate) fn has_gloss(&self) -> bool {
        !matches!(self, Self::Lambertian(_))
    }

    /// About what it scatters of the light from a direction, 1/sr, with a spectrum whose mean is `reflectance`: for choosing among
    /// lights.
    #[inline]
    pub(crate) fn estimate(&self, incident: Vec3, reflectance: f32) -> f32 {
        if let Self::Coated(coated) = self {
            return coated.estimate(incident, reflectance);
        }
        let value = self.evaluate(incident);
        (value.diffuse * reflectance + value.gloss).max(0.0)
    }

    /// Weight of a term of the material's spectrum here, where its texture has `value`: for metals by the angle of view.
    #[inline]
    fn term_weight(&self, term: usize, value: f32) -> f32 {
        match self {
            Self::Conductor(conductor) => conductor.term_weight(term),
            _ => value,
        }
    }

    /// Value for light from a direction, without delta lobes.
    #[inline]
    pub(crate) fn evaluate(&self, incident: Vec3) -> BsdfValue {
        match self {
            Self::Lambertian(lambertian) => lambertian.evaluate(incident),
            Self::Coated(coated) => coated.evaluate(incident),
            Self::Dielectric(dielectric) => dielectric.evaluate(incident),
            Self::Conductor(conductor) => conductor.evaluate(incident),
        }
    }

    /// Draws a direction for the path to continue in; `None` ends the path.
    #[inline]
    pub(crate) fn sample(&self, choice: f32, u: [f32; 2]) -> Option<BsdfSample> {
        match self {
            Self::Lambertian(lambertian) => lambertian.sample(u),
            Self::Coated(coated) => coated.sample(choice, u),
            Self::Dielectric(dielectric) => dielectric.sample(choice, u),
            Self::Conductor(conductor) => conductor.sample(choice, u),
        }
    }
}
