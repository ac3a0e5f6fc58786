//! `fluorspar schema`: the JSON schema of experiment files.

use std::process::ExitCode;

use fluorspar_experiment::{
    design_json_schema, json_schema, layers_json_schema, sample_json_schema, sensor_json_schema,
};

use crate::error::CliError;

/// Options of `schema`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// The schema of flat samples, as `predict` takes them, instead.
    #[arg(long)]
    sample: bool,
    /// The schema of sensor files, as `sensor` takes them, instead.
    #[arg(long, conflicts_with = "sample")]
    sensor: bool,
    /// The schema of files of plane layers, as `tissue mc` takes them, instead.
    #[arg(long, conflicts_with_all = ["sample", "sensor"])]
    layers: bool,
    /// The schema of design problems, as `design` takes them, instead.
    #[arg(long, conflicts_with_all = ["sample", "sensor", "layers"])]
    design: bool,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    super::print_json(&match (options.sample, options.sensor, options.layers, options.design) {
        (true, ..) => sample_json_schema(),
        (_, true, ..) => sensor_json_schema(),
        (_, _, true, _) => layers_json_schema(),
        (.., true) => design_json_schema(),
        _ => json_schema(),
    })?;
    Ok(ExitCode::SUCCESS)
}
