//! Data sheets in the terms of EMVA 1288, checked for contradictions and turned into a sensor model.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::adc::QUANTIZATION_NOISE_DN;
use super::model::{DOUBLING_K, TEMPERATURE_C};
use super::photon_transfer::{Limit, saturation_capacity_e, sensitivity_threshold_e, well_for_saturation_e};
use super::{SensorModel, SensorProblem, SpectralQe};
use crate::units::{check_range, number_text};

/// A data sheet in the terms of EMVA 1288 (release 4), at gain 1. It takes the place of the fields of the model that
/// say the same; geometry, mosaic and everything else stay.
///
/// Values that follow from others (the reciprocal gain, noise in both units, dynamic range, signal-to-noise ratio,
/// threshold) may be given for a check: a sheet that contradicts itself is refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Emva1288 {
    /// Inverse system gain 1/K, e-/DN.
    pub gain_e_per_dn: Option<f64>,
    /// System gain K, DN/e-; instead of `gain_e_per_dn`.
    pub gain_dn_per_e: Option<f64>,
    /// Temporal dark noise, e- rms, quantization excluded.
    pub dark_noise_e: Option<f64>,
    /// Temporal dark noise as measured, DN rms, quantization included; instead of `dark_noise_e`.
    pub dark_noise_dn: Option<f64>,
    /// Saturation capacity, e-: the mean signal at which the temporal variance is largest. The well that gives it is
    /// a little larger and is found by calculation.
    pub saturation_capacity_e: f64,
    /// Bits of the converter, 1 to 16.
    pub bit_depth: u8,
    /// Digital number of no light. Default 64.
    pub black_level_dn: Option<f64>,
    /// Dark current, e-/s. Default 0.
    #[serde(default)]
    pub dark_current_e_per_s: f64,
    /// Temperature of the dark current, degrees Celsius. Default 25.
    #[serde(default = "room_temperature")]
    pub dark_current_temperature_c: f64,
    /// Temperature step that doubles the dark current, K. Default 8.
    #[serde(default = "doubling_temperature")]
    pub doubling_temperature_k: f64,
    /// Dark signal non-uniformity DSNU1288, e-.
    pub dsnu_e: Option<f64>,
    /// Dark signal non-uniformity, DN; instead of `dsnu_e`.
    pub dsnu_dn: Option<f64>,
    /// Photo response non-uniformity PRNU1288, percent.
    pub prnu_percent: f64,
    /// Quantum efficiency of the best channel at `quantum_efficiency_nm`, percent; checked against the curves.
    pub quantum_efficiency_percent: Option<f64>,
    /// Wavelength of `quantum_efficiency_percent`, nm.
    pub quantum_efficiency_nm: Option<f64>,
    /// Dynamic range, dB; checked to 1 dB.
    pub dynamic_range_db: Option<f64>,
    /// Largest temporal signal-to-noise ratio, dB; checked to 0.5 dB.
    pub snr_max_db: Option<f64>,
    /// Absolute sensitivity threshold, e-; checked to 10 %.
    pub sensitivity_threshold_e: Option<f64>,
}

impl Default for Emva1288 {
    /// An ideal sensor without a gain: 12 bits, and what else a sheet may leave out.
    fn default() -> Self {
        Self {
            gain_e_per_dn: None,
            gain_dn_per_e: None,
            dark_noise_e: None,
            dark_noise_dn: None,
            saturation_capacity_e: 1e4,
            bit_depth: 12,
            black_level_dn: None,
            dark_current_e_per_s: 0.0,
            dark_current_temperature_c: room_temperature(),
            doubling_temperature_k: doubling_temperature(),
            dsnu_e: None,
            dsnu_dn: None,
            prnu_percent: 0.0,
            quantum_efficiency_percent: None,
            quantum_efficiency_nm: None,
            dynamic_range_db: None,
            snr_max_db: None,
            sensitivity_threshold_e: None,
        }
    }
}

fn room_temperature() -> f64 {
    25.0
}

fn doubling_temperature() -> f64 {
    8.0
}

/// Voltage per electron of a model made from a sheet, V. Only K can be seen from outside, so the scale is free.
const VOLTS_PER_E: f64 = 1e-4;
/// Relative difference of two values of one quantity that rounding in print explains.
const PRINTED: f64 = 0.02;

fn problem(field: &str, message: String) -> SensorProblem {
    SensorProblem::new(format!("emva1288.{field}"), message)
}

