//! Frames for the screen: at the resolution of the sensor, averaged where it is noisy. No number is made from them.

use rayon::prelude::*;

use crate::image::ChannelImage;

/// Widest image on a page, px; wider sensors are averaged over blocks of pixels.
const WIDEST: usize = 1280;
/// Relative noise of a bright pixel from which an image is averaged.
const NOISY: f64 = 0.02;
/// Pixels to either side that are averaged.
const REACH: isize = 3;
/// Standard deviation of the weights by distance, px.
const SPREAD_PX: f32 = 1.7;
/// A pixel so many standard deviations off the median of its neighborhood is taken for a speck.
const SPECK: f64 = 4.0;
/// Share of the median that a speck is off, at least.
const SPECK_SHARE: f64 = 0.3;
/// Differences of medians up to this share are averaged over, besides noise.
const SHADE: f64 = 0.06;

/// Light of so many standard deviations of the dark noise keeps half of its color.
const FADED: f64 = 2.0;

/// A developed frame made ready for the screen.
#[derive(Clone, Debug)]
pub struct DisplayImage {
    /// Its channels.
    pub image: ChannelImage,
    /// Pixels of the sensor along a side of a pixel of the image.
    pub block: usize,
    /// What was done, in words.
    pub done: String,
}

/// Prepares a developed frame, DN, for the screen: averaged over blocks where it is wider than a page, smoothed where its noise
/// (`noise_floor_dn` and the shot noise that `dn_per_electron` gives) shows in bright light.
pub fn for_display(frame: &ChannelImage, dn_per_electron: f64) -> DisplayImage {
    let block = frame.width.max(frame.height).div_ceil(WIDEST).max(1);
    let binned = blocks(frame, block);
    let noise = Noise {
        floor_dn: frame.noise_floor_dn / block as f64,
        dn_per_electron: dn_per_electron / (block * block) as f64,
    };
    let mut words = Vec::new();
    if block > 1 {
        words.push(format!("{block} x {block} pixels averaged"));
    }
    let image = if noise.is_visible(&binned) {
        words.push("smoothed for display: edge-preserving mean over 7 x 7 pixels, specks replaced by the median of 5 x 5, colors faded where noise hides the light".into());
        smoothed(&binned, &noise)
    } else {
        binned
    };
    DisplayImage { image, block, done: words.join("; ") }
}

/// Noise of a value.
struct Noise {
    floor_dn: f64,
    dn_per_electron: f64,
}

impl Noise {
    fn variance(&self, value: f64) -> f64 {
        self.floor_dn.powi(2) + self.dn_per_electron * value.max(0.0)
    }

    /// Takes the color out of light that is lost in dark noise.
    fn fade_color(&self, values: &mut [f32]) {
        let n = values.len() as f32;
        let sum = values.iter().sum::<f32>().max(0.0);
        let lost = (FADED * self.floor_dn).powi(2) as f32 * n;
        let kept = sum * sum / (sum * sum + lost).max(f32::MIN_POSITIVE);
        values.iter_mut().for_each(|value| *value = sum / n + kept * (*value - sum / n));
    }

    /// Whether a pixel as bright as nine tenths of all shows noise.
    fn is_visible(&self, image: &ChannelImage) -> bool {
        let mut values: Vec<f32> = image.data.iter().copied().filter(|v| v.is_finite()).collect();
        if values.is_empty() {
            return false;
        }
        let at = (values.len() * 9 / 10).min(values.len() - 1);
        let (_, bright, _) = values.select_nth_unstable_by(at, f32::total_cmp);
        let bright = f64::from(*bright);
        self.variance(bright).sqrt() > NOISY * bright
    }
}

/// Means over square blocks; what is left at the right and lower rim joins no block.
fn blocks(frame: &ChannelImage, block: usize) -> ChannelImage {
    if block <= 1 {
        return frame.clone();
    }
    let n = frame.channels.len();
    let (width, height) = (frame.width / block, frame.height / block);
    let mut data = Vec::with_capacity(width * height * n);
    let mut saturated = Vec::with_capacity(width * height);
    for row in 0..height {
        for col in 0..width {
            let inside =
                (0..block * block).map(|i| (row * block + i / block) * frame.width + col * block + i % block);
            for channel in 0..n {
                let sum: f32 = inside.clone().map(|pixel| frame.data[pixel * n + channel]).sum();
                data.push(sum / (block * block) as f32);
            }
            saturated.push(inside.clone().any(|pixel| frame.saturated[pixel]));
        }
    }
    ChannelImage { width, height, data, saturated, subtracted: None, interpolation: None, ..frame.clone() }
}

