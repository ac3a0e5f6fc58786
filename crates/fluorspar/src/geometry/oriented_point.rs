//! A point of a surface with its normal.

use glam::DVec3;

/// A point of a surface and the unit normal of the side from which light arrives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedPoint {
    /// Position, m.
    pub position: DVec3,
    /// Unit normal.
    pub normal: DVec3,
}
