//! Instructions that the kernels retire: band arithmetic per call, traversal per ray, for each kernel that this machine
//! runs. Unlike times they do not depend on what else the machine does, so two versions can be compared on any.
//!
//! `cargo bench -p fluorspar-accel --bench instruction_counts`
//!
//! The kernel of Linux counts them (`perf_event_open`), in user mode only, where the processor has counters that it may use.
//! Virtual machines often have none, and other systems have no such interface: then the program says so and exits with 0.

#![allow(clippy::print_stdout, reason = "printing is what a benchmark is for")]

#[path = "../tests/suite/common/mod.rs"]
mod common;
mod work;

use std::hint::black_box;
use std::io;

use common::{Mesh, Random, closed_surface, ray};
use fluorspar_accel::bands;
use fluorspar_accel::{BuildOptions, Instance, InstanceBvh, Kernel, Ray, Simd, TriangleBvh};
use glam::{Affine3, Vec3};
use work::{BANDS, Dense, Elastic, Products, terms, triangle, vector};

/// Calls or rays of one measurement.
const CALLS: u64 = 2000;

/// Counts instructions of this thread.
#[cfg(target_os = "linux")]
struct Counter(perf_event::Counter);

#[cfg(target_os = "linux")]
impl Counter {
    fn new() -> io::Result<Self> {
        // User mode only is the default, and what an unprivileged process may count.
        perf_event::Builder::new(perf_event::events::Hardware::INSTRUCTIONS).build().map(Self)
    }

    /// Instructions per call, what the loop takes included.
    fn count(&mut self, mut act: impl FnMut(u64)) -> io::Result<f64> {
        // Once for the caches and for what is done once.
        act(0);
        self.0.reset()?;
        self.0.enable()?;
        (0..CALLS).for_each(&mut act);
        self.0.disable()?;
        Ok(self.0.read()? as f64 / CALLS as f64)
    }
}

#[cfg(not(target_os = "linux"))]
struct Counter;

#[cfg(not(target_os = "linux"))]
impl Counter {
    fn new() -> io::Result<Self> {
        Err(io::Error::new(io::ErrorKind::Unsupported, "instructions are counted on Linux only"))
    }

    fn count(&mut self, _: impl FnMut(u64)) -> io::Result<f64> {
        Err(io::ErrorKind::Unsupported.into())
    }
}

/// A value that must be computed although nobody looks at it.
fn keep<T>(value: T) {
    let _ = black_box(value);
}

/// A counter that counts: some virtual machines give one that stands still.
fn working_counter() -> io::Result<Counter> {
    let mut counter = Counter::new()?;
    if counter.count(keep)? < 1.0 {
        return Err(io::Error::other("the counter stands still"));
    }
    Ok(counter)
}

fn main() -> io::Result<()> {
    let mut counter = match working_counter() {
        Ok(counter) => counter,
        Err(error) => {
            println!(
                "Instructions were not counted: {error}. It takes Linux on a processor whose counters are open to this \
                 process (/proc/sys/kernel/perf_event_paranoid at most 2; many virtual machines have none)."
            );
            return Ok(());
        }
    };
    println!("Instructions per call, user mode, mean of {CALLS}");
    band_arithmetic(&mut counter)?;
    traversal(&mut counter)
}

fn band_arithmetic(counter: &mut Counter) -> io::Result<()> {
    for kernel in Kernel::available() {
        let Some(simd) = Simd::of(kernel) else { continue };
        for bands in BANDS {
            let r = bands::to_blocks(&vector(bands, 0.0));
            let light = bands::to_blocks(&vector(bands, 1.0));
            let mut out = bands::to_blocks(&vector(bands, 2.0));
            let mut factor = r.clone();
            let elastic = counter.count(|_| {
                simd.run(Elastic(
                    black_box(&r),
                    black_box(&light),
                    black_box(&mut out),
                    black_box(&mut factor),
                ));
            })?;
            println!("{kernel:>8} {bands:>4} bands  elastic vertex          {elastic:>9.1}");
            for (name, count, masked) in [
                ("separable vertex", 1, false),
                ("masked separable vertex", 1, true),
                ("five masked separable", 5, true),
            ] {
                let terms = terms(bands, count, masked);
                let products = counter.count(|_| {
                    simd.run(Products(black_box(&terms), black_box(&light), black_box(&mut out)))
                })?;
                println!("{kernel:>8} {bands:>4} bands  {name:<23} {products:>9.1}");
            }
            let matrix = triangle(bands);
            let dense = counter
                .count(|_| simd.run(Dense(black_box(&matrix), black_box(&light), black_box(&mut out))))?;
            println!("{kernel:>8} {bands:>4} bands  triangular matrix       {dense:>9.1}");
        }
    }
    Ok(())
}

/// A bumpy closed cavity, and the same as an instance, from inside.
fn traversal(counter: &mut Counter) -> io::Result<()> {
    let bumpy = |d: Vec3| 1.0 + 0.04 * ((9.0 * d.x).sin() * (7.0 * d.y).cos() + (8.0 * d.z).sin());
    let Mesh { positions, triangles } = closed_surface(Vec3::ZERO, 60, bumpy);
    let mut random = Random(7);
    let rays: Vec<Ray> = (0..CALLS).map(|_| ray(0.5 * random.cube(), random.direction())).collect();
    for kernel in Kernel::available() {
        let options = BuildOptions { kernel: Some(kernel) };
        let bvh = TriangleBvh::build_with(&positions, &triangles, &options).map_err(io::Error::other)?;
        let place = Instance { mesh: 0, to_world: Affine3::IDENTITY };
        let instances = InstanceBvh::build_with(vec![bvh.clone().into()], &[place], &options);
        let instances = instances.map_err(io::Error::other)?;
        let at = |call: u64| &rays[call as usize];
        let nearest = counter.count(|call| keep(bvh.closest(black_box(at(call)))))?;
        let any = counter.count(|call| keep(bvh.occluded(black_box(at(call)))))?;
        let placed = counter.count(|call| keep(instances.closest(black_box(at(call)))))?;
        println!("{kernel:>8} {:>6} triangles  nearest hit        {nearest:>9.1}", triangles.len());
        println!("{kernel:>8} {:>6} triangles  any hit            {any:>9.1}", triangles.len());
        println!("{kernel:>8} {:>6} triangles  nearest, instance  {placed:>9.1}", triangles.len());
    }
    Ok(())
}
