//! Meshes at many places: a tree over the boxes of the instances, whose leaves are the trees of the meshes.

use std::sync::Arc;

use glam::{Affine3, DVec3, Vec3};
use rayon::prelude::*;

use crate::binary_tree::{self, BinaryTree, Bounds};
use crate::kernel::{Dispatch, Kernel};
use crate::ray::{Hit, Ray};
use crate::triangle_bvh::{BuildError, BuildOptions, LARGEST_COORDINATE, MOST_TRIANGLES, TriangleBvh};
use crate::wide_tree::{self, STACK_CAPACITY, WideNode, WideTree};

/// A mesh at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Number of the mesh, from 0.
    pub mesh: u32,
    /// From the frame of the mesh to that of the rays: any affine map that [`is_invertible`], mirrors and shears included.
    pub to_world: Affine3,
}

/// Least volume that a map gives the unit cube, relative to the product of the lengths of its edges: below, its edges
/// lie in one plane as far as single precision can tell.
const LEAST_VOLUME: f64 = 1e-6;

/// Whether a map is finite and has an inverse, as far as single precision can tell.
pub fn is_invertible(map: &Affine3) -> bool {
    let linear = map.matrix3.as_dmat3();
    let edges = linear.x_axis.length() * linear.y_axis.length() * linear.z_axis.length();
    // NaN is not greater.
    let has_volume = linear.determinant().abs() > LEAST_VOLUME * edges;
    has_volume && linear.inverse().is_finite() && map.translation.is_finite()
}

/// Where a ray meets an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InstanceHit {
    /// Number of the instance, from 0.
    pub instance: u32,
    /// The hit; `t` counts along the ray as it was given, `u`, `v` and the triangle are those of the mesh.
    pub hit: Hit,
}

/// Meshes, each prepared once, at any number of places.
///
/// Rays are carried into the frame of a mesh, where they intersect it as in [`TriangleBvh`]: watertight within a mesh, but
/// not between neighboring instances that only touch. Directions are not normalized on the way, so `t` stays what it
/// is. Of instances hit at the same `t`, the one with the lowest number wins; all kernels give the same bits.
///
/// Against the same triangles carried to their places one by one, hits differ by rounding: positions by a few units in
/// the last place of the distances from the ray's origin and from the places, and of the coordinates that a mesh has in
/// its own frame, stretched by its place. Meshes should have their origin in their middle, or near it.
#[derive(Clone, Debug)]
pub struct InstanceBvh {
    trees: PlacedTrees,
    bounds: Option<Bounds>,
    dispatch: Dispatch,
}

/// Data of the traversal. The stack that `nodes` need fits [`STACK_CAPACITY`], and references in them name existing
/// nodes, or with [`wide_tree::LEAF`] set existing places.
#[derive(Clone, Debug)]
pub(crate) struct PlacedTrees {
    pub(crate) nodes: Vec<WideNode>,
    pub(crate) places: Vec<Place>,
    meshes: Vec<Arc<TriangleBvh>>,
}

/// An instance ready for tracing: two cache lines.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// Rows of the inverse of the linear part. In double precision, for where the map stretches one way and shrinks
    /// another, rounding of its inverse would be stretched as well.
    to_mesh: [[f64; 3]; 3],
    to_world: Affine3,
    mesh: u32,
}

impl PlacedTrees {
    #[inline(always)]
    pub(crate) fn tree(&self, place: &Place) -> &WideTree {
        &self.meshes[place.mesh as usize].tree
    }
}

impl Place {
    /// The ray in the frame of the mesh.
    #[inline(always)]
    pub(crate) fn local_ray(&self, ray: &Ray, t_max: f32) -> Ray {
        let map = |[x, y, z]: [f64; 3]| {
            let row = |row: &[f64; 3]| (row[0] * x + row[1] * y + row[2] * z) as f32;
            Vec3::new(row(&self.to_mesh[0]), row(&self.to_mesh[1]), row(&self.to_mesh[2]))
        };
        let (origin, place) = (ray.origin.to_array(), self.to_world.translation.to_array());
        let from_place = |axis: usize| f64::from(origin[axis]) - f64::from(place[axis]);
        Ray {
            origin: map([from_place(0), from_place(1), from_place(2)]),
            direction: map(ray.direction.to_array().map(f64::from)),
            t_min: ray.t_min,
            t_max,
        }
    }
}

