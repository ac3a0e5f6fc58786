//! Sums of radiance samples that do not depend on the order in which they were added.
//!
//! Samples of a pixel are rendered in fixed **blocks** ({0}, {1}, {2, 3}, {4..7}, {8..15}, then 16 at a time). A
//! block is summed in one go, rounded once to a multiple of a quantum, and added to a signed 64-bit integer: what light
//! that enters elsewhere brings less to a translucent surface may be negative in a sample. Sums of
//! integers have no rounding and no order: a film that was interrupted, resumed, extended, or put together from
//! shards holds the same bits as one that was rendered without a break.
//!
//! The quantum of a component and band is a power of two, 2^-30 of the brightest of a few thousand pilot samples
//! (less where the pilot finds a band dark), so that rounding a block is an error of less than 2^-31 of that
//! brightest sample: below the rounding of 32-bit floats for every pixel brighter than 2^-11 of it, and unbiased below.
//! Of coefficients on a basis it is that of all bands at these ends together.
//! The range ends at 2^33 times the brightest pilot sample; a sum that leaves it stays at the end and becomes an
//! infinite radiance, never a silent error.

use std::ops::Range;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{
    Component, ComponentBases, ComponentImage, FeatureMaps, SampleStatistics, SpectralBasis, SpectralImage,
    StatisticsKind,
};
use crate::spectral::{Radiance, WavelengthGrid};

/// Side of a tile, pixels.
pub const TILE: usize = 16;
/// Samples of a full block.
pub const BLOCK: u32 = 16;
/// Bytes that are allocated (and given back) together: more than the allocator keeps for itself.
const SLAB_BYTES: usize = 64 << 20;

/// First sample of the block that holds `sample`.
pub fn block_start(sample: u32) -> u32 {
    match sample {
        0 => 0,
        1..BLOCK => 1 << sample.ilog2(),
        _ => sample / BLOCK * BLOCK,
    }
}

/// First sample after the block that holds `sample`.
pub fn block_end(sample: u32) -> u32 {
    match sample {
        0 => 1,
        1..BLOCK => 2 << sample.ilog2(),
        _ => (sample / BLOCK + 1) * BLOCK,
    }
}

/// Number of the block that holds `sample`, from 0.
pub fn block_number(sample: u32) -> u32 {
    match sample {
        0 => 0,
        1..BLOCK => 1 + sample.ilog2(),
        _ => 4 + sample / BLOCK,
    }
}

/// Whether a range of samples can be rendered apart from the samples after it: it ends where a block ends.
pub fn is_block_boundary(sample: u32) -> bool {
    block_start(sample) == sample
}

/// Layout and identity of a film: everything but the samples.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmLayout {
    /// The wavelength grid.
    pub grid: WavelengthGrid,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Label of each component.
    pub components: Vec<Component>,
    /// Statistics of the samples.
    pub statistics: StatisticsKind,
    /// Of each component its basis; empty where all bands of all are summed, as they are wherever statistics are kept.
    pub bases: ComponentBases,
    /// Quantum of each component and coefficient as a power of two, `[component][coefficient]`.
    pub exponents: Vec<i16>,
    /// Mean radiance of the pilot samples, `[component][band]`, W/(sr m² nm): the level that errors are compared with.
    pub levels: Vec<f32>,
    /// Digest of the scene and of every setting that decides a sample's value.
    pub scene_digest: String,
}

impl FilmLayout {
    /// Components that each statistic sums: one list per light group or per component.
    pub fn statistic_members(&self) -> Vec<(String, Vec<usize>)> {
        match self.statistics {
            StatisticsKind::None => Vec::new(),
            StatisticsKind::Components => {
                self.components.iter().enumerate().map(|(i, c)| (c.label(), vec![i])).collect()
            }
            StatisticsKind::LightGroups => {
                let mut groups: Vec<(String, Vec<usize>)> = Vec::new();
                for (index, component) in self.components.iter().enumerate() {
                    let label = component.group_label();
                    match groups.iter_mut().find(|(name, _)| *name == label) {
                        Some((_, members)) => members.push(index),
                        None => groups.push((label, vec![index])),
                    }
                }
                groups
            }
        }
    }

    /// The basis of a component that is not summed in all bands.
    pub fn basis(&self, component: usize) -> Option<&SpectralBasis> {
        self.bases.get(component)?.as_deref()
    }

    /// Integers of each plane of a pixel: components, then first halves, then squares of the statistics.
    pub fn plane_lens(&self) -> Vec<usize> {
        let bands = self.grid.len();
        let of_component = |c| self.basis(c).map_or(bands, |basis| basis.len());
        let of_statistics = std::iter::repeat_n(bands, 2 * self.statistic_members().len());
        (0..self.components.len()).map(of_component).chain(of_statistics).collect()
    }

    /// Rows of tiles.
    pub fn tile_rows(&self) -> usize {
        self.height.div_ceil(TILE.min(self.height).max(1))
    }

    /// Rows of pixels that rows of tiles cover.
    pub fn pixel_rows(&self, tile_rows: Range<usize>) -> Range<usize> {
        let tile = TILE.min(self.height).max(1);
        (tile_rows.start * tile).min(self.height)..(tile_rows.end * tile).min(self.height)
    }

