//! Surfaces as buffers, with the bounding volume hierarchies through which rays find them.

use std::borrow::Cow;

use fluorspar_accel::{BuildError, TriangleBvh};
use glam::{Vec2, Vec3};

use crate::geometry::{TriangleMesh, WetMesh, film_normals};
use crate::light::PreparedEmitter;
use crate::render::compiled_scene::{AnalyticShape, CompiledShape, MeshTriangle, MeshVertex};
use crate::render::instances::{CompiledInstances, InstanceList};
use crate::sampling::warp;
use crate::scene::{Scene, Shape};

/// All surfaces of a scene.
pub(super) struct Geometry {
    /// Over the triangles of meshes.
    pub(super) bvh: TriangleBvh,
    pub(super) vertices: Vec<MeshVertex>,
    /// Of each vertex, zero where there is none; empty without any.
    pub(super) film_normals: Vec<Vec3>,
    pub(super) triangles: Vec<MeshTriangle>,
    /// Meshes at many places; `None` where there are none.
    pub(super) instances: Option<CompiledInstances>,
    pub(super) shapes: Vec<CompiledShape>,
}

/// The surface of an object that emits.
pub(super) struct EmissiveSurface {
    pub(super) object: usize,
    pub(super) emitter: PreparedEmitter,
    pub(super) area_m2: f32,
}

/// Triangles and shapes as they are gathered, object by object.
#[derive(Default)]
struct Surfaces<'a> {
    /// Meshes, whose vertices follow each other, with their objects.
    meshes: Vec<(usize, Cow<'a, TriangleMesh>)>,
    positions: Vec<Vec3>,
    corners: Vec<[u32; 3]>,
    triangle_object: Vec<u32>,
    shapes: Vec<CompiledShape>,
}

/// Compiles the surfaces of a scene; also returns those that emit, in the order of their objects.
///
/// # Errors
/// Triangles that no hierarchy can be built over.
pub(super) fn compile(scene: &Scene) -> Result<(Geometry, Vec<EmissiveSurface>), BuildError> {
    let mut surfaces = Surfaces::default();
    let mut instances = InstanceList::default();
    let mut emissive = Vec::new();

    // Gather the surface of every object
    for (object, item) in scene.objects.iter().enumerate() {
        let emits = item.emission.is_some();
        let is_one_sided = item.emission.as_ref().is_some_and(|emission| emission.is_one_sided);
        let (emitter, area_m2) = match &item.shape {
            Shape::Mesh(mesh) => {
                let first_triangle = surfaces.add_mesh(object, Cow::Borrowed(mesh));
                if !emits {
                    continue;
                }
                (PreparedEmitter::mesh(mesh, first_triangle, is_one_sided), mesh.area_m2() as f32)
            }
            // Emissive instances are sampled triangle by triangle, by the areas that these have at their places.
            Shape::Instances(many) if emits => {
                let mesh = many.flattened();
                let area_m2 = mesh.area_m2() as f32;
                let emitter = PreparedEmitter::mesh(&mesh, surfaces.corners.len(), is_one_sided);
                surfaces.add_mesh(object, Cow::Owned(mesh));
                (emitter, area_m2)
            }
            Shape::Instances(many) => {
                instances.add(object, many);
                continue;
            }
            Shape::Sphere { center, radius_m } => {
                let shape = AnalyticShape::Sphere { center: *center, radius: *radius_m };
                surfaces.shapes.push(CompiledShape { object, shape });
                let area = 4.0 * std::f32::consts::PI * radius_m * radius_m;
                (PreparedEmitter::sphere(*center, *radius_m, is_one_sided), area)
            }
            Shape::Disc { center, normal, radius_m } => {
                let tangents = warp::tangents(*normal);
                let shape =
                    AnalyticShape::Disc { center: *center, normal: *normal, tangents, radius: *radius_m };
                surfaces.shapes.push(CompiledShape { object, shape });
                let area = std::f32::consts::PI * radius_m * radius_m;
                (PreparedEmitter::disc(*center, *normal, *radius_m, is_one_sided), area)
            }
        };
        if emits {
            emissive.push(EmissiveSurface { object, emitter, area_m2 });
        }
    }

    // Build the bounding volume hierarchies
    let Surfaces { meshes, positions, corners, triangle_object, shapes } = surfaces;
    let bvh = TriangleBvh::build(&positions, &corners)?;
    drop(positions);
    let instances = instances.build()?;
    // Not before: while a tree is built, memory is scarcest.
    let vertices = meshes.iter().flat_map(|(_, mesh)| vertices_of(mesh)).collect();
    let film_normals = films(scene, &meshes);

    let triangles = corners
        .into_iter()
        .zip(triangle_object)
        .map(|(vertices, object)| MeshTriangle { vertices, object })
        .collect();
    Ok((Geometry { bvh, vertices, film_normals, triangles, instances, shapes }, emissive))
}

