//! Progressive tile renderer: multithreaded, resumable, pass by pass.

use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use rayon::prelude::*;

use super::adaptive::TileError;
use super::block_sum::BlockSum;
use super::compiled_scene::CompiledScene;
use super::error::RenderError;
use super::feature_maps::feature_maps;
use super::memory::{check_memory, memory_bytes, request_memory, tile_row_bytes, whole_image_bytes};
use super::pilot::{film_layout, trial_paths};
use super::scene_digest::scene_digest;
use super::settings::{ComponentBands, RenderSettings};
use super::share::Share;
use crate::image::film::{
    BlockSign, FilmScale, FilmTile, TileMut, block_end, block_start, is_block_boundary,
};
use crate::image::{Component, ComponentImage, FeatureMaps, Film, FilmLayout, SpectralImage};
use crate::scene::Scene;
use crate::spectral::Radiance;

/// Passes grow to this many samples: bounds the wait after a request to stop.
const LARGEST_PASS: u32 = 64;

/// How far a render has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderProgress {
    /// Paths finished.
    pub paths_done: u64,
    /// Paths in all.
    pub paths_total: u64,
}

/// Reporting and interruption of a render.
pub struct RenderControl<'a> {
    /// Set to stop: the image so far is returned.
    pub stop: &'a AtomicBool,
    /// Called now and then, from any thread.
    pub progress: &'a (dyn Fn(RenderProgress) + Sync),
}

/// Pauses of a render, in which its film is saved or shown.
pub struct Checkpoint<'a> {
    /// Called after every tile, from any thread: whether to pause.
    pub is_due: &'a (dyn Fn() -> bool + Sync),
    /// Called with the film while the render pauses; `false` ends the render.
    pub on_pause: &'a mut dyn FnMut(&Film) -> bool,
}

/// Renders radiance, every component apart.
///
/// The result depends on scene, settings and seed only, never on the number of threads or on timing; an interrupted
/// render returns the samples it has.
///
/// # Errors
/// A scene that is not physical, settings out of range, images larger than the memory limit, or no memory.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    control: &RenderControl<'_>,
) -> Result<ComponentImage, RenderError> {
    Ok(render_sums(scene, settings, control)?.into_image())
}

/// [`render`] but for its last step, [`Film::into_image`]: after a stop the sums are there at once.
///
/// The film does not know its scene: no [`FilmRenderer`] continues it.
///
/// # Errors
/// As [`render`].
pub fn render_sums(
    scene: &Scene,
    settings: &RenderSettings,
    control: &RenderControl<'_>,
) -> Result<Film, RenderError> {
    let renderer = FilmRenderer::new(scene, settings)?;
    let layout = film_layout(&renderer.compiled, scene, settings, String::new());
    let mut film = Film::new(layout, renderer.features());
    let checkpoint = Checkpoint { is_due: &|| false, on_pause: &mut |_| true };
    fill(&renderer.compiled, settings, &Share::default(), &mut film, control, checkpoint);
    Ok(film)
}

/// A scene made ready for rendering on films: what [`render`] does in one go, step by step.
pub struct FilmRenderer {
    compiled: CompiledScene,
    scene: Scene,
    settings: RenderSettings,
    /// [`scene_digest`], computed on first use: large scenes take a while.
    digest: OnceLock<String>,
}

impl FilmRenderer {
    /// Checks and prepares a scene, of which it keeps a copy that shares its meshes and images.
    ///
    /// # Errors
    /// As [`render`].
    pub fn new(scene: &Scene, settings: &RenderSettings) -> Result<Self, RenderError> {
        check_memory(scene, settings)?;
        request_memory(scene, memory_bytes(scene, settings))?;
        Self::prepared(scene, settings)
    }

    /// Checks and prepares a scene for films of some rows at a time ([`Film::of_tile_rows`]); whether those fit into the
    /// memory limit is for the caller to see to.
    ///
    /// # Errors
    /// As [`render`], but for images larger than the memory limit.
    pub fn for_rows(scene: &Scene, settings: &RenderSettings) -> Result<Self, RenderError> {
        request_memory(scene, whole_image_bytes(scene).saturating_add(tile_row_bytes(scene, settings)))?;
        Self::prepared(scene, settings)
    }

