//! Takes photographs, people and outcomes into a study.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::ValueHint;
use csv::{ReaderBuilder, StringRecord, Trim};
use fluorspar_format::{description_path, digest_bounded, read_bounded, read_sensor_image};
use fluorspar_session::{
    Error, ErrorKind, FailedPhotograph, Job, Left, Photograph, Result, find_photographs, region_mask,
    region_with_mask,
};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::event::{Event, HEALTHY, Region, StoredFile, Subject, UNCLEAR};
use crate::store::{LARGEST_BYTES, Study, StudyArgs};

/// What a label is of.
pub(crate) const PATIENT: &str = "patient";
const VISIT: &str = "visit";
/// Verdict of a region that does not count.
const WRONG: &str = "wrong";
/// How often photographs are brought to the disk: each by itself would take most of the time.
const SETTLED_EVERY: Duration = Duration::from_secs(1);
/// Largest table that is read.
const LARGEST_TABLE_BYTES: u64 = 64 << 20;

/// What is taken in.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct ImportOptions {
    /// The study.
    #[command(flatten)]
    #[serde(flatten)]
    pub args: StudyArgs,
    /// Folder of photographs, or their table (photographs.csv), as `fluorspar analyze` takes them.
    #[arg(value_name = "PHOTOS", value_hint = ValueHint::AnyPath)]
    pub photographs: Option<PathBuf>,
    /// Table of people: subject, site, sex, age, skin, smoker, consent; all but subject optional.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub subjects: Option<PathBuf>,
    /// Table of what became of people: subject, method, outcome. No lesion are: healthy, normal, none, no, no lesion, negative,
    /// clear, unremarkable, ok, 0.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub outcomes: Option<PathBuf>,
}

/// What was taken in.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ImportedStudy {
    /// New photographs.
    pub photographs: usize,
    /// Photographs that were there.
    pub known: usize,
    /// New regions, and regions that moved.
    pub regions: usize,
    /// People with new data.
    pub subjects: usize,
    /// New outcomes.
    pub outcomes: usize,
    /// Photographs that were not taken in.
    pub failures: Vec<FailedPhotograph>,
}

/// A line of the table of people; an empty cell, or one of a column that is missing, says nothing.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SubjectRow {
    subject: String,
    site: Option<String>,
    sex: Option<String>,
    age: Option<f64>,
    skin: Option<String>,
    smoker: Option<String>,
    consent: Option<String>,
}

impl SubjectRow {
    /// What is known of the person with this line.
    fn over(self, known: Subject) -> Subject {
        Subject {
            site: self.site.unwrap_or(known.site),
            sex: self.sex.unwrap_or(known.sex),
            age: self.age.or(known.age),
            skin: self.skin.unwrap_or(known.skin),
            smoker: self.smoker.unwrap_or(known.smoker),
            consent: self.consent.unwrap_or(known.consent),
            ..known
        }
    }
}

/// A line of the table of outcomes.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OutcomeRow {
    subject: String,
    #[serde(default)]
    method: String,
    outcome: String,
}

/// Takes photographs, people and outcomes in. Photographs are on the disk a second later: the same command goes on where it was stopped or
/// killed, and takes nothing in twice.
///
/// # Errors
/// Nothing to take in, tables that can't be read, people who are not pseudonyms, a job that is stopped.
pub fn import(options: &ImportOptions, job: &Job) -> Result<ImportedStudy> {
    if options.photographs.is_none() && options.subjects.is_none() && options.outcomes.is_none() {
        return Err(Error::Input("give photographs, a table with ⟨subjects⟩, or one with ⟨outcomes⟩".into()));
    }
    let mut study = Study::open(&options.args.study)?;
    let mut imported = ImportedStudy::default();
    if let Some(path) = &options.subjects {
        imported.subjects = import_subjects(&mut study, path)?;
    }
    if let Some(path) = &options.photographs {
        import_photographs(&mut study, path, &mut imported, job)?;
    }
    if let Some(path) = &options.outcomes {
        imported.outcomes = import_outcomes(&mut study, path, job)?;
    }
    Ok(imported)
}

