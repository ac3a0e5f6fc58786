//! `fluorspar scene convert`: a scene of pbrt as an experiment file.

use std::path::PathBuf;

use clap::ValueHint;
use fluorspar_experiment::parse;

use super::edit::write_texts;
use super::source::SceneArgs;
use crate::error::CliError;
use crate::message::Messages;

/// Options of `scene convert`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    scene: SceneArgs,
    /// File of the experiment, .toml; meshes, maps and spectra go to a folder beside it, NAME_files.
    #[arg(long, value_name = "NAME.toml", value_hint = ValueHint::FilePath)]
    out: PathBuf,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let Options { scene, out } = options;
    let source = scene.text(Some(out))?;
    if !source.is_converted() {
        return Err(CliError::Input(format!(
            "{}: this is an experiment already; `fluorspar scene set` writes it with changes",
            scene.name()
        )));
    }
    let messages = Messages::default();
    messages.warnings(&source.warnings);
    for lost in source.lost() {
        messages.status(format!("warning: lost in the experiment: {lost}"));
    }
    parse(&source.text, &out.display().to_string(), &source.base_dir, &[])?;
    let folder = source.write_companions()?;
    write_texts(&[("--out", out, source.text.clone())], &[])?;
    if let Some(folder) = folder {
        let place = folder.finish()?;
        messages.status(format!("Its meshes, maps and spectra are in {}", place.display()));
    }
    Ok(())
}
