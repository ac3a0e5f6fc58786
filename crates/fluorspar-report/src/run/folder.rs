//! Writes everything that a run produced into one folder.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use fluorspar::analysis::{Analysis, RegionError};
use fluorspar::findings::{Finding, findings, region_findings};
use fluorspar::image::{ComponentImage, ExcitationImage, SpectralImage};
use fluorspar::pipeline::{AnalyzedRegion, Evaluation, frame_radiance, radiance_preview};
use fluorspar::spectral::Radiance;
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_format::{
    ExrCompression, ExrOptions, FileFormat, FormatError, Provenance, write_atomically, write_component_exr,
    write_label_png, write_rgb_png, write_sensor_tiff, write_spectral_exr,
};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use thiserror::Error;

use super::{NamedFigure, RunReport, RunResults, run_report};
use crate::FigureError;

/// Why a run can't be saved.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RunFolderError {
    /// The folder can't be made.
    #[error("{}: can't make this folder: {source}. Choose another with --out", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A file can't be written.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A figure can't be drawn.
    #[error("figure \"{stem}\": {source}")]
    Figure {
        /// Its file name.
        stem: String,
        /// The error.
        source: FigureError,
    },
    /// Results that are not JSON.
    #[error("results.json: {0}")]
    Json(#[from] serde_json::Error),
}

/// Writes what the render of a run gave: `experiment.toml` and `components.exr`, from which everything else can be made, with the
/// excitation basis, if there is one.
///
/// # Errors
/// A folder or file that can't be written.
pub fn write_run_components(
    folder: &Path,
    experiment: &ResolvedExperiment,
    experiment_text: &str,
    components: &ComponentImage,
    excitation: Option<&ExcitationImage>,
) -> Result<(), RunFolderError> {
    fs::create_dir_all(folder)
        .map_err(|source| RunFolderError::Folder { path: folder.to_path_buf(), source })?;
    let provenance = provenance(experiment, experiment_text, components);
    let all_lights = components.recombine(|_| 1.0);
    let shown = rgb_layer(&all_lights);
    let options = ExrOptions {
        compression: ExrCompression::Rounded24,
        preview: Some(&shown),
        provenance: Some(&provenance),
        excitation,
    };
    write_text(&folder.join("experiment.toml"), &experiment.record.resolved_toml)?;
    write_component_exr(&folder.join("components.exr"), components, &options)?;
    Ok(())
}

/// Linear R, G, B as an eye sees them, for viewers that know no wavelengths.
fn rgb_layer(radiance: &SpectralImage<Radiance>) -> Vec<[f32; 3]> {
    let image = radiance_preview(radiance);
    let linear = |value: u8| {
        let encoded = f32::from(value) / 255.0;
        if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
    };
    image.rgb.chunks_exact(3).map(|p| [linear(p[0]), linear(p[1]), linear(p[2])]).collect()
}

fn provenance(experiment: &ResolvedExperiment, text: &str, components: &ComponentImage) -> Provenance {
    let seed = experiment.study.render.seed;
    Provenance::new(text, experiment.record.resolved_toml.clone(), seed, components.samples_per_pixel)
}

