//! Memory on large pages: a renderer jumps about in megabytes of tree, mesh and texture, and looking up small pages costs
//! as much as reading them.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};

/// The system's allocator, which asks for large pages where an allocation fills one.
///
/// A program declares it once; nothing but time depends on it:
///
/// ```
/// #[global_allocator]
/// static ALLOCATOR: fluorspar_accel::LargePageAllocator = fluorspar_accel::LargePageAllocator;
///
/// # fn main() {
/// let mut many = vec![7_u32; 1 << 20];
/// many.resize(3 << 20, 9);
/// assert_eq!((many[(1 << 20) - 1], many[1 << 20]), (7, 9));
/// # }
/// ```
///
/// On Linux (x86-64 and 64-bit ARM), allocations of half a large page (1 MiB) or more are mappings of their own that begin at
/// a large page, and the system is advised to use such (`madvise` with `MADV_HUGEPAGE`); it may decline. They go back to the
/// system as soon as they are freed. Elsewhere this is [`System`].
#[derive(Clone, Copy, Debug, Default)]
pub struct LargePageAllocator;

#[cfg(all(
    target_os = "linux",
    target_pointer_width = "64",
    any(target_arch = "x86_64", target_arch = "aarch64")
))]
mod linux {
    use std::alloc::Layout;
    use std::ffi::{c_int, c_void};
    use std::ptr::null_mut;

    unsafe extern "C" {
        fn mmap(
            start: *mut c_void,
            bytes: usize,
            protection: c_int,
            flags: c_int,
            file: c_int,
            offset: isize,
        ) -> *mut c_void;
        fn mremap(start: *mut c_void, bytes: usize, new_bytes: usize, flags: c_int, ...) -> *mut c_void;
        fn munmap(start: *mut c_void, bytes: usize) -> c_int;
        fn madvise(start: *mut c_void, bytes: usize, advice: c_int) -> c_int;
    }

    // Constants of <sys/mman.h>.
    const READ_WRITE: c_int = 1 | 2;
    const PRIVATE_ANONYMOUS: c_int = 0x02 | 0x20;
    const FAILED: usize = usize::MAX;
    const MAY_MOVE_TO: c_int = 1 | 2;
    const HUGE_PAGE: c_int = 14;

    /// Size of a large page of x86-64, and of 64-bit ARM with small pages of 4 KiB.
    const LARGE_PAGE: usize = 2 << 20;
    /// Largest small pages there are.
    const SMALL_PAGE: usize = 64 << 10;

    pub(super) fn is_large(layout: Layout) -> bool {
        layout.size() >= LARGE_PAGE / 2 && layout.align() <= LARGE_PAGE
    }

    /// Bytes that an allocation of `size` takes: the last large page whole if at least half of it is wanted. `None` beyond the
    /// address space.
    pub(super) fn taken(size: usize) -> Option<usize> {
        let page = if size % LARGE_PAGE >= LARGE_PAGE / 2 { LARGE_PAGE } else { SMALL_PAGE };
        size.checked_next_multiple_of(page)
    }

    /// Memory full of zeros, at a large page; null if there is none.
    pub(super) fn allocate(size: usize) -> *mut u8 {
        let Some(bytes) = taken(size) else { return null_mut() };
        let Some(with_slack) = bytes.checked_add(LARGE_PAGE) else { return null_mut() };
        // SAFETY: a new mapping, wherever there is room, overlaps no other.
        let mapped = unsafe { mmap(null_mut(), with_slack, READ_WRITE, PRIVATE_ANONYMOUS, -1, 0) };
        if mapped as usize == FAILED {
            return null_mut();
        }
        let before = (mapped as usize).next_multiple_of(LARGE_PAGE) - mapped as usize;
        let start = mapped.cast::<u8>().wrapping_add(before);
        // SAFETY: what is unmapped lies in the mapping before and behind the part that is kept, on borders of pages. The advice
        // changes no contents; its failure is none.
        unsafe {
            unmap(mapped.cast(), before);
            unmap(start.wrapping_add(bytes), LARGE_PAGE - before);
            madvise(start.cast(), bytes, HUGE_PAGE);
        }
        start
    }

    /// Gives memory of [`allocate`] back.
    ///
    /// # Safety
    /// The pointer must come from there, with the same size, and not be used any more.
    pub(super) unsafe fn release(start: *mut u8, size: usize) {
        // SAFETY: the caller promises that this much is mapped there. (`taken` was some when it was allocated.)
        unsafe { unmap(start, taken(size).unwrap_or(0)) };
    }

    /// Moves memory to where there is room for more, page by page without copying; null, and nothing changed, if it can't.
    ///
    /// # Safety
    /// The pointer must come from [`allocate`] with `size`, which takes less than `new_size`, and not be used any more unless
    /// null is returned.
    pub(super) unsafe fn grow(start: *mut u8, size: usize, new_size: usize) -> *mut u8 {
        let new_start = allocate(new_size);
        let old = taken(size).unwrap_or(0);
        if new_start.is_null() {
            return null_mut();
        }
        // SAFETY: the pages, which the caller gives up, take the place of the first of the new ones, which nobody has seen.
        let moved = unsafe { mremap(start.cast(), old, old, MAY_MOVE_TO, new_start.cast::<c_void>()) };
        if moved as usize == FAILED {
            // SAFETY: it has just been allocated, with this size.
            unsafe { release(new_start, new_size) };
            return null_mut();
        }
        new_start
    }

