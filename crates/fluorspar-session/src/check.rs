//! Whether an experiment or a flat sample holds, what its camera sees, and what a run needs, without a run.

use std::collections::BTreeMap;

use clap::ValueHint;
use fluorspar::render::{memory_bytes, visible_surfaces};
use fluorspar::scene::Shape;
use fluorspar::study::Study;
use fluorspar_experiment::{ResolvedExperiment, ResolvedSample, Warning, is_sample};
use serde::{Deserialize, Serialize, Serializer};

use crate::resource_needs::check_time;
use crate::{
    Changes, ExperimentSource, Job, RenderOptions, ResourceLimits, ResourceNeeds, Result, render_seconds,
    warnings_before_run,
};

/// Which file is checked, with which changes.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct CheckOptions {
    /// Experiment or sample file, or the name of a built-in one [default: the experiment that `run` takes].
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub file: Option<String>,
    /// Changes by path.
    #[command(flatten)]
    #[serde(flatten)]
    pub changes: Changes,
    /// Changes of the render.
    #[command(flatten)]
    #[serde(flatten)]
    pub render: RenderOptions,
    /// What a run may take.
    #[command(flatten)]
    #[serde(flatten)]
    pub limits: ResourceLimits,
}

/// A file that holds.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum CheckedFile {
    /// A flat sample.
    Sample(CheckedSample),
    /// An experiment.
    Experiment(Box<CheckedExperiment>),
}

/// A flat sample that holds.
#[derive(Clone, Debug, Serialize)]
pub struct CheckedSample {
    /// How the file was named.
    pub file: String,
    /// "sample".
    pub kind: &'static str,
    /// Whether it holds.
    pub valid: bool,
    /// Digest of what decides the result.
    pub sha256: String,
    /// Number of its bands.
    pub bands: usize,
    /// Names of its fluorophores.
    pub fluorophores: Vec<String>,
    /// What is odd about it.
    pub warnings: Vec<Warning>,
}

/// An experiment that holds.
#[derive(Clone, Debug, Serialize)]
pub struct CheckedExperiment {
    /// How the file was named.
    pub file: String,
    /// "experiment".
    pub kind: &'static str,
    /// Whether it holds.
    pub valid: bool,
    /// Digest of what decides the result.
    pub sha256: String,
    /// Number of objects.
    pub objects: usize,
    /// Number of lights.
    pub lights: usize,
    /// Names of the light groups.
    pub light_groups: Vec<String>,
    /// Names of the fluorophores.
    pub fluorophores: Vec<String>,
    /// Names of the captures.
    pub captures: Vec<String>,
    /// Names of the regions beside that of the analysis.
    pub regions: Vec<String>,
    /// Instances of meshes of all objects.
    pub instances: usize,
    /// What its camera sees.
    pub camera_view: CameraView,
    /// Memory of the image while it is rendered in one go, bytes.
    pub memory_bytes: u64,
    /// What a run takes.
    pub budget: ResourceNeeds,
    /// How long rendering takes, s.
    pub render_seconds: f64,
    /// What is odd about it.
    pub warnings: Vec<Warning>,
    /// What it means.
    #[serde(skip)]
    pub study: Study,
}

/// Checks an experiment or a flat sample.
///
/// # Errors
/// Its first defect; limits that a run would exceed.
pub fn check(options: &CheckOptions, job: &Job) -> Result<CheckedFile> {
    let source = ExperimentSource::find_either(options.file.as_deref())?;
    let mut overrides = options.changes.overrides();
    overrides.extend(options.render.overrides());
    overrides.extend(options.limits.overrides());
    let file = options.file.clone().unwrap_or_else(|| source.name.clone());
    if is_sample(&source.text) {
        let ResolvedSample { sample, record, .. } = source.resolve_sample(&overrides)?;
        job.warn(&record.warnings);
        let fluorophores = sample.fluorophores.iter().map(|(fluorophore, _)| fluorophore.name.clone());
        return Ok(CheckedFile::Sample(CheckedSample {
            file,
            kind: "sample",
            valid: true,
            sha256: record.sha256,
            bands: sample.grid.len(),
            fluorophores: fluorophores.collect(),
            warnings: record.warnings,
        }));
    }
    let mut experiment = source.resolve(&overrides)?;
    let camera_view = CameraView::of(&mut experiment.study);
    let mut warnings = warnings_before_run(&experiment);
    warnings.extend(camera_view.warning(&experiment.study));
    job.warn(&warnings);
    let study = &experiment.study;
    let budget = ResourceNeeds::of_run(study);
    budget.check(&options.limits, study)?;
    let render_seconds = render_seconds(&experiment)?;
    check_time(render_seconds, study.render.samples_per_pixel, study.time_limit_s)?;
    let ResolvedExperiment { study, record } = experiment;
    let scene = &study.scene;
    Ok(CheckedFile::Experiment(Box::new(CheckedExperiment {
        file,
        kind: "experiment",
        valid: true,
        sha256: record.sha256,
        objects: scene.objects.len(),
        lights: scene.lights.len(),
        light_groups: scene.light_groups.iter().map(|group| group.name.clone()).collect(),
        fluorophores: scene.fluorophores.iter().map(|fluorophore| fluorophore.name.clone()).collect(),
        captures: study.captures.iter().map(|capture| capture.frame.label.clone()).collect(),
        regions: study.regions.iter().map(|region| region.name.clone()).collect(),
        instances: scene.objects.iter().map(|object| instances(&object.shape)).sum(),
        camera_view,
        memory_bytes: memory_bytes(scene, &study.render),
        budget,
        render_seconds,
        warnings,
        study,
    })))
}

