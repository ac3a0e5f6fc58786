//! `fluorspar presets`: what is built in.

use std::process::ExitCode;

use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;
use fluorspar_experiment::preset::{self, PresetKind};
use serde_json::json;

use super::table::ListOptions;
use crate::error::CliError;

/// Options of `presets`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Print the file of this experiment, flat sample or design problem instead.
    #[arg(value_name = "NAME")]
    name: Option<String>,
    #[command(flatten)]
    list: ListOptions,
}

/// Options of a command that prints a file of the catalogue.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct FileOptions {
    /// Its name in the catalogue.
    #[arg(value_name = "NAME")]
    name: String,
}

/// Kinds whose entries are files of the user's kind.
const FILES: [PresetKind; 3] = [PresetKind::Experiment, PresetKind::Sample, PresetKind::Design];

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    match &options.name {
        Some(name) => super::print_text(file_of(name, &FILES)?)?,
        None => list_of(&options.list, &PresetKind::ALL)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// Prints a file of one kind.
pub(crate) fn show(options: &FileOptions, kind: PresetKind) -> Result<(), CliError> {
    super::print_text(file_of(&options.name, &[kind])?)
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

/// The text of the experiment, flat sample or design problem of a name.
fn file_of(name: &str, kinds: &[PresetKind]) -> Result<&'static str, CliError> {
    let kind = kinds.iter().find(|kind| preset::names(**kind).contains(&name));
    match kind {
        Some(PresetKind::Experiment) => Ok(preset::experiment(name)?.text),
        Some(PresetKind::Sample) => Ok(preset::sample(name)?.text),
        Some(_) => Ok(preset::design(name)?.text),
        None => {
            let known: Vec<&str> = kinds.iter().flat_map(|kind| preset::names(*kind)).collect();
            Err(CliError::Input(format!(
                "there is no experiment, flat sample or design problem \"{}\"{} Known: {}",
                excerpt(name),
                did_you_mean(name, known.iter().copied()),
                known.join(", ")
            )))
        }
    }
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
        text += &format!("  {:<22} {}\n", entry.name, entry.title);
    }
    text
}
