//! Errors as they are typed, and their exit codes.

use fluorspar_session::{ErrorKind, worded};

/// Why a command did not succeed.
pub(crate) use fluorspar_session::Error as CliError;

/// Exit code of wrong input: something that the user gave must be fixed.
pub(crate) const WRONG_INPUT: u8 = 2;
/// Exit code where the machine failed, or a case of `validate`.
pub(crate) const FAILED: u8 = 1;
/// Exit code of work that a signal stopped, EX_TEMPFAIL of sysexits.h: the same command later can go on with it or do it anew.
/// Schedulers repeat jobs that end so.
pub(crate) const STOPPED: u8 = 75;

/// A message with its options as they are typed.
pub(crate) fn as_typed(message: &str) -> String {
    worded(message, |name, value| {
        let name = name.replace('_', "-");
        value.map_or_else(|| format!("--{name}"), |value| format!("--{name} {value}"))
    })
}

/// The exit code of the program.
pub(crate) fn code_of(error: &CliError) -> u8 {
    match error.kind() {
        ErrorKind::Input => WRONG_INPUT,
        ErrorKind::Failed => FAILED,
        ErrorKind::Stopped => STOPPED,
    }
}
