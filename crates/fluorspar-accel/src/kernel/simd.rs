//! Sixteen numbers at once, with the widest vector instructions that the processor has.

use super::{Dispatch, Kernel};
use crate::bands::{BLOCK, BandBlock};

/// Instructions on sixteen numbers.
///
/// A value of a type with this trait proves that the processor has them. Every implementation rounds alike: there is no
/// fused multiplication and addition, and no reordered sum, so results have the same bits whichever instructions run.
pub trait Lanes: Copy {
    /// Sixteen numbers.
    type Vector: Copy;

    /// Reads a block.
    fn load(self, block: &BandBlock) -> Self::Vector;
    /// Reads sixteen numbers that lie anywhere.
    fn read(self, values: &[f32; BLOCK]) -> Self::Vector;
    /// Writes a block.
    fn store(self, vector: Self::Vector, block: &mut BandBlock);
    /// The same number sixteen times.
    fn splat(self, value: f32) -> Self::Vector;
    /// `a + b`.
    fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a * b`.
    fn mul(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// Each number moves `BY` (1, 2, 4 or 8) lanes up; zeros come in.
    fn shift<const BY: usize>(self, vector: Self::Vector) -> Self::Vector;
    /// The last number sixteen times.
    fn splat_last(self, vector: Self::Vector) -> Self::Vector;
    /// Asks for the cache line of a number that will be read soon; beyond the end of the slice, for nothing.
    fn prefetch(self, values: &[f32], at: usize);
    /// Eight rows of eight numbers as eight columns; rows begin `steps` numbers apart, first those that are read.
    ///
    /// # Panics
    /// Where a slice ends before its last row does.
    fn transpose_8(self, from: &[f32], to: &mut [f32], steps: [usize; 2]);
}

/// Arithmetic that is compiled once for each instruction set.
///
/// `run` must be marked `#[inline(always)]`, and so must everything generic over [`Lanes`] that it calls.
pub trait Work {
    /// Result.
    type Output;

    /// Does the work with these instructions.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// Vector instructions that this processor is known to have.
#[derive(Clone, Copy, Debug)]
pub struct Simd(Dispatch);

impl Simd {
    /// The widest that this processor has.
    pub fn detect() -> Self {
        Self(Dispatch::new(Kernel::fastest()).unwrap_or(Dispatch::Portable))
    }

    /// Those of a kernel; `None` if this processor lacks them.
    pub fn of(kernel: Kernel) -> Option<Self> {
        Dispatch::new(kernel).map(Self)
    }

    /// Does the work with these instructions.
    #[inline]
    pub fn run<W: Work>(self, work: W) -> W::Output {
        match self.0 {
            Dispatch::Portable => work.run(Arrays),
            // SAFETY: the token proves that the instructions have been detected.
            #[cfg(target_arch = "x86_64")]
            Dispatch::Avx2(detected) => unsafe { x86::with_avx2(work, detected) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Dispatch::Avx512(detected) => unsafe { x86::with_avx512(work, detected) },
        }
    }
}

/// Plain Rust.
#[derive(Clone, Copy)]
struct Arrays;

impl Lanes for Arrays {
    type Vector = [f32; BLOCK];

    #[inline(always)]
    fn load(self, block: &BandBlock) -> [f32; BLOCK] {
        block.0
    }

    #[inline(always)]
    fn read(self, values: &[f32; BLOCK]) -> [f32; BLOCK] {
        *values
    }

    #[inline(always)]
    fn store(self, vector: [f32; BLOCK], block: &mut BandBlock) {
        block.0 = vector;
    }

    #[inline(always)]
    fn splat(self, value: f32) -> [f32; BLOCK] {
        [value; BLOCK]
    }

    #[inline(always)]
    fn add(self, mut a: [f32; BLOCK], b: [f32; BLOCK]) -> [f32; BLOCK] {
        for lane in 0..BLOCK {
            a[lane] += b[lane];
        }
        a
    }

    #[inline(always)]
    fn mul(self, mut a: [f32; BLOCK], b: [f32; BLOCK]) -> [f32; BLOCK] {
        for lane in 0..BLOCK {
            a[lane] *= b[lane];
        }
        a
    }

    #[inline(always)]
    fn shift<const BY: usize>(self, vector: [f32; BLOCK]) -> [f32; BLOCK] {
        let mut shifted = [0.0; BLOCK];
        shifted[BY..].copy_from_slice(&vector[..BLOCK - BY]);
        shifted
    }

    #[inline(always)]
    fn splat_last(self, vector: [f32; BLOCK]) -> [f32; BLOCK] {
        [vector[BLOCK - 1]; BLOCK]
    }

