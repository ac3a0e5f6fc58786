//! `fluorspar new`: a commented file to start from.

use clap::ValueHint;
use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;
use fluorspar_format::{Output, Outputs, write_atomically};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::table::ListOptions;
use crate::error::CliError;
use crate::message::Messages;

/// Options of `new`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Template; without one, the templates are listed.
    #[arg(value_name = "TEMPLATE")]
    template: Option<String>,
    /// File to write, .toml, or `-` for standard output; it must not exist [default: TEMPLATE.toml].
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: Option<PathBuf>,
    #[command(flatten)]
    list: ListOptions,
}

/// A file to start from.
struct Template {
    name: &'static str,
    /// What it is, for people.
    about: &'static str,
    /// The command that takes it.
    command: &'static str,
    text: &'static str,
}

macro_rules! template {
    ($name:literal, $command:literal, $about:literal) => {
        Template {
            name: $name,
            about: $about,
            command: $command,
            text: include_str!(concat!("../../templates/", $name, ".toml")),
        }
    };
}

const TEMPLATES: [Template; 7] = [
    template!("mouth", "run", "a mouth under white light and a 405 nm LED, with a lesion"),
    template!("leaf", "run", "two leaf discs under a UV lamp: the red glow of chlorophyll"),
    template!("cuvette", "run", "a cuvette of fluorescein beside one of water"),
    template!("painting", "run", "a varnished painting under a UV lamp: a retouching stays dark"),
    template!("flat-sample", "predict", "an evenly lit sample in numbers, without geometry"),
    template!("own-camera", "run", "a camera from its data sheet, in front of a flat patch"),
    template!("calibration", "calibrate", "a camera from its own dark, flat and target frames"),
];

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let Some(name) = &options.template else {
        list(&options.list)?;
        return Ok(());
    };
    let Some(template) = TEMPLATES.iter().find(|template| template.name == name) else {
        let known = TEMPLATES.map(|template| template.name);
        return Err(CliError::Input(format!(
            "there is no template \"{}\"{} Known: {}",
            excerpt(name),
            did_you_mean(name, known),
            known.join(", ")
        )));
    };
    let file = options.file.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.toml")));
    if file.as_os_str() == "-" {
        return super::print_text(template.text);
    }
    write(template, &file)?;
    let shown = file.display();
    let messages = Messages::default();
    messages.status(format!("Wrote {shown}: {}", template.about));
    let check =
        if template.command == "calibrate" { String::new() } else { format!("fluorspar check {shown}; ") };
    messages.status(format!("Next: {check}fluorspar {} {shown}", template.command));
    Ok(())
}

fn list(options: &ListOptions) -> Result<(), CliError> {
    let entries: Vec<_> = TEMPLATES
        .iter()
        .map(
            |template| json!({ "name": template.name, "about": template.about, "command": template.command }),
        )
        .collect();
    let row =
        |template: &Template| vec![template.name.into(), template.command.into(), template.about.into()];
    options.print(&entries, &["template", "for", "what"], TEMPLATES.iter().map(row).collect(), &[1, 2])
}

/// Writes a template to a file that does not exist yet.
fn write(template: &Template, file: &Path) -> Result<(), CliError> {
    let shown = file.display();
    if !file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
        return Err(CliError::Input(format!(
            "{shown}: the name must end in .toml, or be - for standard output"
        )));
    }
    // A link that leads nowhere is something of the user's, too.
    if file.symlink_metadata().is_ok() {
        return Err(CliError::Input(format!(
            "{shown}: this exists already and is kept; choose another name: fluorspar new {} OTHER.toml",
            template.name
        )));
    }
    let set = Outputs::new().and(Output::file("FILE", file)).declare()?;
    write_atomically(file, |writer| writer.write_all(template.text.as_bytes()))?;
    Ok(set.finish()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn templates_are_named_as_their_files() {
        for template in &TEMPLATES {
            assert!(
                template.text.starts_with("# ") && template.text.contains("\nformat = 1\n"),
                "{}",
                template.name
            );
            assert!(
                template.text.contains(&format!("fluorspar {} FILE", template.command)),
                "{}",
                template.name
            );
        }
    }
}
