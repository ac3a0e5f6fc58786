//! Triangle meshes, analytic shapes and transforms, in metres.

mod displacement;
mod instances;
mod mesh;
mod ray_intersection;

pub use instances::{InstancesError, MeshInstance, MeshInstances};
pub use mesh::{MeshError, TriangleMesh};
pub(crate) use ray_intersection::{intersect_disc, intersect_plane, intersect_sphere};
