//! The data sheet of a sensor.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::photon_transfer::{Limit, saturation_capacity_e};
use super::readout::Readout;
use super::relative_illumination::RelativeIllumination;
use super::{Binning, BinningKind, Crosstalk, Emva1288, Shutter, Strobe};
use crate::units::{check_range, number_text};

/// Table 1 of Lyu et al. 2021, where a value may be given in more than one unit.
mod table_1 {
    pub(super) const READ_NOISE_MV: f64 = 1.39;
    pub(super) const DSNU_MV: f64 = 0.2536;
    pub(super) const DARK_VOLTAGE_MV_PER_S: f64 = 0.15;
}

/// Which equations turn mean electrons into digital numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum SensorMode {
    /// Poisson electrons, full well, fixed patterns that stay, noise before and after the gain, black level.
    #[default]
    Physical,
    /// The mean of many frames of the physical chain, as far as whole codes can tell: every random term at its mean, and rounding
    /// spread over the pixels so that means over them are right.
    NoiseFree,
    /// ISETCam's formulas, peculiarities included; see `isetcam.rs`.
    Isetcam {
        /// ISETCam's noise flag: -2 photon noise only and no clipping, -1 nothing, 0 clipping and quantization,
        /// 1 also photon noise, 2 everything.
        noise_flag: i8,
    },
}

