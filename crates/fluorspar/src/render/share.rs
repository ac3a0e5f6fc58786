//! Shards: which samples of which tiles one process renders.

use std::ops::Range;

use super::error::RenderError;
use super::settings::RenderSettings;
use crate::image::film::block_start;

/// Which samples of which tiles one process renders.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Share {
    /// All.
    #[default]
    Whole,
    /// Every `count`th tile, from tile `index` (0 to `count - 1`) on.
    Tiles {
        /// Number of the shard, from 0.
        index: u32,
        /// Number of shards.
        count: u32,
    },
    /// Tiles by number, row by row.
    TileRange(Range<usize>),
    /// One of `count` runs of samples of every tile, about equally long, cut between blocks.
    Samples {
        /// Number of the shard, from 0.
        index: u32,
        /// Number of shards.
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

    /// Whether a tile belongs to the share.
    pub(super) fn holds(&self, tile: usize) -> bool {
        match self {
            Self::Tiles { index, count } => tile as u64 % u64::from(*count) == u64::from(*index),
            Self::TileRange(tiles) => tiles.contains(&tile),
            _ => true,
        }
    }

    /// Refuses shares that do not exist.
    pub(super) fn check(&self, settings: &RenderSettings) -> Result<(), RenderError> {
        let &(Self::Tiles { index, count } | Self::Samples { index, count }) = self else { return Ok(()) };
        if index >= count {
            return Err(RenderError::NoSuchShard { number: index + 1, count });
        }
        if let Self::Samples { .. } = self {
            let samples_per_pixel = settings.samples_per_pixel;
            if settings.error_target.is_some() {
                return Err(RenderError::SampleShardsWithErrorTarget { count });
            }
            if self.samples(samples_per_pixel).is_empty() {
                return Err(RenderError::TooManySampleShards { count, samples_per_pixel });
            }
        }
        Ok(())
    }
}
