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
/// On Linux, allocations of half a large page (1 MiB) or more begin at a large page, take whole ones, and the system is
/// advised to use them (`madvise` with `MADV_HUGEPAGE`); it may decline. Elsewhere this is [`System`].
#[derive(Clone, Copy, Debug, Default)]
pub struct LargePageAllocator;

#[cfg(target_os = "linux")]
mod linux {
    use std::alloc::Layout;
    use std::ffi::{c_int, c_void};

    unsafe extern "C" {
        fn posix_memalign(out: *mut *mut c_void, alignment: usize, size: usize) -> c_int;
        fn calloc(count: usize, size: usize) -> *mut c_void;
        fn free(start: *mut c_void);
        fn madvise(start: *mut c_void, bytes: usize, advice: c_int) -> c_int;
    }

    /// `MADV_HUGEPAGE` of <sys/mman.h>.
    const HUGE_PAGE: c_int = 14;
    /// Size of a large page of x86-64, and of 64-bit ARM with small pages of 4 KiB.
    const LARGE_PAGE: usize = 2 << 20;
    /// Smallest pages there are; advice is given for whole ones.
    const SMALL_PAGE: usize = 4 << 10;

    pub(super) fn is_large(layout: Layout) -> bool {
        layout.size() >= LARGE_PAGE / 2 && layout.align() <= LARGE_PAGE
    }

    /// Bytes that an allocation of `size` takes; `None` beyond the address space.
    pub(super) fn taken(size: usize) -> Option<usize> {
        size.checked_next_multiple_of(LARGE_PAGE)
    }

    pub(super) fn allocate(layout: Layout) -> *mut u8 {
        let mut start: *mut c_void = std::ptr::null_mut();
        let Some(bytes) = taken(layout.size()) else { return start.cast() };
        // SAFETY: the alignment is a power of two and a multiple of the size of a pointer, and `start` may be written.
        if unsafe { posix_memalign(&raw mut start, LARGE_PAGE, bytes) } != 0 {
            return std::ptr::null_mut();
        }
        advise(start, bytes);
        start.cast()
    }

    /// Zeroed memory, which the system provides when it is touched, at an alignment of 16 bytes.
    pub(super) fn allocate_zeroed(layout: Layout) -> *mut u8 {
        let Some(bytes) = taken(layout.size()) else { return std::ptr::null_mut() };
        // SAFETY: any numbers may be given.
        let start = unsafe { calloc(1, bytes) };
        if !start.is_null() {
            advise(start, bytes);
        }
        start.cast()
    }

    /// # Safety
    /// The pointer must come from one of the two functions above and not be used any more.
    pub(super) unsafe fn release(start: *mut u8) {
        // SAFETY: memory of posix_memalign and calloc is given back by free.
        unsafe { free(start.cast()) };
    }

    fn advise(start: *mut c_void, bytes: usize) {
        let first = start as usize / SMALL_PAGE * SMALL_PAGE;
        let last = (start as usize + bytes).next_multiple_of(SMALL_PAGE);
        // SAFETY: the advice changes no contents, whoever else has some of the first and last page. Its failure is none.
        unsafe { madvise(first as *mut c_void, last - first, HUGE_PAGE) };
    }
}

// SAFETY: `linux::is_large` depends on the layout alone, so that memory goes back to where it came from: to the C library
// if large, to `System` if not. Both give memory of the size and alignment asked for, or null.
#[cfg(target_os = "linux")]
unsafe impl GlobalAlloc for LargePageAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if linux::is_large(layout) {
            return linux::allocate(layout);
        }
        // SAFETY: the caller promises what `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        /// What calloc promises on 64-bit systems.
        const ALIGNMENT: usize = 16;
        if !linux::is_large(layout) {
            // SAFETY: the caller promises what `System` asks for.
            return unsafe { System.alloc_zeroed(layout) };
        }
        if layout.align() <= ALIGNMENT {
            return linux::allocate_zeroed(layout);
        }
        let start = linux::allocate(layout);
        if !start.is_null() {
            // SAFETY: at least as many bytes have been allocated.
            unsafe { start.write_bytes(0, layout.size()) };
        }
        start
    }

    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        if linux::is_large(layout) {
            // SAFETY: large layouts are allocated there, and the caller gives the memory up.
            unsafe { linux::release(start) };
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
            (true, true) if linux::taken(layout.size()) == linux::taken(new_size) => return start,
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
#[cfg(not(target_os = "linux"))]
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
