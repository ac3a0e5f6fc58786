//! Means of regions of interpolated frames: their variance in closed form against the scatter of many frames.
#![allow(clippy::unwrap_used)]

use fluorspar::analysis::{ChannelNoise, LineNoise, mean_of_pixels};
use fluorspar::image::{ChannelImage, Mosaic, SensorImage};
use fluorspar::sampling::random::Key;
use fluorspar::sensor::{Demosaicing, Development};

const SIZE: [usize; 2] = [16, 12];

/// What rows and columns share, DN.
const LINES: LineNoise = LineNoise { row_dn: 7.0, column_dn: 4.0, fixed_dn: [0.0; 2], column_gain: 0.0 };

/// A frame of even light with Gaussian noise of variance 100 DN² and that of lines, and of nothing but a constant where `seed` is none.
fn developed(seed: Option<u64>, how: Demosaicing) -> ChannelImage {
    let normal = |of: u64, number: usize| {
        let key = Key::new(of).with(seed.unwrap_or(0)).with(number as u64);
        let uniform = |id: u64| (key.with(id).value() >> 11) as f64 / (1u64 << 53) as f64;
        (-2.0 * (1.0 - uniform(0)).ln()).sqrt() * (std::f64::consts::TAU * uniform(1)).cos()
    };
    let value = |pixel: usize| {
        let of_lines =
            LINES.row_dn * normal(4, pixel / SIZE[0]) + LINES.column_dn * normal(5, pixel % SIZE[0]);
        let noise = if seed.is_some() { 10.0 * normal(3, pixel) + of_lines } else { 0.0 };
        (1000.0 + noise).round() as u16
    };
    let raw = SensorImage {
        width: SIZE[0],
        height: SIZE[1],
        data: (0..SIZE[0] * SIZE[1]).map(value).collect(),
        mosaic: Mosaic::bayer("grbg").unwrap(),
        black_level: 0.0,
        black_offsets: Vec::new(),
        white_levels: Vec::new(),
        factors: Vec::new(),
        orientation: fluorspar::image::Orientation::default(),
        white_level: 4000,
        bit_depth: 12,
        exposure_s: 0.01,
        gain: 1.0,
        dn_per_electron: 1.0,
        read_noise_dn: 10.0,
        gain_is_assumed: false,
        seed: 0,
        label: "even".into(),
    };
    Development { demosaicing: how, ..Development::default() }.linearize(&raw).unwrap().demosaic(how).unwrap()
}

/// Regions that have much rim: one pixel, a line along the border, a diagonal, a disc, the frame.
fn regions() -> Vec<Vec<usize>> {
    let all = || (0..SIZE[0] * SIZE[1]).map(|pixel| [pixel / SIZE[0], pixel % SIZE[0]]);
    let those = |is: &dyn Fn([usize; 2]) -> bool| -> Vec<usize> {
        all().filter(|at| is(*at)).map(|[row, col]| row * SIZE[0] + col).collect()
    };
    vec![
        those(&|at| at == [5, 7]),
        those(&|[row, _]| row == 0),
        those(&|[row, col]| row == col),
        those(&|[row, col]| (row as f64 - 5.5).hypot(col as f64 - 7.0) < 3.2),
        those(&|_| true),
    ]
}

/// The scatter of 3000 means is the stated one: relative error sqrt(2 / 3000) = 0.026 of each variance, held to four of them.
#[test]
fn the_variance_of_a_mean_is_exact_at_rims() {
    const FRAMES: u64 = 3000;
    // Rounding to whole numbers adds 1/12
    let noise = ChannelNoise {
        floor_dn: (100.0f64 + 1.0 / 12.0).sqrt(),
        dn_per_electron: 0.0,
        gain_spread: 0.0,
        lines: LINES,
    };
    for how in [Demosaicing::Bilinear, Demosaicing::GradientCorrected] {
        let regions = regions();
        let mut sums = vec![[[0.0; 2]; 3]; regions.len()];
        for seed in 0..FRAMES {
            let image = developed(Some(seed), how);
            for (sums, pixels) in sums.iter_mut().zip(&regions) {
                let [mean, _] = mean_of_pixels(&image, pixels, &noise, None).unwrap().unwrap();
                for (sum, mean) in sums.iter_mut().zip(mean) {
                    sum[0] += mean - 1000.0;
                    sum[1] += (mean - 1000.0).powi(2);
                }
            }
        }
        let even = developed(None, how);
        for (sums, pixels) in sums.iter().zip(&regions) {
            let [mean, variance] = mean_of_pixels(&even, pixels, &noise, None).unwrap().unwrap();
            for c in 0..3 {
                let n = FRAMES as f64;
                let found = (sums[c][1] - sums[c][0] * sums[c][0] / n) / (n - 1.0);
                assert!((mean[c] - 1000.0).abs() < 1e-3);
                let ratio = found / variance[c];
                assert!(
                    (ratio - 1.0).abs() < 4.0 * (2.0 / n).sqrt(),
                    "{how:?} {c} of {}: {ratio}",
                    pixels.len()
                );
            }
        }
    }
}

/// A pixel that measured green rests on one raw value of it, on two of red and blue; the frame on a quarter, a half, a quarter
/// of its pixels but for the weights of its border.
#[test]
fn weights_of_a_mean_are_those_of_its_raw_pixels() {
    let image = developed(None, Demosaicing::Bilinear);
    let taps = image.interpolation.as_ref().unwrap();
    let effective = |pixels: &[usize], channel: usize| {
        let weights = taps.weights_of_mean(pixels, channel, SIZE);
        let sum: f64 = weights.iter().map(|(_, weight)| weight).sum();
        assert!((sum - 1.0).abs() < 1e-6);
        1.0 / weights.iter().map(|(_, weight)| weight * weight).sum::<f64>()
    };
    // Row 5 and column 7 of G R / B G: green
    let green = [5 * SIZE[0] + 7];
    assert!([2.0, 1.0, 2.0].iter().zip(0..3).all(|(n, c)| (effective(&green, c) - n).abs() < 1e-6));
    let all: Vec<usize> = (0..SIZE[0] * SIZE[1]).collect();
    for (channel, share) in [0.25, 0.5, 0.25].into_iter().enumerate() {
        let n = share * all.len() as f64;
        assert!(effective(&all, channel) > 0.93 * n && effective(&all, channel) <= n);
    }
}
