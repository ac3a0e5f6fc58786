//! Directions toward a flat disc, nearly uniform in solid angle.

use std::f32::consts::PI;

use glam::Vec3;

/// A disc as seen from a point: its image on the sphere is a spherical ellipse.
///
/// The axes of the ellipse follow from the near and the far edge of the disc (I. Guillén et al., Area-preserving
/// parameterizations for spherical ellipses, Computer Graphics Forum 36(4), 179-187 (2017), Sec. 3). Their
/// parameterization needs the inverse of an elliptic integral for the azimuth; here the azimuth is drawn instead from
/// the flat ellipse whose semi-axes are those of the image in Lambert's equal-area projection, and the polar angle
/// exactly. The density is closed-form and exact; it is uniform for circles and for small images, and deviates by less
/// than a quarter for the most extreme ones.
#[derive(Clone, Copy, Debug)]
pub struct SphericalEllipse {
    /// Frame: along the semi-axis across the view, along the one in the plane of disc axis and eye, to the center.
    across: Vec3,
    along: Vec3,
    axis: Vec3,
    /// Squared tangents of the semi-axes.
    tan2: (f32, f32),
    /// Semi-axes in the equal-area projection: `sqrt(2 (1 - cos))`.
    flat: (f32, f32),
}

/// `1 - cos` of an angle with squared tangent `tan2`, without cancellation.
fn one_minus_cos(tan2: f32) -> f32 {
    let square = 1.0 + tan2;
    if square.is_finite() { tan2 / (square + square.sqrt()) } else { 1.0 }
}

impl SphericalEllipse {
    /// A disc with a unit `normal` as seen from `eye`. `None` near the plane of the disc, where the image degenerates.
    pub fn new(center: Vec3, normal: Vec3, radius: f32, eye: Vec3) -> Option<Self> {
        let offset = center - eye;
        let signed_height = offset.dot(normal);
        let height = signed_height.abs();
        if height < 1e-3 * radius || offset.length() > 1e3 * radius {
            // Farther than a thousand radii equal areas are equal solid angles, and the axes lose their digits.
            return None;
        }
        let up = if signed_height > 0.0 { normal } else { -normal };
        // Through the eye, across the disc: toward its center.
        let lateral = offset - up * height;
        let distance = lateral.length();
        let side =
            if distance > 1e-6 * radius { lateral / distance } else { crate::sampling::warp::tangents(up).0 };
        let (near, far) = (distance - radius, distance + radius);
        // The checks above keep the squares in range.
        let length = |x: f32| (x * x + height * height).sqrt();
        let (near_length, far_length) = (length(near), length(far));
        // Bisector of the directions to the near and the far edge, and half the angle between them.
        let near_edge = (side * near + up * height) / near_length;
        let far_edge = (side * far + up * height) / far_length;
        let axis = (near_edge + far_edge).try_normalize()?;
        let half_sine = 0.5 * (far_edge - near_edge).length();
        let tan2_along = (half_sine * half_sine) / (1.0 - half_sine * half_sine).max(1e-12);
        // The bisector meets the plane of the disc at `at`; the chord there is the other axis.
        let climb = axis.dot(up);
        let reach = height / climb;
        let at = reach * axis.dot(side) - distance;
        let chord2 = (radius - at) * (radius + at);
        if chord2 <= 0.0 || !reach.is_finite() {
            return None;
        }
        let tan2_across = chord2 / (reach * reach);
        let along = (side - axis * side.dot(axis)).try_normalize()?;
        let across = along.cross(axis);
        let flat = |tan2: f32| (2.0 * one_minus_cos(tan2)).sqrt();
        Some(Self {
            across,
            along,
            axis,
            tan2: (tan2_across, tan2_along),
            flat: (flat(tan2_across), flat(tan2_along)),
        })
    }

    /// `1 - cos` of the edge of the image, and density of the azimuth times 2, for the azimuth with these squares of
    /// cosine and sine.
    fn edge(&self, cos2: f32, sin2: f32) -> (f32, f32) {
        let one_minus = one_minus_cos(1.0 / (cos2 / self.tan2.0 + sin2 / self.tan2.1));
        let flat2 = 1.0 / (cos2 / (self.flat.0 * self.flat.0) + sin2 / (self.flat.1 * self.flat.1));
        (one_minus, flat2 / (PI * self.flat.0 * self.flat.1))
    }

    /// A unit direction toward the disc and its density, 1/sr.
    pub fn sample(&self, u: [f32; 2]) -> (Vec3, f32) {
        let (sin_t, cos_t) = (2.0 * PI * u[0]).sin_cos();
        let (x, y) = (self.flat.0 * cos_t, self.flat.1 * sin_t);
        let r2 = x * x + y * y;
        let (one_minus, twice) = self.edge(x * x / r2, y * y / r2);
        let drop = u[1] * one_minus;
        let sine = (drop * (2.0 - drop)).max(0.0).sqrt() / r2.sqrt();
        let direction = self.across * (x * sine) + self.along * (y * sine) + self.axis * (1.0 - drop);
        (direction, 0.5 * twice / one_minus)
    }

