//! People against norms.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::analysis::{NormPerson, NormPlace, RocArea, Standing, group_size_for_area};
use fluorspar::findings::FindingId;
use fluorspar::units::counted;
use fluorspar_format::{Output, Outputs};
use fluorspar_report::{HeldNumber, HeldNumbers, norm_report, warnings_by_kind};
use fluorspar_session::{Error, ExperimentSource, Job, Result, camera_digest};
use serde::{Deserialize, Serialize};

use crate::event::Event;
use crate::index::Index;
use crate::norm::{NormFile, NormOptions, outcomes, people_of, read_norm, widened_by, wrong};
use crate::query::{QueriedRow, QueryOptions, person as known_person, rows, warnings_of};
use crate::store::{CAMERA, Study, StudyArgs, write};

/// Half width of the interval of an area that a study should reach.
const WANTED_HALF_WIDTH: f64 = 0.05;

/// Who is held against what.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct AgainstNormOptions {
    /// The study.
    #[command(flatten)]
    #[serde(flatten)]
    pub args: StudyArgs,
    /// Norm that `fluorspar study norm` wrote. May be repeated, for instance with one of simulated people.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, required = true)]
    pub norm: Vec<PathBuf>,
    /// Person whose numbers alone are taken.
    #[arg(long, value_name = "NAME")]
    pub subject: Option<String>,
    /// File for a page (.html): who is outside, how sure that is, and a figure.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub out: Option<PathBuf>,
}

/// A number of a person against a norm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PersonAgainstNorm {
    /// The pseudonym.
    pub subject: String,
    /// The visit.
    pub session: String,
    /// Name of the region.
    pub region: String,
    /// The number.
    pub quantity: String,
    /// The value; `None` where there is an upper limit only.
    pub value: Option<f64>,
    /// Its interval; of a number without one the value twice.
    pub interval: [f64; 2],
    /// Whether the error of the number itself is in the interval.
    pub has_error: bool,
    /// `measured` or `simulated`, of the norm.
    pub norm: String,
    /// Where the person stands.
    #[serde(flatten)]
    pub place: NormPlace,
}

/// People against norms.
#[derive(Clone, Debug, Serialize)]
pub struct ComparedPeople {
    /// Every number.
    pub people: Vec<PersonAgainstNorm>,
    /// Numbers that can't be held against a norm, and why.
    pub left_out: Vec<String>,
    /// How well each number tells people with a lesion from those without, where outcomes are known of two of each: the area under the ROC
    /// curve with its error after DeLong.
    pub separations: Vec<Separation>,
}

/// How well a number tells people with a lesion.
#[derive(Clone, Debug, Serialize)]
pub struct Separation {
    /// Name of the region, and the number.
    pub of: [String; 2],
    /// Whether smaller numbers mean the lesion.
    pub is_lower: bool,
    /// The area.
    pub area: RocArea,
    /// People in each of two groups who give it to 0.05.
    pub group_size: Option<u64>,
}

/// Holds people against norms; those whom a norm holds itself, against the others of it.
///
/// # Errors
/// A study or a norm that can't be read.
pub fn compare(options: &AgainstNormOptions, job: &Job) -> Result<ComparedPeople> {
    let set = options
        .out
        .as_deref()
        .map(|out| Outputs::new().and(Output::file("--out", out)).reading(&options.norm).declare())
        .transpose()?;
    let (index, _) = Study::asked(&options.args.study)?;
    let subject = options.subject.as_deref().map(|written| known_person(&index, written)).transpose()?;
    let mut compared = ComparedPeople { people: Vec::new(), left_out: Vec::new(), separations: Vec::new() };
    let (mut held_numbers, mut warnings, mut doubts) = (Vec::new(), Vec::new(), Vec::new());
    for path in &options.norm {
        let mut norm = read_norm(path)?;
        warnings.extend(of_camera_of(&options.args.study, &mut norm, path)?.map(Into::into));
        let (first, mut outside) = (compared.people.len(), BTreeSet::new());
        let fitted = norm.fit()?;
        let held = people_in(options, &index, &norm)?;
        warn_of_withdrawn(&index, held.keys(), path, job)?;
        let mut of_others = BTreeMap::new();
        let query = QueryOptions {
            subject: subject.clone(),
            region: (norm.origin == "measured").then(|| norm.region.clone()),
            quantity: Some(norm.quantity.clone()),
            ..QueryOptions::default()
        };
        let own =
            rows(&index, &query)?.into_iter().filter(|row| !row.withdrawn && row.channel == norm.channel);
        for row in own.filter(|row| region_of(&norm, &row.region)) {
            let others = held.get(&row.subject).map(|own| {
                of_others
                    .entry(row.subject.clone())
                    .or_insert_with(|| norm.sums.without(own).fit_of_others())
                    .as_ref()
            });
            let fitted = others.unwrap_or(Ok(&fitted));
            match fitted.map_err(wrong).and_then(|fitted| person(&norm, fitted, &row)) {
                Ok(person) => {
                    if person.place.standing == Standing::Outside && held.contains_key(&row.subject) {
                        outside.insert(row.subject.clone());
                    }
                    if options.out.is_some() {
                        doubts.push(warnings_of(&index, &row)?);
                    }
                    compared.people.push(person);
                }
                Err(why) => compared.left_out.push(format!("{}, visit {}: {why}", row.subject, row.session)),
            }
        }
        let outside: Vec<String> = outside.into_iter().collect();
        warnings.extend(widened_by(&outside, norm.sums.people() as usize).map(Into::into));
        held_numbers.extend(held_against(&norm, &compared.people[first..]));
        compared.separations.extend(separation(&index, &norm)?);
    }
    job.warn(&warnings);
    warnings.extend(warnings_by_kind(&doubts));
    if let (Some(out), Some(set)) = (&options.out, set) {
        let study = options.args.study.canonicalize().unwrap_or_else(|_| options.args.study.clone());
        let name = study.file_name().unwrap_or_default().to_string_lossy();
        write(out, norm_report(&name, &held_numbers, &compared.left_out, warnings).to_html().as_bytes())?;
        set.finish()?;
        job.status(format!("Open {}", out.display()));
    }
    Ok(compared)
}

