//! Memory on large pages: a traversal jumps about in hundreds of megabytes, and looking up small pages costs as much as
//! reading them.

/// An empty vector with room for `capacity` items, for which large pages have been asked where the system has them and
/// the vector fills some. It is only advice: everything works without.
pub(crate) fn on_large_pages<T>(capacity: usize) -> Vec<T> {
    let vector = Vec::with_capacity(capacity);
    #[cfg(target_os = "linux")]
    advise(vector.as_ptr() as usize, capacity * size_of::<T>());
    vector
}

#[cfg(target_os = "linux")]
fn advise(start: usize, bytes: usize) {
    use std::ffi::{c_int, c_void};

    unsafe extern "C" {
        fn madvise(start: *mut c_void, bytes: usize, advice: c_int) -> c_int;
    }
    /// `MADV_HUGEPAGE` of <sys/mman.h>.
    const HUGE_PAGE: c_int = 14;
    /// Size of a large page of x86-64, and of 64-bit ARM with small pages of 4 KiB.
    const LARGE_PAGE: usize = 2 << 20;

    // Only whole large pages, none of which is shared with other data.
    let first = start.next_multiple_of(LARGE_PAGE);
    let last = (start + bytes) / LARGE_PAGE * LARGE_PAGE;
    if first < last {
        // SAFETY: the range lies within one allocation, and this advice changes no contents.
        unsafe { madvise(first as *mut c_void, last - first, HUGE_PAGE) };
    }
}
