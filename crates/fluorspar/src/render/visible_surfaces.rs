//! The surfaces that a camera sees, by a depth buffer: for previews, at once, without tree and without light.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use glam::{Affine3, DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::geometry::{TriangleMesh, intersect_disc, intersect_sphere};
use crate::image::FeatureMaps;
use crate::optics::PerspectiveCamera;
use crate::scene::{Scene, Shape};

/// Triangles of a mesh that a thread takes at a time.
const TRIANGLES: usize = 4096;
/// Smallest depth that is drawn, m.
const NEAR_M: f64 = 1e-6;

/// Depth, normals, parts and texture coordinates behind the middle of each pixel. Holes of materials are closed, and a lens
/// counts as the pinhole in its pupil. Normals point to the camera, which need not be that of the scene.
pub fn visible_surfaces(scene: &Scene, camera: &PerspectiveCamera) -> FeatureMaps {
    let pixels = camera.width * camera.height;
    let blocks = blocks(scene);
    let buffer: Vec<AtomicU64> = (0..pixels).map(|_| AtomicU64::new(u64::MAX)).collect();
    blocks.par_iter().for_each(|block| block.draw(camera, &buffer));
    let mut maps = FeatureMaps {
        depth_m: vec![f32::INFINITY; pixels],
        normal: vec![[0.0; 3]; pixels],
        part: vec![0; pixels],
        uv: vec![[0.0; 2]; pixels],
        part_names: scene.objects.iter().map(|object| object.name.clone()).collect(),
        material_names: scene.objects.iter().map(|o| scene.materials[o.material].name.clone()).collect(),
        view: camera.view(),
    };
    (&mut maps.depth_m, &mut maps.normal, &mut maps.part, &mut maps.uv).into_par_iter().enumerate().for_each(
        |(index, (depth_m, normal, part, uv))| {
            let key = buffer[index].load(Relaxed);
            if key == u64::MAX {
                return;
            }
            let number = key as u32;
            let block = &blocks[blocks.partition_point(|block| block.first <= number) - 1];
            let (row, col) = (index / camera.width, index % camera.width);
            let ray = camera.ray(col as f32 + 0.5, row as f32 + 0.5);
            if let Some(seen) = block.seen((number - block.first) as usize, ray) {
                *depth_m = seen.distance;
                *normal = seen.normal.to_array();
                *part = (block.object + 1).min(usize::from(u16::MAX)) as u16;
                *uv = seen.uv.to_array();
            }
        },
    );
    maps
}

/// Where and how a ray meets a surface.
struct Seen {
    distance: f32,
    normal: Vec3,
    uv: Vec2,
}

/// Some triangles of an object, or an analytic shape.
struct Block<'a> {
    object: usize,
    /// Number of its first triangle among all.
    first: u32,
    surface: Surface<'a>,
}

enum Surface<'a> {
    Triangles { mesh: &'a TriangleMesh, to_world: Option<Affine3>, range: std::ops::Range<usize> },
    Sphere { center: Vec3, radius: f32 },
    Disc { center: Vec3, normal: Vec3, radius: f32 },
}

/// Numbers the triangles of all objects.
struct Numbering<'a> {
    blocks: Vec<Block<'a>>,
    next: u32,
}

impl<'a> Numbering<'a> {
    fn add(&mut self, object: usize, surface: Surface<'a>, count: usize) {
        self.blocks.push(Block { object, first: self.next, surface });
        self.next = self.next.saturating_add(u32::try_from(count).unwrap_or(u32::MAX));
    }

    fn add_mesh(&mut self, object: usize, mesh: &'a TriangleMesh, to_world: Option<Affine3>) {
        let count = mesh.triangles.len();
        for start in (0..count).step_by(TRIANGLES) {
            let range = start..(start + TRIANGLES).min(count);
            let triangles = range.len();
            self.add(object, Surface::Triangles { mesh, to_world, range }, triangles);
        }
    }
}

fn blocks(scene: &Scene) -> Vec<Block<'_>> {
    let mut numbering = Numbering { blocks: Vec::new(), next: 0 };
    for (object, item) in scene.objects.iter().enumerate() {
        match &item.shape {
            Shape::Mesh(mesh) => numbering.add_mesh(object, mesh, None),
            Shape::Instances(many) => {
                for instance in &many.instances {
                    numbering.add_mesh(object, &many.meshes[instance.mesh as usize], Some(instance.to_world));
                }
            }
            Shape::Sphere { center, radius_m } => {
                numbering.add(object, Surface::Sphere { center: *center, radius: *radius_m }, 1);
            }
            Shape::Disc { center, normal, radius_m } => {
                let surface = Surface::Disc { center: *center, normal: *normal, radius: *radius_m };
                numbering.add(object, surface, 1);
            }
        }
    }
    numbering.blocks
}

