//! Light of every excitation node along a path, at a fraction of the cost of as many lights.
//!
//! All nodes of a light group share the paths and the factors of its light; only the light spectrum differs. So light that did not
//! fluoresce is carried as even light, one spectrum for all nodes, and cut into the hats of the nodes where it excites or arrives.
//! Fluorescence is carried forward instead of back: with the throughput from the vertex to the camera known, what a vertex emits
//! under each node is added to the image at once, in place of being multiplied at every vertex on its way. What fluoresces
//! again must be carried back, all nodes at each vertex; there the spectra of all nodes are sums of few ([`FewSpectra`]), and only those
//! excite.

use std::f32::consts::FRAC_1_PI;
use std::ops::Range;

use fluorspar_accel::Lanes;
use fluorspar_accel::bands::{self, BandBlock};

use super::compiled_scene::{BasisGroup, CompiledScene};
use super::path::{Path, Vertex};
use super::spread_spectra::SpreadSpectra;

/// Error of light that fluoresces again, relative to all light that fluoresced there under the same node.
const MULTIPLE_ERROR: f32 = 2e-3;
/// Share of the brightest node below which nodes are not looked at more closely.
const DIM_NODE: f32 = 1e-3;
/// Most spectra of which those of all nodes are sums.
const MOST_SPECTRA: usize = 16;

/// What is carried along a path.
#[derive(Debug, Default)]
pub(super) struct BasisState {
    /// Reflectance of every vertex, `[vertex][block]`.
    reflectance: Vec<BandBlock>,
    /// Throughput from every vertex to the camera.
    to_camera: Vec<BandBlock>,
    /// Even light that arrives at every vertex along the continued path.
    arriving: Vec<BandBlock>,
    /// Even light at the vertex.
    even: Vec<BandBlock>,
    /// Light that fluoresced and arrives at the vertex, `[node][block]`.
    fluoresced: Vec<BandBlock>,
    few: FewSpectra,
    /// What few spectra excite.
    excited: Vec<BandBlock>,
    throughput: Vec<BandBlock>,
    /// Matrices of one fluorophore at a vertex, each with its concentration.
    states: Vec<(usize, f32)>,
}

/// A vertex of a path under the nodes of a group.
struct PathVertex<'a> {
    scene: &'a CompiledScene,
    path: &'a Path,
    group: &'a BasisGroup,
    number: usize,
    /// Whether what fluoresces here could fluoresce again nearer to the camera.
    is_carried: bool,
}

/// Components of a path, to add to.
pub(super) struct Components<'a> {
    /// `[component][block]`.
    pub(super) values: &'a mut [BandBlock],
    /// Components that hold anything; the values of the others are left from earlier paths.
    pub(super) lit: &'a mut [bool],
    /// Components of one light spectrum.
    pub(super) kinds: usize,
    /// Blocks of a component.
    pub(super) blocks: usize,
}

impl Components<'_> {
    #[inline(always)]
    fn light_up<L: Lanes>(&mut self, lanes: L, component: usize) -> &mut [BandBlock] {
        let values = &mut self.values[component * self.blocks..(component + 1) * self.blocks];
        if !self.lit[component] {
            self.lit[component] = true;
            bands::clear(lanes, values);
        }
        values
    }
}

/// A range of blocks of one of many vectors.
fn nth(number: usize, blocks: usize) -> Range<usize> {
    number * blocks..(number + 1) * blocks
}

