//! What a scene holds, by name: its tree, and the values at a path.

use serde::Serialize;

use crate::Experiment;
use crate::change::scene_parts::{ScenePart, named_parts, scene_parts};
use crate::change::scene_path::{Finder, Pattern, ScenePath};
use crate::document::tree::{Content, Node, Origin, TextSource};
use crate::error::{ExperimentError, Step, step_text};
use crate::read::experiment_schema;

/// Longest summary of a node, characters.
const LONGEST_SUMMARY: usize = 90;

/// A named thing of a scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SceneNode {
    /// Its path for `get` and `set`; of a part with a slash behind it.
    pub path: String,
    /// What it is: a section such as `camera`, an entry such as `light`, a `part`.
    pub kind: String,
    /// Its most telling fields, as the file writes them.
    pub summary: String,
}

/// The value at a place of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneValue {
    /// The place.
    pub path: String,
    /// Its value, with defaults.
    pub value: toml::Value,
}

/// Sections with one table each, in the order of the tree.
const SECTIONS: [&str; 9] =
    ["spectral", "render", "camera", "lens", "view_filter", "sensor", "mouth", "develop", "analysis"];
/// Lists of named entries.
const LISTS: [&str; 7] =
    ["light", "fluorophore", "tissue", "material", "object", "capture", "spectroradiometer"];

/// Everything in a scene that has a name: sections, lights, materials, tissues, parts, captures.
///
/// # Errors
/// A mouth that can't be made, which its parts depend on.
pub fn scene_nodes(experiment: &Experiment) -> Result<Vec<SceneNode>, ExperimentError> {
    let root = &experiment.document.root;
    let mut nodes = Vec::new();
    for key in SECTIONS {
        if let Some(section) = root.get(key) {
            nodes.push(SceneNode { path: key.into(), kind: key.into(), summary: summary(section) });
        }
        if key == "mouth" {
            for list in ["lesion", "scan", "restoration"] {
                let inner = root.get(key).and_then(|mouth| mouth.get(list));
                nodes.extend(
                    inner.into_iter().flat_map(|inner| entries(inner, list, &format!("mouth.{list}"))),
                );
            }
        }
    }
    for key in LISTS {
        nodes.extend(root.get(key).into_iter().flat_map(|list| entries(list, key, key)));
    }
    let parts = scene_parts(root).map_err(|message| experiment.document.error(&[], message))?;
    nodes.extend(parts.into_iter().map(node_of_part));
    Ok(nodes)
}

fn node_of_part(part: ScenePart) -> SceneNode {
    let summary = match part.material {
        Some(material) => format!("{}, material {}", part.kind, step_text(&material)),
        None => part.kind,
    };
    SceneNode { path: format!("{}/", step_text(&part.name)), kind: "part".into(), summary }
}

/// The named entries of a list.
fn entries(list: &Node, kind: &str, path: &str) -> Vec<SceneNode> {
    let Content::Array(items) = &list.content else { return Vec::new() };
    let entry = |(number, node): (usize, &Node)| SceneNode {
        path: match node.name() {
            Some(name) => format!("{path}.{}", step_text(name)),
            None => format!("{path}[{number}]"),
        },
        kind: kind.into(),
        summary: summary(node),
    };
    items.iter().enumerate().map(entry).collect()
}

/// The fields of a table in a line: its type first, then short values.
fn summary(node: &Node) -> String {
    let Content::Table(fields) = &node.content else { return String::new() };
    let mut text = node.get("type").and_then(Node::as_str).unwrap_or_default().to_string();
    for (key, inner) in fields {
        if ["name", "type", "title", "description"].contains(&key.as_str()) {
            continue;
        }
        let value = inner.to_value().to_string();
        let shown = if value.len() > 40 { "...".into() } else { value };
        let piece = format!("{}{key} = {shown}", if text.is_empty() { "" } else { ", " });
        if text.chars().count() + piece.chars().count() > LONGEST_SUMMARY {
            text.push_str(", ...");
            break;
        }
        text.push_str(&piece);
    }
    text
}

/// The values at a path, defaults included: of every place that it names.
///
/// # Errors
/// A path that names nothing.
pub fn scene_values(experiment: &Experiment, path: &str) -> Result<Vec<SceneValue>, ExperimentError> {
    values_at(experiment, path).map_err(|error| error.about(path))
}

fn values_at(experiment: &Experiment, path: &str) -> Result<Vec<SceneValue>, ExperimentError> {
    let source = TextSource { name: format!("get {path}"), overriding: None, folder: None };
    let complete = toml::Value::try_from(&experiment.file)
        .map_err(|error| source.error(format!("the experiment can't be written out: {error}")))?;
    let root = node_of(complete);
    let schema = experiment_schema();
    let find = |steps: &[Pattern]| Finder::new(schema, &source).find(&root, steps);
    let (ScenePath { part, steps }, _) = ScenePath::read(path, &source)?;
    let mut values = Vec::new();
    match part {
        None => {
            for place in find(&steps)? {
                values.extend(value_at(&root, &place, root.named_path(&place)));
            }
        }
        Some(pattern) => {
            for part in named_parts(&root, &pattern, &source)? {
                let (around, rest) = match (steps.split_first(), &part.section, &part.material) {
                    (Some((first, rest)), _, Some(material)) if first.text == "material" => {
                        if rest.is_empty() {
                            let path = format!("{}/material", step_text(&part.name));
                            values.push(SceneValue { path, value: material.clone().into() });
                            continue;
                        }
                        (vec![Pattern::plain("material"), Pattern::plain(material)], rest)
                    }
                    (_, Some(section), _) => (section.iter().map(as_pattern).collect(), &steps[..]),
                    _ => continue,
                };
                let all = [around.as_slice(), rest].concat();
                for place in find(&all)? {
                    let below = place[around.len()..].to_vec();
                    let material = if steps[0].text == "material" { "material." } else { "" };
                    let path = format!("{}/{material}{}", step_text(&part.name), below_text(&below));
                    values.extend(value_at(&root, &place, path));
                }
            }
        }
    }
    match values.is_empty() {
        true => {
            Err(source.error("there is no value at this path; `fluorspar scene tree` lists what there is"))
        }
        false => Ok(values),
    }
}

fn as_pattern(step: &Step) -> Pattern {
    match step {
        Step::Key(key) => Pattern::plain(key),
        Step::Index(index) => Pattern::plain(&index.to_string()),
    }
}

fn value_at(root: &Node, place: &[Step], path: String) -> Option<SceneValue> {
    let node = place.iter().try_fold(root, |node, step| node.step(step))?;
    Some(SceneValue { path, value: node.to_value() })
}

fn below_text(steps: &[Step]) -> String {
    let mut text = String::new();
    for step in steps {
        match step {
            Step::Key(key) if text.is_empty() => text.push_str(&step_text(key)),
            Step::Key(key) => text.push_str(&format!(".{}", step_text(key))),
            Step::Index(index) => text.push_str(&format!("[{index}]")),
        }
    }
    text
}

/// A value as a tree without places.
fn node_of(value: toml::Value) -> Node {
    let content = match value {
        toml::Value::Table(fields) => {
            Content::Table(fields.into_iter().map(|(key, value)| (key, node_of(value))).collect())
        }
        toml::Value::Array(items) => Content::Array(items.into_iter().map(node_of).collect()),
        leaf => Content::Leaf(leaf),
    };
    Node { content, origin: Origin { source: 0, line: 0 } }
}
