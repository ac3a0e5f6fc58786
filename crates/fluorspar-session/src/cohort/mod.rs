//! Many people in the views of an examination: what an analysis finds in each, and what that says of all.

mod examine;
mod measure;
mod outcome;

pub use outcome::CohortOutcome;

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::digest::sha256_hex;
use fluorspar::findings::PersonFinding;
use fluorspar_experiment::{CohortStudy, ExaminationView, keep_no_surfaces, parse_cohort};
use fluorspar_format::{Journal, OutputFolder};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use self::examine::{Examination, ExaminedView, each_view};
use self::measure::findings_of_view;
use self::outcome::room_bytes;
use crate::shard::{WorkShard, journal_beside, shards_beside};
use crate::values::{as_typed, sets};
use crate::{Changes, Error, ExperimentSource, Job, Result, warnings_before_run};

/// Which cohort is examined, and which part of it.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct CohortOptions {
    /// CohortStudy file (.toml): an experiment with a mouth and a section `[people]`. An experiment of the catalogue has 100 people in nine
    /// views [default: oraleye-2021].
    #[arg(value_name = "COHORT", value_hint = ValueHint::FilePath)]
    pub cohort: Option<String>,
    /// Part that is done, for one of several processes: I/N, or auto in a Slurm array. The same command without it, with the journals of
    /// all beside its folder, makes one result.
    #[arg(long, value_name = "I/N|auto")]
    pub shard: Option<WorkShard>,
    /// Changes by path.
    #[command(flatten)]
    #[serde(flatten)]
    pub changes: Changes,
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
    /// A part of the people, in its journal.
    Shard {
        /// Which part.
        shard: String,
        /// Views that are finished.
        views: usize,
        /// Its journal.
        journal: PathBuf,
    },
}

/// A view of a person.
type Place = (u32, String);

/// Renders, captures and analyzes every person of a cohort in every view, and says what is normal, how good the estimates are, and how
/// well lesions are told. Goes on where one that was stopped or killed ended: a view that is in the journal is not made again.
///
/// # Errors
/// A defect of the file; a view that can't be rendered or analyzed; files that can't be written; a job that is stopped.
pub fn cohort(options: &CohortOptions, job: &Job) -> Result<ExaminedCohort> {
    let source = ExperimentSource::find(options.cohort.as_deref())?;
    let overrides = options.changes.overrides();
    let cohort = parse_cohort(&source.text, &source.name, &source.base_dir, &sets(&overrides))
        .map_err(|error| as_typed(error, &overrides))?;
    let _passing = keep_no_surfaces();
    // The first view stands for all: what is wrong with the file or odd about it is known before the work
    let first = Examination::prepare(&cohort, cohort.people.first, cohort.views[0])
        .map_err(|error| Error::from(as_typed(error, &overrides)))?;
    job.warn(&warnings_before_run(&first.experiment));
    let record = &first.experiment.record;
    let names: Vec<&str> = cohort.views.iter().map(|view| view.name).collect();
    let people = json!([cohort.people.prevalence, cohort.people.first, names]).to_string();
    let sha256 = sha256_hex([record.sha256.clone(), people]);
    let folder = options.out.clone().unwrap_or_else(|| {
        let usual = format!("fluorspar-out/cohort-{}", source.stem);
        PathBuf::from(if overrides.is_empty() { usual } else { format!("{usual}-{}", &sha256[..8]) })
    });
    let head = json!({ "cohort_sha256": sha256, "version": env!("CARGO_PKG_VERSION") });
    let work = Work { cohort: &cohort, head, sha256: &sha256, folder: folder.clone() };
    if let Some(shard) = options.shard {
        let journal = shard.journal(&folder, &sha256);
        let views = work.finish(Some(shard), first, job)?.len();
        job.status(format!(
            "Shard {shard} is finished: {views} views in {}. When all are: the same command without ⟨shard⟩",
            journal.display()
        ));
        return Ok(ExaminedCohort::Shard { shard: shard.to_string(), views, journal });
    }
    let inputs = source.files(record);
    let place = OutputFolder::prepare(&folder, &inputs, room_bytes(&cohort))?;
    let found = work.finish(None, first, job)?;
    let findings: Vec<(u32, PersonFinding)> = found
        .into_iter()
        .flat_map(|((person, _), found)| found.into_iter().map(move |finding| (person, finding)))
        .collect();
    let outcome = CohortOutcome::of(cohort, &source, sha256.clone(), findings)?.write(place, job)?;
    Ok(ExaminedCohort::All(Box::new(outcome)))
}

/// The views of all people, and how they are kept in journals.
struct Work<'a> {
    cohort: &'a CohortStudy,
    head: Value,
    sha256: &'a str,
    folder: PathBuf,
}

impl Work<'_> {
    /// The findings of a line of a journal by its place; nothing of a line that is damaged.
    fn parse(entry: &Value) -> Option<(Place, Vec<PersonFinding>)> {
        let person = u32::try_from(entry.get("person")?.as_u64()?).ok()?;
        let view = entry.get("view")?.as_str()?.to_owned();
        Some(((person, view), Vec::deserialize(entry.get("findings")?).ok()?))
    }

    /// Examines what all journals lack of a part, and gives all of the part.
    fn finish(
        &self,
        shard: Option<WorkShard>,
        first: Examination,
        job: &Job,
    ) -> Result<BTreeMap<Place, Vec<PersonFinding>>> {
        let path = match shard {
            Some(shard) => shard.journal(&self.folder, self.sha256),
            None => journal_beside(&self.folder, self.sha256, ""),
        };
        let (mut journal, entries) = Journal::open(&path, &self.head)?;
        let mut done: BTreeMap<Place, Vec<PersonFinding>> = entries.iter().filter_map(Self::parse).collect();
        if shard.is_none() {
            for other in shards_beside(&self.folder, self.sha256) {
                let entries = Journal::read(&other.journal(&self.folder, self.sha256), &self.head)?;
                done.extend(entries.unwrap_or_default().iter().filter_map(Self::parse));
            }
        }
        let people =
            self.cohort.numbers().zip(0..).filter(|(_, place)| shard.is_none_or(|s| s.holds(*place)));
        let places = |(person, _): (u32, u64)| self.cohort.views.iter().map(move |view| (person, *view));
        let mine: Vec<(u32, &'static ExaminationView)> = people.flat_map(places).collect();
        let key = |(person, view): &(u32, &ExaminationView)| (*person, view.name.to_owned());
        let missing: Vec<(u32, &ExaminationView)> =
            mine.iter().filter(|place| !done.contains_key(&key(place))).copied().collect();
        if missing.len() < mine.len() {
            let (finished, all) = (mine.len() - missing.len(), mine.len());
            job.status(format!("{}: {finished} of {all} views are finished", path.display()));
        }
        each_view(self.cohort, &missing, first, job, |examined: &ExaminedView<'_>| {
            let findings = findings_of_view(self.cohort, examined)?;
            let entry =
                json!({ "person": examined.person, "view": examined.view.name, "findings": findings });
            journal.append(&entry)?;
            // What is kept and what is read again are the same to the last bit
            done.extend(Self::parse(&serde_json::from_str(&entry.to_string())?));
            Ok(())
        })?;
        let wanted: Vec<Place> = mine.iter().map(key).collect();
        done.retain(|place, _| wanted.contains(place));
        Ok(done)
    }
}
