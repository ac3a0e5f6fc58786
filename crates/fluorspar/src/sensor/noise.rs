//! The physical noise chain: light, electrons, well, gain, converter.
//!
//! ```text
//! N   = min(Poisson(t rate (1 + prnu) + t dark), well)     electrons
//! U   = (N + dsnu + read) (1 + column gain) + column + row  electrons at the input of the gain stage
//! DN  = clamp(round(K U + post + black), 0, 2^n - 1)        K = conversion gain * gain / volts per DN
//! ```
//!
//! `prnu`, `dsnu`, the spread of the dark current and the row and column terms are functions of the device seed and
//! the position: the same in every frame. The Poisson draw, `read` and `post` are functions of the seed, number and
//! label of the frame, the position and the source.

use rand_distr::{Distribution, Poisson, StandardNormal};

use super::adc::{Adc, QUANTISATION_NOISE_DN};
use super::{Exposure, SensorMode, SensorModel};
use crate::sampling::random::Key;

/// What a random number is drawn for. The numbers are part of every result: never reuse or renumber them.
#[derive(Clone, Copy)]
pub(super) enum Source {
    Shot = 1,
    Read = 2,
    PostGain = 3,
    Prnu = 4,
    Dsnu = 5,
    DarkSpread = 6,
    ColumnOffset = 7,
    ColumnGain = 8,
    RowOffset = 9,
}

/// A standard normal draw for one source at one place.
#[inline]
pub(super) fn normal(place: Key, source: Source) -> f64 {
    StandardNormal.sample(&mut place.with(source as u64).rng())
}

