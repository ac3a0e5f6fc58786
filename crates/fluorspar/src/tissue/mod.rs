//! Layered tissue: light in plane layers that absorb, scatter and fluoresce.
//!
//! | type | what it is |
//! |---|---|
//! | [`OpticalLayer`], [`OpticalStack`] | plane layers at one wavelength, what solvers start from |
//!
//! Lengths are in mm or um and coefficients in 1/mm, as the names say.

mod optical_layer;
mod tissue_error;

pub use optical_layer::{
    ANISOTROPY, COEFFICIENT_PER_MM, OpticalLayer, OpticalStack, REFRACTIVE_INDEX, THICKNESS_MM,
};
pub use tissue_error::TissueError;