/// Normals of the films on meshes, of each vertex; none where no material has one that evens out what is below it.
fn films(scene: &Scene, meshes: &[(usize, Cow<'_, TriangleMesh>)]) -> Vec<Vec3> {
    let smoothing = |(object, _): &(usize, Cow<'_, TriangleMesh>)| {
        scene.materials[scene.objects[*object].material].smoothing_m(&scene.materials)
    };
    let lengths: Vec<f32> = meshes.iter().map(smoothing).collect();
    if lengths.iter().all(|length| *length == 0.0) {
        return Vec::new();
    }
    let wet: Vec<WetMesh<'_>> = meshes
        .iter()
        .zip(&lengths)
        .filter(|(_, length)| **length > 0.0)
        .map(|((_, mesh), length)| WetMesh { mesh, smoothing_m: *length })
        .collect();
    let mut found = film_normals(&wet).into_iter();
    let of_mesh = |((_, mesh), length): (&(usize, Cow<'_, TriangleMesh>), &f32)| {
        let dry = || vec![Vec3::ZERO; mesh.positions.len()];
        if *length > 0.0 { found.next().unwrap_or_else(dry) } else { dry() }
    };
    meshes.iter().zip(&lengths).flat_map(of_mesh).collect()
}

/// The vertices of a mesh with what they lack as zeros.
fn vertices_of(mesh: &TriangleMesh) -> impl Iterator<Item = MeshVertex> {
    mesh.positions.iter().enumerate().map(|(index, &position)| MeshVertex {
        position,
        normal: mesh.normals.get(index).copied().unwrap_or(Vec3::ZERO),
        uv: mesh.uvs.get(index).copied().unwrap_or(Vec2::ZERO),
    })
}

impl<'a> Surfaces<'a> {
    /// Adds the triangles of a mesh; returns the number of the first of them.
    fn add_mesh(&mut self, object: usize, mesh: Cow<'a, TriangleMesh>) -> usize {
        let offset = self.positions.len() as u32;
        let first_triangle = self.corners.len();
        self.positions.extend_from_slice(&mesh.positions);
        self.corners.extend(mesh.triangles.iter().map(|t| t.map(|v| v + offset)));
        self.triangle_object.extend(std::iter::repeat_n(object as u32, mesh.triangles.len()));
        self.meshes.push((object, mesh));
        first_triangle
    }
}

impl Geometry {
    /// Largest absolute coordinate of any surface, m.
    pub(super) fn largest_coordinate_m(&self) -> f32 {
        let of_vertices = self.vertices.iter().map(|v| v.position.abs().max_element()).fold(0.0, f32::max);
        let of_shapes = self
            .shapes
            .iter()
            .map(|s| match &s.shape {
                AnalyticShape::Sphere { center, radius } | AnalyticShape::Disc { center, radius, .. } => {
                    center.abs().max_element() + radius
                }
            })
            .fold(0.0, f32::max);
        let of_instances = self.instances.as_ref().map_or(0.0, CompiledInstances::reach);
        of_vertices.max(of_shapes).max(of_instances)
    }

    /// Corners of a triangle.
    pub(super) fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].vertices.map(|v| self.vertices[v as usize].position)
    }
}
