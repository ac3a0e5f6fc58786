//! Commands within another program, which wants their answers as values.

use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use fluorspar_experiment::ExperimentError;
use thiserror::Error;

use crate::args::Args;
use crate::error::{CliError, WRONG_INPUT, as_typed, code_of};
use crate::interrupt::stopped_by;
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
/// would have printed on standard output. Messages go to standard error, as those of the program. `stop` ends it, and no other.
///
/// # Errors
/// Those of the command, with its exit code; `--threads`, `--verbose` and `--no-cache`, which are settings of a whole process.
///
/// ```
/// # use std::sync::Arc;
/// let answer = fluorspar_cli::answer_of(["predict", "--json"].map(Into::into), Arc::default()).unwrap();
/// assert!(answer.succeeded && answer.text.starts_with('{'));
/// ```
pub fn answer_of(
    args: impl IntoIterator<Item = OsString>,
    stop: Arc<AtomicBool>,
) -> Result<CommandAnswer, CommandFailure> {
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
    let run = || crate::run_command(args.command.unwrap_or_default());
    let (ended, text) = stopped_by(stop, || with_answers_kept(run));
    match ended {
        Ok(code) => Ok(CommandAnswer { text, succeeded: code == ExitCode::SUCCESS }),
        Err(error) => Err(failure(error)),
    }
}

fn failure(error: CliError) -> CommandFailure {
    let (code, message) = (code_of(&error), as_typed(&error.to_string()));
    let experiment = match error {
        CliError::Experiment(error) => Some(error),
        _ => None,
    };
    CommandFailure { code, message, experiment }
}

/// A command line that is none.
fn refused(message: String) -> CommandFailure {
    CommandFailure { code: WRONG_INPUT, message, experiment: None }
}
