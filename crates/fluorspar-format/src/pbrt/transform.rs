//! Transforms of directives, as matrices on columns.

use glam::{DMat4, DVec3};

/// The frame of an eye at a point that looks at another: x to the right of the image, y up, z forward. `None` where the
/// points coincide, or where `up` is parallel to the view.
pub(super) fn look_at(eye: DVec3, look: DVec3, up: DVec3) -> Option<DMat4> {
    let forward = (look - eye).try_normalize()?;
    let right = up.try_normalize()?.cross(forward).try_normalize()?;
    let up = forward.cross(right);
    let frame = DMat4::from_cols(right.extend(0.0), up.extend(0.0), forward.extend(0.0), eye.extend(1.0));
    Some(frame.inverse())
}

/// Turns by degrees about an axis; `None` for an axis without length.
pub(super) fn rotate(degrees: f64, axis: DVec3) -> Option<DMat4> {
    Some(DMat4::from_axis_angle(axis.try_normalize()?, degrees.to_radians()))
}

/// The inverse of a map; `None` where it flattens space or is not finite.
pub(super) fn inverse(map: &DMat4) -> Option<DMat4> {
    let determinant = map.determinant();
    let inverse = map.inverse();
    (determinant != 0.0 && inverse.is_finite()).then_some(inverse)
}
