//! The share of the porphyrin in the light of a tissue of which only a family is known.
//!
//! For each amount of porphyrin on a grid, and for none, the nuisances are integrated out by Laplace's method: their most probable
//! values are found by Gauss-Newton steps, and around these the electrons are taken as linear, so that both the evidence of the
//! amount and the distribution of the share given the amount are known in closed form (nested Laplace approximation, Rue, Martino
//! and Chopin, J. R. Stat. Soc. B 71, 319, 2009). The posterior of the share is the mixture over the grid, with a spike at zero.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use statrs::function::erf::erfc;

use super::Analyte;
use super::family_average::{FamilyAverage, TissueDoubt};
use super::light_family::{FamilyPoint, LightFamily, NuisanceGroup};
use super::region_blocks::BlockShares;
use super::visible_share::VisibleShare;
use crate::warning::Warning;

/// Amounts of porphyrin on the grid.
const AMOUNTS: usize = 33;
/// Reach of the grid, in standard deviations of the logarithm of the amount.
const REACH: f64 = 4.0;
/// Most Gauss-Newton steps.
const MOST_STEPS: usize = 40;
/// Standard deviations beyond which a normal distribution holds nothing that counts.
const FARTHEST: f64 = 9.0;
/// Probability on either side of an interval.
pub(super) const TAIL: f64 = 0.025;
/// Probability with which the data of the family would be called foreign to it.
const FOREIGN: f64 = 0.001;

/// What a measurement says about the share of the porphyrin, if the tissue is of a family.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SharePosterior {
    /// Frames that were used. The share is that of the first.
    pub frames: Vec<String>,
    /// What was assumed beforehand.
    pub prior: String,
    /// Median of the share.
    pub median: f64,
    /// 95 % interval: 2.5 % of the probability lie on either side, or 5 % above it where it begins at 0. It holds sensor noise, indirect light, leak, the variety of the
    /// tissue and errors of the library of spectra.
    pub interval: [f64; 2],
    /// The share lies below it with a probability of 95 %.
    pub upper_limit: f64,
    /// Probability that there is no porphyrin at all; `prior_probability_of_none` before the measurement.
    pub probability_of_none: f64,
    /// The same before the measurement.
    pub prior_probability_of_none: f64,
    /// What the share is hardest to tell from.
    pub blind_to: Option<BlindDirection>,
    /// The interval if the prior of the tissue is twice as wide.
    pub with_prior_twice_as_wide: [f64; 2],
    /// The interval if one thing were known, or absent.
    pub without: Vec<IntervalWithout>,
    /// How far the measured colors are from the family: about the number of `data` where they belong to it (chi-square).
    pub misfit: f64,
    /// Numbers that were measured.
    pub data: usize,
    /// Whether the misfit is larger than in one of a thousand measurements of the family.
    pub foreign: bool,
    /// Whether it is the tissue that was named, where others were compared; the numbers above are averages over all of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubt: Option<TissueDoubt>,
    /// What the blocks of the region say, where there are enough.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blocks: Option<BlockShares>,
    /// The share from the mean of the region alone, where it can't exclude that there is none: the median, the interval and the probability
    /// of none above are then those of the blocks. Where that interval begins at 0 it ends where that of the mean does, if that is farther.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of_mean: Option<ShareOfMean>,
    /// The share of all red emission, porphyrin and plant pigment together, where the tissue may hold such pigment: median and 95 %
    /// interval. Cameras of three channels know this sum better than its parts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub red: Option<RedShare>,
    /// The smallest shares that would be told from none in the typical tissue, with this light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visible: Option<VisibleShare>,
    /// Sensor chromaticity `(r, g)` of people drawn from the family, without porphyrin, in the first frame: to be drawn, not stored. None where
    /// that has not the channels R, G and B.
    #[serde(skip)]
    pub people: Vec<[f64; 2]>,
}

/// The share of the porphyrin from the mean of a region alone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShareOfMean {
    /// Median of the share.
    pub median: f64,
    /// 95 % interval, as [`SharePosterior::interval`].
    pub interval: [f64; 2],
    /// Probability that there is no porphyrin at all.
    pub probability_of_none: f64,
}

/// The share of all red emission.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RedShare {
    /// Median of the share.
    pub median: f64,
    /// 95 % interval, 2.5 % of the probability on either side.
    pub interval: [f64; 2],
}

