//! What leaves the clinic: people by codes, frames written anew, numbers.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::digest::sha256_hex;
use fluorspar_format::OutputFolder;
use fluorspar_session::{Error, ErrorKind, Job, Left, PhotographCamera, Result, photograph_pictures};
use serde::{Deserialize, Serialize};

use crate::analyze::{Wanted, check_files, photograph_of, wanted};
use crate::deidentify::{
    Deidentified, DeidentifiedFile, code, developed_actions, listed, write_frame, write_mask,
};
use crate::dicom::{Shown, write_picture};
use crate::outside::{Outside, numbers, numbers_csv, numbers_parquet, people};
use crate::store::{CAMERA, Study, StudyArgs, check_unchanged};

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
    /// No raw frames.
    #[arg(long)]
    pub no_frames: bool,
    /// Numbers as Parquet, below estimates/site=CODE/device=CODE, instead of estimates.csv: folders of several sites join as one table.
    #[arg(long)]
    pub parquet: bool,
    /// How the frames look, too, as DICOM (VL Photographic Image), for archives of pictures.
    #[arg(long)]
    pub dicom: bool,
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

/// Names of captures and frames that may leave; others become numbers.
const ROLES: [&str; 10] =
    ["ambient", "white", "blue", "violet", "green", "red", "uv", "dark", "flat", "mask"];

/// What is written below the folder of an export.
struct Export<'a> {
    study: &'a Study,
    secret: &'a str,
    people: &'a BTreeMap<String, Outside>,
    folder: OutputFolder,
    /// Names of captures, by which those that are not listed are numbered.
    captures: Vec<String>,
    /// Numbers of photographs among those of their person and visit: any other order would say who is who.
    numbers: BTreeMap<String, usize>,
    /// Files of each name so far.
    named: BTreeMap<String, usize>,
    files: Vec<DeidentifiedFile>,
    failures: Vec<String>,
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
    let inputs = [study.folder.join(CAMERA)];
    let mut export = Export {
        folder: OutputFolder::prepare(&options.out, &inputs, 1 << 30)?,
        captures: captures_of(&study)?,
        study: &study,
        secret: &secret,
        people: &people,
        numbers: BTreeMap::new(),
        named: BTreeMap::new(),
        files: Vec::new(),
        failures: Vec::new(),
    };
    if !options.no_frames {
        export.write_frames(job)?;
    }
    if options.dicom {
        export.write_pictures(options.no_frames, job)?;
    }
    let numbers = numbers(&study, &people, &secret)?;
    let tables = if options.parquet {
        numbers_parquet(&numbers, &code(&secret, "file", "estimates"))
    } else {
        vec![("estimates.csv".into(), numbers_csv(&numbers).into_bytes())]
    };
    let (files, failures) = (export.files.len(), export.failures.clone());
    let folder = export.finish(tables)?;
    Ok(ExportedStudy { folder, subjects: people.len(), files, estimates: numbers.len(), left_out, failures })
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

