//! Sensors of the catalogue.

use serde::{Deserialize, Serialize};

use super::catalogue::{parse_text, text};
use super::curve_preset::check_name;
use super::kind::{PresetError, PresetKind};

/// A sensor of the catalogue: fields of the `[sensor]` section of an experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorPreset {
    /// Version of the form of its file: 1.
    pub format: u32,
    /// Name by which files refer to it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Description and caveats.
    pub description: String,
    /// Where the numbers come from.
    pub source: String,
    /// Fields that are assumed rather than measured.
    pub assumed: Vec<String>,
    /// The fields.
    pub sensor: toml::Table,
}

/// A sensor.
///
/// # Errors
/// When there is no such sensor.
pub fn sensor(name: &str) -> Result<SensorPreset, PresetError> {
    sensor_of(name, text(PresetKind::Sensor, name)?)
}

/// The sensor that the text of a file describes.
pub(super) fn sensor_of(name: &str, text: &str) -> Result<SensorPreset, PresetError> {
    let preset: SensorPreset = parse_text(PresetKind::Sensor, name, text)?;
    check_name(PresetKind::Sensor, name, &preset.name)?;
    Ok(preset)
}
