//! Scenes by name: what they hold, edits of their files, scripts of changes.

pub(crate) mod edit;
pub(crate) mod script;
pub(crate) mod tree;