    #[inline(always)]
    fn prefetch(self, _: &[f32], _: usize) {}

    #[inline(always)]
    fn transpose_8(self, from: &[f32], to: &mut [f32], [from_step, to_step]: [usize; 2]) {
        for row in 0..8 {
            for (col, value) in from[row * from_step..][..8].iter().enumerate() {
                to[col * to_step + row] = *value;
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::super::x86::{Avx2, Avx512};
    use super::{BLOCK, BandBlock, Lanes, Work};

    #[target_feature(enable = "avx2,bmi1,popcnt")]
    pub(super) fn with_avx2<W: Work>(work: W, detected: Avx2) -> W::Output {
        work.run(detected)
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2,popcnt")]
    pub(super) fn with_avx512<W: Work>(work: W, detected: Avx512) -> W::Output {
        work.run(detected)
    }

    /// Lanes `FROM` to 15 of sixteen zeros, then the first lanes of a vector.
    ///
    /// Written as an instruction because the compiler turns the intrinsic into an expansion under a mask, which it loads
    /// anew each time: with that, five fluorophores at 69 bands take 155 ns a vertex instead of 64.
    #[inline]
    #[target_feature(enable = "avx512f")]
    fn align_with_zeros<const FROM: i32>(vector: __m512) -> __m512 {
        let shifted: __m512;
        // SAFETY: the instruction reads and writes registers only, and AVX-512 F is enabled.
        unsafe {
            std::arch::asm!(
                "valignd {shifted}, {vector}, {zero}, {from}",
                shifted = lateout(zmm_reg) shifted,
                vector = in(zmm_reg) vector,
                zero = in(zmm_reg) _mm512_setzero_ps(),
                from = const FROM,
                options(pure, nomem, nostack, preserves_flags),
            );
        }
        shifted
    }

    /// [`Lanes::prefetch`].
    #[inline(always)]
    fn prefetch(values: &[f32], at: usize) {
        if let Some(value) = values.get(at) {
            // SAFETY: SSE, to which the instruction belongs, is part of x86-64; it changes nothing that a program sees.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(value).cast()) };
        }
    }

    /// [`Lanes::transpose_8`]: pairs of rows, then fours, then halves.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn transpose_8(from: &[f32], to: &mut [f32], [from_step, to_step]: [usize; 2]) {
        let holds = |length: usize, step: usize| 7 * step + 8 <= length;
        assert!(holds(from.len(), from_step) && holds(to.len(), to_step), "eight rows of eight");
        // SAFETY: the slice holds eight numbers from the start of each row on.
        let row = |row: usize| unsafe { _mm256_loadu_ps(from.as_ptr().add(row * from_step)) };
        let pairs = |a: __m256, b: __m256| (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
        let fours = |a: (__m256, __m256), b: (__m256, __m256)| {
            [
                _mm256_shuffle_ps::<0x44>(a.0, b.0),
                _mm256_shuffle_ps::<0xee>(a.0, b.0),
                _mm256_shuffle_ps::<0x44>(a.1, b.1),
                _mm256_shuffle_ps::<0xee>(a.1, b.1),
            ]
        };
        let upper = fours(pairs(row(0), row(1)), pairs(row(2), row(3)));
        let lower = fours(pairs(row(4), row(5)), pairs(row(6), row(7)));
        for (col, (upper, lower)) in upper.into_iter().zip(lower).enumerate() {
            // SAFETY: the slice holds eight numbers from the start of each of its rows on.
            unsafe {
                let start = to.as_mut_ptr().add(col * to_step);
                _mm256_storeu_ps(start, _mm256_permute2f128_ps::<0x20>(upper, lower));
                _mm256_storeu_ps(start.add(4 * to_step), _mm256_permute2f128_ps::<0x31>(upper, lower));
            }
        }
    }

    // SAFETY of the blocks below: a value of either type proves that the processor has the instructions, and blocks
    // are aligned to 64 bytes and 64 bytes long.
    impl Lanes for Avx2 {
        type Vector = [__m256; 2];

        #[inline(always)]
        fn load(self, block: &BandBlock) -> [__m256; 2] {
            let start = block.0.as_ptr();
            // SAFETY: as above.
            unsafe { [_mm256_load_ps(start), _mm256_load_ps(start.add(8))] }
        }

        #[inline(always)]
        fn read(self, values: &[f32; BLOCK]) -> [__m256; 2] {
            let start = values.as_ptr();
            // SAFETY: as above, and sixteen numbers lie there.
            unsafe { [_mm256_loadu_ps(start), _mm256_loadu_ps(start.add(8))] }
        }

        #[inline(always)]
        fn store(self, [low, high]: [__m256; 2], block: &mut BandBlock) {
            let start = block.0.as_mut_ptr();
            // SAFETY: as above.
            unsafe {
                _mm256_store_ps(start, low);
                _mm256_store_ps(start.add(8), high);
            }
        }

        #[inline(always)]
        fn splat(self, value: f32) -> [__m256; 2] {
            // SAFETY: as above.
            [unsafe { _mm256_set1_ps(value) }; 2]
        }

        #[inline(always)]
        fn add(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            // SAFETY: as above.
            unsafe { [_mm256_add_ps(a[0], b[0]), _mm256_add_ps(a[1], b[1])] }
        }

        #[inline(always)]
        fn mul(self, a: [__m256; 2], b: [__m256; 2]) -> [__m256; 2] {
            // SAFETY: as above.
            unsafe { [_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1])] }
        }

        #[inline(always)]
        fn shift<const BY: usize>(self, [low, high]: [__m256; 2]) -> [__m256; 2] {
            // SAFETY: as above.
            unsafe {
                if BY == 8 {
                    return [_mm256_setzero_ps(), low];
                }
                // Four lanes up, then the rest within each half register.
                let by_four =
                    [_mm256_permute2f128_ps::<0x08>(low, low), _mm256_permute2f128_ps::<0x21>(low, high)];
                let align = |x: __m256, below: __m256| {
                    let (x, below) = (_mm256_castps_si256(x), _mm256_castps_si256(below));
                    _mm256_castsi256_ps(match BY {
                        1 => _mm256_alignr_epi8::<12>(x, below),
                        2 => _mm256_alignr_epi8::<8>(x, below),
                        _ => below,
                    })
                };
                [align(low, by_four[0]), align(high, by_four[1])]
            }
        }

        #[inline(always)]
        fn splat_last(self, [_, high]: [__m256; 2]) -> [__m256; 2] {
            // SAFETY: as above.
            [unsafe { _mm256_permutevar8x32_ps(high, _mm256_set1_epi32(7)) }; 2]
        }

        #[inline(always)]
        fn prefetch(self, values: &[f32], at: usize) {
            prefetch(values, at);
        }

        #[inline(always)]
        fn transpose_8(self, from: &[f32], to: &mut [f32], steps: [usize; 2]) {
            // SAFETY: as above.
            unsafe { transpose_8(from, to, steps) }
        }
    }

    impl Lanes for Avx512 {
        type Vector = __m512;

        #[inline(always)]
        fn load(self, block: &BandBlock) -> __m512 {
            // SAFETY: as above.
            unsafe { _mm512_load_ps(block.0.as_ptr()) }
        }

        #[inline(always)]
        fn read(self, values: &[f32; BLOCK]) -> __m512 {
            // SAFETY: as above, and sixteen numbers lie there.
            unsafe { _mm512_loadu_ps(values.as_ptr()) }
        }

        #[inline(always)]
        fn store(self, vector: __m512, block: &mut BandBlock) {
            // SAFETY: as above.
            unsafe { _mm512_store_ps(block.0.as_mut_ptr(), vector) }
        }

        #[inline(always)]
        fn splat(self, value: f32) -> __m512 {
            // SAFETY: as above.
            unsafe { _mm512_set1_ps(value) }
        }

        #[inline(always)]
        fn add(self, a: __m512, b: __m512) -> __m512 {
            // SAFETY: as above.
            unsafe { _mm512_add_ps(a, b) }
        }

        #[inline(always)]
        fn mul(self, a: __m512, b: __m512) -> __m512 {
            // SAFETY: as above.
            unsafe { _mm512_mul_ps(a, b) }
        }

        #[inline(always)]
        fn shift<const BY: usize>(self, vector: __m512) -> __m512 {
            // SAFETY: as above.
            unsafe {
                match BY {
                    1 => align_with_zeros::<15>(vector),
                    2 => align_with_zeros::<14>(vector),
                    4 => align_with_zeros::<12>(vector),
                    _ => align_with_zeros::<8>(vector),
                }
            }
        }

        #[inline(always)]
        fn splat_last(self, vector: __m512) -> __m512 {
            // SAFETY: as above.
            unsafe { _mm512_permutexvar_ps(_mm512_set1_epi32(15), vector) }
        }

        #[inline(always)]
        fn prefetch(self, values: &[f32], at: usize) {
            prefetch(values, at);
        }

        #[inline(always)]
        fn transpose_8(self, from: &[f32], to: &mut [f32], steps: [usize; 2]) {
            // SAFETY: as above; AVX2 is among the instructions that were detected.
            unsafe { transpose_8(from, to, steps) }
        }
    }
}
