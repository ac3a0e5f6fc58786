//! Runs spectra from the far end of a path to the camera: at each vertex
//! `arriving -> R * arriving + F * arriving + direct light`, on whole band vectors, every component at once.

use std::f32::consts::FRAC_1_PI;

use fluorspar_accel::bands::{self, BLOCK, BandBlock};
use fluorspar_accel::{Lanes, Work};

use super::basis_accumulation::{BasisState, Components};
use super::compiled_scene::{CompiledScene, Emitter};
use super::excitation::Choices;
use super::path::{Path, Vertex};
use super::spread_spectra::SpreadSpectra;

/// Band vectors of all components while they travel, `[group][kind][band]` with kinds reflected, one per
/// fluorophore, multiple.
#[derive(Debug)]
pub(super) struct SpectralState {
    values: Vec<BandBlock>,
    /// Components that hold anything; the values of the others are left from earlier paths.
    lit: Vec<bool>,
    kinds: usize,
    blocks: usize,
    /// Reflectance of the vertex, what becomes of elastic light there, and all fluorescent light that arrives there.
    reflectance: Vec<BandBlock>,
    throughput: Vec<BandBlock>,
    fluoresced: Vec<BandBlock>,
    /// What the basis of light that arrives leaves out of it.
    rest: Vec<BandBlock>,
    /// What is carried for excitation nodes.
    basis: BasisState,
    /// Of direct light that left translucent tissue elsewhere than it entered.
    spread: SpreadSpectra,
}

impl SpectralState {
    pub(super) fn new(scene: &CompiledScene) -> Self {
        let kinds = scene.fluorophores + 2;
        let blocks = scene.bands.div_ceil(BLOCK);
        let components = scene.spectra * kinds;
        Self {
            values: vec![BandBlock::ZERO; components * blocks],
            lit: vec![false; components],
            kinds,
            blocks,
            reflectance: vec![BandBlock::ZERO; blocks],
            throughput: vec![BandBlock::ZERO; blocks],
            fluoresced: vec![BandBlock::ZERO; blocks],
            rest: vec![BandBlock::ZERO; blocks],
            basis: BasisState::default(),
            spread: SpreadSpectra::default(),
        }
    }

    /// Computes the radiance of every component that reaches the camera along the path.
    pub(super) fn gather(&mut self, scene: &CompiledScene, path: &Path) {
        scene.simd.run(Gather { state: self, scene, path });
    }

    /// Number of components.
    pub(super) fn components(&self) -> usize {
        self.lit.len()
    }

    /// Radiance of a component that is lit.
    pub(super) fn component(&self, component: usize) -> &[BandBlock] {
        &self.values[component * self.blocks..(component + 1) * self.blocks]
    }

    /// Components that hold anything after [`Self::gather`].
    pub(super) fn is_lit(&self, component: usize) -> bool {
        self.lit[component]
    }

    /// The vector of a component, to add to: cleared if it held nothing.
    #[inline(always)]
    fn light_up<L: Lanes>(&mut self, lanes: L, component: usize) -> &mut [BandBlock] {
        let values = &mut self.values[component * self.blocks..(component + 1) * self.blocks];
        if !self.lit[component] {
            self.lit[component] = true;
            bands::clear(lanes, values);
        }
        values
    }

    #[inline(always)]
    fn add_emission<L: Lanes>(&mut self, lanes: L, scene: &CompiledScene, emission: &[(u32, f32)]) {
        for &(source, factor) in emission {
            let source = &scene.sources[source as usize];
            bands::add_scaled(lanes, factor, &source.bands, self.light_up(lanes, source.group * self.kinds));
        }
    }