/// What is wrong with a line, without the words of the reader.
fn why(error: &csv::Error, heads: &StringRecord, cells: &StringRecord) -> String {
    let csv::ErrorKind::Deserialize { err, .. } = error.kind() else { return error.to_string() };
    let text = err.kind().to_string();
    if let Some(column) = text.strip_prefix("missing field `").and_then(|rest| rest.split('`').next()) {
        return format!("the table has no column \"{column}\"");
    }
    let at = err.field().and_then(|field| usize::try_from(field).ok());
    match at.and_then(|field| Some((heads.get(field)?, cells.get(field)?))) {
        Some((head, cell)) => format!("{head} is \"{cell}\": {text}"),
        None => text,
    }
}

/// Reads a table of comma-, semicolon- or tab-separated lines.
fn table<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>> {
    let bytes = read_bounded(path, LARGEST_TABLE_BYTES)?;
    let first = bytes.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let delimiter = [b'\t', b';'].into_iter().find(|byte| first.contains(byte)).unwrap_or(b',');
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    let mut reader = ReaderBuilder::new().trim(Trim::All).delimiter(delimiter).from_reader(text);
    let wrong = |line: usize, why: String| Error::Input(format!("{}: line {line}: {why}", path.display()));
    let heads = reader.headers().map_err(|error| wrong(1, error.to_string()))?.clone();
    let rows = reader.records().enumerate().map(|(number, cells)| {
        let cells = cells.map_err(|error| wrong(number + 2, error.to_string()))?;
        cells.deserialize(Some(&heads)).map_err(|error| wrong(number + 2, why(&error, &heads, &cells)))
    });
    rows.collect()
}

/// A person (`patient`) or a visit as BIDS has it: letters and digits.
pub(crate) fn label_of(what: &str, text: &str) -> Result<String> {
    let is_between = |c: char| ['_', '-', '.'].contains(&c);
    let label: String = text.chars().filter(|c| !is_between(*c)).collect();
    let is_label = |c: char| c.is_ascii_alphanumeric();
    if label.is_empty() || !label.chars().all(is_label) {
        let why = match what {
            VISIT => {
                "no label of a visit: files are called by letters and digits; write 1 or the like as visit"
            }
            _ => {
                "no pseudonym: a study holds no names, and files are called by letters and digits; write P01 or the like as patient"
            }
        };
        return Err(Error::Input(format!("\"{text}\" is {why}")));
    }
    Ok(label)
}

/// Labels of people and of their visits, and how tables write them: no two may have one label.
struct Labels(BTreeMap<[String; 2], String>);

impl Labels {
    /// Those of a study.
    fn of(study: &Study) -> Self {
        let mut labels = BTreeMap::new();
        for entry in &study.log.entries {
            match &entry.event {
                Event::Subject(Subject { subject, written: Some(written), .. }) => {
                    labels.insert([subject.clone(), String::new()], written.clone());
                }
                Event::Photograph { subject, session, visit: Some(visit), .. } => {
                    labels.insert([subject.clone(), session.clone()], visit.clone());
                }
                _ => {}
            }
        }
        Self(labels)
    }

    /// The label of a person.
    fn person(&mut self, written: &str) -> Result<String> {
        let label = label_of(PATIENT, written)?;
        self.take([label.clone(), String::new()], PATIENT, written)?;
        Ok(label)
    }

    /// The label of a visit of a person.
    fn visit(&mut self, person: &str, written: &str) -> Result<String> {
        let label = label_of(VISIT, written)?;
        self.take([person.to_owned(), label.clone()], &format!("{VISIT} of {person}"), written)?;
        Ok(label)
    }

    fn take(&mut self, label: [String; 2], what: &str, written: &str) -> Result<()> {
        let known = self.0.entry(label).or_insert_with(|| written.to_owned());
        if known == written {
            return Ok(());
        }
        Err(Error::Input(format!(
            "{what}: \"{known}\" and \"{written}\" differ in signs alone that names of files leave out; write the same one as \"{known}\", rename \
             another"
        )))
    }
}

