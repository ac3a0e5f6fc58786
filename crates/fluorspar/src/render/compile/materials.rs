//! Materials ready for rendering: band averages of their spectra, tables shared by those of the same index.

use std::sync::Arc;

use fluorspar_accel::bands::{BLOCK, BandBlock, to_blocks};

use super::band_blocks;
use crate::material::conductor::white_microfacets;
use crate::material::{
    Coat, CoatAlbedo, Conductor, ConductorReflectance, Dielectric, DielectricAlbedo, Material, ScalarTexture,
    Scattering,
};
use crate::render::compiled_scene::{CompiledMaterial, CompiledScattering};
use crate::render::russian_roulette::{BINS, Coarse, RouletteModel};
use crate::scene::Scene;
use crate::spectral::{Curve, Reflectance, WavelengthGrid};

/// What a fluorescent surface is taken to send on at least: its light matters even where it reflects little.
const FLUORESCENT_ALBEDO: f32 = 0.25;

/// All materials of a scene, with the tables that they refer to by index.
pub(super) struct Materials {
    pub(super) materials: Vec<CompiledMaterial>,
    pub(super) coats: Vec<Arc<CoatAlbedo>>,
    pub(super) dielectrics: Vec<Arc<DielectricAlbedo>>,
    pub(super) metals: Vec<ConductorReflectance>,
    /// Opacity of each object whose material has holes; empty when there is none in the scene.
    pub(super) cutouts: Vec<Option<ScalarTexture>>,
}

/// Compiles the materials of a scene.
pub(super) fn compile(scene: &Scene, roulette: &RouletteModel) -> Materials {
    let mut tables = Tables::default();
    let materials =
        scene.materials.iter().map(|material| tables.compile(material, &scene.grid, roulette)).collect();
    let mut cutouts: Vec<Option<ScalarTexture>> =
        scene.objects.iter().map(|object| scene.materials[object.material].opacity.clone()).collect();
    if cutouts.iter().all(Option::is_none) {
        cutouts.clear();
    }
    let Tables { coats, dielectrics, metals } = tables;
    Materials { materials, coats, dielectrics, metals, cutouts }
}

/// The scattering of a material, the terms of its spectrum, and the same terms on coarse bins.
type Form = (CompiledScattering, Vec<(Vec<BandBlock>, ScalarTexture)>, Vec<Coarse>);

/// Tables as they are gathered.
#[derive(Default)]
struct Tables {
    coats: Vec<Arc<CoatAlbedo>>,
    dielectrics: Vec<Arc<DielectricAlbedo>>,
    metals: Vec<ConductorReflectance>,
}

impl Tables {
    fn compile(
        &mut self,
        material: &Material,
        grid: &WavelengthGrid,
        roulette: &RouletteModel,
    ) -> CompiledMaterial {
        let (scattering, reflectance, coarse_reflectance) = match &material.scattering {
            Scattering::Diffuse => diffuse(material, grid, roulette),
            Scattering::Dielectric(glass) => self.dielectric(glass, grid, roulette),
            Scattering::Conductor(conductor) => self.conductor(conductor, grid, roulette),
            Scattering::Mix { first, second, amount } => (
                CompiledScattering::Mix { first: *first, second: *second, amount: amount.clone() },
                Vec::new(),
                Vec::new(),
            ),
            Scattering::TwoSided { front, back } => {
                (CompiledScattering::TwoSided { front: *front, back: *back }, Vec::new(), Vec::new())
            }
        };
        let coat = material.coat.as_ref().map(|coat| (self.coat(coat), coat.roughness.clone()));
        let fluorophores: Vec<(usize, ScalarTexture)> =
            material.fluorophores.iter().map(|a| (a.fluorophore, a.concentration.clone())).collect();
        let terms: &Vec<(Vec<BandBlock>, ScalarTexture)> = &reflectance;
        let elastic = (0..grid.len())
            .map(|band| {
                let at = |r: &[BandBlock]| r[band / BLOCK].0[band % BLOCK];
                terms.iter().map(|(r, weight)| at(r) * weight.max()).sum()
            })
            .fold(0.0, f32::max);
        let albedo_bound = if fluorophores.is_empty() { elastic } else { elastic.max(FLUORESCENT_ALBEDO) };
        CompiledMaterial {
            scattering,
            reflectance,
            coarse_reflectance,
            normal_map: material.normal_map.clone(),
            coat,
            fluorophores,
            albedo_bound,
        }
    }

    fn dielectric(&mut self, glass: &Dielectric, grid: &WavelengthGrid, roulette: &RouletteModel) -> Form {
        let index = glass.refractive_index;
        let table =
            self.dielectrics.iter().position(|d| d.refractive_index() == index).unwrap_or_else(|| {
                self.dielectrics.push(DielectricAlbedo::shared(index));
                self.dielectrics.len() - 1
            });
        let uniform = ScalarTexture::Constant(1.0);
        (
            CompiledScattering::Dielectric { table, roughness: glass.roughness.clone() },
            vec![(on_bands(&glass.transmittance, grid), uniform)],
            vec![roulette.coarse(&glass.transmittance)],
        )
    }

    fn conductor(&mut self, conductor: &Conductor, grid: &WavelengthGrid, roulette: &RouletteModel) -> Form {
        let metal = ConductorReflectance::new(conductor, grid, white_microfacets());
        let centers = grid.centers_nm();
        let coarse = |term: &Vec<f32>| {
            let values = term.iter().map(|&f| f64::from(f)).collect();
            Curve::new(centers.clone(), values).map_or([0.0; BINS], |curve| roulette.coarse(&curve))
        };
        let uniform = ScalarTexture::Constant(1.0);
        let terms = metal.basis().iter().map(|term| (to_blocks(term), uniform.clone())).collect();
        let coarse = metal.basis().iter().map(coarse).collect();
        self.metals.push(metal);
        let roughness = conductor.roughness.clone();
        (CompiledScattering::Conductor { metal: self.metals.len() - 1, roughness }, terms, coarse)
    }

    /// The table of a coat's index.
    fn coat(&mut self, coat: &Coat) -> usize {
        let index = coat.refractive_index;
        self.coats.iter().position(|c| c.refractive_index() == index).unwrap_or_else(|| {
            self.coats.push(CoatAlbedo::shared(index));
            self.coats.len() - 1
        })
    }
}

fn diffuse(material: &Material, grid: &WavelengthGrid, roulette: &RouletteModel) -> Form {
    let terms = &material.reflectance;
    (
        CompiledScattering::Diffuse,
        terms.iter().map(|term| (on_bands(&term.spectrum, grid), term.weight.clone())).collect(),
        terms.iter().map(|term| roulette.coarse(&term.spectrum)).collect(),
    )
}

fn on_bands(curve: &Curve, grid: &WavelengthGrid) -> Vec<BandBlock> {
    band_blocks(curve.on_grid::<Reflectance>(grid).values())
}
