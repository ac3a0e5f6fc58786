//! Interpolation of mosaics: bilinear on any cell, gradient-corrected on Bayer arrays.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use std::sync::Arc;

use crate::image::{InterpolationTaps, Mosaic, Tap};

/// How the colors that a pixel does not see are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Demosaicing {
    /// Weighted mean of the nearest pixels of each color: any mosaic, no overshoot, color fringes at edges.
    #[default]
    Bilinear,
    /// Bilinear plus the Laplacian of the color that the pixel sees (Malvar, He, Cutler 2004): Bayer arrays only,
    /// sharper, overshoots at edges.
    GradientCorrected,
}

/// Bilinear interpolation on any repeating cell.
///
/// A pixel of the channel itself keeps its value. Elsewhere the pixels of the channel under a tent as wide as two cells
/// are averaged by their weights (normalized convolution). On a Bayer array that is ISETCam's `ieBilinear` exactly:
/// `[0 1 0; 1 4 1; 0 1 0] / 4` for green, `[1 2 1]' [1 2 1] / 4` for red and blue. At the border the image is
/// mirrored without repeating its edge where the cell has at most two rows (columns), which keeps the colors in
/// place; longer cells leave out what lies outside.
pub(super) struct Demosaic {
    taps: Arc<InterpolationTaps>,
}

impl Demosaic {
    pub(super) fn new(mosaic: &Mosaic) -> Self {
        let mut taps = Vec::new();
        for row in 0..mosaic.rows {
            for col in 0..mosaic.cols {
                for channel in 0..mosaic.channels.len() {
                    taps.push(taps_of(mosaic, row, col, channel));
                }
            }
        }
        Self { taps: Arc::new(InterpolationTaps::new(mosaic, taps)) }
    }

    /// Gradient-corrected linear interpolation of a two by two Bayer array: Malvar, He and Cutler, "High-quality linear
    /// interpolation for demosaicing of Bayer-patterned color images", ICASSP 2004, Fig. 2. The image is mirrored at its
    /// border without repeating the edge. `None` for any other mosaic.
    pub(super) fn gradient_corrected(mosaic: &Mosaic) -> Option<Self> {
        let green = (0..mosaic.channels.len())
            .find(|&c| mosaic.pattern.iter().filter(|&&seen| usize::from(seen) == c).count() == 2)?;
        if !mosaic.is_bayer() {
            return None;
        }
        let mut taps = Vec::new();
        for row in 0..2 {
            for col in 0..2 {
                for channel in 0..3 {
                    taps.push(gradient_corrected_taps(mosaic, green, row, col, channel));
                }
            }
        }
        Some(Self { taps: Arc::new(InterpolationTaps::new(mosaic, taps)) })
    }

    /// Which raw pixels enter which value.
    pub(super) fn taps(&self) -> Arc<InterpolationTaps> {
        Arc::clone(&self.taps)
    }

    /// Rows and columns that the farthest tap reaches.
    fn reach(&self) -> (usize, usize) {
        let far = |of: fn(&Tap) -> isize| {
            self.taps.taps().iter().flatten().map(|tap| of(tap).unsigned_abs()).max().unwrap_or(0)
        };
        (far(|tap| tap.0), far(|tap| tap.1))
    }

