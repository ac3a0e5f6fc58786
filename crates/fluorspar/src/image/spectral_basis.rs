//! Few coefficients by which the spectra of a component are stored, and how all bands follow from them.

use fluorspar_accel::bands::{BLOCK, BandBlock};
use nalgebra::{DMatrix, SymmetricEigen};

/// The largest share of the bands that is worth storing as coefficients: with more, all bands are stored.
const MOST_COEFFICIENTS: f64 = 0.5;
/// The worst of all spectra is met within so many times the error of those that were seen.
const WORST: f64 = 10.0;
/// Coefficients are rounded to at least and at most so many bits of their norm.
const FEWEST_BITS: f64 = 6.0;
const MOST_BITS: f64 = 11.0;

/// Spectra of which those of a component are sums.
///
/// The spectra of a component lie near a space of few dimensions, because light meets few materials, and noise is in the factors.
/// With each band relative to its level `l`, the axes `a` of that space are orthonormal, the principal ones of the spectra that
/// were seen; a spectrum `v` has the coefficients `c_k = sum over b of a_kb v_b / l_b`, the sums of least squares, and
/// is nearly `v_b = l_b sum over k of c_k a_kb`. Coefficients are linear in the light: sums of samples, their noise and factors of
/// concentrations or lights are those of an image with all bands.
///
/// Files of runs round the `n` coefficients of a pixel to a step that they share, between 2^-(b + 1) and 2^-b of their norm: an error of
/// the spectrum of `sqrt(n) 2^-b / 5` in the root mean square and of `1.5 sqrt(n) 2^-(b + 1)` at most. `b` is 11, and less for a basis
/// whose error is so large that 2^-b is a twentieth of it at most. Small coefficients take little room.
#[derive(Clone, Debug, PartialEq)]
pub struct SpectralBasis {
    /// `[coefficient][band]`: what a coefficient of 1 adds to the spectrum.
    spectra: Vec<f32>,
    /// `[band]`: a coefficient is the sum of all bands times its spectrum times these.
    weights: Vec<f32>,
    /// Bands of the image.
    bands: usize,
    error: f32,
}

impl SpectralBasis {
    /// A basis as it was stored. `None` where the spectra, `[coefficient][band]`, do not fit the weights of the bands, or are not finite.
    pub fn new(spectra: Vec<f32>, weights: Vec<f32>, error: f32) -> Option<Self> {
        let bands = weights.len();
        let is_whole = spectra.len().is_multiple_of(bands.max(1)) && spectra.len() <= bands * bands;
        let is_basis = is_whole && are_finite(&spectra) && are_finite(&weights) && error.is_finite();
        is_basis.then_some(Self { spectra, weights, bands, error })
    }

    /// The basis in which spectra that were `seen`, `[sample][band]`, follow within `error` in the root mean square over all of them, and each of
    /// them and of those that are `possible` within ten times as much. Errors are root mean squares over the bands, relative to those of the spectrum, where each
    /// band counts relative to how bright it is in the mean sample plus `floor` times the brightest. `None` where half as many
    /// coefficients as bands would not do, or a sample is not finite.
    pub(crate) fn of_samples(
        seen: &[f32],
        possible: &[f32],
        bands: usize,
        floor: f32,
        error: f32,
    ) -> Option<Self> {
        if seen.iter().chain(possible).any(|value| !value.is_finite()) {
            return None;
        }
        let all: Vec<f32> = seen.iter().chain(possible).copied().collect();
        let mut level = levels(&all, bands, floor);
        let most = level.iter().copied().fold(0.0, f32::max);
        level.iter_mut().for_each(|level| *level *= inverse(most));
        let (seen, all) = (relative_rows(seen, &level), relative_rows(&all, &level));
        let most = (MOST_COEFFICIENTS * bands as f64) as usize;
        let mut axes = principal_axes(&seen, bands, f64::from(error), most)?;
        let worst = complete(&mut axes, all, bands, WORST * f64::from(error), most)?;

        let spectrum = |axis: &[f64]| -> Vec<f32> {
            axis.iter().zip(&level).map(|(a, level)| (a * f64::from(*level)) as f32).collect()
        };
        let weight = |level: &f32| if *level > 0.0 { f64::from(*level).recip() } else { 0.0 };
        let weight = |level: &f32| (weight(level) * weight(level)) as f32;
        let spectra = axes.chunks_exact(bands.max(1)).flat_map(spectrum).collect();
        Self::new(spectra, level.iter().map(weight).collect(), worst as f32)
    }

