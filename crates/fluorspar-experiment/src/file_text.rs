//! Files as text.

use serde::Serialize;

/// Sections as the text of a TOML file.
///
/// They become a tree of values first: writers of text are compiled for the types of that tree alone, not for those of all sections,
/// which takes a tenth less time and machine code.
///
/// # Errors
/// What TOML can't hold: a key that is no text, a number beyond 64 bits.
pub fn file_text(sections: &impl Serialize) -> Result<String, toml::ser::Error> {
    toml::to_string(&toml::Value::try_from(sections)?)
}
