//! What light excites that has been reflected before it arrives, and what light excites that has fluoresced before.
//!
//! Light that was reflected is the spectrum of a light source times a few reflectances of the scene. Such products lie near a space
//! of few dimensions, so what their basis excites is tabulated for every matrix. What the basis leaves out excites by the
//! operators themselves, at random with a probability in proportion to its share, divided by that probability: the estimate stays
//! unbiased whatever the basis is. Where the operators of a vertex are no more work than the basis is, they take the light as it is.

use fluorspar_accel::Lanes;
use fluorspar_accel::bands::{self, BLOCK, BandBlock, to_blocks};

use super::fluorescence_operator::FluorescenceOperator;
use crate::sampling::hash_u64;

/// Most spectra of a basis.
pub(super) const MOST_SPECTRA: usize = 6;
/// Probability with which what the basis leaves out excites, by its share of the light.
const PROBABILITY_BY_SHARE: f32 = 4.0;
/// Least probability of it.
const LEAST_PROBABILITY: f32 = 1.0 / 32.0;

/// Random numbers for the choices of one path, one after the other.
pub(super) struct Choices(u64);

impl Choices {
    /// The choices that follow from a random word.
    pub(super) fn new(word: u64) -> Self {
        Self(word)
    }

    /// The next number in `[0, 1)`.
    #[inline(always)]
    fn next(&mut self) -> f32 {
        self.0 = hash_u64(self.0);
        (self.0 >> 40) as f32 / 16_777_216.0
    }

    /// 1 over the probability where the choice falls on it, otherwise `None`.
    #[inline(always)]
    pub(super) fn weight(&mut self, probability: f32) -> Option<f32> {
        (probability >= 1.0 || self.next() < probability).then(|| 1.0 / probability.min(1.0))
    }
}

/// What the light of one spectrum excites after reflections.
#[derive(Debug)]
pub(super) struct Excitation {
    /// `[matrix]`, excitation weighted by the spectrum; empty for excitation nodes.
    operators: Vec<FluorescenceOperator>,
    /// Spectra of the basis.
    rank: usize,
    /// Blocks in which any of the matrices is excited: first and one past the last.
    lit: (usize, usize),
    /// Root mean square of what one unit of light in a band excites, `[block]`.
    response: Vec<BandBlock>,
    /// Spectra of the basis, `[spectrum][block]`.
    spectra: Vec<BandBlock>,
    /// Their duals: the product with a light spectrum is its amount of the basis spectrum. Squares of amounts add up to that of the
    /// excited light.
    duals: Vec<BandBlock>,
    /// What the basis spectra excite, `[matrix][block][spectrum]`.
    exitance: Vec<BandBlock>,
    /// Blocks of each matrix in which it emits: first and one past the last.
    emitting: Vec<(usize, usize)>,
    /// Blocks of bands that each matrix takes by its operator, and by the table.
    blocks: Vec<[usize; 2]>,
}

/// Light on the basis.
pub(super) struct Projected {
    amounts: [f32; MOST_SPECTRA],
    /// Factor on what the basis leaves out; `None` where the choice did not fall on it.
    rest: Option<f32>,
}

impl Excitation {
    /// The tables for a basis: orthonormal vectors over the bands that are `excited`, weighted by the `response`, `[band]`, padded.
    pub(super) fn new(
        operators: Vec<FluorescenceOperator>,
        response: &[f64],
        excited: &[usize],
        basis: &[Vec<f64>],
    ) -> Self {
        let rank = basis.len();
        let blocks = response.len() / BLOCK;

        // Undo the weights for the spectra, apply them for the duals
        let spread = |vector: &[f64], weight: &dyn Fn(usize) -> f64| -> Vec<f32> {
            let mut values = vec![0.0; response.len()];
            for (&band, value) in excited.iter().zip(vector) {
                values[band] = (value * weight(band)) as f32;
            }
            values
        };
        let spectra: Vec<Vec<f32>> = basis.iter().map(|v| spread(v, &|band| 1.0 / response[band])).collect();
        let duals: Vec<Vec<f32>> = basis.iter().map(|v| spread(v, &|band| response[band])).collect();

        // Tabulate what the spectra excite
        let mut exitance = Vec::with_capacity(operators.len() * blocks * rank);
        let mut emitting = Vec::with_capacity(operators.len());
        for operator in &operators {
            let excite =
                |spectrum: &Vec<f32>| to_blocks(&operator.product(1.0, &spectrum[..operator.bands()]));
            let of_spectra: Vec<Vec<BandBlock>> = spectra.iter().map(excite).collect();
            let is_lit = |block: &usize| of_spectra.iter().any(|blocks| blocks[*block] != BandBlock::ZERO);
            let first = (0..blocks).find(is_lit).unwrap_or(0);
            emitting.push((first, (first..blocks).rfind(is_lit).map_or(first, |last| last + 1)));
            exitance.extend((0..blocks).flat_map(|block| of_spectra.iter().map(move |blocks| blocks[block])));
        }
        let work = |(operator, (first, end)): (&FluorescenceOperator, &(usize, usize))| {
            [operator.blocks(), rank * (end - first)]
        };
        let work = operators.iter().zip(&emitting).map(work).collect();
        let single: Vec<f32> = response.iter().map(|value| *value as f32).collect();
        let first = excited.first().map_or(0, |band| band / BLOCK);
        Self {
            operators,
            rank,
            lit: (first, excited.last().map_or(first, |band| band / BLOCK + 1)),
            response: to_blocks(&single),
            spectra: spectra.iter().flat_map(|values| to_blocks(values)).collect(),
            duals: duals.iter().flat_map(|values| to_blocks(values)).collect(),
            exitance,
            emitting,
            blocks: work,
        }
    }

