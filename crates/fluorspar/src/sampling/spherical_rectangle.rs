//! Directions towards a flat rectangle, uniform in solid angle.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, Vec3};

/// A rectangle as seen from a point.
///
/// Area-preserving map from the unit square to the rectangle's image on the sphere around the point: C. Ureña,
/// M. Fajardo, A. King, An area-preserving parametrization for spherical rectangles, Computer Graphics Forum 32(4),
/// 59-66 (2013). Double precision: the solid angle is a difference of angles near 2 pi.
#[derive(Clone, Copy, Debug)]
pub struct SphericalRectangle {
    x: DVec3,
    y: DVec3,
    z: DVec3,
    z0: f64,
    x0: f64,
    x1: f64,
    y0: f64,
    y1: f64,
    b0: f64,
    b1: f64,
    /// Cosine and sine of the paper's angle k.
    k: DVec2,
    solid_angle: f64,
}

/// Below this the solid angle has lost its digits; a rectangle so small and far is even in area to one part in 10^5.
const SMALLEST_SR: f64 = 1e-9;

impl SphericalRectangle {
    /// The rectangle at `corner` with two perpendicular edges as seen from `eye`. `None` when it is seen edge-on or
    /// is too small to have a solid angle in double precision.
    pub fn new(corner: Vec3, edge_u: Vec3, edge_v: Vec3, eye: Vec3) -> Option<Self> {
        let (edge_u, edge_v) = (edge_u.as_dvec3(), edge_v.as_dvec3());
        let (length_u, length_v) = (edge_u.length(), edge_v.length());
        let (x, y) = (edge_u / length_u, edge_v / length_v);
        let mut z = x.cross(y);
        let offset = corner.as_dvec3() - eye.as_dvec3();
        let mut z0 = offset.dot(z);
        if z0 > 0.0 {
            (z, z0) = (-z, -z0);
        }
        let (x0, y0) = (offset.dot(x), offset.dot(y));
        let (x1, y1) = (x0 + length_u, y0 + length_v);
        // Near the plane of the rectangle its image degenerates.
        if -z0 < 1e-6 * (length_u + length_v) {
            return None;
        }
        // z components of the unit normals of the planes through the eye and each edge. The normals of neighbours share
        // no other component, so their dot product is that of these.
        let length = |a: f64| (a * a + z0 * z0).sqrt();
        let (n0, n1, n2, n3) = (-y0 / length(y0), x1 / length(x1), y1 / length(y1), -x0 / length(x0));
        // The corner between two planes, as the cosine and sine of its angle: turns add up by complex multiplication, in
        // place of four arc cosines.
        let corner = |a: f64, b: f64| {
            let cos = (-a * b).clamp(-1.0, 1.0);
            DVec2::new(cos, (1.0 - cos * cos).sqrt())
        };
        let last = corner(n2, n3).rotate(corner(n3, n0));
        let all = corner(n0, n1).rotate(corner(n1, n2)).rotate(last);
        // The sum of the angles less 2 pi, between 0 and 2 pi; rounding may lead below 0 by much less than this.
        let excess = all.to_angle();
        let solid_angle = if excess < -SMALLEST_SR { excess + 2.0 * PI } else { excess };
        let k = DVec2::new(last.x, -last.y);
        (solid_angle > SMALLEST_SR).then_some(Self {
            x,
            y,
            z,
            z0,
            x0,
            x1,
            y0,
            y1,
            b0: n0,
            b1: n2,
            k,
            solid_angle,
        })
    }

    /// Solid angle, sr; its inverse is the density of [`Self::sample`].
    pub fn solid_angle(&self) -> f32 {
        self.solid_angle as f32
    }

