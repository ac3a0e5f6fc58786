//! Traversal: one algorithm, and the code that tests eight boxes or four triangles at once for each instruction set.
//!
//! A kernel only decides which boxes and triangles deserve a closer look; hits are computed by [`RayFrame::intersect`]
//! alone. Box distances steer the order of traversal, so kernels compute them by the same operations and visit the same
//! nodes.
// The only place in the workspace where unsafe code is allowed: vector instructions that the processor must have, reads
// without bounds checks whose bounds the builder establishes, and advice to the system about memory.
#![allow(unsafe_code)]

use std::fmt;
use std::mem::MaybeUninit;
use std::ops::ControlFlow;

use crate::instance_bvh::PlacedTrees;
use crate::ray::{FAR_SLACK, Hit, Ray, RayFrame};
use crate::wide_tree::{LEAF, PACK, STACK_CAPACITY, TrianglePack, WIDTH, WideNode, WideTree};

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod large_pages;
mod portable;
mod simd;

pub(crate) use large_pages::on_large_pages;
pub use simd::{Lanes, Simd, Work};

/// The code that traverses a tree. All kernels give the same hits, bit for bit.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
#[non_exhaustive]
pub enum Kernel {
    /// Plain Rust, for every processor.
    Portable,
    /// x86-64 with the AVX2 instructions (Intel since 2013, AMD since 2015).
    Avx2,
    /// x86-64 with the AVX-512 instructions F, BW, CD, DQ and VL (Intel servers since 2017, AMD since 2022).
    Avx512,
}

impl Kernel {
    const ALL: [Self; 3] = [Self::Portable, Self::Avx2, Self::Avx512];

    /// The kernels that this processor runs, slowest first.
    pub fn available() -> Vec<Self> {
        Self::ALL.into_iter().filter(|&kernel| Dispatch::new(kernel).is_some()).collect()
    }

    /// The fastest of [`Kernel::available`].
    pub fn fastest() -> Self {
        Self::ALL.into_iter().rfind(|&kernel| Dispatch::new(kernel).is_some()).unwrap_or(Self::Portable)
    }
}

impl fmt::Display for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Portable => "portable",
            Self::Avx2 => "AVX2",
            Self::Avx512 => "AVX-512",
        })
    }
}

/// A kernel that this processor is known to run.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Dispatch {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2(avx2::Detected),
    #[cfg(target_arch = "x86_64")]
    Avx512(avx512::Detected),
}

impl Dispatch {
    pub(crate) fn new(kernel: Kernel) -> Option<Self> {
        match kernel {
            Kernel::Portable => Some(Self::Portable),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx2 => avx2::Detected::new().map(Self::Avx2),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx512 => avx512::Detected::new().map(Self::Avx512),
            #[cfg(not(target_arch = "x86_64"))]
            Kernel::Avx2 | Kernel::Avx512 => None,
        }
    }

    pub(crate) fn kernel(self) -> Kernel {
        match self {
            Self::Portable => Kernel::Portable,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => Kernel::Avx2,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => Kernel::Avx512,
        }
    }

    #[inline]
    pub(crate) fn closest(self, tree: &WideTree, ray: &Ray) -> Option<Hit> {
        match self {
            Self::Portable => portable::closest(tree, ray),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(detected) => detected.closest(tree, ray),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(detected) => detected.closest(tree, ray),
        }
    }

    #[inline]
    pub(crate) fn occluded(self, tree: &WideTree, ray: &Ray) -> bool {
        match self {
            Self::Portable => portable::occluded(tree, ray),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(detected) => detected.occluded(tree, ray),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(detected) => detected.occluded(tree, ray),
        }
    }

    #[inline]
    pub(crate) fn closest_placed(self, placed: &PlacedTrees, ray: &Ray) -> Option<(u32, Hit)> {
        match self {
            Self::Portable => portable::closest_placed(placed, ray),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(detected) => detected.closest_placed(placed, ray),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(detected) => detected.closest_placed(placed, ray),
        }
    }

