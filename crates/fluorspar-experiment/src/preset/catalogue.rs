//! Finding embedded files by kind and name.

use fluorspar::quote::excerpt;
use std::fmt;

use include_dir::{Dir, include_dir};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

use fluorspar::names::{nearest_name, suggestion};

static DATA: Dir<'static> = include_dir!("$CARGO_MANIFEST_DIR/data");

/// Kind of an entry of the catalogue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PresetKind {
    /// Relative spectral power of a light source.
    Light,
    /// Spectral transmittance of a filter.
    Filter,
    /// Diffuse spectral reflectance of a surface.
    Reflectance,
    /// Complex refractive index of a metal.
    Metal,
    /// Electrons per photon of the channels of a sensor.
    QuantumEfficiency,
    /// Geometry and electronics of a sensor.
    Sensor,
    /// Excitation-emission matrix of a fluorophore.
    Fluorophore,
    /// Refractive index of a lens material.
    Glass,
    /// A lens: surfaces, glasses, stop.
    Lens,
    /// A complete experiment.
    Experiment,
    /// A flat sample without geometry.
    Sample,
    /// A design problem.
    Design,
}

impl PresetKind {
    /// Every kind.
    pub const ALL: [Self; 12] = [
        Self::Light,
        Self::Filter,
        Self::Reflectance,
        Self::Metal,
        Self::QuantumEfficiency,
        Self::Sensor,
        Self::Fluorophore,
        Self::Glass,
        Self::Lens,
        Self::Experiment,
        Self::Sample,
        Self::Design,
    ];

    fn folder(self) -> &'static str {
        match self {
            Self::Light => "lights",
            Self::Filter => "filters",
            Self::Reflectance => "reflectances",
            Self::Metal => "metals",
            Self::QuantumEfficiency => "qe",
            Self::Sensor => "sensors",
            Self::Fluorophore => "fluorophores",
            Self::Glass => "glasses",
            Self::Lens => "lenses",
            Self::Experiment => "experiments",
            Self::Sample => "samples",
            Self::Design => "designs",
        }
    }
}

impl fmt::Display for PresetKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Light => "light spectrum",
            Self::Filter => "filter",
            Self::Reflectance => "reflectance",
            Self::Metal => "metal",
            Self::QuantumEfficiency => "quantum efficiency",
            Self::Sensor => "sensor",
            Self::Fluorophore => "fluorophore",
            Self::Glass => "glass",
            Self::Lens => "lens",
            Self::Experiment => "experiment",
            Self::Sample => "flat sample",
            Self::Design => "design problem",
        })
    }
}

/// Why an entry of the catalogue can't be had.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum PresetError {
    /// There is no such entry.
    #[error("there is no {kind} \"{}\"{} Known: {}", excerpt(.name), suggestion(.nearest.as_deref()), .available.join(", "))]
    Unknown {
        /// The requested value.
        kind: PresetKind,
        /// The requested name.
        name: String,
        /// The most similar name, if one is similar.
        nearest: Option<String>,
        /// All names.
        available: Vec<String>,
    },
    /// An embedded file is damaged: a defect of this program.
    #[error("the built-in file {file} is damaged: {message}")]
    Damaged {
        /// Its name.
        file: String,
        /// What is wrong.
        message: String,
    },
}

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

/// Names of all entries of a kind, sorted.
pub fn names(kind: PresetKind) -> Vec<&'static str> {
    let Some(folder) = DATA.get_dir(kind.folder()) else { return Vec::new() };
    let mut names: Vec<&str> =
        folder.files().filter_map(|file| file.path().file_name()?.to_str()?.strip_suffix(".toml")).collect();
    names.sort_unstable();
    names
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

/// Text of the embedded file of an entry.
pub(super) fn text(kind: PresetKind, name: &str) -> Result<&'static str, PresetError> {
    let file = format!("{}/{name}.toml", kind.folder());
    let found = names(kind).contains(&name).then(|| DATA.get_file(&file)).flatten();
    let Some(found) = found else {
        let available: Vec<String> = names(kind).into_iter().map(String::from).collect();
        let nearest = nearest_name(name, available.iter().map(String::as_str)).map(String::from);
        return Err(PresetError::Unknown { kind, name: name.into(), nearest, available });
    };
    found.contents_utf8().ok_or_else(|| PresetError::Damaged { file, message: "it is not UTF-8".into() })
}

/// The embedded file of an entry as a typed value.
pub(super) fn parse<T: DeserializeOwned>(kind: PresetKind, name: &str) -> Result<T, PresetError> {
    toml::from_str(text(kind, name)?).map_err(|error| damaged(kind, name, error.to_string()))
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
            message.starts_with("there is no light spectrum \"led385\", did you mean \"led_385\"? Known: ")
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
