//! Checks and repairs: every file, the log, the index; and people who withdraw.

use std::path::{Path, PathBuf};

use fluorspar_format::digest_bounded;
use fluorspar_session::{Error, Job, Left, Result};
use serde::{Deserialize, Serialize};

use crate::event::Event;
use crate::index::Index;
use crate::store::{LARGEST_BYTES, Study, StudyArgs};

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
    let files: Vec<(PathBuf, String)> =
        study.index.rows("SELECT path, sha256 FROM file ORDER BY path", [], |row| {
            Ok((PathBuf::from(row.get::<_, String>(0)?), row.get(1)?))
        })?;
    let mut defects = Vec::new();
    let share_done = job.listener.begin("Checking files", "the check", Left::Nothing);
    for (number, (path, sha256)) in files.iter().enumerate() {
        if job.is_stopped() {
            return Err(Error::Stopped("the check was stopped".into()));
        }
        match digest_bounded(&study.path(path), LARGEST_BYTES) {
            Ok(found) if found == *sha256 => {}
            Ok(_) => defects.push(format!("{}: its bytes were changed", path.display())),
            Err(error) => defects.push(error.to_string()),
        }
        share_done((number + 1) as f64 / files.len() as f64);
    }
    if study.index.dump()? != Index::in_memory(&study.log.entries)?.dump()? {
        defects.push(
            "the index says something else than the log; make it anew with `fluorspar study reindex`".into(),
        );
    }
    Ok(VerifiedStudy {
        lines: study.log.entries.len(),
        files: files.len() - defects.len().min(files.len()),
        defects,
    })
}

/// Makes the index anew from the log, row for row.
///
/// # Errors
/// A log that was changed.
pub fn reindex(options: &StudyArgs, _: &Job) -> Result<VerifiedStudy> {
    let study = Study::open(&options.study)?;
    let index = Index::anew(&study.folder, &study.log.entries)?;
    let files = index.rows("SELECT 1 FROM file", [], |row| row.get::<_, i64>(0))?.len();
    Ok(VerifiedStudy { lines: study.log.entries.len(), files, defects: Vec::new() })
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
    let subject = options.subject.clone();
    let sql = "SELECT withdrawn FROM subject WHERE subject = ?";
    let known: Vec<bool> = study.index.rows(sql, [&subject], |row| row.get(0))?;
    match known.first() {
        None => return Err(Error::Input(format!("the study has no person {subject}"))),
        Some(true) => return Ok(subject),
        Some(false) => study.commit("withdraw", vec![Event::Withdrawal { subject: subject.clone() }])?,
    }
    let folder = study.path(Path::new(&format!("sub-{subject}")));
    job.status(format!(
        "{subject} is in no later norm and no later export. Norms that were made before still hold the person: make them anew. The photographs are \
         in {} until you remove them",
        folder.display()
    ));
    Ok(subject)
}
