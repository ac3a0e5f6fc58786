//! A point of a surface with its normal.

use glam::DVec3;

/// A point of a surface and the unit normal of the side from which light arrives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OrientedPoint {
    /// Position, m.
    pub(crate) position: DVec3,
    /// Unit normal.
    pub(crate) normal: DVec3,
}
