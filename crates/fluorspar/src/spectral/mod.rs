//! Wavelength grids, spectra with units, excitation-emission matrices and fluorophores.
