//! The index: SQLite tables made from the log alone.

use std::fs;
use std::path::{Path, PathBuf};

use fluorspar_format::AppendedLines;
use fluorspar_session::{Error, Result};
use rusqlite::{Connection, OpenFlags, Row, params};

use crate::event::{Event, LoggedEstimate, quantity_name};
use crate::log::{Entry, LOG};

/// Folder of what is made from the truth.
pub(crate) const FOLDER: &str = ".fluorspar";
const FILE: &str = "study.sqlite";
/// Version of the tables: an index of another is made anew.
const VERSION: i64 = 6;

const TABLES: &str = "
CREATE TABLE audit (seq INTEGER PRIMARY KEY, before TEXT, at TEXT, who TEXT, command TEXT, sha256 TEXT);
CREATE TABLE study (name TEXT, site TEXT, secret TEXT);
CREATE TABLE setup (path TEXT PRIMARY KEY, sha256 TEXT NOT NULL, analysis TEXT NOT NULL);
CREATE TABLE subject (subject TEXT PRIMARY KEY, site TEXT, sex TEXT, age REAL, skin TEXT, smoker TEXT, consent TEXT, withdrawn INTEGER NOT NULL DEFAULT 0)
    WITHOUT ROWID;
CREATE TABLE photograph (photograph TEXT PRIMARY KEY, subject TEXT NOT NULL, session TEXT NOT NULL, visit TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE file (path TEXT PRIMARY KEY, photograph TEXT NOT NULL, role TEXT NOT NULL, sha256 TEXT NOT NULL);
CREATE TABLE region (region_sha256 TEXT PRIMARY KEY, photograph TEXT NOT NULL, region TEXT NOT NULL, place TEXT NOT NULL, verdict TEXT, current INTEGER NOT NULL)
    WITHOUT ROWID;
CREATE TABLE estimate (photograph TEXT NOT NULL, region_sha256 TEXT NOT NULL, region TEXT NOT NULL, quantity TEXT NOT NULL, channel TEXT NOT NULL,
    value REAL, low REAL, high REAL, interval_kind TEXT, pixels INTEGER, analysis TEXT NOT NULL, version TEXT NOT NULL, seq INTEGER NOT NULL,
    PRIMARY KEY (quantity, channel, region_sha256, analysis, version)) WITHOUT ROWID;
CREATE TABLE warning (region_sha256 TEXT NOT NULL, analysis TEXT NOT NULL, version TEXT NOT NULL, warning TEXT NOT NULL,
    PRIMARY KEY (region_sha256, analysis, version, warning)) WITHOUT ROWID;
CREATE INDEX photograph_of ON photograph (subject);
CREATE INDEX region_of ON region (photograph);
CREATE INDEX estimate_of ON estimate (region_sha256);
CREATE TABLE outcome (subject TEXT NOT NULL, method TEXT, outcome TEXT NOT NULL, seq INTEGER PRIMARY KEY);
";

/// The index of a study.
pub(crate) struct Index {
    connection: Connection,
    /// Lines that are not on the disk yet.
    waiting: usize,
    /// Whether there are lines among them that the log doesn't have on the disk either.
    is_ahead: bool,
}

/// Lines that wait for the disk at most.
const MOST_WAITING: usize = 2000;

impl Drop for Index {
    fn drop(&mut self) {
        // What can't be written is taken from the log by the next process, and the log alone says what happened
        if !self.is_ahead {
            let _ = self.flush();
        }
    }
}

fn failed(error: rusqlite::Error) -> Error {
    Error::Failed(format!("the index of the study: {error}; `fluorspar study reindex` makes it anew"))
}

impl Index {
    /// The index of a folder, with all that the log says: made anew where there is none, or one of another version.
    ///
    /// # Errors
    /// An index of lines that the log does not have.
    pub(crate) fn open(folder: &Path, entries: &[Entry]) -> Result<Self> {
        let path = folder.join(FOLDER).join(FILE);
        if let Ok(connection) = Connection::open(&path)
            && let Some(seq) = known_until(&connection, entries)?
        {
            let mut index = Self::on(connection);
            index.apply(&entries[seq..])?;
            index.settle()?;
            return Ok(index);
        }
        Self::anew(folder, entries)
    }

    /// The index that is there, where it knows the last line of the log: what is only asked for needs no look at the others.
    pub(crate) fn current(folder: &Path) -> Option<Self> {
        let path = folder.join(FOLDER).join(FILE);
        let connection = Connection::open_with_flags(
            path,
            OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX,
        )
        .ok()?;
        let last: Entry = serde_json::from_slice(&AppendedLines::last(&folder.join(LOG)).ok()??).ok()?;
        let is_current =
            is_of_this_version(&connection) && last_line(&connection)? == (last.seq, last.sha256);
        is_current.then(|| Self::on(connection))
    }

    /// Digest of the last line that it knows.
    pub(crate) fn head(&self) -> String {
        last_line(&self.connection).map_or_else(String::new, |(_, sha256)| sha256)
    }

    /// The secret of the study; empty in one of an earlier version.
    pub(crate) fn secret(&self) -> Result<String> {
        let found =
            self.rows("SELECT secret FROM study ORDER BY rowid DESC LIMIT 1", [], |row| row.get(0))?;
        Ok(found.into_iter().next().unwrap_or_default())
    }

    fn on(connection: Connection) -> Self {
        // Without it pages of a large study are read again and again; it is only faster with it
        let _ = connection.pragma_update(None, "cache_size", -64 * 1024);
        Self { connection, waiting: 0, is_ahead: false }
    }

    /// Makes the index anew, and puts it in the place of the one before when it is complete.
    pub(crate) fn anew(folder: &Path, entries: &[Entry]) -> Result<Self> {
        let place = folder.join(FOLDER);
        let path = place.join(FILE);
        let io = |error: std::io::Error| Error::Failed(format!("{}: {error}", place.display()));
        fs::create_dir_all(&place).map_err(io)?;
        let partial = place.join(format!("study.{}.partial", std::process::id()));
        remove(&partial)?;
        let mut index = Self::on(Connection::open(&partial).map_err(failed)?);
        index.connection.execute_batch(TABLES).map_err(failed)?;
        index.connection.pragma_update(None, "user_version", VERSION).map_err(failed)?;
        index.apply(entries)?;
        index.is_ahead = false;
        index.flush()?;
        drop(index);
        for ending in ["-journal", "-wal", "-shm"] {
            remove(&PathBuf::from(format!("{}{ending}", path.display())))?;
        }
        fs::rename(&partial, &path).map_err(io)?;
        Ok(Self::on(Connection::open(&path).map_err(failed)?))
    }

    /// An index in memory, to compare with.
    pub(crate) fn in_memory(entries: &[Entry]) -> Result<Self> {
        let connection = Connection::open_in_memory().map_err(failed)?;
        connection.execute_batch(TABLES).map_err(failed)?;
        let mut index = Self::on(connection);
        index.apply(entries)?;
        Ok(index)
    }

    /// Takes lines of the log in. They come to the disk after [`Self::settle`].
    pub(crate) fn apply(&mut self, entries: &[Entry]) -> Result<()> {
        if self.connection.is_autocommit() {
            self.connection.execute_batch("BEGIN").map_err(failed)?;
        }
        let applied = entries.iter().try_for_each(|entry| apply_one(&self.connection, entry));
        if let Err(error) = applied {
            let _ = self.connection.execute_batch("ROLLBACK");
            return Err(failed(error));
        }
        self.waiting += entries.len();
        self.is_ahead = true;
        Ok(())
    }

    /// Is told that the log has all lines on the disk. They follow when they are many, or when the index is dropped: what a killed process
    /// leaves behind is taken from the log again.
    pub(crate) fn settle(&mut self) -> Result<()> {
        self.is_ahead = false;
        if self.waiting >= MOST_WAITING { self.flush() } else { Ok(()) }
    }

    /// Writes the lines that were taken in.
    pub(crate) fn flush(&mut self) -> Result<()> {
        self.waiting = 0;
        if self.connection.is_autocommit() {
            return Ok(());
        }
        self.connection.execute_batch("COMMIT").map_err(failed)
    }

    /// Rows of a query.
    pub(crate) fn rows<T>(
        &self,
        sql: &str,
        values: impl rusqlite::Params,
        read: impl FnMut(&Row<'_>) -> rusqlite::Result<T>,
    ) -> Result<Vec<T>> {
        let mut statement = self.connection.prepare_cached(sql).map_err(failed)?;
        let rows = statement.query_map(values, read).map_err(failed)?;
        rows.collect::<rusqlite::Result<_>>().map_err(failed)
    }

    /// Every row of every table as text, in order.
    pub(crate) fn dump(&self) -> Result<Vec<String>> {
        let names =
            self.rows("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name", [], |row| {
                row.get::<_, String>(0)
            })?;
        let mut all = Vec::new();
        for name in names {
            let read = |row: &Row<'_>| {
                let cells =
                    (0..row.as_ref().column_count()).map(|column| Ok(format!("{:?}", row.get_ref(column)?)));
                Ok(format!("{name} {}", cells.collect::<rusqlite::Result<Vec<_>>>()?.join("|")))
            };
            let mut rows = self.rows(&format!("SELECT * FROM {name}"), [], read)?;
            rows.sort();
            all.extend(rows);
        }
        Ok(all)
    }
}

fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(Error::Failed(format!("{}: {error}", path.display())))
        }
        _ => Ok(()),
    }
}

