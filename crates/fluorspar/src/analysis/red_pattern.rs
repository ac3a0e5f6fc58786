//! How much of the light of a region is porphyrin, from how its blocks differ along the red direction.
//!
//! Tissue of one person is one unknown that all blocks share, that of a place a small one of each, and porphyrin is none or more in
//! each block. So the blocks with the least red light bound the color of the bulk from above, and with it the porphyrin of the others
//! from below. With the amplitude `a_j` of block `j` along the way from the bulk to the porphyrin, per unit of its share,
//!
//! `a_j = beta + s_j (1 - beta) + error_j`, `beta = beta_0 + f C (1 - beta_0)`, `var error_j = tau² v_a + (rho f C)² + v_n,j`
//!
//! where `beta_0 ~ N(m_b, v_b)` is the bulk of the person, `C` the share of chlorophyll, `tau` how much more than usual places differ. How
//! likely a bulk `beta` is tells the mean of the region, of which it leaves the share `(mean a - beta) / (1 - beta)` to the porphyrin; the
//! normal distribution, which people follow in part, divides it among `beta_0` and `C` alone.
//! The shares `s_j` of blocks follow one of 91 patterns: none, the same everywhere, or a log-normal distribution, with or without
//! blocks that hold none. Neighbors are alike: the likelihood of the blocks is raised to the power of the number of independent ones
//! over that of all (composite likelihood; Cooley, Davison and Ribatet, arXiv 0911.5357). All unknowns are summed over grids.

use std::sync::LazyLock;

use fluorspar_accel::bands::{self, BLOCK, BandBlock};
use fluorspar_accel::{Lanes, Simd, Work};
use rayon::prelude::*;
use statrs::function::erf::erfc;

use super::share_posterior::Mixture;

/// Blocks that count as independent. \[assumed\]: fewer cost power, more take clean tongues for patchy ones.
pub(super) const INDEPENDENT_BLOCKS: f64 = 12.0;
/// Variation from place to place in one person over that among people, as standard deviations of logarithms. \[assumed\], of the size of
/// repeated aims at four tongues under 415 nm: log(R/G) differs by 0.04, part of it porphyrin.
pub(super) const PLACES_OVER_PEOPLE: f64 = 0.25;
/// Factors on the variation from place to place, and the standard deviation of their logarithm. \[assumed\]
pub(super) const PLACE_FACTORS: [f64; 5] = [0.6, 1.0, 1.6, 2.5, 4.0];
const PLACE_FACTOR_LOG_SD: f64 = 0.4;
/// Amounts of chlorophyll over the typical one, and the standard deviation of their logarithm, that of the population.
pub(super) const CHLOROPHYLL: [f64; 5] = [0.1, 0.4, 1.2, 3.0, 7.0];
const CHLOROPHYLL_LOG_SD: f64 = 1.25;
/// Step between colors of the bulk on the grid, over what the mean of independent blocks scatters by, and the most of them.
const BULK_STEP: f64 = 2.0;
const MOST_BULKS: f64 = 96.0;
/// Most steps that are taken at once where blocks scatter more than they do at least.
const MOST_STRIDE: f64 = 4.0;
/// Largest share that the bulk on the grid leaves for porphyrin.
const LARGEST_SHARE: f64 = 0.75;
/// Mean shares of the region on the grid, and where they end.
const MEANS: usize = 18;
const MEAN_RANGE: [f64; 2] = [0.002, 0.45];
/// Shares of blocks on the grid besides none and the means, and where they end.
const SHARES: usize = 22;
const SHARE_RANGE: [f64; 2] = [0.0025, 0.75];
/// Patchy porphyrin: standard deviation of the logarithm, and probability that a block holds none. \[assumed\]
const PATCHES: [[f64; 2]; 4] = [[0.6, 0.0], [1.0, 0.0], [1.5, 0.0], [0.9, 0.4]];
/// Probability of blocks that nobody foresaw, and how much wider they scatter. \[assumed\]
const OUTLIERS: f64 = 0.02;
const OUTLIER_WIDTH: f64 = 3.0;
/// Standard deviations beyond which no block lies: there the density is below [`LEAST_LIKELIHOOD`].
const FARTHEST: f64 = 36.0;
/// Terms this far below the best, as logarithms of probability, are left out.
const NEGLIGIBLE: f64 = 9.0;
/// Blocks whose likelihoods are multiplied before their logarithm is taken, and the least likelihood that counts, so that no product is 0.
const MULTIPLIED: usize = 8;
const LEAST_LIKELIHOOD: f64 = 1e-30;
/// Share from which on a block counts as one with porphyrin.
pub(super) const SHARE_OF_MARK: f64 = 0.02;

