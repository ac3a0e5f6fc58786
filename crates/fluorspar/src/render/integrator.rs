//! All pixels on all cores, pass by pass, with progress and interruption.

use std::fmt;
use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use fluorspar_accel::BuildError;
use fluorspar_accel::bands::{BandBlock, add_bands, add_scaled_range, copy_bands};
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use thiserror::Error;

use super::adaptive::{ErrorTarget, TileError};
use super::camera_sample::{MOST_PATHS, PixelSampler};
use super::compiled_scene::CompiledScene;
use super::surface::Target;
use crate::image::EXCITATION_MARK;
use crate::image::film::{
    BlockSign, FilmScale, FilmTile, TILE, TileMut, block_end, block_start, film_bytes, is_block_boundary,
};
use crate::image::{
    Component, ComponentImage, FeatureMaps, Film, FilmLayout, Light, SpectralImage, Statistics,
};
use crate::scene::{Scene, SceneError};
use crate::spectral::Radiance;
use crate::units::memory_texts;

/// How light transport is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Estimator {
    /// Next-event estimation towards one light of every group, weighted against scattered directions.
    #[default]
    MultipleImportance,
    /// Only scattered directions: slow, blind to point and distant lights, a reference for tests.
    ScatteringOnly,
}

/// How much work a render does.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSettings {
    /// Paths per pixel, 1 or more; powers of two use the samples best.
    pub samples_per_pixel: u32,
    /// Most surfaces that a path visits: 1 is direct light only.
    pub max_depth: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// How light transport is estimated.
    pub estimator: Estimator,
    /// Most memory for the images, bytes.
    pub memory_limit_bytes: u64,
    /// What is kept about the scatter of samples.
    pub statistics: Statistics,
    /// Error at which a tile is done before it has all its samples; `None` gives all pixels the same number.
    pub error_target: Option<ErrorTarget>,
    /// Edges of excitation bins, nm, increasing. When given, each light group becomes one group per bin,
    /// `GROUP@FIRST-LAST`, and `GROUP@rest` for its light outside all bins: the image can then be recombined for any lamp
    /// spectrum that is constant relative to the rendered one within each bin.
    pub excitation_edges_nm: Vec<f64>,
}

impl Default for RenderSettings {
    /// 64 paths per pixel, depth 8, seed 1, at most 8 GiB.
    fn default() -> Self {
        Self {
            samples_per_pixel: 64,
            max_depth: 8,
            seed: 1,
            estimator: Estimator::default(),
            memory_limit_bytes: 8 << 30,
            statistics: Statistics::None,
            error_target: None,
            excitation_edges_nm: Vec::new(),
        }
    }
}

impl RenderSettings {
    /// What the film keeps about the scatter of samples: an error target needs that of the light groups at least.
    pub fn film_statistics(&self) -> Statistics {
        match self.statistics {
            Statistics::None if self.error_target.is_some() => Statistics::LightGroups,
            statistics => statistics,
        }
    }
}

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
    /// Set to stop: the picture so far is returned.
    pub stop: &'a AtomicBool,
    /// Called now and then, from any thread.
    pub progress: &'a (dyn Fn(RenderProgress) + Sync),
}

