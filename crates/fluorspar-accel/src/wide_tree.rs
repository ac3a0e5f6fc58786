//! The tree that rays traverse: up to eight boxes a node, up to six triangles with eight vertices a leaf.

use glam::Vec3;

use crate::binary_tree::{BinaryNode, Bounds};

/// Boxes per node.
pub(crate) const WIDTH: usize = 8;
/// Triangles per leaf.
pub(crate) const PACK: usize = 6;
/// Vertices that the triangles of a leaf may have together.
pub(crate) const PACK_VERTICES: usize = 8;
/// Set in a child reference that names a leaf.
pub(crate) const LEAF: u32 = 1 << 31;
/// References that a traversal can hold back.
pub(crate) const STACK_CAPACITY: usize = 256;

/// Eight boxes and what is in them, one box per column.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct WideNode {
    /// Rows: least x, y, z, greatest x, y, z. Unused columns hold the empty box.
    pub(crate) planes: [[f32; WIDTH]; 6],
    /// Number of a node, or of a leaf with [`LEAF`] set. Unused columns name leaf 0, which is harmless to test.
    pub(crate) children: [u32; WIDTH],
}

/// Up to six triangles that have up to eight vertices together, as neighbors in a mesh do: each vertex is stored, and
/// moved into the frame of a ray, once. Two cache lines.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct TrianglePack {
    /// Coordinates by axis and vertex. Unused columns hold any finite number.
    pub(crate) vertices: [[f32; PACK_VERTICES]; 3],
    /// From the lowest bit on: three bits for each triangle that say which vertex its first corner is, the same for the
    /// second and third corners, and a bit for each triangle that there is.
    corners: u64,
    /// Numbers of the triangles in the input.
    pub(crate) numbers: [u32; PACK],
}

const _: () = assert!(size_of::<TrianglePack>() == 128 && size_of::<WideNode>() == 256);

/// Bits of [`TrianglePack::corners`] for one corner.
const CORNER_BITS: usize = 3 * PACK;

/// Nodes, root first, and leaves.
///
/// Invariants, on which the kernels rely: if there is a node, there is a leaf; every child reference names an existing
/// node or leaf; a node's child nodes come after it; [`stack_need`] is at most [`STACK_CAPACITY`].
#[derive(Clone, Debug, Default)]
pub(crate) struct WideTree {
    pub(crate) nodes: Vec<WideNode>,
    pub(crate) packs: Vec<TrianglePack>,
}

impl WideNode {
    const UNUSED: Self = Self {
        planes: [
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
            [f32::NEG_INFINITY; WIDTH],
        ],
        children: [LEAF; WIDTH],
    };

    fn set(&mut self, column: usize, bounds: Bounds, child: u32) {
        for axis in 0..3 {
            self.planes[axis][column] = bounds.min[axis];
            self.planes[axis + 3][column] = bounds.max[axis];
        }
        self.children[column] = child;
    }
}

impl TrianglePack {
    pub(crate) const EMPTY: Self =
        Self { vertices: [[0.0; PACK_VERTICES]; 3], corners: 0, numbers: [u32::MAX; PACK] };

    /// Adds a triangle; returns whether there was room. `vertex_count` is how many columns are in use.
    #[must_use]
    pub(crate) fn add(&mut self, vertex_count: &mut usize, corners: [Vec3; 3], number: u32) -> bool {
        let triangle = self.used().count_ones() as usize;
        if triangle == PACK {
            return false;
        }
        let mut bits = 0;
        for (corner, position) in corners.iter().enumerate() {
            // By bits, so that hits are computed from the very numbers that the input holds: 0.0 is not -0.0.
            let is_here = |&column: &usize| {
                (0..3).all(|axis| self.vertices[axis][column].to_bits() == position[axis].to_bits())
            };
            let vertex = match (0..*vertex_count).find(is_here) {
                Some(known) => known,
                None if *vertex_count == PACK_VERTICES => return false,
                None => {
                    for axis in 0..3 {
                        self.vertices[axis][*vertex_count] = position[axis];
                    }
                    *vertex_count += 1;
                    *vertex_count - 1
                }
            };
            bits |= (vertex as u64) << (corner * CORNER_BITS + 3 * triangle);
        }
        self.corners |= bits | 1 << (3 * CORNER_BITS + triangle);
        self.numbers[triangle] = number;
        true
    }

