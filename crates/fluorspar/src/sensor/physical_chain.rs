//! The physical noise chain: light, electrons, well, gain, converter.
//!
//! ```text
//! N   = well(Poisson(t_light rate (1 + prnu) + t dark))     electrons
//! U   = (N + dsnu + read) (1 + column gain) + column + row  electrons at the input of the gain stage
//! DN  = clamp(round(K U + post + black), 0, 2^n - 1)        K = conversion gain * gain / volts per DN
//! ```
//!
//! `t_light` is the part of the exposure during which light is on. `well(x)` is `min(x, W)`, or with a knee at `k W`
//! `k W + (1 - k) W (1 - exp(-(x - k W) / ((1 - k) W)))` above it, which joins smoothly. Charge binning adds `N` of
//! several pixels before they are read.
//!
//! `prnu`, `dsnu`, the spread of the dark current, hot and dead pixels and the row and column offsets are functions of
//! the device seed and the position: the same in every frame. The Poisson draw, `read`, `post` and the temporal row and
//! column noise are functions of the seed, number and label of the frame, the position and the source.

use rand::RngExt;
use rand_distr::{Distribution, Exp1, Poisson};

use super::adc::{Adc, QUANTIZATION_NOISE_DN};
use super::readout::Readout;
use super::shutter::Timing;
use super::{BinningKind, Exposure, SensorMode, SensorModel};
use crate::sampling::random::Key;

/// Purpose of a random number. The numbers are part of every result: never reuse or renumber them.
#[derive(Clone, Copy)]
pub(super) enum NoiseSource {
    Shot = 1,
    Read = 2,
    PostGain = 3,
    Prnu = 4,
    Dsnu = 5,
    DarkSpread = 6,
    ColumnOffset = 7,
    ColumnGain = 8,
    RowOffset = 9,
    HotPixel = 10,
    DeadPixel = 11,
    ColumnNoise = 12,
    RowNoise = 13,
}

/// A standard normal draw for one source at one place.
#[inline]
pub(super) fn normal(place: Key, source: NoiseSource) -> f64 {
    place.with(source as u64).normal()
}

/// A Poisson draw. Nothing comes from a mean that is not positive; a mean beyond the sampler's range (1.8e19) is
/// returned as it is.
#[inline]
pub(super) fn poisson(mean: f64, place: Key) -> f64 {
    if mean > 0.0 {
        match Poisson::new(mean) {
            Ok(distribution) => distribution.sample(&mut place.with(NoiseSource::Shot as u64).rng()),
            Err(_) => mean,
        }
    } else {
        0.0
    }
}

/// Key of the temporal noise of a frame.
pub(super) fn frame_key(exposure: &Exposure) -> Key {
    Key::new(exposure.seed).with(exposure.frame).with_text(&exposure.label)
}

/// Key of the column or row patterns; the top bit keeps lines apart from pixels.
pub(super) fn line_key(frame: Key, line: usize) -> Key {
    frame.with(1 << 63 | line as u64)
}

/// Fixed properties of single pixels, independent of the exposure.
#[derive(Clone, Copy)]
struct Defects {
    hot: f64,
    /// Mean additional dark electrons of a hot pixel in the exposure.
    hot_e: f64,
    dead: f64,
}

impl Defects {
    fn hot_electrons(&self, device: Key) -> f64 {
        if self.hot <= 0.0 {
            return 0.0;
        }
        let mut rng = device.with(NoiseSource::HotPixel as u64).rng();
        if rng.random::<f64>() < self.hot {
            self.hot_e * <Exp1 as Distribution<f64>>::sample(&Exp1, &mut rng)
        } else {
            0.0
        }
    }

    fn is_dead(&self, device: Key) -> bool {
        self.dead > 0.0 && device.with(NoiseSource::DeadPixel as u64).rng().random::<f64>() < self.dead
    }
}

/// Pixels of a device that are hot or dead, as indices row by row.
#[cfg(test)]
pub(super) fn defect_pixels(model: &SensorModel) -> (Vec<usize>, Vec<usize>) {
    let share = |per_million: f64| per_million * 1e-6;
    let defects = Defects {
        hot: share(model.hot_pixels_per_million),
        hot_e: 1.0,
        dead: share(model.dead_pixels_per_million),
    };
    let device = Key::new(model.device_seed);
    let pixels = || (0..model.columns * model.rows).map(|pixel| (pixel, device.with(pixel as u64)));
    let hot = pixels().filter(|(_, key)| defects.hot_electrons(*key) > 0.0).map(|(pixel, _)| pixel).collect();
    let dead = pixels().filter(|(_, key)| defects.is_dead(*key)).map(|(pixel, _)| pixel).collect();
    (hot, dead)
}

