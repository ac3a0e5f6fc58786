//! A finished render whose experiment changes again and again: frames, estimates and spectra without a new render.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use fluorspar::analysis::PixelSelection;
use fluorspar::image::{LightPath, SpectralImage};
use fluorspar::interruption::end_if_interrupted;
use fluorspar::pipeline::{
    AnalyzedFrame, CapturedFrame, LiveView, PipelineError, RecentExposures, RegionRadiance, analyze_regions,
    analyze_seen, capture_from_planes, capture_one, check_captures, depth_range_m, frame_radiance, on_sensor,
};
use fluorspar::render::visible_surfaces;
use fluorspar::scene::Scene;
use fluorspar::spectral::Radiance;
use fluorspar::study::{AnalysisPlan, Capture, Study};
use fluorspar_experiment::schema::{ExperimentFile, ExposureTime};
use fluorspar_experiment::{
    Experiment, ResolvedExperiment, SceneChange, cached_analysis, edit_experiment, parse, resolve,
    resolve_captures, resolve_rendered, resolve_shapes, section_of_other_surfaces, show_the_same_scene,
};
use fluorspar_report::ReportData;

use crate::analyze::looked_at;
use crate::frame_report::FrameReport;
use crate::region_option::{RegionOption, region_options};
use crate::values::{Override, as_typed, sets};
use crate::{
    CaptureView, Changes, Error, ExperimentSource, FinishedRender, Result, SceneChanges, ShownExperiment,
    Wanted, as_typed_in_session,
};

/// A finished render and the text of its experiment, on top of which changes come.
pub struct LiveRender {
    render: FinishedRender,
    name: String,
    text: String,
    /// The same with the size and samples that the user has, where the render was made with fewer.
    own_text: String,
    base_dir: PathBuf,
    /// The size of a coarse render, as changes after all others; none of one as large as its experiment says.
    coarse: Vec<String>,
    /// What captures saw of late, the last first.
    seen: Mutex<Vec<KeptView>>,
    /// What frames subtract, exposed of late.
    exposed: RecentExposures,
    /// The rendered experiment with its surfaces, once a change of the lights asked for them.
    surfaces: OnceLock<(Experiment, ResolvedExperiment)>,
    /// The shapes that were asked for last.
    shapes: Mutex<Option<Arc<Shapes>>>,
    /// The last analysis, with the changes and the region that it is of.
    analyzed: Mutex<Option<(Vec<String>, Arc<AnalyzedFrame>)>>,
}

/// The shapes of an experiment, gray and without light, before its camera.
pub struct Shapes {
    /// What they were asked for with, and what that is.
    changes: Changes,
    experiment: Experiment,
    /// The shapes and the camera.
    pub scene: Scene,
    /// How far the middle of what the camera sees is away, m.
    pub distance_m: f32,
}

/// What captures saw.
struct KeptView {
    /// The experiment, as far as it matters.
    file: ExperimentFile,
    captures: Vec<String>,
    view: Arc<CaptureView>,
}

/// An experiment with changes, as a finished render shows it.
pub struct LiveStudy<'a> {
    live: &'a LiveRender,
    parsed: Experiment,
    overrides: Vec<Override>,
    experiment: ResolvedExperiment,
    changes: SceneChanges<'a>,
}

/// Views that are kept: of the frame that is shown, of those that are analyzed, and of one to come back to.
const KEPT_VIEWS: usize = 3;

/// Name of the region that an estimate is asked for.
const DRAWN: &str = "drawn";

impl LiveRender {
    /// Opens a component file with the experiment that it carries.
    ///
    /// # Errors
    /// A file that can't be read, holds no components or carries no experiment.
    pub fn open(path: &Path) -> Result<Self> {
        let render = FinishedRender::open_to_stay(path)?;
        let text = render.experiment_text()?.to_owned();
        let name = format!("experiment in {}", render.name());
        Ok(Self::new(render, name, text, PathBuf::from(".")))
    }

