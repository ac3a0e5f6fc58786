//! Files that describe a sensor and nothing else, in the form of the catalogue's.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sample::SampleFile;
use crate::document::shape::Schema;
use crate::error::ExperimentError;
use crate::read::{read_document, refuse_ignored, schema_of, typed};
use crate::resolve::context::Context;
use crate::resolve::device;
use crate::schema::{ExperimentFile, FormatVersion, SensorSection};
use fluorspar::sensor::Sensor;
use fluorspar::spectral::WavelengthGrid;
use fluorspar::warning::Warning;

/// A sensor file: the `[sensor]` section of an experiment, with a title and sources for people.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorFile {
    /// Version of the form of this file: 1.
    pub format: FormatVersion,
    /// Short name. Default: empty.
    #[serde(default)]
    pub name: String,
    /// Name for people. Default: empty.
    #[serde(default)]
    pub title: String,
    /// Description and caveats. Default: empty.
    #[serde(default)]
    pub description: String,
    /// Where the numbers come from. Default: empty.
    #[serde(default)]
    pub source: String,
    /// Fields that are assumed rather than measured. Default: none.
    #[serde(default)]
    pub assumed: Vec<String>,
    /// The sensor.
    pub sensor: SensorSection,
}

/// A sensor read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedSensor {
    /// Name for people; may be empty.
    pub title: String,
    /// The sensor.
    pub sensor: Sensor,
    /// Warnings.
    pub warnings: Vec<Warning>,
    /// The complete `[sensor]` section as a file.
    pub resolved_toml: String,
    /// Files that it was read from beside the text itself: bases and spectra.
    pub inputs: Vec<PathBuf>,
}

/// Reads the sensor of a sensor file, an experiment or a flat sample. Overrides and paths are as for an experiment;
/// spectra are checked on the default wavelengths.
///
/// # Errors
/// The first defect found.
pub fn parse_sensor(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    overrides: &[String],
) -> Result<ResolvedSensor, ExperimentError> {
    let mut document = read_document(schema_of::<ExperimentFile>(), text, source_name, base_dir, overrides)?;
    if document.root.get("sensor").is_none() {
        return Err(
            document.error(&[], "there is no [sensor] section; add one, if only with preset = \"NAME\"")
        );
    }
    let has = |schema: &Schema, key: &str| {
        schema.table(schema.root()).is_some_and(|table| table.field(None, key).is_some())
    };
    // Of an experiment or a sample only the sensor is read.
    let is_beside = |key: &str| {
        let others = [schema_of::<ExperimentFile>(), schema_of::<SampleFile>()];
        !has(schema_of::<SensorFile>(), key) && others.iter().any(|schema| has(schema, key))
    };
    refuse_ignored(&document, overrides, |key| {
        let message = || format!("`{key}` is no part of a sensor and changes nothing here; change `sensor`");
        is_beside(key).then(message)
    })?;
    document.root.retain(|key| !is_beside(key));
    let file: SensorFile = typed(&mut document, schema_of::<SensorFile>())?;
    let mut context = Context::new(&document);
    let sensor = device::sensor(&mut context, &file.sensor, &WavelengthGrid::default())?;
    let mut complete = file.clone();
    complete.sensor.model = device::filled(&complete.sensor.model);
    let resolved_toml = context.write_out(complete, |_| {})?.0;
    let base_files = document.base_files.iter().cloned();
    let spectra = std::mem::take(&mut context.inputs).into_iter().map(|input| input.path);
    Ok(ResolvedSensor {
        title: file.title,
        sensor,
        warnings: std::mem::take(&mut context.warnings),
        resolved_toml,
        inputs: base_files.chain(spectra).collect(),
    })
}
