//! From the signals of a design's exposures to its figures of merit.

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, Poisson, StandardNormal};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::sampling::random::Key;

use super::criterion::{Contrast, Criterion};
use super::design_camera::DesignCamera;
use super::fisher::{Bound, UncertainData};
use super::region_model::SignalRates;

/// What is taken for granted about each measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Assumptions {
    /// Relative standard deviation of a factor common to all exposures (distance, shading, pupil), 0 to 10, which is as good as no knowledge.
    /// Default 0.
    pub gain: f64,
    /// The same of each exposure by itself (current and age of its light), 0 to 10. Default 0.
    pub drive: f64,
    /// Relative standard deviation of the reflected light that passes the filters, 0 to 10. Default 0.
    pub leak: f64,
    /// Pixels of the sensor that a region is averaged over, 1 to 1e9. Default 1000.
    pub pixels: f64,
    /// Brightest fluorescence of the scene over that of the region, 1 to 1e6. Default 1.
    pub brightest_fluorescence: f64,
    /// Brightest reflection of the scene, highlights included, over that of the region, 1 to 1e6. Default 1.
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

    /// Those of fluorescence among them.
    pub fn fluorescence_electrons(&self, rates: &SignalRates) -> f64 {
        self.factor() * rates.fluorescence.iter().flatten().sum::<f64>()
    }

    /// Mean electrons of one pixel of a channel.
    pub(super) fn channel_electrons(&self, channel: usize, rates: &SignalRates) -> f64 {
        self.factor() * (rates.fluorescence[channel].iter().sum::<f64>() + rates.leak[channel])
    }

    /// Mean dark electrons of one pixel.
    fn dark_electrons(&self) -> f64 {
        self.camera.dark_e_per_s * self.time_s
    }

    /// Variance of the mean of a channel over the region. Of a region as wide as high the root of the number of pixels is that of its lines.
    pub(super) fn variance(&self, channel: usize, mean_e: f64, pixels: f64) -> f64 {
        let camera = self.camera;
        let spread = camera.prnu * mean_e;
        let of_pixel = mean_e + self.dark_electrons() + camera.dark_variance_e2 + spread * spread;
        let pixels = (pixels * camera.shares[channel]).max(1.0);
        let of_line = camera.line_variance_e2 + (camera.column_gain * mean_e).powi(2);
        of_pixel / pixels + of_line / pixels.sqrt()
    }
}

/// Figures of merit of one region under one design.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegionMerits {
    /// Bound on the relative standard deviation of each weight; null where it is not seen.
    pub weights: Vec<f64>,
    /// Bound on the standard deviation of each contrast; null where it is not seen.
    pub contrasts: Vec<f64>,
    /// The contrasts themselves, what their deviations are to be judged by; null where nothing of one is in the region.
    pub contrast_values: Vec<Option<f64>>,
    /// Independent combinations of the weights that are seen.
    pub rank: usize,
    /// Mean electrons of one pixel, by exposure and channel.
    pub electrons: Vec<Vec<f64>>,
    /// Signal to noise ratio of the mean over the region, by exposure and channel.
    pub signal_to_noise: Vec<Vec<f64>>,
    /// Largest ratio of reflected to fluorescent electrons of an exposure through a filter; infinite where it sees no fluorescence.
    pub leak: f64,
    /// Electrons of the brightest pixel, dark ones included, over what it holds.
    pub saturation: f64,
    /// The bound itself.
    #[serde(skip)]
    pub bound: Bound,
}

