//! Plain Rust on arrays, which compilers turn into the vector instructions of any target.

use super::{Distances, Traversal};
use crate::instance_bvh::PlacedTrees;
use crate::ray::{FAR_SLACK, Hit, Ray, RayFrame};
use crate::wide_tree::{PACK, TrianglePack, WIDTH, WideNode, WideTree};

#[derive(Clone, Copy)]
struct Arrays;

pub(super) fn closest(tree: &WideTree, ray: &Ray) -> Option<Hit> {
    super::closest(Arrays, tree, ray)
}

pub(super) fn occluded(tree: &WideTree, ray: &Ray) -> bool {
    super::occluded(Arrays, tree, ray)
}

pub(super) fn closest_placed(placed: &PlacedTrees, ray: &Ray) -> Option<(u32, Hit)> {
    super::closest_placed(Arrays, placed, ray)
}

pub(super) fn occluded_placed(placed: &PlacedTrees, ray: &Ray) -> bool {
    super::occluded_placed(Arrays, placed, ray)
}

pub(super) fn closest_each(tree: &WideTree, rays: &[Ray], hits: &mut [Option<Hit>]) {
    super::closest_each(Arrays, tree, rays, hits);
}

pub(super) fn occluded_each(tree: &WideTree, rays: &[Ray], answers: &mut [bool]) {
    super::occluded_each(Arrays, tree, rays, answers);
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
        let mut met = 0;
        for column in 0..WIDTH {
            met |= u32::from(enter[column] <= min(leave[column] * FAR_SLACK, limit)) << column;
        }
        (met, Distances(enter))
    }

    #[inline(always)]
    fn prefetch(self, _: &WideTree, _: u32) {}

    #[inline(always)]
    fn candidates(self, pack: &TrianglePack, ray: &RayFrame) -> u32 {
        let [kx, ky, kz] = ray.axes;
        let [sx, sy, _] = ray.shear;
        let mut x = [[0.0; PACK]; 3];
        let mut y = [[0.0; PACK]; 3];
        for corner in 0..3 {
            for lane in 0..PACK {
                let z = pack.corners[kz][corner][lane] - ray.origin[kz];
                x[corner][lane] = (pack.corners[kx][corner][lane] - ray.origin[kx]) - sx * z;
                y[corner][lane] = (pack.corners[ky][corner][lane] - ray.origin[ky]) - sy * z;
            }
        }
        let mut inside = 0;
        for lane in 0..PACK {
            let a = x[2][lane] * y[1][lane] - y[2][lane] * x[1][lane];
            let b = x[0][lane] * y[2][lane] - y[0][lane] * x[2][lane];
            let c = x[1][lane] * y[0][lane] - y[1][lane] * x[0][lane];
            let least = min(a, min(b, c));
            let greatest = max(a, max(b, c));
            inside |= u32::from((least >= 0.0) | (greatest <= 0.0)) << lane;
        }
        inside
    }
}