    /// A bit for each triangle that there is.
    #[inline(always)]
    pub(crate) fn used(&self) -> u32 {
        (self.corners >> (3 * CORNER_BITS)) as u32
    }

    /// The vertices that are this corner of the triangles, in three bits each from the lowest on; bits beyond are others.
    #[inline(always)]
    pub(crate) fn vertices_at(&self, corner: usize) -> u32 {
        (self.corners >> (corner * CORNER_BITS)) as u32
    }

    /// The vertex that is this corner of this triangle.
    #[inline(always)]
    pub(crate) fn vertex(&self, corner: usize, lane: usize) -> usize {
        (self.vertices_at(corner) >> (3 * lane)) as usize % PACK_VERTICES
    }
}

/// Cost of testing the boxes of a node, relative to [`LEAF_COST`].
const NODE_COST: f32 = 1.0;
/// Cost of testing a leaf.
const LEAF_COST: f32 = 1.0;

/// The cheapest ways to represent a binary subtree by a given number of wide children.
#[derive(Clone, Copy)]
struct Plan {
    /// Number of children that attain the least cost with up to `i + 1` children.
    children: [u8; WIDTH - 1],
    /// With `i + 1` children: how many of them are in the left subtree.
    left: [u8; WIDTH],
    /// One child: a leaf rather than a node?
    leaf: bool,
}

/// Expected cost of a subtree with up to `i + 1` children, relative to the surface of the whole tree.
type Costs = [f32; WIDTH - 1];

/// Groups a binary tree into nodes of up to eight children at the least expected cost.
///
/// The surface area heuristic is minimized over all groupings of the given binary tree by dynamic programming:
/// H. Ylitie, T. Karras, S. Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017,
/// section 3. Here a leaf costs the same whether it holds one triangle or six.
///
/// `boxes` are those of the triangles, in the numbering of the leaves of `tree`; `triangle` gives the corners of a
/// triangle and its number in the input. Of large scenes memory is scarcest here: what is not needed any longer goes at once.
pub(crate) fn collapse(
    tree: &[BinaryNode],
    boxes: Vec<Bounds>,
    triangle: impl Fn(u32) -> ([Vec3; 3], u32),
) -> WideTree {
    if tree.is_empty() {
        return WideTree::default();
    }
    let bounds = bounds_of(tree, &boxes);
    drop(boxes);
    let plans = plan_all(tree, &bounds, PACK, |member| {
        let (mut pack, mut vertex_count, mut fits) = (TrianglePack::EMPTY, 0, true);
        for_each_leaf(tree, member, &mut |item| {
            let (corners, number) = triangle(item);
            fits = fits && pack.add(&mut vertex_count, corners, number);
        });
        fits
    });
    let (nodes, packs) = count_wide(tree, &plans);
    let mut packs = Vec::with_capacity(packs);
    let nodes = group(tree, &bounds, &plans, Vec::with_capacity(nodes), |member| {
        let (mut pack, mut vertex_count) = (TrianglePack::EMPTY, 0);
        for_each_leaf(tree, member, &mut |item| {
            let (corners, number) = triangle(item);
            assert!(pack.add(&mut vertex_count, corners, number), "leaves were planned to fit");
        });
        packs.push(pack);
        (packs.len() - 1) as u32
    });
    WideTree { nodes, packs }
}