/// The blocks of a region along the red direction, and what is known beforehand.
#[derive(Clone, Debug)]
pub(super) struct RedPattern {
    /// Amplitude of each block: 0 is the mean bulk of people, 1 is porphyrin alone.
    pub(super) amplitudes: Vec<f64>,
    /// Variance of each by the sensor's noise.
    pub(super) noise: Vec<f64>,
    /// Share of the region's light that each block sends.
    pub(super) weights: Vec<f64>,
    /// Variance of the bulk from place to place.
    pub(super) place_variance: f64,
    /// Logarithm of the likelihood of each of [`PLACE_FACTORS`].
    pub(super) place_evidence: [f64; PLACE_FACTORS.len()],
    /// Logarithm of the likelihood of each of [`CHLOROPHYLL`], by colors that porphyrin leaves alone.
    pub(super) chlorophyll_evidence: [f64; CHLOROPHYLL.len()],
    /// Amplitudes that the person's bulk, with chlorophyll, may have, in even steps, and the logarithm of the likelihood of each by the mean of
    /// the region.
    pub(super) bulk: Vec<[f64; 2]>,
    /// Mean of the person's bulk without chlorophyll where there is a share `C` of that: `[at 0, slope by C]`.
    pub(super) bulk_mean: [f64; 2],
    /// Relative variance of the scale of the amplitudes.
    pub(super) scale_variance: f64,
    /// Variance of the same.
    pub(super) bulk_variance: f64,
    /// Typical amount of chlorophyll over all other light, and the amplitude of chlorophyll alone; none where the tissue holds none.
    pub(super) chlorophyll: Option<[f64; 2]>,
    /// Typical share of porphyrin in all light, and the standard deviation of its logarithm.
    pub(super) typical_share: [f64; 2],
    /// The share that is asked for over that of all light, which the amplitudes know.
    pub(super) own_light: f64,
    /// Whether patches of chlorophyll would look the same.
    pub(super) looks_like_chlorophyll: bool,
}

/// What the pattern says.
pub(super) struct PatternPosterior {
    /// The share of the region.
    pub(super) share: Mixture,
    /// The share of all red emission, of porphyrin and plant pigment.
    pub(super) red: Mixture,
    /// Probability that porphyrin is the same everywhere, and that it is patchy.
    pub(super) even: f64,
    pub(super) patchy: f64,
    /// Mean share of each block, and the probability that it is above [`SHARE_OF_MARK`].
    pub(super) blocks: Vec<[f64; 2]>,
    /// Mean factor on the variation from place to place.
    pub(super) place_factor: f64,
    /// Mean share of chlorophyll.
    pub(super) chlorophyll: f64,
}

/// Probabilities of the shares of the grid in a pattern, as a run of them.
struct Pattern {
    first: usize,
    probabilities: Vec<f64>,
}

/// Shares of blocks and the patterns in which they come.
struct Patterns {
    shares: Vec<f64>,
    /// Shares that the means of regions may have.
    means: Vec<f64>,
    patterns: Vec<Pattern>,
    /// Probabilities of the patchy ones, sixteen by sixteen, `[sixteen patterns][share]`.
    patchy: Vec<BandBlock>,
}

/// Number of the pattern without porphyrin; those with the same share everywhere follow.
const NONE: usize = 0;
/// Number of the first patchy pattern.
const FIRST_PATCHY: usize = 1 + MEANS;

static PATTERNS: LazyLock<Patterns> = LazyLock::new(Patterns::new);

impl Patterns {
    fn new() -> Self {
        let even_steps = |[low, high]: [f64; 2], count: usize| -> Vec<f64> {
            let ratio = f64::ln(high / low);
            (0..count).map(|i| low * (ratio * i as f64 / (count - 1) as f64).exp()).collect()
        };
        let means = even_steps(MEAN_RANGE, MEANS);
        let mut shares = vec![0.0];
        shares.extend(even_steps(SHARE_RANGE, SHARES));
        shares.extend(&means);
        shares.sort_by(f64::total_cmp);

        let place = |mean: &f64| shares.iter().position(|share| share == mean).unwrap_or_default();
        let even = std::iter::once(0).chain(means.iter().map(place));
        let mut patterns: Vec<Pattern> =
            even.map(|first| Pattern { first, probabilities: vec![1.0] }).collect();
        // Cells between the means of neighbors on the scale of logarithms; the outermost hold what lies beyond
        let logs: Vec<f64> = shares[1..].iter().map(|share| share.ln()).collect();
        for mean in &means {
            for [log_sd, empty] in PATCHES {
                let center = (mean / (1.0 - empty)).ln() - 0.5 * log_sd * log_sd;
                let below = |log: f64| 0.5 * erfc(-(log - center) / (log_sd * std::f64::consts::SQRT_2));
                let edges = logs.windows(2).map(|pair| below(0.5 * (pair[0] + pair[1]))).chain([1.0]);
                let mut last = 0.0;
                let mut probabilities = vec![empty];
                for edge in edges {
                    probabilities.push((1.0 - empty) * (edge - last));
                    last = edge;
                }
                patterns.push(Pattern { first: 0, probabilities });
            }
        }
        let sixteen = |patterns: &[Pattern], share: usize| {
            let mut block = BandBlock::ZERO;
            let probabilities = patterns.iter().map(|pattern| pattern.probabilities[share] as f32);
            block.0.iter_mut().zip(probabilities).for_each(|(out, probability)| *out = probability);
            block
        };
        let patchy = patterns[FIRST_PATCHY..]
            .chunks(BLOCK)
            .flat_map(|patterns| (0..shares.len()).map(|share| sixteen(patterns, share)))
            .collect();
        Self { shares, means, patterns, patchy }
    }

