//! Instances: one mesh at many places.

use std::sync::Arc;

use glam::{Affine3, Affine3A, Mat3, Vec3};
use thiserror::Error;

use super::{MeshError, TriangleMesh};

/// A mesh at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshInstance {
    /// Index into [`MeshInstances::meshes`].
    pub mesh: u32,
    /// From the frame of the mesh to that of the scene, m: any affine map that has an inverse. Mirrors keep triangles
    /// facing outward.
    pub to_world: Affine3,
}

/// Meshes, each kept once, at any number of places.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshInstances {
    /// The meshes; those that several objects share are prepared for rendering once.
    pub meshes: Vec<Arc<TriangleMesh>>,
    /// Their placements.
    pub instances: Vec<MeshInstance>,
}

/// An error of instances.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum InstancesError {
    /// There is nothing to intersect.
    #[error("there is no instance of a mesh")]
    Empty,
    /// A mesh is not sound.
    #[error("mesh {mesh}: {source}")]
    Mesh {
        /// Number of the mesh, from 0.
        mesh: usize,
        /// What is wrong with it.
        source: MeshError,
    },
    /// An instance names a mesh that does not exist.
    #[error("instance {instance} places mesh {mesh}, but there are only {count} meshes (numbered from 0)")]
    MeshOutOfRange {
        /// Number of the instance, from 0.
        instance: usize,
        /// The mesh it names.
        mesh: u32,
        /// Number of meshes.
        count: usize,
    },
    /// A transform has no inverse.
    #[error(
        "the transform of instance {instance} (counted from 0) flattens the mesh, or is not finite; give it three axes \
         that span a volume"
    )]
    NotInvertible {
        /// Number of the instance, from 0.
        instance: usize,
    },
}

impl MeshInstance {
    /// Whether the map turns the mesh inside out, so that triangles have to be turned as well to face outward.
    pub fn mirrors(&self) -> bool {
        self.to_world.matrix3.determinant() < 0.0
    }

    /// Whether the map has an inverse, as far as single precision can tell.
    pub fn is_invertible(&self) -> bool {
        fluorspar_accel::is_invertible(&self.to_world)
    }

    /// Map of normals, up to their length: the inverse transpose.
    pub fn normal_map(&self) -> Mat3 {
        // The matrix of cofactors is the inverse transpose times the determinant, and exact where that is small.
        let m = self.to_world.matrix3;
        let cofactors =
            Mat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
        if self.mirrors() { cofactors * -1.0 } else { cofactors }
    }
}

impl MeshInstances {
    /// Checks meshes, indices and transforms.
    ///
    /// # Errors
    /// The first defect found.
    pub fn validate(&self) -> Result<(), InstancesError> {
        if self.instances.is_empty() {
            return Err(InstancesError::Empty);
        }
        for (mesh, triangles) in self.meshes.iter().enumerate() {
            triangles.validate().map_err(|source| InstancesError::Mesh { mesh, source })?;
        }
        let count = self.meshes.len();
        for (instance, place) in self.instances.iter().enumerate() {
            if place.mesh as usize >= count {
                return Err(InstancesError::MeshOutOfRange { instance, mesh: place.mesh, count });
            }
            if !place.is_invertible() {
                return Err(InstancesError::NotInvertible { instance });
            }
        }
        Ok(())
    }

    /// The mesh that an instance places.
    pub fn mesh_of(&self, instance: &MeshInstance) -> &TriangleMesh {
        &self.meshes[instance.mesh as usize]
    }

    /// Triangles of all instances together.
    pub fn triangle_count(&self) -> u64 {
        self.instances.iter().map(|instance| self.mesh_of(instance).triangles.len() as u64).sum()
    }