impl SharePosterior {
    /// What makes the result doubtful.
    #[must_use]
    pub fn warnings(&self, analyte: &Analyte) -> Vec<Warning> {
        let other = self.doubt.as_ref().and_then(TissueDoubt::warning);
        let foreign = self.foreign.then(|| {
            let statement = format!(
                "The colors of the region are not those of {} (chi-square {:.0}, where {} is expected): its light holds something \
                 that the family does not, or it is other tissue",
                self.prior, self.misfit, self.data
            );
            let explanation = match self.explained_by() {
                Some(tissue) => format!("The estimate is an average over tissues, of which {tissue} explains the light."),
                None => format!("The {analyte} share is not to be trusted."),
            };
            Warning::explained(statement, explanation)
        });
        foreign.into_iter().chain(other).collect()
    }

    /// The tissue that explains light which is foreign to the named one: the most probable of those that were compared, where its own
    /// family fits. The estimate, an average over all of them, is then one of this tissue.
    #[must_use]
    pub fn explained_by(&self) -> Option<&str> {
        let (_, others) = self.doubt.as_ref()?.tissues.split_first()?;
        let best = others.first()?;
        let is_it = self.foreign && best.probability > 0.5 && best.misfit <= largest_misfit(self.data);
        is_it.then_some(best.tissue.as_str())
    }

    /// Whether the measurement excludes that there is no porphyrin: its 95 % interval begins above 0.
    #[must_use]
    pub fn excludes_none(&self) -> bool {
        self.interval[0] > 0.0
    }

    /// Whether the light is that of no tissue that was compared, so that the share is no estimate of anything.
    #[must_use]
    pub fn is_no_estimate(&self) -> bool {
        self.foreign && self.explained_by().is_none()
    }
}

/// Median and interval of the share, without what else is told of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShareInterval {
    /// Median of the share.
    pub median: f64,
    /// 95 % interval, as [`SharePosterior::interval`].
    pub interval: [f64; 2],
    /// Whether a warning goes with the estimate: the data don't fit the family ([`SharePosterior::foreign`]), or speak for other
    /// tissue ([`TissueDoubt::is_strong`]).
    pub warned: bool,
}

/// The nuisance with which an error of the share goes along most.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlindDirection {
    /// Its name.
    pub name: String,
    /// Correlation after the measurement, -1 to 1.
    pub correlation: f64,
}

/// An interval with one source of uncertainty taken away.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IntervalWithout {
    /// The source.
    pub source: String,
    /// The 95 % interval without it.
    pub interval: [f64; 2],
}

/// The most probable nuisances for one amount of porphyrin.
struct Mode {
    nuisances: DVector<f64>,
    point: FamilyPoint,
    /// `J J^T + 1` of the slopes in standard deviations of the data.
    factor: Cholesky<f64, Dyn>,
    /// As [`in_sd`] has them.
    slopes: DMatrix<f64>,
    /// `chi² + |u|²`.
    misfit: f64,
    log_evidence: f64,
}

/// The posterior of a share as a mixture.
pub(super) struct Mixture {
    /// Probability of none.
    pub(super) none: f64,
    /// Weight, mean and standard deviation of the log odds.
    pub(super) terms: Vec<[f64; 3]>,
}

/// What a measurement says if the tissue is of a family.
pub(super) struct FamilyFit {
    pub(super) mixture: Mixture,
    /// The share of all red emission, porphyrin and plant pigment, in tissue that holds such pigment.
    pub(super) red: Option<Mixture>,
    /// Covariance of the log odds of both shares in each term.
    red_along: Vec<f64>,
    /// Logarithm of the probability density of the data with all unknowns integrated out, up to a term that all families share.
    pub(super) log_evidence: f64,
    /// How far the data are from the family.
    pub(super) misfit: f64,
    /// Mean and standard deviation of the log odds of the share beforehand, where there is porphyrin, and the probability of none.
    pub(super) beforehand: [f64; 2],
    prior_of_none: f64,
    /// The most probable amount.
    best: Mode,
    /// `L` of the covariance `L L^T` of the data.
    noise: DMatrix<f64>,
}

/// Misfit of data of the family that is exceeded with the probability [`FOREIGN`].
pub(super) fn largest_misfit(data: usize) -> f64 {
    ChiSquared::new(data as f64).map_or(f64::INFINITY, |chi| chi.inverse_cdf(1.0 - FOREIGN))
}

