//! From text to typed sections.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_path_to_error::Segment;

use super::document::{Content, Document, Node, Source, anchor_paths, read_tree};
use super::error::{ExperimentError, Step, path_text, steps};
use super::merge::merge;
use super::overrides;
use super::schema::{ExperimentFile, MouthSection, SensorSection};
use crate::anatomy::MouthParameters;
use crate::names::{did_you_mean, nearest_name};
use crate::preset;
use crate::sensor::SensorModel;

/// Longest chain of base experiments.
const MAX_BASES: usize = 8;
/// Largest file, bytes.
const MAX_BYTES: u64 = 16 << 20;

/// An experiment as written: its sections, and where each value came from.
#[derive(Clone, Debug, PartialEq)]
pub struct Experiment {
    /// The sections, merged with their base and overridden.
    pub file: ExperimentFile,
    pub(super) document: Document,
}

/// Reads an experiment: text, base experiments, then overrides such as `light.blue.power_mw=20`.
///
/// `source_name` is how messages call the text. Relative paths in the text, in overrides and in the name of a base
/// file start at `base_dir`.
///
/// # Errors
/// The first defect found.
pub fn parse(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    overrides: &[String],
) -> Result<Experiment, ExperimentError> {
    let document = read_document(text, source_name, base_dir, overrides)?;
    let file: ExperimentFile = typed(&document)?;
    Ok(Experiment { file, document })
}

/// Text, bases, overrides and sensor preset as one tree.
pub(super) fn read_document(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    overrides: &[String],
) -> Result<Document, ExperimentError> {
    let source = Source { name: source_name.into(), has_lines: true };
    let mut document = Document::read(text, source)?;
    anchor_paths(&mut document.root, base_dir);
    put_on_bases(&mut document, base_dir)?;
    for text in overrides {
        overrides::apply(&mut document, text, |node| anchor_paths(node, base_dir))?;
    }
    if document.root.get("base").is_some() {
        return Err(
            document.error(&steps!["base"], "a base can't be set by an override; write it into the file")
        );
    }
    put_on_sensor_preset(&mut document)?;
    spell_out_mosaic(&mut document)?;
    Ok(document)
}

/// A mosaic of two rows and columns may be written as four letters, one without colour as "mono".
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

/// Loads the base of a document, and the base of that, and puts each below what it is the base of.
fn put_on_bases(document: &mut Document, base_dir: &Path) -> Result<(), ExperimentError> {
    let mut folder = base_dir.to_path_buf();
    let mut seen: Vec<PathBuf> = Vec::new();
    while let Some(node) = document.root.get("base").cloned() {
        let Some(name) = node.as_str().map(String::from) else {
            return Err(
                document.error(&steps!["base"], "give the name of an experiment or the path of a file")
            );
        };
        if seen.len() >= MAX_BASES {
            let message = format!("more than {MAX_BASES} experiments stand on each other; use fewer");
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
            let preset = preset::experiment(&name)
                .map_err(|error| document.error(&steps!["base"], error.to_string()))?;
            seen.push(PathBuf::from(&name));
            (preset.text.to_string(), format!("experiment \"{name}\""))
        };
        let index = document.sources.len();
        let source = Source { name: source_name, has_lines: true };
        let mut base = read_tree(&text, &source, index)?;
        document.sources.push(source);
        if is_file {
            anchor_paths(&mut base, &folder);
        }
        document.root.take("base");
        let over = std::mem::replace(&mut document.root, base);
        merge(&mut document.root, over);
    }
    Ok(())
}

fn read_text(file: &Path) -> Result<String, String> {
    let size = std::fs::metadata(file).map_err(|error| format!("{}: {error}", file.display()))?.len();
    if size > MAX_BYTES {
        return Err(format!("{} has {size} bytes; an experiment has at most {MAX_BYTES}", file.display()));
    }
    std::fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))
}