    /// Number of coefficients.
    pub fn len(&self) -> usize {
        self.spectra.len().checked_div(self.bands).unwrap_or(0)
    }

    /// Whether it has no coefficients, as that of a component without light.
    pub fn is_empty(&self) -> bool {
        self.spectra.is_empty()
    }

    /// `[band]`: a coefficient is the sum of all bands times its spectrum times these.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// What a band of 1 adds to each coefficient, in blocks of coefficients: `[block][band]`.
    pub(crate) fn projection_blocks(&self) -> Vec<BandBlock> {
        let value = |coefficient: usize, band: usize| {
            self.spectra[coefficient * self.bands + band] * self.weights[band]
        };
        let of_block = |first: usize| {
            (0..self.bands).map(move |band| {
                let mut block = BandBlock::ZERO;
                for coefficient in first..self.len().min(first + BLOCK) {
                    block.0[coefficient - first] = value(coefficient, band);
                }
                block
            })
        };
        (0..self.len()).step_by(BLOCK).flat_map(of_block).collect()
    }

    /// `[coefficient][band]`: what a coefficient of 1 adds to the spectrum.
    pub fn spectra(&self) -> &[f32] {
        &self.spectra
    }

    /// Error of the worst of the spectra that it was made for, root mean square over the bands relative to the spectrum.
    pub fn error(&self) -> f32 {
        self.error
    }

    /// Sums of the bands of each spectrum times weights `[row][band]`: `[row][coefficient]`.
    pub(crate) fn through(&self, weights: &[f64]) -> Vec<f64> {
        let sum = |weights: &[f64], spectrum: &[f32]| -> f64 {
            weights.iter().zip(spectrum).map(|(weight, value)| weight * f64::from(*value)).sum()
        };
        let of_row =
            |weights| self.spectra.chunks_exact(self.bands).map(move |spectrum| sum(weights, spectrum));
        weights.chunks_exact(self.bands).flat_map(of_row).collect()
    }

    /// Adds all bands of a spectrum times a factor, of which the coefficients are given. What left the range of numbers is infinite in all
    /// bands, here and below: signs of spectra would make it no number, and that darkness.
    pub fn add(&self, factor: f32, coefficients: &[f32], out: &mut [f32]) {
        if factor != 0.0 && !are_finite(coefficients) {
            return out.fill(f32::INFINITY);
        }
        for (value, spectrum) in coefficients.iter().zip(self.spectra.chunks_exact(self.bands)) {
            let value = factor * value;
            if value != 0.0 {
                out.iter_mut().zip(spectrum).for_each(|(sum, of)| *sum += value * of);
            }
        }
    }

    /// Rounds coefficients `[coefficient][pixel]` of some pixels as files of runs have them.
    pub(super) fn round(&self, coefficients: &mut [f32], pixels: usize) {
        let bits = -(f64::from(self.error) / (2.0 * WORST)).log2().floor();
        round_together(coefficients, pixels, bits.clamp(FEWEST_BITS, MOST_BITS) as i32);
    }

    /// All bands of a spectrum of which the coefficients are given.
    pub fn all_bands(&self, coefficients: &[f64]) -> Vec<f64> {
        if !coefficients.iter().all(|value| value.is_finite()) {
            return vec![f64::INFINITY; self.bands];
        }
        let mut all = vec![0.0; self.bands];
        for (value, spectrum) in coefficients.iter().zip(self.spectra.chunks_exact(self.bands)) {
            all.iter_mut().zip(spectrum).for_each(|(sum, of)| *sum += value * f64::from(*of));
        }
        all
    }

