//! Patterns in which porphyrin comes, and how likely each makes a block, in tables.
//!
//! A block whose amplitude lies `x = (a - beta) / (1 - beta)` from the bulk, per share of 1, with the standard deviation `sigma` on that scale,
//! has under pattern `h` the likelihood `sum_s pi_h(s) bell((x - s) / sigma) / sigma`. That is a smooth function of `x` and of the logarithm of
//! `sigma` alone, the same for all regions of all people: it is computed where it is first asked for, and kept. Between nodes it is
//! interpolated, in `x` by polynomials of third degree, in the other linearly: the logarithm is low by `(ln 1.07)² / 4` of the squared
//! distance in standard deviations at most, 0.001 for a usual block.

use std::sync::{LazyLock, OnceLock};

use fluorspar_accel::bands::{BLOCK, BandBlock};
use fluorspar_accel::{Lanes, Simd, Work};
use statrs::function::erf::erfc;

/// Mean shares of the region on the grid, and where they end.
pub(super) const MEANS: usize = 18;
const MEAN_RANGE: [f64; 2] = [0.002, 0.45];
/// Shares of blocks on the grid besides none and the means, and where they end.
const SHARES: usize = 22;
const SHARE_RANGE: [f64; 2] = [0.0025, 0.75];
/// Patchy porphyrin: standard deviation of the logarithm, and probability that a block holds none. \[assumed\]
const PATCHES: [[f64; 2]; 4] = [[0.6, 0.0], [1.0, 0.0], [1.5, 0.0], [0.9, 0.4]];
/// Probability of blocks that nobody foresaw, and how much wider they scatter. \[assumed\]
const OUTLIERS: f64 = 0.02;
const OUTLIER_WIDTH: f64 = 3.0;
/// Standard deviations beyond which no block lies: there the density counts as [`LEAST_LIKELIHOOD`].
const FARTHEST: f64 = 36.0;
/// The least likelihood of a block, over its greatest.
pub(super) const LEAST_LIKELIHOOD: f64 = 1e-30;
/// Share from which on a block counts as one with porphyrin.
pub(super) const SHARE_OF_MARK: f64 = 0.02;

/// Shares of blocks and the patterns in which they come.
pub(super) struct Patterns {
    shares: Vec<f64>,
    /// Shares that the means of regions may have.
    means: Vec<f64>,
    /// Probability of each share in each pattern, sixteen patterns at a time, `[share]`.
    probabilities: Vec<OfPatterns>,
}

/// Number of the pattern without porphyrin; those with the same share everywhere follow.
pub(super) const NONE: usize = 0;
/// Number of the first patchy pattern.
pub(super) const FIRST_PATCHY: usize = 1 + MEANS;
/// Patterns in all, and how many sixteens they fill.
pub(super) const COUNT: usize = FIRST_PATCHY + MEANS * PATCHES.len();
pub(super) const SIXTEENS: usize = COUNT.div_ceil(BLOCK);

pub(super) static PATTERNS: LazyLock<Patterns> = LazyLock::new(Patterns::new);

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
        let mut probabilities = vec![[BandBlock::ZERO; SIXTEENS]; shares.len()];
        let mut set = |share: usize, pattern: usize, probability: f64| {
            probabilities[share][pattern / BLOCK].0[pattern % BLOCK] = probability as f32;
        };
        even.enumerate().for_each(|(pattern, share)| set(share, pattern, 1.0));
        // Cells between the means of neighbors on the scale of logarithms; the outermost hold what lies beyond
        let logs: Vec<f64> = shares[1..].iter().map(|share| share.ln()).collect();
        let patchy = means.iter().flat_map(|mean| PATCHES.map(|patches| (mean, patches)));
        for (pattern, (mean, [log_sd, empty])) in (FIRST_PATCHY..).zip(patchy) {
            let center = (mean / (1.0 - empty)).ln() - 0.5 * log_sd * log_sd;
            let below = |log: f64| 0.5 * erfc(-(log - center) / (log_sd * std::f64::consts::SQRT_2));
            let edges = logs.windows(2).map(|pair| below(0.5 * (pair[0] + pair[1]))).chain([1.0]);
            let mut last = 0.0;
            set(0, pattern, empty);
            for (share, edge) in (1..).zip(edges) {
                set(share, pattern, (1.0 - empty) * (edge - last));
                last = edge;
            }
        }
        Self { shares, means, probabilities }
    }

    /// Logarithm of the probability of each pattern beforehand, around a typical share.
    pub(super) fn log_priors(&self, [typical, log_sd]: [f64; 2]) -> Vec<f64> {
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

/// Numbers of all patterns.
pub(super) type OfPatterns = [BandBlock; SIXTEENS];

/// What a block says of each pattern at nodes that lie side by side.
struct Nodes {
    /// Logarithm of the likelihood, without the factor `1 / sigma`.
    logs: Vec<OfPatterns>,
    /// Mean of the share and its variance, and the probability of a mark.
    of_share: Vec<[OfPatterns; 3]>,
}

/// Widths of tables: each is so many times the one before, from the least on.
const WIDTH_RATIO: f64 = 1.07;
const LEAST_WIDTH: f64 = 1e-4;
const WIDTHS: usize = 140;
/// Nodes in one width.
const NODES_PER_WIDTH: f64 = 3.0;
/// Nodes between which a polynomial leads, and how many lie side by side in the memory: the last are the first of the next ones.
pub(super) const STENCIL: usize = 4;
const SIDE_BY_SIDE: usize = 16;
const STEPS: usize = SIDE_BY_SIDE + 1 - STENCIL;

/// Tables of one width; what is not yet asked for is empty.
struct Table {
    width: f64,
    nodes: Vec<OnceLock<Nodes>>,
}

static TABLES: LazyLock<Vec<Table>> = LazyLock::new(|| (0..WIDTHS).map(Table::new).collect());

impl Table {
    fn new(number: usize) -> Self {
        let width = LEAST_WIDTH * WIDTH_RATIO.powi(number as i32);
        let reach = SHARE_RANGE[1] / width + 2.0 * FARTHEST;
        let parts = (NODES_PER_WIDTH * reach) as usize / STEPS + 1;
        Self { width, nodes: (0..parts).map(|_| OnceLock::new()).collect() }
    }

    /// What lies around `x`, with a share of the weight of the polynomial; the ends beyond the ends.
    #[inline]
    fn around(&self, x: f64, share: f64) -> Around<'_> {
        let place = NODES_PER_WIDTH * (x / self.width + FARTHEST);
        let place = place.clamp(1.0, (self.nodes.len() * STEPS) as f64 - 1e-6);
        let (step, t) = (place as usize - 1, place.fract());
        let nodes = self.nodes[step / STEPS].get_or_init(|| self.part(step / STEPS));
        let range = step % STEPS..step % STEPS + STENCIL;
        let weights = [
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0,
            (t + 1.0) * t * (t - 1.0) / 6.0,
        ];
        let weights = weights.map(|weight| (share * weight) as f32);
        Around { logs: &nodes.logs[range.clone()], of_share: &nodes.of_share[range], weights }
    }

    /// Some nodes that lie side by side.
    #[cold]
    fn part(&self, part: usize) -> Nodes {
        let node = |number: usize| {
            let x = self.width * ((part * STEPS + number) as f64 / NODES_PER_WIDTH - FARTHEST);
            Simd::detect().run(AtNode { x, width: self.width })
        };
        let (logs, of_share) = (0..SIDE_BY_SIDE).map(node).unzip();
        Nodes { logs, of_share }
    }
}

