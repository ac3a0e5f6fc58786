//! Low-discrepancy samples, counter-based random numbers and warps to directions and surfaces.

pub mod random;
mod sobol;
pub mod warp;

pub use sobol::{SampleStream, hash_u64};