/// Averages over neighbors whose medians are alike, after specks were replaced by medians.
fn smoothed(image: &ChannelImage, noise: &Noise) -> ChannelImage {
    let n = image.channels.len();
    let medians = medians(image);
    let mut values = image.data.clone();
    for (value, median) in values.iter_mut().zip(&medians) {
        let (off, middle) = (f64::from((*value - *median).abs()), f64::from(*median).max(0.0));
        if off > SPECK * noise.variance(middle).sqrt() + SPECK_SHARE * middle {
            *value = *median;
        }
    }
    let distance: Vec<f32> = (-REACH..=REACH)
        .flat_map(|dy| (-REACH..=REACH).map(move |dx| (dx * dx + dy * dy) as f32))
        .map(|squared| (-squared / (2.0 * SPREAD_PX * SPREAD_PX)).exp())
        .collect();
    let (width, height) = (image.width as isize, image.height as isize);
    let mean_at = |row: isize, col: isize, inverse_like: &mut [f32], sums: &mut [f32]| {
        let here = (row * width + col) as usize * n;
        for (inverse, &median) in inverse_like.iter_mut().zip(&medians[here..here + n]) {
            let median = f64::from(median);
            let like = noise.variance(median) + (SHADE * median).powi(2);
            *inverse = (1.0 / like.max(1e-30)) as f32;
        }
        sums.fill(0.0);
        let mut weights = 0.0;
        let columns = (col - REACH).max(0)..(col + REACH + 1).min(width);
        for y in (row - REACH).max(0)..(row + REACH + 1).min(height) {
            let place = (y - row + REACH) * (2 * REACH + 1) + columns.start - col + REACH;
            let line = (y * width + columns.start) as usize * n..(y * width + columns.end) as usize * n;
            let near = medians[line.clone()].chunks_exact(n).zip(values[line].chunks_exact(n));
            for ((medians_there, values_there), spread) in near.zip(&distance[place as usize..]) {
                let of_channel = medians_there.iter().zip(&medians[here..here + n]).zip(&*inverse_like);
                let unlike: f32 = of_channel.map(|((a, b), inverse)| (a - b) * (a - b) * inverse).sum();
                // Near exp(-unlike / 2), and nothing beyond 8
                let alike = (1.0 - 0.125 * unlike).max(0.0);
                let weight = spread * alike * alike * (alike * alike);
                weights += weight;
                sums.iter_mut().zip(values_there).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        sums.iter_mut().for_each(|sum| *sum /= weights);
        noise.fade_color(sums);
    };
    let mut data = vec![0.0; values.len()];
    data.par_chunks_mut((image.width * n).max(1)).enumerate().for_each(|(row, line)| {
        let mut inverse_like = vec![0.0; n];
        for (col, out) in line.chunks_exact_mut(n).enumerate() {
            mean_at(row as isize, col as isize, &mut inverse_like, out);
        }
    });
    ChannelImage { data, ..image.clone() }
}

/// Median of the 5 x 5 neighbors of every value, each channel by itself.
fn medians(image: &ChannelImage) -> Vec<f32> {
    let n = image.channels.len();
    let (width, height) = (image.width as isize, image.height as isize);
    let median_at = |row: isize, col: isize, channel: usize, near: &mut Vec<f32>| {
        near.clear();
        for y in (row - 2).max(0)..=(row + 2).min(height - 1) {
            for x in (col - 2).max(0)..=(col + 2).min(width - 1) {
                near.push(image.data[(y * width + x) as usize * n + channel]);
            }
        }
        let middle = near.len() / 2;
        *near.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    let mut medians = vec![0.0; image.data.len()];
    medians.par_chunks_mut((image.width * n).max(1)).enumerate().for_each(|(row, line)| {
        let mut near = Vec::with_capacity(25);
        for (at, median) in line.iter_mut().enumerate() {
            *median = median_at(row as isize, (at / n) as isize, at % n, &mut near);
        }
    });
    medians
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> ChannelImage {
        let data = (0..width * height).map(|pixel| value(pixel / width, pixel % width)).collect();
        ChannelImage {
            width,
            height,
            channels: vec!["mono".into()],
            data,
            saturated: vec![false; width * height],
            noise_floor_dn: 5.0,
            full_scale_dn: 4000.0,
            shares: vec![1.0],
            interpolation: None,
            subtracted: None,
            calibration: None,
            label: "blue".into(),
        }
    }

    #[test]
    fn an_edge_stays_and_a_speck_goes() {
        let step = image(40, 20, |row, col| match (row, col) {
            (9..=11, 30..=32) => 3000.0,
            _ if col < 20 => 50.0,
            _ => 400.0,
        });
        let shown = for_display(&step, 0.5);
        assert!(shown.done.contains("edge-preserving"), "{}", shown.done);
        let at = |row: usize, col: usize| shown.image.data[row * 40 + col];
        // Across the edge medians differ by 350 DN, forty standard deviations: nothing is averaged.
        assert!((at(10, 18) - 50.0).abs() < 1.0 && (at(10, 21) - 400.0).abs() < 4.0);
        // Nine of 25 neighbors are a speck: the median does not see it.
        assert!((at(10, 31) - 400.0).abs() < 4.0, "{}", at(10, 31));
    }

    #[test]
    fn a_large_sensor_is_averaged_over_blocks_and_light_without_noise_stays() {
        let shown = for_display(&image(2600, 4, |_, col| if col % 2 == 0 { 3000.0 } else { 3600.0 }), 0.01);
        assert_eq!((shown.image.width, shown.image.height, shown.block), (866, 1, 3));
        assert_eq!(shown.done, "3 x 3 pixels averaged");
        assert!(shown.image.data.iter().all(|&v| (3150.0..=3450.0).contains(&v)));
    }
}
