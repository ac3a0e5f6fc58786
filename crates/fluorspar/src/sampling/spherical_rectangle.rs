//! Directions toward a flat rectangle, uniform in solid angle.

use glam::{Vec2, Vec3};

/// A flat rectangle in a frame of its own.
#[derive(Clone, Copy, Debug)]
pub struct FlatRectangle {
    corner: Vec3,
    /// Unit vectors along the edges, and perpendicular to both.
    axes: [Vec3; 3],
    /// Of the edges.
    lengths: Vec2,
}

impl FlatRectangle {
    /// The rectangle at `corner` with two perpendicular edges that are not zero.
    pub fn new(corner: Vec3, edge_u: Vec3, edge_v: Vec3) -> Self {
        let (x, y) = (edge_u.normalize(), edge_v.normalize());
        Self { corner, axes: [x, y, x.cross(y)], lengths: Vec2::new(edge_u.length(), edge_v.length()) }
    }

    /// Area.
    pub fn area(&self) -> f32 {
        self.lengths.x * self.lengths.y
    }

    /// Unit normal, on the side from which u to v runs counterclockwise.
    pub fn normal(&self) -> Vec3 {
        self.axes[2]
    }

    /// Where both edges start.
    pub fn corner(&self) -> Vec3 {
        self.corner
    }

    /// Center.
    pub fn center(&self) -> Vec3 {
        self.at([0.5, 0.5])
    }

    /// Distance of the corners from the center.
    pub fn radius(&self) -> f32 {
        0.5 * self.lengths.length()
    }

    /// A point at shares 0 to 1 of the edges.
    pub fn at(&self, [u, v]: [f32; 2]) -> Vec3 {
        self.corner + self.axes[0] * (u * self.lengths.x) + self.axes[1] * (v * self.lengths.y)
    }

    /// Whether a point of the rectangle's plane lies on it.
    pub fn contains(&self, point: Vec3) -> bool {
        let local = point - self.corner;
        let (x, y) = (local.dot(self.axes[0]), local.dot(self.axes[1]));
        (0.0..=self.lengths.x).contains(&x) && (0.0..=self.lengths.y).contains(&y)
    }
}

/// A rectangle as seen from a point.
///
/// Area-preserving map from the unit square to the rectangle's image on the sphere around the point: C. Ureña,
/// M. Fajardo, A. King, An area-preserving parametrization for spherical rectangles, Computer Graphics Forum 32(4),
/// 59-66 (2013). The solid angle is not their sum of angles less 2 pi, which loses its digits, but that of two
/// triangles by A. van Oosterom, J. Strackee, IEEE Trans. Biomed. Eng. 30(2), 125-126 (1983), whose terms add up.
///
/// Single precision where that will do; double where the rectangle is small and far, or seen at a grazing angle.
#[derive(Clone, Copy, Debug)]
pub struct SphericalRectangle {
    /// Unit vectors along the edges, and perpendicular to both on the side of the eye.
    axes: [Vec3; 3],
    seen: Seen,
}

#[derive(Clone, Copy, Debug)]
enum Seen {
    Single(single::Map),
    Double(double::Map),
}

impl SphericalRectangle {
    /// A rectangle as seen from `eye`. `None` when it is seen edge-on, or so small and far that it is even in area to one
    /// part in 10^5.
    #[inline]
    pub fn new(rectangle: &FlatRectangle, eye: Vec3) -> Option<Self> {
        let FlatRectangle { corner, axes: [x, y, mut z], lengths } = *rectangle;
        let offset = corner - eye;
        let mut height = -offset.dot(z);
        if height < 0.0 {
            (z, height) = (-z, -height);
        }
        // Near the plane of the rectangle its image degenerates.
        if height < 1e-6 * (lengths.x + lengths.y) {
            return None;
        }
        let start = Vec2::new(offset.dot(x), offset.dot(y));
        let reach = start.abs().max((start + lengths).abs());
        let seen = if height > GRAZING * reach.max_element() {
            single::Map::new(start.to_array(), lengths.to_array(), height, 1e-3).map(Seen::Single)
        } else {
            None
        };
        let seen = seen.or_else(|| {
            let corner = corner.as_dvec3() - eye.as_dvec3();
            let start = [corner.dot(x.as_dvec3()), corner.dot(y.as_dvec3())];
            let height = corner.dot(z.as_dvec3()).abs();
            double::Map::new(start, lengths.as_dvec2().to_array(), height, 1e-9).map(Seen::Double)
        });
        seen.map(|seen| Self { axes: [x, y, z], seen })
    }

    /// Solid angle, sr; its inverse is the density of [`Self::sample`].
    #[inline]
    pub fn solid_angle(&self) -> f32 {
        match &self.seen {
            Seen::Single(map) => map.solid_angle,
            Seen::Double(map) => map.solid_angle as f32,
        }
    }

