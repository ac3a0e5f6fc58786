//! `fluorspar capture`: raw frames from a component image.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{ValueEnum, ValueHint};
use fluorspar::image::SensorImage;
use fluorspar::pipeline::{
    CameraColor, CapturedFrame, ColorRendering, capture, check_same_scene, preview, relight,
};
use fluorspar::study::Study;
use fluorspar_experiment::{ResolvedExperiment, parse, resolve};
use fluorspar_format::{
    DngColor, FormatError, OutputFolder, Provenance, RawPacking, read_component_image, write_atomically,
    write_packed_raw, write_rgb_png, write_sensor_dng, write_sensor_png, write_sensor_tiff,
};
use serde_json::{Value, json};
use std::io::Write;

use crate::args::{Changes, Seed, Talk};
use crate::budget::frame_bytes;
use crate::error::CliError;
use crate::experiment_source::ExperimentSource;
use crate::values::{Override, as_typed, sets};

/// Options of `capture`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Component image: components.exr of a run, or .exr or .npy of `render --components`.
    #[arg(value_name = "COMPONENTS", value_hint = ValueHint::FilePath)]
    image: PathBuf,
    /// Experiment with lens, sensor and captures [default: the one that the image carries].
    #[arg(long, value_name = "EXPERIMENT")]
    experiment: Option<String>,
    #[command(flatten)]
    changes: Changes,
    #[command(flatten)]
    seed: Seed,
    /// Format of the raw frames: TIFF or PNG with a .json description, DNG for raw converters, or packed as camera modules do.
    #[arg(long, value_enum, value_name = "FORM", default_value_t = RawForm::Tiff)]
    format: RawForm,
    /// Folder for the frames.
    #[arg(long, value_name = "DIR", default_value = "fluorspar-out/capture", value_hint = ValueHint::DirPath)]
    out: PathBuf,
    #[command(flatten)]
    talk: Talk,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum RawForm {
    /// 16-bit TIFF and JSON.
    #[default]
    Tiff,
    /// 16-bit PNG and JSON.
    Png,
    /// Adobe Digital Negative.
    Dng,
    /// MIPI RAW10 and JSON; for sensors of 10 bits.
    Raw10,
    /// MIPI RAW12 and JSON; for sensors of up to 12 bits.
    Raw12,
}