    /// Turns the radiance that arrives along the continued path into leaving radiance.
    #[inline(always)]
    fn scatter<L: Lanes>(
        &mut self,
        lanes: L,
        scene: &CompiledScene,
        emitters: &[(Emitter, f32)],
        vertex: &Vertex,
        reflectance: &[BandBlock],
        choices: &mut Choices,
    ) {
        let (blocks, kinds) = (self.blocks, self.kinds);
        if vertex.diffuse <= 0.0 && vertex.gloss <= 0.0 && vertex.fluorescent <= 0.0 {
            self.lit.fill(false);
            return;
        }
        let fluoresces = vertex.fluorescent > 0.0 && !emitters.is_empty();
        bands::reflection_factor(lanes, vertex.diffuse, reflectance, vertex.gloss, &mut self.throughput);
        for (group, excitation) in scene.excitation.iter().enumerate() {
            let base = group * kinds;
            if !self.lit[base..base + kinds].contains(&true) {
                continue;
            }
            let any_fluorescent = self.lit[base + 1..base + kinds].contains(&true);
            let mut repeats = None;
            if fluoresces && any_fluorescent {
                repeats = choices.weight(scene.repeat_probability);
                bands::clear(lanes, &mut self.fluoresced);
            }
            // Scatter what fluoresced already, and sum it where it excites again
            for kind in (base + 1..base + kinds).filter(|&kind| self.lit[kind]) {
                let values = &mut self.values[kind * blocks..(kind + 1) * blocks];
                if repeats.is_some() {
                    bands::add_then_multiply(lanes, &self.throughput, values, &mut self.fluoresced);
                } else {
                    bands::multiply(lanes, &self.throughput, values);
                }
            }
            // Excite the fluorophores with light that did not fluoresce yet
            let matrices = emitters.iter().map(|(emitter, _)| emitter.matrix);
            if fluoresces && self.lit[base] && excitation.is_direct(matrices) {
                for (emitter, concentration) in emitters {
                    let component = base + 1 + emitter.fluorophore;
                    self.light_up(lanes, component);
                    let (arriving, emitted) = self.values.split_at_mut(component * blocks);
                    let arriving = &arriving[base * blocks..(base + 1) * blocks];
                    let factor = vertex.fluorescent * concentration;
                    excitation.add_product(lanes, emitter.matrix, factor, arriving, &mut emitted[..blocks]);
                }
            } else if fluoresces && self.lit[base] {
                let mut rest = std::mem::take(&mut self.rest);
                let arriving = &self.values[base * blocks..(base + 1) * blocks];
                let light = excitation.project(lanes, arriving, choices, &mut rest);
                for (emitter, concentration) in emitters {
                    let emitted = self.light_up(lanes, base + 1 + emitter.fluorophore);
                    let factor = vertex.fluorescent * concentration;
                    excitation.add_excited(lanes, emitter.matrix, factor, (&light, &rest), emitted);
                }
                self.rest = rest;
            }
            // Excite them with what fluoresced already
            if let Some(weight) = repeats {
                self.light_up(lanes, base + kinds - 1);
                let values = &mut self.values[(base + kinds - 1) * blocks..(base + kinds) * blocks];
                for (emitter, concentration) in emitters {
                    let factor = weight * vertex.fluorescent * concentration;
                    scene.plain_operators[emitter.matrix].add_product(
                        lanes,
                        factor,
                        &self.fluoresced,
                        values,
                    );
                }
            }
            // Scatter what did not fluoresce
            if self.lit[base] {
                let values = &mut self.values[base * blocks..(base + 1) * blocks];
                bands::multiply(lanes, &self.throughput, values);
            }
        }
    }
}

