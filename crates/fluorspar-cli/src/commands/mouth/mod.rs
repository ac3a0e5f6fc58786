//! `fluorspar mouth`: meshes, views and people.

mod generate;
mod person;
mod sample;
mod view;

use std::process::ExitCode;

use crate::error::CliError;

/// Options of `mouth`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(subcommand)]
    command: Command,
}

#[derive(Clone, Debug, clap::Subcommand)]
enum Command {
    /// Write the meshes of one mouth, and print its measured dimensions next to their sources.
    Generate(generate::Options),
    /// Draw a contact sheet of views and poses.
    View(view::Options),
    /// Draw people from the population: one experiment file for each, and a table.
    Sample(sample::Options),
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    match &options.command {
        Command::Generate(options) => generate::run(options),
        Command::View(options) => view::run(options),
        Command::Sample(options) => sample::run(options),
    }
}