/// Instances of meshes of a shape.
fn instances(shape: &Shape) -> usize {
    match shape {
        Shape::Instances(many) => many.instances.len(),
        _ => 0,
    }
}

/// What the camera sees, without light.
#[derive(Clone, Debug, Serialize)]
pub struct CameraView {
    /// Width of what is sharp, mm; `None` where no distance is focused.
    pub width_mm: Option<f64>,
    /// Height of it, mm.
    pub height_mm: Option<f64>,
    /// Its distance, mm; 0 with parallel rays, which have none.
    pub distance_mm: Option<f64>,
    /// Objects in view with their share of the image, the largest first.
    #[serde(serialize_with = "by_name")]
    pub parts: Vec<(String, f64)>,
    /// Share of the image that shows nothing.
    pub nothing: f64,
}

/// Shares by name.
fn by_name<S: Serializer>(parts: &[(String, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    parts.iter().map(|(name, share)| (name, share)).collect::<BTreeMap<_, _>>().serialize(serializer)
}

/// Columns of the image that tells what is seen.
const VIEW_COLUMNS: usize = 160;
impl CameraView {
    fn of(study: &mut Study) -> Self {
        let field_mm = field_mm(study);
        let camera = &mut study.scene.camera;
        let (width, height) = (camera.width, camera.height);
        let shape = height as f64 / width.max(1) as f64;
        camera.width = VIEW_COLUMNS;
        camera.height = ((VIEW_COLUMNS as f64 * shape).round() as usize).max(1);
        let maps = visible_surfaces(&study.scene, &study.scene.camera);
        (study.scene.camera.width, study.scene.camera.height) = (width, height);
        let pixels = maps.part.len().max(1) as f64;
        let share = |number: usize| {
            maps.part.iter().filter(|&&part| usize::from(part) == number).count() as f64 / pixels
        };
        let mut parts: Vec<(String, f64)> = maps
            .part_names
            .iter()
            .enumerate()
            .map(|(index, name)| (name.clone(), share(index + 1)))
            .collect();
        parts.retain(|(_, share)| *share > 0.0);
        parts.sort_by(|a, b| b.1.total_cmp(&a.1));
        let side = |number: usize| field_mm.map(|field| field[number]);
        Self { width_mm: side(0), height_mm: side(1), distance_mm: side(2), parts, nothing: share(0) }
    }

    /// Warns of a camera that has no object before it.
    fn warning(&self, study: &Study) -> Option<Warning> {
        let is_blind = self.parts.is_empty() && !study.scene.objects.is_empty();
        let text = "the camera sees no object: it looks past the scene or from within one. camera.position_mm and camera.look_at_mm say from \
                    where to where it looks";
        is_blind.then(|| Warning::from(text.to_owned()))
    }
}

/// Width and height of what is in focus, and its distance, mm; with parallel rays there is no distance. `None` where the lens stands at
/// infinity.
fn field_mm(study: &Study) -> Option<[f64; 3]> {
    let camera = &study.scene.camera;
    let shape = camera.height as f64 / camera.width.max(1) as f64;
    if let Some(half) = camera.parallel_half_width_m {
        return Some([2e3 * f64::from(half), 2e3 * f64::from(half) * shape, 0.0]);
    }
    let distance_mm = study.camera.lens.as_ref().and_then(|lens| lens.equation.object_distance_mm)?;
    let wide = 2.0 * f64::from(camera.tan_half_width) * distance_mm;
    Some([wide, wide * shape, distance_mm])
}
