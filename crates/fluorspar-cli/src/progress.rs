//! Progress on standard error, and Ctrl-C.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, Once};
use std::time::{Duration, Instant};

use fluorspar::image::ComponentImage;
use fluorspar::render::{RenderControl, RenderError, RenderProgress, RenderSettings, render};
use fluorspar::scene::Scene;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

static STOP: AtomicBool = AtomicBool::new(false);
static HANDLER: Once = Once::new();
/// A folder that is not finished: removed when the user stops for good.
static UNFINISHED: Mutex<Option<PathBuf>> = Mutex::new(None);

/// The first Ctrl-C ends the render with the best picture so far, the second ends the program.
pub(crate) fn catch_interrupts() {
    HANDLER.call_once(|| {
        let handler = || {
            if STOP.swap(true, Ordering::SeqCst) {
                if let Ok(folder) = UNFINISHED.lock()
                    && let Some(path) = folder.as_deref()
                {
                    // Nothing more can be done about a folder that won't go away.
                    let _ = std::fs::remove_dir_all(path);
                }
                std::process::exit(1);
            }
            eprintln!("\nstopping: the picture so far will be saved. Press Ctrl-C again to quit at once");
        };
        if let Err(error) = ctrlc::set_handler(handler) {
            eprintln!("warning: Ctrl-C will end the program at once: {error}");
        }
    });
}

/// Whether the user asked to stop.
pub(crate) fn interrupted() -> bool {
    STOP.load(Ordering::SeqCst)
}

/// Names the folder that is removed when the user quits at once.
pub(crate) fn set_unfinished(folder: Option<&Path>) {
    if let Ok(mut unfinished) = UNFINISHED.lock() {
        *unfinished = folder.map(Path::to_path_buf);
    }
}

/// Renders with a progress bar (or lines, where standard error is no terminal), Ctrl-C and a time limit.
pub(crate) fn render_with_progress(
    scene: &Scene,
    settings: &RenderSettings,
    time_limit_s: Option<f64>,
    quiet: bool,
) -> Result<ComponentImage, RenderError> {
    catch_interrupts();
    let started = Instant::now();
    let lines = !std::io::stderr().is_terminal();
    let bar = ProgressBar::new(1000);
    if quiet || lines {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    if let Ok(style) =
        ProgressStyle::with_template("{msg} [{bar:32}] {percent:>3} %  {elapsed} gone, {eta} left")
    {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_message("Rendering");
    bar.enable_steady_tick(Duration::from_millis(200));
    let tenths = AtomicU64::new(0);
    let progress = |p: RenderProgress| {
        let share = p.paths_done as f64 / p.paths_total.max(1) as f64;
        bar.set_position((1000.0 * share) as u64);
        let elapsed = started.elapsed().as_secs_f64();
        if lines && !quiet {
            let tenth = (10.0 * share) as u64;
            if tenths.fetch_max(tenth, Ordering::Relaxed) < tenth {
                let left = elapsed * (1.0 - share) / share;
                eprintln!("Rendering {:>3} %, {elapsed:.0} s gone, {left:.0} s left", tenth * 10);
            }
        }
        if time_limit_s.is_some_and(|limit| elapsed > limit) {
            STOP.store(true, Ordering::SeqCst);
        }
    };
    let image = render(scene, settings, &RenderControl { stop: &STOP, progress: &progress });
    bar.finish_and_clear();
    image
}
