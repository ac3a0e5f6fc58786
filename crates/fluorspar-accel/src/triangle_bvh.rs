//! The public tree: checks its input, builds, dispatches.

use glam::Vec3;
use rayon::prelude::*;
use thiserror::Error;

use crate::binary_tree::{self, BinaryTree, Bounds};
use crate::kernel::{Dispatch, Kernel};
use crate::ray::{Hit, Ray};
use crate::wide_tree::{self, STACK_CAPACITY, TrianglePack, WideNode, WideTree};

/// Vertices must lie within this distance of the origin along each axis, so that products of two differences stay
/// within the range of `f32`.
pub const LARGEST_COORDINATE: f32 = 1e18;

/// Triangles that a reference of 31 bits can number, with room to spare.
pub(crate) const MOST_TRIANGLES: usize = 1 << 30;

/// Why a mesh cannot be traced.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum BuildError {
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite: {value:?}")]
    NotFinite {
        /// Vertex number, from 0.
        vertex: usize,
        /// Its position.
        value: Vec3,
    },
    /// A coordinate exceeds [`LARGEST_COORDINATE`].
    #[error(
        "vertex {vertex} lies too far from the origin, at {value:?}; coordinates may be up to {LARGEST_COORDINATE:e}"
    )]
    TooFar {
        /// Vertex number, from 0.
        vertex: usize,
        /// Its position.
        value: Vec3,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "triangle {triangle} uses vertex {vertex}, but there are only {count} vertices (numbered from 0)"
    )]
    VertexOutOfRange {
        /// Triangle number, from 0.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// There are more triangles than can be numbered.
    #[error("{count} triangles are too many: a tree holds up to {MOST_TRIANGLES}")]
    TooManyTriangles {
        /// Number of triangles.
        count: usize,
    },
    /// An instance names a mesh that does not exist.
    #[error("instance {instance} places mesh {mesh}, but there are only {count} meshes (numbered from 0)")]
    MeshOutOfRange {
        /// Instance number, from 0.
        instance: usize,
        /// The mesh it names.
        mesh: u32,
        /// Number of meshes.
        count: usize,
    },
    /// The transform of an instance can't be inverted: it flattens the mesh, or it is not finite.
    #[error(
        "the transform of instance {instance} can't be inverted: it flattens the mesh, or a number in it is not finite"
    )]
    NotInvertible {
        /// Instance number, from 0.
        instance: usize,
    },
    /// An instance lies beyond [`LARGEST_COORDINATE`].
    #[error(
        "instance {instance} lies too far from the origin; coordinates may be up to {LARGEST_COORDINATE:e}"
    )]
    InstanceTooFar {
        /// Instance number, from 0.
        instance: usize,
    },
    /// There are more instances than can be numbered.
    #[error("{count} instances are too many: a tree holds up to {MOST_TRIANGLES}")]
    TooManyInstances {
        /// Number of instances.
        count: usize,
    },
    /// The requested kernel needs instructions that this processor does not have.
    #[error(
        "this processor cannot run the {kernel} kernel; leave the choice open, or take one of Kernel::available()"
    )]
    KernelUnavailable {
        /// The requested kernel.
        kernel: Kernel,
    },
}

/// Choices that [`TriangleBvh::build`] makes by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BuildOptions {
    /// The code that traverses; by default the fastest that this processor runs. All give the same hits.
    pub kernel: Option<Kernel>,
}

/// A triangle mesh prepared for tracing rays through it.
#[derive(Clone, Debug)]
pub struct TriangleBvh {
    pub(crate) tree: WideTree,
    bounds: Option<Bounds>,
    triangle_count: usize,
    dispatch: Dispatch,
}

impl TriangleBvh {
    /// Prepares a mesh: three vertex numbers per triangle.
    ///
    /// The mesh may be empty, open, self-intersecting or contain triangles without area. The result is the same on
    /// every machine and for any number of threads.
    ///
    /// # Errors
    /// The first vertex that is not finite or too far away, or the first triangle that names a missing vertex.
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<Self, BuildError> {
        Self::build_with(positions, triangles, &BuildOptions::default())
    }

