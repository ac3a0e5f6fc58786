//! A search that was made, opened from its folder: to look at one design after the other. Nothing is searched again.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use fluorspar::design::{DesignSpace, Score};
use fluorspar_format::{Journal, read_bounded};
use fluorspar_report::{JudgedDesign, Section, design_sections};
use serde::{Deserialize, Serialize};

use super::outcome::{compared, criterion_text, estimate, judged};
use super::sweep::{BLOCK, Work};
use super::{PreparedProblem, ProblemOptions};
use crate::shard::{journal_beside, shards_beside};
use crate::{Changes, Error, Job, Result};

/// Largest results that are read, bytes.
const LARGEST_BYTES: u64 = 1 << 30;

/// Designs that are told, at most: of more, the ones that are told apart and even steps through the others.
const MOST_TOLD: usize = 4000;

/// What of `results.json` is needed.
#[derive(Deserialize)]
struct Results {
    search: String,
    #[serde(default)]
    left_out: Option<String>,
    recommended: Option<u64>,
    best: Vec<Numbered>,
    pareto_front: Vec<Numbered>,
}

#[derive(Deserialize)]
struct Numbered {
    number: Option<u64>,
}

/// A design of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum DesignKey {
    /// By its number.
    Number(u64),
    /// By its place among those that the file names to compare with.
    Compared(usize),
}

/// A design as a dot.
#[derive(Clone, Debug, Serialize)]
pub struct ToldDesign {
    /// Which one.
    pub key: DesignKey,
    /// Its name.
    pub name: String,
    /// What designs are ranked by; less is better.
    pub loss: f64,
    /// All exposures, ms.
    pub time_ms: f64,
    /// Price.
    pub price: f64,
    /// Number of exposures.
    pub exposures: usize,
    /// Whether it is one of the best.
    pub is_best: bool,
    /// Whether no other beats it in everything.
    pub is_front: bool,
}

/// The designs of a search that was made.
pub struct FoundDesigns {
    /// The problem.
    pub problem: PreparedProblem,
    /// How designs were chosen, in words.
    pub search: String,
    /// Why some have no loss, in words; empty where all have one.
    pub left_out: String,
    /// Which designs are told, in words.
    pub drawn: String,
    /// The design that is recommended.
    pub recommended: Option<DesignKey>,
    /// Designs that see what is asked for: by loss.
    pub told: Vec<ToldDesign>,
}

impl FoundDesigns {
    /// Whether a folder holds what `design sweep` or `design optimize` wrote.
    pub fn is_in(folder: &Path) -> bool {
        folder.join("designs.jsonl").is_file() && folder.join("results.json").is_file()
    }

    /// Opens the folder of a search.
    ///
    /// # Errors
    /// A folder that lacks a part or was damaged; scenes that can't be rendered.
    pub fn open(folder: &Path, job: &Job) -> Result<Self> {
        let path = folder.join("results.json");
        let results: Results = serde_json::from_slice(&read_bounded(&path, LARGEST_BYTES)?)
            .map_err(|error| Error::Input(format!("{}: {error}; search again into it", path.display())))?;
        let design = Some(folder.join("report.html").display().to_string());
        let options = ProblemOptions { design, renders: None, changes: Changes::default() };
        let problem = options.read(job)?.prepare(job)?;
        // Each is judged: a damaged list would be worked on without end
        let (named, keep) =
            (results.best.len().max(results.pareto_front.len()), problem.resolved.search.keep);
        if named > keep as usize {
            return Err(Error::Input(format!(
                "{}: it names {named} designs, and its search kept at most {keep}; search again into it",
                path.display()
            )));
        }
        let scores = scores_beside(folder, &problem);
        let numbers =
            |list: &[Numbered]| list.iter().filter_map(|design| design.number).collect::<Vec<u64>>();
        let (best, front) = (numbers(&results.best), numbers(&results.pareto_front));
        let told = told(&problem.space, &scores, &best, &front);
        let drawn = drawn(&scores, problem.space.len(), told.len());
        let compared = compared(&problem)?;
        let seen = compared.iter().enumerate().filter(|(_, judged)| judged.merits.loss.is_finite());
        let beside = seen.map(|(place, judged)| of_judged(DesignKey::Compared(place), judged));
        let mut told: Vec<ToldDesign> = told.into_iter().chain(beside).collect();
        told.sort_by(|a, b| a.loss.total_cmp(&b.loss));
        let recommended = results.recommended.or(best.first().copied()).map(DesignKey::Number);
        let (search, left_out) = (results.search, results.left_out.unwrap_or_default());
        Ok(Self { problem, search, left_out, drawn, recommended, told })
    }

    /// What designs are ranked by, in words.
    pub fn criterion(&self) -> String {
        criterion_text(&self.problem.space)
    }

