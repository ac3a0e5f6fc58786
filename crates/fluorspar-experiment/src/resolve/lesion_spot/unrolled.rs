//! The map of a part, and the surface around a point laid flat: lengths along it in all directions.

use std::collections::BTreeMap;

use fluorspar::geometry::TriangleMesh;
use glam::{Vec2, Vec3};

/// Pixels of the baked textures along each side.
pub(in crate::resolve) const SIDE: usize = 512;

/// Farthest from a triangle, in texture coordinates, that a point is still taken to be on it.
const NEAR: f32 = 0.04;
/// Vertices closer than this are one, m: a closed surface has a seam of pairs, its poles many.
const SAME_M: f32 = 1e-6;
/// Length of an edge laid flat over its own from which on the two ends were reached on different ways around the part.
const TORN: f32 = 2.0;
/// Pixels beside a triangle that hold its values, too: textures are interpolated.
const MARGIN_PX: f32 = 1.5;

/// Texture coordinates of a pixel, rows from the top.
pub(in crate::resolve) fn pixel_center(i: usize) -> Vec2 {
    let (column, row) = (i % SIDE, i / SIDE);
    Vec2::new((column as f32 + 0.5) / SIDE as f32, 1.0 - (row as f32 + 0.5) / SIDE as f32)
}

/// Shares of the corners of a triangle in a point of it, here the nearest one to a point, and their distance in the plane.
fn nearest_in([a, b, c]: [Vec2; 3], point: Vec2) -> Option<(Vec3, f32)> {
    let (e, f, d) = (b - a, c - a, point - a);
    let area = e.perp_dot(f);
    if area.abs() < 1e-12 {
        return None;
    }
    let (s, t) = (d.perp_dot(f) / area, e.perp_dot(d) / area);
    let inside = Vec3::new(1.0 - s - t, s, t).max(Vec3::ZERO);
    let shares = inside / inside.element_sum();
    Some((shares, point.distance(a * shares.x + b * shares.y + c * shares.z)))
}

/// The triangle at texture coordinates and the shares of its corners; `None` where the mesh has no surface.
pub(super) fn triangle_at(mesh: &TriangleMesh, at: Vec2) -> Option<([usize; 3], Vec3)> {
    let of_triangle = |triangle: &[u32; 3]| {
        let corners = triangle.map(|vertex| vertex as usize);
        let (shares, distance) = nearest_in(corners.map(|vertex| mesh.uvs[vertex]), at)?;
        Some((corners, shares, distance))
    };
    let found = mesh.triangles.iter().filter_map(of_triangle).min_by(|a, b| a.2.total_cmp(&b.2))?;
    (found.2 <= NEAR).then_some((found.0, found.1))
}

/// Where a mesh is laid flat from.
pub(super) struct Start {
    /// Vertices of the triangle there, and their shares in the point.
    pub(super) corners: ([usize; 3], Vec3),
    /// Directions of u and v.
    pub(super) along: [Vec3; 2],
    /// Radius within which normals are averaged, and farthest way that is wanted, m.
    pub(super) radii: [f32; 2],
}

/// The surface around a point laid flat.
pub(in crate::resolve) struct Unrolled {
    /// Way to each vertex, m: along the direction of u and at right angles to it, toward v. Not finite where none is wanted.
    ways: Vec<Vec2>,
}

/// Unit vectors along a surface of this normal, the first along the first of two directions, the second to the side of the other one.
fn axes(normal: Vec3, [along_u, along_v]: [Vec3; 2]) -> (Vec3, Vec3) {
    let along = along_u.reject_from_normalized(normal).normalize_or(normal.any_orthonormal_vector());
    let across = normal.cross(along);
    (along, if across.dot(along_v) < 0.0 { -across } else { across })
}

impl Unrolled {
    /// Lays a mesh flat around a point, as far as its vertices are connected within the wanted ways. A way has the direction of the straight
    /// line on the mean surface near the point, and the length of an arc that turns as much as the normals do.
    pub(super) fn new(mesh: &TriangleMesh, start: &Start) -> Self {
        let normals = smooth_normals(mesh);
        let (numbers, neighbors) = welded(mesh);
        let (corners, shares) = start.corners;
        let middle = (0..3).map(|i| mesh.positions[corners[i]] * shares[i]).sum::<Vec3>();
        let normal = (0..3).map(|i| normals[corners[i]] * shares[i]).sum::<Vec3>();
        let normal = mean_normal(mesh, middle, start.radii[0], normal);
        let (along, across) = axes(normal, start.along);
        let way = |vertex: usize| {
            let line = mesh.positions[vertex] - middle;
            let half_turn = 0.5 * normals[vertex].angle_between(normal);
            let arc = if half_turn > 1e-3 { half_turn / half_turn.sin() } else { 1.0 };
            Vec2::new(line.dot(along), line.dot(across)).normalize_or_zero() * line.length() * arc
        };
        let mut ways = vec![Vec2::INFINITY; mesh.positions.len()];
        let mut open: Vec<usize> = corners.map(|corner| numbers[corner]).into();
        while let Some(vertex) = open.pop() {
            if ways[vertex].is_finite() {
                continue;
            }
            ways[vertex] = way(vertex);
            // One edge farther, so that all triangles within are whole
            let edge = |to: usize| mesh.positions[to].distance(mesh.positions[vertex]);
            let beyond = ways[vertex].length() - start.radii[1];
            open.extend(neighbors[vertex].iter().filter(|to| beyond <= edge(**to)));
        }
        Self { ways: numbers.iter().map(|number| ways[*number]).collect() }
    }

