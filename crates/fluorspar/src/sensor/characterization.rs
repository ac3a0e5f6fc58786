//! A sensor measured as EMVA 1288 (release 4, linear) measures cameras: flats, darks, photon transfer.
//!
//! Frames are simulated with even, steady light, whose photo-electrons are known; all but the quantum efficiency, which is the model's, is
//! estimated from their digital numbers.
//!
//! | quantity | estimated from |
//! |---|---|
//! | system gain K | slope of temporal variance over mean, both less their dark values, up to 70 % of saturation |
//! | temporal dark noise | `sqrt(variance of dark pairs - 1/12 DN²) / K` |
//! | saturation capacity | mean signal at the largest temporal variance, by a cubic around it |
//! | DSNU, PRNU | spatial variance of averaged frames, dark and at half saturation, less what temporal noise leaves |
//! | dark current | slope of the mean (and of the variance) of dark frames over time |
//! | linearity error | mean distance from the line of least relative squares, 5 to 95 % of saturation |

use nalgebra::{Matrix4, Vector4};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::adc::QUANTIZATION_NOISE_DN;
use super::exposure::EXPOSURE_MS;
use super::frame_statistics::{Line, mean, spatial_variances};
use super::photon_transfer::{Limit, saturation_capacity_e, sensitivity_threshold_e};
use super::{Exposure, Sensor, SensorMode, SensorModel, SensorProblem, Shutter};
use crate::image::SensorImage;
use crate::warning::Warning;

/// How a sensor is measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CharacterizationSettings {
    /// Columns and rows in the middle of the sensor that are measured; fewer where it has fewer.
    pub region: [usize; 2],
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Gain on top of the model's.
    pub gain: f64,
    /// Steps of the light from dark to saturation, 10 or more.
    pub levels: usize,
    /// Frames that are averaged for the fixed patterns, 4 or more.
    pub stack: usize,
    /// Seed of the temporal noise.
    pub seed: u64,
}

impl Default for CharacterizationSettings {
    fn default() -> Self {
        Self { region: [640, 480], exposure_s: 0.01, gain: 1.0, levels: 50, stack: 32, seed: 0 }
    }
}

/// One step of the light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PhotonTransferPoint {
    /// Mean photo-electrons that the light frees, e-; what a laboratory knows from its photodiode.
    pub light_e: f64,
    /// Mean of the pixels less the dark mean, DN.
    pub signal_dn: f64,
    /// Temporal variance, DN².
    pub variance_dn2: f64,
}

/// A non-uniformity and its parts, in one unit, rms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct NonUniformity {
    /// All together.
    pub total: f64,
    /// Of rows.
    pub row: f64,
    /// Of columns.
    pub column: f64,
    /// Of single pixels.
    pub pixel: f64,
}

/// Quantum efficiency of a channel and the threshold in photons that follows from it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelSensitivity {
    /// Channel.
    pub channel: String,
    /// Wavelength of the largest quantum efficiency, nm.
    pub peak_nm: f64,
    /// Largest quantum efficiency, of photons on the whole pixel, percent.
    pub quantum_efficiency_percent: f64,
    /// Photons per pixel at that wavelength at which signal and noise are equal.
    pub sensitivity_threshold_photons: f64,
}