    /// [`TriangleBvh::build`] with the choices spelled out.
    ///
    /// # Errors
    /// Those of [`TriangleBvh::build`], and [`BuildError::KernelUnavailable`].
    pub fn build_with(
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        options: &BuildOptions,
    ) -> Result<Self, BuildError> {
        let kernel = options.kernel.unwrap_or_else(Kernel::fastest);
        let dispatch = Dispatch::new(kernel).ok_or(BuildError::KernelUnavailable { kernel })?;
        check(positions, triangles)?;
        let corners = |number: u32| triangles[number as usize].map(|vertex| positions[vertex as usize]);
        let tree = build_fitting_tree(triangles.len(), corners, binary_tree::clustered);
        let bounds =
            (0..triangles.len() as u32).map(|number| tight_box(corners(number))).reduce(Bounds::union);
        Ok(Self { tree, bounds, triangle_count: triangles.len(), dispatch })
    }

    /// The hit with the least `t` between `ray.t_min` and `ray.t_max`, both excluded; front and back count alike.
    ///
    /// Of several at the same `t`, the one in the triangle with the lowest number. A ray whose origin or direction is
    /// not finite hits nothing.
    #[inline]
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.dispatch.closest(&self.tree, ray)
    }

    /// Is there any hit between `ray.t_min` and `ray.t_max`? The same as `closest(ray).is_some()`, but faster.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.dispatch.occluded(&self.tree, ray)
    }

    /// [`TriangleBvh::closest`] of every ray, in their order. Up to 64 traversals are interleaved, so
    /// that some move while others wait: faster from a few rays on, most for rays that go different ways.
    pub fn closest_each(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        hits.clear();
        hits.resize(rays.len(), None);
        self.dispatch.closest_each(&self.tree, rays, hits);
    }

    /// [`TriangleBvh::occluded`] of every ray, in their order; as fast as [`TriangleBvh::closest_each`].
    pub fn occluded_each(&self, rays: &[Ray], answers: &mut Vec<bool>) {
        answers.clear();
        answers.resize(rays.len(), false);
        self.dispatch.occluded_each(&self.tree, rays, answers);
    }

    /// Least and greatest coordinates of all triangles; `None` if there are none.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        self.bounds.map(|b| (b.min, b.max))
    }

    /// Memory that the tree and its copy of the triangles take, in bytes.
    pub fn memory_bytes(&self) -> usize {
        size_of::<Self>()
            + self.tree.nodes.capacity() * size_of::<WideNode>()
            + self.tree.packs.capacity() * size_of::<TrianglePack>()
    }

    /// Number of triangles in the input.
    pub fn triangle_count(&self) -> usize {
        self.triangle_count
    }

    /// The code that traverses this tree.
    pub fn kernel(&self) -> Kernel {
        self.dispatch.kernel()
    }
}

fn check(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), BuildError> {
    if triangles.len() > MOST_TRIANGLES {
        return Err(BuildError::TooManyTriangles { count: triangles.len() });
    }
    for (vertex, &value) in positions.iter().enumerate() {
        if !value.is_finite() {
            return Err(BuildError::NotFinite { vertex, value });
        }
        if value.abs().max_element() > LARGEST_COORDINATE {
            return Err(BuildError::TooFar { vertex, value });
        }
    }
    let count = positions.len();
    for (triangle, corners) in triangles.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&vertex| vertex as usize >= count) {
            return Err(BuildError::VertexOutOfRange { triangle, vertex, count });
        }
    }
    Ok(())
}

