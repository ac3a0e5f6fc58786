//! `fluorspar check`: whether an experiment holds, what its camera sees, and what a run needs, without a run.

use std::collections::BTreeMap;
use std::process::ExitCode;

use clap::ValueHint;
use fluorspar::render::visible_surfaces;
use fluorspar::scene::{Scene, Shape};
use fluorspar::study::{RegionPlan, Study};
use fluorspar::units::counted;
use fluorspar_experiment::{ResolvedExperiment, is_sample};
use fluorspar_session::warnings_before_run;
use serde_json::json;

use crate::args::{Answer, Changes, RenderOptions};
use crate::error::CliError;
use crate::experiment_source::ExperimentSource;
use crate::message::Messages;
use crate::progress::duration;
use crate::resource_needs::{Budget, Limits, render_seconds, say_time};

/// Options of `check`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Experiment or sample file, or the name of a built-in one [default: the experiment that `run` takes].
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: Option<String>,
    #[command(flatten)]
    changes: Changes,
    #[command(flatten)]
    render: RenderOptions,
    #[command(flatten)]
    limits: Limits,
    #[command(flatten)]
    answer: Answer,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    let source = ExperimentSource::find_either(options.file.as_deref())?;
    let json = options.answer.json;
    // They are what is asked for: all of them, as part of the answer or in full.
    let messages = if json { Messages::Quiet } else { Messages::in_full() };
    let mut overrides = options.changes.overrides();
    overrides.extend(options.render.overrides());
    overrides.extend(options.limits.overrides());
    let shown = options.file.as_ref().unwrap_or(&source.name);
    if is_sample(&source.text) {
        let sample = source.resolve_sample(&overrides)?;
        messages.warnings(&sample.record.warnings);
        if json {
            super::print_json(&json!({
                "file": shown,
                "kind": "sample",
                "valid": true,
                "sha256": sample.record.sha256,
                "bands": sample.sample.grid.len(),
                "fluorophores": sample.sample.fluorophores.iter().map(|(f, _)| &f.name).collect::<Vec<_>>(),
                "warnings": sample.record.warnings,
            }))?;
        } else {
            super::print_text(&format!(
                "{}: valid. A flat sample with {} fluorophores, {} bands",
                shown,
                sample.sample.fluorophores.len(),
                sample.sample.grid.len()
            ))?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    let mut experiment = source.resolve(&overrides)?;
    let view = CameraView::of(&mut experiment.study);
    experiment.record.warnings = warnings_before_run(&experiment);
    let ResolvedExperiment { study, record } = &experiment;
    messages.warnings(&record.warnings);
    let scene = &study.scene;
    let needed = fluorspar::render::memory_bytes(scene, &study.render);
    let budget = Budget::of_run(study);
    budget.check(&options.limits, study)?;
    let seconds = render_seconds(&experiment)?;
    say_time(seconds, study.render.samples_per_pixel, study.time_limit_s, Messages::Quiet)?;
    if json {
        super::print_json(&json!({
            "file": shown,
            "kind": "experiment",
            "valid": true,
            "sha256": record.sha256,
            "objects": scene.objects.len(),
            "lights": scene.lights.len(),
            "light_groups": scene.light_groups.iter().map(|g| &g.name).collect::<Vec<_>>(),
            "fluorophores": scene.fluorophores.iter().map(|f| &f.name).collect::<Vec<_>>(),
            "captures": study.captures.iter().map(|c| &c.frame.label).collect::<Vec<_>>(),
            "regions": study.regions.iter().map(|r| &r.name).collect::<Vec<_>>(),
            "instances": instances(scene),
            "camera_view": view.json(),
            "memory_bytes": needed,
            "budget": budget.json(),
            "render_seconds": seconds,
            "warnings": record.warnings,
        }))?;
    } else {
        super::print_text(&format!(
            "{}: valid. {}{}, {} in {}, {}, {}\n{}\nA run needs {}, about {} for rendering{}",
            shown,
            counted(scene.objects.len(), "object", "objects"),
            match instances(scene) {
                0 => String::new(),
                count => format!(" with {count} instances"),
            },
            counted(scene.lights.len(), "light", "lights"),
            counted(scene.light_groups.len(), "group", "groups"),
            counted(scene.fluorophores.len(), "fluorophore", "fluorophores"),
            counted(study.captures.len(), "capture", "captures"),
            view.text() + &regions_text(study),
            budget.text(),
            duration(seconds),
            if needed > study.render.memory_limit_bytes {
                "; the film is larger than the limit of render.memory_limit_gib: only `fluorspar render` takes the image, in bands \
                 of rows"
            } else {
                ""
            }
        ))?;
        if let Some(file) = &options.file {
            messages.status(format!("Next: fluorspar run {file}"));
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// What the camera sees, without light.
struct CameraView {
    /// Width and height of what is sharp, and its distance, mm; `None` where no distance is focused.
    field_mm: Option<[f64; 3]>,
    /// Objects in view with their share of the image, the largest first.
    parts: Vec<(String, f64)>,
    /// Share of the image that shows nothing.
    nothing: f64,
}

/// Columns of the image that tells what is seen.
const VIEW_COLUMNS: usize = 160;
/// Objects that are named.
const MOST_NAMED: usize = 6;

impl CameraView {
    fn of(study: &mut Study) -> Self {
        let field_mm = field_mm(study);
        let camera = &mut study.scene.camera;
        let (width, height) = (camera.width, camera.height);
        let shape = height as f64 / width.max(1) as f64;
        camera.width = VIEW_COLUMNS;
        camera.height = ((VIEW_COLUMNS as f64 * shape).round() as usize).max(1);
        let maps = visible_surfaces(&study.scene);
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
        Self { field_mm, parts, nothing: share(0) }
    }

    fn json(&self) -> serde_json::Value {
        let parts: BTreeMap<&str, f64> =
            self.parts.iter().map(|(name, share)| (name.as_str(), *share)).collect();
        json!({
            "width_mm": self.field_mm.map(|field| field[0]),
            "height_mm": self.field_mm.map(|field| field[1]),
            "distance_mm": self.field_mm.map(|field| field[2]),
            "parts": parts,
            "nothing": self.nothing,
        })
    }

    fn text(&self) -> String {
        let field = match self.field_mm {
            Some([width, height, mm]) if mm > 0.0 => format!("{width:.0} x {height:.0} mm at {mm:.0} mm"),
            Some([width, height, _]) => format!("{width:.0} x {height:.0} mm"),
            None => "this".into(),
        };
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let named =
            self.parts.iter().take(MOST_NAMED).map(|(name, share)| format!("{name} {}", percent(*share)));
        let mut list: Vec<String> = named.collect();
        if self.parts.len() > MOST_NAMED {
            list.push(format!("{} more", self.parts.len() - MOST_NAMED));
        }
        if self.nothing > 0.0 {
            list.push(format!("nothing {}", percent(self.nothing)));
        }
        format!("The camera sees {field}: {}", list.join(", "))
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

/// The regions beside that of the analysis, by name and place; empty without them.
fn regions_text(study: &Study) -> String {
    let one = |region: &RegionPlan| format!("\"{}\" ({})", region.name, region.analysis.region().describe());
    match study.regions.as_slice() {
        [] => String::new(),
        regions => format!(
            "\nFurther regions of frame \"{}\": {}",
            study.analysis.as_ref().map_or("", |plan| plan.frame.as_str()),
            regions.iter().map(one).collect::<Vec<_>>().join(", ")
        ),
    }
}

/// Instances of meshes of all objects.
fn instances(scene: &Scene) -> usize {
    let count = |shape: &Shape| match shape {
        Shape::Instances(many) => many.instances.len(),
        _ => 0,
    };
    scene.objects.iter().map(|object| count(&object.shape)).sum()
}