/// Geometry, electronics and noise of a sensor. Every field has a default: Table 1 of Lyu et al. 2021 where the
/// table gives a value.
///
/// Noise may be given in millivolts at the sense node or in electrons, never both; the conversion gain links them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SensorModel {
    /// Columns of pixels.
    pub columns: usize,
    /// Rows of pixels.
    pub rows: usize,
    /// Repeating cell of the color filter array: channel names by row. `[["mono"]]` has no color.
    pub mosaic: Vec<Vec<String>>,
    /// Side of a (square) pixel, um.
    pub pixel_size_um: f64,
    /// Share of the pixel's area that collects light.
    pub fill_factor: f64,
    /// Side of the square that collects light, um, for its share in the sharpness; the sensitivity is that of the fill
    /// factor (physical mode only). Default: the pixel size, as behind microlenses.
    pub aperture_um: Option<f64>,
    /// Electrons that a pixel holds (physical mode only; ISETCam clips at the voltage swing).
    pub well_capacity_e: f64,
    /// Share of the well up to which every electron is collected; above it fewer and fewer are (physical mode only).
    /// 1 is a hard limit.
    pub well_knee: f64,
    /// Voltage that spans the converter at gain 1, V.
    pub voltage_swing_v: f64,
    /// Voltage per electron, mV/e-. Default: voltage swing over well capacity.
    pub conversion_gain_mv_per_e: Option<f64>,
    /// Analog gain of the base exposure. Physical mode multiplies by it, ISETCam divides by it.
    pub analog_gain: f64,
    /// Voltage added by the analog stage, mV (physical mode after the gain, ISETCam before it).
    pub analog_offset_mv: f64,
    /// Bits of the converter.
    pub bit_depth: u8,
    /// Digital number of no light (physical mode only; ISETCam has no pedestal).
    pub black_level_dn: f64,
    /// Temporal noise before the gain, mV rms. Default 1.39.
    #[schemars(extend("x-mutually-exclusive-with" = ["read_noise_e"]))]
    pub read_noise_mv: Option<f64>,
    /// Temporal noise before the gain, e- rms; instead of `read_noise_mv`.
    #[schemars(extend("x-mutually-exclusive-with" = ["read_noise_mv"]))]
    pub read_noise_e: Option<f64>,
    /// Temporal noise after the gain, mV rms at the converter, quantization excluded (physical mode only).
    pub post_gain_noise_mv: f64,
    /// Standard deviation of the pixels' offsets, mV. Default 0.2536.
    #[schemars(extend("x-mutually-exclusive-with" = ["dsnu_e"]))]
    pub dsnu_mv: Option<f64>,
    /// Standard deviation of the pixels' offsets, e-; instead of `dsnu_mv`.
    #[schemars(extend("x-mutually-exclusive-with" = ["dsnu_mv"]))]
    pub dsnu_e: Option<f64>,
    /// Standard deviation of the pixels' responsivities, percent.
    pub prnu_percent: f64,
    /// Standard deviation of the columns' offsets, mV.
    pub column_offset_mv: f64,
    /// Standard deviation of the columns' gains, percent.
    pub column_gain_percent: f64,
    /// Standard deviation of the rows' offsets, mV (physical mode only).
    pub row_offset_mv: f64,
    /// Temporal noise that all pixels of a column share, drawn anew for each frame, mV rms before the gain (physical
    /// mode only).
    pub column_noise_mv: f64,
    /// Temporal noise that all pixels of a row share, drawn anew for each frame, mV rms before the gain (physical mode
    /// only).
    pub row_noise_mv: f64,
    /// Dark signal at the reference temperature, mV/s. Default 0.15.
    #[schemars(extend("x-mutually-exclusive-with" = ["dark_current_e_per_s"]))]
    pub dark_voltage_mv_per_s: Option<f64>,
    /// Dark signal at the reference temperature, e-/s; instead of `dark_voltage_mv_per_s`.
    #[schemars(extend("x-mutually-exclusive-with" = ["dark_voltage_mv_per_s"]))]
    pub dark_current_e_per_s: Option<f64>,
    /// Spread of the pixels' dark currents: standard deviation of the logarithm of a log-normal distribution whose
    /// mean is the dark current (physical mode only).
    pub dark_current_log_spread: f64,
    /// Hot pixels, in a million (physical mode only).
    pub hot_pixels_per_million: f64,
    /// Mean of the additional dark currents of hot pixels, which are exponentially distributed, at the reference
    /// temperature, e-/s.
    pub hot_pixel_dark_current_e_per_s: f64,
    /// Pixels that do not respond to light, in a million (physical mode only).
    pub dead_pixels_per_million: f64,
    /// Temperature of the sensor, degrees Celsius.
    pub temperature_c: f64,
    /// Temperature at which the dark signal holds, degrees Celsius.
    pub dark_reference_temperature_c: f64,
    /// Temperature step that doubles the dark signal, K (6 to 9 for silicon).
    pub dark_doubling_temperature_k: f64,
    /// Relative illumination by channel name, or by "all": coefficients a1, a2, ... of 1 + a1 x + a2 x^2 + ..., x the
    /// squared distance from the center over that of a corner. It comes on top of the lens (physical and noise-free mode
    /// only).
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(extend("x-merge" = "replace"))]
    pub relative_illumination: BTreeMap<String, Vec<f64>>,
    /// Crosstalk between neighbors. Default: none.
    pub crosstalk: Option<Crosstalk>,
    /// Shutter and readout timing. Default: all rows at once.
    #[serde(skip_serializing_if = "Shutter::is_default")]
    pub shutter: Shutter,
    /// Pulsed light. Default: steady light.
    pub strobe: Option<Strobe>,
    /// Part of the sensor that is read: column, row, width, height. Default: all of it.
    pub region_px: Option<[usize; 4]>,
    /// Joining of pixels. Default: none.
    pub binning: Option<Binning>,
    /// Electronics and noise as a data sheet after EMVA 1288, in place of the fields that say the same.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-mutually-exclusive-with" = [
        "well_capacity_e", "voltage_swing_v", "conversion_gain_mv_per_e", "bit_depth", "black_level_dn", "read_noise_mv",
        "read_noise_e", "post_gain_noise_mv", "dsnu_mv", "dsnu_e", "prnu_percent", "dark_voltage_mv_per_s",
        "dark_current_e_per_s", "dark_reference_temperature_c", "dark_doubling_temperature_k", "fill_factor", "well_knee",
    ]))]
    pub emva1288: Option<Emva1288>,
    /// Which equations to use.
    pub mode: SensorMode,
    /// Seed of everything that belongs to the device and stays from frame to frame.
    pub device_seed: u64,
}