impl Export<'_> {
    /// Writes the tables, and moves the complete folder to its place.
    fn finish(self, mut tables: Vec<(String, Vec<u8>)>) -> Result<PathBuf> {
        let heads = "participant_id\tsite\tsex\tage\tskin\tsmoker\tlesion\n";
        let mut lines: Vec<&str> = self.people.values().map(|person| person.line.as_str()).collect();
        // By codes, not by names
        lines.sort_unstable();
        let manifest = serde_json::json!({
            "standard": "DICOM PS3.15, table E.1-1, Basic Application Level Confidentiality Profile; Clean, as whitelist",
            "tables": table_actions(),
            "files": self.files,
            "left_out_files": self.failures.len(),
        });
        tables.push(("participants.tsv".into(), format!("{heads}{}", lines.concat()).into_bytes()));
        tables.push(("deid.json".into(), serde_json::to_vec_pretty(&manifest)?));
        Ok(self.folder.finish_with(tables)?)
    }

    /// The beginning of the names of a photograph's files, and its number.
    fn stem(&mut self, person: &Outside, session: &str, photograph: &str) -> (String, usize) {
        let visit = person.visit(session);
        let of_visit = format!("sub-{0}/ses-{visit}/photo/sub-{0}_ses-{visit}", person.code);
        let number = match self.numbers.get(photograph) {
            Some(number) => *number,
            None => next(&mut self.named, &of_visit),
        };
        self.numbers.insert(photograph.to_owned(), number);
        (format!("{of_visit}_run-{number}"), number)
    }

    /// The name of a further file of a photograph.
    fn name(&mut self, stem: &str, label: &str, ending: &str) -> String {
        let name = format!("{stem}_acq-{label}");
        match next(&mut self.named, &format!("{name}_{ending}")) {
            1 => format!("{name}_{ending}"),
            number => format!("{name}x{number}_{ending}"),
        }
    }

    /// What a capture or a frame of the camera is called outside.
    fn label(&self, role: &str) -> String {
        let at = self.captures.iter().position(|capture| capture == role).unwrap_or_default();
        let label = listed(role, &ROLES);
        if label.is_empty() { format!("capture{}", at + 1) } else { label }
    }

    /// The place of a file in the folder, which is made.
    fn place(&self, to: &str) -> Result<PathBuf> {
        let place = self.folder.path().join(to);
        let made = place.parent().map_or(Ok(()), fs::create_dir_all);
        made.map_err(|error| Error::Failed(format!("{}: {error}", place.display())))?;
        Ok(place)
    }

    /// Takes what was done to a file down, or why it stays.
    fn keep(
        &mut self,
        from: &Path,
        sha256: &str,
        to: String,
        written: Result<Vec<Deidentified>>,
    ) -> Result<()> {
        match written {
            Ok(actions) => {
                let from = sha256_hex([sha256.to_owned()]);
                self.files.push(DeidentifiedFile { path: to, from, actions });
            }
            Err(error) if error.kind() != ErrorKind::Input => return Err(error.at_its_place(&self.folder)),
            Err(error) => {
                self.failures.push(format!("{}: {}", from.display(), error.at_its_place(&self.folder)))
            }
        }
        Ok(())
    }

    fn write_frames(&mut self, job: &Job) -> Result<()> {
        let sql = "SELECT p.subject, p.session, f.role, f.path, f.sha256, p.photograph FROM file f JOIN photograph p ON p.photograph = f.photograph
                   WHERE f.role <> 'description' AND (f.role <> 'mask' OR EXISTS (SELECT 1 FROM region r
                       WHERE r.photograph = f.photograph AND r.current = 1 AND instr(r.place, f.path) > 0)) ORDER BY p.subject, p.session, p.photograph, f.path";
        let mut all: Vec<[String; 6]> = self.study.index.rows(sql, [], |row| {
            Ok([row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?, row.get(4)?, row.get(5)?])
        })?;
        all.sort_by_key(|[subject, ..]| self.people.get(subject).map(|person| &person.code));
        let camera = PhotographCamera::open(&self.study.path(Path::new(CAMERA)).to_string_lossy())?;
        let share_done = job.listener.begin("Writing frames anew", "the export", Left::Nothing);
        for (done, [subject, session, role, path, sha256, photograph]) in all.iter().enumerate() {
            stopped(job)?;
            let Some(person) = self.people.get(subject) else { continue };
            let (stem, _) = self.stem(person, session, photograph);
            let (label, is_mask) = (self.label(role), role == "mask");
            let ending = if is_mask { "mask.png" } else { "raw.tiff" };
            let to = self.name(&stem, &label, ending);
            let place = self.place(&to)?;
            let from = self.study.path(Path::new(path));
            check_unchanged(&from, sha256)?;
            let written =
                if is_mask { write_mask(&from, &place) } else { write_frame(&from, &place, &label) };
            // Frames of the camera are no capture
            if let Ok(Some(warning)) = camera.face_warning(&from, role) {
                job.warn(&[warning]);
            }
            self.keep(&from, sha256, to, written)?;
            share_done((done + 1) as f64 / all.len() as f64);
        }
        Ok(())
    }

    /// Writes how the frames look. `warns` of faces where no frames leave, which are warned of themselves.
    fn write_pictures(&mut self, warns: bool, job: &Job) -> Result<()> {
        let mut all = wanted(self.study)?;
        all.sort_by_key(|photograph| self.people.get(&photograph.subject).map(|person| &person.code));
        let share_done = job.listener.begin("Developing pictures", "the export", Left::Nothing);
        for (done, photograph) in all.iter().enumerate() {
            stopped(job)?;
            if let Some(person) = self.people.get(&photograph.subject) {
                self.write_pictures_of(photograph, person, warns.then_some(job))?;
            }
            share_done((done + 1) as f64 / all.len() as f64);
        }
        Ok(())
    }

    /// Faces are warned of where there is a job.
    fn write_pictures_of(&mut self, of: &Wanted, person: &Outside, job: Option<&Job>) -> Result<()> {
        let (stem, number) = self.stem(person, &of.session, &of.photograph);
        check_files(self.study, &of.photograph)?;
        let photograph = photograph_of(self.study, of)?;
        let frame = &photograph.frames[0].1;
        let pictures = match photograph_pictures(&self.study.analysis(), &photograph) {
            Ok(pictures) => pictures,
            Err(error) => return self.keep(frame, &of.photograph, stem, Err(error)),
        };
        for (at, (capture, picture, face)) in pictures.iter().enumerate() {
            job.iter().for_each(|job| job.warn(face.as_slice()));
            let label = self.label(capture);
            let to = self.name(&stem, &label, "photo.dcm");
            let (code, sex, visit) = (person.code.as_str(), person.sex.as_str(), person.visit(&of.session));
            let shown = Shown {
                code,
                sex,
                visit,
                photograph: number,
                session: &of.session,
                sha256: &of.photograph,
                picture: at + 1,
                capture: &label,
                size: [picture.width, picture.height],
                rgb: &picture.rgb,
            };
            let written = write_picture(&self.place(&to)?, &shown, self.secret);
            self.keep(frame, &of.photograph, to, written.map(|()| developed_actions()))?;
        }
        Ok(())
    }
}

/// Counts a name, from 1 on.
fn next(counts: &mut BTreeMap<String, usize>, name: &str) -> usize {
    let count = counts.entry(name.to_owned()).or_default();
    *count += 1;
    *count
}

fn stopped(job: &Job) -> Result<()> {
    if job.is_stopped() {
        return Err(Error::Stopped("the export was stopped; nothing of it is left".into()));
    }
    Ok(())
}

/// Names of captures and of frames of the camera, by which files are numbered.
fn captures_of(study: &Study) -> Result<Vec<String>> {
    let sql = "SELECT DISTINCT role FROM file WHERE role NOT IN ('mask', 'description', 'dark', 'flat') ORDER BY role";
    study.index.rows(sql, [], |row| row.get(0))
}
