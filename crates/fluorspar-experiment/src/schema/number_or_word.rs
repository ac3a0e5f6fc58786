//! Values that are a number or a word.

use serde::{Deserialize, Serialize};

/// A number, or a word in its place, as a file has it.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum NumberOrWord {
    Number(f64),
    Word(String),
}

impl NumberOrWord {
    /// The number; `None` of the word that may stand in its place.
    pub(super) fn number(self, word: &str) -> Result<Option<f64>, String> {
        match self {
            Self::Number(value) => Ok(Some(value)),
            Self::Word(text) if text == word => Ok(None),
            Self::Word(_) => Err(format!("expected a number or \"{word}\"")),
        }
    }
}