    fn prepared(scene: &Scene, settings: &RenderSettings) -> Result<Self, RenderError> {
        let compiled = prepare(scene, settings)?;
        Ok(Self { compiled, scene: scene.clone(), settings: settings.clone(), digest: OnceLock::new() })
    }

    /// An empty film.
    pub fn new_film(&self) -> Film {
        Film::new(self.layout(), self.features())
    }

    /// Layout of the films. Renders pilot samples to find the quanta.
    pub fn layout(&self) -> FilmLayout {
        film_layout(&self.compiled, &self.scene, &self.settings, self.digest().into())
    }

    fn digest(&self) -> &str {
        self.digest.get_or_init(|| scene_digest(&self.scene, &self.settings))
    }

    /// Geometry behind each pixel.
    pub fn features(&self) -> FeatureMaps {
        feature_maps(&self.compiled, &self.scene)
    }

    /// Memory that the surfaces take, with the trees through which rays find them, bytes.
    pub fn surface_bytes(&self) -> u64 {
        self.compiled.surface_bytes()
    }

    /// Refuses a film that this scene and these settings can't continue.
    ///
    /// # Errors
    /// A film of another scene, seed, depth or version, or of other statistics.
    pub fn check(&self, film: &Film) -> Result<(), RenderError> {
        self.check_layout(film.layout())
    }

