//! Rays per second, for each kernel that this machine runs.
//!
//! `cargo run --release -p fluorspar-accel --example traversal_benchmark -- [SCALE [REPETITIONS [LIBEMBREE4]]]`
//!
//! The scene is a bumpy closed cavity seen from inside, with 24 bumpy blobs in it: 190 thousand triangles times SCALE.
//! Kinds of rays: from a pinhole camera (primary), cosine-distributed from what those hit (bounce1) and again from there
//! (bounce2), and from both generations of points to a small light around the camera (shadow1, shadow2). One thread;
//! medians over the repetitions, in which kernels take turns. With the path of a shared library of Embree 4 (the
//! Python package `embreex` brings one), Embree takes its turns, too, and a last table gives our rates over its robust
//! ones, as medians of the ratios of neighboring runs.

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

#[path = "../tests/suite/common/mod.rs"]
mod common;
#[path = "../tests/suite/common/embree.rs"]
mod embree;

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use common::{Mesh, Random, closed_surface, ray};
use embree::EmbreeScene;
use fluorspar_accel::{Allocator, BuildOptions, Hit, Kernel, Ray, TriangleBvh};
use glam::Vec3;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

const IMAGE_SIDE: usize = 512;
const BLOBS: usize = 24;
/// Rays of one call of those that are traced in turns.
const CALL: usize = 64;
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
        let center = 0.75 * random.direction() * (0.4 + 0.6 * random.unit());
        let size = 0.05 + 0.1 * random.unit();
        let shape = bumps(6.0, 0.15);
        mesh.append(&closed_surface(center, rings(3100.0), |d| size * shape(d)));
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

enum Contender {
    Ours(TriangleBvh),
    /// The same, many rays a call.
    InTurns(TriangleBvh),
    Embree(EmbreeScene, &'static str),
}

impl Contender {
    fn name(&self) -> String {
        match self {
            Self::Ours(bvh) => bvh.kernel().to_string(),
            Self::InTurns(bvh) => format!("{} each", bvh.kernel()),
            Self::Embree(_, name) => (*name).into(),
        }
    }

    /// Hits, so that no work can be left out.
    fn trace(&self, rays: &[Ray], any: bool) -> usize {
        match (self, any) {
            (Self::Ours(bvh), false) => rays.iter().filter(|ray| bvh.closest(ray).is_some()).count(),
            (Self::Ours(bvh), true) => rays.iter().filter(|ray| bvh.occluded(ray)).count(),
            (Self::InTurns(bvh), false) => {
                let mut hits = Vec::new();
                let in_turns = |rays: &[Ray]| {
                    bvh.closest_each(rays, &mut hits);
                    hits.iter().flatten().count()
                };
                rays.chunks(CALL).map(in_turns).sum()
            }
            (Self::InTurns(bvh), true) => {
                let mut answers = Vec::new();
                let in_turns = |rays: &[Ray]| {
                    bvh.occluded_each(rays, &mut answers);
                    answers.iter().filter(|&&occluded| occluded).count()
                };
                rays.chunks(CALL).map(in_turns).sum()
            }
            (Self::Embree(scene, _), false) => rays.iter().filter(|ray| scene.closest(ray).is_some()).count(),
            (Self::Embree(scene, _), true) => rays.iter().filter(|ray| scene.occluded(ray)).count(),
        }
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let scale: f32 = arguments.next().map_or(Ok(1.0), |text| text.parse())?;
    let repetitions: usize = arguments.next().map_or(Ok(7), |text| text.parse())?;
    let mesh = scene(scale);
    let mut contenders = Vec::new();
    if let Some(library) = arguments.next() {
        for (robust, name) in [(false, "Embree"), (true, "robust")] {
            let start = Instant::now();
            let scene = EmbreeScene::build(&library, &mesh.positions, &mesh.triangles, robust)?;
            println!("Embree, {name}: built in {:.2} s", start.elapsed().as_secs_f64());
            contenders.push(Contender::Embree(scene, name));
        }
    }
    let mut built = None;
    for kernel in Kernel::available() {
        let start = Instant::now();
        let options = BuildOptions { kernel: Some(kernel) };
        let bvh = TriangleBvh::build_with(&mesh.positions, &mesh.triangles, &options)?;
        let seconds = start.elapsed().as_secs_f64();
        if built.is_none() {
            println!(
                "{} triangles, {:.1} MB, built in {seconds:.2} s; Mray/s on one thread, medians of {repetitions}",
                bvh.triangle_count(),
                bvh.memory_bytes() as f64 / 1e6,
            );
        }
        built = Some(bvh.clone());
        contenders.push(Contender::Ours(bvh.clone()));
        contenders.push(Contender::InTurns(bvh));
    }
    let Some(bvh) = built else { return Ok(()) };

    let mut random = Random(3);
    let primary = primary_rays();
    let (bounce1, shadow1) = next_rays(&bvh, &mesh, &primary, &mut random);
    let (bounce2, shadow2) = next_rays(&bvh, &mesh, &bounce1, &mut random);
    let sets: [(&str, &[Ray], bool); 5] = [
        ("primary", &primary, false),
        ("bounce1", &bounce1, false),
        ("bounce2", &bounce2, false),
        ("shadow1", &shadow1, true),
        ("shadow2", &shadow2, true),
    ];
    for (name, rays, any) in sets {
        let hits: Vec<usize> = contenders.iter().map(|contender| contender.trace(rays, any)).collect();
        println!("{name}: hits of {} rays: {hits:?}", rays.len());
    }
    print!("{:13}", "");
    for (name, ..) in sets {
        print!("{name:>9}");
    }
    println!();
    let mut rates = vec![[const { Vec::new() }; 5]; contenders.len()];
    for _ in 0..repetitions {
        for (set, &(_, rays, any)) in sets.iter().enumerate() {
            for (contender, rates) in contenders.iter().zip(&mut rates) {
                rates[set].push(mega_rays_per_second(rays.len(), || contender.trace(rays, any)));
            }
        }
    }
    for (contender, rates) in contenders.iter().zip(&rates) {
        print!("{:13}", contender.name());
        for rates in rates {
            print!("{:9.2}", median(rates.clone()));
        }
        println!();
    }
    let peer = contenders.iter().position(|c| matches!(c, Contender::Embree(_, "robust")));
    for (contender, own) in contenders.iter().zip(&rates) {
        let (Some(peer), Contender::Ours(_) | Contender::InTurns(_)) = (peer, contender) else { continue };
        print!("{:13}", format!("{}/r", contender.name()));
        for (own, peer) in own.iter().zip(&rates[peer]) {
            print!("{:9.2}", median(own.iter().zip(peer).map(|(own, peer)| own / peer).collect()));
        }
        println!();
    }
    Ok(())
}
