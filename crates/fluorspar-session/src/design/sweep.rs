//! All designs of a problem, or a search among them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use fluorspar::design::{Score, exchange, score_all};
use fluorspar_format::{Journal, OutputFolder};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::outcome::{DesignOutcome, FOLDER_BYTES, Found};
use super::{Place, PreparedProblem, ProblemOptions, ReadProblem};
use crate::shard::{WorkShard, journal_beside, shards_beside};
use crate::values;
use crate::{Error, Job, Left, Result};

/// Designs of a line of the journal.
pub(super) const BLOCK: u64 = 256;

/// Most designs of a sweep: its journal has some 60 bytes for each.
const MOST_DESIGNS: u64 = 50_000_000;

/// Which problem is swept, and which part of it.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct SweepOptions {
    /// The problem.
    #[command(flatten)]
    #[serde(flatten)]
    pub problem: ProblemOptions,
    /// Part that is done, for one of several processes: I/N, or auto in a Slurm array. `design merge` makes one result of them.
    #[arg(long, value_name = "I/N|auto")]
    pub shard: Option<WorkShard>,
    /// Where results go.
    #[command(flatten)]
    #[serde(flatten)]
    pub place: Place,
}

/// Which problem is searched, and how.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct OptimizeOptions {
    /// The problem.
    #[command(flatten)]
    #[serde(flatten)]
    pub problem: ProblemOptions,
    /// Search by exchange even where all designs could be evaluated.
    #[arg(long)]
    pub exchange: bool,
    /// Where results go.
    #[command(flatten)]
    #[serde(flatten)]
    pub place: Place,
}

/// Which journals make one result.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct MergeOptions {
    /// The problem.
    #[command(flatten)]
    #[serde(flatten)]
    pub problem: ProblemOptions,
    /// Wait until the journals of all N shards are complete.
    #[arg(long, value_name = "N", value_parser = values::whole::<u64, 1, 100_000>, allow_negative_numbers = true)]
    pub wait_for: Option<u64>,
    /// Where results go.
    #[command(flatten)]
    #[serde(flatten)]
    pub place: Place,
}

/// Time between looks at the journals of other processes.
const LOOK_AGAIN: Duration = Duration::from_millis(500);

/// The designs of a problem in blocks, and how they are kept in a journal.
pub(super) struct Work<'a> {
    problem: &'a PreparedProblem,
    blocks: u64,
    pub(super) head: Value,
}

impl<'a> Work<'a> {
    pub(super) fn of(problem: &'a PreparedProblem) -> Result<Self> {
        let designs = problem.space.len();
        if designs > MOST_DESIGNS {
            return Err(Error::Input(format!(
                "{}: there are {designs} designs, more than {MOST_DESIGNS}; offer fewer choices, or search by `design optimize`",
                problem.source.name
            )));
        }
        let sha256 = &problem.resolved.record.sha256;
        let head = json!({ "design_sha256": sha256, "version": env!("CARGO_PKG_VERSION"), "designs": designs, "block": BLOCK });
        Ok(Self { problem, blocks: designs.div_ceil(BLOCK), head })
    }

    /// Scores of a line of the journal by its block; nothing of a line that is damaged.
    pub(super) fn parse(&self, entry: &Value) -> Option<(u64, Vec<Score>)> {
        let block = entry.get("block")?.as_u64().filter(|block| *block < self.blocks)?;
        let score = |value: &Value| {
            let number = |k: usize| value.get(k)?.as_f64();
            let loss = if value.get(0)?.is_null() { f64::INFINITY } else { number(0)? };
            Some(Score {
                loss,
                time_s: number(1)?,
                cost: number(2)?,
                exposures: value.get(3)?.as_u64()? as usize,
            })
        };
        let scores: Vec<Score> = entry.get("scores")?.as_array()?.iter().map(score).collect::<Option<_>>()?;
        let expected = BLOCK.min(self.problem.space.len() - block * BLOCK);
        (scores.len() as u64 == expected).then_some((block, scores))
    }

