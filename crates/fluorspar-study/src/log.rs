//! The log of a study: lines that are only appended, each with the digest of the one before.

use std::path::Path;

use fluorspar::digest::sha256_hex;
use fluorspar_format::AppendedLines;
use fluorspar_session::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::clock::now;
use crate::event::Event;

/// Name of the log.
pub(crate) const LOG: &str = "log.jsonl";
/// Digest before the first line.
const NOTHING: &str = "";

/// A line of the log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Entry {
    /// Its number, from 1.
    pub(crate) seq: i64,
    /// Digest of the line before.
    pub(crate) before: String,
    /// When, UTC.
    pub(crate) when: String,
    /// Who, by the name of the account.
    pub(crate) who: String,
    /// By which command.
    pub(crate) command: String,
    /// What happened.
    pub(crate) event: Event,
    /// Digest of all of this.
    #[serde(default)]
    pub(crate) sha256: String,
}

impl Entry {
    /// Digest of the line without its own.
    fn digest(&self) -> Result<String> {
        Ok(sha256_hex([serde_json::to_string(&Self { sha256: String::new(), ..self.clone() })?]))
    }
}

/// The log, locked for this process.
#[derive(Debug)]
pub(crate) struct Log {
    lines: AppendedLines,
    pub(crate) entries: Vec<Entry>,
    /// The last lines, which are not in the file yet.
    staged: String,
}

impl Log {
    /// Opens the log of a folder, or begins it. A last line that was not written to its end is cut off.
    ///
    /// # Errors
    /// A log that another process holds, lines that were changed, and what the system reports.
    pub(crate) fn open(folder: &Path) -> Result<Self> {
        let path = folder.join(LOG);
        let (mut lines, mut bytes) = AppendedLines::open(&path)?;
        let rest = lines.rest()?;
        // A line that is there as a whole is no torn one: its end alone is missing, or was changed
        let mut objects = serde_json::Deserializer::from_slice(&rest).into_iter::<Entry>();
        let is_whole = matches!(objects.next(), Some(Ok(_)));
        if is_whole {
            bytes.extend_from_slice(&rest);
        }
        let entries = read_entries(&path, &bytes)?;
        if is_whole {
            lines.end_last()?
        } else {
            lines.cut()?
        }
        Ok(Self { lines, entries, staged: String::new() })
    }

    /// Takes events in, which are written by the next [`Self::write_staged`].
    pub(crate) fn stage(&mut self, command: &str, events: Vec<Event>) -> Result<()> {
        let who = ["USER", "USERNAME"].iter().find_map(|name| std::env::var(name).ok()).unwrap_or_default();
        let (mut seq, mut before) = self.head();
        for event in events {
            seq += 1;
            let (who, command) = (who.clone(), command.to_owned());
            let mut entry = Entry { seq, before, when: now(), who, command, event, sha256: String::new() };
            entry.sha256 = entry.digest()?;
            before = entry.sha256.clone();
            self.staged += &format!("{}\n", serde_json::to_string(&entry)?);
            self.entries.push(entry);
        }
        Ok(())
    }

    /// Writes the lines that were taken in; when it returns they are on the disk. They wait for another try where it fails.
    ///
    /// # Errors
    /// What the system reports.
    pub(crate) fn write_staged(&mut self) -> Result<()> {
        self.lines.append_synced(&self.staged)?;
        self.staged.clear();
        Ok(())
    }

    /// Number and digest of the last line.
    fn head(&self) -> (i64, String) {
        self.entries.last().map_or((0, NOTHING.into()), |last| (last.seq, last.sha256.clone()))
    }
}

/// Lines whose chain holds.
fn read_entries(path: &Path, bytes: &[u8]) -> Result<Vec<Entry>> {
    let mut entries: Vec<Entry> = Vec::new();
    for (number, line) in bytes.split(|byte| *byte == b'\n').filter(|line| !line.is_empty()).enumerate() {
        let wrong = |why: &str| {
            Error::Input(format!(
                "{}, line {}: {why}; what follows can't be trusted. Take the log from a copy of the study",
                path.display(),
                number + 1
            ))
        };
        let entry: Entry = serde_json::from_slice(line).map_err(|error| wrong(&error.to_string()))?;
        let before = entries.last().map_or(NOTHING, |last| &last.sha256);
        if entry.before != before || entry.seq != number as i64 + 1 {
            return Err(wrong("a line before it was changed or is missing"));
        }
        if entry.digest()? != entry.sha256 {
            return Err(wrong("it was changed after it was written"));
        }
        entries.push(entry);
    }
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn person(name: &str) -> Event {
        Event::Withdrawal { subject: name.into() }
    }

    #[test]
    fn lines_come_back_and_changed_ones_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let mut log = Log::open(folder).unwrap();
        log.stage("test", vec![person("P1"), person("P2")]).unwrap();
        log.write_staged().unwrap();
        log.stage("test", vec![person("P3")]).unwrap();
        assert_eq!(std::fs::read(folder.join(LOG)).unwrap().iter().filter(|byte| **byte == b'\n').count(), 2);
        log.write_staged().unwrap();
        assert!(Log::open(folder).unwrap_err().to_string().contains("another process"));
        let entries = log.entries.clone();
        drop(log);
        assert_eq!(Log::open(folder).unwrap().entries, entries);
        let whole = std::fs::read(folder.join(LOG)).unwrap();
        // A line without its end is a line; one whose end was changed is refused, and stays
        std::fs::write(folder.join(LOG), &whole[..whole.len() - 1]).unwrap();
        assert_eq!(Log::open(folder).unwrap().entries, entries);
        assert_eq!(std::fs::read(folder.join(LOG)).unwrap(), whole);
        for bit in 0..8 {
            let mut changed = whole.clone();
            *changed.last_mut().unwrap() ^= 1 << bit;
            std::fs::write(folder.join(LOG), &changed).unwrap();
            assert!(Log::open(folder).unwrap_err().to_string().contains("line 3"));
            assert_eq!(std::fs::read(folder.join(LOG)).unwrap(), changed);
        }
        // Torn lines are cut, whatever was written of them
        for cut in 2..20 {
            std::fs::write(folder.join(LOG), &whole[..whole.len() - cut]).unwrap();
            assert_eq!(Log::open(folder).unwrap().entries, entries[..2]);
        }
        let changed = String::from_utf8(whole.clone()).unwrap().replacen("P2", "P9", 1);
        std::fs::write(folder.join(LOG), changed).unwrap();
        let error = Log::open(folder).unwrap_err().to_string();
        assert!(error.contains("line 2: it was changed"), "{error}");
        let lines: Vec<&[u8]> = whole.split_inclusive(|byte| *byte == b'\n').collect();
        std::fs::write(folder.join(LOG), [lines[0], lines[2]].concat()).unwrap();
        let error = Log::open(folder).unwrap_err().to_string();
        assert!(error.contains("line 2: a line before it"), "{error}");
    }
}
