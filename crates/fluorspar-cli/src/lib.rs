//! The `fluorspar` command as a library: [`main`] is the program, [`answer_of`] a command within another program.

mod args;
mod commands;
mod embedded;
mod error;
mod interrupt;
mod message;
mod progress;
#[cfg(test)]
mod reference_tests;

use std::ffi::OsString;
use std::io::ErrorKind;
use std::num::NonZeroUsize;
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use fluorspar_accel::claim_exit_message;
use fluorspar_session::{cite, compare, predict, use_surroundings};
pub(crate) use fluorspar_session::{named_spectra, values};

use crate::args::{Args, Command};
use crate::commands::subcommands::Ended;
use crate::error::{CliError, FAILED, WRONG_INPUT, as_typed, code_of};
use crate::values::MOST_THREADS;

pub use embedded::{CommandAnswer, answer_of};

/// Runs the command that a command line names, whose first word is the name of the program. What it says goes to standard error,
/// what it answers to standard output. `before_render` is called before commands that render. Call it once in a process: it starts the
/// threads of all work and listens to signals.
pub fn main(command_line: impl IntoIterator<Item = OsString>, before_render: impl FnOnce()) -> ExitCode {
    let args = match Args::read(command_line) {
        Ok(args) => args,
        Err(answer) => return print_answer(&answer),
    };
    if args.command.as_ref().is_none_or(Command::renders) {
        before_render();
    }
    say_panics_in_a_line();
    end_of(|| run(args))
}

/// The exit code of some work, once its error has been said.
fn end_of(work: impl FnOnce() -> Result<ExitCode, CliError>) -> ExitCode {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(code)) => code,
        Ok(Err(error)) => {
            claim_exit_message();
            message::error(as_typed(&error.to_string()));
            ExitCode::from(code_of(&error))
        }
        // The panic has been said. What was unfinished went with the stack.
        Err(_) => ExitCode::from(FAILED),
    }
}

/// From here on a panic is one line, as every error; with RUST_BACKTRACE the usual lines come before it.
fn say_panics_in_a_line() {
    let usual = panic::take_hook();
    panic::set_hook(Box::new(move |info| {
        if std::env::var_os("RUST_BACKTRACE").is_some_and(|value| value != "0") {
            usual(info);
        }
        let place = info.location().map_or_else(String::new, |place| format!(" ({place})"));
        let payload = info.payload();
        let text = payload.downcast_ref::<&str>().copied();
        let text = text.or_else(|| payload.downcast_ref::<String>().map(String::as_str));
        let what = text.unwrap_or("a panic").replace('\n', "; ");
        message::error(format!(
            "this is a defect of Fluorspar: {what}{place}. Please report this line, the command and its input"
        ));
    }));
}

/// Prints what the reading of the command line ended with: help and version are answers, everything else is wrong input.
fn print_answer(answer: &clap::Error) -> ExitCode {
    let printed = answer.print();
    if answer.use_stderr() {
        return ExitCode::from(WRONG_INPUT);
    }
    match printed {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            message::error(format!("can't write to standard output: {error}"));
            ExitCode::from(FAILED)
        }
        _ => ExitCode::SUCCESS,
    }
}

/// Threads without `--threads`: those of the environment variable RAYON_NUM_THREADS, those that Slurm allots to a task, or one
/// for each core.
fn default_threads() -> usize {
    let number = |name| std::env::var(name).ok().and_then(|text| text.trim().parse::<usize>().ok());
    let wanted = number("RAYON_NUM_THREADS").or_else(|| number("SLURM_CPUS_PER_TASK"));
    let cores = || std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    wanted.filter(|&threads| threads > 0).unwrap_or_else(cores).min(MOST_THREADS as usize)
}

fn run(args: Args) -> Result<ExitCode, CliError> {
    start_threads(args.threads.unwrap_or_else(default_threads))?;
    if args.verbose {
        message::be_verbose();
    }
    message::be_quiet(args.quiet);
    interrupt::catch_interrupts();
    use_surroundings(!args.no_cache)?;
    run_command(args.command.unwrap_or_default())
}

