//! Several frames of one scene under different lights.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::exposure::{EXPOSURE_MS, GAIN};
use super::{AutoExposure, ElectronRate, Exposure, Sensor, SensorProblem};

/// One frame of a capture sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaptureFrame {
    /// Name of the frame, unique in its sequence, for instance "blue".
    pub label: String,
    /// Light groups that are on, with their drive relative to the power in the scene. Others are off.
    #[serde(default)]
    pub lights: BTreeMap<String, f64>,
    /// Exposure time, ms; or give `auto_exposure`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
    /// Rule that finds the exposure time; or give `exposure_ms`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub auto_exposure: Option<AutoExposure>,
    /// Gain on top of the sensor's analog gain.
    #[serde(default = "unit_gain")]
    pub gain: f64,
}

fn unit_gain() -> f64 {
    1.0
}

impl CaptureFrame {
    /// A frame of fixed exposure at gain 1.
    pub fn fixed<N: Into<String>>(
        label: &str,
        lights: impl IntoIterator<Item = (N, f64)>,
        exposure_ms: f64,
    ) -> Self {
        Self {
            label: label.into(),
            lights: lights.into_iter().map(|(name, drive)| (name.into(), drive)).collect(),
            exposure_ms: Some(exposure_ms),
            auto_exposure: None,
            gain: 1.0,
        }
    }

    /// Drive of a light group in this frame; 0 where it is off.
    pub fn drive(&self, light_group: &str) -> f64 {
        self.lights.get(light_group).copied().unwrap_or(0.0)
    }
}

/// Frames that are taken one after the other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaptureSequence {
    /// The frames, in order.
    pub frames: Vec<CaptureFrame>,
}

impl CaptureSequence {
    /// The frame of a label.
    pub fn find(&self, label: &str) -> Option<&CaptureFrame> {
        self.frames.iter().find(|frame| frame.label == label)
    }

    /// Checks every frame.
    ///
    /// # Errors
    /// The first parameter that can't be used, with the way to fix it.
    pub fn validate(&self) -> Result<(), SensorProblem> {
        for (index, frame) in self.frames.iter().enumerate() {
            let field = |name: &str| format!("frames[{index}].{name}");
            if self.frames[..index].iter().any(|other| other.label == frame.label) {
                let message = format!("\"{}\" is the label of an earlier frame; choose another", frame.label);
                return Err(SensorProblem::new(field("label"), message));
            }
            for (name, drive) in &frame.lights {
                let field = field(&format!("lights.{name}"));
                SensorProblem::unless_within(
                    &field,
                    *drive,
                    [0.0, 1e6],
                    "give 1 for the power in the scene",
                )?;
            }
            match (frame.exposure_ms, &frame.auto_exposure) {
                (Some(0.0), None) => {}
                (Some(ms), None) => {
                    let hint = "give milliseconds, or 0 for the offset alone";
                    SensorProblem::unless_within(&field("exposure_ms"), ms, EXPOSURE_MS, hint)?;
                }
                (None, Some(rule)) => rule
                    .validate()
                    .map_err(|problem| SensorProblem { field: field(&problem.field), ..problem })?,
                (None, None) => {
                    let message = "no exposure; give exposure_ms, or auto_exposure = {} for a rule";
                    return Err(SensorProblem::new(field("exposure_ms"), message));
                }
                (Some(_), Some(_)) => {
                    let message = "given together with exposure_ms; keep one of the two";
                    return Err(SensorProblem::new(field("auto_exposure"), message));
                }
            }
            SensorProblem::unless_within(&field("gain"), frame.gain, GAIN, "give 1 for the base gain")?;
        }
        Ok(())
    }
}

impl Sensor {
    /// Time and gain of a frame, the time found by its rule if it has one.
    ///
    /// # Errors
    /// Parameters that can't be used.
    pub fn frame_exposure(
        &self,
        frame: &CaptureFrame,
        rate: &ElectronRate,
        seed: u64,
    ) -> Result<Exposure, SensorProblem> {
        let rule = frame.auto_exposure.unwrap_or_default();
        let time_s = match frame.exposure_ms {
            Some(ms) => ms * 1e-3,
            None => self.auto_exposure_s(rate, frame.gain, &rule)?,
        };
        Ok(Exposure { time_s, gain: frame.gain, seed, frame: 0, label: frame.label.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_checked() {
        let text = r#"{"frames": [{"label": "blue", "lights": {"blue": 0.5}, "exposure_ms": 30}]}"#;
        let sequence: CaptureSequence = serde_json::from_str(text).unwrap();
        assert!(sequence.validate().is_ok());
        let frame = sequence.find("blue").unwrap().clone();
        assert_eq!((frame.drive("blue"), frame.drive("white"), frame.gain), (0.5, 0.0, 1.0));
        let field = |frames: Vec<CaptureFrame>| CaptureSequence { frames }.validate().unwrap_err().field;
        assert_eq!(field(vec![frame.clone(), frame.clone()]), "frames[1].label");
        assert_eq!(field(vec![CaptureFrame { exposure_ms: None, ..frame.clone() }]), "frames[0].exposure_ms");
        let both = CaptureFrame { auto_exposure: Some(AutoExposure::default()), ..frame.clone() };
        assert_eq!(field(vec![both]), "frames[0].auto_exposure");
        let rule = AutoExposure { percentile: -1.0, ..AutoExposure::default() };
        let auto = CaptureFrame { exposure_ms: None, auto_exposure: Some(rule), ..frame };
        assert_eq!(field(vec![auto]), "frames[0].auto_exposure.percentile");
        let negative = CaptureFrame::fixed("a", [("blue", -1.0)], 1.0);
        assert_eq!(field(vec![negative]), "frames[0].lights.blue");
    }
}
