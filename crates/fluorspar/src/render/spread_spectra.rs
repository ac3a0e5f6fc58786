//! Spectra of direct light that leaves translucent tissue elsewhere than it entered: `t` of `translucency`, by wavelength.

use fluorspar_accel::Lanes;
use fluorspar_accel::bands::{self, BandBlock};

use super::compiled_scene::{CompiledScene, Emitter, MaterialSpectra};
use super::material_spread::MaterialSpread;
use super::path::{Path, VertexSpread};
use crate::tissue::EMITTED_NM;

/// What becomes of direct light that entered elsewhere, on its way to the first vertex of a path.
#[derive(Debug, Default)]
pub(super) struct SpreadSpectra {
    /// Reflectance times `t`.
    pub(super) reflected: Vec<BandBlock>,
    /// `t` of what a fluorophore emits, `[fluorophore][block]`; of those that the vertex has.
    emitted: Vec<BandBlock>,
}

impl SpreadSpectra {
    /// Forms the spectra of the first vertex of a path. Returns whether light leaves it elsewhere than it entered.
    #[inline(always)]
    pub(super) fn prepare<L: Lanes>(
        &mut self,
        lanes: L,
        scene: &CompiledScene,
        path: &Path,
        blocks: usize,
    ) -> bool {
        let (Some(spread), Some(vertex)) = (path.spread, path.vertices().first()) else { return false };
        let MaterialSpectra { spread: Some(profiles), .. } =
            &scene.material_spectra[vertex.material as usize]
        else {
            return false;
        };
        self.reflected.resize(blocks, BandBlock::ZERO);
        bands::clear(lanes, &mut self.reflected);
        let at = |node: usize| node * blocks..(node + 1) * blocks;
        for (profile, weight) in profiles.reflected.iter().zip(path.weights(vertex)) {
            let factor = weight * spread.inverse_density;
            if factor != 0.0 {
                let (low, high) = (&profile[at(spread.node)], &profile[at(spread.node + 1)]);
                bands::add_scaled(lanes, factor * (1.0 - spread.fraction), low, &mut self.reflected);
                bands::add_scaled(lanes, factor * spread.fraction, high, &mut self.reflected);
            }
        }
        self.emitted.resize(scene.fluorophores * blocks, BandBlock::ZERO);
        for of_one in path.emitters(vertex).chunk_by(|(a, _), (b, _)| a.fluorophore == b.fluorophore) {
            let state = chosen_state(of_one, spread.choice);
            let factors = &mut self.emitted[state.fluorophore * blocks..(state.fluorophore + 1) * blocks];
            set_emitted(lanes, scene, profiles, state, spread, factors);
        }
        true
    }

    /// `t` of what a fluorophore of the vertex emits.
    #[inline(always)]
    pub(super) fn emitted(&self, fluorophore: usize) -> &[BandBlock] {
        let blocks = self.reflected.len();
        &self.emitted[fluorophore * blocks..(fluorophore + 1) * blocks]
    }
}

/// Sets `t` of what a fluorophore emits. Light of one that lies on the surface leaves where it enters: 1 times the light there.
#[inline(always)]
fn set_emitted<L: Lanes>(
    lanes: L,
    scene: &CompiledScene,
    profiles: &MaterialSpread,
    state: Emitter,
    spread: VertexSpread,
    factors: &mut [BandBlock],
) {
    const COUNT: usize = EMITTED_NM.len();
    let (nodes, _) = profiles.emitted[state.number].as_chunks::<COUNT>();
    let (Some(low), Some(high)) = (nodes.get(spread.node), nodes.get(spread.node + 1)) else {
        return factors.fill(BandBlock::ZERO);
    };
    let known: [f32; COUNT] =
        std::array::from_fn(|nm| spread.inverse_density * (low[nm] + spread.fraction * (high[nm] - low[nm])));
    scene.emission_bands.interpolate(lanes, &known, factors);
}

/// The state whose profile the light of a fluorophore follows: one of those of the point, by their shares.
fn chosen_state(states: &[(Emitter, f32)], choice: f32) -> Emitter {
    let mut left = choice * states.iter().map(|(_, concentration)| concentration).sum::<f32>();
    let mut chosen = states[0].0;
    for (emitter, concentration) in states {
        chosen = *emitter;
        if left < *concentration {
            break;
        }
        left -= concentration;
    }
    chosen
}
