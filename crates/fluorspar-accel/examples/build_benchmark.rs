//! Seconds and memory to build a tree.
//!
//! `cargo run --release -p fluorspar-accel --example build_benchmark -- [MILLIONS]`
//!
//! The mesh is a bumpy closed surface of MILLIONS (10) million triangles. Memory is the most that the process ever had,
//! with the mesh itself, as Linux tells it. The environment variable RAYON_NUM_THREADS sets the number of threads.

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

#[path = "../tests/suite/common/mod.rs"]
mod common;

use std::error::Error;
use std::fs;
use std::time::Instant;

use fluorspar_accel::TriangleBvh;
use glam::Vec3;

/// A line of /proc/self/status, in MiB.
fn status_mib(name: &str) -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? / 1024.0)
}

/// CPU seconds of all threads so far.
fn cpu_seconds() -> Option<f64> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    Some((fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?) / 100.0)
}

fn main() -> Result<(), Box<dyn Error>> {
    let millions: f32 = std::env::args().nth(1).map_or(Ok(10.0), |text| text.parse())?;
    let rings = (millions * 1e6 / 4.0).sqrt().ceil() as u32;
    let mesh = common::closed_surface(Vec3::ZERO, rings.max(2), |d| {
        1.0 + 0.1 * (9.0 * d.x).sin() * (7.0 * d.y).cos() + 0.02 * (40.0 * d.z).sin()
    });
    let before = status_mib("VmRSS");
    let (start, cpu) = (Instant::now(), cpu_seconds());
    let bvh = TriangleBvh::build(&mesh.positions, &mesh.triangles)?;
    let (wall, cpu) = (start.elapsed().as_secs_f64(), cpu_seconds().zip(cpu).map(|(now, then)| now - then));
    println!(
        "{} triangles: {wall:.2} s, CPU {:.2} s; tree {:.0} MiB; before {:.0} MiB, most {:.0} MiB",
        bvh.triangle_count(),
        cpu.unwrap_or(f64::NAN),
        bvh.memory_bytes() as f64 / f64::from(1 << 20),
        before.unwrap_or(f64::NAN),
        status_mib("VmHWM").unwrap_or(f64::NAN),
    );
    Ok(())
}
