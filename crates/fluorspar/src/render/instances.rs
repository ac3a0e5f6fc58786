//! Meshes at many places, ready for rendering.

use std::sync::Arc;

use fluorspar_accel::{BuildError, Instance, InstanceBvh, Ray, TriangleBvh};
use glam::{Affine3, DVec3, Vec2, Vec3};

use crate::geometry::{MeshInstance, MeshInstances, TriangleMesh};

/// The instances of all objects that have some, in the order of the objects.
#[derive(Debug)]
pub(super) struct CompiledInstances {
    pub(super) bvh: InstanceBvh,
    meshes: Vec<CenteredMesh>,
    /// Object of each instance.
    objects: Vec<u32>,
}

/// A mesh moved so that the origin is in the middle of its box; the places of its instances make up for it.
///
/// Rays are rounded in the frame of the mesh. Near the origin that is as fine as at the place; a mesh modeled far from
/// its origin would be hit off its surface by more than the offset of ray origins.
#[derive(Debug)]
struct CenteredMesh {
    /// Normals, texture coordinates and triangles; its positions are as they were given.
    mesh: Arc<TriangleMesh>,
    /// Positions about the center.
    positions: Vec<Vec3>,
    /// Center that was subtracted from the positions.
    center: DVec3,
}

impl CenteredMesh {
    fn new(mesh: Arc<TriangleMesh>) -> Self {
        // Vertices without triangles may be anywhere. Triangles without vertices are refused with their tree.
        let used = mesh.triangles.iter().flatten().filter_map(|&v| mesh.positions.get(v as usize).copied());
        let bounds = used.map(|p| (p, p)).reduce(|(low, high), (p, _)| (low.min(p), high.max(p)));
        let center = bounds.map_or(DVec3::ZERO, |(low, high)| 0.5 * (low.as_dvec3() + high.as_dvec3()));
        let positions = mesh.positions.iter().map(|p| (p.as_dvec3() - center).as_vec3()).collect();
        Self { mesh, positions, center }
    }

    /// The transform of the moved mesh if that of the given one is `to_world`: `t' = M c + t`.
    fn place(&self, to_world: &Affine3) -> Affine3 {
        let moved = to_world.matrix3.as_dmat3() * self.center + to_world.translation.as_dvec3();
        Affine3 { matrix3: to_world.matrix3, translation: moved.as_vec3() }
    }
}

/// Gathers instances object by object.
#[derive(Debug, Default)]
pub(super) struct InstanceList {
    meshes: Vec<Arc<TriangleMesh>>,
    instances: Vec<Instance>,
    objects: Vec<u32>,
}

/// Where an instance was hit: corners, shading normals and texture coordinates at its place, in the order of the mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlacedTriangle {
    pub(super) corners: [Vec3; 3],
    /// Unit geometric normal, outward also where the place mirrors.
    pub(super) geometric: Vec3,
    /// Interpolated normal, zero for faceted meshes.
    pub(super) normal: Vec3,
    pub(super) uv: Vec2,
}

impl InstanceList {
    /// Adds the instances of an object; meshes that another object has brought are shared.
    pub(super) fn add(&mut self, object: usize, many: &MeshInstances) {
        let number_of = |mesh: &Arc<TriangleMesh>, meshes: &mut Vec<Arc<TriangleMesh>>| {
            let known = meshes.iter().position(|other| Arc::ptr_eq(other, mesh));
            known.unwrap_or_else(|| {
                meshes.push(Arc::clone(mesh));
                meshes.len() - 1
            }) as u32
        };
        let numbers: Vec<u32> = many.meshes.iter().map(|mesh| number_of(mesh, &mut self.meshes)).collect();
        self.instances.extend(many.instances.iter().map(|MeshInstance { mesh, to_world }| Instance {
            mesh: numbers[*mesh as usize],
            to_world: *to_world,
        }));
        self.objects.resize(self.instances.len(), object as u32);
    }