impl BasisState {
    /// Adds what reaches the camera along a path under every node of a group.
    #[inline(always)]
    pub(super) fn gather<L: Lanes>(
        &mut self,
        lanes: L,
        scene: &CompiledScene,
        (path, spread): (&Path, Option<&SpreadSpectra>),
        group: &BasisGroup,
        components: &mut Components<'_>,
    ) {
        let blocks = components.blocks;
        let vertices = path.vertices();
        self.prepare(lanes, scene, path, blocks);
        let lit_by = |emission: &[(u32, f32)]| -> f32 {
            let of = |(source, factor): &(u32, f32)| factor * factor_of(group, *source as usize);
            emission.iter().map(of).sum()
        };

        // Even light from the far end to the camera
        let mut even = std::mem::take(&mut self.even);
        even.clear();
        even.resize(blocks, BandBlock::ZERO);
        for (number, vertex) in vertices.iter().enumerate().rev() {
            add_even(lanes, lit_by(path.emission(vertex)), scene.bands, &mut even);
            self.arriving[nth(number, blocks)].copy_from_slice(&even);
            let reflectance = &self.reflectance[nth(number, blocks)];
            bands::reflection_factor(lanes, vertex.diffuse, reflectance, vertex.gloss, &mut self.throughput);
            bands::multiply(lanes, &self.throughput, &mut even);
            let [diffuse, gloss, _] = direct_light(scene, path, group, number);
            bands::reflection_factor(lanes, diffuse * FRAC_1_PI, reflectance, gloss, &mut self.throughput);
            bands::add_scaled(lanes, 1.0, &self.throughput, &mut even);
        }
        if let Some(spread) = spread {
            let [diffuse, _] = entered_more(path, group);
            bands::add_scaled(lanes, diffuse * FRAC_1_PI, &spread.reflected, &mut even);
        }
        add_even(lanes, lit_by(&path.seen), scene.bands, &mut even);
        reflect(lanes, group, &even, components);
        self.even = even;

        // Fluorescence, from the far end as well: what fluoresced must be there where it fluoresces again
        let fluorescent = |vertex: &Vertex| vertex.fluorescent > 0.0;
        let nearest = vertices.iter().position(fluorescent);
        self.fluoresced.clear();
        self.fluoresced.resize(group.nodes.len() * blocks, BandBlock::ZERO);
        let mut any_fluoresced = false;
        for number in (0..vertices.len()).rev() {
            let is_carried = nearest.is_some_and(|nearest| nearest < number);
            let at = PathVertex { scene, path, group, number, is_carried };
            if any_fluoresced {
                self.fluoresce_again(lanes, &at, components);
            }
            any_fluoresced |= self.fluoresce(lanes, &at, components);
        }
        if let Some(spread) = spread {
            self.fluoresce_aside(lanes, (path, spread), group, components);
        }
    }

    /// Adds how much more the first vertex emits since direct light entered elsewhere.
    #[inline(always)]
    fn fluoresce_aside<L: Lanes>(
        &mut self,
        lanes: L,
        (path, spread): (&Path, &SpreadSpectra),
        group: &BasisGroup,
        components: &mut Components<'_>,
    ) {
        let (blocks, kinds) = (components.blocks, components.kinds);
        let Some(vertex) = path.vertices().first() else { return };
        let [_, more] = entered_more(path, group);
        let of_one = path.emitters(vertex).chunk_by(|(a, _), (b, _)| a.fluorophore == b.fluorophore);
        for emitters in of_one.filter(|_| more != 0.0) {
            let fluorophore = emitters[0].0.fluorophore;
            for (number, node) in group.nodes.iter().enumerate() {
                let emitted = &mut self.throughput;
                bands::clear(lanes, emitted);
                for (emitter, amount) in emitters {
                    for column in node.columns[emitter.matrix].chunks_exact(blocks).take(node.bands.len()) {
                        bands::add_scaled(lanes, more * FRAC_1_PI * amount, column, emitted);
                    }
                }
                let component = (group.first + number) * kinds + 1 + fluorophore;
                let light = components.light_up(lanes, component);
                bands::add_product_of(lanes, spread.emitted(fluorophore), emitted, light);
            }
        }
    }

    /// Reflectance and throughput to the camera of every vertex.
    #[inline(always)]
    fn prepare<L: Lanes>(&mut self, lanes: L, scene: &CompiledScene, path: &Path, blocks: usize) {
        let vertices = path.vertices();
        let len = vertices.len() * blocks;
        for buffer in [&mut self.reflectance, &mut self.to_camera, &mut self.arriving] {
            buffer.clear();
            buffer.resize(len, BandBlock::ZERO);
        }
        self.throughput.resize(blocks, BandBlock::ZERO);
        self.excited.resize(MOST_SPECTRA * blocks, BandBlock::ZERO);
        for (number, vertex) in vertices.iter().enumerate() {
            let material = &scene.material_spectra[vertex.material as usize];
            let reflectance = &mut self.reflectance[nth(number, blocks)];
            for (spectrum, weight) in material.terms.iter().zip(path.weights(vertex)) {
                if *weight != 0.0 {
                    bands::add_scaled(lanes, *weight, spectrum, reflectance);
                }
            }
            if number == 0 {
                self.to_camera[..blocks].fill(ones());
                continue;
            }
            let before = &vertices[number - 1];
            let (near, here) = self.to_camera.split_at_mut(number * blocks);
            let here = &mut here[..blocks];
            let reflectance = &self.reflectance[nth(number - 1, blocks)];
            bands::reflection_factor(lanes, before.diffuse, reflectance, before.gloss, here);
            bands::multiply(lanes, &near[(number - 1) * blocks..], here);
        }
    }

