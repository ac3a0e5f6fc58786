//! How surfaces turn arriving light into leaving light.
//!
//! | module | what |
//! |---|---|
//! | `lambertian` | diffuse reflection, a weighted sum of spectra |
//! | `coated` | a diffuse base below a rough dielectric coat |
//! | `dielectric` | smooth and rough surfaces that refract |
//! | `conductor` | smooth and rough metals |
//! | `mixture` | two materials side by side, or one on either side |
//! | [`fresnel`], [`microfacet`] | what several of them share |
//! | `texture`, `normal_map` | what varies over a surface |
//! | `state_grid`, `tissue_surface` | layered tissue, also where its parameters vary over a surface |
//! | `tissue_nodes`, `tissue_tables` | at which values of these it is solved; its solutions as bytes |
//! | `prepared`, `bsdf` | materials on the bands of a render; their values and samples at points |
//! | `check`, `material_error` | ranges of parameters, conservation of photons |

use std::cell::Cell;
use std::sync::Arc;

mod bsdf;
#[cfg(test)]
mod bsdf_tests;
mod check;
mod coated;
pub mod conductor;
pub mod dielectric;
pub mod fresnel;
mod lambertian;
mod material_error;
pub mod microfacet;
mod mixture;
mod normal_map;
mod prepared;
mod state_grid;
mod texture;
mod tissue_nodes;
mod tissue_surface;
#[cfg(test)]
mod tissue_surface_tests;
mod tissue_tables;

pub(crate) use bsdf::{BsdfSample, BsdfValue};
pub use check::PhotonExcess;
pub(crate) use coated::FilmFrame;
pub use coated::{Coat, CoatAlbedo, Coated};
pub use conductor::{Conductor, ConductorReflectance};
pub use dielectric::{Dielectric, DielectricAlbedo, MAX_DIELECTRIC_INDEX};
pub use lambertian::{Lambertian, ReflectanceTerm};
pub use material_error::MaterialError;
pub use microfacet::{AlbedoTable, MIN_ROUGHNESS};
pub use mixture::{Mixture, TwoSided};
pub use normal_map::{NormalMap, NormalMapError};
pub(crate) use prepared::{Bsdf, PreparedMaterial, PreparedMaterials};
pub use state_grid::{MAX_MAPPED_PARAMETERS, MAX_NODES, MappedParameter, StateGrid};
pub use texture::{ImageTexture, ScalarTexture, TextureError};
pub use tissue_surface::{INTERPOLATION_ERROR, SurfaceFluorescence, TissueSurface};

use crate::spectral::{Curve, PhotonEem};
use crate::tissue::RadialProfile;

/// A surface material, Eq. 5 of the paper: `L = reflection + fluorescence`.
///
/// - Reflection and transmission of [`Scattering`].
/// - Fluorescence comes from the irradiance that is not reflected by the coat, the metal or the surface of the
///   dielectric, is independent of the diffuse reflectance, and leaves as Lambertian light:
///   `L_f = (1/pi) sum_j c_j integral Y_j(lo|li) E(li) dli`, through a coat with its factor. On dielectrics one half
///   leaves to either side.
/// - Both sides of a surface are alike, but for [`TwoSided`] and for dielectrics, whose inside is behind the geometric
///   normal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Material {
    /// Name for error messages and maps.
    pub name: String,
    /// How light is reflected and transmitted.
    pub scattering: Scattering,
    /// Fluorophores and their concentrations, relative to the catalogue's unit. Not on mixtures: on their parts.
    pub fluorophores: Vec<FluorophoreAmount>,
    /// Opacity (alpha mask), 0 to 1: holes are 0. `None` is 1 everywhere. That of a mixture or two-sided material
    /// multiplies that of its parts.
    pub opacity: Option<ScalarTexture>,
    /// Directions of the shading normal over the surface, if any. That of a mixture or two-sided material holds for
    /// those of its parts that have none of their own.
    pub normal_map: Option<NormalMap>,
}

