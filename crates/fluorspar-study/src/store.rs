//! A study on the disk: its folder, its log and its index.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::digest::sha256_hex;
use fluorspar_format::{digest_bounded, read_bounded, sync_together, write_atomically, write_unsynced};
use fluorspar_session::{AnalyzeOptions, Error, ExperimentSource, Job, Result, files_named, read_text};
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::event::{Event, StoredFile};
use crate::index::Index;
use crate::log::{LOG, Log};
use crate::secret::new_secret;

/// The experiment that describes the camera of a study.
pub(crate) const CAMERA: &str = "camera.toml";
/// Files that say what the folder is.
const DESCRIPTION: &str = "dataset_description.json";
const BIDSIGNORE: &str = ".bidsignore";
/// Largest file that is taken into a study.
pub(crate) const LARGEST_BYTES: u64 = 4 << 30;

/// Which study.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct StudyArgs {
    /// Folder of the study.
    #[arg(value_name = "STUDY", value_hint = ValueHint::DirPath)]
    pub study: PathBuf,
}

/// What a study begins with.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct InitOptions {
    /// The study.
    #[command(flatten)]
    #[serde(flatten)]
    pub args: StudyArgs,
    /// Experiment of the camera, its lights and filters, and of the analysis; it is copied into the study.
    #[arg(long, value_name = "EXPERIMENT")]
    pub experiment: String,
    /// Name of the study [default: that of its folder].
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Where its people are examined, for norms that several sites pool.
    #[arg(long, value_name = "NAME")]
    pub site: Option<String>,
}

/// A study that began.
#[derive(Clone, Debug, Serialize)]
pub struct BegunStudy {
    /// Its name.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
}

/// Begins a study in an empty folder, or goes on where the beginning was killed.
///
/// # Errors
/// A folder that holds something else, an experiment that can't be read from within the study.
pub fn init(options: &InitOptions, job: &Job) -> Result<BegunStudy> {
    let folder = &options.args.study;
    let shown = folder.display();
    let is_begun = || {
        Error::Input(format!(
            "{shown}: this is a study already; import into it: fluorspar study import {shown} PHOTOS"
        ))
    };
    if folder.join(LOG).exists() && !Log::open(folder)?.entries.is_empty() {
        return Err(is_begun());
    }
    let camera = camera_of(options)?;
    let own_name = std::path::absolute(folder).ok();
    let own_name = own_name.and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let name = options.name.clone().or(own_name).unwrap_or_default();
    let description = json!({ "Name": name, "BIDSVersion": "1.10.0", "DatasetType": "raw" });
    fs::create_dir_all(folder).map_err(|error| Error::Failed(format!("{shown}: {error}")))?;
    write_new(&folder.join(CAMERA), camera.as_bytes())?;
    write_new(&folder.join(BIDSIGNORE), b"camera.toml\nlog.jsonl\n**/photo/\n")?;
    let description = serde_json::to_string_pretty(&description)?;
    write_new(&folder.join(DESCRIPTION), description.as_bytes())?;
    let site = options.site.clone().unwrap_or_default();
    let log = Log::open(folder)?;
    if !log.entries.is_empty() {
        // Another process was faster
        return Err(is_begun());
    }
    let event = Event::Study { name: name.clone(), site, secret: new_secret() };
    let mut study = Study::with(folder, log)?;
    let setup = study.setup()?;
    study.commit("init", vec![event, setup])?;
    job.status(format!("Next: fluorspar study import {shown} PHOTOS"));
    Ok(BegunStudy { name, folder: folder.clone() })
}

/// The experiment of a study, as it is read from within its folder: a file that it names must lie there, too.
fn camera_of(options: &InitOptions) -> Result<String> {
    let source = ExperimentSource::find(Some(&options.experiment))?;
    if source.parse(&[])?.file.analysis.is_none() {
        let name = &options.experiment;
        return Err(Error::Input(format!("{name}: the experiment has no [analysis] section; add one")));
    }
    let text = match &source.file {
        Some(_) => source.text.clone(),
        None => format!("format = 1\nbase = \"{}\"\n", source.stem),
    };
    let folder = &options.args.study;
    let copy = ExperimentSource { text: text.clone(), base_dir: folder.clone(), ..source };
    copy.resolve(&[]).map_err(|error| {
        let shown = folder.display();
        Error::Input(format!(
            "{error}\nA study holds a copy of its experiment: copy what that names into {shown} first"
        ))
    })?;
    Ok(text)
}

/// Writes a file that is not there yet, or with these bytes.
fn write_new(path: &Path, bytes: &[u8]) -> Result<()> {
    if path.exists() && read_bounded(path, LARGEST_BYTES)? != bytes {
        let shown = path.display();
        return Err(Error::Input(format!("{shown}: this file is there and of no study; give a new folder")));
    }
    write(path, bytes)
}

/// A study, locked for this process.
pub(crate) struct Study {
    pub(crate) folder: PathBuf,
    pub(crate) log: Log,
    pub(crate) index: Index,
    /// Files that were taken in and are not sure to be on the disk.
    unsynced: Vec<PathBuf>,
}

/// Refuses a file whose bytes are not those that were taken in.
pub(crate) fn check_unchanged(file: &Path, sha256: &str) -> Result<()> {
    if digest_bounded(file, LARGEST_BYTES)? == sha256 {
        return Ok(());
    }
    let shown = file.display();
    Err(Error::Input(format!("{shown}: its bytes were changed; see `fluorspar study verify`")))
}

