//! The share of the porphyrin where it is not certain which tissue it is: Bayesian model averaging over families (Hoeting, Madigan,
//! Raftery and Volinsky, Statist. Sci. 14, 382, 1999).
//!
//! Family `m` has the evidence `Z_m`, the probability density of the data under it with all unknowns integrated out, and the
//! probability `w_m` beforehand. After the measurement it is `w_m Z_m / sum_k w_k Z_k`, and the posterior of the share is the mixture of
//! those of the families by these numbers. So the share of a tissue that was named wrongly is as uncertain as the tissue.

use std::sync::OnceLock;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::light_family::{LightFamily, NuisanceGroup};
use super::red_pattern::{PatternPosterior, RedPattern};
use super::region_blocks::{BlockFamily, BlockShares, DrawnTissues, LEAST_BLOCKS, RegionBlock};
use super::share_posterior::{
    FamilyFit, IntervalWithout, Mixture, RedShare, ShareInterval, ShareOfMean, SharePosterior, covariance_of,
    largest_misfit,
};
use super::visible_share::{SignalLevel, VisibleShare, visible_share};
use crate::warning::Warning;

/// Bayes factor from which on other tissue is told: "strong" by Kass and Raftery, J. Am. Stat. Assoc. 90, 773, 1995. The factor of the
/// others together has the mean 1 over data of the named family, so that it reaches 20 in at most 5 % of them (Markov's inequality).
const STRONG: f64 = 20.0;
/// Families below this probability have no part in intervals without one source of uncertainty.
const NEGLIGIBLE: f64 = 1e-3;
/// Families below this probability have no part in what blocks say.
const NEGLIGIBLE_IN_BLOCKS: f64 = 0.01;

/// People whose colors are drawn beside those of a region.
const DRAWN_PEOPLE: u32 = 200;

/// Families that a measured tissue may be of.
#[derive(Clone, Copy, Debug)]
pub struct FamilyAverage<'a> {
    /// The family of the tissue that was named.
    pub named: &'a LightFamily,
    /// Families of other tissues before the same camera.
    pub others: &'a [LightFamily],
    /// Probability before the measurement that the tissue is the named one, above 0 to 1; the others share the rest evenly.
    pub probability_of_named: f64,
}

/// What a measurement says about one tissue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TissueEvidence {
    /// Name of the tissue.
    pub tissue: String,
    /// Evidence over that of the tissue that was named (Bayes factor).
    pub bayes_factor: f64,
    /// Probability after the measurement that it is this tissue.
    pub probability: f64,
    /// How far the measured colors are from its family (chi-square of the data).
    #[serde(default)]
    pub misfit: f64,
}

/// Whether it is the tissue that was named.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TissueDoubt {
    /// Evidence of the other tissues together over that of the named one: the mean of their Bayes factors.
    pub bayes_factor: f64,
    /// The named tissue, then the others, the most probable first.
    pub tissues: Vec<TissueEvidence>,
    /// Median of the share if the tissue is the named one for certain.
    pub median_as_named: f64,
    /// 95 % interval if the tissue is the named one for certain.
    pub interval_as_named: [f64; 2],
    /// Whether the measurement speaks strongly for another tissue: a Bayes factor of 20 or more, which tissue of the named family
    /// reaches in at most 5 % of measurements.
    pub is_strong: bool,
}

impl TissueDoubt {
    /// That the measurement speaks for other tissue than the named one.
    pub(super) fn warning(&self) -> Option<Warning> {
        let (named, others) = self.tissues.split_first()?;
        let (best, [low, high]) = (others.first()?, self.interval_as_named);
        self.is_strong.then(|| {
            let statement = format!(
                "The estimate is told that the region is {}, and {} explains its light {:.0} times better (Bayes factor; \
                 20 and more is strong evidence)",
                named.tissue, best.tissue, best.bayes_factor
            );
            let explanation = format!(
                "Give analysis.tissue the site of the tissue. The interval allows for both; it would be {low:.3} to {high:.3} if \
                 {} were certain, which is not to be trusted.",
                named.tissue
            );
            Warning::explained(statement, explanation)
        })
    }
}

/// Share of the sensor's variance that stands for none: the numbers must have some weight.
pub(super) const QUIET: f64 = 1e-6;
/// What is taken away with it.
pub(super) const SENSOR_NOISE: &str = "sensor noise";

