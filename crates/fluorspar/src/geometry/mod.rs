//! Triangle meshes, analytic shapes and transforms, in meters.

mod displacement;
mod film_normals;
mod instances;
mod mesh;
mod oriented_point;
mod ray_intersection;

pub use film_normals::{WetMesh, film_normals};
pub use instances::{InstancesError, MeshInstance, MeshInstances};
pub use mesh::{MeshError, TriangleMesh};
pub use oriented_point::OrientedPoint;
pub(crate) use ray_intersection::{intersect_disc, intersect_plane, intersect_sphere};
