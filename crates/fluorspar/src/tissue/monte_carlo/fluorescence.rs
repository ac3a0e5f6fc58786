//! Fluorescence of a stack: forward, and by reciprocity.

use std::ops::Range;

use serde::Serialize;

use super::engine::trace_photons;
use super::estimate::{Estimate, GroupSums};
use super::medium::{Layer, Medium};
use super::scattering::uniform;
use super::settings::{MonteCarloControl, MonteCarloSettings, ScoredQuantity};
use super::simulation::{MonteCarloResult, Problem, Ring, ScoreLayout, Slice, rings};
use super::walk::{DepthRecord, End, Photon, Record, Unrecorded, walk};
use crate::sampling::random::KeyedRng;
use crate::tissue::tissue_error::check;
use crate::tissue::{Incidence, OpticalStack, TissueError};

/// Result of [`simulate_fluorescence`], in emitted photons per incident one (for energy multiply by the ratio of the
/// wavelengths, excitation over emission).
#[derive(Clone, Debug, Serialize)]
pub struct FluorescenceResult {
    /// What the excitation does: the same photons.
    pub excitation: MonteCarloResult,
    /// Emission that leaves upward.
    pub upward: Estimate,
    /// Emission that leaves downward.
    pub downward: Estimate,
    /// Emission that leaves upward, by the layer that emitted it.
    pub upward_by_layer: Vec<Estimate>,
    /// Rings of emission that leaves upward, around the beam of excitation.
    pub rings: Vec<Ring>,
}

/// Fluorescence found from two fluences.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReciprocalFluorescence {
    /// Emission that leaves upward, in photons per incident photon.
    pub upward: Estimate,
    /// The same by the layer that emitted it.
    pub upward_by_layer: Vec<Estimate>,
}

/// Chooses one of the collisions of a packet as the place of emission.
///
/// Each collision emits `weight * share`; it is taken with the probability of its part of the emission so far (weighted
/// reservoir sampling of one item), and the packet of emission carries the emission of all.
struct EmissionSite<'a> {
    depth: DepthRecord<'a>,
    /// Emitted share of the light that collides, by layer.
    shares: &'a [f64],
    emitted: f64,
    position: [f64; 3],
    layer: usize,
}

impl Record for EmissionSite<'_> {
    #[inline(always)]
    fn collision(&mut self, layer: &Layer, photon: &Photon, rng: &mut KeyedRng) {
        self.depth.collision(layer, photon, rng);
        let emission = photon.weight * self.shares[photon.layer];
        if emission > 0.0 {
            self.emitted += emission;
            if uniform(rng) * self.emitted < emission {
                self.position = photon.position;
                self.layer = photon.layer;
            }
        }
    }

    #[inline(always)]
    fn track(&mut self, layer: &Layer, photon: &Photon, depth: f64, length: f64) {
        self.depth.track(layer, photon, depth, length);
    }
}

/// Traces excitation and the fluorescence it causes.
///
/// `strengths_per_mm` holds, for each layer, the absorption coefficient of its fluorophores at the excitation times their
/// quantum yield into the emission wavelength (or band), 1/mm; that absorption is contained in the absorption of
/// `excitation`. Each incident packet sends out one packet of emission, from one of its collisions, evenly in all
/// directions, which moves through `emission`: the same layers with their optics at the emission wavelength.
///
/// # Errors
/// As [`super::simulate`]; layers that differ in number or thickness; strengths that are negative or exceed the absorption.
pub fn simulate_fluorescence(
    excitation: &OpticalStack,
    emission: &OpticalStack,
    strengths_per_mm: &[f64],
    incidence: Incidence,
    settings: &MonteCarloSettings,
    control: &MonteCarloControl<'_>,
) -> Result<FluorescenceResult, TissueError> {
    settings.validate(excitation.layers.len(), true)?;
    let problem = Problem::new(excitation, incidence, settings)?;
    emission.validate()?;
    check_layers(excitation, emission, strengths_per_mm)?;
    let Problem { medium, layout, .. } = &problem;
    let emission_medium = Medium::new(emission, &settings.grid);
    let scores = EmissionScores::after(layout, excitation.layers.len(), settings.grid.radial_bins);
    let shares: Vec<f64> =
        strengths_per_mm.iter().zip(&medium.layers).map(|(s, layer)| s * layer.mean_free_path).collect();
    let upward = |groups: &GroupSums| groups.estimate(|sums| sums[scores.upward.clone()].iter().sum());
    let watched = |groups: &GroupSums| match settings.target.map(|target| target.quantity) {
        Some(ScoredQuantity::Fluorescence) => upward(groups),
        _ => problem.watched(groups),
    };
    let (groups, ending) = trace_photons(settings, scores.rings.end, control, watched, |sums, rng| {
        let (specular, photon) = Photon::incident(incidence, medium, rng);
        ScoreLayout::score_surface(sums, specular);
        let depth = DepthRecord { bins: &mut sums[layout.depths()] };
        let mut site = EmissionSite { depth, shares: &shares, emitted: 0.0, position: [0.0; 3], layer: 0 };
        let (end, photon) = walk(medium, photon, &mut site, rng);
        let EmissionSite { emitted, position, layer, .. } = site;
        layout.score_end(sums, end, &photon);
        let photon = Photon::emitted(position, layer, emitted, rng);
        let (end, photon) = walk(&emission_medium, photon, &mut Unrecorded, rng);
        scores.add(sums, end, &photon, layer, layout.ring(&photon));
    })?;
    Ok(FluorescenceResult {
        upward: upward(&groups),
        downward: groups.estimate(|sums| sums[scores.downward]),
        upward_by_layer: scores.upward.clone().map(|score| groups.estimate(|sums| sums[score])).collect(),
        rings: rings(scores.rings.clone(), &settings.grid, &groups),
        excitation: problem.result(&groups, ending),
    })
}

