//! Errors of files, with hints.

use fluorspar::quote::{excerpt, excerpt_to};
use fluorspar::units::memory_text;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::{OtherFormat, ScatterLine};

/// Why a file can't be read or written. Every message names the file, the place where known, and what to do.
#[derive(Debug)]
#[non_exhaustive]
pub enum FormatError {
    /// The operating system refused.
    Io {
        /// The file.
        path: PathBuf,
        /// "read", "create", "write" or "rename".
        action: &'static str,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The path leads to something that can't be read as a file.
    NotAFile {
        /// The path.
        path: PathBuf,
        /// What is there, in words.
        what: &'static str,
        /// What to do about it.
        hint: &'static str,
    },
    /// The content breaks the rules of its format or of this program.
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line of a text file, from 1.
        line: Option<u64>,
        /// What is wrong.
        what: String,
        /// How to fix it.
        hint: String,
    },
    /// The content is well-formed but of a kind that is not read here.
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What was found.
        what: String,
        /// How to fix it.
        hint: String,
    },
    /// A value of a table is below zero.
    Negative {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// The value.
        value: f64,
    },
    /// A cell of an excitation-emission matrix is empty.
    EmptyCell {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Excitation wavelength of its column, nm.
        excitation_nm: f64,
    },
    /// Several cells of a table are wrong.
    Cells {
        /// The first of them.
        first: Box<FormatError>,
        /// The next ones in words, with their places.
        next: Vec<String>,
        /// How many there are besides.
        more: usize,
    },
    /// A file of this program's own, of a version that is not read here.
    OtherFormat {
        /// The file.
        path: PathBuf,
        /// The version it states, and the one that is read.
        other: OtherFormat,
    },
    /// A description is not JSON, or lacks a field or has one of another type.
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column.
        source: serde_json::Error,
    },
    /// The file requires more memory than any sensible file.
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The object that is too large, with its size.
        what: String,
        /// The limit, with its unit.
        limit: String,
    },
    /// The unit of the values is missing or not the wanted one.
    Unit {
        /// The file.
        path: PathBuf,
        /// Found and expected value.
        what: String,
        /// How to fix it.
        hint: String,
    },
    /// Most of an excitation-emission matrix lies at emission wavelengths below its excitation.
    Transposed {
        /// The file.
        path: PathBuf,
        /// Share of the sum of all values, %.
        percent: f64,
    },
    /// One value of an excitation-emission matrix lies below its excitation.
    AntiStokes {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: Option<u64>,
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
    ScatteredLight {
        /// The file.
        path: PathBuf,
        /// The line that they follow.
        line: ScatterLine,
        /// First and last excitation wavelength at which it is seen, nm.
        excitation_nm: [f64; 2],
        /// Largest of the values over the largest one beyond the line, %.
        percent_of_peak: f64,
    },
    /// The columns of a table are of several samples, of which one must be chosen.
    Samples {
        /// The file.
        path: PathBuf,
        /// Line of the header, from 1.
        line: u64,
        /// Names of the samples.
        names: Vec<String>,
    },
    /// The place must not be written; nothing was.
    Refused {
        /// The place.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
        /// What to do.
        hint: String,
    },
    /// The disk has less room than what will be written may take; nothing was written.
    NoRoom {
        /// The place.
        path: PathBuf,
        /// Bytes that the results take at most.
        needed_bytes: u64,
        /// Bytes that are left on the disk.
        free_bytes: u64,
    },
    /// The results are written, but not as they should be.
    Failed {
        /// The place.
        path: PathBuf,
        /// What is where.
        what: String,
    },
    /// The data can't be written; no file was created.
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Defect of the data.
        what: String,
        /// How to fix it.
        hint: String,
    },
}

