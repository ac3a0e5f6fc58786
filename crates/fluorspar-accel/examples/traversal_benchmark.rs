//! Rays per second, for each kernel that this machine runs.
//!
//! `cargo run --release -p fluorspar-accel --example traversal_benchmark -- [SCALE [REPETITIONS [LIBEMBREE4]]]`
//!
//! The scene is a bumpy closed cavity seen from inside, with 24 bumpy blobs in it: 190 thousand triangles times SCALE.
//! Kinds of rays: from a pinhole camera (primary), cosine-distributed from what those hit (bounce1) and again from there
//! (bounce2), and from both generations of points to a small light around the camera (shadow1, shadow2). One thread;
//! medians over the repetitions, in which contenders alternate.
//!
//! Our kernels trace ray by ray and interleaved, in batches of 64. With the path of a shared library of Embree 4 (the
//! Python package `embreex` brings one), Embree traces ray by ray and in packets of sixteen (`rtcIntersect16`,
//! `rtcOccluded16`) that are declared coherent or incoherent. Embree 4 has no ray streams. Every contender starts from
//! the same slice of rays: filling batches and packets is part of the time. The last tables are rows of
//! docs/performance.md: our rates over those of Embree with its robust flag, each the median of the ratios of
//! neighboring runs with its standard error, 1.25 standard deviations (from the median absolute deviation) over the
//! square root of the number of repetitions.

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

#[path = "../tests/suite/common/mod.rs"]
mod common;
#[path = "../tests/suite/common/embree.rs"]
mod embree;

use std::error::Error;
use std::hint::black_box;
use std::rc::Rc;
use std::time::Instant;

use common::{Mesh, Random, closed_surface, ray};
use embree::{Coherence, EmbreeScene};
use fluorspar_accel::{Allocator, BuildOptions, Hit, Kernel, Ray, TriangleBvh};
use glam::Vec3;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

const IMAGE_SIDE: usize = 512;
const BLOBS: usize = 24;
/// Rays of an interleaved batch.
const BATCH: usize = 64;
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

/// How Embree gets its rays.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Query {
    Single,
    Packets(Coherence),
}

enum Contender {
    /// Ours, ray by ray.
    Single(TriangleBvh),
    /// Ours, many rays a call.
    Interleaved(TriangleBvh),
    Embree {
        scene: Rc<EmbreeScene>,
        robust: bool,
        query: Query,
    },
}

impl Contender {
    fn name(&self) -> String {
        match self {
            Self::Single(bvh) => format!("{}, ray by ray", bvh.kernel()),
            Self::Interleaved(bvh) => format!("{}, interleaved", bvh.kernel()),
            Self::Embree { robust, query, .. } => {
                let robust = if *robust { "Embree robust" } else { "Embree" };
                format!("{robust}, {}", query_name(*query))
            }
        }
    }

    /// Hits, so that no work can be left out.
    fn trace(&self, rays: &[Ray], any: bool) -> usize {
        match (self, any) {
            (Self::Single(bvh), false) => rays.iter().filter(|ray| bvh.closest(ray).is_some()).count(),
            (Self::Single(bvh), true) => rays.iter().filter(|ray| bvh.occluded(ray)).count(),
            (Self::Interleaved(bvh), false) => {
                let mut hits = Vec::new();
                let batch = |rays: &[Ray]| {
                    bvh.closest_each(rays, &mut hits);
                    hits.iter().flatten().count()
                };
                rays.chunks(BATCH).map(batch).sum()
            }
            (Self::Interleaved(bvh), true) => {
                let mut answers = Vec::new();
                let batch = |rays: &[Ray]| {
                    bvh.occluded_each(rays, &mut answers);
                    answers.iter().filter(|&&occluded| occluded).count()
                };
                rays.chunks(BATCH).map(batch).sum()
            }
            (Self::Embree { scene, query: Query::Single, .. }, false) => {
                rays.iter().filter(|ray| scene.closest(ray).is_some()).count()
            }
            (Self::Embree { scene, query: Query::Single, .. }, true) => {
                rays.iter().filter(|ray| scene.occluded(ray)).count()
            }
            (Self::Embree { scene, query: Query::Packets(coherence), .. }, false) => {
                scene.closest_in_packets(rays, *coherence)
            }
            (Self::Embree { scene, query: Query::Packets(coherence), .. }, true) => {
                scene.occluded_in_packets(rays, *coherence)
            }
        }
    }
}

