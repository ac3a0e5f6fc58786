//! One change of a scene: its path, its value, what it does to the tree.

pub(crate) mod scene_change;
pub(crate) mod scene_parts;
pub(crate) mod scene_path;
