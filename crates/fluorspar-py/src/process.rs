//! Threads, processes and Ctrl-C.

use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use fluorspar_cli::CommandFailure;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::{failed, of_command};

/// The process that imported the module.
static IMPORTED_BY: OnceLock<u32> = OnceLock::new();

/// How often Ctrl-C is looked for, and progress told.
const PERIOD: Duration = Duration::from_millis(20);

/// Remembers the process that imports the module.
pub(crate) fn remember() {
    IMPORTED_BY.get_or_init(std::process::id);
}

/// Uses the cache and the catalogue of the user, once.
///
/// # Errors
/// A folder of the environment that is no catalogue.
pub(crate) fn prepare(py: Python<'_>) -> PyResult<()> {
    static PREPARED: OnceLock<Result<(), CommandFailure>> = OnceLock::new();
    let prepared = PREPARED.get_or_init(fluorspar_cli::use_surroundings);
    match prepared {
        Ok(()) => Ok(()),
        Err(failure) => Err(of_command(py, failure)),
    }
}

/// Refuses to work in a child that was forked: threads of the parent are not there, and their locks may be held.
fn check_not_forked() -> PyResult<()> {
    if IMPORTED_BY.get().is_some_and(|id| *id != std::process::id()) {
        return Err(failed(
            "this process was forked from one that had imported fluorspar, and threads do not survive that. Start processes with \
             'spawn' or 'forkserver': multiprocessing.get_context(\"spawn\"); Dask and joblib (loky) do so by themselves",
        ));
    }
    Ok(())
}

/// The number of threads that is wanted: one for each core without a number.
fn thread_count(threads: Option<usize>) -> PyResult<usize> {
    const MOST: usize = 4096;
    match threads {
        None => Ok(std::thread::available_parallelism().map_or(1, NonZeroUsize::get)),
        Some(threads @ 1..=MOST) => Ok(threads),
        Some(other) => Err(PyValueError::new_err(format!("threads = {other}: must be between 1 and {MOST}"))),
    }
}

/// Runs some work in a thread pool of its own while the interpreter goes on, looks for Ctrl-C and calls `tell` now and then in the
/// calling thread. The first exception, of a signal or of `tell`, calls `stop`; the work then ends by itself. Returns what the work
/// returned and that exception.
///
/// # Errors
/// A forked process, no threads, a panic (which is a defect).
pub(crate) fn work<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    work: impl FnOnce() -> T + Send,
    stop: impl Fn(),
    mut tell: impl FnMut(Python<'_>) -> PyResult<()>,
) -> PyResult<(T, Option<PyErr>)> {
    check_not_forked()?;
    prepare(py)?;
    let count = thread_count(threads)?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(count)
        .build()
        .map_err(|error| failed(format!("can't start {count} threads: {error}")))?;
    let done = AtomicBool::new(false);
    let mut raised = None;
    let result = std::thread::scope(|scope| {
        let waiting = std::thread::current();
        let worker = scope.spawn({
            let (done, pool) = (&done, &pool);
            move || {
                let result = catch_unwind(AssertUnwindSafe(|| pool.install(work)));
                done.store(true, Ordering::SeqCst);
                waiting.unpark();
                result
            }
        });
        while !done.load(Ordering::SeqCst) {
            py.detach(|| std::thread::park_timeout(PERIOD));
            if raised.is_none() {
                raised = py.check_signals().and_then(|()| tell(py)).err();
                if raised.is_some() {
                    stop();
                }
            }
        }
        worker.join().unwrap_or_else(|panic| resume_unwind(panic))
    });
    match result {
        Ok(result) => Ok((result, raised)),
        Err(panic) => {
            let text = panic.downcast_ref::<&str>().map(ToString::to_string);
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
            Err(failed(format!(
                "this is a defect of Fluorspar: {text}. Please report the call and its input"
            )))
        }
    }
}

/// [`work`] that can't be stopped and tells nothing: an exception waits until it is done.
pub(crate) fn work_through<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    some: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    let (result, raised) = work(py, threads, some, || {}, |_| Ok(()))?;
    raised.map_or(Ok(result), Err)
}
