//! `fluorspar scene check`: whether a scene can be rendered.

use super::source::SceneArgs;
use crate::error::CliError;
use crate::message::Messages;

/// Options of `scene check`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    scene: SceneArgs,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let (study, warnings) = options.scene.study()?;
    Messages::in_full().warnings(&warnings);
    let scene = &study.scene;
    crate::commands::print_text(&format!(
        "{}: valid. {} objects, {} materials, {} lights, {} fluorophores",
        options.scene.name(),
        scene.objects.len(),
        scene.materials.len(),
        scene.lights.len() + scene.objects.iter().filter(|object| object.emission.is_some()).count(),
        scene.fluorophores.len()
    ))
}