    /// Interpolates every channel at every pixel, `[row, col, channel]`, and marks the pixels that a marked one enters.
    pub(super) fn interpolate(
        &self,
        values: &[f32],
        marked: &[bool],
        width: usize,
        height: usize,
    ) -> (Vec<f32>, Vec<bool>) {
        let mosaic = self.taps.mosaic();
        let channels = mosaic.channels.len();
        let mut data = vec![0.0; width * height * channels];
        let mut mask = vec![false; width * height];
        if values.is_empty() {
            return (data, mask);
        }
        let any_marked = marked.contains(&true);
        let cells: Vec<Vec<(isize, f32)>> =
            self.taps.taps().iter().map(|taps| normalized(taps, width)).collect();
        // Lines whose taps all lie inside of the image.
        let (margin_rows, margin_cols) = self.reach();
        let is_interior = |line: usize, margin: usize, lines: usize| line >= margin && line + margin < lines;
        let rows = data.par_chunks_exact_mut(width * channels).zip(mask.par_chunks_exact_mut(width));
        rows.enumerate().for_each(|(row, (data, mask))| {
            let first_cell = (row % mosaic.rows) * mosaic.cols;
            let is_interior_row = is_interior(row, margin_rows, height) && width > 2 * margin_cols;
            let interior = if is_interior_row { margin_cols..width - margin_cols } else { 0..0 };
            // Apply the precomputed offsets inside the image, one column and channel of the cell after the other
            for phase in 0..mosaic.cols.min(interior.len()) {
                let start = interior.start + phase;
                let cell = first_cell + start % mosaic.cols;
                for channel in 0..channels {
                    let values_out = data[start * channels + channel..interior.end * channels]
                        .iter_mut()
                        .step_by(mosaic.cols * channels);
                    let pixels = (row * width + start..row * width + interior.end).step_by(mosaic.cols);
                    weighted_sums(&cells[cell * channels + channel], values, pixels, values_out);
                }
            }
            if any_marked {
                for col in interior.clone() {
                    let (pixel, cell) = (row * width + col, first_cell + col % mosaic.cols);
                    let mut taps = cells[cell * channels..][..channels].iter().flatten();
                    mask[col] = taps.any(|(offset, _)| marked[pixel.wrapping_add_signed(*offset)]);
                }
            }
            // Renormalize the taps that lie inside at the border
            for col in (0..width).filter(|col| !interior.contains(col)) {
                for (channel, out) in data[col * channels..][..channels].iter_mut().enumerate() {
                    let entering = || self.taps.entering([row, col], channel, [width, height]);
                    let (sum, total) = entering().fold((0.0, 0.0), |(sum, total), (pixel, weight)| {
                        (sum + weight * values[pixel], total + weight)
                    });
                    *out = if total > 0.0 { sum / total } else { 0.0 };
                    mask[col] |= any_marked && entering().any(|(pixel, _)| marked[pixel]);
                }
            }
        });
        (data, mask)
    }
}

/// The sums of some taps around pixels. Bilinear interpolation of Bayer arrays has one, two or four: their number is known when
/// compiled.
fn weighted_sums<'a>(
    taps: &[(isize, f32)],
    values: &[f32],
    pixels: impl Iterator<Item = usize>,
    sums: impl Iterator<Item = &'a mut f32>,
) {
    let value =
        |pixel: usize, (offset, weight): (isize, f32)| weight * values[pixel.wrapping_add_signed(offset)];
    let sums = pixels.zip(sums);
    match *taps {
        [a] => sums.for_each(|(pixel, sum)| *sum = value(pixel, a)),
        [a, b] => sums.for_each(|(pixel, sum)| *sum = value(pixel, a) + value(pixel, b)),
        [a, b, c, d] => sums.for_each(|(pixel, sum)| {
            *sum = value(pixel, a) + value(pixel, b) + value(pixel, c) + value(pixel, d);
        }),
        _ => sums.for_each(|(pixel, sum)| *sum = taps.iter().map(|tap| value(pixel, *tap)).sum()),
    }
}

/// Taps as offsets in the image and weights of sum 1.
fn normalized(taps: &[Tap], width: usize) -> Vec<(isize, f32)> {
    let total: f32 = taps.iter().map(|tap| tap.2).sum();
    taps.iter().map(|&(down, right, weight)| (down * width as isize + right, weight / total)).collect()
}

fn taps_of(mosaic: &Mosaic, row: usize, col: usize, channel: usize) -> Vec<Tap> {
    if mosaic.channel(row, col) == channel {
        return vec![(0, 0, 1.0)];
    }
    let (rows, cols) = (mosaic.rows as isize, mosaic.cols as isize);
    let mut taps = Vec::new();
    for down in 1 - rows..rows {
        for right in 1 - cols..cols {
            let at = |start: usize, offset: isize, period: isize| (start as isize + offset + period) as usize;
            if mosaic.channel(at(row, down, rows), at(col, right, cols)) == channel {
                taps.push((down, right, ((rows - down.abs()) * (cols - right.abs())) as f32));
            }
        }
    }
    taps
}

/// The 5 x 5 filters of Malvar, He and Cutler, in sixteenths; they sum to 1.
fn gradient_corrected_taps(
    mosaic: &Mosaic,
    green: usize,
    row: usize,
    col: usize,
    channel: usize,
) -> Vec<Tap> {
    let here = mosaic.channel(row, col);
    if here == channel {
        return vec![(0, 0, 1.0)];
    }
    let (filter, turned) = if channel == green {
        (GREEN, false)
    } else if here == green {
        (IN_ROW, mosaic.channel(row, col + 1) != channel)
    } else {
        (DIAGONAL, false)
    };
    let mut taps = Vec::new();
    for (down, line) in (-2..=2).zip(filter) {
        for (right, weight) in (-2..=2).zip(line) {
            if weight != 0 {
                let (down, right) = if turned { (right, down) } else { (down, right) };
                taps.push((down, right, f32::from(weight) / 16.0));
            }
        }
    }
    taps
}