/// [`collapse`] for things that are each a leaf of their own: a reference with [`LEAF`] set names the box in the input.
pub(crate) fn collapse_single(tree: &[BinaryNode], boxes: &[Bounds]) -> Vec<WideNode> {
    if tree.is_empty() {
        return Vec::new();
    }
    let bounds = bounds_of(tree, boxes);
    let plans = plan_all(tree, &bounds, 1, |_| true);
    let (nodes, _) = count_wide(tree, &plans);
    group(tree, &bounds, &plans, Vec::with_capacity(nodes), |member| {
        let mut only = 0;
        for_each_leaf(tree, member, &mut |item| only = item);
        only
    })
}

/// Boxes of all binary nodes.
fn bounds_of(tree: &[BinaryNode], boxes: &[Bounds]) -> Vec<Bounds> {
    let mut bounds = vec![Bounds::EMPTY; tree.len()];
    for (number, node) in tree.iter().enumerate().rev() {
        bounds[number] = match *node {
            BinaryNode::Leaf(item) => boxes[item as usize],
            BinaryNode::Inner([l, r]) => bounds[l as usize].union(bounds[r as usize]),
        };
    }
    bounds
}

/// How each binary node is best represented when a leaf holds up to `most_in_leaf` boxes of which `fits` reports whether they fit.
fn plan_all(
    tree: &[BinaryNode],
    bounds: &[Bounds],
    most_in_leaf: usize,
    mut fits: impl FnMut(u32) -> bool,
) -> Vec<Plan> {
    let whole = bounds[0].half_area();
    // A tree whose surface area is zero or too small to compare may be grouped arbitrarily.
    let relative = |bounds: &Bounds| if whole > 0.0 { (bounds.half_area() / whole) as f32 } else { 0.0 };
    let mut counts = vec![1_u32; tree.len()];
    let mut costs: Vec<Costs> = vec![[0.0; WIDTH - 1]; tree.len()];
    let mut plans = vec![Plan { children: [1; WIDTH - 1], left: [0; WIDTH], leaf: true }; tree.len()];
    // Subtrees that are neither a leaf nor part of one.
    const TOO_MANY: u32 = u32::MAX;
    for (number, node) in tree.iter().enumerate().rev() {
        match *node {
            BinaryNode::Leaf(_) => costs[number] = [LEAF_COST * relative(&bounds[number]); WIDTH - 1],
            BinaryNode::Inner(children) => {
                let [l, r] = children.map(|child| child as usize);
                let count = counts[l].saturating_add(counts[r]);
                let may_be_leaf = count as usize <= most_in_leaf && fits(number as u32);
                counts[number] = if may_be_leaf { count } else { TOO_MANY };
                (plans[number], costs[number]) =
                    plan(&costs[l], &costs[r], relative(&bounds[number]), may_be_leaf);
            }
        }
    }
    plans
}

/// Executes the plans: fills `nodes`, root first, and calls `leaf` for the number of each leaf.
fn group(
    tree: &[BinaryNode],
    bounds: &[Bounds],
    plans: &[Plan],
    mut nodes: Vec<WideNode>,
    mut leaf: impl FnMut(u32) -> u32,
) -> Vec<WideNode> {
    nodes.push(WideNode::UNUSED);
    let mut waiting = vec![(0_u32, 0_usize)];
    let mut members = Vec::with_capacity(WIDTH);
    while let Some((source, target)) = waiting.pop() {
        members.clear();
        match tree[source as usize] {
            BinaryNode::Inner(children) if !plans[source as usize].leaf => {
                split(tree, plans, children, source, WIDTH, &mut members);
            }
            _ => members.push(source),
        }
        for (column, &member) in members.iter().enumerate() {
            let reference = if plans[member as usize].leaf {
                LEAF | leaf(member)
            } else {
                nodes.push(WideNode::UNUSED);
                waiting.push((member, nodes.len() - 1));
                (nodes.len() - 1) as u32
            };
            nodes[target].set(column, bounds[member as usize], reference);
        }
    }
    nodes
}