/// Nodes of one width around a block, with their weights.
pub(super) struct Around<'a> {
    pub(super) logs: &'a [OfPatterns],
    pub(super) of_share: &'a [[OfPatterns; 3]],
    pub(super) weights: [f32; STENCIL],
}

/// Nodes around a block that lies at `x` with a standard deviation, which is cut at those of the tables.
#[inline]
pub(super) fn around(x: f64, sd: f64) -> [Around<'static>; 2] {
    let place = (sd / LEAST_WIDTH).ln() / WIDTH_RATIO.ln();
    let place = place.clamp(0.0, (WIDTHS - 1) as f64 - 1e-6);
    let (number, share) = (place as usize, place.fract());
    [TABLES[number].around(x, 1.0 - share), TABLES[number + 1].around(x, share)]
}

/// Computes a node, compiled for each instruction set.
struct AtNode {
    x: f64,
    width: f64,
}

impl Work for AtNode {
    type Output = (OfPatterns, [OfPatterns; 3]);

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Self::Output {
        let Patterns { shares, probabilities, .. } = &*PATTERNS;
        let mut sums = [[lanes.splat(0.0); SIXTEENS]; 4];
        for (share, probabilities) in shares.iter().zip(probabilities) {
            let likelihood = bell((self.x - share) / self.width);
            let marked = if *share > SHARE_OF_MARK { likelihood } else { 0.0 };
            let factors = [likelihood, likelihood * share, likelihood * share * share, marked];
            for (sums, factor) in sums.iter_mut().zip(factors) {
                let factor = lanes.splat(factor as f32);
                for (sum, probabilities) in sums.iter_mut().zip(probabilities) {
                    *sum = lanes.add(*sum, lanes.mul(factor, lanes.load(probabilities)));
                }
            }
        }
        let (mut logs, mut of_shares) = ([BandBlock::ZERO; SIXTEENS], [[BandBlock::ZERO; SIXTEENS]; 3]);
        for sixteen in 0..SIXTEENS {
            let mut of = [BandBlock::ZERO; 4];
            of.iter_mut().zip(sums).for_each(|(of, sums)| lanes.store(sums[sixteen], of));
            for lane in 0..BLOCK {
                let [total, share, square, marked] = [0, 1, 2, 3].map(|i| f64::from(of[i].0[lane]));
                let per = total.max(f64::MIN_POSITIVE).recip();
                let mean = share * per;
                logs[sixteen].0[lane] = total.max(LEAST_LIKELIHOOD).ln() as f32;
                let of_share = [mean, (square * per - mean * mean).max(0.0), marked * per];
                of_shares.iter_mut().zip(of_share).for_each(|(of, value)| of[sixteen].0[lane] = value as f32);
            }
        }
        (logs, of_shares)
    }
}

/// Density of an error in its standard deviations up to a factor: normal, and wider for blocks that nobody foresaw.
#[inline(always)]
pub(super) fn bell(x: f64) -> f64 {
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
