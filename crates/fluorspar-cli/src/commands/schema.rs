//! `fluorspar schema`: the JSON schema of experiment files.

use std::process::ExitCode;

use fluorspar::experiment::{json_schema, sample_json_schema};

use crate::error::CliError;

/// Options of `schema`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// The schema of flat samples, as `predict` takes them, instead.
    #[arg(long)]
    sample: bool,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    super::print_json(&if options.sample { sample_json_schema() } else { json_schema() })?;
    Ok(ExitCode::SUCCESS)
}