    /// All bands, `[band][col]`, of lines `[coefficient][col]`.
    pub fn lines(&self, coefficients: &[f32], width: usize) -> Vec<f32> {
        let mut lines = vec![0.0; self.bands * width];
        for (values, spectrum) in
            coefficients.chunks_exact(width.max(1)).zip(self.spectra.chunks_exact(self.bands))
        {
            for (line, of) in lines.chunks_exact_mut(width).zip(spectrum).filter(|(_, of)| **of != 0.0) {
                line.iter_mut().zip(values).for_each(|(sum, value)| *sum += of * value);
            }
        }
        if !are_finite(coefficients) {
            for col in
                (0..width).filter(|col| !coefficients.iter().skip(*col).step_by(width).all(|v| v.is_finite()))
            {
                lines.iter_mut().skip(col).step_by(width).for_each(|value| *value = f32::INFINITY);
            }
        }
        lines
    }
}

/// Whether all values are numbers.
pub(crate) fn are_finite(values: &[f32]) -> bool {
    values.iter().all(|value| value.is_finite())
}

/// Rounds coefficients `[coefficient][pixel]` of some pixels to steps that those of a pixel share, at most 2^-bits of their norm. Once more
/// changes nothing.
fn round_together(coefficients: &mut [f32], pixels: usize, bits: i32) {
    // Adding and taking away rounds to whole numbers
    const WHOLE: f64 = 1.5 * (1_u64 << 52) as f64;
    let mut squares = vec![0.0_f64; pixels];
    let mut steps = vec![1.0_f64; pixels];
    // The second time where the first has brought the norm to the next power of two
    for _ in 0..2 {
        squares.fill(0.0);
        for line in coefficients.chunks_exact(pixels) {
            squares
                .iter_mut()
                .zip(line)
                .for_each(|(sum, value)| *sum += f64::from(*value) * f64::from(*value));
        }
        for (step, squares) in steps.iter_mut().zip(&squares) {
            let exponent = (squares.to_bits() >> 52) as i32 - 1023;
            let exponent = exponent.div_euclid(2) - bits;
            *step = if squares.is_normal() { f64::from_bits(((1023 + exponent) as u64) << 52) } else { 0.0 };
        }
        for line in coefficients.chunks_exact_mut(pixels) {
            for (value, step) in line.iter_mut().zip(&steps).filter(|(_, step)| **step > 0.0) {
                *value = ((f64::from(*value) / step + WHOLE - WHOLE) * step) as f32;
            }
        }
    }
}

/// Samples `[sample][band]` relative to the levels of the bands, each scaled to a root mean square of 1; dark ones are left out.
fn relative_rows(samples: &[f32], level: &[f32]) -> Vec<f64> {
    let mut rows = Vec::with_capacity(samples.len());
    for sample in samples.chunks_exact(level.len().max(1)) {
        let bright = inverse(size(sample));
        let scaled = |(value, level): (&f32, &f32)| f64::from(value * bright) * f64::from(inverse(*level));
        let row: Vec<f64> = sample.iter().zip(level).map(scaled).collect();
        let size = norm(&row);
        if size > 0.0 {
            rows.extend(row.iter().map(|value| value / size));
        }
    }
    rows
}

/// The principal axes of rows of norm 1, `[axis][band]`, by which all but `error` of them is told in the root mean square; `None` where more
/// than `most` are needed.
fn principal_axes(rows: &[f64], bands: usize, error: f64, most: usize) -> Option<Vec<f64>> {
    let rows = rows.chunks_exact(bands.max(1));
    let count = rows.len();
    let mut moments = DMatrix::<f64>::zeros(bands, bands);
    for row in rows {
        for (a, value) in row.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            moments.column_mut(a).iter_mut().zip(row).for_each(|(sum, other)| *sum += value * other);
        }
    }
    let eigen = SymmetricEigen::new(moments / count.max(1) as f64);
    let mut order: Vec<usize> = (0..bands).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let left = |axes: usize| order[axes..].iter().map(|at| eigen.eigenvalues[*at].max(0.0)).sum::<f64>();
    let needed = (0..=most).find(|axes| count == 0 || left(*axes) <= error * error)?;
    Some(
        order[..needed]
            .iter()
            .flat_map(|at| eigen.eigenvectors.column(*at).iter().copied().collect::<Vec<_>>())
            .collect(),
    )
}