    /// A point on the rectangle relative to the eye, its direction uniform in solid angle.
    #[inline]
    pub fn sample(&self, u: [f32; 2]) -> Vec3 {
        let [x, y, z] = self.axes;
        let [along_x, along_y, height] = match &self.seen {
            Seen::Single(map) => map.sample(u),
            Seen::Double(map) => map.sample(u.map(f64::from)).map(|v| v as f32),
        };
        x * along_x + y * along_y - z * height
    }
}

/// Height over the rectangle, as a share of how far it reaches to the side, below which it is seen at a grazing angle: single
/// precision keeps solid angles to 4e-6 above (see the tests).
const GRAZING: f32 = 0.05;

/// The same map in single and double precision.
macro_rules! spherical_map {
    ($name:ident, $float:ident, $complex:ident) => {
        mod $name {
            use glam::$complex;

            /// A rectangle under an eye, edges along x and y; lengths in units of the height.
            #[derive(Clone, Copy, Debug)]
            pub(super) struct Map {
                height: $float,
                /// Where the edges lie.
                x: [$float; 2],
                y: [$float; 2],
                /// `1 + x[0]^2` and `1 + y[0]^2`.
                rest: [$float; 2],
                /// In the direction of the paper's angle k, and as long as the planes' normals make it.
                k: $complex,
                pub(super) solid_angle: $float,
            }

            impl Map {
                /// `None` below the `least` solid angle.
                #[inline]
                pub(super) fn new(
                    start: [$float; 2],
                    lengths: [$float; 2],
                    height: $float,
                    least: $float,
                ) -> Option<Self> {
                    let scale = 1.0 / height;
                    let ([x0, y0], [width, length]) = (start.map(|a| a * scale), lengths.map(|a| a * scale));
                    let (x1, y1) = (x0 + width, y0 + length);

                    // Distances of the corners, counterclockwise.
                    let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
                    let r = corners.map(|[x, y]| (x * x + y * y + 1.0).sqrt());
                    let dot = |a: usize, b: usize| {
                        corners[a][0] * corners[b][0] + corners[a][1] * corners[b][1] + 1.0
                    };
                    // Halves of the triangles' solid angles as complex numbers; their product has the sum of the angles.
                    let volume = width * length;
                    let triangle = |a: usize, b: usize, c: usize| {
                        let sum = r[a] * r[b] * r[c] + dot(a, b) * r[c] + dot(a, c) * r[b] + dot(b, c) * r[a];
                        $complex::new(sum, volume)
                    };
                    let both = triangle(0, 1, 2).rotate(triangle(0, 2, 3));
                    let solid_angle = 2.0 * both.y.atan2(both.x);
                    if solid_angle < least {
                        return None;
                    }
                    // The angle at a corner between the planes through the eye and two edges: where these are at a and b
                    // from the foot of the height, its cosine goes as -a b and its sine as the distance of the corner.
                    // Angles add up by complex multiplication.
                    let last = $complex::new(x0 * y1, r[3]).rotate($complex::new(-x0 * y0, r[0]));
                    Some(Self {
                        height,
                        x: [x0, x1],
                        y: [y0, y1],
                        rest: [1.0 + x0 * x0, 1.0 + y0 * y0],
                        k: $complex::new(last.x, -last.y),
                        solid_angle,
                    })
                }

                /// Where on the rectangle, and the height.
                #[inline]
                pub(super) fn sample(&self, [u, v]: [$float; 2]) -> [$float; 3] {
                    let Self { height, x: [x0, x1], y: [y0, y1], rest: [rest_x, rest_y], k, solid_angle } =
                        *self;
                    let turn = $complex::from_angle(u * solid_angle).rotate(k);
                    // The paper's f times sqrt(1 + y0^2), with the lengths of the normals multiplied out. Where rounding
                    // leaves no number, the nearest edge is as good.
                    let f = -(turn.x * y0 + y1 * rest_x * rest_y) / turn.y;
                    let x = (rest_y / (f * f - 1.0).max($float::MIN_POSITIVE)).sqrt();
                    let x = x.copysign(f).max(x0).min(x1);
                    let d2 = x * x + 1.0;
                    let sine = |y: $float| y / (d2 + y * y).sqrt();
                    let h = sine(y0) + v * (sine(y1) - sine(y0));
                    let y = h * (d2 / (1.0 - h * h).max($float::MIN_POSITIVE)).sqrt();
                    [x * height, y.max(y0).min(y1) * height, height]
                }
            }
        }
    };
}

spherical_map!(single, f32, Vec2);
spherical_map!(double, f64, DVec2);

#[cfg(test)]
mod tests {
    use fluorspar_testkit::{chi_square, sidak};

    use super::*;
    use crate::sampling::hash_u64;

    fn random(index: usize) -> [f32; 2] {
        let bits = hash_u64(index as u64 ^ 0x0EC7_0000);
        [(bits >> 40) as f32, (bits & 0xFF_FFFF) as f32].map(|b| b / 16_777_216.0)
    }

