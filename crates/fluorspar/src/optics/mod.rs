//! Cameras that make rays and lenses that turn scene radiance into irradiance on the sensor.

mod ideal_lens;
mod perspective;

pub use ideal_lens::{IdealLens, LensProblem, Vignetting};
pub use perspective::PerspectiveCamera;
