//! Errors of experiments, with hints.

use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;
use std::fmt;

use thiserror::Error;

/// A defect of an experiment file or of an override: where it is, what is wrong, how to fix it.
///
/// Displayed as `my.toml:12: light[1] "blue": power_mw = -3: must be between 1e-12 and 1e12 milliwatts per
/// emitter`.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub struct ExperimentError(pub(super) Box<ErrorDetails>);

/// The parts of an [`ExperimentError`], for editors and user interfaces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ErrorDetails {
    /// File or override that holds the defect, as it is to be shown.
    pub source_name: String,
    /// The override, where one holds the defect.
    pub blamed_override: Option<BlamedOverride>,
    /// Line in that file, from 1; `None` for an override and for what belongs to no line.
    pub line: Option<usize>,
    /// The entry of a list that holds the field, for instance `light[1] "blue"`.
    pub entry: Option<String>,
    /// The field within its entry, or its full path outside lists.
    pub field: Option<String>,
    /// The whole path of what is wrong as changes write it, entries of lists by their names: `light.blue.strength.power_mw`. Of a field
    /// that is missing or unknown it ends with that; `None` where the defect is of no field.
    pub path: Option<String>,
    /// The value as given, shortened.
    pub value: Option<String>,
    /// What is wrong and how to fix it.
    pub message: String,
    /// The names that could stand there, where a name is wrong; the message ends with them.
    pub known: Vec<String>,
    /// Where relative paths start, if a path may be written wrongly; ends the message.
    pub paths_from: Option<PathsFrom>,
}

/// An override that holds a defect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlamedOverride {
    /// Its number among the overrides, from 0.
    pub number: usize,
    /// Whether the field is the one that the override sets, or below it.
    pub sets_field: bool,
}

/// Where relative paths start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathsFrom {
    /// At the folder of the experiment file.
    ExperimentFile,
    /// At the folder where the program runs.
    WorkingFolder,
}

impl fmt::Display for PathsFrom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ExperimentFile => "paths are relative to the experiment file",
            Self::WorkingFolder => "paths are relative to where the program runs",
        })
    }
}

impl ExperimentError {
    /// The parts of the message.
    pub fn details(&self) -> &ErrorDetails {
        &self.0
    }

    pub(super) fn at_line(mut self, line: usize) -> Self {
        self.0.line = Some(line);
        self
    }

    pub(super) fn with_paths_from(mut self, paths_from: PathsFrom) -> Self {
        self.0.paths_from = Some(paths_from);
        self
    }

    /// The same error, of what a person wrote as a path, unless it is known more closely.
    pub(super) fn about(mut self, path: &str) -> Self {
        self.0.path.get_or_insert_with(|| excerpt(path));
        self
    }

    /// The same error without the value, where the message says it all.
    pub(super) fn without_value(mut self) -> Self {
        self.0.value = None;
        self
    }
}

impl From<ErrorDetails> for ExperimentError {
    /// An error from its parts, for front ends that have other names for them.
    fn from(details: ErrorDetails) -> Self {
        Self(Box::new(details))
    }
}

impl fmt::Display for ExperimentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let details = self.details();
        f.write_str(&details.source_name)?;
        if let Some(line) = details.line {
            write!(f, ":{line}")?;
        }
        f.write_str(": ")?;
        if let Some(entry) = &details.entry {
            write!(f, "{entry}: ")?;
        }
        match (&details.field, &details.value) {
            (Some(field), Some(value)) => write!(f, "{field} = {value}: ")?,
            (Some(field), None) => write!(f, "{field}: ")?,
            _ => {}
        }
        f.write_str(&details.message)?;
        match details.paths_from {
            Some(paths_from) => write!(f, "; {paths_from}"),
            None => Ok(()),
        }
    }
}

/// What is wrong and how to fix it, and the names that could stand there.
#[derive(Clone, Debug)]
pub(crate) struct Message {
    pub(crate) text: String,
    pub(crate) known: Vec<String>,
}

impl Message {
    /// `what` is wrong with a name: the message goes on with the nearest of those that are known, and with all of them.
    pub(crate) fn unknown<'a>(
        what: impl fmt::Display,
        name: &str,
        known: impl IntoIterator<Item = &'a str>,
    ) -> Self {
        let known: Vec<&str> = known.into_iter().collect();
        let hint = did_you_mean(name, known.iter().copied());
        Self::with_known(format!("{what}{hint}"), known)
    }

    /// A message that ends with names that could stand there.
    pub(crate) fn with_known<'a>(text: impl fmt::Display, known: impl IntoIterator<Item = &'a str>) -> Self {
        let known: Vec<String> = known.into_iter().map(excerpt).collect();
        let all = if known.is_empty() { "none".into() } else { known.join(", ") };
        Self { text: format!("{text} Known: {all}"), known }
    }
}

impl From<String> for Message {
    fn from(text: String) -> Self {
        Self { text, known: Vec::new() }
    }
}

impl From<&str> for Message {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

/// One step of a path through an experiment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// A key of a table.
    Key(String),
    /// An entry of a list, from 0.
    Index(usize),
}

impl From<&str> for Step {
    fn from(key: &str) -> Self {
        Self::Key(key.into())
    }
}

impl From<&String> for Step {
    fn from(key: &String) -> Self {
        Self::Key(key.clone())
    }
}

impl From<usize> for Step {
    fn from(index: usize) -> Self {
        Self::Index(index)
    }
}

/// A place in an experiment: the steps to it from the root. Every field and entry below it is one call away:
/// `at.field("gloss").field("roughness")`, `at.index(2)`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Place(Vec<Step>);

impl Place {
    /// A field of this table.
    pub(super) fn field(&self, key: impl Into<String>) -> Self {
        self.then(Step::Key(key.into()))
    }

    /// An entry of this list, from 0.
    pub(super) fn index(&self, index: usize) -> Self {
        self.then(Step::Index(index))
    }

    /// The value at a path of keys separated by dots, such as `bands.0.weight` of an equation.
    pub(super) fn fields(&self, path: &str) -> Self {
        path.split('.').fold(self.clone(), |place, key| place.field(key))
    }

    fn then(&self, step: Step) -> Self {
        let mut steps = self.0.clone();
        steps.push(step);
        Self(steps)
    }
}

impl From<Vec<Step>> for Place {
    fn from(steps: Vec<Step>) -> Self {
        Self(steps)
    }
}

impl std::ops::Deref for Place {
    type Target = [Step];

    fn deref(&self) -> &[Step] {
        &self.0
    }
}

/// A place from keys and indices: `steps!["light", 1, "power_mw"]`.
macro_rules! steps {
    ($($step:expr),* $(,)?) => {
        $crate::error::Place::from(Vec::from([$($crate::error::Step::from($step)),*]))
    };
}
pub(super) use steps;

/// A path as text: `light[1].strength.power_mw`.
pub(super) fn path_text(path: &[Step]) -> String {
    let mut text = String::new();
    for step in path {
        match step {
            Step::Key(key) if text.is_empty() => text.push_str(&excerpt(key)),
            Step::Key(key) => {
                text.push('.');
                text.push_str(&excerpt(key));
            }
            Step::Index(index) => text.push_str(&format!("[{index}]")),
        }
    }
    text
}

/// A name as a step of a path: quoted where it has signs that mean something there.
pub(super) fn step_text(name: &str) -> String {
    if name.is_empty() || name.contains(['.', '[', ']', '=', '/', '*', '?', ' ']) {
        format!("\"{name}\"")
    } else {
        name.into()
    }
}
