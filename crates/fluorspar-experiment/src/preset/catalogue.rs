//! Finding embedded files by kind and name.

use include_dir::{Dir, include_dir};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use fluorspar::names::nearest_name;
use fluorspar_format::read_toml;

use super::kind::{PresetError, PresetKind};
use super::user_entries::{user_entry, user_names};

static DATA: Dir<'static> = include_dir!("$CARGO_MANIFEST_DIR/data");

/// An entry of the catalogue in a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PresetSummary {
    /// Kind of the entry.
    pub kind: PresetKind,
    /// Name by which files refer to it.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Description and caveats.
    pub description: String,
    /// Where the numbers come from.
    pub source: String,
}

/// The fields that all embedded files share; the others are left to the loader of each kind.
#[derive(Deserialize)]
struct Heading {
    title: String,
    description: String,
    #[serde(default)]
    source: String,
}

/// Names of all entries of a kind, sorted, those of the user's catalogue included.
pub fn names(kind: PresetKind) -> Vec<&'static str> {
    let mut names = built_in_names(kind);
    names.extend(user_names(kind));
    names.sort_unstable();
    names
}

/// Names of the embedded entries of a kind.
pub(super) fn built_in_names(kind: PresetKind) -> Vec<&'static str> {
    let Some(folder) = DATA.get_dir(kind.folder()) else { return Vec::new() };
    folder.files().filter_map(|file| file.path().file_name()?.to_str()?.strip_suffix(".toml")).collect()
}

/// All entries of a kind, sorted by name.
///
/// # Errors
/// When an embedded file is damaged.
pub fn list(kind: PresetKind) -> Result<Vec<PresetSummary>, PresetError> {
    names(kind)
        .into_iter()
        .map(|name| {
            let Heading { title, description, source } = parse(kind, name)?;
            Ok(PresetSummary { kind, name: name.into(), title, description, source })
        })
        .collect()
}

/// Text of the file of an entry, comments included.
///
/// # Errors
/// When there is no such entry.
pub fn text(kind: PresetKind, name: &str) -> Result<&'static str, PresetError> {
    if let Some(entry) = user_entry(kind, name) {
        return Ok(&entry.text);
    }
    let file = format!("{}/{name}.toml", kind.folder());
    let found = names(kind).contains(&name).then(|| DATA.get_file(&file)).flatten();
    let Some(found) = found else {
        let available: Vec<String> = names(kind).into_iter().map(String::from).collect();
        let nearest = nearest_name(name, available.iter().map(String::as_str)).map(String::from);
        return Err(PresetError::Unknown { kind, name: name.into(), nearest, available });
    };
    found.contents_utf8().ok_or_else(|| PresetError::Damaged { file, message: "it is not UTF-8".into() })
}

/// The file of an entry as a typed value.
pub(super) fn parse<T: DeserializeOwned>(kind: PresetKind, name: &str) -> Result<T, PresetError> {
    parse_text(kind, name, text(kind, name)?)
}

/// The text of the file of an entry as a typed value.
pub(super) fn parse_text<T: DeserializeOwned>(
    kind: PresetKind,
    name: &str,
    text: &str,
) -> Result<T, PresetError> {
    read_toml(text).map_err(|error| damaged(kind, name, error.to_string()))
}

pub(super) fn damaged(kind: PresetKind, name: &str, message: impl Into<String>) -> PresetError {
    PresetError::Damaged { file: format!("{}/{name}.toml", kind.folder()), message: message.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelled_name_is_answered_with_the_nearest_one() {
        let error = text(PresetKind::Light, "led385").unwrap_err();
        let PresetError::Unknown { nearest, available, .. } = &error else { panic!("{error}") };
        assert_eq!(nearest.as_deref(), Some("led_385"));
        assert!(available.len() >= 10);
        let message = error.to_string();
        assert!(
            message.starts_with("there is no light spectrum \"led385\"; did you mean \"led_385\"? Known: ")
        );
        assert!(text(PresetKind::Light, "../lights/led_385").is_err());
    }

    #[test]
    fn every_list_is_complete() {
        for kind in PresetKind::ALL {
            let entries = list(kind).unwrap();
            assert!(!entries.is_empty(), "{kind}");
            for entry in entries {
                assert!(!entry.title.is_empty() && !entry.description.is_empty(), "{kind} {}", entry.name);
            }
        }
    }
}
