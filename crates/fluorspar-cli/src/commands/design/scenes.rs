//! The scenes that a design problem renders, as experiments of their own: for several processes or machines to render one of them together.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use fluorspar_format::write_atomically;
use serde_json::json;

use super::ProblemArgs;
use super::renders::path_of;
use crate::args::Answer;
use crate::commands::{print_json, print_text};
use crate::error::CliError;

/// Options of `design scenes`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    #[command(flatten)]
    problem: ProblemArgs,
    #[command(flatten)]
    answer: Answer,
}

/// A scene as an experiment.
struct SceneFile {
    name: String,
    experiment: PathBuf,
    image: PathBuf,
}

/// Writes each scene as an experiment beside the place of its image, and tells how it is rendered there.
pub(super) fn run(options: &Options) -> Result<(), CliError> {
    let problem = options.problem.read()?;
    let mut scenes = Vec::new();
    if !problem.resolved.rendered.renders.is_empty() {
        fs::create_dir_all(&problem.renders)
            .map_err(|error| CliError::Input(format!("--renders {}: {error}", problem.renders.display())))?;
    }
    for render in &problem.resolved.rendered.renders {
        let image = path_of(&problem.renders, render);
        let experiment = image.with_extension("toml");
        write_atomically(&experiment, |file| {
            std::io::Write::write_all(file, render.record.resolved_toml.as_bytes())
        })?;
        scenes.push(SceneFile { name: render.name.clone(), experiment, image });
    }
    if scenes.is_empty() {
        return Err(CliError::Input(format!(
            "{}: the problem renders no scene: its regions are flat",
            problem.source.name
        )));
    }
    if options.answer.json {
        let scene = |scene: &SceneFile| json!({ "name": scene.name, "experiment": scene.experiment, "image": scene.image, "is_rendered": scene.image.exists() });
        return print_json(&json!({ "scenes": scenes.iter().map(scene).collect::<Vec<_>>() }));
    }
    let mut text = String::new();
    for scene in &scenes {
        let state = if scene.image.exists() { "rendered" } else { "missing" };
        let _ = writeln!(text, "{state}  {}  {}", scene.experiment.display(), scene.name);
    }
    if let Some(scene) = scenes.iter().find(|scene| !scene.image.exists()) {
        let (experiment, image) = (scene.experiment.display(), scene.image.display());
        let _ = write!(
            text,
            "\na part of the first that is missing: fluorspar render {experiment} --film 1.film --shard 1/2\n\
             all parts together: fluorspar merge 1.film 2.film --components --out {image}\n"
        );
    }
    print_text(&text)
}
