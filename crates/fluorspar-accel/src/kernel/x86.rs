//! x86-64: eight boxes or six triangles per instruction. With AVX-512, the same instructions have more registers and masks.

use std::arch::x86_64::*;

use super::{ClosestSearch, Distances, OcclusionSearch, Stack, Traversal};
use crate::instance_bvh::PlacedTrees;
use crate::ray::{FAR_SLACK, Hit, Ray, RayFrame};
use crate::wide_tree::{STACK_CAPACITY, TrianglePack, WIDTH, WideNode, WideTree};

/// A type whose values prove that the processor has some instructions, and the functions compiled for them.
macro_rules! kernel {
    ($(#[$attribute:meta])* $name:ident, $module:ident, $features:literal, $($feature:tt),+) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug)]
        pub(crate) struct $name(());

        impl $name {
            /// The only way to a value.
            pub(super) fn new() -> Option<Self> {
                ($(is_x86_feature_detected!($feature))&&+).then_some(Self(()))
            }

            #[inline]
            pub(super) fn closest(self, tree: &WideTree, ray: &Ray) -> Option<Hit> {
                // SAFETY, here and below: `self` proves that the instructions have been detected.
                unsafe { $module::closest(self, tree, ray) }
            }

            #[inline]
            pub(super) fn occluded(self, tree: &WideTree, ray: &Ray) -> bool {
                // SAFETY: as above.
                unsafe { $module::occluded(self, tree, ray) }
            }

            #[inline]
            pub(super) fn closest_placed(self, placed: &PlacedTrees, ray: &Ray) -> Option<(u32, Hit)> {
                // SAFETY: as above.
                unsafe { $module::closest_placed(self, placed, ray) }
            }

            #[inline]
            pub(super) fn occluded_placed(self, placed: &PlacedTrees, ray: &Ray) -> bool {
                // SAFETY: as above.
                unsafe { $module::occluded_placed(self, placed, ray) }
            }

            #[inline]
            pub(super) fn closest_each(self, tree: &WideTree, rays: &[Ray], hits: &mut [Option<Hit>]) {
                // SAFETY: as above.
                unsafe { $module::closest_each(self, tree, rays, hits) }
            }

            #[inline]
            pub(super) fn occluded_each(self, tree: &WideTree, rays: &[Ray], answers: &mut [bool]) {
                // SAFETY: as above.
                unsafe { $module::occluded_each(self, tree, rays, answers) }
            }
        }

        impl Traversal for $name {
            #[inline(always)]
            fn boxes(self, node: &WideNode, ray: &RayFrame, limit: f32) -> (u32, Distances) {
                let mut distances = Distances([0.0; WIDTH]);
                // SAFETY: `self` proves that the processor has the instructions; the array holds eight numbers and is
                // aligned to 32 bytes.
                let entered = unsafe {
                    let (enter, entered) = boxes(node, ray, limit);
                    _mm256_store_ps(distances.0.as_mut_ptr(), enter);
                    _mm256_movemask_ps(entered)
                };
                (entered.cast_unsigned(), distances)
            }

            #[inline(always)]
            unsafe fn push_hit(self, node: &WideNode, ray: &RayFrame, limit: f32, stack: &mut Stack) {
                // SAFETY: `self` proves that the processor has the instructions, and the caller that there is room.
                unsafe { push_hit(node, ray, limit, stack) }
            }

            #[inline(always)]
            fn candidates(self, pack: &TrianglePack, ray: &RayFrame) -> u32 {
                // SAFETY: `self` proves that the processor has the instructions.
                unsafe { candidates(pack, ray) }
            }
        }

        mod $module {
            use super::*;

            #[target_feature(enable = $features)]
            pub(super) fn closest(lanes: $name, tree: &WideTree, ray: &Ray) -> Option<Hit> {
                super::super::search::<_, ClosestSearch>(lanes, tree, ray)
            }

            #[target_feature(enable = $features)]
            pub(super) fn occluded(lanes: $name, tree: &WideTree, ray: &Ray) -> bool {
                super::super::search::<_, OcclusionSearch>(lanes, tree, ray)
            }

            #[target_feature(enable = $features)]
            pub(super) fn closest_placed(lanes: $name, placed: &PlacedTrees, ray: &Ray) -> Option<(u32, Hit)> {
                super::super::closest_placed(lanes, placed, ray)
            }

            #[target_feature(enable = $features)]
            pub(super) fn occluded_placed(lanes: $name, placed: &PlacedTrees, ray: &Ray) -> bool {
                super::super::occluded_placed(lanes, placed, ray)
            }

            #[target_feature(enable = $features)]
            pub(super) fn closest_each(lanes: $name, tree: &WideTree, rays: &[Ray], hits: &mut [Option<Hit>]) {
                super::super::search_each::<_, ClosestSearch>(lanes, tree, rays, hits);
            }

            #[target_feature(enable = $features)]
            pub(super) fn occluded_each(lanes: $name, tree: &WideTree, rays: &[Ray], answers: &mut [bool]) {
                super::super::search_each::<_, OcclusionSearch>(lanes, tree, rays, answers);
            }
        }
    };
}

kernel!(
    /// Proof that the processor has AVX2, BMI1 and POPCNT.
    Avx2, avx2, "avx2,bmi1,popcnt", "avx2", "bmi1", "popcnt"
);
kernel!(
    /// Proof that the processor has AVX-512 F, BW, CD, DQ and VL, AVX2, BMI1, BMI2 and POPCNT.
    Avx512, avx512, "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx2,bmi1,bmi2,popcnt",
    "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl", "avx2", "bmi1", "bmi2", "popcnt"
);

// Loads below stay within fixed-size arrays, whose type keeps them aligned: rows of `WideNode::planes`, its `children`, and rows of
// `TrianglePack::vertices` start at multiples of 32 bytes in structs aligned to 64.

/// Where the ray enters eight boxes, and all bits set for those that it meets.
///
/// # Safety
/// AVX2 must be there.
#[inline(always)]
unsafe fn boxes(node: &WideNode, ray: &RayFrame, limit: f32) -> (__m256, __m256) {
    // SAFETY: the caller promises AVX2; loads are aligned and within bounds, as above.
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
        (enter, _mm256_cmp_ps::<_CMP_LE_OQ>(enter, leave))
    }
}

