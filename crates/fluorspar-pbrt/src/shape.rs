//! Shapes as meshes, spheres and discs.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::sync::Arc;

use fluorspar::geometry::{MeshInstance, MeshInstances, TriangleMesh};
use fluorspar::quote::excerpt;
use fluorspar::scene::{Object, Shape};
use fluorspar_format::{PbrtError, PbrtShape, read_ply_leniently};
use glam::{Affine3, DMat4, DVec3, Vec2, Vec3};

use crate::convert::Convert;
use crate::given::Given;

/// Steps around the axis of a surface of revolution.
const STEPS_AROUND: usize = 256;
/// Steps along its profile, where that is curved.
const STEPS_ALONG: usize = 128;
/// Most objects that keep a name of their own; of more, those of one material are joined.
const MOST_OBJECTS: usize = 60_000;

/// A shape in its own frame.
enum Made {
    Mesh(TriangleMesh),
    /// A whole sphere about the origin.
    Sphere(f64),
    /// A whole disc across z at a height.
    Disc {
        height: f64,
        radius: f64,
    },
}

impl Convert<'_> {
    /// All shapes, and objects at their places.
    pub(crate) fn shapes(&mut self) -> Result<(), PbrtError> {
        let tree = self.tree;
        let mut places: HashMap<usize, Vec<DMat4>> = HashMap::new();
        for instance in &tree.instances {
            if instance.to_world.determinant() == 0.0 {
                return Err(
                    self.error(instance.at, "the transform of this instance flattens the object; change it")
                );
            }
            places.entry(instance.object).or_default().push(instance.to_world);
        }
        for shape in &tree.shapes {
            match shape.object {
                None => self.shape(shape, None)?,
                Some(object) => {
                    if let Some(list) = places.get(&object) {
                        self.shape(shape, Some(list))?;
                    }
                }
            }
        }
        self.join_objects();
        Ok(())
    }

    /// One shape, at the places of its object if it is part of one.
    fn shape(&mut self, shape: &PbrtShape, places: Option<&[DMat4]>) -> Result<(), PbrtError> {
        let entity = &shape.entity;
        let at = entity.at;
        let given = Given::new(entity);
        let Some(mut material) = self.material(shape.material)? else {
            if shape.area_light.is_some() {
                self.remark(at, "a light on a material without surface has no counterpart and is left out");
            }
            return Ok(());
        };
        let alpha = match given.find("alpha") {
            Some(parameter) => Some(self.weight(parameter)?),
            None => None,
        };
        given.used(&["shadowalpha", "splitnormal"]);
        let Some(made) = self.made(&given)? else { return Ok(()) };
        given.finish("Shape", &mut self.remarks);
        if matches!(&made, Made::Mesh(mesh) if mesh.triangles.is_empty()) {
            self.remark(at, "the mesh has no triangles and is left out");
            return Ok(());
        }
        let determinant = shape.to_world.determinant();
        if determinant == 0.0 || !determinant.is_finite() {
            return Err(self.error(at, "the transform of this shape flattens it; change it"));
        }
        let emission = match shape.area_light {
            Some(_) if places.is_some() => {
                self.remark(
                    at,
                    "lights within objects have no counterpart, as in pbrt; the shape does not emit",
                );
                None
            }
            Some(light) => Some(light),
            None => None,
        };
        if let Some(alpha) = alpha.filter(|alpha| alpha.constant() != Some(1.0)) {
            if emission.is_some() {
                self.remark(at, "\"alpha\": a surface that emits has no holes here");
            } else if alpha.constant() == Some(0.0) {
                self.remark(at, "\"alpha\" 0: the shape is left out");
                return Ok(());
            } else {
                material = self.masked(material, alpha);
            }
        }
        let is_textured = self.materials[material].is_textured(&self.materials);
        let shape_of = match places {
            None => self.placed(made, shape, is_textured),
            Some(places) => self.instanced(made, shape, places, is_textured),
        };
        let stem = given.text("filename").map_or(entity.class.as_str(), file_stem);
        let name = format!("{}_{}", excerpt(stem), self.objects.len());
        let emission = match emission {
            Some(light) => Some(self.area_light(light, &shape_of)?),
            None => None,
        };
        self.objects.push(Object { name, shape: shape_of, material, emission });
        Ok(())
    }

    /// The shape in its own frame; `None` for one without counterpart.
    fn made(&mut self, given: &Given<'_>) -> Result<Option<Made>, PbrtError> {
        let at = given.entity.at;
        let number = |name: &str, usual: f64| given.number(name).unwrap_or(usual);
        let made = match given.entity.class.as_str() {
            "trianglemesh" => Made::Mesh(self.triangle_mesh(given)?),
            "loopsubdiv" => {
                self.remark(at, "\"loopsubdiv\": the control mesh is not subdivided");
                given.used(&["levels", "nlevels", "scheme"]);
                Made::Mesh(self.triangle_mesh(given)?)
            }
            "bilinearmesh" => Made::Mesh(self.bilinear_mesh(given)?),
            "plymesh" => Made::Mesh(self.ply_mesh(given)?),
            "sphere" => {
                let radius = number("radius", 1.0);
                let (low, high) = (number("zmin", -radius), number("zmax", radius));
                let around = number("phimax", 360.0);
                if low <= -radius && high >= radius && around >= 360.0 {
                    self.check_radius(given, radius)?;
                    return Ok(Some(Made::Sphere(radius)));
                }
                let angle = |z: f64| (z / radius).clamp(-1.0, 1.0).asin();
                let (from, to) = (angle(low.min(high)), angle(low.max(high)));
                self.revolution(
                    given,
                    &curve(STEPS_ALONG, |t| {
                        let latitude = from + (to - from) * t;
                        [radius * latitude.cos(), radius * latitude.sin()]
                    }),
                )?
            }
            "disk" => {
                let (radius, inner, height) =
                    (number("radius", 1.0), number("innerradius", 0.0), number("height", 0.0));
                if inner == 0.0 && number("phimax", 360.0) >= 360.0 {
                    self.check_radius(given, radius)?;
                    return Ok(Some(Made::Disc { height, radius }));
                }
                self.revolution(given, &[[radius, height], [inner, height]])?
            }
            "cylinder" => {
                let radius = number("radius", 1.0);
                self.revolution(given, &[[radius, number("zmin", -1.0)], [radius, number("zmax", 1.0)]])?
            }
            "cone" => {
                let profile = [[number("radius", 1.0), 0.0], [0.0, number("height", 1.0)]];
                self.revolution(given, &profile)?
            }
            "paraboloid" => {
                let (radius, low, high) = (number("radius", 1.0), number("zmin", 0.0), number("zmax", 1.0));
                self.revolution(
                    given,
                    &curve(STEPS_ALONG, |t| {
                        let z = low + (high - low) * t;
                        [radius * (z / high).max(0.0).sqrt(), z]
                    }),
                )?
            }
            class => {
                self.remark(at, format!("Shape \"{}\" has no counterpart and is left out", excerpt(class)));
                return Ok(None);
            }
        };
        Ok(Some(made))
    }

    fn check_radius(&self, given: &Given<'_>, radius: f64) -> Result<(), PbrtError> {
        if radius > 0.0 && radius.is_finite() {
            return Ok(());
        }
        Err(self.error(given.entity.at, format!("a radius of {radius}; give one above 0")))
    }

    /// A profile (radius, height) turned about z; its normals lie to the right of its way.
    fn revolution(&mut self, given: &Given<'_>, profile: &[[f64; 2]]) -> Result<Made, PbrtError> {
        let at = given.entity.at;
        if profile.iter().flatten().any(|value| !value.is_finite())
            || profile.iter().all(|point| point[0] <= 0.0)
        {
            return Err(self.error(at, "the radius must be above 0, and the heights numbers"));
        }
        let degrees = given.number("phimax").unwrap_or(360.0).clamp(0.0, 360.0);
        if degrees == 0.0 {
            return Err(self.error(at, "a \"phimax\" of 0 leaves nothing; give up to 360"));
        }
        self.note(
            at,
            format!("the {} is a mesh of {STEPS_AROUND} steps around", excerpt(&given.entity.class)),
        );
        Ok(Made::Mesh(revolved(profile, degrees.to_radians())))
    }

    fn triangle_mesh(&mut self, given: &Given<'_>) -> Result<TriangleMesh, PbrtError> {
        let at = given.entity.at;
        let positions = points(given, "P");
        let corners = match given.numbers("indices") {
            Some(indices) => self.vertex_numbers(indices, given)?,
            None if positions.len() == 3 => vec![0, 1, 2],
            None => return Err(self.error(at, "a mesh needs \"integer indices\", three for each triangle")),
        };
        if !corners.len().is_multiple_of(3) {
            return Err(self
                .error(at, format!("{} indices do not form triangles; give three for each", corners.len())));
        }
        given.used(&["S", "faceIndices"]);
        let triangles = corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        self.mesh_of(given, positions, triangles)
    }

    /// Quadrilaterals of corners 00, 10, 01, 11, each as two triangles.
    fn bilinear_mesh(&mut self, given: &Given<'_>) -> Result<TriangleMesh, PbrtError> {
        let at = given.entity.at;
        let positions = points(given, "P");
        let corners = match given.numbers("indices") {
            Some(indices) => self.vertex_numbers(indices, given)?,
            None if positions.len() == 4 => vec![0, 1, 2, 3],
            None => {
                return Err(self.error(at, "a bilinear mesh needs \"integer indices\", four for each patch"));
            }
        };
        if !corners.len().is_multiple_of(4) {
            return Err(
                self.error(at, format!("{} indices do not form patches; give four for each", corners.len()))
            );
        }
        self.note(at, "each bilinear patch is two triangles, which is exact where it is flat");
        given.used(&["faceIndices", "emissionfilename"]);
        let triangles =
            corners.chunks_exact(4).flat_map(|c| [[c[0], c[1], c[3]], [c[0], c[3], c[2]]]).collect();
        self.mesh_of(given, positions, triangles)
    }

    fn vertex_numbers(&self, indices: &[f64], given: &Given<'_>) -> Result<Vec<u32>, PbrtError> {
        let whole = |value: &f64| (*value >= 0.0 && *value <= f64::from(u32::MAX)).then_some(*value as u32);
        indices.iter().map(whole).collect::<Option<_>>().ok_or_else(|| {
            self.error(
                given.entity.at,
                "an index below 0, or beyond 4294967295; vertices are numbered from 0",
            )
        })
    }

    fn mesh_of(
        &mut self,
        given: &Given<'_>,
        positions: Vec<Vec3>,
        triangles: Vec<[u32; 3]>,
    ) -> Result<TriangleMesh, PbrtError> {
        let normals = points(given, "N");
        let pairs = ["uv", "st", "UV"].into_iter().find_map(|name| given.numbers(name)).unwrap_or_default();
        let uvs = pairs.chunks_exact(2).map(|pair| Vec2::new(pair[0] as f32, pair[1] as f32)).collect();
        let mesh = TriangleMesh { positions, normals, uvs, triangles };
        self.checked(mesh, given)
    }

    /// A mesh whose numbers fit, or one without triangles.
    fn checked(&self, mesh: TriangleMesh, given: &Given<'_>) -> Result<TriangleMesh, PbrtError> {
        if mesh.triangles.is_empty() {
            return Ok(mesh);
        }
        mesh.validate().map_err(|error| self.error(given.entity.at, error.to_string()))?;
        Ok(mesh)
    }

    fn ply_mesh(&mut self, given: &Given<'_>) -> Result<TriangleMesh, PbrtError> {
        let at = given.entity.at;
        let Some(name) = given.text("filename") else {
            return Err(self.error(at, "a plymesh needs its file; add \"string filename\" \"FILE.ply\""));
        };
        if given.find("displacement").is_some() {
            self.remark(at, "\"displacement\": the mesh stays as it is");
        }
        given.used(&["edgelength"]);
        let path = self.tree.path_of(at, name);
        let read = read_ply_leniently(&path).map_err(|error| self.error(at, error.to_string()))?;
        self.note_read(path);
        if let Some(faces) = read.left_out {
            let text = match faces.count {
                1 => format!("face {} has {} corners and is left out", faces.first, faces.corners),
                count => format!(
                    "{count} faces of fewer than three corners are left out; the first is face {}",
                    faces.first
                ),
            };
            self.remark(at, text);
        }
        Ok(read.mesh)
    }

    /// A shape at its place in the scene.
    fn placed(&mut self, made: Made, shape: &PbrtShape, is_textured: bool) -> Shape {
        let map = self.scene_from_world() * shape.to_world;
        let side = if shape.is_reversed { -1.0 } else { 1.0 };
        match made {
            Made::Sphere(radius) if !is_textured && side > 0.0 && is_similar(&map) => Shape::Sphere {
                center: map.transform_point3(DVec3::ZERO).as_vec3(),
                radius_m: (radius * map.x_axis.length()) as f32,
            },
            Made::Disc { height, radius } if !is_textured && is_similar(&map) => {
                // Handedness does not turn the normal of a shape around, as in pbrt.
                let normal = map.transform_vector3(DVec3::Z).normalize() * side;
                Shape::Disc {
                    center: map.transform_point3(DVec3::Z * height).as_vec3(),
                    normal: normal.as_vec3(),
                    radius_m: (radius * map.x_axis.length()) as f32,
                }
            }
            made => Shape::Mesh(Arc::new(moved(made, &map, shape.is_reversed, is_textured))),
        }
    }

    /// A shape at the places of its object.
    fn instanced(&mut self, made: Made, shape: &PbrtShape, places: &[DMat4], is_textured: bool) -> Shape {
        let unit = DMat4::from_scale(DVec3::splat(self.options.unit_m));
        let own = moved(made, &(unit * shape.to_world), shape.is_reversed, is_textured);
        let scene = self.scene_from_world();
        let back = DMat4::from_scale(DVec3::splat(1.0 / self.options.unit_m));
        let instances = places.iter().map(|place| {
            let map = scene * *place * back;
            let to_world = Affine3 {
                matrix3: glam::DMat3::from_mat4(map).as_mat3(),
                translation: map.w_axis.truncate().as_vec3(),
            };
            MeshInstance { mesh: 0, to_world }
        });
        Shape::Instances(Arc::new(MeshInstances {
            meshes: vec![Arc::new(own)],
            instances: instances.collect(),
        }))
    }

    /// Joins meshes of one material where there are more objects than images can number.
    fn join_objects(&mut self) {
        if self.objects.len() <= MOST_OBJECTS {
            return;
        }
        self.objects = joined(std::mem::take(&mut self.objects));
        let at = self.tree.shapes.first().map(|shape| shape.entity.at).unwrap_or_default();
        self.note(at, format!("more than {MOST_OBJECTS} shapes: those of one material are one object"));
    }
}