    #[inline]
    pub(crate) fn occluded_placed(self, placed: &PlacedTrees, ray: &Ray) -> bool {
        match self {
            Self::Portable => portable::occluded_placed(placed, ray),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(detected) => detected.occluded_placed(placed, ray),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(detected) => detected.occluded_placed(placed, ray),
        }
    }

    /// [`Self::closest`] for each ray; the slices are equally long.
    #[inline]
    pub(crate) fn closest_each(self, tree: &WideTree, rays: &[Ray], hits: &mut [Option<Hit>]) {
        match self {
            Self::Portable => portable::closest_each(tree, rays, hits),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(detected) => detected.closest_each(tree, rays, hits),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(detected) => detected.closest_each(tree, rays, hits),
        }
    }

    /// [`Self::occluded`] for each ray; the slices are equally long.
    #[inline]
    pub(crate) fn occluded_each(self, tree: &WideTree, rays: &[Ray], answers: &mut [bool]) {
        match self {
            Self::Portable => portable::occluded_each(tree, rays, answers),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(detected) => detected.occluded_each(tree, rays, answers),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(detected) => detected.occluded_each(tree, rays, answers),
        }
    }
}

/// The vector part of a kernel. Methods are inlined into a function compiled for its instruction set.
trait Traversal: Copy {
    /// The boxes that the ray meets between `t_min` and `limit`, one bit per column, and the distances at which it
    /// enters them.
    ///
    /// Per axis, `(plane - origin) * inverse`; the entry is the greatest near distance, the exit the least far
    /// distance times [`FAR_SLACK`] (Ize 2013). `max(a, b)` and `min(a, b)` are `b` if either is NaN, which happens
    /// where a ray runs within a plane: that plane then does not count.
    fn boxes(self, node: &WideNode, ray: &RayFrame, limit: f32) -> (u32, Distances);

    /// Asks for the memory of a node or leaf that is likely to be visited soon.
    fn prefetch(self, tree: &WideTree, reference: u32);

    /// The triangles whose edge functions, in single precision, do not differ in sign: a superset of those hit.
    fn candidates(self, pack: &TrianglePack, ray: &RayFrame) -> u32;
}

/// Distances at which a ray enters eight boxes, in the unit of the mesh.
#[repr(C, align(32))]
struct Distances([f32; WIDTH]);

/// A node or leaf to visit, and the distance at which the ray enters it, in one number that sorts by distance.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
struct Entry(i64);

impl Entry {
    /// Distances are not negative, so their bits sort as they do. (Only `-0.0` sorts first, where it belongs.)
    #[inline(always)]
    fn new(distance: f32, reference: u32) -> Self {
        Self((i64::from(distance.to_bits().cast_signed()) << 32) | i64::from(reference))
    }

    #[inline(always)]
    fn distance(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    #[inline(always)]
    fn reference(self) -> u32 {
        self.0 as u32
    }
}

/// What is left to visit. Not initialised beforehand: that would cost as much as a short traversal.
struct Stack {
    entries: [MaybeUninit<Entry>; STACK_CAPACITY],
    len: usize,
}

impl Stack {
    #[inline(always)]
    const fn new() -> Self {
        Self { entries: [const { MaybeUninit::uninit() }; STACK_CAPACITY], len: 0 }
    }

    /// # Safety
    /// Fewer than [`STACK_CAPACITY`] entries must be on the stack.
    #[inline(always)]
    unsafe fn push(&mut self, entry: Entry) {
        debug_assert!(self.len < STACK_CAPACITY);
        // SAFETY: the caller guarantees len < STACK_CAPACITY.
        unsafe { self.entries.get_unchecked_mut(self.len) }.write(entry);
        self.len += 1;
    }

