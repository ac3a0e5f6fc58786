//! `fluorspar scene check`: whether a scene can be rendered.

use super::source::SceneArgs;
use crate::error::CliError;
use crate::message::Messages;

/// Options of `scene check`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    scene: SceneArgs,
    /// Print nothing: only the exit code tells the result.
    #[arg(long, short)]
    quiet: bool,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let (study, warnings) = options.scene.study()?;
    let messages = if options.quiet { Messages::Quiet } else { Messages::Full };
    messages.warnings(&warnings);
    if options.quiet {
        return Ok(());
    }
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