    /// The share of a spot at every pixel of the map of the mesh, by the way there from the middle.
    pub(super) fn bake(&self, mesh: &TriangleMesh, share: impl Fn(Vec2) -> f32) -> Vec<f32> {
        let (mut mask, mut nearest) =
            (vec![0.0_f32; SIDE * SIDE], vec![MARGIN_PX / SIDE as f32; SIDE * SIDE]);
        for triangle in &mesh.triangles {
            let corners = triangle.map(|vertex| vertex as usize);
            let uvs = corners.map(|vertex| mesh.uvs[vertex]);
            let ways = corners.map(|vertex| self.ways[vertex]);
            let edge = |i: usize| mesh.positions[corners[i]].distance(mesh.positions[corners[(i + 1) % 3]]);
            let is_whole = (0..3).all(|i| ways[i].distance(ways[(i + 1) % 3]) <= TORN * edge(i));
            let of_corners = Vec3::from(ways.map(&share));
            for pixel in pixels_around(uvs) {
                let Some((shares, distance)) = nearest_in(uvs, pixel_center(pixel)) else { continue };
                if distance > nearest[pixel] {
                    continue;
                }
                let value = if is_whole {
                    share(ways[0] * shares.x + ways[1] * shares.y + ways[2] * shares.z)
                } else {
                    of_corners.dot(shares)
                };
                mask[pixel] = if distance < nearest[pixel] { value } else { value.max(mask[pixel]) };
                nearest[pixel] = distance;
            }
        }
        mask
    }
}

/// Pixels of the texture in the box around a triangle, with a margin.
fn pixels_around([a, b, c]: [Vec2; 3]) -> impl Iterator<Item = usize> {
    let margin = MARGIN_PX / SIDE as f32;
    let (low, high) = (a.min(b).min(c) - margin, a.max(b).max(c) + margin);
    let range = |low: f32, high: f32| {
        let end = |x: f32| (x * SIDE as f32).clamp(0.0, SIDE as f32) as usize;
        end(low)..end(high.next_up()).max(end(low))
    };
    let (columns, rows) = (range(low.x, high.x), range(1.0 - high.y, 1.0 - low.y));
    rows.flat_map(move |row| columns.clone().map(move |column| row * SIDE + column))
}

/// The mean normal of the surface around a point, of those triangles that face as it does there.
fn mean_normal(mesh: &TriangleMesh, middle: Vec3, radius: f32, there: Vec3) -> Vec3 {
    let is_near = |triangle: &&[u32; 3]| {
        triangle.iter().all(|vertex| mesh.positions[*vertex as usize].distance(middle) <= radius)
    };
    let near = mesh.triangles.iter().filter(is_near).map(|triangle| mesh.triangle_cross(triangle));
    let sum: Vec3 = near.filter(|cross| cross.dot(there) > 0.0).sum();
    sum.normalize_or(there.normalize_or(Vec3::Z))
}

fn smooth_normals(mesh: &TriangleMesh) -> Vec<Vec3> {
    if !mesh.normals.is_empty() {
        return mesh.normals.clone();
    }
    let mut smooth = mesh.clone();
    smooth.compute_smooth_normals();
    smooth.normals
}

/// For each vertex the first one of its place, and for each of these the others that edges lead to.
fn welded(mesh: &TriangleMesh) -> (Vec<usize>, Vec<Vec<usize>>) {
    let mut first = BTreeMap::new();
    let place = |position: &Vec3| (*position / SAME_M).round().to_array().map(|x| x as i64);
    let places = mesh.positions.iter().enumerate();
    let numbers: Vec<usize> = places.map(|(n, at)| *first.entry(place(at)).or_insert(n)).collect();
    let mut neighbors = vec![Vec::new(); mesh.positions.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|vertex| numbers[vertex as usize]);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            neighbors[from].push(to);
            neighbors[to].push(from);
        }
    }
    (numbers, neighbors)
}