fn query_name(query: Query) -> &'static str {
    match query {
        Query::Single => "ray by ray",
        Query::Packets(Coherence::Coherent) => "coherent packets",
        Query::Packets(Coherence::Incoherent) => "incoherent packets",
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Standard error of the median of normal deviates, the standard deviation taken from the median absolute deviation.
fn standard_error(values: &[f64]) -> f64 {
    let middle = median(values.to_vec());
    let deviation = median(values.iter().map(|value| (value - middle).abs()).collect());
    1.253 * 1.483 * deviation / (values.len() as f64).sqrt()
}

/// Embree's scenes and queries, from the library at this path.
fn embree_contenders(library: &str, mesh: &Mesh) -> Result<Vec<Contender>, Box<dyn Error>> {
    let mut contenders = Vec::new();
    for robust in [false, true] {
        let start = Instant::now();
        let scene = Rc::new(EmbreeScene::build(library, &mesh.positions, &mesh.triangles, robust)?);
        let kind = if robust { "Embree robust" } else { "Embree" };
        let packets = if scene.has_native_packets() { "native" } else { "split" };
        println!("{kind}: built in {:.2} s, packets of 16 are {packets}", start.elapsed().as_secs_f64());
        let coherences = [Coherence::Coherent, Coherence::Incoherent].map(Query::Packets);
        for query in [Query::Single].into_iter().chain(coherences) {
            contenders.push(Contender::Embree { scene: Rc::clone(&scene), robust, query });
        }
    }
    Ok(contenders)
}

type Rates = [Vec<f64>; 5];

/// Rows of docs/performance.md: our rates over those of one kind of query of Embree with its robust flag.
fn print_ratios(contenders: &[Contender], rates: &[Rates], names: [&str; 5], wanted: Query) {
    let is_peer =
        |c: &Contender| matches!(c, Contender::Embree { robust: true, query, .. } if *query == wanted);
    let Some(peer) = contenders.iter().position(is_peer) else { return };
    println!("\n| over Embree robust, {} | {} |", query_name(wanted), names.join(" | "));
    println!("|---|---|---|---|---|---|");
    for (contender, own) in contenders.iter().zip(rates) {
        if matches!(contender, Contender::Embree { .. }) {
            continue;
        }
        print!("| {} |", contender.name());
        for (own, peer) in own.iter().zip(&rates[peer]) {
            let ratios: Vec<f64> = own.iter().zip(peer).map(|(own, peer)| own / peer).collect();
            print!(" {:.2} ± {:.2} |", median(ratios.clone()), standard_error(&ratios));
        }
        println!();
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let scale: f32 = arguments.next().map_or(Ok(1.0), |text| text.parse())?;
    let repetitions: usize = arguments.next().map_or(Ok(7), |text| text.parse())?;
    let mesh = scene(scale);
    let mut contenders = match arguments.next() {
        Some(library) => embree_contenders(&library, &mesh)?,
        None => Vec::new(),
    };
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
        contenders.push(Contender::Single(bvh.clone()));
        contenders.push(Contender::Interleaved(bvh));
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
    print!("{:34}", "");
    for (name, ..) in sets {
        print!("{name:>9}");
    }
    println!();
    let mut rates: Vec<Rates> = vec![[const { Vec::new() }; 5]; contenders.len()];
    for _ in 0..repetitions {
        for (set, &(_, rays, any)) in sets.iter().enumerate() {
            for (contender, rates) in contenders.iter().zip(&mut rates) {
                rates[set].push(mega_rays_per_second(rays.len(), || contender.trace(rays, any)));
            }
        }
    }
    for (contender, rates) in contenders.iter().zip(&rates) {
        print!("{:34}", contender.name());
        for rates in rates {
            print!("{:9.2}", median(rates.clone()));
        }
        println!();
    }
    let names = sets.map(|(name, ..)| name);
    let packets = [Coherence::Coherent, Coherence::Incoherent].map(Query::Packets);
    for query in [Query::Single].into_iter().chain(packets) {
        print_ratios(&contenders, &rates, names, query);
    }
    Ok(())
}