/// The value of a quantity that may be given in two fields. Both are allowed when they agree.
fn one_of(
    [a_name, b_name]: [&str; 2],
    [a, b]: [Option<f64>; 2],
    b_as_a: impl Fn(f64) -> f64,
) -> Result<f64, SensorProblem> {
    match (a, b) {
        (Some(a), None) => Ok(a),
        (None, Some(b)) => Ok(b_as_a(b)),
        (Some(a), Some(b)) => {
            let other = b_as_a(b);
            if (a - other).abs() <= PRINTED * a.abs().max(other.abs()) {
                return Ok(a);
            }
            let message = format!(
                "{} means {a_name} = {other:.4}, but {a_name} = {} is given too; remove the wrong one",
                number_text(b),
                number_text(a)
            );
            Err(problem(b_name, message))
        }
        (None, None) => Err(problem(a_name, format!("is missing; give it, or {b_name}"))),
    }
}

impl Emva1288 {
    /// System gain K, DN/e-.
    ///
    /// # Errors
    /// No gain, or two that are not each other's reciprocal.
    pub fn dn_per_electron(&self) -> Result<f64, SensorProblem> {
        for (field, value) in [("gain_e_per_dn", self.gain_e_per_dn), ("gain_dn_per_e", self.gain_dn_per_e)] {
            let hint = "give the system gain or its reciprocal";
            check_range(value.unwrap_or(1.0), [1e-8, 1e8], hint)
                .map_err(|message| problem(field, message))?;
        }
        one_of(["gain_dn_per_e", "gain_e_per_dn"], [self.gain_dn_per_e, self.gain_e_per_dn], |inverse| {
            1.0 / inverse
        })
    }

    /// Temporal dark noise without quantization, e- rms.
    ///
    /// # Errors
    /// No noise, two that disagree, or one that is smaller than quantization alone.
    pub fn dark_noise_electrons(&self) -> Result<f64, SensorProblem> {
        let gain = self.dn_per_electron()?;
        if let Some(dn) = self.dark_noise_dn.filter(|dn| *dn < QUANTIZATION_NOISE_DN) {
            let message = format!(
                "{dn} DN are less than the {QUANTIZATION_NOISE_DN:.4} DN of quantization, which it includes; give \
                 dark_noise_e if quantization was taken off"
            );
            return Err(problem("dark_noise_dn", message));
        }
        let electrons = |dn: f64| (dn * dn - QUANTIZATION_NOISE_DN.powi(2)).max(0.0).sqrt() / gain;
        one_of(["dark_noise_e", "dark_noise_dn"], [self.dark_noise_e, self.dark_noise_dn], electrons)
    }

