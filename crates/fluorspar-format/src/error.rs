//! Errors of files, with hints.

use fluorspar::quote::{excerpt, excerpt_to};
use fluorspar::units::memory_text;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

use super::{OtherFormat, ScatterLine};

/// Why a file can't be read or written. Every message names the file, the place where known, and what to do.
#[derive(Debug)]
pub struct FormatError {
    path: PathBuf,
    /// Of a text file, from 1.
    line: Option<u64>,
    defect: Box<Defect>,
    /// Where else it is wrong, as the end of the message.
    also: String,
}

/// What is wrong with a file, and what to do.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Defect {
    /// The operating system refused.
    #[error("can't {action} it: {source}.{}", io_advice(source))]
    Io {
        /// "read", "create", "write" or "rename".
        action: &'static str,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The content breaks the rules of its format or of this program.
    #[error("{what}. {hint}")]
    Malformed {
        /// What is wrong.
        what: String,
        /// How to fix it.
        hint: String,
    },
    /// The content is well-formed but of a kind that is not read here.
    #[error("{what}. {hint}")]
    Unsupported {
        /// What was found.
        what: String,
        /// How to fix it.
        hint: String,
    },
    /// A value of a table is below zero.
    #[error(
        "column {column} holds {value}, below zero. Subtract the background correctly, or set the value to 0"
    )]
    Negative {
        /// Name of the column.
        column: String,
        /// The value.
        value: f64,
    },
    /// A cell of an excitation-emission matrix is empty.
    #[error("the cell at excitation {excitation_nm} nm is empty. Fill it from its neighbors or with 0")]
    EmptyCell {
        /// Excitation wavelength of its column, nm.
        excitation_nm: f64,
    },
    /// A file of this program's own, of a version that is not read here.
    #[error("{0}")]
    OtherFormat(#[source] OtherFormat),
    /// A description is not JSON, or lacks a field or has one of another type.
    #[error("{}. Restore the file as it was written", bounded(&.0.to_string()))]
    Json(#[source] serde_json::Error),
    /// The file requires more memory than any sensible file.
    #[error("{what}; the limit is {limit}. Check that this is the right file and that it is complete")]
    TooLarge {
        /// The object that is too large, with its size.
        what: String,
        /// The limit, with its unit.
        limit: String,
    },
    /// The unit of the values is missing or not the wanted one.
    #[error("{what}. {hint}")]
    Unit {
        /// Found and expected value.
        what: String,
        /// How to fix it.
        hint: String,
    },
    /// Most of an excitation-emission matrix lies at emission wavelengths below its excitation.
    #[error(
        "{percent:.0} % of the signal lies at emission wavelengths shorter than the excitation. Transpose the table: \
         rows must be emission and columns excitation"
    )]
    Transposed {
        /// Share of the sum of all values, %.
        percent: f64,
    },
    /// One value of an excitation-emission matrix lies below its excitation.
    #[error(
        "emission at {emission_nm} nm is below its excitation at {excitation_nm} nm but holds {value} \
         ({percent_of_peak:.2} % of the peak). Remove scattered light, also that at and just above the excitation, set such cells \
         to 0 or allow anti-Stokes values"
    )]
    AntiStokes {
        /// Emission wavelength, nm.
        emission_nm: f64,
        /// Excitation wavelength, nm.
        excitation_nm: f64,
        /// The value.
        value: f64,
        /// The value relative to the largest one, %.
        percent_of_peak: f64,
    },
    /// Values of an excitation-emission matrix follow the excitation: excitation light that was scattered into the instrument.
    #[error(
        "{} lies along {} for excitations from {} to {} nm, up to {percent_of_peak:.0} % of the largest value off that line. \
         Subtract a blank, or replace the cells within one bandwidth of that line by interpolation or by 0",
        .along.name(), .along.equation(), .excitation_nm[0], .excitation_nm[1]
    )]
    ScatteredLight {
        /// The line that they follow.
        along: ScatterLine,
        /// First and last excitation wavelength at which it is seen, nm.
        excitation_nm: [f64; 2],
        /// Largest of the values over the largest one beyond the line, %.
        percent_of_peak: f64,
    },
    /// The columns of a table are of several samples, of which one must be chosen.
    #[error("the columns are of {} samples: {}. Choose one of them", .0.len(), shortened_list(.0))]
    Samples(Vec<String>),
    /// The place must not be read or written; nothing was written.
    #[error("{why}; {hint}")]
    Refused {
        /// What is wrong with it.
        why: String,
        /// What to do.
        hint: String,
    },
    /// The disk has less room than what will be written may take; nothing was written.
    #[error(
        "the disk has {} left, and up to {} will be written. Free some, name a place on another disk, or ask for less",
        memory_text(*.free_bytes), memory_text(*.needed_bytes)
    )]
    NoRoom {
        /// Bytes that the results take at most.
        needed_bytes: u64,
        /// Bytes that are left on the disk.
        free_bytes: u64,
    },
    /// The results are written, but not as they should be.
    #[error("{0}")]
    Failed(String),
    /// The data can't be written; no file was created.
    #[error("nothing was written: {what}. {hint}")]
    Unwritable {
        /// Defect of the data.
        what: String,
        /// How to fix it.
        hint: String,
    },
}

