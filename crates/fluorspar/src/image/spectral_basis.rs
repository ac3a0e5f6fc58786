//! Few bands of which the spectra of a component are stored, and how the others follow from them.

/// The largest share of the bands that are worth storing: with more, all are stored.
const MOST_BANDS: f64 = 0.5;

/// Bands of which a component is stored, and spectra by which all bands follow from them.
///
/// The spectra of a component lie near a space of few dimensions, because light meets few materials, and noise is in the factors.
/// Empirical interpolation finds bands and spectra: what interpolates worst of what may occur, and the band in which it does, become the
/// next ones (Barrault, Maday, Nguyen and Patera 2004, doi:10.1016/j.crma.2004.08.006). Stored bands are radiance as it is, so that
/// sums of samples, their rounding and their noise are those of an image with all bands.
#[derive(Clone, Debug, PartialEq)]
pub struct SpectralBasis {
    /// Stored bands, ascending.
    stored: Vec<usize>,
    /// `[stored band][band]`: the spectrum of which a stored band of 1 is a part, 0 in the other stored bands.
    spectra: Vec<f32>,
    /// Bands of the image.
    bands: usize,
    error: f32,
}

impl SpectralBasis {
    /// A basis as it was stored. `None` where bands are not ascending or the spectra do not fill them.
    pub fn new(stored: Vec<usize>, spectra: Vec<f32>, bands: usize, error: f32) -> Option<Self> {
        let is_ascending =
            stored.is_sorted_by(|a, b| a < b) && stored.last().is_none_or(|last| *last < bands);
        let fits = spectra.len() == stored.len() * bands && spectra.iter().all(|value| value.is_finite());
        (is_ascending && fits).then_some(Self { stored, spectra, bands, error })
    }

    /// The basis from which all `samples`, `[sample][band]`, follow within `error`: the root mean square over the bands of a sample, relative
    /// to it, where each band counts relative to how bright it is in the mean sample plus `floor` times the brightest. `None` where
    /// half of the bands would not do, or a sample is not finite.
    pub(crate) fn interpolating(samples: &[f32], bands: usize, floor: f32, error: f32) -> Option<Self> {
        if samples.iter().any(|value| !value.is_finite()) {
            return None;
        }
        let interpolation =
            Interpolation::new(samples, bands, floor, error, (MOST_BANDS * bands as f64) as usize);
        (interpolation.error <= error).then(|| interpolation.basis())
    }

    /// Stored bands, ascending.
    pub fn stored(&self) -> &[usize] {
        &self.stored
    }

    /// `[stored band][band]`: the spectrum of which a stored band of 1 is a part.
    pub fn spectra(&self) -> &[f32] {
        &self.spectra
    }

    /// Error of the worst of the spectra that it was made for, root mean square over the bands relative to the spectrum.
    pub fn error(&self) -> f32 {
        self.error
    }

    /// Sums of the bands of each spectrum times weights `[row][band]`: `[row][stored band]`.
    pub(crate) fn through(&self, weights: &[f64]) -> Vec<f64> {
        let sum = |weights: &[f64], spectrum: &[f32]| -> f64 {
            weights.iter().zip(spectrum).map(|(weight, value)| weight * f64::from(*value)).sum()
        };
        let of_row =
            |weights| self.spectra.chunks_exact(self.bands).map(move |spectrum| sum(weights, spectrum));
        weights.chunks_exact(self.bands).flat_map(of_row).collect()
    }

    /// Adds all bands of a spectrum times a factor, of which the stored bands are given.
    pub fn add(&self, factor: f32, stored: &[f32], out: &mut [f32]) {
        for (value, spectrum) in stored.iter().zip(self.spectra.chunks_exact(self.bands)) {
            let value = factor * value;
            if value != 0.0 {
                out.iter_mut().zip(spectrum).for_each(|(sum, of)| *sum += value * of);
            }
        }
    }