    /// `None` where there are no instances.
    pub(super) fn build(self) -> Result<Option<CompiledInstances>, BuildError> {
        if self.instances.is_empty() {
            return Ok(None);
        }
        let meshes: Vec<CenteredMesh> = self.meshes.into_iter().map(CenteredMesh::new).collect();
        let mut instances = self.instances;
        for Instance { mesh, to_world } in &mut instances {
            *to_world = meshes[*mesh as usize].place(to_world);
        }
        let tree =
            |mesh: &CenteredMesh| TriangleBvh::build(&mesh.positions, &mesh.mesh.triangles).map(Arc::new);
        let trees = meshes.iter().map(tree).collect::<Result<Vec<_>, _>>()?;
        let bvh = InstanceBvh::build(trees, &instances)?;
        Ok(Some(CompiledInstances { bvh, meshes, objects: self.objects }))
    }
}

impl CompiledInstances {
    pub(super) fn object_of(&self, instance: u32) -> usize {
        self.objects[instance as usize] as usize
    }

    /// Largest coordinate, m.
    pub(super) fn reach(&self) -> f32 {
        self.bvh.bounds().map_or(0.0, |(low, high)| low.abs().max(high.abs()).max_element())
    }

    /// Memory of trees, places and meshes, bytes.
    pub(super) fn memory_bytes(&self) -> usize {
        let of_mesh = |CenteredMesh { mesh, positions, .. }: &CenteredMesh| {
            (mesh.positions.len() + positions.len()) * size_of::<Vec3>()
                + mesh.normals.len() * size_of::<Vec3>()
                + mesh.uvs.len() * size_of::<Vec2>()
                + mesh.triangles.len() * size_of::<[u32; 3]>()
        };
        self.bvh.memory_bytes()
            + self.meshes.iter().map(of_mesh).sum::<usize>()
            + self.objects.len() * size_of::<u32>()
    }

    /// Corners of a triangle of an instance at its place.
    pub(super) fn corners(&self, instance: u32, triangle: u32) -> [Vec3; 3] {
        let Instance { mesh, to_world } = self.bvh.instance(instance);
        let CenteredMesh { mesh, positions, .. } = &self.meshes[mesh as usize];
        mesh.triangles[triangle as usize].map(|v| to_world.transform_point3(positions[v as usize]))
    }

    /// Texture coordinates of the corners of a triangle; zeros where the mesh has none.
    pub(super) fn texture_corners(&self, instance: u32, triangle: u32) -> [Vec2; 3] {
        let mesh = &self.meshes[self.bvh.instance(instance).mesh as usize].mesh;
        let uv = |v: u32| mesh.uvs.get(v as usize).copied().unwrap_or(Vec2::ZERO);
        mesh.triangles[triangle as usize].map(uv)
    }

    /// A triangle at its place, as it would be had the whole mesh been carried there vertex by vertex.
    pub(super) fn placed(&self, instance: u32, triangle: u32, u: f32, v: f32) -> PlacedTriangle {
        let Instance { mesh: number, to_world } = self.bvh.instance(instance);
        let place = MeshInstance { mesh: number, to_world };
        let CenteredMesh { mesh, positions, .. } = &self.meshes[number as usize];
        let vertices = mesh.triangles[triangle as usize].map(|v| v as usize);
        let [a, b, c] = vertices.map(|v| to_world.transform_point3(positions[v]));
        let cross = (b - a).cross(c - a).normalize_or_zero();
        let w = 1.0 - u - v;
        let normal = if mesh.normals.is_empty() {
            Vec3::ZERO
        } else {
            let map = place.normal_map();
            let [a, b, c] = vertices.map(|v| (map * mesh.normals[v]).normalize_or_zero());
            a * w + b * u + c * v
        };
        let [p, q, r] = self.texture_corners(instance, triangle);
        PlacedTriangle {
            corners: [a, b, c],
            geometric: if place.mirrors() { -cross } else { cross },
            normal,
            uv: p * w + q * u + r * v,
        }
    }

    /// The nearest instance along a ray: `t`, instance, triangle, `u` and `v`.
    #[inline]
    pub(super) fn closest(&self, ray: &Ray) -> Option<(f32, u32, u32, f32, f32)> {
        self.bvh.closest(ray).map(|hit| (hit.hit.t, hit.instance, hit.hit.triangle, hit.hit.u, hit.hit.v))
    }
}