/// Adds axes until each of some rows of norm 1 is met within an error: the worst one's direction again and again. Returns the error
/// left; `None` where more than `most` axes are needed.
fn complete(axes: &mut Vec<f64>, mut rows: Vec<f64>, bands: usize, error: f64, most: usize) -> Option<f64> {
    let take = |axis: &[f64], row: &mut [f64]| {
        let part: f64 = axis.iter().zip(&*row).map(|(a, b)| a * b).sum();
        row.iter_mut().zip(axis).for_each(|(value, of)| *value -= part * of);
    };
    for row in rows.chunks_exact_mut(bands.max(1)) {
        axes.chunks_exact(bands).for_each(|axis| take(axis, row));
    }
    loop {
        let sizes = rows.chunks_exact(bands.max(1)).map(norm).enumerate();
        let Some((worst, size)) = sizes.max_by(|a, b| a.1.total_cmp(&b.1)) else { return Some(0.0) };
        if size <= error {
            return Some(size);
        }
        if axes.len() >= most * bands {
            return None;
        }
        let mut axis: Vec<f64> = rows[worst * bands..][..bands].to_vec();
        // Once more, against rounding
        axes.chunks_exact(bands).for_each(|other| take(other, &mut axis));
        let size = norm(&axis);
        axis.iter_mut().for_each(|value| *value /= size);
        rows.chunks_exact_mut(bands).for_each(|row| take(&axis, row));
        axes.extend(axis);
    }
}

/// Samples `[sample][band]` of which all others are nearly sums, at most so many: the one that is farthest from the sums of those
/// chosen before, again and again.
pub(crate) fn representatives(samples: &[f32], bands: usize, error: f32, most: usize) -> Vec<f32> {
    let level = levels(samples, bands, 1.0);
    let with_row = |sample| (sample, relative_rows(sample, &level));
    let (lit, rows): (Vec<&[f32]>, Vec<Vec<f64>>) =
        samples.chunks_exact(bands.max(1)).map(with_row).filter(|(_, row)| !row.is_empty()).unzip();
    let mut rows = rows.concat();
    let mut chosen = Vec::new();
    while chosen.len() < most * bands {
        let sizes = rows.chunks_exact(bands.max(1)).map(norm).enumerate();
        let Some((worst, size)) = sizes.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        if size <= f64::from(error) {
            break;
        }
        let axis: Vec<f64> = rows[worst * bands..][..bands].iter().map(|value| value / size).collect();
        for row in rows.chunks_exact_mut(bands) {
            let part: f64 = axis.iter().zip(&*row).map(|(a, b)| a * b).sum();
            row.iter_mut().zip(&axis).for_each(|(value, of)| *value -= part * of);
        }
        chosen.extend_from_slice(lit[worst]);
    }
    chosen
}

/// How bright each band is in the mean of the samples, each of them as bright as any, plus `floor` times the brightest band; 0 where all are
/// dark.
fn levels(samples: &[f32], bands: usize, floor: f32) -> Vec<f32> {
    let mut levels = vec![0.0_f32; bands];
    for row in samples.chunks_exact(bands) {
        let size = inverse(size(row));
        levels.iter_mut().zip(row).for_each(|(level, value)| *level += size * value.abs());
    }
    let most = levels.iter().copied().fold(0.0, f32::max);
    levels.iter().map(|level| if *level > 0.0 { level + floor * most } else { 0.0 }).collect()
}

/// Root mean square of values whose squares may leave the range of numbers.
fn size(values: &[f32]) -> f32 {
    let most = values.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
    let squares: f32 = values.iter().map(|value| (value * inverse(most)).powi(2)).sum();
    most * (squares / values.len().max(1) as f32).sqrt()
}