    /// The designs that the file names, by their names.
    pub fn compared(&self) -> impl Iterator<Item = &str> {
        self.problem.resolved.compared.iter().map(|compared| compared.name.as_str())
    }

    /// What a page says of designs, the first of them in full.
    ///
    /// # Errors
    /// A design that there is not.
    pub fn sections(&self, keys: &[DesignKey]) -> Result<Vec<Section>> {
        let designs: Vec<JudgedDesign> = keys.iter().map(|key| self.judge(*key)).collect::<Result<_>>()?;
        Ok(design_sections(&self.problem.space, &designs.iter().collect::<Vec<_>>()))
    }

    fn judge(&self, key: DesignKey) -> Result<JudgedDesign> {
        let space = &self.problem.space;
        let compared = &self.problem.resolved.compared;
        let (name, design) = match key {
            DesignKey::Number(number) if number < space.len() => {
                let design = space.design(number);
                (space.describe(&design), design)
            }
            DesignKey::Compared(place) if place < compared.len() => {
                (compared[place].name.clone(), compared[place].design.clone())
            }
            _ => {
                let last = space.len().saturating_sub(1);
                let count = compared.len();
                return Err(Error::Input(format!(
                    "there is no such design; give a number from 0 to {last}, or one of the {count} that the file compares"
                )));
            }
        };
        let mut judged = judged(space, name, design);
        estimate(&self.problem, &mut judged)?;
        Ok(judged)
    }
}

/// Scores in the journals beside a folder, by number; none where they are gone, or of another version.
fn scores_beside(folder: &Path, problem: &PreparedProblem) -> BTreeMap<u64, Score> {
    let Ok(work) = Work::of(problem) else { return BTreeMap::new() };
    let sha256 = &problem.resolved.record.sha256;
    let shards = shards_beside(folder, sha256).into_iter().map(|shard| shard.journal(folder, sha256));
    let paths: Vec<PathBuf> = std::iter::once(journal_beside(folder, sha256, "")).chain(shards).collect();
    let read = |path: &PathBuf| Journal::read(path, &work.head).ok().flatten().unwrap_or_default();
    let entries = paths.iter().flat_map(read);
    let blocks: BTreeMap<u64, Vec<Score>> = entries.filter_map(|entry| work.parse(&entry)).collect();
    let numbered = |(block, scores): (u64, Vec<Score>)| (block * BLOCK..).zip(scores);
    blocks.into_iter().flat_map(numbered).collect()
}

/// Which designs are told, as a sentence.
fn drawn(scores: &BTreeMap<u64, Score>, all: u64, told: usize) -> String {
    let seen = scores.values().filter(|score| score.loss.is_finite()).count();
    match (scores.len(), seen) {
        (0, _) => "Drawn are the best, the front and those compared: the search kept no others.".into(),
        (_, seen) if seen > told => format!("Drawn are {told} of {seen} designs, in even steps by loss."),
        (scored, _) if (scored as u64) < all => {
            format!("Drawn are {seen} designs of the {scored} whose scores were kept, of {all}.")
        }
        _ => format!("Drawn are all {seen} designs that keep to all limits."),
    }
}

/// The designs that are told: those that are told apart, and others in even steps by loss.
fn told(space: &DesignSpace, scores: &BTreeMap<u64, Score>, best: &[u64], front: &[u64]) -> Vec<ToldDesign> {
    let mut seen: Vec<(u64, f64)> = scores.iter().map(|(number, score)| (*number, score.loss)).collect();
    seen.retain(|(_, loss)| loss.is_finite());
    seen.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    let step = seen.len().div_ceil(MOST_TOLD).max(1);
    let stepped = seen.iter().step_by(step).map(|(number, _)| *number);
    let numbers: BTreeSet<u64> =
        stepped.chain(best.iter().chain(front).copied()).filter(|number| *number < space.len()).collect();
    let of = |number: u64| {
        let design = space.design(number);
        let name = space.describe(&design);
        let key = DesignKey::Number(number);
        let told = match scores.get(&number) {
            Some(score) => of_score(key, name, score),
            None => of_judged(key, &judged(space, name, design)),
        };
        ToldDesign { is_best: best.contains(&number), is_front: front.contains(&number), ..told }
    };
    numbers.into_iter().map(of).collect()
}

fn of_judged(key: DesignKey, judged: &JudgedDesign) -> ToldDesign {
    let merits = &judged.merits;
    let (loss, time_s, cost, exposures) =
        (merits.loss, merits.time_s, merits.cost, judged.design.lights.len());
    of_score(key, judged.name.clone(), &Score { loss, time_s, cost, exposures })
}

fn of_score(key: DesignKey, name: String, score: &Score) -> ToldDesign {
    let Score { loss, time_s, cost, exposures } = *score;
    ToldDesign {
        key,
        name,
        loss,
        time_ms: 1e3 * time_s,
        price: cost,
        exposures,
        is_best: false,
        is_front: false,
    }
}
