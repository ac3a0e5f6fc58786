//! Distances along rays to planes, discs and spheres, m. Directions are unit vectors.

use glam::Vec3;

/// Distance along a ray to a plane through `point`, between 0 and `limit`; `None` for rays along it.
#[inline]
pub(crate) fn intersect_plane(
    origin: Vec3,
    direction: Vec3,
    point: Vec3,
    normal: Vec3,
    limit: f32,
) -> Option<f32> {
    let cos = direction.dot(normal);
    if cos == 0.0 {
        return None;
    }
    let t = (point - origin).dot(normal) / cos;
    (t > 0.0 && t < limit).then_some(t)
}

/// Distance along a ray to a flat disc, between 0 and `limit`.
#[inline]
pub(crate) fn intersect_disc(
    origin: Vec3,
    direction: Vec3,
    center: Vec3,
    normal: Vec3,
    radius: f32,
    limit: f32,
) -> Option<f32> {
    let t = intersect_plane(origin, direction, center, normal, limit)?;
    ((origin + direction * t - center).length_squared() <= radius * radius).then_some(t)
}

/// Smallest distance along a ray to a sphere, between 0 and `limit`.
///
/// Robust quadratic (Haines et al., Ray Tracing Gems, chapter 7): the discriminant from the point of closest approach.
#[inline]
pub(crate) fn intersect_sphere(
    origin: Vec3,
    direction: Vec3,
    center: Vec3,
    radius: f32,
    limit: f32,
) -> Option<f32> {
    let f = origin - center;
    let b = -f.dot(direction);
    let closest = f + direction * b;
    let discriminant = radius * radius - closest.length_squared();
    if discriminant < 0.0 {
        return None;
    }
    let c = f.length_squared() - radius * radius;
    let q = b + discriminant.sqrt().copysign(b);
    let (t0, t1) = if q == 0.0 { (0.0, 0.0) } else { (c / q, q) };
    let (near, far) = if t0 < t1 { (t0, t1) } else { (t1, t0) };
    [near, far].into_iter().find(|&t| t > 0.0 && t < limit)
}
