//! `fluorspar tissue`: list, show, solve, depth, mc, fit.

mod depth;
mod fit;
mod fit_output;
mod list;
mod mc;
mod mc_output;
mod show;
mod solve;
mod solve_output;
mod source;

use std::process::ExitCode;

use clap::Subcommand;

use crate::commands::table::ListOptions;
use crate::error::CliError;

/// Options of `tissue`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(subcommand)]
    action: Action,
}

#[derive(Clone, Debug, Subcommand)]
enum Action {
    /// List the tissues of the catalogue.
    List(ListOptions),
    /// Show parameters, layers, fluorophores and states of a tissue.
    Show(show::Options),
    /// Compute reflectance and fluorescence of a tissue.
    Solve(solve::Options),
    /// Tell from which depth and layer the fluorescence of each channel comes.
    Depth(depth::Options),
    /// Trace photons through the layers of a tissue by Monte Carlo: reflectance, transmittance, absorption, fluence, fluorescence.
    Mc(mc::Options),
    /// Fit parameters of a tissue to measured reflectance and fluorescence.
    Fit(fit::Options),
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    match &options.action {
        Action::List(options) => list::run(options)?,
        Action::Show(options) => show::run(options)?,
        Action::Solve(options) => solve::run(options)?,
        Action::Depth(options) => depth::run(options)?,
        Action::Mc(options) => return mc::run(options),
        Action::Fit(options) => fit::run(options)?,
    }
    Ok(ExitCode::SUCCESS)
}
