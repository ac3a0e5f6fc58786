//! Blocks of a region before a family of tissues: how red each is compared with what tissue of one person can be.
//!
//! The color of a block is the shares of its channels in their sum, which is linear in the share of the porphyrin: `z = bulk + s d`
//! with `d` from the mean bulk of people to the porphyrin alone. Weights `c` with `c' d = 1` that scatter least from place to place
//! give its amplitude `a = c' (z - mean)`; the rest `z - mean - a d` holds no porphyrin, and its mean over the blocks foretells where on
//! the red direction the bulk of the person lies.

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::light_family::{FamilySource, LightFamily, NuisanceGroup, UnitLight};
use super::pattern_table::SHARE_OF_MARK;
use super::red_pattern::{
    CHLOROPHYLL, INDEPENDENT_BLOCKS, PLACE_FACTORS, PLACES_OVER_PEOPLE, PatternPosterior, RedPattern, bulks,
    share_of_chlorophyll,
};
use super::share_posterior::{FamilyFit, covariance_of};
use crate::sampling::SampleStream;

/// Draws of people, and of places in one person.
const PEOPLE: u32 = 512;
const PLACES: u32 = 256;
/// Variation of the light of teeth and of indirect light from place to place, standard deviations of logarithms. \[assumed\]
const PLACES_OF_TEETH: f64 = 0.45;
const PLACES_OF_INDIRECT: f64 = 0.3;
/// The same of colors in further frames, whose lights stand elsewhere. \[assumed\]
const PLACES_OF_LAMPS: f64 = 0.01;
/// Share of a source at which its way from the bulk is taken: straight in the first frame, nearly so in others.
const TOWARD: f64 = 0.1;
/// People by whom amplitudes are scaled.
const SCALED: usize = 128;
/// How alike places are: correlation at no distance of two blocks, that at any distance, and the length over which it falls, as a share
/// of the side of a square of the region's size (8 mm of a tongue). \[assumed\]
const ALIKE: [f64; 3] = [0.9, 0.1, 0.23];
/// Fewest blocks that say anything about a pattern.
pub const LEAST_BLOCKS: usize = 8;
/// Share from which on blocks of which nine in ten hold as much say nothing that the mean of the region does not. Half a step between the even
/// shares of patterns, a factor of 1.38, moves the bulk there by 0.05, more than people scatter by (0.04): light between two of them would be
/// taken for another bulk.
const LARGEST_EVEN: f64 = 0.2;
/// Chlorophyll looks like porphyrin where this share of it moves the colors that porphyrin leaves alone by less than so many standard
/// deviations of a place. \[assumed\]
const LOOKS_ALIKE: [f64; 2] = [0.05, 2.0];
/// Share of marked blocks that may be false.
const FALSE_DISCOVERIES: f64 = 0.05;

/// Blocks that a region is cut into, about, and the least side of a block, pixels.
const BLOCKS: f64 = 50.0;
const LEAST_SIDE_PX: f64 = 4.0;

/// Side of the blocks of a region of some pixels, pixels.
#[must_use]
pub fn block_side_px(pixels: f64) -> usize {
    (pixels / BLOCKS).sqrt().round().max(LEAST_SIDE_PX) as usize
}

/// A block of a region, as measured in the frames of a family.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionBlock {
    /// Its first column and row, pixels of the frame.
    pub corner_px: [usize; 2],
    /// Pixels that count.
    pub pixels: usize,
    /// Mean electrons of each datum of a family.
    pub electrons: Vec<f64>,
    /// Their variances by the sensor's noise, or all numbers of its covariance.
    pub variance: Vec<f64>,
}

/// What the blocks of a region say of the porphyrin in each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlockShares {
    /// Side of a block, pixels of the frame.
    pub side_px: usize,
    /// The blocks.
    pub blocks: Vec<BlockShare>,
    /// Probability that the porphyrin is the same everywhere.
    pub probability_of_even: f64,
    /// Probability that it is patchy.
    pub probability_of_patchy: f64,
    /// How much more than usual the tissue varies from place to place: a factor on standard deviations.
    pub place_factor: f64,
    /// Mean share of the light of chlorophyll, by the prior of the tissue and by how the blocks scatter.
    pub chlorophyll: f64,
    /// Whether patches of plant pigment, as of food, would look the same to this camera.
    pub looks_like_chlorophyll: bool,
    /// Blocks that count as independent of each other.
    pub independent: f64,
}

