//! `fluorspar filter`: list, show, plot, leak.

mod leak;

use std::process::ExitCode;

use clap::Subcommand;
use fluorspar_experiment::preset::PresetKind;

use super::spectra;
use crate::error::CliError;

/// Options of `filter`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(subcommand)]
    action: Action,
}

#[derive(Clone, Debug, Subcommand)]
enum Action {
    /// Compare reflected light with fluorescence behind the viewing filters of a flat sample.
    Leak(leak::Options),
    #[command(flatten)]
    Spectra(spectra::Action),
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    match &options.action {
        Action::Leak(options) => leak::run(options)?,
        Action::Spectra(action) => spectra::act(action, PresetKind::Filter)?,
    }
    Ok(ExitCode::SUCCESS)
}