/// Gives a norm of simulated people the digest of the camera.toml of now, where that describes their camera; says where none is known.
fn of_camera_of(study: &Path, norm: &mut NormFile, path: &Path) -> Result<Option<String>> {
    if norm.origin == "measured" {
        return Ok(None);
    }
    if norm.is_of_any_camera() {
        let text = format!(
            "{}: nothing tells of which camera, lights and filters these simulated people are; with others than those of the study its verdicts \
             are wrong. A cohort.csv of this version tells it: make the norm anew from one",
            path.display()
        );
        return Ok(Some(text));
    }
    let camera = study.join(CAMERA).to_string_lossy().into_owned();
    let source = ExperimentSource::find(Some(&camera))?;
    if camera_digest(&source, &source.parse(&[])?)?.starts_with(&norm.analysis[1])
        && let Event::Setup { analysis, .. } = Study::open(study)?.setup()?
    {
        norm.analysis[1] = analysis;
    }
    Ok(None)
}

/// Numbers against a norm, as a page shows them.
fn held_against(norm: &NormFile, people: &[PersonAgainstNorm]) -> Option<HeldNumbers> {
    let id: FindingId = serde_json::from_value(norm.quantity.as_str().into()).ok()?;
    let number = |of: &PersonAgainstNorm| HeldNumber {
        of: [of.subject.clone(), of.session.clone()],
        value: of.value,
        interval: Some(of.interval).filter(|[low, high]| of.has_error && low < high),
        place: of.place,
    };
    Some(HeldNumbers {
        region: norm.region.clone(),
        id,
        channel: Some(norm.channel.clone()).filter(|channel| !channel.is_empty()),
        origin: norm.origin.clone(),
        sums: norm.sums.clone(),
        numbers: people.iter().map(number).collect(),
    })
}

/// Whether a region is that of a norm: a simulated mouth has parts, of which the tongue is `tongue_dorsum` and the lips `lower_lip`.
pub(crate) fn region_of(norm: &NormFile, region: &str) -> bool {
    let part = match region {
        "tongue" => "tongue_dorsum",
        "lips" | "lip" => "lower_lip",
        other => other,
    };
    region == norm.region || (norm.origin == "simulated" && part == norm.region)
}

fn person(
    norm: &NormFile,
    fitted: &fluorspar::analysis::Norm,
    row: &QueriedRow,
) -> Result<PersonAgainstNorm> {
    if row.is_guess() {
        return Err(Error::Input("the region was guessed from color, and nobody confirmed it".into()));
    }
    if !norm.holds_for(&row.version, &row.analysis) {
        let of = match norm.origin.as_str() {
            "measured" => "camera.toml than the norm",
            _ => {
                "camera than the simulated people; make their cohort anew, with `base = \"camera.toml\"` of the study"
            }
        };
        return Err(Error::Input(format!("the number is of another version of the program or another {of}")));
    }
    let own = row.own_interval();
    let has_error = own.is_some() && row.interval_kind == "estimate";
    let interval = own
        .or_else(|| row.value.map(|value| [value; 2]))
        .ok_or_else(|| Error::Input("there is neither a value nor an interval".into()))?;
    let beyond = row.value.map_or(interval, |value| fitted.beyond_own_error(value, interval));
    let place = fitted.place(beyond, row.age, &row.site).map_err(|error| wrong(&error))?;
    Ok(PersonAgainstNorm {
        subject: row.subject.clone(),
        session: row.session.clone(),
        region: row.region.clone(),
        quantity: row.quantity.clone(),
        value: row.value,
        interval,
        has_error,
        norm: norm.origin.clone(),
        place,
    })
}

