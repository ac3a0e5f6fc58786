//! From the signals of a design's exposures to its figures of merit.

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, Poisson, StandardNormal};
use serde::Serialize;

use crate::sampling::random::Key;

use super::criterion::{Contrast, Criterion};
use super::design_camera::DesignCamera;
use super::fisher::{Bound, Information};
use super::region_model::SignalRates;

/// What is taken for granted about each measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Assumptions {
    /// Relative standard deviation of a factor common to all exposures (distance, shading, pupil); 10 is as good as no knowledge.
    pub gain: f64,
    /// The same of each exposure by itself (current and age of its light).
    pub drive: f64,
    /// Relative standard deviation of the reflected light that passes the filters.
    pub leak: f64,
    /// Pixels of the sensor that a region is averaged over.
    pub pixels: f64,
    /// Brightest fluorescence of the scene over that of the region.
    pub brightest_fluorescence: f64,
    /// Brightest reflection of the scene, highlights included, over that of the region.
    pub brightest_reflection: f64,
}

impl Default for Assumptions {
    /// A known region of 1000 pixels, as bright as anything else.
    fn default() -> Self {
        Self {
            gain: 0.0,
            drive: 0.0,
            leak: 0.0,
            pixels: 1000.0,
            brightest_fluorescence: 1.0,
            brightest_reflection: 1.0,
        }
    }
}

/// One exposure of a design.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DesignExposure<'a> {
    /// The camera.
    pub camera: &'a DesignCamera,
    /// Light on the region, in the unit of its response.
    pub light: f64,
    /// Solid angle of the lens on the axis, sr.
    pub lens_sr: f64,
    /// Exposure time, s.
    pub time_s: f64,
}

impl DesignExposure<'_> {
    fn factor(&self) -> f64 {
        self.light * self.lens_sr * self.time_s
    }

    /// Electrons of all channels together, one pixel each.
    pub fn electrons(&self, rates: &SignalRates) -> f64 {
        let fluorescence: f64 = rates.fluorescence.iter().flatten().sum();
        self.factor() * (fluorescence + rates.leak.iter().sum::<f64>())
    }

    /// Variance of the mean of a channel over the region.
    fn variance(&self, channel: usize, mean_e: f64, pixels: f64) -> f64 {
        let camera = self.camera;
        let spread = camera.prnu * mean_e;
        let of_pixel = mean_e + camera.dark_e_per_s * self.time_s + camera.dark_variance_e2 + spread * spread;
        of_pixel / (pixels * camera.shares[channel]).max(1.0)
    }
}

/// Figures of merit of one region under one design.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegionMerits {
    /// Bound on the relative standard deviation of each weight; null where it is not seen.
    pub weights: Vec<f64>,
    /// Bound on the standard deviation of each contrast; null where it is not seen.
    pub contrasts: Vec<f64>,
    /// Independent combinations of the weights that are seen.
    pub rank: usize,
    /// Mean electrons of one pixel, by exposure and channel.
    pub electrons: Vec<Vec<f64>>,
    /// Signal to noise ratio of the mean over the region, by exposure and channel.
    pub signal_to_noise: Vec<Vec<f64>>,
    /// Largest ratio of reflected to fluorescent electrons of an exposure that sees fluorescence through a filter.
    pub leak: f64,
    /// Electrons of the brightest pixel over what it holds.
    pub saturation: f64,
    /// The bound itself.
    #[serde(skip)]
    pub bound: Bound,
}