impl RawForm {
    fn ending(self) -> &'static str {
        match self {
            Self::Tiff => "tiff",
            Self::Png => "png",
            Self::Dng => "dng",
            Self::Raw10 | Self::Raw12 => "raw",
        }
    }

    fn write(
        self,
        path: &std::path::Path,
        raw: &SensorImage,
        color: Option<CameraColor>,
        provenance: &Provenance,
    ) -> Result<(), FormatError> {
        match self {
            Self::Tiff => write_sensor_tiff(path, raw, Some(provenance)),
            Self::Png => write_sensor_png(path, raw, Some(provenance)),
            Self::Dng => {
                let color = color.map_or_else(DngColor::default, |color| DngColor {
                    xyz_to_camera: color.xyz_to_camera,
                    neutral: color.neutral,
                });
                write_sensor_dng(path, raw, &color, Some(provenance))
            }
            Self::Raw10 => write_packed_raw(path, raw, RawPacking::Raw10, Some(provenance)),
            Self::Raw12 => write_packed_raw(path, raw, RawPacking::Raw12, Some(provenance)),
        }
    }
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    let loaded = read_component_image(&options.image)?;
    let mut components = loaded.image;
    let messages = options.talk.messages();
    let image = options.image.display();
    if components.denoised.is_some() {
        let warning = format!("{image}: this image is denoised: its frames are for display only");
        messages.warnings(&[warning.into()]);
    }
    // As `run` has them, so that the frames are those of `run` whatever file they come from.
    components.round_to_24_bits();
    // What the image was rendered from; nothing that it fixes may be changed here.
    let rendered = match &loaded.provenance {
        None => None,
        Some(provenance) => {
            let name = format!("experiment in {image}");
            let parsed = parse(&provenance.resolved_experiment_toml, &name, std::path::Path::new("."), &[])?;
            Some(resolve(&parsed)?.study)
        }
    };
    let overrides: Vec<Override> =
        options.changes.overrides().into_iter().chain(options.seed.overrides()).collect();
    let mut inputs = vec![options.image.clone()];
    let (text, experiment) = match (&options.experiment, loaded.provenance) {
        (Some(name), _) => {
            let source = ExperimentSource::find(Some(name))?;
            let experiment = source.resolve(&overrides)?;
            messages.warnings(&experiment.record.warnings);
            inputs.extend(source.files(&experiment.record));
            (source.text, experiment)
        }
        (None, Some(provenance)) => {
            let text = provenance.resolved_experiment_toml;
            let name = format!("experiment in {image}");
            let experiment = parse(&text, &name, std::path::Path::new("."), &sets(&overrides))
                .and_then(|parsed| resolve(&parsed))
                .map_err(|error| as_typed(error, &overrides))?;
            (text, experiment)
        }
        (None, None) => {
            return Err(CliError::Input(format!(
                "{image}: this image carries no experiment; name one with --experiment"
            )));
        }
    };
    let ResolvedExperiment { study, record } = experiment;
    if let Some(rendered) = &rendered {
        check_same_scene(&relight(rendered, &study, &mut components)?, &study)?;
    }
    inputs.extend(record.inputs.iter().map(|input| input.path.clone()));
    let folder = OutputFolder::prepare(&options.out, &inputs, frame_bytes(&study))?;
    let frames = capture(&study, &components)?;
    let provenance =
        Provenance::new(&text, record.resolved_toml.clone(), study.render.seed, components.samples_per_pixel);
    let list = write_frames(options.format, &study, &frames, &folder, &provenance)
        .and_then(|list| {
            write_atomically(&folder.path().join("experiment.toml"), |file| {
                file.write_all(record.resolved_toml.as_bytes())
            })?;
            Ok(list)
        })
        .map_err(|error| folder.at_its_place(error))?;
    let target = folder.finish()?;
    if options.talk.json {
        super::print_json(&json!({ "folder": target, "frames": list }))?;
    } else {
        messages.status(format!("Wrote {} frames to {}", frames.len(), target.display()));
    }
    Ok(ExitCode::SUCCESS)
}

/// Writes raw frames and their previews; returns a description of each.
fn write_frames(
    format: RawForm,
    study: &Study,
    frames: &[CapturedFrame],
    folder: &OutputFolder,
    provenance: &Provenance,
) -> Result<Vec<Value>, FormatError> {
    let mut list = Vec::new();
    for (frame, settings) in frames.iter().zip(&study.captures) {
        let color = CameraColor::of_frame(study, settings);
        let name_of = |raw: &SensorImage| format!("raw_{}.{}", raw.label, format.ending());
        for raw in std::iter::once(&frame.raw).chain(&frame.bracket) {
            format.write(&folder.path().join(name_of(raw)), raw, color, provenance)?;
        }
        let file = name_of(&frame.raw);
        let picture = preview(&frame.developed, &ColorRendering::of_frame(study, settings));
        let name = format!("preview_{}.png", frame.raw.label);
        write_rgb_png(&folder.path().join(name), picture.width, picture.height, &picture.rgb)?;
        let saturated = frame.developed.saturated.iter().filter(|s| **s).count();
        list.push(json!({
            "name": frame.raw.label,
            "file": file,
            "bracket_files": frame.bracket.iter().map(name_of).collect::<Vec<_>>(),
            "exposure_s": frame.raw.exposure_s,
            "gain": frame.raw.gain,
            "saturated_fraction": saturated as f64 / frame.developed.saturated.len().max(1) as f64,
        }));
    }
    Ok(list)
}