    /// Refuses what the films of another render are made for.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn check_layout(&self, layout: &FilmLayout) -> Result<(), RenderError> {
        if layout.scene_digest != self.digest() {
            return Err(RenderError::OtherScene);
        }
        let wanted = self.settings.film_statistics();
        if layout.statistics != wanted {
            return Err(RenderError::OtherStatistics { film: layout.statistics, wanted });
        }
        if layout.bases.is_empty() != (self.settings.film_bands() == ComponentBands::All) {
            return Err(RenderError::OtherStorage);
        }
        Ok(())
    }

    /// Renders the samples of a share that a film does not hold yet, up to `samples_per_pixel`; returns whether all of
    /// them are there now (they are not when the render was stopped).
    ///
    /// The film afterwards is the same to the last bit whatever was in it before: nothing, a part that an interrupted
    /// render left, or the samples of a shorter render.
    ///
    /// # Errors
    /// As [`Self::check`], and for shares that do not exist or reach beyond the rows that the film was made for. The film
    /// is unchanged then.
    pub fn fill(
        &self,
        share: &Share,
        film: &mut Film,
        control: &RenderControl<'_>,
        checkpoint: Checkpoint<'_>,
    ) -> Result<bool, RenderError> {
        self.check(film)?;
        share.check(&self.settings)?;
        let len = film.pixel_len();
        let without = |(number, (tile, sums)): &(usize, (&FilmTile, &[u64]))| {
            share.holds(*number) && sums.len() < tile.pixels() * len
        };
        let without = film.tiles().enumerate().find(without);
        if let Some((_, (tile, _))) = without {
            return Err(RenderError::OutsideRows { row: tile.row, col: tile.col });
        }
        Ok(fill(&self.compiled, &self.settings, share, film, control, checkpoint))
    }

    /// Traces some thousand paths all over the image, for a caller that times them, and forgets them. Returns their number.
    pub fn trial_paths(&self) -> usize {
        trial_paths(&self.compiled, &self.settings)
    }

    /// Error that the bases of a finished image leave, measured: some pixels are rendered again with all bands. Root mean square over
    /// their bands, relative to the light: the larger one of the reflected light and of the fluorescence of any light group; 0 where all
    /// bands are stored.
    pub fn basis_error(&self, image: &ComponentImage) -> f64 {
        if image.bases.iter().all(Option::is_none) {
            return 0.0;
        }
        // A hundredth of the work of the render at most
        let side = ((image.width * image.height) as f64 / 100.0).sqrt().clamp(1.0, 16.0) as usize;
        let (bands, kinds) = (self.compiled.bands, self.compiled.fluorophores + 2);
        let at = |number: usize, size: usize| (2 * number + 1) * size / (2 * side);
        // Squares of error and of light, of both kinds of each light group
        let squares = |block: &mut BlockSum, number: usize| -> Vec<[f64; 2]> {
            let (row, col) = (at(number / side, image.height), at(number % side, image.width));
            let pixel = row * image.width + col;
            let samples = image.samples.get(pixel).copied().unwrap_or(image.samples_per_pixel);
            block.render(&self.compiled, &self.settings, std::iter::once((row, col)), 0..samples);
            let mut sums = vec![[0.0_f64; 2]; 2 * image.components.len() / kinds * bands];
            for (component, of_component) in block.values.chunks_exact(bands).enumerate() {
                let kind = 2 * (component / kinds) + usize::from(component % kinds > 0);
                let pairs = image.spectrum(component, pixel);
                for ((sum, of_all), kept) in
                    sums[kind * bands..][..bands].iter_mut().zip(of_component).zip(pairs.iter())
                {
                    let light = f64::from(*of_all) / f64::from(samples.max(1));
                    *sum = [sum[0] + light - f64::from(*kept), sum[1] + light];
                }
            }
            sums.chunks_exact(bands).map(|of_kind| of_kind.iter().fold([0.0; 2], add_squares)).collect()
        };
        let pixels = (0..side * side).into_par_iter();
        let found: Vec<Vec<[f64; 2]>> = pixels
            .map_init(|| BlockSum::new(&self.compiled), |block, number| squares(block, number))
            .collect();
        let kinds = found.first().map_or(0, Vec::len);
        let all = (0..kinds).map(|kind| {
            found.iter().fold([0.0; 2], |sum: [f64; 2], of| [sum[0] + of[kind][0], sum[1] + of[kind][1]])
        });
        all.map(|[error, light]| if light > 0.0 { (error / light).sqrt() } else { 0.0 }).fold(0.0, f64::max)
    }

    /// Paths that a film lacks of a share; with an error target it is the most that may be traced.
    pub fn missing_paths(&self, share: &Share, film: Option<&Film>) -> u64 {
        let camera = &self.compiled.camera;
        let parts = match share {
            Share::Tiles { count, .. } => *count,
            _ => 1,
        };
        let samples = self.samples_of(share).len() as u64;
        let wanted = (camera.width * camera.height) as u64 * samples / u64::from(parts.max(1));
        let held = film.map_or(0, Film::paths);
        wanted.saturating_sub(held)
    }

    /// Samples of each pixel that a share is to hold in the end.
    pub fn samples_of(&self, share: &Share) -> Range<u32> {
        share.samples(self.settings.samples_per_pixel)
    }

    /// The sum of all components, each times its `weight`, in coarse pixels, at most `side` along each side of the image, one sample each: shown
    /// while the first samples of the film are not there yet.
    pub fn coarse_sum(&self, side: usize, weight: impl Fn(&Component) -> f64) -> SpectralImage<Radiance> {
        let weights: Vec<f32> = self.layout().components.iter().map(|c| weight(c) as f32).collect();
        let camera = &self.compiled.camera;
        let step = camera.width.max(camera.height).div_ceil(side.max(1));
        let (width, height) = (camera.width.div_ceil(step), camera.height.div_ceil(step));
        let bands = self.compiled.bands;
        let mut image = SpectralImage::zeros(self.compiled.grid.clone(), width, height);
        image.data_mut().par_chunks_mut(bands * width).enumerate().for_each_init(
            || BlockSum::new(&self.compiled),
            |block, (row, pixels)| {
                for (col, pixel) in pixels.chunks_mut(bands).enumerate() {
                    let at = |i: usize, size: usize| (i * step + step / 2).min(size - 1);
                    let (row, col) = (at(row, camera.height), at(col, camera.width));
                    block.render(&self.compiled, &self.settings, std::iter::once((row, col)), 0..1);
                    for (component, weight) in block.values.chunks(bands).zip(&weights) {
                        pixel.iter_mut().zip(component).for_each(|(sum, value)| *sum += weight * value);
                    }
                }
            },
        );
        image
    }
}