/// A quantity that was put in and came out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recovered {
    /// Name of the quantity.
    pub quantity: String,
    /// Unit.
    pub unit: String,
    /// Value of the model.
    pub set: f64,
    /// Measured value.
    pub measured: f64,
    /// Measured over set, less 1; null where nothing was set.
    pub relative_error: Option<f64>,
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Characterization {
    /// Settings of the measurement; the region is the one that was used.
    pub settings: CharacterizationSettings,
    /// System gain K, DN/e-.
    pub gain_dn_per_e: f64,
    /// Its inverse, e-/DN.
    pub gain_e_per_dn: f64,
    /// Temporal dark noise, quantization excluded, e- rms.
    pub dark_noise_e: f64,
    /// Temporal dark noise as measured, DN rms.
    pub dark_noise_dn: f64,
    /// Mean of dark frames, DN.
    pub dark_mean_dn: f64,
    /// Saturation capacity: mean signal at the largest temporal variance, e-.
    pub saturation_capacity_e: f64,
    /// Signal of fully saturated frames, e-: the full well or the end of the converter, whichever comes first.
    pub full_scale_e: f64,
    /// Dark signal non-uniformity, e-.
    pub dsnu_e: NonUniformity,
    /// Photo response non-uniformity, percent.
    pub prnu_percent: NonUniformity,
    /// Dark current from the mean of dark frames, e-/s.
    pub dark_current_e_per_s: f64,
    /// Dark current from the variance of dark frames, e-/s.
    pub dark_current_from_variance_e_per_s: f64,
    /// Temperature step that doubles the dark current, K; null without dark current.
    pub doubling_temperature_k: Option<f64>,
    /// Mean deviation from a line between 5 and 95 % of saturation, percent.
    pub linearity_error_percent: f64,
    /// Absolute sensitivity threshold, e-.
    pub sensitivity_threshold_e: f64,
    /// Saturation capacity over threshold, dB.
    pub dynamic_range_db: f64,
    /// Largest temporal signal-to-noise ratio, dB.
    pub snr_max_db: f64,
    /// Channels.
    pub channels: Vec<ChannelSensitivity>,
    /// Photon-transfer curve.
    pub photon_transfer: Vec<PhotonTransferPoint>,
    /// What a reader should know.
    pub warnings: Vec<Warning>,
    /// Set values next to measured ones. Empty with hot or dead pixels or a soft well, which have no closed form.
    pub recovered: Vec<Recovered>,
}

impl Characterization {
    /// Signal-to-noise ratio of one pixel at a mean signal: temporal noise only, or the fixed patterns of the whole
    /// image as well.
    pub fn snr(&self, signal_e: f64, with_patterns: bool) -> f64 {
        let quantization_e = QUANTIZATION_NOISE_DN * self.gain_e_per_dn;
        let mut variance_e2 = signal_e + self.dark_noise_e.powi(2) + quantization_e.powi(2);
        if with_patterns {
            variance_e2 += self.dsnu_e.total.powi(2) + (self.prnu_percent.total * 1e-2 * signal_e).powi(2);
        }
        signal_e / variance_e2.sqrt()
    }
}

/// Share of dark pixels at zero up to which dark noise and offsets count as measured (EMVA 1288, section 6.5).
pub(super) const MOST_EMPTY: f64 = 0.005;

/// Variance of dark frames, DN², below which quantization hides the temporal dark noise (EMVA 1288, section 6): the deviation is 0.49 DN,
/// of which quantization alone makes 0.29.
pub(super) const LEAST_DARK_VARIANCE_DN2: f64 = 0.24;

/// What is left of dark noise that quantization hides: an upper limit, `sqrt(0.24 - 1/12) / K`.
pub(super) fn quantization_warning(dark_dn2: f64, dn_per_electron: f64) -> Warning {
    let limit_e = (LEAST_DARK_VARIANCE_DN2 - QUANTIZATION_NOISE_DN.powi(2)).sqrt() / dn_per_electron;
    let statement = format!(
        "Quantization hides the dark noise: dark frames vary by {:.2} DN, below 0.49 DN, so the temporal dark noise is only known to lie below \
         {limit_e:.1} e- (EMVA 1288), and the sensitivity threshold and the dynamic range rest on it",
        dark_dn2.sqrt()
    );
    Warning::explained(statement, "Raise the gain of the exposure or the bit depth.")
}

/// Mean and temporal variance from two frames of one exposure: half the mean square of their difference, less half the
/// squared difference of their means (EMVA 1288, Eq. 15).
fn pair(a: &SensorImage, b: &SensorImage) -> (f64, f64) {
    let numbers = |image: &SensorImage| mean(image.data.iter().map(|&dn| f64::from(dn)));
    let (mean_a, mean_b) = (numbers(a), numbers(b));
    let squares = a.data.iter().zip(&b.data).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2));
    let variance = 0.5 * (mean(squares) - (mean_a - mean_b).powi(2));
    (0.5 * (mean_a + mean_b), variance)
}

