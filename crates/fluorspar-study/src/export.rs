//! What leaves the clinic: people by codes, frames written anew, numbers.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar_format::{OutputFolder, csv_cell};
use fluorspar_session::{Error, ErrorKind, Job, Left, Result};
use serde::{Deserialize, Serialize};

use crate::deidentify::{Deidentified, DeidentifiedFile, age_band, code, listed, write_frame, write_mask};
use crate::query::{QueryOptions, rows};
use crate::store::{LARGEST_BYTES, Study, StudyArgs};

/// Where the export goes.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct ExportOptions {
    /// The study.
    #[command(flatten)]
    #[serde(flatten)]
    pub args: StudyArgs,
    /// Folder for participants.tsv, estimates.csv, the frames and deid.json.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
    /// Tables alone, no pictures.
    #[arg(long)]
    pub no_frames: bool,
}

/// What was exported.
#[derive(Clone, Debug, Serialize)]
pub struct ExportedStudy {
    /// The folder.
    pub folder: PathBuf,
    /// People.
    pub subjects: usize,
    /// Files.
    pub files: usize,
    /// Numbers.
    pub estimates: usize,
    /// People whose consent is not "yes", or who withdrew: nothing of them is there.
    pub left_out: usize,
    /// Files that can't be written anew, and why.
    pub failures: Vec<String>,
}

/// Names of regions that may leave; others become numbers.
const REGIONS: [&str; 20] = [
    "tongue",
    "lips",
    "lip",
    "teeth",
    "tooth",
    "gingiva",
    "gums",
    "palate",
    "cheek",
    "floor",
    "dorsal_tongue",
    "ventral_tongue",
    "lateral_tongue",
    "hard_palate",
    "soft_palate",
    "buccal_mucosa",
    "floor_of_mouth",
    "facial_skin",
    "lesion",
    "analysis",
];

/// Names of captures and frames that may leave; others become numbers.
const ROLES: [&str; 10] =
    ["ambient", "white", "blue", "violet", "green", "red", "uv", "dark", "flat", "mask"];

/// What a person is called outside, and what is told.
struct Outside {
    code: String,
    line: String,
    /// Visits by their label, in order.
    visits: BTreeMap<String, usize>,
}

/// Writes what may leave: people with consent "yes" who did not withdraw, by codes; frames anew from their pixels.
///
/// # Errors
/// A study that can't be opened, a folder that can't be written, nobody with consent.
pub fn export(options: &ExportOptions, job: &Job) -> Result<ExportedStudy> {
    let mut study = Study::open(&options.args.study)?;
    let secret = study.secret()?;
    let (people, left_out) = people(&study, &secret)?;
    if people.is_empty() {
        return Err(Error::Input(
            "nobody consented to this: a line of the table of people (`fluorspar study import STUDY --subjects people.csv`) with \"yes\" as consent \
             lets a person's data leave"
                .into(),
        ));
    }
    let inputs = [study.folder.join(crate::store::CAMERA)];
    let folder = OutputFolder::prepare(&options.out, &inputs, 1 << 30)?;
    let (estimates, count) = estimates(&study, &people, &secret)?;
    let (mut files, mut failures) = (Vec::new(), Vec::new());
    if !options.no_frames {
        write_files(&study, &people, &folder, (&mut files, &mut failures), job)?;
    }
    let heads = "participant_id\tsite\tsex\tage\tskin\tsmoker\tlesion\n";
    let lines: Vec<&str> = people.values().map(|person| person.line.as_str()).collect();
    let tables = serde_json::json!({
        "standard": "DICOM PS3.15, table E.1-1, Basic Application Level Confidentiality Profile; Clean, as whitelist",
        "tables": table_actions(),
        "files": files,
        "left_out_files": failures.len(),
    });
    let written = [
        ("participants.tsv".to_owned(), format!("{heads}{}", lines.concat()).into_bytes()),
        ("estimates.csv".into(), estimates.into_bytes()),
        ("deid.json".into(), serde_json::to_vec_pretty(&tables)?),
    ];
    let place = folder.finish_with(written)?;
    Ok(ExportedStudy {
        folder: place,
        subjects: people.len(),
        files: files.len(),
        estimates: count,
        left_out,
        failures,
    })
}