/// Evaluates one region: its signals by exposure, in the order of the exposures. A white frame counts as data as any other;
/// `is_white` says which, for they need no filter against reflected light. `known` is what was known before: the standard deviation of
/// the prior of each weight, infinite without one (none at all where the list is empty), and what is taken for granted. A prior counts
/// as a datum of the weight itself, for the rank, too.
pub fn evaluate_region(
    signals: &[&SignalRates],
    exposures: &[DesignExposure<'_>],
    is_white: &[bool],
    (priors, assumptions): (&[f64], &Assumptions),
    contrasts: &[Contrast],
) -> RegionMerits {
    let weights = signals.first().map_or(0, |rates| rates.fluorescence.first().map_or(0, Vec::len));
    let unknowns = signals.first().map_or(0, |rates| rates.changes.first().map_or(0, Vec::len));
    let mut data = UncertainData::new(weights);
    let mut columns = NuisanceColumns::new(assumptions, exposures.len(), unknowns);
    let (mut electrons, mut signal_to_noise) = (Vec::new(), Vec::new());
    let (mut worst_leak, mut saturation) = (0.0f64, 0.0f64);
    for (k, (exposure, rates)) in exposures.iter().zip(signals).enumerate() {
        let factor = exposure.factor();
        let (mut means, mut ratios) = (Vec::new(), Vec::new());
        let (mut fluorescent, mut reflected) = (0.0, 0.0);
        for c in 0..rates.leak.len() {
            let signal: f64 = rates.fluorescence[c].iter().sum::<f64>() * factor;
            let leaked = rates.leak[c] * factor;
            let mean = signal + leaked;
            let variance = exposure.variance(c, mean, assumptions.pixels);
            data.observe(rates.fluorescence[c].iter().map(|rate| rate * factor), variance);
            // What a white frame sees is reflected light by intention
            let unwanted = if is_white[k] { 0.0 } else { leaked };
            columns.observe(k, mean, unwanted, rates.changes[c].iter().map(|rate| rate * factor));
            means.push(mean);
            ratios.push(mean / variance.sqrt());
            fluorescent += signal;
            reflected += leaked;
            let brightest =
                signal * assumptions.brightest_fluorescence + leaked * assumptions.brightest_reflection;
            saturation = saturation.max((brightest + exposure.dark_electrons()) / exposure.camera.full_e);
        }
        if !is_white[k] {
            let leak = if fluorescent > 0.0 { reflected / fluorescent } else { f64::INFINITY };
            worst_leak = worst_leak.max(leak);
        }
        electrons.push(means);
        signal_to_noise.push(ratios);
    }
    for (weight, &prior) in priors.iter().enumerate().filter(|(_, prior)| prior.is_finite()) {
        data.observe((0..weights).map(|other| if other == weight { 1.0 } else { 0.0 }), prior * prior);
        columns.columns.iter_mut().for_each(|column| column.push(0.0));
    }
    let bound = data.bound(&columns.columns);
    let contrast = |contrast: &Contrast| contrast.standard_deviation(&bound).unwrap_or(f64::INFINITY);
    RegionMerits {
        weights: bound.standard_deviations(),
        contrasts: contrasts.iter().map(contrast).collect(),
        contrast_values: contrasts.iter().map(Contrast::value).collect(),
        rank: bound.rank(),
        electrons,
        signal_to_noise,
        leak: worst_leak,
        saturation,
        bound,
    }
}

/// What each unknown changes of each datum at one standard deviation: the common gain, the drive and the leak of each exposure, and
/// the unknowns of the region. What is known exactly has no column.
struct NuisanceColumns {
    gain: f64,
    drive: f64,
    leak: f64,
    exposures: usize,
    columns: Vec<Vec<f64>>,
}

impl NuisanceColumns {
    fn new(assumptions: &Assumptions, exposures: usize, unknowns: usize) -> Self {
        let Assumptions { gain, drive, leak, .. } = *assumptions;
        let of = |spread: f64, count: usize| if spread > 0.0 { count } else { 0 };
        let count = of(gain, 1) + of(drive, exposures) + of(leak, exposures) + unknowns;
        Self { gain, drive, leak, exposures, columns: vec![Vec::new(); count] }
    }

    /// Adds a datum of an exposure: its mean, the reflected light in it, and its changes by the unknowns of the region.
    fn observe(&mut self, exposure: usize, mean: f64, leaked: f64, changes: impl Iterator<Item = f64>) {
        let mut columns = self.columns.iter_mut();
        if self.gain > 0.0 {
            columns.next().into_iter().for_each(|column| column.push(self.gain * mean));
        }
        for (spread, value) in [(self.drive, mean), (self.leak, leaked)] {
            if spread > 0.0 {
                for (k, column) in columns.by_ref().take(self.exposures).enumerate() {
                    column.push(if k == exposure { spread * value } else { 0.0 });
                }
            }
        }
        columns.zip(changes).for_each(|(column, change)| column.push(change));
    }
}

impl RegionMerits {
    /// The loss by a criterion that takes one region; infinite where it can't be told.
    pub fn loss(&self, criterion: Criterion, contrasts: &[Contrast]) -> f64 {
        criterion.of_bound(&self.bound, contrasts).unwrap_or(f64::INFINITY)
    }
}

/// Pixels of a region as one channel records them, dark signal subtracted, e-: photon noise, noise of the readout and of rows, which all
/// channels share, and the rounding of the converter, which is taken as a part of it.
pub(super) fn sample_pixels(
    exposure: &DesignExposure<'_>,
    rates: &SignalRates,
    channel: usize,
    pixels: usize,
    key: Key,
) -> Vec<f64> {
    let dark_e = exposure.dark_electrons();
    let mean_e = exposure.channel_electrons(channel, rates);
    let [read_e, line_e] =
        [exposure.camera.dark_variance_e2, exposure.camera.line_variance_e2].map(f64::sqrt);
    let rows = (pixels as f64).sqrt().ceil() as usize;
    let of_row = |row: u64| -> f64 { StandardNormal.sample(&mut key.with(u64::MAX - row).rng()) };
    let draw = |pixel: usize| {
        let mut rng = key.with(channel as u64).with(pixel as u64).rng();
        let shot = Poisson::new((mean_e + dark_e).max(1e-12)).map_or(mean_e + dark_e, |p| p.sample(&mut rng));
        let read: f64 = StandardNormal.sample(&mut rng);
        shot - dark_e + read_e * read + line_e * of_row((pixel % rows) as u64)
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
            let mean = exposure.channel_electrons(c, rates);
            variances.push(exposure.variance(c, mean, pixels));
            means.push(mean);
        }
    }
    (means, variances)
}

