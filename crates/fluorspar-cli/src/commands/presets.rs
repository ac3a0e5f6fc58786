//! `fluorspar presets`: what is built in.

use std::process::ExitCode;

use fluorspar_experiment::preset::{self, PresetKind};
use serde_json::json;

use crate::error::CliError;

/// Options of `presets`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Print this experiment's file instead, as a template.
    #[arg(long, value_name = "NAME")]
    experiment: Option<String>,
    /// Print this flat sample's file instead, as a template.
    #[arg(long, value_name = "NAME", conflicts_with = "experiment")]
    sample: Option<String>,
    /// Print this design problem's file instead, as a template.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["experiment", "sample"])]
    design: Option<String>,
    /// Print the list as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    if let Some(name) = &options.experiment {
        super::print_text(preset::experiment(name)?.text)?;
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(name) = &options.sample {
        super::print_text(preset::sample(name)?.text)?;
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(name) = &options.design {
        super::print_text(preset::design(name)?.text)?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut entries = Vec::new();
    for kind in PresetKind::ALL {
        entries.extend(preset::list(kind)?);
    }
    if options.json {
        let list: Vec<_> = entries
            .iter()
            .map(|e| {
                json!({ "kind": e.kind.to_string(), "name": e.name, "title": e.title, "description": e.description, "source": e.source })
            })
            .collect();
        super::print_json(&list)?;
        return Ok(ExitCode::SUCCESS);
    }
    super::print_text(&by_kind(&entries))?;
    Ok(ExitCode::SUCCESS)
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