    /// All bands of a spectrum of which the stored bands are given.
    pub fn all_bands(&self, stored: &[f64]) -> Vec<f64> {
        let mut all = vec![0.0; self.bands];
        for (value, spectrum) in stored.iter().zip(self.spectra.chunks_exact(self.bands)) {
            all.iter_mut().zip(spectrum).for_each(|(sum, of)| *sum += value * f64::from(*of));
        }
        all
    }

    /// All bands, `[band][col]`, of lines `[stored band][col]`.
    pub fn lines(&self, stored: &[f32], width: usize) -> Vec<f32> {
        let mut lines = vec![0.0; self.bands * width];
        for (values, spectrum) in stored.chunks_exact(width.max(1)).zip(self.spectra.chunks_exact(self.bands))
        {
            for (line, of) in lines.chunks_exact_mut(width).zip(spectrum).filter(|(_, of)| **of != 0.0) {
                line.iter_mut().zip(values).for_each(|(sum, value)| *sum += of * value);
            }
        }
        lines
    }
}

/// Samples from which the interpolant chosen so far is taken away.
struct Interpolation {
    /// `1 / scale` of each band; 0 where all samples are dark.
    level: Vec<f32>,
    /// Chosen bands, and with each its spectrum of scaled values, 1 there and 0 in the other chosen bands.
    chosen: Vec<(usize, Vec<f32>)>,
    /// Samples that were chosen.
    samples: Vec<usize>,
    /// Largest error left.
    error: f32,
}

impl Interpolation {
    fn new(samples: &[f32], bands: usize, floor: f32, error: f32, most: usize) -> Self {
        let mut found = Self {
            level: levels(samples, bands, floor),
            chosen: Vec::new(),
            samples: Vec::new(),
            error: 0.0,
        };
        // Scale the bands, and the samples to a root mean square of 1
        let mut rest: Vec<f32> = samples.to_vec();
        for row in rest.chunks_exact_mut(bands) {
            let bright = inverse(size(row));
            row.iter_mut().zip(&found.level).for_each(|(value, level)| *value *= bright * inverse(*level));
            let size = rms(row);
            row.iter_mut().for_each(|value| *value *= inverse(size));
        }
        loop {
            // The sample that is farthest from its interpolant, and the band in which it is
            let sizes = rest.chunks_exact(bands).map(rms).enumerate();
            let worst = sizes.filter(|(_, size)| size.is_finite()).max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((worst, size)) = worst else { return found };
            found.error = size;
            if size <= error || found.chosen.len() == most {
                return found;
            }
            let row = &rest[worst * bands..][..bands];
            let band = (0..bands).max_by(|a, b| row[*a].abs().total_cmp(&row[*b].abs())).unwrap_or(0);
            debug_assert!(!found.chosen.iter().any(|(known, _)| *known == band));
            let spectrum: Vec<f32> = row.iter().map(|value| value / row[band]).collect();
            // What it explains of all others, and of the spectra before it
            let take = |values: &mut [f32]| {
                let part = values[band];
                if part != 0.0 {
                    values.iter_mut().zip(&spectrum).for_each(|(value, of)| *value -= part * of);
                    values[band] = 0.0;
                }
            };
            rest.chunks_exact_mut(bands).for_each(take);
            found.chosen.iter_mut().for_each(|(_, values)| take(values));
            found.chosen.push((band, spectrum));
            found.samples.push(worst);
        }
    }

    fn basis(mut self) -> SpectralBasis {
        self.chosen.sort_by_key(|(band, _)| *band);
        let of_band = |(band, scaled): &(usize, Vec<f32>)| -> Vec<f32> {
            let unscale = inverse(self.level[*band]);
            scaled.iter().zip(&self.level).map(|(value, level)| value * level * unscale).collect()
        };
        SpectralBasis {
            spectra: self.chosen.iter().flat_map(of_band).collect(),
            stored: self.chosen.iter().map(|(band, _)| *band).collect(),
            bands: self.level.len(),
            error: self.error,
        }
    }
}