/// Why a render can't start.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The scene is not physical.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The triangles can't be sorted.
    #[error("the scene's triangles can't be prepared for rendering: {0}")]
    Build(#[from] BuildError),
    /// A setting is out of range.
    #[error("{field} = {value}: {message}")]
    Setting {
        /// Which.
        field: &'static str,
        /// Its value.
        value: u64,
        /// What is allowed.
        message: &'static str,
    },
    /// The error target is out of range.
    #[error("error target: {message}")]
    Target {
        /// What is wrong.
        message: String,
    },
    /// The film belongs to another scene.
    #[error(
        "the film was made for another scene, seed, depth or version of the program: its samples can't be continued. \
         Render anew, or restore what was changed"
    )]
    OtherScene,
    /// The film keeps other statistics.
    #[error(
        "the film keeps {film:?} statistics, but {wanted:?} are wanted: ask for the same, or render anew"
    )]
    OtherStatistics {
        /// What the film keeps.
        film: Statistics,
        /// What is wanted.
        wanted: Statistics,
    },
    /// The film was made for other rows than those that are to be rendered.
    #[error(
        "the film was made for some rows only and has no memory for the tile at row {row}, column {col}. Render the tiles of \
         its rows only (Share::TileRange), or make a film of the whole picture"
    )]
    OutsideRows {
        /// Row of the first such tile.
        row: usize,
        /// Its column.
        col: usize,
    },
    /// Images would not fit.
    #[error(
        "the component images need {needed} ({components} components of {width} x {height} pixels and {bands} bands), more than \
         the limit of {limit}. Render fewer pixels, bands, light groups or \
         fluorophores, raise render.memory_limit_gib, or use `fluorspar render` without --shard, which goes through such \
         images in bands of rows",
        needed = memory_texts(*needed_bytes, *limit_bytes)[0],
        limit = memory_texts(*needed_bytes, *limit_bytes)[1]
    )]
    TooLarge {
        /// Memory needed, bytes.
        needed_bytes: u64,
        /// Limit, bytes.
        limit_bytes: u64,
        /// Components.
        components: usize,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Bands.
        bands: usize,
    },
}

/// Passes grow to this many samples: bounds the wait after a request to stop.
const LARGEST_PASS: u32 = 64;
/// Pilot pixels along each side of the image, and samples of each.
const PILOT_SIDE: usize = 32;
const PILOT_SAMPLES: u32 = 4;

/// Memory that a render's images need, bytes: the film, from which the result is made in place.
pub fn memory_bytes(scene: &Scene, settings: &RenderSettings) -> u64 {
    let groups = scene.light_groups.len() * settings.excitation_edges_nm.len().max(1);
    let components = groups * (scene.fluorophores.len() + 2);
    let planes = components
        + 2 * match settings.film_statistics() {
            Statistics::None => 0,
            Statistics::LightGroups => groups,
            Statistics::Components => components,
        };
    film_bytes(scene.camera.width, scene.camera.height, scene.grid.len(), planes)
}

/// Memory of what belongs to the whole picture when it is rendered some rows at a time, bytes: feature maps, materials and
/// numbers of samples of all pixels.
pub fn whole_image_bytes(scene: &Scene) -> u64 {
    const PER_PIXEL: u64 = 4 + 12 + 2 + 8 + 2 + 4;
    PER_PIXEL * scene.camera.width as u64 * scene.camera.height as u64
}

/// Memory of the film of one row of tiles, bytes.
pub fn tile_row_bytes(scene: &Scene, settings: &RenderSettings) -> u64 {
    let height = scene.camera.height.max(1);
    let rows = height.div_ceil(TILE.min(height)) as u64;
    memory_bytes(scene, settings) / rows
}

/// Renders radiance, every component apart.
///
/// The result depends on scene, settings and seed only, never on the number of threads or on timing; an interrupted
/// render returns the samples it has.
///
/// # Errors
/// A scene that is not physical, settings out of range, or images larger than the memory limit.
pub fn render(
    scene: &Scene,
    settings: &RenderSettings,
    control: &RenderControl<'_>,
) -> Result<ComponentImage, RenderError> {
    let renderer = FilmRenderer::new(scene, settings)?;
    // Nobody will see the digest: the film does not leave this function.
    let layout = layout(&renderer.compiled, settings, String::new());
    let mut film = Film::new(layout, feature_maps(&renderer.compiled));
    let watch = FilmWatch { due: &|| false, look: &mut |_| true };
    fill(&renderer.compiled, settings, &Share::default(), &mut film, control, watch);
    drop(renderer);
    Ok(film.into_image())
}

