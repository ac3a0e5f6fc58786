//! The name of a light source: of one emitter of a light.

use std::fmt;

/// Name of a light source for messages: that of its light, and which of several emitters it is. It displays as `blue`, or as `blue[3]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LightName {
    light: String,
    emitter: Option<usize>,
}

impl LightName {
    /// One of several emitters of a light, counted from 0.
    #[must_use]
    pub fn of_emitter(light: impl Into<String>, emitter: usize) -> Self {
        Self { light: light.into(), emitter: Some(emitter) }
    }

    /// Name of the light, which its emitters share.
    #[must_use]
    pub fn light(&self) -> &str {
        &self.light
    }
}

impl<T: Into<String>> From<T> for LightName {
    /// A light of a single emitter.
    fn from(light: T) -> Self {
        Self { light: light.into(), emitter: None }
    }
}

impl fmt::Display for LightName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.light)?;
        self.emitter.map_or(Ok(()), |emitter| write!(f, "[{emitter}]"))
    }
}
