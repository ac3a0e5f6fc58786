//! `fluorspar run`: from scene to report.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use fluorspar::findings::region_findings;
use fluorspar::image::ComponentImage;
use fluorspar::pipeline::{
    AnalyzedFrame, AnalyzedRegion, CapturePlanes, Evaluation, check_captures, evaluate, evaluate_from_planes,
};
use fluorspar::study::Study;
use fluorspar_experiment::{FileRecord, ResolvedExperiment, Warning};
use fluorspar_format::OutputFolder;
use fluorspar_report::{
    FrameOrigin, RunResults, exceeded_limits, finding_lines, region_warnings, write_run_components,
    write_run_folder,
};
use fluorspar_session::warnings_before_run;

use super::basis_render;
use super::frame_report::{assumed_tissue, regions_table, warn_of_darkness};
use crate::args::{Answer, ExperimentArgs, OutOption};
use crate::error::{CliError, STOPPED};
use crate::experiment_source::{ExperimentSource, read_text};
use crate::interrupt::interrupted;
use crate::message::Messages;
use crate::progress::{WritingReport, render_with_progress};
use crate::resource_needs::{Budget, Limits};

/// Options of `run`.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    experiment: ExperimentArgs,
    #[command(flatten)]
    limits: Limits,
    #[command(flatten)]
    out: OutOption,
    #[command(flatten)]
    answer: Answer,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    let started = Instant::now();
    let messages = Messages::default();
    let source = ExperimentSource::find(options.experiment.experiment.as_deref())?;
    let mut experiment = source.resolve(
        &[options.experiment.overrides(), options.limits.overrides().into_iter().collect()].concat(),
    )?;
    experiment.record.warnings = warnings_before_run(&experiment);
    let study = &experiment.study;
    super::check_nothing_painted(study)?;
    super::check_memory(
        study,
        "or use `fluorspar render --components`, which goes through large images in bands of rows, and `capture` with what it \
         wrote",
    )?;
    let budget = Budget::of_run(study);
    budget.check(&options.limits, study)?;
    let target = place(options, &source.stem, &experiment.record, messages);
    let folder = OutputFolder::prepare(&target, &source.files(&experiment.record), budget.disk())?;

    let camera = &study.scene.camera;
    messages.status(format!(
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
    messages.warnings(&experiment.record.warnings);
    let prepared = started.elapsed();
    messages.status(format!("Scene prepared in {:.1} s", prepared.as_secs_f64()));
    let (mut components, basis) = match &study.render.excitation_basis {
        None => (render_with_progress(&study.scene, &study.render, study.time_limit_s, messages)?, None),
        Some(basis) => {
            let (components, basis) = basis_render::render(study, basis, messages)?;
            (components, Some(basis))
        }
    };
    if components.samples_per_pixel == 0 {
        let message = "interrupted before every pixel had a sample: there is nothing to develop, and nothing was written";
        return Err(CliError::Stopped(message.into()));
    }
    messages.status(format!(
        "Rendered in {:.1} s. Developing frames, writing images, figures and report",
        (started.elapsed() - prepared).as_secs_f64()
    ));
    components.round_to_24_bits();

    // What took the time is safe before anything else is tried.
    let planes = planes(study, &components);
    let held = planes.as_ref().map_or(&[][..], |planes| planes.planes.as_slice());
    let kept = (held, basis.as_ref());
    let writing = WritingReport::begin(Path::new("components.exr"), messages);
    write_run_components(folder.path(), &experiment, &source.text, &components, kept)
        .map_err(|error| CliError::from(error).at_its_place(&folder))?;
    drop(writing);
    let seen = (&components, planes.as_ref());
    let analyzed = match evaluate_and_write(&experiment, &source.text, seen, folder.path(), messages) {
        Ok(analyzed) => analyzed,
        Err(error) => {
            let error = error.at_its_place(&folder);
            let kept = folder.keep()?;
            return Err(CliError::AfterRender { error: Box::new(error), image: kept.join("components.exr") });
        }
    };
    let target = folder.finish()?;
    if options.answer.json {
        super::print_text(&read_text(&target.join("results.json"))?)?;
    }
    let Evaluated { analysis, regions } = analyzed;
    if let Some(AnalyzedFrame { analysis, .. }) = &analysis {
        if !options.answer.json {
            let mut lines = finding_lines(&region_findings(analysis), &analysis.analyte, false);
            lines.extend(assumed_tissue(analysis));
            let lines = lines.join("\n");
            let text = match regions_table(&experiment, analysis, &regions) {
                table if table.is_empty() => lines,
                table => format!("{lines}\n{table}"),
            };
            super::print_text(&text)?;
        }
        let of_regions = region_warnings(analysis, &regions);
        let warnings: Vec<Warning> = analysis.warnings.iter().chain(&of_regions).cloned().collect();
        messages.warnings(&warnings);
    }
    let seconds = started.elapsed().as_secs_f64();
    messages.status(format!("Done in {seconds:.1} s. Open {}", target.join("report.html").display()));
    if interrupted() && components.samples_per_pixel < study.render.samples_per_pixel {
        messages.status(format!(
            "interrupted after {} of {} samples per pixel",
            components.samples_per_pixel, study.render.samples_per_pixel
        ));
        return Ok(ExitCode::from(STOPPED));
    }
    Ok(ExitCode::SUCCESS)
}

/// Where results go: to `--out`, else to the folder that the file names, else to one of the name of the file. An experiment that options changed
/// does not take the place of results of another one there: it has a folder of its own.
fn place(options: &Options, stem: &str, record: &FileRecord, messages: Messages) -> PathBuf {
    if let Some(out) = &options.out.out {
        return out.clone();
    }
    let overrides = options.experiment.overrides();
    let names_folder = overrides.iter().any(|change| change.set.trim_start().starts_with("output.folder"));
    let usual = record.output_folder.clone().unwrap_or_else(|| PathBuf::from("fluorspar-out").join(stem));
    if overrides.is_empty() || names_folder {
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
    messages.status(format!(
        "{} holds results of other settings and is kept; those of these changes go to {} (--out names another folder)",
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

/// What a run says at its end.
struct Evaluated {
    analysis: Option<AnalyzedFrame>,
    regions: Vec<AnalyzedRegion>,
}

/// Everything after the render: frames, analysis, figures, report.
fn evaluate_and_write(
    experiment: &ResolvedExperiment,
    experiment_text: &str,
    (components, planes): (&ComponentImage, Option<&CapturePlanes>),
    folder: &Path,
    messages: Messages,
) -> Result<Evaluated, CliError> {
    let evaluation = match planes {
        Some(planes) => evaluate_from_planes(&experiment.study, components, Some(planes))?,
        None => evaluate(&experiment.study, components)?,
    };
    let results = RunResults {
        experiment,
        experiment_text,
        components: Some(components),
        evaluation: &evaluation,
        frames_from: FrameOrigin::Simulated,
        described_frames: &[],
        raw_ending: Some("tiff"),
    };
    write_run_folder(folder, &results)?;
    warn_of_darkness(experiment, &evaluation.frames, messages);
    let exceeded = evaluation.safety.iter().flat_map(exceeded_limits).map(Warning::from);
    messages.warnings(&exceeded.collect::<Vec<_>>());
    let Evaluation { analysis, regions, .. } = evaluation;
    Ok(Evaluated { analysis, regions })
}