    /// Fields of a [`SensorModel`] that a data sheet takes the place of.
    pub fn replaced_fields() -> impl Iterator<Item = &'static str> {
        fields_given(&SensorModel::default()).into_iter().map(|(field, _)| field)
    }

    /// Dark signal non-uniformity, e-.
    ///
    /// # Errors
    /// None given, or two that disagree.
    pub fn dsnu_electrons(&self) -> Result<f64, SensorProblem> {
        let gain = self.dn_per_electron()?;
        one_of(["dsnu_e", "dsnu_dn"], [self.dsnu_e, self.dsnu_dn], |dn| dn / gain)
    }

    /// The model with the fields of this sheet in place of its own.
    ///
    /// # Errors
    /// A value that can't be, values that contradict each other, or a field of the model that contradicts them.
    pub fn applied_to(&self, model: &SensorModel) -> Result<SensorModel, SensorProblem> {
        let black = self.black_level_dn.unwrap_or(SensorModel::default().black_level_dn);
        self.check_numbers(black)?;
        // Check the numbers against each other and against the model
        let (gain, dark_noise, dsnu) =
            (self.dn_per_electron()?, self.dark_noise_electrons()?, self.dsnu_electrons()?);
        let codes = 2f64.powi(i32::from(self.bit_depth));
        self.check_saturation(black, gain, dark_noise, codes)?;
        self.check_derived(gain, dark_noise)?;
        self.check_model(model)?;
        // Replace the equivalent fields of the model
        Ok(SensorModel {
            fill_factor: 1.0,
            conversion_gain_mv_per_e: Some(VOLTS_PER_E * 1e3),
            voltage_swing_v: VOLTS_PER_E * codes / gain,
            well_capacity_e: well_for_saturation_e(self.saturation_capacity_e, self.prnu_percent * 1e-2),
            read_noise_mv: None,
            read_noise_e: Some(dark_noise),
            post_gain_noise_mv: 0.0,
            dsnu_mv: None,
            dsnu_e: Some(dsnu),
            prnu_percent: self.prnu_percent,
            dark_voltage_mv_per_s: None,
            dark_current_e_per_s: Some(self.dark_current_e_per_s),
            dark_reference_temperature_c: self.dark_current_temperature_c,
            dark_doubling_temperature_k: self.doubling_temperature_k,
            bit_depth: self.bit_depth,
            black_level_dn: black,
            emva1288: None,
            ..model.clone()
        })
    }

    /// Checks every number on its own.
    fn check_numbers(&self, black: f64) -> Result<(), SensorProblem> {
        for (field, value) in [
            ("dark_noise_e", self.dark_noise_e),
            ("dark_noise_dn", self.dark_noise_dn),
            ("black_level_dn", Some(black)),
            ("dark_current_e_per_s", Some(self.dark_current_e_per_s)),
            ("dsnu_e", self.dsnu_e),
            ("dsnu_dn", self.dsnu_dn),
            ("prnu_percent", Some(self.prnu_percent)),
        ] {
            check_range(value.unwrap_or(0.0), [0.0, 1e9], "give 0 or more")
                .map_err(|message| problem(field, message))?;
        }
        if self.prnu_percent > 30.0 {
            let message = format!(
                "{} is not a data sheet's value; give percent, 0 to 30",
                number_text(self.prnu_percent)
            );
            return Err(problem("prnu_percent", message));
        }
        for (field, value, range, hint) in [
            ("saturation_capacity_e", self.saturation_capacity_e, [10.0, 1e8], "give electrons"),
            (
                "dark_current_temperature_c",
                self.dark_current_temperature_c,
                TEMPERATURE_C,
                "give degrees Celsius",
            ),
            ("doubling_temperature_k", self.doubling_temperature_k, DOUBLING_K, "give kelvin"),
        ] {
            check_range(value, range, hint).map_err(|message| problem(field, message))?;
        }
        if !(1..=16).contains(&self.bit_depth) {
            return Err(problem("bit_depth", format!("{} is outside 1 to 16", self.bit_depth)));
        }
        Ok(())
    }

    /// Checks that the converter and the pixels reach the stated saturation.
    fn check_saturation(
        &self,
        black: f64,
        gain: f64,
        dark_noise: f64,
        codes: f64,
    ) -> Result<(), SensorProblem> {
        let saturation = self.saturation_capacity_e;
        if black + gain * saturation > codes - 0.5 {
            let message = format!(
                "{saturation} e- at {gain:.4} DN/e- above a black level of {black} DN need {:.0} DN levels, but {} \
                 bits have {codes}; correct the gain, the saturation capacity, the black level or the bit depth",
                (black + gain * saturation).ceil(),
                self.bit_depth
            );
            return Err(problem("saturation_capacity_e", message));
        }
        let prnu = self.prnu_percent * 1e-2;
        let converter = Limit { electrons: (codes - 1.0 - black) / gain, noise_e: dark_noise };
        let largest = saturation_capacity_e(converter, prnu);
        if saturation > 1.01 * largest {
            let message = format!(
                "{saturation} e- can't be the signal of the largest variance: the converter ends at {:.0} e-, so the \
                 variance falls from {largest:.0} e- on; give {largest:.0} if the sheet means the end of the converter",
                converter.electrons
            );
            return Err(problem("saturation_capacity_e", message));
        }
        Ok(())
    }

    fn check_derived(&self, gain: f64, dark_noise: f64) -> Result<(), SensorProblem> {
        let saturation = self.saturation_capacity_e;
        let threshold = sensitivity_threshold_e(dark_noise, gain);
        let checks = [
            ("sensitivity_threshold_e", self.sensitivity_threshold_e, threshold, 0.1 * threshold, "e-"),
            ("dynamic_range_db", self.dynamic_range_db, 20.0 * (saturation / threshold).log10(), 1.0, "dB"),
            ("snr_max_db", self.snr_max_db, 10.0 * saturation.log10(), 0.5, "dB"),
        ];
        for (field, given, follows, tolerance, unit) in checks {
            if let Some(given) = given.filter(|given| {
                let agrees = (given - follows).abs() <= tolerance;
                !agrees
            }) {
                let message = format!(
                    "{} {unit} contradicts the sheet: its saturation capacity, dark noise and gain give \
                     {follows:.1} {unit}",
                    number_text(given)
                );
                return Err(problem(field, message));
            }
        }
        Ok(())
    }

    /// Refuses fields of the model that say something else than this sheet.
    fn check_model(&self, model: &SensorModel) -> Result<(), SensorProblem> {
        match fields_given(model).iter().find(|(_, is_given)| *is_given) {
            Some((field, _)) => {
                let message = "is also given by emva1288; remove one of the two";
                Err(SensorProblem::new(*field, message))
            }
            None => Ok(()),
        }
    }

    /// Compares the stated quantum efficiency with the curves.
    pub(super) fn check_efficiency(&self, qe: &SpectralQe) -> Result<(), SensorProblem> {
        let (percent, nm) = match (self.quantum_efficiency_percent, self.quantum_efficiency_nm) {
            (None, None) => return Ok(()),
            (Some(percent), Some(nm)) => (percent, nm),
            (Some(_), None) => {
                let message = "a quantum efficiency needs a wavelength; give quantum_efficiency_nm".into();
                return Err(problem("quantum_efficiency_percent", message));
            }
            (None, Some(_)) => {
                let message =
                    "a wavelength needs a quantum efficiency; give quantum_efficiency_percent".into();
                return Err(problem("quantum_efficiency_nm", message));
            }
        };
        let best = 100.0 * qe.channels().iter().map(|channel| channel.curve.at(nm)).fold(0.0, f64::max);
        if (percent - best).abs() <= 0.1 * percent.max(best) {
            return Ok(());
        }
        let message = format!(
            "{percent} % at {nm} nm contradicts the curves of quantum_efficiency, whose best channel has {best:.1} % \
             there; use the curves of this sensor"
        );
        Err(problem("quantum_efficiency_percent", message))
    }
}