impl FormatError {
    /// The file that the error is about.
    pub fn path(&self) -> &Path {
        match self {
            Self::Io { path, .. }
            | Self::NotAFile { path, .. }
            | Self::Malformed { path, .. }
            | Self::Unsupported { path, .. }
            | Self::Negative { path, .. }
            | Self::EmptyCell { path, .. }
            | Self::OtherFormat { path, .. }
            | Self::Json { path, .. }
            | Self::TooLarge { path, .. }
            | Self::Unit { path, .. }
            | Self::Transposed { path, .. }
            | Self::AntiStokes { path, .. }
            | Self::ScatteredLight { path, .. }
            | Self::Samples { path, .. }
            | Self::Refused { path, .. }
            | Self::NoRoom { path, .. }
            | Self::Failed { path, .. }
            | Self::Unwritable { path, .. } => path,
            Self::Cells { first, .. } => first.path(),
        }
    }

    /// The error itself, of several cells that of the first.
    pub fn first(&self) -> &Self {
        match self {
            Self::Cells { first, .. } => first,
            one => one,
        }
    }

    /// What else is wrong with cells of the file, in words.
    pub fn also(&self) -> Option<String> {
        let Self::Cells { next, more, .. } = self else { return None };
        let more = if *more > 0 { format!("; and {more} more cells") } else { String::new() };
        Some(format!("Also {}{more}", next.join("; ")))
    }

    /// Line of a text file, from 1, where one is to blame.
    pub fn line(&self) -> Option<u64> {
        match self {
            Self::Malformed { line, .. } | Self::AntiStokes { line, .. } => *line,
            Self::Negative { line, .. } | Self::EmptyCell { line, .. } | Self::Samples { line, .. } => {
                Some(*line)
            }
            Self::Cells { first, .. } => first.line(),
            _ => None,
        }
    }

    /// What is wrong and what to do, for messages that name the file themselves.
    pub fn problem(&self) -> Problem<'_> {
        Problem(self)
    }

    fn path_mut(&mut self) -> &mut PathBuf {
        match self {
            Self::Io { path, .. }
            | Self::NotAFile { path, .. }
            | Self::Malformed { path, .. }
            | Self::Unsupported { path, .. }
            | Self::Negative { path, .. }
            | Self::EmptyCell { path, .. }
            | Self::OtherFormat { path, .. }
            | Self::Json { path, .. }
            | Self::TooLarge { path, .. }
            | Self::Unit { path, .. }
            | Self::Transposed { path, .. }
            | Self::AntiStokes { path, .. }
            | Self::ScatteredLight { path, .. }
            | Self::Samples { path, .. }
            | Self::Refused { path, .. }
            | Self::NoRoom { path, .. }
            | Self::Failed { path, .. }
            | Self::Unwritable { path, .. } => path,
            Self::Cells { first, .. } => first.path_mut(),
        }
    }

    /// The same error about a file that lies below another folder than the one it was made in.
    #[must_use]
    pub(super) fn moved(mut self, from: &Path, to: &Path) -> Self {
        let path = self.path_mut();
        if let Ok(below) = path.strip_prefix(from) {
            *path = if below.as_os_str().is_empty() { to.to_path_buf() } else { to.join(below) };
        }
        self
    }

    /// A place that must not be written, and the option with which another is named.
    pub(super) fn refused(path: &Path, why: impl Into<String>, hint: &str, option: &str) -> Self {
        Self::Refused { path: path.into(), why: why.into(), hint: format!("{hint} {option}") }
    }

    pub(super) fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        Self::Io { path: path.into(), action, source }
    }

    pub(super) fn malformed(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Malformed { path: path.into(), line: None, what: bounded(&what.into()), hint: hint.into() }
    }

    pub(super) fn at_line(path: &Path, line: u64, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.into(),
            line: Some(line),
            what: bounded(&what.into()),
            hint: hint.into(),
        }
    }

    pub(super) fn unsupported(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Unsupported { path: path.into(), what: bounded(&what.into()), hint: hint.into() }
    }

    pub(super) fn unit(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Unit { path: path.into(), what: bounded(&what.into()), hint: hint.into() }
    }

    pub(super) fn other_format(path: &Path, other: OtherFormat) -> Self {
        Self::OtherFormat { path: path.into(), other }
    }

    pub(super) fn json(path: &Path, source: serde_json::Error) -> Self {
        Self::Json { path: path.into(), source }
    }

    pub(super) fn too_large(path: &Path, what: impl Into<String>, limit: impl Into<String>) -> Self {
        Self::TooLarge { path: path.into(), what: bounded(&what.into()), limit: limit.into() }
    }

    pub(super) fn unwritable(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Unwritable { path: path.into(), what: bounded(&what.into()), hint: hint.into() }
    }
}

