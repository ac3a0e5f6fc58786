//! Errors and their exit codes.

use std::io;
use std::process::ExitCode;

use fluorspar::pipeline::{PipelineError, PredictError};
use fluorspar::render::RenderError;
use fluorspar::tissue::TissueError;
use fluorspar_experiment::ExperimentError;
use fluorspar_experiment::preset::{LensError, PresetError};
use fluorspar_format::{FormatError, OutputFolder, PbrtError};
use fluorspar_report::{FigureError, RunFolderError};
use fluorspar_session::{ErrorKind, SessionError, worded};
use thiserror::Error;

/// Exit code of wrong input: something that the user gave must be fixed.
pub(crate) const WRONG_INPUT: u8 = 2;
/// Exit code where the machine failed, or a case of `validate`.
pub(crate) const FAILED: u8 = 1;
/// Exit code of work that a signal stopped, EX_TEMPFAIL of sysexits.h: the same command later can go on with it or do it anew.
/// Schedulers repeat jobs that end so.
pub(crate) const STOPPED: u8 = 75;

/// Why a command did not succeed.
#[derive(Debug, Error)]
pub(crate) enum CliError {
    /// Something that the user gave must be fixed.
    #[error("{0}")]
    Input(String),
    /// The machine could not do it.
    #[error("{0}")]
    Failed(String),
    /// A signal stopped the work before there was something to save.
    #[error("{0}")]
    Stopped(String),
    #[error("{}", worded(&.0.to_string(), option))]
    Session(SessionError),
    #[error(transparent)]
    Pbrt(#[from] PbrtError),
    #[error("can't write to standard output: {0}")]
    Stdout(#[from] io::Error),
}

/// An option as it is typed.
pub(crate) fn option(name: &str, value: Option<&str>) -> String {
    let name = name.replace('_', "-");
    value.map_or_else(|| format!("--{name}"), |value| format!("--{name} {value}"))
}

impl<E: IntoSessionError> From<E> for CliError {
    fn from(error: E) -> Self {
        Self::Session(error.into())
    }
}

/// Errors below a session.
trait IntoSessionError: Into<SessionError> {}

impl IntoSessionError for SessionError {}
impl IntoSessionError for ExperimentError {}
impl IntoSessionError for FormatError {}
impl IntoSessionError for PresetError {}
impl IntoSessionError for LensError {}
impl IntoSessionError for RenderError {}
impl IntoSessionError for PipelineError {}
impl IntoSessionError for PredictError {}
impl IntoSessionError for TissueError {}
impl IntoSessionError for RunFolderError {}
impl IntoSessionError for FigureError {}
impl IntoSessionError for serde_json::Error {}

impl CliError {
    /// The same error about a folder in its place, if it is about one in work.
    pub(crate) fn at_its_place(self, folder: &OutputFolder) -> Self {
        match self {
            Self::Session(error) => Self::Session(error.at_its_place(folder)),
            other => other,
        }
    }

    /// The exit code of the program.
    pub(crate) fn code(&self) -> u8 {
        match self {
            Self::Session(error) => match error.kind() {
                ErrorKind::Input => WRONG_INPUT,
                ErrorKind::Failed => FAILED,
                ErrorKind::Stopped => STOPPED,
            },
            Self::Failed(_) | Self::Stdout(_) => FAILED,
            Self::Stopped(_) => STOPPED,
            Self::Input(_) | Self::Pbrt(_) => WRONG_INPUT,
        }
    }

    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(self.code())
    }
}