/// A family with its probability before the measurement, and what is made of it once.
pub(super) struct Candidate<'a> {
    weight: f64,
    pub(super) family: &'a LightFamily,
    /// The one that it was changed from.
    from: Option<&'a Candidate<'a>>,
    drawn: OnceLock<DrawnTissues>,
    of_blocks: OnceLock<Option<BlockFamily>>,
}

impl<'a> Candidate<'a> {
    pub(super) fn new(weight: f64, family: &'a LightFamily) -> Self {
        Self { weight, family, from: None, drawn: OnceLock::new(), of_blocks: OnceLock::new() }
    }

    /// A family that was made of this one.
    pub(super) fn changed(&'a self, family: &'a LightFamily) -> Self {
        Self { from: Some(self), ..Self::new(self.weight, family) }
    }

    fn drawn(&self) -> &DrawnTissues {
        match self.from.filter(|from| from.family.coordinates == self.family.coordinates) {
            Some(from) => from.drawn(),
            None => self.drawn.get_or_init(|| self.family.drawn()),
        }
    }

    /// Blocks of a region along the red direction, whose mean is fitted; `None` where they say nothing.
    pub(super) fn pattern(&self, of_mean: &FamilyFit, blocks: &[RegionBlock]) -> Option<RedPattern> {
        if blocks.len() < LEAST_BLOCKS {
            return None;
        }
        let of_blocks = self.of_blocks.get_or_init(|| self.family.of_blocks(self.drawn()));
        of_blocks.as_ref()?.pattern(self.family, of_mean, blocks)
    }
}

/// What is measured of a region.
#[derive(Clone, Copy)]
struct Measured<'a> {
    electrons: &'a [f64],
    variance: &'a [f64],
    blocks: &'a [RegionBlock],
}

/// What one change of all families makes of the interval, and what the named one sees.
struct Changed {
    without: Vec<IntervalWithout>,
    twice_as_wide: [f64; 2],
    visible: Option<VisibleShare>,
}