fn import_subjects(study: &mut Study, path: &Path) -> Result<usize> {
    let mut events = Vec::new();
    let mut labels = Labels::of(study);
    let of_log = study.log.entries.iter().filter_map(|entry| match &entry.event {
        Event::Subject(subject) => Some((subject.subject.clone(), subject.clone())),
        _ => None,
    });
    let mut known: BTreeMap<String, Subject> = of_log.collect();
    let mut told = BTreeSet::new();
    for row in table::<SubjectRow>(path)? {
        let label = labels.person(&row.subject)?;
        let is_told = !told.insert(label.clone());
        let before = known.get(&label);
        let written = Some(row.subject.clone());
        let new = || Subject { subject: label.clone(), written, ..Subject::default() };
        let subject = row.over(before.cloned().unwrap_or_else(new));
        if let Some(age) = subject.age.filter(|age| !(0.0..=120.0).contains(age)) {
            return Err(Error::Input(format!(
                "{}: {}: an age of {age} years; give years at the first visit",
                path.display(),
                subject.subject
            )));
        }
        if !["yes", "no", ""].contains(&subject.consent.as_str()) {
            return Err(Error::Input(format!(
                "{}: {}: consent is \"{}\"; write yes, no or nothing",
                path.display(),
                subject.subject,
                subject.consent
            )));
        }
        if before != Some(&subject) {
            if is_told {
                return Err(Error::Input(format!(
                    "{}: {label} stands in it twice, with other cells; strike one of the lines",
                    path.display()
                )));
            }
            known.insert(label, subject.clone());
            events.push(Event::Subject(subject));
        }
    }
    let count = events.len();
    study.commit("import", events)?;
    Ok(count)
}

fn import_outcomes(study: &mut Study, path: &Path, job: &Job) -> Result<usize> {
    let known: Vec<String> = study.index.rows("SELECT subject FROM subject", [], |row| row.get(0))?;
    let mut events = Vec::new();
    let mut words = [BTreeSet::new(), BTreeSet::new()];
    let mut labels = Labels::of(study);
    for OutcomeRow { subject, method, outcome } in table(path)? {
        let subject = labels.person(&subject)?;
        if !known.contains(&subject) {
            return Err(Error::Input(format!("{}: the study has no person {subject}", path.display())));
        }
        if outcome.is_empty() {
            return Err(Error::Input(format!(
                "{}: the outcome of {subject} is empty; write what was found, \"healthy\" where nothing was, or strike the line",
                path.display()
            )));
        }
        let word = outcome.to_lowercase();
        if UNCLEAR.contains(&word.as_str()) {
            return Err(Error::Input(format!(
                "{}: the outcome of {subject} is \"{outcome}\", which may be a lesion or none; write \"healthy\" where there is none, what the lesion \
                 is, or strike the line until it is known",
                path.display()
            )));
        }
        words[usize::from(HEALTHY.contains(&word.as_str()))].insert(word);
        // A later one of the same method takes its place
        let of_log = study.log.entries.iter().map(|entry| &entry.event).chain(&events);
        let mut last = of_log.filter_map(|event| match event {
            Event::Outcome { subject: of, method: by, outcome } if (of, by) == (&subject, &method) => {
                Some(outcome)
            }
            _ => None,
        });
        if last.next_back() != Some(&outcome) {
            events.push(Event::Outcome { subject, method, outcome });
        }
    }
    let [lesions, none] = words.map(|words| match words.len() {
        0 => "nothing".to_owned(),
        _ => words.into_iter().collect::<Vec<_>>().join(", "),
    });
    job.status(format!("Outcomes counted as a lesion: {lesions}; as no lesion: {none}"));
    let count = events.len();
    study.commit("import", events)?;
    Ok(count)
}

fn import_photographs(study: &mut Study, path: &Path, imported: &mut ImportedStudy, job: &Job) -> Result<()> {
    let (photographs, failures) = find_photographs(&study.analysis(), path)?;
    imported.failures = failures;
    let mut labels = Labels::of(study);
    for photograph in &photographs {
        let person = labels.person(&photograph.patient)?;
        labels.visit(&person, &photograph.visit)?;
    }
    let taken = take_photographs(study, &photographs, imported, job);
    // What was taken in until then stays
    study.settle()?;
    taken
}

fn take_photographs(
    study: &mut Study,
    photographs: &[Photograph],
    imported: &mut ImportedStudy,
    job: &Job,
) -> Result<()> {
    let share_done = job.listener.begin("Importing photographs", "the import", Left::Results);
    let count = photographs.len();
    let mut settled = Instant::now();
    for (number, photograph) in photographs.iter().enumerate() {
        if settled.elapsed() > SETTLED_EVERY {
            study.settle()?;
            settled = Instant::now();
        }
        if job.is_stopped() {
            let text =
                format!("stopped after {number} of {count} photographs; the same command goes on from there");
            return Err(Error::Stopped(text));
        }
        match import_one(study, photograph, imported) {
            Err(error) if error.kind() != ErrorKind::Input => return Err(error),
            Err(error) => imported
                .failures
                .push(FailedPhotograph { frame: photograph.frames[0].1.clone(), why: error.to_string() }),
            Ok(()) => {}
        }
        share_done((number + 1) as f64 / count as f64);
    }
    Ok(())
}

