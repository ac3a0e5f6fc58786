//! Work of one kind, one at a time, that ends when nobody waits for it any more.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use fluorspar::interruption::{Interrupted, listen_to};
use fluorspar_session::{Error, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};
use tokio::sync::Mutex as Turn;

/// A queue with threads of its own, which listen to its flag.
pub(crate) struct Lane {
    pool: Arc<ThreadPool>,
    now: Arc<Running>,
    turn: Arc<Turn<()>>,
    serial: AtomicU64,
}

/// The work that runs, and the flag that ends it.
#[derive(Default)]
struct Running {
    serial: Mutex<u64>,
    stop: Arc<AtomicBool>,
}

impl Running {
    fn begin(&self, serial: u64) {
        let mut running = self.serial.lock().unwrap_or_else(PoisonError::into_inner);
        *running = serial;
        self.stop.store(false, Ordering::SeqCst);
    }

    /// Ends a piece of work, if it is the one that runs.
    fn end(&self, serial: u64) {
        // Held until the flag is set: the next piece of work may begin meanwhile
        let running = self.serial.lock().unwrap_or_else(PoisonError::into_inner);
        if *running == serial {
            self.stop.store(true, Ordering::SeqCst);
        }
    }
}

/// Ends its work when it is dropped: with the request, whose connection the browser closes.
struct Waiting {
    now: Arc<Running>,
    serial: u64,
}

impl Drop for Waiting {
    fn drop(&mut self) {
        self.now.end(self.serial);
    }
}

impl Lane {
    /// # Errors
    /// A system that gives no threads.
    pub(crate) fn new() -> Result<Self> {
        let now = Arc::new(Running::default());
        let stop = Arc::clone(&now.stop);
        let pool = ThreadPoolBuilder::new().start_handler(move |_| listen_to(Arc::clone(&stop)));
        let pool = pool.build().map_err(|error| Error::Failed(format!("no threads: {error}")))?;
        Ok(Self { pool: Arc::new(pool), now, turn: Arc::default(), serial: AtomicU64::new(1) })
    }

    /// Does work when its turn comes. A future that is dropped ends its work where that looks at the flag.
    ///
    /// # Errors
    /// What the work unwinds with: [`Interrupted`], or a panic.
    pub(crate) async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> std::result::Result<T, Box<dyn Any + Send>> {
        let turn = Arc::clone(&self.turn).lock_owned().await;
        let serial = self.serial.fetch_add(1, Ordering::Relaxed);
        self.now.begin(serial);
        let _waiting = Waiting { now: Arc::clone(&self.now), serial };
        let pool = Arc::clone(&self.pool);
        let done = tokio::task::spawn_blocking(move || {
            let done = catch_unwind(AssertUnwindSafe(|| pool.install(work)));
            drop(turn);
            done
        });
        done.await.unwrap_or_else(|_| Err(Box::new(Interrupted)))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "these are tests")]
mod tests {
    use std::time::{Duration, Instant};

    use fluorspar::interruption::end_if_interrupted;

    use super::*;

    #[test]
    fn work_ends_within_a_tenth_of_a_second_when_nobody_waits_for_it() {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
        let lane = Arc::new(Lane::new().unwrap());
        let slow = || {
            let begun = Instant::now();
            while begun.elapsed() < Duration::from_secs(20) {
                end_if_interrupted();
                std::thread::sleep(Duration::from_millis(2));
            }
        };
        runtime.block_on(async {
            let dropped = tokio::time::timeout(Duration::from_millis(50), lane.run(slow)).await;
            assert!(dropped.is_err());
            let begun = Instant::now();
            // What comes next waits for its end, and is not ended itself
            let next = lane.run(|| {
                end_if_interrupted();
                7
            });
            assert_eq!(next.await.unwrap(), 7);
            assert!(begun.elapsed() < Duration::from_millis(100), "{:?}", begun.elapsed());
        });
    }
}