    /// Puts `entry` below those of the entries from `base` on that are nearer.
    ///
    /// # Safety
    /// Fewer than [`STACK_CAPACITY`] entries must be on the stack, and at least `base`.
    #[inline(always)]
    unsafe fn insert(&mut self, base: usize, entry: Entry) {
        debug_assert!(base <= self.len && self.len < STACK_CAPACITY);
        let mut position = self.len;
        while position > base {
            // SAFETY: base <= position - 1 < len, and entries below len are initialised.
            let below = unsafe { self.entries.get_unchecked(position - 1).assume_init() };
            if below >= entry {
                break;
            }
            // SAFETY: position <= len < STACK_CAPACITY.
            unsafe { self.entries.get_unchecked_mut(position) }.write(below);
            position -= 1;
        }
        // SAFETY: position <= len < STACK_CAPACITY.
        unsafe { self.entries.get_unchecked_mut(position) }.write(entry);
        self.len += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<Entry> {
        if self.len == 0 {
            return None;
        }
        self.len -= 1;
        // SAFETY: the entry at the new len was below the old len, hence initialised.
        Some(unsafe { self.entries.get_unchecked(self.len).assume_init() })
    }
}

impl WideTree {
    #[inline(always)]
    fn node(&self, reference: u32) -> &WideNode {
        debug_assert!((reference as usize) < self.nodes.len());
        // SAFETY: references come from the tree, whose invariants say that they name existing nodes.
        unsafe { self.nodes.get_unchecked(reference as usize) }
    }

    #[inline(always)]
    fn pack(&self, reference: u32) -> &TrianglePack {
        debug_assert!(((reference & !LEAF) as usize) < self.packs.len());
        // SAFETY: as for nodes; references with LEAF set name existing leaves.
        unsafe { self.packs.get_unchecked((reference & !LEAF) as usize) }
    }
}

/// Asks for the memory of an element that will be read soon, where the processor can be asked; nothing else happens, also
/// beyond the end.
#[inline(always)]
pub fn prefetch<T>(items: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        const LINE: usize = 64;
        let start = items.as_ptr().wrapping_add(index).cast::<i8>();
        for line in (0..size_of::<T>()).step_by(LINE) {
            // SAFETY: a prefetch may be given any address.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(start.wrapping_add(line)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (items, index);
}

/// Brings a node or leaf into the cache: all its lines, for none of them is of use alone.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn prefetch_child(tree: &WideTree, reference: u32) {
    let number = (reference & !LEAF) as usize;
    if reference & LEAF == 0 {
        prefetch(&tree.nodes, number);
    } else {
        prefetch(&tree.packs, number);
    }
}

/// What a search for the nearest hit knows of its ray.
#[derive(Clone, Copy)]
struct ClosestSearch {
    frame: RayFrame,
    best: Hit,
    found: bool,
    /// Nothing entered farther away than this matters any more.
    limit: f32,
}

impl ClosestSearch {
    #[inline(always)]
    fn new(ray: &Ray) -> Self {
        let frame = RayFrame::new(ray);
        let best = Hit { t: ray.t_max, u: 0.0, v: 0.0, triangle: 0 };
        Self { frame, best, found: false, limit: best.t * FAR_SLACK }
    }

    #[inline(always)]
    fn hit(&self) -> Option<Hit> {
        self.found.then_some(self.best)
    }