/// Average of a stack of frames and the temporal variance of the average.
struct Stack {
    width: usize,
    mean: Vec<f64>,
    temporal_dn2: f64,
}

impl Stack {
    fn take(
        frames: usize,
        mut frame: impl FnMut(u64) -> Result<SensorImage, SensorProblem>,
    ) -> Result<Self, SensorProblem> {
        let first = frame(0)?;
        let width = first.width;
        // Sums about the first frame keep squares small.
        let origin: Vec<f64> = first.data.iter().map(|&dn| f64::from(dn)).collect();
        let mut sums = vec![0.0; origin.len()];
        let mut squares = vec![0.0; origin.len()];
        for index in 1..frames {
            for (((sum, square), dn), origin) in
                sums.iter_mut().zip(&mut squares).zip(&frame(index as u64)?.data).zip(&origin)
            {
                let difference = f64::from(*dn) - origin;
                *sum += difference;
                *square += difference * difference;
            }
        }
        let count = frames as f64;
        let temporal =
            sums.iter().zip(&squares).map(|(sum, square)| (square - sum * sum / count) / (count - 1.0));
        let temporal_dn2 = mean(temporal) / count;
        let mean = origin.iter().zip(&sums).map(|(origin, sum)| origin + sum / count).collect();
        Ok(Self { width, mean, temporal_dn2 })
    }

    /// Spatial variances: total, rows, columns, pixels, DN². Temporal noise that is left is taken off the pixels' part.
    fn spatial(&self) -> [f64; 4] {
        let [all, row, column, pixels] = spatial_variances(&self.mean, self.width);
        [all - self.temporal_dn2, row, column, pixels - self.temporal_dn2]
    }

    fn level(&self) -> f64 {
        mean(self.mean.iter().copied())
    }
}

fn non_uniformity(variances: [f64; 4], unit: f64) -> NonUniformity {
    let [total, row, column, pixel] = variances.map(|v| v.max(0.0).sqrt() * unit);
    NonUniformity { total, row, column, pixel }
}

/// The sensor as it stands in the laboratory: its middle, pixel by pixel, in steady light.
fn in_laboratory(sensor: &Sensor, settings: &CharacterizationSettings) -> Result<Sensor, SensorProblem> {
    let model = sensor.model();
    if model.mode != SensorMode::Physical {
        let message =
            "only the mode physical has fixed patterns that stay and temporal noise; measure in that mode";
        return Err(SensorProblem::new("mode", message));
    }
    let place = |wanted: usize, all: usize, cell: usize| {
        let count = wanted.min(all);
        let first = (all - count) / 2;
        (first / cell * cell, count)
    };
    let [wanted_columns, wanted_rows] = settings.region;
    let (column, columns) = place(wanted_columns, model.columns, model.mosaic[0].len());
    let (row, rows) = place(wanted_rows, model.rows, model.mosaic.len());
    let laboratory = SensorModel {
        region_px: Some([column, row, columns, rows]),
        binning: None,
        shutter: Shutter::default(),
        strobe: None,
        ..model.clone()
    };
    Sensor::new(laboratory, sensor.qe().clone())
}

fn check(settings: &CharacterizationSettings) -> Result<(), SensorProblem> {
    for (field, value, least) in [
        ("region[0]", settings.region[0], 16),
        ("region[1]", settings.region[1], 16),
        ("levels", settings.levels, 10),
        ("stack", settings.stack, 4),
    ] {
        if !(least..=100_000).contains(&value) {
            let message = format!("{value} is outside {least} to 100000");
            return Err(SensorProblem::new(format!("characterization.{field}"), message));
        }
    }
    let range_s = EXPOSURE_MS.map(|ms| ms * 1e-3);
    SensorProblem::unless_within(
        "characterization.exposure_s",
        settings.exposure_s,
        range_s,
        "give seconds",
    )?;
    Exposure { time_s: settings.exposure_s, gain: settings.gain, ..Exposure::default() }.validate()
}

