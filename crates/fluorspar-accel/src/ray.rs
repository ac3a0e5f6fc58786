//! Rays, hits, and the one place where a hit is computed.

use glam::Vec3;

use crate::wide_tree::TrianglePack;

/// The points `origin + t direction` with `t_min < t < t_max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where `t = 0`, in the unit of the mesh.
    pub origin: Vec3,
    /// Unit vector. Components may be zero, of either sign.
    pub direction: Vec3,
    /// Hits at or before this distance are ignored. A ray has nothing behind its origin: negative values count as zero.
    pub t_min: f32,
    /// Hits at or beyond this distance are ignored. May be infinite.
    pub t_max: f32,
}

/// Where a ray meets a triangle: `(1 - u - v) p0 + u p1 + v p2`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, in the unit of the mesh.
    pub t: f32,
    /// Weight of the triangle's second vertex.
    pub u: f32,
    /// Weight of the triangle's third vertex.
    pub v: f32,
    /// Number of the triangle in the input, from 0.
    pub triangle: u32,
}

/// Values computed once per ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayFrame {
    /// Origin, x y z.
    pub(crate) origin: [f32; 3],
    /// `1 / direction`, x y z; infinite where the direction is zero.
    pub(crate) inverse: [f32; 3],
    /// Rows of [`crate::wide_tree::WideNode::planes`] that the ray crosses first, x y z.
    pub(crate) near: [usize; 3],
    /// Rows that it crosses last.
    pub(crate) far: [usize; 3],
    /// Axes in the order of the sheared frame: the last is the one along which the ray moves fastest.
    pub(crate) axes: [usize; 3],
    /// Shear that makes the direction `(0, 0, 1)`: `dx/dz`, `dy/dz`, `1/dz` in the order of `axes`.
    pub(crate) shear: [f32; 3],
    /// `t_min`, at least 0.
    pub(crate) t_min: f32,
}

/// Slack for box distances, relative: distances to the far planes and to the best hit are multiplied by this before
/// comparison with the near planes.
///
/// With unit roundoff `r = 2^-24`, each slab distance is off by at most `3 r` and the sheared coordinates of the
/// triangle test by at most `4 r` (Ize 2013, section 3, does the count for the slabs alone), so `2 (3 + 4) r < 16 r`.
pub(crate) const FAR_SLACK: f32 = 1.0 + 8.0 * f32::EPSILON;

impl RayFrame {
    #[inline(always)]
    pub(crate) fn new(ray: &Ray) -> Self {
        let origin = ray.origin.to_array();
        let direction = ray.direction.to_array();
        let inverse = direction.map(|d| 1.0 / d);
        let [ax, ay, az] = direction.map(f32::abs);
        let axes = if az >= ax && az >= ay {
            [0, 1, 2]
        } else if ay >= ax {
            [2, 0, 1]
        } else {
            [1, 2, 0]
        };
        let along = direction[axes[2]];
        let shear = [direction[axes[0]] / along, direction[axes[1]] / along, 1.0 / along];
        let behind = |axis: usize| 3 * usize::from(inverse[axis].is_sign_negative());
        let near = [behind(0), 1 + behind(1), 2 + behind(2)];
        let far = [3 - behind(0), 4 - behind(1), 5 - behind(2)];
        let t_min = if ray.t_min < 0.0 { 0.0 } else { ray.t_min };
        Self { origin, inverse, near, far, axes, shear, t_min }
    }

    /// Where the line of the ray meets triangle `lane` of `pack`, as `(t, u, v)`; `t` may have any value.
    ///
    /// Woop, Benthin and Wald (2013): relative to the origin and sheared so that the ray runs along +z, the triangle
    /// contains the ray if the edge functions `U = Cx By - Cy Bx`, `V = Ax Cy - Ay Cx`, `W = Bx Ay - By Ax` do not
    /// differ in sign; divided by their sum they are the weights of the corners. Two triangles compute the function of a
    /// shared edge from the same numbers, so rounding cannot open a gap. Coordinates are in single precision, edge
    /// functions in double, in which the products are exact and the signs right.
    ///
    /// Every kernel gets its hits from here, so they agree in every bit.
    #[inline(always)]
    pub(crate) fn intersect(&self, pack: &TrianglePack, lane: usize) -> Option<(f32, f32, f32)> {
        let [kx, ky, kz] = self.axes;
        let [sx, sy, sz] = self.shear;
        let vertices = [pack.vertex(0, lane), pack.vertex(1, lane), pack.vertex(2, lane)];
        let relative = |axis: usize, corner: usize| pack.vertices[axis][vertices[corner]] - self.origin[axis];
        let z = [relative(kz, 0), relative(kz, 1), relative(kz, 2)];
        let x = [relative(kx, 0) - sx * z[0], relative(kx, 1) - sx * z[1], relative(kx, 2) - sx * z[2]];
        let y = [relative(ky, 0) - sy * z[0], relative(ky, 1) - sy * z[1], relative(ky, 2) - sy * z[2]];
        let (x, y, z) = (x.map(f64::from), y.map(f64::from), z.map(f64::from));
        let a = x[2] * y[1] - y[2] * x[1];
        let b = x[0] * y[2] - y[0] * x[2];
        let c = x[1] * y[0] - y[1] * x[0];
        // Comparisons are written so that NaN is outside.
        let inside = (a >= 0.0 && b >= 0.0 && c >= 0.0) || (a <= 0.0 && b <= 0.0 && c <= 0.0);
        let sum = a + b + c;
        if !inside || sum == 0.0 {
            return None;
        }
        let scale = 1.0 / sum;
        let t = (a * z[0] + b * z[1] + c * z[2]) * scale * f64::from(sz);
        Some((t as f32, (b * scale) as f32, (c * scale) as f32))
    }
}
