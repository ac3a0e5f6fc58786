//! What is normal: a file of sums over people, which holds none of them. No norm comes with the program: it is of the study's own people, of
//! whom those without an outcome count as healthy [assumed], or of simulated ones, whose amounts of porphyrin are assumed.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::path::{Path, PathBuf};

use clap::ValueHint;
use csv::Reader;
use fluorspar::analysis::{
    Norm, NormError, NormPerson, NormSums, Standing, ToleranceInterval, ToleranceMethod, ValueRange,
};
use fluorspar::findings::FindingId;
use fluorspar_format::{Output, Outputs};
use fluorspar_session::{Error, Job, Result, read_text};
use serde::{Deserialize, Serialize};

use crate::event::HEALTHY;
use crate::index::Index;
use crate::query::{QueriedRow, QueryOptions, rows};
use crate::secret::public_id;
use crate::store::{Study, write};

/// What becomes a norm.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct NormOptions {
    /// Folder of the study whose people without a lesion are taken.
    #[arg(value_name = "STUDY", value_hint = ValueHint::DirPath)]
    pub study: Option<PathBuf>,
    /// Name of the regions whose numbers are taken [default: tongue].
    #[arg(long = "region-name", value_name = "NAME")]
    pub region: Option<String>,
    /// Number that is taken, as patients.csv calls it: chromaticity_r, ... [default: red_share].
    #[arg(long, value_name = "NAME")]
    pub quantity: Option<String>,
    /// The channel of a signal.
    #[arg(long, value_name = "NAME")]
    pub channel: Option<String>,
    /// Adjust for age; people without an age are left out.
    #[arg(long)]
    pub by_age: bool,
    /// cohort.csv that `fluorspar cohort` wrote: a norm of simulated people, its parts as regions.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, conflicts_with = "study")]
    pub cohort: Option<PathBuf>,
    /// Norms of several sites, to be made one. May be repeated.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, conflicts_with_all = ["study", "cohort"])]
    pub pool: Vec<PathBuf>,
    /// File for the norm (.json).
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub out: Option<PathBuf>,
}

/// A norm as it travels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NormFile {
    /// What wrote the file: it may be replaced where this program did.
    pub program: String,
    /// Version of the format.
    pub format: u32,
    /// `measured` or `simulated`.
    pub origin: String,
    /// Name of the region.
    pub region: String,
    /// The number.
    pub quantity: String,
    /// Its channel; may be empty.
    pub channel: String,
    /// Version of the program and digest of the experiment of the numbers; of simulated people of their camera, or of their table where that
    /// tells no camera.
    pub analysis: [String; 2],
    /// Digests of the last lines of the logs that it was made of: by them it is found which norms still hold a person who withdrew.
    pub logs: Vec<String>,
    /// By what its studies and cohorts are told apart: each is in a norm once.
    #[serde(default)]
    pub studies: Vec<String>,
    /// Digests of the experiments of further cameras, of pooled sites.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cameras: Vec<String>,
    /// Sums over people.
    pub sums: NormSums,
    /// The range by order statistics, of 93 people or more of one site without regard to age; it can't be pooled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ranks: Option<ToleranceInterval>,
}

/// A norm and what it says.
#[derive(Clone, Debug, Serialize)]
pub struct NormReport {
    /// The norm.
    pub norm: NormFile,
    /// Range of each site, at 20, 50 and 80 years where it is adjusted for age.
    pub ranges: Vec<NormRange>,
    /// People with visits that have an upper limit and no number; such visits are left out.
    pub without_value: usize,
    /// Numbers of regions that are guesses, which are left out.
    pub guesses: usize,
    /// People with a number who withdrew or refuse; they are left out.
    pub refused: usize,
    /// People with a number who have a lesion; they are left out.
    pub with_lesion: usize,
}

/// A range of normal values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NormRange {
    /// The site.
    pub site: String,
    /// People there.
    pub people: u64,
    /// Years.
    pub age: Option<f64>,
    /// Ends that hold 95 % of people with 95 % confidence.
    pub range: [f64; 2],
}

impl NormOptions {
    fn region(&self) -> &str {
        self.region.as_deref().unwrap_or("tongue")
    }

    fn quantity(&self) -> &str {
        self.quantity.as_deref().unwrap_or("red_share")
    }

    pub(crate) fn channel(&self) -> &str {
        self.channel.as_deref().unwrap_or_default()
    }
}

impl NormFile {
    /// Whether numbers of a version of the program and of a camera can be held against it.
    pub(crate) fn holds_for(&self, version: &str, camera: &str) -> bool {
        self.is_of_any_camera()
            || (self.analysis[0] == version
                && (self.analysis[1] == camera || self.cameras.iter().any(|of| of == camera)))
    }

