//! `--set path=value`: single values on top of an experiment file.

use super::document::{Content, Document, Node, Origin, Source, read_tree};
use super::error::{ExperimentError, Step};
use super::merge::replace;
use crate::names::did_you_mean;

/// Applies one override such as `light.blue.power_mw=20` or `material[2].gloss.roughness=0.3`.
///
/// An entry of a list is addressed by its name or by its number from 0. The value is TOML; what is no TOML is
/// taken as a string, so that `sensor.quantum_efficiency=monochrome_cmos` needs no quotes.
pub(super) fn apply(
    document: &mut Document,
    text: &str,
    anchor: impl Fn(&mut Node),
) -> Result<(), ExperimentError> {
    let source = Source { name: format!("--set {text}"), has_lines: false };
    let (steps, value_text) = split(text, &source)?;
    let index = document.sources.len();
    let value = read_value(value_text, &source, index);
    let steps = resolve_names(&document.root, &steps, &source)?;

    // A tree with nothing but this value in it, so that the rules of merging hold for overrides as well.
    let origin = Origin { source: index, line: 1 };
    document.sources.push(source);
    let key = steps.iter().rev().find_map(|step| match step {
        Step::Key(key) => Some(key.clone()),
        Step::Index(_) => None,
    });
    let mut value = Node { content: Content::Table(vec![(key.unwrap_or_default(), value)]), origin };
    anchor(&mut value);
    if steps == [Step::Key("sensor".into()), Step::Key("preset".into())] {
        keep_only_overrides_of_sensor(document, &value);
    }
    let Content::Table(mut only) = value.content else { return Ok(()) };
    let Some((_, value)) = only.pop() else { return Ok(()) };
    put(&mut document.root, &steps, value, origin);
    Ok(())
}

/// Another sensor of the catalogue takes the place of what files say about the sensor; earlier overrides stay.
fn keep_only_overrides_of_sensor(document: &mut Document, value: &Node) {
    let sources = &document.sources;
    let Some(section) = document.root.get_mut("sensor") else { return };
    let name = |node: Option<&Node>| node.and_then(Node::as_str).map(String::from);
    if name(section.get("preset")) == name(value.get("preset")) {
        return;
    }
    if let Content::Table(entries) = &mut section.content {
        entries.retain(|(_, node)| !sources[node.origin.source].has_lines);
    }
}

fn bad(source: &Source, message: impl Into<String>) -> ExperimentError {
    ExperimentError::in_source(&source.name, message)
}

/// Splits `path=value` into the steps of the path and the text of the value.
fn split<'a>(text: &'a str, source: &Source) -> Result<(Vec<String>, &'a str), ExperimentError> {
    let mut steps = Vec::new();
    let mut current = String::new();
    let mut quoted = false;
    for (at, c) in text.char_indices() {
        match c {
            '"' => quoted = !quoted,
            '.' | '[' | ']' if !quoted => {
                if !current.trim().is_empty() {
                    steps.push(current.trim().to_string());
                } else if c == '.' && !text[..at].ends_with(']') {
                    return Err(bad(source, "the path has an empty step; write section.field=value"));
                }
                current.clear();
            }
            '=' if !quoted => {
                if !current.trim().is_empty() {
                    steps.push(current.trim().to_string());
                }
                if steps.is_empty() {
                    return Err(bad(source, "nothing stands before `=`; write section.field=value"));
                }
                return Ok((steps, text[at + 1..].trim()));
            }
            c => current.push(c),
        }
    }
    Err(bad(source, "there is no `=`; write section.field=value, for instance light.blue.power_mw=20"))
}

fn read_value(text: &str, source: &Source, index: usize) -> Node {
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
fn resolve_names(root: &Node, steps: &[String], source: &Source) -> Result<Vec<Step>, ExperimentError> {
    let mut node = Some(root);
    let mut resolved = Vec::with_capacity(steps.len());
    let mut parent = "";
    for step in steps {
        let next = match node.map(|node| &node.content) {
            Some(Content::Array(items)) => Step::Index(find_entry(items, parent, step, source)?),
            Some(Content::Leaf(_)) => {
                return Err(bad(source, format!("`{parent}` is a value and has no field `{step}`")));
            }
            _ => Step::Key(step.clone()),
        };
        node = node.and_then(|node| node.step(&next));
        resolved.push(next);
        parent = step;
    }
    Ok(resolved)
}

fn find_entry(items: &[Node], list: &str, step: &str, source: &Source) -> Result<usize, ExperimentError> {
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
    if names.is_empty() {
        return Err(bad(
            source,
            format!("`{list}` is a list; address its entries by number, as in {list}[0]"),
        ));
    }
    let hint = did_you_mean(step, names.iter().copied());
    Err(bad(source, format!("there is no {list} \"{step}\"{hint} Known: {}", names.join(", "))))
}

/// Puts a value at a path, building the tables around it where they do not exist.
fn put(node: &mut Node, steps: &[Step], value: Node, origin: Origin) {
    match steps {
        [] => *node = value,
        [Step::Index(index), rest @ ..] => {
            if let Content::Array(items) = &mut node.content
                && let Some(item) = items.get_mut(*index)
            {
                put(item, rest, value, origin);
            }
        }
        [Step::Key(key), rest @ ..] => {
            if let (false, Some(inner)) = (rest.is_empty(), node.get_mut(key))
                && !matches!(inner.content, Content::Leaf(_))
            {
                put(inner, rest, value, origin);
                return;
            }
            let mut value = value;
            for step in rest.iter().rev() {
                let Step::Key(key) = step else { return };
                value = Node { content: Content::Table(vec![(key.clone(), value)]), origin };
            }
            replace(node, key, value);
        }
    }
}
