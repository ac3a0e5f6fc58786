//! Time per call of the band arithmetic of one path vertex, for each kernel that this machine runs.
//!
//! `cargo bench -p fluorspar-accel --bench band_arithmetic`

use divan::{Bencher, black_box};
use fluorspar_accel::bands::{self, BandBlock, BandMatrix, OuterProduct};
use fluorspar_accel::{Kernel, Lanes, Simd, Work};

fn main() {
    divan::main();
}

const BANDS: [usize; 4] = [31, 69, 81, 128];

fn cases() -> Vec<(Kernel, usize)> {
    Kernel::available().into_iter().flat_map(|kernel| BANDS.map(|bands| (kernel, bands))).collect()
}

fn vector(bands: usize, phase: f32) -> Vec<f32> {
    (0..bands).map(|band| 0.6 + 0.3 * (0.2 * band as f32 + phase).sin()).collect()
}

fn bump(bands: usize, centre: f32, width: f32) -> Vec<f32> {
    let nm = |band: usize| 350.0 + 400.0 * band as f32 / bands as f32;
    (0..bands).map(|band| (-((nm(band) - centre) / width).powi(2)).exp()).collect()
}

struct Elastic<'a>(&'a [BandBlock], &'a [BandBlock], &'a mut [BandBlock], &'a mut [BandBlock]);

impl Work for Elastic<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        bands::reflection_factor(lanes, 0.7, self.0, 0.05, self.3);
        bands::multiply(lanes, self.3, self.2);
        bands::add_reflected(lanes, 0.2, self.0, 0.05, self.1, self.2);
    }
}

/// Reflection of what arrives and of one lamp.
#[divan::bench(args = cases())]
fn elastic_vertex(bencher: Bencher, (kernel, bands): (Kernel, usize)) {
    let Some(simd) = Simd::of(kernel) else { return };
    let (r, lamp) = (bands::to_blocks(&vector(bands, 0.0)), bands::to_blocks(&vector(bands, 1.0)));
    let mut v = bands::to_blocks(&vector(bands, 2.0));
    let mut factor = r.clone();
    bencher.bench_local(|| {
        simd.run(Elastic(black_box(&r), black_box(&lamp), black_box(&mut v), black_box(&mut factor)));
    });
}

struct Products<'a>(&'a [OuterProduct], &'a [BandBlock], &'a mut [BandBlock]);

impl Work for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        for term in self.0 {
            term.add_product(lanes, 0.3, self.1, self.2);
        }
    }
}

fn products(bencher: Bencher, kernel: Kernel, bands: usize, terms: usize, masked: bool) {
    let Some(simd) = Simd::of(kernel) else { return };
    let terms: Vec<OuterProduct> = (0..terms)
        .map(|i| {
            let shift = 12.0 * i as f32;
            let (excitation, emission) = (bump(bands, 380.0 + shift, 40.0), bump(bands, 460.0 + shift, 30.0));
            if masked {
                OuterProduct::below_diagonal(&excitation, &emission, &bump(bands, 420.0 + shift, 20.0))
            } else {
                OuterProduct::new(&excitation, &emission)
            }
        })
        .collect();
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

struct Dense<'a>(&'a BandMatrix, &'a [BandBlock], &'a mut [BandBlock]);

impl Work for Dense<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        self.0.add_product(lanes, 0.3, self.1, self.2);
    }
}

/// A full matrix below its diagonal.
#[divan::bench(args = cases())]
fn triangular_matrix(bencher: Bencher, (kernel, bands): (Kernel, usize)) {
    let Some(simd) = Simd::of(kernel) else { return };
    let matrix = BandMatrix::new(bands, |row, column| if row > column { 0.01 } else { 0.0 });
    let v = bands::to_blocks(&vector(bands, 1.0));
    let mut out = bands::to_blocks(&vector(bands, 2.0));
    bencher.bench_local(|| simd.run(Dense(black_box(&matrix), black_box(&v), black_box(&mut out))));
}
