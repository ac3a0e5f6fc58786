//! What the workbench shows: a finished render, or an experiment that is rendered first.

use std::any::Any;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;

use fluorspar::pipeline::PipelineError;
use fluorspar_experiment::schema::ExperimentFile;
use fluorspar_experiment::{SceneChange, Warning, check_settings, edit_experiment, resolve_rendered};
use fluorspar_format::read_toml;
use fluorspar_session::design::FoundDesigns;
use fluorspar_session::values::{Override, as_typed, sets};
use fluorspar_session::{
    Changes, Error, ExperimentSource, Job, Left, Listener, LiveRender, Result, check_memory,
    check_nothing_painted, worded,
};

use crate::WorkbenchOptions;
use crate::anew::{Anew, in_own_threads, parts, rendered};

/// What is shown.
pub(crate) struct Subject {
    stage: Mutex<Stage>,
    progress: Arc<Progress>,
    /// What is rendered or read first, until it is.
    waiting: Mutex<Option<Waiting>>,
    /// Ends the render in work.
    stop: Mutex<Arc<AtomicBool>>,
    /// Renders of what the page changes.
    pub(crate) anew: Arc<Anew>,
    /// Its file or name.
    pub(crate) name: String,
    /// Changes on which the workbench begins, in the form of `--set`.
    changes: Vec<String>,
}

/// What is there after some work.
enum Waiting {
    /// What is rendered, and the text of the user's experiment.
    Experiment(ExperimentSource, String),
    /// The folder of a search of designs.
    Designs(PathBuf),
}

/// How far it is.
#[derive(Clone)]
pub(crate) enum Stage {
    Rendering,
    Ready(Arc<LiveRender>),
    Failed(String),
    /// There are designs alone.
    Designs(Arc<FoundDesigns>),
    /// There is nothing but photographs.
    Photographs,
}

/// Largest spectra that are read into memory, bytes.
const MOST_SPECTRA: usize = 2 << 30;

/// Share of the width and height of an experiment that is rendered.
const QUICK: [u32; 2] = [2, 3];

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Subject {
    /// Finds the subject of some options.
    pub(crate) fn find(options: &WorkbenchOptions) -> Result<Self> {
        let name = options.subject.clone().unwrap_or_else(|| fluorspar_experiment::DEFAULT_EXPERIMENT.into());
        let subject = |stage, waiting, changes| Self {
            stage: Mutex::new(stage),
            progress: Arc::default(),
            waiting: Mutex::new(waiting),
            stop: Mutex::default(),
            anew: Arc::new(Anew::new(options.spp)),
            name: name.clone(),
            changes,
        };
        if !frames_of(options).is_empty() {
            return Ok(subject(Stage::Photographs, None, Vec::new()));
        }
        let folder = options.subject.as_ref().map(PathBuf::from);
        if let Some(folder) = folder.filter(|folder| FoundDesigns::is_in(folder)) {
            if let Some(path) = options.changes.set.first().or(options.changes.unset.first()) {
                return Err(Error::Input(format!(
                    "{}: a search of designs can't be changed, and {path} was given; search again with `fluorspar design`",
                    folder.display()
                )));
            }
            return Ok(subject(Stage::Rendering, Some(Waiting::Designs(folder)), Vec::new()));
        }
        if let Some(path) = image_of(options.subject.as_deref())? {
            let Changes { set, unset } = &options.changes;
            if let Some(path) = unset.first() {
                return Err(Error::Input(format!(
                    "⟨unset={path}⟩: the page of a finished render only sets values; give an experiment, or leave it out"
                )));
            }
            let live = LiveRender::open(&path)?;
            live.show(&options.changes)?;
            return Ok(subject(Stage::Ready(Arc::new(live)), None, set.clone()));
        }
        let source = ExperimentSource::find(options.subject.as_deref())?;
        let (text, own_text) = first_texts(&source, options)?;
        // What the render is made with is no difference to it any more
        let waiting = Waiting::Experiment(ExperimentSource { text, ..source }, own_text);
        Ok(subject(Stage::Rendering, Some(waiting), Vec::new()))
    }

    /// How far it is.
    pub(crate) fn stage(&self) -> Stage {
        lock(&self.stage).clone()
    }

    /// Changes on which the page begins, in the form of `--set`.
    pub(crate) fn changes(&self) -> &[String] {
        &self.changes
    }

    /// Share of the render that is done, 0 to 1, and what is done or was said last.
    pub(crate) fn progress(&self) -> (f64, String) {
        self.progress.told()
    }

    /// Begins to render, or to read designs, in a thread of its own, where that is to be done.
    pub(crate) fn begin(self: &Arc<Self>) {
        let Some(waiting) = lock(&self.waiting).take() else { return };
        let (subject, job) = (Arc::clone(self), Job::new(lock(&self.stop).clone(), self.progress.clone()));
        thread::spawn(move || {
            let work = || match waiting {
                Waiting::Experiment(source, own) => Ok(Stage::Ready(Arc::new(of_source(source, own, &job)?))),
                Waiting::Designs(folder) => Ok(Stage::Designs(Arc::new(FoundDesigns::open(&folder, &job)?))),
            };
            let stage = in_own_threads(&job, work).unwrap_or_else(|error| Stage::Failed(said(&error)));
            *lock(&subject.stage) = stage;
        });
    }

    /// Ends the render in work.
    pub(crate) fn stop(&self) {
        lock(&self.stop).store(true, Ordering::SeqCst);
        self.anew.stop();
    }
}