fn normal_cdf(z: f64) -> f64 {
    0.5 * erfc(-z / std::f64::consts::SQRT_2)
}

impl RedShare {
    pub(super) fn of(mixture: &Mixture) -> Self {
        let [median, low, high] = [0.5, 0.025, 0.975].map(|probability| mixture.quantile(probability));
        Self { median, interval: [low, high] }
    }

    /// No less than the share of porphyrin, which is a part of it.
    pub(super) fn at_least(self, median: f64, [low, high]: [f64; 2]) -> Self {
        let Self { median: own, interval: [own_low, own_high] } = self;
        Self { median: own.max(median), interval: [own_low.max(low), own_high.max(high)] }
    }
}

impl FamilyFit {
    /// Logarithm of the likelihood of a share by the mean of the region, up to a term that all shares have.
    pub(super) fn log_likelihood(&self, share: f64) -> f64 {
        /// Share below which there is as good as none.
        const LEAST: f64 = 0.002;
        let of_none = (self.mixture.none / self.prior_of_none).max(f64::MIN_POSITIVE).ln();
        let x = share.clamp(LEAST, 1.0 - LEAST);
        let log_odds = (x / (1.0 - x)).ln();
        let [mean, sd] = self.beforehand;
        let z = (log_odds - mean) / sd;
        let before =
            -0.5 * z * z - (sd * std::f64::consts::TAU.sqrt()).ln() + (1.0 - self.prior_of_none).ln();
        let of_some = self.mixture.below(log_odds)[1].max(f64::MIN_POSITIVE).ln() - before;
        of_none + (of_some - of_none) * (share / LEAST).min(1.0)
    }

    /// The share of all red emission, which is that of porphyrin in tissue without plant pigment.
    pub(super) fn red(&self) -> &Mixture {
        self.red.as_ref().unwrap_or(&self.mixture)
    }

    /// The share of all red emission where more than the mean of the region tells that of porphyrin: what goes along with each share of
    /// porphyrin stays as the mean has it (Jeffrey's rule).
    pub(super) fn red_given(&self, share: &Mixture) -> Mixture {
        /// Steps over the log odds of the share, and the probability beyond either end.
        const STEPS: usize = 64;
        const BEYOND: f64 = 1e-4;
        let log_odds = |share: f64| (share / (1.0 - share)).max(1e-6).ln();
        let [from, to] = [BEYOND, 1.0 - BEYOND].map(|probability| log_odds(share.quantile(probability)));
        let red = &self.red().terms;
        let of_none = red.last().map(|[_, mean, sd]| [share.none, *mean, *sd]);
        let (mut terms, mut below) = (Vec::from_iter(of_none), share.none);
        for step in 1..=STEPS {
            let end = from + (to - from) * step as f64 / STEPS as f64;
            let at = end - 0.5 * (to - from) / STEPS as f64;
            let up_to = if step == STEPS { 1.0 } else { share.below(end)[0] };
            let log = |[weight, mean, sd]: &[f64; 3]| {
                (weight / sd).max(f64::MIN_POSITIVE).ln() - 0.5 * ((at - mean) / sd).powi(2)
            };
            let logs: Vec<f64> = self.mixture.terms.iter().map(log).collect();
            let best = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let total: f64 = logs.iter().map(|log| (log - best).exp()).sum();
            let of_share = self.mixture.terms.iter().zip(&self.red_along).zip(logs);
            terms.extend(red.iter().zip(of_share).map(
                |([_, red, red_sd], (([_, mean, sd], along), log))| {
                    let slope = along / (sd * sd);
                    let rest = (red_sd * red_sd - slope * along).max(1e-12).sqrt();
                    [(up_to - below) * (log - best).exp() / total, red + slope * (at - mean), rest]
                },
            ));
            below = up_to;
        }
        Mixture { none: 0.0, terms }
    }
}

impl Mixture {
    /// Adds another one of some weight.
    pub(super) fn add(&mut self, weight: f64, other: &Self) {
        self.none += weight * other.none;
        self.terms.extend(other.terms.iter().map(|[share, mean, sd]| [weight * share, *mean, *sd]));
    }

