//! The text of a file as a tree that knows its lines, and how it fits the types of an experiment.

pub(crate) mod fit;
pub(crate) mod format_version;
pub(crate) mod merge;
pub(crate) mod shape;
pub(crate) mod tree;