/// Copies the frames of a photograph, and writes down what is new of it.
fn import_one(study: &mut Study, photograph: &Photograph, imported: &mut ImportedStudy) -> Result<()> {
    let (subject, session) = (label_of(PATIENT, &photograph.patient)?, label_of(VISIT, &photograph.visit)?);
    let main = &photograph.frames[0].1;
    // What can't be read is not taken in; a mirrored picture has left and right exchanged
    let frame = read_sensor_image(main)?.image;
    if frame.orientation.is_mirrored() {
        return Err(Error::Input(format!(
            "{}: its tags say that it is mirrored, so left and right are exchanged; turn mirroring off in the camera, or write the frame anew \
             without the tag",
            main.display()
        )));
    }
    let sha256 = digest_bounded(main, LARGEST_BYTES)?;
    let of_other = "SELECT subject, session FROM photograph WHERE photograph = ?";
    let known: Vec<[String; 2]> =
        study.index.rows(of_other, [&sha256], |row| Ok([row.get(0)?, row.get(1)?]))?;
    if let Some([other, visit]) = known.first().filter(|known| **known != [subject.clone(), session.clone()])
    {
        return Err(Error::Input(format!(
            "{}: the study has this very photograph as that of {other}, visit {visit}; cameras and cards give names twice: see whose it is",
            main.display()
        )));
    }
    // A photograph that shows nothing right is left out
    let is_wrong = |[_, _, verdict]: &[String; 3]| verdict == WRONG;
    if known.is_empty() && !photograph.regions.is_empty() && photograph.regions.iter().all(is_wrong) {
        return Ok(());
    }
    let is_out = "SELECT withdrawn FROM subject WHERE subject = ?";
    if study.index.rows(is_out, [&subject], |row| row.get::<_, bool>(0))?.contains(&true) {
        if !known.is_empty() {
            imported.known += 1;
            return Ok(());
        }
        return Err(Error::Input(format!(
            "{}: {subject} withdrew, and nothing new of this person is taken in",
            main.display()
        )));
    }
    let regions = new_regions(study, photograph, [&subject, &session], &sha256)?;
    let mut events = Vec::new();
    if known.is_empty() {
        let of_subject = "SELECT subject FROM subject WHERE subject = ?";
        if study.index.rows(of_subject, [&subject], |row| row.get::<_, String>(0))?.is_empty() {
            let written = Some(photograph.patient.clone());
            events.push(Event::Subject(Subject { subject: subject.clone(), written, ..Subject::default() }));
        }
        let files = take_files(study, photograph, &subject, &session, &sha256)?;
        events.push(Event::Photograph {
            photograph: sha256.clone(),
            subject: subject.clone(),
            session: session.clone(),
            visit: Some(photograph.visit.clone()),
            files,
        });
        imported.photographs += 1;
    } else {
        refuse_other_files(study, photograph, &sha256)?;
        imported.known += 1;
    }
    imported.regions += regions.len();
    events.extend(regions.into_iter().map(Event::Region));
    study.stage("import", events)
}

/// Refuses files that a photograph of the study does not have: what was taken in stays as it is, and numbers rest on it.
fn refuse_other_files(study: &Study, photograph: &Photograph, sha256: &str) -> Result<()> {
    let sql = "SELECT role, sha256 FROM file WHERE photograph = ?";
    let known: Vec<[String; 2]> = study.index.rows(sql, [sha256], |row| Ok([row.get(0)?, row.get(1)?]))?;
    for (role, from) in files_of(photograph) {
        let description = description_path(from);
        let described = description.is_file().then_some(("description", description.as_path()));
        for (role, path) in described.into_iter().chain([(role, from)]) {
            if !known.contains(&[role.to_owned(), digest_bounded(path, LARGEST_BYTES)?]) {
                return Err(Error::Input(format!(
                    "{}: the study has this photograph without this {role}, and what it has stays as it was taken in; begin a new study with the \
                     files as they are now",
                    path.display()
                )));
            }
        }
    }
    Ok(())
}

