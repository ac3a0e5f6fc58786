//! `fluorspar completions`: for bash, zsh, fish, PowerShell and Elvish.

use std::process::ExitCode;

use clap::CommandFactory;
use clap_complete::Shell;

use crate::args::Args;
use crate::error::CliError;

pub(crate) fn run(shell: Shell) -> Result<ExitCode, CliError> {
    clap_complete::generate(shell, &mut Args::command(), "fluorspar", &mut std::io::stdout());
    Ok(ExitCode::SUCCESS)
}
