//! Journals of long work, line by line: what a killed process has finished is there for the next.

use std::path::Path;

use serde_json::Value;

use super::lines::AppendedLines;
use crate::{FileFormat, FormatError};

/// A file of JSON lines that grows with the work: a head that says what work it is, then a line for each finished part. It is locked
/// while it is open, so that no two processes do the same work.
#[derive(Debug)]
pub struct Journal {
    lines: AppendedLines,
}

impl Journal {
    /// Opens a journal, or begins it, and returns what was finished before. A last line that was not written to its end is cut
    /// off.
    ///
    /// # Errors
    /// A file that is no journal or that of other work, one that another process holds, and what the system reports.
    pub fn open(path: &Path, work: &Value) -> Result<(Self, Vec<Value>), FormatError> {
        let (lines, bytes) = AppendedLines::open(path)?;
        let (entries, head) = read_lines(path, &bytes, work)?;
        lines.cut()?;
        let mut journal = Self { lines };
        if !head {
            let version = FileFormat::JOURNAL.version();
            journal.append(&serde_json::json!({ "format": version, "work": work }))?;
        }
        Ok((journal, entries))
    }

    /// What a journal holds; `None` where there is none yet.
    ///
    /// # Errors
    /// As [`Journal::open`], but for the lock.
    pub fn read(path: &Path, work: &Value) -> Result<Option<Vec<Value>>, FormatError> {
        match AppendedLines::read(path) {
            Err(error) if error.is_not_found() => Ok(None),
            bytes => Ok(Some(read_lines(path, &bytes?, work)?.0)),
        }
    }

    /// Removes a journal of work that came to nothing.
    ///
    /// # Errors
    /// What the system reports.
    pub fn discard(self) -> Result<(), FormatError> {
        self.lines.remove()
    }

    /// Adds a finished part.
    ///
    /// # Errors
    /// What the system reports.
    pub fn append(&mut self, entry: &Value) -> Result<(), FormatError> {
        self.lines.append(&format!("{entry}\n"))
    }
}

/// The entries of a journal, and whether it has a head.
fn read_lines(path: &Path, bytes: &[u8], work: &Value) -> Result<(Vec<Value>, bool), FormatError> {
    let mut entries = Vec::new();
    let mut head = false;
    for (number, line) in bytes.split(|byte| *byte == b'\n').filter(|line| !line.is_empty()).enumerate() {
        let Ok(value) = serde_json::from_slice::<Value>(line) else {
            let hint = "give another place; nothing was written";
            return Err(FormatError::at_line(
                path,
                number as u64 + 1,
                "this is not a journal of this program",
                hint,
            ));
        };
        if head {
            entries.push(value);
            continue;
        }
        let stated = value.get("format").and_then(Value::as_i64);
        FileFormat::JOURNAL.check(stated).map_err(|other| FormatError::other_format(path, other))?;
        if value.get("work") != Some(work) {
            let hint = "give another --out, or remove the journal if its work is not needed";
            return Err(FormatError::unsupported(path, "it is the journal of other work", hint));
        }
        head = true;
    }
    Ok((entries, head))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn finished_lines_come_back_and_cut_ones_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.journal");
        let work = json!({ "sha256": "abc", "blocks": 3 });
        assert_eq!(Journal::read(&path, &work).unwrap(), None);
        let (mut journal, before) = Journal::open(&path, &work).unwrap();
        assert!(before.is_empty());
        journal.append(&json!({ "block": 0, "loss": [0.1, 1e-300] })).unwrap();
        let held = Journal::open(&path, &work).unwrap_err().to_string();
        assert!(held.contains("another process"), "{held}");
        journal.append(&json!({ "block": 1 })).unwrap();
        drop(journal);
        let whole = std::fs::read(&path).unwrap();
        for cut in 1..9 {
            std::fs::write(&path, &whole[..whole.len() - cut]).unwrap();
            let (_, before) = Journal::open(&path, &work).unwrap();
            assert_eq!(before, [json!({ "block": 0, "loss": [0.1, 1e-300] })]);
        }
        assert_eq!(Journal::read(&path, &work).unwrap().unwrap().len(), 1);
        let other = Journal::open(&path, &json!({ "sha256": "def" })).unwrap_err().to_string();
        assert!(other.contains("other work"), "{other}");
        std::fs::write(&path, "a,b\n1,2\n").unwrap();
        let refused = Journal::open(&path, &work).unwrap_err().to_string();
        assert!(refused.contains("not a journal"), "{refused}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "a,b\n1,2\n");
    }
}
