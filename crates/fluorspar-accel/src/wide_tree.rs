//! The tree that rays traverse: up to eight boxes a node, up to four triangles a leaf.

use glam::Vec3;

use crate::binary_tree::{BinaryNode, Bounds};
use crate::kernel::on_large_pages;

/// Boxes per node.
pub(crate) const WIDTH: usize = 8;
/// Triangles per leaf.
pub(crate) const PACK: usize = 4;
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

/// Four triangles, one per column.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug)]
pub(crate) struct TrianglePack {
    /// Coordinates by axis, corner, column. Unused columns hold NaN, which nothing hits.
    pub(crate) corners: [[[f32; PACK]; 3]; 3],
    /// Numbers of the triangles in the input.
    pub(crate) numbers: [u32; PACK],
}

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
    pub(crate) const UNUSED: Self = Self { corners: [[[f32::NAN; PACK]; 3]; 3], numbers: [u32::MAX; PACK] };

    /// Puts one triangle into a column.
    pub(crate) fn set(&mut self, column: usize, corners: [Vec3; 3], number: u32) {
        for axis in 0..3 {
            for (corner, position) in corners.iter().enumerate() {
                self.corners[axis][corner][column] = position[axis];
            }
        }
        self.numbers[column] = number;
    }
}

/// Cost of testing the boxes of a node, relative to [`LEAF_COST`].
const NODE_COST: f32 = 1.0;
/// Cost of testing a leaf.
const LEAF_COST: f32 = 1.0;

/// The cheapest ways to represent a binary subtree by a given number of wide children.
#[derive(Clone, Copy)]
struct Plan {
    /// Expected cost with up to `i + 1` children, relative to the surface of the whole tree.
    cost: [f32; WIDTH - 1],
    /// How many children attain it.
    children: [u8; WIDTH - 1],
    /// With `i + 1` children: how many of them are in the left subtree.
    left: [u8; WIDTH],
    /// One child: a leaf rather than a node?
    leaf: bool,
}

/// Groups a binary tree into nodes of up to eight children at the least expected cost.
///
/// The surface area heuristic is minimised over all groupings of the given binary tree by dynamic programming:
/// H. Ylitie, T. Karras, S. Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017,
/// section 3. Here a leaf costs the same whether it holds one triangle or four.
///
/// `boxes` are those of the triangles, in the numbering of the leaves of `tree`.
pub(crate) fn collapse(
    tree: &[BinaryNode],
    boxes: &[Bounds],
    triangle: impl Fn(u32) -> ([Vec3; 3], u32),
) -> WideTree {
    if tree.is_empty() {
        return WideTree::default();
    }
    let (bounds, plans) = plan_all(tree, boxes, PACK);
    let (nodes, packs) = count_wide(tree, &plans);
    let mut packs = on_large_pages(packs);
    let nodes = group(tree, &bounds, &plans, on_large_pages(nodes), |member| {
        let mut pack = TrianglePack::UNUSED;
        let mut filled = 0;
        for_each_leaf(tree, member, &mut |item| {
            let (corners, number) = triangle(item);
            pack.set(filled, corners, number);
            filled += 1;
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
    let (bounds, plans) = plan_all(tree, boxes, 1);
    let (nodes, _) = count_wide(tree, &plans);
    group(tree, &bounds, &plans, on_large_pages(nodes), |member| {
        let mut only = 0;
        for_each_leaf(tree, member, &mut |item| only = item);
        only
    })
}

/// Boxes of all binary nodes, and how each is best represented when a leaf holds up to `most_in_leaf` boxes.
fn plan_all(tree: &[BinaryNode], boxes: &[Bounds], most_in_leaf: usize) -> (Vec<Bounds>, Vec<Plan>) {
    let whole = boxes.iter().fold(Bounds::EMPTY, |sum, &next| sum.union(next)).half_area();
    // A tree without any surface, or none that can be told from none, may be grouped anyhow.
    let relative = |bounds: &Bounds| if whole > 0.0 { (bounds.half_area() / whole) as f32 } else { 0.0 };
    let mut bounds = vec![Bounds::EMPTY; tree.len()];
    let mut counts = vec![1_u32; tree.len()];
    let unknown = Plan { cost: [0.0; WIDTH - 1], children: [1; WIDTH - 1], left: [0; WIDTH], leaf: true };
    let mut plans = vec![unknown; tree.len()];
    for (number, node) in tree.iter().enumerate().rev() {
        match *node {
            BinaryNode::Leaf(item) => {
                bounds[number] = boxes[item as usize];
                plans[number].cost = [LEAF_COST * relative(&bounds[number]); WIDTH - 1];
            }
            BinaryNode::Inner(children) => {
                let [l, r] = children.map(|child| child as usize);
                bounds[number] = bounds[l].union(bounds[r]);
                counts[number] = counts[l] + counts[r];
                let may_be_leaf = counts[number] as usize <= most_in_leaf;
                plans[number] = plan(&plans[l], &plans[r], relative(&bounds[number]), may_be_leaf);
            }
        }
    }
    (bounds, plans)
}

/// Carries the plans out: fills `nodes`, root first, and asks `leaf` for the number of each leaf.
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

fn plan(left: &Plan, right: &Plan, half_area: f32, may_be_leaf: bool) -> Plan {
    let mut plan =
        Plan { cost: [f32::INFINITY; WIDTH - 1], children: [1; WIDTH - 1], left: [0; WIDTH], leaf: false };
    let mut shared = [f32::INFINITY; WIDTH];
    for total in 2..=WIDTH {
        for on_left in 1..total {
            let cost = left.cost[on_left - 1] + right.cost[total - on_left - 1];
            if cost < shared[total - 1] {
                shared[total - 1] = cost;
                plan.left[total - 1] = on_left as u8;
            }
        }
    }
    plan.cost[0] = NODE_COST * half_area + shared[WIDTH - 1];
    if may_be_leaf {
        let as_leaf = LEAF_COST * half_area;
        if as_leaf <= plan.cost[0] {
            plan.cost[0] = as_leaf;
            plan.leaf = true;
        }
    }
    for total in 2..WIDTH {
        let fewer = plan.cost[total - 2];
        if shared[total - 1] < fewer {
            plan.cost[total - 1] = shared[total - 1];
            plan.children[total - 1] = total as u8;
        } else {
            plan.cost[total - 1] = fewer;
            plan.children[total - 1] = plan.children[total - 2];
        }
    }
    plan
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

/// How many references a traversal can at most hold back: all but one child on each level of the worst path, plus the
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