    /// Whether nothing tells the camera of its simulated people.
    pub(crate) fn is_of_any_camera(&self) -> bool {
        self.origin != "measured" && self.studies.contains(&self.analysis[1])
    }

    const FORMAT: u32 = 1;

    /// The fitted norm.
    ///
    /// # Errors
    /// Too few people.
    pub fn fit(&self) -> Result<Norm> {
        self.sums.fit().map_err(|error| wrong(&error))
    }
}

pub(crate) fn wrong(error: &NormError) -> Error {
    Error::Input(format!("there is no norm: {error}"))
}

/// Most people of a norm that is read: the time that a range takes grows with them.
const MOST_PEOPLE: u64 = 1_000_000;

/// Largest sum of a norm that is read: a fit squares its squares. Sums of measured numbers stay far below.
const MOST_SUM: f64 = 1e30;

/// Refuses a sum that overflows in a fit, and sums of squares below 0.
fn check_sums(norm: &NormFile, shown: &dyn Display) -> Result<()> {
    for (number, site) in norm.sums.sites.iter().enumerate() {
        let sums = [
            ("age", site.age, -MOST_SUM),
            ("age_age", site.age_age, 0.0),
            ("age_value", site.age_value, -MOST_SUM),
            ("value", site.value, -MOST_SUM),
            ("value_value", site.value_value, 0.0),
            ("within", site.within, 0.0),
            ("inverse_visits", site.inverse_visits, 0.0),
            ("inverse_visits_squared", site.inverse_visits_squared, 0.0),
            ("error[0]", site.error[0], 0.0),
            ("error[1]", site.error[1], 0.0),
            ("error_squared[0]", site.error_squared[0], 0.0),
            ("error_squared[1]", site.error_squared[1], 0.0),
        ];
        for (key, sum, least) in sums {
            if !(least..=MOST_SUM).contains(&sum) {
                return Err(Error::Input(format!(
                    "{shown}: sums.sites[{number}].{key} is {sum:e}, which no sum over people can be (at least {least:e}, at most {MOST_SUM:e}); \
                     copy the norm again, or make it anew with `fluorspar study norm`"
                )));
            }
        }
    }
    Ok(())
}

/// Reads a norm.
///
/// # Errors
/// A file that is none.
pub(crate) fn read_norm(path: &Path) -> Result<NormFile> {
    let shown = path.display();
    let norm: NormFile = serde_json::from_str(&read_text(path)?).map_err(|error| {
        Error::Input(format!("{shown}: this is no norm of `fluorspar study norm`: {error}"))
    })?;
    if norm.format != NormFile::FORMAT {
        return Err(Error::Input(format!(
            "{shown}: its format is {}, this program reads {}",
            norm.format,
            NormFile::FORMAT
        )));
    }
    let people = norm.sums.sites.iter().fold(0_u64, |all, site| all.saturating_add(site.people));
    if people > MOST_PEOPLE {
        return Err(Error::Input(format!(
            "{shown}: it claims {people} people, and at most {MOST_PEOPLE} are taken; copy the norm again"
        )));
    }
    check_sums(&norm, &shown)?;
    Ok(norm)
}

/// Makes a norm of a study, of a cohort, or of norms, and says what is normal.
///
/// # Errors
/// Fewer than ten people, numbers of several analyses, norms of other numbers.
pub fn norm(options: &NormOptions, job: &Job) -> Result<NormReport> {
    if options.by_age && options.study.is_none() {
        return Err(Error::Input(
            "⟨by_age⟩ is of a study: cohorts and pooled norms are adjusted for age or not; leave it out"
                .into(),
        ));
    }
    let read: Vec<PathBuf> = options.cohort.iter().chain(&options.pool).cloned().collect();
    let set = options
        .out
        .as_deref()
        .map(|out| Outputs::new().and(Output::file("--out", out)).reading(&read).declare())
        .transpose()?;
    let (norm, left_out) = match (&options.study, &options.cohort, &options.pool[..]) {
        (Some(study), ..) => of_study(options, study)?,
        (None, Some(cohort), _) => of_cohort(options, cohort)?,
        (None, None, [first, rest @ ..]) => (pooled(options, first, rest)?, LeftOut::default()),
        (None, None, []) => {
            return Err(Error::Input("give a study, ⟨cohort=FILE⟩ or norms with ⟨pool=FILE⟩".into()));
        }
    };
    let LeftOut { without_value, at_ends, guesses, without_age, refused, with_lesion, outside, frames } =
        left_out;
    warn([without_value, at_ends, guesses, without_age], job);
    job.warn(frames.map(Into::into).as_slice());
    job.warn(widened_by(&outside, norm.sums.people() as usize).map(Into::into).as_slice());
    if refused + with_lesion > 0 {
        job.status(format!(
            "Left out: {refused} who withdrew or refuse, {with_lesion} with an outcome other than healthy"
        ));
    }
    let fitted = norm.fit()?;
    let mut ranges = Vec::new();
    for site in &norm.sums.sites {
        let ages = if norm.sums.by_age { vec![Some(20.0), Some(50.0), Some(80.0)] } else { vec![None] };
        for age in ages {
            let range = fitted.range(age, &site.site).map_err(|error| wrong(&error))?;
            ranges.push(NormRange { site: site.site.clone(), people: site.people, age, range });
        }
    }
    if let (Some(out), Some(set)) = (&options.out, set) {
        write(out, serde_json::to_string_pretty(&norm)?.as_bytes())?;
        set.finish()?;
        job.status(format!("Wrote {}", out.display()));
    }
    Ok(NormReport { norm, ranges, without_value, guesses, refused, with_lesion })
}

