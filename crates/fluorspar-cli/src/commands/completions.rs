//! `fluorspar completions`: for bash, zsh, fish, PowerShell and Elvish.

use clap::CommandFactory;
use clap_complete::Shell;

use crate::args::Args;
use crate::error::CliError;

pub(crate) fn run(shell: Shell) -> Result<(), CliError> {
    // Not straight to standard output: the generator panics where that is closed early.
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Args::command(), "fluorspar", &mut text);
    super::print_text(&String::from_utf8_lossy(&text))
}
