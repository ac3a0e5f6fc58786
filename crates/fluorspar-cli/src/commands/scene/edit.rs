//! `fluorspar scene set`, `insert`, `delete`: a scene with changes, as a new file.

use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar_experiment::{SceneChange, edit_experiment, parse, parse_script, script_text};
use fluorspar_format::{Output, Outputs, WRITTEN_BY, write_atomically};

use super::source::{SceneArgs, SceneText};
use crate::error::CliError;
use crate::message::Messages;
use fluorspar_session::read_text;

/// Options of `scene set`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct SetOptions {
    #[command(flatten)]
    scene: SceneArgs,
    /// Paths and their new values, as after --set: `light.*.strength.power_mw=20`, `tooth_11/material=metal`.
    #[arg(value_name = "PATH=VALUE")]
    values: Vec<String>,
    /// Script of changes, which come first. May be repeated.
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    script: Vec<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
}

/// Options of `scene insert`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct InsertOptions {
    #[command(flatten)]
    scene: SceneArgs,
    /// Lists with the names of new entries, and the fields of those: `object.ball={ type = "sphere", ... }`.
    #[arg(value_name = "LIST.NAME=VALUE", required = true)]
    values: Vec<String>,
    #[command(flatten)]
    output: OutputArgs,
}

/// Options of `scene delete`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct DeleteOptions {
    #[command(flatten)]
    scene: SceneArgs,
    /// Paths to delete: entries or fields; wildcards are allowed.
    #[arg(value_name = "PATH", required = true)]
    paths: Vec<String>,
    #[command(flatten)]
    output: OutputArgs,
}

/// Where a changed scene goes.
#[derive(Clone, Debug, clap::Args)]
struct OutputArgs {
    /// File of the new scene, .toml; without it, the scene is printed.
    #[arg(long, value_name = "FILE.toml", value_hint = ValueHint::FilePath)]
    out: Option<PathBuf>,
    /// File for the changes as a script.
    #[arg(long, value_name = "FILE.toml", value_hint = ValueHint::FilePath)]
    record: Option<PathBuf>,
}

pub(crate) fn set(options: &SetOptions) -> Result<(), CliError> {
    let mut changes = Vec::new();
    for script in &options.script {
        changes.extend(parse_script(&read_text(script)?, &script.display().to_string())?);
    }
    for text in &options.values {
        changes.push(SceneChange::read_set(text)?);
    }
    if changes.is_empty() {
        return Err(CliError::Input("nothing is to be set; give PATH=VALUE or --script FILE".into()));
    }
    write(&options.scene, &changes, &options.script, &options.output)
}

pub(crate) fn insert(options: &InsertOptions) -> Result<(), CliError> {
    let changes: Result<Vec<SceneChange>, _> =
        options.values.iter().map(|text| SceneChange::read_insert(text)).collect();
    write(&options.scene, &changes?, &[], &options.output)
}

pub(crate) fn delete(options: &DeleteOptions) -> Result<(), CliError> {
    let delete = |path: &String| SceneChange::Delete { path: path.clone() };
    let changes: Vec<SceneChange> = options.paths.iter().map(delete).collect();
    write(&options.scene, &changes, &[], &options.output)
}

/// Applies changes and writes the scene, with its meshes where it comes from pbrt.
fn write(
    scene: &SceneArgs,
    changes: &[SceneChange],
    scripts: &[PathBuf],
    output: &OutputArgs,
) -> Result<(), CliError> {
    let OutputArgs { out, record } = output;
    let mut source = scene.text(out.as_deref())?;
    Messages::default().warnings(&source.warnings);
    let text = edit_experiment(&source.text, &source.name, &source.base_dir, changes)?;
    let text = with_mark(text, &source.name);
    let (Some(out), record) = (out, record) else {
        if let Some(record) = record {
            write_texts(&[("--record", record, script_text(changes))], scripts)?;
        }
        return crate::commands::print_text(text.trim_end());
    };
    source.text = text.clone();
    check_folder(&source, out)?;
    let mut texts = vec![("--out", out, text)];
    texts.extend(record.as_ref().map(|path| ("--record", path, script_text(changes))));
    let folder = source.write_companions()?;
    // A file that this program wrote may be edited in its place; those of others are refused.
    write_texts(&texts, scripts)?;
    folder.map_or(Ok(()), |folder| folder.finish().map(drop))?;
    Ok(())
}

/// A text that says who wrote it, so that it may be written again.
fn with_mark(text: String, name: &str) -> String {
    if text.contains(WRITTEN_BY) {
        return text;
    }
    let shown = name.replace(char::is_control, " ");
    format!("# {shown} with changes, {WRITTEN_BY} scene\n{text}")
}

/// Writes texts, all or none of them.
pub(super) fn write_texts(texts: &[(&str, &PathBuf, String)], reading: &[PathBuf]) -> Result<(), CliError> {
    for (option, path, _) in texts {
        if !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
            let path = path.display();
            return Err(CliError::Input(format!("{option} {path}: the name must end in .toml")));
        }
    }
    let outputs = texts
        .iter()
        .fold(Outputs::new(), |outputs, (option, path, _)| outputs.and(Output::file(option, path)));
    let set = outputs.reading(reading).declare()?;
    for (_, path, text) in texts {
        write_atomically(path, |writer| std::io::Write::write_all(writer, text.as_bytes()))?;
    }
    set.finish()?;
    let names: Vec<String> = texts.iter().map(|(_, path, _)| path.display().to_string()).collect();
    Messages::default().status(format!("Wrote {}", names.join(" and ")));
    Ok(())
}

/// Refuses a place from where the files that the scene names are not found.
fn check_folder(source: &SceneText, out: &Path) -> Result<(), CliError> {
    if source.is_converted() {
        return Ok(());
    }
    let folder = out.parent().filter(|path| !path.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let here = parse(&source.text, &source.name, &source.base_dir, &[])?;
    let there = parse(&source.text, &source.name, folder, &[]);
    if there.is_ok_and(|there| there.file == here.file) {
        return Ok(());
    }
    Err(CliError::Input(format!(
        "--out {}: {} names files by paths that start at its folder; write the new file into that folder as well, for instance {}",
        out.display(),
        source.name,
        source.base_dir.join(out.file_name().unwrap_or_default()).display()
    )))
}
