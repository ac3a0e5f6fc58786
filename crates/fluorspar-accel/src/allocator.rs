//! The allocator of the programs: mimalloc, which requests large pages. A renderer reads at random from megabytes of
//! tree, mesh and texture, and looking up small pages costs as much as reading them.
#![allow(unsafe_code)]

use std::ffi::c_long;

use libmimalloc_sys::{mi_option_set, mi_option_t};
/// The global allocator of programs that render.
///
/// ```
/// #[global_allocator]
/// static ALLOCATOR: fluorspar_accel::Allocator = fluorspar_accel::Allocator;
///
/// fn main() {
///     fluorspar_accel::return_freed_memory_at_once();
/// }
/// ```
pub use mimalloc::MiMalloc as Allocator;

/// `mi_option_purge_delay` of mimalloc.h: milliseconds that freed pages stay with the program.
const PURGE_DELAY: mi_option_t = 15;

/// Gives freed pages back to the system as soon as they are free, instead of some time later: films and images are large,
/// and follow each other. The default experiment peaks at 1.1 GiB instead of 1.4 GiB, in the same time.
///
/// A program calls it first in `main`, before it starts threads. It does nothing unless [`Allocator`] is the global
/// allocator.
pub fn return_freed_memory_at_once() {
    const AT_ONCE: c_long = 0;
    // SAFETY: the option exists and takes any number. It is read as one aligned word, so an allocation that runs at the same
    // time sees the old delay or the new one.
    unsafe { mi_option_set(PURGE_DELAY, AT_ONCE) };
}

#[cfg(test)]
mod tests {
    use libmimalloc_sys::mi_option_get;

    use super::*;

    /// The number of the option is that of the library: its default comes before, zero after.
    #[test]
    fn freed_memory_is_returned_at_once() {
        // SAFETY: reading an option has no conditions.
        let delay = || unsafe { mi_option_get(PURGE_DELAY) };
        assert!(delay() > 0);
        return_freed_memory_at_once();
        assert_eq!(delay(), 0);
    }
}