/// People and numbers that are in no norm, and why.
#[derive(Default)]
struct LeftOut {
    without_value: usize,
    /// People with numbers at the ends of their range.
    at_ends: usize,
    guesses: usize,
    without_age: usize,
    refused: usize,
    with_lesion: usize,
    /// People in the norm who lie outside of the range of the others.
    outside: Vec<String>,
    /// Frames, in words, where nothing tells which is meant.
    frames: Option<String>,
}

/// Says who of so many people of a norm is outside of the range of the others, where more are than a range of 95 % leaves out: of healthy
/// people some are, and a norm without them is too narrow.
pub(crate) fn widened_by(outside: &[String], people: usize) -> Option<String> {
    let who = match outside {
        _ if 20 * outside.len() <= people => return None,
        [one] => format!("{one} is"),
        _ => format!("{} are", outside.join(", ")),
    };
    let text = format!(
        "{who} in the norm and outside of the range of the others, which is wider for it: keep out who may be ill by a line of a table of outcomes \
         (subject,outcome: {},suspected; `fluorspar study import STUDY --outcomes FILE`), and make the norm anew",
        outside[0]
    );
    Some(text)
}

/// Most people among whom one moves the range much.
const MOST_MOVED: usize = 92;

/// Who lies outside of the range of the others, where one person moves it much.
fn outside_of_others(norm: &NormSums, people: &BTreeMap<String, NormPerson>) -> Vec<String> {
    if people.len() > MOST_MOVED {
        return Vec::new();
    }
    let is_outside = |person: &NormPerson| {
        let others = norm.without(person).fit().ok()?;
        let counted = || person.values.iter().filter(|value| norm.range.straightened(**value).is_some());
        let mean = counted().sum::<f64>() / counted().count() as f64;
        Some(others.place([mean; 2], person.age, &person.site).ok()?.standing == Standing::Outside)
    };
    let outside = people.iter().filter(|(_, person)| is_outside(person) == Some(true));
    outside.map(|(subject, _)| subject.clone()).collect()
}

/// Warns of people who are left out, and of regions that nobody looked at.
fn warn([without_value, at_ends, guesses, without_age]: [usize; 4], job: &Job) {
    if at_ends > 0 {
        let text = format!(
            "{at_ends} people have a number at an end of what is possible, as a share of 0, where nothing is normal; such numbers are left out, \
             which moves the norm"
        );
        job.warn(&[text.into()]);
    }
    if without_age > 0 {
        job.warn(&[format!("{without_age} people have no age; they are left out of a norm by age").into()]);
    }
    if without_value > 0 {
        job.warn(&[format!("{without_value} people have a visit with an upper limit and no number; it is left out, which moves the norm up").into()]);
    }
    if guesses > 0 {
        let text = format!(
            "{guesses} numbers are of regions that were guessed from color, which may leave out just what is red, and that nobody confirmed; they \
             are left out. Look at them, write \"right\" as verdict into photographs.csv, and import it again"
        );
        job.warn(&[text.into()]);
    }
}

/// Which values a quantity can take.
fn range_of(quantity: &str) -> Result<ValueRange> {
    let id: Option<FindingId> = serde_json::from_value(quantity.into()).ok();
    id.and_then(FindingId::value_range).ok_or_else(|| {
        Error::Input(format!("\"{quantity}\" has no norm; take red_share, chromaticity_r, chromaticity_g, line_share or median_signal"))
    })
}

pub(crate) fn people_with_lesions(index: &Index) -> Result<BTreeSet<String>> {
    Ok(outcomes(index)?.into_iter().filter_map(|(subject, is_ill)| is_ill.then_some(subject)).collect())
}