    /// Logarithm of the probability of each pattern beforehand, around a typical share.
    fn log_priors(&self, [typical, log_sd]: [f64; 2]) -> Vec<f64> {
        let of_mean = |mean: &f64| (-0.5 * ((mean / typical).ln() / log_sd).powi(2)).exp();
        let priors: Vec<f64> = self.means.iter().map(of_mean).collect();
        let total: f64 = priors.iter().sum();
        let third = f64::ln(1.0 / 3.0);
        let even = priors.iter().map(|prior| third + (prior / total).ln());
        let patchy = priors.iter().flat_map(|prior| {
            let log_prior = third + (prior / total / PATCHES.len() as f64).ln();
            [log_prior; PATCHES.len()]
        });
        std::iter::once(third).chain(even).chain(patchy).collect()
    }
}

/// Colors that the bulk of a person may have, in even steps, with the logarithms of their likelihoods: `of_share` gives that of a share of
/// porphyrin in the region, whose mean amplitude and variances of a block by places and by noise are known.
pub(super) fn bulks(
    mean: f64,
    [of_places, noise]: [f64; 2],
    independent: f64,
    of_share: impl Fn(f64) -> f64,
) -> Vec<[f64; 2]> {
    let scatter = |factor: f64| ((factor * factor * of_places + noise) / independent).sqrt();
    let [least, .., most] = PLACE_FACTORS;
    let from = mean + 3.0 * scatter(most);
    let to = (mean - LARGEST_SHARE) / (1.0 - LARGEST_SHARE);
    let log_likelihood = |bulk: f64| of_share(((mean - bulk) / (1.0 - bulk)).max(0.0));
    // From the reddest on, as far as any is likely
    let coarse = (from - to) / MOST_BULKS;
    let steps = || (0..=MOST_BULKS as usize).map(|step| from - coarse * step as f64);
    let best = steps().map(log_likelihood).fold(f64::NEG_INFINITY, f64::max);
    let last = steps().rfind(|bulk| log_likelihood(*bulk) > best - NEGLIGIBLE).unwrap_or(to).min(mean);
    let count = ((from - last) / (BULK_STEP * scatter(least))).ceil().clamp(8.0, MOST_BULKS);
    let step = (from - last) / count;
    let node = |number: usize| from - step * number as f64;
    (0..=count as usize).map(node).map(|bulk| [bulk, log_likelihood(bulk)]).collect()
}

/// Share of chlorophyll in all light for an amount `factor` times the typical one, which is `typical` of all other light.
pub(super) fn share_of_chlorophyll(factor: f64, typical: f64) -> f64 {
    factor * typical / (1.0 + factor * typical)
}

/// One choice of the unknowns that all blocks share.
#[derive(Clone, Copy)]
struct Cell {
    log_prior: f64,
    place_factor: f64,
    chlorophyll: f64,
    /// Number of its [`RedPattern::precisions`].
    spread: usize,
    /// Amplitude of the person's tissue without porphyrin and chlorophyll, and with chlorophyll.
    tissue: f64,
    bulk: f64,
}

/// Cells that count, with the probability of each pattern in them, 0 of those that are negligible.
struct Weighed {
    cells: Vec<(Cell, Vec<f64>)>,
    /// One over the standard deviation of the amplitude of each block, `[spread][block]`.
    precisions: Vec<Vec<f64>>,
}

/// What the patterns of a cell say.
struct OfCell {
    /// Number and probability of a pattern, and the region's mean share with its variance.
    terms: Vec<(usize, f64, [f64; 2])>,
    /// Mean share of each block and the probability of a mark, times the probability of the cell.
    blocks: Vec<[f64; 2]>,
}

impl RedPattern {
    /// The posterior; `None` without blocks.
    pub(super) fn posterior(&self) -> Option<PatternPosterior> {
        let weighed = self.weighed()?;
        let of_cell = |(cell, weights): &(Cell, Vec<f64>)| {
            let precisions = &weighed.precisions[cell.spread];
            (*cell, Simd::detect().run(Details { pattern: self, cell, precisions, weights }))
        };
        let cells: Vec<(Cell, OfCell)> = weighed.cells.par_iter().map(of_cell).collect();
        Some(self.mix(&cells))
    }