    /// A render that was just made from an experiment with its surfaces, on top of which changes come. `own_text` is the experiment as the
    /// user has it, with other numbers of pixels and samples. `coarse` is the size of one that is smaller than the experiment says, as
    /// changes.
    pub fn of_render(
        render: FinishedRender,
        source: ExperimentSource,
        own_text: String,
        surfaces: (Experiment, ResolvedExperiment),
        coarse: Vec<String>,
    ) -> Self {
        let ExperimentSource { name, text, base_dir, .. } = source;
        let surfaces = OnceLock::from(surfaces);
        Self { coarse, surfaces, own_text, ..Self::new(render, name, text, base_dir) }
    }

    /// An experiment that is resolved already and has the surfaces of another one, where there is one.
    pub fn surfaces_of(&self, now: &Experiment) -> Option<&(Experiment, ResolvedExperiment)> {
        let has_them = |(kept, resolved): &&(Experiment, ResolvedExperiment)| {
            matches!(resolve_rendered(now, kept, resolved), Ok(Some(_)))
        };
        self.surfaces.get().filter(has_them)
    }

    fn new(render: FinishedRender, name: String, text: String, base_dir: PathBuf) -> Self {
        let (seen, surfaces, shapes) = (Mutex::default(), OnceLock::new(), Mutex::default());
        let (coarse, analyzed, own_text) = (Vec::new(), Mutex::default(), text.clone());
        let exposed = RecentExposures::default();
        Self { exposed, render, name, text, own_text, base_dir, coarse, seen, surfaces, shapes, analyzed }
    }

    /// Another render, of the same experiment with changes: these still come on top of the same text. `coarse` is the size of one that is
    /// smaller than these say, as changes.
    #[must_use]
    pub fn with_render(&self, render: FinishedRender, coarse: Vec<String>) -> Self {
        let own_text = self.own_text.clone();
        Self {
            coarse,
            own_text,
            ..Self::new(render, self.name.clone(), self.text.clone(), self.base_dir.clone())
        }
    }

    /// Names of the fluorophores whose light the render holds, each once.
    pub fn fluorophores(&self) -> Vec<&str> {
        fluorophores(&self.render)
    }

    /// Whether it is smaller than its experiment says.
    pub fn is_coarse(&self) -> bool {
        !self.coarse.is_empty()
    }

    /// Whether its scene is that of the experiment with changes, by another camera at most. Tells that in milliseconds.
    ///
    /// # Errors
    /// A change that can't be made.
    pub fn is_of(&self, changes: &Changes) -> Result<bool> {
        Ok(self.render.shown_without_surfaces(&self.sized(changes)?)?.is_some())
    }

    /// Whether its surfaces are those of the experiment with changes.
    ///
    /// # Errors
    /// A change that can't be made.
    pub fn has_surfaces_of(&self, changes: &Changes) -> Result<bool> {
        let now = self.sized(changes)?;
        Ok(self.render.experiment()?.is_some_and(|own| section_of_other_surfaces(own, &now).is_none()))
    }

    /// The shapes of the experiment with changes, rendered or not; the last ones are kept.
    ///
    /// # Errors
    /// A change that can't be made; shapes that can't be.
    pub fn shapes(&self, changes: &Changes) -> Result<Arc<Shapes>> {
        let lock = || self.shapes.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = lock().clone();
        if let Some(kept) = kept.as_ref().filter(|kept| kept.changes.set == changes.set) {
            return Ok(Arc::clone(kept));
        }
        let now = self.experiment(changes)?;
        if let Some(kept) = kept.filter(|kept| show_the_same_scene(&kept.experiment, &now)) {
            return Ok(kept);
        }
        let scene = resolve_shapes(&now).map_err(|error| as_typed(error, &changes.overrides()))?;
        let [near, far] = depth_range_m(&visible_surfaces(&scene, &scene.camera)).unwrap_or([1.0; 2]);
        let changes = changes.clone();
        let shapes = Arc::new(Shapes { changes, experiment: now, scene, distance_m: 0.5 * (near + far) });
        *lock() = Some(Arc::clone(&shapes));
        Ok(shapes)
    }

    /// The experiment with changes, of the size of the render.
    fn sized(&self, changes: &Changes) -> Result<Experiment> {
        let set = changes.set.iter().chain(&self.coarse).cloned().collect();
        self.experiment(&Changes { set, unset: changes.unset.clone() })
    }

    /// The render.
    pub fn render(&self) -> &FinishedRender {
        &self.render
    }

