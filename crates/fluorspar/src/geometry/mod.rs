//! Triangle meshes, analytic shapes and transforms, in metres.

mod mesh;

pub use mesh::{MeshError, TriangleMesh};
