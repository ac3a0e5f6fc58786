//! Rectangular grids of surface points and their conversion to triangle meshes.

use std::ops::Range;

use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::Part;
use fluorspar::geometry::TriangleMesh;
use fluorspar::interruption::end_if_interrupted;

/// Triangles smaller than this are dropped, m²: they come from the poles of a grid.
const SMALLEST_AREA_M2: f32 = 1e-13;

/// Counts of rows and columns for a level of detail.
pub(super) fn count(at_detail_one: usize, detail: f64) -> usize {
    ((at_detail_one as f64 * detail).round() as usize).max(4)
}

/// Points of a rectangular grid with their texture coordinates.
pub(super) struct Surface {
    columns: usize,
    positions: Vec<Vec3>,
    uvs: Vec<Vec2>,
}

impl Surface {
    /// Samples `surface(v, u)`, in millimeters, at the given parameters; rows in parallel.
    pub(super) fn new(
        v_values: &[f64],
        u_values: &[f64],
        surface: impl Fn(f64, f64) -> (DVec3, DVec2) + Sync,
    ) -> Self {
        let rows: Vec<Vec<(Vec3, Vec2)>> = v_values
            .par_iter()
            .map(|&v| {
                end_if_interrupted();
                u_values
                    .iter()
                    .map(|&u| {
                        let (point, uv) = surface(v, u);
                        ((point * 1e-3).as_vec3(), uv.clamp(DVec2::ZERO, DVec2::ONE).as_vec2())
                    })
                    .collect()
            })
            .collect();
        let (positions, uvs) = rows.into_iter().flatten().unzip();
        Self { columns: u_values.len(), positions, uvs }
    }

    /// Triangles of the cells in these ranges of rows and columns. The visible side has the normal ∂/∂v × ∂/∂u, or the
    /// opposite one with `flip`.
    pub(super) fn mesh(&self, rows: Range<usize>, columns: Range<usize>, flip: bool) -> TriangleMesh {
        let width = columns.len() + 1;
        let mut mesh = TriangleMesh::default();
        for row in rows.start..=rows.end {
            let from = row * self.columns + columns.start;
            mesh.positions.extend_from_slice(&self.positions[from..from + width]);
            mesh.uvs.extend_from_slice(&self.uvs[from..from + width]);
        }
        let mut triangles = Vec::with_capacity(2 * rows.len() * columns.len());
        for row in 0..rows.len() {
            for column in 0..columns.len() {
                let first = (row * width + column) as u32;
                triangles.extend(cell_triangles(&mesh.positions, first, width as u32));
            }
        }
        if flip {
            triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        mesh.triangles = triangles;
        clean(&mut mesh);
        mesh
    }
}

/// The two triangles of a cell whose first point has this number, in a grid with `width` points a row: on both sides of the shorter
/// diagonal, which gives the better shaped pair.
fn cell_triangles(positions: &[Vec3], first: u32, width: u32) -> [[u32; 3]; 2] {
    let (a, b, c, d) = (first, first + width, first + width + 1, first + 1);
    let length = |p: u32, q: u32| positions[p as usize].distance_squared(positions[q as usize]);
    if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
}

/// Makes a mesh from all of `surface(v, u)`, see [`Surface`].
pub(super) fn surface_mesh(
    v_values: &[f64],
    u_values: &[f64],
    flip: bool,
    surface: impl Fn(f64, f64) -> (DVec3, DVec2) + Sync,
) -> TriangleMesh {
    Surface::new(v_values, u_values, surface).mesh(0..v_values.len() - 1, 0..u_values.len() - 1, flip)
}

/// Drops triangles without area, then vertices that no triangle uses.
fn clean(mesh: &mut TriangleMesh) {
    let triangles = std::mem::take(&mut mesh.triangles);
    mesh.triangles =
        triangles.into_iter().filter(|t| mesh.triangle_cross(t).length() > 2.0 * SMALLEST_AREA_M2).collect();
    const UNUSED: u32 = u32::MAX;
    let mut new_number = vec![UNUSED; mesh.positions.len()];
    for triangle in &mesh.triangles {
        for &vertex in triangle {
            new_number[vertex as usize] = 0;
        }
    }
    let mut next = 0;
    for (old, number) in new_number.iter_mut().enumerate() {
        if *number != UNUSED {
            *number = next;
            mesh.positions[next as usize] = mesh.positions[old];
            mesh.uvs[next as usize] = mesh.uvs[old];
            next += 1;
        }
    }
    mesh.positions.truncate(next as usize);
    mesh.uvs.truncate(next as usize);
    for triangle in &mut mesh.triangles {
        *triangle = triangle.map(|vertex| new_number[vertex as usize]);
    }
}

/// Gives every part smooth normals. Vertices at the same place share theirs, also across parts, unless the surfaces
/// meet at an angle.
pub(super) fn smooth_normals(parts: &mut [Part]) {
    let mut places: Vec<([u32; 3], u32, u32)> = Vec::new();
    for (number, part) in parts.iter_mut().enumerate() {
        part.mesh.compute_smooth_normals();
        // Where the triangles around a vertex cancel, it takes the normal of one of them.
        for triangle in &part.mesh.triangles {
            for &vertex in triangle {
                if part.mesh.normals[vertex as usize] == Vec3::ZERO {
                    part.mesh.normals[vertex as usize] =
                        part.mesh.triangle_cross(triangle).normalize_or_zero();
                }
            }
        }
        for (vertex, position) in part.mesh.positions.iter().enumerate() {
            // Adding zero turns -0 into +0.
            places.push((position.to_array().map(|c| (c + 0.0).to_bits()), number as u32, vertex as u32));
        }
    }
    places.sort_unstable();
    share_normals(parts, &places);
}

/// Vertices of one place, next to each other in the list, take the mean of their normals, if it is near their own.
fn share_normals(parts: &mut [Part], places: &[([u32; 3], u32, u32)]) {
    for group in places.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() > 1) {
        let own: Vec<Vec3> = group
            .iter()
            .map(|&(_, part, vertex)| parts[part as usize].mesh.normals[vertex as usize])
            .collect();
        let mean = own.iter().copied().sum::<Vec3>().normalize_or_zero();
        for (&(_, part, vertex), normal) in group.iter().zip(&own) {
            if mean.dot(*normal) > 0.5 {
                parts[part as usize].mesh.normals[vertex as usize] = mean;
            }
        }
    }
}

/// `intervals + 1` equally spaced numbers.
pub(super) fn linspace(low: f64, high: f64, intervals: usize) -> Vec<f64> {
    (0..=intervals).map(|i| low + (high - low) * (i as f64 / intervals as f64)).collect()
}
