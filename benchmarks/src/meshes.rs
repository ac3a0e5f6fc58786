//! Meshes of the benchmark scenes.

use std::f32::consts::{PI, TAU};

use fluorspar::geometry::TriangleMesh;
use glam::{Vec2, Vec3};

/// A flat parallelogram of two triangles.
pub(crate) fn parallelogram(corner: Vec3, edge_u: Vec3, edge_v: Vec3) -> TriangleMesh {
    TriangleMesh {
        positions: vec![corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..TriangleMesh::default()
    }
}

/// A block on the plane y = 0: center of its base, half sides, height, turned about +y.
pub(crate) fn block(base: Vec3, half: f32, height: f32, turn: f32) -> TriangleMesh {
    let (sin, cos) = turn.sin_cos();
    let corner =
        |x: f32, z: f32, y: f32| base + Vec3::new(half * (x * cos + z * sin), y, half * (z * cos - x * sin));
    let mut mesh = TriangleMesh::default();
    let sides = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    for (index, &(x, z)) in sides.iter().enumerate() {
        let (next_x, next_z) = sides[(index + 1) % 4];
        let low = corner(x, z, 0.0);
        mesh.append(&parallelogram(low, corner(next_x, next_z, 0.0) - low, Vec3::Y * height));
    }
    let top = corner(-1.0, -1.0, height);
    mesh.append(&parallelogram(top, corner(1.0, -1.0, height) - top, corner(-1.0, 1.0, height) - top));
    mesh
}

/// The closed surface `center + radius(direction) axes direction`, with rings of latitude about z and texture
/// coordinates by longitude and latitude: `4 rings (rings - 1)` triangles, normals by finite differences.
pub(crate) fn closed_surface(
    center: Vec3,
    axes: Vec3,
    rings: u32,
    inward: bool,
    radius: impl Fn(Vec3) -> f32,
) -> TriangleMesh {
    let segments = 2 * rings;
    let mut mesh = TriangleMesh::default();
    for ring in 0..=rings {
        for segment in 0..=segments {
            let (u, v) = (segment as f32 / segments as f32, ring as f32 / rings as f32);
            let point = |u: f32, v: f32| {
                let (sin_theta, cos_theta) = (PI * v).sin_cos();
                let (sin_phi, cos_phi) = (TAU * u).sin_cos();
                let direction = Vec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta);
                center + axes * direction * radius(direction)
            };
            mesh.positions.push(point(if segment == segments { 0.0 } else { u }, v));
            mesh.uvs.push(Vec2::new(u, v));
        }
    }
    let at = |ring: u32, segment: u32| ring * (segments + 1) + segment;
    for ring in 0..rings {
        for segment in 0..segments {
            let (a, b) = (at(ring, segment), at(ring, segment + 1));
            let (c, d) = (at(ring + 1, segment), at(ring + 1, segment + 1));
            if ring + 1 < rings {
                mesh.triangles.push(if inward { [a, d, c] } else { [a, c, d] });
            }
            if ring > 0 {
                mesh.triangles.push(if inward { [a, b, d] } else { [a, d, b] });
            }
        }
    }
    mesh
}

/// Gentle bumps on the unit sphere about 1.
pub(crate) fn bumps(frequency: f32, height: f32) -> impl Fn(Vec3) -> f32 {
    move |d| {
        let Vec3 { x, y, z } = frequency * d;
        1.0 + height * ((x + 0.3).sin() * (1.3 * y).cos() + (0.9 * z + 1.0).sin() * (2.1 * x).cos())
            + 0.2 * height * ((5.0 * x).sin() * (4.0 * y).sin() * (6.0 * z).cos())
    }
}
