//! The version of the form of a file, and what to write for the spellings from before there was one.

use super::shape::{Schema, Shape};
use super::tree::{Content, Node, TextSource};
use crate::error::ExperimentError;
use fluorspar_format::FileFormat;

/// Largest number of old spellings in a message.
const MOST_NAMED: usize = 6;

/// Refuses a file that does not state its format. The message names what its owner has to change.
///
/// # Errors
/// A format that is absent or another one.
pub(crate) fn check_format(
    schema: &Schema,
    format: &'static FileFormat,
    root: &Node,
    source: &TextSource,
) -> Result<(), ExperimentError> {
    let (message, given) = match root.get("format") {
        None => (missing_format(schema, format, root), None),
        Some(node) => match &node.content {
            Content::Leaf(toml::Value::Integer(stated)) => match format.check(Some(*stated)) {
                Ok(()) => return Ok(()),
                Err(other) => (other.to_string(), Some(node)),
            },
            _ => (format!("expected a whole number: {}", format.version()), Some(node)),
        },
    };
    let mut error = source.error(message);
    if let Some(node) = given {
        error.0.field = Some("format".into());
        error.0.line = source.has_lines().then_some(node.origin.line);
    }
    Err(error)
}

/// What to change in a file that states no format.
fn missing_format(schema: &Schema, format: &FileFormat, root: &Node) -> String {
    let mut old = Vec::new();
    find_renamed(schema, schema.root(), root, &mut old);
    old.sort_unstable();
    let more = if old.len() > MOST_NAMED { ", and more of the kind" } else { "" };
    let named: Vec<String> = old
        .iter()
        .take(MOST_NAMED)
        .map(|(line, field, now)| format!("line {line}: for `{field}` write {now}"))
        .collect();
    let rest =
        if named.is_empty() { String::new() } else { format!(". Also change {}{more}", named.join("; ")) };
    format!("the file has no `format`; write format = {} as its first line{rest}", format.version())
}

/// Fields of the old form below a node, with their lines.
fn find_renamed<'a>(
    schema: &'a Schema,
    shape: &'a Shape,
    node: &'a Node,
    found: &mut Vec<(usize, &'a str, &'a str)>,
) {
    match &node.content {
        Content::Table(entries) => {
            let Some(table) = schema.table(shape) else { return };
            let variant = table.variant_or_default(node);
            for (key, inner) in entries {
                if let Some(now) = table.renamed(key) {
                    found.push((inner.origin.line, key, now));
                }
                if let Some(shape) = table.shape(variant, key) {
                    find_renamed(schema, shape, inner, found);
                }
            }
        }
        Content::Array(items) => {
            if let Some(shape) = schema.items(shape) {
                items.iter().for_each(|item| find_renamed(schema, shape, item, found));
            }
        }
        Content::Leaf(_) => {}
    }
}
