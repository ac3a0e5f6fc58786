//! Lights ready for sampling, and the distinct spectra that they emit.

use fluorspar_accel::bands::{BandBlock, to_blocks};
use rayon::prelude::*;

use super::excitation_bins::excitation_slices;
use super::geometry::EmissiveSurface;
use crate::light::PreparedEmitter;
use crate::render::compiled_scene::{CompiledLight, Source};
use crate::render::fluorescence_operator::direct_exitance;
use crate::scene::Scene;
use crate::spectral::{Curve, PhotonEem, WavelengthGrid};

/// All lights of a scene.
pub(super) struct Lights {
    /// Sources in runs of `slices`: the excitation bins of one light spectrum.
    pub(super) sources: Vec<Source>,
    /// Excitation bins of every light spectrum; 1 unless they are kept apart.
    pub(super) slices: usize,
    /// Emissive objects, then light sources.
    pub(super) lights: Vec<CompiledLight>,
    /// Number of the first light source in `lights`.
    pub(super) first_light_source: usize,
    /// Lights of each group that can be sampled.
    pub(super) group_lights: Vec<Vec<usize>>,
    /// Emissive objects: their light.
    pub(super) object_light: Vec<Option<usize>>,
    /// Sources that shine from every direction beyond the scene.
    pub(super) environment: Vec<usize>,
    /// Lights that are environment maps.
    pub(super) environment_maps: Vec<usize>,
}

/// Compiles the lights of a scene: emissive objects first, then its light sources.
pub(super) fn compile(
    scene: &Scene,
    matrices: &[&PhotonEem],
    emissive: Vec<EmissiveSurface>,
    excitation_edges_nm: &[f64],
) -> Lights {
    let mut list = SourceList::new(scene, matrices, excitation_edges_nm);
    let mut lights = Vec::new();
    let mut environment = Vec::new();
    let mut environment_maps = Vec::new();
    let mut object_light = vec![None; scene.objects.len()];

    // Objects that emit
    for EmissiveSurface { object, emitter, area_m2 } in emissive {
        if let Some(emission) = &scene.objects[object].emission {
            let source = list.source_of(emission.group, &emission.radiance);
            object_light[object] = Some(lights.len());
            let power = emission.radiance.total() as f32 * area_m2 * std::f32::consts::PI;
            lights.push(compiled_light(emission.group, &[source], emitter, power));
        }
    }
    let first_light_source = lights.len();

    // Light sources
    for light in &scene.lights {
        let sources: Vec<usize> =
            light.spectra().iter().map(|spectrum| list.source_of(light.group, spectrum)).collect();
        let Some(emitter) = light.emitter.prepare() else {
            environment.extend(sources.into_iter().flat_map(|source| source..source + list.slices));
            continue;
        };
        if emitter.environment_map().is_some() {
            environment_maps.push(lights.len());
        }
        let power = light.whole_spectrum().total() as f32;
        lights.push(compiled_light(light.group, &sources, emitter, power));
    }

    let group_lights = (0..scene.light_groups.len())
        .map(|group| (0..lights.len()).filter(|&l| lights[l].group == group).collect())
        .collect();
    let SourceList { sources, slices, .. } = list;
    Lights {
        sources,
        slices,
        lights,
        first_light_source,
        group_lights,
        object_light,
        environment,
        environment_maps,
    }
}

/// A light of given sources: one, or one per layer of an environment map.
fn compiled_light(group: usize, sources: &[usize], emitter: PreparedEmitter, power: f32) -> CompiledLight {
    CompiledLight {
        source: sources.first().copied().unwrap_or_default(),
        sources: sources.to_vec(),
        group,
        bounds: emitter.bounds(),
        emitter,
        power: power.max(f32::MIN_POSITIVE),
    }
}

/// Distinct spectra as they are gathered.
struct SourceList<'a> {
    grid: &'a WavelengthGrid,
    matrices: &'a [&'a PhotonEem],
    excitation_edges_nm: &'a [f64],
    slices: usize,
    /// Light group and spectrum of each run of sources.
    known: Vec<(usize, Curve)>,
    sources: Vec<Source>,
}

impl<'a> SourceList<'a> {
    fn new(scene: &'a Scene, matrices: &'a [&'a PhotonEem], excitation_edges_nm: &'a [f64]) -> Self {
        let slices = excitation_edges_nm.len().max(1);
        let grid = &scene.grid;
        Self { grid, matrices, excitation_edges_nm, slices, known: Vec::new(), sources: Vec::new() }
    }

    /// The first source of a spectrum of a light group: one that is known, or a new one.
    fn source_of(&mut self, group: usize, curve: &Curve) -> usize {
        if let Some(found) = self.known.iter().position(|(g, known)| *g == group && known == curve) {
            return found * self.slices;
        }
        self.known.push((group, curve.clone()));
        let grid = self.grid;
        for (slice, curve) in excitation_slices(curve, self.excitation_edges_nm).into_iter().enumerate() {
            let bands = band_blocks(&curve.bin_averages(grid));
            let exitance = self
                .matrices
                .par_iter()
                .map(|eem| band_blocks(&direct_exitance(eem, grid, &curve)))
                .collect();
            self.sources.push(Source { group: group * self.slices + slice, bands, exitance });
        }
        (self.known.len() - 1) * self.slices
    }
}

/// Band values in single precision, in blocks.
fn band_blocks(values: &[f64]) -> Vec<BandBlock> {
    let single: Vec<f32> = values.iter().map(|&value| value as f32).collect();
    to_blocks(&single)
}
