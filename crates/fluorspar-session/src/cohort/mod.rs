//! Many people in the views of an examination: what an analysis finds in each, and what that says of all.

mod examine;
mod measure;
mod outcome;
mod work;

pub(crate) use examine::ExaminedView;
pub use outcome::CohortOutcome;
pub use work::{CohortArgs, FinishedShard};
pub(crate) use work::{CohortWork, Place};

use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::findings::PersonFinding;
use fluorspar_experiment::keep_no_surfaces;
use fluorspar_format::OutputFolder;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use self::measure::findings_of_view;
use self::outcome::room_bytes;
use crate::{Job, Result};

/// Which cohort is examined, and where the results go.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct CohortOptions {
    /// The cohort.
    #[command(flatten)]
    #[serde(flatten)]
    pub people: CohortArgs,
    /// Folder for report.html, cohort.csv, ranges.csv, people.csv, results.json and figures [default: fluorspar-out/cohort-NAME; with --set
    /// or --unset fluorspar-out/cohort-NAME-DIGEST]. The journal of the work lies beside it.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// What an examination of a cohort gave.
#[derive(Serialize)]
#[serde(untagged)]
pub enum ExaminedCohort {
    /// What is found in all people.
    All(Box<CohortOutcome>),
    /// A part of the people.
    Shard(FinishedShard),
}

/// Renders, captures and analyzes every person of a cohort in every view, and says what is normal, how good the estimates are, and how
/// well lesions are told. Goes on where one that was stopped or killed ended: a view that is in the journal is not made again.
///
/// # Errors
/// A defect of the file; a view that can't be rendered or analyzed; files that can't be written; a job that is stopped.
pub fn cohort(options: &CohortOptions, job: &Job) -> Result<ExaminedCohort> {
    let _passing = keep_no_surfaces();
    let (work, first) = CohortWork::prepare(&options.people, options.out.as_deref(), "cohort", job)?;
    let inputs = work.source.files(&first.experiment.record);
    let read = |entry: &Value| Vec::<PersonFinding>::deserialize(entry.get("findings")?).ok();
    let make =
        |examined: &ExaminedView<'_>| Ok(json!({ "findings": findings_of_view(&work.cohort, examined)? }));
    let shard = options.people.shard;
    if let Some(shard) = shard {
        let views = work.finish(Some(shard), first, job, read, make)?.len();
        return Ok(ExaminedCohort::Shard(work.finished_shard(shard, views, job)));
    }
    let place = OutputFolder::prepare(&work.folder, &inputs, room_bytes(&work.cohort))?;
    let found = work.finish(None, first, job, read, make)?;
    let findings: Vec<(u32, PersonFinding)> = found
        .into_iter()
        .flat_map(|((person, _), found)| found.into_iter().map(move |finding| (person, finding)))
        .collect();
    let outcome = CohortOutcome::of(&work, findings)?.write(&work, place, job)?;
    Ok(ExaminedCohort::All(Box::new(outcome)))
}