/// Writes the folder of a run, beside what [`write_run_components`] wrote, and returns the path of the report.
///
/// | file | content |
/// |---|---|
/// | `report.html` | pictures, figures and numbers, explained; carries the experiment |
/// | `results.json` | every number, for programs |
/// | `preview_*.png` | the developed frames |
/// | `raw_*.tiff`, `.json` | 16-bit mosaics and their description |
/// | `radiance_*.exr` | spectral radiance of each frame that has light |
/// | `figures/` | every figure as SVG and PNG, its points as CSV |
///
/// Each file is complete or absent; the report comes last.
///
/// # Errors
/// A folder or file that can't be written.
pub fn write_run_folder(folder: &Path, run: &RunResults<'_>) -> Result<PathBuf, RunFolderError> {
    fs::create_dir_all(folder)
        .map_err(|source| RunFolderError::Folder { path: folder.to_path_buf(), source })?;
    let evaluation = run.evaluation;
    let Some(components) = run.components else { return write_frame_report(folder, run) };
    let provenance = provenance(run.experiment, run.experiment_text, components);
    let options = ExrOptions {
        compression: ExrCompression::Rounded24,
        provenance: Some(&provenance),
        ..Default::default()
    };

    let images = || -> Result<(), RunFolderError> {
        for capture in &run.experiment.study.captures {
            if capture.frame.lights.values().any(|&drive| drive > 0.0) {
                let radiance = frame_radiance(&capture.frame, components);
                let shown = rgb_layer(&radiance);
                let options = ExrOptions { preview: Some(&shown), ..options };
                let path = folder.join(format!("radiance_{}.exr", capture.frame.label));
                write_spectral_exr(&path, &radiance, &options)?;
            }
        }
        for frame in &evaluation.frames {
            for raw in std::iter::once(&frame.raw).chain(&frame.bracket) {
                let path = folder.join(format!("raw_{}.tiff", raw.label));
                write_sensor_tiff(&path, raw, Some(&provenance))?;
            }
        }
        let mut results = serde_json::to_string_pretty(&results_json(run, components)?)?;
        results.push('\n');
        Ok(write_text(&folder.join("results.json"), &results)?)
    };
    // Files and figures side by side
    let (written, page) = rayon::join(images, || report_and_figures(folder, run));
    written?;
    write_report(folder, &page?)
}

/// Writes the report of frames into a folder: `preview_*.png`, `targets.png` where there are targets, `figures/` (every figure as SVG and PNG, and its points as CSV) and
/// `report.html`, whose path it returns. The report comes last.
///
/// # Errors
/// A folder or file that can't be written.
pub fn write_frame_report(folder: &Path, run: &RunResults<'_>) -> Result<PathBuf, RunFolderError> {
    write_report(folder, &report_and_figures(folder, run)?)
}

fn write_report(folder: &Path, page: &str) -> Result<PathBuf, RunFolderError> {
    let report = folder.join("report.html");
    write_text(&report, page)?;
    Ok(report)
}

/// Writes all of a report but its page, which it returns.
fn report_and_figures(folder: &Path, run: &RunResults<'_>) -> Result<String, RunFolderError> {
    let figures = folder.join("figures");
    fs::create_dir_all(&figures)
        .map_err(|source| RunFolderError::Folder { path: figures.clone(), source })?;
    for (frame, preview) in run.evaluation.frames.iter().zip(&run.evaluation.previews) {
        let path = folder.join(format!("preview_{}.png", frame.raw.label));
        write_rgb_png(&path, preview.width, preview.height, &preview.rgb)?;
    }
    if let Some(labels) = run.evaluation.analysis.as_ref().and_then(|analyzed| analyzed.targets.as_ref()) {
        write_label_png(&folder.join("targets.png"), labels.width, labels.height, &labels.labels)?;
    }
    let RunReport { page, figures: list } = run_report(run);
    let write = |named: &NamedFigure| -> Result<(), RunFolderError> {
        write_text(&figures.join(format!("{}.svg", named.stem)), &named.figure.to_svg())?;
        if let Some(csv) = named.figure.to_csv() {
            write_text(&figures.join(format!("{}.csv", named.stem)), &csv)?;
        }
        let png = named
            .figure
            .to_png()
            .map_err(|source| RunFolderError::Figure { stem: named.stem.clone(), source })?;
        Ok(write_atomically(&figures.join(format!("{}.png", named.stem)), |file| file.write_all(&png))?)
    };
    let (written, page) = rayon::join(|| list.par_iter().try_for_each(write), || page.to_html());
    written?;
    Ok(page)
}

fn write_text(path: &Path, text: &str) -> Result<(), FormatError> {
    write_atomically(path, |file| file.write_all(text.as_bytes()))
}

