//! Reflectance, transmittance, absorption and fluence of a stack.

use std::ops::Range;

use serde::Serialize;

use super::engine::{Ending, trace_photons};
use super::estimate::{Estimate, GroupSums};
use super::medium::Medium;
use super::settings::{MonteCarloControl, MonteCarloSettings, ScoredQuantity, ScoringGrid};
use super::walk::{DepthRecord, End, Photon, walk};
use crate::tissue::{Incidence, OpticalStack, TissueError};

/// Places of the scores of one photon: totals first, then rings, then depths.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScoreLayout {
    rings: usize,
    rings_per_mm: f64,
    depth_bins: usize,
}

impl ScoreLayout {
    const SPECULAR: usize = 0;
    const DIFFUSE: usize = 1;
    const TRANSMITTED: usize = 2;
    const UNSCATTERED: usize = 3;
    const GUIDED: usize = 4;
    const TOTALS: usize = 5;

    pub(super) fn new(medium: &Medium, grid: &ScoringGrid) -> Self {
        let rings_per_mm = grid.radial_step_mm.recip();
        Self { rings: grid.radial_bins, rings_per_mm, depth_bins: medium.depth_bins }
    }

    /// Number of scores.
    pub(super) fn len(&self) -> usize {
        self.depths().end
    }

    fn reflected(&self) -> Range<usize> {
        Self::TOTALS..Self::TOTALS + self.rings
    }

    fn transmitted(&self) -> Range<usize> {
        Self::TOTALS + self.rings..Self::TOTALS + 2 * self.rings
    }

    pub(super) fn depths(&self) -> Range<usize> {
        let first = Self::TOTALS + 2 * self.rings;
        first..first + self.depth_bins
    }

    /// Ring that a photon leaves through; `None` beyond the outermost.
    pub(super) fn ring(&self, photon: &Photon) -> Option<usize> {
        let ring = (photon.radius() * self.rings_per_mm) as usize;
        (ring < self.rings).then_some(ring)
    }

    pub(super) fn score_surface(scores: &mut [f64], specular: f64) {
        scores[Self::SPECULAR] += specular;
    }

    /// Adds a packet that has ended.
    pub(super) fn score_end(&self, scores: &mut [f64], end: End, photon: &Photon) {
        let (total, rings) = match end {
            End::Above => (Self::DIFFUSE, self.reflected()),
            End::Below => (Self::TRANSMITTED, self.transmitted()),
            End::Guided => {
                scores[Self::GUIDED] += photon.weight;
                return;
            }
            End::Inside | End::Paused => return,
        };
        scores[total] += photon.weight;
        if end == End::Below && !photon.has_scattered {
            scores[Self::UNSCATTERED] += photon.weight;
        }
        if let Some(ring) = self.ring(photon) {
            scores[rings.start + ring] += photon.weight;
        }
    }
}

/// Light leaving through a ring around the beam.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ring {
    /// Inner and outer radius, mm.
    pub radii_mm: [f64; 2],
    /// Share of the incident light that leaves per area, 1/mm².
    pub exitance_per_mm2: Estimate,
}

/// Light in a slice of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Slice {
    /// Layer, counted from zero.
    pub layer: usize,
    /// Upper and lower depth below the surface, mm.
    pub depths_mm: [f64; 2],
    /// Mean fluence rate over the slice for an irradiance of 1 on the surface; dimensionless.
    pub fluence: Estimate,
}

/// Result of [`simulate`]: shares of the incident light, for light of one wavelength.
#[derive(Clone, Debug, Serialize)]
pub struct MonteCarloResult {
    /// Photons traced.
    pub photons: u64,
    /// Why there are no more.
    pub ending: Ending,
    /// Reflected by the uppermost interface, before it enters.
    pub specular_reflectance: Estimate,
    /// Leaves upward after it has entered.
    pub diffuse_reflectance: Estimate,
    /// Leaves downward.
    pub transmittance: Estimate,
    /// Leaves downward without any scattering; contained in `transmittance`.
    pub unscattered_transmittance: Estimate,
    /// Guided sideways without end by total reflection in a clear layer.
    pub guided: Estimate,
    /// Absorbed in each layer.
    pub absorbed_by_layer: Vec<Estimate>,
    /// `R(r)`: rings of light that leaves upward after it has entered, from the beam outward.
    pub reflected_rings: Vec<Ring>,
    /// `T(r)`: rings of light that leaves downward.
    pub transmitted_rings: Vec<Ring>,
    /// Fluence from the surface downward, as deep as the grid.
    pub slices: Vec<Slice>,
    /// Seed.
    pub seed: u64,
    #[serde(skip)]
    pub(super) incidence: Incidence,
    #[serde(skip)]
    pub(super) stack: OpticalStack,
    /// Fluence in each slice, of each group.
    #[serde(skip)]
    pub(super) fluence_by_group: Vec<Vec<f64>>,
}