    /// Probability that there is no porphyrin, at a part of the cost of all that the pattern says; `None` without blocks.
    pub(super) fn probability_of_none(&self) -> Option<f64> {
        Some(self.weighed()?.cells.iter().map(|(_, weights)| weights[NONE]).sum())
    }

    /// Weighs every pattern in every cell that no bound excludes.
    fn weighed(&self) -> Option<Weighed> {
        if self.amplitudes.is_empty() {
            return None;
        }
        let log_priors = PATTERNS.log_priors(self.typical_share);
        let (cells, precisions) = self.cells();
        let largest = |values: &[f64]| values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let bounds: Vec<f64> = cells.iter().map(|cell| self.bound(cell, &precisions[cell.spread])).collect();
        let evidence = |cell: &Cell| {
            let precisions = &precisions[cell.spread];
            let mut logs = Simd::detect().run(Evidence { pattern: self, cell, precisions });
            let independent = self.independent();
            let prior = |(log, prior): (&mut f64, &f64)| *log = independent * *log + cell.log_prior + prior;
            logs.iter_mut().zip(&log_priors).for_each(prior);
            logs
        };
        let promising = (0..cells.len()).max_by(|a, b| bounds[*a].total_cmp(&bounds[*b]))?;
        let reached = largest(&evidence(&cells[promising]));
        let is_left = |(_, bound): &(&Cell, &f64)| **bound > reached - NEGLIGIBLE;
        let cells: Vec<Cell> = cells.iter().zip(&bounds).filter(is_left).map(|(cell, _)| *cell).collect();
        let mut evidence: Vec<Vec<f64>> = cells.par_iter().map(evidence).collect();
        let best = evidence.iter().map(|logs| largest(logs)).fold(f64::NEG_INFINITY, f64::max);
        if !best.is_finite() {
            return None;
        }
        let weight = |log: f64| if log > best - NEGLIGIBLE { (log - best).exp() } else { 0.0 };
        evidence.iter_mut().flatten().for_each(|log| *log = weight(*log));
        let total: f64 = evidence.iter().flatten().sum();
        evidence.iter_mut().flatten().for_each(|weight| *weight /= total);
        let counts = |(_, weights): &(Cell, Vec<f64>)| weights.iter().any(|weight| *weight > 0.0);
        Some(Weighed { cells: cells.into_iter().zip(evidence).filter(counts).collect(), precisions })
    }

    /// All cells, and one over the standard deviation of the amplitude of each block, `[spread][block]`.
    fn cells(&self) -> (Vec<Cell>, Vec<Vec<f64>>) {
        let log_normal = |factor: f64, log_sd: f64| -0.5 * (factor.ln() / log_sd).powi(2);
        let normalized = |logs: Vec<f64>| -> Vec<f64> {
            let best = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let total: f64 = logs.iter().map(|log| (log - best).exp()).sum();
            logs.iter().map(|log| log - best - total.ln()).collect()
        };
        let places = normalized(PLACE_FACTORS.iter().map(|f| log_normal(*f, PLACE_FACTOR_LOG_SD)).collect());
        let (amounts, of_amounts) = match self.chlorophyll {
            Some([typical, _]) => (
                CHLOROPHYLL.iter().map(|k| share_of_chlorophyll(*k, typical)).collect(),
                normalized(CHLOROPHYLL.iter().map(|k| log_normal(*k, CHLOROPHYLL_LOG_SD)).collect())
                    .into_iter()
                    .zip(&self.chlorophyll_evidence)
                    .map(|(prior, evidence)| prior + evidence)
                    .collect(),
            ),
            None => (vec![0.0], vec![0.0]),
        };
        let amplitude = self.amplitude_of_chlorophyll();
        // How much of a bulk is chlorophyll
        let own = |bulk: f64, amount: f64| (bulk - amplitude * amount) / (1.0 - amplitude * amount);
        let of_bulk = |&[bulk, _]: &[f64; 2]| {
            let of_amount = |(&amount, prior): (&f64, &f64)| {
                let off = own(bulk, amount) - self.bulk_mean[0] - self.bulk_mean[1] * amount;
                prior - 0.5 * off * off / self.bulk_variance - (1.0 - amplitude * amount).ln()
            };
            normalized(amounts.iter().zip(&of_amounts).map(of_amount).collect())
        };
        let of_bulks: Vec<Vec<f64>> = self.bulk.iter().map(of_bulk).collect();
        let (mut cells, mut precisions, mut narrowest) = (Vec::new(), Vec::new(), None);
        let noise = self.noise.iter().sum::<f64>() / self.noise.len().max(1) as f64;
        for ((place_factor, place), evidence) in PLACE_FACTORS.iter().zip(&places).zip(&self.place_evidence) {
            for (number, &chlorophyll) in amounts.iter().enumerate() {
                let shared = place_factor.powi(2) * self.place_variance
                    + (PLACES_OVER_PEOPLE * amplitude * chlorophyll).powi(2);
                precisions.push(self.noise.iter().map(|noise| (shared + noise).sqrt().recip()).collect());
                // Where blocks scatter more, the likelihood is wider
                let least = *narrowest.get_or_insert(shared + noise);
                let stride = ((shared + noise) / least).sqrt().clamp(1.0, MOST_STRIDE) as usize;
                let of_stride = (stride as f64).ln();
                for (&[bulk, of_mean], of_amounts) in self.bulk.iter().zip(&of_bulks).step_by(stride) {
                    cells.push(Cell {
                        log_prior: place + evidence + of_mean + of_amounts[number] + of_stride,
                        place_factor: *place_factor,
                        chlorophyll,
                        spread: precisions.len() - 1,
                        tissue: own(bulk, chlorophyll),
                        bulk,
                    });
                }
            }
        }
        (cells, precisions)
    }

