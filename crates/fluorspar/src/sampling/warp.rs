//! Warps from the unit square to directions and surfaces, each with its density.
//!
//! Directions are unit vectors in a local frame whose normal is +z. Every warp is held to its density by a
//! chi-square test.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

/// Unit square to unit disc, area-preserving (Shirley and Chiu 1997). Density `1/pi`.
#[inline]
pub fn concentric_disc(u: [f32; 2]) -> Vec2 {
    let x = 2.0 * u[0] - 1.0;
    let y = 2.0 * u[1] - 1.0;
    // Which is larger is as good as random: both sectors are computed alike, and a select takes the place of a jump.
    let wide = x.abs() > y.abs();
    let (radius, other) = if wide { (x, y) } else { (y, x) };
    let ratio = if radius == 0.0 { 0.0 } else { other / radius };
    let (sin, cos) = sin_cos_eighth(PI / 4.0 * ratio);
    let (along, across) = (radius * cos, radius * sin);
    if wide { Vec2::new(along, across) } else { Vec2::new(across, along) }
}

/// Sine and cosine of an angle between `-pi/4` and `pi/4`, to 2e-7: Taylor series.
#[inline]
fn sin_cos_eighth(angle: f32) -> (f32, f32) {
    let x2 = angle * angle;
    let sin = angle * (1.0 + x2 * (-1.0 / 6.0 + x2 * (1.0 / 120.0 + x2 * (-1.0 / 5040.0 + x2 / 362_880.0))));
    let cos = 1.0 + x2 * (-0.5 + x2 * (1.0 / 24.0 + x2 * (-1.0 / 720.0 + x2 / 40_320.0)));
    (sin, cos)
}

/// Cosine-weighted direction on the upper hemisphere. Density `cos(theta) / pi`, 1/sr.
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let d = concentric_disc(u);
    Vec3::new(d.x, d.y, (1.0 - d.length_squared()).max(0.0).sqrt())
}

/// Uniform direction on the sphere. Density `1 / (4 pi)`.
pub fn uniform_sphere(u: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u[0];
    let r = (1.0 - z * z).max(0.0).sqrt();
    let phi = 2.0 * PI * u[1];
    Vec3::new(r * phi.cos(), r * phi.sin(), z)
}

/// Barycentric coordinates `(u, v)` uniform over a triangle (Heitz 2019). Density `1 / area`.
pub fn triangle(u: [f32; 2]) -> [f32; 2] {
    if u[1] > u[0] {
        let x = 0.5 * u[0];
        [x, u[1] - x]
    } else {
        let y = 0.5 * u[1];
        [u[0] - y, y]
    }
}

/// An orthonormal frame around a unit vector (Duff et al., JCGT 6(1), 2017): the two tangents.
pub fn tangents(normal: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f32.copysign(normal.z);
    let a = -1.0 / (sign + normal.z);
    let b = normal.x * normal.y * a;
    (
        Vec3::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x),
        Vec3::new(b, sign + normal.y * normal.y * a, -normal.y),
    )
}

#[cfg(test)]
mod tests {
    use fluorspar_testkit::{chi_square, chi_square_over_sphere, sidak};

    use super::*;

    #[test]
    fn sines_and_cosines_of_small_angles() {
        for i in -1000..=1000 {
            let angle = PI / 4.0 * i as f32 / 1000.0;
            let (sin, cos) = sin_cos_eighth(angle);
            let (true_sin, true_cos) = f64::from(angle).sin_cos();
            assert!((f64::from(sin) - true_sin).abs() < 2e-7, "{angle}: {sin}");
            assert!((f64::from(cos) - true_cos).abs() < 2e-7, "{angle}: {cos}");
        }
    }

    #[test]
    fn the_center_of_the_square_is_that_of_the_disc() {
        assert_eq!(concentric_disc([0.5, 0.5]), Vec2::ZERO);
    }
    use crate::sampling::hash_u64;

    /// Hypotheses tested in this file.
    const TESTS: usize = 5;
    const SAMPLES: usize = 200_000;

    /// Independent uniform numbers: the chi-square statistic assumes independence, which Sobol samples do not have.
    fn random(index: usize) -> [f32; 2] {
        let bits = hash_u64(index as u64 ^ 0x5EED_0000);
        [(bits >> 40) as f32, (bits & 0xFF_FFFF) as f32].map(|b| b / 16_777_216.0)
    }

    fn array(v: Vec3) -> [f64; 3] {
        v.as_dvec3().to_array()
    }

    #[test]
    fn cosine_hemisphere_follows_its_density() {
        chi_square_over_sphere(
            SAMPLES,
            20,
            20,
            32,
            |i| Some(array(cosine_hemisphere(random(i)))),
            |d| d[2].max(0.0) / std::f64::consts::PI,
        )
        .assert_accepted(sidak(0.01, TESTS));
    }

    #[test]
    fn uniform_sphere_follows_its_density() {
        chi_square_over_sphere(
            SAMPLES,
            20,
            20,
            32,
            |i| Some(array(uniform_sphere(random(i)))),
            |_| 0.25 / std::f64::consts::PI,
        )
        .assert_accepted(sidak(0.01, TESTS));
    }

    #[test]
    fn concentric_disc_is_even() {
        // Rings of equal area times sectors.
        let mut counts = vec![0.0; 64];
        for i in 0..SAMPLES {
            let d = concentric_disc(random(i));
            let ring = (d.length_squared() * 8.0).min(7.0) as usize;
            let sector = ((d.y.atan2(d.x) + PI) / (2.0 * PI) * 8.0).min(7.0) as usize;
            counts[ring * 8 + sector] += 1.0;
        }
        chi_square(&counts, &[SAMPLES as f64 / 64.0; 64]).assert_accepted(sidak(0.01, TESTS));
    }

    #[test]
    fn triangle_is_even() {
        // The unit triangle in squares of side 1/8: inner squares are whole, those on the hypotenuse half.
        let mut counts = vec![0.0; 64];
        let mut expected = vec![0.0; 64];
        for i in 0..SAMPLES {
            let [u, v] = triangle(random(i));
            counts[(v * 8.0) as usize * 8 + (u * 8.0) as usize] += 1.0;
        }
        for row in 0..8 {
            for col in 0..8 {
                let share = match (row + col).cmp(&7) {
                    std::cmp::Ordering::Less => 1.0,
                    std::cmp::Ordering::Equal => 0.5,
                    std::cmp::Ordering::Greater => 0.0,
                };
                expected[row * 8 + col] = share * SAMPLES as f64 / 32.0;
            }
        }
        chi_square(&counts, &expected).assert_accepted(sidak(0.01, TESTS));
    }

    #[test]
    fn tangents_are_orthonormal() {
        for i in 0..1000 {
            let n = uniform_sphere(random(i));
            let (a, b) = tangents(n);
            for (x, y, dot) in [(a, a, 1.0), (b, b, 1.0), (a, b, 0.0), (a, n, 0.0), (b, n, 0.0)] {
                assert!((x.dot(y) - dot).abs() < 1e-5);
            }
            assert!(a.cross(b).dot(n) > 0.999);
        }
    }
}