/// The people whom a norm took from this study, as the log was when it was made.
fn people_in(
    options: &AgainstNormOptions,
    index: &Index,
    norm: &NormFile,
) -> Result<BTreeMap<String, NormPerson>> {
    let people =
        |index: &Index| Ok(people_of(index, &numbers_of(norm), options.subject.as_deref(), false)?.people);
    if norm.origin != "measured" {
        return Ok(BTreeMap::new());
    }
    if norm.logs.contains(&index.head()) {
        return people(index);
    }
    for line in &norm.logs {
        let sql = "SELECT seq FROM audit WHERE sha256 = ?";
        if let Some(last) = index.rows(sql, [line], |row| row.get::<_, i64>(0))?.first() {
            let entries = Study::open(&options.args.study)?.log.entries;
            return people(&Index::in_memory(&entries[..*last as usize])?);
        }
    }
    Ok(BTreeMap::new())
}

/// Says whether a norm still holds people who withdrew since.
fn warn_of_withdrawn<'a>(
    index: &Index,
    held: impl Iterator<Item = &'a String>,
    norm: &Path,
    job: &Job,
) -> Result<()> {
    let sql = "SELECT subject FROM subject WHERE withdrawn = 1";
    let withdrawn: Vec<String> = index.rows(sql, [], |row| row.get(0))?;
    let count = held.filter(|subject| withdrawn.contains(subject)).count();
    if count > 0 {
        let who = counted(count, "person", "people");
        let text = format!("{}: this norm still holds {who} who withdrew; make it anew", norm.display());
        job.warn(&[text.into()]);
    }
    Ok(())
}

/// Which numbers a norm is of.
fn numbers_of(norm: &NormFile) -> NormOptions {
    NormOptions {
        region: Some(norm.region.clone()),
        quantity: Some(norm.quantity.clone()),
        channel: Some(norm.channel.clone()),
        ..NormOptions::default()
    }
}

/// How well the number of a norm tells people with a lesion, where two or more of each are known.
fn separation(index: &Index, norm: &NormFile) -> Result<Option<Separation>> {
    let outcomes = outcomes(index)?;
    if !outcomes.values().any(|is_ill| *is_ill) {
        return Ok(None);
    }
    // Numbers that can be held against the norm: means of visits, then of people
    let query = QueryOptions { quantity: Some(norm.quantity.clone()), ..QueryOptions::default() };
    let all = rows(index, &query)?;
    let is_held = |row: &&QueriedRow| {
        row.channel == norm.channel
            && region_of(norm, &row.region)
            && norm.holds_for(&row.version, &row.analysis)
            && !(row.withdrawn || row.consent == "no" || row.is_guess())
    };
    let mut visits: BTreeMap<[&str; 2], Vec<f64>> = BTreeMap::new();
    for (row, value) in all.iter().filter(is_held).filter_map(|row| Some((row, row.value?))) {
        visits.entry([&row.subject, &row.session]).or_default().push(value);
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let mut people: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for ([subject, _], values) in &visits {
        people.entry(subject).or_default().push(mean(values));
    }
    let scores = |has_lesion: bool| -> Vec<f64> {
        let known = people.iter().filter(|(subject, _)| outcomes.get(**subject) == Some(&has_lesion));
        known.map(|(_, visits)| mean(visits)).collect()
    };
    let [ill, healthy] = [scores(true), scores(false)];
    let Some(upward) = RocArea::of(&ill, &healthy) else { return Ok(None) };
    let is_lower = upward.area < 0.5;
    let turned = |scores: &[f64]| scores.iter().map(|score| -score).collect::<Vec<f64>>();
    let area = if is_lower { RocArea::of(&turned(&ill), &turned(&healthy)) } else { Some(upward) };
    Ok(area.map(|area| {
        let group_size = group_size_for_area(area.area, WANTED_HALF_WIDTH);
        Separation { of: [norm.region.clone(), norm.quantity.clone()], is_lower, area, group_size }
    }))
}

impl PersonAgainstNorm {
    /// Whether the person stands outside.
    #[must_use]
    pub fn is_outside(&self) -> bool {
        self.place.standing == Standing::Outside
    }
}
