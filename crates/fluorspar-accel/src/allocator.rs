//! The allocator of the programs: mimalloc, which requests large pages. A renderer reads at random from megabytes of
//! tree, mesh and texture, and looking up small pages costs as much as reading them.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout};
use std::cell::Cell;
use std::ffi::c_long;

use libmimalloc_sys::{mi_option_set, mi_option_t};
use mimalloc::MiMalloc;

use crate::memory::IS_PREPARED;

/// The global allocator of programs that render: mimalloc, and an end with a message where memory runs out.
///
/// A request that the system refuses writes one line to standard error and ends the process with exit code 1, on Unix;
/// elsewhere, and in a program with another allocator, Rust aborts. What is large enough to be refused in practice, such as the
/// images of a render, is asked for with [`memory_is_available`](crate::memory_is_available) before, which gives an error that the caller can explain.
///
/// ```
/// #[global_allocator]
/// static ALLOCATOR: fluorspar_accel::Allocator = fluorspar_accel::Allocator;
///
/// fn main() {
///     fluorspar_accel::return_freed_memory_at_once();
/// }
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Allocator;

// SAFETY: all requests go to mimalloc as they are, and its answers come back as they are; a null pointer stays one where the
// process goes on.
unsafe impl GlobalAlloc for Allocator {
    #[inline]
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps to the contract of this method, which is that of mimalloc's.
        granted(unsafe { MiMalloc.alloc(layout) }, layout.size())
    }

    #[inline]
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        granted(unsafe { MiMalloc.alloc_zeroed(layout) }, layout.size())
    }

    #[inline]
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { MiMalloc.dealloc(pointer, layout) }
    }

    #[inline]
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: as above.
        granted(unsafe { MiMalloc.realloc(pointer, layout, new_size) }, new_size)
    }
}

/// The answer of mimalloc, unless it refuses a request for which nobody is prepared.
#[inline]
fn granted(pointer: *mut u8, bytes: usize) -> *mut u8 {
    if pointer.is_null() {
        refused(bytes);
    }
    pointer
}

/// Ends the process where nobody is prepared for a refusal.
#[cold]
#[inline(never)]
fn refused(bytes: usize) {
    // The flag is gone where a thread ends: nobody is prepared there.
    if !IS_PREPARED.try_with(Cell::get).unwrap_or(false) {
        #[cfg(unix)]
        end_without_memory(bytes);
    }
    // Elsewhere the caller, in the end Rust itself, does what it does about a null pointer.
    #[cfg(not(unix))]
    let _ = bytes;
}

/// Writes one line and ends the process, without a further request for memory.
#[cfg(unix)]
fn end_without_memory(bytes: usize) -> ! {
    use std::ffi::{c_int, c_void};
    use std::io::Write;

    unsafe extern "C" {
        fn write(file: c_int, bytes: *const c_void, count: usize) -> isize;
        fn _exit(code: c_int) -> !;
    }
    const STANDARD_ERROR: c_int = 2;
    crate::claim_exit_message();
    let mut line = [0_u8; 256];
    let mut rest = &mut line[..];
    // What does not fit is left out; it does fit.
    let _ = writeln!(
        rest,
        "error: not enough memory: a request of {bytes} bytes was refused. Render fewer pixels or bands, use coarser meshes, or \
         raise the limit of the process (ulimit -v, the memory of its container)"
    );
    let unused = rest.len();
    let length = line.len() - unused;
    // SAFETY: the line is readable over its length. `_exit` ends the process at once, without running code that could ask for
    // memory; a line that can't be written is lost.
    unsafe {
        write(STANDARD_ERROR, line.as_ptr().cast(), length);
        _exit(1)
    }
}

/// `mi_option_purge_delay` of mimalloc.h: milliseconds that freed pages stay with the program.
const PURGE_DELAY: mi_option_t = 15;

/// `mi_option_arena_max_object_size` of mimalloc.h: KiB up to which memory comes from areas that are kept for later.
const ARENA_MAX_OBJECT_SIZE: mi_option_t = 45;

/// Gives freed pages back to the system as soon as they are free, instead of some time later: films and images are large,
/// and follow each other. The default experiment peaks at 1.1 GiB instead of 1.4 GiB, in the same time.
///
/// A program calls it first in `main`, before it starts threads. It does nothing unless [`Allocator`] is the global
/// allocator.
pub fn return_freed_memory_at_once() {
    const AT_ONCE: c_long = 0;
    // Parts of a film that are larger go back while the image is made of the others: areas of a GiB were seen to keep them.
    const LARGEST_KEPT_KIB: c_long = 16 << 10;
    // SAFETY: the option exists and takes any number. It is read as one aligned word, so an allocation that runs at the same
    // time sees the old delay or the new one.
    unsafe { mi_option_set(PURGE_DELAY, AT_ONCE) };
    // SAFETY: as above.
    unsafe { mi_option_set(ARENA_MAX_OBJECT_SIZE, LARGEST_KEPT_KIB) };
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
        // SAFETY: as above.
        let largest = || unsafe { mi_option_get(ARENA_MAX_OBJECT_SIZE) };
        assert!(delay() > 0 && largest() == 2 << 20);
        return_freed_memory_at_once();
        assert_eq!((delay(), largest()), (0, 16 << 10));
    }
}
