//! `fluorspar schema`: the JSON schema of experiment files.

use std::process::ExitCode;

use fluorspar::experiment::json_schema;

use crate::error::CliError;

pub(crate) fn run() -> Result<ExitCode, CliError> {
    super::print_json(&json_schema())?;
    Ok(ExitCode::SUCCESS)
}
