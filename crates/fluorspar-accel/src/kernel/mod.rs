//! Traversal: one algorithm, and the code that tests all boxes of a node or triangles of a leaf at once for each
//! instruction set.
//!
//! A kernel only decides which boxes and triangles deserve a closer look; hits are computed by [`RayFrame::intersect`]
//! alone. Box distances steer the order of traversal and, with [`FAR_SLACK`], tell what lies beyond the nearest hit.
// Unsafe code is allowed here for vector instructions that the processor must have and for reads without bounds checks
// whose bounds the builder establishes; elsewhere in the workspace only in `allocator`.
#![allow(unsafe_code)]

use std::fmt;
use std::mem::MaybeUninit;

use crate::instance_bvh::PlacedTrees;
use crate::ray::{FAR_SLACK, Hit, Ray, RayFrame};
use crate::wide_tree::{LEAF, PACK, STACK_CAPACITY, TrianglePack, WIDTH, WideNode, WideTree};

mod portable;
mod simd;
#[cfg(target_arch = "x86_64")]
mod x86;

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
    Avx2(x86::Avx2),
    #[cfg(target_arch = "x86_64")]
    Avx512(x86::Avx512),
}

impl Dispatch {
    pub(crate) fn new(kernel: Kernel) -> Option<Self> {
        match kernel {
            Kernel::Portable => Some(Self::Portable),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx2 => x86::Avx2::new().map(Self::Avx2),
            #[cfg(target_arch = "x86_64")]
            Kernel::Avx512 => x86::Avx512::new().map(Self::Avx512),
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

    /// Puts the children whose boxes the ray meets on the stack, the nearest on top, without a branch where the
    /// processor has instructions for that. Alone, a ray does better with [`enter`], whose time
    /// depends on how few boxes are hit.
    ///
    /// # Safety
    /// The stack must have room for [`WIDTH`] more entries.
    #[inline(always)]
    unsafe fn push_hit(self, node: &WideNode, ray: &RayFrame, limit: f32, stack: &mut Stack) {
        // SAFETY: as promised. What is returned had room, too.
        unsafe {
            let near = enter(self, node, ray, limit, stack, |_| {});
            if near != NOTHING {
                stack.push(Entry::new(0.0, near));
            }
        }
    }

    /// The triangles whose edge functions, in single precision, do not differ in sign: a superset of those hit.
    fn candidates(self, pack: &TrianglePack, ray: &RayFrame) -> u32;
}

/// Distances at which a ray enters eight boxes, in the unit of the mesh.
#[repr(C, align(32))]
struct Distances([f32; WIDTH]);

/// A node or leaf to visit, and the distance at which the ray enters it or a little less, in one number that sorts by
/// distance.
#[repr(transparent)]
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

/// Stack of elements to visit. Not initialized beforehand: that would cost as much as a short traversal.
struct Stack {
    /// Kernels write [`WIDTH`] entries at a time, of which those beyond `len` do not count. As many more than are ever needed
    /// also keep neighboring stacks from sharing the same few lines of the cache.
    entries: [MaybeUninit<Entry>; STACK_CAPACITY + WIDTH],
    len: usize,
}

impl Stack {
    #[inline(always)]
    const fn new() -> Self {
        Self { entries: [const { MaybeUninit::uninit() }; STACK_CAPACITY + WIDTH], len: 0 }
    }

    /// As many as there is memory for. (`[const { Stack::new() }; N]` fills all of it with zeros, for a twentieth of the
    /// time of a whole render.)
    #[inline(always)]
    fn all_empty<const N: usize>(memory: &mut MaybeUninit<[Self; N]>) -> &mut [Self; N] {
        let first = memory.as_mut_ptr().cast::<Self>();
        for number in 0..N {
            // SAFETY: the number is less than N, and writing through a raw pointer needs no initialized memory.
            unsafe { (&raw mut (*first.add(number)).len).write(0) };
        }
        // SAFETY: every `len` has been written, and entries may be uninitialized.
        unsafe { memory.assume_init_mut() }
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
            // SAFETY: base <= position - 1 < len, and entries below len are initialized.
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

    /// Next element to visit that is entered before `limit`; [`NOTHING`] if nothing is left.
    #[inline(always)]
    fn pop_within(&mut self, limit: f32) -> u32 {
        while self.len > 0 {
            self.len -= 1;
            // SAFETY: the entry at the new len was below the old len, hence initialized.
            let entry = unsafe { self.entries.get_unchecked(self.len).assume_init() };
            if entry.distance() <= limit {
                return entry.reference();
            }
        }
        NOTHING
    }
}

/// [`Traversal::push_hit`] in branches. If there are one or two children, the nearest is returned instead of pushed;
/// [`NOTHING`] if not. `fetch` is called for each.
///
/// # Safety
/// The stack must have room for [`WIDTH`] more entries.
#[inline(always)]
unsafe fn enter<L: Traversal>(
    lanes: L,
    node: &WideNode,
    ray: &RayFrame,
    limit: f32,
    stack: &mut Stack,
    fetch: impl Fn(u32),
) -> u32 {
    let (mut entered, distances) = lanes.boxes(node, ray, limit);
    if entered == 0 {
        return NOTHING;
    }
    let entry = |entered: u32| {
        let column = entered.trailing_zeros() as usize & (WIDTH - 1);
        fetch(node.children[column]);
        Entry::new(distances.0[column], node.children[column])
    };
    let first = entry(entered);
    entered &= entered - 1;
    if entered == 0 {
        return first.reference();
    }
    let second = entry(entered);
    entered &= entered - 1;
    let (near, far) = if first < second { (first, second) } else { (second, first) };
    let base = stack.len;
    // SAFETY, here and below: the caller guarantees room for all columns.
    unsafe { stack.push(far) };
    if entered == 0 {
        return near.reference();
    }
    // SAFETY: as above.
    unsafe { stack.push(near) };
    while entered != 0 {
        // SAFETY: as above; base was the length before this node.
        unsafe { stack.insert(base, entry(entered)) };
        entered &= entered - 1;
    }
    NOTHING
}

/// A reference that names neither node nor leaf, with [`LEAF`] set: there are fewer leaves.
const NOTHING: u32 = u32::MAX;

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

/// Prefetches the memory of an element that will be read soon, where the processor can; nothing else happens, also
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

/// Prefetches a node or leaf.
#[inline(always)]
fn prefetch_child(tree: &WideTree, reference: u32) {
    let number = (reference & !LEAF) as usize;
    if reference & LEAF == 0 {
        prefetch(&tree.nodes, number);
    } else {
        prefetch(&tree.packs, number);
    }
}

/// A question about a ray, and what is known so far.
trait Search: Copy {
    /// Result of the search.
    type Answer: Copy;

    /// In a tree without triangles.
    const NOTHING_FOUND: Self::Answer;

    fn start(ray: &Ray) -> Self;
    fn frame(&self) -> &RayFrame;
    /// Nothing entered farther away matters any more.
    fn limit(&self) -> f32;
    /// Takes note of a hit beyond `t_min`.
    fn meet(&mut self, hit: Hit);
    /// Does no other hit matter any more?
    fn is_over(&self) -> bool;
    fn answer(&self) -> Self::Answer;

    /// Looks for hits in a leaf; returns whether the search is over.
    #[inline(always)]
    fn visit_leaf<L: Traversal>(&mut self, lanes: L, tree: &WideTree, reference: u32) -> bool {
        let pack = tree.pack(reference);
        let mut candidates = lanes.candidates(pack, self.frame());
        while candidates != 0 {
            let lane = (candidates.trailing_zeros() as usize).min(PACK - 1);
            candidates &= candidates - 1;
            if let Some((t, u, v)) = self.frame().intersect(pack, lane)
                && t > self.frame().t_min
            {
                self.meet(Hit { t, u, v, triangle: pack.numbers[lane] });
            }
        }
        self.is_over()
    }
}

/// State of a search for the nearest hit.
#[derive(Clone, Copy)]
struct ClosestSearch {
    frame: RayFrame,
    best: Hit,
    found: bool,
    /// Nothing entered farther away than this matters any more.
    limit: f32,
}

impl Search for ClosestSearch {
    type Answer = Option<Hit>;
    const NOTHING_FOUND: Option<Hit> = None;

    #[inline(always)]
    fn start(ray: &Ray) -> Self {
        let frame = RayFrame::new(ray);
        let best = Hit { t: ray.t_max, u: 0.0, v: 0.0, triangle: 0 };
        Self { frame, best, found: false, limit: best.t * FAR_SLACK }
    }

    #[inline(always)]
    fn frame(&self) -> &RayFrame {
        &self.frame
    }

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.limit
    }

    #[inline(always)]
    fn answer(&self) -> Option<Hit> {
        self.found.then_some(self.best)
    }

    #[inline(always)]
    fn meet(&mut self, hit: Hit) {
        if hit.t < self.best.t || (hit.t == self.best.t && hit.triangle < self.best.triangle) {
            self.best = hit;
            self.found = true;
            self.limit = hit.t * FAR_SLACK;
        }
    }

    #[inline(always)]
    fn is_over(&self) -> bool {
        false
    }
}

/// State of a search for any hit.
#[derive(Clone, Copy)]
struct OcclusionSearch {
    frame: RayFrame,
    t_max: f32,
    /// `t_max` with slack.
    limit: f32,
    blocked: bool,
}

impl Search for OcclusionSearch {
    type Answer = bool;
    const NOTHING_FOUND: bool = false;

    #[inline(always)]
    fn start(ray: &Ray) -> Self {
        Self { frame: RayFrame::new(ray), t_max: ray.t_max, limit: ray.t_max * FAR_SLACK, blocked: false }
    }

    #[inline(always)]
    fn frame(&self) -> &RayFrame {
        &self.frame
    }

    #[inline(always)]
    fn limit(&self) -> f32 {
        self.limit
    }

    #[inline(always)]
    fn answer(&self) -> bool {
        self.blocked
    }

    #[inline(always)]
    fn meet(&mut self, hit: Hit) {
        self.blocked |= hit.t < self.t_max;
    }

    #[inline(always)]
    fn is_over(&self) -> bool {
        self.blocked
    }
}

/// Searches along one ray.
#[inline(always)]
fn search<L: Traversal, S: Search>(lanes: L, tree: &WideTree, ray: &Ray) -> S::Answer {
    if tree.nodes.is_empty() {
        return S::NOTHING_FOUND;
    }
    let mut search = S::start(ray);
    let mut stack = Stack::new();
    let mut current = 0;
    while current != NOTHING {
        let mut next = NOTHING;
        if current & LEAF == 0 {
            let fetch = |reference| prefetch_child(tree, reference);
            let node = tree.node(current);
            // SAFETY: with all columns of this node on it, the stack holds at most `stack_need` entries, and the builder
            // has checked that those fit.
            next = unsafe { enter(lanes, node, search.frame(), search.limit(), &mut stack, fetch) };
        } else if search.visit_leaf(lanes, tree, current) {
            break;
        }
        current = if next == NOTHING { stack.pop_within(search.limit()) } else { next };
    }
    search.answer()
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
        let mut next = NOTHING;
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
            if let Some(hit) = search::<L, ClosestSearch>(lanes, placed.tree(place), &local) {
                t_max = hit.t;
                best = Some((number, hit));
            }
        }
        current = if next == NOTHING { stack.pop_within(t_max * FAR_SLACK) } else { next };
        if current == NOTHING {
            return best;
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
        let mut next = NOTHING;
        if current & LEAF == 0 {
            let fetch = |reference| prefetch_place(placed, reference);
            let node = &placed.nodes[current as usize];
            // SAFETY: `PlacedTrees` promises that `stack_need` of its nodes fits.
            next = unsafe { enter(lanes, node, &frame, limit, &mut stack, fetch) };
        } else {
            let place = &placed.places[(current & !LEAF) as usize];
            if search::<L, OcclusionSearch>(lanes, placed.tree(place), &place.local_ray(ray, ray.t_max)) {
                return true;
            }
        }
        current = if next == NOTHING { stack.pop_within(limit) } else { next };
        if current == NOTHING {
            return false;
        }
    }
}

/// Most rays that are on their way at a time.
const IN_FLIGHT: usize = 64;
const _: () = assert!(IN_FLIGHT <= u8::MAX as usize, "queues hold bytes");

/// Interleaved traversal of several rays: while one waits for memory, the others advance.
///
/// Rays that are at nodes and rays that are at leaves stand in queues of their own, and which queue is next is computed
/// instead of branched on: the processor can't guess the way of a ray, and with each wrong guess it would throw away what it
/// had begun for the rays after it.
#[inline(always)]
fn search_each<L: Traversal, S: Search>(lanes: L, tree: &WideTree, rays: &[Ray], answers: &mut [S::Answer]) {
    if tree.nodes.is_empty() {
        answers.fill(S::NOTHING_FOUND);
        return;
    }
    for (rays, answers) in rays.chunks(IN_FLIGHT).zip(answers.chunks_mut(IN_FLIGHT)) {
        search_chunk::<L, S>(lanes, tree, rays, answers);
    }
}

/// Numbers of rays in a queue, and room for one more.
struct Queue {
    numbers: [u8; IN_FLIGHT + 1],
    len: usize,
}

impl Queue {
    /// Adds a ray, if `really`. A queue of each kind holds a ray once, so that there is room.
    #[inline(always)]
    fn push_if(&mut self, number: u8, really: bool) {
        self.numbers[self.len.min(IN_FLIGHT)] = number;
        self.len += usize::from(really);
    }
}

/// Puts a ray into the queue for what it visits next, if anything.
#[inline(always)]
fn wait_for(next: u32, number: u8, at_nodes: &mut Queue, at_leaves: &mut Queue) {
    at_nodes.push_if(number, next & LEAF == 0);
    at_leaves.push_if(number, next & LEAF != 0 && next != NOTHING);
}

/// [`search_each`] of up to [`IN_FLIGHT`] rays, in a tree that is not empty.
#[inline(always)]
fn search_chunk<L: Traversal, S: Search>(lanes: L, tree: &WideTree, rays: &[Ray], answers: &mut [S::Answer]) {
    let Some(first) = rays.first() else { return };
    let mut stacks = MaybeUninit::<[Stack; IN_FLIGHT]>::uninit();
    let stacks = Stack::all_empty(&mut stacks);
    let mut searches = [S::start(first); IN_FLIGHT];
    for (search, ray) in searches.iter_mut().zip(rays).skip(1) {
        *search = S::start(ray);
    }
    let mut currents = [0_u32; IN_FLIGHT];
    let mut at_nodes = Queue { numbers: std::array::from_fn(|number| number as u8), len: rays.len() };
    let mut at_leaves = Queue { numbers: [0; IN_FLIGHT + 1], len: 0 };
    // Alternate between rays at nodes and rays at leaves until both queues are empty
    while at_nodes.len + at_leaves.len > 0 {
        for &ray in &at_nodes.numbers[..at_nodes.len] {
            prefetch(&tree.nodes, currents[usize::from(ray) % IN_FLIGHT] as usize);
        }
        // Visit one node per ray, queue it for its next element
        let visited = std::mem::take(&mut at_nodes.len);
        for position in 0..visited {
            let number = at_nodes.numbers[position % IN_FLIGHT];
            let ray = usize::from(number) % IN_FLIGHT;
            let (search, stack) = (&searches[ray], &mut stacks[ray]);
            // SAFETY: as for a ray alone.
            unsafe { lanes.push_hit(tree.node(currents[ray]), search.frame(), search.limit(), stack) };
            let next = stack.pop_within(search.limit());
            currents[ray] = next;
            wait_for(next, number, &mut at_nodes, &mut at_leaves);
        }
        for &ray in &at_leaves.numbers[..at_leaves.len] {
            prefetch(&tree.packs, (currents[usize::from(ray) % IN_FLIGHT] & !LEAF) as usize);
        }
        // Visit one leaf per ray; finished rays leave the queues
        let visited = std::mem::take(&mut at_leaves.len);
        for position in 0..visited {
            let number = at_leaves.numbers[position % IN_FLIGHT];
            let ray = usize::from(number) % IN_FLIGHT;
            let (search, stack) = (&mut searches[ray], &mut stacks[ray]);
            if search.visit_leaf(lanes, tree, currents[ray]) {
                continue;
            }
            let next = stack.pop_within(search.limit());
            currents[ray] = next;
            wait_for(next, number, &mut at_nodes, &mut at_leaves);
        }
    }
    for (search, answer) in searches.iter().zip(answers) {
        *answer = search.answer();
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