/// Fields of a model that a data sheet replaces, and whether each says something.
fn fields_given(model: &SensorModel) -> [(&'static str, bool); 17] {
    let default = SensorModel::default();
    [
        ("read_noise_mv", model.read_noise_mv.is_some()),
        ("read_noise_e", model.read_noise_e.is_some()),
        ("post_gain_noise_mv", model.post_gain_noise_mv != default.post_gain_noise_mv),
        ("dsnu_mv", model.dsnu_mv.is_some()),
        ("dsnu_e", model.dsnu_e.is_some()),
        ("dark_voltage_mv_per_s", model.dark_voltage_mv_per_s.is_some()),
        ("dark_current_e_per_s", model.dark_current_e_per_s.is_some()),
        ("conversion_gain_mv_per_e", model.conversion_gain_mv_per_e.is_some()),
        ("voltage_swing_v", model.voltage_swing_v != default.voltage_swing_v),
        ("well_capacity_e", model.well_capacity_e != default.well_capacity_e),
        ("prnu_percent", model.prnu_percent != default.prnu_percent),
        ("bit_depth", model.bit_depth != default.bit_depth),
        ("black_level_dn", model.black_level_dn != default.black_level_dn),
        ("fill_factor", model.fill_factor != default.fill_factor && model.fill_factor != 1.0),
        ("well_knee", model.well_knee != default.well_knee),
        (
            "dark_reference_temperature_c",
            model.dark_reference_temperature_c != default.dark_reference_temperature_c,
        ),
        (
            "dark_doubling_temperature_k",
            model.dark_doubling_temperature_k != default.dark_doubling_temperature_k,
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectral::Curve;

    fn sheet() -> Emva1288 {
        serde_json::from_str(
            r#"{"gain_e_per_dn": 2.7027, "dark_noise_e": 2.2, "saturation_capacity_e": 10300, "bit_depth": 12,
                "dark_current_e_per_s": 0.4, "dsnu_e": 0.9, "prnu_percent": 0.6}"#,
        )
        .unwrap()
    }

    #[test]
    fn a_sheet_becomes_a_model_with_its_gain() {
        let model = sheet().applied_to(&SensorModel::default()).unwrap();
        assert!(model.validate().is_ok());
        assert!((model.base_dn_per_electron() * 2.7027 - 1.0).abs() < 1e-12);
        assert!((model.read_noise_electrons() - 2.2).abs() < 1e-12);
        assert!((model.dsnu_electrons() - 0.9).abs() < 1e-12);
        // The well is above the saturation capacity, by a few standard deviations of 101 e-.
        assert!(
            model.well_capacity_e > 10_300.0 + 101.0 && model.well_capacity_e < 10_300.0 + 505.0,
            "{model:?}"
        );
        let noisy = Emva1288 { dark_noise_e: None, dark_noise_dn: Some(0.8637), ..sheet() };
        let from_dn = noisy.applied_to(&SensorModel::default()).unwrap();
        // sqrt(0.8637² - 1/12) * 2.7027
        assert!((from_dn.read_noise_electrons() - 2.2).abs() < 1e-3, "{}", from_dn.read_noise_electrons());
    }

    #[test]
    fn values_that_follow_from_others_are_accepted() {
        let derived = Emva1288 {
            gain_dn_per_e: Some(0.37),
            dark_noise_dn: Some(0.864),
            dsnu_dn: Some(0.333),
            // sqrt(2.2² + 2.7027² / 12 + 1/4) + 1/2 = 2.887
            sensitivity_threshold_e: Some(2.89),
            dynamic_range_db: Some(71.0),
            snr_max_db: Some(40.1),
            ..sheet()
        };
        derived.applied_to(&SensorModel::default()).unwrap();
    }

    #[test]
    fn contradictions_are_refused_and_named() {
        let field = |sheet: Emva1288| sheet.applied_to(&SensorModel::default()).unwrap_err().field;
        let base = sheet;
        assert_eq!(field(Emva1288 { gain_dn_per_e: Some(2.7), ..base() }), "emva1288.gain_e_per_dn");
        assert_eq!(field(Emva1288 { gain_e_per_dn: None, ..base() }), "emva1288.gain_dn_per_e");
        assert_eq!(field(Emva1288 { dark_noise_dn: Some(2.2), ..base() }), "emva1288.dark_noise_dn");
        assert_eq!(field(Emva1288 { dark_noise_dn: Some(0.1), ..base() }), "emva1288.dark_noise_dn");
        assert_eq!(field(Emva1288 { dsnu_dn: Some(0.9), ..base() }), "emva1288.dsnu_dn");
        assert_eq!(
            field(Emva1288 { saturation_capacity_e: 12_000.0, ..base() }),
            "emva1288.saturation_capacity_e"
        );
        // Below the last code, but above where the converter cuts the variance.
        assert_eq!(
            field(Emva1288 { saturation_capacity_e: 10_880.0, ..base() }),
            "emva1288.saturation_capacity_e"
        );
        assert_eq!(field(Emva1288 { dynamic_range_db: Some(60.0), ..base() }), "emva1288.dynamic_range_db");
        assert_eq!(field(Emva1288 { snr_max_db: Some(f64::NAN), ..base() }), "emva1288.snr_max_db");
        assert_eq!(field(Emva1288 { prnu_percent: -0.1, ..base() }), "emva1288.prnu_percent");
        assert_eq!(
            field(Emva1288 { sensitivity_threshold_e: Some(8.0), ..base() }),
            "emva1288.sensitivity_threshold_e"
        );
        let both = SensorModel { read_noise_e: Some(2.2), ..SensorModel::default() };
        assert_eq!(sheet().applied_to(&both).unwrap_err().field, "read_noise_e");
        let both = SensorModel { well_capacity_e: 10_500.0, ..SensorModel::default() };
        assert_eq!(sheet().applied_to(&both).unwrap_err().field, "well_capacity_e");
    }

    #[test]
    fn the_stated_efficiency_is_that_of_the_curves() {
        let qe =
            SpectralQe::from_curves([("a", Curve::constant(0.3)), ("b", Curve::constant(0.65))]).unwrap();
        let stated = |percent, nm| Emva1288 {
            quantum_efficiency_percent: percent,
            quantum_efficiency_nm: nm,
            ..sheet()
        };
        assert!(stated(Some(66.0), Some(525.0)).check_efficiency(&qe).is_ok());
        assert!(stated(None, None).check_efficiency(&qe).is_ok());
        let error = stated(Some(90.0), Some(525.0)).check_efficiency(&qe).unwrap_err();
        assert!(error.to_string().contains("best channel has 65.0 %"), "{error}");
        assert!(stated(Some(66.0), None).check_efficiency(&qe).is_err());
        assert!(stated(None, Some(525.0)).check_efficiency(&qe).is_err());
    }
}