/// A block and the porphyrin in it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlockShare {
    /// First column and row, pixels of the frame.
    pub corner_px: [usize; 2],
    /// Mean of the share of the porphyrin in its fluorescence.
    pub share: f64,
    /// Probability that the share is above 0.02.
    pub probability: f64,
    /// Whether it belongs to the blocks of which at most 5 % hold less (Bayesian false discovery rate; Guindani, Mueller and Zhang,
    /// J. R. Stat. Soc. B 71, 905, 2009).
    pub is_marked: bool,
}

impl BlockShares {
    pub(super) fn new(
        blocks: &[RegionBlock],
        side_px: usize,
        (pattern, found): (&RedPattern, &PatternPosterior),
    ) -> Self {
        // Mark the most probable while the mean of what is false among them stays low
        let mut order: Vec<usize> = (0..blocks.len()).collect();
        order.sort_by(|a, b| found.blocks[*b][1].total_cmp(&found.blocks[*a][1]).then(a.cmp(b)));
        let mut marked = vec![false; blocks.len()];
        let mut false_ones = 0.0;
        for (count, &block) in order.iter().enumerate() {
            false_ones += 1.0 - found.blocks[block][1];
            if false_ones > FALSE_DISCOVERIES * (count + 1) as f64 {
                break;
            }
            marked[block] = true;
        }
        let share = |((block, [share, probability]), is_marked): ((&RegionBlock, &[f64; 2]), bool)| {
            BlockShare { corner_px: block.corner_px, share: *share, probability: *probability, is_marked }
        };
        Self {
            side_px,
            blocks: blocks.iter().zip(&found.blocks).zip(marked).map(share).collect(),
            probability_of_even: found.even,
            probability_of_patchy: found.patchy,
            place_factor: found.place_factor,
            chlorophyll: found.chlorophyll,
            looks_like_chlorophyll: pattern.looks_like_chlorophyll,
            independent: INDEPENDENT_BLOCKS.min(blocks.len() as f64),
        }
    }

    /// Number of blocks that are marked.
    #[must_use]
    pub fn marked(&self) -> usize {
        self.blocks.iter().filter(|block| block.is_marked).count()
    }

    /// Least share from which on a block counts as one with porphyrin.
    pub const SHARE_OF_MARK: f64 = SHARE_OF_MARK;
}

/// Independent standard normal numbers, evenly distributed over the draws of a seed.
pub(super) fn normal_deviates(count: usize, seed: u64, draw: u32) -> Vec<f64> {
    let stream = SampleStream::new(seed, 0, draw);
    let pair = |[first, second]: [f32; 2]| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(second)).sin_cos();
        let radius = (-2.0 * (1.0 - f64::from(first)).ln()).sqrt();
        [radius * cos, radius * sin]
    };
    let set = |set: u32| {
        let [a, b, c, d] = stream.set_4d(set);
        [[a, b], [c, d]].into_iter().flat_map(pair)
    };
    (0..count.div_ceil(4) as u32).flat_map(set).take(count).collect()
}

/// Mean and covariance of vectors.
fn moments(vectors: &[DVector<f64>]) -> (DVector<f64>, DMatrix<f64>) {
    let len = vectors.first().map_or(0, DVector::len);
    let count = vectors.len().max(1) as f64;
    let mean = vectors.iter().fold(DVector::zeros(len), |sum, vector| sum + vector) / count;
    let mut covariance = DMatrix::zeros(len, len);
    for vector in vectors {
        let off = vector - &mean;
        covariance.ger(1.0 / count, &off, &off, 1.0);
    }
    (mean, covariance)
}

impl LightFamily {
    /// Electrons that count in the share.
    fn counted_electrons(&self, electrons: &[f64]) -> f64 {
        electrons.iter().zip(&self.counted).filter(|(_, counted)| **counted).map(|(e, _)| e).sum()
    }

    /// Whether a datum belongs to the sum by which another is divided in a color: of the first frame those that count in the share, so that
    /// the color is linear in it; of further frames all of the frame, whatever the brightness of its light.
    fn divides(&self, datum: usize, of: usize) -> bool {
        self.frame_of[datum] == self.frame_of[of] && (self.frame_of[of] > 0 || self.counted[datum])
    }

    /// The data that make a color: all but the last of each sum, which the others tell.
    fn color_data(&self) -> Vec<usize> {
        let data = 0..self.counted.len();
        let is_last = |of: usize| data.clone().rfind(|datum| self.divides(*datum, of)) == Some(of);
        data.clone().filter(|datum| !is_last(*datum)).collect()
    }