/// Growth of the boxes of instances, relative to the largest coordinate of the scene.
///
/// With unit roundoff `r = 2^-24`, the ray in the frame of a mesh is off by up to `r` of its origin and of its way, which
/// [`crate::ray::FAR_SLACK`] does not count, and triangles at their places by up to `4 r` of their coordinates; `8 r` and
/// as much again for the way. Coordinates in the frames of the meshes count, stretched to the length they have at their
/// places: those of a mesh far from its origin are the largest.
const PADDING: f64 = 16.0 / (1 << 24) as f64;

impl InstanceBvh {
    /// Prepares instances of meshes. There may be none of either; meshes may be empty.
    ///
    /// # Errors
    /// The first instance that names a missing mesh, has no inverse, or lies too far away.
    pub fn build(meshes: Vec<Arc<TriangleBvh>>, instances: &[Instance]) -> Result<Self, BuildError> {
        Self::build_with(meshes, instances, &BuildOptions::default())
    }

    /// [`InstanceBvh::build`] with the choices spelled out; the kernel traverses the trees of the meshes, too.
    ///
    /// # Errors
    /// Those of [`InstanceBvh::build`], and [`BuildError::KernelUnavailable`].
    pub fn build_with(
        meshes: Vec<Arc<TriangleBvh>>,
        instances: &[Instance],
        options: &BuildOptions,
    ) -> Result<Self, BuildError> {
        let kernel = options.kernel.unwrap_or_else(Kernel::fastest);
        let dispatch = Dispatch::new(kernel).ok_or(BuildError::KernelUnavailable { kernel })?;
        if instances.len() > MOST_TRIANGLES {
            return Err(BuildError::TooManyInstances { count: instances.len() });
        }
        // Bound every instance in the scene
        let mut places = Vec::with_capacity(instances.len());
        // Instances of meshes without triangles have no box and are left out of the tree.
        let mut numbers = Vec::with_capacity(instances.len());
        let mut boxes = Vec::with_capacity(instances.len());
        let mut reach = 0.0_f64;
        for (number, instance) in instances.iter().enumerate() {
            let mesh = meshes.get(instance.mesh as usize).ok_or(BuildError::MeshOutOfRange {
                instance: number,
                mesh: instance.mesh,
                count: meshes.len(),
            })?;
            places.push(place(number, instance)?);
            let Some((low, high)) = mesh.bounds() else { continue };
            let own = farthest_from_own_origin(&instance.to_world, low, high);
            let (low, high) = world_box(&instance.to_world, low, high);
            let farthest = low.abs().max(high.abs()).max_element();
            if farthest > f64::from(LARGEST_COORDINATE) {
                return Err(BuildError::InstanceTooFar { instance: number });
            }
            reach = reach.max(farthest).max(own);
            numbers.push(number as u32);
            boxes.push((low, high));
        }
        // Pad the boxes by the rounding of transformed rays
        let pad = DVec3::splat(PADDING * reach);
        let outward = |low: DVec3, high: DVec3| Bounds {
            min: (low - pad).as_vec3().to_array().map(f32::next_down).into(),
            max: (high + pad).as_vec3().to_array().map(f32::next_up).into(),
        };
        let bounds = boxes
            .iter()
            .map(|&(low, high)| Bounds { min: low.as_vec3(), max: high.as_vec3() })
            .reduce(Bounds::union);
        let boxes: Vec<Bounds> = boxes.par_iter().map(|&(low, high)| outward(low, high)).collect();
        // Build the tree over the boxes
        let mut nodes = fitting_nodes(&boxes, binary_tree::clustered);
        // Renumber the leaves where instances were left out
        if numbers.len() < instances.len() {
            for child in nodes.iter_mut().flat_map(|node| &mut node.children) {
                if *child & wide_tree::LEAF != 0 {
                    *child = wide_tree::LEAF | numbers[(*child & !wide_tree::LEAF) as usize];
                }
            }
        }
        nodes.shrink_to_fit();
        Ok(Self { trees: PlacedTrees { nodes, places, meshes }, bounds, dispatch })
    }