/// A sensor on the bench.
struct Bench<'a> {
    sensor: &'a Sensor,
    settings: &'a CharacterizationSettings,
}

impl Bench<'_> {
    /// A frame of even light; series of different names have independent noise.
    fn frame(
        &self,
        series: &str,
        electrons: f64,
        time_s: f64,
        frame: u64,
    ) -> Result<SensorImage, SensorProblem> {
        let CharacterizationSettings { gain, seed, .. } = *self.settings;
        let exposure = Exposure { time_s, gain, seed, frame, label: format!("characterization {series}") };
        self.sensor.expose_even(electrons / time_s, &exposure)
    }

    fn pair(&self, series: &str, electrons: f64, step: usize) -> Result<(f64, f64), SensorProblem> {
        let (time_s, first) = (self.settings.exposure_s, 2 * step as u64);
        Ok(pair(
            &self.frame(series, electrons, time_s, first)?,
            &self.frame(series, electrons, time_s, first + 1)?,
        ))
    }

    /// Steps of the light from above one value up to another, e-.
    fn sweep(
        &self,
        series: &str,
        dark_dn: f64,
        [from_e, to_e]: [f64; 2],
        levels: usize,
    ) -> Result<Vec<PhotonTransferPoint>, SensorProblem> {
        (1..=levels)
            .map(|step| {
                let light_e = from_e + (to_e - from_e) * step as f64 / levels as f64;
                let (mean_dn, variance_dn2) = self.pair(series, light_e, step)?;
                Ok(PhotonTransferPoint { light_e, signal_dn: mean_dn - dark_dn, variance_dn2 })
            })
            .collect()
    }

    fn stack(&self, series: &str, electrons: f64) -> Result<Stack, SensorProblem> {
        Stack::take(self.settings.stack, |frame| {
            self.frame(series, electrons, self.settings.exposure_s, frame)
        })
    }

    /// Slopes of mean and temporal variance of dark frames over time, DN/s and DN²/s. The longest time is such that the
    /// mean rises by 100 e-, but not above an hour or half of the codes.
    fn dark_slopes(&self, gain: f64, most_dn: f64) -> Result<(f64, f64), SensorProblem> {
        let shortest_s = 1e-4;
        let longest_s = self.longest_dark_s(shortest_s, gain, most_dn)?;
        let mut points = Vec::new();
        for k in 0..6 {
            let time_s = shortest_s + (longest_s - shortest_s) * k as f64 / 5.0;
            let (mean_dn, variance_dn2) = self.dark(time_s, 100 + k)?;
            points.push((time_s, mean_dn, variance_dn2));
        }
        let of_mean = Line::through(points.iter().map(|&(t, mean, _)| (t, mean, 1.0)));
        let of_variance = Line::through(points.iter().map(|&(t, _, variance)| (t, variance, 1.0)));
        Ok((of_mean.slope, of_variance.slope))
    }

    /// The longest time whose dark signal is large, but below a limit.
    fn longest_dark_s(&self, shortest_s: f64, gain: f64, most_dn: f64) -> Result<f64, SensorProblem> {
        let (zero_dn, _) = self.dark(shortest_s, 0)?;
        let (mut longest_s, mut step, mut was_too_long) = (0.1, 1, false);
        loop {
            let (mean_dn, _) = self.dark(longest_s, step)?;
            if mean_dn > most_dn && longest_s > 4.0 * shortest_s {
                (longest_s, was_too_long) = (longest_s / 4.0, true);
            } else if was_too_long || mean_dn - zero_dn > 100.0 * gain || longest_s > 900.0 {
                return Ok(longest_s);
            } else {
                longest_s *= 4.0;
            }
            step += 1;
        }
    }

    /// Mean, DN, and temporal variance, DN², of a pair of dark frames. Each step has frames of its own.
    fn dark(&self, time_s: f64, step: usize) -> Result<(f64, f64), SensorProblem> {
        let frame = |k| self.frame("dark current", 0.0, time_s, (2 * step + k) as u64);
        Ok(pair(&frame(0)?, &frame(1)?))
    }
}

