//! Arithmetic on band vectors: one number per wavelength band, padded to whole blocks.
//!
//! Functions are generic over the instructions that they use and are inlined into a [`Work`](crate::Work), which is
//! compiled for each instruction set. Sums have a fixed order, so results have the same bits everywhere. Padding holds
//! zeros and stays zero.

use std::ops::Range;

use crate::Lanes;

/// Bands per block: one vector register of AVX-512, two of AVX2.
pub const BLOCK: usize = 16;

/// Sixteen neighboring bands.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandBlock(pub [f32; BLOCK]);

impl BandBlock {
    /// Sixteen zeros.
    pub const ZERO: Self = Self([0.0; BLOCK]);
}

/// A band vector in whole blocks, padded with zeros.
pub fn to_blocks(values: &[f32]) -> Vec<BandBlock> {
    let mut blocks = vec![BandBlock::ZERO; values.len().div_ceil(BLOCK)];
    for (block, values) in blocks.iter_mut().zip(values.chunks(BLOCK)) {
        block.0[..values.len()].copy_from_slice(values);
    }
    blocks
}

/// The first `out.len()` bands.
#[inline(always)]
pub fn copy_bands(blocks: &[BandBlock], out: &mut [f32]) {
    for (block, out) in blocks.iter().zip(out.chunks_mut(BLOCK)) {
        out.copy_from_slice(&block.0[..out.len()]);
    }
}

/// `out += v` over the first `out.len()` bands.
#[inline(always)]
pub fn add_bands(blocks: &[BandBlock], out: &mut [f32]) {
    let (whole, rest) = out.as_chunks_mut::<BLOCK>();
    for (block, out) in blocks.iter().zip(whole.iter_mut()) {
        for (out, value) in out.iter_mut().zip(&block.0) {
            *out += value;
        }
    }
    if let Some(block) = blocks.get(whole.len()) {
        for (out, value) in rest.iter_mut().zip(&block.0) {
            *out += value;
        }
    }
}

/// `out += factor * v` over a range of bands; `out` holds all bands.
///
/// # Panics
/// If either vector ends before the range does.
pub fn add_scaled_range(factor: f32, blocks: &[BandBlock], range: Range<usize>, out: &mut [f32]) {
    for (band, out) in range.clone().zip(&mut out[range]) {
        *out += factor * blocks[band / BLOCK].0[band % BLOCK];
    }
}

/// `v = 0`.
#[inline(always)]
pub fn clear<L: Lanes>(lanes: L, v: &mut [BandBlock]) {
    let zero = lanes.splat(0.0);
    for v in v {
        lanes.store(zero, v);
    }
}

/// `out += factor * v`.
#[inline(always)]
pub fn add_scaled<L: Lanes>(lanes: L, factor: f32, v: &[BandBlock], out: &mut [BandBlock]) {
    let factor = lanes.splat(factor);
    for (out, v) in out.iter_mut().zip(v) {
        lanes.store(lanes.add(lanes.load(out), lanes.mul(factor, lanes.load(v))), out);
    }
}

/// `out = slope * r + offset`: what a diffuse base `r` and an achromatic lobe reflect.
#[inline(always)]
pub fn reflection_factor<L: Lanes>(
    lanes: L,
    slope: f32,
    r: &[BandBlock],
    offset: f32,
    out: &mut [BandBlock],
) {
    let (slope, offset) = (lanes.splat(slope), lanes.splat(offset));
    for (out, r) in out.iter_mut().zip(r) {
        lanes.store(lanes.add(lanes.mul(slope, lanes.load(r)), offset), out);
    }
}

/// `v *= factor`, band by band.
#[inline(always)]
pub fn multiply<L: Lanes>(lanes: L, factor: &[BandBlock], v: &mut [BandBlock]) {
    for (v, factor) in v.iter_mut().zip(factor) {
        lanes.store(lanes.mul(lanes.load(factor), lanes.load(v)), v);
    }
}