/// Which samples of which tiles one process renders.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Share {
    /// All.
    #[default]
    Whole,
    /// Every `count`th tile, from tile `index` (0 to `count - 1`) on.
    Tiles {
        /// Which share.
        index: u32,
        /// How many there are.
        count: u32,
    },
    /// Tiles by number, row by row.
    TileRange(Range<usize>),
    /// One of `count` runs of samples of every tile, about equally long, cut between blocks.
    Samples {
        /// Which share.
        index: u32,
        /// How many there are.
        count: u32,
    },
}

impl Share {
    /// Samples of each pixel, of `all` samples.
    pub fn samples(&self, all: u32) -> Range<u32> {
        let &Self::Samples { index, count } = self else { return 0..all };
        // Aim at equal lengths, then go back to the start of the block.
        let cut = |part: u32| match part {
            part if part >= count => all,
            part => block_start((u64::from(all) * u64::from(part) / u64::from(count)) as u32),
        };
        cut(index)..cut(index + 1)
    }

    fn holds(&self, tile: usize) -> bool {
        match self {
            Self::Tiles { index, count } => tile as u64 % u64::from(*count) == u64::from(*index),
            Self::TileRange(tiles) => tiles.contains(&tile),
            _ => true,
        }
    }

    fn check(&self, settings: &RenderSettings) -> Result<(), RenderError> {
        let &(Self::Tiles { index, count } | Self::Samples { index, count }) = self else { return Ok(()) };
        let refuse =
            |field, value: u32, message| Err(RenderError::Setting { field, value: value.into(), message });
        if index >= count {
            return refuse("shard", index + 1, "must be between 1 and the number of shards");
        }
        if let Self::Samples { .. } = self {
            if settings.error_target.is_some() {
                return refuse(
                    "shards by samples",
                    count,
                    "can't be used with an error target, which needs all samples; split by tiles",
                );
            }
            if self.samples(settings.samples_per_pixel).is_empty() {
                return refuse(
                    "shards by samples",
                    count,
                    "is too many for so few samples: shards are cut every 16 samples. Split by tiles, or into fewer",
                );
            }
        }
        Ok(())
    }
}

/// Looks at a film while it is being filled: to save it, or to show it.
pub struct FilmWatch<'a> {
    /// Asked after every tile, from any thread: whether to pause for a look.
    pub due: &'a (dyn Fn() -> bool + Sync),
    /// Looks at the film; `false` ends the render.
    pub look: &'a mut dyn FnMut(&Film) -> bool,
}

/// A scene made ready for rendering on films: what [`render`] does in one go, step by step.
pub struct FilmRenderer<'a> {
    compiled: CompiledScene<'a>,
    settings: &'a RenderSettings,
    /// [`scene_digest`], once it was asked for: of large scenes it takes a while.
    digest: OnceLock<String>,
}

impl<'a> FilmRenderer<'a> {
    /// Checks and prepares a scene.
    ///
    /// # Errors
    /// As [`render`].
    pub fn new(scene: &'a Scene, settings: &'a RenderSettings) -> Result<Self, RenderError> {
        check_memory(scene, settings)?;
        Self::for_rows(scene, settings)
    }

    /// Checks and prepares a scene for films of some rows at a time ([`Film::of_tile_rows`]); whether those fit into the
    /// memory limit is for the caller to see to.
    ///
    /// # Errors
    /// As [`render`], but for images larger than the memory limit.
    pub fn for_rows(scene: &'a Scene, settings: &'a RenderSettings) -> Result<Self, RenderError> {
        Ok(Self { compiled: prepare(scene, settings)?, settings, digest: OnceLock::new() })
    }

    /// An empty film.
    pub fn new_film(&self) -> Film {
        Film::new(self.layout(), self.features())
    }

    /// What films are made for. Takes a moment: pilot samples find the quanta.
    pub fn layout(&self) -> FilmLayout {
        layout(&self.compiled, self.settings, self.digest().into())
    }