fn run_command(command: Command) -> Result<ExitCode, CliError> {
    let Ended(code) = match command {
        Command::Run(options) => Ended::of(commands::run::run, &options),
        Command::Render(options) => Ended::of(commands::render::run, &options),
        Command::Merge(options) => Ended::of(commands::merge::run, &options),
        Command::Denoise(options) => Ended::of(commands::denoise::run, &options),
        Command::Capture(options) => Ended::of(commands::capture::run, &options),
        Command::Cube(options) => Ended::of(commands::cube::run, &options),
        Command::Sheet(options) => Ended::of(commands::sheet::run, &options),
        Command::Analyze(options) => Ended::of(commands::analyze::run, &options),
        Command::Cohort(options) => Ended::of(commands::cohort::run, &options),
        Command::Dataset(options) => Ended::of(commands::dataset::run, &options),
        Command::Compare(options) => options.answer(compare, commands::compare::describe).map(Into::into),
        Command::Cite(options) => options.answer(cite, commands::cite::describe).map(Into::into),
        Command::Describe(options) => Ended::of(commands::describe::run, &options),
        Command::Calibrate(options) => Ended::of(commands::calibrate::run, &options),
        Command::Study(options) => Ended::of(commands::study::run, &options),
        Command::Catalog(options) => Ended::of(commands::catalog::run, &options),
        Command::Fluorophore(options) => Ended::of(commands::fluorophore::run, &options),
        Command::Sensor(options) => Ended::of(commands::sensor::run, &options),
        Command::Lens(options) => Ended::of(commands::lens::run, &options),
        Command::Filter(options) => Ended::of(commands::filter::run, &options),
        Command::Plot(options) => Ended::of(commands::plot::run, &options),
        Command::Mouth(options) => Ended::of(commands::mouth::run, &options),
        Command::Tissue(options) => Ended::of(commands::tissue::run, &options),
        Command::Predict(options) => options.answer(predict, commands::predict::describe).map(Into::into),
        Command::Design(options) => Ended::of(commands::design::run, &options),
        Command::Safety(options) => Ended::of(commands::safety::run, &options),
        Command::Spectroradiometer(options) => Ended::of(commands::spectroradiometer::run, &options),
        Command::Validate(options) => Ended::of(commands::validate::run, &options),
        Command::Check(options) => Ended::of(commands::check::run, &options),
        Command::Workbench(options) => Ended::of(commands::workbench::run, &options),
        Command::New(options) => Ended::of(commands::new::run, &options),
        Command::Scene(options) => Ended::of(commands::scene::run, &options),
        Command::Schema(options) => Ended::of(commands::schema::run, &options),
        Command::Completions { shell } => commands::completions::run(shell).map(Into::into),
    }?;
    Ok(code)
}

/// Starts the threads of all commands here, where a refusal of the system can be explained.
fn start_threads(threads: usize) -> Result<(), CliError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    pool.map_err(|error| {
        CliError::Failed(format!("can't start {threads} threads: {error}. Ask for fewer with --threads"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test starts itself, since a panic hook is that of a whole process.
    #[test]
    fn a_panic_is_one_line_and_exit_code_1() {
        const WITHIN: &str = "FLUORSPAR_TEST_PANIC";
        if std::env::var_os(WITHIN).is_some() {
            say_panics_in_a_line();
            let code = end_of(|| {
                rayon::join(|| (), || panic!("two\nlines"));
                Ok(ExitCode::SUCCESS)
            });
            assert_eq!(code, ExitCode::from(FAILED));
            return;
        }
        let said = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "tests::a_panic_is_one_line_and_exit_code_1", "--nocapture"])
            .env(WITHIN, "1")
            .env_remove("RUST_BACKTRACE")
            .output()
            .unwrap();
        let told = String::from_utf8(said.stderr).unwrap();
        assert!(said.status.success(), "{told}");
        assert!(told.starts_with("error: this is a defect of Fluorspar: two; lines (crates/"), "{told}");
        assert_eq!(told.lines().count(), 1, "{told}");
    }
}