/// [`Traversal::push_hit`].
///
/// # Safety
/// AVX2 and POPCNT must be there, and the stack must have room for eight more entries.
#[inline(always)]
unsafe fn push_hit(node: &WideNode, ray: &RayFrame, limit: f32, stack: &mut Stack) {
    debug_assert!(stack.len + WIDTH <= STACK_CAPACITY);
    // SAFETY: the caller promises AVX2 and room for eight entries; the load is aligned, as above.
    unsafe {
        let (enter, entered) = boxes(node, ray, limit);
        // Distances are not negative, so their bits sort as they do. The lowest three bits give way to the number of the
        // column; the highest bit marks boxes that are hit; the others go to the end.
        let distance_bits = _mm256_set1_epi32(0x7fff_fff8);
        let column = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        let mark = _mm256_or_si256(column, _mm256_set1_epi32(i32::MIN));
        let bits = _mm256_and_si256(_mm256_castps_si256(enter), distance_bits);
        let keys = _mm256_and_si256(_mm256_or_si256(bits, mark), _mm256_castps_si256(entered));
        let keys = sort_descending(keys);
        let children = _mm256_load_si256(node.children.as_ptr().cast());
        // The permutation looks at the lowest three bits only.
        let references = _mm256_permutevar8x32_epi32(children, keys);
        let distances = _mm256_and_si256(keys, distance_bits);
        // Entries hold the reference in the lower half. Columns 0, 1, 4, 5 and 2, 3, 6, 7, then in order.
        let outer = _mm256_unpacklo_epi32(references, distances);
        let inner = _mm256_unpackhi_epi32(references, distances);
        let top = stack.entries.as_mut_ptr().add(stack.len);
        _mm256_storeu_si256(top.cast(), _mm256_permute2x128_si256::<0x20>(outer, inner));
        _mm256_storeu_si256(top.add(4).cast(), _mm256_permute2x128_si256::<0x31>(outer, inner));
        stack.len += _mm256_movemask_ps(entered).count_ones() as usize;
    }
}