/// Samples `[sample][band]` of which all others are nearly sums, at most so many.
pub(crate) fn representatives(samples: &[f32], bands: usize, error: f32, most: usize) -> Vec<f32> {
    let chosen = Interpolation::new(samples, bands, 1.0, error, most).samples;
    chosen.iter().flat_map(|sample| samples[sample * bands..][..bands].iter().copied()).collect()
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

fn rms(values: &[f32]) -> f32 {
    const LANES: usize = 16;
    let (parts, rest) = values.as_chunks::<LANES>();
    let mut sums = [0.0_f32; LANES];
    for part in parts {
        sums.iter_mut().zip(part).for_each(|(sum, value)| *sum += value * value);
    }
    let rest: f32 = rest.iter().map(|value| value * value).sum();
    ((sums.iter().sum::<f32>() + rest) / values.len().max(1) as f32).sqrt()
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
    fn sums_of_three_spectra_follow_from_three_bands() {
        let all = samples();
        let basis = SpectralBasis::interpolating(&all[..20 * 40], 40, 1e-4, 1e-4).unwrap();
        assert_eq!(basis.stored().len(), 3);
        for sample in all.chunks_exact(40) {
            let stored: Vec<f32> = basis.stored().iter().map(|band| sample[*band]).collect();
            let mut spectrum = vec![0.0; 40];
            basis.add(2.0, &stored, &mut spectrum);
            for (value, expected) in spectrum.iter().zip(sample) {
                assert!((value - 2.0 * expected).abs() < 1e-3 * expected + 1e-6, "{value} {expected}");
            }
            assert_eq!(basis.lines(&stored, 1).iter().map(|v| 2.0 * v).collect::<Vec<_>>(), spectrum);
            let weights: Vec<f64> = (0..80).map(|at| f64::from(at % 7)).collect();
            let rows = basis.through(&weights);
            for (row, weights) in rows.chunks_exact(3).zip(weights.chunks_exact(40)) {
                let short: f64 = row.iter().zip(&stored).map(|(a, b)| a * f64::from(*b)).sum();
                let long: f64 = weights.iter().zip(sample).map(|(a, b)| a * f64::from(*b)).sum();
                assert!((short - long).abs() < 1e-3 * long, "{short} {long}");
            }
        }
        assert_eq!(representatives(&all, 40, 1e-3, 24).len() % 40, 0);
    }

    #[test]
    fn dark_samples_take_no_band_and_noise_takes_all() {
        let dark = SpectralBasis::interpolating(&[0.0; 80], 40, 1e-3, 1e-3).unwrap();
        assert!(dark.stored().is_empty());
        let noise: Vec<f32> =
            (0..4000_u32).map(|at| (at.wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0).collect();
        assert_eq!(SpectralBasis::interpolating(&noise, 40, 1e-3, 1e-3), None);
        // Light of any brightness takes as many, and what is infinite all
        let basis = |factor: f32| {
            let bright: Vec<f32> = samples().iter().map(|value| factor * value).collect();
            SpectralBasis::interpolating(&bright, 40, 1e-4, 1e-4).map(|basis| basis.stored().to_vec())
        };
        let powers = [-80, 80].map(|power| basis(2_f32.powi(power)));
        assert_eq!(powers, [basis(1.0), basis(1.0)]);
        assert_eq!((basis(f32::INFINITY), basis(1.0).map(|bands| bands.len())), (None, Some(3)));
    }

    #[test]
    fn a_damaged_basis_is_refused() {
        assert!(SpectralBasis::new(vec![0, 2], vec![0.0; 6], 3, 0.0).is_some());
        for (stored, spectra) in [(vec![2, 0], 6), (vec![0, 3], 6), (vec![0, 2], 5)] {
            assert_eq!(SpectralBasis::new(stored, vec![0.0; spectra], 3, 0.0), None);
        }
        assert_eq!(SpectralBasis::new(vec![0], vec![0.0, f32::NAN, 0.0], 3, 0.0), None);
    }
}