    /// Numbers of the tiles in rows of tiles.
    pub fn tiles_of_rows(&self, tile_rows: Range<usize>) -> Range<usize> {
        let per_row = self.width.div_ceil(TILE.min(self.width).max(1));
        tile_rows.start * per_row..tile_rows.end * per_row
    }

    /// Memory of a film, bytes: 8 for each component, pixel and coefficient, and 16 for each statistic, pixel and band.
    pub fn memory_bytes(&self) -> u64 {
        film_bytes(self.width, self.height, self.plane_lens().iter().sum())
    }
}

/// Memory of `values` sums of every pixel, bytes, whole tiles counted.
pub fn film_bytes(width: usize, height: usize, values: usize) -> u64 {
    let (tile_width, tile_height) = (TILE.min(width), TILE.min(height));
    let tiles = width.div_ceil(tile_width.max(1)) as u64 * height.div_ceil(tile_height.max(1)) as u64;
    8 * tiles * (tile_width * tile_height) as u64 * values as u64
}

/// A rectangle of pixels and the samples that each of them holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FilmTile {
    /// First row.
    pub row: usize,
    /// First column.
    pub col: usize,
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Samples that every pixel holds: sorted, disjoint, not touching.
    pub samples: Vec<Range<u32>>,
}

impl FilmTile {
    /// Samples per pixel.
    pub fn count(&self) -> u32 {
        self.samples.iter().map(|range| range.end - range.start).sum()
    }

    /// Pixels.
    pub fn pixels(&self) -> usize {
        self.rows * self.cols
    }

    /// Blocks that the samples make, and how many samples lie in even blocks (the first half-buffer).
    pub fn blocks(&self) -> (u32, u32) {
        let (mut blocks, mut even) = (0, 0);
        for range in &self.samples {
            let mut first = range.start;
            while first < range.end {
                let end = block_end(first).min(range.end);
                blocks += 1;
                if block_number(first).is_multiple_of(2) {
                    even += end - first;
                }
                first = end;
            }
        }
        (blocks, even)
    }

    /// Notes that samples were added at the end of the range that ends at `samples.start`, or apart from all others.
    pub fn add_samples(&mut self, samples: Range<u32>) {
        self.samples.push(samples);
        self.samples.sort_by_key(|range| range.start);
        let mut joined: Vec<Range<u32>> = Vec::new();
        for range in self.samples.drain(..) {
            match joined.last_mut() {
                Some(last) if last.end >= range.start => last.end = last.end.max(range.end),
                _ => joined.push(range),
            }
        }
        self.samples = joined;
    }
}

/// Whether a block is added or taken away again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockSign {
    /// The block is new.
    Add,
    /// The block was not complete: it is taken away before the complete one is added.
    Remove,
}

/// How block sums become integers; one for all pixels of a film.
#[derive(Clone, Debug)]
pub struct FilmScale {
    bands: usize,
    components: usize,
    /// First integer of each plane, and the end of the last.
    starts: Vec<usize>,
    members: Vec<(String, Vec<usize>)>,
    /// `2^-exponent`, `[plane][coefficient]`.
    per_unit: Vec<f64>,
    scratch: Vec<f64>,
}

impl FilmScale {
    /// The scale of a layout.
    pub fn new(layout: &FilmLayout) -> Self {
        let bands = layout.grid.len();
        let members = layout.statistic_members();
        let mut exponents: Vec<i32> = layout.exponents.iter().map(|&e| i32::from(e)).collect();
        let mut squares = Vec::new();
        for (_, members) in &members {
            for band in 0..bands {
                let of_members = members.iter().map(|m| i32::from(layout.exponents[m * bands + band]));
                let exponent = of_members.max().unwrap_or(0);
                exponents.push(exponent);
                // Squares span twice the range: 2^-40 of the squared pilot maximum, up to 2^24 of it.
                squares.push(2 * exponent + 20);
            }
        }
        exponents.extend(squares);
        let ends = layout.plane_lens().into_iter().scan(0, |end, len| {
            *end += len;
            Some(*end)
        });
        Self {
            bands,
            components: layout.components.len(),
            starts: std::iter::once(0).chain(ends).collect(),
            members,
            per_unit: exponents.into_iter().map(|e| 2_f64.powi(-e)).collect(),
            scratch: vec![0.0; bands],
        }
    }

    /// Integers of one pixel.
    pub fn pixel_len(&self) -> usize {
        self.per_unit.len()
    }

    fn plane(&self, plane: usize) -> Range<usize> {
        self.starts[plane]..self.starts[plane + 1]
    }