/// Builds a tree that the traversal stack can cope with: grouped by `group`, or balanced should that be too deep.
fn build_fitting_tree(
    count: usize,
    corners: impl Fn(u32) -> [Vec3; 3] + Copy + Sync,
    group: impl Fn(Vec<Bounds>) -> BinaryTree,
) -> WideTree {
    let mut tree = build_tree(count, corners, group);
    if wide_tree::stack_need(&tree.nodes) > STACK_CAPACITY {
        tree = build_tree(count, corners, binary_tree::balanced);
    }
    // The kernels write to the stack unchecked; a balanced tree of 2^30 triangles is 30 levels deep.
    assert!(wide_tree::stack_need(&tree.nodes) <= STACK_CAPACITY, "a balanced tree fits the traversal stack");
    tree
}

/// Builds the tree of all triangles that have an area.
fn build_tree(
    count: usize,
    corners: impl Fn(u32) -> [Vec3; 3] + Sync,
    group: impl Fn(Vec<Bounds>) -> BinaryTree,
) -> WideTree {
    let numbers: Vec<u32> = (0..count as u32).filter(|&number| has_area(corners(number))).collect();
    // Twice rather than kept: what groups them takes ten times their memory
    let boxes = || -> Vec<Bounds> { numbers.par_iter().map(|&number| padded_box(corners(number))).collect() };
    let binary = group(boxes());
    let mut tree = wide_tree::collapse(&binary, boxes(), |item| {
        let number = numbers[item as usize];
        (corners(number), number)
    });
    tree.nodes.shrink_to_fit();
    tree.packs.shrink_to_fit();
    tree
}

/// Differences of `f32` numbers and products of two such differences are exact in `f64` unless the coordinates differ in
/// scale by orders of magnitude; then a triangle may be kept whose area is zero, and traversal must cope with it anyway.
fn has_area(corners: [Vec3; 3]) -> bool {
    let [p0, p1, p2] = corners.map(Vec3::as_dvec3);
    (p1 - p0).cross(p2 - p0) != glam::DVec3::ZERO
}

fn tight_box(corners: [Vec3; 3]) -> Bounds {
    let [p0, p1, p2] = corners;
    Bounds { min: p0.min(p1).min(p2), max: p0.max(p1).max(p2) }
}