    fn digest(&self) -> &str {
        self.digest.get_or_init(|| scene_digest(self.compiled.scene, self.settings))
    }

    /// Geometry behind each pixel.
    pub fn features(&self) -> FeatureMaps {
        feature_maps(&self.compiled)
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
        watch: FilmWatch<'_>,
    ) -> Result<bool, RenderError> {
        self.check(film)?;
        share.check(self.settings)?;
        let len = film.pixel_len();
        let without = |(number, (tile, sums)): &(usize, (&FilmTile, &[u64]))| {
            share.holds(*number) && sums.len() < tile.pixels() * len
        };
        let without = film.tiles().enumerate().find(without);
        if let Some((_, (tile, _))) = without {
            return Err(RenderError::OutsideRows { row: tile.row, col: tile.col });
        }
        Ok(fill(&self.compiled, self.settings, share, film, control, watch))
    }

    /// Samples of each pixel that a share is to hold in the end.
    pub fn samples_of(&self, share: &Share) -> Range<u32> {
        share.samples(self.settings.samples_per_pixel)
    }

    /// The sum of all components in coarse pixels, at most `side` along each side of the image, one sample each: shown
    /// while the first samples of the film are not there yet.
    pub fn coarse_sum(&self, side: usize) -> SpectralImage<Radiance> {
        let camera = &self.compiled.scene.camera;
        let step = camera.width.max(camera.height).div_ceil(side.max(1));
        let (width, height) = (camera.width.div_ceil(step), camera.height.div_ceil(step));
        let bands = self.compiled.bands;
        let mut image = SpectralImage::zeros(self.compiled.scene.grid.clone(), width, height);
        image.data_mut().par_chunks_mut(bands * width).enumerate().for_each_init(
            || BlockSum::new(&self.compiled),
            |block, (row, pixels)| {
                for (col, pixel) in pixels.chunks_mut(bands).enumerate() {
                    let at = |i: usize, size: usize| (i * step + step / 2).min(size - 1);
                    let (row, col) = (at(row, camera.height), at(col, camera.width));
                    block.render(&self.compiled, self.settings, std::iter::once((row, col)), 0..1);
                    for component in block.values.chunks(bands) {
                        pixel.iter_mut().zip(component).for_each(|(sum, value)| *sum += value);
                    }
                }
            },
        );
        image
    }
}

/// Number of the way in which paths are drawn: one more whenever the same scene and seed come to give other samples, so that
/// films of before are not continued with samples that do not fit theirs.
const SAMPLING: u32 = 2;

/// SHA-256 of everything that decides the value of a sample: the scene with all its numbers, seed, depth, estimator,
/// the version of the program and of its sampling. Lower-case hexadecimal.
pub fn scene_digest(scene: &Scene, settings: &RenderSettings) -> String {
    struct Writer(Sha256);
    impl fmt::Write for Writer {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            self.0.update(text.as_bytes());
            Ok(())
        }
    }
    let mut writer = Writer(Sha256::new());
    // Debug output of floats is exact, and covers every field that anyone adds to a scene. A digest can't fail.
    let _ = fmt::Write::write_fmt(
        &mut writer,
        format_args!(
            "{} {SAMPLING} {} {} {:?} {:?} {scene:?}",
            env!("CARGO_PKG_VERSION"),
            settings.seed,
            settings.max_depth,
            settings.estimator,
            settings.excitation_edges_nm
        ),
    );
    writer.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

fn prepare<'a>(scene: &'a Scene, settings: &RenderSettings) -> Result<CompiledScene<'a>, RenderError> {
    scene.check()?;
    check_settings(settings)?;
    if let Some(target) = &settings.error_target {
        target.check(scene.grid.len(), scene.light_groups.len())?;
    }
    Ok(CompiledScene::new(scene, &settings.excitation_edges_nm)?)
}