/// Number of nodes and of leaves that [`collapse`] makes of a tree.
fn count_wide(tree: &[BinaryNode], plans: &[Plan]) -> (usize, usize) {
    let (mut nodes, mut packs) = (1, 0);
    let mut waiting = vec![0_u32];
    let mut members = Vec::with_capacity(WIDTH);
    while let Some(source) = waiting.pop() {
        members.clear();
        match tree[source as usize] {
            BinaryNode::Inner(children) if !plans[source as usize].leaf => {
                split(tree, plans, children, source, WIDTH, &mut members);
            }
            _ => members.push(source),
        }
        for &member in &members {
            if plans[member as usize].leaf {
                packs += 1;
            } else {
                nodes += 1;
                waiting.push(member);
            }
        }
    }
    (nodes, packs)
}

fn plan(left: &Costs, right: &Costs, half_area: f32, may_be_leaf: bool) -> (Plan, Costs) {
    let (shared, on_left) = cheapest_shares(left, right);
    let mut plan = Plan { children: [1; WIDTH - 1], left: on_left, leaf: false };
    let mut costs = [f32::INFINITY; WIDTH - 1];
    costs[0] = NODE_COST * half_area + shared[WIDTH - 1];
    if may_be_leaf {
        let as_leaf = LEAF_COST * half_area;
        if as_leaf <= costs[0] {
            costs[0] = as_leaf;
            plan.leaf = true;
        }
    }
    for total in 2..WIDTH {
        let fewer = costs[total - 2];
        if shared[total - 1] < fewer {
            costs[total - 1] = shared[total - 1];
            plan.children[total - 1] = total as u8;
        } else {
            costs[total - 1] = fewer;
            plan.children[total - 1] = plan.children[total - 2];
        }
    }
    (plan, costs)
}

/// The least costs of two subtrees with 1, 2, ... nodes together, and how many of these are in the left one.
fn cheapest_shares(left: &Costs, right: &Costs) -> ([f32; WIDTH], [u8; WIDTH]) {
    let mut shared = [f32::INFINITY; WIDTH];
    let mut in_left = [0; WIDTH];
    for total in 2..=WIDTH {
        for on_left in 1..total {
            let cost = left[on_left - 1] + right[total - on_left - 1];
            if cost < shared[total - 1] {
                shared[total - 1] = cost;
                in_left[total - 1] = on_left as u8;
            }
        }
    }
    (shared, in_left)
}

/// Collects the wide children that represent the two subtrees of `parent` by `total` children in all.
fn split(
    tree: &[BinaryNode],
    plans: &[Plan],
    children: [u32; 2],
    parent: u32,
    total: usize,
    members: &mut Vec<u32>,
) {
    let on_left = usize::from(plans[parent as usize].left[total - 1]);
    for (child, allowed) in children.into_iter().zip([on_left, total - on_left]) {
        let used = usize::from(plans[child as usize].children[allowed - 1]);
        match tree[child as usize] {
            BinaryNode::Inner(grandchildren) if used > 1 => {
                split(tree, plans, grandchildren, child, used, members);
            }
            _ => members.push(child),
        }
    }
}

fn for_each_leaf(tree: &[BinaryNode], node: u32, act: &mut impl FnMut(u32)) {
    match tree[node as usize] {
        BinaryNode::Leaf(item) => act(item),
        BinaryNode::Inner([l, r]) => {
            for_each_leaf(tree, l, act);
            for_each_leaf(tree, r, act);
        }
    }
}

/// Largest number of references on the stack of a traversal: all but one child on each level of the worst path, plus the
/// one that is about to be taken.
pub(crate) fn stack_need(nodes: &[WideNode]) -> usize {
    let mut need = vec![0_usize; nodes.len()];
    for (number, node) in nodes.iter().enumerate().rev() {
        let deepest =
            node.children.iter().filter(|&&child| child & LEAF == 0).map(|&child| need[child as usize]);
        need[number] = WIDTH - 1 + deepest.max().unwrap_or(0);
    }
    need.first().map_or(0, |need| need + 1)
}