/// Frames of a photograph and frames of the camera, each with what it is.
fn files_of(photograph: &Photograph) -> impl Iterator<Item = (&str, &Path)> {
    let frames = photograph.frames.iter().map(|(capture, file)| (capture.as_str(), file.as_path()));
    let dark = photograph.dark.iter().map(|file| ("dark", file.as_path()));
    frames.chain(dark).chain(photograph.flat.iter().map(|file| ("flat", file.as_path())))
}

/// Folder and beginning of the names of a photograph's files, which no other photograph has.
fn stem(subject: &str, session: &str, sha256: &str) -> PathBuf {
    PathBuf::from(format!(
        "sub-{subject}/ses-{session}/photo/sub-{subject}_ses-{session}_desc-{}",
        &sha256[..12]
    ))
}

fn take_files(
    study: &mut Study,
    photograph: &Photograph,
    subject: &str,
    session: &str,
    sha256: &str,
) -> Result<Vec<StoredFile>> {
    let stem = stem(subject, session, sha256).to_string_lossy().into_owned();
    let mut files = Vec::new();
    for (number, (role, from)) in files_of(photograph).enumerate() {
        let ending = from.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let label: String = role.chars().filter(char::is_ascii_alphanumeric).collect();
        let to = PathBuf::from(format!("{stem}_acq-{label}_run-{}_raw.{ending}", number + 1));
        // The description comes before its frame, which is no frame without it
        let description = description_path(from);
        if description.is_file() {
            let digest = digest_bounded(&description, LARGEST_BYTES)?;
            files.push(study.take(&description, &description_path(&to), "description", &digest)?);
        }
        files.push(study.take(from, &to, role, &digest_bounded(from, LARGEST_BYTES)?)?);
    }
    files.sort_by_key(|file| file.role == "description");
    Ok(files)
}

/// A mask at a place that its bytes tell.
fn stored_mask(from: &Path, stem: &Path) -> Result<StoredFile> {
    if !from.is_file() {
        return Err(Error::Input(format!(
            "{}: this mask of a region is not there; put it there, or write another place into the table",
            from.display()
        )));
    }
    let digest = digest_bounded(from, LARGEST_BYTES)?;
    let ending = from.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let to = PathBuf::from(format!("{}_mask-{}.{ending}", stem.display(), &digest[..12]));
    Ok(StoredFile { role: "mask".into(), path: to, sha256: digest })
}

/// Regions that the study does not have as they are. A wrong one is told of where the study takes it for right, and no other of its name
/// takes its place.
fn new_regions(
    study: &mut Study,
    photograph: &Photograph,
    [subject, session]: [&str; 2],
    sha256: &str,
) -> Result<Vec<Region>> {
    let mut regions = Vec::new();
    let has_other =
        |name: &str| photograph.regions.iter().any(|[of, _, verdict]| of == name && verdict != WRONG);
    for (number, of) in photograph.regions.iter().enumerate() {
        let [name, place, verdict] = of;
        let is_again = |[other, at, by]: &[String; 3]| other == name && by != WRONG && at != place;
        if verdict != WRONG && photograph.regions[..number].iter().any(is_again) {
            return Err(Error::Input(format!(
                "{}: there are two regions \"{name}\" of this photograph; rename one",
                photograph.frames[0].1.display()
            )));
        }
        if verdict == WRONG && has_other(name) {
            continue;
        }
        let from = region_mask(of)?;
        let stem = stem(subject, session, sha256);
        let mask = from.as_deref().map(|from| stored_mask(from, &stem)).transpose()?;
        let place =
            mask.as_ref().map_or_else(|| Ok(place.clone()), |mask| region_with_mask(of, &mask.path))?;
        let region =
            Region { photograph: sha256.into(), region: name.clone(), place, mask, verdict: verdict.clone() };
        let same = "SELECT verdict FROM region WHERE region_sha256 = ? AND current = 1";
        let known: Vec<String> = study.index.rows(same, [region.sha256()], |row| row.get(0))?;
        let is_new = if verdict == WRONG { !known.is_empty() } else { known.first() != Some(verdict) };
        if !is_new {
            continue;
        }
        if let (Some(from), Some(mask)) = (&from, &region.mask) {
            study.take(from, &mask.path, &mask.role, &mask.sha256)?;
        }
        regions.push(region);
    }
    Ok(regions)
}