    /// Gives back what a smaller size does not take.
    ///
    /// # Safety
    /// The pointer must come from [`allocate`] with `size`, and nothing beyond `new_size`, which takes no more, may be used
    /// any more.
    pub(super) unsafe fn shrink(start: *mut u8, size: usize, new_size: usize) {
        let (old, new) = (taken(size).unwrap_or(0), taken(new_size).unwrap_or(0));
        // SAFETY: the caller promises that the old size is mapped there.
        unsafe { unmap(start.wrapping_add(new), old - new) };
    }

    /// # Safety
    /// The bytes must be mapped, begin at a page, and not be used any more.
    unsafe fn unmap(start: *mut u8, bytes: usize) {
        if bytes > 0 {
            // SAFETY: as the caller promises. It fails only if the system has no room to note the hole; the memory then stays.
            unsafe { munmap(start.cast(), bytes) };
        }
    }
}

// SAFETY: `linux::is_large` depends on the layout alone, so that memory goes back to where it came from: mappings if large,
// `System` if not. Both give memory of the size and alignment asked for, or null.
#[cfg(all(
    target_os = "linux",
    target_pointer_width = "64",
    any(target_arch = "x86_64", target_arch = "aarch64")
))]
unsafe impl GlobalAlloc for LargePageAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if linux::is_large(layout) {
            return linux::allocate(layout.size());
        }
        // SAFETY: the caller promises what `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if linux::is_large(layout) {
            return linux::allocate(layout.size());
        }
        // SAFETY: the caller promises what `System` asks for.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        if linux::is_large(layout) {
            // SAFETY: large layouts are allocated there, and the caller gives the memory up.
            unsafe { linux::release(start, layout.size()) };
        } else {
            // SAFETY: all others are allocated by `System`.
            unsafe { System.dealloc(start, layout) };
        }
    }

    unsafe fn realloc(&self, start: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: the caller promises that `new_size`, rounded up to the alignment, does not overflow `isize`.
        let new_layout = unsafe { Layout::from_size_align_unchecked(new_size, layout.align()) };
        match (linux::is_large(layout), linux::is_large(new_layout)) {
            // SAFETY: the caller promises what `System` asks for, and `System` allocated the memory.
            (false, false) => return unsafe { System.realloc(start, layout, new_size) },
            (true, true) if linux::taken(new_size) <= linux::taken(layout.size()) => {
                // SAFETY: the caller gives up what lies beyond the new size, if that is smaller; if not, both take the same.
                unsafe { linux::shrink(start, layout.size(), new_size) };
                return start;
            }
            // SAFETY: the caller gives the memory up unless null is returned.
            (true, true) => return unsafe { linux::grow(start, layout.size(), new_size) },
            _ => {}
        }
        // SAFETY: as the caller promises; the two do not overlap, and both hold the bytes copied.
        unsafe {
            let new_start = self.alloc(new_layout);
            if !new_start.is_null() {
                new_start.copy_from_nonoverlapping(start, layout.size().min(new_size));
                self.dealloc(start, layout);
            }
            new_start
        }
    }
}

// SAFETY: `System` does it all.
#[cfg(not(all(
    target_os = "linux",
    target_pointer_width = "64",
    any(target_arch = "x86_64", target_arch = "aarch64")
)))]
unsafe impl GlobalAlloc for LargePageAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller promises what `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller promises what `System` asks for.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        // SAFETY: the caller promises what `System` asks for.
        unsafe { System.dealloc(start, layout) }
    }

    unsafe fn realloc(&self, start: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: the caller promises what `System` asks for.
        unsafe { System.realloc(start, layout, new_size) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Large and small allocations keep what is in them when they grow and shrink across the border, and begin with zeros
    /// where zeros were asked for.
    #[test]
    fn contents_survive_growing_and_shrinking() {
        const SIZES: [usize; 9] =
            [1 << 10, 1 << 20, (1 << 20) - 1, 3 << 20, (4 << 20) + 5, (7 << 20) / 2, 2 << 20, 100, 5 << 20];
        let expected = |index: usize| (index % 251) as u8 + 1;
        for align in [1, 64, 4096, 2 << 20, 4 << 20] {
            let layout = |size: usize| Layout::from_size_align(size, align).unwrap();
            // SAFETY: layouts have sizes above zero and belong to the pointers; what is read has been written or zeroed.
            unsafe {
                let mut size = SIZES[0];
                let mut start = LargePageAllocator.alloc(layout(size));
                (0..size).for_each(|index| start.add(index).write(expected(index)));
                for new_size in SIZES.into_iter().skip(1) {
                    start = LargePageAllocator.realloc(start, layout(size), new_size);
                    assert!(!start.is_null() && (start as usize).is_multiple_of(align));
                    for index in 0..size.min(new_size) {
                        assert_eq!(*start.add(index), expected(index), "{size} -> {new_size}");
                    }
                    (size..new_size).for_each(|index| start.add(index).write(expected(index)));
                    size = new_size;
                }
                LargePageAllocator.dealloc(start, layout(size));
                for size in SIZES {
                    let zeros = LargePageAllocator.alloc_zeroed(layout(size));
                    assert!((0..size).all(|index| *zeros.add(index) == 0));
                    zeros.write_bytes(7, size);
                    LargePageAllocator.dealloc(zeros, layout(size));
                }
                // More than there is: null, not a crash.
                let absurd = LargePageAllocator.alloc(layout(isize::MAX as usize / 2));
                assert!(absurd.is_null());
            }
        }
    }
}
