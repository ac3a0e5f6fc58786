//! The binary tree from which the wide one is made: how triangles are grouped, nothing else.

use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub(crate) min: Vec3,
    pub(crate) max: Vec3,
}

impl Bounds {
    pub(crate) const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    pub(crate) fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Half the surface, in f64 so that it cannot overflow.
    pub(crate) fn half_area(self) -> f64 {
        let d = (self.max - self.min).as_dvec3();
        d.x * d.y + d.y * d.z + d.z * d.x
    }
}

/// A node of [`BinaryTree`].
#[derive(Clone, Copy, Debug)]
pub(crate) enum BinaryNode {
    /// Number of a box in the input.
    Leaf(u32),
    /// Two later nodes.
    Inner([u32; 2]),
}

/// Nodes from the root on, parents before children.
pub(crate) type BinaryTree = Vec<BinaryNode>;

/// Fraction of the nodes that the reinsertion passes try to place better.
const REINSERTION_RATIO: f32 = 0.1;
/// By how much boxes are disturbed, as a fraction of their extent.
const DISTURBANCE: f64 = 1.0 / 128.0;

/// A tree of good quality: parallel locally-ordered clustering followed by reinsertion, both from `obvhs`. Of large scenes memory is
/// scarcest here, so that the boxes go as soon as the builder has its own.
pub(crate) fn clustered(boxes: Vec<Bounds>) -> BinaryTree {
    let primitives = disturbed(&boxes);
    let count = boxes.len();
    drop(boxes);
    let numbers = (0..count as u32).collect();
    let mut tree = PlocBuilder::with_capacity(count).build(
        PlocSearchDistance::Medium,
        &primitives,
        numbers,
        SortPrecision::U64,
        3,
    );
    drop(primitives);
    ReinsertionOptimizer::default().run(&mut tree, REINSERTION_RATIO, None);
    in_order(&tree)
}

/// Boxes for the builder. Only the shape of the tree is taken from it, so its boxes may be scaled, against overflow, and
/// disturbed: clustering sorts boxes along a curve and merges mutual nearest neighbors, which takes quadratic time
/// where each box prefers the one before, as equal or steadily growing boxes do.
fn disturbed(boxes: &[Bounds]) -> Vec<Aabb> {
    let whole = boxes.iter().fold(Bounds::EMPTY, |sum, &next| sum.union(next));
    let largest = whole.min.abs().max(whole.max.abs()).max_element();
    let scale = if largest > 0.0 { 1.0 / f64::from(largest) } else { 1.0 };
    let disturb = |(number, b): (usize, &Bounds)| {
        let (min, max) = (b.min.as_dvec3() * scale, b.max.as_dvec3() * scale);
        let shift = (max - min) * DISTURBANCE * random(2 * number as u32);
        let growth = (max - min) * DISTURBANCE * random(2 * number as u32 + 1);
        Aabb::new((min + shift - growth).as_vec3().into(), (max + shift + growth).as_vec3().into())
    };
    boxes.par_iter().enumerate().map(disturb).collect()
}

fn in_order(tree: &Bvh2) -> BinaryTree {
    let mut ordered = Vec::with_capacity(tree.nodes.len());
    let mut waiting = Vec::new();
    if !tree.nodes.is_empty() {
        ordered.push(BinaryNode::Leaf(0));
        waiting.push((0_usize, 0_usize));
    }
    while let Some((source, target)) = waiting.pop() {
        let node = &tree.nodes[source];
        let first = node.first_index as usize;
        if node.is_leaf() {
            ordered[target] = BinaryNode::Leaf(tree.primitive_indices[first]);
        } else {
            let child = ordered.len();
            ordered[target] = BinaryNode::Inner([child as u32, child as u32 + 1]);
            ordered.extend([BinaryNode::Leaf(0); 2]);
            waiting.extend([(first + 1, child + 1), (first, child)]);
        }
    }
    ordered
}

/// A tree whose depth is the logarithm of the number of boxes, whatever they look like: halves along the longest axis.
pub(crate) fn balanced(boxes: Vec<Bounds>) -> BinaryTree {
    let center = |number: u32| {
        let b = &boxes[number as usize];
        b.min * 0.5 + b.max * 0.5
    };
    let mut numbers: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut ordered = Vec::with_capacity(2 * boxes.len());
    let mut waiting = Vec::new();
    if !boxes.is_empty() {
        ordered.push(BinaryNode::Leaf(0));
        waiting.push((0..boxes.len(), 0_usize));
    }
    while let Some((range, target)) = waiting.pop() {
        let members = &mut numbers[range.clone()];
        if let [only] = members {
            ordered[target] = BinaryNode::Leaf(*only);
            continue;
        }
        let mut spread = Bounds::EMPTY;
        for &mut number in members.iter_mut() {
            let center = center(number);
            spread = spread.union(Bounds { min: center, max: center });
        }
        let axis = (spread.max - spread.min).max_position();
        let half = members.len() / 2;
        members.select_nth_unstable_by(half, |&l, &r| {
            center(l)[axis].total_cmp(&center(r)[axis]).then(l.cmp(&r))
        });
        let child = ordered.len();
        ordered[target] = BinaryNode::Inner([child as u32, child as u32 + 1]);
        ordered.extend([BinaryNode::Leaf(0); 2]);
        let middle = range.start + half;
        waiting.extend([(middle..range.end, child + 1), (range.start..middle, child)]);
    }
    ordered
}

/// A pseudo-random number in [0, 1] for each counter (the finaliser of MurmurHash3).
fn random(counter: u32) -> f64 {
    let mut x = counter.wrapping_add(0x9e37_79b9);
    x = (x ^ (x >> 16)).wrapping_mul(0x85eb_ca6b);
    x = (x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35);
    f64::from(x ^ (x >> 16)) / f64::from(u32::MAX)
}
