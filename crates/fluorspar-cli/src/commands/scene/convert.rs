//! `fluorspar scene convert`: a scene in the form of another program.

use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::study::Study;
use fluorspar_experiment::parse;
use fluorspar_format::{NamedMesh, Output, OutputFolder, Outputs, write_atomically, write_gltf_scene};
use fluorspar_pbrt::{ConvertedScene, DrawnPart, DrawnScene, to_gltf, to_pbrt};

use super::edit::write_texts;
use super::source::SceneArgs;
use crate::commands::light_of_capture::{CaptureLight, CaptureOption};
use crate::error::CliError;
use crate::message::Messages;

/// Options of `scene convert`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    scene: SceneArgs,
    /// File, whose name tells the form: .toml, the experiment of a scene of pbrt; .pbrt, version 4, or pbrt-v3-spectral where something
    /// fluoresces; .glb (glTF). Meshes, maps and spectra of the first two go to a folder beside it, NAME_files.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    out: PathBuf,
    #[command(flatten)]
    light: CaptureOption,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let ending = options.out.extension().unwrap_or_default().to_ascii_lowercase();
    match ending.to_str() {
        Some("pbrt") => to_scene_of_pbrt(options),
        Some("glb") => to_drawing(options),
        _ => to_experiment(options),
    }
}

fn to_experiment(Options { scene, out, light }: &Options) -> Result<(), CliError> {
    let source = scene.text(Some(out))?;
    if !source.is_converted() {
        return Err(CliError::Input(format!(
            "{}: this is an experiment already; `fluorspar scene set` writes it with changes, and an --out that ends in .pbrt or .glb in \
             the form of other programs",
            scene.name()
        )));
    }
    light.check_none("an experiment keeps all lights")?;
    let messages = Messages::default();
    messages.warnings(&source.warnings);
    say_lost(source.lost(), "experiment");
    parse(&source.text, &out.display().to_string(), &source.base_dir, &[])?;
    let folder = source.write_companions()?;
    write_texts(&[("--out", out, source.text.clone())], &[])?;
    finish(folder)
}

/// Puts the folder of the files that a scene names into its place.
fn finish(folder: Option<OutputFolder>) -> Result<(), CliError> {
    if let Some(folder) = folder {
        let place = folder.finish()?;
        Messages::default().status(format!("Its meshes, maps and spectra are in {}", place.display()));
    }
    Ok(())
}

fn say_lost(lost: &[String], form: &str) {
    lost.iter().for_each(|what| Messages::default().status(format!("warning: lost in the {form}: {what}")));
}

fn to_scene_of_pbrt(Options { scene, out, light }: &Options) -> Result<(), CliError> {
    let read = [PathBuf::from(scene.name())];
    let set = Outputs::new().and(Output::file("--out", out)).reading(&read).declare()?;
    // Apart from the files that an experiment of the same name reads
    let folder = format!("{}_pbrt", out.file_stem().unwrap_or_default().to_string_lossy());
    let files = OutputFolder::prepare(&out.parent().unwrap_or(Path::new("")).join(&folder), &read, 0)?;
    let (study, light) = lit_study(scene, light)?;
    let drive = |group: &str| light.drive(group);
    let converted: ConvertedScene = to_pbrt(&study.scene, &study.render, &drive, scene.name(), &folder);
    say_lost(&converted.lost, "scene of pbrt");
    converted.write_files(files.path()).map_err(|error| files.at_its_place(error))?;
    write_atomically(out, |file| std::io::Write::write_all(file, converted.text.as_bytes()))?;
    set.finish()?;
    Messages::default().status(format!("Wrote {}", out.display()));
    finish(Some(files))
}

/// A scene, and the light that is on in it.
fn lit_study(scene: &SceneArgs, light: &CaptureOption) -> Result<(Study, CaptureLight), CliError> {
    let (study, warnings) = scene.study()?;
    let light = light.of_study(&study)?;
    Messages::default().warnings(&warnings);
    light.say(Messages::default(), "");
    Ok((study, light))
}

fn to_drawing(Options { scene, out, light }: &Options) -> Result<(), CliError> {
    let read = [PathBuf::from(scene.name())];
    let set = Outputs::new().and(Output::file("--out", out)).reading(&read).declare()?;
    let (study, light) = lit_study(scene, light)?;
    let DrawnScene { parts, camera, lights, lost } = to_gltf(&study.scene, &|group| light.drive(group));
    say_lost(&lost, "glTF file");
    let meshes: Vec<NamedMesh<'_>> = parts.iter().map(named_mesh).collect();
    write_gltf_scene(out, &meshes, camera.as_ref(), &lights)?;
    set.finish()?;
    let (count, lights) = (meshes.len(), lights.len());
    Messages::default().status(format!("Wrote {}: {count} meshes, {lights} lights", out.display()));
    Ok(())
}

fn named_mesh(part: &DrawnPart) -> NamedMesh<'_> {
    NamedMesh { name: &part.name, material: &part.material, color: part.color, mesh: &part.mesh }
}
