//! x86-64 with AVX-512: sixteen bands, eight boxes or eight triangles per instruction.

use std::arch::x86_64::*;

use super::{Distances, Traversal};
use crate::instance_bvh::PlacedTrees;
use crate::ray::{FAR_SLACK, Hit, Ray, RayFrame};
use crate::wide_tree::{TrianglePack, WideNode, WideTree};

/// Proof that the processor has AVX-512 F, BW, CD, DQ and VL, AVX2, BMI1 and BMI2: only [`Detected::new`] makes one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Detected(());

impl Detected {
    pub(super) fn new() -> Option<Self> {
        let has = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512cd")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2");
        has.then_some(Self(()))
    }

    #[inline]
    pub(super) fn closest(self, tree: &WideTree, ray: &Ray) -> Option<Hit> {
        // SAFETY: `self` proves that the instructions have been detected.
        unsafe { closest(self, tree, ray) }
    }

    #[inline]
    pub(super) fn closest_placed(self, placed: &PlacedTrees, ray: &Ray) -> Option<(u32, Hit)> {
        // SAFETY: `self` proves that the instructions have been detected.
        unsafe { closest_placed(self, placed, ray) }
    }

    #[inline]
    pub(super) fn occluded_placed(self, placed: &PlacedTrees, ray: &Ray) -> bool {
        // SAFETY: `self` proves that the instructions have been detected.
        unsafe { occluded_placed(self, placed, ray) }
    }

    #[inline]
    pub(super) fn closest_each(self, tree: &WideTree, rays: &[Ray], hits: &mut [Option<Hit>]) {
        // SAFETY: `self` proves that the instructions have been detected.
        unsafe { closest_each(self, tree, rays, hits) }
    }

    #[inline]
    pub(super) fn occluded_each(self, tree: &WideTree, rays: &[Ray], answers: &mut [bool]) {
        // SAFETY: `self` proves that the instructions have been detected.
        unsafe { occluded_each(self, tree, rays, answers) }
    }

    #[inline]
    pub(super) fn occluded(self, tree: &WideTree, ray: &Ray) -> bool {
        // SAFETY: `self` proves that the instructions have been detected.
        unsafe { occluded(self, tree, ray) }
    }
}

#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2")]
fn closest(detected: Detected, tree: &WideTree, ray: &Ray) -> Option<Hit> {
    super::closest(detected, tree, ray)
}

#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2")]
fn occluded(detected: Detected, tree: &WideTree, ray: &Ray) -> bool {
    super::occluded(detected, tree, ray)
}

#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2")]
fn closest_placed(detected: Detected, placed: &PlacedTrees, ray: &Ray) -> Option<(u32, Hit)> {
    super::closest_placed(detected, placed, ray)
}

#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2")]
fn occluded_placed(detected: Detected, placed: &PlacedTrees, ray: &Ray) -> bool {
    super::occluded_placed(detected, placed, ray)
}

#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2")]
fn closest_each(detected: Detected, tree: &WideTree, rays: &[Ray], hits: &mut [Option<Hit>]) {
    super::closest_each(detected, tree, rays, hits);
}

#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2")]
fn occluded_each(detected: Detected, tree: &WideTree, rays: &[Ray], answers: &mut [bool]) {
    super::occluded_each(detected, tree, rays, answers);
}

// SAFETY of the blocks below: a value of type `Detected` proves that the processor has the instructions. Loads stay
// within fixed-size arrays, whose type keeps them aligned: rows of `WideNode::planes` start at multiples of 32 bytes in a
// struct aligned to 64, rows of `TrianglePack::corners` at multiples of 16 in a struct aligned to 32.
impl Traversal for Detected {
    #[inline(always)]
    fn boxes(self, node: &WideNode, ray: &RayFrame, limit: f32) -> (u32, Distances) {
        // SAFETY: AVX-512 is there and loads are aligned and within bounds, as said above.
        unsafe {
            let mut enter = _mm256_set1_ps(ray.t_min);
            let mut leave = _mm256_set1_ps(f32::INFINITY);
            for axis in 0..3 {
                let near = _mm256_load_ps(node.planes[ray.near[axis]].as_ptr());
                let far = _mm256_load_ps(node.planes[ray.far[axis]].as_ptr());
                let origin = _mm256_set1_ps(ray.origin[axis]);
                let inverse = _mm256_set1_ps(ray.inverse[axis]);
                let near = _mm256_mul_ps(_mm256_sub_ps(near, origin), inverse);
                let far = _mm256_mul_ps(_mm256_sub_ps(far, origin), inverse);
                enter = _mm256_max_ps(near, enter);
                leave = _mm256_min_ps(far, leave);
            }
            let leave = _mm256_mul_ps(leave, _mm256_set1_ps(FAR_SLACK));
            let leave = _mm256_min_ps(leave, _mm256_set1_ps(limit));
            let met = _mm256_cmp_ps_mask::<_CMP_LE_OQ>(enter, leave);
            let mut distances = Distances([0.0; 8]);
            _mm256_store_ps(distances.0.as_mut_ptr(), enter);
            (u32::from(met), distances)
        }
    }

    #[inline(always)]
    fn prefetch(self, tree: &WideTree, reference: u32) {
        super::prefetch_child(tree, reference);
    }

    #[inline(always)]
    fn candidates(self, pack: &TrianglePack, ray: &RayFrame) -> u32 {
        // SAFETY: AVX-512 is there and loads are aligned and within bounds, as said above.
        unsafe {
            let relative = |axis: usize, corner: usize| {
                _mm_sub_ps(
                    _mm_load_ps(pack.corners[ray.axes[axis]][corner].as_ptr()),
                    _mm_set1_ps(ray.origin[ray.axes[axis]]),
                )
            };
            let z = [relative(2, 0), relative(2, 1), relative(2, 2)];
            let sheared = |axis: usize, corner: usize| {
                _mm_sub_ps(relative(axis, corner), _mm_mul_ps(_mm_set1_ps(ray.shear[axis]), z[corner]))
            };
            let x = [sheared(0, 0), sheared(0, 1), sheared(0, 2)];
            let y = [sheared(1, 0), sheared(1, 1), sheared(1, 2)];
            let edge =
                |from: usize, to: usize| _mm_sub_ps(_mm_mul_ps(x[from], y[to]), _mm_mul_ps(y[from], x[to]));
            let (a, b, c) = (edge(2, 1), edge(0, 2), edge(1, 0));
            let least = _mm_min_ps(a, _mm_min_ps(b, c));
            let greatest = _mm_max_ps(a, _mm_max_ps(b, c));
            let zero = _mm_setzero_ps();
            let inside =
                _mm_cmp_ps_mask::<_CMP_GE_OQ>(least, zero) | _mm_cmp_ps_mask::<_CMP_LE_OQ>(greatest, zero);
            u32::from(inside)
        }
    }
}