/// People of whom an outcome is known, and whether one is a lesion: the last of each method counts.
pub(crate) fn outcomes(index: &Index) -> Result<BTreeMap<String, bool>> {
    let healthy = HEALTHY.join("', '");
    let sql = format!(
        "SELECT o.subject, max(lower(o.outcome) NOT IN ('{healthy}')) FROM outcome o WHERE o.seq =
         (SELECT max(p.seq) FROM outcome p WHERE p.subject = o.subject AND p.method = o.method) GROUP BY o.subject"
    );
    Ok(index.rows(&sql, [], |row| Ok((row.get(0)?, row.get(1)?)))?.into_iter().collect())
}

/// The numbers of a norm, of all people or of one.
fn query_of(options: &NormOptions, subject: Option<&str>) -> QueryOptions {
    QueryOptions {
        region: Some(options.region().to_owned()),
        quantity: Some(options.quantity().to_owned()),
        subject: subject.map(str::to_owned),
        ..QueryOptions::default()
    }
}

/// People of a norm, and who is none.
pub(crate) struct NormPeople {
    pub(crate) people: BTreeMap<String, NormPerson>,
    /// Their rows.
    rows: Vec<QueriedRow>,
    /// How many have a visit without a number.
    without_value: usize,
    /// People who withdrew or refuse, and others with a lesion.
    refused: BTreeSet<String>,
    with_lesion: BTreeSet<String>,
}

/// People of a study, or one of them, with or without lesions, who did not withdraw or refuse.
pub(crate) fn people_of(
    index: &Index,
    options: &NormOptions,
    subject: Option<&str>,
    has_lesion: bool,
) -> Result<NormPeople> {
    let ill = people_with_lesions(index)?;
    let (mut refused, mut with_lesion) = (BTreeSet::new(), BTreeSet::new());
    let mut all = rows(index, &query_of(options, subject))?;
    all.retain(|row| {
        let is_ill = ill.contains(&row.subject);
        let is_of_channel = row.channel == options.channel();
        if is_of_channel && (row.withdrawn || row.consent == "no") {
            refused.insert(row.subject.clone());
            return false;
        }
        if is_of_channel && is_ill {
            with_lesion.insert(row.subject.clone());
        }
        is_of_channel && is_ill == has_lesion
    });
    let mut people: BTreeMap<String, NormPerson> = BTreeMap::new();
    let mut of_visit: BTreeMap<[&str; 2], Vec<f64>> = BTreeMap::new();
    let mut errors: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for row in all.iter().filter(|row| !row.is_guess()) {
        let new = || NormPerson { site: row.site.clone(), age: row.age, ..NormPerson::default() };
        people.entry(row.subject.clone()).or_insert_with(new);
        of_visit.entry([&row.subject, &row.session]).or_default().extend(row.value);
        if let (Some(value), Some(interval)) = (row.value, row.own_interval()) {
            errors.entry(row.subject.clone()).or_default().push(squared_reach(value, interval));
        }
    }
    set_errors(&mut people, errors);
    let empty: BTreeSet<&str> =
        of_visit.iter().filter(|(_, of)| of.is_empty()).map(|(key, _)| key[0]).collect();
    let without_value = empty.len();
    // Several photographs of a visit are one measurement of it
    for ([subject, _], values) in of_visit.into_iter().filter(|(_, values)| !values.is_empty()) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        people.entry(subject.into()).and_modify(|person| person.values.push(mean));
    }
    people.retain(|_, person| !person.values.is_empty());
    Ok(NormPeople { people, rows: all, without_value, refused, with_lesion })
}

/// How far an interval reaches below and above its number, squared.
fn squared_reach(value: f64, [low, high]: [f64; 2]) -> [f64; 2] {
    [(value - low).powi(2), (high - value).powi(2)]
}

/// Gives people the mean of what their intervals reach.
fn set_errors<K: Ord>(people: &mut BTreeMap<K, NormPerson>, errors: BTreeMap<K, Vec<[f64; 2]>>) {
    for (of, reaches) in errors {
        let mean = |side: usize| reaches.iter().map(|reach| reach[side]).sum::<f64>() / reaches.len() as f64;
        people.entry(of).and_modify(|person| person.error = Some([mean(0), mean(1)]));
    }
}

/// Version and experiment of all numbers.
fn one_analysis(index: &Index, options: &NormOptions, of: &NormPeople) -> Result<[String; 2]> {
    let mut analyses: Vec<[String; 2]> =
        of.rows.iter().map(|row| [row.version.clone(), row.analysis.clone()]).collect();
    analyses.sort();
    analyses.dedup();
    match &analyses[..] {
        [one] => Ok(one.clone()),
        [] => Err(nobody(index, options, of)?),
        _ => {
            Err(Error::Input(
                "the numbers are of several versions of the program or of camera.toml, which must not be mixed: `fluorspar study analyze STUDY \
                 --missing` first"
                    .into(),
            ))
        }
    }
}

