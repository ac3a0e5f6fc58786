//! Commands within another program, which wants their answers as values.

use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::args::Args;
use crate::error::CliError;
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
) -> Result<CommandAnswer, CliError> {
    let words = std::iter::once(OsString::from("fluorspar")).chain(args);
    let args = match Args::read(words) {
        Ok(args) => args,
        Err(said) if said.use_stderr() => {
            return Err(CliError::Input(said.to_string()));
        }
        // Help and version
        Err(said) => return Ok(CommandAnswer { text: said.to_string(), succeeded: true }),
    };
    if args.threads.is_some() || args.verbose || args.no_cache {
        let message = "--threads, --verbose and --no-cache are options of the program, not of a command within another one";
        return Err(CliError::Input(message.into()));
    }
    be_quiet(args.quiet);
    let run = || crate::run_command(args.command.unwrap_or_default());
    let (ended, text) = stopped_by(stop, || with_answers_kept(run));
    Ok(CommandAnswer { text, succeeded: ended? == ExitCode::SUCCESS })
}
