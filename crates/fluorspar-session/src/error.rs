//! Why a task gives no answer.

use std::error::Error as _;
use std::io;
use std::path::PathBuf;

use fluorspar::pipeline::{PipelineError, PredictError};
use fluorspar::render::RenderError;
use fluorspar::sensor::DevelopError;
use fluorspar::tissue::TissueError;
use fluorspar::tissue::fit::TissueFitError;
use fluorspar_experiment::preset::{LensError, PresetError};
use fluorspar_experiment::{DEFAULT_EXPERIMENT, ExperimentError};
use fluorspar_format::{Defect, FormatError, OutputFolder, PbrtError};
use fluorspar_report::{FigureError, RunFolderError};

/// Why a task gives no answer. Messages name options as `⟨name⟩` or `⟨name=value⟩`; [`worded`] has them as a front writes them.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Something that was given must be fixed.
    #[error("{0}")]
    Input(String),
    /// The machine could not do it.
    #[error("{0}")]
    Failed(String),
    /// The task was stopped before there was an answer.
    #[error("{0}")]
    Stopped(String),
    /// A defect of an experiment.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// Frames can't be developed, or do not belong together.
    #[error(transparent)]
    Develop(#[from] DevelopError),
    /// A stage after the render can't be done.
    #[error("{0}{hint}", hint = section_hint(.0))]
    Pipeline(#[from] PipelineError),
    /// A file can't be read or written.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A scene of pbrt can't be read.
    #[error(transparent)]
    Pbrt(#[from] PbrtError),
    /// A name that the catalogue does not have.
    #[error(transparent)]
    Preset(#[from] PresetError),
    /// A lens can't be used.
    #[error(transparent)]
    Lens(#[from] LensError),
    /// A scene can't be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A flat sample can't be predicted.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// A tissue can't be solved.
    #[error(transparent)]
    Tissue(#[from] TissueError),
    /// A tissue can't be fitted.
    #[error(transparent)]
    Fit(#[from] TissueFitError),
    /// The folder of a run can't be written.
    #[error(transparent)]
    RunFolder(#[from] RunFolderError),
    /// A figure can't be drawn.
    #[error("figure: {0}")]
    Figure(#[from] FigureError),
    /// An answer has no JSON.
    #[error("can't write the answer: {0}")]
    Json(#[from] serde_json::Error),
    /// A stage after the render failed; what was rendered is kept.
    #[error(
        "{error}\nThe render is kept. Fix the experiment and continue from it: fluorspar capture {} --experiment FILE",
        image.display()
    )]
    AfterRender {
        /// What failed.
        error: Box<Self>,
        /// The component image.
        image: PathBuf,
    },
    /// An experiment is wanted of an image that carries none.
    #[error("{image}: this image carries no experiment; name one with ⟨experiment⟩")]
    NoExperiment {
        /// The image.
        image: String,
    },
}

/// The answer of a task, or why there is none.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What kind of end an error is, which programs tell by their exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// Something that was given must be fixed.
    Input,
    /// The machine failed: no memory, no room on the disk, a defect of the program.
    Failed,
    /// The task was stopped.
    Stopped,
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

impl Error {
    /// What kind of end it is.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::AfterRender { error, .. } => error.kind(),
            Self::Failed(_)
            | Self::Figure(_)
            | Self::Json(_)
            | Self::Render(RenderError::NoMemory { .. }) => ErrorKind::Failed,
            Self::Format(error) if matches!(error.defect(), Defect::NoRoom { .. } | Defect::Failed(_)) => {
                ErrorKind::Failed
            }
            Self::Stopped(_) | Self::Tissue(TissueError::Interrupted) => ErrorKind::Stopped,
            _ if self.is_for_want_of_room() => ErrorKind::Failed,
            _ => ErrorKind::Input,
        }
    }

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
    #[must_use]
    pub fn at_its_place(self, folder: &OutputFolder) -> Self {
        match self {
            Self::Format(error) => Self::Format(folder.at_its_place(error)),
            Self::RunFolder(RunFolderError::Format(error)) => Self::Format(folder.at_its_place(error)),
            Self::RunFolder(RunFolderError::Folder { path, source }) => {
                Self::RunFolder(RunFolderError::Folder { path: folder.place_of(&path), source })
            }
            other => other,
        }
    }
}

/// A message with its options as a front writes them: `option` makes them of a name and, where one is given, a value.
pub fn worded(message: &str, option: impl Fn(&str, Option<&str>) -> String) -> String {
    let mut parts = message.split('⟨');
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        match part.split_once('⟩') {
            None => text += part,
            Some((named, rest)) => {
                let (name, value) = named.split_once('=').map_or((named, None), |(n, v)| (n, Some(v)));
                text += &option(name, value);
                text += rest;
            }
        }
    }
    text
}
