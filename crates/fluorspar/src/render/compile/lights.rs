//! Lights ready for sampling, and the distinct spectra that they emit.

use fluorspar_accel::bands::{BandBlock, to_blocks};
use rayon::prelude::*;

use super::geometry::EmissiveSurface;
use crate::interruption::end_if_interrupted;
use crate::light::PreparedEmitter;
use crate::render::RenderSettings;
use crate::render::compiled_scene::{CompiledLight, Source};
use crate::render::fluorescence_operator::DirectLight;
use crate::render::light_targets::LightTargets;
use crate::scene::Scene;
use crate::spectral::{Curve, PhotonEem};

/// All lights of a scene.
pub(super) struct Lights {
    /// Distinct spectra of the groups.
    pub(super) sources: Vec<Source>,
    /// Sources of groups with excitation nodes: group, source, factor on the hats.
    pub(super) hats: Vec<(usize, usize, f32)>,
    /// Emissive objects, then light sources.
    pub(super) lights: Vec<CompiledLight>,
    /// The light sources as rays meet them.
    pub(super) light_targets: LightTargets,
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
    settings: &RenderSettings,
) -> Lights {
    let mut list =
        SourceList { scene, matrices, settings, known: Vec::new(), sources: Vec::new(), hats: Vec::new() };
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
            environment.extend(sources);
            continue;
        };
        if emitter.environment_map().is_some() {
            environment_maps.push(lights.len());
        }
        let power = light.whole_spectrum().total() as f32;
        let crossed_polarizers = light.crossed_polarizers;
        lights.push(CompiledLight {
            crossed_polarizers,
            ..compiled_light(light.group, &sources, emitter, power)
        });
    }

    let sources = lights.iter().enumerate().skip(first_light_source);
    let light_targets = LightTargets::new(sources.map(|(number, light)| (number, &light.emitter)));
    let group_lights = (0..scene.light_groups.len())
        .map(|group| (0..lights.len()).filter(|&l| lights[l].group == group).collect())
        .collect();
    Lights {
        sources: list.sources,
        hats: list.hats,
        lights,
        light_targets,
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
        crossed_polarizers: false,
        bounds: emitter.bounds(),
        emitter,
        power: power.max(f32::MIN_POSITIVE),
    }
}

/// Distinct spectra as they are gathered.
struct SourceList<'a> {
    scene: &'a Scene,
    matrices: &'a [&'a PhotonEem],
    settings: &'a RenderSettings,
    /// Light group and spectrum of each source.
    known: Vec<(usize, Curve)>,
    sources: Vec<Source>,
    hats: Vec<(usize, usize, f32)>,
}

impl SourceList<'_> {
    /// The source of a spectrum of a light group: one that is known, or a new one.
    fn source_of(&mut self, group: usize, curve: &Curve) -> usize {
        if let Some(known) = self.known.iter().position(|(g, known)| *g == group && known == curve) {
            return known;
        }
        let number = self.sources.len();
        self.known.push((group, curve.clone()));
        if self.settings.nodes_of(group).is_some() {
            // Hats are for the first light of a group
            let total = self.scene.group_spectra(group).first().map_or(0.0, |spectrum| spectrum.total());
            let factor = if total > 0.0 { curve.total() / total } else { 0.0 };
            self.hats.push((group, number, factor as f32));
        }
        let grid = &self.scene.grid;
        let light = DirectLight::new(grid, curve);
        let exitance = |eem: &&PhotonEem| {
            end_if_interrupted();
            band_blocks(&light.exitance(eem))
        };
        self.sources.push(Source {
            group: self.settings.spectrum_number(group),
            bands: band_blocks(&curve.bin_averages(grid)),
            exitance: self.matrices.par_iter().map(exitance).collect(),
        });
        number
    }
}

/// Band values in single precision, in blocks.
pub(super) fn band_blocks(values: &[f64]) -> Vec<BandBlock> {
    let single: Vec<f32> = values.iter().map(|&value| value as f32).collect();
    to_blocks(&single)
}
