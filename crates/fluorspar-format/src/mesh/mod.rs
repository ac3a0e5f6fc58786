//! Meshes and their places.

pub(crate) mod gltf;
pub(crate) mod mesh_set;
pub(crate) mod obj;
pub(crate) mod placements;
pub(crate) mod ply;
pub(crate) mod ply_binary;
pub(crate) mod polygon;
pub(crate) mod stl;