    /// Adds one block of one pixel.
    ///
    /// `sums` are the pixel's integers, `block` the plain sums of the block's samples, `[component][coefficient]`; components
    /// that are not `lit` hold zeros. `samples` are the samples of the block that were taken.
    pub fn add_block(
        &mut self,
        sums: &mut [u64],
        block: &[f32],
        lit: &[bool],
        samples: Range<u32>,
        sign: BlockSign,
    ) {
        let bands = self.bands;
        for component in (0..self.components).filter(|&c| lit[c]) {
            let range = self.plane(component);
            let values = block[range.clone()].iter().map(|&v| f64::from(v));
            add(&mut sums[range.clone()], values, &self.per_unit[range], sign);
        }
        if self.members.is_empty() {
            return;
        }
        let count = f64::from(samples.end - samples.start);
        let even = block_number(samples.start).is_multiple_of(2);
        let statistics = self.members.len();
        for (index, (_, members)) in self.members.iter().enumerate() {
            if !members.iter().any(|&m| lit[m]) {
                continue;
            }
            self.scratch.fill(0.0);
            for &member in members.iter().filter(|&&m| lit[m]) {
                for (sum, &value) in self.scratch.iter_mut().zip(&block[member * bands..]) {
                    *sum += f64::from(value);
                }
            }
            if even {
                let range = self.plane(self.components + index);
                add(&mut sums[range.clone()], self.scratch.iter().copied(), &self.per_unit[range], sign);
            }
            let range = self.plane(self.components + statistics + index);
            let squares = self.scratch.iter().map(|v| v * v / count);
            add(&mut sums[range.clone()], squares, &self.per_unit[range], sign);
        }
    }

    /// Mean of a component, one value per coefficient.
    pub fn mean(&self, sums: &[u64], component: usize, samples: u32, mean: &mut [f32]) {
        let range = self.plane(component);
        let samples = f64::from(samples);
        for ((mean, &sum), per_unit) in mean.iter_mut().zip(&sums[range.clone()]).zip(&self.per_unit[range]) {
            *mean = (real(sum, *per_unit) / samples) as f32;
        }
    }

    /// Sums over all samples and over those of even blocks of a statistic, for `visit(band, all, even)`.
    pub fn halves(&self, sums: &[u64], statistic: usize, mut visit: impl FnMut(usize, f64, f64)) {
        let bands = self.bands;
        for band in 0..bands {
            let all = self.members[statistic].1.iter().map(|m| {
                let at = m * bands + band;
                real(sums[at], self.per_unit[at])
            });
            let at = (self.components + statistic) * bands + band;
            visit(band, all.sum(), real(sums[at], self.per_unit[at]));
        }
    }

    /// Sum over blocks of (block sum)² / samples of the block.
    fn squares(&self, sums: &[u64], statistic: usize, band: usize) -> f64 {
        let at = (self.components + self.members.len() + statistic) * self.bands + band;
        real(sums[at], self.per_unit[at])
    }
}

fn real(sum: u64, per_unit: f64) -> f64 {
    match sum as i64 {
        i64::MAX => f64::INFINITY,
        i64::MIN => f64::NEG_INFINITY,
        sum => sum as f64 / per_unit,
    }
}

/// Sum of two sums. One that has left the range stays at its end.
fn joined(a: u64, b: u64) -> u64 {
    let is_at_end = |sum: i64| sum == i64::MAX || sum == i64::MIN;
    let sum = match (a as i64, b as i64) {
        (a, _) if is_at_end(a) => a,
        (_, b) if is_at_end(b) => b,
        (a, b) => a.saturating_add(b),
    };
    sum as u64
}

/// The largest integer that is not larger. The conversion saturates: what is too large (or infinite) stays at the end of the range.
/// Baseline processors have no instruction for `f64::floor`.
#[inline(always)]
fn floored(value: f64) -> i64 {
    let whole = value as i64;
    whole.saturating_sub(i64::from(whole as f64 > value))
}

fn add(sums: &mut [u64], values: impl Iterator<Item = f64>, per_unit: &[f64], sign: BlockSign) {
    for ((sum, value), per_unit) in sums.iter_mut().zip(values).zip(per_unit) {
        let units = floored(value * per_unit + 0.5);
        *sum = match (sign, *sum as i64) {
            (BlockSign::Add, _) => joined(*sum, units as u64),
            (BlockSign::Remove, i64::MAX | i64::MIN) => *sum,
            (BlockSign::Remove, sum) => sum.wrapping_sub(units) as u64,
        };
    }
}

#[derive(Clone, Debug, PartialEq)]
struct Slab {
    tiles: Vec<FilmTile>,
    /// Empty where the film holds no samples of these tiles and will not.
    sums: Vec<u64>,
}

/// Sums of samples of every component, pixel and band, in tiles. See the [module](self) for what they promise.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    layout: FilmLayout,
    features: FeatureMaps,
    tile_len: usize,
    slabs: Vec<Slab>,
}

/// A tile of a film with its integers, `[pixel][plane][coefficient]`.
#[derive(Debug)]
pub struct TileMut<'a> {
    /// Number of the tile, row by row.
    pub number: usize,
    /// Place and samples.
    pub tile: &'a mut FilmTile,
    /// The integers; a tile at the edge of the image leaves the last ones unused, and a tile outside of the rows that the
    /// film was made for has none.
    pub sums: &'a mut [u64],
}

