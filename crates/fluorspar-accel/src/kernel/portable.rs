//! Plain Rust on arrays, which compilers turn into the vector instructions of any target.

use super::{ClosestSearch, Distances, OcclusionSearch, Traversal};
use crate::instance_bvh::PlacedTrees;
use crate::ray::{FAR_SLACK, Hit, Ray, RayFrame};
use crate::wide_tree::{PACK, PACK_VERTICES, TrianglePack, WIDTH, WideNode, WideTree};

#[derive(Clone, Copy)]
struct Arrays;

pub(super) fn closest(tree: &WideTree, ray: &Ray) -> Option<Hit> {
    super::search::<_, ClosestSearch>(Arrays, tree, ray)
}

pub(super) fn occluded(tree: &WideTree, ray: &Ray) -> bool {
    super::search::<_, OcclusionSearch>(Arrays, tree, ray)
}

pub(super) fn closest_placed(placed: &PlacedTrees, ray: &Ray) -> Option<(u32, Hit)> {
    super::closest_placed(Arrays, placed, ray)
}

pub(super) fn occluded_placed(placed: &PlacedTrees, ray: &Ray) -> bool {
    super::occluded_placed(Arrays, placed, ray)
}

pub(super) fn closest_each(tree: &WideTree, rays: &[Ray], hits: &mut [Option<Hit>]) {
    super::search_each::<_, ClosestSearch>(Arrays, tree, rays, hits);
}

pub(super) fn occluded_each(tree: &WideTree, rays: &[Ray], answers: &mut [bool]) {
    super::search_each::<_, OcclusionSearch>(Arrays, tree, rays, answers);
}

/// The second number if either is NaN, as the instructions of most processors have it.
#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

impl Traversal for Arrays {
    #[inline(always)]
    fn boxes(self, node: &WideNode, ray: &RayFrame, limit: f32) -> (u32, Distances) {
        let mut enter = [ray.t_min; WIDTH];
        let mut leave = [f32::INFINITY; WIDTH];
        for axis in 0..3 {
            let near = &node.planes[ray.near[axis]];
            let far = &node.planes[ray.far[axis]];
            for column in 0..WIDTH {
                enter[column] = max((near[column] - ray.origin[axis]) * ray.inverse[axis], enter[column]);
                leave[column] = min((far[column] - ray.origin[axis]) * ray.inverse[axis], leave[column]);
            }
        }
        let mut entered = 0;
        for column in 0..WIDTH {
            entered |= u32::from(enter[column] <= min(leave[column] * FAR_SLACK, limit)) << column;
        }
        (entered, Distances(enter))
    }

    #[inline(always)]
    fn candidates(self, pack: &TrianglePack, ray: &RayFrame) -> u32 {
        let [kx, ky, kz] = ray.axes;
        let [sx, sy, _] = ray.shear;
        let [mut x, mut y] = [[0.0; PACK_VERTICES]; 2];
        for vertex in 0..PACK_VERTICES {
            let z = pack.vertices[kz][vertex] - ray.origin[kz];
            x[vertex] = (pack.vertices[kx][vertex] - ray.origin[kx]) - sx * z;
            y[vertex] = (pack.vertices[ky][vertex] - ray.origin[ky]) - sy * z;
        }
        let mut inside = 0;
        for lane in 0..PACK {
            let [v0, v1, v2] = [0, 1, 2].map(|corner| pack.vertex(corner, lane));
            let a = x[v2] * y[v1] - y[v2] * x[v1];
            let b = x[v0] * y[v2] - y[v0] * x[v2];
            let c = x[v1] * y[v0] - y[v1] * x[v0];
            let least = min(a, min(b, c));
            let greatest = max(a, max(b, c));
            inside |= u32::from((least >= 0.0) | (greatest <= 0.0)) << lane;
        }
        inside & pack.used()
    }
}