/// A point in the frame of the camera: right, up, depth, m.
type InCamera = DVec3;

fn in_camera(camera: &PerspectiveCamera, point: Vec3) -> InCamera {
    let p = (point - camera.position).as_dvec3();
    DVec3::new(p.dot(camera.right.as_dvec3()), p.dot(camera.up.as_dvec3()), p.dot(camera.forward.as_dvec3()))
}

/// Column, row and what is linear over the image: the inverse depth, or with parallel rays the depth itself.
fn on_image(camera: &PerspectiveCamera, point: InCamera) -> DVec3 {
    let (width, height) = (camera.width as f64, camera.height as f64);
    let (half, depth, linear) = match camera.parallel_half_width_m {
        Some(half) => (f64::from(half), 1.0, point.z),
        None => (f64::from(camera.tan_half_width), point.z, 1.0 / point.z),
    };
    let scale = 0.5 * width / (half * depth);
    let axis =
        0.5 * DVec2::new(width, height) + 0.5 * width * DVec2::new(-1.0, 1.0) * camera.center.as_dvec2();
    DVec3::new(axis.x + scale * point.x, axis.y - scale * point.y, linear)
}

/// Puts a depth into a pixel if it is the nearest. Equal depths go to the lower number, whatever the order of threads.
fn put(pixel: &AtomicU64, depth: f64, number: u32) {
    let key = (u64::from((depth as f32).to_bits()) << 32) | u64::from(number);
    if key < pixel.load(Relaxed) {
        pixel.fetch_min(key, Relaxed);
    }
}

impl Block<'_> {
    fn draw(&self, camera: &PerspectiveCamera, buffer: &[AtomicU64]) {
        match &self.surface {
            Surface::Triangles { mesh, to_world, range } => {
                for (number, triangle) in (self.first..).zip(&mesh.triangles[range.clone()]) {
                    let corners = corners(mesh, *to_world, triangle);
                    draw_triangle(camera, buffer, corners.map(|corner| in_camera(camera, corner)), number);
                }
            }
            Surface::Sphere { center, radius } | Surface::Disc { center, radius, .. } => {
                let Some([columns, rows]) = extent(camera, *center, *radius) else { return };
                for (row, col) in rows.flat_map(|row| columns.clone().map(move |col| (row, col))) {
                    let ray = camera.ray(col as f32 + 0.5, row as f32 + 0.5);
                    if let Some(seen) = self.seen(0, ray) {
                        let depth = seen.distance * ray.1.dot(camera.forward);
                        put(&buffer[row * camera.width + col], f64::from(depth), self.first);
                    }
                }
            }
        }
    }

    /// Where a ray meets a triangle of the block, or its shape.
    fn seen(&self, triangle: usize, (origin, direction): (Vec3, Vec3)) -> Option<Seen> {
        match &self.surface {
            Surface::Triangles { mesh, to_world, range } => {
                let triangle = &mesh.triangles[range.start + triangle];
                let [a, b, c] = corners(mesh, *to_world, triangle);
                let cross = (b - a).cross(c - a);
                let along = direction.dot(cross);
                let distance = (a - origin).dot(cross) / along;
                let point = origin + direction * distance;
                // Barycentric coordinates as shares of the area
                let size = cross.length_squared();
                let v = (point - a).cross(c - a).dot(cross) / size;
                let w = (b - a).cross(point - a).dot(cross) / size;
                if !(distance.is_finite() && v.is_finite() && w.is_finite()) {
                    return None;
                }
                let weights = [1.0 - v - w, v, w];
                let mut normal = cross.normalize_or_zero();
                if !mesh.normals.is_empty() {
                    let own = mix(triangle, weights, |corner| mesh.normals[corner]);
                    let turned = to_world.map_or(own, |map| map.matrix3.inverse().transpose() * own);
                    normal = turned.try_normalize().unwrap_or(normal);
                }
                let uv = match mesh.uvs.is_empty() {
                    true => Vec2::ZERO,
                    false => mix(triangle, weights, |corner| mesh.uvs[corner].extend(0.0)).truncate(),
                };
                Some(Seen { distance, normal: toward(normal, direction), uv })
            }
            Surface::Sphere { center, radius } => {
                let distance = intersect_sphere(origin, direction, *center, *radius, f32::INFINITY)?;
                let normal = (origin + direction * distance - *center).normalize_or_zero();
                let longitude = normal.y.atan2(normal.x) / std::f32::consts::TAU;
                let uv = Vec2::new(
                    longitude.rem_euclid(1.0),
                    normal.z.clamp(-1.0, 1.0).acos() / std::f32::consts::PI,
                );
                Some(Seen { distance, normal: toward(normal, direction), uv })
            }
            Surface::Disc { center, normal, radius } => {
                let distance = intersect_disc(origin, direction, *center, *normal, *radius, f32::INFINITY)?;
                let from = origin + direction * distance - *center;
                let (x, y) = normal.any_orthonormal_pair();
                let uv = 0.5 + 0.5 * Vec2::new(from.dot(x), from.dot(y)) / *radius;
                Some(Seen { distance, normal: toward(*normal, direction), uv })
            }
        }
    }
}