impl Measured<'_> {
    /// The interval by some families; all where they say nothing.
    fn interval(self, families: &[&Candidate<'_>]) -> [f64; 2] {
        Compared::new(families, self.electrons, self.variance).map_or([0.0, 1.0], |compared| {
            let by_blocks = compared.by_blocks(families, self.blocks, 0);
            answer(&compared.average(), by_blocks.as_ref().map(|found| &found.all)).1
        })
    }

    /// The interval without the sensor's noise.
    fn quiet_interval(self, families: &[&Candidate<'_>]) -> [f64; 2] {
        let quietened = |variance: &[f64]| -> Vec<f64> { variance.iter().map(|v| QUIET * v).collect() };
        let quiet =
            |block: &RegionBlock| RegionBlock { variance: quietened(&block.variance), ..block.clone() };
        let (variance, blocks) =
            (quietened(self.variance), self.blocks.iter().map(quiet).collect::<Vec<_>>());
        Measured { electrons: self.electrons, variance: &variance, blocks: &blocks }.interval(families)
    }

    /// `parts` are the families that count, the named one first.
    fn changed(self, parts: &[&Candidate<'_>]) -> Changed {
        let named = parts[0];
        let of_all = |change: &dyn Fn(&LightFamily) -> LightFamily| -> Vec<LightFamily> {
            parts.iter().map(|part| change(part.family)).collect()
        };
        let groups: Vec<NuisanceGroup> = named.family.groups_that_may_be_known().collect();
        let mut families: Vec<Vec<LightFamily>> =
            groups.iter().map(|group| of_all(&|family| family.with_known(*group))).collect();
        families.push(of_all(&|family| family.widened(2.0)));
        let changed: Vec<Vec<Candidate<'_>>> = families
            .iter()
            .map(|families| parts.iter().zip(families).map(|(part, family)| part.changed(family)).collect())
            .collect();

        let known = groups.iter().zip(&changed).map(|(group, changed)| (group.name(), &changed[0]));
        let known: Vec<(&str, &Candidate<'_>)> = known.collect();
        let level = SignalLevel {
            electrons: self.electrons.to_vec(),
            variance: covariance_of(self.variance, self.electrons.len()).diagonal().iter().copied().collect(),
            blocks: self.blocks.len(),
        };
        let interval = |changed: &Vec<Candidate<'_>>| self.interval(&changed.iter().collect::<Vec<_>>());
        let (mut intervals, (quiet, visible)): (Vec<[f64; 2]>, _) = rayon::join(
            || changed.par_iter().map(interval).collect(),
            || rayon::join(|| self.quiet_interval(parts), || visible_share(named, &known, &level)),
        );
        let twice_as_wide = intervals.pop().unwrap_or([0.0, 1.0]);
        let names = groups.iter().map(|group| group.name()).chain([SENSOR_NOISE]);
        let without = names.zip(intervals.into_iter().chain([quiet]));
        let without = without.map(|(source, interval)| IntervalWithout { source: source.into(), interval });
        Changed { without: without.collect(), twice_as_wide, visible }
    }
}

/// What the blocks of a region say.
struct ByBlocks {
    /// The share, averaged over the families.
    all: Mixture,
    /// What each family says; `None` where its blocks say nothing.
    found: Vec<Option<(RedPattern, PatternPosterior)>>,
    /// The blocks, as the most probable family has them.
    shares: BlockShares,
}

/// What a measurement says under each of several families.
struct Compared {
    fits: Vec<FamilyFit>,
    /// Number of the family of each fit.
    numbers: Vec<usize>,
    /// Probabilities after the measurement.
    probabilities: Vec<f64>,
}

impl Compared {
    /// `None` where the first family, the named one, says nothing.
    fn new(families: &[&Candidate<'_>], electrons: &[f64], variance: &[f64]) -> Option<Self> {
        let fit = |(number, candidate): (usize, &&Candidate<'_>)| {
            Some((number, candidate.family.fit(electrons, variance)?))
        };
        let found: Vec<(usize, FamilyFit)> = families.par_iter().enumerate().filter_map(fit).collect();
        let (numbers, fits): (Vec<usize>, Vec<FamilyFit>) = found.into_iter().unzip();
        if numbers.first() != Some(&0) {
            return None;
        }
        let largest = fits.iter().map(|fit| fit.log_evidence).fold(f64::NEG_INFINITY, f64::max);
        let weight = |(number, fit): (&usize, &FamilyFit)| {
            families[*number].weight * (fit.log_evidence - largest).exp()
        };
        let weights: Vec<f64> = numbers.iter().zip(&fits).map(weight).collect();
        let total: f64 = weights.iter().sum();
        let probabilities = weights.into_iter().map(|weight| weight / total).collect();
        Some(Self { fits, numbers, probabilities })
    }

    /// The posterior of the share: what families say, each by its probability.
    fn average(&self) -> Mixture {
        let mut all = Mixture { none: 0.0, terms: Vec::new() };
        self.fits.iter().zip(&self.probabilities).for_each(|(fit, weight)| all.add(*weight, &fit.mixture));
        all
    }

    /// The posterior of the share of all red emission, by blocks where these answer; tissue without plant pigment has none but that of
    /// porphyrin.
    fn average_of_red(&self, by_blocks: Option<&ByBlocks>) -> Mixture {
        let mut all = Mixture { none: 0.0, terms: Vec::new() };
        for (number, (fit, weight)) in self.fits.iter().zip(&self.probabilities).enumerate() {
            match by_blocks.and_then(|blocks| blocks.found[number].as_ref()) {
                Some((_, found)) if fit.red.is_none() => all.add(*weight, &found.share),
                Some((pattern, found)) if pattern.looks_like_chlorophyll => all.add(*weight, &found.red),
                // Blocks along a way that pigment does not go say nothing of it
                Some((_, found)) => all.add(*weight, &fit.red_given(&found.share)),
                None => all.add(*weight, fit.red()),
            }
        }
        all
    }

    /// The posterior of the share by blocks, each family by its probability, and what the most probable one says of each block. A family
    /// whose blocks say nothing keeps what the mean says. `None` where the blocks of the most probable family say nothing.
    fn by_blocks(
        &self,
        families: &[&Candidate<'_>],
        blocks: &[RegionBlock],
        side_px: usize,
    ) -> Option<ByBlocks> {
        let found: Vec<_> = (0..self.fits.len())
            .into_par_iter()
            .map(|fit| {
                let has_part = fit == 0 || self.probabilities[fit] > NEGLIGIBLE_IN_BLOCKS;
                let family = families[self.numbers[fit]];
                let pattern = if has_part { family.pattern(&self.fits[fit], blocks) } else { None }?;
                let posterior = pattern.posterior()?;
                Some((pattern, posterior))
            })
            .collect();
        let best =
            (0..found.len()).max_by(|a, b| self.probabilities[*a].total_cmp(&self.probabilities[*b]))?;
        let (pattern, posterior) = found[best].as_ref()?;
        let shares = BlockShares::new(blocks, side_px, (pattern, posterior));
        let mut all = Mixture { none: 0.0, terms: Vec::new() };
        for ((fit, found), weight) in self.fits.iter().zip(&found).zip(&self.probabilities) {
            all.add(*weight, found.as_ref().map_or(&fit.mixture, |(_, found)| &found.share));
        }
        Some(ByBlocks { all, found, shares })
    }

    /// Evidence of a fit over that of the named family.
    fn factor(&self, fit: usize) -> f64 {
        (self.fits[fit].log_evidence - self.fits[0].log_evidence).exp()
    }

    /// Evidence of the others together over that of the named family; those that say nothing count as 0.
    fn factor_of_others(&self, others: usize) -> f64 {
        (1..self.fits.len()).map(|fit| self.factor(fit)).sum::<f64>() / others.max(1) as f64
    }
}

/// The share with its interval. What the mean of a region proves stands: it knows the scale of the share better. Else blocks may prove
/// porphyrin; where they don't, the interval ends no nearer than that of the mean.
pub(super) fn answer<'a>(of_mean: &'a Mixture, by_blocks: Option<&'a Mixture>) -> (&'a Mixture, [f64; 2]) {
    let proven_by_mean = of_mean.interval();
    match by_blocks {
        Some(blocks) if proven_by_mean[0] <= 0.0 => match blocks.interval() {
            [0.0, high] => (blocks, [0.0, high.max(proven_by_mean[1])]),
            interval => (blocks, interval),
        },
        _ => (of_mean, proven_by_mean),
    }
}

impl<'a> FamilyAverage<'a> {
    /// The named family alone.
    #[must_use]
    pub fn certain(named: &'a LightFamily) -> Self {
        Self { named, others: &[], probability_of_named: 1.0 }
    }

    /// All families with their probabilities beforehand, the named one first.
    fn families(&self) -> Vec<Candidate<'a>> {
        let of_other = (1.0 - self.probability_of_named) / self.others.len().max(1) as f64;
        let others = self.others.iter().map(|family| Candidate::new(of_other, family));
        std::iter::once(Candidate::new(self.probability_of_named, self.named)).chain(others).collect()
    }

    /// The share of the porphyrin from measured electrons, one number for each channel of each frame, and their variances by the
    /// sensor's noise, or all numbers of its covariance. `None` where there is nothing to measure: no positive number, or numbers that do not fit the named family in
    /// length.
    #[must_use]
    pub fn posterior(&self, electrons: &[f64], variance: &[f64]) -> Option<SharePosterior> {
        self.posterior_of_blocks(electrons, variance, &[], 0)
    }

    /// [`Self::posterior`] by the pattern of the blocks of the region in the first frame, squares of `side_px` pixels: those with the least
    /// red light tell what the tissue of the person emits without porphyrin. Too few blocks add nothing.
    #[must_use]
    pub fn posterior_of_blocks(
        &self,
        electrons: &[f64],
        variance: &[f64],
        blocks: &[RegionBlock],
        side_px: usize,
    ) -> Option<SharePosterior> {
        let families = self.families();
        let families: Vec<&Candidate<'_>> = families.iter().collect();
        let compared = Compared::new(&families, electrons, variance)?;
        let (of_mean, named) = (compared.average(), &compared.fits[0]);
        let by_blocks = compared.by_blocks(&families, blocks, side_px);
        let (mixture, interval) = answer(&of_mean, by_blocks.as_ref().map(|found| &found.all));
        let is_by_blocks = !std::ptr::eq(mixture, &raw const of_mean);

        let has_part = |fit: &usize| *fit == 0 || compared.probabilities[*fit] > NEGLIGIBLE;
        let parts = (0..compared.fits.len()).filter(has_part).map(|fit| families[compared.numbers[fit]]);
        let measured = Measured { electrons, variance, blocks };
        let Changed { mut without, twice_as_wide, visible } = measured.changed(&parts.collect::<Vec<_>>());
        let median = mixture.quantile(0.5);
        let red = named.red.as_ref().map(|_| {
            let red = compared.average_of_red(by_blocks.as_ref().filter(|_| is_by_blocks));
            RedShare::of(&red).at_least(median, interval)
        });
        let of_named = by_blocks.as_ref().and_then(|found| Some(&found.found[0].as_ref()?.1.share));
        let doubt = self.doubt(&compared, answer(&named.mixture, of_named));
        if let Some(doubt) = &doubt {
            without.push(IntervalWithout {
                source: "doubt of the tissue".into(),
                interval: doubt.interval_as_named,
            });
        }
        let data = electrons.len();
        Some(SharePosterior {
            frames: self.named.frames.clone(),
            prior: self.named.prior.clone(),
            median,
            interval,
            upper_limit: if interval[0] > 0.0 { mixture.quantile(0.95) } else { interval[1] },
            probability_of_none: mixture.none,
            prior_probability_of_none: self.named.probability_of_none,
            blind_to: self.named.blind_direction(named),
            with_prior_twice_as_wide: twice_as_wide,
            without,
            misfit: named.misfit,
            data,
            foreign: named.misfit > largest_misfit(data),
            doubt,
            of_mean: is_by_blocks.then(|| ShareOfMean {
                median: of_mean.quantile(0.5),
                interval: of_mean.interval(),
                probability_of_none: of_mean.none,
            }),
            blocks: by_blocks.map(|found| found.shares),
            red,
            visible,
            people: self.named.drawn_chromaticities(DRAWN_PEOPLE),
        })
    }

    /// Median and interval of the share alone: what a test of many measurements needs, at a tenth of the cost.
    #[must_use]
    pub fn share_interval(&self, electrons: &[f64], variance: &[f64]) -> Option<ShareInterval> {
        self.share_interval_of_blocks(electrons, variance, &[])
    }

    /// [`Self::share_interval`] by the pattern of the blocks of the region, as [`Self::posterior_of_blocks`] has it.
    #[must_use]
    pub fn share_interval_of_blocks(
        &self,
        electrons: &[f64],
        variance: &[f64],
        blocks: &[RegionBlock],
    ) -> Option<ShareInterval> {
        let families = self.families();
        let families: Vec<&Candidate<'_>> = families.iter().collect();
        let compared = Compared::new(&families, electrons, variance)?;
        let of_mean = compared.average();
        let by_blocks = compared.by_blocks(&families, blocks, 0);
        let (mixture, interval) = answer(&of_mean, by_blocks.as_ref().map(|found| &found.all));
        let foreign = compared.fits[0].misfit > largest_misfit(electrons.len());
        Some(ShareInterval {
            median: mixture.quantile(0.5),
            interval,
            warned: foreign || compared.factor_of_others(self.others.len()) >= STRONG,
        })
    }

    fn doubt(
        &self,
        compared: &Compared,
        (named, interval_as_named): (&Mixture, [f64; 2]),
    ) -> Option<TissueDoubt> {
        if self.others.is_empty() {
            return None;
        }
        let evidence = |fit: usize| TissueEvidence {
            tissue: match compared.numbers[fit] {
                0 => self.named.tissue.clone(),
                other => self.others[other - 1].tissue.clone(),
            },
            bayes_factor: compared.factor(fit),
            probability: compared.probabilities[fit],
            misfit: compared.fits[fit].misfit,
        };
        let mut tissues: Vec<TissueEvidence> = (0..compared.fits.len()).map(evidence).collect();
        tissues[1..].sort_by(|a, b| b.probability.total_cmp(&a.probability));
        let bayes_factor = compared.factor_of_others(self.others.len());
        Some(TissueDoubt {
            bayes_factor,
            tissues,
            median_as_named: named.quantile(0.5),
            interval_as_named,
            is_strong: bayes_factor >= STRONG,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A share around some odds, with a probability of none.
    fn mixture(none: f64, share: f64) -> Mixture {
        Mixture { none, terms: vec![[1.0 - none, (share / (1.0 - share)).ln(), 0.1]] }
    }

    #[test]
    fn blocks_answer_where_the_mean_proves_nothing() {
        let [sure, unsure] = [mixture(0.0, 0.05), mixture(0.4, 0.2)];
        let found = |of_mean: &Mixture, by_blocks: Option<&Mixture>| answer(of_mean, by_blocks).1;
        assert_eq!(found(&sure, Some(&mixture(0.0, 0.3))), sure.interval());
        let blocks = mixture(0.001, 0.3);
        assert_eq!(found(&unsure, Some(&blocks)), blocks.interval());
        assert_eq!(found(&unsure, None), unsure.interval());
        // Blocks that prove nothing end no nearer than the mean
        assert_eq!(found(&unsure, Some(&mixture(0.3, 0.01))), unsure.interval());
    }
}