/// A mesh moved by a map, with the side of its normals as pbrt has it.
fn moved(made: Made, map: &DMat4, is_reversed: bool, is_textured: bool) -> TriangleMesh {
    let mut mesh = mesh(made);
    if is_textured && mesh.uvs.is_empty() {
        mesh = with_usual_uvs(&mesh);
    }
    let normal_map = glam::DMat3::from_mat4(*map).inverse().transpose();
    for position in &mut mesh.positions {
        *position = map.transform_point3(position.as_dvec3()).as_vec3();
    }
    // Given normals turn around with the orientation: of version 3 at hits, of version 4 in the mesh itself.
    let sign = if is_reversed { -1.0 } else { 1.0 };
    for normal in &mut mesh.normals {
        *normal = (normal_map * normal.as_dvec3() * sign).as_vec3().normalize_or_zero();
    }
    let mirrors = map.determinant() < 0.0;
    for index in 0..mesh.triangles.len() {
        let faces_inward = match mesh.normals.is_empty() {
            true => mirrors != is_reversed,
            false => turns_from_normals(&mesh, index),
        };
        if faces_inward {
            mesh.triangles[index].swap(1, 2);
        }
    }
    mesh
}

/// Objects in which meshes of one material and kind that do not shine are one.
fn joined(objects: Vec<Object>) -> Vec<Object> {
    let mut joined: Vec<Object> = Vec::new();
    let mut open: HashMap<(usize, bool, bool), usize> = HashMap::new();
    for object in objects {
        let Shape::Mesh(mesh) = &object.shape else {
            joined.push(object);
            continue;
        };
        let key = (object.material, mesh.normals.is_empty(), mesh.uvs.is_empty());
        match open.get(&key).filter(|_| object.emission.is_none()) {
            Some(&first) => {
                if let Shape::Mesh(sum) = &mut joined[first].shape {
                    Arc::make_mut(sum).append(mesh);
                }
            }
            None => {
                if object.emission.is_none() {
                    open.insert(key, joined.len());
                }
                joined.push(object);
            }
        }
    }
    joined
}