fn add_squares(sum: [f64; 2], values: &[f64; 2]) -> [f64; 2] {
    [sum[0] + values[0] * values[0], sum[1] + values[1] * values[1]]
}

/// Checks a scene and compiles it.
fn prepare(scene: &Scene, settings: &RenderSettings) -> Result<CompiledScene, RenderError> {
    scene.check()?;
    settings.check()?;
    if let Some(target) = &settings.error_target {
        target.check(scene.grid.len(), scene.light_groups.len())?;
    }
    Ok(CompiledScene::new(scene, settings)?)
}

/// Renders what is missing, pass by pass; `false` if it was stopped before the end.
fn fill(
    scene: &CompiledScene,
    settings: &RenderSettings,
    share: &Share,
    film: &mut Film,
    control: &RenderControl<'_>,
    checkpoint: Checkpoint<'_>,
) -> bool {
    let layout = film.layout().clone();
    let samples = share.samples(settings.samples_per_pixel);
    let target = TileError::new(settings.error_target.as_ref(), &layout);

    // Count the paths that are wanted and those that the film holds already
    let mut paths_total = 0;
    let mut converged = Vec::new();
    let done = AtomicU64::new(0);
    for (index, (tile, _)) in film.tiles().enumerate() {
        converged.push(AtomicBool::new(!share.holds(index)));
        if share.holds(index) {
            let held = end_of(&tile.samples, &samples) - samples.start;
            done.fetch_add(tile.pixels() as u64 * u64::from(held), Ordering::Relaxed);
            paths_total += tile.pixels() as u64 * u64::from(samples.end - samples.start);
        }
    }

    // Double the samples of every pixel, pass by pass
    let mut last = samples.start;
    let mut pass = 1;
    while last < samples.end {
        last = block_end(last + pass - 1).min(samples.end);
        pass = if last - samples.start < LARGEST_PASS { last - samples.start } else { LARGEST_PASS };
        loop {
            // Render the tiles that lack samples of this pass, until all are done or a checkpoint is due
            let pause = AtomicBool::new(false);
            let mut tasks = film.tiles_mut();
            tasks.retain(|task| {
                !converged[task.number].load(Ordering::Relaxed) && end_of(&task.tile.samples, &samples) < last
            });
            tasks.par_iter_mut().for_each_init(
                || TileWorker::new(scene, settings, &layout, control.stop),
                |worker, task| {
                    if control.stop.load(Ordering::Relaxed) || pause.load(Ordering::Relaxed) {
                        return;
                    }
                    let first = end_of(&task.tile.samples, &samples);
                    let mut saved = last - first;
                    if target.is_met(&worker.scale, task.tile, task.sums) {
                        converged[task.number].store(true, Ordering::Relaxed);
                        saved = samples.end - first;
                    } else {
                        while let Some(range) = next_missing(&task.tile.samples, &samples, last) {
                            if !worker.fill_tile(task, range) {
                                return;
                            }
                        }
                    }
                    let paths = task.tile.pixels() as u64 * u64::from(saved);
                    let paths_done = done.fetch_add(paths, Ordering::Relaxed) + paths;
                    (control.progress)(RenderProgress { paths_done, paths_total });
                    if (checkpoint.is_due)() {
                        pause.store(true, Ordering::Relaxed);
                    }
                },
            );
            drop(tasks);

            // Stop, pause, or go to the next pass
            if control.stop.load(Ordering::Relaxed) {
                return done.load(Ordering::Relaxed) >= paths_total;
            }
            if !pause.load(Ordering::Relaxed) {
                break;
            }
            if !(checkpoint.on_pause)(film) {
                return done.load(Ordering::Relaxed) >= paths_total;
            }
        }
    }
    true
}

/// End of the samples that a tile holds from the start of `wanted` on, within `wanted`.
fn end_of(held: &[Range<u32>], wanted: &Range<u32>) -> u32 {
    let range = held.iter().find(|range| range.start <= wanted.start && range.end > wanted.start);
    range.map_or(wanted.start, |range| range.end.min(wanted.end))
}

