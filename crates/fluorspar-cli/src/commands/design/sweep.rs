//! All designs of a problem, or a search among them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

use fluorspar::design::{Score, exchange, score_all};
use fluorspar_format::{Journal, OutputFolder};
use fluorspar_session::Left;
use serde_json::{Value, json};

use super::outcome::{FOLDER_BYTES, Found, Outcome};
use super::shard::{SweepShard, journal_beside};
use super::{Place, Problem, ProblemArgs, ReadProblem};
use crate::args::Answer;
use crate::error::CliError;
use crate::interrupt::{save_when_interrupted, stop_flag};
use crate::message::Messages;
use crate::progress::WorkReport;
use crate::values;

/// Designs of a line of the journal.
const BLOCK: u64 = 256;

/// Most designs of a sweep: its journal has some 60 bytes for each.
const MOST_DESIGNS: u64 = 50_000_000;

/// Options of `design sweep`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct SweepOptions {
    #[command(flatten)]
    problem: ProblemArgs,
    /// Part that is done, for one of several processes: I/N, or auto in a Slurm array. `design merge` makes one result of them.
    #[arg(long, value_name = "I/N|auto")]
    shard: Option<SweepShard>,
    #[command(flatten)]
    place: Place,
    #[command(flatten)]
    answer: Answer,
}

/// Options of `design optimize`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct OptimizeOptions {
    #[command(flatten)]
    problem: ProblemArgs,
    /// Search by exchange even where all designs could be evaluated.
    #[arg(long)]
    exchange: bool,
    #[command(flatten)]
    place: Place,
    #[command(flatten)]
    answer: Answer,
}

/// Options of `design merge`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct MergeOptions {
    #[command(flatten)]
    problem: ProblemArgs,
    /// Wait until the journals of all N shards are complete.
    #[arg(long, value_name = "N", value_parser = values::whole::<u64, 1, 100_000>, allow_negative_numbers = true)]
    wait_for: Option<u64>,
    #[command(flatten)]
    place: Place,
    #[command(flatten)]
    answer: Answer,
}

/// Time between looks at the journals of other processes.
const LOOK_AGAIN: Duration = Duration::from_millis(500);

/// The designs of a problem in blocks, and how they are kept in a journal.
struct Work<'a> {
    problem: &'a Problem,
    blocks: u64,
    head: Value,
}

impl<'a> Work<'a> {
    fn of(problem: &'a Problem) -> Result<Self, CliError> {
        let designs = problem.space.len();
        if designs > MOST_DESIGNS {
            return Err(CliError::Input(format!(
                "{}: there are {designs} designs, more than {MOST_DESIGNS}; offer fewer choices, or search by `design optimize`",
                problem.source.name
            )));
        }
        let sha256 = &problem.resolved.record.sha256;
        let head = json!({ "design_sha256": sha256, "version": env!("CARGO_PKG_VERSION"), "designs": designs, "block": BLOCK });
        Ok(Self { problem, blocks: designs.div_ceil(BLOCK), head })
    }