/// Sorts unsigned numbers, the greatest first: Batcher's bitonic network, six rounds of comparing with a partner.
///
/// # Safety
/// AVX2 must be there.
#[inline(always)]
unsafe fn sort_descending(keys: __m256i) -> __m256i {
    /// Where `SECOND` has a bit, a column takes the lesser of its number and its partner's, else the greater.
    #[inline(always)]
    unsafe fn exchange<const SECOND: i32>(keys: __m256i, partners: __m256i) -> __m256i {
        // SAFETY: the caller promises AVX2.
        unsafe {
            let greater = _mm256_max_epu32(keys, partners);
            let lesser = _mm256_min_epu32(keys, partners);
            _mm256_blend_epi32::<SECOND>(greater, lesser)
        }
    }
    /// Partners within four columns.
    const NEIGHBOR: i32 = 0b10_11_00_01;
    const MIRROR_OF_FOUR: i32 = 0b00_01_10_11;
    const TWO_AWAY: i32 = 0b01_00_11_10;
    // SAFETY: the caller promises AVX2.
    unsafe {
        let keys = exchange::<0b1010_1010>(keys, _mm256_shuffle_epi32::<NEIGHBOR>(keys));
        let keys = exchange::<0b1100_1100>(keys, _mm256_shuffle_epi32::<MIRROR_OF_FOUR>(keys));
        let keys = exchange::<0b1010_1010>(keys, _mm256_shuffle_epi32::<NEIGHBOR>(keys));
        let mirror = _mm256_shuffle_epi32::<MIRROR_OF_FOUR>(_mm256_permute2x128_si256::<0x01>(keys, keys));
        let keys = exchange::<0b1111_0000>(keys, mirror);
        let keys = exchange::<0b1100_1100>(keys, _mm256_shuffle_epi32::<TWO_AWAY>(keys));
        exchange::<0b1010_1010>(keys, _mm256_shuffle_epi32::<NEIGHBOR>(keys))
    }
}

/// [`Traversal::candidates`].
///
/// # Safety
/// AVX2 must be there.
#[inline(always)]
unsafe fn candidates(pack: &TrianglePack, ray: &RayFrame) -> u32 {
    // SAFETY: the caller promises AVX2.
    unsafe {
        let z = relative(pack, ray, 2);
        let x = sheared(pack, ray, 0, z);
        let y = sheared(pack, ray, 1, z);
        let [v0, v1, v2] = [vertices_at(pack, 0), vertices_at(pack, 1), vertices_at(pack, 2)];
        let (x0, y0) = (_mm256_permutevar8x32_ps(x, v0), _mm256_permutevar8x32_ps(y, v0));
        let (x1, y1) = (_mm256_permutevar8x32_ps(x, v1), _mm256_permutevar8x32_ps(y, v1));
        let (x2, y2) = (_mm256_permutevar8x32_ps(x, v2), _mm256_permutevar8x32_ps(y, v2));
        let a = _mm256_sub_ps(_mm256_mul_ps(x2, y1), _mm256_mul_ps(y2, x1));
        let b = _mm256_sub_ps(_mm256_mul_ps(x0, y2), _mm256_mul_ps(y0, x2));
        let c = _mm256_sub_ps(_mm256_mul_ps(x1, y0), _mm256_mul_ps(y1, x0));
        let least = _mm256_min_ps(a, _mm256_min_ps(b, c));
        let greatest = _mm256_max_ps(a, _mm256_max_ps(b, c));
        let zero = _mm256_setzero_ps();
        let inside = _mm256_or_ps(
            _mm256_cmp_ps::<_CMP_GE_OQ>(least, zero),
            _mm256_cmp_ps::<_CMP_LE_OQ>(greatest, zero),
        );
        _mm256_movemask_ps(inside).cast_unsigned() & pack.used()
    }
}

// The steps of `candidates` are functions because the compiler does not inline closures into code for other instructions.

/// Coordinates of the vertices relative to the origin of the ray, along one of its axes.
///
/// # Safety
/// AVX2 must be there.
#[inline(always)]
unsafe fn relative(pack: &TrianglePack, ray: &RayFrame, axis: usize) -> __m256 {
    let axis = ray.axes[axis];
    // SAFETY: the caller promises AVX2; the load is aligned and within bounds, as above.
    unsafe { _mm256_sub_ps(_mm256_load_ps(pack.vertices[axis].as_ptr()), _mm256_set1_ps(ray.origin[axis])) }
}

/// The same, sheared.
///
/// # Safety
/// AVX2 must be there.
#[inline(always)]
unsafe fn sheared(pack: &TrianglePack, ray: &RayFrame, axis: usize, z: __m256) -> __m256 {
    // SAFETY: the caller promises AVX2.
    unsafe { _mm256_sub_ps(relative(pack, ray, axis), _mm256_mul_ps(_mm256_set1_ps(ray.shear[axis]), z)) }
}

/// Which vertex each triangle has there, for a permutation that looks at the lowest three bits only.
///
/// # Safety
/// AVX2 must be there.
#[inline(always)]
unsafe fn vertices_at(pack: &TrianglePack, corner: usize) -> __m256i {
    // SAFETY: the caller promises AVX2.
    unsafe {
        let triangle = _mm256_setr_epi32(0, 3, 6, 9, 12, 15, 18, 21);
        _mm256_srlv_epi32(_mm256_set1_epi32(pack.vertices_at(corner).cast_signed()), triangle)
    }
}