/// The box of a triangle, grown so that the box test finds whatever the triangle test finds.
///
/// The shear of the triangle test moves a vertex by up to `(4 t + 6 s) r`, with distance `t` of the hit, extent `s` of
/// the triangle and unit roundoff `r = 2^-24`. The first part is relative to the distance and left to
/// [`crate::ray::FAR_SLACK`]; the second matters for rays that start close to a large triangle and is added here,
/// rounded up to `8 s r`.
fn padded_box(corners: [Vec3; 3]) -> Bounds {
    let tight = tight_box(corners);
    let pad = (tight.max - tight.min).max_element() * (4.0 * f32::EPSILON);
    let down = (tight.min - pad).to_array().map(f32::next_down);
    let up = (tight.max + pad).to_array().map(f32::next_up);
    Bounds { min: down.into(), max: up.into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::binary_tree::BinaryNode;
    use crate::ray::RayFrame;
    use crate::wide_tree::{LEAF, PACK, WIDTH};

    /// Well-spread points in [-1, 1)^3: the additive sequence of the plastic number's relative in three dimensions.
    fn point(index: usize) -> Vec3 {
        let spread = |alpha: f64| (((index + 1) as f64 * alpha).fract() * 2.0 - 1.0) as f32;
        Vec3::new(
            spread(0.819_172_513_396_164_4),
            spread(0.671_043_606_703_789_2),
            spread(0.549_700_477_901_97),
        )
    }

    /// Triangles that share vertices, on a wavy sheet of `2 SIDE SIDE`.
    fn sheet() -> Vec<[Vec3; 3]> {
        const SIDE: usize = 18;
        let vertex = |row: usize, column: usize| {
            let (x, y) = (2.0 * column as f32 / SIDE as f32 - 1.0, 2.0 * row as f32 / SIDE as f32 - 1.0);
            // Both zeros, which are one number but not one vertex.
            Vec3::new(
                x,
                y,
                if row.is_multiple_of(5) { -0.0 } else { 0.3 * (7.0 * x).sin() * (5.0 * y).cos() },
            )
        };
        let cell = |row: usize, column: usize| {
            let [a, b] = [vertex(row, column), vertex(row, column + 1)];
            let [c, d] = [vertex(row + 1, column), vertex(row + 1, column + 1)];
            [[a, b, d], [a, d, c]]
        };
        (0..SIDE * SIDE).flat_map(|number| cell(number / SIDE, number % SIDE)).collect()
    }

    fn soup(count: usize) -> Vec<[Vec3; 3]> {
        let corner = |n: usize, k: usize| point(7 * n) + 0.2 * point(31 * n + 1009 * k + 5);
        (0..count).map(|n| [corner(n, 0), corner(n, 1), corner(n, 2)]).collect()
    }

    fn ray(index: usize) -> Ray {
        let origin = 1.4 * point(3 * index + 1);
        let direction = (point(5 * index + 2) - origin).normalize();
        let t_max = if index.is_multiple_of(3) { 1.0 } else { f32::INFINITY };
        Ray { origin, direction, t_min: 0.0, t_max }
    }

    fn brute_force(triangles: &[[Vec3; 3]], ray: &Ray) -> Option<Hit> {
        let frame = RayFrame::new(ray);
        let mut best: Option<Hit> = None;
        for (number, corners) in triangles.iter().enumerate() {
            let mut pack = TrianglePack::EMPTY;
            assert!(pack.add(&mut 0, *corners, number as u32));
            if let Some((t, u, v)) = frame.intersect(&pack, 0)
                && t > ray.t_min
                && t < best.map_or(ray.t_max, |best| best.t)
            {
                best = Some(Hit { t, u, v, triangle: number as u32 });
            }
        }
        best
    }

    /// The deepest tree there is.
    fn chain(boxes: Vec<Bounds>) -> BinaryTree {
        let mut tree = Vec::new();
        for item in 0..boxes.len() as u32 {
            let next = tree.len() as u32 + 1;
            if item + 1 < boxes.len() as u32 {
                tree.push(BinaryNode::Inner([next + 1, next]));
            }
            tree.push(BinaryNode::Leaf(item));
        }
        tree
    }

    /// The tree only saves work: it changes no bit of the hits, however it groups the triangles.
    #[test]
    fn hits_do_not_depend_on_the_tree() {
        let (apart, together) = (soup(700), sheet());
        type Cluster = fn(Vec<Bounds>) -> BinaryTree;
        let cases: [(&[[Vec3; 3]], Cluster); 5] = [
            (&apart, binary_tree::clustered),
            (&apart, binary_tree::balanced),
            (&apart[..40], chain),
            (&together, binary_tree::clustered),
            (&together, binary_tree::balanced),
        ];
        for (triangles, cluster) in cases {
            let corners = |number: u32| triangles[number as usize];
            let tree = &build_tree(triangles.len(), corners, cluster);
            check_invariants(tree, triangles.len(), corners);
            let is_full = |pack: &TrianglePack| pack.used().count_ones() as usize == PACK;
            let shares = std::ptr::eq(triangles, together.as_slice());
            assert_eq!(
                tree.packs.iter().any(is_full),
                shares,
                "leaves are full where triangles share vertices"
            );
            for kernel in Kernel::available() {
                let dispatch = Dispatch::new(kernel).unwrap();
                let mut hits = 0;
                for index in 0..4000 {
                    let ray = ray(index);
                    let expected = brute_force(triangles, &ray);
                    assert_eq!(dispatch.closest(tree, &ray), expected, "{kernel}: {ray:?}");
                    assert_eq!(dispatch.occluded(tree, &ray), expected.is_some(), "{kernel}: {ray:?}");
                    hits += usize::from(expected.is_some());
                }
                assert!((400..3900).contains(&hits), "{hits} hits of 4000 test little");
            }
        }
    }

    /// Batched traversal agrees with single rays, for batches smaller and larger than the number of slots.
    #[test]
    fn rays_in_turns_find_the_same() {
        let triangles = soup(700);
        let positions: Vec<Vec3> = triangles.iter().flatten().copied().collect();
        let numbers: Vec<[u32; 3]> = (0..700).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
        let rays: Vec<Ray> = (0..1500).map(ray).collect();
        let (mut hits, mut answers) = (vec![None; 3], vec![true; 5]);
        for kernel in Kernel::available() {
            let options = BuildOptions { kernel: Some(kernel) };
            let bvh = TriangleBvh::build_with(&positions, &numbers, &options).unwrap();
            let nothing = TriangleBvh::build_with(&[], &[], &options).unwrap();
            for count in [0, 1, 2, 63, 64, 65, 128, 1500] {
                let rays = &rays[..count];
                bvh.closest_each(rays, &mut hits);
                assert_eq!(hits, rays.iter().map(|ray| bvh.closest(ray)).collect::<Vec<_>>(), "{kernel}");
                bvh.occluded_each(rays, &mut answers);
                assert_eq!(answers, hits.iter().map(Option::is_some).collect::<Vec<_>>(), "{kernel}");
                nothing.closest_each(rays, &mut hits);
                nothing.occluded_each(rays, &mut answers);
                assert_eq!((&hits, &answers), (&vec![None; count], &vec![false; count]));
            }
        }
    }

    /// What the unchecked reads of the kernels rely on, and that each triangle is in one leaf, within its boxes.
    fn check_invariants(tree: &WideTree, count: usize, corners: impl Fn(u32) -> [Vec3; 3]) {
        assert!(wide_tree::stack_need(&tree.nodes) <= STACK_CAPACITY);
        assert!(!tree.nodes.is_empty() && !tree.packs.is_empty());
        let mut seen = vec![0; count];
        let mut waiting = vec![(0_u32, Bounds { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY })];
        while let Some((number, outer)) = waiting.pop() {
            let node = &tree.nodes[number as usize];
            for column in 0..WIDTH {
                let plane = |row: usize| node.planes[row][column];
                let min = Vec3::new(plane(0), plane(1), plane(2));
                let max = Vec3::new(plane(3), plane(4), plane(5));
                let child = node.children[column];
                if child & LEAF == 0 {
                    assert!(child > number, "children come after their parents");
                } else {
                    assert!(((child & !LEAF) as usize) < tree.packs.len());
                }
                if min.x > max.x {
                    assert_eq!(child, LEAF, "unused columns name leaf 0");
                    continue;
                }
                assert!(min.cmpge(outer.min).all() && max.cmple(outer.max).all());
                if child & LEAF == 0 {
                    waiting.push((child, Bounds { min, max }));
                    continue;
                }
                let pack = &tree.packs[(child & !LEAF) as usize];
                for lane in (0..PACK).filter(|&lane| pack.used() >> lane & 1 == 1) {
                    let triangle = pack.numbers[lane] as usize;
                    seen[triangle] += 1;
                    for corner in 0..3 {
                        let vertex = pack.vertex(corner, lane);
                        let position = Vec3::from(pack.vertices.map(|axis| axis[vertex]));
                        let bits = |v: Vec3| v.to_array().map(f32::to_bits);
                        assert_eq!(bits(position), bits(corners(triangle as u32)[corner]));
                        assert!(position.cmpgt(min).all() && position.cmplt(max).all());
                    }
                }
            }
        }
        assert!(seen.iter().all(|&times| times == 1), "each triangle is in one leaf");
    }

    #[test]
    fn trees_too_deep_for_the_stack_are_replaced() {
        let triangles = soup(700);
        let corners = |number: u32| triangles[number as usize];
        assert_eq!(wide_tree::stack_need(&build_tree(0, corners, chain).nodes), 0);
        assert_eq!(wide_tree::stack_need(&build_tree(4, corners, chain).nodes), WIDTH);
        assert!(wide_tree::stack_need(&build_tree(700, corners, chain).nodes) > STACK_CAPACITY);
        check_invariants(&build_fitting_tree(700, corners, chain), 700, corners);
    }
}
