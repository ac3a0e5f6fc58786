//! Files that grow line by line, held by one process.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::store::input::open_plain;
use crate::{FormatError, read_bounded};

/// Largest file, bytes.
const LARGEST_BYTES: u64 = 4 << 30;

/// A file to whose end lines are added. It is locked while it is open, so that no two processes add to it.
#[derive(Debug)]
pub struct AppendedLines {
    path: PathBuf,
    file: File,
    /// Bytes of lines that were written to their end.
    complete: u64,
}

impl AppendedLines {
    /// Opens a file, or begins it, and returns its complete lines. Nothing is changed yet: see [`Self::cut`].
    ///
    /// # Errors
    /// A file that another process holds, and what the system reports.
    pub fn open(path: &Path) -> Result<(Self, Vec<u8>), FormatError> {
        let failed = |source| FormatError::io(path, "open", source);
        let file = OpenOptions::new().create(true).append(true).open(path).map_err(failed)?;
        if file.try_lock().is_err() {
            let hint = "wait for it, or work on another place";
            return Err(FormatError::unsupported(path, "another process is writing this file", hint));
        }
        let bytes = Self::read(path)?;
        let complete = bytes.len() as u64;
        Ok((Self { path: path.into(), file, complete }, bytes))
    }

    /// The complete lines of a file.
    ///
    /// # Errors
    /// What the system reports.
    pub fn read(path: &Path) -> Result<Vec<u8>, FormatError> {
        let mut bytes = read_bounded(path, LARGEST_BYTES)?;
        let complete = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |last| last + 1);
        bytes.truncate(complete);
        Ok(bytes)
    }

    /// The last complete line of a file, without its end. `None` where there is none, or one of more than a mebibyte.
    ///
    /// # Errors
    /// What the system reports.
    pub fn last(path: &Path) -> Result<Option<Vec<u8>>, FormatError> {
        const LONGEST: u64 = 1 << 20;
        let failed = |source| FormatError::io(path, "read", source);
        let (mut file, length) = open_plain(path)?;
        file.seek(SeekFrom::Start(length.saturating_sub(LONGEST))).map_err(failed)?;
        let mut end = Vec::new();
        file.take(LONGEST).read_to_end(&mut end).map_err(failed)?;
        let mut lines = end.rsplit(|byte| *byte == b'\n').skip(1);
        let is_whole = |line: &&[u8]| !line.is_empty() && (line.len() as u64) < LONGEST;
        Ok(lines.next().filter(is_whole).map(<[u8]>::to_vec))
    }

    /// What follows the last complete line: a torn one, or one whose end was changed.
    ///
    /// # Errors
    /// What the system reports.
    pub fn rest(&self) -> Result<Vec<u8>, FormatError> {
        let failed = |source| FormatError::io(&self.path, "read", source);
        let (mut file, _) = open_plain(&self.path)?;
        file.seek(SeekFrom::Start(self.complete)).map_err(failed)?;
        let mut rest = Vec::new();
        file.take(LARGEST_BYTES).read_to_end(&mut rest).map_err(failed)?;
        Ok(rest)
    }

    /// Writes the end of the last line, which is complete otherwise.
    ///
    /// # Errors
    /// What the system reports.
    pub fn end_last(&mut self) -> Result<(), FormatError> {
        self.complete += self.rest()?.len() as u64;
        self.append_synced("\n")
    }

    /// Cuts a last line off that was not written to its end.
    ///
    /// # Errors
    /// What the system reports.
    pub fn cut(&self) -> Result<(), FormatError> {
        self.file.set_len(self.complete).map_err(|source| FormatError::io(&self.path, "write", source))
    }

    /// Removes the file.
    ///
    /// # Errors
    /// What the system reports.
    pub fn remove(self) -> Result<(), FormatError> {
        std::fs::remove_file(&self.path).map_err(|source| FormatError::io(&self.path, "remove", source))
    }

    /// Adds lines, each with its end; all, or none.
    ///
    /// # Errors
    /// What the system reports.
    pub fn append(&mut self, lines: &str) -> Result<(), FormatError> {
        let written = self.file.write_all(lines.as_bytes());
        self.finish(lines, written)
    }

    /// Adds lines, each with its end, which are on the disk when it returns; all, or none.
    ///
    /// # Errors
    /// What the system reports.
    pub fn append_synced(&mut self, lines: &str) -> Result<(), FormatError> {
        let written = self.file.write_all(lines.as_bytes()).and_then(|()| self.file.sync_data());
        self.finish(lines, written)
    }

    /// Counts lines that were written; cuts what was written of lines that failed, whose next would follow a torn one.
    fn finish(&mut self, lines: &str, written: io::Result<()>) -> Result<(), FormatError> {
        if let Err(source) = written {
            // A file that can't be cut either is cut by the next that opens it
            let _ = self.cut();
            return Err(FormatError::io(&self.path, "write", source));
        }
        self.complete += lines.len() as u64;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_failed_append_left_is_cut() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lines");
        let (mut lines, _) = AppendedLines::open(&path).unwrap();
        lines.append("one\n").unwrap();
        lines.file.write_all(b"tw").unwrap();
        lines.finish("two\n", Err(io::ErrorKind::StorageFull.into())).unwrap_err();
        lines.append_synced("three\n").unwrap();
        assert_eq!(AppendedLines::read(&path).unwrap(), b"one\nthree\n");
        assert_eq!(AppendedLines::last(&path).unwrap().unwrap(), b"three");
        lines.file.write_all(b"torn").unwrap();
        assert_eq!(AppendedLines::last(&path).unwrap().unwrap(), b"three");
    }
}