fn check_memory(scene: &Scene, settings: &RenderSettings) -> Result<(), RenderError> {
    let needed = memory_bytes(scene, settings);
    if needed > settings.memory_limit_bytes {
        return Err(RenderError::TooLarge {
            needed_bytes: needed,
            limit_bytes: settings.memory_limit_bytes,
            components: component_labels(scene, settings).len(),
            width: scene.camera.width,
            height: scene.camera.height,
            bands: scene.grid.len(),
        });
    }
    Ok(())
}

/// Plain sums of some samples of a few pixels: what one worker reuses from pixel to pixel.
struct BlockSum {
    sampler: PixelSampler,
    bands: usize,
    /// `[pixel][component][band]`.
    values: Vec<f32>,
    /// `[pixel][component]`.
    lit: Vec<bool>,
}

/// Memory for sums, bytes: no more than stays in the second-level cache.
const SUMS_BYTES: usize = 128 << 10;

impl BlockSum {
    fn new(scene: &CompiledScene<'_>) -> Self {
        Self { sampler: PixelSampler::new(scene), bands: scene.bands, values: Vec::new(), lit: Vec::new() }
    }

    /// How many numbers a pixel has.
    fn pixel_len(&self) -> usize {
        self.sampler.components() * self.bands
    }

    /// How many pixels to render at a time.
    fn pixels_at_a_time(&self, samples: &Range<u32>) -> usize {
        let wanted = MOST_PATHS / samples.len().max(1);
        wanted.min(SUMS_BYTES / (size_of::<f32>() * self.pixel_len().max(1))).max(1)
    }

    /// Renders the same samples of some pixels. The plain sum of those of each, in order, is in `values` afterwards.
    fn render(
        &mut self,
        scene: &CompiledScene<'_>,
        settings: &RenderSettings,
        pixels: impl ExactSizeIterator<Item = (usize, usize)>,
        samples: Range<u32>,
    ) {
        let (components, bands, len) = (self.sampler.components(), self.bands, self.pixel_len());
        self.values.clear();
        self.values.resize(pixels.len() * len, 0.0);
        self.lit.clear();
        self.lit.resize(pixels.len() * components, false);
        let (values, lit) = (&mut self.values, &mut self.lit);
        let add = |pixel: usize, component: usize, range: Range<usize>, weight: f32, light: &[BandBlock]| {
            lit[pixel * components + component] = true;
            let start = pixel * len + component * bands;
            let sums = &mut values[start..start + bands];
            if weight == 1.0 && range.len() == bands {
                add_bands(light, sums);
            } else {
                add_scaled_range(weight, light, range, sums);
            }
        };
        self.sampler.render(scene, settings, pixels, samples, add);
    }

    /// The sums of each pixel, and which of its components are lit.
    fn pixels(&self) -> impl Iterator<Item = (&[f32], &[bool])> {
        self.values.chunks(self.pixel_len()).zip(self.lit.chunks(self.sampler.components()))
    }
}