    /// Density of [`Self::sample`] for a direction that meets the disc, 1/sr.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let (x, y) = (direction.dot(self.across), direction.dot(self.along));
        let r2 = x * x + y * y;
        let (cos2, sin2) = if r2 > 0.0 { (x * x / r2, y * y / r2) } else { (1.0, 0.0) };
        let (one_minus, twice) = self.edge(cos2, sin2);
        0.5 * twice / one_minus
    }
}

#[cfg(test)]
mod tests {
    use fluorspar_testkit::{chi_square, sidak};

    use super::*;
    use crate::sampling::hash_u64;

    fn random(index: usize) -> [f32; 2] {
        let bits = hash_u64(index as u64 ^ 0xD15C_0000);
        [(bits >> 40) as f32, (bits & 0xFF_FFFF) as f32].map(|b| b / 16_777_216.0)
    }

    const EYES: [Vec3; 5] = [
        Vec3::new(0.0, 0.0, -1.0),
        Vec3::new(0.0, 0.0, -0.25),
        Vec3::new(0.7, 0.5, -0.1),
        Vec3::new(2.0, -1.0, -0.5),
        Vec3::new(1.0, 0.0, -0.2),
    ];

    fn seen_from(eye: Vec3) -> SphericalEllipse {
        SphericalEllipse::new(Vec3::ZERO, Vec3::Z, 0.8, eye).unwrap()
    }

    /// Counts per ring of equal area and sector of the disc against the integral of the density.
    #[test]
    fn directions_follow_their_density_and_meet_the_disc() {
        const RINGS: usize = 8;
        const SECTORS: usize = 16;
        const FINE: usize = 48;
        const SAMPLES: usize = 100_000;
        for eye in EYES {
            let seen = seen_from(eye);
            let mut observed = vec![0.0; RINGS * SECTORS];
            for i in 0..SAMPLES {
                let (direction, density) = seen.sample(random(i));
                assert!((direction.length() - 1.0).abs() < 1e-4);
                assert!((seen.pdf(direction) / density - 1.0).abs() < 1e-2, "{eye}: {density}");
                let at = eye - direction * (eye.z / direction.z);
                let ring = at.truncate().length_squared() / 0.64;
                assert!(ring < 1.0 + 1e-3, "{eye}: {direction} misses the disc by {ring}");
                let sector = (at.y.atan2(at.x) + PI) / (2.0 * PI) * SECTORS as f32;
                let ring = ((ring * RINGS as f32) as usize).min(RINGS - 1);
                observed[ring * SECTORS + (sector as usize).min(SECTORS - 1)] += 1.0;
            }
            let area = 0.64 * PI / (RINGS * SECTORS * FINE * FINE) as f32;
            let expected: Vec<f64> = (0..RINGS * SECTORS)
                .map(|cell| {
                    let mut sum = 0.0;
                    for k in 0..FINE * FINE {
                        let ring = (cell / SECTORS) as f32 + ((k / FINE) as f32 + 0.5) / FINE as f32;
                        let sector = (cell % SECTORS) as f32 + ((k % FINE) as f32 + 0.5) / FINE as f32;
                        let radius = 0.8 * (ring / RINGS as f32).sqrt();
                        let (sin, cos) = (sector / SECTORS as f32 * 2.0 * PI - PI).sin_cos();
                        let offset = Vec3::new(radius * cos, radius * sin, 0.0) - eye;
                        let distance2 = offset.length_squared();
                        let direction = offset / distance2.sqrt();
                        sum += f64::from(seen.pdf(direction) * direction.z / distance2 * area);
                    }
                    sum * SAMPLES as f64
                })
                .collect();
            let total = expected.iter().sum::<f64>() / SAMPLES as f64;
            assert!((total - 1.0).abs() < 2e-3, "{eye}: the density integrates to {total}");
            chi_square(&observed, &expected).assert_accepted(sidak(0.01, EYES.len()));
        }
    }

    #[test]
    fn on_the_axis_the_density_is_that_of_a_cone() {
        let density = seen_from(Vec3::new(0.0, 0.0, -1.0)).sample([0.3, 0.7]).1;
        let cone = 1.0 / (2.0 * PI * (1.0 - 1.0 / (1.0_f32 + 0.64).sqrt()));
        assert!((density / cone - 1.0).abs() < 1e-5, "{density} {cone}");
    }

    #[test]
    fn the_density_is_nearly_uniform() {
        for eye in EYES {
            let densities: Vec<f32> = (0..1000).map(|i| seen_from(eye).sample(random(i)).1).collect();
            let low = densities.iter().copied().fold(f32::INFINITY, f32::min);
            let high = densities.iter().copied().fold(0.0, f32::max);
            assert!(high / low < 1.25, "{eye}: {low} to {high}");
        }
    }
}