fn inverse(value: f32) -> f32 {
    if value > 0.0 && value.is_normal() { value.recip() } else { 0.0 }
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of three smooth spectra of 40 bands, one of them dim.
    fn samples() -> Vec<f32> {
        let peak = |middle: f32, width: f32, band: usize| (-((band as f32 - middle) / width).powi(2)).exp();
        let factor = |sample: usize, k: usize| 0.1 + ((sample * (k + 2) * 7919 + k) % 97) as f32 / 97.0;
        let value = |sample: usize, band: usize| {
            let parts = [peak(8.0, 6.0, band), peak(22.0, 9.0, band), 1e-3 * peak(30.0, 3.0, band)];
            (0..3).map(|k| factor(sample, k) * parts[k]).sum::<f32>()
        };
        (0..50).flat_map(|sample| (0..40).map(move |band| (sample, band))).map(|(s, b)| value(s, b)).collect()
    }

    #[test]
    fn sums_of_three_spectra_have_three_coefficients() {
        let all = samples();
        let basis = SpectralBasis::of_samples(&all[..20 * 40], &[], 40, 1e-4, 1e-4).unwrap();
        assert_eq!(basis.len(), 3);
        let blocks = basis.projection_blocks();
        for sample in all.chunks_exact(40) {
            let of_band = |(band, value): (usize, &f32)| blocks[band].0.map(|weight| weight * value);
            let mut coefficients = [0.0; 3];
            for of_band in sample.iter().enumerate().map(of_band) {
                coefficients.iter_mut().zip(of_band).for_each(|(sum, value)| *sum += value);
            }
            let mut spectrum = vec![0.0; 40];
            basis.add(2.0, &coefficients, &mut spectrum);
            for (value, expected) in spectrum.iter().zip(sample) {
                assert!((value - 2.0 * expected).abs() < 1e-3 * expected + 1e-6, "{value} {expected}");
            }
            assert_eq!(basis.lines(&coefficients, 1).iter().map(|v| 2.0 * v).collect::<Vec<_>>(), spectrum);
            let weights: Vec<f64> = (0..80).map(|at| f64::from(at % 7)).collect();
            let rows = basis.through(&weights);
            for (row, weights) in rows.chunks_exact(3).zip(weights.chunks_exact(40)) {
                let short: f64 = row.iter().zip(&coefficients).map(|(a, b)| a * f64::from(*b)).sum();
                let long: f64 = weights.iter().zip(sample).map(|(a, b)| a * f64::from(*b)).sum();
                assert!((short - long).abs() < 1e-3 * long, "{short} {long}");
            }
        }
        // The dim one of them is less than the error beside the others
        assert_eq!(representatives(&all, 40, 1e-3, 24).len(), 2 * 40);
    }

    #[test]
    fn what_was_not_seen_but_may_occur_is_met_too() {
        let all = samples();
        // A narrow line, which none of the samples has
        let mut line = vec![0.0_f32; 40];
        line[33] = 1.0;
        let basis = SpectralBasis::of_samples(&all, &line, 40, 1e-2, 1e-4).unwrap();
        assert_eq!(basis.len(), 4);
        assert!(basis.error() <= 1e-3);
        let basis = SpectralBasis::of_samples(&all, &all, 40, 1e-2, 1e-4).unwrap();
        assert_eq!(basis.len(), 3);
    }

    #[test]
    fn dark_samples_take_no_coefficient_and_noise_takes_all_bands() {
        let dark = SpectralBasis::of_samples(&[0.0; 80], &[0.0; 40], 40, 1e-3, 1e-3).unwrap();
        assert!(dark.is_empty());
        let noise: Vec<f32> =
            (0..4000_u32).map(|at| (at.wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0).collect();
        assert_eq!(SpectralBasis::of_samples(&noise, &[], 40, 1e-3, 1e-3), None);
        assert_eq!(SpectralBasis::of_samples(&[], &noise, 40, 1e-3, 1e-3), None);
        // Light of any brightness takes as many, and what is infinite all
        let count = |factor: f32| {
            let bright: Vec<f32> = samples().iter().map(|value| factor * value).collect();
            SpectralBasis::of_samples(&bright, &[], 40, 1e-4, 1e-4).map(|basis| basis.len())
        };
        assert_eq!([-80, 0, 80].map(|power| count(2_f32.powi(power))), [Some(3); 3]);
        assert_eq!(count(f32::INFINITY), None);
    }

    #[test]
    fn a_damaged_basis_is_refused() {
        assert!(SpectralBasis::new(vec![0.0; 6], vec![1.0; 3], 0.0).is_some());
        for (weights, spectra) in
            [(vec![1.0; 2], 6), (vec![1.0; 3], 5), (vec![f32::INFINITY; 3], 6), (vec![1.0; 3], 12)]
        {
            assert_eq!(SpectralBasis::new(vec![0.0; spectra], weights, 0.0), None);
        }
        assert_eq!(SpectralBasis::new(vec![0.0, f32::NAN, 0.0], vec![1.0; 3], 0.0), None);
        assert_eq!(SpectralBasis::new(vec![0.0; 3], vec![1.0; 3], f32::NAN), None);
    }

    #[test]
    fn what_is_infinite_is_so_in_all_bands() {
        let spectra = vec![1.0, 1.0, 0.0, 1.0, -1.0, 0.0];
        let basis = SpectralBasis::new(spectra, vec![0.5; 3], 0.0).unwrap();
        let mut spectrum = [0.0; 3];
        basis.add(1.0, &[f32::INFINITY; 2], &mut spectrum);
        assert_eq!(spectrum, [f32::INFINITY; 3]);
        assert_eq!(basis.all_bands(&[f64::NEG_INFINITY, 0.0]), [f64::INFINITY; 3]);
        let lines = basis.lines(&[1.0, f32::INFINITY, 2.0, f32::INFINITY], 2);
        assert_eq!(lines, [3.0, f32::INFINITY, -1.0, f32::INFINITY, 0.0, f32::INFINITY]);
    }

    #[test]
    fn rounding_together_keeps_the_spectrum_and_is_done_once() {
        let norm = |values: &[f32]| values.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
        for number in 0..4000_u32 {
            // Norms around powers of two among them
            let size =
                (1.0 + 1e-4 * ((number % 41) as f32 - 20.0)) * 2_f32.powi((number % 7) as i32 * 20 - 60);
            let part = |k: u32| ((number * 7919 + k * 104_729) % 1009) as f32 / 504.5 - 1.0;
            let values: Vec<f32> = (0..9).map(part).collect();
            let values: Vec<f32> =
                values.iter().map(|v| (f64::from(v * size) / norm(&values)) as f32).collect();
            let mut once = values.clone();
            round_together(&mut once, 1, 11);
            let error: Vec<f32> = once.iter().zip(&values).map(|(a, b)| a - b).collect();
            assert!(norm(&error) <= 1.5 * 3.0 * 2_f64.powi(-12) * norm(&values));
            assert!(once.iter().all(|value| value.to_bits() & 0xff == 0), "{once:?}");
            let mut again = once.clone();
            round_together(&mut again, 1, 11);
            assert_eq!(again, once);
            // Beside another pixel it is the same
            let mut lines: Vec<f32> = values.iter().flat_map(|value| [*value, 1.0]).collect();
            round_together(&mut lines, 2, 11);
            assert!(lines.chunks_exact(2).zip(&once).all(|(pair, value)| pair[0] == *value));
        }
        // A basis that errs more is rounded to fewer bits, by a fraction of its error
        for (error, bits) in [(0.0, 11), (4e-3, 11), (0.05, 9), (0.2, 7), (10.0, 6)] {
            let basis = SpectralBasis::new(vec![0.0; 9], vec![1.0; 9], error).unwrap();
            let mut values = [1.0, 2_f32.powi(-1 - bits), 0.0];
            basis.round(&mut values, 1);
            assert_eq!(values, [1.0, 0.0, 0.0], "{error}");
            let mut values = [1.0, 2_f32.powi(-bits), 0.0];
            basis.round(&mut values, 1);
            assert_eq!(values[1], 2_f32.powi(-bits), "{error}");
        }
        let mut beyond = [1.234_567_8, f32::INFINITY];
        round_together(&mut beyond, 1, 11);
        assert_eq!(beyond, [1.234_567_8, f32::INFINITY]);
    }
}