    fn entry(block: u64, scores: &[Score]) -> Value {
        // JSON has no infinity: a design that can't do it has no loss
        let row = |s: &Score| json!([s.loss.is_finite().then_some(s.loss), s.time_s, s.cost, s.exposures]);
        json!({ "block": block, "scores": scores.iter().map(row).collect::<Vec<Value>>() })
    }

    /// Evaluates what a journal lacks of a part, and gives all of the part.
    fn finish(&self, path: &Path, shard: Option<WorkShard>, job: &Job) -> Result<BTreeMap<u64, Vec<Score>>> {
        let (mut journal, entries) = Journal::open(path, &self.head)?;
        let mut done: BTreeMap<u64, Vec<Score>> =
            entries.iter().filter_map(|entry| self.parse(entry)).collect();
        let mine: Vec<u64> =
            (0..self.blocks).filter(|&block| shard.is_none_or(|shard| shard.holds(block))).collect();
        if !done.is_empty() {
            let [path, count] = [path.display().to_string(), mine.len().to_string()];
            job.status(match mine.iter().filter(|block| done.contains_key(block)).count() {
                all if all == mine.len() => format!("{path}: all designs are evaluated already"),
                finished => format!("{path}: {finished} of {count} blocks are finished, the rest follows"),
            });
        }
        let share_done = job.listener.begin("Evaluating designs", "the sweep", Left::Results);
        for (place, &block) in mine.iter().enumerate() {
            if done.contains_key(&block) {
                continue;
            }
            if job.is_stopped() {
                return Err(Error::Stopped(format!(
                    "stopped after {place} of {} blocks; the same command goes on from {}",
                    mine.len(),
                    path.display()
                )));
            }
            let last = ((block + 1) * BLOCK).min(self.problem.space.len());
            let scores = score_all(&self.problem.space, block * BLOCK..last);
            journal.append(&Self::entry(block, &scores))?;
            done.insert(block, scores);
            share_done((place + 1) as f64 / mine.len() as f64);
        }
        Ok(done)
    }
}

/// Scores of all designs in the order of their numbers.
fn in_order(blocks: BTreeMap<u64, Vec<Score>>, action: &'static str) -> Found {
    let scores = blocks.into_values().flatten().enumerate();
    Found {
        scores: scores.map(|(number, score)| (number as u64, score)).collect(),
        search: "all designs".into(),
        action,
    }
}

/// The folder of a place, refused before the work if it can't be written, and the folder around it for the journal.
fn checked_folder(problem: &ReadProblem, place: &Place) -> Result<(PathBuf, OutputFolder)> {
    let shown = problem.folder(place);
    let folder = OutputFolder::prepare(&shown, &problem.inputs(), FOLDER_BYTES)?;
    Ok((shown, folder))
}

/// What a sweep found.
#[derive(Serialize)]
#[serde(untagged)]
pub enum Sweep {
    /// The best of all designs.
    All(Box<DesignOutcome>),
    /// A part of the designs, in its journal.
    Shard {
        /// Which part.
        shard: String,
        /// Blocks of designs in it.
        blocks: usize,
        /// Its journal.
        journal: PathBuf,
    },
}

/// Evaluates all designs of a problem, or a part of them; goes on where one that was stopped ended.
///
/// # Errors
/// A defect of the file; scenes that can't be rendered; files that can't be written.
pub fn sweep(options: &SweepOptions, job: &Job) -> Result<Sweep> {
    let problem = options.problem.read(job)?;
    let (shown, folder) = checked_folder(&problem, &options.place)?;
    let problem = problem.prepare(job)?;
    let sha256 = &problem.resolved.record.sha256;
    let Some(shard) = options.shard else {
        let scores = Work::of(&problem)?.finish(&journal_beside(&shown, sha256, ""), None, job)?;
        let outcome = DesignOutcome::of(problem, in_order(scores, "sweep"))?.write(folder, job)?;
        return Ok(Sweep::All(Box::new(outcome)));
    };
    let journal = shard.journal(&shown, sha256);
    let blocks = Work::of(&problem)?.finish(&journal, Some(shard), job)?.len();
    job.status(format!(
        "Shard {shard} is finished: {blocks} blocks in {}. When all are: fluorspar design merge",
        journal.display()
    ));
    Ok(Sweep::Shard { shard: shard.to_string(), blocks, journal })
}

