//! Why a finished render can't be used.

use fluorspar::pipeline::PipelineError;
use fluorspar_experiment::ExperimentError;
use fluorspar_format::FormatError;
use thiserror::Error;

/// Why a finished render can't be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SessionError {
    /// A defect of an experiment.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The render does not show what captures want to see.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// A file can't be read.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// An experiment is wanted of an image that carries none.
    #[error("{image}: this image carries no experiment")]
    NoExperiment {
        /// The image.
        image: String,
    },
}