impl Study {
    /// Opens a study, and brings its index up to its log.
    pub(crate) fn open(folder: &Path) -> Result<Self> {
        Self::with(folder, Self::log_of(folder)?)
    }

    /// The index and the secret of a study that is only asked: with every line of the log alone where the index is behind.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub(crate) fn asked(folder: &Path) -> Result<(Index, String)> {
        if let Some(index) = Index::current(folder) {
            let secret = index.secret()?;
            if !secret.is_empty() {
                return Ok((index, secret));
            }
        }
        let mut study = Self::open(folder)?;
        let secret = study.secret()?;
        study.index.flush()?;
        Ok((study.index, secret))
    }

    fn with(folder: &Path, log: Log) -> Result<Self> {
        let index = Index::open(folder, &log.entries)?;
        Ok(Self { folder: folder.into(), log, index, unsynced: Vec::new() })
    }

    /// The log of a study.
    ///
    /// # Errors
    /// A folder that is no study, a log that is gone.
    pub(crate) fn log_of(folder: &Path) -> Result<Log> {
        if !folder.join(CAMERA).is_file() {
            let shown = folder.display();
            return Err(Error::Input(format!(
                "{shown}: this is no study; begin one with `fluorspar study init {shown} --experiment CAMERA.toml`"
            )));
        }
        let path = folder.join(LOG);
        let log = path.is_file().then(|| Log::open(folder)).transpose()?;
        log.filter(|log| !log.entries.is_empty()).ok_or_else(|| {
            Error::Input(format!(
                "{}: the log of the study is gone or empty; take it from a copy of the study. If the beginning of a new study was stopped, begin it \
                 again with the same `fluorspar study init`",
                path.display()
            ))
        })
    }

    /// Writes what happened: on the disk when it returns.
    pub(crate) fn commit(&mut self, command: &str, events: Vec<Event>) -> Result<()> {
        self.stage(command, events)?;
        self.settle()
    }

    /// Takes in what happened, to be written by [`Self::settle`]; a process that ends before leaves no trace of it in the log.
    pub(crate) fn stage(&mut self, command: &str, events: Vec<Event>) -> Result<()> {
        let known = self.log.entries.len();
        self.log.stage(command, events)?;
        self.index.apply(&self.log.entries[known..])
    }

    /// Brings files to the disk, then the lines of the log that tell of them, then these to the index.
    pub(crate) fn settle(&mut self) -> Result<()> {
        sync_together(&self.folder, &self.unsynced)?;
        self.unsynced.clear();
        self.log.write_staged()?;
        self.index.settle()
    }

    /// The camera of now, and the files that are of no photograph.
    ///
    /// # Errors
    /// A camera that can't be read.
    pub(crate) fn setup(&self) -> Result<Event> {
        let camera = files_named(&self.folder, Path::new(CAMERA))?;
        let whole = |path: &Path| {
            let sha256 = digest_bounded(&self.path(path), LARGEST_BYTES)?;
            Ok(StoredFile { role: "setup".into(), path: path.into(), sha256 })
        };
        let others = [DESCRIPTION, BIDSIGNORE].map(PathBuf::from);
        let others = others.iter().filter(|path| self.path(path).is_file());
        let files = camera.iter().chain(others).map(|path| whole(path)).collect::<Result<Vec<_>>>()?;
        let text = read_text(&self.path(Path::new(CAMERA)))?;
        let named =
            files[1..camera.len()].iter().map(|file| format!("{}\n{}", file.path.display(), file.sha256));
        Ok(Event::Setup { analysis: sha256_hex(std::iter::once(text).chain(named)), files })
    }

    /// Its analysis, as photographs in bulk have it.
    pub(crate) fn analysis(&self) -> AnalyzeOptions {
        let camera = self.path(Path::new(CAMERA)).to_string_lossy().into_owned();
        AnalyzeOptions { experiment: Some(camera), ..AnalyzeOptions::default() }
    }

    /// The path of a file of the study as the working folder has it.
    pub(crate) fn path(&self, file: &Path) -> PathBuf {
        self.folder.join(file)
    }

    /// Copies a file into the study, on the disk after the next [`Self::settle`]; one that is there with these bytes stays.
    pub(crate) fn take(&mut self, from: &Path, to: &Path, role: &str, sha256: &str) -> Result<StoredFile> {
        let place = self.path(to);
        let stored = StoredFile { role: role.into(), path: to.into(), sha256: sha256.into() };
        self.unsynced.push(place.clone());
        if place.is_file() && digest_bounded(&place, LARGEST_BYTES)? == sha256 {
            return Ok(stored);
        }
        let failed = |error: std::io::Error| Error::Failed(format!("{}: {error}", place.display()));
        fs::create_dir_all(place.parent().unwrap_or(&self.folder)).map_err(failed)?;
        let bytes = read_bounded(from, LARGEST_BYTES)?;
        write_unsynced(&place, |file| file.write_all(&bytes))?;
        if digest_bounded(&place, LARGEST_BYTES)? != sha256 {
            return Err(Error::Failed(format!(
                "{}: it changed while it was copied; import it again",
                from.display()
            )));
        }
        Ok(stored)
    }
}

/// Writes a file, on the disk when it returns.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(write_atomically(path, |file| file.write_all(bytes))?)
}
