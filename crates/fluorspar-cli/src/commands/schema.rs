//! `fluorspar schema`: the JSON schemas of files.

use clap::ValueEnum;
use fluorspar_experiment::{
    CohortFile, LayersFile, SampleFile, SensorFile, design_json_schema, json_schema, json_schema_of,
};
use fluorspar_session::CalibrationText;

use crate::error::CliError;

/// Options of `schema`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// The kind of file.
    #[arg(value_enum, default_value_t = FileKind::Experiment)]
    kind: FileKind,
}

/// Files that have a schema.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum FileKind {
    /// Experiments, as `run` takes them.
    Experiment,
    /// Flat samples, as `predict` takes them.
    Sample,
    /// Sensors, as `sensor` takes them.
    Sensor,
    /// Plane layers, as `tissue mc` takes them.
    Layers,
    /// Design problems, as `design` takes them.
    Design,
    /// Cohorts, as `cohort` takes them.
    Cohort,
    /// Which frames of a camera are what, as `calibrate` takes them.
    Calibration,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    super::print_json(&match options.kind {
        FileKind::Experiment => json_schema(),
        FileKind::Sample => json_schema_of::<SampleFile>(),
        FileKind::Sensor => json_schema_of::<SensorFile>(),
        FileKind::Layers => json_schema_of::<LayersFile>(),
        FileKind::Design => design_json_schema(),
        FileKind::Cohort => json_schema_of::<CohortFile>(),
        FileKind::Calibration => json_schema_of::<CalibrationText>(),
    })?;
    Ok(())
}
