//! The `fluorspar` command.

mod args;
mod commands;
mod error;
mod experiment_source;
mod interrupt;
mod progress;
mod values;

use std::io::ErrorKind;
use std::process::ExitCode;

use clap::Parser;
use fluorspar_accel::{Allocator, return_freed_memory_at_once};

use crate::args::{Args, Command};
use crate::error::CliError;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

fn main() -> ExitCode {
    return_freed_memory_at_once();
    let args = match Args::try_parse() {
        Ok(args) => args,
        // Help and version are not errors; everything else is exit code 2.
        Err(error) => {
            let code = if error.use_stderr() { ExitCode::from(2) } else { ExitCode::SUCCESS };
            return match error.print() {
                Err(error) if error.kind() != ErrorKind::BrokenPipe => ExitCode::from(1),
                _ => code,
            };
        }
    };
    match run(args) {
        Ok(code) => code,
        // The reader has seen enough: `fluorspar presets | head`.
        Err(CliError::Stdout(error)) if error.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            error.exit_code()
        }
    }
}

fn run(args: Args) -> Result<ExitCode, CliError> {
    if let Some(threads) = args.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
        pool.map_err(|error| CliError::Failed(format!("can't start {threads} threads: {error}")))?;
    }
    interrupt::catch_interrupts();
    match args.command.unwrap_or_default() {
        Command::Run(options) => commands::run::run(&options),
        Command::Render(options) => commands::render::run(&options),
        Command::Merge(options) => commands::merge::run(&options),
        Command::Denoise(options) => commands::denoise::run(&options),
        Command::Capture(options) => commands::capture::run(&options),
        Command::Analyze(options) => commands::analyze::run(&options),
        Command::Fluorophore(options) => commands::fluorophore::run(&options),
        Command::Sensor(options) => commands::sensor::run(&options),
        Command::Lens(options) => commands::lens::run(&options),
        Command::Filter(options) => commands::filter::run(&options),
        Command::Mouth(options) => commands::mouth::run(&options),
        Command::Predict(options) => commands::predict::run(&options),
        Command::Safety(options) => commands::safety::run(&options),
        Command::Spectroradiometer(options) => commands::spectroradiometer::run(&options),
        Command::Presets(options) => commands::presets::run(&options),
        Command::Check(options) => commands::check::run(&options),
        Command::Schema(options) => commands::schema::run(&options),
        Command::Completions { shell } => commands::completions::run(shell),
    }
}