/// How many lines an index holds, where it can be read and is of this version.
///
/// # Errors
/// Lines that the log does not have.
fn known_until(connection: &Connection, entries: &[Entry]) -> Result<Option<usize>> {
    let Some((seq, sha256)) = last_line(connection) else { return Ok(None) };
    let of_log = usize::try_from(seq - 1).ok().and_then(|at| entries.get(at));
    if of_log.is_none_or(|entry| entry.sha256 != sha256) {
        return Err(Error::Input(format!(
            "the index of the study knows {seq} lines of the log, which has {} and not these: {LOG} was shortened or replaced. Take it from a copy of the \
             study. Only if there is none, and what is missing may be lost, `fluorspar study reindex` makes the index of what is left",
            entries.len()
        )));
    }
    Ok(is_of_this_version(connection).then_some(seq as usize))
}

/// Number and digest of the last line of the log that an index knows.
fn last_line(connection: &Connection) -> Option<(i64, String)> {
    let sql = "SELECT seq, sha256 FROM audit ORDER BY seq DESC LIMIT 1";
    connection.query_row(sql, [], |row| Ok((row.get(0)?, row.get(1)?))).ok()
}

fn is_of_this_version(connection: &Connection) -> bool {
    connection.pragma_query_value(None, "user_version", |row| row.get(0)) == Ok(VERSION)
}

