//! What is built in, by name, and the files of experiments, flat samples and design problems.

use fluorspar_experiment::preset::{self, PresetKind};
use serde_json::json;

use super::table::ListOptions;
use crate::error::CliError;

/// Options of a command that prints a file of the catalogue.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct FileOptions {
    /// Its name in the catalogue.
    #[arg(value_name = "NAME")]
    name: String,
}

/// Prints the file of an experiment, a flat sample or a design problem.
pub(crate) fn show(options: &FileOptions, kind: PresetKind) -> Result<(), CliError> {
    super::print_text(preset::text(kind, &options.name)?)
}

/// Lists kinds of parts by name.
pub(crate) fn list_of(options: &ListOptions, kinds: &[PresetKind]) -> Result<(), CliError> {
    let mut entries = Vec::new();
    for kind in kinds {
        entries.extend(preset::list(*kind)?);
    }
    if !options.is_json() {
        return super::print_text(&by_kind(&entries));
    }
    let list: Vec<_> = entries
        .iter()
        .map(|e| {
            json!({ "kind": e.kind.to_string(), "name": e.name, "title": e.title, "description": e.description, "source": e.source })
        })
        .collect();
    super::print_json(&list)
}

/// The entries under headings of their kinds.
fn by_kind(entries: &[preset::PresetSummary]) -> String {
    let mut text = String::new();
    let mut last = None;
    for entry in entries {
        if last != Some(entry.kind) {
            text += &format!("{}{}\n", if last.is_some() { "\n" } else { "" }, entry.kind);
            last = Some(entry.kind);
        }
        text += &format!("  {:<26} {}\n", entry.name, entry.title);
    }
    text
}
