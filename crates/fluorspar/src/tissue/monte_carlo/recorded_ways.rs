//! Ways of photons through layers that scatter, recorded so that absorption can be put in afterwards: one simulation serves all
//! wavelengths and all amounts of blood at which the layers scatter alike (Kienle and Patterson, Phys. Med. Biol. 41, 2221, 1996;
//! Alerstam, Svensson and Andersson-Engels, J. Biomed. Opt. 13, 041304, 2008).

use rayon::prelude::*;

use super::medium::{Layer, Medium};
use super::scattering::uniform;
use super::settings::ScoringGrid;
use super::walk::{End, Photon, Record, walk};
use crate::interruption::end_if_interrupted;
use crate::sampling::random::{Key, KeyedRng};
use crate::tissue::{Incidence, OpticalStack};

/// Parts in which photons are traced side by side.
const CHUNKS: u64 = 64;
/// Depth at which half of the passages are recorded, mm; above it more, below it fewer, each weighing more.
const HALF_DEPTH_MM: f64 = 0.03;

/// Places at which packets were, each with its weight and its way in each layer so far, under the least absorption.
#[derive(Debug, Default)]
pub(in crate::tissue) struct Ways {
    layers: usize,
    /// Distance from the beam, mm.
    pub(in crate::tissue) radius_mm: Vec<f32>,
    /// Depth, mm.
    pub(in crate::tissue) depth_mm: Vec<f32>,
    weight: Vec<f32>,
    /// `[place][layer]`, mm.
    lengths_mm: Vec<f32>,
}

/// Which places [`trace_ways`] records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::tissue) enum Recorded {
    /// Where packets left above.
    Left,
    /// Where they passed inside: weights times mm.
    Passed,
}

impl Ways {
    fn push(&mut self, photon: &Photon, depth_mm: f64, weight: f64, lengths_mm: &[f64]) {
        self.radius_mm.push(photon.radius() as f32);
        self.depth_mm.push(depth_mm as f32);
        self.weight.push(weight as f32);
        self.lengths_mm.extend(lengths_mm.iter().map(|length| *length as f32));
    }

    fn append(&mut self, other: &Self) {
        self.radius_mm.extend_from_slice(&other.radius_mm);
        self.depth_mm.extend_from_slice(&other.depth_mm);
        self.weight.extend_from_slice(&other.weight);
        self.lengths_mm.extend_from_slice(&other.lengths_mm);
    }

    /// Weights where each layer absorbs so much more than when the ways were traced, 1/mm.
    pub(in crate::tissue) fn weights(&self, more_per_mm: &[f32]) -> Vec<f32> {
        let lengths = self.lengths_mm.chunks_exact(self.layers.max(1));
        let weighted = |(weight, lengths): (&f32, &[f32])| {
            let depth: f32 = lengths.iter().zip(more_per_mm).map(|(length, more)| length * more).sum();
            weight * (-depth).exp()
        };
        self.weight.iter().zip(lengths).map(weighted).collect()
    }
}

/// Transport mean free paths after which a packet has forgotten its direction: the others are scattered evenly and so much less often.
const REMEMBERED: f64 = 3.0;

/// Records ways while a packet walks.
struct WayRecord<'a> {
    lengths_mm: Vec<f64>,
    /// Transport mean free paths that it has left before it forgets its direction.
    remembered: f64,
    passed: Option<&'a mut Ways>,
    rng: KeyedRng,
}

impl Record for WayRecord<'_> {
    #[inline(always)]
    fn collision(&mut self, layer: &Layer, _: &Photon, _: &mut KeyedRng) {
        self.remembered -= 1.0 - layer.phase.anisotropy();
    }

    #[inline(always)]
    fn track(&mut self, _: &Layer, _: &Photon, _: f64, _: f64) {}

    #[inline(always)]
    fn pauses(&self) -> bool {
        self.remembered <= 0.0
    }

    #[inline(always)]
    fn way(&mut self, photon: &Photon, length: f64) {
        if let Some(passed) = &mut self.passed {
            // Fluence by tracks: any place on the way, by chance fewer in the depth
            let share = uniform(&mut self.rng);
            let place = |axis: usize| photon.position[axis] + photon.direction[axis] * share * length;
            let probability = HALF_DEPTH_MM / (HALF_DEPTH_MM + place(2).max(0.0));
            if uniform(&mut self.rng) < probability {
                let at = Photon { position: [place(0), place(1), place(2)], ..*photon };
                self.lengths_mm[photon.layer] += share * length;
                passed.push(&at, place(2), photon.weight * length / probability, &self.lengths_mm);
                self.lengths_mm[photon.layer] -= share * length;
            }
        }
        self.lengths_mm[photon.layer] += length;
    }
}

/// Layers of the same reduced scattering without a preferred direction (similarity: van de Hulst, Multiple Light Scattering, 1980).
fn evenly_scattering(stack: &OpticalStack) -> OpticalStack {
    let mut even = stack.clone();
    for layer in &mut even.layers {
        layer.scattering_per_mm *= 1.0 - layer.anisotropy;
        layer.anisotropy = 0.0;
    }
    even
}

/// Traces photons that fall upon the layers at one point. The same number gives the same ways, whatever the number of threads.
pub(in crate::tissue) fn trace_ways(
    stack: &OpticalStack,
    incidence: Incidence,
    photons: u64,
    recorded: Recorded,
) -> Ways {
    let medium = Medium::new(stack, &ScoringGrid::default());
    let even = Medium::new(&evenly_scattering(stack), &ScoringGrid::default());
    let layers = stack.layers.len();
    let of_chunk = |chunk: u64| {
        end_if_interrupted();
        let mut ways = Ways { layers, ..Ways::default() };
        for number in (chunk..photons).step_by(CHUNKS as usize) {
            let key = Key::new(number);
            let rng = &mut key.rng();
            let passed = (recorded == Recorded::Passed).then_some(&mut ways);
            let mut record = WayRecord {
                lengths_mm: vec![0.0; layers],
                remembered: REMEMBERED,
                passed,
                rng: key.with(1).rng(),
            };
            let (_, photon) = Photon::incident(incidence, &medium, rng);
            let mut end = walk(&medium, photon, &mut record, rng);
            if let (End::Paused, photon) = end {
                record.remembered = f64::INFINITY;
                end = walk(&even, photon, &mut record, rng);
            }
            let lengths_mm = record.lengths_mm;
            if let (Recorded::Left, (End::Above, photon)) = (recorded, end) {
                ways.push(&photon, 0.0, photon.weight, &lengths_mm);
            }
        }
        ways
    };
    let chunks: Vec<Ways> = (0..CHUNKS).into_par_iter().map(of_chunk).collect();
    let mut all = Ways { layers, ..Ways::default() };
    chunks.iter().for_each(|chunk| all.append(chunk));
    all
}