/// The name of a file without folders and ending.
fn file_stem(path: &str) -> &str {
    let name = path.rsplit(['/', '\\']).next().unwrap_or(path);
    name.split('.').next().filter(|stem| !stem.is_empty()).unwrap_or("mesh")
}

/// Points or vectors of a parameter.
fn points(given: &Given<'_>, name: &str) -> Vec<Vec3> {
    let numbers = given.numbers(name).unwrap_or_default();
    numbers.chunks_exact(3).map(|p| Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32)).collect()
}

/// Whether a map keeps right angles and scales all directions alike.
fn is_similar(map: &DMat4) -> bool {
    let [x, y, z] = [map.x_axis, map.y_axis, map.z_axis].map(glam::DVec4::truncate);
    let length = x.length();
    let even = [y, z].iter().all(|axis| (axis.length() / length - 1.0).abs() < 1e-5);
    even && [x.dot(y), y.dot(z), z.dot(x)].iter().all(|cos| cos.abs() < 1e-5 * length * length)
}

fn mesh(made: Made) -> TriangleMesh {
    match made {
        Made::Mesh(mesh) => mesh,
        Made::Sphere(radius) => {
            let profile = curve(STEPS_ALONG, |t| {
                let latitude = PI * (t - 0.5);
                [radius * latitude.cos(), radius * latitude.sin()]
            });
            revolved(&profile, 2.0 * PI)
        }
        Made::Disc { height, radius } => revolved(&[[radius, height], [0.0, height]], 2.0 * PI),
    }
}