/// Levels of the first sweep from dark to beyond saturation.
const COARSE_LEVELS: usize = 24;

/// Largest relative standard error of a gain that is told.
const MOST_GAIN_ERROR: f64 = 0.2;

/// System gain: slope through the origin of the variance over the signal, both less their dark values, up to a light.
fn photon_transfer_gain(
    bench: &Bench<'_>,
    points: &[PhotonTransferPoint],
    dark_dn2: f64,
    most_e: f64,
) -> Result<f64, SensorProblem> {
    let linear = || points.iter().filter(|p| p.light_e <= most_e);
    let squares: f64 = linear().map(|p| p.signal_dn.powi(2)).sum();
    let gain = linear().map(|p| p.signal_dn * (p.variance_dn2 - dark_dn2)).sum::<f64>() / squares;
    // A variance of n pixels has a relative variance of 2 / n; that of the dark counts in every point
    let [columns, rows] = bench.sensor.image_size();
    let of_dark = dark_dn2 * linear().map(|p| p.signal_dn).sum::<f64>();
    let of_points: f64 = linear().map(|p| (p.signal_dn * p.variance_dn2).powi(2)).sum();
    let error = (2.0 / (columns * rows) as f64 * (of_points + of_dark.powi(2))).sqrt() / squares;
    if gain.is_finite() && gain * MOST_GAIN_ERROR > error {
        return Ok(gain);
    }
    let message = "the variance does not rise beyond its noise; check well capacity, gain and black level, or measure a larger region";
    Err(SensorProblem::new("characterization", message))
}

/// Number of the point of the largest variance, averaged with so many neighbors on each side.
fn largest(points: &[PhotonTransferPoint], neighbors: usize) -> usize {
    let smooth =
        |i: usize| -> f64 { points[i - neighbors..=i + neighbors].iter().map(|p| p.variance_dn2).sum() };
    let last = points.len() - neighbors;
    (neighbors..last).fold(neighbors, |best, i| if smooth(i) > smooth(best) { i } else { best })
}