impl Default for SensorModel {
    fn default() -> Self {
        Self {
            columns: 1280,
            rows: 720,
            mosaic: [["G", "R"], ["B", "G"]].map(|row| row.map(String::from).to_vec()).to_vec(),
            pixel_size_um: 2.5,
            fill_factor: 0.99,
            aperture_um: None,
            well_capacity_e: 9000.0,
            well_knee: 1.0,
            voltage_swing_v: 0.911,
            conversion_gain_mv_per_e: None,
            analog_gain: 1.0,
            analog_offset_mv: 0.0,
            bit_depth: 12,
            black_level_dn: 64.0,
            read_noise_mv: None,
            read_noise_e: None,
            post_gain_noise_mv: 0.0,
            dsnu_mv: None,
            dsnu_e: None,
            prnu_percent: 2.29,
            column_offset_mv: 0.0,
            column_gain_percent: 0.0,
            row_offset_mv: 0.0,
            column_noise_mv: 0.0,
            row_noise_mv: 0.0,
            dark_voltage_mv_per_s: None,
            dark_current_e_per_s: None,
            dark_current_log_spread: 0.0,
            hot_pixels_per_million: 0.0,
            hot_pixel_dark_current_e_per_s: 10_000.0,
            dead_pixels_per_million: 0.0,
            temperature_c: 25.0,
            dark_reference_temperature_c: 25.0,
            dark_doubling_temperature_k: 8.0,
            relative_illumination: BTreeMap::new(),
            crosstalk: None,
            shutter: Shutter::default(),
            strobe: None,
            region_px: None,
            binning: None,
            emva1288: None,
            mode: SensorMode::Physical,
            device_seed: 1,
        }
    }
}

/// A sensor or exposure parameter that can't be used.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("sensor {field}: {message}")]
pub struct SensorProblem {
    /// The field.
    pub field: String,
    /// What is wrong and how to fix it.
    pub message: String,
}

impl SensorProblem {
    pub(super) fn new(field: impl Into<String>, message: impl Into<String>) -> Self {
        Self { field: field.into(), message: message.into() }
    }

    /// Refuses a number outside a range, ends included, and NaN.
    pub(super) fn unless_within(field: &str, value: f64, range: [f64; 2], hint: &str) -> Result<(), Self> {
        check_range(value, range, hint).map_err(|message| Self::new(field, message))
    }
}

impl SensorModel {
    /// Voltage per electron, V/e-.
    pub fn conversion_gain_v_per_e(&self) -> f64 {
        self.conversion_gain_mv_per_e.map_or(self.voltage_swing_v / self.well_capacity_e, |mv| mv * 1e-3)
    }

    /// Voltage of one digital number, V: the swing over 2^bits.
    pub fn volts_per_dn(&self) -> f64 {
        self.voltage_swing_v / 2f64.powi(i32::from(self.bit_depth))
    }

    /// System gain K at gain 1, DN/e-.
    pub fn base_dn_per_electron(&self) -> f64 {
        self.conversion_gain_v_per_e() / self.volts_per_dn()
    }

    /// Largest code of the converter, `2^bits - 1`.
    pub fn max_code(&self) -> u16 {
        ((1u32 << self.bit_depth) - 1) as u16
    }

    /// Area of a pixel that collects light, m².
    pub fn collecting_area_m2(&self) -> f64 {
        (self.pixel_size_um * 1e-6).powi(2) * self.fill_factor
    }

    /// Width of all columns, mm.
    pub fn width_mm(&self) -> f64 {
        self.columns as f64 * self.pixel_size_um * 1e-3
    }

    /// Height of all rows, mm.
    pub fn height_mm(&self) -> f64 {
        self.rows as f64 * self.pixel_size_um * 1e-3
    }

