//! One file per command.

pub(crate) mod analyze;
pub(crate) mod capture;
pub(crate) mod check;
pub(crate) mod completions;
pub(crate) mod denoise;
pub(crate) mod fluorophore;
pub(crate) mod image_output;
pub(crate) mod merge;
pub(crate) mod mouth;
pub(crate) mod out_folder;
pub(crate) mod predict;
pub(crate) mod presets;
pub(crate) mod render;
pub(crate) mod run;
pub(crate) mod safety;
pub(crate) mod schema;
pub(crate) mod spectroradiometer;
pub(crate) mod table;

use std::io::Write;
use std::path::Path;

use serde::Serialize;

use crate::error::CliError;

/// Prints a value as JSON on standard output.
pub(crate) fn print_json(value: &impl Serialize) -> Result<(), CliError> {
    let text = serde_json::to_string_pretty(value)?;
    print_text(&text)
}

/// Prints lines on standard output.
pub(crate) fn print_text(text: &str) -> Result<(), CliError> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{}", text.trim_end())?;
    Ok(())
}

/// A text as TOML.
pub(crate) fn quoted(text: &str) -> String {
    toml::Value::String(text.into()).to_string()
}

/// Refuses a file whose folder does not exist.
pub(crate) fn check_parent(path: &Path) -> Result<(), CliError> {
    match path.parent().filter(|p| !p.as_os_str().is_empty()) {
        Some(parent) if !parent.is_dir() => Err(CliError::Input(format!(
            "{}: the folder {} does not exist; make it first",
            path.display(),
            parent.display()
        ))),
        _ => Ok(()),
    }
}