    /// Amplitude of chlorophyll alone.
    fn amplitude_of_chlorophyll(&self) -> f64 {
        self.chlorophyll.map_or(0.0, |[_, amplitude]| amplitude)
    }

    /// Likelihood of each share in a block, up to a factor that all cells have.
    #[inline(always)]
    fn likelihood(&self, cell: &Cell, precision: f64, block: usize, out: &mut [f64]) {
        let (from, to) = (self.amplitudes[block] - cell.bulk, 1.0 - cell.bulk);
        for (out, share) in out.iter_mut().zip(&PATTERNS.shares) {
            *out = bell((from - share * to) * precision) * precision;
        }
    }

    /// A bound on the logarithm of the weight of all patterns in a cell: each block has its most probable share.
    fn bound(&self, cell: &Cell, precisions: &[f64]) -> f64 {
        let of_block = |(amplitude, precision): (&f64, &f64)| {
            (bell(((amplitude - cell.bulk) * precision).min(0.0)) * precision).max(LEAST_LIKELIHOOD)
        };
        let of_some = |(amplitudes, precisions): (&[f64], &[f64])| -> f64 {
            amplitudes.iter().zip(precisions).map(of_block).product::<f64>().ln()
        };
        let sum: f64 =
            self.amplitudes.chunks(MULTIPLIED).zip(precisions.chunks(MULTIPLIED)).map(of_some).sum();
        self.independent() * sum + cell.log_prior
    }

    /// Share of the number of blocks that is independent.
    fn independent(&self) -> f64 {
        (INDEPENDENT_BLOCKS / self.amplitudes.len() as f64).min(1.0)
    }

    /// Adds up all cells.
    fn mix(&self, cells: &[(Cell, OfCell)]) -> PatternPosterior {
        let mut found = PatternPosterior {
            share: Mixture { none: 0.0, terms: Vec::new() },
            red: Mixture { none: 0.0, terms: Vec::new() },
            even: 0.0,
            patchy: 0.0,
            blocks: vec![[0.0; 2]; self.amplitudes.len()],
            place_factor: 0.0,
            chlorophyll: 0.0,
        };
        for (cell, of_cell) in cells {
            let [red, variance] = self.red_share(cell);
            for &(pattern, weight, share) in &of_cell.terms {
                // Porphyrin is red light
                let red = if red > share[0] { [red, variance] } else { share };
                found.red.terms.push(self.log_odds(weight, red));
                if pattern == NONE {
                    found.share.none += weight;
                } else {
                    *(if pattern <= MEANS { &mut found.even } else { &mut found.patchy }) += weight;
                    found.share.terms.push(self.log_odds(weight, share));
                }
                found.place_factor += weight * cell.place_factor;
                found.chlorophyll += weight * cell.chlorophyll;
            }
            for (sum, block) in found.blocks.iter_mut().zip(&of_cell.blocks) {
                sum[0] += block[0];
                sum[1] += block[1];
            }
        }
        found
    }

    /// The share of all red emission in a cell and its variance: how far the mean amplitude lies from the bulk without either.
    fn red_share(&self, cell: &Cell) -> [f64; 2] {
        let mean = |of: &dyn Fn(usize) -> f64| -> f64 {
            self.weights.iter().enumerate().map(|(block, weight)| weight * of(block)).sum()
        };
        let share = ((mean(&|block| self.amplitudes[block]) - cell.tissue) / (1.0 - cell.tissue)).max(1e-4);
        let blocks = self.amplitudes.len() as f64;
        let places = cell.place_factor.powi(2) * self.place_variance / (blocks * self.independent());
        let noise = mean(&|block| self.weights[block] * self.noise[block]);
        [share, (places + noise) / (1.0 - cell.tissue).powi(2) + self.scale_variance * share * share]
    }

