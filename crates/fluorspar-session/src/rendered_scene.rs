//! Whether a finished render shows the scene of an experiment, and what makes it do so.

use std::collections::BTreeMap;

use fluorspar::image::{ComponentFactors, ComponentImage, ExcitationImage, LightPath, RelitComponent};
use fluorspar::light::Light;
use fluorspar::pipeline::{PipelineError, check_same_scene, concentration_factors, relight_with_basis};
use fluorspar::scene::Scene;
use fluorspar::study::Study;
use fluorspar_experiment::schema::ConcentrationFactor;
use fluorspar_experiment::{
    CapturesOfRender, Experiment, ExperimentError, ResolvedExperiment, resolve, resolve_captures,
    resolve_rendered, show_the_same_scene,
};

use crate::Result;

/// A component image and the experiment that it was rendered from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RenderedScene<'a> {
    /// The component image, of which only the labels count.
    pub(crate) labels: &'a ComponentImage,
    /// Its experiment; `None` where the image carries none.
    pub(crate) experiment: Option<&'a Experiment>,
}

/// What makes a finished render show another scene.
#[derive(Clone, Debug)]
pub struct SceneChanges<'a> {
    /// Factors on the components.
    pub factors: ComponentFactors,
    /// For each component what takes its place under another light, if anything does.
    pub relit: Vec<Option<RelitComponent<'a>>>,
    /// Lights of the render, where others may shine now.
    pub lights: Option<Vec<Light>>,
    /// Light groups whose spectra changed, with the estimated relative error of their light.
    pub light_errors: Vec<(String, f64)>,
}

/// Even factors on the concentrations of fluorophores, by name.
type ConcentrationFactors = BTreeMap<String, f64>;

impl RenderedScene<'_> {
    /// The captures of an experiment that shows the same scene, and what they make of the image, without surfaces: no mesh or tissue is
    /// needed ([`resolve_captures`]). `None` where more has changed.
    ///
    /// # Errors
    /// The first defect of the experiment; concentrations that the image can't be scaled to.
    pub(crate) fn captures(
        &self,
        now: &Experiment,
    ) -> Result<Option<(CapturesOfRender, SceneChanges<'static>)>> {
        let Some(rendered) = self.experiment else { return Ok(None) };
        let mut held: Vec<&str> = Vec::new();
        for component in &self.labels.components {
            if let LightPath::Fluorescence(name) = &component.light
                && !held.contains(&name.as_str())
            {
                held.push(name);
            }
        }
        let Some(found) = resolve_captures(rendered, now, &held)? else { return Ok(None) };
        let changes = self.of_concentrations(&even_factors(rendered), &found.study)?;
        Ok(Some((found, changes)))
    }

    /// What makes the image show the scene of an experiment. `basis` gives the excitation basis of the image; it is asked where lights
    /// emit otherwise.
    ///
    /// # Errors
    /// A scene that only a new render can show, if `is_same` is demanded; what `basis` fails with.
    pub(crate) fn changes<'b>(
        &self,
        now: &Experiment,
        resolved: &ResolvedExperiment,
        is_same: bool,
        basis: impl FnOnce() -> Result<Option<&'b ExcitationImage>>,
    ) -> Result<SceneChanges<'b>> {
        let study = &resolved.study;
        let Some(experiment) = self.experiment else {
            return Ok(self.of_concentrations(&BTreeMap::new(), study)?);
        };
        let concentrations = even_factors(experiment);
        if show_the_same_scene(experiment, now) {
            return Ok(self.of_concentrations(&concentrations, study)?);
        }
        let rendered = rendered_study(experiment, now, resolved)?;
        let mut shown = rendered.clone();
        let (mut relit, mut light_errors) = (vec![None; self.labels.components.len()], Vec::new());
        if emits_otherwise(&shown.scene, &study.scene)
            && let Some(basis) = basis()?
        {
            let found = relight_with_basis(&shown, study, self.labels, basis)?;
            (shown, relit, light_errors) = (found.shown, found.components, found.changed);
        }
        if is_same {
            check_same_scene(&shown, study)?;
        }
        let factors = concentration_factors(&concentrations, study, self.labels)?;
        Ok(SceneChanges { factors, relit, lights: Some(rendered.scene.lights), light_errors })
    }

    /// Changes where nothing but concentrations differs from the render.
    fn of_concentrations<'b>(
        &self,
        rendered: &ConcentrationFactors,
        study: &Study,
    ) -> Result<SceneChanges<'b>, PipelineError> {
        let factors = concentration_factors(rendered, study, self.labels)?;
        let relit = vec![None; self.labels.components.len()];
        Ok(SceneChanges { factors, relit, lights: None, light_errors: Vec::new() })
    }
}

/// The study that an image was rendered from, with the surfaces and concentrations of an experiment.
fn rendered_study(
    rendered: &Experiment,
    now: &Experiment,
    resolved: &ResolvedExperiment,
) -> Result<Study, ExperimentError> {
    if let Some(study) = resolve_rendered(rendered, now, resolved)? {
        return Ok(study);
    }
    // Factors on concentrations are no difference of the scenes
    let mut rendered = rendered.clone();
    rendered.file.concentration.clone_from(&now.file.concentration);
    Ok(resolve(&rendered)?.study)
}

/// Factors on concentrations that hold everywhere.
fn even_factors(experiment: &Experiment) -> ConcentrationFactors {
    let even = |(name, factor): (&String, &ConcentrationFactor)| match factor {
        ConcentrationFactor::Even(factor) => Some((name.clone(), *factor)),
        ConcentrationFactor::Painted(_) => None,
    };
    experiment.file.concentration.iter().filter_map(even).collect()
}

/// Whether lights or surfaces of two scenes differ in what they emit.
fn emits_otherwise(a: &Scene, b: &Scene) -> bool {
    let surfaces =
        |scene: &Scene| scene.objects.iter().map(|object| object.emission.clone()).collect::<Vec<_>>();
    a.lights != b.lights || surfaces(a) != surfaces(b)
}