    /// Scores of a line of the journal by its block; nothing of a line that is damaged.
    fn parse(&self, entry: &Value) -> Option<(u64, Vec<Score>)> {
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
    fn finish(
        &self,
        path: &Path,
        shard: Option<SweepShard>,
        messages: Messages,
    ) -> Result<BTreeMap<u64, Vec<Score>>, CliError> {
        let (mut journal, entries) = Journal::open(path, &self.head)?;
        let mut done: BTreeMap<u64, Vec<Score>> =
            entries.iter().filter_map(|entry| self.parse(entry)).collect();
        let mine: Vec<u64> =
            (0..self.blocks).filter(|&block| shard.is_none_or(|shard| shard.holds(block))).collect();
        if !done.is_empty() {
            let [path, count] = [path.display().to_string(), mine.len().to_string()];
            messages.status(match mine.iter().filter(|block| done.contains_key(block)).count() {
                all if all == mine.len() => format!("{path}: all designs are evaluated already"),
                finished => format!("{path}: {finished} of {count} blocks are finished, the rest follows"),
            });
        }
        save_when_interrupted(Left::Results);
        let progress = WorkReport::begin("Evaluating designs", "the sweep", messages);
        for (place, &block) in mine.iter().enumerate() {
            if done.contains_key(&block) {
                continue;
            }
            if stop_flag().load(Ordering::SeqCst) {
                return Err(CliError::Stopped(format!(
                    "stopped after {place} of {} blocks; the same command goes on from {}",
                    mine.len(),
                    path.display()
                )));
            }
            let last = ((block + 1) * BLOCK).min(self.problem.space.len());
            let scores = score_all(&self.problem.space, block * BLOCK..last);
            journal.append(&Self::entry(block, &scores))?;
            done.insert(block, scores);
            progress.share_done((place + 1) as f64 / mine.len() as f64);
        }
        progress.end();
        save_when_interrupted(Left::Nothing);
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
fn checked_folder(problem: &ReadProblem, place: &Place) -> Result<(PathBuf, OutputFolder), CliError> {
    let shown = problem.folder(place);
    let folder = OutputFolder::prepare(&shown, &problem.inputs(), FOLDER_BYTES)?;
    Ok((shown, folder))
}

pub(super) fn sweep(options: &SweepOptions) -> Result<(), CliError> {
    let problem = options.problem.read()?;
    let messages = Messages::default();
    let (shown, folder) = checked_folder(&problem, &options.place)?;
    let problem = problem.prepare()?;
    let work = Work::of(&problem)?;
    let Some(shard) = options.shard else {
        let found = in_order(
            work.finish(&journal_beside(&shown, &problem.resolved.record.sha256, ""), None, messages)?,
            "sweep",
        );
        return Outcome::of(&problem, found)?.write(&problem, folder, &options.answer);
    };
    let journal = shard.journal(&shown, &problem.resolved.record.sha256);
    let blocks = work.finish(&journal, Some(shard), messages)?.len();
    messages.status(format!(
        "Shard {shard} is finished: {blocks} blocks in {}. When all are: fluorspar design merge",
        journal.display()
    ));
    if options.answer.json {
        super::super::print_json(
            &json!({ "shard": shard.to_string(), "blocks": blocks, "journal": journal }),
        )?;
    }
    Ok(())
}

pub(super) fn optimize(options: &OptimizeOptions) -> Result<(), CliError> {
    let problem = options.problem.read()?;
    let messages = Messages::default();
    let (shown, folder) = checked_folder(&problem, &options.place)?;
    let problem = problem.prepare()?;
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
        in_order(
            Work::of(&problem)?.finish(
                &journal_beside(&shown, &problem.resolved.record.sha256, ""),
                None,
                messages,
            )?,
            "optimize",
        )
    };
    Outcome::of(&problem, found)?.write(&problem, folder, &options.answer)
}

pub(super) fn merge(options: &MergeOptions) -> Result<(), CliError> {
    let problem = options.problem.read()?;
    let messages = Messages::default();
    let (shown, folder) = checked_folder(&problem, &options.place)?;
    let problem = problem.prepare()?;
    let work = Work::of(&problem)?;
    let sha256 = &problem.resolved.record.sha256;
    let shards = match options.wait_for {
        Some(shards) => shards,
        None => shards_beside(&shown, sha256)?,
    };
    let mut waiting = false;
    loop {
        let mut blocks: BTreeMap<u64, Vec<Score>> = BTreeMap::new();
        for number in 1..=shards {
            let journal = SweepShard { number, of: shards }.journal(&shown, sha256);
            let entries = Journal::read(&journal, &work.head)?.unwrap_or_default();
            blocks.extend(entries.iter().filter_map(|entry| work.parse(entry)));
        }
        let missing = work.blocks - blocks.len() as u64;
        if missing == 0 {
            return Outcome::of(&problem, in_order(blocks, "sweep"))?.write(
                &problem,
                folder,
                &options.answer,
            );
        }
        if options.wait_for.is_none() {
            return Err(CliError::Input(format!(
                "{missing} of {} blocks are missing in the journals of {shards} shards beside {}; finish the shards, or wait for \
                 them with --wait-for {shards}",
                work.blocks,
                shown.display()
            )));
        }
        if !waiting {
            messages.status(format!("Waiting for {missing} of {} blocks of {shards} shards", work.blocks));
            waiting = true;
        }
        std::thread::sleep(LOOK_AGAIN);
    }
}

/// Number of shards by the names of the journals of a problem beside a folder.
fn shards_beside(folder: &Path, sha256: &str) -> Result<u64, CliError> {
    let around = folder.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let start = format!("{}.{}.", folder.file_name().unwrap_or_default().to_string_lossy(), &sha256[..8]);
    let of = |name: &str| -> Option<u64> {
        let part = name.strip_prefix(&start)?.strip_suffix(".journal")?;
        part.split_once("-of-")?.1.parse().ok()
    };
    let entries = std::fs::read_dir(around).into_iter().flatten().flatten();
    let found = entries.filter_map(|entry| of(&entry.file_name().to_string_lossy())).max();
    found.ok_or_else(|| {
        CliError::Input(format!(
            "there is no journal of a shard of this problem beside {}; run `fluorspar design sweep --shard I/N` with the same --out first",
            folder.display()
        ))
    })
}