/// The physical chain at one exposure, all constants in electrons and digital numbers.
pub(super) struct PhysicalChain {
    random: bool,
    columns: usize,
    time_s: f64,
    timing: Timing,
    first_row: usize,
    dark_e: f64,
    dark_log_spread: f64,
    defects: Defects,
    prnu: f64,
    dsnu_e: f64,
    read_e: f64,
    well_e: f64,
    /// Electrons up to which all are collected.
    knee_e: f64,
    /// Pixels whose charges are added before they are read, and the electrons that the node holds.
    added: f64,
    node_e: f64,
    /// Pixels whose digital numbers are added or averaged.
    joined: f64,
    averages: bool,
    /// Digital numbers per electron of one read.
    k: f64,
    post_gain_dn: f64,
    /// Digital number of no light of one read.
    black: f64,
    adc: Adc,
    column_offset_e: Vec<f64>,
    column_gain: Vec<f64>,
    row_offset_e: Vec<f64>,
    /// Spread of a full well through the row and column patterns.
    line_noise_e: f64,
    /// Temporal row and column noise together, e- rms.
    line_read_e: f64,
    device: Key,
    frame: Key,
}

impl PhysicalChain {
    pub(super) fn new(model: &SensorModel, readout: &Readout, exposure: &Exposure) -> Self {
        let random = model.mode != SensorMode::NoiseFree;
        let gain = model.analog_gain * exposure.gain;
        let (device, frame) = (Key::new(model.device_seed), frame_key(exposure));
        let electrons = |mv: f64| model.electrons_of_mv(mv);
        let lines = |count: usize, key: Key, source, sigma: f64| -> Vec<f64> {
            let sigma = if random { sigma } else { 0.0 };
            (0..count).map(|line| term(sigma, line_key(key, line), source)).collect()
        };
        // Fixed pattern of a line plus its noise in this frame
        let offsets = |count: usize, fixed, fixed_e: f64, temporal, temporal_e: f64| -> Vec<f64> {
            let both = lines(count, device, fixed, fixed_e)
                .into_iter()
                .zip(lines(count, frame, temporal, temporal_e));
            both.map(|(fixed, temporal)| fixed + temporal).collect()
        };
        // Convert offsets and noise from millivolts to electrons
        let (column_e, row_e) = (electrons(model.column_offset_mv), electrons(model.row_offset_mv));
        let (column_read_e, row_read_e) = (electrons(model.column_noise_mv), electrons(model.row_noise_mv));
        // Find how many pixels share a well and a read
        let pixels = readout.binning.map_or(1.0, |binning| binning.pixels() as f64);
        let kind = readout.binning.map(|binning| binning.kind);
        let added = if kind == Some(BinningKind::Charge) { pixels } else { 1.0 };
        let node_e = readout.binning.and_then(|b| b.well_capacity_e).unwrap_or(added * model.well_capacity_e);
        let hot_e = model.hot_pixel_dark_current_e_per_s * model.dark_temperature_factor() * exposure.time_s;
        Self {
            random,
            columns: model.columns,
            time_s: exposure.time_s,
            timing: Timing { shutter: model.shutter, strobe: model.strobe },
            first_row: readout.first_row,
            dark_e: model.dark_electrons_per_s() * exposure.time_s,
            dark_log_spread: model.dark_current_log_spread,
            defects: Defects {
                hot: model.hot_pixels_per_million * 1e-6,
                hot_e,
                dead: model.dead_pixels_per_million * 1e-6,
            },
            prnu: model.prnu_percent * 1e-2,
            dsnu_e: model.dsnu_electrons(),
            read_e: model.read_noise_electrons(),
            well_e: model.well_capacity_e,
            knee_e: model.well_knee * model.well_capacity_e,
            added,
            node_e,
            joined: pixels / added,
            averages: kind == Some(BinningKind::DigitalAverage),
            k: model.base_dn_per_electron() * gain,
            post_gain_dn: model.post_gain_noise_mv * 1e-3 / model.volts_per_dn(),
            black: model.black_level_dn + model.analog_offset_mv * 1e-3 / model.volts_per_dn(),
            adc: Adc { max_code: model.max_code() },
            column_offset_e: offsets(
                model.columns,
                NoiseSource::ColumnOffset,
                column_e,
                NoiseSource::ColumnNoise,
                column_read_e,
            ),
            column_gain: lines(
                model.columns,
                device,
                NoiseSource::ColumnGain,
                model.column_gain_percent * 1e-2,
            ),
            row_offset_e: offsets(
                model.rows,
                NoiseSource::RowOffset,
                row_e,
                NoiseSource::RowNoise,
                row_read_e,
            ),
            line_noise_e: column_e
                .hypot(row_e)
                .hypot(model.well_capacity_e * model.column_gain_percent * 1e-2),
            line_read_e: column_read_e.hypot(row_read_e),
            device,
            frame,
        }
    }

