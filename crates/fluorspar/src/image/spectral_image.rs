//! `[row, col, band]` images of one quantity.

use std::marker::PhantomData;

use thiserror::Error;

use crate::spectral::{Quantity, Spectrum, WavelengthGrid};

/// An image with one spectrum per pixel, in `Q::UNIT`: `[row, col, band]`, f32, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct SpectralImage<Q: Quantity> {
    grid: WavelengthGrid,
    width: usize,
    height: usize,
    data: Vec<f32>,
    quantity: PhantomData<Q>,
}

/// Data that do not fill the image they are meant for.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{values} values do not fill an image of {height} rows, {width} columns and {bands} bands")]
pub struct ImageShapeError {
    /// Values given.
    pub values: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Bands.
    pub bands: usize,
}

impl<Q: Quantity> SpectralImage<Q> {
    /// A black image.
    pub fn zeros(grid: WavelengthGrid, width: usize, height: usize) -> Self {
        let data = vec![0.0; width * height * grid.len()];
        Self { grid, width, height, data, quantity: PhantomData }
    }

    /// An image from its values in `[row, col, band]` order.
    ///
    /// # Errors
    /// When the number of values is not `height * width * bands`.
    pub fn from_data(
        grid: WavelengthGrid,
        width: usize,
        height: usize,
        data: Vec<f32>,
    ) -> Result<Self, ImageShapeError> {
        if data.len() != width * height * grid.len() {
            return Err(ImageShapeError { values: data.len(), height, width, bands: grid.len() });
        }
        Ok(Self { grid, width, height, data, quantity: PhantomData })
    }

    /// The wavelength grid.
    pub fn grid(&self) -> &WavelengthGrid {
        &self.grid
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Bands.
    pub fn bands(&self) -> usize {
        self.grid.len()
    }

    /// All values, `[row, col, band]`.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// All values, `[row, col, band]`.
    pub fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// The spectrum of one pixel.
    pub fn pixel(&self, row: usize, col: usize) -> &[f32] {
        let bands = self.bands();
        let start = (row * self.width + col) * bands;
        &self.data[start..start + bands]
    }

    /// The spectrum of one pixel.
    pub fn pixel_mut(&mut self, row: usize, col: usize) -> &mut [f32] {
        let bands = self.bands();
        let start = (row * self.width + col) * bands;
        &mut self.data[start..start + bands]
    }

    /// Adds another image of the same grid and size.
    ///
    /// # Panics
    /// In debug builds, when grids or sizes differ.
    pub fn add(&mut self, other: &Self) {
        debug_assert!(self.grid() == other.grid() && self.data.len() == other.data.len());
        for (sum, value) in self.data.iter_mut().zip(&other.data) {
            *sum += value;
        }
    }

    /// Mean spectrum over all pixels, accumulated in f64.
    pub fn mean_spectrum(&self) -> Spectrum<Q> {
        let mut sums = vec![0.0; self.bands()];
        for pixel in self.data.chunks_exact(self.bands()) {
            for (sum, &value) in sums.iter_mut().zip(pixel) {
                *sum += f64::from(value);
            }
        }
        let pixels = (self.width * self.height).max(1) as f64;
        Spectrum::from_parts(self.grid.clone(), sums.into_iter().map(|sum| sum / pixels).collect())
    }
}