/// Why a norm has nobody: all are left out, the channel is another, or there is no such number.
fn nobody(index: &Index, options: &NormOptions, of: &NormPeople) -> Result<Error> {
    let (quantity, region) = (options.quantity(), options.region());
    let what = format!("{quantity} of a region \"{region}\"");
    let left_out = of.refused.len() + of.with_lesion.len();
    if left_out > 0 {
        return Ok(Error::Input(format!(
            "nobody is left for a norm: of {left_out} people with a {what} {} withdrew or refuse, {} have an outcome other than healthy; import \
             further people",
            of.refused.len(),
            of.with_lesion.len()
        )));
    }
    let found = rows(index, &query_of(options, None))?;
    let channels: BTreeSet<&str> = found.iter().map(|row| row.channel.as_str()).collect();
    if !channels.is_empty() {
        let known = channels.into_iter().filter(|channel| !channel.is_empty()).collect::<Vec<_>>().join(", ");
        return Ok(Error::Input(match known.as_str() {
            "" => format!("a {what} has no channel; leave ⟨channel⟩ out"),
            _ => format!("a {what} is that of a channel; give ⟨channel⟩: {known}"),
        }));
    }
    let sql = "SELECT DISTINCT region || ' ' || quantity FROM estimate ORDER BY 1";
    let known = index.rows(sql, [], |row| row.get::<_, String>(0))?;
    Ok(Error::Input(format!(
        "the study has no {what}; it has {}",
        if known.is_empty() {
            "no estimate yet: `fluorspar study analyze STUDY` makes them".into()
        } else {
            known.join(", ")
        }
    )))
}

/// The norm of a study, and who is left out.
fn of_study(options: &NormOptions, folder: &Path) -> Result<(NormFile, LeftOut)> {
    let (index, secret) = Study::asked(folder)?;
    let range = range_of(options.quantity())?;
    let of = people_of(&index, options, None, false)?;
    let analysis = one_analysis(&index, options, &of)?;
    let subjects = of.people;
    let people: Vec<NormPerson> = subjects.values().cloned().collect();
    let norm = NormFile {
        program: "fluorspar".into(),
        format: NormFile::FORMAT,
        origin: "measured".into(),
        region: options.region().to_owned(),
        quantity: options.quantity().to_owned(),
        channel: options.channel().to_owned(),
        analysis,
        cameras: Vec::new(),
        studies: vec![public_id(&secret)],
        logs: vec![index.head()],
        ranks: ranks(&people, range, options.by_age),
        sums: NormSums::of(&people, range, options.by_age),
    };
    let without_age = people.iter().filter(|person| options.by_age && person.age.is_none()).count();
    let left_out = LeftOut {
        without_value: of.without_value,
        at_ends: at_ends(&people, range),
        guesses: of.rows.iter().filter(|row| row.is_guess()).count(),
        without_age,
        refused: of.refused.len(),
        with_lesion: of.with_lesion.len(),
        outside: outside_of_others(&norm.sums, &subjects),
        frames: None,
    };
    Ok((norm, left_out))
}

/// People with numbers at the ends of their range.
fn at_ends(people: &[NormPerson], range: ValueRange) -> usize {
    let is_at_end = |value: &f64| range.straightened(*value).is_none();
    people.iter().filter(|person| person.values.iter().any(is_at_end)).count()
}

/// The range by order statistics of people of one site.
fn ranks(people: &[NormPerson], range: ValueRange, by_age: bool) -> Option<ToleranceInterval> {
    let one_site = people.windows(2).all(|pair| pair[0].site == pair[1].site);
    let values: Vec<f64> = people.iter().filter_map(|person| person.values.first().copied()).collect();
    let found = ToleranceInterval::of(&values, range).filter(|_| one_site && !by_age);
    found.filter(|found| found.method == ToleranceMethod::OrderStatistics)
}

/// A line of cohort.csv.
#[derive(Deserialize)]
struct CohortRow {
    person: u32,
    part: String,
    channel: String,
    name: String,
    quantity: String,
    has_lesion_here: u8,
    #[serde(default)]
    view: String,
    #[serde(default)]
    frame: String,
    value: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    #[serde(default)]
    camera: String,
}

