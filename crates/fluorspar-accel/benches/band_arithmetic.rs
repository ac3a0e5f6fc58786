//! Time per call of the band arithmetic of one path vertex, for each kernel that this machine runs.
//!
//! `cargo bench -p fluorspar-accel --bench band_arithmetic`

mod work;

use divan::{Bencher, black_box};
use fluorspar_accel::bands;
use fluorspar_accel::{Kernel, Simd};
use work::{BANDS, Dense, Elastic, Products, terms, triangle, vector};

fn main() {
    divan::main();
}

fn cases() -> Vec<(Kernel, usize)> {
    Kernel::available().into_iter().flat_map(|kernel| BANDS.map(|bands| (kernel, bands))).collect()
}

/// Reflection of what arrives and of one light.
#[divan::bench(args = cases())]
fn elastic_vertex(bencher: Bencher, (kernel, bands): (Kernel, usize)) {
    let Some(simd) = Simd::of(kernel) else { return };
    let (r, light) = (bands::to_blocks(&vector(bands, 0.0)), bands::to_blocks(&vector(bands, 1.0)));
    let mut v = bands::to_blocks(&vector(bands, 2.0));
    let mut factor = r.clone();
    bencher.bench_local(|| {
        simd.run(Elastic(black_box(&r), black_box(&light), black_box(&mut v), black_box(&mut factor)));
    });
}

fn products(bencher: Bencher, kernel: Kernel, bands: usize, count: usize, masked: bool) {
    let Some(simd) = Simd::of(kernel) else { return };
    let terms = terms(bands, count, masked);
    let v = bands::to_blocks(&vector(bands, 1.0));
    let mut out = bands::to_blocks(&vector(bands, 2.0));
    bencher.bench_local(|| simd.run(Products(black_box(&terms), black_box(&v), black_box(&mut out))));
}

/// One fluorophore, emission only above its excitation.
#[divan::bench(args = cases())]
fn masked_separable_vertex(bencher: Bencher, (kernel, bands): (Kernel, usize)) {
    products(bencher, kernel, bands, 1, true);
}

/// One fluorophore without mask.
#[divan::bench(args = cases())]
fn separable_vertex(bencher: Bencher, (kernel, bands): (Kernel, usize)) {
    products(bencher, kernel, bands, 1, false);
}

/// Five fluorophores, masked.
#[divan::bench(args = cases())]
fn five_masked_separable(bencher: Bencher, (kernel, bands): (Kernel, usize)) {
    products(bencher, kernel, bands, 5, true);
}

/// A full matrix below its diagonal.
#[divan::bench(args = cases())]
fn triangular_matrix(bencher: Bencher, (kernel, bands): (Kernel, usize)) {
    let Some(simd) = Simd::of(kernel) else { return };
    let matrix = triangle(bands);
    let v = bands::to_blocks(&vector(bands, 1.0));
    let mut out = bands::to_blocks(&vector(bands, 2.0));
    bencher.bench_local(|| simd.run(Dense(black_box(&matrix), black_box(&v), black_box(&mut out))));
}