/// Places of the scores of emission, after those of the excitation.
struct EmissionScores {
    downward: usize,
    /// One for each layer that emits.
    upward: Range<usize>,
    /// Upward, by the ring it leaves through.
    rings: Range<usize>,
}

impl EmissionScores {
    fn after(layout: &ScoreLayout, layers: usize, rings: usize) -> Self {
        let downward = layout.len();
        let upward = downward + 1..downward + 1 + layers;
        Self { downward, rings: upward.end..upward.end + rings, upward }
    }

    fn add(&self, sums: &mut [f64], end: End, photon: &Photon, layer: usize, ring: Option<usize>) {
        match end {
            End::Above => {
                sums[self.upward.start + layer] += photon.weight;
                if let Some(ring) = ring {
                    sums[self.rings.start + ring] += photon.weight;
                }
            }
            End::Below => sums[self.downward] += photon.weight,
            End::Inside | End::Guided | End::Paused => {}
        }
    }
}

/// Fluorescence from the fluence of the excitation and that of even diffuse light at the emission wavelength.
///
/// Light that an isotropic source at depth `z` sends out of the surface is `phi_m(z) / (4 n^2)`, by reciprocity, with
/// `phi_m` the fluence under Lambertian light of irradiance 1 and `n` the index of the layer over that of the medium above.
/// So `F = sum over layers of s / (4 n^2) integral phi_x(z) phi_m(z) dz`: one simulation for each wavelength gives the
/// fluorescence of every pair. `strengths_per_mm` is that of [`simulate_fluorescence`]; `excitation` may have any
/// incidence, `emission` must be [`Incidence::Lambertian`].
///
/// The integral is a sum over slices, too large by a share near `(k dz)^2 / 12` where both fluences fall like `exp(-k z)`
/// with slices of `dz` (3e-5 at 2/mm and 10 um), and ends at the limit of depth of the grid. The standard error holds
/// those of both fluences to first order.
///
/// # Errors
/// Layers or slices that differ; the same seed twice, which makes the errors of the two fluences dependent; an emission
/// that is not Lambertian; strengths that are negative or exceed the absorption at the excitation.
pub fn fluorescence_by_reciprocity(
    excitation: &MonteCarloResult,
    emission: &MonteCarloResult,
    strengths_per_mm: &[f64],
) -> Result<ReciprocalFluorescence, TissueError> {
    if emission.incidence != Incidence::Lambertian {
        return Err(TissueError::EmissionNotLambertian);
    }
    if excitation.seed == emission.seed {
        return Err(TissueError::SameSeed { seed: emission.seed });
    }
    check_layers(&excitation.stack, &emission.stack, strengths_per_mm)?;
    let places = |result: &MonteCarloResult| -> Vec<_> {
        result.slices.iter().map(|slice| (slice.layer, slice.depths_mm)).collect()
    };
    if places(excitation) != places(emission) {
        return Err(TissueError::SlicesDiffer);
    }
    let escape = |layer: usize| {
        let index = emission.stack.layers[layer].refractive_index / emission.stack.index_above;
        strengths_per_mm[layer] / (4.0 * index * index)
    };
    // Emission of a slice per product of fluences.
    let factors: Vec<f64> = excitation
        .slices
        .iter()
        .map(|slice| escape(slice.layer) * (slice.depths_mm[1] - slice.depths_mm[0]))
        .collect();
    let estimate = |layer: Option<usize>| {
        let is_in = |slice: &Slice| layer.is_none_or(|layer| slice.layer == layer);
        let sum = |fluences: &[f64], others: &[Slice]| -> f64 {
            let terms = others.iter().zip(&factors).zip(fluences);
            terms
                .filter(|((slice, _), _)| is_in(slice))
                .map(|((slice, f), phi)| f * phi * slice.fluence.mean)
                .sum()
        };
        let of = |one: &MonteCarloResult, other: &MonteCarloResult| {
            Estimate::of(one.fluence_by_group.iter().map(|group| sum(group, &other.slices)))
        };
        let (x, m) = (of(excitation, emission), of(emission, excitation));
        Estimate { mean: x.mean, standard_error: x.standard_error.hypot(m.standard_error) }
    };
    let upward_by_layer = (0..strengths_per_mm.len()).map(|layer| estimate(Some(layer))).collect();
    Ok(ReciprocalFluorescence { upward: estimate(None), upward_by_layer })
}

/// The layers of excitation and emission are the same ones, and hold the fluorophores.
fn check_layers(
    excitation: &OpticalStack,
    emission: &OpticalStack,
    strengths_per_mm: &[f64],
) -> Result<(), TissueError> {
    let thicknesses =
        |stack: &OpticalStack| -> Vec<f64> { stack.layers.iter().map(|layer| layer.thickness_mm).collect() };
    if thicknesses(excitation) != thicknesses(emission) {
        return Err(TissueError::LayersDiffer);
    }
    if strengths_per_mm.len() != excitation.layers.len() {
        return Err(TissueError::StrengthsDiffer {
            strengths: strengths_per_mm.len(),
            layers: excitation.layers.len(),
        });
    }
    for (number, (&strength, layer)) in strengths_per_mm.iter().zip(&excitation.layers).enumerate() {
        let hint = "it is a part of the layer's absorption_per_mm at the excitation, times a quantum yield of at most 1";
        let range = [0.0, layer.absorption_per_mm];
        check(&format!("layer {}", number + 1), "fluorophore strength_per_mm", strength, range, hint)?;
    }
    Ok(())
}
