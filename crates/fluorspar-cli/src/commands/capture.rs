//! `fluorspar capture`: raw frames from a component image.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use clap::{ValueEnum, ValueHint};
use fluorspar::image::SensorImage;
use fluorspar::pipeline::{
    CameraColor, CapturedFrame, ColorRendering, analyze_regions, analyze_seen, capture_from_planes,
    check_captures, preview,
};
use fluorspar::study::{Capture, Study};
use fluorspar_experiment::{ResolvedExperiment, resolve};
use fluorspar_format::{
    DngColor, FileFormat, FormatError, OutputFolder, Provenance, RawPacking, write_atomically,
    write_packed_raw, write_rgb_png, write_sensor_dng, write_sensor_png, write_sensor_tiff,
};
use fluorspar_report::{FrameOrigin, evaluation_json};
use fluorspar_session::{FinishedRender, ShownExperiment, Wanted, coarse_image};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::io::Write;

use super::frame_report::{FrameReport, warn_of_darkness};
use super::rendered_image::{as_typed_in_session, experiment_of, say_uncertainty, warn_of_denoised};
use crate::args::{Answer, Changes, Seed};
use crate::error::CliError;
use crate::experiment_source::ExperimentSource;
use crate::message::Messages;
use crate::resource_needs::frame_bytes;
use crate::values::{Override, as_typed};

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
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = RawForm::Tiff)]
    format: RawForm,
    /// Also write report.html, with the analysis and the numbers that a design is judged by.
    #[arg(long)]
    report: bool,
    /// Folder for the frames.
    #[arg(long, value_name = "DIR", default_value = "fluorspar-out/capture", value_hint = ValueHint::DirPath)]
    out: PathBuf,
    #[command(flatten)]
    answer: Answer,
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
        color: impl Fn() -> Option<CameraColor>,
        provenance: &Provenance,
    ) -> Result<(), FormatError> {
        match self {
            Self::Tiff => write_sensor_tiff(path, raw, Some(provenance)),
            Self::Png => write_sensor_png(path, raw, Some(provenance)),
            Self::Dng => {
                let color = color().map_or_else(DngColor::default, |color| DngColor {
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
    let messages = Messages::default();
    // A report analyzes the frames, for which it asks maps and surfaces
    let image = match options.report {
        true => FinishedRender::open(&options.image)?,
        false => FinishedRender::open_for_captures(&options.image)?,
    };
    warn_of_denoised(&image, messages);
    let overrides: Vec<Override> =
        options.changes.overrides().into_iter().chain(options.seed.overrides()).collect();
    let mut inputs = vec![options.image.clone()];
    let (text, shown) = match &options.experiment {
        Some(name) => {
            let source = ExperimentSource::find(Some(name))?;
            let parsed = source.parse(&overrides)?;
            let experiment = resolve(&parsed).map_err(|error| as_typed(error, &overrides))?;
            messages.warnings(&experiment.record.warnings);
            inputs.extend(source.files(&experiment.record));
            let shown = image.shown_by(&parsed, experiment)?;
            (source.text, shown)
        }
        None => {
            let (text, parsed) = experiment_of(&image, &overrides)?;
            let shown = match options.report {
                true => image.shown_whole(&parsed),
                false => image.shown(&parsed),
            };
            (text, shown.map_err(|error| as_typed_in_session(error, &overrides))?)
        }
    };
    let ShownExperiment { mut experiment, changes } = shown;
    if let Some(warning) =
        coarse_image(image.labels(), image.experiment().ok().flatten().map(Arc::as_ref), &experiment.study)
    {
        messages.warnings(std::slice::from_ref(&warning));
        experiment.record.warnings.push(warning);
    }
    let ResolvedExperiment { study, record } = &experiment;
    inputs.extend(record.inputs.iter().map(|input| input.path.clone()));
    check_captures(study, image.labels())?;
    let folder = OutputFolder::prepare(&options.out, &inputs, frame_bytes(study))?;
    let spectra = if options.report { image.spectra(study, &changes)? } else { None };
    if options.report && spectra.is_none() {
        messages.status(
            "The page tells neither leak nor light by origin: the spectra of the image do not fit into render.memory_limit_gib; raise it",
        );
    }
    let view = image.seen_by(study, &study.captures, changes, Wanted::Lit)?;
    say_uncertainty(&view, study, messages);
    let seen = view.components(&image);
    let frames = capture_from_planes(study, &seen)?;
    warn_of_darkness(&experiment, &frames, messages);
    let provenance = Provenance::new(
        &text,
        record.resolved_toml.clone(),
        study.render.seed,
        image.labels().samples_per_pixel,
    );
    let list = write_frames(options.format, study, &frames, &folder, &provenance)
        .and_then(|list| {
            write_atomically(&folder.path().join("experiment.toml"), |file| {
                file.write_all(record.resolved_toml.as_bytes())
            })?;
            Ok(list)
        })
        .map_err(|error| folder.at_its_place(error))?;
    let count = frames.len();
    let labels = image.labels();
    let mut results = results_json(&options.image, [labels.width, labels.height], &list);
    if options.report {
        let analysis = analyze_seen(study, Some(&seen), &frames)?;
        let regions = analyze_regions(study, Some(&seen), &frames)?;
        let report = FrameReport {
            experiment: &experiment,
            experiment_text: &text,
            frames,
            analysis,
            regions,
            components: spectra.as_ref(),
            frames_from: FrameOrigin::Simulated,
            described_frames: Vec::new(),
            raw_ending: Some(options.format.ending()),
        };
        let found = report.write(folder.path()).map_err(|error| error.at_its_place(&folder))?;
        results.extend(evaluation_json(&found)?);
        results.insert("warnings".into(), serde_json::to_value(&record.warnings)?);
    }
    let results = serde_json::to_vec_pretty(&results)?;
    write_atomically(&folder.path().join("results.json"), |file| file.write_all(&results))
        .map_err(|error| folder.at_its_place(error))?;
    let target = folder.finish()?;
    if options.answer.json {
        super::print_json(&json!({ "folder": target, "frames": list }))?;
    } else {
        let place = target.display();
        let next = match options.report {
            true => format!("Open {}", target.join("report.html").display()),
            false => format!(
                "Next: fluorspar analyze {place} --out FOLDER, or capture again with --report for a page"
            ),
        };
        messages.status(format!(
            "Wrote {count} {} to {place}. {next}",
            if count == 1 { "frame" } else { "frames" }
        ));
    }
    Ok(ExitCode::SUCCESS)
}

/// What the folder of a capture tells: the component image that the frames come from, and the frames.
fn results_json(image: &Path, [width, height]: [usize; 2], frames: &[Value]) -> Map<String, Value> {
    let image = image.canonicalize().unwrap_or_else(|_| image.to_path_buf());
    Map::from_iter([
        ("format".into(), json!(FileFormat::RESULTS.version())),
        ("program".into(), json!("fluorspar")),
        ("version".into(), json!(env!("CARGO_PKG_VERSION"))),
        ("components_file".into(), json!(image)),
        ("width_px".into(), json!(width)),
        ("height_px".into(), json!(height)),
        ("frames".into(), json!(frames)),
    ])
}

/// Writes raw frames and their previews; returns a description of each.
fn write_frames(
    format: RawForm,
    study: &Study,
    frames: &[CapturedFrame],
    folder: &OutputFolder,
    provenance: &Provenance,
) -> Result<Vec<Value>, FormatError> {
    let write = |(frame, settings): (&CapturedFrame, &Capture)| -> Result<Value, FormatError> {
        let name_of = |raw: &SensorImage| format!("raw_{}.{}", raw.label, format.ending());
        for raw in std::iter::once(&frame.raw).chain(&frame.bracket) {
            let color = || CameraColor::of_frame(study, settings);
            format.write(&folder.path().join(name_of(raw)), raw, color, provenance)?;
        }
        let file = name_of(&frame.raw);
        let picture = preview(&frame.developed, &ColorRendering::of_frame(study, settings));
        let name = format!("preview_{}.png", frame.raw.label);
        write_rgb_png(&folder.path().join(name), picture.width, picture.height, &picture.rgb)?;
        let saturated = frame.developed.saturated.iter().filter(|s| **s).count();
        Ok(json!({
            "name": frame.raw.label,
            "file": file,
            "bracket_files": frame.bracket.iter().map(name_of).collect::<Vec<_>>(),
            "exposure_s": frame.raw.exposure_s,
            "gain": frame.raw.gain,
            "saturated_fraction": saturated as f64 / frame.developed.saturated.len().max(1) as f64,
        }))
    };
    frames.par_iter().zip(&study.captures).map(write).collect()
}
