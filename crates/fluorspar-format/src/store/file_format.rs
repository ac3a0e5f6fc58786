//! Versions of this program's own file formats.
//!
//! Every file of a form of our own carries an integer `format`: `format = 1` in TOML, `"format": 1` in JSON, an
//! attribute of OpenEXR images, a word of films. It counts up when a reader of the former version would misread the file.
//! A reader refuses versions that it does not know; each version has a stored file in `tests/fixtures/`.

use std::fmt;
use std::path::Path;

use serde::Deserialize;
use thiserror::Error;

use crate::FormatError;

const MAKE_AGAIN: [&str; 2] =
    ["Make it again", "Make it again, or use the version of the program that wrote it"];
const DELETE: &str = "Delete the folder by hand if nothing in it is needed";

/// A file format of this program: what its files hold, and the version that is written and read.
#[derive(Debug, PartialEq, Eq)]
pub struct FileFormat {
    content: &'static str,
    version: u32,
    /// What helps where a file states no version, and where it states another one.
    hints: [&'static str; 2],
}

impl FileFormat {
    /// Experiments, flat samples and sensor files (TOML).
    pub const EXPERIMENT: Self = Self::new(
        "file",
        1,
        ["Write format = 1 as its first line", "Use a version of Fluorspar that reads this format"],
    );
    /// Design problems (TOML).
    pub const DESIGN: Self = Self::new(
        "design file",
        2,
        [
            "Write format = 2 as its first line",
            "Files of format 1 are converted by examples/convert_design.py",
        ],
    );
    /// Component images (OpenEXR).
    pub const COMPONENT_IMAGE: Self = Self::new("component image", 1, MAKE_AGAIN);
    /// Films.
    pub const FILM: Self = Self::new("film", 1, MAKE_AGAIN);
    /// Descriptions of NumPy arrays (JSON).
    pub const ARRAY: Self = Self::new("description", 1, MAKE_AGAIN);
    /// Descriptions of raw frames (JSON), alone or in a DNG.
    pub const RAW_FRAME: Self = Self::new(
        "description",
        1,
        ["Write \"format\": 1 into it", "Use a version of Fluorspar that reads this format"],
    );
    /// `results.json` of a run and of a characterized sensor.
    pub const RESULTS: Self = Self::new("file of results", 1, MAKE_AGAIN);
    /// Lists of the files of a result folder (JSON).
    pub const RESULT_FOLDER: Self = Self::new("list of files", 1, [DELETE; 2]);

    /// Journals of long work (JSON lines).
    pub const JOURNAL: Self = Self::new("journal", 1, MAKE_AGAIN);

    const fn new(content: &'static str, version: u32, hints: [&'static str; 2]) -> Self {
        Self { content, version, hints }
    }

    /// The version that this program writes and reads.
    pub const fn version(&self) -> u32 {
        self.version
    }

    /// Checks the version that a file states.
    ///
    /// # Errors
    /// No version, or one that this program does not read.
    pub fn check(&'static self, stated: Option<i64>) -> Result<(), OtherFormat> {
        if stated == Some(i64::from(self.version)) {
            Ok(())
        } else {
            Err(OtherFormat { format: self, stated })
        }
    }

    /// [`Self::check`] of the field `format` of a JSON text, before anything else in it is read.
    pub(crate) fn check_json(&'static self, path: &Path, json: &[u8]) -> Result<(), FormatError> {
        #[derive(Deserialize)]
        struct Head {
            #[serde(default)]
            format: Option<i64>,
        }
        let head: Head = serde_json::from_slice(json).map_err(|source| FormatError::json(path, source))?;
        self.check(head.format).map_err(|other| FormatError::other_format(path, other))
    }
}

/// A file of a version that this program does not read.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub struct OtherFormat {
    format: &'static FileFormat,
    stated: Option<i64>,
}

impl fmt::Display for OtherFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FileFormat { content, version, hints: [unstated, other] } = self.format;
        match self.stated {
            Some(stated) => {
                write!(f, "the {content} has format {stated}; this program reads format {version}. {other}")
            }
            None => {
                write!(f, "the {content} has no `format`; this program reads format {version}. {unstated}")
            }
        }
    }
}
