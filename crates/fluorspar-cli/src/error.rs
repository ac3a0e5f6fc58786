//! Errors and their exit codes.

use std::error::Error as _;
use std::io;
use std::path::PathBuf;
use std::process::ExitCode;

use fluorspar::pipeline::{PipelineError, PredictError};
use fluorspar::render::RenderError;
use fluorspar::tissue::TissueError;
use fluorspar::tissue::fit::TissueFitError;
use fluorspar_experiment::preset::{LensError, PresetError};
use fluorspar_experiment::{DEFAULT_EXPERIMENT, ExperimentError};
use fluorspar_format::{FormatError, OutputFolder, PbrtError};
use fluorspar_report::{FigureError, RunFolderError};
use fluorspar_session::SessionError;
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
    /// A stage after the render failed; what was rendered is kept.
    #[error(
        "{error}\nThe render is kept. Fix the experiment and continue from it: fluorspar capture {} --experiment FILE",
        image.display()
    )]
    AfterRender {
        /// What failed.
        error: Box<CliError>,
        /// The component image.
        image: PathBuf,
    },
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    #[error(transparent)]
    Format(#[from] FormatError),
    #[error(transparent)]
    Pbrt(#[from] PbrtError),
    #[error(transparent)]
    Preset(#[from] PresetError),
    #[error(transparent)]
    Lens(#[from] LensError),
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error("{0}{hint}", hint = section_hint(.0))]
    Pipeline(#[from] PipelineError),
    #[error(transparent)]
    Predict(#[from] PredictError),
    #[error(transparent)]
    Tissue(#[from] TissueError),
    #[error(transparent)]
    Fit(#[from] TissueFitError),
    #[error(transparent)]
    RunFolder(#[from] RunFolderError),
    #[error("figure: {0}")]
    Figure(#[from] FigureError),
    #[error("can't write the answer: {0}")]
    Json(#[from] serde_json::Error),
    #[error("can't write to standard output: {0}")]
    Stdout(#[from] io::Error),
}

impl From<SessionError> for CliError {
    fn from(error: SessionError) -> Self {
        match error {
            SessionError::Experiment(error) => Self::Experiment(error),
            SessionError::Pipeline(error) => Self::Pipeline(error),
            SessionError::Format(error) => Self::Format(error),
            other => Self::Input(format!("{other}; name one with --experiment")),
        }
    }
}

/// What to add to an experiment file that lacks something.
fn section_hint(error: &PipelineError) -> String {
    let section = match error {
        PipelineError::Missing("captures") => "[[capture]]".into(),
        PipelineError::Missing(what) => format!("[{what}]"),
        _ => return String::new(),
    };
    format!("; add a {section} section, or start from `base = \"{DEFAULT_EXPERIMENT}\"`")
}

impl CliError {
    /// Whether a file could not be written for want of room: no other input changes that.
    fn is_for_want_of_room(&self) -> bool {
        use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};

        let mut cause = self.source();
        while let Some(error) = cause {
            if let Some(error) = error.downcast_ref::<io::Error>() {
                return matches!(error.kind(), StorageFull | QuotaExceeded | FileTooLarge);
            }
            cause = error.source();
        }
        false
    }

    /// The same error about a folder in its place, if it is about one in work.
    pub(crate) fn at_its_place(self, folder: &OutputFolder) -> Self {
        match self {
            Self::Format(error) => Self::Format(folder.at_its_place(error)),
            Self::RunFolder(RunFolderError::Format(error)) => Self::Format(folder.at_its_place(error)),
            Self::RunFolder(RunFolderError::Folder { path, source }) => {
                Self::RunFolder(RunFolderError::Folder { path: folder.place_of(&path), source })
            }
            other => other,
        }
    }

    pub(crate) fn exit_code(&self) -> ExitCode {
        match self {
            Self::AfterRender { error, .. } => error.exit_code(),
            Self::Failed(_)
            | Self::Figure(_)
            | Self::Json(_)
            | Self::Stdout(_)
            | Self::Format(FormatError::NoRoom { .. } | FormatError::Failed { .. })
            | Self::Render(RenderError::NoMemory { .. }) => ExitCode::from(FAILED),
            Self::Stopped(_) | Self::Tissue(TissueError::Interrupted) => ExitCode::from(STOPPED),
            _ if self.is_for_want_of_room() => ExitCode::from(FAILED),
            _ => ExitCode::from(WRONG_INPUT),
        }
    }
}
