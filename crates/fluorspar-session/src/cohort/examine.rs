//! The loop over people and views: each is rendered once, and handed to what is done with it.

use std::fmt::Display;

use fluorspar::image::ComponentImage;
use fluorspar::render::{RenderControl, RenderProgress, render};
use fluorspar_experiment::{CohortStudy, ExaminationView, ExperimentError, ResolvedExperiment, resolve};

use crate::{Error, Job, Left, Result};

/// A view of a person before it is rendered.
pub(crate) struct Examination {
    person: u32,
    view: &'static ExaminationView,
    pub(crate) experiment: ResolvedExperiment,
}

/// A view of a person as it was rendered.
pub(crate) struct ExaminedView<'a> {
    /// Number of the person.
    pub(crate) person: u32,
    /// The view.
    pub(crate) view: &'static ExaminationView,
    /// Scene, camera, captures and analysis.
    pub(crate) experiment: &'a ResolvedExperiment,
    /// The render.
    pub(crate) components: &'a ComponentImage,
}

impl ExaminedView<'_> {
    /// An error of this view.
    pub(crate) fn failed(&self, error: impl Display) -> Error {
        Error::Input(format!("person {}, view {}: {error}", self.person, self.view.name))
    }
}

impl Examination {
    /// Makes the mouth and solves the tissues of a person.
    pub(super) fn prepare(
        cohort: &CohortStudy,
        person: u32,
        view: &'static ExaminationView,
    ) -> Result<Self, ExperimentError> {
        Ok(Self { person, view, experiment: resolve(&cohort.experiment_of(person, view)?)? })
    }
}

/// Renders views in their order and gives each to `take`; the next one is prepared meanwhile. `first` is the first view of the cohort,
/// which is prepared already.
///
/// # Errors
/// A view that can't be prepared or rendered, what `take` fails with, and a job that is stopped: what `take` had is done.
pub(super) fn each_view(
    cohort: &CohortStudy,
    places: &[(u32, &'static ExaminationView)],
    first: Examination,
    job: &Job,
    mut take: impl FnMut(&ExaminedView<'_>) -> Result<()> + Send,
) -> Result<()> {
    let prepared = |(person, view): (u32, &'static ExaminationView)| {
        let failed = |error| Error::Input(format!("person {person}, view {}: {error}", view.name));
        Examination::prepare(cohort, person, view).map_err(failed)
    };
    let Some(&place) = places.first() else { return Ok(()) };
    let is_first = (first.person, first.view.name) == (place.0, place.1.name);
    let mut next = Some(if is_first { first } else { prepared(place)? });
    let share_done = job.listener.begin("Examining people", "the examination", Left::Results);
    for number in 0..places.len() {
        let Some(current) = next.take() else { break };
        let control = RenderControl {
            stop: &job.stop,
            progress: &|p: RenderProgress| {
                let share = p.paths_done as f64 / p.paths_total.max(1) as f64;
                share_done((number as f64 + share) / places.len() as f64);
            },
        };
        let examine = || -> Result<()> {
            let study = &current.experiment.study;
            let mut components = render(&study.scene, &study.render, &control)?;
            if job.is_stopped() {
                let all = places.len();
                let text =
                    format!("stopped after {number} of {all} views; the same command goes on from there");
                return Err(Error::Stopped(text));
            }
            // As a run keeps them
            components.round_as_stored();
            let (person, view) = (current.person, current.view);
            take(&ExaminedView { person, view, experiment: &current.experiment, components: &components })
        };
        let following = places.get(number + 1).filter(|_| !job.is_stopped());
        let (examined, following) =
            rayon::join(examine, || following.map(|place| prepared(*place)).transpose());
        examined?;
        next = following?;
    }
    Ok(())
}