/// Maximum of the cubic of least squares through a fine sweep around the largest variance: the curve falls faster than
/// it rises.
fn maximum(points: &[PhotonTransferPoint]) -> Option<f64> {
    let center = points[points.len() / 2].light_e;
    let half = 0.5 * (points[points.len() - 1].light_e - points[0].light_e);
    let height = points.iter().map(|p| p.variance_dn2).fold(0.0, f64::max);
    // Normal equations of 1, x, x², x³ with x from -1 to 1.
    let (mut matrix, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for point in points {
        let x = (point.light_e - center) / half;
        let powers = Vector4::new(1.0, x, x * x, x * x * x);
        matrix += powers * powers.transpose();
        right += powers * (point.variance_dn2 / height);
    }
    let [_, b, c, d] = matrix.cholesky()?.solve(&right).into();
    // b + 2 c x + 3 d x² = 0 with a falling slope.
    let root = c * c - 3.0 * b * d;
    let x = if d.abs() < 1e-12 { -b / (2.0 * c) } else { (-c - root.max(0.0).sqrt()) / (3.0 * d) };
    (root >= 0.0 && x.abs() <= 1.0).then_some(center + half * x)
}

/// Doubles the light until frames get no brighter: light beyond saturation, in electrons of the nominal response.
fn light_beyond_saturation(bench: &Bench<'_>, dark_dn: f64) -> Result<f64, SensorProblem> {
    let mut beyond_e = 64.0;
    let mut brightest_dn = bench.pair("range", beyond_e, 0)?.0;
    for step in 1..40 {
        let (next_dn, _) = bench.pair("range", 2.0 * beyond_e, step)?;
        // Below one digital number nothing is seen to rise
        let risen_dn = brightest_dn - dark_dn;
        let still_rises = risen_dn < 1.0 || next_dn > brightest_dn + 0.02 * risen_dn;
        brightest_dn = next_dn;
        if !still_rises {
            break;
        }
        beyond_e *= 2.0;
    }
    Ok(beyond_e)
}

/// Temperature rise that doubles the dark current, K, from a sensor 10 K warmer; `None` without dark current.
fn doubling_temperature_k(
    bench: &Bench<'_>,
    gain: f64,
    most_dn: f64,
    mean_slope: f64,
) -> Result<Option<f64>, SensorProblem> {
    let warmer_k = 10.0;
    let model = bench.sensor.model();
    Ok(if model.dark_electrons_per_s() > 0.0 {
        let warm = SensorModel { temperature_c: model.temperature_c + warmer_k, ..model.clone() };
        let warm = Sensor::new(warm, bench.sensor.qe().clone())?;
        let (slope, _) = Bench { sensor: &warm, settings: bench.settings }.dark_slopes(gain, most_dn)?;
        let doublings = (slope / mean_slope).log2();
        (doublings > 0.0 && doublings.is_finite()).then_some(warmer_k / doublings)
    } else {
        None
    })
}

/// Warns where zero cuts the noise of dark frames.
fn cut_dark_noise(bench: &Bench<'_>) -> Result<Vec<Warning>, SensorProblem> {
    let frame = bench.frame("dark", 0.0, bench.settings.exposure_s, 0)?;
    let empty = frame.data.iter().filter(|&&dn| dn == 0).count() as f64 / frame.data.len() as f64;
    if empty <= MOST_EMPTY {
        return Ok(Vec::new());
    }
    let percent = 100.0 * empty;
    let text = format!(
        "{percent:.1} % of the pixels of a dark frame are 0 and cut the dark noise; raise black_level_dn"
    );
    Ok(vec![text.into()])
}

/// Spatial variances of averaged frames: total, rows, columns, pixels.
struct Patterns {
    dark_dn2: [f64; 4],
    /// At half saturation, less those of the dark.
    response_dn2: [f64; 4],
    /// Mean signal at half saturation, DN.
    signal_dn: f64,
}

/// The light of the largest temporal variance, and the fixed patterns.
struct Saturation {
    light_e: f64,
    patterns: Patterns,
}

/// Looks for saturation in three sweeps, each finer than the one before.
fn saturation(bench: &Bench<'_>, (dark_dn, dark_dn2): (f64, f64)) -> Result<Saturation, SensorProblem> {
    let levels = bench.settings.levels;
    let beyond_e = light_beyond_saturation(bench, dark_dn)?;
    // The last doubling crossed saturation: between half of it and all of it lies the largest variance.
    // The step of the coarse sweep is 5 % of its range; the largest variance lies within two steps of its maximum.
    let coarse = bench.sweep("coarse", dark_dn, [0.0, 1.2 * beyond_e], COARSE_LEVELS)?;
    let coarse_e = coarse[largest(&coarse, 0)].light_e;
    let gain = photon_transfer_gain(bench, &coarse, dark_dn2, 0.7 * coarse_e)?;
    let (dark, bright) = (bench.stack("dark stack", 0.0)?, bench.stack("bright stack", 0.5 * coarse_e)?);
    let (dark_spatial, bright_spatial) = (dark.spatial(), bright.spatial());
    let patterns = Patterns {
        dark_dn2: dark_spatial,
        response_dn2: [0, 1, 2, 3].map(|i| bright_spatial[i] - dark_spatial[i]),
        signal_dn: bright.level() - dark.level(),
    };
    // The variance falls over a few of these relative deviations, of shot noise and of the pixels' responsivities.
    let coarse_signal_e = 2.0 * patterns.signal_dn / gain;
    let unevenness = patterns.response_dn2[0].max(0.0) / patterns.signal_dn.powi(2);
    let spread = (1.0 / coarse_signal_e + unevenness).sqrt();
    let two_steps_e = 2.0 * 1.2 * beyond_e / COARSE_LEVELS as f64;
    let fine = bench.sweep("fine", dark_dn, [coarse_e - two_steps_e, coarse_e + two_steps_e], levels)?;
    let fine_e = fine[largest(&fine, 1)].light_e;
    let half_e = 2.0 * spread * fine_e;
    let finest = bench.sweep("finest", dark_dn, [fine_e - half_e, fine_e + half_e], levels)?;
    Ok(Saturation { light_e: maximum(&finest).unwrap_or(fine_e), patterns })
}

/// Digital numbers per unit of light, from the linear part.
fn response(points: &[PhotonTransferPoint], saturation_light_e: f64) -> f64 {
    let linear = points.iter().filter(|p| p.light_e <= 0.7 * saturation_light_e);
    linear.clone().map(|p| p.signal_dn * p.light_e).sum::<f64>()
        / linear.map(|p| p.light_e.powi(2)).sum::<f64>()
}

/// Mean distance from the line of least relative squares, %.
fn linearity_error_percent(points: &[PhotonTransferPoint], saturation_light_e: f64) -> f64 {
    let in_range = |p: &&PhotonTransferPoint| (0.05..=0.95).contains(&(p.light_e / saturation_light_e));
    let range = points.iter().filter(in_range);
    let line = Line::through(range.clone().map(|p| (p.light_e, p.signal_dn, p.signal_dn.powi(-2))));
    let deviations: Vec<f64> = range.map(|p| (p.signal_dn / line.at(p.light_e) - 1.0).abs()).collect();
    100.0 * mean(deviations.iter().copied())
}

/// Measures a sensor.
///
/// The middle of the sensor is measured pixel by pixel in even, steady light: region, binning, shutter and strobe of
/// the model do not count, nor do crosstalk and fall-off, which even light does not show.
///
/// # Errors
/// A mode other than physical, settings that can't be used, or a sensor whose light can't be measured.
pub fn characterize(
    sensor: &Sensor,
    settings: &CharacterizationSettings,
) -> Result<Characterization, SensorProblem> {
    check(settings)?;
    let laboratory = in_laboratory(sensor, settings)?;
    let bench = Bench { sensor: &laboratory, settings };
    let mut warnings = cut_dark_noise(&bench)?;
    let dark = bench.pair("dark", 0.0, 0)?;
    let (dark_dn, dark_dn2) = dark;

    // Find the light that saturates, then sweep up to it
    let Saturation { light_e: saturation_light_e, patterns } = saturation(&bench, dark)?;
    let photon_transfer =
        bench.sweep("transfer", dark_dn, [0.0, 1.1 * saturation_light_e], settings.levels)?;
    let gain = photon_transfer_gain(&bench, &photon_transfer, dark_dn2, 0.7 * saturation_light_e)?;
    let dark_noise_e = (dark_dn2 - QUANTIZATION_NOISE_DN.powi(2)).max(0.0).sqrt() / gain;
    let saturation_e = saturation_light_e * response(&photon_transfer, saturation_light_e) / gain;
    let full_scale_e = (bench.pair("full", 4.0 * saturation_light_e, 0)?.0 - dark_dn) / gain;

    // Dark frames over time, and warmer
    let most_dn = dark_dn + 0.5 * gain * saturation_e;
    let (mean_slope, variance_slope) = bench.dark_slopes(gain, most_dn)?;
    let doubling_temperature_k = doubling_temperature_k(&bench, gain, most_dn, mean_slope)?;

    if dark_dn2 < LEAST_DARK_VARIANCE_DN2 {
        warnings.push(quantization_warning(dark_dn2, gain));
    }
    let threshold_e = sensitivity_threshold_e(dark_noise_e, gain);
    let mut result = Characterization {
        settings: CharacterizationSettings { region: laboratory.image_size(), ..*settings },
        gain_dn_per_e: gain,
        gain_e_per_dn: 1.0 / gain,
        dark_noise_e,
        dark_noise_dn: dark_dn2.sqrt(),
        dark_mean_dn: dark_dn,
        saturation_capacity_e: saturation_e,
        full_scale_e,
        dsnu_e: non_uniformity(patterns.dark_dn2, 1.0 / gain),
        prnu_percent: non_uniformity(patterns.response_dn2, 100.0 / patterns.signal_dn),
        dark_current_e_per_s: mean_slope / gain,
        dark_current_from_variance_e_per_s: variance_slope / (gain * gain),
        doubling_temperature_k,
        linearity_error_percent: linearity_error_percent(&photon_transfer, saturation_light_e),
        sensitivity_threshold_e: threshold_e,
        dynamic_range_db: 20.0 * (saturation_e / threshold_e).log10(),
        snr_max_db: 10.0 * saturation_e.log10(),
        channels: channels(sensor, threshold_e),
        photon_transfer,
        warnings,
        recovered: Vec::new(),
    };
    result.recovered = recovered(&laboratory, &result, settings.exposure_s);
    Ok(result)
}

fn channels(sensor: &Sensor, threshold_e: f64) -> Vec<ChannelSensitivity> {
    let qe = sensor.effective_qe();
    let channel = |channel: &super::ChannelQe| {
        let efficiency = channel.curve.max() * sensor.model().fill_factor;
        ChannelSensitivity {
            channel: channel.name.clone(),
            peak_nm: channel.curve.peak_nm(),
            quantum_efficiency_percent: 100.0 * efficiency,
            sensitivity_threshold_photons: threshold_e / efficiency,
        }
    };
    qe.channels().iter().map(channel).collect()
}

/// The set values of the measured quantities.
fn recovered(laboratory: &Sensor, measured: &Characterization, time_s: f64) -> Vec<Recovered> {
    let model = laboratory.model();
    let simple =
        model.hot_pixels_per_million == 0.0 && model.dead_pixels_per_million == 0.0 && model.well_knee == 1.0;
    if !simple {
        return Vec::new();
    }
    // Compute the set values in the units of the measurement
    let electrons = |mv: f64| mv * 1e-3 / model.conversion_gain_v_per_e();
    let gain = model.base_dn_per_electron() * model.analog_gain * measured.settings.gain;
    let dark_e = model.dark_electrons_per_s() * time_s;
    let read_e2 = model.dark_noise_electrons(measured.settings.gain).powi(2) + dark_e;
    let spread_e = dark_e * model.dark_current_log_spread.powi(2).exp_m1().sqrt();
    let dsnu_e2 = model.dsnu_electrons().powi(2)
        + spread_e.powi(2)
        + electrons(model.row_offset_mv).powi(2)
        + electrons(model.column_offset_mv).powi(2);
    let prnu = model.prnu_percent.hypot(model.column_gain_percent);
    let converter_e = (f64::from(model.max_code()) - measured.dark_mean_dn) / gain;
    let full_e = (model.well_capacity_e - dark_e).min(converter_e);
    let mut list = vec![
        ("system gain", "DN/e-", gain, measured.gain_dn_per_e),
        ("temporal dark noise", "e-", read_e2.sqrt(), measured.dark_noise_e),
        ("full scale", "e-", full_e, measured.full_scale_e),
        ("DSNU", "e-", dsnu_e2.sqrt(), measured.dsnu_e.total),
        ("PRNU", "%", prnu, measured.prnu_percent.total),
        ("dark current", "e-/s", model.dark_electrons_per_s(), measured.dark_current_e_per_s),
    ];
    // The closed form knows a well that fills before the converter ends, or the other way round, not both at once.
    let read_e = read_e2.sqrt();
    let limit = if model.well_capacity_e + 4.0 * read_e < converter_e {
        Some(Limit::well(model.well_capacity_e))
    } else if model.well_capacity_e - 4.0 * read_e > converter_e {
        Some(Limit { electrons: converter_e + dark_e, noise_e: read_e })
    } else {
        None
    };
    if let Some(limit) = limit {
        let saturation = saturation_capacity_e(limit, prnu * 1e-2) - dark_e;
        list.insert(2, ("saturation capacity", "e-", saturation, measured.saturation_capacity_e));
    }
    if let Some(doubling) = measured.doubling_temperature_k {
        list.push(("doubling temperature", "K", model.dark_doubling_temperature_k, doubling));
    }
    list.into_iter()
        .map(|(quantity, unit, set, measured)| Recovered {
            quantity: quantity.into(),
            unit: unit.into(),
            set,
            measured,
            relative_error: (set != 0.0).then(|| measured / set - 1.0),
        })
        .collect()
}