    /// Sum by which a datum is divided in a color.
    fn divisor(&self, electrons: &[f64], of: usize) -> f64 {
        electrons.iter().enumerate().filter(|(datum, _)| self.divides(*datum, of)).map(|(_, e)| e).sum()
    }

    /// The color of the electrons of all data; `None` where a frame has no light.
    fn color(&self, electrons: &[f64]) -> Option<DVector<f64>> {
        let of_datum = |&datum: &usize| {
            let total = self.divisor(electrons, datum);
            (total > 0.0).then(|| electrons[datum] / total)
        };
        let color: Vec<f64> = self.color_data().iter().map(of_datum).collect::<Option<_>>()?;
        Some(DVector::from_vec(color))
    }

    /// Tissues drawn from the family: people, and places in one of them.
    pub(super) fn drawn(&self) -> DrawnTissues {
        let (places, nuisances) = (self.of_places(), self.nuisances().len());
        let draw = |family: &Self, seed: u64, number: u32| {
            let drawn = normal_deviates(nuisances, seed, number);
            (family.unit_light(&drawn), drawn)
        };
        DrawnTissues {
            people: (0..PEOPLE).map(|number| draw(self, 1, number)).collect(),
            places: (0..PLACES).map(|number| draw(&places, 2, number)).collect(),
        }
    }

    /// Colors of drawn tissues without porphyrin.
    fn colors_of(&self, drawn: &[Drawn]) -> Vec<DVector<f64>> {
        let color = |(light, nuisances): &Drawn| self.color(&self.electrons_of(light, nuisances, 0.0));
        drawn.iter().filter_map(color).collect()
    }

    /// Sensor chromaticity `(r, g)` of tissues drawn from the family, without porphyrin, in the first frame; none where that has not the channels
    /// R, G and B.
    pub(super) fn drawn_chromaticities(&self, count: u32) -> Vec<[f64; 2]> {
        let nuisances = self.nuisances().len();
        let place = |name: &str| {
            let is_it = |(channel, &frame): (&String, &usize)| frame == 0 && channel == name;
            self.channel_of.iter().zip(&self.frame_of).position(is_it)
        };
        let [Some(r), Some(g), Some(b)] = ["R", "G", "B"].map(place) else { return Vec::new() };
        let draw = |number: u32| {
            let electrons = self.electrons(&normal_deviates(nuisances, 1, number), 0.0);
            let sum = electrons[r] + electrons[g] + electrons[b];
            (sum > 0.0).then(|| [electrons[r] / sum, electrons[g] / sum])
        };
        (0..count).filter_map(draw).collect()
    }

    /// Electrons of some places in the typical person without porphyrin, each as bright in a frame as `typical`.
    pub(super) fn drawn_places(&self, count: usize, typical: &[f64]) -> Vec<Vec<f64>> {
        let (places, nuisances) = (self.of_places(), self.nuisances().len());
        let sum = |frame: usize, of: &[f64]| -> f64 {
            of.iter().zip(&self.frame_of).filter(|(_, of)| **of == frame).map(|(e, _)| e).sum()
        };
        let place = |number: usize| {
            let drawn = places.electrons(&normal_deviates(nuisances, 3, number as u32), 0.0);
            let scaled = |(e, &frame): (&f64, &usize)| e * sum(frame, typical) / sum(frame, &drawn);
            drawn.iter().zip(&self.frame_of).map(scaled).collect()
        };
        (0..count).map(place).collect()
    }

    /// The family with some of its sources taken out.
    fn without(&self, is_out: impl Fn(&FamilySource) -> bool) -> Self {
        let mut family = self.clone();
        family.sources.iter_mut().filter(|source| is_out(source)).for_each(|source| source.median = 0.0);
        family
    }

    /// The family of places in one typical person.
    fn of_places(&self) -> Self {
        let mut family = self.widened(PLACES_OVER_PEOPLE / self.width);
        // What is known of the person is known of its places
        let unknown =
            |source: &&mut FamilySource| source.group == NuisanceGroup::Surroundings && source.log_sd > 0.0;
        family.sources.iter_mut().filter(unknown).for_each(|source| source.log_sd = PLACES_OF_TEETH);
        if let Some(indirect) = family.indirect.as_mut().filter(|indirect| indirect[1] > 0.0) {
            indirect[1] = PLACES_OF_INDIRECT;
        }
        family.know_library();
        family
    }

