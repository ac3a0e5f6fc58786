//! x86-64 with AVX2: eight boxes or four triangles per instruction.

use std::arch::x86_64::*;

use super::{Distances, Traversal};
use crate::ray::{FAR_SLACK, Hit, Ray, RayFrame};
use crate::wide_tree::{TrianglePack, WideNode, WideTree};

/// Proof that the processor has AVX2 and BMI1: only [`Detected::new`] makes one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Detected(());

impl Detected {
    pub(super) fn new() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1")).then_some(Self(()))
    }

    #[inline]
    pub(super) fn closest(self, tree: &WideTree, ray: &Ray) -> Option<Hit> {
        // SAFETY: `self` proves that AVX2 and BMI1 have been detected.
        unsafe { closest(self, tree, ray) }
    }

    #[inline]
    pub(super) fn occluded(self, tree: &WideTree, ray: &Ray) -> bool {
        // SAFETY: `self` proves that AVX2 and BMI1 have been detected.
        unsafe { occluded(self, tree, ray) }
    }
}

#[target_feature(enable = "avx2,bmi1")]
fn closest(detected: Detected, tree: &WideTree, ray: &Ray) -> Option<Hit> {
    super::closest(detected, tree, ray)
}

#[target_feature(enable = "avx2,bmi1")]
fn occluded(detected: Detected, tree: &WideTree, ray: &Ray) -> bool {
    super::occluded(detected, tree, ray)
}

/// A ray with each number in all lanes.
pub(super) struct Broadcast {
    origin: [__m256; 3],
    inverse: [__m256; 3],
    t_min: __m256,
    near: [usize; 3],
    far: [usize; 3],
    axes: [usize; 3],
    /// Origin and shear in the order of `axes`.
    sheared_origin: [__m128; 3],
    shear: [__m128; 2],
}

// SAFETY of the blocks below: a value of type `Detected` proves that the processor has the instructions. Loads stay
// within fixed-size arrays, whose type keeps them aligned: rows of `WideNode::planes` start at multiples of 32 bytes in a
// struct aligned to 64, rows of `TrianglePack::corners` at multiples of 16 in a struct aligned to 32.
impl Traversal for Detected {
    type Ray = Broadcast;

    #[inline(always)]
    fn prepare(self, frame: &RayFrame) -> Broadcast {
        // SAFETY: AVX2 is there, as said above.
        unsafe {
            Broadcast {
                origin: [
                    _mm256_set1_ps(frame.origin[0]),
                    _mm256_set1_ps(frame.origin[1]),
                    _mm256_set1_ps(frame.origin[2]),
                ],
                inverse: [
                    _mm256_set1_ps(frame.inverse[0]),
                    _mm256_set1_ps(frame.inverse[1]),
                    _mm256_set1_ps(frame.inverse[2]),
                ],
                t_min: _mm256_set1_ps(frame.t_min),
                near: frame.near,
                far: frame.far,
                axes: frame.axes,
                sheared_origin: [
                    _mm_set1_ps(frame.origin[frame.axes[0]]),
                    _mm_set1_ps(frame.origin[frame.axes[1]]),
                    _mm_set1_ps(frame.origin[frame.axes[2]]),
                ],
                shear: [_mm_set1_ps(frame.shear[0]), _mm_set1_ps(frame.shear[1])],
            }
        }
    }

    #[inline(always)]
    fn boxes(self, node: &WideNode, ray: &Broadcast, limit: f32) -> (u32, Distances) {
        // SAFETY: AVX2 is there and loads are aligned and within bounds, as said above.
        unsafe {
            let mut enter = ray.t_min;
            let mut leave = _mm256_set1_ps(f32::INFINITY);
            for axis in 0..3 {
                let near = _mm256_load_ps(node.planes[ray.near[axis]].as_ptr());
                let far = _mm256_load_ps(node.planes[ray.far[axis]].as_ptr());
                let near = _mm256_mul_ps(_mm256_sub_ps(near, ray.origin[axis]), ray.inverse[axis]);
                let far = _mm256_mul_ps(_mm256_sub_ps(far, ray.origin[axis]), ray.inverse[axis]);
                enter = _mm256_max_ps(near, enter);
                leave = _mm256_min_ps(far, leave);
            }
            let leave = _mm256_mul_ps(leave, _mm256_set1_ps(FAR_SLACK));
            let leave = _mm256_min_ps(leave, _mm256_set1_ps(limit));
            let met = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(enter, leave));
            let mut distances = Distances([0.0; 8]);
            _mm256_store_ps(distances.0.as_mut_ptr(), enter);
            (met.cast_unsigned(), distances)
        }
    }

    #[inline(always)]
    fn prefetch(self, tree: &WideTree, reference: u32) {
        super::prefetch(tree, reference);
    }

    #[inline(always)]
    fn candidates(self, pack: &TrianglePack, ray: &Broadcast) -> u32 {
        // SAFETY: AVX2 is there and loads are aligned and within bounds, as said above.
        unsafe {
            let relative = |axis: usize, corner: usize| {
                _mm_sub_ps(
                    _mm_load_ps(pack.corners[ray.axes[axis]][corner].as_ptr()),
                    ray.sheared_origin[axis],
                )
            };
            let z = [relative(2, 0), relative(2, 1), relative(2, 2)];
            let sheared = |axis: usize, corner: usize| {
                _mm_sub_ps(relative(axis, corner), _mm_mul_ps(ray.shear[axis], z[corner]))
            };
            let x = [sheared(0, 0), sheared(0, 1), sheared(0, 2)];
            let y = [sheared(1, 0), sheared(1, 1), sheared(1, 2)];
            let edge =
                |from: usize, to: usize| _mm_sub_ps(_mm_mul_ps(x[from], y[to]), _mm_mul_ps(y[from], x[to]));
            let (a, b, c) = (edge(2, 1), edge(0, 2), edge(1, 0));
            let least = _mm_min_ps(a, _mm_min_ps(b, c));
            let greatest = _mm_max_ps(a, _mm_max_ps(b, c));
            let zero = _mm_setzero_ps();
            let inside = _mm_or_ps(_mm_cmpge_ps(least, zero), _mm_cmple_ps(greatest, zero));
            _mm_movemask_ps(inside).cast_unsigned()
        }
    }
}