/// A shape of a scene as a mesh in its place; copies of instances one after the other.
pub(crate) fn mesh_in_place(shape: &Shape) -> TriangleMesh {
    let placed = |mut mesh: TriangleMesh, place: Affine3| {
        let turn = place.matrix3.inverse().transpose();
        mesh.positions.iter_mut().for_each(|point| *point = place.transform_point3(*point));
        mesh.normals.iter_mut().for_each(|normal| *normal = (turn * *normal).normalize_or(Vec3::Z));
        if place.matrix3.determinant() < 0.0 {
            mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        }
        mesh
    };
    match shape {
        Shape::Mesh(whole) => whole.as_ref().clone(),
        Shape::Sphere { center, radius_m } => {
            placed(mesh(Made::Sphere((*radius_m).into())), Affine3::from_translation(*center))
        }
        Shape::Disc { center, normal, radius_m } => {
            let turn = glam::Quat::from_rotation_arc(Vec3::Z, *normal);
            let disc = mesh(Made::Disc { height: 0.0, radius: (*radius_m).into() });
            placed(disc, Affine3::from_rotation_translation(turn, *center))
        }
        Shape::Instances(instances) => {
            let mut all = TriangleMesh::default();
            for instance in &instances.instances {
                let copy =
                    placed(instances.meshes[instance.mesh as usize].as_ref().clone(), instance.to_world);
                let first = all.positions.len() as u32;
                all.triangles
                    .extend(copy.triangles.iter().map(|corners| corners.map(|corner| corner + first)));
                all.positions.extend(copy.positions);
                all.normals.extend(copy.normals);
                all.uvs.extend(copy.uvs);
            }
            // Of meshes with and without them together there are none
            all.normals.truncate(if all.normals.len() == all.positions.len() { usize::MAX } else { 0 });
            all.uvs.truncate(if all.uvs.len() == all.positions.len() { usize::MAX } else { 0 });
            all
        }
    }
}

