//! Arithmetic on band vectors: one number per wavelength band, padded to whole blocks.
//!
//! Everything here is plain Rust on fixed-size arrays, inlined into the caller; inside a [`Work`](crate::Work) it is
//! compiled for the widest instructions that the processor has. Sums have a fixed order, so results have the same bits
//! everywhere. Padding holds zeros and stays zero.

/// Bands per block: one vector register of AVX-512, two of AVX2.
pub const BLOCK: usize = 16;

/// Sixteen neighbouring bands.
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

/// `v = 0`.
#[inline(always)]
pub fn clear(v: &mut [BandBlock]) {
    v.fill(BandBlock::ZERO);
}

/// `out = factor * v`.
#[inline(always)]
pub fn scale(factor: f32, v: &[BandBlock], out: &mut [BandBlock]) {
    for (out, v) in out.iter_mut().zip(v) {
        for lane in 0..BLOCK {
            out.0[lane] = factor * v.0[lane];
        }
    }
}

/// `out += v`.
#[inline(always)]
pub fn add(v: &[BandBlock], out: &mut [BandBlock]) {
    for (out, v) in out.iter_mut().zip(v) {
        for lane in 0..BLOCK {
            out.0[lane] += v.0[lane];
        }
    }
}

/// `out += factor * v`.
#[inline(always)]
pub fn add_scaled(factor: f32, v: &[BandBlock], out: &mut [BandBlock]) {
    for (out, v) in out.iter_mut().zip(v) {
        for lane in 0..BLOCK {
            out.0[lane] += factor * v.0[lane];
        }
    }
}

/// `v *= slope * r + offset`: reflection by a diffuse base `r` and an achromatic lobe.
#[inline(always)]
pub fn reflect(slope: f32, r: &[BandBlock], offset: f32, v: &mut [BandBlock]) {
    for (v, r) in v.iter_mut().zip(r) {
        for lane in 0..BLOCK {
            v.0[lane] *= slope * r.0[lane] + offset;
        }
    }
}

/// `out += (slope * r + offset) * v`: light `v` reflected for the first time.
#[inline(always)]
pub fn add_reflected(slope: f32, r: &[BandBlock], offset: f32, v: &[BandBlock], out: &mut [BandBlock]) {
    for ((out, r), v) in out.iter_mut().zip(r).zip(v) {
        for lane in 0..BLOCK {
            out.0[lane] += (slope * r.0[lane] + offset) * v.0[lane];
        }
    }
}

/// A matrix `emission ⊗ excitation`, all of it or only what lies below the diagonal.
#[derive(Clone, Debug, PartialEq)]
pub struct OuterProduct {
    excitation: Vec<BandBlock>,
    emission: Vec<BandBlock>,
    /// Blocks in which excitation and emission are not all zero: first and one past the last.
    excited: (usize, usize),
    emitting: (usize, usize),
    /// Only emission bands after the excitation band count.
    masked: bool,
}

/// Entries below this fraction of the greatest one count as zero: half of the spacing of `f32` at the greatest.
const NEGLIGIBLE: f32 = f32::EPSILON / 2.0;

impl OuterProduct {
    /// The matrix with `emission[o] * excitation[i]` in row `o`, column `i`; if `masked`, only where `o > i`.
    ///
    /// Entries below 2^-24 of the greatest of their vector are dropped, so that far wings cost no time.
    ///
    /// # Panics
    /// If the vectors differ in length.
    pub fn new(excitation: &[f32], emission: &[f32], masked: bool) -> Self {
        assert_eq!(excitation.len(), emission.len(), "one value per band in both");
        let prepare = |values: &[f32]| {
            let greatest = values.iter().fold(0.0_f32, |sum, value| sum.max(value.abs()));
            let kept: Vec<f32> = values
                .iter()
                .map(|&value| if value.abs() < NEGLIGIBLE * greatest { 0.0 } else { value })
                .collect();
            let blocks = to_blocks(&kept);
            let used = |block: &BandBlock| block.0.iter().any(|&value| value != 0.0);
            let first = blocks.iter().position(used).unwrap_or(0);
            let end = blocks.iter().rposition(used).map_or(0, |last| last + 1);
            (blocks, (first, end))
        };
        let (excitation, excited) = prepare(excitation);
        let (emission, emitting) = prepare(emission);
        Self { excitation, emission, excited, emitting, masked }
    }

