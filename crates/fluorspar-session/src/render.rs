//! Renders that a job stops and that say how far they are; films that survive that.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use fluorspar::image::{Component, ComponentImage, ExcitationImage, Film, SpectralImage};
use fluorspar::pipeline::{radiance_preview, render_with_basis};
use fluorspar::render::{
    BasisSettings, Checkpoint, FilmRenderer, RenderControl, RenderProgress, RenderSettings, Share,
};
use fluorspar::scene::Scene;
use fluorspar::spectral::Radiance;
use fluorspar::study::Study;
use fluorspar_format::{FormatError, Provenance, write_film, write_rgb_png};

use crate::{Error, Job, Left, Result, say_time, seconds_of};

/// Files that are written during a render.
pub struct Keep<'a> {
    /// Path of the film, and the interval of its checkpoints.
    pub film: Option<(&'a Path, Duration)>,
    /// Provenance of the film.
    pub provenance: Option<&'a Provenance>,
    /// Preview of the sum, updated during the render.
    pub preview: Option<&'a Path>,
    /// What a component counts in the preview.
    pub weight: &'a (dyn Fn(&Component) -> f64 + Sync),
    /// What is left of a render that is interrupted.
    pub left: Left,
}

impl Default for Keep<'_> {
    fn default() -> Self {
        Self { film: None, provenance: None, preview: None, weight: &|_| 1.0, left: Left::default() }
    }
}

/// Longest time until the first preview.
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

/// Renders until all samples are there, the time limit is over or the job is stopped.
///
/// # Errors
/// A scene that can't be rendered; a time limit in which not even the first sample of every pixel gets done.
pub fn render_scene(
    scene: &Scene,
    settings: &RenderSettings,
    time_limit_s: Option<f64>,
    job: &Job,
) -> Result<ComponentImage> {
    let renderer = FilmRenderer::new(scene, settings)?;
    let mut film = renderer.new_film();
    fill_film(&renderer, &Share::Whole, &mut film, time_limit_s, job, &Keep::default())?;
    let image = film.into_image();
    if job.listener.hears_status() && !job.is_interrupted() {
        say_basis(&renderer, &image, job);
    }
    Ok(image)
}

/// Tells in how many bands components are kept, and what error that leaves.
fn say_basis(renderer: &FilmRenderer, image: &ComponentImage, job: &Job) {
    let (pixels, count) = (image.width * image.height, image.components.len());
    let stored = image.stored_values() / pixels.max(1);
    if stored == count * image.grid.len() {
        return;
    }
    job.status(format!(
        "Components are kept in {:.0} of {} bands, from which the others follow to {:.3} %, measured",
        stored as f64 / count.max(1) as f64,
        image.grid.len(),
        100.0 * renderer.basis_error(image)
    ));
}

/// Renders what a film lacks, and saves film and preview on the way and at the end. The time limit holds from the first
/// sample of every pixel on. Returns whether nothing is lacking.
///
/// # Errors
/// As [`render_scene`]; files that can't be written.
pub fn fill_film(
    renderer: &FilmRenderer,
    share: &Share,
    film: &mut Film,
    time_limit_s: Option<f64>,
    job: &Job,
    keep: &Keep<'_>,
) -> Result<bool> {
    // Of bands of rows the time of all is said before.
    let is_part = matches!(share, Share::TileRange(_));
    if !is_part && (job.listener.hears_status() || time_limit_s.is_some()) {
        let lacking = seconds_of(renderer, share, Some(film));
        say_time(lacking, renderer.samples_of(share).len() as u32, time_limit_s, job)?;
    }
    let share_done = job.listener.begin("Rendering", "rendering", keep.left);
    let started = Instant::now();
    let samples = renderer.samples_of(share).len() as u64;
    let progress = |p: RenderProgress| {
        share_done(p.paths_done as f64 / p.paths_total.max(1) as f64);
        // Pixels without any sample would be black, and numbers made from them wrong.
        let every_pixel_has_one = p.paths_done.saturating_mul(samples) >= p.paths_total;
        if every_pixel_has_one && time_limit_s.is_some_and(|limit| started.elapsed().as_secs_f64() > limit) {
            job.end_by_time();
        }
    };

    if let (Some(path), 0) = (keep.preview, film.paths()) {
        let coarse = renderer.coarse_sum(COARSE_SIDE, |component| (keep.weight)(component));
        write_preview(path, &enlarged(&coarse, film))?;
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
                    write_preview(path, &film.sum(|component| (keep.weight)(component)))?;
                }
                due.set(started.elapsed() + (PREVIEW_SHARE * begun.elapsed()).max(FIRST_PREVIEW));
            }
            Ok(())
        };
        failure = save().err();
        failure.is_none()
    };
    let control = RenderControl { stop: &job.stop, progress: &progress };
    let filled = renderer.fill(share, film, &control, Checkpoint { is_due: &due, on_pause: &mut look });
    drop(share_done);
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

/// Renders with the excitation basis of the settings, in bands of rows where its film does not fit into memory at once.
///
/// # Errors
/// As [`render_scene`]; a render that ends before every row has its samples.
pub fn render_with_excitation_basis(
    study: &Study,
    basis: &BasisSettings,
    job: &Job,
) -> Result<(ComponentImage, ExcitationImage)> {
    let (scene, settings) = (&study.scene, &study.render);
    let names: Vec<&str> =
        basis.groups.iter().map(|group| scene.light_groups[*group].name.as_str()).collect();
    let [first, last] = basis.nodes.span_nm();
    job.status(format!(
        "Excitation basis: {} nodes from {first} to {last} nm for the light of {}",
        basis.nodes.len(),
        names.join(", ")
    ));
    let renderer = FilmRenderer::for_rows(scene, settings)?;
    if job.listener.hears_status() {
        say_time(seconds_of(&renderer, &Share::Whole, None), settings.samples_per_pixel, None, job)?;
    }
    let rendered = render_with_basis(&renderer, settings, scene, |share, film| {
        fill_film(&renderer, share, film, study.time_limit_s, job, &Keep::default())
    })?;
    let Some((image, basis)) = rendered else {
        let what = if job.is_interrupted() { "interrupted" } else { "ended by the time limit" };
        return Err(Error::Stopped(format!(
            "{what} before every row had its samples: an excitation basis needs all of them, and nothing was written"
        )));
    };
    for group in &basis.groups {
        let spectra = group.components.iter().map(|component| component.rank);
        job.status(format!(
            "Light of {}: {} spectra hold every wavelength of excitation, with an error of {:.2} % at most",
            group.light_group,
            spectra.sum::<usize>(),
            100.0 * group.error()
        ));
    }
    Ok((image, basis))
}