    /// Electrons behind a voltage before the gain, mV.
    pub fn electrons_of_mv(&self, millivolts: f64) -> f64 {
        millivolts * 1e-3 / self.conversion_gain_v_per_e()
    }

    fn in_electrons(&self, electrons: Option<f64>, millivolts: Option<f64>, default_mv: f64) -> f64 {
        electrons.unwrap_or_else(|| self.electrons_of_mv(millivolts.unwrap_or(default_mv)))
    }

    /// Temporal noise before the gain, e- rms.
    pub fn read_noise_electrons(&self) -> f64 {
        self.in_electrons(self.read_noise_e, self.read_noise_mv, table_1::READ_NOISE_MV)
    }

    /// Temporal dark noise of one pixel at an exposure's gain, e- rms: noise before and after the gain, of rows and of
    /// columns. Shot noise of the dark current and quantization excluded.
    pub fn dark_noise_electrons(&self, gain: f64) -> f64 {
        let after_gain_dn = self.post_gain_noise_mv * 1e-3 / self.volts_per_dn();
        self.read_noise_electrons()
            .hypot(after_gain_dn / (self.base_dn_per_electron() * self.analog_gain * gain))
            .hypot(self.electrons_of_mv(self.row_noise_mv).hypot(self.electrons_of_mv(self.column_noise_mv)))
    }

    /// Saturation capacity of EMVA 1288 at an exposure's gain, e-: the mean signal of the largest temporal variance, where a well that fills
    /// or the last code of the converter ends it, whichever comes first. It lies below both, as pixels fill one after the other.
    #[must_use]
    pub fn saturation_capacity_e(&self, gain: f64) -> f64 {
        let prnu = self.prnu_percent.hypot(self.column_gain_percent) * 1e-2;
        let dn_per_electron = self.base_dn_per_electron() * self.analog_gain * gain;
        let converter = Limit {
            electrons: (f64::from(self.max_code()) - self.black_level_dn) / dn_per_electron,
            noise_e: self.dark_noise_electrons(gain),
        };
        let well = saturation_capacity_e(Limit::well(self.well_capacity_e), prnu);
        well.min(saturation_capacity_e(converter, prnu))
    }

    /// Standard deviation of the pixels' offsets, e-.
    pub fn dsnu_electrons(&self) -> f64 {
        self.in_electrons(self.dsnu_e, self.dsnu_mv, table_1::DSNU_MV)
    }

    /// Dark current at the sensor's temperature, e-/s.
    pub fn dark_electrons_per_s(&self) -> f64 {
        let reference = self.in_electrons(
            self.dark_current_e_per_s,
            self.dark_voltage_mv_per_s,
            table_1::DARK_VOLTAGE_MV_PER_S,
        );
        reference * self.dark_temperature_factor()
    }

    /// Dark current at the sensor's temperature over that at the reference temperature:
    /// `2^((T - T_ref) / doubling temperature)`.
    pub fn dark_temperature_factor(&self) -> f64 {
        let warmer = self.temperature_c - self.dark_reference_temperature_c;
        2f64.powf(warmer / self.dark_doubling_temperature_k)
    }

    /// Columns and rows of the raw images: those of the region that is read, joined pixels counting once.
    ///
    /// # Errors
    /// A region or a binning that does not fit.
    pub fn image_size(&self) -> Result<[usize; 2], SensorProblem> {
        Readout::of(self).map(|readout| [readout.columns, readout.rows])
    }

    /// Photo response non-uniformity of the raw image, percent: joined pixels average it.
    pub fn image_prnu_percent(&self) -> f64 {
        self.prnu_percent / self.binning.map_or(1.0, |binning| binning.pixels() as f64).sqrt()
    }

    /// Standard deviation of the offsets of the raw image, in electrons of its pixels: each read has an offset.
    pub fn image_dsnu_electrons(&self) -> f64 {
        self.dsnu_electrons() * self.image_reads().sqrt()
    }

