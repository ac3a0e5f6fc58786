//! Scenes: experiment files, built-in experiments, reports, and scenes of pbrt, which are taken as experiments.

use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::scene::Scene;
use fluorspar::study::Study;
use fluorspar_experiment::{Experiment, Warning, parse, resolve_shapes, resolve_unlit};
use fluorspar_format::OutputFolder;
use fluorspar_pbrt::{ConvertedScene, to_experiment};
use fluorspar_session::ExperimentSource;

use crate::commands::pbrt_scene::{PbrtArgs, changed_study};
use crate::error::CliError;
use crate::values::{Override, as_typed, sets};

/// A scene.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct SceneArgs {
    /// Experiment file (.toml), a report.html of an earlier run, the name of a built-in experiment, or a scene of pbrt (.pbrt).
    #[arg(value_name = "SCENE", value_hint = ValueHint::FilePath)]
    scene: String,
    #[command(flatten)]
    pbrt: PbrtArgs,
}

/// A scene as the text of an experiment file.
pub(super) struct SceneText {
    /// How messages call it.
    pub(super) name: String,
    pub(super) text: String,
    /// Where its relative paths start.
    pub(super) base_dir: PathBuf,
    /// What it was converted from pbrt with, and the folder for the files that it names.
    converted: Option<(ConvertedScene, PathBuf)>,
    pub(super) warnings: Vec<Warning>,
}

impl SceneArgs {
    /// How messages call it.
    pub(super) fn name(&self) -> &str {
        &self.scene
    }

    fn source(&self) -> Result<ExperimentSource, CliError> {
        let source = ExperimentSource::find(Some(&self.scene))?;
        if source.pbrt_scene().is_none() {
            self.pbrt.check_none(&source.name)?;
        }
        Ok(source)
    }

    /// The scene as text; one of pbrt as the experiment that would stand at `out`.
    pub(super) fn text(&self, out: Option<&Path>) -> Result<SceneText, CliError> {
        let source = self.source()?;
        let Some(path) = source.pbrt_scene() else {
            let ExperimentSource { name, text, base_dir, .. } = source;
            return Ok(SceneText { name, text, base_dir, converted: None, warnings: Vec::new() });
        };
        let (loaded, warnings) = self.pbrt.load(path)?;
        let place = out.map_or_else(|| path.with_extension("toml"), Path::to_path_buf);
        let stem = place.file_stem().unwrap_or_default().to_string_lossy();
        let folder = format!("{stem}_files");
        let converted = to_experiment(&loaded, &source.stem, &folder)
            .map_err(|message| CliError::Input(format!("{}: {message}", self.scene)))?;
        let base_dir = place.parent().unwrap_or(Path::new("")).to_path_buf();
        let base_dir = if base_dir.as_os_str().is_empty() { PathBuf::from(".") } else { base_dir };
        let text = converted.text.clone();
        let folder = base_dir.join(folder);
        Ok(SceneText { name: source.name, text, base_dir, converted: Some((converted, folder)), warnings })
    }

    /// The scene as a parsed experiment with changes.
    pub(super) fn read(&self, changes: &[Override]) -> Result<Experiment, CliError> {
        let SceneText { name, text, base_dir, .. } = self.text(None)?;
        Ok(parse(&text, &name, &base_dir, &sets(changes)).map_err(|error| as_typed(error, changes))?)
    }

    /// The shapes of the scene with changes, and its camera; materials are gray.
    pub(super) fn shapes(&self, changes: &[Override]) -> Result<Scene, CliError> {
        let source = self.source()?;
        if let (Some(path), []) = (source.pbrt_scene(), changes) {
            return Ok(self.pbrt.load(path)?.0.study.scene);
        }
        if let Some(path) = source.pbrt_scene() {
            return Ok(changed_study(&self.pbrt.load(path)?.0, &source, changes)?.scene);
        }
        let parsed = source.parse(changes)?;
        Ok(resolve_shapes(&parsed).map_err(|error| as_typed(error, changes))?)
    }

    /// The scene itself, checked, with its warnings.
    pub(super) fn study(&self) -> Result<(Study, Vec<Warning>), CliError> {
        let source = self.source()?;
        if let Some(path) = source.pbrt_scene() {
            let (loaded, warnings) = self.pbrt.load(path)?;
            return Ok((loaded.study, warnings));
        }
        let resolved = resolve_unlit(&source.parse(&[])?)?;
        Ok((resolved.study, resolved.record.warnings))
    }
}

impl SceneText {
    /// Whether it comes from a scene of pbrt.
    pub(super) fn is_converted(&self) -> bool {
        self.converted.is_some()
    }

    /// What a converted scene does not hold.
    pub(super) fn lost(&self) -> &[String] {
        self.converted.as_ref().map_or(&[], |(converted, _)| &converted.lost)
    }

    /// The folder of the files that a converted scene names, complete but not in its place yet.
    pub(super) fn write_companions(&self) -> Result<Option<OutputFolder>, CliError> {
        let Some((converted, place)) = self.converted.as_ref().filter(|(c, _)| c.files().next().is_some())
        else {
            return Ok(None);
        };
        let folder = OutputFolder::prepare(place, &[], 0)?;
        converted.write_files(folder.path()).map_err(|error| folder.at_its_place(error))?;
        Ok(Some(folder))
    }
}