/// Why films can't be put together.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum MergeError {
    /// The films belong to different renders.
    #[error("the films differ in {what}: they belong to different renders")]
    Different {
        /// What differs.
        what: &'static str,
    },
    /// The same samples are there twice.
    #[error(
        "both films hold samples {start}..{end} of the tile at row {row}, column {col}: the same shard was given twice, \
         or shards of different splits were mixed"
    )]
    Overlap {
        /// Row of the tile.
        row: usize,
        /// Column of the tile.
        col: usize,
        /// First sample that is there twice.
        start: u32,
        /// End of the samples that are there twice.
        end: u32,
    },
    /// Samples end within a block.
    #[error(
        "samples of the tile at row {row}, column {col} are cut at {sample}, within a block of {BLOCK}: bits would \
         depend on the cut. Resume the first film instead"
    )]
    Cut {
        /// Row of the tile.
        row: usize,
        /// Column of the tile.
        col: usize,
        /// Where.
        sample: u32,
    },
    /// The film has no memory for samples of the other.
    #[error(
        "samples of the tile at row {row}, column {col} have no place in the film, which was made for other rows. Merge into a \
         film of the whole image"
    )]
    OutsideRows {
        /// Row of the tile.
        row: usize,
        /// Column of the tile.
        col: usize,
    },
}

impl Film {
    /// An empty film. Memory is taken from the system when samples arrive.
    pub fn new(layout: FilmLayout, features: FeatureMaps) -> Self {
        let rows = 0..layout.tile_rows();
        Self::of_tile_rows(layout, features, rows)
    }

    /// An empty film with memory for some rows of tiles only: only they can be filled.
    pub fn of_tile_rows(layout: FilmLayout, features: FeatureMaps, tile_rows: Range<usize>) -> Self {
        let (tile_width, tile_height) = (TILE.min(layout.width).max(1), TILE.min(layout.height).max(1));
        let tile_len = tile_width * tile_height * layout.plane_lens().iter().sum::<usize>();
        let per_slab = (SLAB_BYTES / (8 * tile_len).max(1)).max(1);
        let mut tiles = Vec::new();
        for row in (0..layout.height).step_by(tile_height) {
            for col in (0..layout.width).step_by(tile_width) {
                let (rows, cols) = (tile_height.min(layout.height - row), tile_width.min(layout.width - col));
                tiles.push(FilmTile { row, col, rows, cols, samples: Vec::new() });
            }
        }
        let held = layout.tiles_of_rows(tile_rows);
        let (start, end) = (held.start.min(tiles.len()), held.end.min(tiles.len()));
        let without = |tiles: &[FilmTile]| {
            (!tiles.is_empty()).then(|| Slab { tiles: tiles.to_vec(), sums: Vec::new() })
        };
        let with = tiles[start..end]
            .chunks(per_slab)
            .map(|tiles| Slab { tiles: tiles.to_vec(), sums: vec![0; tiles.len() * tile_len] });
        let slabs = without(&tiles[..start]).into_iter().chain(with).chain(without(&tiles[end..])).collect();
        Self { layout, features, tile_len, slabs }
    }

    /// Layout of the film.
    pub fn layout(&self) -> &FilmLayout {
        &self.layout
    }

    /// Geometry behind each pixel.
    pub fn features(&self) -> &FeatureMaps {
        &self.features
    }

    /// The feature maps, without the film.
    pub fn into_features(self) -> FeatureMaps {
        self.features
    }

    /// Integers of one pixel, `[plane][coefficient]`: components, then first halves, then squares of the statistics.
    pub fn pixel_len(&self) -> usize {
        self.layout.plane_lens().iter().sum()
    }

    /// All tiles with their integers, `[pixel][plane][coefficient]`, row by row.
    pub fn tiles(&self) -> impl Iterator<Item = (&FilmTile, &[u64])> {
        let len = self.tile_len.max(1);
        self.slabs.iter().flat_map(move |slab| {
            let mut sums = slab.sums.chunks(len);
            slab.tiles.iter().map(move |tile| (tile, sums.next().unwrap_or_default()))
        })
    }