    /// `out += factor * M v`, in time proportional to the number of bands.
    #[inline(always)]
    pub fn add_product(&self, factor: f32, v: &[BandBlock], out: &mut [BandBlock]) {
        let blocks = self.excitation.len();
        let (v, out) = (&v[..blocks], &mut out[..blocks]);
        if !self.masked {
            let mut sums = [0.0; BLOCK];
            for block in self.excited.0..self.excited.1 {
                for lane in 0..BLOCK {
                    sums[lane] += self.excitation[block].0[lane] * v[block].0[lane];
                }
            }
            let absorbed = factor * total(&sums);
            let emitting = self.emitting.0..self.emitting.1;
            return add_scaled(absorbed, &self.emission[emitting.clone()], &mut out[emitting]);
        }
        // What was absorbed in the blocks before.
        let mut absorbed = 0.0;
        for block in self.excited.0..self.emitting.1 {
            let here = block < self.excited.1;
            let emits = block >= self.emitting.0;
            let mut sums = [absorbed; BLOCK];
            if here {
                let mut running = [0.0; BLOCK];
                for lane in 0..BLOCK {
                    running[lane] = self.excitation[block].0[lane] * v[block].0[lane];
                }
                let running = running_sum(running);
                for lane in 1..BLOCK {
                    sums[lane] = absorbed + running[lane - 1];
                }
                absorbed += running[BLOCK - 1];
            }
            if emits {
                for lane in 0..BLOCK {
                    out[block].0[lane] += (factor * self.emission[block].0[lane]) * sums[lane];
                }
            }
        }
    }
}

#[inline(always)]
fn shifted_sum<const BY: usize>(x: [f32; BLOCK]) -> [f32; BLOCK] {
    let mut shifted = [0.0; BLOCK];
    shifted[BY..].copy_from_slice(&x[..BLOCK - BY]);
    std::array::from_fn(|lane| x[lane] + shifted[lane])
}

/// Sums up to and including each lane, by doubling (Hillis and Steele 1986).
#[inline(always)]
fn running_sum(x: [f32; BLOCK]) -> [f32; BLOCK] {
    shifted_sum::<8>(shifted_sum::<4>(shifted_sum::<2>(shifted_sum::<1>(x))))
}

/// Sum of all lanes, by halving.
#[inline(always)]
fn total(x: &[f32; BLOCK]) -> f32 {
    let eight: [f32; 8] = std::array::from_fn(|lane| x[lane] + x[lane + 8]);
    let four: [f32; 4] = std::array::from_fn(|lane| eight[lane] + eight[lane + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
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
    pub fn add_product(&self, factor: f32, v: &[BandBlock], out: &mut [BandBlock]) {
        for (&(first, end, start), out) in self.spans.iter().zip(out) {
            let columns = &self.columns[start..start + (end - first)];
            let mut sums = [[0.0; BLOCK]; CHAINS];
            let (fours, rest) = columns.as_chunks::<CHAINS>();
            let mut band = first;
            for four in fours {
                for chain in 0..CHAINS {
                    let value = v[(band + chain) / BLOCK].0[(band + chain) % BLOCK];
                    for lane in 0..BLOCK {
                        sums[chain][lane] += four[chain].0[lane] * value;
                    }
                }
                band += CHAINS;
            }
            for column in rest {
                let value = v[band / BLOCK].0[band % BLOCK];
                for lane in 0..BLOCK {
                    sums[0][lane] += column.0[lane] * value;
                }
                band += 1;
            }
            for lane in 0..BLOCK {
                out.0[lane] += factor * ((sums[0][lane] + sums[1][lane]) + (sums[2][lane] + sums[3][lane]));
            }
        }
    }
}
