//! An experiment from scene to report.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::ValueHint;
use fluorspar::analysis::Analysis;
use fluorspar::image::{ComponentFactors, ComponentImage};
use fluorspar::pipeline::{
    AnalyzedFrame, AnalyzedRegion, CapturePlanes, CapturedFrame, Evaluation, LiveView, SeenComponents,
    check_captures, evaluate, evaluate_from_planes,
};
use fluorspar::render::memory_bytes;
use fluorspar::study::Study;
use fluorspar::units::{memory_gib, memory_texts};
use fluorspar_experiment::{FileRecord, ResolvedExperiment, Warning};
use fluorspar_format::OutputFolder;
use fluorspar_report::{
    FrameOrigin, RunResults, exceeded_limits, leaking_frames, region_warnings, write_run_components,
    write_run_folder,
};
use serde::ser::Error as _;
use serde::{Deserialize, Serialize, Serializer};
use serde_json::Value;

use crate::frame_report::warn_of_darkness;
use crate::values::Override;
use crate::{
    Error, ExperimentArgs, ExperimentSource, Job, ResourceLimits, ResourceNeeds, Result, read_text,
    render_scene, render_with_excitation_basis, warnings_before_run,
};

/// Which experiment is run, with which changes.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct RunOptions {
    /// The experiment and its changes.
    #[command(flatten)]
    #[serde(flatten)]
    pub experiment: ExperimentArgs,
    /// A first look in about a third of the time: two thirds of the width and of the height, a quarter of the samples. What is set wins.
    #[arg(long)]
    pub quick: bool,
    /// What the run may take.
    #[command(flatten)]
    #[serde(flatten)]
    pub limits: ResourceLimits,
    /// Folder for the results [default: the experiment's own, else fluorspar-out/NAME].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// What a run left in its folder.
#[derive(Clone, Debug)]
pub struct FinishedExperiment {
    /// The folder.
    pub folder: PathBuf,
    /// The experiment.
    pub experiment: ResolvedExperiment,
    /// The region of the analysis, where there is one.
    pub analysis: Option<Analysis>,
    /// The regions beside it.
    pub regions: Vec<AnalyzedRegion>,
    /// Whether all samples are there, or a time limit ended the render: `false` where the job was stopped before.
    pub is_complete: bool,
}

impl Serialize for FinishedExperiment {
    /// The numbers that the folder holds in results.json.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let text = read_text(&self.folder.join("results.json")).map_err(S::Error::custom)?;
        serde_json::from_str::<Value>(&text).map_err(S::Error::custom)?.serialize(serializer)
    }
}

/// Fewer pixels and samples than an experiment has by itself.
fn quick_overrides(source: &ExperimentSource) -> Result<Vec<Override>> {
    let render = source.parse(&[])?.file.render;
    let part = |path: &str, value: u32| Override::of_option(path, value.max(1), "⟨quick⟩".into());
    Ok(vec![
        part("render.width_px", render.width_px * 2 / 3),
        part("render.height_px", render.height_px * 2 / 3),
        part("render.samples_per_pixel", render.samples_per_pixel / 4),
    ])
}

