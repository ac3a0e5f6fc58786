//! Threads, processes and Ctrl-C.

use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use fluorspar::interruption::{Interrupted, listen_to};
use fluorspar_format::{FormatError, Output, Outputs, count_as_program, description_path};
use fluorspar_session::use_surroundings;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::ThreadPool;

use crate::error::failed;

/// The process that imported the module.
static IMPORTED_BY: OnceLock<u32> = OnceLock::new();

/// Writes a file under a name that ends as it must, in place of one that this program wrote at most.
pub(crate) fn write_new(
    path: &Path,
    endings: &[&str],
    write: impl FnOnce() -> Result<(), FormatError>,
) -> PyResult<()> {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if !endings.contains(&ending.as_str()) {
        let known = endings.iter().map(|ending| format!(".{ending}")).collect::<Vec<_>>().join(" or ");
        return Err(failed(format!("{}: end the name in {known}", path.display())));
    }
    let beside = description_path(path);
    let mut all = Outputs::new().and(Output::file("path", path));
    if beside.exists() && ending.starts_with("tif") {
        all = all.and(Output::file("path", &beside));
    }
    let set = all.declare().map_err(failed)?;
    write().and_then(|()| set.finish()).map_err(failed)
}

/// How often Ctrl-C is looked for, and progress told.
const PERIOD: Duration = Duration::from_millis(20);

/// Remembers the process that imports the module.
pub(crate) fn remember() {
    IMPORTED_BY.get_or_init(std::process::id);
}

/// Lets the cache tell builds of this module apart: the program that runs is the interpreter, which stays the same.
pub(crate) fn name_program(py: Python<'_>) -> PyResult<()> {
    let file: PathBuf = py.import("fluorspar._fluorspar")?.getattr("__file__")?.extract()?;
    count_as_program(file);
    Ok(())
}

/// Uses the cache and the catalogue of the user, once.
///
/// # Errors
/// A folder of the environment that is no catalogue.
pub(crate) fn prepare(py: Python<'_>) -> PyResult<()> {
    static PREPARED: OnceLock<Result<(), String>> = OnceLock::new();
    if PREPARED.get().is_none() {
        name_program(py)?;
    }
    let prepared = PREPARED.get_or_init(|| use_surroundings(true).map_err(|error| error.to_string()));
    prepared.as_ref().copied().map_err(failed)
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

/// Threads that work for one call at a time, and what ends their work where it keeps nothing.
struct Pool {
    count: usize,
    threads: ThreadPool,
    stop: Arc<AtomicBool>,
}

/// Pools that no call works in. A call has one to itself: a thread that waits for another in the same pool takes up what else there
/// is, and might wait there for what it had begun itself.
static IDLE: Mutex<Vec<Pool>> = Mutex::new(Vec::new());

/// Idle pools that are kept.
const MOST_IDLE: usize = 4;

/// A pool of so many threads: one that is idle, or a new one.
fn take_pool(count: usize) -> PyResult<Pool> {
    // What is held stays whole wherever a thread panics
    let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(found) = idle.iter().position(|pool| pool.count == count) {
        let pool = idle.swap_remove(found);
        pool.stop.store(false, Ordering::SeqCst);
        return Ok(pool);
    }
    drop(idle);
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    let threads = rayon::ThreadPoolBuilder::new().num_threads(count);
    let threads = threads.start_handler(move |_| listen_to(flag.clone())).build();
    let threads = threads.map_err(|error| failed(format!("can't start {count} threads: {error}")))?;
    Ok(Pool { count, threads, stop })
}

/// Keeps a pool for the next call.
fn give_back(pool: Pool) {
    let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
    if idle.len() == MOST_IDLE {
        idle.remove(0);
    }
    idle.push(pool);
}

/// Runs some work in a pool of threads while the interpreter goes on, looks for Ctrl-C and calls `tell` now and then in the
/// calling thread. The first exception, of a signal or of `tell`, calls `stop`; the work then ends by itself, with what it has, or where
/// it looks at [`fluorspar::interruption`], without. Returns what the work returned and that exception.
///
/// # Errors
/// That exception, where the work returned nothing; a forked process, no threads, a panic (which is a defect).
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
    let pool = take_pool(count)?;
    let done = AtomicBool::new(false);
    let mut raised = None;
    let result = std::thread::scope(|scope| {
        let waiting = std::thread::current();
        let worker = scope.spawn({
            let (done, pool) = (&done, &pool);
            move || {
                let result = catch_unwind(AssertUnwindSafe(|| pool.threads.install(work)));
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
                    pool.stop.store(true, Ordering::SeqCst);
                }
            }
        }
        worker.join().unwrap_or_else(|panic| resume_unwind(panic))
    });
    give_back(pool);
    match (result, raised) {
        (Ok(result), raised) => Ok((result, raised)),
        (Err(payload), Some(raised)) if payload.is::<Interrupted>() => Err(raised),
        (Err(panic), _) => {
            let text = panic.downcast_ref::<&str>().map(ToString::to_string);
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
            let error = failed(format!(
                "this is a defect of Fluorspar: {text}. Please report the call and its input"
            ));
            error.value(py).setattr("code", 1)?;
            Err(error)
        }
    }
}

/// [`work`] that tells nothing, and ends early only where it looks at [`fluorspar::interruption`]: otherwise an exception waits until
/// it is done.
pub(crate) fn work_through<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    some: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    let (result, raised) = work(py, threads, some, || {}, |_| Ok(()))?;
    raised.map_or(Ok(result), Err)
}
