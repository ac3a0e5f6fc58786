//! Parameters of light sources that are out of range.

use thiserror::Error;

/// Largest exponent of an emission pattern that is accepted: a half angle of about 3 degrees.
pub(super) const MAX_EXPONENT: f32 = 1000.0;

/// An error of an emitter.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum EmitterError {
    /// A length is zero, negative or not finite.
    #[error("the {quantity} must be a positive length; got {value_m} m")]
    Length {
        /// Which length.
        quantity: &'static str,
        /// Its value, m.
        value_m: f32,
    },
    /// The hole of a ring is as large as the ring, or larger.
    #[error("the inner radius {inner_m} m must be smaller than the outer radius {outer_m} m")]
    Hole {
        /// Inner radius, m.
        inner_m: f32,
        /// Outer radius, m.
        outer_m: f32,
    },
    /// The angles of a cone are out of range.
    #[error(
        "the cone is even up to {inner_deg} and dark from {outer_deg} degrees; the first must be 0 or more and not above the second, that \
         0.01 to 180 degrees"
    )]
    Cone {
        /// Angle up to which it is even, degrees.
        inner_deg: f64,
        /// Angle from which on it is dark, degrees.
        outer_deg: f64,
    },
    /// The exponent of the emission pattern is out of range.
    #[error(
        "the emission exponent {exponent} is not between {lowest} and {}; for a flat source 1 is Lambertian (a half angle of 60 degrees)",
        MAX_EXPONENT
    )]
    Exponent {
        /// The exponent.
        exponent: f32,
        /// The lowest that the shape has.
        lowest: f32,
    },
}

/// Checks a length.
pub(super) fn check_length(quantity: &'static str, value_m: f32) -> Result<(), EmitterError> {
    if value_m > 0.0 && value_m.is_finite() {
        return Ok(());
    }
    Err(EmitterError::Length { quantity, value_m })
}