    /// Solid angle of a rectangle in the plane `z` from the origin, in double precision: the four rectangles that end
    /// under the eye, with signs.
    fn reference(x: [f64; 2], y: [f64; 2], z: f64) -> f64 {
        let part = |x: f64, y: f64| (x * y / (z * (x * x + y * y + z * z).sqrt())).atan();
        part(x[1], y[1]) - part(x[0], y[1]) - part(x[1], y[0]) + part(x[0], y[0])
    }

    #[test]
    fn solid_angles_near_and_far_and_of_strips() {
        let mut seen = 0;
        for i in 0..20_000 {
            let [a, b] = random(4 * i).map(|u| 8.0 * u - 4.0);
            let [width, length] = random(4 * i + 1).map(|u| 10_f32.powf(3.0 * u - 2.0));
            let z = 10_f32.powf(4.0 * random(4 * i + 2)[0] - 3.0);
            let corner = Vec3::new(a, b, z);
            let rectangle = FlatRectangle::new(corner, Vec3::X * width, Vec3::Y * length);
            let expected = reference(
                [f64::from(a), f64::from(a) + f64::from(width)],
                [f64::from(b), f64::from(b) + f64::from(length)],
                f64::from(z),
            );
            let view = SphericalRectangle::new(&rectangle, Vec3::ZERO);
            let Some(view) = view else {
                let low = z < 1.01e-6 * (width + length);
                assert!(low || expected < 1.001e-9, "{rectangle:?}: {expected} sr");
                continue;
            };
            seen += 1;
            // Sixty roundings of single precision; the worst of these cases is off by 3.5e-6.
            let error = f64::from(view.solid_angle()) / expected - 1.0;
            assert!(error.abs() < 7.2e-6, "{rectangle:?}: {expected} sr, off by {error}");
        }
        assert!(seen > 10_000, "{seen}");
    }

    /// A square of half side a at distance h: `4 asin(a^2 / (a^2 + h^2))`.
    #[test]
    fn the_solid_angle_of_a_square_on_its_axis() {
        for (a, h) in [(0.5, 1.0), (1.0, 0.01), (0.01, 1.0), (0.0001, 0.002), (300.0, 4000.0)] {
            let corner = Vec3::new(-a, -a, h);
            let square = FlatRectangle::new(corner, Vec3::X * 2.0 * a, Vec3::Y * 2.0 * a);
            let seen = SphericalRectangle::new(&square, Vec3::ZERO).unwrap();
            let (a, h) = (f64::from(a), f64::from(h));
            let expected = 4.0 * (a * a / (a * a + h * h)).asin();
            assert!((f64::from(seen.solid_angle()) / expected - 1.0).abs() < 1e-5, "{seen:?} {expected}");
        }
    }

    /// Counts per eighth by eighth of the rectangle against their solid angles.
    #[test]
    fn points_are_uniform_in_solid_angle() {
        const SIDE: usize = 8;
        const POINTS: usize = 100_000;
        let corner = Vec3::new(-0.3, 0.2, 0.7);
        let (square, strip) = ([1.2, 1.5], [0.01, 2.0]);
        let cases = [
            (square, Vec3::ZERO),
            (square, Vec3::new(0.4, 0.6, 0.69)),
            (square, Vec3::new(3.0, -1.0, 1.0)),
            // Small, smaller than single precision allows, and grazing.
            (square, Vec3::new(20.0, 20.0, -20.0)),
            (square, Vec3::new(400.0, 500.0, -500.0)),
            (square, Vec3::new(2.0, 3.0, 0.703)),
            (strip, Vec3::new(0.3, 1.0, 1.2)),
        ];
        for ([width, length], eye) in cases {
            let rectangle = FlatRectangle::new(corner, Vec3::X * width, Vec3::Y * length);
            let seen = SphericalRectangle::new(&rectangle, eye).unwrap();
            let mut observed = vec![0.0; SIDE * SIDE];
            for i in 0..POINTS {
                let point = eye + seen.sample(random(i));
                assert!((point.z - 0.7).abs() < 1e-5 * eye.length().max(1.0), "off the plane: {point}");
                let cell = |x: f32, length: f32| ((x / length * SIDE as f32) as usize).min(SIDE - 1);
                observed[cell(point.y - corner.y, length) * SIDE + cell(point.x - corner.x, width)] += 1.0;
            }
            let edge = |low: f32, length: f32, eye: f32, part: usize| {
                [part, part + 1].map(|p| f64::from(low - eye) + f64::from(length) * p as f64 / SIDE as f64)
            };
            let expected: Vec<f64> = (0..SIDE * SIDE)
                .map(|cell| {
                    let x = edge(corner.x, width, eye.x, cell % SIDE);
                    let y = edge(corner.y, length, eye.y, cell / SIDE);
                    let part = reference(x, y, f64::from((corner.z - eye.z).abs()));
                    POINTS as f64 * part / f64::from(seen.solid_angle())
                })
                .collect();
            assert!((expected.iter().sum::<f64>() / POINTS as f64 - 1.0).abs() < 1e-4, "{eye}");
            chi_square(&observed, &expected).assert_accepted(sidak(0.01, cases.len()));
        }
    }
}
