//! The smallest share of porphyrin that a camera tells from none, before the typical tissue of a family: the estimate itself, on regions
//! made for it.
//!
//! A region is as many blocks as that of the measurement. Each has the color of a place drawn from the family, the same in every run,
//! and the sensor's noise; porphyrin is added in a tenth of the blocks, evenly, or as mouths of the catalogue have it. What the estimate would say of
//! it is what it would say of a frame.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};

use super::family_average::{Candidate, QUIET, SENSOR_NOISE, answer};
use super::light_family::LightFamily;
use super::region_blocks::{RegionBlock, normal_deviates};
use super::share_posterior::TAIL;

/// Shares between which the smallest is looked for, and the even steps of their logarithm.
const RANGE: [f64; 2] = [0.003, 0.5];
const STEPS: usize = 64;
/// One of so many blocks holds the porphyrin of patches.
const PATCHES_OF: usize = 10;
/// As mouths of the catalogue have it: the standard deviation of the logarithm, as blocks of rendered tongues have it. \[assumed\] of people.
const USUAL_LOG_SD: f64 = 0.7;
/// Side of a block, in any unit.
const SIDE: usize = 10;

/// How much light a region gives, and how well it is known.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalLevel {
    /// Mean electrons of one pixel for each datum of a family.
    pub electrons: Vec<f64>,
    /// Their variances by the sensor's noise, of the means over the region.
    pub variance: Vec<f64>,
    /// Blocks that the region is cut into.
    pub blocks: usize,
}

/// How porphyrin lies in a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PorphyrinSpread {
    /// In patches that cover a tenth.
    Patches,
    /// The same everywhere.
    Even,
    /// As mouths of the catalogue have it: log-normal.
    Usual,
}

/// The smallest shares that a camera tells from none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VisibleShare {
    /// Share of the light of the region in patches that cover a tenth of it; `None` where one half is not enough.
    pub in_patches: Option<f64>,
    /// The same if it is spread evenly.
    pub evenly: Option<f64>,
    /// What, if it were known, would lower the first most.
    pub limited_by: Option<String>,
}

impl VisibleShare {
    /// Largest share that is tried.
    pub const LARGEST: f64 = RANGE[1];
}

/// A typical region before a camera.
#[derive(Clone)]
struct TypicalRegion<'a> {
    /// The family by which it is judged.
    family: &'a Candidate<'a>,
    /// Electrons of each place without porphyrin, and those of all porphyrin where it is as much as all other fluorescence.
    places: Vec<Vec<f64>>,
    porphyrin: Vec<f64>,
    /// Variance of the mean over the region per electron.
    noise: Vec<f64>,
    /// Normal deviates of the noise of each place.
    deviates: Vec<Vec<f64>>,
}

impl PorphyrinSpread {
    /// Amount in each of some blocks over their mean.
    fn amounts(self, blocks: usize) -> Vec<f64> {
        let usual = |block: usize| {
            // Even steps of the distribution in an order that no place has a part in
            let step = (block as f64 * 0.618_033_988_749_895 + 0.5).fract();
            (USUAL_LOG_SD * Normal::standard().inverse_cdf(step.clamp(0.01, 0.99))).exp()
        };
        let of = |block: usize| match self {
            Self::Even => 1.0,
            Self::Patches => f64::from(u8::from(block.is_multiple_of(PATCHES_OF))),
            Self::Usual => usual(block),
        };
        let amounts: Vec<f64> = (0..blocks).map(of).collect();
        let mean = amounts.iter().sum::<f64>() / blocks.max(1) as f64;
        amounts.into_iter().map(|amount| amount / mean).collect()
    }
}

