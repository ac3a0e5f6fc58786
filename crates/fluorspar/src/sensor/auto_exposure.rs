//! Exposure time from the noise-free image.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::exposure::{Chain, EXPOSURE_MS};
use super::{ElectronRate, Exposure, Sensor, SensorProblem};

/// Chooses the exposure that puts a percentile of the pixels at a fraction of full scale.
///
/// It looks at the mean image, dark signal included, never at a noisy one: the same scene gives the same time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AutoExposure {
    /// Percentile of the pixels that is put at the target; 100 is the brightest pixel.
    pub percentile: f64,
    /// Target as a fraction of the electrons between black and saturation.
    pub target_fraction: f64,
    /// Shortest exposure, ms.
    pub min_exposure_ms: f64,
    /// Longest exposure, ms.
    pub max_exposure_ms: f64,
}

impl Default for AutoExposure {
    fn default() -> Self {
        Self { percentile: 99.0, target_fraction: 0.8, min_exposure_ms: 0.01, max_exposure_ms: 1000.0 }
    }
}

impl AutoExposure {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that can't be used, with the way to fix it.
    pub fn validate(&self) -> Result<(), SensorProblem> {
        for (field, value, range, hint) in [
            ("auto_exposure.percentile", self.percentile, [0.0, 100.0], "give percent of the pixels"),
            (
                "auto_exposure.target_fraction",
                self.target_fraction,
                [1e-6, 1.0],
                "give a share of full scale",
            ),
            ("auto_exposure.min_exposure_ms", self.min_exposure_ms, EXPOSURE_MS, "give milliseconds"),
            ("auto_exposure.max_exposure_ms", self.max_exposure_ms, EXPOSURE_MS, "give milliseconds"),
        ] {
            SensorProblem::unless_within(field, value, range, hint)?;
        }
        if self.max_exposure_ms < self.min_exposure_ms {
            let message = format!(
                "{} is below min_exposure_ms, {}; swap them or raise it",
                self.max_exposure_ms, self.min_exposure_ms
            );
            return Err(SensorProblem::new("auto_exposure.max_exposure_ms", message));
        }
        Ok(())
    }
}

impl Sensor {
    /// Exposure time, s, for a frame at a gain. The longest exposure where there is no light.
    ///
    /// # Errors
    /// Parameters that can't be used.
    pub fn auto_exposure_s(
        &self,
        rate: &ElectronRate,
        gain: f64,
        rule: &AutoExposure,
    ) -> Result<f64, SensorProblem> {
        rule.validate()?;
        let exposure = Exposure { gain, ..Exposure::default() };
        exposure.validate()?;
        if self.model().strobe.is_some() {
            let message = "cannot meter pulsed light; give the exposure, or remove the strobe";
            return Err(SensorProblem::new("auto_exposure", message));
        }
        let full_e = Chain::new(self, &exposure).full_scale_e();
        let mut rates = self.rates_that_are_read(rate);
        let photo_rate = if rates.is_empty() {
            0.0
        } else {
            let rank = (rule.percentile / 100.0 * (rates.len() - 1) as f64).round() as usize;
            f64::from(*rates.select_nth_unstable_by(rank, f32::total_cmp).1)
        };
        let total_rate = photo_rate + self.model().dark_electrons_per_s();
        let (shortest_s, longest_s) = (rule.min_exposure_ms * 1e-3, rule.max_exposure_ms * 1e-3);
        if total_rate > 0.0 {
            Ok((rule.target_fraction * full_e / total_rate).clamp(shortest_s, longest_s))
        } else {
            Ok(longest_s)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{SensorMode, SensorModel, SpectralQe};
    use crate::spectral::Curve;

    #[test]
    fn the_percentile_lands_on_the_target() {
        let qe = SpectralQe::from_curves([("mono", Curve::constant(0.6))]).unwrap();
        let data: Vec<f32> = (0..=1000).map(|i| 100.0 * i as f32).collect();
        let rate = ElectronRate { columns: 1001, rows: 1, data };
        for (mode, full_e) in [
            (SensorMode::Physical, (4095.0 - 64.0) / (4096.0 / 9000.0)),
            (SensorMode::Isetcam { noise_flag: 2 }, 9000.0),
        ] {
            let model = SensorModel {
                columns: 1001,
                rows: 1,
                mosaic: vec![vec!["mono".into()]],
                dark_current_e_per_s: Some(50.0),
                mode,
                ..SensorModel::default()
            };
            let sensor = Sensor::new(model, qe.clone()).unwrap();
            let rule = AutoExposure { percentile: 90.0, target_fraction: 0.5, ..AutoExposure::default() };
            let time_s = sensor.auto_exposure_s(&rate, 1.0, &rule).unwrap();
            assert!((time_s - 0.5 * full_e / 90_050.0).abs() < 1e-9 * time_s, "{mode:?}: {time_s} s");
            assert_eq!(time_s, sensor.auto_exposure_s(&rate, 1.0, &rule).unwrap());
            let short = AutoExposure { max_exposure_ms: 5.0, ..rule };
            assert_eq!(sensor.auto_exposure_s(&rate, 1.0, &short).unwrap(), 5e-3);
        }
    }

    #[test]
    fn problems_name_the_field() {
        let rule = AutoExposure::default();
        assert!(rule.validate().is_ok());
        let field = |rule: AutoExposure| rule.validate().unwrap_err().field;
        assert_eq!(field(AutoExposure { percentile: 101.0, ..rule }), "auto_exposure.percentile");
        assert_eq!(field(AutoExposure { target_fraction: 80.0, ..rule }), "auto_exposure.target_fraction");
        assert_eq!(field(AutoExposure { max_exposure_ms: 0.001, ..rule }), "auto_exposure.max_exposure_ms");
    }
}