    /// Factor from the sum of the reads of a raw pixel to the raw pixel.
    fn share(&self) -> f64 {
        if self.averages { 1.0 / self.joined } else { 1.0 }
    }

    /// Digital numbers of a raw pixel per electron that its pixels collect.
    pub(super) fn dn_per_electron(&self) -> f64 {
        self.k * self.share()
    }

    /// Digital number of no light of a raw pixel.
    pub(super) fn black_dn(&self) -> f64 {
        self.black * self.joined * self.share()
    }

    /// Temporal dark noise of the output, DN rms, without shot noise and quantization.
    pub(super) fn read_noise_dn(&self) -> f64 {
        if self.random {
            let one_read = (self.k * self.read_e.hypot(self.line_read_e)).hypot(self.post_gain_dn);
            one_read * self.joined.sqrt() * self.share()
        } else {
            0.0
        }
    }

    /// Temporal noise of a raw pixel around a mean of electrons of one of its pixels, dark ones included, DN rms.
    pub(super) fn temporal_noise_dn(&self, mean_e: f64) -> f64 {
        let shot_e2 = if self.random { self.added * self.joined * mean_e } else { 0.0 };
        let rounding = QUANTIZATION_NOISE_DN * self.joined.sqrt() * self.share();
        // An average is rounded once more.
        let last = if self.averages { QUANTIZATION_NOISE_DN } else { 0.0 };
        (self.dn_per_electron().powi(2) * shot_e2
            + self.read_noise_dn().powi(2)
            + rounding.powi(2)
            + last.powi(2))
        .sqrt()
    }

    /// Mean dark electrons of one pixel in the exposure.
    pub(super) fn dark_electrons(&self) -> f64 {
        self.dark_e
    }

    /// Time that the first row collects light, s.
    pub(super) fn light_s(&self) -> f64 {
        self.timing.light_s(0, self.time_s)
    }

    /// Electrons of one pixel at which its well, the node of charge binning or the converter is full.
    pub(super) fn full_scale_e(&self) -> f64 {
        let converter_e = (f64::from(self.adc.max_code) - self.black) / self.k;
        self.well_e.min(self.node_e.min(converter_e) / self.added)
    }

    /// Largest digital number of a raw pixel.
    pub(super) fn max_dn(&self) -> f64 {
        f64::from(self.adc.max_code) * self.joined * self.share()
    }

    /// Electrons that a pixel holds of those that are freed.
    #[inline]
    fn collected(&self, electrons: f64) -> f64 {
        if electrons <= self.knee_e {
            electrons
        } else if self.knee_e >= self.well_e {
            self.well_e
        } else {
            let rest = self.well_e - self.knee_e;
            self.knee_e - rest * (-(electrons - self.knee_e) / rest).exp_m1()
        }
    }

    /// Digital number of a raw pixel whose pixels have these electrons each, not rounded and not clipped by the
    /// converter.
    pub(super) fn dn_of_electrons(&self, electrons: f64) -> f64 {
        self.dn_of_one_read(electrons) * self.joined * self.share()
    }

    /// The same for one read by the converter, before digital numbers are joined.
    pub(super) fn dn_of_one_read(&self, electrons: f64) -> f64 {
        self.k * (self.added * self.collected(electrons)).min(self.node_e) + self.black
    }