/// How well the colors of two regions are told apart, whatever their brightness: the distance of their signals in standard
/// deviations of the sensor's noise, `min over g of sqrt(sum (b - g a)² / (v_b + g² v_a))`. For one exposure of R, G and B that is
/// the separability of two chromaticities. `pixels` are those of each region.
pub fn chromaticity_separability(
    a: &[&SignalRates],
    b: &[&SignalRates],
    exposures: &[DesignExposure<'_>],
    pixels: [f64; 2],
) -> f64 {
    let unit = |signals: &[&SignalRates], pixels: f64| -> Vec<[f64; 2]> {
        let (means, variances) = means_and_variances(signals, exposures, pixels);
        let sum = means.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        means.iter().zip(variances).map(|(mean, v)| [mean / sum, v / (sum * sum)]).collect()
    };
    let (a, b) = (unit(a, pixels[0]), unit(b, pixels[1]));
    // g is the tangent of an angle: none of both regions comes first
    let squared = |angle: f64| -> f64 {
        let (sin, cos) = angle.sin_cos();
        let of_one = |([a, va], [b, vb]): (&[f64; 2], &[f64; 2])| {
            (b * cos - a * sin).powi(2) / (vb * cos * cos + va * sin * sin)
        };
        a.iter().zip(&b).map(of_one).sum()
    };
    // The best of a grid, then halves of its steps
    let mut step = std::f64::consts::FRAC_PI_2 / 32.0;
    let best = (0..=32).map(|k| f64::from(k) * step).min_by(|x, y| squared(*x).total_cmp(&squared(*y)));
    let mut angle = best.unwrap_or_default();
    for _ in 0..40 {
        step *= 0.5;
        let near = [angle - step, angle, angle + step];
        angle = near.into_iter().min_by(|x, y| squared(*x).total_cmp(&squared(*y))).unwrap_or(angle);
    }
    squared(angle).sqrt()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{Sensor, SensorModel, SpectralQe};
    use crate::spectral::{Curve, WavelengthGrid};

    use super::super::FineBands;

    fn camera() -> DesignCamera {
        let qe = SpectralQe::from_curves([("a", Curve::constant(0.5)), ("b", Curve::constant(0.5))]).unwrap();
        let model = SensorModel {
            columns: 2,
            rows: 1,
            mosaic: vec![vec!["a".into(), "b".into()]],
            ..SensorModel::default()
        };
        let sensor = Sensor::new(model, qe).unwrap();
        let bands = FineBands::of(&WavelengthGrid::uniform(500.0, 600.0, 10.0).unwrap());
        DesignCamera::new("two", &sensor, 1.0, &Curve::constant(1.0), &bands)
    }

    fn rates(a: f64, b: f64) -> SignalRates {
        SignalRates { fluorescence: vec![vec![a], vec![b]], leak: vec![0.0; 2], changes: vec![Vec::new(); 2] }
    }

    fn exposure(camera: &DesignCamera) -> DesignExposure<'_> {
        DesignExposure { camera, light: 1.0, lens_sr: 1.0, time_s: 1.0 }
    }

    #[test]
    fn colors_are_told_apart_whatever_their_brightness() {
        let camera = camera();
        let exposures = [exposure(&camera)];
        let apart =
            |a: &SignalRates, b: &SignalRates| chromaticity_separability(&[a], &[b], &exposures, [1000.0; 2]);
        assert!(apart(&rates(300.0, 100.0), &rates(600.0, 200.0)) < 1e-6);
        // The least over a fine grid of factors, with the noise of both
        let (a, b) = (rates(300.0, 100.0), rates(200.0, 200.0));
        let variance = |channel, mean| exposures[0].variance(channel, mean, 1000.0);
        let squared = |g: f64| {
            let of =
                |c: usize, a: f64, b: f64| (b - g * a).powi(2) / (variance(c, b) + g * g * variance(c, a));
            of(0, 300.0, 200.0) + of(1, 100.0, 200.0)
        };
        let expected = (0..40_000).map(|k| squared(f64::from(k) * 1e-4)).fold(f64::INFINITY, f64::min).sqrt();
        // None of them comes first, bright or dim
        let dim = rates(3.0, 1.0);
        assert!((apart(&dim, &b) / apart(&b, &dim) - 1.0).abs() < 1e-9 && apart(&dim, &b) < apart(&a, &b));
        assert!((apart(&a, &b) / expected - 1.0).abs() < 1e-6);
    }

    /// Dark electrons fill pixels as others do, and what lines share averages over the lines of a region alone.
    #[test]
    fn dark_electrons_saturate_and_lines_average_by_themselves() {
        let mut camera = camera();
        camera.dark_e_per_s = 4000.0;
        let merits = |camera: &DesignCamera| {
            // 10 000 pixels of each channel
            let known = Assumptions { pixels: 2e4, ..Assumptions::default() };
            evaluate_region(&[&rates(300.0, 100.0)], &[exposure(camera)], &[false], (&[], &known), &[])
        };
        let plain = merits(&camera);
        assert!((plain.saturation * camera.full_e - 4300.0).abs() < 1e-9, "{plain:?}");
        camera.line_variance_e2 = 100.0;
        let variance = |merits: RegionMerits| (300.0 / merits.signal_to_noise[0][0]).powi(2);
        let variance_of_plain = variance(plain);
        assert!((variance(merits(&camera)) - variance_of_plain - 1.0).abs() < 1e-9);
        // 300 electrons at gains of 100 columns that spread by 5 %
        (camera.line_variance_e2, camera.column_gain) = (0.0, 0.05);
        assert!((variance(merits(&camera)) - variance_of_plain - 2.25).abs() < 1e-9);
    }

    /// People whose signals are independent normals of standard deviation 20 e- in both channels, shifted by 40 and 0: `d'` 2. Of 400
    /// and 400 people it is known to `sqrt(2/400 + 4/3200)` = 0.08; four of those.
    #[test]
    fn detectability_of_independent_normals() {
        let camera = camera();
        let exposures = [exposure(&camera)];
        let group = |mean: f64, seed: u64| -> Vec<SignalRates> {
            let draw = |person: u64| {
                let mut rng = Key::new(seed).with(person).rng();
                let [x, y]: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
                rates(mean + 20.0 * x, 500.0 + 20.0 * y)
            };
            (0..400).map(draw).collect()
        };
        let (healthy, altered) = (group(500.0, 1), group(540.0, 2));
        let as_refs =
            |people: &'static [SignalRates]| people.iter().map(|rates| vec![rates]).collect::<Vec<_>>();
        let leak =
            |people: Vec<SignalRates>| -> &'static [SignalRates] { Box::leak(people.into_boxed_slice()) };
        let (healthy, altered) = (as_refs(leak(healthy)), as_refs(leak(altered)));
        // Noise of a mean over a billion pixels is nothing
        let known = Assumptions { pixels: 1e9, ..Assumptions::default() };
        let found = detectability(&healthy, &altered, &exposures, &known).unwrap();
        assert!((found - 2.0).abs() < 0.33, "{found}");
        // A gain that is not known hides most of a change of one channel in two that are alike
        let lost = Assumptions { gain: 10.0, ..known };
        let hidden = detectability(&healthy, &altered, &exposures, &lost).unwrap();
        assert!(hidden < found && (hidden - 2.0 / 2f64.sqrt()).abs() < 0.33, "{hidden}");
        assert_eq!(detectability(&healthy[..2], &altered[..2], &exposures, &known), None);
    }
}