    /// Adds what a vertex emits at first under every node to the image, and to what fluoresced if that is carried on. Returns whether
    /// it emits anything.
    #[inline(always)]
    fn fluoresce<L: Lanes>(
        &mut self,
        lanes: L,
        at: &PathVertex<'_>,
        components: &mut Components<'_>,
    ) -> bool {
        let &PathVertex { scene, path, group, number, is_carried } = at;
        let (blocks, kinds) = (components.blocks, components.kinds);
        let vertex = &path.vertices()[number];
        let [_, _, direct] = direct_light(scene, path, group, number);
        let direct = direct * FRAC_1_PI;
        let arriving = &self.arriving[nth(number, blocks)];
        let to_camera = &self.to_camera[nth(number, blocks)];
        let is_lit = vertex.fluorescent > 0.0 && arriving.iter().any(|block| *block != BandBlock::ZERO);
        if direct <= 0.0 && !is_lit {
            return false;
        }
        let light_in =
            |band: usize| direct + vertex.fluorescent * arriving[band / bands::BLOCK].0[band % bands::BLOCK];
        let mut emits = false;
        for fluorophore in 0..kinds - 2 {
            // All states of a tissue emit together
            let states =
                path.emitters(vertex).iter().filter(|(emitter, _)| emitter.fluorophore == fluorophore);
            self.states.clear();
            self.states.extend(states.map(|(emitter, concentration)| (emitter.matrix, *concentration)));
            if self.states.is_empty() {
                continue;
            }
            emits = true;
            for (number_of_node, node) in group.nodes.iter().enumerate() {
                let component = (group.first + number_of_node) * kinds + 1 + fluorophore;
                let emitted = &mut self.throughput;
                bands::clear(lanes, emitted);
                for (matrix, concentration) in &self.states {
                    let columns = node.columns[*matrix].chunks_exact(blocks);
                    for (band, column) in node.bands.clone().zip(columns) {
                        bands::add_scaled(lanes, concentration * light_in(band), column, emitted);
                    }
                }
                bands::add_product_of(lanes, to_camera, emitted, components.light_up(lanes, component));
                if is_carried {
                    let fluoresced = &mut self.fluoresced[nth(number_of_node, blocks)];
                    bands::add_scaled(lanes, 1.0, emitted, fluoresced);
                }
            }
        }
        emits
    }

    /// Adds what fluoresces again at a vertex to the image, and leaves in `fluoresced` what leaves the vertex of it.
    #[inline(always)]
    fn fluoresce_again<L: Lanes>(&mut self, lanes: L, at: &PathVertex<'_>, components: &mut Components<'_>) {
        let &PathVertex { scene, path, group, number, is_carried } = at;
        let (blocks, kinds) = (components.blocks, components.kinds);
        let vertex = &path.vertices()[number];
        let emitters = path.emitters(vertex);
        let fluoresces = vertex.fluorescent > 0.0 && !emitters.is_empty();
        if fluoresces {
            self.few.take_apart(lanes, &self.fluoresced, blocks);
            for spectrum in 0..self.few.rank {
                let excited = &mut self.excited[nth(spectrum, blocks)];
                bands::clear(lanes, excited);
                for (emitter, concentration) in emitters {
                    let operator = &scene.plain_operators[emitter.matrix];
                    let arriving = &self.few.spectra[nth(spectrum, blocks)];
                    operator.add_product(lanes, vertex.fluorescent * concentration, arriving, excited);
                }
            }
        }
        // Scatter what fluoresced, as far as any vertex is left that it could excite
        if is_carried {
            let reflectance = &self.reflectance[nth(number, blocks)];
            bands::reflection_factor(lanes, vertex.diffuse, reflectance, vertex.gloss, &mut self.throughput);
            for fluoresced in self.fluoresced.chunks_exact_mut(blocks) {
                bands::multiply(lanes, &self.throughput, fluoresced);
            }
        }
        if !fluoresces {
            return;
        }
        let to_camera = &self.to_camera[nth(number, blocks)];
        for node in 0..group.nodes.len() {
            let emitted = &mut self.throughput;
            bands::clear(lanes, emitted);
            for spectrum in 0..self.few.rank {
                let factor = self.few.factors[spectrum * group.nodes.len() + node];
                bands::add_scaled(lanes, factor, &self.excited[nth(spectrum, blocks)], emitted);
            }
            let component = (group.first + node + 1) * kinds - 1;
            bands::add_product_of(lanes, to_camera, emitted, components.light_up(lanes, component));
            if is_carried {
                bands::add_scaled(lanes, 1.0, emitted, &mut self.fluoresced[nth(node, blocks)]);
            }
        }
    }
}

/// Sixteen ones.
fn ones() -> BandBlock {
    BandBlock([1.0; bands::BLOCK])
}

/// Adds even light; padding stays zero.
#[inline(always)]
fn add_even<L: Lanes>(lanes: L, light: f32, count: usize, even: &mut [BandBlock]) {
    if light == 0.0 {
        return;
    }
    for (number, block) in even.iter_mut().enumerate() {
        let here = count.saturating_sub(number * bands::BLOCK).min(bands::BLOCK);
        let mut light_here = BandBlock::ZERO;
        light_here.0[..here].fill(light);
        let sum = lanes.add(lanes.load(block), lanes.load(&light_here));
        lanes.store(sum, block);
    }
}