    /// Digital number at and above which a raw pixel counts as saturated. Where the well fills before the converter,
    /// four standard deviations below the mean of a full well: noise leaves 3e-5 of the full pixels below.
    pub(super) fn white_level(&self) -> u16 {
        let full_well_dn =
            self.dn_of_electrons(if self.knee_e < self.well_e { 10.0 } else { 1.0 } * self.well_e);
        let fixed_dn = self.k * self.dsnu_e.hypot(self.line_noise_e) * self.joined.sqrt() * self.share();
        let noise_dn = if self.random { self.read_noise_dn().hypot(fixed_dn) } else { 0.0 };
        let level = (full_well_dn - 4.0 * noise_dn).floor();
        level.clamp((self.black_dn().ceil() + 1.0).min(self.max_dn()), self.max_dn()) as u16
    }

    /// Time for which a row of the sensor collects light, s.
    fn row_light_s(&self, row: usize) -> f64 {
        self.timing.light_s(row - self.first_row, self.time_s)
    }

    /// Turns electron rates of the row of a sensor into digital numbers, for columns from `first` on.
    pub(super) fn expose_row(&self, row: usize, first: usize, rates: &[f32], out: &mut [u16]) {
        let light_s = self.row_light_s(row);
        let pixel = (row * self.columns + first) as u64;
        for (index, (rate, out)) in rates.iter().zip(out).enumerate() {
            let photo_e = f64::from(*rate).max(0.0) * light_s;
            *out = self.read(row, first + index, self.electrons(pixel + index as u64, photo_e));
        }
    }

    /// Adds the electrons that pixels of a row collect to charges.
    pub(super) fn collect(&self, row: usize, columns: impl Iterator<Item = usize>, rates: &[f32]) -> f64 {
        let light_s = self.row_light_s(row);
        let pixel = |col: usize| (row * self.columns + col) as u64;
        columns.map(|col| self.electrons(pixel(col), f64::from(rates[col]).max(0.0) * light_s)).sum()
    }

    /// Electrons in the well of one pixel.
    #[inline]
    fn electrons(&self, pixel: u64, photo_e: f64) -> f64 {
        if !self.random {
            return self.collected(photo_e + self.dark_e);
        }
        let device = self.device.with(pixel);
        let mut response = (1.0 + term(self.prnu, device, NoiseSource::Prnu)).max(0.0);
        if self.defects.is_dead(device) {
            response = 0.0;
        }
        let mut dark_e = self.dark_e;
        if self.dark_log_spread > 0.0 {
            let deviation = term(self.dark_log_spread, device, NoiseSource::DarkSpread);
            dark_e *= (deviation - 0.5 * self.dark_log_spread * self.dark_log_spread).exp();
        }
        dark_e += self.defects.hot_electrons(device);
        self.collected(poisson(photo_e * response + dark_e, self.frame.with(pixel)))
    }

    /// Digital number of a charge that is read through the node of one pixel.
    #[inline]
    pub(super) fn read(&self, row: usize, col: usize, electrons: f64) -> u16 {
        let held_e = electrons.min(self.node_e);
        if !self.random {
            return self.adc.code(self.k * held_e + self.black + dither_dn(row, col));
        }
        let pixel = (row * self.columns + col) as u64;
        let (device, frame) = (self.device.with(pixel), self.frame.with(pixel));
        let pixel_e = held_e
            + term(self.dsnu_e, device, NoiseSource::Dsnu)
            + term(self.read_e, frame, NoiseSource::Read);
        let input_e =
            pixel_e * (1.0 + self.column_gain[col]) + self.column_offset_e[col] + self.row_offset_e[row];
        self.adc.code(self.k * input_e + term(self.post_gain_dn, frame, NoiseSource::PostGain) + self.black)
    }
}

/// What spreads the rounding of a chain without noise over its pixels, -0.5 to 0.5 DN: means over pixels keep fractions of a code, as
/// those of noisy frames do. Places in two dimensions as even as can be (Roberts's sequence of the plastic number).
#[inline]
fn dither_dn(row: usize, col: usize) -> f64 {
    (0.5 + 0.754_877_666_246_692_7 * col as f64 + 0.569_840_290_998_053_2 * row as f64).fract() - 0.5
}

/// A normal term of a standard deviation; nothing is drawn where that is zero.
#[inline]
fn term(sigma: f64, place: Key, source: NoiseSource) -> f64 {
    if sigma > 0.0 { sigma * normal(place, source) } else { 0.0 }
}