/// Layout of the film, with quanta from pilot samples on a lattice of pixels.
fn layout(scene: &CompiledScene<'_>, settings: &RenderSettings, scene_digest: String) -> FilmLayout {
    let camera = &scene.scene.camera;
    let components = component_labels(scene.scene, settings);
    let bands = scene.bands;
    let lattice = |size: usize| -> Vec<usize> {
        let count = size.min(PILOT_SIDE);
        (0..count).map(|i| (2 * i + 1) * size / (2 * count)).collect()
    };
    let pixels: Vec<(usize, usize)> = lattice(camera.height)
        .into_iter()
        .flat_map(|row| lattice(camera.width).into_iter().map(move |col| (row, col)))
        .collect();
    // Fixed groups of pixels: sums of floats in an order that no scheduler decides.
    let parts: Vec<(Vec<f32>, Vec<f64>)> = pixels
        .par_chunks(PILOT_SIDE)
        .map_init(
            || BlockSum::new(scene),
            |block, pixels| {
                let (mut brightest, mut sums) =
                    (vec![0.0_f32; block.pixel_len()], vec![0.0; block.pixel_len()]);
                for &(row, col) in pixels {
                    for sample in 0..PILOT_SAMPLES {
                        block.render(scene, settings, std::iter::once((row, col)), sample..sample + 1);
                        for ((most, sum), &value) in brightest.iter_mut().zip(&mut sums).zip(&block.values) {
                            *most = most.max(value);
                            *sum += f64::from(value);
                        }
                    }
                }
                (brightest, sums)
            },
        )
        .collect();
    let (mut brightest, mut levels) =
        (vec![0.0_f32; components.len() * bands], vec![0.0; components.len() * bands]);
    for (most, sums) in parts {
        brightest.iter_mut().zip(&most).for_each(|(a, b)| *a = a.max(*b));
        levels.iter_mut().zip(&sums).for_each(|(a, b)| *a += b);
    }
    let samples = f64::from(PILOT_SAMPLES) * pixels.len() as f64;
    FilmLayout {
        grid: scene.scene.grid.clone(),
        width: camera.width,
        height: camera.height,
        exponents: exponents(scene, &components, &brightest),
        components,
        statistics: settings.film_statistics(),
        levels: levels.into_iter().map(|sum| ((sum / samples) as f32).min(f32::MAX)).collect(),
        scene_digest,
    }
}

/// Quanta as powers of two: 2^-30 of the brightest pilot sample of the component and band; where the pilot finds the
/// band dark, 2^-50 of the component's brightest sample times the share that the band has in what the lamps emit or
/// excite. A component without any light in the pilot is taken to be 2^-10 of its light group.
fn exponents(scene: &CompiledScene<'_>, components: &[Component], brightest: &[f32]) -> Vec<i16> {
    let bands = scene.bands;
    let kinds = scene.plain_operators.len() + 2;
    let most = |values: &[f32]| values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f32::max);
    let of_component: Vec<f32> = brightest.chunks(bands).map(most).collect();
    let mut exponents = Vec::with_capacity(brightest.len());
    for component in 0..components.len() {
        let (group, kind) = (component / kinds, component % kinds);
        let of_group = most(&of_component[group * kinds..(group + 1) * kinds]);
        let level = match (of_component[component], of_group) {
            (own, _) if own > 0.0 => f64::from(own),
            (_, of_group) if of_group > 0.0 => f64::from(of_group) / 1024.0,
            _ => 1.0,
        };
        let mut shape = vec![0.0_f32; bands];
        for source in scene.sources.iter().filter(|source| source.group == group) {
            let spectra: &[Vec<BandBlock>] = match kind {
                0 => std::slice::from_ref(&source.bands),
                kind if kind < kinds - 1 => &source.exitance[kind - 1..kind],
                _ => &source.exitance,
            };
            let mut spectrum = vec![0.0; bands];
            for blocks in spectra {
                copy_bands(blocks, &mut spectrum);
                shape.iter_mut().zip(&spectrum).for_each(|(a, b)| *a = a.max(*b));
            }
        }
        let peak = most(&shape);
        for (&value, &share) in brightest[component * bands..(component + 1) * bands].iter().zip(&shape) {
            let share = if share > 0.0 && share.is_finite() { f64::from(share / peak) } else { 1.0 };
            let floor = level * share.max(f64::MIN_POSITIVE) * 2_f64.powi(-20);
            let value = if value.is_finite() { f64::from(value).max(floor) } else { level };
            exponents.push((value.log2().ceil() as i32 - 30).clamp(-400, 400) as i16);
        }
    }
    exponents
}