    /// A share of all light with its variance as a share of the region's own light: weight, mean and standard deviation of the log
    /// odds.
    fn log_odds(&self, weight: f64, [mean, variance]: [f64; 2]) -> [f64; 3] {
        let share = (self.own_light * mean).clamp(1e-9, 1.0 - 1e-9);
        // The logarithm of a share that is log-normal with these moments, turned into odds at its median
        let log_variance = (1.0 + variance / (mean * mean)).ln();
        let median = (share * (-0.5 * log_variance).exp()).clamp(1e-9, 1.0 - 1e-9);
        [weight, (median / (1.0 - median)).ln(), (log_variance.sqrt() / (1.0 - median)).max(1e-6)]
    }
}

/// Logarithm of the likelihood of all blocks under each pattern in a cell, compiled for each instruction set.
struct Evidence<'a> {
    pattern: &'a RedPattern,
    cell: &'a Cell,
    precisions: &'a [f64],
}

impl Work for Evidence<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Vec<f64> {
        let Self { pattern, cell, precisions } = self;
        let Patterns { patterns, patchy: of_shares, .. } = &*PATTERNS;
        let count = patterns.len();
        let (mut sums, mut products) = (vec![0.0; count], vec![1.0; count]);
        let mut likelihood = vec![0.0; PATTERNS.shares.len()];
        let mut narrow = vec![0.0; likelihood.len()];
        let mut of_patchy = vec![BandBlock::ZERO; (count - FIRST_PATCHY).div_ceil(BLOCK)];
        for (block, precision) in precisions.iter().enumerate() {
            // Sum the likelihoods of the shares that each pattern has
            pattern.likelihood(cell, *precision, block, &mut likelihood);
            narrow.iter_mut().zip(&likelihood).for_each(|(narrow, value)| *narrow = *value as f32);
            bands::clear(lanes, &mut of_patchy);
            bands::add_combination(lanes, &narrow, of_shares, &mut of_patchy);
            let (alike, patchy) = products.split_at_mut(FIRST_PATCHY);
            for (product, pattern) in alike.iter_mut().zip(patterns) {
                *product *= likelihood[pattern.first].max(LEAST_LIKELIHOOD);
            }
            for (products, sums) in patchy.chunks_mut(BLOCK).zip(&of_patchy) {
                for (product, sum) in products.iter_mut().zip(&sums.0) {
                    *product *= f64::from(*sum).max(LEAST_LIKELIHOOD);
                }
            }
            if (block + 1) % MULTIPLIED == 0 {
                sums.iter_mut().zip(&mut products).for_each(|(sum, product)| *sum += take_power(product));
            }
        }
        let ln = |(sum, product): (f64, f64)| sum * std::f64::consts::LN_2 + product.ln();
        sums.into_iter().zip(products).map(ln).collect()
    }
}

/// What the patterns of a cell that count say, compiled for each instruction set.
struct Details<'a> {
    pattern: &'a RedPattern,
    cell: &'a Cell,
    precisions: &'a [f64],
    weights: &'a [f64],
}

/// Sums over the shares of a block in sixteen patterns: of the likelihood, of it times share and share squared, and where marked.
type Moments = [BandBlock; 4];

impl Work for Details<'_> {
    type Output = OfCell;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> OfCell {
        let Self { pattern, cell, precisions, weights } = self;
        let Patterns { shares, patterns, patchy, .. } = &*PATTERNS;
        let independent = precisions.len() as f64 * pattern.independent();
        let (mut terms, mut blocks) = (Vec::new(), vec![[0.0; 2]; precisions.len()]);
        let mut push = |number: usize, [mean, variance]: [f64; 2]| {
            let of_scale = pattern.scale_variance * mean * mean;
            terms.push((number, weights[number], [mean, variance / independent + of_scale]));
        };
        // The same share everywhere
        let mut of_all = [0.0; 2];
        for number in (NONE..FIRST_PATCHY).filter(|number| weights[*number] > 0.0) {
            let share = shares[patterns[number].first];
            push(number, [share, 0.0]);
            of_all[0] += weights[number] * (pattern.own_light * share).min(1.0);
            of_all[1] += if share > SHARE_OF_MARK { weights[number] } else { 0.0 };
        }
        blocks.fill(of_all);
        // Patchy, sixteen at a time
        let sixteens = weights[FIRST_PATCHY..].chunks(BLOCK).zip(patchy.chunks(shares.len())).enumerate();
        let mut sixteens: Vec<Sixteen<'_>> = sixteens
            .filter(|(_, (weights, _))| weights.iter().any(|weight| *weight > 0.0))
            .map(|(number, (weights, probabilities))| Sixteen {
                first: FIRST_PATCHY + BLOCK * number,
                weights,
                probabilities,
                of_region: [[0.0; 2]; BLOCK],
            })
            .collect();
        let mut likelihood = vec![0.0; shares.len()];
        let mut factors = vec![[0.0; 4]; shares.len()];
        for (block, precision) in precisions.iter().enumerate() {
            pattern.likelihood(cell, *precision, block, &mut likelihood);
            for ((factors, likelihood), share) in factors.iter_mut().zip(&likelihood).zip(shares) {
                *factors = factors_of(*likelihood, *share);
            }
            let light = [pattern.weights[block], pattern.own_light];
            for sixteen in &mut sixteens {
                sixteen.add(&moments(lanes, sixteen.probabilities, &factors), light, &mut blocks[block]);
            }
        }
        for sixteen in &sixteens {
            for (lane, of_region) in sixteen.of_region.iter().enumerate() {
                if sixteen.weights.get(lane).is_some_and(|weight| *weight > 0.0) {
                    push(sixteen.first + lane, *of_region);
                }
            }
        }
        OfCell { terms, blocks }
    }
}

