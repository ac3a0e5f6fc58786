//! `fluorspar render`: spectral radiance only.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueHint;
use fluorspar::format::{
    ExrCompression, ExrOptions, Provenance, write_component_exr, write_component_npy, write_rgb_png,
    write_spectral_exr, write_spectral_npy,
};
use fluorspar::pipeline::radiance_preview;
use serde_json::json;

use super::check_parent;
use crate::args::{ExperimentArgs, Talk};
use crate::error::CliError;
use crate::experiment_source::ExperimentSource;
use crate::progress::{interrupted, render_with_progress};

/// Options of `render`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    experiment: ExperimentArgs,
    /// Image file: .exr (spectral OpenEXR) or .npy (NumPy, with a .json beside it).
    #[arg(long, value_name = "FILE", default_value = "radiance.exr", value_hint = ValueHint::FilePath)]
    out: PathBuf,
    /// Keep light groups and fluorophores apart, one layer each, instead of their sum.
    #[arg(long)]
    components: bool,
    /// Also write a PNG as the eye would see the sum.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    preview: Option<PathBuf>,
    #[command(flatten)]
    talk: Talk,
}

enum ImageFormat {
    Exr,
    Npy,
}

fn image_format(path: &Path) -> Result<ImageFormat, CliError> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("exr") => Ok(ImageFormat::Exr),
        Some("npy") => Ok(ImageFormat::Npy),
        _ => Err(CliError::Input(format!(
            "--out {}: the name must end in .exr or .npy, which keep every band; for a picture add --preview FILE.png",
            path.display()
        ))),
    }
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    let format = image_format(&options.out)?;
    check_parent(&options.out)?;
    if let Some(path) = &options.preview {
        check_parent(path)?;
        if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
            return Err(CliError::Input(format!("--preview {}: the name must end in .png", path.display())));
        }
    }
    let source = ExperimentSource::find(options.experiment.experiment.as_deref())?;
    let experiment = source.resolve(&options.experiment.overrides(), options.talk.quiet)?;
    let components = render_with_progress(
        &experiment.scene,
        &experiment.render,
        experiment.time_limit_s,
        options.talk.quiet,
    )?;
    let provenance = Provenance::new(
        &source.text,
        experiment.resolved_toml.clone(),
        experiment.render.seed,
        components.samples_per_pixel,
    );
    let sum = components.recombine(|_| 1.0);
    let exr = ExrOptions { compression: ExrCompression::Zip, preview: None, provenance: Some(&provenance) };
    match (format, options.components) {
        (ImageFormat::Exr, true) => write_component_exr(&options.out, &components, &exr)?,
        (ImageFormat::Exr, false) => write_spectral_exr(&options.out, &sum, &exr)?,
        (ImageFormat::Npy, true) => write_component_npy(&options.out, &components, Some(&provenance))?,
        (ImageFormat::Npy, false) => write_spectral_npy(&options.out, &sum, Some(&provenance))?,
    }
    if let Some(path) = &options.preview {
        let picture = radiance_preview(&sum);
        write_rgb_png(path, picture.width, picture.height, &picture.rgb)?;
    }
    if options.talk.json {
        let mean = sum.mean_spectrum();
        super::print_json(&json!({
            "file": options.out,
            "width_px": components.width,
            "height_px": components.height,
            "samples_per_pixel": components.samples_per_pixel,
            "wavelength_nm": components.grid.centers_nm(),
            "components": components.components.iter().map(|c| c.label()).collect::<Vec<_>>(),
            "mean_radiance": mean.values(),
            "unit": "W/(sr m^2 nm)",
            "experiment_sha256": experiment.sha256,
        }))?;
    } else if !options.talk.quiet {
        eprintln!("Wrote {}", options.out.display());
    }
    let stopped = interrupted() && components.samples_per_pixel < experiment.render.samples_per_pixel;
    Ok(if stopped && experiment.time_limit_s.is_none() { ExitCode::from(1) } else { ExitCode::SUCCESS })
}
