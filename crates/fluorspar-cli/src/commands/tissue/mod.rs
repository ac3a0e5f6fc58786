//! `fluorspar tissue`: mc.

mod mc;
mod mc_output;
mod source;

use std::process::ExitCode;

use clap::Subcommand;

use crate::error::CliError;

/// Options of `tissue`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(subcommand)]
    action: Action,
}

#[derive(Clone, Debug, Subcommand)]
enum Action {
    /// Trace photons through the layers of a tissue by Monte Carlo: reflectance, transmittance, absorption, fluence, fluorescence.
    Mc(mc::Options),
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    match &options.action {
        Action::Mc(options) => mc::run(options),
    }
}