    /// The experiment with changes.
    ///
    /// # Errors
    /// A change that can't be made.
    pub fn experiment(&self, changes: &Changes) -> Result<Experiment> {
        let overrides = changes.overrides();
        let parsed = parse(&self.text, &self.name, &self.base_dir, &sets(&overrides));
        Ok(parsed.map_err(|error| as_typed(error, &overrides))?)
    }

    /// The text of the user's experiment with changes written into it, comments and order kept; with a region of an analysis, as `NAME=WHERE`
    /// of [`crate::AnalyzeOptions::named_region`], where one is given.
    ///
    /// # Errors
    /// A change that can't be made.
    pub fn text_with(&self, changes: &Changes, region: Option<&str>) -> Result<String> {
        self.edited(&self.own_text, changes, region)
    }

    fn edited(&self, text: &str, changes: &Changes, region: Option<&str>) -> Result<String> {
        let mut overrides = changes.overrides();
        if let Some(region) = drawn(region)? {
            overrides.extend(region.overrides(&self.experiment(changes)?));
        }
        let read = |one: &Override| SceneChange::read(&one.set);
        let list: Vec<SceneChange> = overrides.iter().map(read).collect::<Result<_, _>>()?;
        let edited = edit_experiment(text, &self.name, &self.base_dir, &list);
        Ok(edited.map_err(|error| as_typed(error, &overrides))?)
    }

    /// The experiment with changes as the render shows it.
    ///
    /// # Errors
    /// A change that can't be made; one that only a new render can show.
    pub fn show(&self, changes: &Changes) -> Result<LiveStudy<'_>> {
        let (parsed, overrides) = (self.sized(changes)?, changes.overrides());
        let shown = self.shown(&parsed).map_err(|error| as_typed_in_session(error, &overrides))?;
        let ShownExperiment { experiment, changes } = shown;
        check_captures(&experiment.study, self.render.labels())?;
        Ok(LiveStudy { live: self, parsed, overrides, experiment, changes })
    }

    /// What `capture --report` writes of the experiment with changes, as it was rendered, without links to files beside it.
    ///
    /// # Errors
    /// A change that can't be made; one that only a new render can show; frames that can't be analyzed.
    pub fn report(&self, changes: &Changes, region: Option<&str>) -> Result<ReportData> {
        let text = self.edited(&self.text, changes, region)?;
        let parsed = parse(&text, &self.name, &self.base_dir, &[])?;
        let shown = self.render.shown_whole(&parsed)?;
        let study = &shown.experiment.study;
        check_captures(study, self.render.labels())?;
        let spectra = self.render.spectra(study, &shown.changes)?;
        let view = self.render.seen_by(study, &study.captures, shown.changes, Wanted::Lit)?;
        let seen = view.components(&self.render);
        let frames = capture_from_planes(study, &seen)?;
        let report = FrameReport {
            analysis: analyze_seen(study, Some(&seen), &frames)?,
            regions: analyze_regions(study, Some(&seen), &frames)?,
            live: LiveView::new(study, &seen, &frames)?,
            components: spectra.as_ref().map(|spectra| (spectra, seen)),
            ..FrameReport::simulated(&shown.experiment, &text, frames)
        };
        Ok(report.page()?.page)
    }

    /// [`FinishedRender::shown`], which meshes and solves surfaces once for all changes of lights.
    fn shown(&self, now: &Experiment) -> Result<ShownExperiment<'_>> {
        if let Some(shown) = self.render.shown_without_surfaces(now)? {
            return Ok(shown);
        }
        // Another mouth takes seconds to make, and is another scene whatever else changes
        if let Some(own) = self.render.experiment()?
            && section_of_other_surfaces(own, now) == Some("mouth")
        {
            return Err(PipelineError::OtherScene("the mouth".into()).into());
        }
        match self.on_kept_surfaces(now)? {
            Some(resolved) => self.render.shown_by(now, resolved),
            None => self.render.shown_whole(now),
        }
    }

    /// An experiment on the surfaces of the rendered one; `None` where it has others, or where more is to be checked than lights, camera and
    /// captures.
    fn on_kept_surfaces(&self, now: &Experiment) -> Result<Option<ResolvedExperiment>> {
        let (rendered, resolved) = match self.surfaces.get() {
            Some(kept) => kept,
            None => {
                let rendered = match self.render.experiment()? {
                    Some(own) => Experiment::clone(own),
                    None => self.experiment(&Changes::default())?,
                };
                let resolved = resolve(&rendered)?;
                self.surfaces.get_or_init(|| (rendered, resolved))
            }
        };
        let (file, other) = (&now.file, &rendered.file);
        let is_checked = file.analysis == other.analysis
            && file.target == other.target
            && file.spectroradiometer == other.spectroradiometer
            && file.safety == other.safety;
        let Some(study) = resolve_rendered(now, rendered, resolved)?.filter(|_| is_checked) else {
            return Ok(None);
        };
        // Against itself an experiment shows the same scene: what is left are its captures
        let Some(found) = resolve_captures(now, now, &fluorophores(&self.render))? else { return Ok(None) };
        let mut experiment = found.into_resolved(now);
        let Study { concentrations, captures, motion, develop, .. } = experiment.study;
        experiment.study = Study { concentrations, captures, motion, develop, ..study };
        Ok(Some(experiment))
    }
}

