//! Images whose film is larger than the memory limit: rendered in bands of tile rows, one after the other.
//!
//! Each band gets all its samples before the next one begins, and its finished rows go to a [`BandStore`] at once, so the
//! film of one band is all that stays in memory besides the maps of all pixels. The rows are those of a render in one go,
//! bit for bit.

use std::ops::Range;

use crate::image::{Component, ComponentImage, FeatureMaps, Film, FilmLayout, SampleStatistics};
use crate::render::{RenderSettings, Share, basis_bytes, tile_row_bytes, whole_image_bytes};
use crate::scene::Scene;

/// Why an image can't be divided into bands of tile rows.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RowBandError {
    /// One row of tiles and the maps of all pixels are larger than the limit.
    #[error(
        "one band of rows and the maps of all pixels need {needed} bytes, more than the limit of {limit}"
    )]
    Memory {
        /// Bytes of one row of tiles and of the maps.
        needed: u64,
        /// Limit, bytes.
        limit: u64,
    },
    /// A band that was begun before overlaps another one or lies outside of the image.
    #[error("the tile rows {} to {} do not match the other bands", .0.start, .0.end)]
    Overlap(Range<usize>),
    /// A band that was begun before is larger than what fits into the limit now.
    #[error("the tile rows {} to {} are more than the {fit} that fit into the memory limit", .band.start, .band.end)]
    TooTall {
        /// The band, in rows of tiles.
        band: Range<usize>,
        /// Rows of tiles that fit.
        fit: usize,
    },
}

/// Rows of tiles whose film fits into the memory limit at once, besides the maps of all pixels: at least 1.
///
/// # Errors
/// A limit below one row of tiles.
pub fn tile_rows_at_once(scene: &Scene, settings: &RenderSettings) -> Result<usize, RowBandError> {
    let maps = whole_image_bytes(scene) + basis_bytes(scene, settings);
    let per_row = tile_row_bytes(scene, settings);
    let (needed, limit) = (maps + per_row, settings.memory_limit_bytes);
    if needed > limit {
        return Err(RowBandError::Memory { needed, limit });
    }
    Ok(((limit - maps) / per_row.max(1)) as usize)
}

/// Divides rows of tiles into bands of at most `at_once` (at least 1) rows: the bands that an earlier render began, `begun`,
/// and between them new ones.
///
/// # Errors
/// Bands that overlap, lie outside of the image, are empty, or do not fit.
pub fn row_bands(
    tile_rows: usize,
    at_once: usize,
    mut begun: Vec<Range<usize>>,
) -> Result<Vec<Range<usize>>, RowBandError> {
    begun.sort_by_key(|band| band.start);
    let fit = at_once.max(1);
    let mut bands: Vec<Range<usize>> = Vec::new();
    let mut next = 0;
    for band in begun.into_iter().chain(std::iter::once(tile_rows..tile_rows)) {
        let last = band.start == tile_rows;
        if band.start < next || band.end > tile_rows || (band.is_empty() && !last) {
            return Err(RowBandError::Overlap(band));
        }
        while next < band.start {
            let end = (next + fit).min(band.start);
            bands.push(next..end);
            next = end;
        }
        if band.len() > fit {
            return Err(RowBandError::TooTall { band, fit: at_once });
        }
        if !last {
            next = band.end;
            bands.push(band);
        }
    }
    Ok(bands)
}

/// Which planes of an image in bands are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BandPlanes {
    /// Every component, and the two halves and the variance of each statistic.
    Components,
    /// The sum of all components.
    Sum,
}

impl BandPlanes {
    /// Values of a pixel in the planes of an image: the components, then the first half, the second half and the variance of all statistics;
    /// or one plane.
    pub fn stored(self, layout: &FilmLayout) -> Vec<usize> {
        let bands = layout.grid.len();
        match self {
            Self::Components => {
                let mut stored = layout.plane_lens();
                stored.extend(std::iter::repeat_n(bands, layout.statistic_members().len()));
                stored
            }
            Self::Sum => vec![bands],
        }
    }
}

/// Films and finished rows of a render in bands, and its progress: what a front does while the bands are rendered.
pub trait BandStore {
    /// Error of the store.
    type Error;

    /// The film of a band that was begun before, if there is one.
    ///
    /// # Errors
    /// A film that can't be read or belongs to another render.
    fn load(&mut self, band: &Range<usize>) -> Result<Option<Film>, Self::Error>;

    /// Renders what the film of a band lacks of a share, with the front's progress, checkpoints and way to stop
    /// ([`crate::render::FilmRenderer::fill`]). Returns whether nothing is lacking.
    ///
    /// # Errors
    /// A render that can't start, a film that can't be saved.
    fn fill(&mut self, band: &Range<usize>, share: &Share, film: &mut Film) -> Result<bool, Self::Error>;

    /// Keeps finished rows of a plane, from a row of pixels on, `[row, col, band]`: of a component its coefficients.
    ///
    /// # Errors
    /// Storage that fails.
    fn store_rows(&mut self, plane: usize, first_row: usize, values: &[f32]) -> Result<(), Self::Error>;
}

/// Labels and feature maps of an image that was rendered in bands.
#[derive(Clone, Debug, PartialEq)]
pub struct FinishedBands {
    /// Samples of every pixel, `[row, col]`.
    samples: Vec<u32>,
    /// Sum over all pixels and components, one per wavelength bin.
    sums: Vec<f64>,
}

