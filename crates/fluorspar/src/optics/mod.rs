//! What turns scene radiance into irradiance on the sensor.

mod ideal_lens;

pub use ideal_lens::{IdealLens, LensProblem, Vignetting};
