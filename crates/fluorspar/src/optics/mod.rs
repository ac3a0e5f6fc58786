//! Cameras that make rays and lenses that form images.

mod ideal_lens;
mod perspective;

pub use ideal_lens::{IdealLens, LensProblem, Vignetting};
pub use perspective::PerspectiveCamera;
