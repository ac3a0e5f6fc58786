//! Adaptive sampling: a tile gets samples until its error is small enough.
//!
//! A tile is checked when it holds 32, 64, 128, ... samples, and is done when in every channel the root mean square
//! over its pixels of the standard error is below the wanted share of the tile's mean. The standard error of a pixel
//! comes from the difference of its half-buffers. Tiles are checked by doubling and as a whole, so the results hold the
//! same bits for any number of threads, shards by tile and interruptions.
//!
//! Bias: whether a pixel gets more samples depends, through the error of its tile, on the samples that it keeps. One
//! pixel is one of 256 in that error, and what is compared is the spread, not the value; still, where rare bright
//! samples carry much of the light, tiles that have not found one yet stop earlier, and are too dark on average. A render
//! with the same number of samples everywhere has no such bias: use it for validation.

use thiserror::Error;

use crate::image::FilmLayout;
use crate::image::film::{FilmScale, FilmTile};

/// Samples at which a tile is checked first; then at every doubling.
pub const FIRST_ERROR_CHECK: u32 = 32;
/// Tiles darker than this share of the image need no smaller absolute error than a tile at this share.
const DARK: f64 = 0.01;

/// One weighted sum over light groups and bands: what a pixel of a sensor sees, or the radiance in some bands.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorChannel {
    /// Name for messages.
    pub name: String,
    /// Drive of each light group, in the scene's order.
    pub drives: Vec<f64>,
    /// Weight of each band, bin width included.
    pub weights: Vec<f64>,
}

/// When a tile is done.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorTarget {
    /// Root mean square over a tile of the standard error of its pixels, relative to the mean of the tile (or to 1 % of
    /// the mean of the image where the tile is darker than that).
    pub relative_error: f64,
    /// Channels that must all reach it.
    pub channels: Vec<ErrorChannel>,
}

/// Why an error target is invalid.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ErrorTargetError {
    /// The relative error is out of range.
    #[error("{relative_error} must be between 0 and 1")]
    RelativeError {
        /// The requested value.
        relative_error: f64,
    },
    /// There are no channels.
    #[error("there is no channel to watch")]
    NoChannels,
    /// A channel has weights or drives for another scene.
    #[error(
        "channel \"{channel}\" has {weights} weights and {drives} drives for {bands} bands and {groups} light groups"
    )]
    Lengths {
        /// Name of the channel.
        channel: String,
        /// Weights of the channel.
        weights: usize,
        /// Drives of the channel.
        drives: usize,
        /// Bands of the scene.
        bands: usize,
        /// Light groups of the scene.
        groups: usize,
    },
    /// A weight is invalid.
    #[error("channel \"{channel}\" has a negative or infinite weight")]
    Weight {
        /// Name of the channel.
        channel: String,
    },
    /// A channel without light.
    #[error("channel \"{channel}\" sees no light: all its weights are zero")]
    Dark {
        /// Name of the channel.
        channel: String,
    },
}

impl ErrorTarget {
    /// Refuses targets that no tile of a scene can be held to.
    pub(super) fn check(&self, bands: usize, groups: usize) -> Result<(), ErrorTargetError> {
        let relative_error = self.relative_error;
        if !(relative_error > 0.0 && relative_error < 1.0) {
            return Err(ErrorTargetError::RelativeError { relative_error });
        }
        if self.channels.is_empty() {
            return Err(ErrorTargetError::NoChannels);
        }
        for ErrorChannel { name, drives, weights } in &self.channels {
            let channel = name.clone();
            if weights.len() != bands || drives.len() != groups {
                let (weights, drives) = (weights.len(), drives.len());
                return Err(ErrorTargetError::Lengths { channel, weights, drives, bands, groups });
            }
            if weights.iter().chain(drives).any(|w| !w.is_finite() || *w < 0.0) {
                return Err(ErrorTargetError::Weight { channel });
            }
            if weights.iter().all(|&w| w == 0.0) || drives.iter().all(|&d| d == 0.0) {
                return Err(ErrorTargetError::Dark { channel });
            }
        }
        Ok(())
    }
}

/// An error target prepared for one film.
#[derive(Clone, Debug)]
pub(super) struct TileError {
    relative_error: f64,
    /// Drive of each statistic, weights of the bands, mean over the image.
    channels: Vec<(Vec<f64>, Vec<f64>, f64)>,
}

impl TileError {
    pub(super) fn new(target: Option<&ErrorTarget>, layout: &FilmLayout) -> Self {
        let Some(target) = target else { return Self { relative_error: 0.0, channels: Vec::new() } };
        let mut groups: Vec<&str> = Vec::new();
        for component in &layout.components {
            if groups.last() != Some(&component.light_group.as_str()) {
                groups.push(&component.light_group);
            }
        }
        let bands = layout.grid.len();
        let members = layout.statistic_members();
        let channels = target.channels.iter().map(|channel| {
            let of_component: Vec<f64> = layout
                .components
                .iter()
                .map(|c| groups.iter().position(|group| *group == c.light_group))
                .map(|group| group.map_or(0.0, |index| channel.drives[index]))
                .collect();
            // All members of a statistic belong to one light group.
            let drives = members.iter().map(|(_, members)| of_component[members[0]]).collect();
            let level = layout.levels.chunks(bands).zip(&of_component).map(|(level, drive)| {
                drive * level.iter().zip(&channel.weights).map(|(l, w)| f64::from(*l) * w).sum::<f64>()
            });
            (drives, channel.weights.clone(), level.sum())
        });
        Self { relative_error: target.relative_error, channels: channels.collect() }
    }

    /// Whether a tile is done.
    pub(super) fn is_met(&self, scale: &FilmScale, tile: &FilmTile, sums: &[u64]) -> bool {
        let count = tile.count();
        let is_checked = count >= FIRST_ERROR_CHECK && count.is_power_of_two() && tile.samples.len() == 1;
        if self.channels.is_empty() || !is_checked {
            return false;
        }
        let errors = self.channels.iter().map(|channel| relative_error(channel, scale, tile, sums));
        errors.fold(0.0, f64::max) <= self.relative_error
    }
}

fn relative_error(
    (drives, weights, level): &(Vec<f64>, Vec<f64>, f64),
    scale: &FilmScale,
    tile: &FilmTile,
    sums: &[u64],
) -> f64 {
    let (n, even) = (f64::from(tile.count()), f64::from(tile.blocks().1));
    let odd = n - even;
    let (mut signal, mut variance) = (0.0, 0.0);
    for sums in sums.chunks(scale.pixel_len()).take(tile.pixels()) {
        let (mut all, mut half) = (0.0, 0.0);
        for (statistic, drive) in drives.iter().enumerate().filter(|(_, drive)| **drive > 0.0) {
            scale.halves(sums, statistic, |band, of_all, of_half| {
                all += drive * weights[band] * of_all;
                half += drive * weights[band] * of_half;
            });
        }
        signal += all / n;
        // Var((A + B) / n) of two halves with `even` and `odd` samples, from their one difference.
        variance += (half / even - (all - half) / odd).powi(2) * even * odd / (n * n);
    }
    let pixels = tile.pixels() as f64;
    let reference = (signal / pixels).max(DARK * level);
    if reference > 0.0 { (variance / pixels).sqrt() / reference } else { 0.0 }
}
