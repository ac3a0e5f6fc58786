//! Which raw pixels enter an interpolated value, and so how certain a mean of such values is.

use serde::{Deserialize, Serialize};

use super::Mosaic;

/// A pixel that enters an interpolated value: offset in rows and columns, and weight.
pub(crate) type Tap = (isize, isize, f32);

/// Weights by which the raw values of a mosaic make up every channel of every pixel.
///
/// At the border the image is mirrored without repeating its edge where the cell has at most two rows (columns), which keeps
/// the colors in place; longer cells leave out what lies outside. Weights are brought to a sum of 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InterpolationTaps {
    mosaic: Mosaic,
    /// Taps by `[row of cell, column of cell, channel]`, weights not normalized.
    taps: Vec<Vec<Tap>>,
}

impl InterpolationTaps {
    /// Taps by `[row of cell, column of cell, channel]`.
    pub(crate) fn new(mosaic: &Mosaic, taps: Vec<Vec<Tap>>) -> Self {
        Self { mosaic: mosaic.clone(), taps }
    }

    /// The mosaic.
    pub(crate) fn mosaic(&self) -> &Mosaic {
        &self.mosaic
    }

    /// The taps of all channels, in the order that [`Self::new`] names.
    pub(crate) fn taps(&self) -> &[Vec<Tap>] {
        &self.taps
    }

    /// Raw pixels that make up a channel of a pixel, with weights that are not normalized; none where no raw pixel of it is near.
    pub(crate) fn entering(
        &self,
        [row, col]: [usize; 2],
        channel: usize,
        [width, height]: [usize; 2],
    ) -> impl Iterator<Item = (usize, f32)> + '_ {
        let cell = (row % self.mosaic.rows) * self.mosaic.cols + col % self.mosaic.cols;
        let (mirror_rows, mirror_cols) = (self.mosaic.rows <= 2, self.mosaic.cols <= 2);
        self.taps[cell * self.mosaic.channels.len() + channel].iter().filter_map(
            move |&(down, right, weight)| {
                let row = inside(row, down, height, mirror_rows)?;
                let col = inside(col, right, width, mirror_cols)?;
                Some((row * width + col, weight))
            },
        )
    }

    /// Weight of each raw pixel in the mean of a channel over some pixels of an image: the mean is a linear function of the raw
    /// values, which are independent. Pixels at the rim of a region rest on raw values beyond it, those inside share theirs.
    ///
    /// The result names raw pixels `row * width + col` in rising order, those that enter.
    #[must_use]
    pub fn weights_of_mean(
        &self,
        pixels: &[usize],
        channel: usize,
        [width, height]: [usize; 2],
    ) -> Vec<(usize, f64)> {
        let share = 1.0 / pixels.len().max(1) as f64;
        // Rows of the image that any tap reaches
        let reach = self.taps.iter().flatten().map(|tap| tap.0.unsigned_abs()).max().unwrap_or(0);
        let rows = || pixels.iter().map(|pixel| pixel / width);
        let first = rows().min().unwrap_or(0).saturating_sub(reach);
        let end = rows().max().map_or(first, |row| (row + reach + 1).min(height));
        let start = first * width;
        let mut weights = vec![0.0; (end - first) * width];
        for pixel in pixels {
            let entering = || self.entering([pixel / width, pixel % width], channel, [width, height]);
            let total: f64 = entering().map(|(_, weight)| f64::from(weight)).sum();
            for (raw, weight) in entering().filter(|_| total > 0.0) {
                weights[raw - start] += share * f64::from(weight) / total;
            }
        }
        let numbered = weights.into_iter().enumerate().map(|(at, weight)| (start + at, weight));
        numbered.filter(|(_, weight)| *weight != 0.0).collect()
    }

    /// Channel that a raw pixel measures, by its number `row * width + col`.
    pub(crate) fn channel_of(&self, pixel: usize, width: usize) -> usize {
        self.mosaic.channel(pixel / width, pixel % width)
    }
}

/// The line `offset` away from `line`; mirrored at the edges, or nothing where it lies outside.
#[inline]
fn inside(line: usize, offset: isize, lines: usize, mirror: bool) -> Option<usize> {
    let at = line as isize + offset;
    let last = lines as isize - 1;
    if (0..=last).contains(&at) {
        Some(at as usize)
    } else if mirror {
        let mirrored = if at < 0 { -at } else { 2 * last - at };
        (0..=last).contains(&mirrored).then_some(mirrored as usize)
    } else {
        None
    }
}
