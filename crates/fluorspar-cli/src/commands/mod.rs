//! One file per command.

pub(crate) mod analyze;
pub(crate) mod capture;
pub(crate) mod check;
pub(crate) mod completions;
pub(crate) mod out_folder;
pub(crate) mod presets;
pub(crate) mod render;
pub(crate) mod run;
pub(crate) mod schema;

use std::io::Write;

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
