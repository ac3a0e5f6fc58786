//! `fluorspar lens`: list, report.

mod list;
mod report;

use std::process::ExitCode;

use clap::Subcommand;

use crate::commands::table::ListOptions;
use crate::error::CliError;

/// Options of `lens`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(subcommand)]
    action: Action,
}

#[derive(Clone, Debug, Subcommand)]
enum Action {
    /// List the lenses of the catalogue.
    List(ListOptions),
    /// Trace a lens: focal length, pupils, illumination, distortion, field curvature, spots, MTF, drawings.
    Report(report::Options),
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    match &options.action {
        Action::List(options) => list::run(options)?,
        Action::Report(options) => report::run(options)?,
    }
    Ok(ExitCode::SUCCESS)
}
