//! Meshes and rays for the tests and the benchmark.
#![allow(dead_code, unreachable_pub)]

use std::f32::consts::{PI, TAU};

use fluorspar_accel::Ray;
use glam::Vec3;

/// Vertices and triangles.
#[derive(Clone, Default)]
pub struct Mesh {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    pub fn add(&mut self, corners: [Vec3; 3]) {
        let first = self.positions.len() as u32;
        self.positions.extend(corners);
        self.triangles.push([first, first + 1, first + 2]);
    }

    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|vertex| self.positions[vertex as usize])
    }

    pub fn append(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.triangles.extend(other.triangles.iter().map(|corners| corners.map(|vertex| vertex + first)));
    }
}

/// SplitMix64: Steele, Lea, Flood, OOPSLA 2014.
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1_u64 << 24) as f32
    }

    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// Uniform in the cube [-1, 1)^3.
    pub fn cube(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> Vec3 {
        let z = 2.0 * self.unit() - 1.0;
        let (sin, cos) = (TAU * self.unit()).sin_cos();
        let radius = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(radius * cos, radius * sin, z)
    }

    /// Cosine-distributed about a unit normal.
    pub fn cosine_direction(&mut self, normal: Vec3) -> Vec3 {
        (normal + self.direction()).normalize_or(normal)
    }
}

/// A ray without limits.
pub fn ray(origin: Vec3, direction: Vec3) -> Ray {
    Ray { origin, direction: direction.normalize(), t_min: 0.0, t_max: f32::INFINITY }
}

/// A closed surface `center + radius(direction) direction` of latitude rings, `2 rings (rings - 1)` times two triangles,
/// with one vertex at each pole.
pub fn closed_surface(center: Vec3, rings: u32, radius: impl Fn(Vec3) -> f32) -> Mesh {
    let segments = 2 * rings;
    let mut mesh = Mesh::default();
    let mut vertex = |direction: Vec3| mesh.positions.push(center + radius(direction) * direction);
    vertex(Vec3::Z);
    for ring in 1..rings {
        let (sin_theta, cos_theta) = (PI * ring as f32 / rings as f32).sin_cos();
        for segment in 0..segments {
            let (sin_phi, cos_phi) = (TAU * segment as f32 / segments as f32).sin_cos();
            vertex(Vec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta));
        }
    }
    vertex(Vec3::NEG_Z);
    let last = mesh.positions.len() as u32 - 1;
    let at = |ring: u32, segment: u32| 1 + (ring - 1) * segments + segment % segments;
    for segment in 0..segments {
        mesh.triangles.push([0, at(1, segment), at(1, segment + 1)]);
        for ring in 1..rings - 1 {
            let (a, b) = (at(ring, segment), at(ring, segment + 1));
            let (c, d) = (at(ring + 1, segment), at(ring + 1, segment + 1));
            mesh.triangles.extend([[a, c, d], [a, d, b]]);
        }
        mesh.triangles.push([last, at(rings - 1, segment + 1), at(rings - 1, segment)]);
    }
    mesh
}

/// Triangles of about the given size, anywhere in the cube.
pub fn soup(count: usize, size: f32, seed: u64) -> Mesh {
    let mut random = Random(seed);
    let mut mesh = Mesh::default();
    for _ in 0..count {
        let center = random.cube();
        mesh.add([(); 3].map(|()| center + size * random.cube()));
    }
    mesh
}

/// A flat square of `cells` squared cells, with vertices on exact binary fractions, in the plane normal to `axis`.
pub fn grid(cells: u32, axis: usize, height: f32) -> Mesh {
    let mut mesh = Mesh::default();
    for row in 0..=cells {
        for column in 0..=cells {
            let mut position = Vec3::splat(height);
            position[(axis + 1) % 3] = 2.0 * column as f32 / cells as f32 - 1.0;
            position[(axis + 2) % 3] = 2.0 * row as f32 / cells as f32 - 1.0;
            mesh.positions.push(position);
        }
    }
    for row in 0..cells {
        for column in 0..cells {
            let a = row * (cells + 1) + column;
            let c = a + cells + 1;
            mesh.triangles.extend([[a, a + 1, c + 1], [a, c + 1, c]]);
        }
    }
    mesh
}
