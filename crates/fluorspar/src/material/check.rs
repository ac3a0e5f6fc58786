//! Whether a material is physical: ranges of its parameters, conservation of photons.

use std::fmt;

use glam::Vec2;

use super::material_error::{MaterialError, at_most_one};
use super::texture::ScalarTexture;
use super::{Lambertian, Material, Scattering, TissueEmission};
use crate::spectral::WavelengthGrid;

/// A wavelength at which more photons leave a material than arrive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonExcess {
    /// Wavelength of the arriving light, nm.
    pub wavelength_nm: f64,
    /// Share of light that is reflected or transmitted without fluorescence.
    pub reflectance: f64,
    /// Photon yield, summed over fluorophores.
    pub photon_yield: f64,
    /// Excess of their sum over 1.
    pub excess: f64,
}

impl fmt::Display for PhotonExcess {
    /// As the predicate of a sentence: `emits more photons than it receives: at 405 nm, ...`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { wavelength_nm, reflectance, photon_yield, excess } = self;
        write!(
            f,
            "emits more photons than it receives: at {wavelength_nm} nm, reflectance {reflectance:.4} plus fluorescence \
             yield {photon_yield:.4} exceeds 1 by {excess:.4}. Lower the reflectance or the concentrations"
        )
    }
}

/// Rounding allowed above 1: a perfectly white material must pass.
const ROUNDING: f64 = 1e-6;

impl Material {
    /// Checks the parameters of the material itself. Parts of mixtures are checked as materials of their own.
    ///
    /// # Errors
    /// The first parameter that is out of its range, or data that do not cover the bands of `grid`.
    pub fn check(&self, grid: &WavelengthGrid) -> Result<(), MaterialError> {
        if let Some(opacity) = &self.opacity {
            at_most_one("opacity", opacity)?;
        }
        match &self.scattering {
            Scattering::Lambertian(_) => Ok(()),
            Scattering::Coated(coated) => coated.coat.check(),
            Scattering::Dielectric(dielectric) => dielectric.check(),
            Scattering::Conductor(conductor) => conductor.check(grid),
            Scattering::Mixture(mixture) => mixture.check(),
            Scattering::TwoSided(_) => Ok(()),
        }?;
        if self.parts().is_some() && !self.fluorophores.is_empty() {
            return Err(MaterialError::FluorophoresOfMixture);
        }
        self.check_states()
    }

    /// Checks that states of a tissue fit their grid, and fluorophores in tissue their states.
    fn check_states(&self) -> Result<(), MaterialError> {
        let states = self.diffuse().and_then(|base| Some((base.states.as_ref()?, base.reflectance.len())));
        if let Some((grid, count)) = states {
            grid.check(count)?;
        }
        let count = states.map_or(0, |(_, count)| count);
        match self
            .fluorophores
            .iter()
            .filter_map(|amount| amount.in_tissue.as_ref())
            .find(|s| s.term >= count)
        {
            None => Ok(()),
            Some(TissueEmission { term, .. }) => {
                Err(MaterialError::States(format!("a fluorophore is in state {term}, but there are {count}")))
            }
        }
    }

    /// Whether a mixture or two-sided material, at `index` of `materials`, is a part of itself at any depth.
    pub fn is_part_of_itself(index: usize, materials: &[Self]) -> bool {
        let has_part = |material: &Self| material.parts().is_some_and(|parts| parts.contains(&index));
        materials.get(index).is_some_and(|material| material.any(materials, has_part))
    }

    /// Where the excess of photons is largest: `R + sum_o Y <= 1` (for dielectrics `T + sum_o Y <= 1`) must hold at
    /// every wavelength of `nodes_nm`, with all textures at their largest value or, where that is too much, at every
    /// point of a grid over them. `yields` holds those of each fluorophore of the scene at the nodes, at unit
    /// concentration. Of layered tissue every state must conserve photons: so does every mean of them.
    pub fn photon_excess(&self, nodes_nm: &[f64], yields: &[Vec<f64>]) -> Option<PhotonExcess> {
        if let Some(base) = self.diffuse().filter(|base| base.states.is_some()) {
            return self.excess_of_states(base, nodes_nm, yields);
        }
        worst(nodes_nm, |node, wavelength_nm| {
            let sum =
                |value: &dyn Fn(&ScalarTexture) -> f64| self.photons(wavelength_nm, node, yields, value);
            let (reflectance, photon_yield) = sum(&|texture| f64::from(texture.max()));
            if reflectance + photon_yield - 1.0 > ROUNDING {
                // Textures of one material often exclude each other: look where they are together.
                return largest_sum(sum);
            }
            (reflectance, photon_yield)
        })
    }

