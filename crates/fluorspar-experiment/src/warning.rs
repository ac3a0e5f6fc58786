//! Warnings about an experiment that can be run nevertheless.

use std::fmt;
use std::ops::Deref;

use serde::{Serialize, Serializer};

/// A warning: its whole text, and one short line for those who have no time for it.
///
/// It displays, compares with text and serializes as the whole text.
#[derive(Clone, Debug, PartialEq, Eq)]
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

    /// A warning of one or more sentences, the first of which says what it is about.
    pub fn of_sentences(text: impl Into<String>) -> Self {
        let text = text.into();
        let first = text.split_once(". ").map_or(text.as_str(), |(first, _)| first).to_string();
        Self::summarized(text, first)
    }

    /// All of it: what, where, and how much.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// One line: the text itself, or a shorter line that counts what the text names.
    pub fn summary(&self) -> &str {
        self.summary.as_ref().unwrap_or(&self.text)
    }

    /// Whether the text says more than the summary.
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