/// Weights of the gradient-corrected filters in sixteenths, rows from two above to two below.
const GREEN: [[i8; 5]; 5] =
    [[0, 0, -2, 0, 0], [0, 0, 4, 0, 0], [-2, 4, 8, 4, -2], [0, 0, 4, 0, 0], [0, 0, -2, 0, 0]];
const IN_ROW: [[i8; 5]; 5] =
    [[0, 0, 1, 0, 0], [0, -2, 0, -2, 0], [-2, 8, 10, 8, -2], [0, -2, 0, -2, 0], [0, 0, 1, 0, 0]];
const DIAGONAL: [[i8; 5]; 5] =
    [[0, 0, -3, 0, 0], [0, 4, 0, 4, 0], [-3, 0, 12, 0, -3], [0, 4, 0, 4, 0], [0, 0, -3, 0, 0]];

#[cfg(test)]
mod tests {
    use super::*;

    /// `ieBilinear` as it is written: zero-filled planes, mirrored, convolved.
    fn ie_bilinear(values: &[f32], mosaic: &Mosaic, width: usize, height: usize) -> Vec<f32> {
        let mut out = Vec::new();
        for row in 0..height as isize {
            for col in 0..width as isize {
                for channel in 0..3 {
                    let mut sum = 0.0;
                    for down in -1..=1isize {
                        for right in -1..=1isize {
                            let mirror = |x: isize, n: usize| {
                                let x = x.abs();
                                if x >= n as isize { 2 * (n as isize - 1) - x } else { x }
                            } as usize;
                            let (r, c) = (mirror(row + down, height), mirror(col + right, width));
                            let far = down.abs() + right.abs();
                            let weight = match (channel, far) {
                                (1, 0) => 1.0,
                                (1, 1) => 0.25,
                                (1, _) => 0.0,
                                (_, far) => [1.0, 0.5, 0.25][far as usize],
                            };
                            if mosaic.channel(r, c) == channel {
                                sum += weight * values[r * width + c];
                            }
                        }
                    }
                    out.push(sum);
                }
            }
        }
        out
    }

    #[test]
    fn every_bayer_order_follows_ie_bilinear_borders_included() {
        for (width, height) in [(6, 4), (7, 5), (2, 2), (3, 2)] {
            let values: Vec<f32> = (0..width * height).map(|i| ((i * 37 + 11) % 101) as f32).collect();
            for order in ["rggb", "grbg", "gbrg", "bggr"] {
                let mosaic = Mosaic::bayer(order).unwrap();
                let marked = vec![false; values.len()];
                let (data, _) = Demosaic::new(&mosaic).interpolate(&values, &marked, width, height);
                let expected = ie_bilinear(&values, &mosaic, width, height);
                // Sums of four integers over powers of two are exact.
                assert_eq!(data, expected, "{order} {width} x {height}");
            }
        }
    }

    #[test]
    fn a_mark_reaches_what_it_enters() {
        let mosaic = Mosaic::bayer("rggb").unwrap();
        let mut marked = vec![false; 36];
        marked[2 * 6 + 2] = true; // a red pixel
        let (_, mask) = Demosaic::new(&mosaic).interpolate(&[1.0; 36], &marked, 6, 6);
        let reached: Vec<usize> = (0..36).filter(|&i| mask[i]).collect();
        assert_eq!(reached, [7, 8, 9, 13, 14, 15, 19, 20, 21]);
        let mut marked = vec![false; 36];
        marked[2 * 6 + 3] = true; // a green pixel: not its green neighbors on the diagonals
        let (_, mask) = Demosaic::new(&mosaic).interpolate(&[1.0; 36], &marked, 6, 6);
        let reached: Vec<usize> = (0..36).filter(|&i| mask[i]).collect();
        assert_eq!(reached, [9, 14, 15, 16, 21]);
    }

    #[test]
    fn any_cell_reproduces_flat_channels() {
        let mosaic = Mosaic {
            rows: 3,
            cols: 4,
            pattern: vec![0, 1, 2, 1, 3, 4, 0, 1, 2, 1, 3, 0],
            channels: ["a", "b", "c", "d", "e"].map(String::from).to_vec(),
        };
        let (width, height) = (11, 7);
        let values: Vec<f32> =
            (0..width * height).map(|i| 10.0 * mosaic.channel(i / width, i % width) as f32).collect();
        let (data, _) =
            Demosaic::new(&mosaic).interpolate(&values, &vec![false; values.len()], width, height);
        for pixel in data.chunks_exact(5) {
            for (channel, value) in pixel.iter().enumerate() {
                assert!((value - 10.0 * channel as f32).abs() < 1e-4, "{pixel:?}");
            }
        }
    }

