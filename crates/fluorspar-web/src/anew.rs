//! Renders what only a new render can show: a coarse picture first, then finer ones, until another scene is wanted.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use fluorspar::interruption::{Interrupted, listen_to};
use fluorspar::optics::PerspectiveCamera;
use fluorspar::study::Study;
use fluorspar_experiment::{Experiment, check_settings, resolve, resolve_rendered, show_the_same_scene};
use fluorspar_session::values::as_typed;
use fluorspar_session::{
    Changes, Error, FinishedRender, Job, LiveRender, Result, check_memory, check_nothing_painted,
    render_scene, render_with_excitation_basis,
};
use rayon::ThreadPoolBuilder;
use serde::Serialize;

use crate::subject::{Progress, lock, said};

/// Renders of changed scenes.
pub(crate) struct Anew {
    /// Samples per pixel of a finished one.
    spp: u32,
    /// The newest first.
    scenes: Mutex<Vec<Arc<LiveRender>>>,
    /// The finished render of the experiment without changes, where the first one is coarse.
    unchanged: Mutex<Option<Arc<LiveRender>>>,
    work: Mutex<Option<Work>>,
}

/// A render in work, or the last one.
struct Work {
    experiment: Experiment,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
    progress: Arc<Progress>,
    told: Arc<Told>,
}

/// How far a render is, and who waits to hear of it.
#[derive(Default)]
struct Told(Mutex<Stand>, Condvar);

/// How far a render is.
#[derive(Clone, Default, Serialize)]
pub(crate) struct Stand {
    /// Pictures that are there, each finer than the one before.
    level: usize,
    /// Whether there will be no further one.
    is_over: bool,
    /// Share of the next one that is done, 0 to 1, and what is done.
    share: f64,
    said: String,
    /// Why there is no further one.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

impl Stand {
    /// Of a scene in whose place another page had another one rendered.
    fn given_up() -> Self {
        let error = "Another page had another scene rendered; choose Render to have this one.".into();
        Self { is_over: true, error: Some(error), ..Self::default() }
    }
}

/// Parts of width and height that are rendered one after the other before the whole, and their samples per pixel.
const PARTS: [usize; 2] = [4, 2];
const COARSE_SAMPLES: u32 = 2;
/// Least width of a coarse image, px.
const LEAST_WIDTH: usize = 48;
/// Scenes that are kept to come back to.
const KEPT_SCENES: usize = 2;
/// Longest wait for the next picture before the progress is told: a wish for another scene waits no longer.
const LOOK: Duration = Duration::from_millis(80);

impl Told {
    fn change(&self, change: impl FnOnce(&mut Stand)) {
        change(&mut lock(&self.0));
        self.1.notify_all();
    }

    /// How far it is, once there are more pictures than a number or it is over, or a moment later.
    fn beyond(&self, level: usize) -> Stand {
        let stand = lock(&self.0);
        let is_same = |stand: &mut Stand| stand.level <= level && !stand.is_over;
        let waited = self.1.wait_timeout_while(stand, LOOK, is_same);
        waited.unwrap_or_else(PoisonError::into_inner).0.clone()
    }
}

impl Anew {
    pub(crate) fn new(spp: u32) -> Self {
        Self { spp, scenes: Mutex::default(), unchanged: Mutex::default(), work: Mutex::default() }
    }

    /// The render that shows the experiment with changes: one that was made of them, or else the first one.
    pub(crate) fn shown(&self, first: &Arc<LiveRender>, changes: &Changes) -> Arc<LiveRender> {
        let (scenes, unchanged) = (lock(&self.scenes).clone(), lock(&self.unchanged).clone());
        let all: Vec<Arc<LiveRender>> =
            scenes.into_iter().chain(unchanged).chain([Arc::clone(first)]).collect();
        let own = |is: &dyn Fn(&LiveRender) -> Result<bool>| {
            all.iter().find(|live| is(live).unwrap_or(false)).map(Arc::clone)
        };
        if all.len() == 1 {
            return Arc::clone(first);
        }
        own(&|live| live.is_of(changes))
            .or_else(|| own(&|live| Ok(live.has_surfaces_of(changes)? && live.show(changes).is_ok())))
            .unwrap_or_else(|| Arc::clone(first))
    }

