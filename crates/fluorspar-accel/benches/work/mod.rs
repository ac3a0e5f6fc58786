//! What one vertex of a path does with its spectra: shared by the benchmarks that time it and that count its
//! instructions.
#![allow(unreachable_pub)]

use fluorspar_accel::bands::{self, BandBlock, BandMatrix, OuterProduct};
use fluorspar_accel::{Lanes, Work};

pub const BANDS: [usize; 4] = [31, 69, 81, 128];

pub fn vector(bands: usize, phase: f32) -> Vec<f32> {
    (0..bands).map(|band| 0.6 + 0.3 * (0.2 * band as f32 + phase).sin()).collect()
}

fn bump(bands: usize, center: f32, width: f32) -> Vec<f32> {
    let nm = |band: usize| 350.0 + 400.0 * band as f32 / bands as f32;
    (0..bands).map(|band| (-((nm(band) - center) / width).powi(2)).exp()).collect()
}

/// Fluorophores of one term each.
pub fn terms(bands: usize, count: usize, masked: bool) -> Vec<OuterProduct> {
    (0..count)
        .map(|i| {
            let shift = 12.0 * i as f32;
            let (excitation, emission) = (bump(bands, 380.0 + shift, 40.0), bump(bands, 460.0 + shift, 30.0));
            if masked {
                OuterProduct::below_diagonal(&excitation, &emission, &bump(bands, 420.0 + shift, 20.0))
            } else {
                OuterProduct::new(&excitation, &emission)
            }
        })
        .collect()
}

/// A full matrix below its diagonal.
pub fn triangle(bands: usize) -> BandMatrix {
    BandMatrix::new(bands, |row, column| if row > column { 0.01 } else { 0.0 })
}

/// Reflection of what arrives and of one light; the last vector is working memory.
pub struct Elastic<'a>(
    pub &'a [BandBlock],
    pub &'a [BandBlock],
    pub &'a mut [BandBlock],
    pub &'a mut [BandBlock],
);

impl Work for Elastic<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        bands::reflection_factor(lanes, 0.7, self.0, 0.05, self.3);
        bands::multiply(lanes, self.3, self.2);
        bands::add_reflected(lanes, 0.2, self.0, 0.05, self.1, self.2);
    }
}

/// Fluorescence of separable terms.
pub struct Products<'a>(pub &'a [OuterProduct], pub &'a [BandBlock], pub &'a mut [BandBlock]);

impl Work for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        for term in self.0 {
            term.add_product(lanes, 0.3, self.1, self.2);
        }
    }
}

/// Fluorescence of a full matrix.
pub struct Dense<'a>(pub &'a BandMatrix, pub &'a [BandBlock], pub &'a mut [BandBlock]);

impl Work for Dense<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        self.0.add_product(lanes, 0.3, self.1, self.2);
    }
}
