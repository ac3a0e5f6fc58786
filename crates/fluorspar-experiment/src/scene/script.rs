//! Scripts of changes: files that are replayed on any scene, and compared line by line.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::change::scene_change::SceneChange;
use crate::error::ExperimentError;
use crate::read::read_sections;
use crate::schema::FormatVersion;
use fluorspar_format::{WRITTEN_BY, read_toml};

/// A script: changes in their order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct ScriptFile {
    /// Version of the form of this file: 1.
    format: FormatVersion,
    /// The changes, in this order.
    #[serde(default)]
    change: Vec<ChangeSection>,
}

/// One change: exactly one of `set`, `insert` and `delete`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
enum ChangeSection {
    /// A value takes the place of another one.
    Set(SetSection),
    /// An entry is added to a list.
    Insert(InsertSection),
    /// Something is removed.
    Delete(DeleteSection),
}

/// A value takes the place of another one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct SetSection {
    /// Path of what is set.
    set: String,
    /// Its value, as it would be typed: a number, a text, a list, a table.
    value: AnyValue,
}

/// An entry is added to a list.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct InsertSection {
    /// List and name of an entry that is added.
    insert: String,
    /// Its value, as it would be typed: a table.
    value: AnyValue,
}

/// Something is removed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct DeleteSection {
    /// Path of what is removed.
    delete: String,
}

impl From<ChangeSection> for SceneChange {
    fn from(section: ChangeSection) -> Self {
        match section {
            ChangeSection::Set(SetSection { set: path, value }) => {
                Self::Set { path, value: value.0.to_string() }
            }
            ChangeSection::Insert(InsertSection { insert: path, value }) => {
                Self::Insert { path, value: value.0.to_string() }
            }
            ChangeSection::Delete(DeleteSection { delete: path }) => Self::Delete { path },
        }
    }
}

/// Whatever TOML can hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
struct AnyValue(toml::Value);

impl JsonSchema for AnyValue {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "AnyValue".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "description": "Any value." })
    }
}

/// Reads a script of changes.
///
/// # Errors
/// The first defect found, with its line.
pub fn parse_script(text: &str, source_name: &str) -> Result<Vec<SceneChange>, ExperimentError> {
    let (_, file) = read_sections::<ScriptFile>(text, source_name, Path::new(""), &[])?;
    Ok(file.change.into_iter().map(SceneChange::from).collect())
}

/// A script as text.
pub fn script_text(changes: &[SceneChange]) -> String {
    let mut text = format!(
        "# Changes of a scene, {WRITTEN_BY}: fluorspar scene set SCENE --script THIS_FILE --out NEW.toml\nformat = 1\n"
    );
    for change in changes {
        let (key, path, value) = match change {
            SceneChange::Set { path, value } => ("set", path, Some(value)),
            SceneChange::Insert { path, value } => ("insert", path, Some(value)),
            SceneChange::Delete { path } => ("delete", path, None),
        };
        text.push_str(&format!("\n[[change]]\n{key} = {}\n", toml::Value::String(path.clone())));
        if let Some(value) = value {
            text.push_str(&format!("value = {}\n", typed_value(value)));
        }
    }
    text
}

/// A value as TOML: as it was typed where that is TOML, else as a text.
fn typed_value(typed: &str) -> String {
    let is_toml = !typed.contains('\n')
        && read_toml::<toml::Table>(&format!("value = {typed}")).is_ok_and(|table| table.len() == 1);
    if is_toml { typed.into() } else { toml::Value::String(typed.into()).to_string() }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "these are tests")]

    use super::*;

    #[test]
    fn scripts_come_back() {
        let set = |path: &str, value: &str| SceneChange::Set { path: path.into(), value: value.into() };
        let changes = vec![
            set("light.blue.strength.power_mw", "20.5"),
            set("tooth_*/material", "\"white\""),
            set("mouth.lesion.\"a b\".size_mm", "[1.0, 2.0]"),
            SceneChange::Insert {
                path: "object.ball".into(),
                value: "{ type = \"sphere\", radius_mm = 2.0 }".into(),
            },
            SceneChange::Delete { path: "light.room".into() },
        ];
        let text = script_text(&changes);
        assert_eq!(parse_script(&text, "s.toml").unwrap(), changes, "{text}");
        // What was typed without quotes is a text.
        let text = script_text(&[set("title", "two words")]);
        assert_eq!(parse_script(&text, "s.toml").unwrap(), [set("title", "\"two words\"")]);
    }

    #[test]
    fn mistakes_in_scripts_are_told_with_their_line() {
        let cases = [
            ("[[change]]\nset = \"a\"\n", "s.toml:2: change[0]: `set` needs the field `value`; add it"),
            (
                "[[change]]\ndelete = \"a\"\nvalue = 1\n",
                "`delete` and `value` exclude each other: `value` goes with `set` or `insert`; remove one of them",
            ),
            ("[[change]]\nvalue = 1\n", "give exactly one of set, insert, delete"),
            ("[[change]]\nset = \"a\"\ndelete = \"a\"\n", "give exactly one of set, insert, delete"),
            ("[[change]]\nput = 1\n", "put"),
            ("change = 3\n", "change"),
        ];
        for (text, words) in cases {
            let said = parse_script(&format!("format = 1\n{text}"), "s.toml").unwrap_err().to_string();
            assert!(said.contains(words), "{words}: {said}");
        }
        assert!(parse_script("", "s.toml").unwrap_err().to_string().contains("format = 1"));
    }
}
