//! Ctrl-C and requests to end: what was rendered is saved, and nothing unfinished is left behind.

use std::cell::RefCell;
#[cfg(unix)]
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, LazyLock};

#[cfg(unix)]
use fluorspar_format::read_text_bounded;

use fluorspar_session::Left;

use crate::error::STOPPED;
use crate::message;

/// The command of the program shall end: Ctrl-C, a request to end, or the time limit of a render.
static STOP: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

thread_local! {
    /// What ends the command of this thread, where it is not that of the program.
    static OWN_STOP: RefCell<Option<Arc<AtomicBool>>> = const { RefCell::new(None) };
}

/// What ends the command of this thread.
pub(crate) fn stop_flag() -> Arc<AtomicBool> {
    OWN_STOP.with_borrow(|own| own.clone()).unwrap_or_else(|| STOP.clone())
}

/// Does some work that a flag ends.
pub(crate) fn stopped_by<T>(stop: Arc<AtomicBool>, work: impl FnOnce() -> T) -> T {
    let before = OWN_STOP.replace(Some(stop));
    let returned = work();
    OWN_STOP.replace(before);
    returned
}

/// A signal requested the end of the program.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);
/// What is left of the render in work, as [`Left`].
static RENDERS: AtomicU8 = AtomicU8::new(0);

/// From here on the first Ctrl-C ends a render with the best image so far; the second, and the first where nothing is
/// rendered, ends the program. SIGTERM and SIGHUP count as Ctrl-C, unless they were ignored when the program started, as
/// `nohup` has it.
pub(crate) fn catch_interrupts() {
    if let Err(error) = listen() {
        let what = "Ctrl-C will end the program at once and may leave unfinished files";
        message::notice(format!("warning: {what}: {error}"));
    }
}

#[cfg(unix)]
fn listen() -> std::io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};

    let ignored = ignored_signals();
    let wanted = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| ignored & (1 << (signal - 1)) == 0);
    // A file that grows beyond a limit shall fail to be written, which can be told; the signal alone would end the program.
    let mut signals = signal_hook::iterator::Signals::new(wanted.chain([SIGXFSZ]))?;
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        for signal in signals.forever() {
            if signal != SIGXFSZ {
                interrupt();
            }
        }
    })?;
    Ok(())
}

#[cfg(not(unix))]
fn listen() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(interrupt)
}

/// Signals that this process was started to ignore, bit by bit from 1; none where the system does not tell (it is Linux that
/// does).
#[cfg(unix)]
fn ignored_signals() -> u64 {
    let status = read_text_bounded(Path::new("/proc/self/status"), 1 << 20).unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

/// Whether the first request to end is the usual end of the command, as of one that serves.
static SERVES: AtomicBool = AtomicBool::new(false);

/// From here on the first Ctrl-C is the usual end of the command, which looks at [`stop_flag`].
pub(crate) fn serve_until_interrupted() {
    SERVES.store(true, Ordering::SeqCst);
}

fn interrupt() {
    STOP.store(true, Ordering::SeqCst);
    let again = INTERRUPTED.swap(true, Ordering::SeqCst);
    if SERVES.load(Ordering::SeqCst) && !again {
        return;
    }
    let left = RENDERS.load(Ordering::SeqCst);
    if again || left == Left::Nothing as u8 {
        fluorspar_format::remove_unfinished_files();
        message::notice(if again {
            "\nstopped at once"
        } else {
            "\nstopped before there was anything to keep"
        });
        std::process::exit(i32::from(STOPPED));
    }
    let what = match left {
        _ if left == Left::Film as u8 => "film so far will be saved",
        _ if left == Left::Results as u8 => "results so far will be given",
        _ => "image so far will be saved",
    };
    message::notice(format!("\nstopping: the {what}. Press Ctrl-C again to quit at once"));
}

/// Says what there is to save, from now on, when the program is asked to end.
pub(crate) fn save_when_interrupted(left: Left) {
    RENDERS.store(left as u8, Ordering::SeqCst);
}

/// Whether the user stopped the render; an expired time limit does not count.
pub(crate) fn interrupted() -> bool {
    INTERRUPTED.load(Ordering::SeqCst)
}
