//! `--set path=value`: single values on top of an experiment file.

use fluorspar::quote::excerpt;
use std::path::Path;

use super::document::{Content, Document, Node, Origin, Overriding, TextSource, read_tree};
use super::error::{ExperimentError, Step};
use super::merge::make_room;
use super::shape::{Found, Schema, Shape};
use fluorspar::names::did_you_mean;

/// Applies one override, of a number among all, such as `light.blue.strength.power_mw=20` or `material[2].gloss.roughness=0.3`.
///
/// An entry of a list is addressed by its name or by its number from 0. The value is TOML; what is not TOML is
/// taken as a string, so that `sensor.quantum_efficiency=monochrome_cmos` needs no quotes.
pub(super) fn apply(
    document: &mut Document,
    schema: &Schema,
    number: usize,
    text: &str,
    base_dir: &Path,
) -> Result<(), ExperimentError> {
    let mut source = TextSource {
        name: format!("--set {text}"),
        overriding: Some(Overriding { number, path: Vec::new() }),
        folder: Some(base_dir.to_path_buf()),
    };
    let (steps, value_text) = split(text, &source)?;
    let index = document.sources.len();
    let value = read_value(value_text, &source, index);
    let steps = resolve_names(&document.root, &steps, &source)?;
    source.overriding = Some(Overriding { number, path: steps.clone() });
    document.sources.push(source);
    let sources = &document.sources;
    // Another variant takes the place of what files say about the old one; earlier overrides stay.
    let is_override = |node: &Node| !sources[node.origin.source].has_lines();
    put(schema, Some(schema.root()), &mut document.root, &steps, value, &is_override);
    Ok(())
}

fn bad(source: &TextSource, message: impl Into<String>) -> ExperimentError {
    source.error(message)
}

/// Splits `path=value` into the steps of the path and the text of the value.
fn split<'a>(text: &'a str, source: &TextSource) -> Result<(Vec<String>, &'a str), ExperimentError> {
    let mut steps = Vec::new();
    let mut current = String::new();
    let mut quoted = false;
    for (at, c) in text.char_indices() {
        match c {
            '"' => quoted = !quoted,
            '.' | '[' | ']' if !quoted => {
                if !end_step(&mut current, &mut steps) && c == '.' && !text[..at].ends_with(']') {
                    return Err(bad(source, "the path has an empty step; write section.field=value"));
                }
            }
            '=' if !quoted => {
                end_step(&mut current, &mut steps);
                if steps.is_empty() {
                    return Err(bad(source, "the path before `=` is missing; write section.field=value"));
                }
                return Ok((steps, text[at + 1..].trim()));
            }
            c => current.push(c),
        }
    }
    Err(bad(
        source,
        "there is no `=`; write section.field=value, for instance light.blue.strength.power_mw=20",
    ))
}

/// Adds a step to a path, if there is one.
fn end_step(current: &mut String, steps: &mut Vec<String>) -> bool {
    let step = std::mem::take(current);
    if step.trim().is_empty() {
        return false;
    }
    steps.push(step.trim().to_string());
    true
}

fn read_value(text: &str, source: &TextSource, index: usize) -> Node {
    let origin = Origin { source: index, line: 1 };
    let as_string = || Node { content: Content::Leaf(toml::Value::String(text.into())), origin };
    if text.contains('\n') {
        return as_string();
    }
    read_tree(&format!("value = {text}"), source, index)
        .ok()
        .and_then(|mut root| root.take("value"))
        .unwrap_or_else(as_string)
}

/// Turns names of list entries into their numbers.
fn resolve_names(root: &Node, steps: &[String], source: &TextSource) -> Result<Vec<Step>, ExperimentError> {
    let mut node = Some(root);
    let mut resolved = Vec::with_capacity(steps.len());
    let mut parent = "";
    for step in steps {
        let next = match node.map(|node| &node.content) {
            Some(Content::Array(items)) => Step::Index(find_entry(items, parent, step, source)?),
            Some(Content::Leaf(_)) => {
                return Err(bad(
                    source,
                    format!("`{}` is a value and has no field `{}`", excerpt(parent), excerpt(step)),
                ));
            }
            _ => Step::Key(step.clone()),
        };
        node = node.and_then(|node| node.step(&next));
        resolved.push(next);
        parent = step;
    }
    Ok(resolved)
}

fn find_entry(items: &[Node], list: &str, step: &str, source: &TextSource) -> Result<usize, ExperimentError> {
    if let Some(index) = items.iter().position(|item| item.name() == Some(step)) {
        return Ok(index);
    }
    if let Ok(index) = step.parse::<usize>() {
        if index < items.len() {
            return Ok(index);
        }
        let message =
            format!("there is no {list}[{index}]; the list has {} entries, numbered from 0", items.len());
        return Err(bad(source, message));
    }
    let names: Vec<&str> = items.iter().filter_map(Node::name).collect();
    let known: Vec<String> = names.iter().map(|name| excerpt(name)).collect();
    if names.is_empty() {
        return Err(bad(
            source,
            format!("`{list}` is a list; address its entries by number, as in {list}[0]"),
        ));
    }
    let hint = did_you_mean(step, names.iter().copied());
    Err(bad(source, format!("there is no {list} \"{}\"{hint} Known: {}", excerpt(step), known.join(", "))))
}

/// Puts a value at a path, building the tables around it where they do not exist.
fn put(
    schema: &Schema,
    shape: Option<&Shape>,
    node: &mut Node,
    steps: &[Step],
    value: Node,
    keep: &impl Fn(&Node) -> bool,
) {
    match steps {
        [] => *node = value,
        [Step::Index(index), rest @ ..] => {
            if let Content::Array(items) = &mut node.content
                && let Some(item) = items.get_mut(*index)
            {
                put(schema, shape.and_then(|shape| schema.items(shape)), item, rest, value, keep);
            }
        }
        [Step::Key(key), rest @ ..] => {
            // A tree with nothing but this value in it, so that the rules of merging hold for overrides as well.
            let origin = value.origin;
            let in_table = |inner: Node, step: &Step| match step {
                Step::Key(key) => Node { content: Content::Table(vec![(key.clone(), inner)]), origin },
                Step::Index(_) => inner,
            };
            let alone = steps.iter().rev().fold(value.clone(), in_table);
            if !matches!(node.content, Content::Table(_)) {
                *node = alone;
                return;
            }
            let table = shape.and_then(|shape| schema.table(shape));
            if let Some(table) = table {
                make_room(table, node, &alone, keep);
            }
            let variant = table.and_then(|table| match table.variant_of(&alone) {
                Found::Variant(index) => Some(index),
                _ => table.variant_or_default(node),
            });
            let shape = table.and_then(|table| table.shape(variant, key));
            if let (false, Some(inner)) = (rest.is_empty(), node.get_mut(key))
                && !matches!(inner.content, Content::Leaf(_))
            {
                put(schema, shape, inner, rest, value, keep);
                return;
            }
            let value = rest.iter().rev().fold(value, in_table);
            match node.get_mut(key) {
                Some(existing) => *existing = value,
                None => node.insert(key, value),
            }
        }
    }
}
