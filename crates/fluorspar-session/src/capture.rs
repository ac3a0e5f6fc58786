//! Raw frames from a component image in a file.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{ValueEnum, ValueHint};
use fluorspar::image::{ComponentImage, SensorImage};
use fluorspar::pipeline::{
    CameraColor, CapturedFrame, ColorRendering, LiveView, analyze_regions, analyze_seen, capture_from_planes,
    channel_light, check_captures, columns_per_render_column, preview,
};
use fluorspar::study::{Capture, Study};
use fluorspar_experiment::{ResolvedExperiment, Warning, resolve};
use fluorspar_format::{
    CubeFacts, DngColor, FileFormat, FormatError, OmeChannel, OmeFacts, OutputFolder, Provenance, RawPacking,
    write_atomically, write_ome_tiff, write_ome_zarr, write_packed_raw, write_rgb_png, write_sensor_dng,
    write_sensor_png, write_sensor_tiff,
};
use fluorspar_report::{evaluation_json, leaking_frames};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use crate::frame_report::{FrameReport, warn_of_darkness};
use crate::options::defaults;
use crate::values::{Override, as_typed};
use crate::{
    Changes, ExperimentSource, FinishedRender, Job, Result, Seed, ShownExperiment, Wanted,
    as_typed_in_session, experiment_of, frame_bytes, image_warnings, say_uncertainty, warn_of_denoised,
};

/// Which component image is captured, by which experiment.
#[derive(Clone, Debug, Deserialize, clap::Args)]
#[serde(default = "defaults")]
pub struct CaptureOptions {
    /// Component image: components.exr of a run, or .exr or .npy of `render --components`.
    #[arg(value_name = "COMPONENTS", value_hint = ValueHint::FilePath)]
    pub image: PathBuf,
    /// Experiment with lens, sensor and captures [default: the one that the image carries].
    #[arg(long, value_name = "EXPERIMENT")]
    pub experiment: Option<String>,
    /// Changes by path.
    #[command(flatten)]
    #[serde(flatten)]
    pub changes: Changes,
    /// Seed of the noise.
    #[command(flatten)]
    #[serde(flatten)]
    pub seed: Seed,
    /// Format of the raw frames: TIFF or PNG with a .json description, DNG for raw converters, or packed as camera modules do.
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = RawForm::Tiff)]
    pub format: RawForm,
    /// Also write report.html, with the analysis and the numbers that a design is judged by.
    #[arg(long)]
    pub report: bool,
    /// Folder for the frames.
    #[arg(long, value_name = "DIR", default_value = "fluorspar-out/capture", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
}

/// Formats of raw frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum RawForm {
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
    /// OME-TIFF for Fiji, napari and QuPath: no raw frame but its linear channels, digital numbers above black, a page each.
    #[serde(rename = "ome-tiff")]
    OmeTiff,
    /// OME-Zarr 0.5 for napari and servers of pictures: a folder with what ome-tiff has.
    #[serde(rename = "ome-zarr")]
    OmeZarr,
}

impl RawForm {
    fn ending(self) -> &'static str {
        match self {
            Self::Tiff => "tiff",
            Self::Png => "png",
            Self::Dng => "dng",
            Self::Raw10 | Self::Raw12 => "raw",
            Self::OmeTiff => "ome.tiff",
            Self::OmeZarr => "ome.zarr",
        }
    }

    /// Whether its files are raw frames.
    pub fn is_raw(self) -> bool {
        !matches!(self, Self::OmeTiff | Self::OmeZarr)
    }

    fn write(
        self,
        path: &Path,
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
            // Not of raw values
            Self::OmeTiff | Self::OmeZarr => Ok(()),
        }
    }
}

/// Frames of all captures in a folder.
#[derive(Clone, Debug, Serialize)]
pub struct CapturedFolder {
    /// The folder.
    pub folder: PathBuf,
    /// Name, files and exposure of each frame.
    pub frames: Vec<Value>,
}