    /// Probability of log odds up to some, and its density there.
    fn below(&self, log_odds: f64) -> [f64; 2] {
        let (mut probability, mut density) = (self.none, 0.0);
        for [weight, mean, sd] in &self.terms {
            let z = (log_odds - mean) / sd;
            if z > FARTHEST {
                probability += weight;
            } else if z > -FARTHEST {
                probability += weight * normal_cdf(z);
                density += weight * (-0.5 * z * z).exp() / (sd * std::f64::consts::TAU.sqrt());
            }
        }
        [probability, density]
    }

    pub(super) fn quantile(&self, probability: f64) -> f64 {
        if self.none >= probability {
            return 0.0;
        }
        // Newton's steps in the log odds, which resolve small shares, halved where they lead out of what is left
        let (mut low, mut high) = (-25.0_f64, 25.0_f64);
        let mut at = -3.0;
        for _ in 0..60 {
            let [below, density] = self.below(at);
            if below < probability {
                low = at
            } else {
                high = at
            }
            let next = at - (below - probability) / density;
            let next = if low < next && next < high { next } else { 0.5 * (low + high) };
            let moved = (next - at).abs();
            at = next;
            if moved < 1e-12 {
                break;
            }
        }
        1.0 / (1.0 + (-at).exp())
    }

    /// Whether [`Self::interval`] begins above 0.
    pub(super) fn excludes_none(&self) -> bool {
        self.none < TAIL
    }

    /// Holds 95 %: 2.5 % on either side, or all from none to the 95 % quantile where none can't be excluded.
    pub(super) fn interval(&self) -> [f64; 2] {
        if self.excludes_none() {
            [TAIL, 1.0 - TAIL].map(|probability| self.quantile(probability))
        } else {
            [0.0, self.quantile(1.0 - 2.0 * TAIL)]
        }
    }
}

impl LightFamily {
    /// The share of the porphyrin from measured electrons, one number for each channel of each frame, and their variances by the
    /// sensor's noise, if the tissue is of this family for certain. `None` where there is nothing to measure: no positive number, or
    /// numbers that do not fit the family in length.
    #[must_use]
    pub fn posterior(&self, electrons: &[f64], variance: &[f64]) -> Option<SharePosterior> {
        FamilyAverage::certain(self).posterior(electrons, variance)
    }

    /// Median and interval of the share alone: what a test of many measurements needs, at a tenth of the cost.
    #[must_use]
    pub fn share_interval(&self, electrons: &[f64], variance: &[f64]) -> Option<ShareInterval> {
        FamilyAverage::certain(self).share_interval(electrons, variance)
    }

    pub(super) fn fit(&self, electrons: &[f64], variance: &[f64]) -> Option<FamilyFit> {
        let n = self.frame_of.len();
        let fits = [n, n * n].contains(&variance.len()) && electrons.len() == n;
        if !fits || !electrons.iter().any(|e| *e > 0.0) {
            return None;
        }
        let noise = self.data_noise(electrons, variance)?;
        let start = self.start(electrons);
        let none = self.mode(&[start], 0.0, electrons, &noise)?;

        // Walk over the amounts, each from the mode of the one before or from where the two before it lead
        let mut modes: Vec<(f64, Mode)> = Vec::with_capacity(AMOUNTS);
        let mut starts = vec![none.nuisances.clone()];
        for node in 0..AMOUNTS {
            let [z, amount] = self.amount(node);
            if let Some(mode) = self.mode(&starts, amount, electrons, &noise) {
                let before = modes.last().map_or(&none.nuisances, |(_, before)| &before.nuisances);
                starts = vec![mode.nuisances.clone(), 2.0 * &mode.nuisances - before];
                modes.push((-0.5 * z * z, mode));
            }
        }
        self.mix(none, modes, noise)
    }

    /// `L` of the covariance `L L^T` of the data: noise, and errors of the model in proportion to the signal.
    fn data_noise(&self, electrons: &[f64], variance: &[f64]) -> Option<DMatrix<f64>> {
        let largest = electrons.iter().copied().fold(0.0, f64::max);
        let mut covariance = covariance_of(variance, electrons.len());
        for (i, electrons) in electrons.iter().enumerate() {
            let of_model = self.model_error[i] * electrons.max(1e-3 * largest);
            covariance[(i, i)] = (covariance[(i, i)] + of_model.powi(2)).max((1e-9 * largest).powi(2));
        }
        Cholesky::new(covariance).map(Cholesky::unpack)
    }

