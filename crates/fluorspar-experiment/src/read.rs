//! From text to typed sections.

use fluorspar::quote::excerpt_to;
use std::any::TypeId;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_path_to_error::Segment;

use super::error::{ExperimentError, Step, steps};
use super::schema::{ExperimentFile, FormatVersion};
use crate::change::scene_change::{SceneChange, apply_change, apply_unset};
use crate::document::fit::{check, complete};
use crate::document::format_version::check_format;
use crate::document::merge::merge;
use crate::document::shape::Schema;
use crate::document::tree::{Content, Document, MAX_TEXT_BYTES, Node, TextSource, read_tree};
use crate::mouth_view::{change_person, change_view, person_of, spell_out_view, view_of};
use crate::preset::{self, PresetKind};
use fluorspar_format::{FileFormat, read_text_bounded};

/// Longest chain of base experiments.
const MAX_BASES: usize = 8;

/// An experiment as written: its sections, and where each value came from.
#[derive(Clone, Debug, PartialEq)]
pub struct Experiment {
    /// The sections, merged with their base and overridden.
    pub file: ExperimentFile,
    pub(super) document: Document,
}

/// Reads an experiment: text, base experiments, then overrides such as `light.blue.strength.power_mw=20`,
/// `unset analysis` or `insert analysis.region.lip={ parts = ["lower_lip"] }`.
///
/// `source_name` is how messages call the text. Relative paths in the text and in the name of a base file start at `base_dir`, those in
/// overrides at the working folder, where they are typed.
///
/// # Errors
/// The first defect found.
pub fn parse(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    overrides: &[String],
) -> Result<Experiment, ExperimentError> {
    let schema = experiment_schema();
    let mut document = read_document(schema, text, source_name, base_dir, overrides)?;
    let sets = |key: &str| overrides.iter().any(|text| text.split(['.', '=', '[']).next() == Some(key));
    let harmless = ["title", "description", "output", "render"];
    if overrides
        .iter()
        .any(|text| !harmless.contains(&text.split(['.', '=', '[']).next().unwrap_or_default()))
    {
        keep_to_what_holds(&mut document.root, sets);
    }
    let file: ExperimentFile = typed(&mut document, schema)?;
    Ok(Experiment { file, document })
}

/// [`parse`] with any changes instead of overrides: also entries that are inserted and deleted.
///
/// # Errors
/// The first defect found.
pub fn parse_changed(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    changes: &[SceneChange],
) -> Result<Experiment, ExperimentError> {
    let schema = experiment_schema();
    let mut document = read_merged(schema, text, source_name, base_dir)?;
    change_document(&mut document, schema, changes, base_dir)?;
    finish_document(&mut document, schema)?;
    let file: ExperimentFile = typed(&mut document, schema)?;
    Ok(Experiment { file, document })
}

/// The shapes of a kind of file, by the type of its sections; made once.
pub(crate) fn schema_of<T: JsonSchema + 'static>() -> &'static Schema {
    static SCHEMAS: Mutex<BTreeMap<TypeId, &'static Schema>> = Mutex::new(BTreeMap::new());
    let mut schemas = SCHEMAS.lock().unwrap_or_else(PoisonError::into_inner);
    schemas.entry(TypeId::of::<T>()).or_insert_with(|| Box::leak(Box::new(Schema::of::<T>())))
}

/// The shapes of an experiment file.
pub(super) fn experiment_schema() -> &'static Schema {
    schema_of::<ExperimentFile>()
}

/// Reads a file of the kind of its sections' type: its tree, and the sections. Overrides and paths are as for an experiment.
pub(crate) fn read_sections<T: DeserializeOwned + JsonSchema + 'static>(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    overrides: &[String],
) -> Result<(Document, T), ExperimentError> {
    let schema = schema_of::<T>();
    let mut document = read_document(schema, text, source_name, base_dir, overrides)?;
    let sections = typed(&mut document, schema)?;
    Ok((document, sections))
}

/// Text, bases, overrides and sensor preset as one tree.
pub(super) fn read_document(
    schema: &Schema,
    text: &str,
    source_name: &str,
    base_dir: &Path,
    overrides: &[String],
) -> Result<Document, ExperimentError> {
    let changes = overrides.iter().map(|text| SceneChange::read(text)).collect::<Result<Vec<_>, _>>();
    let mut document = read_merged(schema, text, source_name, base_dir)?;
    change_document(&mut document, schema, &changes?, Path::new("."))?;
    finish_document(&mut document, schema)?;
    Ok(document)
}

/// Mark of a title that was written for another experiment.
const CHANGED: &str = ", changed";

/// What was written of an experiment need not hold for what is put on top of it: its description goes, and its title says that it
/// was changed, unless they are written anew.
fn keep_to_what_holds(root: &mut Node, is_anew: impl Fn(&str) -> bool) {
    if !is_anew("description") {
        root.take("description");
    }
    if let (Some(node), false) = (root.get_mut("title"), is_anew("title"))
        && let Some(title) = node.as_str().filter(|title| !title.is_empty() && !title.ends_with(CHANGED))
    {
        node.content = Content::Leaf(toml::Value::String(format!("{title}{CHANGED}")));
    }
}

