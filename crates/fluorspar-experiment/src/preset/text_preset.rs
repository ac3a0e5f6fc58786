//! Entries of the catalogue that are sections of an experiment file, or whole ones.

use fluorspar_format::read_toml;
use serde::{Deserialize, Serialize};

use super::catalogue::{damaged, parse, text};
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

/// An experiment, a flat sample or a design problem of the catalogue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExperimentPreset {
    /// Name by which files refer to it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Description and caveats.
    pub description: String,
    /// The file, comments included.
    pub text: &'static str,
}

/// A sensor.
///
/// # Errors
/// When there is no such sensor.
pub fn sensor(name: &str) -> Result<SensorPreset, PresetError> {
    let preset: SensorPreset = parse(PresetKind::Sensor, name)?;
    check_name(PresetKind::Sensor, name, &preset.name)?;
    Ok(preset)
}

/// Text of the file of a sensor.
pub(crate) fn sensor_text(name: &str) -> Result<&'static str, PresetError> {
    text(PresetKind::Sensor, name)
}

/// An experiment.
///
/// # Errors
/// When there is no such experiment.
pub fn experiment(name: &str) -> Result<ExperimentPreset, PresetError> {
    whole_file(PresetKind::Experiment, name)
}

/// A flat sample.
///
/// # Errors
/// When there is no such sample.
pub fn sample(name: &str) -> Result<ExperimentPreset, PresetError> {
    whole_file(PresetKind::Sample, name)
}

/// A design problem.
///
/// # Errors
/// When there is no such problem.
pub fn design(name: &str) -> Result<ExperimentPreset, PresetError> {
    whole_file(PresetKind::Design, name)
}

fn whole_file(kind: PresetKind, name: &str) -> Result<ExperimentPreset, PresetError> {
    let text = text(kind, name)?;
    let table: toml::Table = read_toml(text).map_err(|error| damaged(kind, name, error.to_string()))?;
    let field = |key: &str| table.get(key).and_then(toml::Value::as_str).unwrap_or_default().to_string();
    Ok(ExperimentPreset { name: name.into(), title: field("title"), description: field("description"), text })
}
