//! The files that a study was made from.

use std::path::PathBuf;
use std::sync::Arc;

use crate::schema::ExperimentFile;
use fluorspar::warning::Warning;

/// A file that a study was made from.
#[derive(Clone, Debug, PartialEq)]
pub struct FileRecord {
    /// Name for people.
    pub title: String,
    /// Description of the experiment.
    pub description: String,
    /// Folder for the results, if the file names one.
    pub output_folder: Option<PathBuf>,
    /// Warnings.
    pub warnings: Vec<Warning>,
    /// Files that were read, with their digests.
    pub inputs: Vec<InputFile>,
    /// Files of base experiments that were read; they are part of `resolved_toml`.
    pub base_files: Vec<PathBuf>,
    /// The complete experiment as a file: base, overrides and defaults written out, paths absolute. Reading it
    /// gives the same experiment and the same `sha256`.
    pub resolved_toml: String,
    /// The sections of `resolved_toml`; `None` of a design, a flat sample and a scene of pbrt.
    pub experiment: Option<Arc<ExperimentFile>>,
    /// Digest of everything that decides the result: the resolved file without title, description and output, the
    /// contents (not the places) of all files it names, and the entries of the catalogue in use.
    pub sha256: String,
}

/// A file that an experiment reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputFile {
    /// Where it is.
    pub path: PathBuf,
    /// Digest of its content.
    pub sha256: String,
}
