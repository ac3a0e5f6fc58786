//! Warnings: what makes a result doubtful, or an experiment that can be run nevertheless.

use std::fmt;
use std::ops::Deref;

use serde::{Deserialize, Serialize, Serializer};

/// A warning: its whole text, and one short line for those who have no time for it.
///
/// It displays, compares with text and serializes as the whole text, and is read back without a line of its own.
#[derive(Clone, Debug, Eq, Deserialize)]
#[serde(from = "String")]
pub struct Warning {
    text: String,
    summary: Option<String>,
}

impl Warning {
    /// A warning whose text names more than fits on a line, with a line that counts instead. The two may be the same.
    pub fn summarized(text: impl Into<String>, summary: impl Into<String>) -> Self {
        let (text, summary) = (text.into(), summary.into());
        Self { summary: (summary != text).then_some(summary), text }
    }

    /// A statement without its full stop, which is also the line, and sentences on what follows from it or what to do.
    pub fn explained(statement: impl Into<String>, explanation: impl fmt::Display) -> Self {
        let statement = statement.into();
        Self { text: format!("{statement}. {explanation}"), summary: Some(statement) }
    }

    /// The same warning about one of several things: both texts begin with its name.
    #[must_use]
    pub fn about(&self, name: &str) -> Self {
        let named = |text: &String| format!("{name}: {text}");
        Self { text: named(&self.text), summary: self.summary.as_ref().map(named) }
    }

    /// All of it: what, where, and how much.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// One line: the text itself, or a shorter line that counts what the text names.
    #[must_use]
    pub fn summary(&self) -> &str {
        self.summary.as_ref().unwrap_or(&self.text)
    }

    /// Whether the text says more than the summary.
    #[must_use]
    pub fn has_details(&self) -> bool {
        self.summary.is_some()
    }
}

impl From<String> for Warning {
    /// A warning that is short as it is.
    fn from(text: String) -> Self {
        Self { text, summary: None }
    }
}

impl Deref for Warning {
    type Target = str;

    fn deref(&self) -> &str {
        &self.text
    }
}

impl PartialEq for Warning {
    /// The summary follows from the text.
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text
    }
}

impl PartialEq<&str> for Warning {
    fn eq(&self, text: &&str) -> bool {
        self.text == *text
    }
}

impl PartialEq<str> for Warning {
    fn eq(&self, text: &str) -> bool {
        self.text == text
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Serialize for Warning {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.text)
    }
}