/// `out += a * b`, band by band.
#[inline(always)]
pub fn add_product_of<L: Lanes>(lanes: L, a: &[BandBlock], b: &[BandBlock], out: &mut [BandBlock]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        lanes.store(lanes.add(lanes.load(out), lanes.mul(lanes.load(a), lanes.load(b))), out);
    }
}

/// `out += sum of factors[k] * vectors[k]`; of each block the vectors follow each other, `[block][vector]`.
#[inline(always)]
pub fn add_combination<L: Lanes>(lanes: L, factors: &[f32], vectors: &[BandBlock], out: &mut [BandBlock]) {
    if factors.is_empty() {
        return;
    }
    for (out, vectors) in out.iter_mut().zip(vectors.chunks_exact(factors.len())) {
        let mut sum = lanes.load(out);
        for (factor, vector) in factors.iter().zip(vectors) {
            sum = lanes.add(sum, lanes.mul(lanes.splat(*factor), lanes.load(vector)));
        }
        lanes.store(sum, out);
    }
}

/// Sum of `(weight * v)²` over all bands, in the order of [`dot`].
#[inline(always)]
pub fn weighted_squares<L: Lanes>(lanes: L, weight: &[BandBlock], v: &[BandBlock]) -> f32 {
    let mut sums = lanes.splat(0.0);
    for (weight, v) in weight.iter().zip(v) {
        let weighted = lanes.mul(lanes.load(weight), lanes.load(v));
        sums = lanes.add(sums, lanes.mul(weighted, weighted));
    }
    sum_of_lanes(lanes, sums)
}

/// Sum of `a * b` over all bands: lane by lane first, then the lanes by doubling.
#[inline(always)]
pub fn dot<L: Lanes>(lanes: L, a: &[BandBlock], b: &[BandBlock]) -> f32 {
    let mut sums = lanes.splat(0.0);
    for (a, b) in a.iter().zip(b) {
        sums = lanes.add(sums, lanes.mul(lanes.load(a), lanes.load(b)));
    }
    sum_of_lanes(lanes, sums)
}

/// `sum += v`, then `v *= factor`, band by band.
#[inline(always)]
pub fn add_then_multiply<L: Lanes>(
    lanes: L,
    factor: &[BandBlock],
    v: &mut [BandBlock],
    sum: &mut [BandBlock],
) {
    for ((v, factor), sum) in v.iter_mut().zip(factor).zip(sum) {
        let value = lanes.load(v);
        lanes.store(lanes.add(lanes.load(sum), value), sum);
        lanes.store(lanes.mul(lanes.load(factor), value), v);
    }
}

/// `out += (slope * r + offset) * v`: light `v` reflected for the first time.
#[inline(always)]
pub fn add_reflected<L: Lanes>(
    lanes: L,
    slope: f32,
    r: &[BandBlock],
    offset: f32,
    v: &[BandBlock],
    out: &mut [BandBlock],
) {
    let (slope, offset) = (lanes.splat(slope), lanes.splat(offset));
    for ((out, r), v) in out.iter_mut().zip(r).zip(v) {
        let factor = lanes.add(lanes.mul(slope, lanes.load(r)), offset);
        lanes.store(lanes.add(lanes.load(out), lanes.mul(factor, lanes.load(v))), out);
    }
}