/// Renders an experiment, takes its captures, analyzes them, and writes all of it and a report into a folder.
///
/// # Errors
/// A defect of the experiment; what a run would need beyond its limits; a folder that can't be written; a stage after the render, which keeps
/// what was rendered: [`Error::AfterRender`].
pub fn run(options: &RunOptions, job: &Job) -> Result<FinishedExperiment> {
    let started = Instant::now();
    let source = ExperimentSource::find(options.experiment.experiment.as_deref())?;
    let quick = if options.quick { quick_overrides(&source)? } else { Vec::new() };
    let changes = [quick, options.experiment.overrides()].concat();
    let changes = [changes, options.limits.overrides().into_iter().collect()].concat();
    let mut experiment = source.resolve(&changes)?;
    experiment.record.warnings = warnings_before_run(&experiment);
    let study = &experiment.study;
    check_nothing_painted(study)?;
    check_memory(
        study,
        "or use `fluorspar render --components`, which goes through large images in bands of rows, and `capture` with what it \
         wrote",
    )?;
    let budget = ResourceNeeds::of_run(study);
    budget.check(&options.limits, study)?;
    let target = place(options, &changes, &source.stem, &experiment.record, job);
    let folder = OutputFolder::prepare(&target, &source.files(&experiment.record), budget.disk)?;

    let camera = &study.scene.camera;
    job.status(format!(
        "{}\n{} x {} pixels, {} bands, {} light groups, {} fluorophores, {} samples per pixel\nNeeds {}",
        experiment.record.title,
        camera.width,
        camera.height,
        study.scene.grid.len(),
        study.scene.light_groups.len(),
        study.scene.fluorophores.len(),
        study.render.samples_per_pixel,
        budget.text()
    ));
    job.warn(&experiment.record.warnings);
    let prepared = started.elapsed();
    job.status(format!("Scene prepared in {:.1} s", prepared.as_secs_f64()));
    let (mut components, basis) = match &study.render.excitation_basis {
        None => (render_scene(&study.scene, &study.render, study.time_limit_s, job)?, None),
        Some(basis) => {
            let (components, basis) = render_with_excitation_basis(study, basis, job)?;
            (components, Some(basis))
        }
    };
    if components.samples_per_pixel == 0 {
        let message = "interrupted before every pixel had a sample: there is nothing to develop, and nothing was written";
        return Err(Error::Stopped(message.into()));
    }
    job.status(format!(
        "Rendered in {:.1} s. Developing frames, writing images, figures and report",
        (started.elapsed() - prepared).as_secs_f64()
    ));
    components.round_as_stored();

    // What took the time is kept whatever becomes of the rest
    let write = || {
        let _writing = job.listener.begin_writing(Path::new("components.exr"));
        write_run_components(folder.path(), &experiment, &source.text, &components, basis.as_ref())
    };
    let (written, (planes, evaluated)) = rayon::join(write, || {
        let planes = planes(study, &components);
        let evaluated = match &planes {
            Some(planes) => evaluate_from_planes(study, &components, Some(planes)),
            None => evaluate(study, &components),
        };
        (planes, evaluated)
    });
    written.map_err(|error| Error::from(error).at_its_place(&folder))?;
    let results = evaluated.map_err(Error::from).and_then(|evaluation| {
        let live = live_view(&experiment.study, &components, planes.as_ref(), &evaluation.frames)?;
        write_results(&experiment, &source.text, (&components, live), evaluation, folder.path(), job)
    });
    let analyzed = match results {
        Ok(analyzed) => analyzed,
        Err(error) => {
            let error = error.at_its_place(&folder);
            let kept = folder.keep()?;
            return Err(Error::AfterRender { error: Box::new(error), image: kept.join("components.exr") });
        }
    };
    let target = folder.finish()?;
    let Evaluated { analysis, regions } = analyzed;
    if let Some(AnalyzedFrame { analysis, .. }) = &analysis {
        let of_regions = region_warnings(analysis, &regions);
        let warnings: Vec<Warning> = analysis.warnings.iter().chain(&of_regions).cloned().collect();
        job.warn(&warnings);
    }
    let seconds = started.elapsed().as_secs_f64();
    job.status(format!("Done in {seconds:.1} s. Open {}", target.join("report.html").display()));
    let samples = [components.samples_per_pixel, study.render.samples_per_pixel];
    let is_complete = !job.is_interrupted() || samples[0] >= samples[1];
    if !is_complete {
        job.status(format!("interrupted after {} of {} samples per pixel", samples[0], samples[1]));
    }
    Ok(FinishedExperiment {
        folder: target,
        experiment,
        analysis: analysis.map(|found| found.analysis),
        regions,
        is_complete,
    })
}

/// Where results go: to `out`, else to the folder that the file names, else to one of the name of the file. An experiment that options changed
/// does not take the place of results of another one there: it has a folder of its own.
fn place(options: &RunOptions, changes: &[Override], stem: &str, record: &FileRecord, job: &Job) -> PathBuf {
    if let Some(out) = &options.out {
        return out.clone();
    }
    let names_folder = changes.iter().any(|change| change.set.trim_start().starts_with("output.folder"));
    let usual = record.output_folder.clone().unwrap_or_else(|| PathBuf::from("fluorspar-out").join(stem));
    if changes.is_empty() || names_folder {
        return usual;
    }
    let held = read_text(&usual.join("results.json")).ok();
    let held = held.and_then(|text| serde_json::from_str::<serde_json::Value>(&text).ok());
    let is_other = held
        .as_ref()
        .and_then(|held| held.get("experiment_sha256")?.as_str())
        .is_some_and(|held| held != record.sha256);
    if !is_other {
        return usual;
    }
    let name = usual.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let own = usual.with_file_name(format!("{name}-{}", &record.sha256[..8]));
    job.status(format!(
        "{} holds results of other settings and is kept; those of these changes go to {} (⟨out⟩ names another folder)",
        usual.display(),
        own.display()
    ));
    own
}

