//! Finer meshes and surfaces moved along their normals.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::TriangleMesh;

impl TriangleMesh {
    /// Splits every triangle into four at the middles of its edges, `levels` times. Positions, normals and texture
    /// coordinates are interpolated: the surface stays what it was.
    pub fn subdivide(&mut self, levels: u32) {
        for _ in 0..levels {
            let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
            let mut triangles = Vec::with_capacity(4 * self.triangles.len());
            for [a, b, c] in std::mem::take(&mut self.triangles) {
                let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| {
                    *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                        let (p, q) = (p as usize, q as usize);
                        self.positions.push(0.5 * (self.positions[p] + self.positions[q]));
                        if !self.normals.is_empty() {
                            self.normals.push((self.normals[p] + self.normals[q]).normalize_or_zero());
                        }
                        if !self.uvs.is_empty() {
                            self.uvs.push(0.5 * (self.uvs[p] + self.uvs[q]));
                        }
                        (self.positions.len() - 1) as u32
                    })
                });
                triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
            }
            self.triangles = triangles;
        }
    }

    /// Moves every vertex along its normal by `height_m(uv)`; meters, outward. Vertices at the same place with the
    /// same normal stay together where their heights agree. Normals are computed anew.
    pub fn displace(&mut self, height_m: impl Fn(Vec2) -> f32) {
        if self.normals.is_empty() {
            self.compute_smooth_normals();
        }
        for (index, position) in self.positions.iter_mut().enumerate() {
            let uv = self.uvs.get(index).copied().unwrap_or(Vec2::ZERO);
            *position += self.normals[index] * height_m(uv);
        }
        self.compute_welded_normals();
    }

    /// Smooth normals that do not see seams of the texture: vertices at the same place share theirs.
    fn compute_welded_normals(&mut self) {
        let key = |p: Vec3| p.to_array().map(|x| (x + 0.0).to_bits());
        let mut sums: HashMap<[u32; 3], Vec3> = HashMap::with_capacity(self.positions.len());
        for triangle in &self.triangles {
            let cross = self.triangle_cross(triangle);
            for &vertex in triangle {
                *sums.entry(key(self.positions[vertex as usize])).or_insert(Vec3::ZERO) += cross;
            }
        }
        self.normals = self
            .positions
            .iter()
            .map(|&p| sums.get(&key(p)).copied().unwrap_or(Vec3::ZERO).normalize_or_zero())
            .collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> TriangleMesh {
        TriangleMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y],
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..TriangleMesh::default()
        }
    }

    #[test]
    fn subdivision_keeps_area_and_shares_vertices() {
        let mut mesh = square();
        mesh.subdivide(3);
        assert_eq!((mesh.triangles.len(), mesh.positions.len()), (2 * 64, 81));
        assert!((mesh.area_m2() - 1.0).abs() < 1e-6 && mesh.validate().is_ok());
        assert!(mesh.positions.iter().zip(&mesh.uvs).all(|(p, uv)| p.truncate() == *uv));
    }

    #[test]
    fn a_slope_turns_the_normals() {
        let mut mesh = square();
        mesh.subdivide(2);
        mesh.displace(|uv| 0.5 * uv.x);
        let expected = Vec3::new(-0.5, 0.0, 1.0).normalize();
        assert!(mesh.normals.iter().all(|n| (*n - expected).length() < 1e-5), "{:?}", mesh.normals[0]);
        // A plane of slope 1/2: its area grows by sqrt(1 + 1/4).
        assert!((mesh.area_m2() - 1.25_f64.sqrt()).abs() < 1e-5);
    }
}