    /// Amount of porphyrin of a node of the grid.
    fn amount(&self, node: usize) -> [f64; 2] {
        let z = REACH * (2.0 * node as f64 / (AMOUNTS - 1) as f64 - 1.0);
        [z, self.porphyrin.median * (self.porphyrin.log_sd * z).exp()]
    }

    /// Weights of all amounts together.
    fn mix(&self, none: Mode, mut modes: Vec<(f64, Mode)>, noise: DMatrix<f64>) -> Option<FamilyFit> {
        let step = 2.0 * REACH / (AMOUNTS - 1) as f64;
        let slab = (1.0 - self.probability_of_none).ln() + (step / std::f64::consts::TAU.sqrt()).ln();
        let log_weights: Vec<f64> =
            modes.iter().map(|(log_prior, mode)| slab + log_prior + mode.log_evidence).collect();
        let log_none = self.probability_of_none.ln() + none.log_evidence;
        let largest = log_weights.iter().copied().fold(log_none, f64::max);
        if !largest.is_finite() {
            return None;
        }
        let total: f64 =
            log_weights.iter().map(|w| (w - largest).exp()).sum::<f64>() + (log_none - largest).exp();
        let of_none = (log_none - largest).exp() / total;
        let weighted = |of: &dyn Fn(&Mode) -> [f64; 2]| -> Vec<[f64; 3]> {
            let term = |(weight, (_, mode)): (&f64, &(f64, Mode))| {
                let [mean, sd] = of(mode);
                [(weight - largest).exp() / total, mean, sd]
            };
            log_weights.iter().zip(&modes).map(term).collect()
        };
        // Without porphyrin there is still the pigment
        let red = (!none.point.red_log_odds_slopes.is_empty()).then(|| {
            let mut terms = weighted(&Mode::red_log_odds);
            let [mean, sd] = none.red_log_odds();
            terms.push([of_none, mean, sd]);
            Mixture { none: 0.0, terms }
        });
        let along = |(_, mode): &(f64, Mode)| {
            mode.covariance(&mode.point.log_odds_slopes, &mode.point.red_log_odds_slopes)
        };
        let red_along = red.iter().flat_map(|_| modes.iter().map(along)).collect();
        let best = (0..modes.len()).max_by(|a, b| log_weights[*a].total_cmp(&log_weights[*b]))?;
        let misfit =
            modes.iter().map(|(log_prior, mode)| mode.misfit - 2.0 * log_prior).fold(none.misfit, f64::min);
        let middle = self.point(&vec![0.0; self.nuisances().len()], self.porphyrin.median);
        Some(FamilyFit {
            beforehand: [middle.log_odds, middle.log_odds_slopes.norm().hypot(self.porphyrin.log_sd)],
            prior_of_none: self.probability_of_none,
            mixture: Mixture { none: of_none, terms: weighted(&Mode::log_odds) },
            red,
            red_along,
            log_evidence: largest + total.ln() - noise.diagonal().iter().map(|sd| sd.ln()).sum::<f64>(),
            misfit,
            best: modes.swap_remove(best).1,
            noise,
        })
    }

    /// Nuisances to start from: all in the middle of their priors but the brightness, which the data tell.
    fn start(&self, electrons: &[f64]) -> DVector<f64> {
        let names = self.nuisances();
        let mut start = DVector::zeros(names.len());
        let expected: f64 = self.electrons(start.as_slice(), 0.0).iter().sum();
        let measured: f64 = electrons.iter().filter(|e| **e > 0.0).sum();
        let brightness = names.iter().position(|(_, group)| *group == NuisanceGroup::Brightness);
        if let (Some(place), true) = (brightness, self.gain_log_sd > 0.0 && expected > 0.0) {
            start[place] = (measured / expected).ln() / self.gain_log_sd;
        }
        start
    }

