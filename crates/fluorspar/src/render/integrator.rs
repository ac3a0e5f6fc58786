//! All pixels on all cores, pass by pass, with progress and interruption.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use fluorspar_accel::BuildError;
use rayon::prelude::*;
use thiserror::Error;

use super::compiled_scene::{CompiledScene, Target};
use super::path::Path;
use super::spectral_accumulation::SpectralState;
use crate::image::{Component, ComponentImage, FeatureMaps, Light};
use crate::sampling::SampleStream;
use crate::scene::{Scene, SceneError};

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
}

impl Default for RenderSettings {
    /// 64 paths per pixel, depth 8, seed 1, at most 16 GiB.
    fn default() -> Self {
        Self {
            samples_per_pixel: 64,
            max_depth: 8,
            seed: 1,
            estimator: Estimator::default(),
            memory_limit_bytes: 8 << 30,
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
    /// Images would not fit.
    #[error(
        "the component images need {needed_gib:.1} GiB ({components} components of {width} x {height} pixels and \
         {bands} bands), more than the limit of {limit_gib:.1} GiB. Render fewer pixels, bands, light groups or \
         fluorophores, or raise the limit"
    )]
    TooLarge {
        /// Memory needed, GiB.
        needed_gib: f64,
        /// Limit, GiB.
        limit_gib: f64,
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

/// Side of a tile, pixels.
const TILE: usize = 16;
/// Largest number of samples that a pixel takes in one go: bounds the wait after a request to stop.
const LARGEST_PASS: u32 = 16;

/// Memory that a render's images need, bytes: film and result.
pub fn memory_bytes(scene: &Scene) -> u64 {
    let components = scene.light_groups.len() * (scene.fluorophores.len() + 2);
    2 * 4 * (components * scene.grid.len()) as u64 * (scene.camera.width as u64 * scene.camera.height as u64)
}

struct Tile {
    row: usize,
    col: usize,
    rows: usize,
    cols: usize,
    samples: u32,
    /// `[component][pixel][band]`.
    sums: Vec<f32>,
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
    scene.check()?;
    check_settings(settings)?;
    let components = component_labels(scene);
    let (width, height, bands) = (scene.camera.width, scene.camera.height, scene.grid.len());
    let needed = memory_bytes(scene);
    if needed > settings.memory_limit_bytes {
        let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
        return Err(RenderError::TooLarge {
            needed_gib: gib(needed),
            limit_gib: gib(settings.memory_limit_bytes),
            components: components.len(),
            width,
            height,
            bands,
        });
    }
    let compiled = CompiledScene::new(scene)?;

    let mut tiles = Vec::new();
    for row in (0..height).step_by(TILE) {
        for col in (0..width).step_by(TILE) {
            let (rows, cols) = (TILE.min(height - row), TILE.min(width - col));
            tiles.push(Tile { row, col, rows, cols, samples: 0, sums: Vec::new() });
        }
    }

    let done = AtomicU64::new(0);
    let paths_total = (width * height) as u64 * u64::from(settings.samples_per_pixel);
    let mut first = 0;
    let mut pass = 1;
    while first < settings.samples_per_pixel && !control.stop.load(Ordering::Relaxed) {
        let last = (first + pass).min(settings.samples_per_pixel);
        tiles.par_iter_mut().for_each_init(
            || (Path::default(), SpectralState::new(&compiled)),
            |(path, state), tile| {
                if control.stop.load(Ordering::Relaxed) {
                    return;
                }
                tile.sums.resize(components.len() * tile.rows * tile.cols * bands, 0.0);
                render_tile(&compiled, settings, tile, first..last, path, state);
                tile.samples = last;
                let paths = (tile.rows * tile.cols) as u64 * u64::from(last - first);
                let paths_done = done.fetch_add(paths, Ordering::Relaxed) + paths;
                (control.progress)(RenderProgress { paths_done, paths_total });
            },
        );
        first = last;
        pass = (pass * 2).min(LARGEST_PASS);
    }

    let mut image = ComponentImage::zeros(scene.grid.clone(), width, height, components);
    image.samples_per_pixel = tiles.iter().map(|t| t.samples).min().unwrap_or(0);
    for tile in &mut tiles {
        if tile.samples > 0 {
            copy_tile(tile, &mut image);
            tile.sums = Vec::new();
        }
    }
    image.features = feature_maps(&compiled);
    Ok(image)
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
    check("max_depth", settings.max_depth, 1..=10_000, "must be between 1 (direct light only) and 10000")
}

fn component_labels(scene: &Scene) -> Vec<Component> {
    let mut labels = Vec::new();
    for group in &scene.light_groups {
        let mut push = |light| labels.push(Component { light_group: group.name.clone(), light });
        push(Light::Reflected);
        scene.fluorophores.iter().for_each(|f| push(Light::Fluorescence(f.name.clone())));
        push(Light::MultipleFluorescence);
    }
    labels
}

fn render_tile(
    scene: &CompiledScene<'_>,
    settings: &RenderSettings,
    tile: &mut Tile,
    samples: std::ops::Range<u32>,
    path: &mut Path,
    state: &mut SpectralState,
) {
    let camera = &scene.scene.camera;
    let pixels = tile.rows * tile.cols;
    for index in 0..pixels {
        let (row, col) = (tile.row + index / tile.cols, tile.col + index % tile.cols);
        for sample in samples.clone() {
            let mut stream = SampleStream::new(settings.seed, (row * camera.width + col) as u64, sample);
            let [x, y, _, _] = stream.next_4d();
            let (origin, direction) = camera.ray(col as f32 + x, row as f32 + y);
            scene.trace(path, origin, direction, &mut stream, settings.max_depth, settings.estimator);
            state.gather(scene, path);
            for component in 0..state.components() {
                if !state.is_lit(component) {
                    continue;
                }
                let start = (component * pixels + index) * scene.bands;
                let sums = &mut tile.sums[start..start + scene.bands];
                for (sum, value) in sums.iter_mut().zip(state.component(component)) {
                    *sum += value;
                }
            }
        }
    }
}

fn copy_tile(tile: &Tile, image: &mut ComponentImage) {
    let bands = image.grid.len();
    let (width, height) = (image.width, image.height);
    let pixels = tile.rows * tile.cols;
    let scale = 1.0 / tile.samples as f32;
    for component in 0..image.components.len() {
        for row in 0..tile.rows {
            let from = (component * pixels + row * tile.cols) * bands;
            let to = ((component * height + tile.row + row) * width + tile.col) * bands;
            let source = &tile.sums[from..from + tile.cols * bands];
            for (value, sum) in image.data[to..to + tile.cols * bands].iter_mut().zip(source) {
                *value = sum * scale;
            }
        }
    }
}

fn feature_maps(compiled: &CompiledScene<'_>) -> FeatureMaps {
    let scene = compiled.scene;
    let camera = &scene.camera;
    let pixels: Vec<_> = (0..camera.width * camera.height)
        .into_par_iter()
        .map(|index| {
            let (row, col) = (index / camera.width, index % camera.width);
            let (origin, direction) = camera.ray(col as f32 + 0.5, row as f32 + 0.5);
            let nothing = (f32::INFINITY, [0.0; 3], 0, [0.0; 2]);
            match compiled.closest(origin, direction) {
                None => nothing,
                Some(hit) if matches!(hit.target, Target::Light(_)) => (hit.t, [0.0; 3], 0, [0.0; 2]),
                Some(hit) => compiled.surface(origin, direction, &hit).map_or(nothing, |point| {
                    (hit.t, point.shading.to_array(), point.object as u16 + 1, point.uv.to_array())
                }),
            }
        })
        .collect();
    FeatureMaps {
        depth_m: pixels.iter().map(|p| p.0).collect(),
        normal: pixels.iter().map(|p| p.1).collect(),
        part: pixels.iter().map(|p| p.2).collect(),
        uv: pixels.iter().map(|p| p.3).collect(),
        part_names: scene.objects.iter().map(|o| o.name.clone()).collect(),
        material_names: scene.objects.iter().map(|o| scene.materials[o.material].name.clone()).collect(),
        view: Some(camera.view()),
    }
}
