//! Spectra of the components of a render, row by row.

use std::convert::Infallible;

use fluorspar_accel::{Lanes, Simd, Work, bands};
use rayon::prelude::*;

use super::component_image::round_to_24_bits;
use super::{ComponentFactors, ComponentImage, SpectralBasis};

/// Spectra of the components of a render, row by row: those of an image in memory, or of a file, of which only the rows of the
/// wanted components are read.
pub trait ComponentRows: Sync {
    /// Why rows can't be had.
    type Error;

    /// The basis of a component whose rows hold its coefficients.
    fn basis(&self, component: usize) -> Option<&SpectralBasis>;

    /// Whether all rows are rounded as files of runs have them ([`ComponentImage::round_as_stored`]).
    fn are_rounded(&self) -> bool {
        false
    }

    /// Calls `visit` for every row of the components that are `wanted`, in any order and from several threads, with the
    /// number of the component, the row, and its radiance `[band][col]`, W/(sr m² nm), or coefficients where [`Self::basis`] gives a basis. Returns
    /// what it returned, with component and row.
    ///
    /// # Errors
    /// Rows that can't be read.
    fn map_rows<T: Send>(
        &self,
        wanted: impl Fn(usize) -> bool + Sync,
        visit: impl Fn(usize, usize, &[f32]) -> T + Sync,
    ) -> Result<Vec<(usize, usize, T)>, Self::Error>;
}

impl ComponentRows for ComponentImage {
    type Error = Infallible;

    fn basis(&self, component: usize) -> Option<&SpectralBasis> {
        self.basis(component)
    }

    fn map_rows<T: Send>(
        &self,
        wanted: impl Fn(usize) -> bool + Sync,
        visit: impl Fn(usize, usize, &[f32]) -> T + Sync,
    ) -> Result<Vec<(usize, usize, T)>, Infallible> {
        let (width, simd) = (self.width, Simd::detect());
        let components: Vec<usize> =
            (0..self.components.len()).filter(|component| wanted(*component)).collect();
        let rows: Vec<(usize, usize)> =
            components.iter().flat_map(|component| (0..self.height).map(|row| (*component, row))).collect();
        let found = rows.into_par_iter().map_init(
            || vec![0.0_f32; width * self.grid.len()],
            |lines, (component, row)| {
                let bands = self.values_per_pixel(component);
                let lines = &mut lines[..width * bands];
                transpose(
                    simd,
                    &self.stored(component)[row * width * bands..][..width * bands],
                    bands,
                    lines,
                );
                (component, row, visit(component, row, lines))
            },
        );
        Ok(found.collect())
    }
}

/// Spectra of a row, `[col][band]`, as `[band][col]`.
struct Transposition<'a> {
    spectra: &'a [f32],
    bands: usize,
    lines: &'a mut [f32],
}

impl Work for Transposition<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        bands::transpose(lanes, self.spectra, self.bands, self.lines);
    }
}

/// Spectra of a row, `[col][band]`, as `[band][col]`. Not inlined into crates that are compiled for size.
#[inline(never)]
fn transpose(simd: Simd, spectra: &[f32], bands: usize, lines: &mut [f32]) {
    simd.run(Transposition { spectra, bands, lines });
}

/// Rows of a render as a run keeps them: rounded to the 24 bits of its file, and with the masks of factors applied.
pub struct PreparedRows<'a, R> {
    /// The rows.
    pub rows: &'a R,
    /// Factors whose maps are applied; those for whole components are left to the sum of the planes.
    pub factors: &'a ComponentFactors,
    /// Columns of the image.
    pub width: usize,
}

impl<R: ComponentRows> ComponentRows for PreparedRows<'_, R> {
    type Error = R::Error;

    fn basis(&self, component: usize) -> Option<&SpectralBasis> {
        self.rows.basis(component)
    }

    fn map_rows<T: Send>(
        &self,
        wanted: impl Fn(usize) -> bool + Sync,
        visit: impl Fn(usize, usize, &[f32]) -> T + Sync,
    ) -> Result<Vec<(usize, usize, T)>, R::Error> {
        let are_rounded = self.rows.are_rounded();
        self.rows.map_rows(wanted, |component, row, lines| {
            let mut lines = lines.to_vec();
            if let Some(basis) = self.basis(component).filter(|_| !are_rounded) {
                basis.round(&mut lines, self.width);
            }
            if !are_rounded {
                round_to_24_bits(&mut lines);
            }
            self.factors.scale_row(component, row, self.width, &mut lines);
            visit(component, row, &lines)
        })
    }
}