/// Spectra one after the other, `[col][band]`, as lines of equal wavelength, `[band][col]`.
///
/// # Panics
/// If `lines` holds fewer numbers than `spectra`.
#[inline(always)]
pub fn transpose<L: Lanes>(lanes: L, spectra: &[f32], bands: usize, lines: &mut [f32]) {
    /// Side of the squares that are transposed at once.
    const SIDE: usize = 8;
    /// Columns between those that are read and those that are asked for.
    const AHEAD: usize = 16;
    let width = spectra.len() / bands.max(1);
    if bands < SIDE || width < SIDE {
        for (col, spectrum) in spectra.chunks_exact(bands.max(1)).enumerate() {
            for (band, value) in spectrum.iter().enumerate() {
                lines[band * width + col] = *value;
            }
        }
        return;
    }
    // The last squares begin early enough to end with the image, and write some numbers twice
    for col in (0..width).step_by(SIDE).map(|col| col.min(width - SIDE)) {
        for band in (0..bands).step_by(SIDE).map(|band| band.min(bands - SIDE)) {
            let (from, to) = (col * bands + band, band * width + col);
            // A processor does not foresee short rows in turn: ask early for an equal part of the columns to come
            let ahead = (col + AHEAD) * bands + SIDE * band;
            for line in (ahead..ahead + SIDE * SIDE).step_by(BLOCK) {
                lanes.prefetch(spectra, line);
            }
            lanes.transpose_8(&spectra[from..], &mut lines[to..], [bands, width]);
        }
    }
}

/// A table of weights, `[channel][band]`, and the sums that it adds to, `[channel][col]`.
pub struct WeightedSums<'a> {
    /// Weights of all bands.
    pub weights: &'a [f32],
    /// Sums of all columns.
    pub sums: &'a mut [f64],
}