/// Captures a component image into the folder of the options.
///
/// # Errors
/// An option without a meaning, an image or an experiment that can't be read, captures that can't be taken of the image, a folder that can't be
/// written.
pub fn capture(options: &CaptureOptions, job: &Job) -> Result<CapturedFolder> {
    // A report analyzes the frames, for which it asks maps and surfaces; a scale follows from depths
    let image = match options.report || !options.format.is_raw() {
        true => FinishedRender::open(&options.image)?,
        false => FinishedRender::open_for_captures(&options.image)?,
    };
    warn_of_denoised(&image, job);
    let overrides: Vec<Override> =
        options.changes.overrides().into_iter().chain(options.seed.overrides()).collect();
    let mut inputs = vec![options.image.clone()];
    let (text, shown) = match &options.experiment {
        Some(name) => {
            let source = ExperimentSource::find(Some(name))?;
            let parsed = source.parse(&overrides)?;
            let experiment = resolve(&parsed).map_err(|error| as_typed(error, &overrides))?;
            job.warn(&experiment.record.warnings);
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
    let rendered = image.experiment().ok().flatten().map(Arc::as_ref);
    let warnings = image_warnings(image.labels(), rendered, &experiment);
    job.warn(&warnings);
    experiment.record.warnings.extend(warnings);
    let ResolvedExperiment { study, record } = &experiment;
    inputs.extend(record.inputs.iter().map(|input| input.path.clone()));
    check_captures(study, image.labels())?;
    let folder = OutputFolder::prepare(&options.out, &inputs, frame_bytes(study))?;
    let spectra = if options.report { image.spectra(study, &changes)? } else { None };
    if options.report && spectra.is_none() {
        job.status(
            "The page tells neither leak nor light by origin: the spectra of the image do not fit into render.memory_limit_gib; raise it",
        );
    }
    let view = image.seen_by(study, &study.captures, changes, Wanted::Lit)?;
    say_uncertainty(&view, study, job);
    let seen = view.components(&image);
    let frames = capture_from_planes(study, &seen)?;
    warn_of_darkness(&experiment, &frames, job);
    let provenance = Provenance::new(
        &text,
        record.resolved_toml.clone(),
        study.render.seed,
        image.labels().samples_per_pixel,
    );
    let list = write_frames(options.format, (study, image.labels()), &frames, &folder, &provenance)
        .and_then(|list| {
            write_atomically(&folder.path().join("experiment.toml"), |file| {
                file.write_all(record.resolved_toml.as_bytes())
            })?;
            Ok(list)
        })
        .map_err(|error| folder.at_its_place(error))?;
    let labels = image.labels();
    let mut results = results_json(&options.image, [labels.width, labels.height], &list);
    if options.report {
        let analysis = analyze_seen(study, Some(&seen), &frames)?;
        let regions = analyze_regions(study, Some(&seen), &frames)?;
        let report = FrameReport {
            analysis,
            regions,
            live: LiveView::new(study, &seen, &frames)?,
            components: spectra.as_ref().map(|spectra| (spectra, seen)),
            raw_ending: options.format.is_raw().then(|| options.format.ending()),
            ..FrameReport::simulated(&experiment, &text, frames)
        };
        let found = report.write(folder.path()).map_err(|error| error.at_its_place(&folder))?;
        job.warn(&leaking_frames(&found.leaks).into_iter().map(Warning::from).collect::<Vec<_>>());
        results.extend(evaluation_json(&found)?);
        results.insert("warnings".into(), serde_json::to_value(&record.warnings)?);
    }
    let results = serde_json::to_vec_pretty(&results)?;
    write_atomically(&folder.path().join("results.json"), |file| file.write_all(&results))
        .map_err(|error| folder.at_its_place(error))?;
    let target = folder.finish()?;
    Ok(CapturedFolder { folder: target, frames: list })
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
    (study, labels): (&Study, &ComponentImage),
    frames: &[CapturedFrame],
    folder: &OutputFolder,
    provenance: &Provenance,
) -> Result<Vec<Value>, FormatError> {
    let write = |(frame, settings): (&CapturedFrame, &Capture)| -> Result<Value, FormatError> {
        let kind = if format.is_raw() { "raw" } else { "frame" };
        let name_of = |raw: &SensorImage| format!("{kind}_{}.{}", raw.label, format.ending());
        let bracket = if format.is_raw() { frame.bracket.as_slice() } else { &[] };
        for raw in std::iter::once(&frame.raw).chain(bracket) {
            let color = || CameraColor::of_frame(study, settings);
            format.write(&folder.path().join(name_of(raw)), raw, color, provenance)?;
        }
        if !format.is_raw() {
            let path = folder.path().join(name_of(&frame.raw));
            write_channels(format, &path, (study, labels), frame, settings)?;
        }
        let file = name_of(&frame.raw);
        let picture = preview(&frame.developed, &ColorRendering::of_frame(study, settings));
        let name = format!("preview_{}.png", frame.raw.label);
        write_rgb_png(&folder.path().join(name), picture.width, picture.height, &picture.rgb)?;
        let saturated = frame.developed.saturated.iter().filter(|s| **s).count();
        Ok(json!({
            "name": frame.raw.label,
            "file": file,
            "bracket_files": bracket.iter().map(name_of).collect::<Vec<_>>(),
            "exposure_s": frame.raw.exposure_s,
            "gain": frame.raw.gain,
            "saturated_fraction": saturated as f64 / frame.developed.saturated.len().max(1) as f64,
        }))
    };
    frames.par_iter().zip(&study.captures).map(write).collect()
}

/// Writes the channels of a frame as OME-TIFF or OME-Zarr.
fn write_channels(
    format: RawForm,
    path: &Path,
    (study, labels): (&Study, &ComponentImage),
    frame: &CapturedFrame,
    settings: &Capture,
) -> Result<(), FormatError> {
    let (developed, light) = (&frame.developed, channel_light(study, settings));
    let facts = CubeFacts::of_maps(labels.features.clone(), [labels.width, labels.height]);
    let scale = facts.mm_per_pixel.zip(columns_per_render_column(study, labels));
    let channel = |(number, name): (usize, &String)| OmeChannel {
        name: format!("{} {name}", frame.raw.label),
        emission_nm: light.emission_nm.get(number).copied().flatten(),
        excitation_nm: light.excitation_nm,
    };
    let channels: Vec<OmeChannel> = developed.channels.iter().enumerate().map(channel).collect();
    let subtracted = settings.subtract.as_ref();
    let less = subtracted.map_or_else(String::new, |name| format!(", frame \"{name}\" subtracted"));
    let facts = OmeFacts {
        title: frame.raw.label.clone(),
        mm_per_pixel: scale.map(|(mm, columns)| mm / columns),
        exposure_s: Some(frame.raw.exposure_s),
        unit: format!("digital numbers above black, linear{less}"),
    };
    let write = if format == RawForm::OmeZarr { write_ome_zarr } else { write_ome_tiff };
    write(path, [developed.width, developed.height], &developed.data, &channels, &facts)
}
