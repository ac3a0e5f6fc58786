//! What the workbench shows: a finished render, or an experiment that is rendered first.

use std::any::Any;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use fluorspar_experiment::{SceneChange, Warning, edit_experiment};
use fluorspar_session::values::{Override, as_typed, sets};
use fluorspar_session::{
    Changes, Error, ExperimentSource, Job, Left, Listener, LiveRender, Result, check_memory,
    check_nothing_painted, render_scene, warnings_before_run, worded,
};

use crate::WorkbenchOptions;

/// What is shown.
pub(crate) struct Subject {
    stage: Mutex<Stage>,
    progress: Arc<Progress>,
    /// The experiment that is rendered first, until it is.
    waiting: Mutex<Option<Waiting>>,
    /// Its file or name.
    pub(crate) name: String,
    /// Changes on which the workbench begins.
    pub(crate) changes: Changes,
}

/// How far it is.
#[derive(Clone)]
pub(crate) enum Stage {
    Rendering,
    Ready(Arc<LiveRender>),
    Failed(String),
}

struct Waiting {
    source: ExperimentSource,
    text: String,
}

/// Largest spectra that are read into memory, bytes.
const MOST_SPECTRA: usize = 2 << 30;

/// Share of the width and height of an experiment that is rendered.
const QUICK: [u32; 2] = [2, 3];

impl Subject {
    /// Finds the subject of some options.
    pub(crate) fn find(options: &WorkbenchOptions) -> Result<Self> {
        let name = options.subject.clone().unwrap_or_else(|| fluorspar_experiment::DEFAULT_EXPERIMENT.into());
        let changes = options.changes.clone();
        let subject = |stage, waiting, changes| Self {
            stage: Mutex::new(stage),
            progress: Arc::default(),
            waiting: Mutex::new(waiting),
            name: name.clone(),
            changes,
        };
        if let Some(path) = image_of(options.subject.as_deref())? {
            let live = LiveRender::open(&path)?;
            live.show(&changes)?;
            return Ok(subject(Stage::Ready(Arc::new(live)), None, changes));
        }
        let source = ExperimentSource::find(options.subject.as_deref())?;
        let text = first_text(&source, options)?;
        // What the render was made with is no difference to it any more
        Ok(subject(Stage::Rendering, Some(Waiting { source, text }), Changes::default()))
    }

    /// How far it is.
    pub(crate) fn stage(&self) -> Stage {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Share of the render that is done, 0 to 1, and what is done or was said last.
    pub(crate) fn progress(&self) -> (f64, String) {
        let said = self.progress.said.lock().unwrap_or_else(PoisonError::into_inner).clone();
        (f64::from(self.progress.permille.load(Ordering::Relaxed)) / 1000.0, said)
    }

    /// Begins to render in a thread of its own, where that is to be done.
    pub(crate) fn begin(self: &Arc<Self>, stop: &Arc<AtomicBool>) {
        let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(waiting) = waiting else { return };
        let (subject, job) = (Arc::clone(self), Job::new(Arc::clone(stop), self.progress.clone()));
        thread::spawn(move || {
            let stage = match rendered(&waiting, &job) {
                Ok(live) => Stage::Ready(Arc::new(live)),
                Err(error) => Stage::Failed(said(&error)),
            };
            *subject.stage.lock().unwrap_or_else(PoisonError::into_inner) = stage;
        });
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

/// The component image that a subject names; `None` of an experiment.
fn image_of(subject: Option<&str>) -> Result<Option<PathBuf>> {
    let Some(path) = subject.map(Path::new) else { return Ok(None) };
    if path.is_dir() {
        let image = path.join("components.exr");
        return match image.is_file() {
            true => Ok(Some(image)),
            false => Err(Error::Input(format!(
                "{}: this folder has no components.exr; give one that `run` wrote, a component image, or an experiment",
                path.display()
            ))),
        };
    }
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    Ok(matches!(ending.as_deref(), Some("exr" | "npy")).then(|| path.to_path_buf()))
}

/// The text of an experiment with its changes, and with fewer pixels and samples, where these do not set them.
fn first_text(source: &ExperimentSource, options: &WorkbenchOptions) -> Result<String> {
    let typed = options.changes.overrides();
    let render = source.parse(&typed)?.file.render;
    let is_set = |path: &str| options.changes.set.iter().any(|set| set.trim_start().starts_with(path));
    let part = |path: &str, value: u32| {
        let value = (value * QUICK[0] / QUICK[1]).max(1);
        (!is_set(path)).then(|| Override::of_option(path, value, "⟨spp⟩".into()))
    };
    let spp = Override::of_option("render.samples_per_pixel", options.spp, format!("⟨spp={}⟩", options.spp));
    let quick = [part("render.width_px", render.width_px), part("render.height_px", render.height_px), Some(spp)];
    let all: Vec<Override> = quick.into_iter().flatten().chain(typed).collect();
    let changes = all.iter().map(|one| SceneChange::read(&one.set)).collect::<Result<Vec<_>, _>>()?;
    let edited = edit_experiment(&source.text, &source.name, &source.base_dir, &changes);
    Ok(edited.map_err(|error| as_typed(error, &all))?)
}

fn rendered(waiting: &Waiting, job: &Job) -> Result<LiveRender> {
    let Waiting { source, text } = waiting;
    job.listener.status("Preparing the scene");
    let source = ExperimentSource {
        name: source.name.clone(),
        stem: source.stem.clone(),
        text: text.clone(),
        base_dir: source.base_dir.clone(),
        file: source.file.clone(),
    };
    let parsed = source.parse(&[])?;
    let experiment = source.resolve(&[])?;
    job.listener.warnings(&warnings_before_run(&experiment));
    let study = &experiment.study;
    check_nothing_painted(study)?;
    check_memory(study, "or give the folder of a finished run")?;
    let mut image = render_scene(&study.scene, &study.render, study.time_limit_s, job)?;
    if job.is_stopped() {
        return Err(Error::Stopped("the render was stopped".into()));
    }
    image.round_to_24_bits();
    Ok(LiveRender::of_image(Arc::new(image), Arc::new(parsed), &source, text.clone()))
}

/// An error as the page says it: options are changes there.
pub(crate) fn said(error: &Error) -> String {
    worded(&error.to_string(), |name, value| match (name, value) {
        ("set", Some(value)) => value.to_owned(),
        (name, Some(value)) => format!("{name} {value}"),
        (name, None) => name.to_owned(),
    })
}

/// Refuses changes that name files: the page changes what is there, and reads nothing from the disk.
pub(crate) fn check_no_files(changes: &Changes) -> Result<()> {
    for text in sets(&changes.overrides()) {
        let value = text.split_once('=').map_or("", |(_, value)| value);
        let texts = value.split(['"', '\'']).skip(1).step_by(2);
        let bare = value.trim().parse::<toml::Value>().is_err().then_some(value);
        let is_file = |text: &str| text.contains(['/', '\\']) || text.contains('.');
        if texts.chain(bare).any(is_file) {
            return Err(Error::Input(format!(
                "⟨set={text}⟩: the workbench reads no files; give a name of the catalogue, or start it with an experiment that names the \
                 file"
            )));
        }
    }
    Ok(())
}

/// Hears how far a render is.
#[derive(Default)]
struct Progress {
    permille: Arc<AtomicU32>,
    said: Mutex<String>,
}

impl Listener for Progress {
    fn status(&self, text: &str) {
        let first = text.lines().next().unwrap_or_default();
        first.clone_into(&mut self.said.lock().unwrap_or_else(PoisonError::into_inner));
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
