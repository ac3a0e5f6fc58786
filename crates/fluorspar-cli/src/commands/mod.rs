//! One file or folder per command, and what several of them share.

mod actions;
pub(crate) mod analyze;
mod basis_render;
pub(crate) mod capture;
pub(crate) mod capture_light;
pub(crate) mod catalog;
pub(crate) mod check;
pub(crate) mod compare;
pub(crate) mod completions;
pub(crate) mod denoise;
pub(crate) mod describe;
pub(crate) mod design;
pub(crate) mod filter;
pub(crate) mod fluorophore;
mod frame_report;
pub(crate) mod image_output;
pub(crate) mod lens;
pub(crate) mod merge;
pub(crate) mod mouth;
pub(crate) mod new;
pub(crate) mod pbrt_scene;
pub(crate) mod plot;
pub(crate) mod predict;
pub(crate) mod presets;
mod region_option;
pub(crate) mod render;
mod rendered_image;
pub(crate) mod row_bands;
pub(crate) mod run;
pub(crate) mod safety;
pub(crate) mod scene;
pub(crate) mod schema;
pub(crate) mod sensor;
pub(crate) mod sheet;
pub(crate) mod spectra;
pub(crate) mod spectroradiometer;
pub(crate) mod table;
pub(crate) mod tissue;
pub(crate) mod validate;

use std::path::{Path, PathBuf};

pub(crate) use fluorspar::quote::shell_word;
use fluorspar::render::memory_bytes;
use fluorspar::study::Study;
use fluorspar::units::{memory_gib, memory_texts};
use fluorspar_report::Figure;
use serde::Serialize;

use crate::error::CliError;
use crate::message;

/// Prints a value as JSON on standard output.
pub(crate) fn print_json(value: &impl Serialize) -> Result<(), CliError> {
    let text = serde_json::to_string_pretty(value)?;
    print_text(&text)
}

/// Prints lines on standard output.
pub(crate) fn print_text(text: &str) -> Result<(), CliError> {
    Ok(message::answer(text)?)
}

/// A text as TOML.
pub(crate) fn quoted(text: &str) -> String {
    toml::Value::String(text.into()).to_string()
}

/// How a figure is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FigureFormat {
    Svg,
    Png,
}

impl FigureFormat {
    /// By the ending of the file's name.
    pub(crate) fn of(path: &Path) -> Result<Self, CliError> {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        match ending.as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(CliError::Input(format!("--out {}: the name must end in .svg or .png", path.display()))),
        }
    }

    pub(crate) fn bytes(self, figure: &Figure) -> Result<Vec<u8>, CliError> {
        Ok(match self {
            Self::Svg => figure.to_svg().into_bytes(),
            Self::Png => figure.to_png()?,
        })
    }
}

/// Refuses images that don't fit into the memory limit. `instead` is what could be done with them.
pub(crate) fn check_memory(study: &Study, instead: &str) -> Result<(), CliError> {
    let (scene, settings) = (&study.scene, &study.render);
    let (needed, limit) = (memory_bytes(scene, settings), settings.memory_limit_bytes);
    // One with an excitation basis is rendered in bands of rows anyway
    if needed <= limit || settings.excitation_basis.is_some() {
        return Ok(());
    }
    let [needed_text, limit] = memory_texts(needed, limit);
    let (width, height, bands) = (scene.camera.width, scene.camera.height, scene.grid.len());
    Err(CliError::Input(format!(
        "the images of {width} x {height} pixels and {bands} bands need {needed_text}, more than the limit of {limit}; render \
         fewer pixels, bands, light groups or fluorophores, raise render.memory_limit_gib to {} or more, {instead}",
        memory_gib(needed)
    )))
}

/// The same file name with a suffix before its ending.
pub(crate) fn beside(path: &Path, suffix: &str) -> PathBuf {
    let part =
        |part: Option<&std::ffi::OsStr>| part.map(|p| p.to_string_lossy().into_owned()).unwrap_or_default();
    path.with_file_name(format!("{}{suffix}.{}", part(path.file_stem()), part(path.extension())))
}

/// Refuses a mask that is painted on an image before there is one.
pub(crate) fn check_nothing_painted(study: &Study) -> Result<(), CliError> {
    let painted = study.concentrations.iter().find(|change| change.painted.is_some());
    match painted {
        None => Ok(()),
        Some(change) => Err(CliError::Input(format!(
            "concentration.{}: a mask is painted on a finished render: give it to `capture` and `analyze`. For a new render give \
             the material a map, concentrations.{} = {{ image = ... }}, or the mouth a lesion",
            change.fluorophore, change.fluorophore
        ))),
    }
}