fn corners(mesh: &TriangleMesh, to_world: Option<Affine3>, triangle: &[u32; 3]) -> [Vec3; 3] {
    triangle.map(|corner| {
        let own = mesh.positions[corner as usize];
        to_world.map_or(own, |map| map.matrix3 * own + map.translation)
    })
}

fn mix(triangle: &[u32; 3], weights: [f32; 3], of: impl Fn(usize) -> Vec3) -> Vec3 {
    triangle.iter().zip(weights).map(|(corner, weight)| of(*corner as usize) * weight).sum()
}

fn toward(normal: Vec3, direction: Vec3) -> Vec3 {
    if normal.dot(direction) > 0.0 { -normal } else { normal }
}

/// Columns and rows of the image around a ball; `None` behind the camera.
fn extent(camera: &PerspectiveCamera, center: Vec3, radius: f32) -> Option<[std::ops::Range<usize>; 2]> {
    let (c, r) = (in_camera(camera, center), f64::from(radius));
    if c.z + r <= NEAR_M {
        return None;
    }
    let whole = [0..camera.width, 0..camera.height];
    if camera.parallel_half_width_m.is_none() && c.z <= 2.0 * r {
        return Some(whole);
    }
    // At its nearest, so that the box holds all of the ball.
    let near = if camera.parallel_half_width_m.is_some() { c.z } else { c.z - r };
    let points = [-1.0, 1.0].map(|side| {
        let corner = |depth: f64| on_image(camera, DVec3::new(c.x + side * r, c.y + side * r, depth));
        (corner(near), corner(c.z + r))
    });
    let span = |axis: usize, end: usize| {
        let all = points.iter().flat_map(|(near, far)| [near[axis], far[axis]]);
        let (low, high) = all.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        low.floor().clamp(0.0, end as f64) as usize..(high.ceil() + 1.0).clamp(0.0, end as f64) as usize
    };
    Some([span(0, camera.width), span(1, camera.height)])
}

fn draw_triangle(camera: &PerspectiveCamera, buffer: &[AtomicU64], corners: [InCamera; 3], number: u32) {
    let is_parallel = camera.parallel_half_width_m.is_some();
    if is_parallel || corners.iter().all(|corner| corner.z > NEAR_M) {
        return fill(camera, buffer, corners.map(|corner| on_image(camera, corner)), number);
    }
    // Cut off what is behind the camera
    let mut cut: Vec<InCamera> = Vec::with_capacity(4);
    for (index, &from) in corners.iter().enumerate() {
        let to = corners[(index + 1) % 3];
        if from.z > NEAR_M {
            cut.push(from);
        }
        if (from.z > NEAR_M) != (to.z > NEAR_M) {
            cut.push(from + (to - from) * ((NEAR_M - from.z) / (to.z - from.z)));
        }
    }
    for index in 2..cut.len() {
        let part = [cut[0], cut[index - 1], cut[index]];
        fill(camera, buffer, part.map(|corner| on_image(camera, corner)), number);
    }
}

/// Fills the pixels whose middles a triangle covers.
fn fill(camera: &PerspectiveCamera, buffer: &[AtomicU64], [a, b, c]: [DVec3; 3], number: u32) {
    let area = (b - a).truncate().perp_dot((c - a).truncate());
    if area == 0.0 || !area.is_finite() {
        return;
    }
    // Pixels whose middles lie in the box around it
    let span = |axis: usize, end: usize| {
        middles_between(a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]), end)
    };
    let (columns, rows) = (span(0, camera.width), span(1, camera.height));
    let is_parallel = camera.parallel_half_width_m.is_some();
    for row in rows {
        for col in columns.clone() {
            let p = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
            let share = |from: DVec3, to: DVec3| {
                (to.truncate() - from.truncate()).perp_dot(p - from.truncate()) / area
            };
            let weights = [share(b, c), share(c, a), share(a, b)];
            if weights.iter().any(|weight| *weight < 0.0) {
                continue;
            }
            let linear = weights[0] * a.z + weights[1] * b.z + weights[2] * c.z;
            let depth = if is_parallel { linear } else { 1.0 / linear };
            if depth > 0.0 {
                put(&buffer[row * camera.width + col], depth, number);
            }
        }
    }
}

/// Numbers of the pixels below `end` whose middles lie between two places.
fn middles_between(low: f64, high: f64, end: usize) -> std::ops::Range<usize> {
    let first = (low - 0.5).ceil().clamp(0.0, end as f64) as usize;
    first..((high - 0.5).floor() + 1.0).clamp(first as f64, end as f64) as usize
}