/// Points of a curve at even steps of its parameter from 0 to 1.
fn curve(steps: usize, point: impl Fn(f64) -> [f64; 2]) -> Vec<[f64; 2]> {
    (0..=steps).map(|i| point(i as f64 / steps as f64)).collect()
}

/// A profile (radius, height) turned about z from x toward y. Normals lie to the right of the way along the profile:
/// outside, for one that rises. Texture coordinates run around and along.
fn revolved(profile: &[[f64; 2]], angle: f64) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    let last = profile.len() - 1;
    for (row, point) in profile.iter().enumerate() {
        let (before, after) = (profile[row.saturating_sub(1)], profile[(row + 1).min(last)]);
        let (along_r, along_z) = (after[0] - before[0], after[1] - before[1]);
        for step in 0..=STEPS_AROUND {
            let (sin, cos) = (angle * step as f64 / STEPS_AROUND as f64).sin_cos();
            let radius = point[0].max(0.0);
            mesh.positions.push(DVec3::new(radius * cos, radius * sin, point[1]).as_vec3());
            mesh.normals
                .push(DVec3::new(along_z * cos, along_z * sin, -along_r).as_vec3().normalize_or(Vec3::Z));
            mesh.uvs.push(Vec2::new(step as f32 / STEPS_AROUND as f32, row as f32 / last as f32));
        }
    }
    let row = STEPS_AROUND as u32 + 1;
    for r in 0..last as u32 {
        for s in 0..STEPS_AROUND as u32 {
            let first = r * row + s;
            for triangle in [[first, first + 1, first + row + 1], [first, first + row + 1, first + row]] {
                // At a pole one of the two has no area.
                if mesh.triangle_cross(&triangle).length_squared() > 0.0 {
                    mesh.triangles.push(triangle);
                }
            }
        }
    }
    mesh
}