    /// Renders the experiment with changes, unless that is in work, in place of what is; tells how far it is once there are more pictures
    /// than `seen`. One that failed or was stopped begins again where nothing was `seen`.
    ///
    /// # Errors
    /// A change that can't be made.
    pub(crate) fn render(
        self: &Arc<Self>,
        first: &Arc<LiveRender>,
        changes: &Changes,
        seen: Option<usize>,
    ) -> Result<Stand> {
        let experiment = self.experiment_of(first, changes, &[])?;
        let mut work = lock(&self.work);
        let is_same = |work: &Work| {
            (seen.is_some() || lock(&work.told.0).error.is_none() && !work.stop.load(Ordering::SeqCst))
                && show_the_same_scene(&work.experiment, &experiment)
        };
        let is_of_page = work.as_ref().is_some_and(is_same);
        if seen.is_some() && work.is_some() && !is_of_page {
            return Ok(Stand::given_up());
        }
        if !is_of_page {
            check_settings(&experiment).map_err(|error| as_typed(error, &changes.overrides()))?;
            let before = work.take();
            *work = Some(self.begin(first, changes.clone(), experiment, before));
        }
        let of_work = |work: &Work| (Arc::clone(&work.told), Arc::clone(&work.progress));
        let Some((told, progress)) = work.as_ref().map(of_work) else { return Ok(Stand::default()) };
        drop(work);
        let stand = told.beyond(seen.unwrap_or(0));
        let (share, said) = progress.told();
        Ok(Stand { share, said, ..stand })
    }

    /// Ends the render in work.
    pub(crate) fn stop(&self) {
        if let Some(work) = lock(&self.work).as_ref() {
            work.stop.store(true, Ordering::SeqCst);
        }
    }

    fn begin(
        self: &Arc<Self>,
        first: &Arc<LiveRender>,
        changes: Changes,
        experiment: Experiment,
        before: Option<Work>,
    ) -> Work {
        let (stop, told, progress) = (Arc::<AtomicBool>::default(), Arc::<Told>::default(), Arc::default());
        if let Some(before) = &before {
            before.stop.store(true, Ordering::SeqCst);
        }
        let job = Job::new(Arc::clone(&stop), Arc::<Progress>::clone(&progress));
        let (anew, first, heard, whole) =
            (Arc::clone(self), Arc::clone(first), Arc::clone(&told), experiment.clone());
        let thread = thread::spawn(move || {
            // Two renders at once would both be late
            if let Some(before) = before {
                let _ = before.thread.join();
            }
            let done = in_own_threads(&job, || anew.pictures(&first, &changes, &whole, &job, &heard));
            heard.change(|stand| {
                (stand.is_over, stand.error) = (true, done.err().map(|error| said(&error)));
            });
        });
        Work { experiment, stop, thread, progress, told }
    }

    /// The experiment with changes, further ones, and the samples of a render of the page.
    fn experiment_of(&self, first: &LiveRender, changes: &Changes, further: &[String]) -> Result<Experiment> {
        let is_given = changes.set.iter().any(|set| set.starts_with("render.samples_per_pixel"));
        let samples = (!is_given).then(|| format!("render.samples_per_pixel={}", self.spp));
        let set = changes.set.iter().cloned().chain(samples).chain(further.iter().cloned()).collect();
        first.experiment(&Changes { set, unset: changes.unset.clone() })
    }