    /// Corners of all triangles of all instances at their places, m.
    pub fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> + '_ {
        self.instances.iter().flat_map(move |instance| {
            let mesh = self.mesh_of(instance);
            mesh.triangles
                .iter()
                .map(move |t| t.map(|v| instance.to_world.transform_point3(mesh.positions[v as usize])))
        })
    }

    /// Spheres around the instances: centers and radii, m.
    pub fn bounding_spheres(&self) -> impl Iterator<Item = (Vec3, f32)> + '_ {
        let of_mesh = |mesh: &Arc<TriangleMesh>| {
            let (low, high) = mesh.bounds();
            (0.5 * (low + high), 0.5 * (high - low).length())
        };
        let spheres: Vec<(Vec3, f32)> = self.meshes.iter().map(of_mesh).collect();
        self.instances.iter().map(move |instance| {
            let (center, radius) = spheres[instance.mesh as usize];
            let m = instance.to_world.matrix3;
            // The Frobenius norm bounds what the map does to lengths.
            let stretch =
                (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt();
            (instance.to_world.transform_point3(center), radius * stretch)
        })
    }

    /// Smallest and largest corner of a box around all instances; zeros if there are none. The box of a turned instance
    /// may be a little larger than the instance.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let boxes: Vec<(Vec3, Vec3)> = self.meshes.iter().map(|mesh| mesh.bounds()).collect();
        let mut whole: Option<(Vec3, Vec3)> = None;
        for instance in &self.instances {
            let (low, high) = boxes[instance.mesh as usize];
            let (m, half) = (instance.to_world.matrix3, 0.5 * (high - low));
            let center = instance.to_world.transform_point3(0.5 * (low + high));
            let spread = m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z;
            let (low, high) = (center - spread, center + spread);
            whole = Some(whole.map_or((low, high), |(a, b)| (a.min(low), b.max(high))));
        }
        whole.unwrap_or_default()
    }

    /// All instances as one mesh, triangle by triangle. Where only some of the meshes have normals, the others get zeros
    /// (facets); where only some have texture coordinates, the others get zeros, too.
    pub fn flattened(&self) -> TriangleMesh {
        let any = |has: fn(&TriangleMesh) -> bool| self.meshes.iter().any(|mesh| has(mesh));
        let (normals, uvs) = (any(|mesh| !mesh.normals.is_empty()), any(|mesh| !mesh.uvs.is_empty()));
        let mut whole = TriangleMesh::default();
        for instance in &self.instances {
            let mut mesh = self.mesh_of(instance).clone();
            if normals {
                mesh.normals.resize(mesh.positions.len(), Vec3::ZERO);
            }
            if uvs {
                mesh.uvs.resize(mesh.positions.len(), glam::Vec2::ZERO);
            }
            let Affine3 { matrix3, translation, .. } = instance.to_world;
            mesh.transform(&Affine3A::from_mat3_translation(matrix3, translation));
            whole.append(&mesh);
        }
        whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner() -> Arc<TriangleMesh> {
        let mut mesh = TriangleMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
            triangles: vec![[0, 1, 2], [0, 3, 1]],
            ..TriangleMesh::default()
        };
        mesh.compute_smooth_normals();
        Arc::new(mesh)
    }

    #[test]
    fn flattened_instances_have_their_bounds_and_outward_normals() {
        let maps = [
            Affine3::from_translation(Vec3::new(2.0, 0.0, 0.0)),
            Affine3::from_scale(Vec3::new(-1.0, 2.0, 0.5)),
            Affine3::from_rotation_x(0.7) * Affine3::from_scale(Vec3::new(1.0, -3.0, 1.0)),
        ];
        let instances = maps.map(|to_world| MeshInstance { mesh: 0, to_world }).to_vec();
        let many = MeshInstances { meshes: vec![corner()], instances };
        many.validate().unwrap();
        let flat = many.flattened();
        assert_eq!((flat.triangles.len() as u64, many.triangle_count()), (6, 6));
        let (low, high) = many.bounds();
        let (tight_low, tight_high) = flat.bounds();
        assert!((low - tight_low).max_element() < 1e-6 && (tight_high - high).max_element() < 1e-6);
        for (number, instance) in many.instances.iter().enumerate() {
            for (vertex, normal) in many.meshes[0].normals.iter().enumerate() {
                let mapped = (instance.normal_map() * *normal).normalize();
                assert!((mapped - flat.normals[4 * number + vertex]).length() < 1e-6);
            }
        }
        for triangle in &flat.triangles {
            // The smooth normal of a corner leans to the side of each of its triangles.
            assert!(flat.triangle_cross(triangle).dot(flat.normals[triangle[0] as usize]) > 0.0);
        }
        for ((center, radius), chunk) in many.bounding_spheres().zip(flat.positions.chunks(4)) {
            assert!(chunk.iter().all(|p| (*p - center).length() <= radius * (1.0 + 1e-6)));
        }
    }

    #[test]
    fn defects_are_named() {
        let with = |mesh, to_world| {
            let instances = vec![MeshInstance { mesh, to_world }];
            MeshInstances { meshes: vec![corner()], instances }.validate()
        };
        assert_eq!(with(0, Affine3::IDENTITY), Ok(()));
        assert!(matches!(with(1, Affine3::IDENTITY), Err(InstancesError::MeshOutOfRange { count: 1, .. })));
        let flat = Affine3::from_scale(Vec3::new(1.0, 0.0, 1.0));
        assert_eq!(with(0, flat), Err(InstancesError::NotInvertible { instance: 0 }));
        assert_eq!(MeshInstances::default().validate(), Err(InstancesError::Empty));
    }
}
