//! `fluorspar scene get`: the values at paths.

use fluorspar_experiment::scene_values;
use fluorspar_session::Changes;

use super::source::SceneArgs;
use crate::error::CliError;

/// Options of `scene get`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    changes: Changes,
    /// Paths, also with wildcards and by part: `light.blue.strength`, `tooth_*/material.reflectance`.
    #[arg(value_name = "PATH", required = true)]
    paths: Vec<String>,
    /// Print the answer as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let scene = options.scene.read(&options.changes.overrides())?;
    let mut values = Vec::new();
    for path in &options.paths {
        values.extend(scene_values(&scene, path)?);
    }
    if options.json {
        return crate::commands::print_json(&values);
    }
    let lines: Vec<String> = values.iter().map(|value| format!("{} = {}", value.path, value.value)).collect();
    crate::commands::print_text(&lines.join("\n"))
}