    /// Makes one picture after the other.
    fn pictures(
        &self,
        first: &LiveRender,
        changes: &Changes,
        whole: &Experiment,
        job: &Job,
        told: &Told,
    ) -> Result<()> {
        job.status("Preparing the scene");
        let resolved;
        let (kept, resolved) = match first.surfaces_of(whole) {
            Some((kept, resolved)) => (kept, resolved),
            None => {
                resolved = resolve(whole).map_err(|error| as_typed(error, &changes.overrides()))?;
                (whole, &resolved)
            }
        };
        let study = |experiment: &Experiment| match resolve_rendered(experiment, kept, resolved)? {
            Some(study) => Ok::<_, Error>(study),
            None => Ok(resolve(experiment)?.study),
        };
        let size = study(whole)?;
        check_nothing_painted(&size)?;
        check_memory(&size, "or take the change back")?;
        let coarse = parts(&size.scene.camera);
        let is_there = first.is_coarse() && first.is_of(changes)?;
        for set in coarse.into_iter().skip(usize::from(is_there)).map(Some).chain([None]) {
            let further = set.iter().flat_map(Part::changes).collect::<Vec<_>>();
            let experiment = self.experiment_of(first, changes, &further)?;
            let render = rendered(&study(&experiment)?, experiment, job)?;
            let live = Arc::new(first.with_render(render, set.map(|part| part.size).unwrap_or_default()));
            if !live.is_coarse() && changes.set.is_empty() {
                *lock(&self.unchanged) = Some(Arc::clone(&live));
            }
            self.keep(live);
            told.change(|stand| stand.level += 1);
        }
        Ok(())
    }

    /// Keeps a render in place of coarser ones.
    fn keep(&self, live: Arc<LiveRender>) {
        let mut scenes = lock(&self.scenes);
        scenes.retain(|kept| !kept.is_coarse());
        scenes.insert(0, live);
        scenes.truncate(KEPT_SCENES);
    }
}

/// A render that is smaller than its experiment says: its size, as changes, and its samples.
pub(crate) struct Part {
    pub(crate) size: Vec<String>,
}

impl Part {
    pub(crate) fn changes(&self) -> impl Iterator<Item = String> + '_ {
        self.size.iter().cloned().chain([format!("render.samples_per_pixel={COARSE_SAMPLES}")])
    }
}

/// Coarse renders before that of a camera, the smallest first.
pub(crate) fn parts(camera: &PerspectiveCamera) -> Vec<Part> {
    let (width, height) = (camera.width, camera.height);
    let part = |part: usize| Part {
        size: vec![
            format!("render.width_px={}", width / part),
            format!("render.height_px={}", (height / part).max(1)),
        ],
    };
    PARTS.into_iter().filter(|part| width / part >= LEAST_WIDTH).map(part).collect()
}

/// Does work in threads that end with a job. A defect of the program ends the work alone.
pub(crate) fn in_own_threads<T: Send>(job: &Job, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    let stop = Arc::clone(&job.stop);
    let pool = ThreadPoolBuilder::new().start_handler(move |_| listen_to(Arc::clone(&stop)));
    let pool = pool.build().map_err(|error| Error::Failed(format!("no threads: {error}")))?;
    catch_unwind(AssertUnwindSafe(|| pool.install(work))).unwrap_or_else(|why| {
        Err(match why.is::<Interrupted>() {
            true => stopped(),
            false => Error::Input("the render ended by a defect of the program".into()),
        })
    })
}

fn stopped() -> Error {
    Error::Stopped("the render was stopped".into())
}

/// Renders a study.
///
/// # Errors
/// A scene that can't be rendered; a job that was stopped.
pub(crate) fn rendered(study: &Study, experiment: Experiment, job: &Job) -> Result<FinishedRender> {
    let (mut image, basis) = match &study.render.excitation_basis {
        None => (render_scene(&study.scene, &study.render, study.time_limit_s, job)?, None),
        Some(basis) => {
            let (image, basis) = render_with_excitation_basis(study, basis, job)?;
            (image, Some(basis))
        }
    };
    if job.is_interrupted() {
        return Err(stopped());
    }
    image.round_as_stored();
    let render = FinishedRender::of_image(Arc::new(image), Some(Arc::new(experiment)));
    Ok(match basis {
        Some(basis) => render.with_basis(basis),
        None => render,
    })
}