    /// The most probable nuisances for an amount of porphyrin, by Gauss-Newton steps in the space of the data from the best of some starts.
    fn mode(
        &self,
        starts: &[DVector<f64>],
        amount: f64,
        electrons: &[f64],
        noise: &DMatrix<f64>,
    ) -> Option<Mode> {
        let residual = |point: &FamilyPoint| {
            let off = electrons.iter().zip(&point.electrons).map(|(measured, e)| measured - e);
            noise.solve_lower_triangular_unchecked(&DVector::from_iterator(electrons.len(), off))
        };
        let at = |u: DVector<f64>| {
            let point = self.point(u.as_slice(), amount);
            let r = residual(&point);
            let misfit = r.norm_squared() + u.norm_squared();
            (u, point, r, misfit)
        };
        let tried = starts.iter().cloned().map(at);
        let (mut u, mut point, mut r, mut misfit) = tried.min_by(|a, b| a.3.total_cmp(&b.3))?;
        for _ in 0..MOST_STEPS {
            let slopes = in_sd(&point.slopes, noise);
            let factor = Cholesky::new(products_and_one(&slopes))?;
            let step = &slopes * factor.solve(&(&r + slopes.tr_mul(&u))) - &u;
            // Halve the step until the misfit falls
            let mut share = 1.0;
            let mut better = None;
            while share > 1e-4 {
                let there = at(&u + share * &step);
                if there.3 < misfit {
                    better = Some(there);
                    break;
                }
                share *= 0.5;
            }
            let Some((tried, there, r_there, value)) = better else { break };
            let gained = misfit - value;
            (u, point, r, misfit) = (tried, there, r_there, value);
            if gained < 1e-6 {
                break;
            }
        }
        let slopes = in_sd(&point.slopes, noise);
        let factor = Cholesky::new(products_and_one(&slopes))?;
        let log_determinant = 2.0 * factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let log_evidence = -0.5 * misfit - 0.5 * log_determinant;
        Some(Mode { nuisances: u, point, factor, slopes, misfit, log_evidence })
    }

    /// The nuisance that goes along with the share most, the amount of porphyrin being unknown.
    pub(super) fn blind_direction(&self, fit: &FamilyFit) -> Option<BlindDirection> {
        let (FamilyFit { best: mode, noise, .. }, names) = (fit, self.nuisances());
        // The logarithm of the amount joins as the last unknown
        let slopes = self.with_amount(&mode.slopes, &mode.point, noise);
        let mut odds = mode.point.log_odds_slopes.clone().insert_row(names.len(), self.porphyrin.log_sd);
        let factor = Cholesky::new(products_and_one(&slopes))?;
        let spread = |g: &DVector<f64>| g - &slopes * factor.solve(&slopes.tr_mul(g));
        let along = spread(&odds);
        let variance = odds.dot(&along);
        odds.fill(0.0);
        let correlation = |(place, (name, group)): (usize, &(String, NuisanceGroup))| {
            let mut unit = DVector::zeros(odds.len());
            unit[place] = 1.0;
            let own = unit.dot(&spread(&unit));
            let correlation = if own * variance > 0.0 { along[place] / (own * variance).sqrt() } else { 0.0 };
            (*group != NuisanceGroup::Brightness).then(|| BlindDirection { name: name.clone(), correlation })
        };
        names
            .iter()
            .enumerate()
            .filter_map(correlation)
            .max_by(|a, b| a.correlation.abs().total_cmp(&b.correlation.abs()))
    }

    /// Standard deviation that the log odds of the share keep at best, given nuisances and amount: the Cramér-Rao bound of the
    /// family with its prior (van Trees), for data of these variances. `None` without porphyrin.
    #[must_use]
    pub fn bound_of_log_odds(&self, nuisances: &[f64], porphyrin: f64, variance: &[f64]) -> Option<f64> {
        let Bound { slopes, odds, factor, .. } = self.bound(nuisances, porphyrin, variance)?;
        let seen = slopes.tr_mul(&odds);
        let variance = odds.norm_squared() - seen.dot(&factor.solve(&seen));
        Some(variance.max(0.0).sqrt())
    }

    /// Standard deviation by the sensor's noise alone that the log odds of the share have at best in repeated measurements of the
    /// same tissue, if the prior is used: the Cramér-Rao bound for an estimate of the bias that the prior gives it. The estimate
    /// moves by `C J^T r` with the residuals `r` and the covariance `C = (J^T J + 1)^-1` of all unknowns; of `r`, the noise has the
    /// share `variance / sd²`. `None` without porphyrin.
    #[must_use]
    pub fn bound_of_repeats(&self, nuisances: &[f64], porphyrin: f64, variance: &[f64]) -> Option<f64> {
        let Bound { slopes, odds, factor, sd } = self.bound(nuisances, porphyrin, variance)?;
        let moves = &odds - &slopes * factor.solve(&slopes.tr_mul(&odds));
        let of_data = slopes.tr_mul(&moves);
        let squares = of_data.iter().zip(variance).zip(&sd);
        Some(
            squares
                .map(|((weight, variance), sd)| weight * weight * variance / (sd * sd))
                .sum::<f64>()
                .sqrt(),
        )
    }