/// Puts the fields of `sensor.preset` below the others of the section.
fn put_on_sensor_preset(document: &mut Document) -> Result<(), ExperimentError> {
    let Some(name) = document.root.get("sensor").and_then(|node| node.get("preset")) else { return Ok(()) };
    let Some(name) = name.as_str().map(String::from) else {
        return Err(document.error(&steps!["sensor", "preset"], "give the name of a sensor of the catalogue"));
    };
    let text = preset::sensor_text(&name)
        .map_err(|error| document.error(&steps!["sensor", "preset"], error.to_string()))?;
    let source = Source { name: format!("sensor \"{name}\""), has_lines: true };
    let mut root = read_tree(text, &source, document.sources.len())?;
    document.sources.push(source);
    let Some(mut fields) = root.take("sensor") else { return Ok(()) };
    if let Some(section) = document.root.get_mut("sensor") {
        section.take("preset");
        fields.origin = section.origin;
        let over = std::mem::replace(section, fields);
        merge(section, over);
    }
    Ok(())
}

/// A document as a typed value; what does not fit is explained with its place.
pub(super) fn typed<T: DeserializeOwned>(document: &Document) -> Result<T, ExperimentError> {
    serde_path_to_error::deserialize(document.root.to_value()).map_err(|error| {
        let steps = error
            .path()
            .iter()
            .filter_map(|segment| match segment {
                Segment::Seq { index } => Some(Step::Index(*index)),
                Segment::Map { key } => Some(Step::Key(key.clone())),
                Segment::Enum { .. } | Segment::Unknown => None,
            })
            .collect();
        explain(document, steps, error.inner().message())
    })
}

/// Turns a message of serde into one for people, at the right place.
fn explain(document: &Document, mut steps: Vec<Step>, message: &str) -> ExperimentError {
    blame_flattened(document, &mut steps);
    let message = message.trim();
    let mut quoted = message.split('`').skip(1).step_by(2);
    if message.starts_with("unknown field") {
        let unknown = quoted.next().unwrap_or_default().to_string();
        if steps.last() == Some(&Step::Key(unknown.clone())) {
            steps.pop();
        }
        let mut known: Vec<String> = quoted.map(String::from).collect();
        if known.is_empty() {
            known = flattened_fields(&steps);
        }
        let hint = nearest_name(&unknown, known.iter().map(String::as_str))
            .map_or_else(|| ".".into(), |name| format!(", did you mean `{name}`?"));
        let known = if known.is_empty() { String::new() } else { format!(" Known: {}", known.join(", ")) };
        let mut at = steps.clone();
        at.push(Step::Key(unknown.clone()));
        let place = document.error(&at, "").0;
        let mut error =
            document.error(&steps, format!("unknown field `{unknown}`{hint}{known}")).without_value();
        error.0.source_name = place.source_name;
        error.0.line = place.line;
        return error;
    }
    if message.starts_with("missing field") {
        let missing = quoted.next().unwrap_or_default();
        return document.error(&steps, format!("the field `{missing}` is missing")).without_value();
    }
    if message.starts_with("unknown variant") {
        let unknown = quoted.next().unwrap_or_default().to_string();
        let known: Vec<&str> = quoted.collect();
        let hint = did_you_mean(&unknown, known.iter().copied());
        return document
            .error(&steps, format!("unknown value \"{unknown}\"{hint} Known: {}", known.join(", ")));
    }
    let text = match message.split_once(", expected ") {
        Some((found, expected)) => {
            let expected = if let Some(most) = largest_whole(found, expected.trim()) {
                format!("a whole number from 0 to {most}")
            } else if expected.trim() == "a sequence" {
                format!("a list in [ ]{}", list_example(found))
            } else {
                for_people(expected)
            };
            match found.split_once(": ") {
                Some(("invalid length", _)) | None if found.starts_with("invalid length") => {
                    format!(
                        "this list has {} entries; expected {expected}",
                        found.trim_start_matches("invalid length ")
                    )
                }
                Some((_, what)) if what.starts_with("map") => {
                    format!("a table stands here; expected {expected}")
                }
                Some((_, what)) if what.starts_with("sequence") => {
                    format!("a list stands here; expected {expected}")
                }
                _ => format!("expected {expected}"),
            }
        }
        None => message.to_string(),
    };
    document.error(&steps, text)
}