    /// Whether the operators of matrices are no more work than the basis is.
    #[inline(always)]
    pub(super) fn is_direct(&self, matrices: impl Iterator<Item = usize>) -> bool {
        let [direct, tabulated] = matrices.fold([0; 2], |[direct, tabulated], matrix| {
            let [by_operator, by_table] = self.blocks[matrix];
            [direct + by_operator, tabulated + by_table]
        });
        direct <= tabulated + (self.rank + 1) * (self.lit.1 - self.lit.0)
    }

    /// Adds what light excites through a matrix: `out += factor F light`.
    #[inline(always)]
    pub(super) fn add_product<L: Lanes>(
        &self,
        lanes: L,
        matrix: usize,
        factor: f32,
        light: &[BandBlock],
        out: &mut [BandBlock],
    ) {
        self.operators[matrix].add_product(lanes, factor, light, out);
    }

    /// Takes apart light that arrives. Where the choice falls on it, `rest` is what the basis leaves out.
    #[inline(always)]
    pub(super) fn project<L: Lanes>(
        &self,
        lanes: L,
        light: &[BandBlock],
        choices: &mut Choices,
        rest: &mut [BandBlock],
    ) -> Projected {
        let (blocks, lit) = (light.len(), self.lit.0..self.lit.1);
        let excited = bands::weighted_squares(lanes, &self.response[lit.clone()], &light[lit.clone()]);
        let mut amounts = [0.0; MOST_SPECTRA];
        let mut left = excited;
        for (amount, dual) in amounts.iter_mut().zip(self.duals.chunks_exact(blocks)) {
            *amount = bands::dot(lanes, &dual[lit.clone()], &light[lit.clone()]);
            left -= *amount * *amount;
        }
        let share = if self.rank == 0 {
            1.0
        } else if excited > 0.0 {
            (left.max(0.0) / excited).sqrt()
        } else {
            0.0
        };
        let factor = choices.weight((PROBABILITY_BY_SHARE * share).clamp(LEAST_PROBABILITY, 1.0));
        if factor.is_some() {
            rest.copy_from_slice(light);
            for (amount, spectrum) in amounts.iter().zip(self.spectra.chunks_exact(blocks)) {
                bands::add_scaled(lanes, -amount, &spectrum[lit.clone()], &mut rest[lit.clone()]);
            }
        }
        Projected { amounts, rest: factor }
    }

    /// Adds what projected light excites through a matrix: `out += factor F (sum_k a_k u_k + rest)`.
    #[inline(always)]
    pub(super) fn add_excited<L: Lanes>(
        &self,
        lanes: L,
        matrix: usize,
        factor: f32,
        (light, rest): (&Projected, &[BandBlock]),
        out: &mut [BandBlock],
    ) {
        let (first, end) = self.emitting[matrix];
        let start = matrix * out.len() * self.rank;
        let exitance = &self.exitance[start + first * self.rank..start + end * self.rank];
        let mut factors = light.amounts;
        factors.iter_mut().for_each(|amount| *amount *= factor);
        bands::add_combination(lanes, &factors[..self.rank], exitance, &mut out[first..end]);
        if let Some(weight) = light.rest {
            self.operators[matrix].add_product(lanes, factor * weight, rest, out);
        }
    }
}