impl<'a> TypicalRegion<'a> {
    /// `None` where the family sends no light, or the level is not of it.
    fn new(candidate: &'a Candidate<'a>, level: &SignalLevel) -> Option<Self> {
        let family = candidate.family;
        let data = family.frame_of.len();
        if level.electrons.len() != data || level.variance.len() != data {
            return None;
        }
        let middle = vec![0.0; family.nuisances().len()];
        let bulk = family.electrons(&middle, 0.0);
        let typical = family.electrons(&middle, family.porphyrin.median);
        let share = family.share(&middle, family.porphyrin.median);
        if !(share > 0.0 && share < 1.0) {
            return None;
        }
        // As bright as the measurement, each frame by itself
        let sum = |frame: usize, of: &[f64]| -> f64 {
            (0..data).filter(|datum| family.frame_of[*datum] == frame).map(|datum| of[datum]).sum()
        };
        let scale: Vec<f64> = (0..family.frames.len())
            .map(|frame| sum(frame, &level.electrons) / sum(frame, &typical).max(f64::MIN_POSITIVE))
            .collect();
        let of_datum = |datum: usize| scale[family.frame_of[datum]];
        let per_odds = (1.0 - share) / share;
        let places = family.drawn_places(level.blocks.max(1), &bulk);
        Some(Self {
            family: candidate,
            porphyrin: (0..data).map(|i| of_datum(i) * per_odds * (typical[i] - bulk[i])).collect(),
            noise: (0..data).map(|i| level.variance[i] / level.electrons[i].max(f64::MIN_POSITIVE)).collect(),
            deviates: (0..level.blocks.max(1)).map(|place| normal_deviates(data, 4, place as u32)).collect(),
            places: places
                .into_iter()
                .map(|place| place.iter().enumerate().map(|(i, e)| of_datum(i) * e).collect())
                .collect(),
        })
    }

    /// The blocks of the region with a share of porphyrin, and their mean.
    fn blocks(&self, share: f64, spread: PorphyrinSpread) -> (Vec<RegionBlock>, [Vec<f64>; 2]) {
        let (count, odds) = (self.places.len(), share / (1.0 - share));
        let columns = (count as f64).sqrt().ceil() as usize;
        let places = self.places.iter().zip(&self.deviates).zip(spread.amounts(count)).enumerate();
        let blocks: Vec<RegionBlock> = places
            .map(|(number, ((place, deviates), amount))| {
                let exact = place.iter().zip(&self.porphyrin).map(|(bulk, p)| bulk + odds * amount * p);
                let exact: Vec<f64> = exact.collect();
                let variance: Vec<f64> =
                    exact.iter().zip(&self.noise).map(|(e, noise)| noise * e * count as f64).collect();
                let noisy = exact.iter().zip(&variance).zip(deviates);
                RegionBlock {
                    corner_px: [number % columns * SIDE, number / columns * SIDE],
                    pixels: SIDE * SIDE,
                    electrons: noisy.map(|((e, variance), z)| e + z * variance.sqrt()).collect(),
                    variance,
                }
            })
            .collect();
        let mean = |of: &dyn Fn(&RegionBlock) -> &Vec<f64>, per: f64| -> Vec<f64> {
            (0..self.noise.len()).map(|i| blocks.iter().map(|b| of(b)[i]).sum::<f64>() / per).collect()
        };
        let means = [mean(&|b| &b.electrons, count as f64), mean(&|b| &b.variance, (count * count) as f64)];
        (blocks, means)
    }

    /// What the estimate says of the region: the interval of the share.
    fn estimate(&self, share: f64, spread: PorphyrinSpread) -> Option<[f64; 2]> {
        let (blocks, [electrons, variance]) = self.blocks(share, spread);
        let fit = self.family.family.fit(&electrons, &variance)?;
        let is_sure = fit.mixture.excludes_none();
        let by_blocks = if is_sure { None } else { self.family.pattern(&fit, &blocks) };
        let by_blocks = by_blocks.and_then(|pattern| Some(pattern.posterior()?.share));
        Some(answer(&fit.mixture, by_blocks.as_ref()).1)
    }

