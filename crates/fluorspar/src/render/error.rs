//! Why a render cannot start.

use fluorspar_accel::BuildError;
use thiserror::Error;

use super::adaptive::ErrorTargetError;
use crate::image::StatisticsKind;
use crate::scene::SceneError;
use crate::units::{memory_text, memory_texts};

/// Largest number of samples per pixel.
pub(super) const MOST_SAMPLES_PER_PIXEL: u32 = 1_000_000;
/// Largest path depth.
pub(super) const MOST_DEPTH: u32 = 10_000;

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
    /// The number of samples is out of range.
    #[error("samples_per_pixel = {samples_per_pixel}: must be between 1 and {most}", most = MOST_SAMPLES_PER_PIXEL)]
    SamplesPerPixel {
        /// The requested value.
        samples_per_pixel: u32,
    },
    /// The path depth is out of range.
    #[error("max_depth = {max_depth}: must be between 1 (direct light only) and {most}", most = MOST_DEPTH)]
    MaxDepth {
        /// The requested value.
        max_depth: u32,
    },
    /// A shard that does not exist.
    #[error("shard {number} of {count}: must be between 1 and the number of shards")]
    NoSuchShard {
        /// Number of the shard, from 1 on.
        number: u32,
        /// Number of shards.
        count: u32,
    },
    /// An error target needs all samples of a tile, which shards by samples do not have.
    #[error(
        "{count} shards by samples can't be used with an error target, which needs all samples: split by tiles"
    )]
    SampleShardsWithErrorTarget {
        /// Number of shards.
        count: u32,
    },
    /// Some shards by samples would be empty.
    #[error(
        "{count} shards by samples are too many for {samples_per_pixel} samples per pixel: shards are cut every 16 \
         samples. Split by tiles, or into fewer"
    )]
    TooManySampleShards {
        /// Number of shards.
        count: u32,
        /// Samples of each pixel.
        samples_per_pixel: u32,
    },
    /// The error target is invalid.
    #[error("error target: {0}")]
    ErrorTarget(#[from] ErrorTargetError),
    /// The film belongs to another scene.
    #[error(
        "the film was made for another scene, seed, depth or version of the program: its samples can't be continued. \
         Render anew, or restore what was changed"
    )]
    OtherScene,
    /// The film keeps other statistics.
    #[error(
        "the film keeps {film:?} statistics, but {wanted:?} are requested: request the same, or start a new render"
    )]
    OtherStatistics {
        /// Statistics of the film.
        film: StatisticsKind,
        /// Requested statistics.
        wanted: StatisticsKind,
    },
    /// The film keeps other bands of the components.
    #[error(
        "the film keeps other bands of its components than are requested: request the same, or start a new render"
    )]
    OtherStorage,
    /// The film was made for other rows than those that are to be rendered.
    #[error(
        "the film was made for some rows only and has no memory for the tile at row {row}, column {col}. Render the tiles of \
         its rows only (Share::TileRange), or make a film of the whole image"
    )]
    OutsideRows {
        /// Row of the first such tile.
        row: usize,
        /// Its column.
        col: usize,
    },
    /// The system refuses the memory.
    #[error(
        "not enough memory: the images take {} ({width} x {height} pixels, {bands} bands) and the surfaces about {}, which the \
         system refuses. Render fewer pixels, bands, light groups or fluorophores, use coarser meshes, lower \
         render.memory_limit_gib so that `fluorspar render` goes through the image in bands of rows, or raise the limit of the \
         process (ulimit -v, the memory of its container)",
        memory_text(*image_bytes),
        memory_text(*surface_bytes)
    )]
    NoMemory {
        /// Memory of the images, bytes.
        image_bytes: u64,
        /// Memory of the surfaces while they are prepared, bytes, estimated.
        surface_bytes: u64,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Bands.
        bands: usize,
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