/// Renders what is missing, pass by pass; `false` if it was stopped before the end.
fn fill(
    scene: &CompiledScene<'_>,
    settings: &RenderSettings,
    share: &Share,
    film: &mut Film,
    control: &RenderControl<'_>,
    watch: FilmWatch<'_>,
) -> bool {
    let layout = film.layout().clone();
    let samples = share.samples(settings.samples_per_pixel);
    let target = TileError::new(settings.error_target.as_ref(), &layout);
    let mut paths_total = 0;
    let mut met = Vec::new();
    let done = AtomicU64::new(0);
    for (index, (tile, _)) in film.tiles().enumerate() {
        met.push(AtomicBool::new(!share.holds(index)));
        if share.holds(index) {
            let held = end_of(&tile.samples, &samples) - samples.start;
            done.fetch_add(tile.pixels() as u64 * u64::from(held), Ordering::Relaxed);
            paths_total += tile.pixels() as u64 * u64::from(samples.end - samples.start);
        }
    }
    let mut last = samples.start;
    let mut pass = 1;
    while last < samples.end {
        last = block_end(last + pass - 1).min(samples.end);
        pass = if last - samples.start < LARGEST_PASS { last - samples.start } else { LARGEST_PASS };
        loop {
            let pause = AtomicBool::new(false);
            let mut tasks = film.tiles_mut();
            tasks.retain(|task| {
                !met[task.number].load(Ordering::Relaxed) && end_of(&task.tile.samples, &samples) < last
            });
            tasks.par_iter_mut().for_each_init(
                || (BlockSum::new(scene), FilmScale::new(&layout)),
                |(block, scale), task| {
                    if control.stop.load(Ordering::Relaxed) || pause.load(Ordering::Relaxed) {
                        return;
                    }
                    let first = end_of(&task.tile.samples, &samples);
                    let mut saved = last - first;
                    if target.is_met(scale, task.tile, task.sums) {
                        met[task.number].store(true, Ordering::Relaxed);
                        saved = samples.end - first;
                    } else {
                        while let Some(range) = next_missing(&task.tile.samples, &samples, last) {
                            fill_tile(scene, settings, task, range, block, scale);
                        }
                    }
                    let paths = task.tile.pixels() as u64 * u64::from(saved);
                    let paths_done = done.fetch_add(paths, Ordering::Relaxed) + paths;
                    (control.progress)(RenderProgress { paths_done, paths_total });
                    if (watch.due)() {
                        pause.store(true, Ordering::Relaxed);
                    }
                },
            );
            drop(tasks);
            if control.stop.load(Ordering::Relaxed) {
                return done.load(Ordering::Relaxed) >= paths_total;
            }
            if !pause.load(Ordering::Relaxed) {
                break;
            }
            if !(watch.look)(film) {
                return done.load(Ordering::Relaxed) >= paths_total;
            }
        }
    }
    true
}

/// Where the samples of a tile that lie in `wanted` and touch its start end.
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

/// Adds samples to every pixel of a tile, block by block.
fn fill_tile(
    scene: &CompiledScene<'_>,
    settings: &RenderSettings,
    task: &mut TileMut<'_>,
    samples: Range<u32>,
    block: &mut BlockSum,
    scale: &mut FilmScale,
) {
    let mut first = samples.start;
    if !is_block_boundary(first) {
        // An earlier render ended within a block: exchange the part for the whole.
        let start = block_start(first);
        fill_block(scene, settings, task, start..first, BlockSign::Remove, block, scale);
        first = start;
    }
    while first < samples.end {
        let end = block_end(first).min(samples.end);
        fill_block(scene, settings, task, first..end, BlockSign::Add, block, scale);
        first = end;
    }
    task.tile.add_samples(samples);
}

/// Adds one block of samples to every pixel of a tile, or takes it away.
fn fill_block(
    scene: &CompiledScene<'_>,
    settings: &RenderSettings,
    task: &mut TileMut<'_>,
    samples: Range<u32>,
    sign: BlockSign,
    block: &mut BlockSum,
    scale: &mut FilmScale,
) {
    let tile = &*task.tile;
    let at_a_time = block.pixels_at_a_time(&samples);
    let len = scale.pixel_len();
    let position = |index: usize| (tile.row + index / tile.cols, tile.col + index % tile.cols);
    let count = tile.rows * tile.cols;
    for (chunk, sums) in task.sums[..count * len].chunks_mut(at_a_time * len).enumerate() {
        let start = chunk * at_a_time;
        let pixels = start..start + sums.len() / len;
        block.render(scene, settings, pixels.map(position), samples.clone());
        for ((values, lit), sums) in block.pixels().zip(sums.chunks_mut(len)) {
            scale.add_block(sums, values, lit, samples.clone(), sign);
        }
    }
}