/// Sixteen patchy patterns of a cell.
struct Sixteen<'a> {
    /// Number of the first, and the probabilities of those that there are.
    first: usize,
    weights: &'a [f64],
    /// Of each share.
    probabilities: &'a [BandBlock],
    /// Mean share of the region and its variance, added up over blocks.
    of_region: [[f64; 2]; BLOCK],
}

impl Sixteen<'_> {
    /// Adds a block with its share of the region's light and the factor for its own light.
    #[inline(always)]
    fn add(&mut self, moments: &Moments, [light, own_light]: [f64; 2], block: &mut [f64; 2]) {
        for (lane, weight) in self.weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
            let [total, of_share, of_square, marked] = [0, 1, 2, 3].map(|i| f64::from(moments[i].0[lane]));
            let per = total.max(f64::MIN_POSITIVE).recip();
            let [share, square] = [of_share * per, of_square * per];
            self.of_region[lane][0] += light * share;
            self.of_region[lane][1] += light * (square - share * share).max(0.0);
            block[0] += weight * (own_light * share).min(1.0);
            block[1] += weight * marked * per;
        }
    }
}

/// Of sixteen patterns with these probabilities of the shares.
#[inline(always)]
fn moments<L: Lanes>(lanes: L, probabilities: &[BandBlock], factors: &[[f32; 4]]) -> Moments {
    let mut sums = [lanes.splat(0.0); 4];
    for (probabilities, factors) in probabilities.iter().zip(factors) {
        let probabilities = lanes.load(probabilities);
        for (sum, factor) in sums.iter_mut().zip(factors) {
            *sum = lanes.add(*sum, lanes.mul(lanes.splat(*factor), probabilities));
        }
    }
    let mut moments = [BandBlock::ZERO; 4];
    moments.iter_mut().zip(sums).for_each(|(moments, sums)| lanes.store(sums, moments));
    moments
}

/// What the likelihood of a share is summed with: 1, the share, its square, and whether it marks a block.
#[inline(always)]
fn factors_of(likelihood: f64, share: f64) -> [f32; 4] {
    let marked = if share > SHARE_OF_MARK { likelihood } else { 0.0 };
    [likelihood, likelihood * share, likelihood * share * share, marked].map(|factor| factor as f32)
}

/// Takes the power of two out of a number above 0, which is left between 1 and 2.
#[inline(always)]
fn take_power(number: &mut f64) -> f64 {
    const OF_ONE: u64 = 1023 << 52;
    let bits = number.to_bits();
    *number = f64::from_bits((bits & ((1 << 52) - 1)) | OF_ONE);
    f64::from((bits >> 52) as i32 - 1023)
}

/// Density of an error in its standard deviations up to a factor: normal, and wider for blocks that nobody foresaw.
#[inline(always)]
fn bell(x: f64) -> f64 {
    // The narrow one is the ninth power of the wide one
    let wide = exp_below_0(-0.5 * (x.abs().min(FARTHEST) / OUTLIER_WIDTH).powi(2));
    let third = wide * wide * wide;
    let density = (1.0 - OUTLIERS) * (third * third * third) + OUTLIERS / OUTLIER_WIDTH * wide;
    if x.abs() > FARTHEST { 0.0 } else { density }
}