    /// A point on the rectangle relative to the eye, its direction uniform in solid angle.
    pub fn sample(&self, u: [f32; 2]) -> Vec3 {
        let [u, v] = u.map(f64::from);
        let turn = DVec2::from_angle(u * self.solid_angle).rotate(self.k);
        let (cos, sin) = (turn.x, turn.y);
        let f = (cos * self.b0 - self.b1) / sin;
        let c = (1.0 / (f * f + self.b0 * self.b0).sqrt()).copysign(f).clamp(-1.0, 1.0);
        let x = (-(c * self.z0) / (1.0 - c * c).max(1e-300).sqrt()).clamp(self.x0, self.x1);
        let d2 = x * x + self.z0 * self.z0;
        let height = |y: f64| y / (d2 + y * y).sqrt();
        let h = height(self.y0) + v * (height(self.y1) - height(self.y0));
        let y = if h * h < 1.0 - 1e-12 { h * (d2 / (1.0 - h * h)).sqrt() } else { self.y1 };
        let y = y.clamp(self.y0, self.y1);
        (self.x * x + self.y * y + self.z * self.z0).as_vec3()
    }
}

#[cfg(test)]
mod tests {
    use fluorspar_testkit::{chi_square, sidak};

    use super::*;
    use crate::sampling::hash_u64;

    fn random(index: usize) -> [f32; 2] {
        let bits = hash_u64(index as u64 ^ 0x0EC7_0000);
        [(bits >> 40) as f32, (bits & 0xFF_FFFF) as f32].map(|b| b / 16_777_216.0)
    }

    /// A square of half side a at distance h: `4 asin(a^2 / (a^2 + h^2))`.
    #[test]
    fn the_solid_angle_of_a_square_on_its_axis() {
        for (a, h) in [(0.5, 1.0), (1.0, 0.01), (0.001, 1.0), (0.0005, 2.0)] {
            let corner = Vec3::new(-a, -a, h);
            let seen =
                SphericalRectangle::new(corner, Vec3::X * 2.0 * a, Vec3::Y * 2.0 * a, Vec3::ZERO).unwrap();
            let (a, h) = (f64::from(a), f64::from(h));
            let expected = 4.0 * (a * a / (a * a + h * h)).asin();
            assert!((f64::from(seen.solid_angle()) / expected - 1.0).abs() < 1e-5, "{seen:?} {expected}");
        }
    }

    /// Counts per eighth by eighth of the rectangle against their solid angles.
    #[test]
    fn points_are_uniform_in_solid_angle() {
        const SIDE: usize = 8;
        let (corner, u, v) = (Vec3::new(-0.3, 0.2, 0.7), Vec3::X * 1.2, Vec3::Y * 1.5);
        let eyes = [Vec3::ZERO, Vec3::new(0.4, 0.6, 0.69), Vec3::new(3.0, -1.0, 1.0)];
        for eye in eyes {
            let seen = SphericalRectangle::new(corner, u, v, eye).unwrap();
            let mut observed = vec![0.0; SIDE * SIDE];
            for i in 0..100_000 {
                let point = eye + seen.sample(random(i));
                assert!((point.z - 0.7).abs() < 1e-5, "off the plane: {point}");
                let cell = |x: f32, length: f32| ((x / length * SIDE as f32) as usize).min(SIDE - 1);
                observed[cell(point.y - 0.2, 1.5) * SIDE + cell(point.x + 0.3, 1.2)] += 1.0;
            }
            let expected: Vec<f64> = (0..SIDE * SIDE)
                .map(|cell| {
                    let (row, col) = ((cell / SIDE) as f32 / SIDE as f32, (cell % SIDE) as f32 / SIDE as f32);
                    let part = SphericalRectangle::new(
                        corner + u * col + v * row,
                        u / SIDE as f32,
                        v / SIDE as f32,
                        eye,
                    );
                    100_000.0 * f64::from(part.unwrap().solid_angle() / seen.solid_angle())
                })
                .collect();
            assert!((expected.iter().sum::<f64>() / 100_000.0 - 1.0).abs() < 1e-4);
            chi_square(&observed, &expected).assert_accepted(sidak(0.01, eyes.len()));
        }
    }
}
