//! Memory that may not be there, and the last message of a program without it.
#![allow(unsafe_code)]

use std::alloc::{Layout, alloc, dealloc};
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};

thread_local! {
    /// Whether this thread asks for memory that it can do without.
    pub(crate) static IS_PREPARED: Cell<bool> = const { Cell::new(false) };
}

/// Claims the one message that says why the process ends. Of several threads that fail together the first returns; the others wait
/// here for the end. A program calls it before its last message.
pub fn claim_exit_message() {
    static CLAIMED: AtomicBool = AtomicBool::new(false);
    if CLAIMED.swap(true, Ordering::SeqCst) {
        loop {
            std::thread::yield_now();
        }
    }
}

/// Whether the process may have so many bytes more now: its limits (`ulimit -v`) and the system's rules on overcommitment are
/// asked with a request that is given back at once, untouched. Other threads, and pages that exist in name only, can still
/// make a later request fail.
pub fn memory_is_available(bytes: u64) -> bool {
    const PAGE: usize = 4096;
    let Ok(bytes) = usize::try_from(bytes) else { return false };
    if bytes == 0 {
        return true;
    }
    let Ok(layout) = Layout::from_size_align(bytes, PAGE) else { return false };
    let before = IS_PREPARED.replace(true);
    // SAFETY: the layout has a size, and what is given is given back as it is.
    let pointer = unsafe { alloc(layout) };
    // The compiler may take an allocation that nobody uses for granted, and leave it out.
    let pointer = std::hint::black_box(pointer);
    IS_PREPARED.set(before);
    if pointer.is_null() {
        return false;
    }
    // SAFETY: it came from `alloc` with this layout and was not given back.
    unsafe { dealloc(pointer, layout) };
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_machine_has_is_not_available() {
        assert!(memory_is_available(0) && memory_is_available(1 << 20));
        // More than the addresses of any process.
        assert!(!memory_is_available(1 << 62) && !memory_is_available(u64::MAX));
    }
}
