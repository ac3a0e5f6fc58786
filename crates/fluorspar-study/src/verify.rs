//! Checks and repairs: every file, the log, the index; and people who withdraw.

use std::path::{Path, PathBuf};

use fluorspar_format::digest_bounded;
use fluorspar_session::{Error, Job, Left, Result};
use serde::{Deserialize, Serialize};

use crate::event::Event;
use crate::index::Index;
use crate::query::person;
use crate::store::{CAMERA, LARGEST_BYTES, Study, StudyArgs};

/// What was checked.
#[derive(Clone, Debug, Serialize)]
pub struct VerifiedStudy {
    /// Lines of the log, each with the digest of the one before.
    pub lines: usize,
    /// Files with the bytes that the log says.
    pub files: usize,
    /// What is wrong.
    pub defects: Vec<String>,
}

/// Checks that every file has the bytes that were taken in, that no line of the log was changed, and that the index says what the log says.
///
/// # Errors
/// A log that was changed, named with its line.
pub fn verify(options: &StudyArgs, job: &Job) -> Result<VerifiedStudy> {
    let study = Study::open(&options.study)?;
    let sql =
        "SELECT f.path, f.sha256, s.withdrawn FROM file f JOIN photograph p ON p.photograph = f.photograph
               JOIN subject s ON s.subject = p.subject ORDER BY f.path";
    let read = |row: &rusqlite::Row<'_>| {
        Ok((PathBuf::from(row.get::<_, String>(0)?), row.get::<_, String>(1)?, row.get::<_, bool>(2)?))
    };
    let mut files = study.index.rows("SELECT path, sha256, 0 FROM setup ORDER BY path", [], read)?;
    files.extend(study.index.rows(sql, [], read)?);
    let (mut defects, mut whole) = (Vec::new(), 0);
    let share_done = job.listener.begin("Checking files", "the check", Left::Nothing);
    for (number, (path, sha256, may_be_gone)) in files.iter().enumerate() {
        if job.is_stopped() {
            return Err(Error::Stopped("the check was stopped".into()));
        }
        match digest_bounded(&study.path(path), LARGEST_BYTES) {
            Ok(found) if found == *sha256 => whole += 1,
            Ok(_) if path == Path::new(CAMERA) => defects.push(format!(
                "{CAMERA}: it was changed since numbers were made by it; `fluorspar study analyze STUDY --missing` makes others by what it is now"
            )),
            Ok(_) => defects.push(format!("{}: its bytes were changed", path.display())),
            // What people who withdrew left may be removed
            Err(_) if *may_be_gone && !study.path(path).exists() => {}
            Err(error) => defects.push(error.to_string()),
        }
        share_done((number + 1) as f64 / files.len() as f64);
    }
    if study.index.dump()? != Index::in_memory(&study.log.entries)?.dump()? {
        defects.push(
            "the index says something else than the log; make it anew with `fluorspar study reindex`".into(),
        );
    }
    Ok(VerifiedStudy { lines: study.log.entries.len(), files: whole, defects })
}

/// Makes the index anew from the log, row for row.
///
/// # Errors
/// A log that was changed.
pub fn reindex(options: &StudyArgs, _: &Job) -> Result<VerifiedStudy> {
    let log = Study::log_of(&options.study)?;
    let index = Index::anew(&options.study, &log.entries)?;
    let files = index.rows("SELECT 1 FROM file", [], |row| row.get::<_, i64>(0))?.len();
    Ok(VerifiedStudy { lines: log.entries.len(), files, defects: Vec::new() })
}

/// Who withdraws.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct WithdrawOptions {
    /// The study.
    #[command(flatten)]
    #[serde(flatten)]
    pub args: StudyArgs,
    /// Pseudonym of the person.
    #[arg(value_name = "SUBJECT")]
    pub subject: String,
}

/// Takes a person out of all later norms and exports. What was photographed stays in the folder.
///
/// # Errors
/// A person whom the study does not have.
pub fn withdraw(options: &WithdrawOptions, job: &Job) -> Result<String> {
    let mut study = Study::open(&options.args.study)?;
    let subject = person(&study.index, &options.subject)?;
    let sql = "SELECT withdrawn FROM subject WHERE subject = ?";
    let known: Vec<bool> = study.index.rows(sql, [&subject], |row| row.get(0))?;
    if known.contains(&true) {
        return Ok(subject);
    }
    study.commit("withdraw", vec![Event::Withdrawal { subject: subject.clone() }])?;
    let folder = study.path(Path::new(&format!("sub-{subject}")));
    job.status(format!(
        "{subject} is in no later norm and no later export. Norms that were made before still hold the person: make them anew. The photographs are \
         in {} until you remove them",
        folder.display()
    ));
    Ok(subject)
}
