//! Indexed triangle meshes.

use std::fmt;

use glam::{Affine3A, Vec2, Vec3};
use thiserror::Error;

use crate::digest::sha256_of_words;

/// An indexed triangle mesh, in meters, right-handed; counter-clockwise triangles face outward.
#[derive(Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions, m.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, one per vertex; empty when the mesh is faceted.
    pub normals: Vec<Vec3>,
    /// Texture coordinates in `[0, 1]`, one per vertex; empty when the mesh has none.
    pub uvs: Vec<Vec2>,
    /// Three vertex numbers per triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// Numbers of vertices and triangles, and a digest of all their values: meshes are large, and equal ones read the same.
impl fmt::Debug for TriangleMesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let vectors = self.positions.iter().chain(&self.normals).flat_map(|vector| vector.to_array());
        let uvs = self.uvs.iter().flat_map(|uv| uv.to_array());
        let numbers = vectors.chain(uvs).map(f32::to_bits);
        f.debug_struct("TriangleMesh")
            .field("vertices", &[self.positions.len(), self.normals.len(), self.uvs.len()])
            .field("triangles", &self.triangles.len())
            .field("sha256", &sha256_of_words(numbers.chain(self.triangles.iter().flatten().copied())))
            .finish()
    }
}

/// An error of a mesh.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MeshError {
    /// There is nothing to intersect.
    #[error("the mesh has no triangles")]
    Empty,
    /// A triangle names a vertex that does not exist.
    #[error(
        "triangle {triangle} uses vertex {vertex}, but the mesh has only {count} vertices (numbered from 0)"
    )]
    VertexOutOfRange {
        /// Triangle number, from 0.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite: {value:?}")]
    NotFinite {
        /// Vertex number, from 0.
        vertex: usize,
        /// Its position.
        value: Vec3,
    },
    /// Normals or texture coordinates do not match the vertices.
    #[error("the mesh has {count} {what} for {expected} vertices; give one per vertex or none")]
    CountMismatch {
        /// "normals" or "texture coordinates".
        what: &'static str,
        /// Given number.
        count: usize,
        /// Number of vertices.
        expected: usize,
    },
}

impl TriangleMesh {
    /// A parallelogram of two triangles, from a corner, m, and two edges, m. It faces to the side of `edge_u x edge_v`;
    /// texture coordinates run along the edges.
    pub fn quad(corner: Vec3, edge_u: Vec3, edge_v: Vec3) -> Self {
        let mut mesh = Self::default();
        mesh.add_quad(corner, edge_u, edge_v);
        mesh
    }

    /// Adds a parallelogram as [`TriangleMesh::quad`] makes it to a mesh without normals.
    pub fn add_quad(&mut self, corner: Vec3, edge_u: Vec3, edge_v: Vec3) {
        let first = self.positions.len() as u32;
        for (u, v) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            self.positions.push(corner + u * edge_u + v * edge_v);
            self.uvs.push(Vec2::new(u, v));
        }
        self.triangles.push([first, first + 1, first + 2]);
        self.triangles.push([first, first + 2, first + 3]);
    }

    /// Checks indices, finiteness and the lengths of the optional attributes.
    ///
    /// # Errors
    /// The first defect found, naming vertex or triangle.
    pub fn validate(&self) -> Result<(), MeshError> {
        if self.triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        for (vertex, &value) in self.positions.iter().enumerate() {
            if !value.is_finite() {
                return Err(MeshError::NotFinite { vertex, value });
            }
        }
        let expected = self.positions.len();
        for (what, count) in [("normals", self.normals.len()), ("texture coordinates", self.uvs.len())] {
            if count != 0 && count != expected {
                return Err(MeshError::CountMismatch { what, count, expected });
            }
        }
        for (triangle, corners) in self.triangles.iter().enumerate() {
            for &vertex in corners {
                if vertex as usize >= expected {
                    return Err(MeshError::VertexOutOfRange { triangle, vertex, count: expected });
                }
            }
        }
        Ok(())
    }

    /// Moves the mesh; normals are transformed by the inverse transpose and renormalized.
    pub fn transform(&mut self, transform: &Affine3A) {
        let normal_matrix = transform.matrix3.inverse().transpose();
        for position in &mut self.positions {
            *position = transform.transform_point3(*position);
        }
        for normal in &mut self.normals {
            *normal = (normal_matrix * *normal).normalize_or_zero();
        }
        if transform.matrix3.determinant() < 0.0 {
            for triangle in &mut self.triangles {
                triangle.swap(1, 2);
            }
        }
    }

    /// Appends another mesh. Attributes that only one of the two has are dropped.
    pub fn append(&mut self, other: &Self) {
        let offset = self.positions.len() as u32;
        let keep_normals =
            (self.positions.is_empty() || !self.normals.is_empty()) && !other.normals.is_empty();
        let keep_uvs = (self.positions.is_empty() || !self.uvs.is_empty()) && !other.uvs.is_empty();
        self.positions.extend_from_slice(&other.positions);
        if keep_normals {
            self.normals.extend_from_slice(&other.normals);
        } else {
            self.normals.clear();
        }
        if keep_uvs {
            self.uvs.extend_from_slice(&other.uvs);
        } else {
            self.uvs.clear();
        }
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + offset)));
    }

    /// Area of the whole surface, m².
    pub fn area_m2(&self) -> f64 {
        self.triangles.iter().map(|t| f64::from(self.triangle_cross(t).length()) * 0.5).sum()
    }

    /// Cross product of two edges of a triangle: twice its area times its geometric normal.
    pub fn triangle_cross(&self, triangle: &[u32; 3]) -> Vec3 {
        let [a, b, c] = triangle.map(|v| self.positions[v as usize]);
        (b - a).cross(c - a)
    }

    /// Replaces the normals by area-weighted averages over the triangles around each vertex.
    pub fn compute_smooth_normals(&mut self) {
        let mut normals = vec![Vec3::ZERO; self.positions.len()];
        for triangle in &self.triangles {
            let cross = self.triangle_cross(triangle);
            for &vertex in triangle {
                normals[vertex as usize] += cross;
            }
        }
        self.normals = normals.into_iter().map(Vec3::normalize_or_zero).collect();
    }

    /// Smallest and largest corner of the bounding box; zeros for an empty mesh.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let Some(&first) = self.positions.first() else { return (Vec3::ZERO, Vec3::ZERO) };
        self.positions.iter().fold((first, first), |(low, high), &p| (low.min(p), high.max(p)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_triangle() -> TriangleMesh {
        TriangleMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            ..TriangleMesh::default()
        }
    }

    #[test]
    fn area_and_bounds_of_a_unit_triangle() {
        let mesh = unit_triangle();
        assert_eq!(mesh.area_m2(), 0.5);
        assert_eq!(mesh.bounds(), (Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)));
    }

    #[test]
    fn a_mirror_keeps_triangles_facing_outward() {
        let mut mesh = unit_triangle();
        mesh.compute_smooth_normals();
        mesh.transform(&Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0)));
        let cross = mesh.triangle_cross(&mesh.triangles[0]);
        assert!(cross.dot(mesh.normals[0]) > 0.0);
    }

    #[test]
    fn defects_are_named() {
        let mut mesh = unit_triangle();
        mesh.triangles[0][2] = 9;
        assert_eq!(mesh.validate(), Err(MeshError::VertexOutOfRange { triangle: 0, vertex: 9, count: 3 }));
        mesh = unit_triangle();
        mesh.positions[1].y = f32::NAN;
        assert!(matches!(mesh.validate(), Err(MeshError::NotFinite { vertex: 1, .. })));
    }
}