/// Traces light of one wavelength through a stack.
///
/// Weighted Monte Carlo after Wang, Jacques and Zheng (MCML, 1995). Fluence is scored at collisions (weight over
/// extinction) and, in layers thinner than a tenth of a mean free path, along tracks.
///
/// # Errors
/// Numbers outside their ranges; too many bins; an interruption before the first round of photons was complete.
pub fn simulate(
    stack: &OpticalStack,
    incidence: Incidence,
    settings: &MonteCarloSettings,
    control: &MonteCarloControl<'_>,
) -> Result<MonteCarloResult, TissueError> {
    settings.validate(stack.layers.len(), false)?;
    let problem = Problem::new(stack, incidence, settings)?;
    let Problem { medium, layout, .. } = &problem;
    let watched = |groups: &GroupSums| problem.watched(groups);
    let (groups, ending) = trace_photons(settings, layout.len(), control, watched, |scores, rng| {
        let (specular, photon) = Photon::incident(incidence, medium, rng);
        ScoreLayout::score_surface(scores, specular);
        let mut record = DepthRecord { bins: &mut scores[layout.depths()] };
        let (end, photon) = walk(medium, photon, &mut record, rng);
        layout.score_end(scores, end, &photon);
    })?;
    Ok(problem.result(&groups, ending))
}

/// A stack under light, ready for photons.
pub(super) struct Problem<'a> {
    settings: &'a MonteCarloSettings,
    stack: &'a OpticalStack,
    incidence: Incidence,
    pub(super) medium: Medium,
    pub(super) layout: ScoreLayout,
}

impl<'a> Problem<'a> {
    pub(super) fn new(
        stack: &'a OpticalStack,
        incidence: Incidence,
        settings: &'a MonteCarloSettings,
    ) -> Result<Self, TissueError> {
        stack.validate()?;
        incidence.validate()?;
        let medium = Medium::new(stack, &settings.grid);
        let layout = ScoreLayout::new(&medium, &settings.grid);
        Ok(Self { settings, stack, incidence, medium, layout })
    }

    /// The estimate that the error target is about.
    pub(super) fn watched(&self, groups: &GroupSums) -> Estimate {
        match self.settings.target.map(|target| target.quantity) {
            Some(ScoredQuantity::Absorbed(layer)) => self.absorbed(groups, layer),
            Some(ScoredQuantity::Transmittance) => groups.estimate(|scores| scores[ScoreLayout::TRANSMITTED]),
            _ => groups.estimate(|scores| scores[ScoreLayout::DIFFUSE]),
        }
    }

    fn absorbed(&self, groups: &GroupSums, layer: usize) -> Estimate {
        let bins = self.medium.layers[layer].bins;
        let first = self.layout.depths().start + bins.first;
        let factor = self.medium.layers[layer].track_per_score() * self.stack.layers[layer].absorption_per_mm;
        groups.estimate(|scores| factor * scores[first..=first + bins.number].iter().sum::<f64>())
    }

    /// Estimates from the sums of the groups.
    pub(super) fn result(self, groups: &GroupSums, ending: Ending) -> MonteCarloResult {
        let Self { settings, layout, .. } = &self;
        let total = |place: usize| groups.estimate(|scores| scores[place]);
        let layers = 0..self.stack.layers.len();
        let fluence_by_group = self.fluence_by_group(groups);
        MonteCarloResult {
            photons: groups.photons(),
            ending,
            specular_reflectance: total(ScoreLayout::SPECULAR),
            diffuse_reflectance: total(ScoreLayout::DIFFUSE),
            transmittance: total(ScoreLayout::TRANSMITTED),
            unscattered_transmittance: total(ScoreLayout::UNSCATTERED),
            guided: total(ScoreLayout::GUIDED),
            absorbed_by_layer: layers.map(|layer| self.absorbed(groups, layer)).collect(),
            reflected_rings: rings(layout.reflected(), &settings.grid, groups),
            transmitted_rings: rings(layout.transmitted(), &settings.grid, groups),
            slices: self.slices(&fluence_by_group),
            seed: settings.seed,
            incidence: self.incidence,
            stack: self.stack.clone(),
            fluence_by_group,
        }
    }

    /// Fluence of each slice in each group.
    fn fluence_by_group(&self, groups: &GroupSums) -> Vec<Vec<f64>> {
        let photons = groups.photons_per_group as f64;
        let depths = self.layout.depths().start;
        let fluence = |scores: &Vec<f64>| {
            let layers = self.medium.layers.iter().flat_map(|layer| {
                let factor = layer.track_per_score() / (layer.bins.width * photons);
                let first = depths + layer.bins.first;
                scores[first..first + layer.bins.number].iter().map(move |score| score * factor)
            });
            layers.collect()
        };
        groups.sums.iter().map(fluence).collect()
    }

    fn slices(&self, fluence_by_group: &[Vec<f64>]) -> Vec<Slice> {
        let mut slices = Vec::with_capacity(self.medium.depth_bins);
        for (place, layer) in self.medium.layers.iter().enumerate() {
            let edge = |bin: usize| layer.top + bin as f64 * layer.bins.width;
            for bin in 0..layer.bins.number {
                let slice = slices.len();
                let fluence = Estimate::of(fluence_by_group.iter().map(|group| group[slice]));
                slices.push(Slice { layer: place, depths_mm: [edge(bin), edge(bin + 1)], fluence });
            }
        }
        slices
    }
}

/// Light that leaves per area of each ring.
pub(super) fn rings(scores: Range<usize>, grid: &ScoringGrid, groups: &GroupSums) -> Vec<Ring> {
    let step = grid.radial_step_mm;
    let ring = |(ring, score): (usize, usize)| {
        let inner = ring as f64 * step;
        let area = std::f64::consts::PI * step * (2.0 * inner + step);
        let exitance_per_mm2 = groups.estimate(|scores| scores[score] / area);
        Ring { radii_mm: [inner, inner + step], exitance_per_mm2 }
    };
    scores.enumerate().map(ring).collect()
}