impl FinishedBands {
    /// Mean spectrum of the image, W/(sr m² nm).
    pub fn mean_spectrum(&self) -> Vec<f64> {
        let pixels = self.samples.len().max(1) as f64;
        self.sums.iter().map(|sum| sum / pixels).collect()
    }

    /// Everything of the component image but its pixels and those of its statistics.
    pub fn into_labels(self, layout: FilmLayout, features: FeatureMaps) -> ComponentImage {
        let names: Vec<String> = layout.statistic_members().into_iter().map(|(name, _)| name).collect();
        let statistics = (!names.is_empty()).then(|| SampleStatistics {
            of: layout.statistics,
            names,
            half_a: Vec::new(),
            half_b: Vec::new(),
            variance: Vec::new(),
        });
        let least = self.samples.iter().copied().min().unwrap_or(0);
        let even = self.samples.iter().all(|&samples| samples == least);
        ComponentImage {
            grid: layout.grid,
            width: layout.width,
            height: layout.height,
            components: layout.components,
            bases: layout.bases,
            data: Vec::new(),
            samples_per_pixel: least,
            samples: if even { Vec::new() } else { self.samples },
            features,
            statistics,
            denoised: None,
        }
    }

    /// Adds the rows of a finished film and stores their planes.
    fn add<S: BandStore>(
        &mut self,
        film: Film,
        rows: Range<usize>,
        (planes, weight): (BandPlanes, &dyn Fn(&Component) -> f64),
        store: &mut S,
    ) -> Result<(), S::Error> {
        let image = film.into_rows(rows.clone());
        let own = &mut self.samples[rows.start * image.width..rows.end * image.width];
        if image.samples.is_empty() {
            own.fill(image.samples_per_pixel);
        } else {
            own.copy_from_slice(&image.samples);
        }
        if planes == BandPlanes::Components {
            let count = image.components.len();
            for component in 0..count {
                store.store_rows(component, rows.start, image.stored(component))?;
            }
            if let Some(statistics) = &image.statistics {
                let names = statistics.names.len();
                let plane = image.width * image.height * image.grid.len();
                let kinds = [&statistics.half_a, &statistics.half_b, &statistics.variance];
                for (kind, data) in kinds.into_iter().enumerate() {
                    for (index, data) in data.chunks_exact(plane).enumerate() {
                        store.store_rows(count + kind * names + index, rows.start, data)?;
                    }
                }
            }
        }
        let sum = image.recombine(weight);
        drop(image);
        for pixel in sum.data().chunks_exact(self.sums.len()) {
            self.sums.iter_mut().zip(pixel).for_each(|(sum, &value)| *sum += f64::from(value));
        }
        if planes == BandPlanes::Sum {
            store.store_rows(0, rows.start, sum.data())?;
        }
        Ok(())
    }
}

/// How a render in bands ended.
#[derive(Clone, Debug, PartialEq)]
pub enum BandedRender {
    /// All rows are stored.
    Finished(FinishedBands),
    /// Stopped within these rows of pixels. Rows before them are stored; the store holds what is to be gone on from.
    Stopped(Range<usize>),
}

/// Renders an image in bands of tile rows ([`row_bands`]) and stores their finished rows. In the sum and in the
/// mean a component counts by its `weight`.
///
/// # Errors
/// Those of the store.
pub fn render_row_bands<S: BandStore>(
    layout: &FilmLayout,
    samples_per_pixel: u32,
    bands: &[Range<usize>],
    (planes, weight): (BandPlanes, &dyn Fn(&Component) -> f64),
    store: &mut S,
) -> Result<BandedRender, S::Error> {
    let mut finished =
        FinishedBands { samples: vec![0; layout.width * layout.height], sums: vec![0.0; layout.grid.len()] };
    for band in bands {
        // Take up the film of this band, or begin one
        let begun = store.load(band)?;
        let empty = || Film::of_tile_rows(layout.clone(), FeatureMaps::default(), band.clone());
        let mut film = begun.unwrap_or_else(empty);

        // Render the samples that it lacks
        let tiles = layout.tiles_of_rows(band.clone());
        let all = |held: &[Range<u32>]| matches!(held, [held] if *held == (0..samples_per_pixel));
        let complete =
            film.tiles().skip(tiles.start).take(tiles.len()).all(|(tile, _)| all(tile.samples.as_slice()));
        let rows = layout.pixel_rows(band.clone());
        if !complete && !store.fill(band, &Share::TileRange(tiles), &mut film)? {
            return Ok(BandedRender::Stopped(rows));
        }

        // Store its rows
        finished.add(film, rows, (planes, weight), store)?;
    }
    Ok(BandedRender::Finished(finished))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_fill_the_gaps_between_those_that_were_begun() {
        assert_eq!(row_bands(7, 3, Vec::new()).unwrap(), [0..3, 3..6, 6..7]);
        assert_eq!(row_bands(7, 3, vec![4..6, 0..2]).unwrap(), [0..2, 2..4, 4..6, 6..7]);
        assert_eq!(row_bands(2, 0, Vec::new()).unwrap(), [0..1, 1..2]);
        assert_eq!(row_bands(7, 3, vec![0..3, 2..4]), Err(RowBandError::Overlap(2..4)));
        let one = |band: Range<usize>| row_bands(7, 3, std::iter::once(band).collect());
        assert_eq!(one(5..8), Err(RowBandError::Overlap(5..8)));
        let tall = RowBandError::TooTall { band: 1..6, fit: 3 };
        assert_eq!(one(1..6), Err(tall));
    }
}