/// Adds lines of equal wavelength, `[band][col]`, times weights: `sums[channel][col] += sum of weights[channel][band] lines[band][col]`
/// over some bands and columns, for several tables at once.
///
/// Eight bands at a time are summed in single precision, in their order, then added in double precision.
///
/// # Panics
/// If a slice is too short for its range.
#[inline(always)]
pub fn add_weighted<L: Lanes>(
    lanes: L,
    (lines, width): (&[f32], usize),
    bands: &Range<usize>,
    columns: &Range<usize>,
    tables: &mut [WeightedSums<'_>],
) {
    for first in columns.clone().step_by(2 * BLOCK) {
        let part = first..(first + 2 * BLOCK).min(columns.end);
        let line = (lines, width, bands, &part);
        match part.len().div_ceil(BLOCK) {
            1 => add_columns::<L, 1>(lanes, line, tables),
            _ => add_columns::<L, 2>(lanes, line, tables),
        }
    }
}

/// Bands that are summed in single precision.
const AT_ONCE: usize = 8;

/// Adds bands in columns that fill some blocks, the last one perhaps in part. Several blocks share each look at a weight.
#[inline(always)]
fn add_columns<L: Lanes, const BLOCKS: usize>(
    lanes: L,
    (lines, width, bands, columns): (&[f32], usize, &Range<usize>, &Range<usize>),
    tables: &mut [WeightedSums<'_>],
) {
    let count = lines.len() / width.max(1);
    for few in bands.clone().step_by(AT_ONCE) {
        let few = few..(few + AT_ONCE).min(bands.end);
        // Where the table ends within the blocks of a row, the row is copied
        let mut copies = [[BandBlock::ZERO; BLOCKS]; AT_ONCE];
        let mut rows = [None; AT_ONCE];
        for ((row, copy), band) in rows.iter_mut().zip(&mut copies).zip(few.clone()) {
            let line = &lines[band * width + columns.start..];
            *row = first_blocks(line);
            if row.is_none() {
                for (block, values) in copy.iter_mut().zip(line.chunks(BLOCK)) {
                    block.0[..values.len()].copy_from_slice(values);
                }
            }
        }
        let rows: [[&[f32; BLOCK]; BLOCKS]; AT_ONCE] = std::array::from_fn(|index| match rows[index] {
            Some(blocks) => blocks.each_ref(),
            None => copies[index].each_ref().map(|block| &block.0),
        });
        for WeightedSums { weights, sums } in tables.iter_mut() {
            for (weights, sums) in weights.chunks_exact(count).zip(sums.chunks_exact_mut(width)) {
                let weights = &weights[few.clone()];
                if weights.iter().all(|weight| *weight == 0.0) {
                    continue;
                }
                let mut partial = [lanes.splat(0.0); BLOCKS];
                // A known number of bands becomes straight code
                match weights.first_chunk::<AT_ONCE>() {
                    Some(weights) => add_rows(lanes, weights, &rows, &mut partial),
                    None => add_rows(lanes, weights, &rows, &mut partial),
                }
                for (partial, sums) in partial.into_iter().zip(sums[columns.clone()].chunks_mut(BLOCK)) {
                    let mut values = BandBlock::ZERO;
                    lanes.store(partial, &mut values);
                    add_doubled(&values, sums);
                }
            }
        }
    }
}

/// The first whole blocks of a line, if it holds as many.
#[inline(always)]
fn first_blocks<const BLOCKS: usize>(line: &[f32]) -> Option<&[[f32; BLOCK]; BLOCKS]> {
    line.as_chunks::<BLOCK>().0.first_chunk::<BLOCKS>()
}

/// `sums += weight * row`, row by row.
#[inline(always)]
fn add_rows<L: Lanes, const BLOCKS: usize>(
    lanes: L,
    weights: &[f32],
    rows: &[[&[f32; BLOCK]; BLOCKS]],
    sums: &mut [L::Vector; BLOCKS],
) {
    for (weight, row) in weights.iter().zip(rows) {
        let weight = lanes.splat(*weight);
        for (sum, block) in sums.iter_mut().zip(row) {
            *sum = lanes.add(*sum, lanes.mul(weight, lanes.read(block)));
        }
    }
}

/// Adds as many numbers as there are sums.
#[inline(always)]
fn add_doubled(values: &BandBlock, sums: &mut [f64]) {
    let add = |(sum, value): (&mut f64, &f32)| *sum += f64::from(*value);
    // A known number of sums becomes vector instructions
    match sums.first_chunk_mut::<BLOCK>() {
        Some(sums) => sums.iter_mut().zip(&values.0).for_each(add),
        None => sums.iter_mut().zip(&values.0).for_each(add),
    }
}

/// A matrix `emission ⊗ excitation`, or what lies of it below the diagonal and any diagonal.
#[derive(Clone, Debug, PartialEq)]
pub struct OuterProduct {
    excitation: Vec<BandBlock>,
    emission: Vec<BandBlock>,
    /// Blocks in which excitation, emission and diagonal are not all zero: first and one past the last.
    excited: (usize, usize),
    emitting: (usize, usize),
    on_diagonal: (usize, usize),
    /// The diagonal, if only emission bands after the excitation band count.
    diagonal: Option<Vec<BandBlock>>,
}

/// Entries below this fraction of the greatest one count as zero, 2^-40: far below what any sum of them can show, and
/// deep enough for bands that hold nothing but a wing.
const NEGLIGIBLE: f32 = f32::EPSILON * f32::EPSILON * 64.0;

impl OuterProduct {
    /// The matrix with `emission[o] * excitation[i]` in row `o`, column `i`.
    ///
    /// Entries below 2^-40 of the greatest of their vector are dropped, so that far wings cost no time.
    ///
    /// # Panics
    /// If the vectors differ in length.
    pub fn new(excitation: &[f32], emission: &[f32]) -> Self {
        assert_eq!(excitation.len(), emission.len(), "one value per band in both");
        let (excitation, excited) = trimmed(excitation);
        let (emission, emitting) = trimmed(emission);
        Self { excitation, emission, excited, emitting, on_diagonal: (0, 0), diagonal: None }
    }

    /// The matrix with `emission[o] * excitation[i]` where `o > i`, `diagonal[o]` where `o = i`, and zero elsewhere;
    /// entries are dropped as in [`OuterProduct::new`].
    ///
    /// # Panics
    /// If the vectors differ in length.
    pub fn below_diagonal(excitation: &[f32], emission: &[f32], diagonal: &[f32]) -> Self {
        assert_eq!(excitation.len(), diagonal.len(), "one value per band in all");
        let (diagonal, on_diagonal) = trimmed(diagonal);
        Self { diagonal: Some(diagonal), on_diagonal, ..Self::new(excitation, emission) }
    }

    /// Blocks that a product reads or writes, about in proportion to its time.
    pub fn blocks(&self) -> usize {
        /// Work of a masked block, which sums up its lanes, by that of a plain one: an estimate, by which only time changes.
        const MASKED: usize = 3;
        let len = |(first, end): (usize, usize)| end - first;
        match self.diagonal {
            None => len(self.excited) + len(self.emitting),
            Some(_) => MASKED * (len(self.excited).max(len(self.on_diagonal)) + len(self.emitting)),
        }
    }

    /// `out += factor * M v`, in time proportional to the number of bands.
    #[inline(always)]
    pub fn add_product<L: Lanes>(&self, lanes: L, factor: f32, v: &[BandBlock], out: &mut [BandBlock]) {
        let factor = lanes.splat(factor);
        let range = |(first, end): (usize, usize)| first..end;
        let (excited, emitting) = (range(self.excited), range(self.emitting));
        let Some(diagonal) = &self.diagonal else {
            let mut sums = lanes.splat(0.0);
            for (excitation, v) in self.excitation[excited.clone()].iter().zip(&v[excited]) {
                sums = lanes.add(sums, lanes.mul(lanes.load(excitation), lanes.load(v)));
            }
            let absorbed = lanes.mul(factor, lanes.splat_last(running_sum(lanes, sums)));
            for (emission, out) in self.emission[emitting.clone()].iter().zip(&mut out[emitting]) {
                lanes.store(lanes.add(lanes.load(out), lanes.mul(lanes.load(emission), absorbed)), out);
            }
            return;
        };
        let on_diagonal = range(self.on_diagonal);
        let parts = [&excited, &emitting, &on_diagonal];
        let start = parts.iter().filter(|part| !part.is_empty()).map(|part| part.start).min().unwrap_or(0);
        let used = start..emitting.end.max(on_diagonal.end).max(start);
        let vectors = self.excitation[used.clone()].iter().zip(&self.emission[used.clone()]);
        let vectors = vectors.zip(&diagonal[used.clone()]);
        // What the blocks before have absorbed.
        let mut absorbed = lanes.splat(0.0);
        for ((block, ((excitation, emission), diagonal)), (v, out)) in
            used.clone().zip(vectors).zip(v[used.clone()].iter().zip(&mut out[used]))
        {
            let v = lanes.load(v);
            let mut below = absorbed;
            if excited.contains(&block) {
                let sums = running_sum(lanes, lanes.mul(lanes.load(excitation), v));
                below = lanes.add(absorbed, lanes.shift::<1>(sums));
                absorbed = lanes.add(absorbed, lanes.splat_last(sums));
            }
            let mut emitted = lanes.mul(lanes.load(emission), below);
            if on_diagonal.contains(&block) {
                emitted = lanes.add(emitted, lanes.mul(lanes.load(diagonal), v));
            }
            lanes.store(lanes.add(lanes.load(out), lanes.mul(factor, emitted)), out);
        }
    }
}

/// A vector without its entries below 2^-40 of the greatest, and the blocks in which the others lie: first and one past
/// the last.
fn trimmed(values: &[f32]) -> (Vec<BandBlock>, (usize, usize)) {
    let greatest = values.iter().fold(0.0_f32, |sum, value| sum.max(value.abs()));
    let kept: Vec<f32> =
        values.iter().map(|&value| if value.abs() < NEGLIGIBLE * greatest { 0.0 } else { value }).collect();
    let blocks = to_blocks(&kept);
    let used = |block: &BandBlock| block.0.iter().any(|&value| value != 0.0);
    let first = blocks.iter().position(used).unwrap_or(0);
    let end = blocks.iter().rposition(used).map_or(0, |last| last + 1);
    (blocks, (first, end))
}

/// Sum of all lanes.
#[inline(always)]
fn sum_of_lanes<L: Lanes>(lanes: L, x: L::Vector) -> f32 {
    let mut sums = BandBlock::ZERO;
    lanes.store(running_sum(lanes, x), &mut sums);
    sums.0[BLOCK - 1]
}

/// Sums up to and including each lane, by doubling (Hillis and Steele 1986).
#[inline(always)]
fn running_sum<L: Lanes>(lanes: L, x: L::Vector) -> L::Vector {
    let x = lanes.add(x, lanes.shift::<1>(x));
    let x = lanes.add(x, lanes.shift::<2>(x));
    let x = lanes.add(x, lanes.shift::<4>(x));
    lanes.add(x, lanes.shift::<8>(x))
}

/// A dense square matrix, kept by blocks of sixteen rows; blocks know which columns they need.
#[derive(Clone, Debug, PartialEq)]
pub struct BandMatrix {
    /// Columns of each block of rows, block after block.
    columns: Vec<BandBlock>,
    /// For each block of rows: first column, one past the last, and where they start in `columns`.
    spans: Vec<(usize, usize, usize)>,
}

/// Columns that are added up side by side.
const CHAINS: usize = 4;

impl BandMatrix {
    /// A matrix from its entries, `entry(row, column)`. Leading and trailing columns of zeros cost nothing, so a
    /// triangular matrix takes half the time.
    pub fn new(bands: usize, entry: impl Fn(usize, usize) -> f32) -> Self {
        let mut columns = Vec::new();
        let mut spans = Vec::new();
        for first_row in (0..bands).step_by(BLOCK) {
            let rows = first_row..bands.min(first_row + BLOCK);
            let used = |column: &usize| rows.clone().any(|row| entry(row, *column) != 0.0);
            let first = (0..bands).find(used).unwrap_or(0);
            let end = (0..bands).rev().find(used).map_or(0, |last| last + 1);
            spans.push((first, end, columns.len()));
            for column in first..end {
                let mut block = BandBlock::ZERO;
                for (lane, row) in rows.clone().enumerate() {
                    block.0[lane] = entry(row, column);
                }
                columns.push(block);
            }
        }
        Self { columns, spans }
    }

    /// `out += factor * M v`.
    #[inline(always)]
    pub fn add_product<L: Lanes>(&self, lanes: L, factor: f32, v: &[BandBlock], out: &mut [BandBlock]) {
        let factor = lanes.splat(factor);
        for (&(first, end, start), out) in self.spans.iter().zip(out) {
            let (fours, rest) = self.columns[start..start + (end - first)].as_chunks::<CHAINS>();
            let step = |sum: L::Vector, column: &BandBlock, band: usize| {
                let value = lanes.splat(v[band / BLOCK].0[band % BLOCK]);
                lanes.add(sum, lanes.mul(lanes.load(column), value))
            };
            let zero = lanes.splat(0.0);
            let (mut a, mut b, mut c, mut d) = (zero, zero, zero, zero);
            let mut band = first;
            for columns in fours {
                a = step(a, &columns[0], band);
                b = step(b, &columns[1], band + 1);
                c = step(c, &columns[2], band + 2);
                d = step(d, &columns[3], band + 3);
                band += CHAINS;
            }
            for column in rest {
                a = step(a, column, band);
                band += 1;
            }
            let sum = lanes.add(lanes.add(a, b), lanes.add(c, d));
            lanes.store(lanes.add(lanes.load(out), lanes.mul(factor, sum)), out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Kernel, Simd, Work};

    fn vector(bands: usize, phase: f32) -> Vec<f32> {
        (0..bands).map(|band| 0.6 + 0.5 * (0.7 * band as f32 + phase).sin()).collect()
    }

    /// Every operation of this module, one after the other.
    struct All<'a> {
        vectors: [&'a [BandBlock]; 2],
        products: &'a [OuterProduct],
        matrix: &'a BandMatrix,
    }

    impl Work for All<'_> {
        type Output = Vec<BandBlock>;

        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> Vec<BandBlock> {
            let [a, b] = self.vectors;
            let mut out = vec![BandBlock([7.0; BLOCK]); a.len()];
            clear(lanes, &mut out);
            add_scaled(lanes, 0.3, a, &mut out);
            add_scaled(lanes, 1.0, b, &mut out);
            let mut factor = out.clone();
            reflection_factor(lanes, 0.7, b, 0.1, &mut factor);
            multiply(lanes, &factor, &mut out);
            reflection_factor(lanes, 0.3, a, 0.2, &mut factor);
            multiply(lanes, &factor, &mut out);
            let mut sum = out.clone();
            add_then_multiply(lanes, &factor, &mut out, &mut sum);
            add_scaled(lanes, 1.0, &sum, &mut out);
            add_reflected(lanes, 0.2, a, 0.05, b, &mut out);
            for product in self.products {
                product.add_product(lanes, 0.4, a, &mut out);
            }
            self.matrix.add_product(lanes, 0.2, b, &mut out);
            add_product_of(lanes, a, b, &mut out);
            add_scaled(lanes, dot(lanes, a, b), a, &mut out);
            out
        }
    }

    fn outer_products(bands: usize) -> ([Vec<f32>; 3], [OuterProduct; 2]) {
        let bump = |center: f32, width: f32| {
            (0..bands).map(move |band| (-((band as f32 / bands as f32 - center) / width).powi(2)).exp())
        };
        let (excitation, emission): (Vec<f32>, Vec<f32>) =
            (bump(0.3, 0.06).collect(), bump(0.5, 0.1).collect());
        let diagonal: Vec<f32> = bump(0.4, 0.2).collect();
        let products = [
            OuterProduct::below_diagonal(&excitation, &emission, &diagonal),
            OuterProduct::new(&excitation, &emission),
        ];
        ([excitation, emission, diagonal], products)
    }

    #[test]
    fn every_kernel_gives_the_same_bits_as_the_formula_gives_values() {
        for bands in [1, 15, 16, 17, 31, 69, 81, 128] {
            let (a, b) = (vector(bands, 0.0), vector(bands, 2.0));
            let ([excitation, emission, diagonal], products) = outer_products(bands);
            let entry =
                |row: usize, column: usize| if row > column { 0.01 * (row + 2 * column) as f32 } else { 0.0 };
            let matrix = BandMatrix::new(bands, entry);
            let (blocks_a, blocks_b) = (to_blocks(&a), to_blocks(&b));
            let results: Vec<Vec<BandBlock>> = Kernel::available()
                .into_iter()
                .filter_map(Simd::of)
                .map(|simd| {
                    simd.run(All { vectors: [&blocks_a, &blocks_b], products: &products, matrix: &matrix })
                })
                .collect();
            assert!(results.iter().all(|result| result == &results[0]), "{bands} bands");

            let double = |values: &[f32], band: usize| f64::from(values[band]);
            for band in 0..bands {
                let (x, y) = (double(&a, band), double(&b, band));
                let mut value = (0.3 * x + y) * (0.7 * y + 0.1);
                // Times the factor, and to that twice itself added before the factor comes again.
                let factor = 0.3 * x + 0.2;
                value *= factor;
                value = value * factor + 2.0 * value + (0.2 * x + 0.05) * y;
                value += 0.4 * double(&diagonal, band) * x;
                let absorbed =
                    |upto: usize| (0..upto).map(|i| double(&excitation, i) * double(&a, i)).sum::<f64>();
                value += 0.4 * double(&emission, band) * (absorbed(band) + absorbed(bands));
                value += 0.2 * (0..bands).map(|i| f64::from(entry(band, i)) * double(&b, i)).sum::<f64>();
                value += x * y + x * (0..bands).map(|i| double(&a, i) * double(&b, i)).sum::<f64>();
                let got = f64::from(results[0][band / BLOCK].0[band % BLOCK]);
                // About 2 bands + 20 roundings of 2^-24 of positive terms.
                let tolerance = (2 * bands + 20) as f64 * 6e-8 * value + 1e-7;
                assert!((got - value).abs() < tolerance, "{bands} bands, band {band}: {got} {value}");
            }
            for padding in bands..results[0].len() * BLOCK {
                assert_eq!(results[0][padding / BLOCK].0[padding % BLOCK], 0.0);
            }
        }
    }

    /// The transposition of spectra, and the sum of their lines over a range of bands and columns.
    struct Lines<'a> {
        spectra: &'a [f32],
        bands: usize,
        weights: &'a [f32],
        over: (Range<usize>, Range<usize>),
    }

    impl Work for Lines<'_> {
        type Output = (Vec<f32>, Vec<f64>);

        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> Self::Output {
            let width = self.spectra.len() / self.bands;
            let mut lines = vec![0.0; self.spectra.len()];
            transpose(lanes, self.spectra, self.bands, &mut lines);
            let mut sums = vec![0.5; self.weights.len() / self.bands * width];
            let mut tables = [WeightedSums { weights: self.weights, sums: &mut sums }];
            add_weighted(lanes, (&lines, width), &self.over.0, &self.over.1, &mut tables);
            (lines, sums)
        }
    }

    #[test]
    fn lines_are_spectra_on_their_side_and_sums_are_the_same_with_every_kernel() {
        for (bands, width) in [(1, 1), (5, 40), (8, 8), (9, 16), (81, 37), (69, 7), (33, 320)] {
            let spectra = vector(bands * width, 1.0);
            // More channels than are summed at once
            let mut weights = vector(7 * bands, 0.3);
            weights[bands / 2] = 0.0;
            let over = (bands / 3..bands, width / 5..width);
            let all: Vec<(Vec<f32>, Vec<f64>)> = Kernel::available()
                .into_iter()
                .filter_map(Simd::of)
                .map(|simd| {
                    simd.run(Lines { spectra: &spectra, bands, weights: &weights, over: over.clone() })
                })
                .collect();
            let (lines, sums) = &all[0];
            assert!(all.iter().all(|one| one == &all[0]), "{bands} bands, {width} columns");
            for (index, value) in spectra.iter().enumerate() {
                assert_eq!(lines[index % bands * width + index / bands], *value);
            }
            for (index, sum) in sums.iter().enumerate() {
                let (channel, col) = (index / width, index % width);
                let term = |band: usize| {
                    f64::from(weights[channel * bands + band]) * f64::from(spectra[col * bands + band])
                };
                let added: f64 = over.0.clone().map(term).sum();
                let expected = if over.1.contains(&col) { 0.5 + added } else { 0.5 };
                // Sixteen roundings of positive terms in single precision: a product and a sum of each of eight bands
                assert!((sum - expected).abs() <= 16.0 * 2f64.powi(-24) * added, "{sum} {expected}");
            }
        }
    }

    #[test]
    fn bands_survive_padding() {
        let values = vector(37, 1.0);
        let mut out = vec![0.0; 37];
        copy_bands(&to_blocks(&values), &mut out);
        assert_eq!(out, values);
        add_bands(&to_blocks(&values), &mut out);
        assert!(out.iter().zip(&values).all(|(out, value)| *out == 2.0 * value));
        add_scaled_range(0.5, &to_blocks(&values), 14..35, &mut out);
        for (band, (out, value)) in out.iter().zip(&values).enumerate() {
            let factor = if (14..35).contains(&band) { 2.5 } else { 2.0 };
            assert_eq!(*out, factor * value, "band {band}");
        }
    }
}
