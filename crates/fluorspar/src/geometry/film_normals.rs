//! Normals of a liquid film, which evens out the relief below it.

use std::collections::HashMap;
use std::ops::Range;

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::TriangleMesh;

/// Least cosine between the normals of places that one film covers.
const LEAST_COSINE: f32 = 0.5;

/// A mesh below a film, and the length over which that evens out its relief, m.
#[derive(Clone, Copy, Debug)]
pub struct WetMesh<'a> {
    /// The surface below.
    pub mesh: &'a TriangleMesh,
    /// Above 0, m.
    pub smoothing_m: f32,
}

/// Vertices of wet meshes in cells as wide as the longest smoothing.
struct WetVertices {
    cell_m: f32,
    /// Positions and vector areas, m and m², cell after cell.
    vertices: Vec<(Vec3, Vec3)>,
    cells: HashMap<IVec3, Range<usize>>,
}

/// Normals of the film at the vertices of each mesh, of unit length; zero where there is none, on vertices of no triangle.
///
/// Vector areas around a vertex are weighted by a Gaussian of the distance, half the length wide and cut off at the length, over all meshes
/// that face alike: a film reaches from one part to the next. What is wider than the length keeps its shape, what is narrower is
/// filled.
pub fn film_normals(meshes: &[WetMesh<'_>]) -> Vec<Vec<Vec3>> {
    let areas: Vec<Vec<Vec3>> = meshes.iter().map(|wet| vector_areas(wet.mesh)).collect();
    let of_mesh = |(wet, areas): (&WetMesh<'_>, &Vec<Vec3>)| -> Vec<(Vec3, Vec3)> {
        wet.mesh.positions.iter().copied().zip(areas.iter().copied()).collect()
    };
    let vertices: Vec<(Vec3, Vec3)> = meshes.iter().zip(&areas).flat_map(of_mesh).collect();
    let longest = meshes.iter().map(|wet| wet.smoothing_m).fold(0.0, f32::max);
    let wet = WetVertices::new(vertices, longest);
    meshes
        .iter()
        .zip(&areas)
        .map(|(WetMesh { mesh, smoothing_m }, areas)| {
            let normal = |(position, area): (&Vec3, &Vec3)| wet.normal(*position, *area, *smoothing_m);
            mesh.positions.par_iter().zip(areas).map(normal).collect()
        })
        .collect()
}

/// Sum of the vector areas of the triangles around each vertex, m².
fn vector_areas(mesh: &TriangleMesh) -> Vec<Vec3> {
    let mut areas = vec![Vec3::ZERO; mesh.positions.len()];
    for triangle in &mesh.triangles {
        let cross = mesh.triangle_cross(triangle);
        triangle.iter().for_each(|vertex| areas[*vertex as usize] += cross / 6.0);
    }
    areas
}

impl WetVertices {
    fn new(mut vertices: Vec<(Vec3, Vec3)>, cell_m: f32) -> Self {
        let key = |(position, _): &(Vec3, Vec3)| cell(*position, cell_m).to_array();
        // Stable: sums have one order
        vertices.sort_by_key(key);
        let mut cells = HashMap::new();
        let mut start = 0;
        for of_cell in vertices.chunk_by(|a, b| key(a) == key(b)) {
            cells.insert(IVec3::from_array(key(&of_cell[0])), start..start + of_cell.len());
            start += of_cell.len();
        }
        Self { cell_m, vertices, cells }
    }

    fn normal(&self, position: Vec3, area: Vec3, smoothing_m: f32) -> Vec3 {
        let own = area.normalize_or_zero();
        let middle = cell(position, self.cell_m);
        let mut sum = Vec3::ZERO;
        for number in 0..27 {
            let aside = IVec3::new(number % 3 - 1, number / 3 % 3 - 1, number / 9 - 1);
            let Some(range) = self.cells.get(&(middle + aside)) else { continue };
            for (there, area) in &self.vertices[range.clone()] {
                let relative2 = (*there - position).length_squared() / (smoothing_m * smoothing_m);
                if relative2 < 1.0 && area.dot(own) > LEAST_COSINE * area.length() {
                    sum += *area * (-2.0 * relative2).exp();
                }
            }
        }
        sum.normalize_or_zero()
    }
}

fn cell(position: Vec3, cell_m: f32) -> IVec3 {
    (position / cell_m).floor().clamp(Vec3::splat(-1e9), Vec3::splat(1e9)).as_ivec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet of 20 mm with waves of a length and of a height along x, and of vertices 0.1 mm apart.
    fn waves(length_mm: f32, height_mm: f32) -> TriangleMesh {
        const SIDE: u32 = 200;
        let mut mesh = TriangleMesh::default();
        for (row, column) in (0..=SIDE).flat_map(|row| (0..=SIDE).map(move |column| (row, column))) {
            let (x, y) = (0.1 * column as f32, 0.1 * row as f32);
            let z = height_mm * (std::f32::consts::TAU * x / length_mm).sin();
            mesh.positions.push(1e-3 * Vec3::new(x, y, z));
            if row < SIDE && column < SIDE {
                let corner = row * (SIDE + 1) + column;
                let above = corner + SIDE + 1;
                mesh.triangles.extend([[corner, corner + 1, above + 1], [corner, above + 1, above]]);
            }
        }
        mesh
    }

    /// Largest slope of the film in the middle of a sheet over that of the waves below.
    fn slope_left(length_mm: f32, smoothing_mm: f32) -> f32 {
        let mesh = waves(length_mm, 0.01 * length_mm);
        let steepest = std::f32::consts::TAU * 0.01;
        let normals = film_normals(&[WetMesh { mesh: &mesh, smoothing_m: 1e-3 * smoothing_mm }]).remove(0);
        let inside = |position: Vec3| (position * 1e3).truncate().distance(glam::Vec2::splat(10.0)) < 5.0;
        let slopes = mesh.positions.iter().zip(&normals).filter(|(position, _)| inside(**position));
        slopes.map(|(_, normal)| (normal.x / normal.z).abs()).fold(0.0, f32::max) / steepest
    }

    /// A Gaussian of standard deviation s leaves exp(-(2 pi s / length)^2 / 2) of the slopes of waves; cut off at two of them it is that
    /// of 0.83 s as long as waves are wide: 0.97 and 0.81.
    #[test]
    fn a_film_fills_what_is_narrow_and_follows_what_is_wide() {
        for (length_mm, smoothing_mm, least, most) in
            [(10.0, 1.0, 0.96, 0.975), (4.0, 1.0, 0.79, 0.83), (1.0, 1.0, 0.0, 0.06), (1.0, 2.0, 0.0, 0.03)]
        {
            let left = slope_left(length_mm, smoothing_mm);
            assert!((least..=most).contains(&left), "{length_mm} mm, {smoothing_mm} mm: {left}");
        }
    }

    /// Two sheets that meet make one film, and the back of a sheet has one of its own.
    #[test]
    fn a_film_reaches_over_parts_that_face_alike() {
        let flat = waves(1.0, 0.0);
        let mut tilted = flat.clone();
        tilted.positions.iter_mut().for_each(|p| *p = Vec3::new(0.02 + p.x, p.y, 0.5 * p.x));
        let mut back = flat.clone();
        back.positions.iter_mut().for_each(|p| p.z -= 1e-4);
        back.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        let wet = |mesh| WetMesh { mesh, smoothing_m: 1e-3 };
        let normals = film_normals(&[wet(&flat), wet(&tilted), wet(&back)]);
        let edge = 100 * 201 + 200;
        assert!(normals[0][edge].x < -0.1 && normals[0][edge].x > -0.4, "{}", normals[0][edge]);
        assert!(normals[0][edge - 100].abs_diff_eq(Vec3::Z, 1e-6));
        assert!(normals[2][edge - 100].abs_diff_eq(Vec3::NEG_Z, 1e-6));
    }
}
