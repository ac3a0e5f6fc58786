//! Progress on standard error, Ctrl-C, films that survive it.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, Once};
use std::time::{Duration, Instant};

use fluorspar::format::{FormatError, Provenance, write_film, write_rgb_png};
use fluorspar::image::{ComponentImage, Film, SpectralImage};
use fluorspar::pipeline::radiance_preview;
use fluorspar::render::{FilmRenderer, FilmWatch, RenderControl, RenderProgress, RenderSettings, Share};
use fluorspar::scene::Scene;
use fluorspar::spectral::Radiance;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::error::CliError;

/// Rendering shall end: Ctrl-C, or the time limit.
static STOP: AtomicBool = AtomicBool::new(false);
/// The user pressed Ctrl-C.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);
static HANDLER: Once = Once::new();
/// A folder that is not finished: removed when the user stops for good.
static UNFINISHED: Mutex<Option<PathBuf>> = Mutex::new(None);

/// The first Ctrl-C ends the render with the best picture so far, the second ends the program.
pub(crate) fn catch_interrupts() {
    HANDLER.call_once(|| {
        let handler = || {
            STOP.store(true, Ordering::SeqCst);
            if INTERRUPTED.swap(true, Ordering::SeqCst) {
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

/// Whether the user asked to stop; a time limit that ran out does not count.
pub(crate) fn interrupted() -> bool {
    INTERRUPTED.load(Ordering::SeqCst)
}

/// Names the folder that is removed when the user quits at once.
pub(crate) fn set_unfinished(folder: Option<&Path>) {
    if let Ok(mut unfinished) = UNFINISHED.lock() {
        *unfinished = folder.map(Path::to_path_buf);
    }
}

/// What is written while a film is being filled.
#[derive(Debug, Default)]
pub(crate) struct Keep<'a> {
    /// Where the film is saved, and how often.
    pub(crate) film: Option<(&'a Path, Duration)>,
    /// What rides on it.
    pub(crate) provenance: Option<&'a Provenance>,
    /// A picture of the sum, renewed as it gets better.
    pub(crate) preview: Option<&'a Path>,
}

/// A picture can be looked at after this time at the latest.
const FIRST_PREVIEW: Duration = Duration::from_millis(700);
/// Making a preview takes at most this share of the time.
const PREVIEW_SHARE: u32 = 20;
/// Side of the first preview, coarse pixels.
const COARSE_SIDE: usize = 64;

/// When something is due next, seen from any thread.
struct Due(AtomicU64);

impl Due {
    fn at(time: Duration) -> Self {
        Self(AtomicU64::new(time.as_millis() as u64))
    }

    fn is_past(&self, elapsed: Duration) -> bool {
        elapsed.as_millis() as u64 >= self.0.load(Ordering::Relaxed)
    }

    fn set(&self, time: Duration) {
        self.0.store(time.as_millis() as u64, Ordering::Relaxed);
    }
}

/// Renders with a progress bar (or lines, where standard error is no terminal), Ctrl-C and a time limit.
pub(crate) fn render_with_progress(
    scene: &Scene,
    settings: &RenderSettings,
    time_limit_s: Option<f64>,
    quiet: bool,
) -> Result<ComponentImage, CliError> {
    let renderer = FilmRenderer::new(scene, settings)?;
    let mut film = renderer.new_film();
    fill_with_progress(&renderer, &Share::Whole, &mut film, time_limit_s, quiet, &Keep::default())?;
    drop(renderer);
    Ok(film.into_image())
}

/// Renders what a film lacks, and saves film and preview on the way and at the end. The time limit holds from the first
/// sample of every pixel on. Returns whether nothing is lacking.
pub(crate) fn fill_with_progress(
    renderer: &FilmRenderer<'_>,
    share: &Share,
    film: &mut Film,
    time_limit_s: Option<f64>,
    quiet: bool,
    keep: &Keep<'_>,
) -> Result<bool, CliError> {
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
    let samples = renderer.samples_of(share).len() as u64;
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
        // Pixels without any sample would be black, and numbers made from them wrong.
        let every_pixel_has_one = p.paths_done.saturating_mul(samples) >= p.paths_total;
        if every_pixel_has_one && time_limit_s.is_some_and(|limit| elapsed > limit) {
            STOP.store(true, Ordering::SeqCst);
        }
    };

    if let (Some(path), 0) = (keep.preview, film.paths()) {
        write_preview(path, &enlarged(&renderer.coarse_sum(COARSE_SIDE), film))?;
    }
    let film_due = keep.film.map(|(_, interval)| Due::at(interval));
    let preview_due = keep.preview.map(|_| Due::at(FIRST_PREVIEW));
    let due = || {
        let elapsed = started.elapsed();
        [&film_due, &preview_due].into_iter().flatten().any(|due| due.is_past(elapsed))
    };
    let mut failure = None;
    let mut look = |film: &Film| {
        let save = || -> Result<(), FormatError> {
            if let (Some(due), Some((path, interval))) = (&film_due, keep.film)
                && due.is_past(started.elapsed())
            {
                write_film(path, film, keep.provenance)?;
                due.set(started.elapsed() + interval);
            }
            if let (Some(due), Some(path)) = (&preview_due, keep.preview)
                && due.is_past(started.elapsed())
            {
                let begun = Instant::now();
                // Black holes of the first pass would be worse than coarse pixels.
                if film.least_samples() > 0 {
                    write_preview(path, &film.sum())?;
                }
                due.set(started.elapsed() + (PREVIEW_SHARE * begun.elapsed()).max(FIRST_PREVIEW));
            }
            Ok(())
        };
        failure = save().err();
        failure.is_none()
    };
    let control = RenderControl { stop: &STOP, progress: &progress };
    let filled = renderer.fill(share, film, &control, FilmWatch { due: &due, look: &mut look });
    bar.finish_and_clear();
    let complete = filled?;
    if let Some(error) = failure {
        return Err(error.into());
    }
    if let Some((path, _)) = keep.film {
        write_film(path, film, keep.provenance)?;
    }
    Ok(complete)
}

fn write_preview(path: &Path, sum: &SpectralImage<Radiance>) -> Result<(), FormatError> {
    let picture = radiance_preview(sum);
    write_rgb_png(path, picture.width, picture.height, &picture.rgb)
}

/// Coarse pixels at the size of the film.
fn enlarged(coarse: &SpectralImage<Radiance>, film: &Film) -> SpectralImage<Radiance> {
    let (width, height) = (film.layout().width, film.layout().height);
    let step = width.max(height).div_ceil(coarse.width().max(coarse.height()));
    let mut image = SpectralImage::zeros(coarse.grid().clone(), width, height);
    for row in 0..height {
        for col in 0..width {
            let (r, c) = ((row / step).min(coarse.height() - 1), (col / step).min(coarse.width() - 1));
            image.pixel_mut(row, col).copy_from_slice(coarse.pixel(r, c));
        }
    }
    image
}