    /// Reads of each pixel of the raw image.
    pub(crate) fn image_reads(&self) -> f64 {
        match &self.binning {
            Some(binning) if binning.kind != BinningKind::Charge => binning.pixels() as f64,
            _ => 1.0,
        }
    }

    /// Variance of a pixel of the raw image by what a row and a column share, over that of one read: joined digital numbers hold several
    /// reads of a line.
    pub fn image_line_factors(&self) -> [f64; 2] {
        match &self.binning {
            Some(binning) if binning.kind != BinningKind::Charge => {
                [binning.columns, binning.rows].map(|side| (side * binning.pixels()) as f64)
            }
            _ => [1.0; 2],
        }
    }

    /// Standard deviation of the gain of a column of the raw image: joined charge is read by one column, joined digital numbers by each of
    /// theirs.
    pub fn image_column_gain(&self) -> f64 {
        let reads = match &self.binning {
            Some(binning) if binning.kind != BinningKind::Charge => binning.columns as f64,
            _ => 1.0,
        };
        self.column_gain_percent / 100.0 / reads.sqrt()
    }

    /// The model with its data sheet, if it has one, written into its own fields.
    ///
    /// # Errors
    /// A sheet that contradicts itself or the model.
    pub fn with_data_sheet(&self) -> Result<Self, SensorProblem> {
        match &self.emva1288 {
            Some(sheet) => sheet.applied_to(self),
            None => Ok(self.clone()),
        }
    }