/// Names of the fluorophores whose light a render holds, each once.
fn fluorophores(render: &FinishedRender) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for component in &render.labels().components {
        if let LightPath::Fluorescence(name) = &component.light
            && !names.contains(&name.as_str())
        {
            names.push(name);
        }
    }
    names
}

/// An experiment with nothing but what planes and factors depend on: drives, exposures, gains and the analysis are left out.
fn what_is_seen(file: &ExperimentFile) -> ExperimentFile {
    let mut seen = ExperimentFile {
        title: String::new(),
        description: String::new(),
        motion: None,
        develop: None,
        safety: None,
        analysis: None,
        target: Vec::new(),
        spectroradiometer: Vec::new(),
        output: Default::default(),
        ..file.clone()
    };
    for capture in &mut seen.capture {
        capture.light_groups.retain(|_, drive| *drive != 0.0);
        capture.light_groups.values_mut().for_each(|drive| *drive = 1.0);
        (capture.exposure_ms, capture.auto_exposure, capture.gain) = (ExposureTime::Auto, None, 1.0);
        (capture.subtract, capture.light_on_ms) = (None, None);
        capture.bracket_ev.clear();
    }
    seen
}

/// A region that was drawn, from where it lies.
fn drawn(region: Option<&str>) -> Result<Option<RegionOption>> {
    let typed: Vec<String> = region.map(|place| format!("{DRAWN}={place}")).into_iter().collect();
    Ok(region_options(&typed)?.pop())
}

