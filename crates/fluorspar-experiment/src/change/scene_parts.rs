//! The parts of a scene by name: objects, and parts of the mouth, each with the place where its material is said.

use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;
use fluorspar_anatomy::MouthParameters;
use serde::Deserialize;

use super::scene_path::Pattern;
use crate::cache::cached_mouth;
use crate::document::tree::{Content, Node, TextSource};
use crate::error::{ExperimentError, Step};

/// A part of a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ScenePart {
    pub(crate) name: String,
    /// What it is: an object, a scan, a restoration, or the tissue of a part of the mouth.
    pub(crate) kind: String,
    /// Its section, where it has one: parts that the parameters of the mouth make have none.
    pub(crate) section: Option<Vec<Step>>,
    /// Where its material is written, or would be.
    pub(crate) material_at: Vec<Step>,
    /// The name of its material, as far as it is said.
    pub(crate) material: Option<String>,
}

/// All parts: those of the mouth, then the objects, as a scene has them.
///
/// # Errors
/// A mouth that can't be made, which its parts depend on.
pub(crate) fn scene_parts(root: &Node) -> Result<Vec<ScenePart>, String> {
    let mut parts = Vec::new();
    if let Some(section) = root.get("mouth") {
        parts.extend(mouth_parts(section)?);
    }
    for (number, node) in entries(root, "object").iter().enumerate() {
        parts.extend(of_section(node, vec![Step::from("object"), Step::from(number)], object_kind(node)));
    }
    Ok(parts)
}

fn object_kind(node: &Node) -> String {
    let shape = node.get("type").and_then(Node::as_str).unwrap_or("object");
    if node.get("instance").is_some() || node.get("instance_file").is_some() {
        format!("instances of a {shape}")
    } else {
        shape.into()
    }
}

/// A section with a name and a material.
fn of_section(node: &Node, at: Vec<Step>, kind: String) -> Option<ScenePart> {
    Some(ScenePart {
        name: node.name()?.into(),
        kind,
        material_at: [&at[..], &[Step::from("material")]].concat(),
        section: Some(at),
        material: node.get("material").and_then(Node::as_str).map(String::from),
    })
}

fn entries<'a>(node: &'a Node, key: &str) -> &'a [Node] {
    match node.get(key).map(|node| &node.content) {
        Some(Content::Array(items)) => items,
        _ => &[],
    }
}

fn mouth_parts(section: &Node) -> Result<Vec<ScenePart>, String> {
    let mouth = cached_mouth(&mouth_parameters(section)?)
        .map_err(|error| format!("mouth.{}: {}", error.field, error.message))?;
    let materials = section.get("materials");
    let said = |key: &str| materials?.get(key)?.as_str().map(String::from);
    let mut parts: Vec<ScenePart> = mouth
        .parts
        .iter()
        .map(|part| {
            let tissue = part.tissue.name();
            ScenePart {
                name: part.name.clone(),
                kind: tissue.into(),
                section: None,
                material_at: ["mouth", "materials", &part.name].map(Step::from).into(),
                material: said(&part.name).or_else(|| said(tissue)).or_else(|| Some(tissue.into())),
            }
        })
        .collect();
    for (number, scan) in entries(section, "scan").iter().enumerate() {
        parts.retain(|part| !is_replaced(part, scan));
        let at = vec![Step::from("mouth"), Step::from("scan"), Step::from(number)];
        parts.extend(of_section(scan, at, "scan".into()));
    }
    for (number, restoration) in entries(section, "restoration").iter().enumerate() {
        let at = vec![Step::from("mouth"), Step::from("restoration"), Step::from(number)];
        parts.extend(of_section(restoration, at, "restoration".into()));
    }
    Ok(parts)
}

/// Whether a scan stands in place of a part of the mouth: by its name, or by how it begins.
fn is_replaced(part: &ScenePart, scan: &Node) -> bool {
    let mut replaced = entries(scan, "replaces").iter().filter_map(Node::as_str);
    replaced.any(|replaced| match replaced.strip_suffix('*') {
        Some(start) => part.name.starts_with(start),
        None => part.name == replaced,
    })
}

/// The fields of the section that the shape and the pose of a mouth follow from.
fn mouth_parameters(section: &Node) -> Result<MouthParameters, String> {
    let mut value = section.to_value();
    if let toml::Value::Table(table) = &mut value {
        for other in ["materials", "lesion", "scan", "restoration", "transform"] {
            table.remove(other);
        }
    }
    MouthParameters::deserialize(value).map_err(|error| format!("mouth: {}", error.message()))
}

/// The parts that a pattern names.
///
/// # Errors
/// None.
pub(crate) fn named_parts(
    root: &Node,
    pattern: &Pattern,
    source: &TextSource,
) -> Result<Vec<ScenePart>, ExperimentError> {
    let parts = scene_parts(root).map_err(|message| source.error(message))?;
    let named: Vec<ScenePart> = parts.iter().filter(|part| pattern.matches(&part.name)).cloned().collect();
    if !named.is_empty() {
        return Ok(named);
    }
    let hint = match pattern.is_wild() {
        true => ";".into(),
        false => did_you_mean(&pattern.text, parts.iter().map(|part| part.name.as_str())),
    };
    let message = format!(
        "no part is named `{}`{hint} `fluorspar scene tree` lists the {} parts",
        excerpt(&pattern.text),
        parts.len()
    );
    Err(source.error(message))
}

/// Names of materials that a material is made of, or other places where one is named besides those of parts.
pub(crate) fn materials_within_others(root: &Node) -> Vec<String> {
    let within = ["first", "second", "front", "back"];
    let of_material = |node: &Node| -> Vec<String> {
        within.iter().filter_map(|key| node.get(key)?.as_str().map(String::from)).collect()
    };
    let of_instances = |node: &Node| -> Vec<String> {
        let instances = entries(node, "instance").iter();
        instances.filter_map(|instance| instance.get("material")?.as_str().map(String::from)).collect()
    };
    let materials = entries(root, "material").iter().flat_map(of_material);
    materials.chain(entries(root, "object").iter().flat_map(of_instances)).collect()
}