    /// All tiles, to be filled.
    pub fn tiles_mut(&mut self) -> Vec<TileMut<'_>> {
        let len = self.tile_len.max(1);
        self.slabs
            .iter_mut()
            .flat_map(|slab| {
                let mut sums = slab.sums.chunks_mut(len);
                slab.tiles.iter_mut().map(move |tile| (tile, sums.next().unwrap_or_default()))
            })
            .enumerate()
            .map(|(number, (tile, sums))| TileMut { number, tile, sums })
            .collect()
    }

    /// Samples that every pixel holds at least.
    pub fn least_samples(&self) -> u32 {
        self.tiles().map(|(tile, _)| tile.count()).min().unwrap_or(0)
    }

    /// Paths that the film holds.
    pub fn paths(&self) -> u64 {
        self.tiles().map(|(tile, _)| tile.pixels() as u64 * u64::from(tile.count())).sum()
    }

    /// Adds the samples of another film of the same render: exact, in any order.
    ///
    /// # Errors
    /// Films of different renders, samples that both hold, samples that end within a block, samples outside of the rows
    /// that this film was made for ([`Self::of_tile_rows`]). The film is unchanged then.
    pub fn merge(&mut self, other: &Self) -> Result<(), MergeError> {
        // Check that both films belong to one render
        let differs = |what| Err(MergeError::Different { what });
        let (a, b) = (&self.layout, &other.layout);
        if (a.width, a.height) != (b.width, b.height) {
            return differs("their size");
        }
        if a.statistics != b.statistics {
            return differs("the statistics that they keep");
        }
        if a.scene_digest != b.scene_digest {
            return differs("their scene, seed or depth");
        }
        if a != b {
            return differs("their components, wavelengths or quanta");
        }
        // Check that no sample is in both, and that ranges end at blocks
        for ((mine, own), (theirs, sums)) in self.tiles().zip(other.tiles()) {
            if !theirs.samples.is_empty() && own.len() != sums.len() {
                return Err(MergeError::OutsideRows { row: mine.row, col: mine.col });
            }
            for (x, y) in mine.samples.iter().flat_map(|x| theirs.samples.iter().map(move |y| (x, y))) {
                let (start, end) = (x.start.max(y.start), x.end.min(y.end));
                let (row, col) = (mine.row, mine.col);
                if start < end {
                    return Err(MergeError::Overlap { row, col, start, end });
                }
                let cut = x.end.min(y.end);
                if !is_block_boundary(cut) {
                    return Err(MergeError::Cut { row, col, sample: cut });
                }
            }
        }
        // Add the sums
        for (mine, (theirs, sums)) in self.tiles_mut().into_iter().zip(other.tiles()) {
            if theirs.samples.is_empty() {
                continue;
            }
            for (a, b) in mine.sums.iter_mut().zip(sums) {
                *a = joined(*a, *b);
            }
            theirs.samples.iter().for_each(|range| mine.tile.add_samples(range.clone()));
        }
        Ok(())
    }

    /// `sum weight(component) * component`, as [`ComponentImage::recombine`] of what is there so far, black where nothing is. What an
    /// excitation basis keeps of the light besides does not count twice.
    pub fn sum(&self, weight: impl Fn(&Component) -> f64) -> SpectralImage<Radiance> {
        let bands = self.layout.grid.len();
        let scale = FilmScale::new(&self.layout);
        let mut image = SpectralImage::zeros(self.layout.grid.clone(), self.layout.width, self.layout.height);
        let mut mean = vec![0.0; bands];
        let weights: Vec<(usize, f32)> = (0..self.layout.components.len())
            .filter(|c| self.layout.components[*c].node_nm.is_none())
            .map(|c| (c, weight(&self.layout.components[c]) as f32))
            .collect();
        for (tile, sums) in self.tiles() {
            let samples = tile.count();
            if samples == 0 {
                continue;
            }
            for (index, sums) in sums.chunks(scale.pixel_len()).take(tile.pixels()).enumerate() {
                let pixel = image.pixel_mut(tile.row + index / tile.cols, tile.col + index % tile.cols);
                for &(component, weight) in &weights {
                    let mean = &mut mean[..scale.plane(component).len()];
                    scale.mean(sums, component, samples, mean);
                    match self.layout.basis(component) {
                        Some(basis) => basis.add(weight, mean, pixel),
                        None => pixel.iter_mut().zip(mean).for_each(|(sum, value)| *sum += weight * *value),
                    }
                }
            }
        }
        image
    }

    /// The finished image. Memory of the film is given back on the way, so that both together never need more than the
    /// film and 64 MiB.
    pub fn into_image(self) -> ComponentImage {
        let rows = 0..self.layout.height;
        self.into_rows(rows)
    }

    /// Some rows of the finished image, as an image of their own: what [`Self::into_image`] holds there, in the same
    /// memory. The feature maps are those of the film, all of them.
    pub fn into_rows(self, rows: Range<usize>) -> ComponentImage {
        let layout = self.layout;
        let (bands, width, height) = (layout.grid.len(), layout.width, rows.len());
        let scale = FilmScale::new(&layout);
        let plane = width * height * bands;
        let values =
            (0..layout.components.len()).map(|component| scale.plane(component).len()).sum::<usize>();
        let mut image = ComponentImage {
            data: vec![0.0; width * height * values],
            bases: layout.bases.clone(),
            components: layout.components.clone(),
            ..ComponentImage::zeros(layout.grid.clone(), width, height, Vec::new())
        };
        let names: Vec<String> = scale.members.iter().map(|(name, _)| name.clone()).collect();
        let mut statistics = (!names.is_empty()).then(|| SampleStatistics {
            of: layout.statistics,
            half_a: vec![0.0; names.len() * plane],
            half_b: vec![0.0; names.len() * plane],
            variance: vec![0.0; names.len() * plane],
            names,
        });
        let mut samples = vec![0; width * height];
        // Slab by slab, each given back when its sums are read: image and film share their memory
        for slab in self.slabs {
            // Slabs without sums hold no samples.
            let tiles = slab.tiles.iter().zip(slab.sums.chunks(self.tile_len.max(1)));
            let held = tiles.filter(|(tile, _)| tile.count() > 0 && rows.contains(&tile.row));
            let pixels: Vec<PixelSums<'_>> = held
                .flat_map(|(tile, sums)| {
                    let sums = sums.chunks(scale.pixel_len()).take(tile.pixels()).enumerate();
                    sums.map(|(index, sums)| PixelSums {
                        tile,
                        pixel: (tile.row - rows.start + index / tile.cols) * width
                            + tile.col
                            + index % tile.cols,
                        sums,
                    })
                })
                .collect();
            for of in &pixels {
                samples[of.pixel] = of.tile.count();
            }
            let mut rest = image.data.as_mut_slice();
            let mut of_component = Vec::with_capacity(layout.components.len());
            for component in 0..layout.components.len() {
                let (own, after) =
                    std::mem::take(&mut rest).split_at_mut(width * height * scale.plane(component).len());
                of_component.push(own);
                rest = after;
            }
            of_component.into_par_iter().enumerate().for_each(|(component, means)| {
                let len = scale.plane(component).len();
                for of in &pixels {
                    let means = &mut means[of.pixel * len..(of.pixel + 1) * len];
                    scale.mean(of.sums, component, of.tile.count(), means);
                }
            });
            let Some(statistics) = &mut statistics else { continue };
            let half_a = statistics.half_a.par_chunks_mut(plane.max(1));
            let half_b = statistics.half_b.par_chunks_mut(plane.max(1));
            let variance = statistics.variance.par_chunks_mut(plane.max(1));
            half_a.zip(half_b).zip(variance).enumerate().for_each(
                |(statistic, ((half_a, half_b), variance))| {
                    for PixelSums { tile, pixel, sums } in &pixels {
                        let (count, (blocks, even)) = (tile.count(), tile.blocks());
                        scale.halves(sums, statistic, |band, all, half| {
                            let (at, other) = (pixel * bands + band, (all - half).max(0.0));
                            half_a[at] = (half / f64::from(even.max(1))) as f32;
                            half_b[at] = (other / f64::from((count - even).max(1))) as f32;
                            let scatter = scale.squares(sums, statistic, band) - all * all / f64::from(count);
                            variance[at] = if blocks < 2 {
                                f32::INFINITY
                            } else {
                                (scatter.max(0.0) / f64::from(blocks - 1) / f64::from(count)) as f32
                            };
                        });
                    }
                },
            );
        }
        image.samples_per_pixel = samples.iter().copied().min().unwrap_or(0);
        if samples.iter().any(|&n| n != image.samples_per_pixel) {
            image.samples = samples;
        }
        image.statistics = statistics;
        image.features = self.features;
        image
    }
}