/// The rows of a table, all of the frame that its estimates are of: colors and signals of further frames stand beside them. Where it has no
/// estimates, the first frame, and that it was taken.
fn rows_of_cohort(text: &str, path: &Path) -> Result<(Vec<CohortRow>, Option<String>)> {
    let rows: Vec<CohortRow> = Reader::from_reader(text.as_bytes())
        .deserialize()
        .collect::<std::result::Result<_, _>>()
        .map_err(|error| Error::Input(format!("{}: this is no cohort.csv: {error}", path.display())))?;
    let is_estimate =
        |row: &&CohortRow| ["red_share", "share", "line_share"].contains(&row.quantity.as_str());
    let of_estimates = rows.iter().find(is_estimate);
    let frame = of_estimates.or(rows.first()).map(|row| row.frame.clone()).unwrap_or_default();
    let other = rows.iter().find(|row| of_estimates.is_none() && row.frame != frame);
    let told = other.map(|other| {
        format!(
            "{}: there are no estimates that tell which frame is meant: \"{frame}\" is taken, not \"{}\"; for another leave its rows alone in \
             the table",
            path.display(),
            other.frame
        )
    });
    Ok((rows.into_iter().filter(|row| row.frame == frame).collect(), told))
}

fn of_cohort(options: &NormOptions, path: &Path) -> Result<(NormFile, LeftOut)> {
    let range = range_of(options.quantity())?;
    let text = read_text(path)?;
    let mut views: BTreeMap<u32, BTreeMap<String, Vec<f64>>> = BTreeMap::new();
    let mut errors: BTreeMap<_, Vec<_>> = BTreeMap::new();
    let mut cameras = BTreeSet::new();
    let (rows, frames) = rows_of_cohort(&text, path)?;
    for row in rows {
        cameras.insert(row.camera);
        let is_wanted = row.part == options.region()
            && row.quantity == options.quantity()
            && row.channel == options.channel()
            && row.name.is_empty()
            && row.has_lesion_here == 0;
        if let Some(value) = row.value.filter(|_| is_wanted) {
            views.entry(row.person).or_default().entry(row.view).or_default().push(value);
            if let Some((low, high)) = row.low.zip(row.high) {
                errors.entry(row.person).or_default().push(squared_reach(value, [low, high]));
            }
        }
    }
    if cameras.len() > 1 {
        let shown = path.display();
        let why =
            "its people were seen by several cameras, which must not be mixed: take the rows of one `camera`";
        return Err(Error::Input(format!("{shown}: {why}")));
    }
    // Views of a person are taken in one visit
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let visit = |views: &BTreeMap<String, Vec<f64>>| {
        let of_views: Vec<f64> = views.values().map(|values| mean(values)).collect();
        NormPerson { values: vec![mean(&of_views)], ..NormPerson::default() }
    };
    let mut people: BTreeMap<_, _> = views.iter().map(|(person, views)| (*person, visit(views))).collect();
    set_errors(&mut people, errors);
    let people: Vec<NormPerson> = people.into_values().collect();
    let sha256 = fluorspar::digest::sha256_hex([text]);
    let left_out = LeftOut { at_ends: at_ends(&people, range), frames, ..LeftOut::default() };
    let camera = cameras.pop_first().filter(|camera| !camera.is_empty());
    let norm = NormFile {
        program: "fluorspar".into(),
        format: NormFile::FORMAT,
        origin: "simulated".into(),
        region: options.region().to_owned(),
        quantity: options.quantity().to_owned(),
        channel: options.channel().to_owned(),
        analysis: [env!("CARGO_PKG_VERSION").into(), camera.unwrap_or_else(|| sha256.clone())],
        cameras: Vec::new(),
        logs: Vec::new(),
        studies: vec![sha256],
        ranks: ranks(&people, range, false),
        sums: NormSums::of(&people, range, false),
    };
    Ok((norm, left_out))
}

/// Refuses norms that are not of one kind, or of the same people.
fn check_alike(all: &NormFile, other: &NormFile, path: &Path) -> Result<()> {
    let shown = path.display();
    if all.origin != "measured" {
        let why = "simulated people are pooled in their cohort: make one of more (people.count)";
        return Err(Error::Input(format!("{shown}: {why}")));
    }
    let key = |norm: &NormFile| {
        [norm.origin.clone(), norm.region.clone(), norm.quantity.clone(), norm.channel.clone()]
    };
    if key(all) != key(other) {
        return Err(Error::Input(format!(
            "{shown}: this norm is of {}, the others of {}",
            key(other).join(" "),
            key(all).join(" ")
        )));
    }
    let same_site =
        || other.sums.sites.iter().any(|site| all.sums.sites.iter().any(|of| of.site == site.site));
    // Of which site a further camera is no norm tells
    let one_camera = || all.analysis == other.analysis && all.cameras.is_empty() && other.cameras.is_empty();
    if all.analysis[0] != other.analysis[0] || (!one_camera() && same_site()) {
        return Err(Error::Input(format!(
            "{shown}: its numbers are of another version of the program, or of another camera.toml at the same site; sites with cameras of their own \
             need names of their own (`fluorspar study init --site`), and norms of one site are pooled before those of others"
        )));
    }
    let shares = |all: &[String], other: &[String]| other.iter().any(|of| all.contains(of));
    if shares(&all.logs, &other.logs) || shares(&all.studies, &other.studies) {
        return Err(Error::Input(format!(
            "{shown}: its study or cohort is in the others already, and people must not count twice; of a study take its last norm alone"
        )));
    }
    Ok(())
}