impl Defect {
    /// The error of a file.
    pub fn of(self, path: &Path) -> FormatError {
        FormatError { path: path.into(), line: None, defect: Box::new(self), also: String::new() }
    }

    /// The error of a line of a file, from 1.
    pub(super) fn at(self, path: &Path, line: u64) -> FormatError {
        FormatError { line: Some(line), ..self.of(path) }
    }
}

impl FormatError {
    /// The file that the error is about.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Line of a text file, from 1, where one is to blame.
    pub fn line(&self) -> Option<u64> {
        self.line
    }

    /// What is wrong; of several cells with the first.
    pub fn defect(&self) -> &Defect {
        &self.defect
    }

    /// Whether more is wrong than [`Self::defect`].
    pub fn has_more(&self) -> bool {
        !self.also.is_empty()
    }

    /// Whether there is no such file.
    pub fn is_not_found(&self) -> bool {
        matches!(&*self.defect, Defect::Io { source, .. } if source.kind() == io::ErrorKind::NotFound)
    }

    /// What is wrong and what to do, for messages that name the file themselves.
    pub fn problem(&self) -> String {
        self.problem_with("")
    }

    /// The same, with a remedy behind what is wrong first.
    pub fn problem_with(&self, remedy: &str) -> String {
        format!("{}{remedy}{}", self.defect, self.also)
    }

    /// The message, with a remedy behind what is wrong first.
    pub fn message_with(&self, remedy: &str) -> String {
        let line = self.line.map_or_else(String::new, |line| format!(":{line}"));
        format!("{}{line}: {}", self.path.display(), self.problem_with(remedy))
    }

    /// The same error where more is wrong: in words with their places, and how much besides.
    #[must_use]
    pub(super) fn and(mut self, next: &[String], more: usize) -> Self {
        if !next.is_empty() {
            let more = if more > 0 { format!("; and {more} more cells") } else { String::new() };
            self.also = format!(". Also {}{more}", next.join("; "));
        }
        self
    }

    /// The same error about a file that lies below another folder than the one it was made in.
    #[must_use]
    pub(super) fn moved(mut self, from: &Path, to: &Path) -> Self {
        if let Ok(below) = self.path.strip_prefix(from) {
            self.path = if below.as_os_str().is_empty() { to.to_path_buf() } else { to.join(below) };
        }
        self
    }

    /// A place that must not be read or written.
    pub(super) fn refused(path: &Path, why: impl Into<String>, hint: impl Into<String>) -> Self {
        Defect::Refused { why: why.into(), hint: hint.into() }.of(path)
    }

    pub(super) fn failed(path: &Path, what: impl Into<String>) -> Self {
        Defect::Failed(what.into()).of(path)
    }

    pub(super) fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        Defect::Io { action, source }.of(path)
    }

    pub(super) fn malformed(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Defect::Malformed { what: bounded(&what.into()), hint: hint.into() }.of(path)
    }

    pub(super) fn at_line(
        path: &Path,
        line: impl Into<Option<u64>>,
        what: impl Into<String>,
        hint: impl Into<String>,
    ) -> Self {
        Self { line: line.into(), ..Self::malformed(path, what, hint) }
    }

    pub(super) fn unsupported(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Defect::Unsupported { what: bounded(&what.into()), hint: hint.into() }.of(path)
    }

    pub(super) fn unit(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Defect::Unit { what: bounded(&what.into()), hint: hint.into() }.of(path)
    }

    pub(super) fn other_format(path: &Path, other: OtherFormat) -> Self {
        Defect::OtherFormat(other).of(path)
    }

    pub(super) fn json(path: &Path, source: serde_json::Error) -> Self {
        Defect::Json(source).of(path)
    }

    pub(super) fn too_large(path: &Path, what: impl Into<String>, limit: impl Into<String>) -> Self {
        Defect::TooLarge { what: bounded(&what.into()), limit: limit.into() }.of(path)
    }

    pub(super) fn unwritable(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Defect::Unwritable { what: bounded(&what.into()), hint: hint.into() }.of(path)
    }
}

impl fmt::Display for FormatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message_with(""))
    }
}

impl std::error::Error for FormatError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.defect.source()
    }
}

/// A description that stays readable whatever a file holds; what it quotes of the file is shortened before.
fn bounded(what: &str) -> String {
    const LONGEST: usize = 400;
    excerpt_to(what, LONGEST)
}

fn io_advice(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::NotFound => " Check the path and its folder",
        io::ErrorKind::PermissionDenied => " Check the permissions of the file and its folder",
        io::ErrorKind::StorageFull => " Free some disk space",
        io::ErrorKind::IsADirectory => " It is a folder: give a file",
        _ => " Check the disk and the path",
    }
}

/// The first of some names, and how many more there are.
pub(super) fn shortened_list(names: &[String]) -> String {
    let mut list = names.iter().take(12).map(|name| excerpt(name)).collect::<Vec<_>>().join(", ");
    if names.len() > 12 {
        list.push_str(&format!(" and {} more", names.len() - 12));
    }
    list
}