impl fmt::Display for FormatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path().display())?;
        if let Some(line) = self.line() {
            write!(f, ":{line}")?;
        }
        write!(f, ": {}", self.problem())
    }
}

impl std::error::Error for FormatError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io { source, .. } => Some(source),
            Self::Json { source, .. } => Some(source),
            Self::OtherFormat { other, .. } => Some(other),
            _ => None,
        }
    }
}

/// A [`FormatError`] without its file.
#[derive(Debug)]
pub struct Problem<'a>(&'a FormatError);

impl fmt::Display for Problem<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            FormatError::Io { action, source, .. } => {
                write!(f, "can't {action} it: {source}.{}", io_advice(source))
            }
            FormatError::NotAFile { what, hint, .. } => write!(f, "this is {what}; {hint}"),
            FormatError::Malformed { what, hint, .. }
            | FormatError::Unsupported { what, hint, .. }
            | FormatError::Unit { what, hint, .. } => write!(f, "{what}. {hint}"),
            FormatError::Negative { column, value, .. } => write!(
                f,
                "column {column} holds {value}, below zero. Subtract the background correctly, or set the \
                 value to 0"
            ),
            FormatError::EmptyCell { excitation_nm, .. } => write!(
                f,
                "the cell at excitation {excitation_nm} nm is empty. Fill it from its neighbors or with 0"
            ),
            FormatError::Cells { first, .. } => {
                write!(f, "{}. {}", first.problem(), self.0.also().unwrap_or_default())
            }
            FormatError::OtherFormat { other, .. } => write!(f, "{other}"),
            FormatError::Json { source, .. } => {
                write!(f, "{}. Restore the file as it was written", bounded(&source.to_string()))
            }
            FormatError::TooLarge { what, limit, .. } => {
                write!(
                    f,
                    "{what}; the limit is {limit}. Check that this is the right file and that it is complete"
                )
            }
            FormatError::Transposed { percent, .. } => write!(
                f,
                "{percent:.0} % of the signal lies at emission wavelengths shorter than the excitation. Transpose the table: \
                 rows must be emission and columns excitation"
            ),
            FormatError::AntiStokes { emission_nm, excitation_nm, value, percent_of_peak, .. } => write!(
                f,
                "emission at {emission_nm} nm is below its excitation at {excitation_nm} nm but holds {value} \
                 ({percent_of_peak:.2} % of the peak). Remove scattered light, also that at and just above the excitation, set such cells \
                 to 0 or allow anti-Stokes values"
            ),
            FormatError::ScatteredLight { line, excitation_nm: [first, last], percent_of_peak, .. } => {
                let what = match line {
                    ScatterLine::First => "first-order scatter (Rayleigh and Tyndall)",
                    ScatterLine::Second => "second-order scatter",
                    ScatterLine::Third => "third-order scatter",
                    ScatterLine::WaterRaman => "Raman scatter of water",
                };
                write!(
                    f,
                    "{what} lies along {} for excitations from {first} to {last} nm, up to {percent_of_peak:.0} % of the largest value off that line. \
                     Subtract a blank, or replace the cells within one bandwidth of that line by interpolation or by 0",
                    line.equation()
                )
            }
            FormatError::Samples { names, .. } => write!(
                f,
                "the columns are of {} samples: {}. Choose one of them",
                names.len(),
                shortened_list(names)
            ),
            FormatError::Refused { why, hint, .. } => write!(f, "{why}; {hint}"),
            FormatError::NoRoom { needed_bytes, free_bytes, .. } => write!(
                f,
                "the disk has {} left, and up to {} will be written. Free some, name a place on another disk, or ask for less",
                memory_text(*free_bytes),
                memory_text(*needed_bytes)
            ),
            FormatError::Failed { what, .. } => write!(f, "{what}"),
            FormatError::Unwritable { what, hint, .. } => write!(f, "nothing was written: {what}. {hint}"),
        }
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
