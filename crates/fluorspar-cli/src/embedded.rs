//! Commands within another program, which wants their answers as values.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use fluorspar_experiment::ExperimentError;
use thiserror::Error;

use crate::args::Args;
use crate::error::{CliError, FAILED, STOPPED, WRONG_INPUT};
use crate::experiment_source::ExperimentSource;
use crate::interrupt::STOP;
use crate::message::{be_quiet, with_answers_kept};

/// What a command answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandAnswer {
    /// What the command prints on standard output: JSON with `--json`.
    pub text: String,
    /// Whether it ended with exit code 0; `validate` answers also where a case failed.
    pub succeeded: bool,
}

/// Why a command gave no answer.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{message}")]
pub struct CommandFailure {
    /// The exit code that the program would have ended with.
    pub code: u8,
    /// What it would have said.
    pub message: String,
    /// The defect of an experiment, where that is why.
    pub experiment: Option<ExperimentError>,
}

/// Runs the command of a command line without the name of the program, in the rayon pool of the calling thread, and returns what it
/// would have printed on standard output. Messages go to standard error, as those of the program.
///
/// # Errors
/// Those of the command, with its exit code; `--threads`, `--verbose` and `--no-cache`, which are settings of a whole process.
///
/// ```
/// let answer = fluorspar_cli::answer_of(["predict", "--json"].map(Into::into)).unwrap();
/// assert!(answer.succeeded && answer.text.starts_with('{'));
/// ```
pub fn answer_of(args: impl IntoIterator<Item = OsString>) -> Result<CommandAnswer, CommandFailure> {
    let words = std::iter::once(OsString::from("fluorspar")).chain(args);
    let args = match Args::read(words) {
        Ok(args) => args,
        Err(said) if said.use_stderr() => {
            return Err(refused(said.to_string()));
        }
        // Help and version
        Err(said) => return Ok(CommandAnswer { text: said.to_string(), succeeded: true }),
    };
    if args.threads.is_some() || args.verbose || args.no_cache {
        let message = "--threads, --verbose and --no-cache are options of the program, not of a command within another one";
        return Err(refused(message.into()));
    }
    be_quiet(args.quiet);
    // A time limit of an earlier command has stopped that one
    stop(false);
    let (ended, text) = with_answers_kept(|| crate::run_command(args.command.unwrap_or_default()));
    match ended {
        Ok(code) => Ok(CommandAnswer { text, succeeded: code == ExitCode::SUCCESS }),
        Err(error) => Err(failure(error)),
    }
}

/// The text of an experiment, and where it was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundExperiment {
    /// The text, TOML.
    pub text: String,
    /// How messages call it.
    pub name: String,
    /// Folder where its relative paths start.
    pub base_dir: PathBuf,
}

/// Finds an experiment as all commands do: the name of a built-in one, a file, or a report.html that carries it.
///
/// # Errors
/// No such experiment, a file that can't be read or carries none.
pub fn find_experiment(name: &str) -> Result<FoundExperiment, CommandFailure> {
    let ExperimentSource { text, name, base_dir, .. } =
        ExperimentSource::find(Some(name)).map_err(failure)?;
    Ok(FoundExperiment { text, name, base_dir })
}

fn failure(error: CliError) -> CommandFailure {
    let known = [WRONG_INPUT, FAILED].into_iter().find(|code| error.exit_code() == ExitCode::from(*code));
    let message = error.to_string();
    let experiment = match error {
        CliError::Experiment(error) => Some(error),
        _ => None,
    };
    CommandFailure { code: known.unwrap_or(STOPPED), message, experiment }
}

/// A command line that is none.
fn refused(message: String) -> CommandFailure {
    CommandFailure { code: WRONG_INPUT, message, experiment: None }
}

/// Lets all work of this process use the user's cache, and the folder that `FLUORSPAR_CATALOGUE` names beside the catalogue, as the
/// program does.
///
/// # Errors
/// A folder that is none, or holds what is no entry.
pub fn use_surroundings() -> Result<(), CommandFailure> {
    crate::surroundings(true).map_err(failure)
}

/// Asks commands in other threads of this process to stop, or takes the request back.
pub fn stop(is_wanted: bool) {
    STOP.store(is_wanted, Ordering::SeqCst);
}