    /// What the family says of blocks; `None` where they hold nothing to tell, as those of a single channel. Tissues are those drawn from a
    /// family with the same coordinates.
    pub(super) fn of_blocks(&self, drawn: &DrawnTissues) -> Option<BlockFamily> {
        // The typical tissue, and what porphyrin and chlorophyll add to it
        let bulk_family = self.without(FamilySource::is_pigment);
        let middle = vec![0.0; self.nuisances().len()];
        let added = |more: Vec<f64>, less: &[f64]| -> Vec<f64> {
            more.iter().zip(less).map(|(more, less)| (more - less).max(0.0)).collect()
        };
        let bulk = bulk_family.electrons(&middle, 0.0);
        let porphyrin = added(bulk_family.electrons(&middle, self.porphyrin.median), &bulk);
        let chlorophyll = added(self.electrons(&middle, 0.0), &bulk);
        let sum = |electrons: &[f64]| self.counted_electrons(electrons);
        let all = sum(&bulk) + sum(&porphyrin) + sum(&chlorophyll);
        if self.color_data().is_empty() || all <= 0.0 {
            return None;
        }

        // People, and places in one of them
        let (mean, of_people) = moments(&bulk_family.colors_of(&drawn.people));
        let (_, mut of_places) = moments(&bulk_family.of_places().colors_of(&drawn.places));
        for (number, datum) in self.color_data().into_iter().enumerate() {
            if self.frame_of[datum] > 0 {
                of_places[(number, number)] += (PLACES_OF_LAMPS * mean[number]).powi(2);
            }
        }
        // From the mean to a source alone, as far as its first part leads; straight on in the first frame
        let mixed = |source: &[f64]| -> Vec<f64> {
            let odds = TOWARD / (1.0 - TOWARD) * sum(&bulk) / sum(source);
            bulk.iter().zip(source).map(|(bulk, more)| bulk + odds * more).collect()
        };
        let way = |bulk: &[f64], mixed: &[f64]| Some((self.color(mixed)? - self.color(bulk)?) / TOWARD);
        let toward = |source: &[f64]| Some(way(&bulk, &mixed(source))? + self.color(&bulk)? - &mean);
        // People with porphyrin, whose light scales the amplitudes
        let amount = self.porphyrin.median * TOWARD / (1.0 - TOWARD) * sum(&bulk) / sum(&porphyrin);
        let scaled = |(light, nuisances): &Drawn| {
            let color = |amount| self.color(&bulk_family.electrons_of(light, nuisances, amount));
            Some((color(0.0)?, color(amount)?, bulk_family.share_of(light, nuisances, amount)))
        };
        Some(BlockFamily {
            red: toward(&porphyrin)?,
            scaled: drawn.people.iter().take(SCALED).filter_map(scaled).collect(),
            of_chlorophyll: if sum(&chlorophyll) > 0.0 { toward(&chlorophyll) } else { None },
            chlorophyll: sum(&chlorophyll) / (sum(&bulk) + sum(&porphyrin)),
            typical_share: sum(&porphyrin) / all,
            mean,
            of_people,
            of_places,
        })
    }

    /// Covariance of the color of a block by the sensor's noise.
    fn noise_of(&self, block: &RegionBlock, color: &DVector<f64>) -> DMatrix<f64> {
        let data = self.color_data();
        let totals: Vec<f64> = data.iter().map(|of| self.divisor(&block.electrons, *of)).collect();
        let slope = |row: usize, datum: usize| {
            let by_divisor = if self.divides(datum, data[row]) { color[row] } else { 0.0 };
            (f64::from(u8::from(data[row] == datum)) - by_divisor) / totals[row]
        };
        let noise = covariance_of(&block.variance, block.electrons.len());
        let slopes = DMatrix::from_fn(color.len(), noise.ncols(), slope);
        &slopes * noise * slopes.transpose()
    }
}

/// Light of units in a drawn tissue, and its nuisances.
type Drawn = (UnitLight, Vec<f64>);

/// Tissues drawn from a family, for all that have its coordinates.
pub(super) struct DrawnTissues {
    people: Vec<Drawn>,
    places: Vec<Drawn>,
}

/// What a family says of the colors of blocks.
pub(super) struct BlockFamily {
    /// Mean color of people without porphyrin, and its covariance.
    mean: DVector<f64>,
    of_people: DMatrix<f64>,
    /// Covariance of places in one person.
    of_places: DMatrix<f64>,
    /// Ways from the mean to porphyrin and to plant pigment alone.
    red: DVector<f64>,
    /// People: color without porphyrin, color with some, and the share of the latter.
    scaled: Vec<(DVector<f64>, DVector<f64>, f64)>,
    of_chlorophyll: Option<DVector<f64>>,
    /// Typical light of chlorophyll over all other.
    chlorophyll: f64,
    /// Typical share of porphyrin in all light.
    typical_share: f64,
}