    /// The same model with every default and every conversion between units written out, in millivolts.
    #[must_use]
    pub fn resolved(&self) -> Self {
        let millivolts = |electrons: f64| electrons * self.conversion_gain_v_per_e() * 1e3;
        let reference = Self { temperature_c: self.dark_reference_temperature_c, ..self.clone() };
        Self {
            conversion_gain_mv_per_e: Some(millivolts(1.0)),
            read_noise_mv: Some(millivolts(self.read_noise_electrons())),
            read_noise_e: None,
            dsnu_mv: Some(millivolts(self.dsnu_electrons())),
            dsnu_e: None,
            dark_voltage_mv_per_s: Some(millivolts(reference.dark_electrons_per_s())),
            dark_current_e_per_s: None,
            ..self.clone()
        }
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that can't be used, with the way to fix it.
    pub fn validate(&self) -> Result<(), SensorProblem> {
        self.validate_geometry()?;
        if self.emva1288.is_some() {
            return self.with_data_sheet()?.validate();
        }
        for (field, value, range, hint) in [
            ("well_capacity_e", self.well_capacity_e, [1.0, 1e9], "give electrons"),
            ("voltage_swing_v", self.voltage_swing_v, [1e-9, 1e6], "give volts"),
            (
                "conversion_gain_mv_per_e",
                self.conversion_gain_v_per_e() * 1e3,
                [1e-6, 1e6],
                "give mV per electron",
            ),
            ("analog_gain", self.analog_gain, [1e-3, 1e6], "give 1 for the base gain"),
            ("dark_doubling_temperature_k", self.dark_doubling_temperature_k, DOUBLING_K, "give kelvin"),
        ] {
            SensorProblem::unless_within(field, value, range, hint)?;
        }
        for (mv_field, e_field, mv, e) in [
            ("read_noise_mv", "read_noise_e", self.read_noise_mv, self.read_noise_e),
            ("dsnu_mv", "dsnu_e", self.dsnu_mv, self.dsnu_e),
            (
                "dark_voltage_mv_per_s",
                "dark_current_e_per_s",
                self.dark_voltage_mv_per_s,
                self.dark_current_e_per_s,
            ),
        ] {
            if mv.is_some() && e.is_some() {
                let message = format!("given together with {mv_field}; keep one of the two");
                return Err(SensorProblem::new(e_field, message));
            }
            noise_or_current(mv_field, mv.unwrap_or(0.0))?;
            noise_or_current(e_field, e.unwrap_or(0.0))?;
        }
        for (field, value) in [
            ("post_gain_noise_mv", self.post_gain_noise_mv),
            ("column_offset_mv", self.column_offset_mv),
            ("row_offset_mv", self.row_offset_mv),
            ("column_noise_mv", self.column_noise_mv),
            ("row_noise_mv", self.row_noise_mv),
            ("hot_pixel_dark_current_e_per_s", self.hot_pixel_dark_current_e_per_s),
        ] {
            noise_or_current(field, value)?;
        }
        for (field, value, most, hint) in [
            ("prnu_percent", self.prnu_percent, 100.0, "give percent"),
            ("column_gain_percent", self.column_gain_percent, 100.0, "give percent"),
            ("dark_current_log_spread", self.dark_current_log_spread, 10.0, "give a natural logarithm"),
            ("hot_pixels_per_million", self.hot_pixels_per_million, 1e6, "give pixels in a million"),
            ("dead_pixels_per_million", self.dead_pixels_per_million, 1e6, "give pixels in a million"),
        ] {
            SensorProblem::unless_within(field, value, [0.0, most], hint)?;
        }
        let hint = "give a share of the well, 1 for a hard limit";
        SensorProblem::unless_within("well_knee", self.well_knee, [1e-6, 1.0], hint)?;
        if let Some(crosstalk) = &self.crosstalk {
            crosstalk.validate()?;
        }
        self.shutter.validate()?;
        if let Some(strobe) = &self.strobe {
            strobe.validate()?;
        }
        RelativeIllumination::validate(self)?;
        self.validate_isetcam()?;
        for (field, value, range, hint) in [
            ("analog_offset_mv", self.analog_offset_mv, [-1e6, 1e6], "give millivolts"),
            ("temperature_c", self.temperature_c, TEMPERATURE_C, "give degrees Celsius"),
            (
                "dark_reference_temperature_c",
                self.dark_reference_temperature_c,
                TEMPERATURE_C,
                "give degrees Celsius",
            ),
        ] {
            SensorProblem::unless_within(field, value, range, hint)?;
        }
        self.validate_converter()
    }

    fn validate_geometry(&self) -> Result<(), SensorProblem> {
        for (field, value) in [("columns", self.columns), ("rows", self.rows)] {
            if !(1..=65_536).contains(&value) {
                let message = format!("{value} is outside 1 to 65536; give the number of pixels");
                return Err(SensorProblem::new(field, message));
            }
        }
        SensorProblem::unless_within(
            "pixel_size_um",
            self.pixel_size_um,
            [0.1, 1e3],
            "give the pitch in µm",
        )?;
        SensorProblem::unless_within(
            "fill_factor",
            self.fill_factor,
            [1e-6, 1.0],
            "give a fraction, not percent",
        )?;
        if let Some(aperture) = self.aperture_um.filter(|a| !(1e-3..=self.pixel_size_um).contains(a)) {
            let message = format!(
                "{} is outside 0.001 to the pixel size, {} µm; give the side of the square that collects light",
                number_text(aperture),
                self.pixel_size_um
            );
            return Err(SensorProblem::new("aperture_um", message));
        }
        let cell_columns = self.mosaic.first().map_or(0, Vec::len);
        if cell_columns == 0 || self.mosaic.iter().any(|row| row.len() != cell_columns) {
            let message = "the rows of the cell must have one length, at least 1; for instance \
                           [[\"G\", \"R\"], [\"B\", \"G\"]], or [[\"mono\"]] for a sensor without color";
            return Err(SensorProblem::new("mosaic", message));
        }
        if self.mosaic.len() > self.rows || cell_columns > self.columns {
            let message = format!(
                "the cell of {} by {cell_columns} does not fit into {} by {} pixels; add pixels",
                self.mosaic.len(),
                self.rows,
                self.columns
            );
            return Err(SensorProblem::new("mosaic", message));
        }
        Ok(())
    }

    /// ISETCam has no equations for these: a field that would have no effect is refused.
    fn validate_isetcam(&self) -> Result<(), SensorProblem> {
        if !matches!(self.mode, SensorMode::Isetcam { .. }) {
            return Ok(());
        }
        let unknown = [
            ("crosstalk", self.crosstalk.is_some()),
            ("shutter", !self.shutter.is_default()),
            ("strobe", self.strobe.is_some()),
            ("binning", self.binning.is_some()),
            ("relative_illumination", !self.relative_illumination.is_empty()),
            ("aperture_um", self.aperture_um.is_some()),
            ("well_knee", self.well_knee != 1.0),
            ("column_noise_mv", self.column_noise_mv != 0.0),
            ("row_noise_mv", self.row_noise_mv != 0.0),
            ("hot_pixels_per_million", self.hot_pixels_per_million != 0.0),
            ("dead_pixels_per_million", self.dead_pixels_per_million != 0.0),
        ];
        match unknown.iter().find(|(_, given)| *given) {
            Some((field, _)) => {
                let message = "is not modeled in mode \"isetcam\"; remove it or use mode \"physical\"";
                Err(SensorProblem::new(*field, message))
            }
            None => Ok(()),
        }
    }

    fn validate_converter(&self) -> Result<(), SensorProblem> {
        // ISETCam's converter has one code more than its bits can count.
        let most_bits = if matches!(self.mode, SensorMode::Isetcam { .. }) { 15 } else { 16 };
        if !(1..=most_bits).contains(&self.bit_depth) {
            let message = format!("{} is outside 1 to {most_bits}; raw images have 16 bits", self.bit_depth);
            return Err(SensorProblem::new("bit_depth", message));
        }
        if let SensorMode::Isetcam { noise_flag } = self.mode
            && !(-2..=2).contains(&noise_flag)
        {
            let message = format!("{noise_flag} is not a noise flag of ISETCam; give -2, -1, 0, 1 or 2");
            return Err(SensorProblem::new("mode.noise_flag", message));
        }
        if !(0.0..f64::from(self.max_code())).contains(&self.black_level_dn) {
            let message = format!(
                "{} is outside the {} codes of {} bits; give the digital number of a covered pixel",
                number_text(self.black_level_dn),
                u32::from(self.max_code()) + 1,
                self.bit_depth
            );
            return Err(SensorProblem::new("black_level_dn", message));
        }
        if self.mode == SensorMode::Physical {
            let offset_dn = self.analog_offset_mv * 1e-3 / self.volts_per_dn();
            let highest = f64::from(self.max_code().saturating_sub(2));
            let black_dn = self.black_level_dn + offset_dn;
            if black_dn > highest {
                let field = if self.black_level_dn > highest { "black_level_dn" } else { "analog_offset_mv" };
                let message = format!(
                    "black lies at {black_dn:.1} DN ({} from black_level_dn, {offset_dn:.1} from analog_offset_mv); the \
                     converter ends at {}, so give at most {highest} together to leave room for light",
                    self.black_level_dn,
                    self.max_code()
                );
                return Err(SensorProblem::new(field, message));
            }
        }
        Readout::of(self).map(|_| ())
    }
}

/// Temperatures of sensors, degrees Celsius, from absolute zero up.
pub(super) const TEMPERATURE_C: [f64; 2] = [-273.15, 1e3];

/// Temperatures over which a dark current doubles, K.
pub(super) const DOUBLING_K: [f64; 2] = [0.1, 1e3];

fn noise_or_current(field: &str, value: f64) -> Result<(), SensorProblem> {
    SensorProblem::unless_within(field, value, [0.0, 1e9], "a noise or a current is 0 or more")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_1_in_electrons() {
        let model = SensorModel::default();
        assert!((model.conversion_gain_v_per_e() * 1e3 - 0.101_222).abs() < 1e-6);
        assert!((model.collecting_area_m2() - 6.1875e-12).abs() < 1e-20);
        assert!((model.read_noise_electrons() - 13.732).abs() < 1e-3);
        assert!((model.dsnu_electrons() - 2.505_4).abs() < 1e-3);
        assert!((model.dark_electrons_per_s() - 1.481_9).abs() < 1e-3);
        assert!((model.base_dn_per_electron() - 4096.0 / 9000.0).abs() < 1e-12);
        assert_eq!(model.max_code(), 4095);
        assert!(model.validate().is_ok());
    }

    #[test]
    fn an_empty_file_is_the_default_and_a_resolved_one_says_so_in_full() {
        let model: SensorModel = serde_json::from_str("{}").unwrap();
        assert_eq!(model, SensorModel::default());
        let text = r#"{"mode": {"type": "isetcam", "noise_flag": -1}, "mosaic": [["mono"]]}"#;
        let mono: SensorModel = serde_json::from_str(text).unwrap();
        assert_eq!(mono.mode, SensorMode::Isetcam { noise_flag: -1 });
        let warm = SensorModel { temperature_c: 45.0, read_noise_e: Some(2.0), ..model };
        let text = serde_json::to_string(&warm.resolved()).unwrap();
        let back: SensorModel = serde_json::from_str(&text).unwrap();
        assert!(back.validate().is_ok());
        assert!((back.read_noise_electrons() - 2.0).abs() < 1e-12);
        assert!((back.dark_electrons_per_s() - warm.dark_electrons_per_s()).abs() < 1e-12);
        assert!(text.contains("\"dsnu_mv\":0.2536"), "{text}");
    }

    #[test]
    fn dark_current_doubles_with_temperature() {
        let cool = SensorModel { dark_current_e_per_s: Some(3.0), ..SensorModel::default() };
        let warm = SensorModel { temperature_c: 41.0, ..cool.clone() };
        assert!((warm.dark_electrons_per_s() - 12.0).abs() < 1e-12);
    }

    #[test]
    fn problems_name_the_field_and_the_cure() {
        let field = |model: SensorModel| model.validate().unwrap_err().field;
        let base = SensorModel::default;
        assert_eq!(field(SensorModel { fill_factor: 99.0, ..base() }), "fill_factor");
        assert_eq!(
            field(SensorModel { read_noise_mv: Some(1.0), read_noise_e: Some(2.0), ..base() }),
            "read_noise_e"
        );
        assert_eq!(field(SensorModel { dsnu_e: Some(-1.0), ..base() }), "dsnu_e");
        assert_eq!(field(SensorModel { bit_depth: 20, ..base() }), "bit_depth");
        assert_eq!(field(SensorModel { mosaic: vec![], ..base() }), "mosaic");
        assert_eq!(
            field(SensorModel { mode: SensorMode::Isetcam { noise_flag: 3 }, ..base() }),
            "mode.noise_flag"
        );
        assert_eq!(field(SensorModel { black_level_dn: 5000.0, ..base() }), "black_level_dn");
        assert_eq!(field(SensorModel { prnu_percent: f64::NAN, ..base() }), "prnu_percent");
        assert_eq!(field(SensorModel { analog_offset_mv: 900.0, ..base() }), "analog_offset_mv");
        assert_eq!(field(SensorModel { black_level_dn: 4094.5, ..base() }), "black_level_dn");
        let highest = SensorModel { black_level_dn: 4093.0, ..base() };
        assert!(highest.validate().is_ok());
        assert!(SensorModel { bit_depth: 1, black_level_dn: 0.0, ..base() }.validate().is_ok());
        let unknown = serde_json::from_str::<SensorModel>("{\"read_noise\": 2}").unwrap_err();
        assert!(unknown.to_string().contains("read_noise_mv"), "{unknown}");
    }
}