    /// The hit with the least `t` between `ray.t_min` and `ray.t_max`, both excluded; front and back count alike.
    #[inline]
    pub fn closest(&self, ray: &Ray) -> Option<InstanceHit> {
        self.dispatch.closest_placed(&self.trees, ray).map(|(instance, hit)| InstanceHit { instance, hit })
    }

    /// Is there any hit between `ray.t_min` and `ray.t_max`? The same as `closest(ray).is_some()`, but faster.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.dispatch.occluded_placed(&self.trees, ray)
    }

    /// An instance, as it was given.
    ///
    /// # Panics
    /// If there is no instance of this number.
    #[inline]
    pub fn instance(&self, number: u32) -> Instance {
        let place = &self.trees.places[number as usize];
        Instance { mesh: place.mesh, to_world: place.to_world }
    }

    /// Least and greatest coordinates of the boxes of all instances at their places; `None` if there are none. Those of a
    /// turned instance may be a little larger than the instance.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        self.bounds.map(|b| (b.min, b.max))
    }

    /// Memory that the tree over the instances and the trees of the meshes take, in bytes; a tree that is given twice
    /// counts once.
    pub fn memory_bytes(&self) -> usize {
        let meshes = &self.trees.meshes;
        let first = |number: usize| !meshes[..number].iter().any(|other| Arc::ptr_eq(other, &meshes[number]));
        let of_meshes =
            (0..meshes.len()).filter(|&number| first(number)).map(|number| meshes[number].memory_bytes());
        size_of::<Self>()
            + self.trees.nodes.capacity() * size_of::<WideNode>()
            + self.trees.places.capacity() * size_of::<Place>()
            + of_meshes.sum::<usize>()
    }

    /// The code that traverses these trees.
    pub fn kernel(&self) -> Kernel {
        self.dispatch.kernel()
    }
}

fn place(number: usize, instance: &Instance) -> Result<Place, BuildError> {
    if !is_invertible(&instance.to_world) {
        return Err(BuildError::NotInvertible { instance: number });
    }
    let inverse = instance.to_world.matrix3.as_dmat3().inverse().transpose();
    Ok(Place { to_mesh: inverse.to_cols_array_2d(), to_world: instance.to_world, mesh: instance.mesh })
}

/// The box around a box at its place.
fn world_box(to_world: &Affine3, low: Vec3, high: Vec3) -> (DVec3, DVec3) {
    let (low, high) = (low.as_dvec3(), high.as_dvec3());
    let linear = to_world.matrix3.as_dmat3();
    let (center, half) = (0.5 * (low + high), 0.5 * (high - low));
    let center = linear * center + to_world.translation.as_dvec3();
    let spread = linear.x_axis.abs() * half.x + linear.y_axis.abs() * half.y + linear.z_axis.abs() * half.z;
    (center - spread, center + spread)
}

/// Largest coordinate that a box can have in the frame of its mesh, as long as it is at its place.
fn farthest_from_own_origin(to_world: &Affine3, low: Vec3, high: Vec3) -> f64 {
    let (linear, far) = (to_world.matrix3.as_dmat3(), low.abs().max(high.abs()).as_dvec3());
    (linear.x_axis.abs() * far.x + linear.y_axis.abs() * far.y + linear.z_axis.abs() * far.z).max_element()
}

/// A tree over boxes that the traversal stack can cope with: grouped by `cluster`, or balanced should that be too deep.
fn fitting_nodes(boxes: &[Bounds], cluster: impl Fn(Vec<Bounds>) -> BinaryTree) -> Vec<WideNode> {
    let mut nodes = wide_tree::collapse_single(&cluster(boxes.to_vec()), boxes);
    if wide_tree::stack_need(&nodes) > STACK_CAPACITY {
        nodes = wide_tree::collapse_single(&binary_tree::balanced(boxes.to_vec()), boxes);
    }
    // The kernels write to the stack unchecked; a balanced tree of 2^30 boxes is 30 levels deep.
    assert!(wide_tree::stack_need(&nodes) <= STACK_CAPACITY, "a balanced tree fits the traversal stack");
    nodes
}
