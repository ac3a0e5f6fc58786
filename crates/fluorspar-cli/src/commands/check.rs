//! `fluorspar check`: validate only.

use std::process::ExitCode;

use clap::ValueHint;
use fluorspar::scene::{Scene, Shape};
use fluorspar_experiment::{ResolvedExperiment, is_sample};
use serde_json::json;

use crate::args::{Changes, Talk};
use crate::budget::{Budget, Limits, render_seconds, say_time};
use crate::error::CliError;
use crate::experiment_source::ExperimentSource;
use crate::message::Messages;
use crate::progress::duration;

/// Options of `check`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Experiment or sample file, or the name of a built-in one [default: the experiment that `run` takes].
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: Option<String>,
    #[command(flatten)]
    changes: Changes,
    #[command(flatten)]
    limits: Limits,
    #[command(flatten)]
    talk: Talk,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    let source = ExperimentSource::find_either(options.file.as_deref())?;
    let (json, silent) = (options.talk.json, options.talk.quiet && !options.talk.json);
    // They are what is asked for: all of them, as part of the answer or in full.
    let messages = if options.talk.quiet || json { Messages::Quiet } else { Messages::Full };
    let mut overrides = options.changes.overrides();
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
        } else if !silent {
            super::print_text(&format!(
                "{}: valid. A flat sample with {} fluorophores, {} bands",
                shown,
                sample.sample.fluorophores.len(),
                sample.sample.grid.len()
            ))?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    let experiment = source.resolve(&overrides)?;
    let ResolvedExperiment { study, record } = &experiment;
    messages.warnings(&record.warnings);
    let scene = &study.scene;
    let needed = fluorspar::render::memory_bytes(scene, &study.render);
    let budget = Budget::of_run(study);
    budget.check(&options.limits, study)?;
    // With `--quiet` only the exit code tells something.
    let seconds =
        if silent && study.time_limit_s.is_none() { None } else { Some(render_seconds(&experiment)?) };
    if let Some(seconds) = seconds {
        say_time(seconds, study.render.samples_per_pixel, study.time_limit_s, Messages::Quiet)?;
    }
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
            "instances": instances(scene),
            "memory_bytes": needed,
            "budget": budget.json(),
            "render_seconds": seconds,
            "warnings": record.warnings,
        }))?;
    } else if !silent {
        super::print_text(&format!(
            "{}: valid. {} objects{}, {} lights in {} groups, {} fluorophores, {} captures\nA run needs {}, about {} for rendering{}",
            shown,
            scene.objects.len(),
            match instances(scene) {
                0 => String::new(),
                count => format!(" with {count} instances"),
            },
            scene.lights.len(),
            scene.light_groups.len(),
            scene.fluorophores.len(),
            study.captures.len(),
            budget.text(),
            duration(seconds.unwrap_or_default()),
            if needed > study.render.memory_limit_bytes {
                "; the film is larger than the limit of render.memory_limit_gib: only `fluorspar render` takes the image, in bands \
                 of rows"
            } else {
                ""
            }
        ))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Instances of meshes of all objects.
fn instances(scene: &Scene) -> usize {
    let count = |shape: &Shape| match shape {
        Shape::Instances(many) => many.instances.len(),
        _ => 0,
    };
    scene.objects.iter().map(|object| count(&object.shape)).sum()
}