impl BlockFamily {
    /// The blocks along the red direction, as the family says; `None` where there are too few.
    pub(super) fn pattern(
        &self,
        family: &LightFamily,
        of_mean: &FamilyFit,
        blocks: &[RegionBlock],
    ) -> Option<RedPattern> {
        if blocks.len() < LEAST_BLOCKS {
            return None;
        }
        let count = self.mean.len();
        let colors: Vec<DVector<f64>> =
            blocks.iter().map(|block| family.color(&block.electrons)).collect::<Option<_>>()?;
        let noise: Vec<DMatrix<f64>> =
            blocks.iter().zip(&colors).map(|(block, z)| family.noise_of(block, z)).collect();
        let mean_noise =
            noise.iter().fold(DMatrix::zeros(count, count), |sum, n| sum + n) / blocks.len() as f64;

        // Amplitudes, and the rest that holds no porphyrin
        // along a way that plant pigment goes little, where the camera has one
        let of_pigment = self.of_chlorophyll.as_ref().map_or_else(
            || DMatrix::zeros(count, count),
            |color| color * color.transpose() * self.chlorophyll.powi(2),
        );
        let scatter = Cholesky::new(&self.of_places + &mean_noise + of_pigment)?;
        let toward = scatter.solve(&self.red);
        let weights = &toward / toward.dot(&self.red);
        let remainder = DMatrix::identity(count, count) - &self.red * weights.transpose();
        let off: Vec<DVector<f64>> = colors.iter().map(|color| color - &self.mean).collect();
        let light: Vec<f64> =
            blocks.iter().map(|b| b.pixels as f64 * family.counted_electrons(&b.electrons)).collect();
        let whole: f64 = light.iter().sum();
        let light: Vec<f64> = light.iter().map(|light| light / whole).collect();
        let rests: Vec<DVector<f64>> = off.iter().map(|off| &remainder * off).collect();
        let mean_rest =
            rests.iter().zip(&light).fold(DVector::zeros(count), |sum, (rest, weight)| sum + rest * *weight);

        // Where the rest says that the bulk of the person lies
        let independent = INDEPENDENT_BLOCKS.min(blocks.len() as f64);
        let of_mean_rest = &remainder * (&self.of_places + &mean_noise) * remainder.transpose() / independent;
        let of_rest = &remainder * &self.of_people * remainder.transpose() + of_mean_rest;
        let along = (weights.transpose() * &self.of_people * remainder.transpose()).transpose();
        let tolerance = 1e-9 * of_rest.diagonal().max();
        let inverse = of_rest.pseudo_inverse(tolerance).ok()?;
        let regression = &inverse * &along;
        // How much chlorophyll the rest shows
        let chlorophyll_evidence = CHLOROPHYLL.map(|factor| {
            let Some(color) = &self.of_chlorophyll else { return 0.0 };
            let share = share_of_chlorophyll(factor, self.chlorophyll);
            let off = &mean_rest - &remainder * color * share;
            -0.5 * off.dot(&(&inverse * &off))
        });
        let bulk_variance =
            (weights.transpose() * &self.of_people * &weights)[(0, 0)] - regression.dot(&along);
        let scatter_of_rest = &remainder * (&self.of_places + &mean_noise) * remainder.transpose();
        let tolerance = 1e-9 * scatter_of_rest.diagonal().max();
        let looks_like_chlorophyll = self.of_chlorophyll.as_ref().is_some_and(|color| {
            let rest = &remainder * color * LOOKS_ALIKE[0];
            let scattered = scatter_of_rest.clone().pseudo_inverse(tolerance);
            scattered.is_ok_and(|inverse| rest.dot(&(inverse * &rest)).max(0.0).sqrt() < LOOKS_ALIKE[1])
        });
        let slope = self.of_chlorophyll.as_ref().map_or(0.0, |color| -regression.dot(&(&remainder * color)));

        // The share of the porphyrin over what the amplitude takes for it
        let of_person = |(bulk, mixed, share): &(DVector<f64>, DVector<f64>, f64)| {
            let [from, to] = [bulk, mixed].map(|color| weights.dot(&(color - &self.mean)));
            DVector::from_element(1, share * (1.0 - from) / (to - from))
        };
        let (scale, scatter_of_scale) = moments(&self.scaled.iter().map(of_person).collect::<Vec<_>>());
        let (scale, scatter_of_scale) = (scale[0], scatter_of_scale[(0, 0)]);

        let amplitudes: Vec<f64> = off.iter().map(|off| weights.dot(off)).collect();
        let of_bulk = regression.dot(&mean_rest);
        if are_all_red(&amplitudes, of_bulk) {
            return None;
        }
        let noise_along: Vec<f64> = noise.iter().map(|n| weights.dot(&(n * &weights))).collect();
        let place_variance = (weights.transpose() * &self.of_places * &weights)[(0, 0)];
        let mean = |of: &[f64]| of.iter().zip(&light).map(|(value, weight)| value * weight).sum::<f64>();
        let scatter = [place_variance, mean(&noise_along)];
        let bulk =
            bulks(mean(&amplitudes), scatter, independent, |share| of_mean.log_likelihood(scale * share));

        Some(RedPattern {
            amplitudes,
            bulk,
            noise: noise_along,
            weights: light,
            place_variance,
            place_evidence: place_evidence(blocks, &rests, &noise, &remainder, &self.of_places),
            chlorophyll_evidence,
            bulk_mean: [of_bulk, slope],
            scale_variance: scatter_of_scale / (scale * scale),
            bulk_variance: bulk_variance.max(1e-12),
            chlorophyll: self.of_chlorophyll.as_ref().map(|color| [self.chlorophyll, weights.dot(color)]),
            typical_share: [self.typical_share, of_mean.beforehand[1]],
            own_light: scale,
            looks_like_chlorophyll,
        })
    }
}