/// Evaluates one region: its signals by exposure, in the order of the exposures. A white frame counts as data as any other;
/// `is_white` says which, for they need no filter against reflected light.
pub fn evaluate_region(
    signals: &[&SignalRates],
    exposures: &[DesignExposure<'_>],
    is_white: &[bool],
    assumptions: &Assumptions,
    contrasts: &[Contrast],
) -> RegionMerits {
    let weights = signals.first().map_or(0, |rates| rates.fluorescence.first().map_or(0, Vec::len));
    let unknowns = signals.first().map_or(0, |rates| rates.changes.first().map_or(0, Vec::len));
    let count = exposures.len();
    // Parameters: weights, gain, drive by exposure, leak by exposure, unknowns of the region
    let gain = weights;
    let (drive, leak) = (gain + 1, gain + 1 + count);
    let state = leak + count;
    let mut information = Information::new(weights, 1 + 2 * count + unknowns);
    let spreads = [assumptions.gain, assumptions.drive, assumptions.leak];
    // What is known exactly is no parameter: nothing depends on it
    let unknown = spreads.map(|spread| if spread > 0.0 { 1.0 } else { 0.0 });
    let mut know = |parameter: usize, spread: f64| {
        if spread > 0.0 {
            information.know(parameter, spread);
        }
    };
    know(gain, spreads[0]);
    (0..count).for_each(|k| know(drive + k, spreads[1]));
    (0..count).for_each(|k| know(leak + k, spreads[2]));
    (0..unknowns).for_each(|k| know(state + k, 1.0));
    let mut row = vec![0.0; state + unknowns];
    let (mut electrons, mut signal_to_noise) = (Vec::new(), Vec::new());
    let (mut worst_leak, mut saturation) = (0.0f64, 0.0f64);
    for (k, (exposure, rates)) in exposures.iter().zip(signals).enumerate() {
        let factor = exposure.factor();
        let (mut means, mut ratios) = (Vec::new(), Vec::new());
        let (mut fluorescent, mut reflected) = (0.0, 0.0);
        for c in 0..rates.leak.len() {
            row.fill(0.0);
            let signal: f64 = rates.fluorescence[c].iter().sum::<f64>() * factor;
            let leaked = rates.leak[c] * factor;
            let mean = signal + leaked;
            for (slot, rate) in row.iter_mut().zip(&rates.fluorescence[c]) {
                *slot = rate * factor;
            }
            row[gain] = unknown[0] * mean;
            row[drive + k] = unknown[1] * mean;
            row[leak + k] = unknown[2] * leaked;
            for (slot, rate) in row[state..].iter_mut().zip(&rates.changes[c]) {
                *slot = rate * factor;
            }
            let variance = exposure.variance(c, mean, assumptions.pixels);
            information.observe(&row, variance);
            means.push(mean);
            ratios.push(mean / variance.sqrt());
            fluorescent += signal;
            reflected += leaked;
            let brightest =
                signal * assumptions.brightest_fluorescence + leaked * assumptions.brightest_reflection;
            saturation = saturation.max(brightest / exposure.camera.full_e);
        }
        if !is_white[k] && fluorescent > 0.0 {
            worst_leak = worst_leak.max(reflected / fluorescent);
        }
        electrons.push(means);
        signal_to_noise.push(ratios);
    }
    let bound = information.bound();
    RegionMerits {
        weights: bound.standard_deviations(),
        contrasts: contrasts
            .iter()
            .map(|contrast| contrast.standard_deviation(&bound).unwrap_or(f64::INFINITY))
            .collect(),
        rank: bound.rank(),
        electrons,
        signal_to_noise,
        leak: worst_leak,
        saturation,
        bound,
    }
}

impl RegionMerits {
    /// The loss by a criterion that takes one region; infinite where it can't be told.
    pub fn loss(&self, criterion: Criterion, contrasts: &[Contrast]) -> f64 {
        criterion.of_bound(&self.bound, contrasts).unwrap_or(f64::INFINITY)
    }
}

/// Pixels of a region as one channel records them, dark signal subtracted, e-: photon noise, noise of the readout, and the rounding
/// of the converter, which is taken as a part of it.
pub(super) fn sample_pixels(
    exposure: &DesignExposure<'_>,
    rates: &SignalRates,
    channel: usize,
    pixels: usize,
    key: Key,
) -> Vec<f64> {
    let dark_e = exposure.camera.dark_e_per_s * exposure.time_s;
    let mean_e = exposure.factor() * (rates.fluorescence[channel].iter().sum::<f64>() + rates.leak[channel]);
    let read_e = exposure.camera.dark_variance_e2.sqrt();
    let draw = |pixel: usize| {
        let mut rng = key.with(channel as u64).with(pixel as u64).rng();
        let shot = Poisson::new((mean_e + dark_e).max(1e-12)).map_or(mean_e + dark_e, |p| p.sample(&mut rng));
        let read: f64 = StandardNormal.sample(&mut rng);
        shot - dark_e + read_e * read
    };
    (0..pixels).map(draw).collect()
}

/// Mean electrons of a region, all exposures and channels in one list, with the variance of each over the region.
fn means_and_variances(
    signals: &[&SignalRates],
    exposures: &[DesignExposure<'_>],
    pixels: f64,
) -> (Vec<f64>, Vec<f64>) {
    let (mut means, mut variances) = (Vec::new(), Vec::new());
    for (exposure, rates) in exposures.iter().zip(signals) {
        for c in 0..rates.leak.len() {
            let mean = exposure.factor() * (rates.fluorescence[c].iter().sum::<f64>() + rates.leak[c]);
            variances.push(exposure.variance(c, mean, pixels));
            means.push(mean);
        }
    }
    (means, variances)
}

/// How well the colors of two regions are told apart, whatever their brightness: the distance of their signals in standard
/// deviations of the sensor's noise, `min over g of sqrt(sum (b - g a)² / v)`. For one exposure of R, G and B that is the
/// separability of two chromaticities.
pub fn chromaticity_separability(
    a: &[&SignalRates],
    b: &[&SignalRates],
    exposures: &[DesignExposure<'_>],
    pixels: f64,
) -> f64 {
    let (from, _) = means_and_variances(a, exposures, pixels);
    let (to, variances) = means_and_variances(b, exposures, pixels);
    let sum =
        |x: &[f64], y: &[f64]| x.iter().zip(y).zip(&variances).map(|((x, y), v)| x * y / v).sum::<f64>();
    let (aa, ab, bb) = (sum(&from, &from), sum(&from, &to), sum(&to, &to));
    if aa > 0.0 { (bb - ab * ab / aa).max(0.0).sqrt() } else { bb.sqrt() }
}

/// Hotelling's `d'` between two groups of people: `d'² = dm^T S^-1 dm`, with the spread between people, the sensor's noise and
/// the uncertainty of the common factor in `S`. Groups of few people make it too large by chance; the mean of that is taken off:
/// `(n - p - 1) / n d'² - p (1/n1 + 1/n2)`, `n = n1 + n2 - 2`, `p` data. `None` for fewer people than data need.
pub fn detectability(
    healthy: &[Vec<&SignalRates>],
    altered: &[Vec<&SignalRates>],
    exposures: &[DesignExposure<'_>],
    assumptions: &Assumptions,
) -> Option<f64> {
    let group = |people: &[Vec<&SignalRates>]| {
        people
            .iter()
            .map(|signals| means_and_variances(signals, exposures, assumptions.pixels))
            .collect::<Vec<_>>()
    };
    let groups = [group(healthy), group(altered)];
    let data = groups[0].first()?.0.len();
    let (n1, n2) = (healthy.len() as f64, altered.len() as f64);
    let (free, p) = (n1 + n2 - 2.0, data as f64);
    if free - p - 1.0 <= 0.0 {
        return None;
    }
    let mean = |people: &[(Vec<f64>, Vec<f64>)]| {
        DVector::from_fn(data, |d, _| people.iter().map(|(y, _)| y[d]).sum::<f64>() / people.len() as f64)
    };
    let means = [mean(&groups[0]), mean(&groups[1])];
    let mut spread = DMatrix::<f64>::zeros(data, data);
    for (people, mean) in groups.iter().zip(&means) {
        for (y, variances) in people {
            let off = DVector::from_column_slice(y) - mean;
            spread += &off * off.transpose() / free;
            let share = 1.0 / (n1 + n2);
            variances.iter().enumerate().for_each(|(d, v)| spread[(d, d)] += share * v);
        }
    }
    let middle = 0.5 * (&means[0] + &means[1]);
    spread += assumptions.gain.powi(2) * &middle * middle.transpose();
    let difference = &means[1] - &means[0];
    let solved = spread.cholesky()?.solve(&difference);
    let squared = difference.dot(&solved);
    Some(((free - p - 1.0) / free * squared - p * (1.0 / n1 + 1.0 / n2)).max(0.0).sqrt())
}
