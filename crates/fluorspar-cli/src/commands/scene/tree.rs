//! `fluorspar scene tree`: what has a name.

use fluorspar_experiment::scene_nodes;
use fluorspar_session::Changes;

use super::source::SceneArgs;
use crate::commands::table::align;
use crate::error::CliError;

/// Options of `scene tree`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    changes: Changes,
    /// Print the answer as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let scene = options.scene.read(&options.changes.overrides())?;
    let nodes = scene_nodes(&scene)?;
    if options.json {
        return crate::commands::print_json(&nodes);
    }
    let rows: Vec<Vec<String>> =
        nodes.into_iter().map(|node| vec![node.path, node.kind, node.summary]).collect();
    crate::commands::print_text(&align(&rows, &[1, 2]))
}