/// Reads the spectra of a render into memory in a thread of its own, unless they are too large: other filters and regions are soon
/// there then. What fails is told when they are wanted.
pub(crate) fn read_ahead(live: &Arc<LiveRender>) {
    if live.render().labels().stored_values() <= MOST_SPECTRA / 4 {
        let live = Arc::clone(live);
        thread::spawn(move || live.render().read_spectra());
    }
}

/// The photographs that were given: where the first thing is a frame, all are.
pub(crate) fn frames_of(options: &WorkbenchOptions) -> Vec<PathBuf> {
    let first = options.subject.as_ref().map(PathBuf::from);
    let ending =
        |path: &PathBuf| path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let is_frame = |path: &PathBuf| {
        ending(path).is_some_and(|ending| FRAME_ENDINGS.contains(&ending.as_str()))
            || !options.frames.is_empty()
    };
    first.filter(is_frame).into_iter().chain(options.frames.iter().cloned()).collect()
}

/// Endings of frames of cameras; a JPEG is refused with its reason.
const FRAME_ENDINGS: [&str; 7] = ["dng", "tif", "tiff", "png", "raw", "jpg", "jpeg"];

/// The component image that a subject names; `None` of an experiment.
fn image_of(subject: Option<&str>) -> Result<Option<PathBuf>> {
    let Some(path) = subject.map(Path::new) else { return Ok(None) };
    if path.is_dir() {
        let image = path.join("components.exr");
        return match image.is_file() {
            true => Ok(Some(image)),
            false => Err(Error::Input(format!(
                "{}: this folder has no components.exr; give one that `run`, `design sweep` or `design optimize` wrote, a component \
                 image, or an experiment",
                path.display()
            ))),
        };
    }
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    Ok(matches!(ending.as_deref(), Some("exr" | "npy")).then(|| path.to_path_buf()))
}

/// Refuses scenes without a camera.
fn check_has_camera(file: &ExperimentFile) -> Result<()> {
    let has = [
        (file.lens.is_some(), "lens"),
        (file.sensor.is_some(), "sensor"),
        (!file.capture.is_empty(), "captures"),
    ];
    let missing = has.into_iter().find(|(is_there, _)| !is_there);
    missing.map_or(Ok(()), |(_, missing)| Err(PipelineError::Missing(missing).into()))
}

/// The text of an experiment with its changes and with fewer pixels and samples, where these do not set them; and that with the changes alone.
fn first_texts(source: &ExperimentSource, options: &WorkbenchOptions) -> Result<(String, String)> {
    let typed = options.changes.overrides();
    let parsed = source.parse(&typed)?;
    check_settings(&parsed).map_err(|error| as_typed(error, &typed))?;
    check_has_camera(&parsed.file)?;
    let render = parsed.file.render;
    // Who sets one of the two has the other one in mind
    let sizes = ["render.width_px", "render.height_px"];
    let is_sized =
        options.changes.set.iter().any(|set| sizes.iter().any(|path| set.trim_start().starts_with(path)));
    let part = |path: &str, value: u32| {
        let value = (value * QUICK[0] / QUICK[1]).max(1);
        (!is_sized).then(|| Override::of_option(path, value, "⟨spp⟩".into()))
    };
    let spp = Override::of_option("render.samples_per_pixel", options.spp, format!("⟨spp={}⟩", options.spp));
    let quick =
        [part("render.width_px", render.width_px), part("render.height_px", render.height_px), Some(spp)];
    let text_with = |all: &[Override]| -> Result<String> {
        let changes = all.iter().map(|one| SceneChange::read(&one.set)).collect::<Result<Vec<_>, _>>()?;
        let edited = edit_experiment(&source.text, &source.name, &source.base_dir, &changes);
        Ok(edited.map_err(|error| as_typed(error, all))?)
    };
    let all: Vec<Override> = quick.into_iter().flatten().chain(typed.iter().cloned()).collect();
    Ok((text_with(&all)?, text_with(&typed)?))
}

