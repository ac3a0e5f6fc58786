//! Low-discrepancy samples, counter-based random numbers, noise and warps to directions and surfaces.

pub mod random;
mod sobol;
mod spherical_ellipse;
mod spherical_rectangle;
mod value_noise;
pub mod warp;

/// Two-sided 95 % quantile of the standard normal distribution: standard deviations to each end of an interval of 95 %.
pub const Z_95: f64 = 1.959_963_984_540_054;

pub use sobol::{SampleStream, hash_u64};
pub use spherical_ellipse::SphericalEllipse;
pub use spherical_rectangle::{FlatRectangle, SphericalRectangle};
pub use value_noise::{fractal_noise, smoothstep};
