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
    /// Seen from the side of the object's geometric normal.
    pub(super) front: bool,
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

    /// Start of a ray that leaves along a direction, lifted off the surface by `clearance` so that rounding does not
    /// make the ray hit the surface it starts from.
    pub(super) fn leave(&self, direction: Vec3, clearance: f32) -> Vec3 {
        self.position + self.geometric * clearance.copysign(direction.dot(self.geometric))
    }

    /// Turns the shading normal to one given in the frame of the texture coordinates (x along u, y along v), for a
    /// viewer in the direction `outgoing`. Where the viewer would see it from behind, the normal stays as it was.
    pub(super) fn apply_normal_map(
        &mut self,
        normal: Vec3,
        (along_u, along_v): (Vec3, Vec3),
        outgoing: Vec3,
    ) {
        let project = |v: Vec3| (v - self.shading * v.dot(self.shading)).try_normalize();
        let Some(u) = project(along_u) else { return };
        let across = self.shading.cross(u);
        let v = if across.dot(along_v) < 0.0 { -across } else { across };
        let turned = (u * normal.x + v * normal.y + self.shading * normal.z).normalize();
        if turned.dot(outgoing) > 1e-3 {
            self.shading = turned;
            self.tangents = warp::tangents(turned);
        }
    }
}

impl CompiledScene<'_> {
    /// The surface at an intersection with an object; `None` for lights.
    #[inline]
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
            Target::Instance { instance, triangle, u, v } => {
                let instances = self.instances.as_ref()?;
                let at = instances.placed(instance, triangle, u, v);
                let [a, b, c] = at.corners;
                let shading = at.normal.try_normalize().unwrap_or(at.geometric);
                let position = a * (1.0 - u - v) + b * u + c * v;
                (position, at.geometric, shading, at.uv, instances.object_of(instance))
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
        // Both normals face the viewer.
        let front = geometric.dot(direction) <= 0.0;
        let geometric = if front { geometric } else { -geometric };
        let shading = if shading.dot(geometric) < 0.0 { -shading } else { shading };
        let shading = if shading.dot(direction) >= -1e-4 { geometric } else { shading };
        let tangents = warp::tangents(shading);
        Some(SurfacePoint { position, geometric, shading, tangents, uv, object, front })
    }

    /// Directions in which the texture coordinates u and v grow at an intersection, not normalised.
    pub(super) fn texture_directions(&self, target: Target, position: Vec3) -> (Vec3, Vec3) {
        match target {
            Target::Light(_) => (Vec3::X, Vec3::Y),
            Target::Triangle { triangle, .. } => {
                let triangle = triangle as usize;
                along_texture(self.corners(triangle), self.texture_corners(triangle))
            }
            Target::Instance { instance, triangle, .. } => match &self.instances {
                Some(instances) => along_texture(
                    instances.corners(instance, triangle),
                    instances.texture_corners(instance, triangle),
                ),
                None => (Vec3::X, Vec3::Y),
            },
            Target::Shape(index) => match &self.shapes[index as usize].shape {
                AnalyticShape::Sphere { center, .. } => {
                    let from_center = position - *center;
                    let east = Vec3::new(-from_center.z, 0.0, from_center.x);
                    let east = if east == Vec3::ZERO { Vec3::X } else { east };
                    // Longitude grows from x to z; north is east x outward.
                    (east, east.cross(from_center))
                }
                AnalyticShape::Disc { tangents, .. } => *tangents,
            },
        }
    }
}

/// Directions in which u and v grow over a triangle.
fn along_texture([a, b, c]: [Vec3; 3], [p, q, r]: [Vec2; 3]) -> (Vec3, Vec3) {
    let (side, other) = (b - a, c - a);
    let (du, dv) = (q - p, r - p);
    let determinant = du.x * dv.y - du.y * dv.x;
    if determinant == 0.0 {
        return (side, other);
    }
    let sign = determinant.signum();
    ((side * dv.y - other * du.y) * sign, (other * du.x - side * dv.x) * sign)
}
