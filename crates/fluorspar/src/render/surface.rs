//! What a ray finds on a surface: position, frame, texture coordinates, material.

use glam::{Vec2, Vec3};

use super::compiled_scene::{AnalyticShape, CompiledScene, Intersection, Target};
use crate::sampling::warp;

/// A point on an object, seen from one side.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePoint {
    pub(super) position: Vec3,
    /// Geometric normal on the side that is seen.
    pub(super) geometric: Vec3,
    /// Shading normal on the side that is seen.
    pub(super) shading: Vec3,
    tangents: (Vec3, Vec3),
    pub(super) uv: Vec2,
    pub(super) object: usize,
}

impl SurfacePoint {
    /// Direction from world to the local frame with the shading normal as +z.
    pub(super) fn to_local(self, direction: Vec3) -> Vec3 {
        Vec3::new(direction.dot(self.tangents.0), direction.dot(self.tangents.1), direction.dot(self.shading))
    }

    /// Direction from the local frame to world.
    pub(super) fn to_world(self, direction: Vec3) -> Vec3 {
        self.tangents.0 * direction.x + self.tangents.1 * direction.y + self.shading * direction.z
    }

    /// Start of a ray that leaves on the seen side, lifted off the surface by `clearance` so that rounding does not
    /// make the ray hit the surface it starts from.
    pub(super) fn leave(&self, clearance: f32) -> Vec3 {
        self.position + self.geometric * clearance
    }
}

impl CompiledScene<'_> {
    /// The surface at an intersection with an object; `None` for lights.
    pub(super) fn surface(&self, origin: Vec3, direction: Vec3, hit: &Intersection) -> Option<SurfacePoint> {
        let (position, geometric, shading, uv, object) = match hit.target {
            Target::Light(_) => return None,
            Target::Triangle { triangle, u, v } => {
                let triangle = triangle as usize;
                let [a, b, c] = self.corners(triangle);
                let geometric = (b - a).cross(c - a).normalize_or_zero();
                let (normal, uv) = self.attributes(triangle, u, v);
                let shading = normal.try_normalize().unwrap_or(geometric);
                let position = a * (1.0 - u - v) + b * u + c * v;
                (position, geometric, shading, uv, self.object_of(triangle))
            }
            Target::Shape(index) => {
                let shape = &self.shapes[index as usize];
                let point = origin + direction * hit.t;
                match &shape.shape {
                    AnalyticShape::Sphere { center, radius } => {
                        let normal = (point - *center).normalize_or_zero();
                        let uv = Vec2::new(
                            0.5 + normal.z.atan2(normal.x) / (2.0 * std::f32::consts::PI),
                            0.5 + normal.y.clamp(-1.0, 1.0).asin() / std::f32::consts::PI,
                        );
                        (*center + normal * *radius, normal, normal, uv, shape.object)
                    }
                    AnalyticShape::Disc { center, normal, tangents, radius } => {
                        let local = point - *center;
                        let uv =
                            Vec2::new(local.dot(tangents.0), local.dot(tangents.1)) / (2.0 * radius) + 0.5;
                        (point, *normal, *normal, uv, shape.object)
                    }
                }
            }
        };
        // Materials are two-sided: both normals face the viewer.
        let geometric = if geometric.dot(direction) > 0.0 { -geometric } else { geometric };
        let shading = if shading.dot(geometric) < 0.0 { -shading } else { shading };
        let shading = if shading.dot(direction) >= -1e-4 { geometric } else { shading };
        let tangents = warp::tangents(shading);
        Some(SurfacePoint { position, geometric, shading, tangents, uv, object })
    }
}
