//! Triangle meshes, analytic shapes and transforms, in metres.

mod displacement;
mod instances;
mod mesh;

pub use instances::{InstancesError, MeshInstance, MeshInstances};
pub use mesh::{MeshError, TriangleMesh};