impl LiveStudy<'_> {
    /// What captures see of the study: without surfaces where nothing of the scene has changed.
    pub fn study(&self) -> &Study {
        &self.experiment.study
    }

    /// The experiment with its changes.
    pub fn experiment(&self) -> &Experiment {
        &self.parsed
    }

    /// What some captures of the study see of the render. Planes of the last cameras are kept, and with them a drive, an exposure or a gain is a
    /// sum.
    ///
    /// # Errors
    /// A study without lens or sensor; spectra that can't be read.
    pub fn view(&self, captures: &[Capture]) -> Result<Arc<CaptureView>> {
        let file = what_is_seen(&self.parsed.file);
        let labels: Vec<&str> = captures.iter().map(|capture| capture.frame.label.as_str()).collect();
        let is_same = |kept: &KeptView| kept.captures == labels && kept.file == file;
        let lock = || self.live.seen.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kept) = lock().iter().find(|kept| is_same(kept)) {
            return Ok(Arc::clone(&kept.view));
        }
        let study = self.study();
        // The first capture under a light tells how light that fluoresced twice follows a concentration
        let is_lit = |capture: &Capture, group: &str| capture.frame.drive(group) != 0.0;
        let first = |group: &String| study.captures.iter().find(|capture| is_lit(capture, group));
        let groups = captures.iter().flat_map(|capture| capture.frame.lights.keys());
        let firsts = groups.filter_map(first).map(|capture| capture.frame.label.as_str());
        let wanted: Vec<&str> = labels.iter().copied().chain(firsts).collect();
        let wanted = Wanted::LitByAny(&wanted);
        let seen = self.live.render.seen_by(study, &study.captures, self.changes.clone(), wanted)?;
        let view = Arc::new(seen);
        let captures = labels.into_iter().map(String::from).collect();
        let mut held = lock();
        held.insert(0, KeptView { file, captures, view: Arc::clone(&view) });
        held.truncate(KEPT_VIEWS);
        Ok(view)
    }

    /// What a capture sees of the render, with all that its frame takes.
    ///
    /// # Errors
    /// A capture that is not there; those of [`Self::view`].
    pub fn view_of(&self, capture: &str) -> Result<Arc<CaptureView>> {
        self.view(&self.needed(capture)?)
    }

    /// The captures that the frame of one takes: itself and what is subtracted from it.
    fn needed(&self, capture: &str) -> Result<Vec<Capture>> {
        let study = self.study();
        let Some(own) = study.capture(capture) else { return Err(self.no_capture(capture)) };
        // Motion runs from exposure to exposure, and calibration looks at the longest of all
        let takes_all =
            study.motion.is_some() || study.develop.dark_frames > 0 || study.develop.flat_field.is_some();
        let is_needed = |other: &&Capture| {
            takes_all || other.frame.label == capture || own.subtract.as_ref() == Some(&other.frame.label)
        };
        Ok(study.captures.iter().filter(is_needed).cloned().collect())
    }

    /// The frame of a capture, as `capture` takes it.
    ///
    /// # Errors
    /// A capture that is not there or can't be taken.
    pub fn frame(&self, capture: &str) -> Result<CapturedFrame> {
        let study = Study { captures: self.needed(capture)?, ..self.study().clone() };
        let view = self.view(&study.captures)?;
        end_if_interrupted();
        let frame = capture_one(&study, &view.components(&self.live.render), capture, &self.live.exposed)?;
        end_if_interrupted();
        Ok(frame)
    }

    fn no_capture(&self, wanted: &str) -> Error {
        let known = self.study().captures.iter().map(|capture| capture.frame.label.as_str());
        let known = known.collect::<Vec<_>>().join(", ");
        PipelineError::NoFrame { wanted: wanted.into(), known }.into()
    }

    /// What the pixels of a region say, as `analyze` has it: that of `[analysis]`, or one that lies where `region` tells, as behind the
    /// name of [`crate::AnalyzeOptions::named_region`]. `None` without an analysis.
    ///
    /// # Errors
    /// A region without pixels; an analysis that can't be done.
    pub fn analyzed(&self, region: Option<&str>) -> Result<Option<Arc<AnalyzedFrame>>> {
        let added = drawn(region)?.map(|region| region.overrides(&self.parsed)).unwrap_or_default();
        let all: Vec<Override> = self.overrides.iter().cloned().chain(added).collect();
        let asked = sets(&all);
        let lock = || self.live.analyzed.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, found)) = lock().as_ref().filter(|(known, _)| *known == asked) {
            return Ok(Some(Arc::clone(found)));
        }
        let LiveRender { text, name, base_dir, .. } = self.live;
        let parsed = parse(text, name, base_dir, &asked).map_err(|error| as_typed(error, &all))?;
        let Some(found) = self.analyzed_by(&parsed, &all)? else { return Ok(None) };
        let found = Arc::new(found);
        *lock() = Some((asked, Arc::clone(&found)));
        Ok(Some(found))
    }

    /// The last region of an experiment, else its analysis. What an analysis asks of surfaces is kept in the cache, as for `analyze`.
    fn analyzed_by(&self, parsed: &Experiment, overrides: &[Override]) -> Result<Option<AnalyzedFrame>> {
        if parsed.file.analysis.is_none() {
            return Ok(None);
        }
        if let Some(kept) = cached_analysis(parsed) {
            let found = self.of_study(kept.complete(self.study().clone()))?;
            if found.as_ref().is_some_and(|found| found.analysis.posterior.is_some()) {
                return Ok(found);
            }
        }
        let resolved = resolve(parsed).map_err(|error| as_typed(error, overrides))?;
        self.of_study(resolved.study)
    }

    /// The drawn region of a study, else its analysis.
    fn of_study(&self, mut study: Study) -> Result<Option<AnalyzedFrame>> {
        study.regions.retain(|region| region.name == DRAWN);
        let plans: Vec<&AnalysisPlan> =
            study.analysis.iter().chain(study.regions.iter().map(|region| &region.analysis)).collect();
        study.captures = looked_at(&study, &plans);
        let view = self.view(&study.captures)?;
        let seen = view.components(&self.live.render);
        let frames = capture_from_planes(&study, &seen)?;
        end_if_interrupted();
        match analyze_regions(&study, Some(&seen), &frames)?.pop() {
            None => Ok(analyze_seen(&study, Some(&seen), &frames)?),
            Some(region) => Ok(Some(region.analyzed.map_err(|why| {
                Error::Input(format!("the region is not in view: {why}; draw it elsewhere"))
            })?)),
        }
    }

    /// Spectral radiance of the frame of a capture, before filter and lens, W/(sr m² nm), `[row][col][band]` of the render.
    ///
    /// # Errors
    /// A capture that is not there; spectra that can't be read, or are larger than the memory that the experiment allows.
    pub fn radiance_image(&self, capture: &str) -> Result<SpectralImage<Radiance>> {
        let own = self.study().capture(capture).ok_or_else(|| self.no_capture(capture))?;
        let mut lit = self.study().clone();
        lit.captures.retain(|other| other.frame.label == capture);
        let mut changes = self.changes.clone();
        changes.factors.even.copy_from_slice(self.view(&lit.captures)?.even_factors());
        let why = "the spectra do not fit into render.memory_limit_gib; raise it";
        let spectra = self.live.render.spectra(&lit, &changes)?;
        Ok(frame_radiance(&own.frame, &spectra.ok_or_else(|| Error::Input(why.into()))?))
    }

    /// The page of a report on the frames and a region, as [`Self::analyzed`] takes it. Only `with_spectra` it tells light by origin, leak and
    /// depth: these read all spectra.
    ///
    /// # Errors
    /// Frames that can't be taken or analyzed; spectra that can't be read.
    pub fn findings(&self, region: Option<&str>, with_spectra: bool) -> Result<ReportData> {
        let LiveRender { render, text, .. } = self.live;
        let kept = self.live.on_kept_surfaces(&self.parsed)?;
        let shown = match kept {
            Some(resolved) => render.shown_by(&self.parsed, resolved)?,
            None => render.shown_whole(&self.parsed)?,
        };
        let study = &shown.experiment.study;
        let spectra = if with_spectra { render.spectra(study, &shown.changes)? } else { None };
        let view = self.view(&study.captures)?;
        let seen = view.components(render);
        let frames = capture_from_planes(study, &seen)?;
        let report = FrameReport {
            analysis: self.analyzed(region)?.map(|analyzed| (*analyzed).clone()),
            components: spectra.as_ref().map(|spectra| (spectra, seen)),
            ..FrameReport::simulated(&shown.experiment, text, frames)
        };
        Ok(report.page()?.page)
    }

    /// Mean radiance of a region of the frame of a capture, before filter and lens, split by what happened to the light.
    ///
    /// # Errors
    /// A capture that is not there, a region outside of the rendered field, spectra that can't be read.
    pub fn radiance(&self, capture: &str, region: &PixelSelection) -> Result<RegionRadiance> {
        let render = &self.live.render;
        let study = self.study();
        let Some(own) = study.capture(capture) else { return Err(self.no_capture(capture)) };
        let scene = on_sensor(study, render.labels()).ok_or(PipelineError::Missing("sensor"))?;
        let pixels = scene.scene_pixels(region);
        if pixels.is_empty() {
            let why = "the region lies beyond the rendered field; draw it elsewhere";
            return Err(Error::Input(why.into()));
        }
        let mut changes = self.changes.clone();
        let mut lit = study.clone();
        lit.captures.retain(|other| other.frame.label == capture);
        changes.factors.even.copy_from_slice(self.view(&lit.captures)?.even_factors());
        let spectra = render.spectra_at(&lit, &changes, &pixels)?;
        let all: Vec<usize> = (0..pixels.len()).collect();
        Ok(RegionRadiance::new(&spectra, &own.frame, &all))
    }
}