    #[test]
    fn gradient_correction_has_the_published_filters() {
        // One lit pixel in the middle of 9 x 9, on red of "rggb" (row 4, column 4): what it gives to its neighbors are the
        // coefficients of the paper, in eighths.
        let mosaic = Mosaic::bayer("rggb").unwrap();
        let mut values = vec![0.0; 81];
        values[4 * 9 + 4] = 8.0;
        let (data, _) =
            Demosaic::gradient_corrected(&mosaic).unwrap().interpolate(&values, &[false; 81], 9, 9);
        let at = |row: usize, col: usize| &data[(row * 9 + col) * 3..][..3];
        assert_eq!(at(4, 4), [8.0, 4.0, 6.0]); // red here: green 4/8, blue 6/8
        assert_eq!(at(4, 5), [4.0, 0.0, 0.0]); // green in a red row: red 4/8, blue from its own Laplacian only
        assert_eq!(at(3, 4), [4.0, 0.0, 0.0]); // green in a blue row, red above and below
        assert_eq!(at(3, 3), [2.0, 0.0, 0.0]); // blue: red from four corners, 2/8
        assert_eq!(at(4, 6), [0.0, -1.0, -1.5]); // next red: green -1/8, blue -3/2 /8
        assert_eq!(at(2, 4), [0.0, -1.0, -1.5]);
    }

    #[test]
    fn gradient_correction_is_exact_where_colors_change_alike_and_linearly() {
        let (width, height) = (12, 10);
        for order in ["rggb", "grbg", "gbrg", "bggr"] {
            let mosaic = Mosaic::bayer(order).unwrap();
            let truth = |row: usize, col: usize, c: usize| {
                3.0 * row as f32 + 5.0 * col as f32 + [10.0, 70.0, 40.0][c]
            };
            let values: Vec<f32> = (0..width * height)
                .map(|i| truth(i / width, i % width, mosaic.channel(i / width, i % width)))
                .collect();
            let (data, _) = Demosaic::gradient_corrected(&mosaic).unwrap().interpolate(
                &values,
                &vec![false; width * height],
                width,
                height,
            );
            for row in 2..height - 2 {
                for col in 2..width - 2 {
                    for c in 0..3 {
                        let got = data[(row * width + col) * 3 + c];
                        assert!((got - truth(row, col, c)).abs() < 1e-4, "{order} {row} {col} {c}: {got}");
                    }
                }
            }
        }
    }

    /// A gray zone plate: where all channels are equal, gradient correction recovers far more than bilinear does.
    #[test]
    fn gradient_correction_beats_bilinear_on_fine_detail() {
        let (width, height) = (64, 64);
        let mosaic = Mosaic::bayer("grbg").unwrap();
        let values: Vec<f32> = (0..width * height)
            .map(|i| {
                let (y, x) = ((i / width) as f32 - 32.0, (i % width) as f32 - 32.0);
                100.0 + 50.0 * (0.012 * (x * x + y * y)).cos()
            })
            .collect();
        let rms = |(data, _): (Vec<f32>, Vec<bool>)| {
            let squares = data
                .chunks_exact(3)
                .zip(&values)
                .map(|(rgb, truth)| rgb.iter().map(|v| f64::from(v - truth).powi(2)).sum::<f64>());
            (squares.sum::<f64>() / (3 * width * height) as f64).sqrt()
        };
        let none = vec![false; width * height];
        let bilinear = rms(Demosaic::new(&mosaic).interpolate(&values, &none, width, height));
        let corrected = Demosaic::gradient_corrected(&mosaic).unwrap();
        let corrected = rms(corrected.interpolate(&values, &none, width, height));
        assert!(corrected < 0.6 * bilinear, "{corrected} against {bilinear}");
    }

    #[test]
    fn gradient_correction_needs_a_bayer_array() {
        assert!(Demosaic::gradient_corrected(&Mosaic::monochrome()).is_none());
        let stripes = Mosaic {
            rows: 2,
            cols: 2,
            pattern: vec![0, 1, 2, 1],
            channels: ["R", "G", "B"].map(String::from).to_vec(),
        };
        assert!(Demosaic::gradient_corrected(&stripes).is_none());
    }
}
