//! Bin averages of a quantity on a wavelength grid.

use std::marker::PhantomData;
use std::ops::{Index, IndexMut};

use thiserror::Error;

use super::{Quantity, WavelengthGrid};
use crate::units::photons_per_joule;

/// One value per bin of a grid, in `Q::UNIT`: the quantity's density averaged over the bin.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum<Q: Quantity> {
    grid: WavelengthGrid,
    values: Vec<f64>,
    quantity: PhantomData<Q>,
}

/// Two spectra do not share a wavelength grid, or a value list does not fit its grid.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("spectra are on different wavelength grids ({left} and {right} bins); resample one of them first")]
pub struct GridMismatch {
    /// Bins on the left.
    pub left: usize,
    /// Bins on the right.
    pub right: usize,
}

impl<Q: Quantity> Spectrum<Q> {
    /// A spectrum from one value per bin.
    ///
    /// # Errors
    /// When the number of values is not the number of bins.
    pub fn new(grid: WavelengthGrid, values: Vec<f64>) -> Result<Self, GridMismatch> {
        if values.len() == grid.len() {
            Ok(Self::from_parts(grid, values))
        } else {
            Err(GridMismatch { left: values.len(), right: grid.len() })
        }
    }

    pub(crate) fn from_parts(grid: WavelengthGrid, values: Vec<f64>) -> Self {
        debug_assert_eq!(grid.len(), values.len());
        Self { grid, values, quantity: PhantomData }
    }

    /// The same value in every bin.
    pub fn constant(grid: &WavelengthGrid, value: f64) -> Self {
        Self::from_parts(grid.clone(), vec![value; grid.len()])
    }

    /// The wavelength grid.
    pub fn grid(&self) -> &WavelengthGrid {
        &self.grid
    }

    /// One value per bin, in `Q::UNIT`.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Integral over wavelength: `sum value * width`.
    pub fn integral(&self) -> f64 {
        self.values.iter().enumerate().map(|(bin, value)| value * self.grid.width_nm(bin)).sum()
    }

    /// Combines two spectra bin by bin into a spectrum of quantity `P`.
    ///
    /// # Errors
    /// When the grids differ.
    pub fn zip<R: Quantity, P: Quantity>(
        &self,
        other: &Spectrum<R>,
        f: impl Fn(f64, f64) -> f64,
    ) -> Result<Spectrum<P>, GridMismatch> {
        if self.grid != *other.grid() {
            return Err(GridMismatch { left: self.grid.len(), right: other.grid().len() });
        }
        let values = self.values.iter().zip(other.values()).map(|(&a, &b)| f(a, b)).collect();
        Ok(Spectrum::from_parts(self.grid.clone(), values))
    }

    /// Every value times a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self::from_parts(self.grid.clone(), self.values.iter().map(|v| v * factor).collect())
    }

    /// Photons for energy, bin by bin: values times `lambda/(hc)`, in photons/s where `Q` has W.
    pub fn to_photons(&self) -> Vec<f64> {
        self.values
            .iter()
            .enumerate()
            .map(|(bin, v)| v * photons_per_joule(self.grid.center_nm(bin)))
            .collect()
    }
}

impl<Q: Quantity> Index<usize> for Spectrum<Q> {
    type Output = f64;
    fn index(&self, bin: usize) -> &f64 {
        &self.values[bin]
    }
}

impl<Q: Quantity> IndexMut<usize> for Spectrum<Q> {
    fn index_mut(&mut self, bin: usize) -> &mut f64 {
        &mut self.values[bin]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectral::{Irradiance, Radiance, Reflectance};

    #[test]
    fn grids_are_never_mixed_silently() {
        let a = Spectrum::<Irradiance>::constant(&WavelengthGrid::default(), 1.0);
        let b = Spectrum::<Reflectance>::constant(&WavelengthGrid::uniform(400.0, 700.0, 10.0).unwrap(), 1.0);
        let product = a.zip::<_, Radiance>(&b, |irradiance, reflectance| irradiance * reflectance);
        assert_eq!(product, Err(GridMismatch { left: 81, right: 31 }));
    }
}
