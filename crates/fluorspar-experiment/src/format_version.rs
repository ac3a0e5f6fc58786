//! The version of the form of a file, and the spellings of files from before there was one.

use super::document::{Content, Node, Source};
use super::error::{ExperimentError, Place, Step};
use super::schema::FormatVersion;

/// Fields that were written in another way before format 1: the section and the field (`*` for any), and what to write now.
const RENAMED: [(&str, &str, &str); 32] = [
    ("light", "power_mw", "strength.power_mw"),
    ("light", "irradiance_w_per_m2", "strength.irradiance_w_per_m2"),
    ("light", "at_distance_mm", "strength.at_distance_mm"),
    ("light", "radiance_w_per_sr_m2", "strength.radiance_w_per_sr_m2"),
    ("light", "measured", "strength.measured"),
    ("light", "direction", "aim.direction"),
    ("light", "look_at_mm", "aim.look_at_mm"),
    ("light", "map_rotation_deg", "map = { file = \"...\", rotation_deg = ... }"),
    ("object", "mesh", "type = \"mesh\" and file = \"...\""),
    ("object", "sphere", "type = \"sphere\" and its fields in the object itself"),
    ("object", "quad", "type = \"quad\" and its fields in the object itself"),
    ("object", "disc", "type = \"disc\" and its fields in the object itself"),
    ("object", "box", "type = \"box\" and its fields in the object itself"),
    ("material", "dielectric", "type = \"dielectric\" and its fields in the material itself"),
    ("material", "conductor", "type = \"conductor\" and its fields in the material itself"),
    ("material", "mix", "type = \"mix\" and its fields in the material itself"),
    ("material", "two_sided", "type = \"two_sided\" and its fields in the material itself"),
    ("conductor", "n", "metal = { n = ..., k = ... }"),
    ("conductor", "k", "metal = { n = ..., k = ... }"),
    ("material", "n", "metal = { n = ..., k = ... }"),
    ("material", "k", "metal = { n = ..., k = ... }"),
    ("fluorophore", "from", "source = \"...\""),
    ("fluorophore", "csv", "source = { csv = \"...\" }"),
    ("fluorophore", "eem_csv", "source = { eem_csv = \"...\" }"),
    ("fluorophore", "mat", "source = { mat = \"...\" }"),
    ("fluorophore", "excitation_csv", "source = { excitation_csv = \"...\", emission_csv = \"...\" }"),
    ("fluorophore", "emission_csv", "source = { excitation_csv = \"...\", emission_csv = \"...\" }"),
    ("fluorophore", "unit", "source = { ..., unit = \"...\" }"),
    ("analysis", "bulk_material", "bulk = \"...\""),
    ("mode", "kind", "type"),
    ("shutter", "kind", "type"),
    ("*", "kind", "type"),
];

/// Largest number of old spellings in a message.
const MOST_NAMED: usize = 6;

/// Replacement of a field that was written otherwise before format 1.
pub(super) fn renamed(table: &Place, field: &str) -> Option<&'static str> {
    let section = table.iter().rev().find_map(|step| match step {
        Step::Key(key) => Some(key.as_str()),
        Step::Index(_) => None,
    });
    now(section.unwrap_or_default(), field)
}

fn now(section: &str, field: &str) -> Option<&'static str> {
    let fits = |(of, name, _): &&(&str, &str, &str)| *name == field && (*of == section || *of == "*");
    RENAMED.iter().find(fits).map(|(_, _, now)| *now)
}

/// Refuses a file that does not say `format = 1`. The message names what its owner has to change.
///
/// # Errors
/// A format that is absent or another one.
pub(super) fn check_format(root: &Node, source: &Source) -> Result<(), ExperimentError> {
    let current = FormatVersion::CURRENT;
    let given = match root.get("format") {
        Some(node) if node.content == Content::Leaf(toml::Value::Integer(current)) => return Ok(()),
        given => given,
    };
    let message = match given {
        Some(_) => format!("must be {current}, the only format that this program reads"),
        None => {
            let mut old = Vec::new();
            find_renamed("", root, &mut old);
            old.sort_unstable();
            let more = if old.len() > MOST_NAMED { ", and more of the kind" } else { "" };
            let named: Vec<String> = old
                .iter()
                .take(MOST_NAMED)
                .map(|(line, field, now)| format!("line {line}: for `{field}` write {now}"))
                .collect();
            let rest = if named.is_empty() {
                String::new()
            } else {
                format!(". Also change {}{more}", named.join("; "))
            };
            format!("the file has no `format`; write format = {current} as its first line{rest}")
        }
    };
    let mut error = ExperimentError::in_source(&source.name, message);
    if let Some(node) = given {
        error.0.field = Some("format".into());
        error.0.line = source.has_lines.then_some(node.origin.line);
    }
    Err(error)
}

/// Fields of the old form below a node, with their lines.
fn find_renamed(section: &str, node: &Node, found: &mut Vec<(usize, String, &'static str)>) {
    match &node.content {
        Content::Table(entries) => {
            for (key, inner) in entries {
                if let Some(now) = now(section, key) {
                    found.push((inner.origin.line, key.clone(), now));
                }
                find_renamed(key, inner, found);
            }
        }
        Content::Array(items) => items.iter().for_each(|item| find_renamed(section, item, found)),
        Content::Leaf(_) => {}
    }
}
