//! Errors of scenes, with their places.

use std::path::PathBuf;

use thiserror::Error;

/// A scene that can't be read: file, line, column, what is wrong and how to fix it.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{}{}: {message}", file.display(), at.map_or_else(String::new, |[line, column]| format!(":{line}:{column}")))]
pub struct PbrtError {
    /// The file.
    pub file: PathBuf,
    /// Line and column, from 1, where one is to blame.
    pub at: Option<[u32; 2]>,
    /// What is wrong and how to fix it.
    pub message: String,
}

/// A place in the files of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct PbrtPlace {
    /// Index into [`super::PbrtScene::files`].
    pub file: u32,
    /// Line, from 1.
    pub line: u32,
    /// Column in bytes, from 1.
    pub column: u32,
}

/// The part of an error that the reader of one file knows.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) at: [u32; 2],
    pub(super) message: String,
}

impl Fault {
    pub(super) fn new(at: [u32; 2], message: impl Into<String>) -> Self {
        Self { at, message: message.into() }
    }
}
