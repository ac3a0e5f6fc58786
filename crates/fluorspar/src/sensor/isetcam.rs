//! ISETCam's sensor formulas [^farrell2012], so that its results can be compared number by number.
//!
//! In its order, with its constants and with what a reader may not expect:
//!
//! 1. dark voltage is added only for noise flag 2;
//! 2. photon noise is normal and rounded to whole electrons from a mean of 25 on, Poisson below;
//! 3. read noise in volts; then PRNU multiplies everything so far, dark signal and read noise included; then DSNU;
//! 4. fixed patterns are drawn anew for every frame;
//! 5. `(V + offset) / gain`: a gain above 1 darkens the image;
//! 6. clipping to 0 and the voltage swing, without a pedestal: half of a dark frame is exactly 0;
//! 7. `DN = round(V / (swing / 2^bits))` from 0 to 2^bits, one code more than the bits can count.
//!
//! Random numbers are ours: its results agree as distributions. Its blur of the optical image before sampling is not
//! repeated; pixels integrate over their area as in the physical mode.
//!
//! [^farrell2012]: Farrell, Catrysse, Wandell, Digital camera simulation, Appl. Opt. 51 (2012) A80,
//!     doi:10.1364/AO.51.000A80.

use super::adc::Adc;
use super::physical_chain::{NoiseSource, frame_key, line_key, normal, poisson};
use super::{Exposure, SensorMode, SensorModel};
use crate::sampling::random::Key;

/// Mean from which ISETCam replaces the Poisson distribution by a rounded normal one, electrons.
const NORMAL_ABOVE_E: f64 = 25.0;

/// The chain at one exposure, all constants in volts.
pub(super) struct IsetcamChain {
    flag: i8,
    time_s: f64,
    volts_per_e: f64,
    volts_per_dn: f64,
    dark_v: f64,
    read_v: f64,
    prnu: f64,
    dsnu_v: f64,
    column_offset_v: f64,
    column_gain: f64,
    offset_v: f64,
    gain: f64,
    swing_v: f64,
    full_code: u16,
    frame: Key,
}

impl IsetcamChain {
    pub(super) fn new(model: &SensorModel, flag: i8, exposure: &Exposure) -> Self {
        let volts_per_e = model.conversion_gain_v_per_e();
        let dark_v = model.dark_electrons_per_s() * volts_per_e * exposure.time_s;
        Self {
            flag,
            time_s: exposure.time_s,
            volts_per_e,
            volts_per_dn: model.volts_per_dn(),
            dark_v: if flag == 2 { dark_v } else { 0.0 },
            read_v: model.read_noise_electrons() * volts_per_e,
            prnu: model.prnu_percent * 1e-2,
            dsnu_v: model.dsnu_electrons() * volts_per_e,
            column_offset_v: model.column_offset_mv * 1e-3,
            column_gain: model.column_gain_percent * 1e-2,
            offset_v: model.analog_offset_mv * 1e-3,
            gain: model.analog_gain * exposure.gain,
            swing_v: model.voltage_swing_v,
            full_code: 1 << model.bit_depth,
            frame: frame_key(exposure),
        }
    }

    pub(super) fn of(model: &SensorModel, exposure: &Exposure) -> Option<Self> {
        match model.mode {
            SensorMode::Isetcam { noise_flag } => Some(Self::new(model, noise_flag, exposure)),
            SensorMode::Physical | SensorMode::NoiseFree => None,
        }
    }

    /// Digital numbers per electron.
    pub(super) fn dn_per_electron(&self) -> f64 {
        self.volts_per_e / (self.gain * self.volts_per_dn)
    }

    /// Digital number of no light.
    pub(super) fn black_dn(&self) -> f64 {
        self.offset_v / self.gain / self.volts_per_dn
    }

    /// Read noise of the output, DN rms.
    pub(super) fn read_noise_dn(&self) -> f64 {
        if self.flag == 2 { self.read_v / self.gain / self.volts_per_dn } else { 0.0 }
    }

    /// Temporal noise of the output around a mean of electrons, dark ones included, DN rms.
    pub(super) fn temporal_noise_dn(&self, mean_e: f64) -> f64 {
        let shot_v2 = if matches!(self.flag, -2 | 1 | 2) { self.volts_per_e.powi(2) * mean_e } else { 0.0 };
        let shot_dn2 = shot_v2 / (self.gain * self.volts_per_dn).powi(2);
        (shot_dn2 + self.read_noise_dn().powi(2) + super::adc::QUANTIZATION_NOISE_DN.powi(2)).sqrt()
    }

    /// Mean dark electrons of the exposure; none unless the flag is 2.
    pub(super) fn dark_electrons(&self) -> f64 {
        self.dark_v / self.volts_per_e
    }

    /// Electrons at which the voltage swing is reached.
    pub(super) fn full_scale_e(&self) -> f64 {
        (self.swing_v * self.gain - self.offset_v) / self.volts_per_e
    }

    /// Code at the voltage swing, `2^bits`.
    pub(super) fn white_level(&self) -> u16 {
        self.full_code
    }

    /// Mean voltage of photo-electrons at the converter.
    pub(super) fn mean_volts(&self, electrons: f64) -> f64 {
        self.clipped(self.amplified(electrons * self.volts_per_e + self.dark_v))
    }

    fn amplified(&self, volts: f64) -> f64 {
        (volts + self.offset_v) / self.gain
    }

    fn clipped(&self, volts: f64) -> f64 {
        if self.flag >= 0 { volts.clamp(0.0, self.swing_v) } else { volts }
    }

    /// Voltage of one pixel before the analog stage.
    pub(super) fn noisy_volts(&self, col: usize, pixel: u64, electrons: f64) -> f64 {
        let mut volts = electrons * self.volts_per_e + self.dark_v;
        if matches!(self.flag, 0 | -1) {
            return volts;
        }
        let place = self.frame.with(pixel);
        let mean_e = volts / self.volts_per_e;
        let counted_e = if mean_e >= NORMAL_ABOVE_E {
            (mean_e + mean_e.sqrt() * normal(place, NoiseSource::Shot)).round()
        } else {
            poisson(mean_e, place)
        };
        volts = counted_e * self.volts_per_e;
        if self.flag == 2 {
            volts += self.read_v * normal(place, NoiseSource::Read);
            volts *= 1.0 + self.prnu * normal(place, NoiseSource::Prnu);
            volts += self.dsnu_v * normal(place, NoiseSource::Dsnu);
            if self.column_gain > 0.0 || self.column_offset_v > 0.0 {
                let column = line_key(self.frame, col);
                volts *= 1.0 + self.column_gain * normal(column, NoiseSource::ColumnGain);
                volts += self.column_offset_v * normal(column, NoiseSource::ColumnOffset);
            }
        }
        volts
    }

    /// Turns the electron rates of one row into digital numbers. Without clipping (flags below 0) only the 16 bits of
    /// the raw image limit them. `rates` are those of the whole row, `out` begins at column `first_column`.
    pub(super) fn expose_row(&self, row: usize, first_column: usize, rates: &[f32], out: &mut [u16]) {
        let adc = Adc { max_code: if self.flag >= 0 { self.full_code } else { u16::MAX } };
        let first = row as u64 * rates.len() as u64;
        for (index, out) in out.iter_mut().enumerate() {
            let col = first_column + index;
            let electrons = f64::from(rates[col]) * self.time_s;
            let volts = self.noisy_volts(col, first + col as u64, electrons);
            *out = adc.code(self.clipped(self.amplified(volts)) / self.volts_per_dn);
        }
    }
}