fn apply_one(to: &Connection, entry: &Entry) -> rusqlite::Result<()> {
    to.prepare_cached("INSERT INTO audit VALUES (?, ?, ?, ?, ?, ?)")?.execute(params![
        entry.seq,
        entry.before,
        entry.when,
        entry.who,
        entry.command,
        entry.sha256
    ])?;
    match &entry.event {
        Event::Study { name, site, secret } => {
            to.execute("INSERT INTO study VALUES (?, ?, ?)", params![name, site, secret]).map(|_| ())
        }
        Event::Setup { analysis, files } => {
            to.execute("DELETE FROM setup", [])?;
            files.iter().try_for_each(|file| {
                let path = file.path.to_string_lossy();
                to.execute("INSERT INTO setup VALUES (?, ?, ?)", params![path, file.sha256, analysis]).map(|_| ())
            })
        }
        Event::Subject(of) => to
            .prepare_cached(
                "INSERT INTO subject (subject, site, sex, age, skin, smoker, consent) VALUES (?, ?, ?, ?, ?, ?, ?)
                 ON CONFLICT (subject) DO UPDATE SET site = excluded.site, sex = excluded.sex, age = excluded.age, skin = excluded.skin,
                 smoker = excluded.smoker, consent = excluded.consent",
            )?
            .execute(params![of.subject, of.site, of.sex, of.age, of.skin, of.smoker, of.consent])
            .map(|_| ()),
        Event::Withdrawal { subject } => {
            to.execute("UPDATE subject SET withdrawn = 1 WHERE subject = ?", params![subject]).map(|_| ())
        }
        Event::Photograph { photograph, subject, session, visit, files } => {
            let visit = visit.as_ref().unwrap_or(session);
            to.prepare_cached("INSERT OR REPLACE INTO photograph VALUES (?, ?, ?, ?)")?.execute(params![photograph, subject, session, visit])?;
            files.iter().try_for_each(|file| add_file(to, photograph, file))
        }
        Event::Region(of) => {
            to.prepare_cached("UPDATE region SET current = 0 WHERE photograph = ? AND region = ?")?.execute(params![of.photograph, of.region])?;
            let current = of.verdict != "wrong";
            to.prepare_cached("INSERT OR REPLACE INTO region VALUES (?, ?, ?, ?, ?, ?)")?.execute(params![
                of.sha256(),
                of.photograph,
                of.region,
                of.place,
                of.verdict,
                current
            ])?;
            of.mask.iter().try_for_each(|mask| add_file(to, &of.photograph, mask))
        }
        Event::Estimate(of) => add_estimate(to, of, entry.seq),
        Event::Outcome { subject, method, outcome } => {
            to.execute("INSERT INTO outcome VALUES (?, ?, ?, ?)", params![subject, method, outcome, entry.seq]).map(|_| ())
        }
    }
}

fn add_estimate(to: &Connection, of: &LoggedEstimate, seq: i64) -> rusqlite::Result<()> {
    let number = &of.number;
    to.prepare_cached("INSERT OR IGNORE INTO estimate VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)")?
        .execute(params![
            of.photograph,
            of.region_sha256,
            number.region,
            quantity_name(number.quantity),
            number.channel.clone().unwrap_or_default(),
            number.value,
            number.interval.map(|ends| ends[0]),
            number.interval.map(|ends| ends[1]),
            serde_json::to_value(number.interval_kind).ok().and_then(|kind| kind.as_str().map(str::to_owned)),
            number.pixels as i64,
            of.analysis,
            of.version,
            seq
        ])?;
    let mut add = to.prepare_cached("INSERT OR IGNORE INTO warning VALUES (?, ?, ?, ?)")?;
    let mut warnings = number.warnings.iter();
    warnings.try_for_each(|text| {
        add.execute(params![of.region_sha256, of.analysis, of.version, text]).map(|_| ())
    })
}

fn add_file(to: &Connection, photograph: &str, file: &crate::StoredFile) -> rusqlite::Result<()> {
    let path = file.path.to_string_lossy();
    to.prepare_cached("INSERT OR REPLACE INTO file VALUES (?, ?, ?, ?)")?
        .execute(params![path, photograph, file.role, file.sha256])
        .map(|_| ())
}
