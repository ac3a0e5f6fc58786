//! Photographs of a camera: taken in, shown, asked about region by region, and saved as the table that `analyze` takes.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use fluorspar::findings::region_findings;
use fluorspar::pipeline::{AnalyzedFrame, CapturedFrame, ColorRendering, Preview};
use fluorspar_experiment::DEFAULT_EXPERIMENT;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_format::{
    description_path, digest_bounded, read_bounded, read_described_frame, write_atomically, write_label_png,
};
use fluorspar_report::finding_lines;
use fluorspar_session::{Error, Job, PhotographCamera, PhotographRow, Result, photographs_csv};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::picture::{View, of_photograph};
use crate::region::Place;
use crate::subject::{Heard, said};

/// Name of the table that `analyze` takes.
const TABLE: &str = "photographs.csv";
/// Mask of a region that is asked about: no dropped file has such a name.
const SCRATCH_MASK: &str = ".mask.png";
/// Most pixels of a mask.
const MOST_PIXELS: usize = 1 << 28;
/// Largest file that is copied, bytes.
const MOST_BYTES: u64 = 1 << 30;
/// Value of a pixel inside a mask.
const INSIDE: u8 = 255;

/// The photographs of one workbench.
pub(crate) struct Photographs {
    /// Where files go that were dropped on the page: it is gone with the workbench.
    folder: TempDir,
    files: Mutex<Vec<Given>>,
    /// The experiment of the command line.
    own: Option<String>,
    /// Experiments by name, once they are asked for.
    cameras: Mutex<BTreeMap<String, Arc<PhotographCamera>>>,
    /// Capture, person and visit of photographs, as they seem to be for an experiment.
    guessed: Mutex<BTreeMap<(String, usize), [String; 3]>>,
    /// The last photograph that was developed, as which capture of which experiment.
    developed: Mutex<Option<(Key, Arc<Developed>)>>,
    /// The last region that was asked about, with its photograph as one of a capture of an experiment.
    analyzed: Mutex<Option<(Key, Arc<AnalyzedFrame>)>>,
    /// Files that were written here, with their digests and the page that had them written: as long as they are as they were, that page may
    /// have them written anew.
    written: Mutex<BTreeMap<PathBuf, (String, String)>>,
}

type Key = (String, usize, String);
type Developed = (CapturedFrame, ColorRendering);

/// A file.
#[derive(Clone)]
struct Given {
    name: String,
    path: PathBuf,
    /// Whether it lies where the user has it, and not in the folder of the workbench.
    is_in_place: bool,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The last part of a path.
fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// The folder that holds both.
fn common_folder(one: PathBuf, other: PathBuf) -> PathBuf {
    one.iter().zip(other.iter()).take_while(|(a, b)| a == b).map(|(part, _)| part).collect()
}

/// A photograph as it is asked about.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PhotographRequest {
    experiment: String,
    id: usize,
    capture: String,
    view: View,
}

/// Which region of a photograph is asked about.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct EstimateRequest {
    experiment: String,
    id: usize,
    /// Captures and photographs of the visit.
    frames: Vec<(String, usize)>,
    size: [usize; 2],
    /// Name of the region.
    name: String,
    place: Place,
}

