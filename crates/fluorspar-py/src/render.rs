//! Renders.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use fluorspar::image::Film;
use fluorspar::render::{RenderControl, RenderProgress, render_sums};
use fluorspar_format::Provenance;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

use crate::components::Components;
use crate::error::{RenderStopped, failed};
use crate::experiment::Experiment;
use crate::process::{work, work_through};

/// Renders an experiment. `progress` is called with the paths done and all paths, some 50 times a second, in the calling thread.
/// After `time_limit_s` seconds the image holds the samples so far.
#[pyfunction]
#[pyo3(signature = (experiment, *, threads = None, time_limit_s = None, progress = None))]
pub(crate) fn render(
    experiment: &Bound<'_, Experiment>,
    threads: Option<usize>,
    time_limit_s: Option<f64>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<Components> {
    let py = experiment.py();
    let resolved = experiment.get().resolved(py, threads).map_err(|error| before_any_image(py, error))?;
    let study = &resolved.study;
    let (stop, done, total) = (AtomicBool::new(false), AtomicU64::new(0), AtomicU64::new(0));
    let limit = time_limit_s.or(study.time_limit_s);
    let started = Instant::now();
    let report = |p: RenderProgress| {
        done.fetch_max(p.paths_done, Ordering::Relaxed);
        total.store(p.paths_total, Ordering::Relaxed);
        // Pixels without any sample would be black, and numbers made from them wrong.
        let has_all = p.paths_done.saturating_mul(u64::from(study.render.samples_per_pixel)) >= p.paths_total;
        if has_all && limit.is_some_and(|limit| started.elapsed().as_secs_f64() > limit) {
            stop.store(true, Ordering::SeqCst);
        }
    };
    let mut told = (0, 0);
    let tell = |_: Python<'_>| {
        let now = (done.load(Ordering::Relaxed), total.load(Ordering::Relaxed));
        match &progress {
            Some(progress) if now != told && now.1 > 0 => {
                told = now;
                progress.call1(now).map(|_| ())
            }
            _ => Ok(()),
        }
    };
    let control = RenderControl { stop: &stop, progress: &report };
    let rendered = work(
        py,
        threads,
        || render_sums(&study.scene, &study.render, &control),
        || stop.store(true, Ordering::SeqCst),
        tell,
    );
    let (rendered, raised) = rendered.map_err(|error| before_any_image(py, error))?;
    let film = rendered.map_err(failed)?;
    let Some(raised) = raised else { return finished(experiment, film, threads) };
    if !raised.is_instance_of::<PyKeyboardInterrupt>(py) {
        return Err(raised);
    }
    let stopped = RenderStopped::new_err("the render was interrupted; .partial holds the samples so far");
    let unfinished =
        UnfinishedRender { experiment: experiment.clone().unbind(), film: Mutex::new(Some(film)) };
    stopped.value(py).setattr("unfinished", Py::new(py, unfinished)?)?;
    Err(stopped)
}

/// Ctrl-C during the preparation of a render, which has no image yet; any other error stays as it is.
fn before_any_image(py: Python<'_>, error: PyErr) -> PyErr {
    if !error.is_instance_of::<PyKeyboardInterrupt>(py) {
        return error;
    }
    RenderStopped::new_err("the render was interrupted while it was being prepared; there is no image yet")
}

/// What a render had when Ctrl-C ended it.
#[pyclass(frozen, module = "fluorspar._fluorspar")]
pub(crate) struct UnfinishedRender {
    experiment: Py<Experiment>,
    film: Mutex<Option<Film>>,
}

#[pymethods]
impl UnfinishedRender {
    /// The image so far, the first time; then, and where some pixel has no sample yet, `None`.
    fn take(&self, py: Python<'_>) -> PyResult<Option<Components>> {
        let film = self.film.lock().ok().and_then(|mut film| film.take());
        let components = film.map(|film| finished(self.experiment.bind(py), film, None)).transpose()?;
        Ok(components.filter(|components| components.image.samples_per_pixel > 0))
    }
}

/// The image of a film.
fn finished(experiment: &Bound<'_, Experiment>, film: Film, threads: Option<usize>) -> PyResult<Components> {
    let py = experiment.py();
    let resolved = experiment.get().resolved(py, threads)?;
    let image = work_through(py, threads, || {
        let mut image = film.into_image();
        // As `run` and the files of a run have it
        image.round_as_stored();
        image
    })?;
    let provenance = Provenance::new(
        experiment.get().text(),
        resolved.record.resolved_toml.clone(),
        resolved.study.render.seed,
        image.samples_per_pixel,
    );
    Ok(Components::new(image, Some(provenance), Some(experiment.clone().unbind())))
}