/// `exp(x)` for -700 to 0 to 1e-14, without a call or a branch, so that several are computed at once.
#[inline(always)]
fn exp_below_0(x: f64) -> f64 {
    /// Added to a number it leaves the nearest whole one in the last bits.
    const ROUNDING: f64 = 6_755_399_441_055_744.0;
    const TERMS: [f64; 12] = [
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ];
    let powers = x * std::f64::consts::LOG2_E + ROUNDING;
    let rest = x - (powers - ROUNDING) * std::f64::consts::LN_2;
    let of_rest = TERMS.iter().fold(0.0, |sum, term| sum * rest + term);
    of_rest * f64::from_bits((powers.to_bits().wrapping_add(1023)) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bulks of people who are normally distributed and hold any of the amounts of chlorophyll.
    fn normal_bulks([typical, amplitude]: [f64; 2], variance: f64) -> Vec<[f64; 2]> {
        let bulk = |node: i32| {
            let bulk = 0.003 * f64::from(node) - 0.12;
            let of_amount = |factor: &f64| {
                let share = amplitude * share_of_chlorophyll(*factor, typical);
                let own = (bulk - share) / (1.0 - share);
                let prior = (factor.ln() / CHLOROPHYLL_LOG_SD).powi(2);
                (-0.5 * (prior + own * own / variance)).exp() / (1.0 - share)
            };
            [bulk, CHLOROPHYLL.iter().map(of_amount).sum::<f64>().ln()]
        };
        (0..=133).map(bulk).collect()
    }

    fn pattern(amplitudes: Vec<f64>) -> RedPattern {
        let blocks = amplitudes.len();
        RedPattern {
            bulk: normal_bulks([0.014, 0.95], 0.039_f64.powi(2)),
            amplitudes,
            noise: vec![0.003_f64.powi(2); blocks],
            weights: vec![1.0 / blocks as f64; blocks],
            place_variance: 0.0093_f64.powi(2),
            place_evidence: [0.0; PLACE_FACTORS.len()],
            chlorophyll_evidence: [0.0; CHLOROPHYLL.len()],
            bulk_mean: [0.0, 0.0],
            scale_variance: 0.06_f64.powi(2),
            bulk_variance: 0.039_f64.powi(2),
            chlorophyll: Some([0.014, 0.95]),
            typical_share: [0.0153, 1.3],
            own_light: 1.085,
            looks_like_chlorophyll: true,
        }
    }

    fn blocks(parts: &[(usize, f64)]) -> Vec<f64> {
        parts.iter().flat_map(|(count, value)| vec![*value; *count]).collect()
    }

    /// A second program, in Python, gave these: probability of none, median, interval, mean share of the first and the last block.
    #[test]
    fn amplitudes_give_the_numbers_of_another_program() {
        let even_steps = (0..40).map(|i| 0.15 * f64::from(i) / 39.0).collect();
        let cases = [
            (blocks(&[(40, 0.015)]), 0.5216, 0.0, [0.0, 0.0382], [0.0074, 0.0074]),
            (blocks(&[(40, 0.12)]), 0.0914, 0.0730, [0.0, 0.1459], [0.0680, 0.0680]),
            (blocks(&[(20, 0.015), (20, 0.075)]), 0.1453, 0.0321, [0.0, 0.0631], [0.0078, 0.0450]),
            (blocks(&[(20, 0.015), (20, 0.115)]), 0.00095, 0.0562, [0.0441, 0.0911], [0.0067, 0.1031]),
            (blocks(&[(36, 0.015), (4, 0.115)]), 0.0189, 0.0154, [0.0076, 0.0234], [0.0046, 0.1021]),
            (blocks(&[(36, 0.015), (4, 0.315)]), 0.0, 0.0412, [0.0348, 0.0524], [0.0064, 0.3274]),
            (even_steps, 0.0579, 0.0583, [0.0, 0.1051], [0.0135, 0.1093]),
        ];
        for (amplitudes, none, median, interval, [first, last]) in cases {
            let found = pattern(amplitudes).posterior().unwrap();
            let near = |name: &str, found: f64, wanted: f64, tolerance: f64| {
                assert!((found - wanted).abs() <= tolerance, "{name} {found} {wanted}");
            };
            // That program has a third of the steps of the bulk
            near("none", found.share.none, none, 0.1 * none + 2e-4);
            near("median", found.share.quantile(0.5), median, 0.03 * median + 1e-4);
            let found_interval = found.share.interval();
            near("low", found_interval[0], interval[0], 0.08 * interval[0]);
            near("high", found_interval[1], interval[1], 0.02 * interval[1]);
            // Shares of blocks are of the region's own light here
            near("first", found.blocks[0][0], 1.085 * first, 0.05 * first);
            near("last", found.blocks[found.blocks.len() - 1][0], 1.085 * last, 0.03 * last);
        }
    }

    /// The same porphyrin everywhere can't be told from another person's bulk: nothing is won by blocks.
    #[test]
    fn even_light_proves_nothing_and_patches_do() {
        for share in [0.0, 0.05, 0.1] {
            assert_eq!(pattern(vec![share; 50]).posterior().unwrap().share.interval()[0], 0.0, "{share}");
        }
        let patchy = pattern(blocks(&[(30, 0.0), (20, 0.1)])).posterior().unwrap();
        assert!(patchy.share.interval()[0] > 0.02 && patchy.patchy > 0.95, "{:?}", patchy.share.interval());
        assert!(patchy.blocks[0][1] < 0.1 && patchy.blocks[49][1] > 0.95);
    }
}