/// What is done to the words of tables.
fn table_actions() -> Vec<Deidentified> {
    let all: [(&str, char, &'static str); 9] = [
        ("subject: a code", 'D', "Patient ID (0010,0020)"),
        ("site: a code", 'D', "Institution Name (0008,0080)"),
        ("visit: its number; no date leaves", 'X', "Study Date (0008,0020)"),
        ("age: its decade, from 90 on one", 'C', "Patient's Age (0010,1010)"),
        ("sex, skin, smoker: of a list", 'C', "Patient's Sex (0010,0040), Smoking Status (0010,21A0)"),
        ("outcome: lesion or not", 'C', "Additional Patient History (0010,21B0)"),
        ("warnings, camera.toml, the log, accounts of people who work", 'X', "Operators' Name (0008,1070)"),
        ("names of regions: of a list, others a number", 'C', "Image Comments (0020,4000)"),
        ("names of files", 'D', "Patient ID (0010,0020)"),
    ];
    all.map(|(what, action, clause)| Deidentified { what: what.into(), action, clause }).to_vec()
}

fn people(study: &Study, secret: &str) -> Result<(BTreeMap<String, Outside>, usize)> {
    let sql = "SELECT s.subject, CASE WHEN s.site = '' THEN (SELECT site FROM study LIMIT 1) ELSE s.site END, s.sex, s.age, s.skin, s.smoker,
                      s.consent = 'yes' AND s.withdrawn = 0,
                      (SELECT max(lower(o.outcome) NOT IN ('healthy', 'none')) FROM outcome o WHERE o.subject = s.subject)
               FROM subject s ORDER BY s.subject";
    let mut people = BTreeMap::new();
    let all = study.index.rows(sql, [], |row| {
        let subject: String = row.get(0)?;
        let text = |column: usize| row.get::<_, String>(column);
        let (site, sex, skin, smoker) = (text(1)?, text(2)?, text(4)?, text(5)?);
        let lesion = row.get::<_, Option<bool>>(7)?.map_or("", |is_ill| if is_ill { "yes" } else { "no" });
        let id = code(secret, "subject", &subject);
        let cells = [
            format!("sub-{id}"),
            if site.is_empty() { site } else { code(secret, "site", &site) },
            listed(&sex, &["female", "male", "other", "f", "m", "d"]),
            age_band(row.get(3)?),
            listed(&skin, &["i", "ii", "iii", "iv", "v", "vi", "1", "2", "3", "4", "5", "6"]),
            listed(&smoker, &["yes", "no", "former"]),
            lesion.to_owned(),
        ];
        let line = cells.map(|cell| if cell.is_empty() { "n/a".into() } else { cell }).join("\t") + "\n";
        Ok((subject, Outside { code: id, line, visits: BTreeMap::new() }, row.get::<_, bool>(6)?))
    })?;
    let count = all.len();
    people.extend(
        all.into_iter().filter(|(_, _, may_leave)| *may_leave).map(|(subject, person, _)| (subject, person)),
    );
    for (subject, person) in &mut people {
        let sql = "SELECT session, min(visit) FROM photograph WHERE subject = ? GROUP BY session";
        let mut visits: Vec<[String; 2]> =
            study.index.rows(sql, [subject], |row| Ok([row.get(0)?, row.get(1)?]))?;
        visits.sort_by_cached_key(|[session, visit]| (natural(visit), session.clone()));
        person.visits = visits.into_iter().map(|[session, _]| session).zip(1..).collect();
    }
    let left_out = count - people.len();
    Ok((people, left_out))
}

/// A key by which words are in the order of the numbers in them: 2 before 10.
fn natural(word: &str) -> Vec<(u64, String)> {
    let mut parts: Vec<String> = Vec::new();
    for c in word.chars() {
        match parts.last_mut() {
            Some(last) if last.ends_with(|of: char| of.is_ascii_digit()) == c.is_ascii_digit() => {
                last.push(c)
            }
            _ => parts.push(c.into()),
        }
    }
    parts.into_iter().map(|part| (part.parse().unwrap_or(u64::MAX), part)).collect()
}

/// The numbers of people who may leave.
fn estimates(study: &Study, people: &BTreeMap<String, Outside>, secret: &str) -> Result<(String, usize)> {
    let mut text = String::from(
        "participant_id,site,visit,region,quantity,channel,value,low,high,interval,analysis,version\n",
    );
    let mut count = 0;
    let mut regions: BTreeMap<String, usize> = BTreeMap::new();
    for row in rows(&study.index, &QueryOptions::default())? {
        let Some(person) = people.get(&row.subject) else { continue };
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        let next = regions.len() + 1;
        let known = listed(&row.region, &REGIONS);
        let region = if known.is_empty() {
            format!("region-{}", regions.entry(row.region).or_insert(next))
        } else {
            known
        };
        let cells = [
            format!("sub-{}", person.code),
            if row.site.is_empty() { String::new() } else { code(secret, "site", &row.site) },
            person.visits.get(&row.session).map_or_else(String::new, ToString::to_string),
            region,
            row.quantity,
            listed(&row.channel, &["r", "g", "b"]).to_uppercase(),
            number(row.value),
            number(row.interval.map(|ends| ends[0])),
            number(row.interval.map(|ends| ends[1])),
            row.interval_kind,
            row.analysis,
            row.version,
        ];
        text += &(cells.map(|cell| csv_cell(&cell).into_owned()).join(",") + "\n");
        count += 1;
    }
    Ok((text, count))
}

fn write_files(
    study: &Study,
    people: &BTreeMap<String, Outside>,
    folder: &OutputFolder,
    (files, failures): (&mut Vec<DeidentifiedFile>, &mut Vec<String>),
    job: &Job,
) -> Result<()> {
    let sql = "SELECT p.subject, p.session, f.role, f.path, f.sha256, p.photograph FROM file f JOIN photograph p ON p.photograph = f.photograph
               WHERE f.role <> 'description' ORDER BY p.subject, p.session, p.photograph, f.path";
    let all: Vec<[String; 6]> = study.index.rows(sql, [], |row| {
        Ok([row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?, row.get(4)?, row.get(5)?])
    })?;
    let captures: Vec<String> = captures_of(study)?;
    let share_done = job.listener.begin("Writing frames anew", "the export", Left::Nothing);
    let mut numbers: BTreeMap<String, usize> = BTreeMap::new();
    for (done, [subject, session, role, path, sha256, photograph]) in all.iter().enumerate() {
        if job.is_stopped() {
            return Err(Error::Stopped("the export was stopped; nothing of it is left".into()));
        }
        let Some(person) = people.get(subject) else { continue };
        let visit = person.visits.get(session).copied().unwrap_or_default();
        let next = numbers.len() + 1;
        let number = *numbers.entry(photograph.clone()).or_insert(next);
        let label = listed(role, &ROLES);
        let at = captures.iter().position(|capture| capture == role).unwrap_or_default();
        let label = if label.is_empty() { format!("capture{}", at + 1) } else { label };
        let below = format!(
            "sub-{0}/ses-{visit}/photo/sub-{0}_ses-{visit}_run-{number}-{done}_acq-{label}",
            person.code
        );
        let to = if role == "mask" { format!("{below}_mask.png") } else { format!("{below}_raw.tiff") };
        let place = folder.path().join(&to);
        let made = place.parent().map_or(Ok(()), fs::create_dir_all);
        made.map_err(|error| Error::Failed(format!("{}: {error}", place.display())))?;
        let from = study.path(Path::new(path));
        if fluorspar_format::digest_bounded(&from, LARGEST_BYTES)? != *sha256 {
            return Err(Error::Input(format!(
                "{}: its bytes were changed; see `fluorspar study verify`",
                from.display()
            )));
        }
        let written =
            if role == "mask" { write_mask(&from, &place) } else { write_frame(&from, &place, &label) };
        match written {
            Ok(actions) => files.push(DeidentifiedFile {
                path: to,
                from: fluorspar::digest::sha256_hex([sha256.clone()]),
                actions,
            }),
            Err(error) if error.kind() != ErrorKind::Input => return Err(error.at_its_place(folder)),
            Err(error) => failures.push(format!("{}: {}", from.display(), error.at_its_place(folder))),
        }
        share_done((done + 1) as f64 / all.len() as f64);
    }
    Ok(())
}

/// Names of captures and of frames of the camera, by which files are numbered.
fn captures_of(study: &Study) -> Result<Vec<String>> {
    let sql = "SELECT DISTINCT role FROM file WHERE role NOT IN ('mask', 'description', 'dark', 'flat') ORDER BY role";
    study.index.rows(sql, [], |row| row.get(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn visits_are_in_the_order_of_their_numbers() {
        let mut visits = ["10", "1.10", "v2", "2", "1.2", "1", "v10"];
        visits.sort_by_key(|visit| natural(visit));
        assert_eq!(visits, ["1", "1.2", "1.10", "2", "10", "v2", "v10"]);
    }
}