    /// Visits one node or leaf, and says what to visit next.
    #[inline(always)]
    fn visit<L: Traversal>(
        &mut self,
        lanes: L,
        tree: &WideTree,
        stack: &mut Stack,
        current: u32,
    ) -> Option<u32> {
        if current & LEAF == 0 {
            let fetch = |reference| lanes.prefetch(tree, reference);
            // SAFETY: with all columns of this node on it, the stack holds at most `stack_need` entries, and the builder has
            // checked that those fit.
            let next = unsafe { enter(lanes, tree.node(current), &self.frame, self.limit, stack, fetch) };
            if next.is_some() {
                return next;
            }
        } else {
            let pack = tree.pack(current);
            let mut candidates = lanes.candidates(pack, &self.frame);
            while candidates != 0 {
                let lane = candidates.trailing_zeros() as usize & (PACK - 1);
                candidates &= candidates - 1;
                if let Some((t, u, v)) = self.frame.intersect(pack, lane) {
                    let triangle = pack.numbers[lane];
                    let nearer = t < self.best.t || (t == self.best.t && triangle < self.best.triangle);
                    if t > self.frame.t_min && nearer {
                        self.best = Hit { t, u, v, triangle };
                        self.found = true;
                        self.limit = t * FAR_SLACK;
                    }
                }
            }
        }
        pop_within(stack, self.limit)
    }
}

/// What to visit next, now that nothing entered beyond `limit` matters.
#[inline(always)]
fn pop_within(stack: &mut Stack, limit: f32) -> Option<u32> {
    loop {
        let entry = stack.pop()?;
        if entry.distance() <= limit {
            return Some(entry.reference());
        }
    }
}

/// Puts the children of a node that the ray meets on the stack, the nearest on top, and asks for their memory. If there
/// are one or two, the nearest is returned instead.
///
/// # Safety
/// The stack must have room for [`WIDTH`] more entries.
#[inline(always)]
unsafe fn enter<L: Traversal>(
    lanes: L,
    node: &WideNode,
    frame: &RayFrame,
    limit: f32,
    stack: &mut Stack,
    fetch: impl Fn(u32),
) -> Option<u32> {
    let (mut met, distances) = lanes.boxes(node, frame, limit);
    if met == 0 {
        return None;
    }
    let entry = |met: u32| {
        let column = met.trailing_zeros() as usize & (WIDTH - 1);
        fetch(node.children[column]);
        Entry::new(distances.0[column], node.children[column])
    };
    let first = entry(met);
    met &= met - 1;
    if met == 0 {
        return Some(first.reference());
    }
    let second = entry(met);
    met &= met - 1;
    let (near, far) = if first < second { (first, second) } else { (second, first) };
    let base = stack.len;
    // SAFETY, here and below: the caller guarantees room for all columns.
    unsafe { stack.push(far) };
    if met == 0 {
        return Some(near.reference());
    }
    // SAFETY: as above.
    unsafe { stack.push(near) };
    while met != 0 {
        // SAFETY: as above; base was the length before this node.
        unsafe { stack.insert(base, entry(met)) };
        met &= met - 1;
    }
    None
}

#[inline(always)]
fn closest<L: Traversal>(lanes: L, tree: &WideTree, ray: &Ray) -> Option<Hit> {
    if tree.nodes.is_empty() {
        return None;
    }
    let mut search = ClosestSearch::new(ray);
    let mut stack = Stack::new();
    let mut current = 0;
    while let Some(next) = search.visit(lanes, tree, &mut stack, current) {
        current = next;
    }
    search.hit()
}

/// What a search for any hit knows of its ray.
#[derive(Clone, Copy)]
struct OcclusionSearch {
    frame: RayFrame,
    t_max: f32,
}

impl OcclusionSearch {
    #[inline(always)]
    fn new(ray: &Ray) -> Self {
        Self { frame: RayFrame::new(ray), t_max: ray.t_max }
    }