/// Text and bases as one tree.
pub(super) fn read_merged(
    schema: &Schema,
    text: &str,
    source_name: &str,
    base_dir: &Path,
) -> Result<Document, ExperimentError> {
    read_merged_as(schema, &FileFormat::EXPERIMENT, text, source_name, base_dir)
}

/// Text of a format of its own and bases, which are experiments, as one tree.
pub(super) fn read_merged_as(
    schema: &Schema,
    format: &'static FileFormat,
    text: &str,
    source_name: &str,
    base_dir: &Path,
) -> Result<Document, ExperimentError> {
    let source =
        TextSource { name: source_name.into(), overriding: None, folder: Some(base_dir.to_path_buf()) };
    let mut document = Document::read(text, source)?;
    check_format(schema, format, &document.root, &document.sources[0])?;
    if let Some(stated) = document.root.get_mut("format") {
        stated.content = Content::Leaf(FormatVersion::CURRENT.into());
    }
    put_on_bases(&mut document, schema, base_dir)?;
    Ok(document)
}

/// Applies changes one after the other.
pub(super) fn change_document(
    document: &mut Document,
    schema: &Schema,
    changes: &[SceneChange],
    base_dir: &Path,
) -> Result<(), ExperimentError> {
    for (number, change) in changes.iter().enumerate() {
        let (before, person) = (view_of(&document.root), person_of(&document.root));
        apply_change(document, schema, number, change, base_dir)?;
        if person_of(&document.root) != person {
            change_person(&mut document.root);
        }
        if view_of(&document.root) != before {
            change_view(&mut document.root, before);
        }
    }
    if document.root.get("base").is_some() {
        return Err(
            document.error(&steps!["base"], "a base can't be set by an override; write it into the file")
        );
    }
    if document.root.get("unset").is_some() && has_unset(schema) {
        return Err(
            document.error(&steps!["unset"], "a list can't be set by an override; write --unset PATH")
        );
    }
    Ok(())
}

/// Refuses overrides of sections that are not looked at; `why` says so of a section.
pub(super) fn refuse_ignored(
    document: &Document,
    overrides: &[String],
    why: impl Fn(&str) -> Option<String>,
) -> Result<(), ExperimentError> {
    for (number, text) in overrides.iter().enumerate() {
        let path = text.trim_start_matches("insert ").trim_start_matches("unset ");
        let Some(message) = why(path.split(['.', '=', '[']).next().unwrap_or_default()) else { continue };
        let is_own =
            |source: &&TextSource| source.overriding.as_ref().is_some_and(|set| set.number == number);
        return Err(match document.sources.iter().find(is_own) {
            Some(source) => source.error(message),
            None => document.error(&[], message),
        });
    }
    Ok(())
}

/// Puts the preset of the sensor below its fields and spells out what has a short form.
pub(super) fn finish_document(document: &mut Document, schema: &Schema) -> Result<(), ExperimentError> {
    put_on_sensor_preset(document, schema)?;
    spell_out_mosaic(document)
}

/// A mosaic of two rows and columns may be written as four letters, one without color as "mono".
fn spell_out_mosaic(document: &mut Document) -> Result<(), ExperimentError> {
    let Some(node) = document.root.get("sensor").and_then(|node| node.get("mosaic")) else { return Ok(()) };
    let Some(text) = node.as_str() else { return Ok(()) };
    let letters: Vec<String> = text.to_uppercase().chars().map(String::from).collect();
    let channel = |letter: &String| if letter == "N" { "NIR".to_string() } else { letter.clone() };
    let rows: Vec<Vec<String>> = if text == "mono" {
        vec![vec!["mono".into()]]
    } else if letters.len() == 4 && letters.iter().all(|letter| "RGBN".contains(letter.as_str())) {
        letters.chunks(2).map(|row| row.iter().map(channel).collect()).collect()
    } else {
        let message = "write four of the letters r, g, b, n (near infrared) row by row, such as \"grbg\", or \"mono\", or a list of rows";
        return Err(document.error(&steps!["sensor", "mosaic"], message));
    };
    let origin = node.origin;
    let name = |name: String| Node { content: Content::Leaf(toml::Value::String(name)), origin };
    let row =
        |row: Vec<String>| Node { content: Content::Array(row.into_iter().map(name).collect()), origin };
    let mosaic = Content::Array(rows.into_iter().map(row).collect());
    if let Some(node) = document.root.get_mut("sensor").and_then(|node| node.get_mut("mosaic")) {
        node.content = mosaic;
    }
    Ok(())
}

/// Whether files of a kind may take away what their base says.
fn has_unset(schema: &Schema) -> bool {
    schema.table(schema.root()).is_some_and(|table| table.field(None, "unset").is_some())
}