/// Refuses a norm of another region or number than is asked for.
fn check_asked(options: &NormOptions, norm: &NormFile, path: &Path) -> Result<()> {
    let asked = [
        (&options.region, &norm.region),
        (&options.quantity, &norm.quantity),
        (&options.channel, &norm.channel),
    ];
    let other =
        asked.into_iter().find_map(|(asked, known)| Some((asked.as_ref()?, known)).filter(|(a, b)| a != b));
    if let Some((asked, known)) = other {
        let shown = path.display();
        return Err(Error::Input(format!(
            "{shown}: this norm is of {known}, not of {asked}; pool norms of {asked}"
        )));
    }
    Ok(())
}

fn pooled(options: &NormOptions, first: &Path, rest: &[PathBuf]) -> Result<NormFile> {
    let mut all = read_norm(first)?;
    check_asked(options, &all, first)?;
    if rest.is_empty() {
        return Err(Error::Input("one norm is not pooled; give ⟨pool⟩ twice or more".into()));
    }
    for path in rest {
        let other = read_norm(path)?;
        let shown = path.display();
        check_alike(&all, &other, path)?;
        all.sums = all.sums.pooled(&other.sums).map_err(|error| Error::Input(format!("{shown}: {error}")))?;
        all.cameras.extend(other.cameras);
        if other.analysis != all.analysis && !all.cameras.contains(&other.analysis[1]) {
            all.cameras.push(other.analysis[1].clone());
        }
        all.logs.extend(other.logs);
        all.studies.extend(other.studies);
        all.ranks = None;
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads a norm of some people with a sum of their values.
    fn read(people: u64, value: &str) -> Result<NormFile> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("n.json");
        let text = format!(
            "{{\"program\":\"fluorspar\",\"format\":1,\"origin\":\"measured\",\"region\":\"tongue\",\"quantity\":\"red_share\",\"channel\":\"\",\
             \"analysis\":[\"a\",\"b\"],\"logs\":[],\"sums\":{{\"range\":\"positive\",\"by_age\":false,\"sites\":[{{\"site\":\"\",\"people\":{people},\
             \"age\":0,\"age_age\":0,\"age_value\":0,{value},\"within\":0,\"within_degrees\":0,\"inverse_visits\":1}}]}}}}"
        );
        std::fs::write(&path, text).unwrap();
        read_norm(&path)
    }

    /// A damaged count would be worked on without end.
    #[test]
    fn more_people_than_can_be_are_refused() {
        let told = |people| read(people, "\"value\":1,\"value_value\":1").map(drop);
        assert!(told(1_000_000).is_ok());
        assert!(told(1_000_001).unwrap_err().to_string().contains("it claims 1000001 people"));
    }

    /// Which site a further camera is of no norm tells: a mean of numbers of two cameras is refused in any order.
    #[test]
    fn numbers_of_two_cameras_at_one_site_are_refused_in_any_order() {
        let folder = tempfile::tempdir().unwrap();
        let written = |(name, site, camera): (&str, &str, &str)| {
            let mut norm = read(10, "\"value\":1,\"value_value\":1").unwrap();
            norm.sums.sites[0].site = site.into();
            norm.analysis[1] = camera.into();
            (norm.studies, norm.logs) = (vec![name.into()], vec![name.into()]);
            let path = folder.path().join(name);
            std::fs::write(&path, serde_json::to_string(&norm).unwrap()).unwrap();
            path
        };
        let [a, b, c] = [("a", "north", "X"), ("b", "south", "Y"), ("c", "south", "X")].map(written);
        let options = NormOptions::default();
        for [first, second, third] in [[&a, &b, &c], [&b, &a, &c], [&c, &a, &b], [&b, &c, &a]] {
            let error = pooled(&options, first, &[second.clone(), third.clone()]).unwrap_err();
            assert!(error.to_string().contains("another camera.toml at the same site"), "{error}");
        }
        assert_eq!(pooled(&options, &a, &[b]).unwrap().cameras, ["Y"]);
        assert_eq!(pooled(&options, &a, &[c]).unwrap().sums.people(), 20);
    }

    /// Such a norm would say that NaN is normal.
    #[test]
    fn errors_of_simulated_people_are_in_their_norm() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cohort.csv");
        let rows: String = (1..=3)
            .map(|k| format!("{k},tongue_dorsum,,,red_share,0,0.{k}0,0.{k}0,0.{}0\n", k + 1))
            .collect();
        let heads = "person,part,channel,name,quantity,has_lesion_here,value,low,high";
        std::fs::write(&path, format!("{heads}\n{rows}")).unwrap();
        let options = NormOptions { region: Some("tongue_dorsum".into()), ..NormOptions::default() };
        let site = &of_cohort(&options, &path).unwrap().0.sums.sites[0];
        assert_eq!((site.people, site.with_error, site.error[0]), (3, 3, 0.0));
        assert!((site.error[1] - 0.03).abs() < 1e-12, "{site:?}");
    }

    /// Colors of the white frame stand beside those of the blue one, of which the estimates are; views are one visit.
    #[test]
    fn a_norm_of_simulated_people_is_of_one_frame() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cohort.csv");
        let mut text =
            String::from("person,view,frame,part,channel,name,quantity,has_lesion_here,value,low,high\n");
        for k in 1..=3 {
            for (view, more) in [("open", 0.0), ("tongue-out", 0.02)] {
                text += &format!("{k},{view},white,tongue_dorsum,,,chromaticity_r,0,0.6,,\n");
                text += &format!("{k},{view},blue,tongue_dorsum,,,red_share,0,0.1,0,0.2\n");
                text += &format!("{k},{view},blue,tongue_dorsum,,,chromaticity_r,0,{},,\n", 0.4 + more);
            }
        }
        std::fs::write(&path, &text).unwrap();
        let options = NormOptions {
            region: Some("tongue_dorsum".into()),
            quantity: Some("chromaticity_r".into()),
            ..NormOptions::default()
        };
        let site = &of_cohort(&options, &path).unwrap().0.sums.sites[0];
        let wanted = ValueRange::Share.straightened(0.41).unwrap();
        assert!((site.value / 3.0 - wanted).abs() < 1e-9 && site.within_degrees == 0, "{site:?}");
        // Without estimates nothing tells the frame
        let taken = |text: &str| rows_of_cohort(text, &path).unwrap();
        assert!(taken(&text).1.is_none());
        let (rows, told) = taken(&text.replace("red_share", "median_signal"));
        let told = told.unwrap();
        assert!(rows.iter().all(|row| row.frame == "white") && told.contains("\"white\" is taken"), "{told}");
    }

    #[test]
    fn who_widens_the_range_of_the_others_is_named() {
        let with_last = |last: f64| -> BTreeMap<String, NormPerson> {
            let values = (0..11).map(|k| 0.33 + 0.001 * f64::from(k * 7 % 11)).chain([last]);
            let person =
                |value| NormPerson { site: "north".into(), values: vec![value], ..NormPerson::default() };
            values.enumerate().map(|(k, value)| (format!("P{k:02}"), person(value))).collect()
        };
        let outside = |people: &BTreeMap<String, NormPerson>| {
            let all: Vec<NormPerson> = people.values().cloned().collect();
            outside_of_others(&NormSums::of(&all, ValueRange::Share, false), people)
        };
        assert!(outside(&with_last(0.334)).is_empty() && widened_by(&[], 0).is_none());
        assert_eq!(outside(&with_last(0.45)), ["P11"]);
        assert!(widened_by(&["P11".into()], 20).is_none());
        assert!(widened_by(&["P11".into()], 19).unwrap().starts_with("P11 is in the norm and outside"));
    }

    #[test]
    fn sums_that_overflow_are_refused_with_their_place() {
        for (value, words) in [
            ("\"value\":1e308,\"value_value\":1", "n.json: sums.sites[0].value is 1e308, which no sum"),
            ("\"value\":1,\"value_value\":1e308", "value_value is 1e308"),
            (
                "\"value\":1,\"value_value\":-1",
                "value_value is -1e0, which no sum over people can be (at least 0e0",
            ),
        ] {
            let error = read(20, value).unwrap_err();
            assert!(matches!(&error, Error::Input(said) if said.contains(words)), "{error}");
        }
        // A mean of logarithms that is no number's
        let norm = read(20, "\"value\":1e5,\"value_value\":1e9").unwrap();
        let said = norm.fit().unwrap().range(None, "").unwrap_err().to_string();
        assert_eq!(said, "its numbers overflow");
    }
}