/// Channel planes of the captures; `None` without captures, and where something prevents them, which the evaluation will report.
fn planes(study: &Study, components: &ComponentImage) -> Option<CapturePlanes> {
    check_captures(study, components).ok()?;
    CapturePlanes::new(study, components).ok()
}

/// The frames of the page that follow sliders.
fn live_view(
    study: &Study,
    image: &ComponentImage,
    planes: Option<&CapturePlanes>,
    frames: &[CapturedFrame],
) -> Result<Option<LiveView>> {
    let Some(planes) = planes else { return Ok(None) };
    let factors = &ComponentFactors::ones(image.components.len());
    let seen = SeenComponents { image, planes, captures: &study.captures, factors };
    Ok(LiveView::new(study, &seen, frames)?)
}

/// What a run says at its end.
struct Evaluated {
    analysis: Option<AnalyzedFrame>,
    regions: Vec<AnalyzedRegion>,
}

/// Writes everything that is made of the components: frames, analysis, figures, report.
fn write_results(
    experiment: &ResolvedExperiment,
    experiment_text: &str,
    (components, live): (&ComponentImage, Option<LiveView>),
    evaluation: Evaluation,
    folder: &Path,
    job: &Job,
) -> Result<Evaluated> {
    let results = RunResults {
        experiment,
        experiment_text,
        components: Some(components),
        live: live.as_ref(),
        evaluation: &evaluation,
        frames_from: FrameOrigin::Simulated,
        described_frames: &[],
        raw_ending: Some("tiff"),
    };
    write_run_folder(folder, &results)?;
    warn_of_darkness(experiment, &evaluation.frames, job);
    job.warn(&leaking_frames(&evaluation.leaks).into_iter().map(Warning::from).collect::<Vec<_>>());
    let exceeded = evaluation.safety.iter().flat_map(exceeded_limits).map(Warning::from);
    job.warn(&exceeded.collect::<Vec<_>>());
    let Evaluation { analysis, regions, .. } = evaluation;
    Ok(Evaluated { analysis, regions })
}

/// Refuses images that don't fit into the memory limit. `instead` is what could be done with them.
///
/// # Errors
/// Images that don't fit.
pub fn check_memory(study: &Study, instead: &str) -> Result<()> {
    let (scene, settings) = (&study.scene, &study.render);
    let (needed, limit) = (memory_bytes(scene, settings), settings.memory_limit_bytes);
    // One with an excitation basis is rendered in bands of rows anyway
    if needed <= limit || settings.excitation_basis.is_some() {
        return Ok(());
    }
    let [needed_text, limit] = memory_texts(needed, limit);
    let (width, height, bands) = (scene.camera.width, scene.camera.height, scene.grid.len());
    Err(Error::Input(format!(
        "the images of {width} x {height} pixels and {bands} bands need {needed_text}, more than the limit of {limit}; render \
         fewer pixels, bands, light groups or fluorophores, raise render.memory_limit_gib to {} or more, {instead}",
        memory_gib(needed)
    )))
}

/// Refuses a mask that is painted on an image before there is one.
///
/// # Errors
/// A painted mask.
pub fn check_nothing_painted(study: &Study) -> Result<()> {
    let painted = study.concentrations.iter().find(|change| change.painted.is_some());
    match painted {
        None => Ok(()),
        Some(change) => Err(Error::Input(format!(
            "concentration.{}: a mask is painted on a finished render: give it to `capture` and `analyze`. For a new render give \
             the material a map, concentrations.{} = {{ image = ... }}, or the mouth a lesion",
            change.fluorophore, change.fluorophore
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quick_run_is_a_shorthand_of_settings() {
        let quick = quick_overrides(&ExperimentSource::find(None).unwrap()).unwrap();
        let sets: Vec<&str> = quick.iter().map(|change| change.set.as_str()).collect();
        assert_eq!(sets, ["render.width_px=320", "render.height_px=240", "render.samples_per_pixel=4"]);
    }
}