/// How a material reflects and transmits light.
#[derive(Clone, Debug, PartialEq)]
pub enum Scattering {
    /// Diffuse reflection.
    Lambertian(Lambertian),
    /// Diffuse reflection below a rough dielectric coat.
    Coated(Coated),
    /// Reflection and refraction.
    Dielectric(Dielectric),
    /// Reflection by a metal.
    Conductor(Conductor),
    /// Two materials side by side, finer than a pixel.
    Mixture(Mixture),
    /// One material on either side.
    TwoSided(TwoSided),
}

impl Default for Scattering {
    /// A black surface.
    fn default() -> Self {
        Self::Lambertian(Lambertian::default())
    }
}

/// Amount of a fluorophore in a material.
#[derive(Clone, Debug, PartialEq)]
pub struct FluorophoreAmount {
    /// Index into the scene's fluorophores.
    pub fluorophore: usize,
    /// Concentration over the surface, in the catalogue's unit.
    pub concentration: ScalarTexture,
    /// How it is excited and seen below the surface of layered tissue; `None` for one that lies on the surface.
    pub in_tissue: Option<TissueEmission>,
}

/// Light of a fluorophore in layered tissue: that of one of the states between which the tissue of a point lies.
#[derive(Clone, Debug, PartialEq)]
pub struct TissueEmission {
    /// Photon yield density of the tissue at unit concentration, of light that passed its surface; it takes the place of
    /// the fluorophore's own.
    pub eem: Arc<PhotonEem>,
    /// Number of the reflectance term that belongs to the same state: its weight multiplies the concentration.
    pub term: usize,
    /// How far from where the excitation enters its light leaves, for each of [`crate::tissue::EXCITATIONS_NM`]. `None` where light
    /// leaves where it enters.
    pub profiles: Option<Arc<[RadialProfile; 3]>>,
}

impl FluorophoreAmount {
    /// A fluorophore on the surface.
    pub fn new(fluorophore: usize, concentration: ScalarTexture) -> Self {
        Self { fluorophore, concentration, in_tissue: None }
    }
}

impl Material {
    /// An opaque material without fluorophores and normal map.
    pub fn new(name: &str, scattering: Scattering) -> Self {
        Self { name: name.into(), scattering, ..Self::default() }
    }

    /// A matte material of one reflectance, 0 to 1.
    pub fn lambertian(name: &str, reflectance: Curve) -> Self {
        Self::new(name, Scattering::Lambertian(Lambertian::uniform(reflectance)))
    }

    /// A material of one diffuse reflectance, 0 to 1, below a coat.
    ///
    /// ```
    /// use fluorspar::material::{Coat, Material, ScalarTexture};
    /// use fluorspar::spectral::Curve;
    ///
    /// let saliva = Coat::new(1.33, ScalarTexture::Constant(0.1));
    /// let tongue = Material::coated("tongue", Curve::constant(0.3), saliva);
    /// assert!(tongue.coat().is_some());
    /// ```
    pub fn coated(name: &str, reflectance: Curve, coat: Coat) -> Self {
        Self::with_base(name, Lambertian::uniform(reflectance), Some(coat))
    }

    /// A diffuse material, below a coat if one is given.
    pub fn with_base(name: &str, base: Lambertian, coat: Option<Coat>) -> Self {
        let scattering = match coat {
            None => Scattering::Lambertian(base),
            Some(coat) => Scattering::Coated(Coated { base, coat }),
        };
        Self::new(name, scattering)
    }

    /// The diffuse reflection of a material that has one.
    pub fn diffuse(&self) -> Option<&Lambertian> {
        match &self.scattering {
            Scattering::Lambertian(lambertian) => Some(lambertian),
            Scattering::Coated(coated) => Some(&coated.base),
            _ => None,
        }
    }

    /// The diffuse reflection of a material that has one, to change it.
    pub fn diffuse_mut(&mut self) -> Option<&mut Lambertian> {
        match &mut self.scattering {
            Scattering::Lambertian(lambertian) => Some(lambertian),
            Scattering::Coated(coated) => Some(&mut coated.base),
            _ => None,
        }
    }