    /// Visits one node or leaf; breaks with the answer, or says what to visit next.
    #[inline(always)]
    fn visit<L: Traversal>(
        &self,
        lanes: L,
        tree: &WideTree,
        stack: &mut Stack,
        current: u32,
    ) -> ControlFlow<bool, u32> {
        if current & LEAF == 0 {
            let node = tree.node(current);
            let (mut met, distances) = lanes.boxes(node, &self.frame, self.t_max * FAR_SLACK);
            while met != 0 {
                let column = met.trailing_zeros() as usize & (WIDTH - 1);
                met &= met - 1;
                lanes.prefetch(tree, node.children[column]);
                // SAFETY: with all columns of this node on it, the stack holds at most `stack_need` entries, which the
                // builder has checked.
                unsafe { stack.push(Entry::new(distances.0[column], node.children[column])) };
            }
        } else {
            let pack = tree.pack(current);
            let mut candidates = lanes.candidates(pack, &self.frame);
            while candidates != 0 {
                let lane = candidates.trailing_zeros() as usize & (PACK - 1);
                candidates &= candidates - 1;
                if let Some((t, _, _)) = self.frame.intersect(pack, lane)
                    && t > self.frame.t_min
                    && t < self.t_max
                {
                    return ControlFlow::Break(true);
                }
            }
        }
        stack.pop().map_or(ControlFlow::Break(false), |entry| ControlFlow::Continue(entry.reference()))
    }
}

#[inline(always)]
fn occluded<L: Traversal>(lanes: L, tree: &WideTree, ray: &Ray) -> bool {
    if tree.nodes.is_empty() {
        return false;
    }
    let search = OcclusionSearch::new(ray);
    let mut stack = Stack::new();
    let mut current = 0;
    loop {
        match search.visit(lanes, tree, &mut stack, current) {
            ControlFlow::Continue(next) => current = next,
            ControlFlow::Break(answer) => return answer,
        }
    }
}

/// The nearest hit in placed meshes, and the number of the instance; of those at the same `t`, the lowest numbers.
#[inline(always)]
fn closest_placed<L: Traversal>(lanes: L, placed: &PlacedTrees, ray: &Ray) -> Option<(u32, Hit)> {
    if placed.nodes.is_empty() {
        return None;
    }
    let frame = RayFrame::new(ray);
    let mut best: Option<(u32, Hit)> = None;
    let mut t_max = ray.t_max;
    let mut stack = Stack::new();
    let mut current = 0;
    loop {
        let mut next = None;
        if current & LEAF == 0 {
            let fetch = |reference| prefetch_place(placed, reference);
            let node = &placed.nodes[current as usize];
            // SAFETY: `PlacedTrees` promises that `stack_need` of its nodes fits.
            next = unsafe { enter(lanes, node, &frame, t_max * FAR_SLACK, &mut stack, fetch) };
        } else {
            let number = current & !LEAF;
            let place = &placed.places[number as usize];
            // Limits are not part of what is searched: at the same distance an earlier instance takes precedence.
            let limit = match best {
                Some((earlier, _)) if number < earlier => t_max.next_up(),
                _ => t_max,
            };
            let local = place.local_ray(ray, limit);
            if let Some(hit) = closest(lanes, placed.tree(place), &local) {
                t_max = hit.t;
                best = Some((number, hit));
            }
        }
        match next.or_else(|| pop_within(&mut stack, t_max * FAR_SLACK)) {
            Some(reference) => current = reference,
            None => return best,
        }
    }
}

#[inline(always)]
fn occluded_placed<L: Traversal>(lanes: L, placed: &PlacedTrees, ray: &Ray) -> bool {
    if placed.nodes.is_empty() {
        return false;
    }
    let frame = RayFrame::new(ray);
    let limit = ray.t_max * FAR_SLACK;
    let mut stack = Stack::new();
    let mut current = 0;
    loop {
        let mut next = None;
        if current & LEAF == 0 {
            let fetch = |reference| prefetch_place(placed, reference);
            let node = &placed.nodes[current as usize];
            // SAFETY: `PlacedTrees` promises that `stack_need` of its nodes fits.
            next = unsafe { enter(lanes, node, &frame, limit, &mut stack, fetch) };
        } else {
            let place = &placed.places[(current & !LEAF) as usize];
            if occluded(lanes, placed.tree(place), &place.local_ray(ray, ray.t_max)) {
                return true;
            }
        }
        match next.or_else(|| pop_within(&mut stack, limit)) {
            Some(reference) => current = reference,
            None => return false,
        }
    }
}

/// Brings a node of the upper tree or a place into the cache.
#[inline(always)]
fn prefetch_place(placed: &PlacedTrees, reference: u32) {
    let number = (reference & !LEAF) as usize;
    if reference & LEAF == 0 {
        prefetch(&placed.nodes, number);
    } else {
        prefetch(&placed.places, number);
    }
}

/// Rays that are traced in turns: while one waits for memory, the others go on.
const IN_TURNS: usize = 8;

/// [`closest`] for each of several rays.
#[inline(always)]
fn closest_each<L: Traversal>(lanes: L, tree: &WideTree, rays: &[Ray], hits: &mut [Option<Hit>]) {
    if tree.nodes.is_empty() {
        hits.fill(None);
        return;
    }
    let mut stacks = [const { Stack::new() }; IN_TURNS];
    let mut places = [(0_usize, 0_u32); IN_TURNS];
    let started = rays.len().min(IN_TURNS);
    let Some(first) = rays.first() else { return };
    let mut searches = [ClosestSearch::new(first); IN_TURNS];
    for (turn, ray) in rays[..started].iter().enumerate().skip(1) {
        searches[turn] = ClosestSearch::new(ray);
        places[turn] = (turn, 0);
    }
    let mut order: [usize; IN_TURNS] = std::array::from_fn(|turn| turn);
    let (mut running, mut next_ray) = (started, started);
    while running > 0 {
        let mut position = 0;
        while position < running {
            let turn = order[position] & (IN_TURNS - 1);
            let search = &mut searches[turn];
            let (ray, current) = places[turn];
            if let Some(next) = search.visit(lanes, tree, &mut stacks[turn], current) {
                places[turn].1 = next;
                position += 1;
            } else {
                hits[ray] = search.hit();
                if next_ray < rays.len() {
                    *search = ClosestSearch::new(&rays[next_ray]);
                    places[turn] = (next_ray, 0);
                    next_ray += 1;
                    position += 1;
                } else {
                    running -= 1;
                    order.swap(position, running);
                }
            }
        }
    }
}

/// [`occluded`] for each of several rays.
#[inline(always)]
fn occluded_each<L: Traversal>(lanes: L, tree: &WideTree, rays: &[Ray], answers: &mut [bool]) {
    if tree.nodes.is_empty() {
        answers.fill(false);
        return;
    }
    let mut stacks = [const { Stack::new() }; IN_TURNS];
    let mut places = [(0_usize, 0_u32); IN_TURNS];
    let started = rays.len().min(IN_TURNS);
    let Some(first) = rays.first() else { return };
    let mut searches = [OcclusionSearch::new(first); IN_TURNS];
    for (turn, ray) in rays[..started].iter().enumerate().skip(1) {
        searches[turn] = OcclusionSearch::new(ray);
        places[turn] = (turn, 0);
    }
    let mut order: [usize; IN_TURNS] = std::array::from_fn(|turn| turn);
    let (mut running, mut next_ray) = (started, started);
    while running > 0 {
        let mut position = 0;
        while position < running {
            let turn = order[position] & (IN_TURNS - 1);
            let search = &mut searches[turn];
            let (ray, current) = places[turn];
            match search.visit(lanes, tree, &mut stacks[turn], current) {
                ControlFlow::Continue(next) => {
                    places[turn].1 = next;
                    position += 1;
                }
                ControlFlow::Break(answer) => {
                    answers[ray] = answer;
                    if next_ray < rays.len() {
                        *search = OcclusionSearch::new(&rays[next_ray]);
                        stacks[turn].len = 0;
                        places[turn] = (next_ray, 0);
                        next_ray += 1;
                        position += 1;
                    } else {
                        running -= 1;
                        order.swap(position, running);
                    }
                }
            }
        }
    }
}
