//! `fluorspar capture`: raw frames from a component image.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueHint;
use fluorspar::experiment::{parse, resolve};
use fluorspar::format::{Provenance, read_component_exr, write_atomically, write_rgb_png, write_sensor_tiff};
use fluorspar::pipeline::{ColorRendering, capture, check_same_scene, preview, with_rendered_camera};
use serde_json::json;
use std::io::Write;

use super::out_folder;
use crate::args::{Changes, Seed, Talk};
use crate::error::CliError;
use crate::experiment_source::ExperimentSource;

/// Options of `capture`.
///
/// What is in the image stays as it was rendered; a change of it is refused.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Component image: components.exr of a run, or `render --components`.
    #[arg(value_name = "COMPONENTS.exr", value_hint = ValueHint::FilePath)]
    image: PathBuf,
    /// Experiment with lens, sensor and captures [default: the one that the image carries].
    #[arg(long, value_name = "EXPERIMENT")]
    experiment: Option<String>,
    #[command(flatten)]
    changes: Changes,
    #[command(flatten)]
    seed: Seed,
    /// Folder for the frames.
    #[arg(long, value_name = "DIR", default_value = "fluorspar-out/capture", value_hint = ValueHint::DirPath)]
    out: PathBuf,
    #[command(flatten)]
    talk: Talk,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    let loaded = read_component_exr(&options.image)?;
    let mut components = loaded.image;
    // As `run` has them, so that the frames are those of `run` whatever file they come from.
    components.round_to_24_bits();
    let image = options.image.display();
    // What the image was rendered from; nothing that it fixes may be changed here.
    let rendered = match &loaded.provenance {
        None => None,
        Some(provenance) => {
            let name = format!("experiment in {image}");
            let parsed = parse(&provenance.resolved_experiment_toml, &name, std::path::Path::new("."), &[])?;
            Some(resolve(&parsed)?)
        }
    };
    let overrides: Vec<String> =
        options.changes.set.iter().cloned().chain(options.seed.overrides()).collect();
    let mut inputs = vec![options.image.clone()];
    let (text, experiment) = match (&options.experiment, loaded.provenance) {
        (Some(name), _) => {
            let source = ExperimentSource::find(Some(name))?;
            let experiment = source.resolve(&overrides, options.talk.quiet)?;
            inputs.extend(source.files(&experiment));
            (source.text, experiment)
        }
        (None, Some(provenance)) => {
            let text = provenance.resolved_experiment_toml;
            let name = format!("experiment in {image}");
            let parsed = parse(&text, &name, std::path::Path::new("."), &overrides)?;
            let experiment = resolve(&parsed)?;
            (text, experiment)
        }
        (None, None) => {
            return Err(CliError::Input(format!(
                "{image}: this image carries no experiment; name one with --experiment"
            )));
        }
    };
    let experiment = match &rendered {
        Some(rendered) => {
            check_same_scene(rendered, &experiment)?;
            with_rendered_camera(experiment, rendered)
        }
        None => experiment,
    };
    inputs.extend(experiment.inputs.iter().map(|input| input.path.clone()));
    let folder = out_folder::OutFolder::prepare(&options.out, &inputs)?;
    let frames = capture(&experiment, &components)?;
    let provenance = Provenance::new(
        &text,
        experiment.resolved_toml.clone(),
        experiment.render.seed,
        components.samples_per_pixel,
    );
    let mut list = Vec::new();
    for (frame, settings) in frames.iter().zip(&experiment.captures) {
        let file = format!("raw_{}.tiff", frame.raw.label);
        write_sensor_tiff(&folder.path().join(&file), &frame.raw, Some(&provenance))?;
        let picture = preview(&frame.developed, &ColorRendering::of_frame(&experiment, settings));
        let name = format!("preview_{}.png", frame.raw.label);
        write_rgb_png(&folder.path().join(name), picture.width, picture.height, &picture.rgb)?;
        let saturated = frame.developed.saturated.iter().filter(|s| **s).count();
        list.push(json!({
            "name": frame.raw.label,
            "file": file,
            "exposure_s": frame.raw.exposure_s,
            "gain": frame.raw.gain,
            "saturated_fraction": saturated as f64 / frame.developed.saturated.len().max(1) as f64,
        }));
    }
    write_atomically(&folder.path().join("experiment.toml"), |file| {
        file.write_all(experiment.resolved_toml.as_bytes())
    })?;
    let target = folder.finish()?;
    if options.talk.json {
        super::print_json(&json!({ "folder": target, "frames": list }))?;
    } else if !options.talk.quiet {
        eprintln!("Wrote {} frames to {}", frames.len(), target.display());
    }
    Ok(ExitCode::SUCCESS)
}
