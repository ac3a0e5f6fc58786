//! Warps from the unit square to directions and surfaces, each with its density.
//!
//! Directions are unit vectors in a local frame whose normal is +z. Every warp is held to its density by a
//! chi-square test.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

/// Unit square to unit disc, area-preserving (Shirley and Chiu 1997). Density `1/pi`.
pub fn concentric_disc(u: [f32; 2]) -> Vec2 {
    let x = 2.0 * u[0] - 1.0;
    let y = 2.0 * u[1] - 1.0;
    if x == 0.0 && y == 0.0 {
        return Vec2::ZERO;
    }
    let (radius, angle) =
        if x.abs() > y.abs() { (x, PI / 4.0 * (y / x)) } else { (y, PI / 2.0 - PI / 4.0 * (x / y)) };
    Vec2::new(radius * angle.cos(), radius * angle.sin())
}

/// Cosine-weighted direction on the upper hemisphere. Density [`cosine_hemisphere_pdf`].
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let d = concentric_disc(u);
    Vec3::new(d.x, d.y, (1.0 - d.length_squared()).max(0.0).sqrt())
}

/// `cos(theta) / pi`, 1/sr; zero below the horizon.
pub fn cosine_hemisphere_pdf(direction: Vec3) -> f32 {
    direction.z.max(0.0) / PI
}

/// Uniform direction on the sphere. Density `1 / (4 pi)`.
pub fn uniform_sphere(u: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u[0];
    let r = (1.0 - z * z).max(0.0).sqrt();
    let phi = 2.0 * PI * u[1];
    Vec3::new(r * phi.cos(), r * phi.sin(), z)
}

/// Uniform direction within a cone about +z. Density [`uniform_cone_pdf`].
pub fn uniform_cone(u: [f32; 2], cos_max: f32) -> Vec3 {
    let z = 1.0 - u[0] * (1.0 - cos_max);
    let r = (1.0 - z * z).max(0.0).sqrt();
    let phi = 2.0 * PI * u[1];
    Vec3::new(r * phi.cos(), r * phi.sin(), z)
}

/// `1 / (2 pi (1 - cos_max))`, 1/sr.
pub fn uniform_cone_pdf(cos_max: f32) -> f32 {
    1.0 / (2.0 * PI * (1.0 - cos_max))
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
