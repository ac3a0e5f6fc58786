//! Kinds of entries of the catalogue, and why an entry can't be had.

use std::fmt;
use std::path::PathBuf;

use crate::error::Message;
use fluorspar::names::suggestion;
use fluorspar::quote::excerpt;
use thiserror::Error;

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
    /// A tissue with its parameters.
    Site,
    /// A state of tissue, a lesion for instance.
    State,
    /// A complete experiment.
    Experiment,
    /// A flat sample without geometry.
    Sample,
    /// A design problem.
    Design,
}

impl PresetKind {
    /// Every kind.
    pub const ALL: [Self; 14] = [
        Self::Light,
        Self::Filter,
        Self::Reflectance,
        Self::Metal,
        Self::QuantumEfficiency,
        Self::Sensor,
        Self::Fluorophore,
        Self::Glass,
        Self::Lens,
        Self::Site,
        Self::State,
        Self::Experiment,
        Self::Sample,
        Self::Design,
    ];

    /// Folder of its files, and what one entry is called.
    fn names(self) -> [&'static str; 2] {
        match self {
            Self::Light => ["lights", "light spectrum"],
            Self::Filter => ["filters", "filter"],
            Self::Reflectance => ["reflectances", "reflectance"],
            Self::Metal => ["metals", "metal"],
            Self::QuantumEfficiency => ["qe", "quantum efficiency"],
            Self::Sensor => ["sensors", "sensor"],
            Self::Fluorophore => ["fluorophores", "fluorophore"],
            Self::Glass => ["glasses", "glass"],
            Self::Lens => ["lenses", "lens"],
            Self::Site => ["sites", "tissue"],
            Self::State => ["states", "state of tissue"],
            Self::Experiment => ["experiments", "experiment"],
            Self::Sample => ["samples", "flat sample"],
            Self::Design => ["designs", "design problem"],
        }
    }

    pub(crate) fn folder(self) -> &'static str {
        self.names()[0]
    }
}

impl fmt::Display for PresetKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.names()[1])
    }
}

impl From<PresetError> for Message {
    fn from(error: PresetError) -> Self {
        let text = error.to_string();
        let known = match error {
            PresetError::Unknown { available, .. } => available,
            _ => Vec::new(),
        };
        Self { text, known }
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
    /// A file of the user's catalogue can't be used.
    #[error("{}: {message}", .path.display())]
    User {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
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