/// Factor of the hats of a source, 0 for sources of other groups.
fn factor_of(group: &BasisGroup, source: usize) -> f32 {
    let known = group.sources.iter().find(|(own, _)| *own == source);
    known.map_or(0.0, |(_, factor)| *factor)
}

/// Direct light of the hats at a vertex: diffuse, gloss, fluorescent.
#[inline(always)]
fn direct_light(scene: &CompiledScene, path: &Path, group: &BasisGroup, vertex: usize) -> [f32; 3] {
    let direct = path.direct(vertex, scene.sources.len());
    let mut sum = [0.0; 3];
    for (source, factor) in &group.sources {
        let of = &direct[*source];
        for (sum, value) in sum.iter_mut().zip([of.diffuse, of.gloss, of.fluorescent]) {
            *sum += factor * value;
        }
    }
    sum
}

/// How much more direct light of the hats there is where light entered than at the first vertex: diffuse, fluorescent.
fn entered_more(path: &Path, group: &BasisGroup) -> [f32; 2] {
    group.sources.iter().fold([0.0; 2], |[diffuse, fluorescent], (source, factor)| {
        let [more_diffuse, more_fluorescent] = path.entered_more(*source);
        [diffuse + factor * more_diffuse, fluorescent + factor * more_fluorescent]
    })
}

/// Cuts even light that reaches the camera into the hats.
#[inline(always)]
fn reflect<L: Lanes>(lanes: L, group: &BasisGroup, even: &[BandBlock], components: &mut Components<'_>) {
    for (number, node) in group.nodes.iter().enumerate() {
        let light = |band: usize| even[band / bands::BLOCK].0[band % bands::BLOCK];
        if node.reflected_bands.clone().all(|band| light(band) == 0.0) {
            continue;
        }
        let component = (group.first + number) * components.kinds;
        let reflected = components.light_up(lanes, component);
        for (band, hat) in node.reflected_bands.clone().zip(&node.reflected) {
            reflected[band / bands::BLOCK].0[band % bands::BLOCK] += hat * light(band);
        }
    }
}

/// Spectra of many nodes as sums of few, to a stated error: those of the nodes that are farthest from all sums so far, made
/// orthonormal one after the other (Gram-Schmidt with pivots).
#[derive(Debug, Default)]
struct FewSpectra {
    rank: usize,
    /// `[spectrum][block]`.
    spectra: Vec<BandBlock>,
    /// `[spectrum][node]`.
    factors: Vec<f32>,
    rest: Vec<BandBlock>,
    /// Squared length of each node, and of what is left of it.
    lengths: Vec<f32>,
    left: Vec<f32>,
}

impl FewSpectra {
    #[inline(always)]
    fn take_apart<L: Lanes>(&mut self, lanes: L, vectors: &[BandBlock], blocks: usize) {
        let nodes = vectors.len() / blocks;
        self.rank = 0;
        self.spectra.resize(MOST_SPECTRA * blocks, BandBlock::ZERO);
        self.factors.resize(MOST_SPECTRA * nodes, 0.0);
        self.rest.clear();
        self.rest.extend_from_slice(vectors);
        self.lengths.clear();
        self.lengths.extend(vectors.chunks_exact(blocks).map(|vector| bands::dot(lanes, vector, vector)));
        self.left.clone_from(&self.lengths);
        let brightest = self.lengths.iter().copied().fold(0.0, f32::max);
        let floor = DIM_NODE * DIM_NODE * brightest;
        while self.rank < MOST_SPECTRA {
            // The node that is farthest from all sums
            let mut worst = (0, 0.0);
            for (node, (left, length)) in self.left.iter().zip(&self.lengths).enumerate() {
                let error = left / length.max(floor);
                if error > worst.1 {
                    worst = (node, error);
                }
            }
            let length = self.left[worst.0].sqrt();
            if worst.1 <= MULTIPLE_ERROR * MULTIPLE_ERROR || length <= f32::MIN_POSITIVE {
                return;
            }
            let spectrum = &mut self.spectra[nth(self.rank, blocks)];
            bands::clear(lanes, spectrum);
            bands::add_scaled(lanes, length.recip(), &self.rest[nth(worst.0, blocks)], spectrum);
            for node in 0..nodes {
                let rest = &mut self.rest[nth(node, blocks)];
                let factor = bands::dot(lanes, rest, spectrum);
                self.factors[self.rank * nodes + node] = factor;
                bands::add_scaled(lanes, -factor, spectrum, rest);
                self.left[node] = bands::dot(lanes, rest, rest);
            }
            // Rounding leaves what was taken itself
            self.left[worst.0] = 0.0;
            self.rank += 1;
        }
    }
}