fn check_settings(settings: &RenderSettings) -> Result<(), RenderError> {
    let check = |field, value: u32, range: std::ops::RangeInclusive<u32>, message| {
        if range.contains(&value) {
            Ok(())
        } else {
            Err(RenderError::Setting { field, value: u64::from(value), message })
        }
    };
    check("samples_per_pixel", settings.samples_per_pixel, 1..=1_000_000, "must be between 1 and 1000000")?;
    let edges = &settings.excitation_edges_nm;
    if edges.len() == 1
        || edges.iter().any(|edge| !edge.is_finite() || *edge <= 0.0)
        || edges.windows(2).any(|pair| pair[0] >= pair[1])
    {
        return Err(RenderError::Setting {
            field: "excitation_edges_nm",
            value: edges.len() as u64,
            message: "edges: must be two or more increasing wavelengths",
        });
    }
    check("max_depth", settings.max_depth, 1..=10_000, "must be between 1 (direct light only) and 10000")
}

fn component_labels(scene: &Scene, settings: &RenderSettings) -> Vec<Component> {
    let mut labels = Vec::new();
    for group in &scene.light_groups {
        for name in excitation_names(&group.name, &settings.excitation_edges_nm) {
            let mut push = |light| labels.push(Component { light_group: name.clone(), light });
            push(Light::Reflected);
            scene.fluorophores.iter().for_each(|f| push(Light::Fluorescence(f.name.clone())));
            push(Light::MultipleFluorescence);
        }
    }
    labels
}

/// Names of the excitation bins of a light group.
fn excitation_names(group: &str, edges_nm: &[f64]) -> Vec<String> {
    if edges_nm.is_empty() {
        return vec![group.into()];
    }
    let mut names: Vec<String> =
        edges_nm.windows(2).map(|edge| format!("{group}{EXCITATION_MARK}{}-{}", edge[0], edge[1])).collect();
    names.push(format!("{group}{EXCITATION_MARK}rest"));
    names
}

fn feature_maps(compiled: &CompiledScene<'_>) -> FeatureMaps {
    let scene = compiled.scene;
    let camera = &scene.camera;
    let pixels = camera.width * camera.height;
    // In place: pictures that come in bands of rows have no memory for these maps twice.
    let mut maps = FeatureMaps {
        depth_m: vec![f32::INFINITY; pixels],
        normal: vec![[0.0; 3]; pixels],
        part: vec![0; pixels],
        uv: vec![[0.0; 2]; pixels],
        part_names: scene.objects.iter().map(|o| o.name.clone()).collect(),
        material_names: scene.objects.iter().map(|o| scene.materials[o.material].name.clone()).collect(),
        view: Some(camera.view()),
    };
    (&mut maps.depth_m, &mut maps.normal, &mut maps.part, &mut maps.uv).into_par_iter().enumerate().for_each(
        |(index, (depth_m, normal, part, uv))| {
            let (row, col) = (index / camera.width, index % camera.width);
            let (origin, direction) = camera.ray(col as f32 + 0.5, row as f32 + 0.5);
            let Some(hit) = compiled.closest(origin, direction) else { return };
            if matches!(hit.target, Target::Light(_)) {
                *depth_m = hit.t;
            } else if let Some(point) = compiled.surface(origin, direction, &hit) {
                *depth_m = hit.t;
                *normal = point.shading.to_array();
                *part = point.object as u16 + 1;
                *uv = point.uv.to_array();
            }
        },
    );
    maps
}
