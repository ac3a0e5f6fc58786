//! Seconds and memory from a binary PLY file to a scene in which rays can be traced.
//!
//! `cargo run --release -p fluorspar-experiment --example ply_benchmark -- [MILLIONS] [FOLDER]`
//!
//! Writes a bumpy closed surface of MILLIONS (10) million triangles into FOLDER (that of temporary files), unless it is there, then
//! starts itself anew to read it and to compile the scene, its tree included. Memory is the most that this second process ever had,
//! as Linux tells it; the load is that of the machine before. The file is in the memory of the system: a disk comes on top.

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

use std::error::Error;
use std::f32::consts::{PI, TAU};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use fluorspar::geometry::TriangleMesh;
use fluorspar::light::{Emitter, Light, LightGroup};
use fluorspar::material::Material;
use fluorspar::optics::PerspectiveCamera;
use fluorspar::render::{FilmRenderer, RenderSettings};
use fluorspar::scene::{Object, Scene, Shape};
use fluorspar::spectral::{Curve, WavelengthGrid};
use fluorspar_format::{read_ply, write_ply};
use glam::Vec3;

/// Rows and columns of a sphere with bumps.
fn surface(triangles: f64) -> TriangleMesh {
    let rows = (triangles / 4.0).sqrt().ceil() as u32;
    let columns = 2 * rows;
    let point = |row: u32, column: u32| {
        let (polar, around) = (PI * row as f32 / rows as f32, TAU * column as f32 / columns as f32);
        let d = Vec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos());
        d * (1.0 + 0.1 * (9.0 * d.x).sin() * (7.0 * d.y).cos() + 0.02 * (40.0 * d.z).sin())
    };
    let positions = (0..=rows).flat_map(|row| (0..columns).map(move |column| point(row, column))).collect();
    let corner = |row: u32, column: u32| row * columns + column % columns;
    let cells = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
    let halves = cells.flat_map(|(row, column)| {
        let (a, b) = (corner(row, column), corner(row, column + 1));
        let (c, d) = (corner(row + 1, column), corner(row + 1, column + 1));
        [[a, c, d], [a, d, b]]
    });
    TriangleMesh { positions, triangles: halves.collect(), ..TriangleMesh::default() }
}

/// The mesh, gray, under an even sky.
fn scene(mesh: TriangleMesh) -> Option<Scene> {
    let shape = Shape::Mesh(Arc::new(mesh));
    Some(Scene {
        grid: WavelengthGrid::default(),
        objects: vec![Object { name: "surface".into(), shape, material: 0, emission: None }],
        materials: vec![Material::lambertian("gray", Curve::constant(0.5))],
        fluorophores: Vec::new(),
        light_groups: vec![LightGroup { name: "sky".into() }],
        lights: vec![Light {
            name: "sky".into(),
            group: 0,
            spectrum: Curve::constant(1.0),
            crossed_polarizers: false,
            emitter: Emitter::Environment,
        }],
        camera: PerspectiveCamera::look_at(3.0 * Vec3::Z, Vec3::ZERO, Vec3::Y, 40.0, 64, 64)?,
    })
}

/// A line of /proc/self/status, in MiB.
fn status_mib(name: &str) -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? / 1024.0)
}

fn read_and_compile(path: &Path) -> Result<(), Box<dyn Error>> {
    let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    // Once for the memory of the system.
    let bytes = std::io::copy(&mut fs::File::open(path)?, &mut std::io::sink())?;
    let start = Instant::now();
    let mesh = read_ply(path, 1.0)?;
    let read_s = start.elapsed().as_secs_f64();
    let triangles = mesh.triangles.len();
    let start = Instant::now();
    let scene = scene(mesh).ok_or("no camera")?;
    let renderer = FilmRenderer::new(&scene, &RenderSettings::default())?;
    let ready_s = start.elapsed().as_secs_f64();
    drop(renderer);
    println!(
        "{triangles} triangles, {:.0} MB: read in {read_s:.2} s, ready to trace {ready_s:.2} s later; most memory {:.0} MiB; load \
         before {}",
        bytes as f64 * 1e-6,
        status_mib("VmHWM").unwrap_or(f64::NAN),
        load.split_whitespace().take(3).collect::<Vec<_>>().join(" "),
    );
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [first, path] = arguments.as_slice()
        && first == "--read"
    {
        return read_and_compile(Path::new(path));
    }
    let millions: f64 = arguments.first().map_or(Ok(10.0), |text| text.parse())?;
    let folder = arguments.get(1).map_or_else(std::env::temp_dir, PathBuf::from);
    let path = folder.join(format!("fluorspar-{millions}-million.ply"));
    if !path.exists() {
        write_ply(&path, &surface(millions * 1e6))?;
    }
    let status = std::process::Command::new(std::env::current_exe()?).arg("--read").arg(&path).status()?;
    if status.success() { Ok(()) } else { Err("the second process failed".into()) }
}