/// The render of an experiment that is soon there: a coarse one of what would take longer.
fn of_source(source: ExperimentSource, own_text: String, job: &Job) -> Result<LiveRender> {
    job.listener.status("Preparing the scene");
    let parsed = source.parse(&[])?;
    let resolved = source.resolve(&[])?;
    check_nothing_painted(&resolved.study)?;
    check_memory(&resolved.study, "or give the folder of a finished run")?;
    let Some(part) = parts(&resolved.study.scene.camera).into_iter().next() else {
        let render = rendered(&resolved.study, parsed.clone(), job)?;
        return Ok(LiveRender::of_render(render, source, own_text, (parsed, resolved), Vec::new()));
    };
    let further = Changes { set: part.changes().collect(), unset: Vec::new() };
    let coarse = source.parse(&further.overrides())?;
    let study = match resolve_rendered(&coarse, &parsed, &resolved)? {
        Some(study) => study,
        None => source.resolve(&further.overrides())?.study,
    };
    let render = rendered(&study, coarse, job)?;
    Ok(LiveRender::of_render(render, source, own_text, (parsed, resolved), part.size))
}

/// An error as the page says it: options are changes there.
pub(crate) fn said(error: &Error) -> String {
    worded(&error.to_string(), |name, value| match (name, value) {
        ("set", Some(value)) => value.to_owned(),
        (name, Some(value)) => format!("{name} {value}"),
        (name, None) => name.to_owned(),
    })
}

/// Whether a text looks like the name of a file rather than that of a part of the catalogue.
fn is_file(text: &str) -> bool {
    text.contains(['/', '\\', '.'])
}

/// Whether any text of a value looks like the name of a file.
fn names_file(value: &serde_json::Value) -> bool {
    match value {
        serde_json::Value::String(text) => is_file(text),
        serde_json::Value::Array(values) => values.iter().any(names_file),
        serde_json::Value::Object(fields) => fields.values().any(names_file),
        _ => false,
    }
}

/// Refuses changes that name files: the page changes what is there, and reads nothing from the disk.
pub(crate) fn check_no_files(changes: &Changes) -> Result<()> {
    for text in sets(&changes.overrides()) {
        let (path, value) = text.split_once('=').unwrap_or((&text, ""));
        if ["title", "description"].contains(&path.trim()) {
            continue;
        }
        // What is not TOML is a text
        let read = read_toml::<serde_json::Value>(&format!("value = {value}"));
        if read.map_or_else(|_| is_file(value), |read| names_file(&read)) {
            return Err(Error::Input(format!(
                "⟨set={text}⟩: the workbench reads no files; give a name of the catalogue, or start it with an experiment that names the \
                 file"
            )));
        }
    }
    Ok(())
}

/// Hears the warnings of a task.
#[derive(Default)]
pub(crate) struct Heard(Mutex<Vec<String>>);

impl Heard {
    pub(crate) fn warnings(&self) -> Vec<String> {
        lock(&self.0).clone()
    }
}

impl Listener for Heard {
    fn status(&self, _: &str) {}

    fn warnings(&self, warnings: &[Warning]) {
        lock(&self.0).extend(warnings.iter().map(|warning| warning.text().to_owned()));
    }

    fn begin(&self, _: &'static str, _: &'static str, _: Left) -> Box<dyn Fn(f64) + Sync> {
        Box::new(|_| {})
    }
}

/// Hears how far a render is.
#[derive(Default)]
pub(crate) struct Progress {
    permille: Arc<AtomicU32>,
    said: Mutex<String>,
}

impl Progress {
    /// Share that is done, 0 to 1, and what is done or was said last.
    pub(crate) fn told(&self) -> (f64, String) {
        (f64::from(self.permille.load(Ordering::Relaxed)) / 1000.0, lock(&self.said).clone())
    }
}

impl Listener for Progress {
    fn status(&self, text: &str) {
        let first = text.lines().next().unwrap_or_default();
        first.clone_into(&mut lock(&self.said));
    }

    fn warnings(&self, _: &[Warning]) {}

    fn begin(&self, title: &'static str, _: &'static str, _: Left) -> Box<dyn Fn(f64) + Sync> {
        self.status(title);
        let permille = Arc::clone(&self.permille);
        Box::new(move |share| permille.store((1000.0 * share) as u32, Ordering::Relaxed))
    }

    fn begin_writing(&self, _: &Path) -> Box<dyn Any> {
        Box::new(())
    }
}