    fn bound(&self, nuisances: &[f64], porphyrin: f64, variance: &[f64]) -> Option<Bound> {
        let point = self.point(nuisances, porphyrin);
        let n = variance.len();
        let sd: Vec<f64> = (0..n)
            .map(|i| (variance[i] + (self.model_error[i] * point.electrons[i]).powi(2)).sqrt())
            .collect();
        let noise = DMatrix::from_diagonal(&DVector::from_column_slice(&sd));
        let slopes = self.with_amount(&in_sd(&point.slopes, &noise), &point, &noise);
        let odds = point.log_odds_slopes.insert_row(nuisances.len(), self.porphyrin.log_sd);
        let factor = Cholesky::new(products_and_one(&slopes))?;
        (porphyrin > 0.0).then_some(Bound { slopes, odds, factor, sd })
    }

    /// Slopes of the data in their standard deviations, with those by the logarithm of the amount as the last row.
    fn with_amount(&self, slopes: &DMatrix<f64>, point: &FamilyPoint, noise: &DMatrix<f64>) -> DMatrix<f64> {
        let by_amount = DVector::from_column_slice(&point.porphyrin) * self.porphyrin.log_sd;
        let last = slopes.nrows();
        let mut slopes = slopes.clone().insert_row(last, 0.0);
        slopes.set_row(last, &noise.solve_lower_triangular_unchecked(&by_amount).transpose());
        slopes
    }
}

/// Slopes at a truth, the logarithm of the amount of porphyrin being the last unknown.
struct Bound {
    /// Of the data, in their standard deviations, `[unknown, datum]`.
    slopes: DMatrix<f64>,
    /// Of the log odds of the share.
    odds: DVector<f64>,
    /// `J J^T + 1`.
    factor: Cholesky<f64, Dyn>,
    /// Standard deviations of the data.
    sd: Vec<f64>,
}

/// The covariance of data by their variances, or by all of its numbers.
pub(super) fn covariance_of(variance: &[f64], data: usize) -> DMatrix<f64> {
    if variance.len() == data * data {
        DMatrix::from_column_slice(data, data, variance)
    } else {
        DMatrix::from_diagonal(&DVector::from_column_slice(variance))
    }
}

/// Slopes of independent data of unit variance, `[nuisance, datum]`: those of a datum lie side by side.
fn in_sd(slopes: &DMatrix<f64>, noise: &DMatrix<f64>) -> DMatrix<f64> {
    noise.solve_lower_triangular_unchecked(slopes).transpose()
}

/// `J J^T + 1` from the columns of `J^T`.
fn products_and_one(slopes: &DMatrix<f64>) -> DMatrix<f64> {
    let n = slopes.ncols();
    let mut products = DMatrix::identity(n, n);
    for i in 0..n {
        for j in 0..=i {
            products[(i, j)] += slopes.column(i).dot(&slopes.column(j));
            products[(j, i)] = products[(i, j)];
        }
    }
    products
}

impl Mode {
    /// Mean and standard deviation of the log odds of the share for this amount of porphyrin.
    fn log_odds(&self) -> [f64; 2] {
        [self.point.log_odds, self.deviation_of(&self.point.log_odds_slopes)]
    }

    /// The same of all red emission.
    fn red_log_odds(&self) -> [f64; 2] {
        [self.point.red_log_odds, self.deviation_of(&self.point.red_log_odds_slopes)]
    }

    /// Standard deviation of what has some slopes by the nuisances.
    fn deviation_of(&self, slopes: &DVector<f64>) -> f64 {
        self.covariance(slopes, slopes).max(0.0).sqrt().max(1e-6)
    }

    fn covariance(&self, a: &DVector<f64>, b: &DVector<f64>) -> f64 {
        a.dot(b) - self.slopes.tr_mul(a).dot(&self.factor.solve(&self.slopes.tr_mul(b)))
    }
}