/// The content of `results.json`.
fn results_json(run: &RunResults<'_>, components: &ComponentImage) -> Result<Value, serde_json::Error> {
    let (study, record, evaluation) = (&run.experiment.study, &run.experiment.record, run.evaluation);
    let frames: Vec<Value> = evaluation
        .frames
        .iter()
        .map(|frame| {
            let raw = &frame.raw;
            let saturated = frame.developed.saturated.iter().filter(|s| **s).count();
            json!({
                "name": raw.label,
                "exposure_s": raw.exposure_s,
                "gain": raw.gain,
                "black_level_dn": raw.black_level,
                "white_level_dn": raw.white_level,
                "dn_per_electron": raw.dn_per_electron,
                "read_noise_dn": raw.read_noise_dn,
                "saturated_fraction": saturated as f64 / frame.developed.saturated.len().max(1) as f64,
                "raw_file": format!("raw_{}.tiff", raw.label),
                "preview_file": format!("preview_{}.png", raw.label),
            })
        })
        .collect();
    let mut results = Map::from_iter([
        ("format".into(), json!(FileFormat::RESULTS.version())),
        ("program".into(), json!("fluorspar")),
        ("version".into(), json!(env!("CARGO_PKG_VERSION"))),
        ("title".into(), json!(record.title)),
        ("experiment_sha256".into(), json!(record.sha256)),
        ("seed".into(), json!(study.render.seed)),
        ("samples_per_pixel".into(), json!(components.samples_per_pixel)),
        ("width_px".into(), json!(components.width)),
        ("height_px".into(), json!(components.height)),
        ("wavelength_edges_nm".into(), json!(study.scene.grid.edges_nm())),
        ("components".into(), json!(components.components.iter().map(|c| c.label()).collect::<Vec<_>>())),
        ("frames".into(), json!(frames)),
    ]);
    results.extend(evaluation_json(evaluation)?);
    results.insert("warnings".into(), json!(record.warnings));
    Ok(Value::Object(results))
}

/// What follows from the frames, as `results.json` of runs and captures has it.
///
/// # Errors
/// Numbers that JSON can't hold.
pub fn evaluation_json(evaluation: &Evaluation) -> Result<Map<String, Value>, serde_json::Error> {
    let analysis =
        evaluation.analysis.as_ref().map(|analyzed| serde_json::to_value(&analyzed.analysis)).transpose()?;
    let leak_ratio = evaluation.analyzed_leak().and_then(|leak| leak.leak_ratio);
    Ok(Map::from_iter([
        ("findings".into(), serde_json::to_value(findings(evaluation))?),
        ("analysis".into(), json!(analysis)),
        ("regions".into(), regions_json(evaluation.regions.iter().map(AnalyzedRegion::analysis))?),
        ("region_radiance_w_per_sr_m2_nm".into(), serde_json::to_value(&evaluation.region_radiance)?),
        ("leak_ratio".into(), json!(leak_ratio)),
        ("leaks".into(), serde_json::to_value(&evaluation.leaks)?),
        ("depths_of_light".into(), serde_json::to_value(&evaluation.depths)?),
        ("safety".into(), serde_json::to_value(&evaluation.safety)?),
        ("spectroradiometers".into(), serde_json::to_value(&evaluation.spectra)?),
    ]))
}

/// Further regions of the analyzed frame, as `results.json` has them: each with its name and its analysis, or with `not_in_view`, why
/// no pixel shows it.
fn regions_json<'a>(
    regions: impl Iterator<Item = (&'a str, Result<&'a Analysis, &'a RegionError>)>,
) -> Result<Value, serde_json::Error> {
    let one = |(name, analysis): (&str, Result<&Analysis, &RegionError>)| match analysis {
        Ok(analysis) => Ok(json!({ "name": name, "analysis": serde_json::to_value(analysis)? })),
        Err(why) => Ok(json!({ "name": name, "not_in_view": why.to_string() })),
    };
    regions.map(one).collect::<Result<Vec<Value>, _>>().map(Value::Array)
}

/// An analysis with its findings and those of further regions, as `analyze --json` prints it.
///
/// # Errors
/// Numbers that JSON can't hold.
pub fn analysis_json<'a>(
    analysis: &Analysis,
    regions: impl Iterator<Item = (&'a str, Result<&'a Analysis, &'a RegionError>)> + Clone,
) -> Result<Value, serde_json::Error> {
    let mut results = serde_json::to_value(analysis)?;
    let mut findings = region_findings(analysis);
    for (name, analysis) in regions.clone() {
        let own = analysis.map(region_findings).unwrap_or_default();
        findings.extend(own.into_iter().map(|f| Finding { region: Some(name.to_owned()), ..f }));
    }
    results["findings"] = serde_json::to_value(findings)?;
    if regions.clone().next().is_some() {
        results["regions"] = regions_json(regions)?;
    }
    Ok(results)
}
