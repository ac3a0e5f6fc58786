//! Layered tissue: light in plane layers that absorb, scatter and fluoresce.
//!
//! | type | what it is |
//! |---|---|
//! | [`OpticalLayer`], [`OpticalStack`] | plane layers at one wavelength, what solvers start from |
//! | [`DiscreteOrdinates`], [`LightField`] | the deterministic solver, and the light that it finds |
//!
//! Lengths are in mm or um and coefficients in 1/mm, as the names say.

mod angular_quadrature;
mod beam_source;
mod discrete_ordinates;
#[cfg(test)]
mod discrete_ordinates_tests;
mod fresnel_interface;
mod layer_modes;
mod light_field;
mod optical_layer;
mod tissue_error;

pub use discrete_ordinates::{DiscreteOrdinates, Incidence};
pub use fresnel_interface::{diffuse_reflectance, fresnel_reflectance};
pub use light_field::LightField;
pub use optical_layer::{
    ANISOTROPY, COEFFICIENT_PER_MM, OpticalLayer, OpticalStack, REFRACTIVE_INDEX, THICKNESS_MM,
};
pub use tissue_error::TissueError;