    /// Probability of none that the estimate gives. Porphyrin that is the same everywhere is as probable by blocks as by their mean.
    fn probability_of_none(&self, share: f64, spread: PorphyrinSpread) -> Option<f64> {
        let (blocks, [electrons, variance]) = self.blocks(share, spread);
        let fit = self.family.family.fit(&electrons, &variance)?;
        let is_enough = fit.mixture.excludes_none() || spread == PorphyrinSpread::Even;
        let by_blocks = if is_enough { None } else { self.family.pattern(&fit, &blocks) };
        Some(by_blocks.and_then(|pattern| pattern.probability_of_none()).unwrap_or(fit.mixture.none))
    }

    /// Whether the estimate excludes that there is none.
    fn is_seen(&self, share: f64, spread: PorphyrinSpread) -> bool {
        self.probability_of_none(share, spread).is_some_and(|none| none < TAIL)
    }

    /// The smallest share of which the estimate excludes that there is none.
    fn smallest(&self, spread: PorphyrinSpread) -> Option<f64> {
        let [low, high] = RANGE;
        let share = |step: usize| low * (high / low).powf(step as f64 / STEPS as f64);
        // From a usual one on, in longer and longer strides until it lies between two
        let [mut unseen, mut seen] = [0, STEPS + 1];
        let (mut probe, mut stride) = (if spread == PorphyrinSpread::Even { 46 } else { 22 }, 4);
        while seen - unseen > 1 {
            if self.is_seen(share(probe), spread) {
                seen = probe
            } else {
                unseen = probe
            }
            probe = match (unseen, seen) {
                (0, seen) => seen.saturating_sub(stride).max(1),
                (unseen, seen) if seen > STEPS => (unseen + stride).min(STEPS),
                _ => (unseen + seen) / 2,
            };
            stride *= 2;
        }
        (seen <= STEPS).then(|| share(seen))
    }
}

impl LightFamily {
    /// The smallest share of porphyrin that is told from none in the typical tissue of the family. `None` where it sends no light.
    #[must_use]
    pub fn visible_share(&self, level: &SignalLevel) -> Option<VisibleShare> {
        let itself = Candidate::new(1.0, self);
        let known = self.groups_that_may_be_known().map(|group| (group.name(), self.with_known(group)));
        let known: Vec<(&str, Self)> = known.collect();
        let known: Vec<(&str, Candidate<'_>)> =
            known.iter().map(|(name, family)| (*name, itself.changed(family))).collect();
        visible_share(&itself, &known.iter().map(|(name, known)| (*name, known)).collect::<Vec<_>>(), level)
    }

    /// The 95 % interval that the estimate would give of a share of porphyrin in the typical tissue of the family.
    #[must_use]
    pub fn expected_interval(
        &self,
        level: &SignalLevel,
        share: f64,
        spread: PorphyrinSpread,
    ) -> Option<[f64; 2]> {
        TypicalRegion::new(&Candidate::new(1.0, self), level)?.estimate(share, spread)
    }
}

/// [`LightFamily::visible_share`] where the family and those of which one thing is known have been prepared.
pub(super) fn visible_share<'a>(
    family: &'a Candidate<'a>,
    known: &[(&str, &'a Candidate<'a>)],
    level: &SignalLevel,
) -> Option<VisibleShare> {
    let region = TypicalRegion::new(family, level)?;
    let in_patches = region.smallest(PorphyrinSpread::Patches);
    // Of what might be known, what leaves the least probability of none at the limit
    let none_if = |region: &TypicalRegion<'_>| {
        region.probability_of_none(in_patches.unwrap_or(RANGE[1]), PorphyrinSpread::Patches)
    };
    let judged_by = |family| TypicalRegion { family, ..region.clone() };
    let mut quiet = region.clone();
    quiet.noise.iter_mut().for_each(|noise| *noise *= QUIET);
    let limits = known
        .iter()
        .filter_map(|(name, known)| Some((*name, none_if(&judged_by(*known))?)))
        .chain(none_if(&quiet).map(|none| (SENSOR_NOISE, none)));
    let limited_by = limits.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(name, _)| name.to_owned());
    Some(VisibleShare { evenly: region.smallest(PorphyrinSpread::Even), in_patches, limited_by })
}
