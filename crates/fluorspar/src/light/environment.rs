//! The same radiance from every direction beyond the scene. Spectrum: radiance, W/(sr m² nm).
//!
//! There is nothing to sample: rays that leave the scene find it.

use std::f64::consts::PI;

use super::ApparentSize;
use crate::geometry::OrientedPoint;

/// Irradiance per unit of radiance of a whole hemisphere, sr.
pub(super) const IRRADIANCE_FACTOR: f64 = PI;

pub(super) fn apparent_size(at: OrientedPoint) -> ApparentSize {
    ApparentSize::hemisphere(at)
}