    /// The coat of a material that has one.
    pub fn coat(&self) -> Option<&Coat> {
        match &self.scattering {
            Scattering::Coated(coated) => Some(&coated.coat),
            _ => None,
        }
    }

    /// Indices of the two materials that a mixture or a two-sided material is made of.
    pub fn parts(&self) -> Option<[usize; 2]> {
        match &self.scattering {
            Scattering::Mixture(mixture) => Some([mixture.first, mixture.second]),
            Scattering::TwoSided(sides) => Some([sides.front, sides.back]),
            _ => None,
        }
    }

    /// Whether anything of the material varies over texture coordinates, its parts among `materials` included.
    pub fn is_textured(&self, materials: &[Self]) -> bool {
        self.any(materials, |material| {
            material.normal_map.is_some()
                || material.textures().iter().any(|texture| texture.constant().is_none())
        })
    }

    /// Whether a condition holds for the material or for any that it is made of, at any depth. `materials` are those
    /// that indices of parts refer to; indices beyond them and parts of themselves are passed over.
    pub fn any(&self, materials: &[Self], condition: impl Fn(&Self) -> bool) -> bool {
        let mut is_visited = vec![false; materials.len()];
        let mut open = vec![self];
        while let Some(material) = open.pop() {
            if condition(material) {
                return true;
            }
            for part in material.parts().into_iter().flatten() {
                if let (Some(part), Some(visited)) = (materials.get(part), is_visited.get_mut(part))
                    && !std::mem::replace(visited, true)
                {
                    open.push(part);
                }
            }
        }
        false
    }

    /// Longest length over which a film on the material, or on any that it is made of, evens out what is below it, m.
    pub(crate) fn smoothing_m(&self, materials: &[Self]) -> f32 {
        let longest = Cell::new(0.0_f32);
        self.any(materials, |part| {
            longest.set(part.coat().map_or(0.0, |coat| coat.smoothing_m).max(longest.get()));
            false
        });
        longest.get()
    }

    /// All textures of the material itself.
    fn textures(&self) -> Vec<&ScalarTexture> {
        let mut textures: Vec<&ScalarTexture> = match &self.scattering {
            Scattering::Lambertian(lambertian) => lambertian.textures().collect(),
            Scattering::Coated(coated) => coated.base.textures().chain([&coated.coat.roughness]).collect(),
            Scattering::Dielectric(dielectric) => vec![&dielectric.roughness],
            Scattering::Conductor(conductor) => vec![&conductor.roughness],
            Scattering::Mixture(mixture) => vec![&mixture.amount],
            Scattering::TwoSided(_) => Vec::new(),
        };
        let states = self.diffuse().and_then(|base| base.states.as_ref());
        textures.extend(states.into_iter().flat_map(|grid| &grid.parameters).map(|parameter| &parameter.map));
        textures.extend(self.fluorophores.iter().map(|amount| &amount.concentration));
        textures.extend(&self.opacity);
        textures
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_are_found_at_any_depth() {
        let checker = ScalarTexture::Checker { columns: 2, rows: 2, low: 0.2, high: 0.9 };
        let mix = |first, second, amount| {
            Material::new("mix", Scattering::Mixture(Mixture { first, second, amount }))
        };
        let gray = || Material::lambertian("gray", Curve::constant(0.5));
        let half = || ScalarTexture::Constant(0.5);
        let sides = Material::new("sides", Scattering::TwoSided(TwoSided { front: 0, back: 2 }));
        let mut materials = vec![gray(), gray(), mix(0, 1, half()), sides];
        assert!(!materials[3].is_textured(&materials));
        materials[1].opacity = Some(checker.clone());
        assert!(materials[3].is_textured(&materials));
        materials[1].opacity = None;
        materials[2] = mix(0, 1, checker);
        assert!(materials[3].is_textured(&materials));
        // A part of itself and parts that do not exist end the search.
        materials[2] = mix(3, 9, half());
        assert!(!materials[3].is_textured(&materials));
    }
}