/// Loads the base of a document, and the base of that, and puts each below what it is the base of.
fn put_on_bases(document: &mut Document, schema: &Schema, base_dir: &Path) -> Result<(), ExperimentError> {
    let mut above = load_bases(document, schema, base_dir)?;
    if document.root.get("unset").is_some() && has_unset(schema) {
        let message =
            "this takes away what a base says, and the file has no base; leave the sections out instead";
        return Err(document.error(&steps!["unset"], message).without_value());
    }
    spell_out_view(&mut document.root, None);
    while let Some(mut over) = above.pop() {
        spell_out_view(&mut over, Some(&document.root));
        if let Some(unset) = over.take("unset") {
            apply_unset(document, schema, &unset)?;
        }
        keep_to_what_holds(&mut document.root, |key| over.get(key).is_some());
        merge(schema, Some(schema.root()), &mut document.root, over);
    }
    Ok(())
}

/// Loads the chain of bases of a document: the lowest becomes the root, those above are returned, the topmost first.
fn load_bases(
    document: &mut Document,
    schema: &Schema,
    base_dir: &Path,
) -> Result<Vec<Node>, ExperimentError> {
    let mut folder = base_dir.to_path_buf();
    let mut seen: Vec<PathBuf> = Vec::new();
    let mut above = Vec::new();
    while let Some(node) = document.root.get("base").cloned() {
        let Some(name) = node.as_str().map(String::from) else {
            return Err(
                document.error(&steps!["base"], "give the name of an experiment or the path of a file")
            );
        };
        if seen.len() >= MAX_BASES {
            let message = format!("more than {MAX_BASES} experiments in the chain of bases; use fewer");
            return Err(document.error(&steps!["base"], message));
        }
        let is_file = name.contains(['/', '\\']) || name.ends_with(".toml");
        let (text, source_name) = if is_file {
            let file = folder.join(&name);
            let text = read_text(&file).map_err(|message| document.error(&steps!["base"], message))?;
            let canonical = file.canonicalize().unwrap_or_else(|_| file.clone());
            if seen.contains(&canonical) {
                return Err(
                    document.error(&steps!["base"], "the experiment is its own base; remove the line")
                );
            }
            document.base_files.push(canonical.clone());
            seen.push(canonical);
            folder = file.parent().unwrap_or(Path::new("")).to_path_buf();
            (text, file.display().to_string())
        } else {
            let preset = preset::text(PresetKind::Experiment, &name)
                .map_err(|error| document.error(&steps!["base"], error))?;
            seen.push(PathBuf::from(&name));
            (preset.to_string(), format!("experiment \"{name}\""))
        };
        let index = document.sources.len();
        let source =
            TextSource { name: source_name, overriding: None, folder: is_file.then(|| folder.clone()) };
        let base = read_tree(&text, &source, index)?;
        check_format(schema, &FileFormat::EXPERIMENT, &base, &source)?;
        document.sources.push(source);
        document.root.take("base");
        above.push(std::mem::replace(&mut document.root, base));
    }
    Ok(above)
}

fn read_text(file: &Path) -> Result<String, String> {
    read_text_bounded(file, MAX_TEXT_BYTES as u64)
        .map_err(|error| format!("{}: {}", excerpt_to(&file.to_string_lossy(), 400), error.problem()))
}

/// Puts the fields of `sensor.preset` below the others of the section.
fn put_on_sensor_preset(document: &mut Document, schema: &Schema) -> Result<(), ExperimentError> {
    let Some(name) = document.root.get("sensor").and_then(|node| node.get("preset")) else { return Ok(()) };
    let Some(name) = name.as_str().map(String::from) else {
        return Err(document.error(&steps!["sensor", "preset"], "give the name of a sensor of the catalogue"));
    };
    let text = preset::text(PresetKind::Sensor, &name)
        .map_err(|error| document.error(&steps!["sensor", "preset"], error))?;
    let source = TextSource { name: format!("sensor \"{name}\""), overriding: None, folder: None };
    let mut root = read_tree(text, &source, document.sources.len())?;
    document.sources.push(source);
    let Some(mut fields) = root.take("sensor") else { return Ok(()) };
    if let Some(section) = document.root.get_mut("sensor") {
        section.take("preset");
        fields.origin = section.origin;
        let over = std::mem::replace(section, fields);
        let shape = schema.table(schema.root()).and_then(|table| table.shape(None, "sensor"));
        merge(schema, shape, section, over);
    }
    Ok(())
}

/// A document as a typed value; what does not fit is explained with its place.
pub(super) fn typed<T: DeserializeOwned>(
    document: &mut Document,
    schema: &Schema,
) -> Result<T, ExperimentError> {
    let Document { root, sources, .. } = document;
    complete(schema, schema.root(), root, sources);
    check(schema, document)?;
    // What the shapes can't know is left to the types: single texts that mean something.
    serde_path_to_error::deserialize(document.root.to_value()).map_err(|error| {
        let step = |segment: &Segment| match segment {
            Segment::Seq { index } => Some(Step::Index(*index)),
            Segment::Map { key } => Some(Step::Key(key.clone())),
            Segment::Enum { .. } | Segment::Unknown => None,
        };
        let steps: Vec<Step> = error.path().iter().filter_map(step).collect();
        document.error(&steps, error.inner().message())
    })
}
