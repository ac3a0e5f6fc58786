//! Where a ray ends, and the surface found there: position, frame, texture coordinates, object.

use glam::{Vec2, Vec3};

use super::compiled_scene::{AnalyticShape, CompiledScene};
use crate::material::FilmFrame;
use crate::sampling::warp;

/// Least cosine at which a film is seen: where it would be seen from behind, it follows the surface.
const LEAST_COSINE: f32 = 0.02;

/// Where a ray ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Target {
    /// A triangle, with barycentric coordinates.
    Triangle { triangle: u32, u: f32, v: f32 },
    /// A triangle of an instance of a mesh, with barycentric coordinates.
    Instance { instance: u32, triangle: u32, u: f32, v: f32 },
    /// An analytic shape of an object.
    Shape(u32),
    /// The surface of a light.
    Light(u32),
}

/// A point on a surface that a ray found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Intersection {
    pub(super) t: f32,
    pub(super) target: Target,
}

/// A point on an object, seen from one side.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePoint {
    pub(super) position: Vec3,
    /// Geometric normal on the side that is seen.
    pub(super) geometric: Vec3,
    /// Shading normal on the side that is seen.
    pub(super) shading: Vec3,
    tangents: (Vec3, Vec3),
    /// Normal of a film that does not follow the surface; zero without one.
    film: Vec3,
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

    /// The frame of a film in the local frame.
    #[inline]
    pub(super) fn film_frame(&self) -> FilmFrame {
        if self.film == Vec3::ZERO { FilmFrame::default() } else { FilmFrame::new(self.to_local(self.film)) }
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
        // Seen from behind, the normal of the map points away, and its opposite is that of this side
        let side = if self.front { 1.0 } else { -1.0 };
        let across = self.shading.cross(u);
        let v = if across.dot(along_v) < 0.0 { -across } else { across };
        let turned = (side * (u * normal.x + v * normal.y) + self.shading * normal.z).normalize();
        if turned.dot(outgoing) > 1e-3 {
            self.shading = turned;
            self.tangents = warp::tangents(turned);
        }
    }
}

impl CompiledScene {
    /// The surface at an intersection with an object; `None` for lights.
    #[inline]
    pub(super) fn surface(&self, origin: Vec3, direction: Vec3, hit: &Intersection) -> Option<SurfacePoint> {
        // Interpolate position, normals and texture coordinates at the hit
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
        let film = match hit.target {
            Target::Triangle { triangle, u, v } => self.film_normal(triangle as usize, u, v),
            _ => Vec3::ZERO,
        };
        let film = if film.dot(geometric) < 0.0 { -film } else { film };
        let film = if film.dot(direction) > -LEAST_COSINE { Vec3::ZERO } else { film };
        let tangents = warp::tangents(shading);
        Some(SurfacePoint { position, geometric, shading, tangents, film, uv, object, front })
    }