/// What a film holds of one pixel.
struct PixelSums<'a> {
    tile: &'a FilmTile,
    /// Index of the pixel in the image that is made.
    pixel: usize,
    sums: &'a [u64],
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::LightPath;

    fn layout(statistics: StatisticsKind) -> FilmLayout {
        let label = |light| Component::of_group("blue", light);
        let grid = WavelengthGrid::uniform(400.0, 410.0, 5.0).unwrap();
        FilmLayout {
            components: vec![label(LightPath::Reflected), label(LightPath::MultipleFluorescence)],
            bases: Vec::new(),
            exponents: vec![-30; 2 * grid.len()],
            levels: vec![1.0; 2 * grid.len()],
            grid,
            width: 3,
            height: 2,
            statistics,
            scene_digest: "a".into(),
        }
    }

    #[test]
    fn numbers_are_floored_as_the_standard_library_does() {
        let values = [0.0, -0.0, 0.5, -0.5, 3.0, -3.0, 1e15 + 0.5, -1e15 - 0.5, 1e300, -1e300];
        for value in values.into_iter().chain([f64::INFINITY, f64::NEG_INFINITY, f64::NAN]) {
            assert_eq!(floored(value), value.floor() as i64, "{value}");
        }
    }

    /// Samples of translucent surfaces may be negative, and lie in blocks of their own: they count as they are.
    #[test]
    fn negative_samples_are_kept() {
        let layout = layout(StatisticsKind::None);
        let mut scale = FilmScale::new(&layout);
        let mut sums = vec![0; 2 * layout.grid.len()];
        let (lit, mut mean) = ([true, false], vec![0.0; layout.grid.len()]);
        for (number, value) in [-0.5, 2.0, -0.25, 4.0].into_iter().enumerate() {
            let samples = number as u32..number as u32 + 1;
            let sign = if number == 3 { BlockSign::Remove } else { BlockSign::Add };
            scale.add_block(&mut sums, &vec![value; 2 * layout.grid.len()], &lit, samples, sign);
        }
        scale.mean(&sums, 0, 1, &mut mean);
        assert_eq!(mean, vec![-2.75; layout.grid.len()]);
        // Also in films that are merged, and what is too large stays so
        let of = |value: i64| value as u64;
        assert_eq!(joined(of(-5), of(10)), of(5));
        assert_eq!(joined(of(-5), of(-3)), of(-8));
        assert_eq!(joined(of(i64::MAX), of(-3)), of(i64::MAX));
    }

    /// A sample that any run gives again.
    fn sample(pixel: usize, sample: u32, at: usize) -> f32 {
        let hash = (pixel as u32 * 7919 + sample * 104_729 + at as u32 * 1299).wrapping_mul(2_654_435_761);
        (hash >> 8) as f32 / 16_777_216.0
    }

    fn fill(film: &mut Film, samples: Range<u32>) {
        let mut scale = FilmScale::new(film.layout());
        for task in film.tiles_mut() {
            let mut first = samples.start;
            if !is_block_boundary(first) {
                let start = block_start(first);
                add_block(&mut scale, task.tile, task.sums, start..first, BlockSign::Remove);
                first = start;
            }
            while first < samples.end {
                let end = block_end(first).min(samples.end);
                add_block(&mut scale, task.tile, task.sums, first..end, BlockSign::Add);
                first = end;
            }
            task.tile.add_samples(samples.clone());
        }
    }

    fn add_block(
        scale: &mut FilmScale,
        tile: &FilmTile,
        sums: &mut [u64],
        samples: Range<u32>,
        sign: BlockSign,
    ) {
        let len = scale.pixel_len();
        for (pixel, sums) in sums.chunks_mut(len).take(tile.pixels()).enumerate() {
            let mut block = vec![0.0; 6];
            for s in samples.clone() {
                block.iter_mut().enumerate().for_each(|(at, sum)| *sum += sample(pixel, s, at));
            }
            scale.add_block(sums, &block, &[true, true], samples.clone(), sign);
        }
    }

    #[test]
    fn blocks_tile_all_samples() {
        let (mut first, mut number) = (0, 0);
        while first < 4096 {
            let end = block_end(first);
            for s in first..end {
                assert_eq!((block_start(s), block_end(s), block_number(s)), (first, end, number), "{s}");
                assert_eq!(is_block_boundary(s), s == first);
            }
            (first, number) = (end, number + 1);
        }
    }

    #[test]
    fn parts_in_any_order_and_an_extended_tail_give_the_bits_of_the_whole() {
        for statistics in [StatisticsKind::None, StatisticsKind::LightGroups, StatisticsKind::Components] {
            let empty = Film::new(layout(statistics), FeatureMaps::default());
            let mut whole = empty.clone();
            fill(&mut whole, 0..100);
            let mut parts = Vec::new();
            for range in [32..64, 0..32, 64..100] {
                let mut part = empty.clone();
                fill(&mut part, range);
                parts.push(part);
            }
            let mut merged = empty.clone();
            parts.iter().for_each(|part| merged.merge(part).unwrap());
            assert_eq!(merged, whole);
            let mut extended = empty.clone();
            for range in [0..3, 3..37, 37..100] {
                fill(&mut extended, range);
            }
            assert_eq!(extended, whole);
            let again = merged.merge(&parts[0]);
            assert_eq!(again, Err(MergeError::Overlap { row: 0, col: 0, start: 32, end: 64 }));
        }
    }

    #[test]
    fn what_does_not_belong_together_is_refused() {
        let mut film = Film::new(layout(StatisticsKind::None), FeatureMaps::default());
        fill(&mut film, 0..20);
        let mut rest = Film::new(layout(StatisticsKind::None), FeatureMaps::default());
        fill(&mut rest, 20..32);
        assert_eq!(film.merge(&rest), Err(MergeError::Cut { row: 0, col: 0, sample: 20 }));
        let mut other = layout(StatisticsKind::None);
        other.scene_digest = "b".into();
        let other = Film::new(other, FeatureMaps::default());
        assert_eq!(film.merge(&other), Err(MergeError::Different { what: "their scene, seed or depth" }));
    }

    #[test]
    fn means_halves_and_variance_are_those_of_the_samples() {
        let mut film = Film::new(layout(StatisticsKind::Components), FeatureMaps::default());
        fill(&mut film, 0..64);
        let image = film.into_image();
        let statistics = image.statistics.as_ref().unwrap();
        let (pixel, component, band) = (4, 1, 2);
        let at = (component * 6 + pixel) * 3 + band;
        let value = |s| f64::from(sample(pixel, s, component * 3 + band));
        let mean = (0..64).map(value).sum::<f64>() / 64.0;
        assert!((f64::from(image.data[at]) - mean).abs() < 1e-7 * mean);
        let (mut even, mut n, mut first, mut squares, mut blocks) = (0.0, 0.0, 0, 0.0, 0.0);
        while first < 64 {
            let block: f64 = (first..block_end(first)).map(value).sum();
            let len = f64::from(block_end(first) - first);
            if block_number(first).is_multiple_of(2) {
                (even, n) = (even + block, n + len);
            }
            (squares, blocks) = (squares + block * block / len, blocks + 1.0);
            first = block_end(first);
        }
        // Values and sums of 32-bit floats.
        assert!((f64::from(statistics.half_a[at]) - even / n).abs() < 1e-6);
        assert!((f64::from(statistics.half_b[at]) - (64.0 * mean - even) / (64.0 - n)).abs() < 1e-6);
        let variance = (squares - 64.0 * mean * mean) / (blocks - 1.0) / 64.0;
        assert!((f64::from(statistics.variance[at]) - variance).abs() < 1e-4 * variance);
    }

    #[test]
    fn a_basis_keeps_coefficients_and_gives_all_bands() {
        let mut short = layout(StatisticsKind::None);
        // The last component has one coefficient, its band 1, and is shaped 1 : 2 : 3, the first as it is
        let basis = SpectralBasis::new(vec![0.5, 1.0, 1.5], vec![0.0, 1.0, 0.0], 0.0).unwrap();
        (short.bases, short.exponents) = (vec![None, Some(basis.into())], vec![-30; 4]);
        let mut film = Film::new(short, FeatureMaps::default());
        assert_eq!((film.pixel_len(), film.layout().memory_bytes()), (4, 4 * 8 * 6));
        let mut scale = FilmScale::new(film.layout());
        for task in film.tiles_mut() {
            for sums in task.sums.chunks_mut(4) {
                scale.add_block(sums, &[1.0, 2.0, 3.0, 4.0], &[true, true], 0..1, BlockSign::Add);
            }
            task.tile.add_samples(0..1);
        }
        let sum = film.sum(|component| if component.light == LightPath::Reflected { 1.0 } else { 10.0 });
        assert_eq!(sum.pixel(1, 2), [21.0, 42.0, 63.0]);
        let image = film.into_image();
        assert_eq!((image.stored(1), &image.component(1)[..4]), (&[4.0; 6][..], &[2.0, 4.0, 6.0, 2.0][..]));
        assert_eq!(image.recombine(|_| 1.0).pixel(0, 1), [3.0, 6.0, 9.0]);
        assert_eq!(image.all_values()[..18], image.component(0)[..]);
        assert_eq!(image.all_values()[33..], image.spectrum(1, 5)[..]);
    }

    #[test]
    fn rows_are_those_of_the_image() {
        let mut layout = layout(StatisticsKind::LightGroups);
        (layout.width, layout.height) = (20, 40);
        let fill = |film: &mut Film| {
            let mut scale = FilmScale::new(film.layout());
            for task in film.tiles_mut().into_iter().filter(|task| !task.sums.is_empty()) {
                let len = scale.pixel_len();
                for (pixel, sums) in task.sums.chunks_mut(len).take(task.tile.pixels()).enumerate() {
                    let pixel = 100 * task.number + pixel;
                    let values: Vec<f32> = (0..6).map(|at| sample(pixel, 0, at)).collect();
                    scale.add_block(sums, &values, &[true, true], 0..1, BlockSign::Add);
                }
                task.tile.add_samples(0..1);
            }
        };
        let mut whole = Film::new(layout.clone(), FeatureMaps::default());
        fill(&mut whole);
        let image = whole.into_image();
        assert_eq!(
            (layout.tile_rows(), layout.pixel_rows(1..3), layout.tiles_of_rows(1..3)),
            (3, 16..40, 2..6)
        );
        for tile_rows in [0..1, 1..3, 2..3] {
            let mut part = Film::of_tile_rows(layout.clone(), FeatureMaps::default(), tile_rows.clone());
            fill(&mut part);
            assert_eq!(part.tiles().filter(|(_, sums)| !sums.is_empty()).count(), 2 * tile_rows.len());
            let rows = layout.pixel_rows(tile_rows);
            let part = part.into_rows(rows.clone());
            let values = 20 * 3;
            for component in 0..2 {
                let expected = &image.component(component)[rows.start * values..rows.end * values];
                assert_eq!(part.component(component).as_ref(), expected);
            }
            let (a, b) = (part.statistics.unwrap(), image.statistics.as_ref().unwrap());
            assert_eq!(a.half_a, b.half_a[rows.start * values..rows.end * values]);
        }
    }

    #[test]
    fn a_film_of_some_rows_takes_no_samples_of_others() {
        let mut layout = layout(StatisticsKind::None);
        (layout.width, layout.height) = (20, 40);
        let of = |tile_rows: Range<usize>, samples: Range<u32>| {
            let mut film = Film::of_tile_rows(layout.clone(), FeatureMaps::default(), tile_rows.clone());
            let tiles = layout.tiles_of_rows(tile_rows);
            let mut scale = FilmScale::new(&layout);
            for task in film.tiles_mut().into_iter().filter(|task| tiles.contains(&task.number)) {
                add_block(&mut scale, task.tile, task.sums, samples.clone(), BlockSign::Add);
                task.tile.add_samples(samples.clone());
            }
            film
        };
        let mut upper = of(0..2, 0..1);
        for (rows, row) in [(0..3, 32), (1..3, 32), (2..3, 32)] {
            let before = upper.clone();
            assert_eq!(upper.merge(&of(rows, 1..2)), Err(MergeError::OutsideRows { row, col: 0 }));
            assert_eq!(upper, before);
        }
        // Other films of these rows are taken, and films of the whole take all.
        upper.merge(&of(1..2, 1..2)).unwrap();
        let mut whole = Film::new(layout.clone(), FeatureMaps::default());
        for part in [&upper, &of(2..3, 0..1), &of(0..1, 1..2), &of(2..3, 1..2)] {
            whole.merge(part).unwrap();
        }
        let mut at_once = of(0..3, 0..1);
        at_once.merge(&of(0..3, 1..2)).unwrap();
        assert_eq!(whole, at_once);
    }

    #[test]
    fn a_sum_that_leaves_the_range_is_infinite() {
        let mut film = Film::new(layout(StatisticsKind::None), FeatureMaps::default());
        let mut scale = FilmScale::new(film.layout());
        for task in film.tiles_mut() {
            let block = [f32::INFINITY, 1e38, 1.0, 1.0, 1.0, 1.0];
            for s in 0..2 {
                scale.add_block(&mut task.sums[..6], &block, &[true, true], s..s + 1, BlockSign::Add);
                task.tile.add_samples(s..s + 1);
            }
        }
        let image = film.into_image();
        assert!(image.data[0].is_infinite() && image.data[1].is_infinite());
        assert_eq!(image.data[2], 1.0);
    }
}