/// Whether a triangle faces away from the normals of its corners. Their side is the outside.
fn turns_from_normals(mesh: &TriangleMesh, index: usize) -> bool {
    let triangle = mesh.triangles[index];
    let normal: Vec3 = triangle.iter().map(|corner| mesh.normals[*corner as usize]).sum();
    mesh.triangle_cross(&triangle).dot(normal) < 0.0
}

/// The mesh with the texture coordinates that pbrt gives triangles without any: (0, 0), (1, 0), (1, 1).
fn with_usual_uvs(mesh: &TriangleMesh) -> TriangleMesh {
    let mut apart = TriangleMesh::default();
    for (number, triangle) in mesh.triangles.iter().enumerate() {
        for (corner, uv) in triangle.iter().zip([Vec2::ZERO, Vec2::X, Vec2::ONE]) {
            apart.positions.push(mesh.positions[*corner as usize]);
            apart.normals.extend(mesh.normals.get(*corner as usize));
            apart.uvs.push(uv);
        }
        let first = 3 * number as u32;
        apart.triangles.push([first, first + 1, first + 2]);
    }
    apart
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_of_revolution_have_their_areas_and_face_outward() {
        let sphere = mesh(Made::Sphere(2.0));
        assert!((sphere.area_m2() / (16.0 * PI) - 1.0).abs() < 1e-3);
        let disc = mesh(Made::Disc { height: 1.0, radius: 2.0 });
        assert!((disc.area_m2() / (4.0 * PI) - 1.0).abs() < 1e-3);
        assert!(disc.triangles.iter().all(|t| disc.triangle_cross(t).z > 0.0) && disc.normals[0] == Vec3::Z);
        for t in &sphere.triangles {
            let middle: Vec3 = t.iter().map(|c| sphere.positions[*c as usize]).sum();
            assert!(sphere.triangle_cross(t).dot(middle) > 0.0);
        }
        assert!(sphere.positions.iter().zip(&sphere.normals).all(|(p, n)| p.dot(*n) > 1.99));
    }

    #[test]
    fn names_of_files_are_names_of_objects() {
        assert_eq!((file_stem("a/b.ply.gz"), file_stem(".ply"), file_stem("c")), ("b", "mesh", "c"));
    }
}