impl SpectralState {
    /// Adds how much more direct light leaves the first vertex since it entered elsewhere.
    #[inline(always)]
    fn add_spread<L: Lanes>(&mut self, lanes: L, scene: &CompiledScene, path: &Path) {
        let (spread, mut temporary) =
            (std::mem::take(&mut self.spread), std::mem::take(&mut self.throughput));
        for (number, source) in scene.sources.iter().enumerate() {
            let [diffuse, fluorescent] = path.entered_more(number).map(|more| more * FRAC_1_PI);
            let base = source.group * self.kinds;
            if diffuse != 0.0 {
                bands::clear(lanes, &mut temporary);
                bands::add_scaled(lanes, diffuse, &spread.reflected, &mut temporary);
                bands::add_product_of(lanes, &temporary, &source.bands, self.light_up(lanes, base));
            }
            if fluorescent == 0.0 {
                continue;
            }
            let emitters = path.vertices().first().map_or(&[][..], |vertex| path.emitters(vertex));
            for of_one in emitters.chunk_by(|(a, _), (b, _)| a.fluorophore == b.fluorophore) {
                let fluorophore = of_one[0].0.fluorophore;
                bands::clear(lanes, &mut temporary);
                for (emitter, amount) in of_one {
                    let exitance = &source.exitance[emitter.matrix];
                    bands::add_scaled(lanes, fluorescent * amount, exitance, &mut temporary);
                }
                let emitted = self.light_up(lanes, base + 1 + fluorophore);
                bands::add_product_of(lanes, spread.emitted(fluorophore), &temporary, emitted);
            }
        }
        (self.spread, self.throughput) = (spread, temporary);
    }
}

/// One path on one state, compiled for each instruction set.
struct Gather<'a> {
    state: &'a mut SpectralState,
    scene: &'a CompiledScene,
    path: &'a Path,
}

impl Work for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { state, scene, path } = self;
        state.lit.fill(false);
        let mut choices = Choices::new(path.choices);
        // Lent out, so that the state can be changed meanwhile.
        let mut mixed = std::mem::take(&mut state.reflectance);
        for (index, vertex) in path.vertices().iter().enumerate().rev() {
            // Add the emission that the continued path meets
            state.add_emission(lanes, scene, path.emission(vertex));

            // Mix the reflectance of the vertex from its terms
            let material = &scene.material_spectra[vertex.material as usize];
            let weights = &path.weights(vertex)[..material.terms.len()];
            let emitters = path.emitters(vertex);
            let reflectance = match material.terms.as_slice() {
                [first, ..] if weights[0] == 1.0 && weights[1..].iter().all(|&w| w == 0.0) => {
                    first.as_slice()
                }
                terms => {
                    bands::clear(lanes, &mut mixed);
                    for (spectrum, weight) in terms.iter().zip(weights) {
                        if *weight != 0.0 {
                            bands::add_scaled(lanes, *weight, spectrum, &mut mixed);
                        }
                    }
                    mixed.as_slice()
                }
            };

            // Scatter what arrives, then add direct light: reflected, and fluorescent
            if state.lit.contains(&true) {
                state.scatter(lanes, scene, emitters, vertex, reflectance, &mut choices);
            }
            for (source, direct) in scene.sources.iter().zip(path.direct(index, scene.sources.len())) {
                if direct.diffuse <= 0.0 && direct.gloss <= 0.0 && direct.fluorescent <= 0.0 {
                    continue;
                }
                let base = source.group * state.kinds;
                let diffuse = direct.diffuse * FRAC_1_PI;
                bands::add_reflected(
                    lanes,
                    diffuse,
                    reflectance,
                    direct.gloss,
                    &source.bands,
                    state.light_up(lanes, base),
                );
                for (emitter, concentration) in emitters {
                    let factor = direct.fluorescent * FRAC_1_PI * concentration;
                    let emitted = state.light_up(lanes, base + 1 + emitter.fluorophore);
                    bands::add_scaled(lanes, factor, &source.exitance[emitter.matrix], emitted);
                }
            }
        }
        let blocks = state.blocks;
        let is_spread = state.spread.prepare(lanes, scene, path, blocks);
        if is_spread {
            state.add_spread(lanes, scene, path);
        }
        state.add_emission(lanes, scene, &path.seen);
        state.reflectance = mixed;
        for basis in &scene.bases {
            let SpectralState { values, lit, kinds, blocks, basis: carried, spread, .. } = &mut *state;
            let spread = is_spread.then_some(&*spread);
            let mut components = Components { values, lit, kinds: *kinds, blocks: *blocks };
            carried.gather(lanes, scene, (path, spread), basis, &mut components);
        }
    }
}