    /// Directions in which the texture coordinates u and v grow at an intersection, not normalized.
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DVec2, DVec3};

    use super::*;
    use crate::geometry::TriangleMesh;
    use crate::light::LightGroup;
    use crate::material::Material;
    use crate::optics::PerspectiveCamera;
    use crate::render::RenderSettings;
    use crate::scene::{Object, Scene, Shape};
    use crate::spectral::{Curve, WavelengthGrid};

    fn scene(meshes: Vec<(String, TriangleMesh)>) -> Scene {
        let object =
            |(name, mesh)| Object { name, shape: Shape::Mesh(Arc::new(mesh)), material: 0, emission: None };
        Scene {
            grid: WavelengthGrid::uniform(500.0, 510.0, 5.0).unwrap(),
            objects: meshes.into_iter().map(object).collect(),
            materials: vec![Material::lambertian("m", Curve::constant(0.5))],
            fluorophores: Vec::new(),
            light_groups: vec![LightGroup { name: "g".into() }],
            lights: Vec::new(),
            camera: PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 50.0, 4, 4).unwrap(),
        }
    }

    /// Derivatives of the position by the texture coordinates on a flat triangle: the solution of
    /// `side_k = dP/du du_k + dP/dv dv_k` for two sides.
    fn derivatives(corners: [Vec3; 3], uvs: [Vec2; 3]) -> (DVec3, DVec3) {
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        let [p, q, r] = uvs.map(|uv| uv.as_dvec2());
        let (first, second): (DVec2, DVec2) = (q - p, r - p);
        let determinant = first.perp_dot(second);
        (
            ((b - a) * second.y - (c - a) * first.y) / determinant,
            ((c - a) * first.x - (b - a) * second.x) / determinant,
        )
    }

    /// Faults of the tangent frames of normal maps, over every triangle of a scene.
    fn frame_faults(scene: &Scene) -> Vec<String> {
        let compiled = CompiledScene::new(scene, &RenderSettings::default()).unwrap();
        let count: usize = scene
            .objects
            .iter()
            .map(|object| match &object.shape {
                Shape::Mesh(mesh) => mesh.triangles.len(),
                _ => 0,
            })
            .sum();
        let mut faults = vec![(0, 0.0_f32); scene.objects.len()];
        let mut turns = vec![[0_usize; 2]; scene.objects.len()];
        for triangle in 0..count {
            let corners = compiled.corners(triangle);
            let (along_u, along_v) = derivatives(corners, compiled.texture_corners(triangle));
            let hit = Intersection {
                t: 1e-3,
                target: Target::Triangle { triangle: triangle as u32, u: 0.3, v: 0.3 },
            };
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            let point = compiled.surface(corners[0] + normal * 1e-3, -normal, &hit).unwrap();
            let directions = compiled.texture_directions(hit.target, point.position);
            // What the frame must be: dP/du laid into the plane of the shading normal, and what is square to it on the
            // side of dP/dv.
            let shading = point.shading.as_dvec3();
            let wanted_u = (along_u - shading * along_u.dot(shading)).normalize();
            let across = shading.cross(wanted_u);
            let wanted_v = if across.dot(along_v) < 0.0 { -across } else { across };
            turns[point.object][usize::from(across.dot(along_v) < 0.0)] += 1;
            // A normal leant by a tenth shows the axis that it leans along.
            let axis = |lean: Vec3| {
                let mut turned = point;
                turned.apply_normal_map((Vec3::Z + 0.1 * lean).normalize(), directions, point.shading);
                let axis = turned.shading * 1.01_f32.sqrt() - point.shading;
                (axis / 0.1, (turned.shading.length() - 1.0).abs())
            };
            let ((u, u_length), (v, v_length)) = (axis(Vec3::X), axis(Vec3::Y));
            // From behind the surface is the same, and its normal the opposite
            let behind = compiled.surface(corners[0] - normal * 1e-3, normal, &hit).unwrap();
            let [front, behind] = [point, behind].map(|mut point| {
                point.apply_normal_map((Vec3::Z + 0.1 * Vec3::X).normalize(), directions, point.shading);
                point.shading
            });
            let error = [
                u_length,
                v_length,
                (u.length() - 1.0).abs(),
                (v.length() - 1.0).abs(),
                u.dot(point.shading).abs(),
                v.dot(point.shading).abs(),
                u.distance(wanted_u.as_vec3()),
                v.distance(wanted_v.as_vec3()),
                front.distance(-behind),
            ]
            .into_iter()
            .fold(0.0_f32, |worst, error| if error > worst || error.is_nan() { error } else { worst });
            // Single precision: texture coordinates differ by 1e-3 within a triangle and are rounded to 6e-8.
            if error.is_nan() || error > 2e-3 {
                faults[point.object].0 += 1;
                faults[point.object].1 = faults[point.object].1.max(error);
            }
        }
        let mut said = Vec::new();
        for ((object, (wrong, worst)), [one, other]) in scene.objects.iter().zip(faults).zip(turns) {
            if wrong > 0 {
                said.push(format!("{}: {wrong} frames of {} are off, by {worst}", object.name, one + other));
            }
            // Slivers at folds, whose shading normals lie across them, may turn over.
            if one.min(other) as f64 > (0.003 * (one + other) as f64).max(3.0) {
                said.push(format!("{}: {one} frames are right-handed, {other} left-handed", object.name));
            }
        }
        said
    }

    /// A tube of 4 mm about a ring of 20 mm with ripples, a part of it laid out on the unit square by `texture`.
    fn rippled_tube(texture: impl Fn(Vec2) -> Vec2) -> TriangleMesh {
        const SIDE: u32 = 64;
        let place = |u: f64, v: f64| {
            let (along, round) = (5.0 * u, 4.0 * v);
            let radius_m = 0.004 * (1.0 + 0.2 * (7.0 * along).sin() * (3.0 * round).cos());
            let from_axis_m = 0.02 + radius_m * round.cos();
            DVec3::new(from_axis_m * along.cos(), from_axis_m * along.sin(), radius_m * round.sin())
        };
        let mut mesh = TriangleMesh::default();
        for (row, column) in (0..=SIDE).flat_map(|row| (0..=SIDE).map(move |column| (row, column))) {
            let (u, v) = (f64::from(column) / f64::from(SIDE), f64::from(row) / f64::from(SIDE));
            let across = |du: f64, dv: f64| place(u + du, v + dv) - place(u - du, v - dv);
            mesh.positions.push(place(u, v).as_vec3());
            mesh.normals.push(across(1e-4, 0.0).cross(across(0.0, 1e-4)).normalize().as_vec3());
            mesh.uvs.push(texture(Vec2::new(u as f32, v as f32)));
            if row < SIDE && column < SIDE {
                let corner = row * (SIDE + 1) + column;
                let above = corner + SIDE + 1;
                mesh.triangles.extend([[corner, corner + 1, above + 1], [corner, above + 1, above]]);
            }
        }
        mesh
    }

    #[test]
    fn normal_maps_follow_the_texture_on_curved_surfaces() {
        let meshes = vec![
            ("as laid out".to_string(), rippled_tube(|uv| uv)),
            ("mirrored".into(), rippled_tube(|uv| Vec2::new(1.0 - uv.x, uv.y))),
            (
                "turned, sheared and stretched".into(),
                rippled_tube(|uv| {
                    Vec2::new(0.2 + 0.5 * uv.y - 0.2 * uv.x, 0.1 + 0.6 * uv.x * (0.5 + 0.5 * uv.x))
                }),
            ),
        ];
        assert_eq!(frame_faults(&scene(meshes)), Vec::<String>::new());
    }

    #[test]
    fn frames_that_do_not_follow_the_texture_are_found() {
        // The texture folded over along its middle: one half is left-handed.
        let folded = rippled_tube(|uv| Vec2::new((uv.x - 0.5).abs(), uv.y));
        let said = frame_faults(&scene(vec![("tube".into(), folded)]));
        assert!(said.len() == 1 && said[0].contains("left-handed"), "{said:?}");
    }
}
