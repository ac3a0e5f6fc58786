//! Work that is ended from outside and keeps nothing of what it has: meshes, maps and tissues that are made before a render.
//!
//! A front gives the threads of a call a flag ([`listen_to`]), and long loops look at it ([`end_if_interrupted`]). What they have is
//! dropped with the stack, up to the front, which catches [`Interrupted`]. A render is stopped by its
//! [`RenderControl`](crate::render::RenderControl) instead: it keeps the samples so far.

use std::cell::RefCell;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What the stack of work that was ended unwinds with. It is no panic: no hook is called, and nothing is printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interrupted;

thread_local! {
    static STOP: RefCell<Option<Arc<AtomicBool>>> = const { RefCell::new(None) };
}

/// From here on a flag ends the work of this thread. Threads that were never given one are not ended.
pub fn listen_to(stop: Arc<AtomicBool>) {
    STOP.replace(Some(stop));
}

/// Ends the work of this thread if its flag asks for it: unwinds with [`Interrupted`]. Call it where nothing is left half done: within
/// a loop that makes a value, and under no lock.
pub fn end_if_interrupted() {
    let is_asked = STOP.with_borrow(|stop| stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed)));
    if is_asked {
        resume_unwind(Box::new(Interrupted));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    #[test]
    fn the_threads_of_a_pool_end_when_they_are_asked_to_and_work_again_afterwards() {
        let stop = Arc::new(AtomicBool::new(false));
        let flag = stop.clone();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2);
        let pool = pool.start_handler(move |_| listen_to(flag.clone())).build().unwrap();
        let sum = || {
            let one = |n: u64| {
                end_if_interrupted();
                if n == 500 {
                    stop.store(true, Ordering::Relaxed);
                }
                n
            };
            pool.install(|| (0..1000_u64).into_par_iter().map(one).sum::<u64>())
        };
        let ended = catch_unwind(AssertUnwindSafe(sum)).unwrap_err();
        assert!(ended.is::<Interrupted>());
        stop.store(false, Ordering::Relaxed);
        let all =
            pool.install(|| (0..1000_u64).into_par_iter().inspect(|_| end_if_interrupted()).sum::<u64>());
        assert_eq!(all, 499_500);
        // This thread has no flag
        stop.store(true, Ordering::Relaxed);
        end_if_interrupted();
    }
}