/// What is saved.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SaveRequest {
    folder: String,
    /// Tells the page that saves from others, and from itself before it was loaded anew.
    page: String,
    frames: Vec<SavedFrame>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedFrame {
    id: usize,
    patient: String,
    visit: String,
    capture: String,
    size: [usize; 2],
    regions: Vec<SavedRegion>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedRegion {
    name: String,
    place: Place,
    verdict: String,
}

/// What the pixels of a region say.
#[derive(Serialize)]
pub(crate) struct EstimateAnswer {
    lines: Vec<String>,
    warnings: Vec<String>,
    has_map: bool,
}

impl Photographs {
    /// Those of the command line; none is read yet.
    ///
    /// # Errors
    /// A system without a place for temporary files.
    pub(crate) fn new(frames: &[PathBuf], own: Option<String>) -> Result<Self> {
        let folder = tempfile::Builder::new().prefix("fluorspar-workbench").tempdir();
        let folder = folder.map_err(|error| Error::Failed(format!("no temporary folder: {error}")))?;
        let in_place =
            |path: &PathBuf| Given { name: file_name(path), path: path.clone(), is_in_place: true };
        Ok(Self {
            folder,
            files: Mutex::new(frames.iter().map(in_place).collect()),
            own,
            cameras: Mutex::default(),
            guessed: Mutex::default(),
            developed: Mutex::default(),
            analyzed: Mutex::default(),
            written: Mutex::default(),
        })
    }

    /// The photographs, and what an experiment knows of their camera; that of the command line by default.
    ///
    /// # Errors
    /// An experiment that is not in the catalogue and was not given.
    pub(crate) fn told(&self, experiment: Option<&str>) -> Result<Value> {
        let name = experiment.or(self.own.as_deref()).unwrap_or(DEFAULT_EXPERIMENT);
        let camera = self.camera(name)?;
        let catalogue = preset::list(PresetKind::Experiment)?;
        let named = catalogue.iter().map(|entry| [entry.name.as_str(), entry.title.as_str()]);
        let own = self.own.iter().map(|own| [own.as_str(), "of the command line"]);
        let files = lock(&self.files);
        let mut guessed = lock(&self.guessed);
        let given = files.iter().filter(|given| given.is_in_place).filter_map(|given| given.path.parent());
        let around = given.map(Path::to_path_buf).reduce(common_folder);
        let mut frame = |(id, given): (usize, &Given)| {
            let own = given.path.parent().unwrap_or(Path::new(""));
            let below = around.as_deref().filter(|_| given.is_in_place).unwrap_or(own);
            let guess =
                guessed.entry((name.into(), id)).or_insert_with(|| camera.told_by(&given.path, below));
            let [capture, patient, visit] = &*guess;
            json!({ "id": id, "name": given.name, "capture": capture, "patient": patient, "visit": visit })
        };
        let frames: Vec<Value> = files.iter().enumerate().map(&mut frame).collect();
        let folder = files.iter().find(|given| given.is_in_place).and_then(|given| given.path.parent());
        let folder = folder.and_then(|folder| {
            fs::canonicalize(if folder.as_os_str().is_empty() { Path::new(".") } else { folder }).ok()
        });
        Ok(json!({
            "experiment": name,
            "experiments": own.chain(named).collect::<Vec<_>>(),
            "captures": camera.captures(),
            "analyzed": camera.analyzed(),
            "parts": camera.parts(),
            "frames": frames,
            "folder": folder,
        }))
    }

    /// Takes a file in that was dropped on the page: a frame, or the description of one.
    ///
    /// # Errors
    /// A name that is none, a file that is no raw frame.
    pub(crate) fn take(&self, name: &str, bytes: &[u8]) -> Result<Value> {
        let is_plain =
            Path::new(name).components().eq([Component::Normal(name.as_ref())]) && !name.starts_with('.');
        if !is_plain || name.contains(['/', '\\', '=', '\0']) {
            return Err(Error::Input(format!("{name:?} is no name of a file; rename it")));
        }
        let path = self.folder.path().join(name);
        // Another description would change a frame that was looked at
        let is_of = |given: &Given| given.path == path || description_path(&given.path) == path;
        let is_taken = lock(&self.files).iter().any(is_of);
        if is_taken && read_bounded(&path, MOST_BYTES).is_ok_and(|known| known != bytes) {
            let text = format!("another {name} is here already; rename one of them, and drop it again");
            return Err(Error::Input(text));
        }
        write_atomically(&path, |file| file.write_all(bytes))?;
        if name.ends_with(".json") {
            return Ok(json!({ "description": name }));
        }
        // Messages name the file, not where it was put
        let told = read_described_frame(&path)
            .map_err(|error| Error::Input(error.to_string().replace(&path.display().to_string(), name)))?;
        let mut files = lock(&self.files);
        let known = files.iter().position(|given| given.path == path);
        let id = known.unwrap_or(files.len());
        if known.is_none() {
            files.push(Given { name: name.into(), path, is_in_place: false });
        }
        *lock(&self.developed) = None;
        let doubts: Vec<String> =
            told.facts.iter().filter(|fact| fact.is_doubtful).map(|fact| fact.sentence()).collect();
        Ok(json!({ "id": id, "doubts": doubts }))
    }

    fn given(&self, id: usize) -> Result<Given> {
        let given = lock(&self.files).get(id).cloned();
        given.ok_or_else(|| Error::Input(format!("there is no photograph {id}; drop it again")))
    }

    fn camera(&self, name: &str) -> Result<Arc<PhotographCamera>> {
        let is_known =
            self.own.as_deref() == Some(name) || preset::names(PresetKind::Experiment).contains(&name);
        if !is_known {
            return Err(Error::Input(format!(
                "{name:?} is no experiment of the catalogue; start the workbench with --experiment for one of your own"
            )));
        }
        if let Some(camera) = lock(&self.cameras).get(name) {
            return Ok(Arc::clone(camera));
        }
        let camera = Arc::new(PhotographCamera::open(name)?);
        lock(&self.cameras).insert(name.into(), Arc::clone(&camera));
        Ok(camera)
    }

    /// A photograph as one of a capture.
    fn developed(&self, (experiment, id, capture): Key) -> Result<Arc<Developed>> {
        let key = (experiment, id, capture);
        if let Some((_, found)) = lock(&self.developed).as_ref().filter(|(known, _)| *known == key) {
            return Ok(Arc::clone(found));
        }
        let found = Arc::new(self.camera(&key.0)?.developed(&self.given(id)?.path, &key.2)?);
        *lock(&self.developed) = Some((key, Arc::clone(&found)));
        Ok(found)
    }

    /// The picture of a photograph.
    ///
    /// # Errors
    /// A photograph that can't be developed.
    pub(crate) fn picture(&self, asked: &PhotographRequest) -> Result<(Value, Preview)> {
        let key: Key = (asked.experiment.clone(), asked.id, asked.capture.clone());
        let developed = self.developed(key.clone())?;
        let analyzed = lock(&self.analyzed).clone().filter(|(of, _)| *of == key).map(|(_, found)| found);
        of_photograph(&developed.0, &developed.1, asked.view, analyzed.as_deref())
    }

    /// What the pixels of a region say.
    ///
    /// # Errors
    /// Frames that can't be analyzed; a region without pixels.
    pub(crate) fn estimate(&self, asked: &EstimateRequest) -> Result<EstimateAnswer> {
        check_name(&asked.name)?;
        let files = |(capture, id): &(String, usize)| Ok((capture.clone(), self.given(*id)?.path));
        let frames: Vec<(String, PathBuf)> = asked.frames.iter().map(files).collect::<Result<_>>()?;
        let mask = self.folder.path().join(SCRATCH_MASK);
        if let Some(runs) = &asked.place.mask_runs {
            write_mask(&mask, asked.size, runs)?;
        }
        let heard = Arc::new(Heard::default());
        let job = Job::new(Arc::default(), heard.clone());
        let place = asked.place.fields(&mask.display().to_string());
        let analyzed = self.camera(&asked.experiment)?.estimate(&frames, asked.name.trim(), &place, &job)?;
        let analysis = &analyzed.analysis;
        let own = analysis.warnings.iter().map(|warning| warning.text().to_owned());
        let mut warnings: Vec<String> = heard.warnings().into_iter().chain(own).collect();
        warnings.dedup();
        let answer = EstimateAnswer {
            lines: finding_lines(&region_findings(analysis), &analysis.analyte, false),
            warnings: warnings.iter().map(|text| said(&Error::Input(text.clone()))).collect(),
            has_map: analyzed.porphyrin.is_some(),
        };
        let capture = asked.frames.iter().find(|(_, id)| *id == asked.id).map(|(capture, _)| capture.clone());
        let key = (asked.experiment.clone(), asked.id, capture.unwrap_or_default());
        *lock(&self.analyzed) = Some((key, Arc::new(analyzed)));
        Ok(answer)
    }

    /// Writes the table, masks beside it, and the photographs that were dropped; files of others stay. The table comes last.
    ///
    /// # Errors
    /// A folder that is not there, a file that somebody else wrote, regions without names.
    pub(crate) fn save(&self, asked: &SaveRequest) -> Result<Value> {
        let folder = fs::canonicalize(&asked.folder)
            .ok()
            .filter(|folder| folder.is_dir() && Path::new(&asked.folder).is_absolute());
        let folder = folder.ok_or_else(|| {
            Error::Input(format!("{:?} is no folder; give the whole path of one that is there", asked.folder))
        })?;
        let mut files: Vec<(PathBuf, Content)> = Vec::new();
        let mut rows = Vec::new();
        for frame in &asked.frames {
            self.save_frame(&folder, frame, &mut files, &mut rows)?;
        }
        files.push((folder.join(TABLE), Content::Bytes(photographs_csv(&rows)?)));
        self.check_free(&files, &asked.page)?;
        for (path, content) in &files {
            content.write(path)?;
            let written = (digest_bounded(path, MOST_BYTES)?, asked.page.clone());
            lock(&self.written).insert(path.clone(), written);
        }
        let names: Vec<String> = files.iter().map(|(path, _)| file_name(path)).collect();
        Ok(json!({ "folder": folder, "files": names }))
    }

    /// Lines of a photograph, and the files that they name.
    fn save_frame(
        &self,
        folder: &Path,
        frame: &SavedFrame,
        files: &mut Vec<(PathBuf, Content)>,
        rows: &mut Vec<PhotographRow>,
    ) -> Result<()> {
        let given = self.given(frame.id)?;
        let name = match given.is_in_place {
            true => relative(&given.path, folder)?,
            false => {
                let copies = [given.path.clone(), description_path(&given.path)];
                for copy in copies.into_iter().filter(|path| path.is_file()) {
                    files.push((folder.join(file_name(&copy)), Content::Copy(copy)));
                }
                given.name.clone()
            }
        };
        let [patient, visit, capture] =
            [&frame.patient, &frame.visit, &frame.capture].map(|text| text.trim().to_owned());
        let row = PhotographRow { patient, visit, capture, frame: name.into(), ..PhotographRow::default() };
        if frame.regions.is_empty() {
            rows.push(row.clone());
        }
        let mut masks: Vec<String> = Vec::new();
        for region in &frame.regions {
            check_name(&region.name)?;
            if !["", "right", "wrong"].contains(&region.verdict.as_str()) {
                return Err(Error::Input(format!(
                    "{:?} is no verdict; take \"right\" or \"wrong\"",
                    region.verdict
                )));
            }
            let mut mask = mask_name(&given.name, &region.name);
            if let Some(runs) = &region.place.mask_runs {
                let is_of_frame = masks.contains(&mask);
                masks.push(mask.clone());
                // Cameras number the files of all patients alike
                if files.iter().any(|(path, _)| file_name(path) == mask) {
                    mask = mask_name(&format!("{}_{}", frame.id, given.name), &region.name);
                }
                if is_of_frame {
                    return Err(Error::Input(format!(
                        "two regions {:?} of {} are the same; rename one",
                        region.name, given.name
                    )));
                }
                files.push((folder.join(&mask), Content::Mask(frame.size, runs.clone())));
            }
            let fields: Vec<String> = region
                .place
                .fields(&mask)
                .iter()
                .map(|(field, value)| format!("{field} = {value}"))
                .collect();
            rows.push(PhotographRow {
                region: region.name.trim().into(),
                place: format!("{{ {} }}", fields.join(", ")),
                verdict: region.verdict.clone(),
                ..row.clone()
            });
        }
        Ok(())
    }

    /// Refuses files that somebody else wrote; copies of the same content may be there.
    fn check_free(&self, files: &[(PathBuf, Content)], page: &str) -> Result<()> {
        let written = lock(&self.written).clone();
        for (path, content) in files {
            let of = |path: &Path| read_bounded(path, MOST_BYTES).ok();
            let is_same = |source: &PathBuf| of(source).is_some_and(|own| of(path) == Some(own));
            let is_as_written = written.get(path).filter(|(_, of)| of == page).is_some_and(|(written, _)| {
                digest_bounded(path, MOST_BYTES).is_ok_and(|now| now == *written)
            });
            let is_own = is_as_written || matches!(content, Content::Copy(source) if is_same(source));
            if path.exists() && !is_own {
                return Err(Error::Input(format!(
                    "{} is there already, and nothing of yours is overwritten; give another folder, or move it away",
                    path.display()
                )));
            }
        }
        Ok(())
    }
}

/// What is written.
enum Content {
    Bytes(Vec<u8>),
    Mask([usize; 2], Vec<u32>),
    Copy(PathBuf),
}

impl Content {
    fn write(&self, path: &Path) -> Result<()> {
        match self {
            Self::Bytes(bytes) => write_atomically(path, |file| file.write_all(bytes))?,
            Self::Mask(size, runs) => write_mask(path, *size, runs)?,
            Self::Copy(source) => {
                let bytes = read_bounded(source, MOST_BYTES)?;
                write_atomically(path, |file| file.write_all(&bytes))?;
            }
        }
        Ok(())
    }
}

/// Refuses what can't name a region.
fn check_name(name: &str) -> Result<()> {
    match name.trim().is_empty() || name.contains(['"', '=', '\n', '\r']) {
        true => Err(Error::Input(format!("{name:?} is no name of a region; rename it"))),
        false => Ok(()),
    }
}

/// Name of the mask of a region.
fn mask_name(frame: &str, region: &str) -> String {
    let plain = |text: &str| text.replace(|c: char| !c.is_alphanumeric() && c != '-', "_");
    let stem =
        Path::new(frame).file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    format!("mask_{}_{}.png", plain(&stem), plain(region.trim()))
}

/// A path as seen from a folder.
fn relative(path: &Path, folder: &Path) -> Result<String> {
    let path =
        fs::canonicalize(path).map_err(|error| Error::Input(format!("{}: {error}", path.display())))?;
    let shared = path.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(shared).map(|_| Component::ParentDir);
    let whole: PathBuf = up.chain(path.components().skip(shared)).collect();
    Ok(whole.display().to_string())
}

/// Writes a mask from runs of pixels outside and inside, in turn, row by row.
fn write_mask(path: &Path, [width, height]: [usize; 2], runs: &[u32]) -> Result<()> {
    let pixels = width.checked_mul(height).filter(|pixels| *pixels <= MOST_PIXELS);
    let total: u64 = runs.iter().map(|run| u64::from(*run)).sum();
    let pixels = pixels.filter(|pixels| total <= *pixels as u64);
    let pixels =
        pixels.ok_or_else(|| Error::Input("a mask is larger than its photograph; paint it again".into()))?;
    let mut labels = Vec::with_capacity(pixels);
    for (number, run) in runs.iter().enumerate() {
        labels.resize(labels.len() + *run as usize, if number % 2 == 1 { INSIDE } else { 0 });
    }
    labels.resize(pixels, 0);
    Ok(write_label_png(path, width, height, &labels)?)
}
