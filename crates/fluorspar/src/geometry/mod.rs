//! Triangle meshes, analytic shapes and transforms, in metres.

mod displacement;
mod mesh;

pub use mesh::{MeshError, TriangleMesh};