/// Whether nine in ten blocks hold more than [`LARGEST_EVEN`] beside a bulk.
fn are_all_red(amplitudes: &[f64], bulk: f64) -> bool {
    let mut sorted = amplitudes.to_vec();
    sorted.sort_by(f64::total_cmp);
    (sorted[sorted.len() / 10] - bulk) / (1.0 - bulk) > LARGEST_EVEN
}

/// Logarithm of the likelihood of each of [`PLACE_FACTORS`] by how the rests of the blocks scatter, each principal direction by
/// itself, with tissue that is alike at near places and any mean.
fn place_evidence(
    blocks: &[RegionBlock],
    rests: &[DVector<f64>],
    noise: &[DMatrix<f64>],
    remainder: &DMatrix<f64>,
    of_places: &DMatrix<f64>,
) -> [f64; PLACE_FACTORS.len()] {
    /// Variance of the mean, over that of places: as good as unknown.
    const ANY_MEAN: f64 = 100.0;
    let count = blocks.len();
    let pixels: usize = blocks.iter().map(|block| block.pixels).sum();
    let length = ALIKE[2] * (pixels as f64).sqrt();
    let alike = DMatrix::from_fn(count, count, |i, j| {
        let way = |axis: usize| blocks[i].corner_px[axis] as f64 - blocks[j].corner_px[axis] as f64;
        let own = if i == j { ALIKE[1] } else { 0.0 };
        ALIKE[0] * (-way(0).hypot(way(1)) / length).exp() + own + ANY_MEAN
    });
    let SymmetricEigen { eigenvalues, eigenvectors } =
        SymmetricEigen::new(remainder * of_places * remainder.transpose());
    let largest = eigenvalues.max();
    let mut evidence = [0.0; PLACE_FACTORS.len()];
    for (number, value) in eigenvalues.iter().enumerate().filter(|(_, value)| **value > 1e-6 * largest) {
        let axis = eigenvectors.column(number);
        let values = DVector::from_iterator(count, rests.iter().map(|rest| axis.dot(rest)));
        let along = remainder.tr_mul(&axis);
        let of_noise: Vec<f64> = noise.iter().map(|n| along.dot(&(n * &along))).collect();
        for (sum, factor) in evidence.iter_mut().zip(PLACE_FACTORS) {
            let covariance = &alike * (factor * factor * value)
                + DMatrix::from_diagonal(&DVector::from_column_slice(&of_noise));
            if let Some(found) = Cholesky::new(covariance) {
                let log_determinant: f64 = found.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
                *sum -= 0.5 * (log_determinant + values.dot(&found.solve(&values)));
            }
        }
    }
    let share = (INDEPENDENT_BLOCKS / count as f64).min(1.0);
    let best = evidence.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    evidence.map(|value| share * (value - best))
}