/// The next samples to render on the way to `last`: up to there, or up to samples that are held already.
fn next_missing(held: &[Range<u32>], wanted: &Range<u32>, last: u32) -> Option<Range<u32>> {
    let first = end_of(held, wanted);
    let next = held.iter().map(|range| range.start).find(|&start| start > first);
    (first < last).then(|| first..next.map_or(last, |start| start.min(last)))
}

/// What one thread needs to render tiles.
struct TileWorker<'a> {
    scene: &'a CompiledScene,
    settings: &'a RenderSettings,
    stop: &'a AtomicBool,
    block: BlockSum,
    scale: FilmScale,
    /// Sums of a tile before the block that is being added.
    before: Vec<u64>,
}

impl<'a> TileWorker<'a> {
    /// Blocks of fewer samples are over before a stop is noticed, and copies of their sums would cost time.
    const LEAST_TO_ABANDON: usize = 4;

    fn new(
        scene: &'a CompiledScene,
        settings: &'a RenderSettings,
        layout: &FilmLayout,
        stop: &'a AtomicBool,
    ) -> Self {
        let (block, scale) = (BlockSum::on_bases(scene, &layout.bases), FilmScale::new(layout));
        Self { scene, settings, stop, block, scale, before: Vec::new() }
    }

    /// Adds samples to every pixel of a tile, block by block; `false` where a stop came before the last of them.
    fn fill_tile(&mut self, task: &mut TileMut<'_>, samples: Range<u32>) -> bool {
        let mut first = samples.start;
        if !is_block_boundary(first) {
            // Replace the part of a block at which an earlier render ended by the whole block
            let start = block_start(first);
            let end = block_end(start).min(samples.end);
            self.fill_block(task, start..first, BlockSign::Remove);
            self.fill_block(task, start..end, BlockSign::Add);
            task.tile.add_samples(first..end);
            first = end;
        }
        while first < samples.end {
            let block = first..block_end(first).min(samples.end);
            if block.len() < Self::LEAST_TO_ABANDON {
                self.fill_block(task, block.clone(), BlockSign::Add);
            } else if !self.fill_or_abandon_block(task, block.clone()) {
                return false;
            }
            first = block.end;
            task.tile.add_samples(block);
        }
        true
    }

    /// Adds one block of samples to every pixel of a tile. Where a stop comes before its end the sums stay as they were, and
    /// `false` returns.
    fn fill_or_abandon_block(&mut self, task: &mut TileMut<'_>, samples: Range<u32>) -> bool {
        self.before.clear();
        self.before.extend_from_slice(task.sums);
        for pixels in self.batches(task, &samples) {
            if self.stop.load(Ordering::Relaxed) {
                task.sums.copy_from_slice(&self.before);
                return false;
            }
            self.fill_batch(task, pixels, &samples, BlockSign::Add);
        }
        true
    }

    /// Adds one block of samples to every pixel of a tile, or takes it away.
    fn fill_block(&mut self, task: &mut TileMut<'_>, samples: Range<u32>, sign: BlockSign) {
        for pixels in self.batches(task, &samples) {
            self.fill_batch(task, pixels, &samples, sign);
        }
    }

    /// Pixels of a tile of which a block of samples is rendered together.
    fn batches(
        &self,
        task: &TileMut<'_>,
        samples: &Range<u32>,
    ) -> impl Iterator<Item = Range<usize>> + use<> {
        let (count, at_a_time) = (task.tile.pixels(), self.block.pixels_at_a_time(samples));
        (0..count).step_by(at_a_time).map(move |start| start..(start + at_a_time).min(count))
    }

    fn fill_batch(
        &mut self,
        task: &mut TileMut<'_>,
        pixels: Range<usize>,
        samples: &Range<u32>,
        sign: BlockSign,
    ) {
        let (tile, len) = (&*task.tile, self.scale.pixel_len());
        let position = |index: usize| (tile.row + index / tile.cols, tile.col + index % tile.cols);
        let sums = task.sums[pixels.start * len..pixels.end * len].chunks_mut(len.max(1));
        self.block.render(self.scene, self.settings, pixels.map(position), samples.clone());
        for ((values, lit), sums) in self.block.pixels().zip(sums) {
            self.scale.add_block(sums, values, lit, samples.clone(), sign);
        }
    }
}
