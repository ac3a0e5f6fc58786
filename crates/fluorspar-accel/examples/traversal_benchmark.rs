//! Rays per second, for each kernel that this machine runs.
//!
//! `cargo run --release -p fluorspar-accel --example traversal_benchmark -- [SCALE [REPETITIONS]]`
//!
//! The scene is a bumpy closed cavity seen from inside, with 24 bumpy blobs in it: 190 thousand triangles times SCALE.
//! Kinds of rays: from a pinhole camera (primary), cosine-distributed from what those hit (bounce1) and again from there
//! (bounce2), and from both generations of points to a small light around the camera (shadow1, shadow2). One thread;
//! medians over the repetitions, in which kernels take turns.

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;
use std::time::Instant;

use common::{Mesh, Random, closed_surface, ray};
use fluorspar_accel::{BuildOptions, Hit, Kernel, Ray, TriangleBvh};
use glam::Vec3;

const IMAGE_SIDE: usize = 512;
const BLOBS: usize = 24;
/// Distance by which rays start off a surface, as a fraction of the cavity's radius.
const OFFSET: f32 = 1e-4;

fn bumps(frequency: f32, height: f32) -> impl Fn(Vec3) -> f32 {
    move |d| {
        let Vec3 { x, y, z } = frequency * d;
        1.0 + height * ((x + 0.3).sin() * (1.3 * y).cos() + (0.9 * z + 1.0).sin() * (2.1 * x).cos())
            + 0.2 * height * ((5.0 * x).sin() * (4.0 * y).sin() * (6.0 * z).cos())
    }
}

fn scene(scale: f32) -> Mesh {
    let rings = |triangles: f32| ((triangles * scale / 4.0).sqrt().round() as u32).max(4);
    let mut mesh = closed_surface(Vec3::ZERO, rings(115_000.0), bumps(9.0, 0.04));
    let mut random = Random(1);
    for _ in 0..BLOBS {
        let centre = 0.75 * random.direction() * (0.4 + 0.6 * random.unit());
        let size = 0.05 + 0.1 * random.unit();
        let shape = bumps(6.0, 0.15);
        mesh.append(&closed_surface(centre, rings(3100.0), |d| size * shape(d)));
    }
    mesh
}

fn primary_rays() -> Vec<Ray> {
    let mut random = Random(2);
    let mut rays = Vec::with_capacity(IMAGE_SIDE * IMAGE_SIDE);
    for row in 0..IMAGE_SIDE {
        for column in 0..IMAGE_SIDE {
            let x = 2.0 * (column as f32 + random.unit()) / IMAGE_SIDE as f32 - 1.0;
            let y = 2.0 * (row as f32 + random.unit()) / IMAGE_SIDE as f32 - 1.0;
            rays.push(ray(camera(), Vec3::new(x, y, 1.2)));
        }
    }
    rays
}

fn camera() -> Vec3 {
    Vec3::new(0.02, -0.03, -0.8)
}

/// Point and unit normal, on the side from which the ray comes.
fn surface(mesh: &Mesh, ray: &Ray, hit: &Hit) -> (Vec3, Vec3) {
    let [p0, p1, p2] = mesh.corners(hit.triangle as usize);
    let normal = (p1 - p0).cross(p2 - p0).normalize_or(-ray.direction);
    let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
    (p0 + hit.u * (p1 - p0) + hit.v * (p2 - p0), normal)
}

fn next_rays(bvh: &TriangleBvh, mesh: &Mesh, rays: &[Ray], random: &mut Random) -> (Vec<Ray>, Vec<Ray>) {
    let (mut bounced, mut shadow) = (Vec::new(), Vec::new());
    for incoming in rays {
        let Some(hit) = bvh.closest(incoming) else { continue };
        let (point, normal) = surface(mesh, incoming, &hit);
        let origin = point + OFFSET * normal;
        bounced.push(ray(origin, random.cosine_direction(normal)));
        let to_light = camera() + 0.02 * random.cube() - origin;
        shadow.push(Ray { t_max: to_light.length() * (1.0 - OFFSET), ..ray(origin, to_light) });
    }
    (bounced, shadow)
}

fn mega_rays_per_second(count: usize, run: impl FnOnce() -> usize) -> f64 {
    let start = Instant::now();
    black_box(run());
    count as f64 / start.elapsed().as_secs_f64() / 1e6
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let scale: f32 = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(1.0);
    let repetitions: usize = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(7);
    let mesh = scene(scale);
    let mut trees = Vec::new();
    for kernel in Kernel::available() {
        let start = Instant::now();
        let options = BuildOptions { kernel: Some(kernel) };
        match TriangleBvh::build_with(&mesh.positions, &mesh.triangles, &options) {
            Ok(bvh) => trees.push((bvh, start.elapsed().as_secs_f64())),
            Err(error) => eprintln!("{kernel}: {error}"),
        }
    }
    let Some((bvh, seconds)) = trees.last() else { return };
    println!(
        "{} triangles, {:.1} MB, built in {seconds:.2} s; Mray/s on one thread, medians of {repetitions}",
        bvh.triangle_count(),
        bvh.memory_bytes() as f64 / 1e6,
    );

    let mut random = Random(3);
    let primary = primary_rays();
    let (bounce1, shadow1) = next_rays(bvh, &mesh, &primary, &mut random);
    let (bounce2, shadow2) = next_rays(bvh, &mesh, &bounce1, &mut random);
    let sets: [(&str, &[Ray], bool); 5] = [
        ("primary", &primary, false),
        ("bounce1", &bounce1, false),
        ("bounce2", &bounce2, false),
        ("shadow1", &shadow1, true),
        ("shadow2", &shadow2, true),
    ];
    print!("{:10}", "kernel");
    for (name, ..) in sets {
        print!("{name:>9}");
    }
    println!();
    let mut rates = vec![[const { Vec::new() }; 5]; trees.len()];
    for _ in 0..repetitions {
        for ((bvh, _), rates) in trees.iter().zip(&mut rates) {
            for (&(_, rays, any), rates) in sets.iter().zip(rates) {
                rates.push(mega_rays_per_second(rays.len(), || {
                    if any {
                        rays.iter().filter(|ray| bvh.occluded(ray)).count()
                    } else {
                        rays.iter()
                            .filter_map(|ray| bvh.closest(ray))
                            .map(|hit| hit.triangle as usize & 1)
                            .sum()
                    }
                }));
            }
        }
    }
    for ((bvh, _), rates) in trees.iter().zip(&mut rates) {
        print!("{:10}", bvh.kernel().to_string());
        for rates in rates {
            rates.sort_by(f64::total_cmp);
            print!("{:9.2}", rates[rates.len() / 2]);
        }
        println!();
    }
    for (name, rays, any) in sets {
        let hits = rays.iter().filter(|ray| bvh.occluded(ray)).count();
        let what = if any { "occluded" } else { "hit" };
        println!("{name}: {:.1} % {what}", 100.0 * hits as f64 / rays.len() as f64);
    }
}
