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
    /// Experiment file; meshes, maps and spectra go to a folder beside it, NAME_files.
    #[arg(long, value_name = "NAME.toml", value_hint = ValueHint::FilePath)]
    out: PathBuf,
    /// Print no warnings and no list of the written files.
    #[arg(long, short)]
    quiet: bool,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let Options { scene, out, quiet } = options;
    let source = scene.text(Some(out))?;
    if !source.is_converted() {
        return Err(CliError::Input(format!(
            "{}: this is an experiment already; `fluorspar scene set` writes it with changes",
            scene.name()
        )));
    }
    let messages = Messages::unless(*quiet);
    messages.warnings(&source.warnings);
    for lost in source.lost() {
        messages.status(format!("warning: lost in the experiment: {lost}"));
    }
    parse(&source.text, &out.display().to_string(), &source.base_dir, &[])?;
    let folder = source.write_companions()?;
    write_texts(&[("--out", out, source.text.clone())], &[], *quiet)?;
    if let Some(folder) = folder {
        let place = folder.finish()?;
        messages.status(format!("Its meshes, maps and spectra are in {}", place.display()));
    }
    Ok(())
}