    /// The largest excess of any state of a tissue, with its fluorophores at their largest concentrations.
    fn excess_of_states(
        &self,
        base: &Lambertian,
        nodes_nm: &[f64],
        yields: &[Vec<f64>],
    ) -> Option<PhotonExcess> {
        // Sum the yields of each state; fluorophores on the surface belong to all
        let mut of_states = vec![vec![0.0; nodes_nm.len()]; base.reflectance.len()];
        for amount in &self.fluorophores {
            let concentration = f64::from(amount.concentration.max());
            let mut add = |state: usize, yields: &[f64]| {
                of_states[state]
                    .iter_mut()
                    .zip(yields)
                    .for_each(|(sum, value)| *sum += concentration * value);
            };
            match &amount.in_tissue {
                Some(state) => add(state.term, &state.eem.total_yields(nodes_nm)),
                None => (0..base.reflectance.len()).for_each(|state| add(state, &yields[amount.fluorophore])),
            }
        }
        let states = base.reflectance.iter().zip(&of_states).filter_map(|(term, yields)| {
            worst(nodes_nm, |node, wavelength_nm| (term.spectrum.at(wavelength_nm), yields[node]))
        });
        states.max_by(|a, b| a.excess.total_cmp(&b.excess))
    }

    /// Elastic share of light and photon yield where textures have the given values.
    fn photons(
        &self,
        wavelength_nm: f64,
        node: usize,
        yields: &[Vec<f64>],
        value: &dyn Fn(&ScalarTexture) -> f64,
    ) -> (f64, f64) {
        let photon_yield = self
            .fluorophores
            .iter()
            .map(|amount| yields[amount.fluorophore][node] * value(&amount.concentration))
            .sum();
        (self.elastic_share(wavelength_nm, value), photon_yield)
    }

    /// Share of light that is passed on without fluorescence. Fluorophores on a metal or a dielectric get what its
    /// surface does not reflect, and share it with what crosses.
    fn elastic_share(&self, wavelength_nm: f64, value: &dyn Fn(&ScalarTexture) -> f64) -> f64 {
        match &self.scattering {
            Scattering::Lambertian(lambertian) => lambertian.albedo(wavelength_nm, value),
            Scattering::Coated(coated) => coated.base.albedo(wavelength_nm, value),
            Scattering::Dielectric(dielectric) => dielectric.transmittance.at(wavelength_nm),
            Scattering::Conductor(_) | Scattering::Mixture(_) | Scattering::TwoSided(_) => 0.0,
        }
    }
}

/// Where the excess of reflectance and photon yield, given by node and wavelength, is largest; `None` where nothing exceeds.
fn worst(nodes_nm: &[f64], photons: impl Fn(usize, f64) -> (f64, f64)) -> Option<PhotonExcess> {
    let mut worst = None;
    let mut largest = ROUNDING;
    for (node, &wavelength_nm) in nodes_nm.iter().enumerate() {
        let (reflectance, photon_yield) = photons(node, wavelength_nm);
        let excess = reflectance + photon_yield - 1.0;
        if excess > largest {
            largest = excess;
            worst = Some(PhotonExcess { wavelength_nm, reflectance, photon_yield, excess });
        }
    }
    worst
}

/// Elastic share and photon yield where their sum is largest on a grid over the textures.
fn largest_sum(sum: impl Fn(&dyn Fn(&ScalarTexture) -> f64) -> (f64, f64)) -> (f64, f64) {
    const SIDE: u32 = 48;
    let mut worst = (0.0, 0.0);
    for i in 0..SIDE * SIDE {
        let uv = Vec2::new((i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5) / SIDE as f32;
        let (reflectance, photon_yield) = sum(&|texture| f64::from(texture.at(uv)));
        if reflectance + photon_yield > worst.0 + worst.1 {
            worst = (reflectance, photon_yield);
        }
    }
    worst
}