/// The value that was found as the only entry of a list, such as `, for instance ["led_385"]`.
fn list_example(found: &str) -> String {
    let value = found.split_once(": ").map_or("", |(_, what)| what);
    let value = value.strip_prefix("string ").or_else(|| value.split('`').nth(1)).unwrap_or_default();
    if value.is_empty() || value.len() > 60 { String::new() } else { format!(", for instance [{value}]") }
}

/// The end of a type of whole numbers, where a number beyond it was found.
fn largest_whole(found: &str, expected: &str) -> Option<u64> {
    found.split('`').nth(1)?.parse::<u64>().ok().filter(|_| found.starts_with("invalid value: integer"))?;
    match expected {
        "u8" => Some(u8::MAX.into()),
        "u16" => Some(u16::MAX.into()),
        "u32" => Some(u32::MAX.into()),
        _ => None,
    }
}

/// What serde expects, in words.
fn for_people(expected: &str) -> String {
    let expected = expected.trim();
    match expected {
        "f64" | "f32" => "a number".into(),
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, 0 or more".into(),
        "i8" | "i64" => "a whole number".into(),
        "a boolean" => "true or false".into(),
        "a string" => "a text in quotes".into(),
        "a sequence" => "a list in [ ]".into(),
        "a map" => "a table".into(),
        "an array of length 2" => "a list of 2 numbers".into(),
        "an array of length 3" => "a list of 3 numbers".into(),
        "an array of length 4" => "a list of 4 numbers".into(),
        _ if expected.starts_with("struct ") => "a table".into(),
        _ => expected.into(),
    }
}

/// A flattened section loses the key of what does not fit: finds it by trying its keys one by one.
fn blame_flattened(document: &Document, steps: &mut Vec<Step>) {
    let [Step::Key(section)] = steps.as_slice() else { return };
    let fits = match section.as_str() {
        "sensor" => |table| SensorModel::deserialize_table(table),
        "mouth" => |table| MouthParameters::deserialize_table(table),
        _ => return,
    };
    let own: &[&str] = &["quantum_efficiency", "filters", "preset", "materials", "transform"];
    let Some(Content::Table(entries)) = document.root.get(section).map(|node| &node.content) else { return };
    for (key, node) in entries {
        let known = flattened_fields(steps);
        let table = toml::Table::from_iter([(key.clone(), node.to_value())]);
        if !own.contains(&key.as_str()) && known.contains(key) && !fits(table) {
            steps.push(Step::Key(key.clone()));
            return;
        }
    }
}

/// Whether a table of a few fields, the others at their defaults, is of a type.
trait DeserializeTable: DeserializeOwned {
    fn deserialize_table(table: toml::Table) -> bool {
        Self::deserialize(table).is_ok()
    }
}

impl DeserializeTable for SensorModel {}
impl DeserializeTable for MouthParameters {}

/// Names of the fields of a section whose list serde does not know.
fn flattened_fields(steps: &[Step]) -> Vec<String> {
    match path_text(steps).as_str() {
        "sensor" => field_names::<SensorSection>(),
        "mouth" => field_names::<MouthSection>(),
        _ => Vec::new(),
    }
}

pub(super) fn field_names<T: JsonSchema>() -> Vec<String> {
    let schema = schemars::SchemaGenerator::default().into_root_schema_for::<T>();
    let properties = schema.get("properties").and_then(serde_json::Value::as_object);
    properties.map(|properties| properties.keys().cloned().collect()).unwrap_or_default()
}