/// A Poisson draw. Nothing comes from a mean that is not positive; a mean beyond the sampler's range (1.8e19) is
/// returned as it is.
#[inline]
pub(super) fn poisson(mean: f64, place: Key) -> f64 {
    if mean > 0.0 {
        match Poisson::new(mean) {
            Ok(distribution) => distribution.sample(&mut place.with(Source::Shot as u64).rng()),
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

/// The physical chain at one exposure, all constants in electrons and digital numbers.
pub(super) struct PhysicalChain {
    random: bool,
    time_s: f64,
    dark_e: f64,
    dark_log_spread: f64,
    prnu: f64,
    dsnu_e: f64,
    read_e: f64,
    well_e: f64,
    /// Digital numbers per electron.
    pub(super) dn_per_electron: f64,
    post_gain_dn: f64,
    /// Digital number of no light.
    pub(super) black_dn: f64,
    adc: Adc,
    column_offset_e: Vec<f64>,
    column_gain: Vec<f64>,
    row_offset_e: Vec<f64>,
    /// Spread of a full well through the row and column patterns.
    line_noise_e: f64,
    device: Key,
    frame: Key,
}

impl PhysicalChain {
    pub(super) fn new(model: &SensorModel, exposure: &Exposure) -> Self {
        let random = model.mode != SensorMode::NoiseFree;
        let gain = model.analog_gain * exposure.gain;
        let device = Key::new(model.device_seed);
        let offset_e = |mv: f64| mv * 1e-3 / model.conversion_gain_v_per_e();
        let lines = |count: usize, source, sigma: f64| -> Vec<f64> {
            let sigma = if random { sigma } else { 0.0 };
            (0..count).map(|line| sigma * normal(line_key(device, line), source)).collect()
        };
        let (column_e, row_e) = (offset_e(model.column_offset_mv), offset_e(model.row_offset_mv));
        Self {
            random,
            time_s: exposure.time_s,
            dark_e: model.dark_electrons_per_s() * exposure.time_s,
            dark_log_spread: model.dark_current_log_spread,
            prnu: model.prnu_percent * 1e-2,
            dsnu_e: model.dsnu_electrons(),
            read_e: model.read_noise_electrons(),
            well_e: model.well_capacity_e,
            dn_per_electron: model.base_dn_per_electron() * gain,
            post_gain_dn: model.post_gain_noise_mv * 1e-3 / model.volts_per_dn(),
            black_dn: model.black_level_dn + model.analog_offset_mv * 1e-3 / model.volts_per_dn(),
            adc: Adc { max_code: model.max_code() },
            column_offset_e: lines(model.columns, Source::ColumnOffset, column_e),
            column_gain: lines(model.columns, Source::ColumnGain, model.column_gain_percent * 1e-2),
            row_offset_e: lines(model.rows, Source::RowOffset, row_e),
            line_noise_e: column_e
                .hypot(row_e)
                .hypot(model.well_capacity_e * model.column_gain_percent * 1e-2),
            device,
            frame: frame_key(exposure),
        }
    }

    /// Temporal dark noise of the output, DN rms, without shot noise and quantisation.
    pub(super) fn read_noise_dn(&self) -> f64 {
        if self.random { (self.dn_per_electron * self.read_e).hypot(self.post_gain_dn) } else { 0.0 }
    }

    /// Temporal noise of the output around a mean of electrons, dark ones included, DN rms.
    pub(super) fn temporal_noise_dn(&self, mean_e: f64) -> f64 {
        let shot_dn2 = self.dn_per_electron * self.dn_per_electron * if self.random { mean_e } else { 0.0 };
        (shot_dn2 + self.read_noise_dn().powi(2) + QUANTISATION_NOISE_DN.powi(2)).sqrt()
    }

    /// Mean dark electrons of the exposure.
    pub(super) fn dark_electrons(&self) -> f64 {
        self.dark_e
    }

    /// Electrons at which either the well or the converter is full.
    pub(super) fn full_scale_e(&self) -> f64 {
        self.well_e.min((f64::from(self.adc.max_code) - self.black_dn) / self.dn_per_electron)
    }

    /// Digital number of electrons in the well, not rounded and not clipped by the converter.
    pub(super) fn dn_of_electrons(&self, electrons: f64) -> f64 {
        self.dn_per_electron * electrons.min(self.well_e) + self.black_dn
    }

    /// Digital number at and above which a pixel counts as saturated. Where the well fills before the converter, four
    /// standard deviations below the mean of a full well: noise leaves 3e-5 of the full pixels below.
    pub(super) fn white_level(&self) -> u16 {
        let full_well_dn = self.dn_of_electrons(self.well_e);
        let fixed_dn = self.dn_per_electron * self.dsnu_e.hypot(self.line_noise_e);
        let noise_dn = if self.random { self.read_noise_dn().hypot(fixed_dn) } else { 0.0 };
        let level = (full_well_dn - 4.0 * noise_dn).floor();
        level.max(self.black_dn.ceil() + 1.0).min(f64::from(self.adc.max_code)) as u16
    }

    /// Turns the electron rates of one row into digital numbers.
    pub(super) fn expose_row(&self, row: usize, rates: &[f32], out: &mut [u16]) {
        let first = row as u64 * rates.len() as u64;
        for (col, (rate, out)) in rates.iter().zip(out).enumerate() {
            let photo_e = f64::from(*rate).max(0.0) * self.time_s;
            let dn = if self.random {
                self.noisy_dn(row, col, first + col as u64, photo_e)
            } else {
                self.dn_of_electrons(photo_e + self.dark_e)
            };
            *out = self.adc.code(dn);
        }
    }

    #[inline]
    fn noisy_dn(&self, row: usize, col: usize, pixel: u64, photo_e: f64) -> f64 {
        let (device, frame) = (self.device.with(pixel), self.frame.with(pixel));
        let response = 1.0 + term(self.prnu, device, Source::Prnu);
        let mut dark_e = self.dark_e;
        if self.dark_log_spread > 0.0 {
            let deviation = term(self.dark_log_spread, device, Source::DarkSpread);
            dark_e *= (deviation - 0.5 * self.dark_log_spread * self.dark_log_spread).exp();
        }
        let electrons = poisson(photo_e * response.max(0.0) + dark_e, frame).min(self.well_e);
        let pixel_e =
            electrons + term(self.dsnu_e, device, Source::Dsnu) + term(self.read_e, frame, Source::Read);
        let input_e =
            pixel_e * (1.0 + self.column_gain[col]) + self.column_offset_e[col] + self.row_offset_e[row];
        self.dn_per_electron * input_e + term(self.post_gain_dn, frame, Source::PostGain) + self.black_dn
    }
}

/// A normal term of a standard deviation; nothing is drawn where that is zero.
#[inline]
fn term(sigma: f64, place: Key, source: Source) -> f64 {
    if sigma > 0.0 { sigma * normal(place, source) } else { 0.0 }
}