/// Finds the best design: of all where that is possible, otherwise by exchange of one choice at a time.
///
/// # Errors
/// As [`sweep`].
pub fn optimize(options: &OptimizeOptions, job: &Job) -> Result<DesignOutcome> {
    let problem = options.problem.read(job)?;
    let (shown, folder) = checked_folder(&problem, &options.place)?;
    let problem = problem.prepare(job)?;
    let search = &problem.resolved.search;
    let found = if options.exchange || problem.space.len() > search.most_exhaustive {
        let most = usize::try_from(search.evaluations).unwrap_or(usize::MAX);
        let result = exchange(&problem.space, search.seed, most);
        let text = format!(
            "exchange, {} of {} designs evaluated from {} starts, seed {}",
            result.evaluated.len(),
            problem.space.len(),
            result.restarts,
            search.seed
        );
        Found { scores: result.evaluated, search: text, action: "optimize" }
    } else {
        let journal = journal_beside(&shown, &problem.resolved.record.sha256, "");
        in_order(Work::of(&problem)?.finish(&journal, None, job)?, "optimize")
    };
    DesignOutcome::of(problem, found)?.write(folder, job)
}

/// Makes one result of the journals of several shards.
///
/// # Errors
/// As [`sweep`]; journals that are not complete, unless they are waited for.
pub fn merge(options: &MergeOptions, job: &Job) -> Result<DesignOutcome> {
    let problem = options.problem.read(job)?;
    let (shown, folder) = checked_folder(&problem, &options.place)?;
    let problem = problem.prepare(job)?;
    let work = Work::of(&problem)?;
    let sha256 = &problem.resolved.record.sha256;
    let shards = match options.wait_for {
        Some(shards) => shards,
        None => number_of_shards(&shown, sha256)?,
    };
    let mut waiting = false;
    loop {
        let mut blocks: BTreeMap<u64, Vec<Score>> = BTreeMap::new();
        for number in 1..=shards {
            let journal = WorkShard { number, of: shards }.journal(&shown, sha256);
            let entries = Journal::read(&journal, &work.head)?.unwrap_or_default();
            blocks.extend(entries.iter().filter_map(|entry| work.parse(entry)));
        }
        let missing = work.blocks - blocks.len() as u64;
        if missing == 0 {
            return DesignOutcome::of(problem, in_order(blocks, "sweep"))?.write(folder, job);
        }
        if options.wait_for.is_none() {
            return Err(Error::Input(format!(
                "{missing} of {} blocks are missing in the journals of {shards} shards beside {}; finish the shards, or wait for \
                 them with ⟨wait_for={shards}⟩",
                work.blocks,
                shown.display()
            )));
        }
        if !waiting {
            job.status(format!("Waiting for {missing} of {} blocks of {shards} shards", work.blocks));
            waiting = true;
        }
        std::thread::sleep(LOOK_AGAIN);
    }
}

/// Number of shards by the names of the journals of a problem beside a folder.
fn number_of_shards(folder: &Path, sha256: &str) -> Result<u64> {
    let found = shards_beside(folder, sha256).last().map(|shard| shard.of);
    found.ok_or_else(|| {
        Error::Input(format!(
            "there is no journal of a shard of this problem beside {}; run `fluorspar design sweep --shard I/N` with the same ⟨out⟩ first",
            folder.display()
        ))
    })
}
