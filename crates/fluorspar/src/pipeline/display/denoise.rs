//! Noise reduction of component images, for display: never for validation or measurement.
//!
//! Joint non-local means (Rousselle, Knaus and Zwicker 2012[^nlm], with feature buffers as in 2013[^features]): every
//! pixel becomes a weighted mean of its neighborhood. The weights come from how much two patches differ beyond their
//! noise, in the sum of one light group over eight ranges of wavelength, and from the surface behind the pixels. All
//! bands and all components of a light group share them, so spectra keep their shape and components still add up.
//! Pixels of different parts are never mixed. At the end each part gets back its mean, per component and band.
//!
//! Each half-buffer gives weights of its own, and their mean is used: a bright sample sits in one half only, and the
//! other half does not know it.
//!
//! [^nlm]: ACM Trans. Graph. 31(6), 195 (2012), doi:10.1145/2366145.2366214.
//! [^features]: Computer Graphics Forum 32(7), 121-130 (2013), doi:10.1111/cgf.12219.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::image::ComponentImage;

/// How strongly noise is reduced.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DenoiseSettings {
    /// Radius of the filter, pixels, 1 to 20.
    pub radius: usize,
    /// Differences count from this many standard deviations of the noise on, 0.1 to 10: more is smoother.
    pub strength: f64,
    /// Scale of differences between normals, 0.01 to 10.
    pub normal: f64,
    /// Scale of relative differences in depth, 1e-4 to 10.
    pub depth: f64,
}

impl Default for DenoiseSettings {
    /// 5 x 5 pixels, strength 0.45 (that of Rousselle et al. 2012), normals to 0.2, depth to 1 %. Measured on a smooth sphere at
    /// 16 and 64 samples: larger windows and strengths blur more than they smooth, because stratified samples err less than
    /// their variance predicts.
    fn default() -> Self {
        Self { radius: 2, strength: 0.45, normal: 0.2, depth: 0.01 }
    }
}

/// Why an image can't be denoised.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum DenoiseError {
    /// The noise is not known.
    #[error(
        "the image has no half-buffers and variance of its light groups, so its noise is not known; render it with \
         `--statistics light_groups`"
    )]
    NoStatistics,
    /// There is too little to tell noise from signal.
    #[error("the image has {0} samples per pixel; noise can be estimated from 16 on; render more samples")]
    TooFewSamples(u32),
    /// It was done already.
    #[error("the image is denoised already; start from the raw one")]
    Twice,
    /// A setting is out of range.
    #[error("{name} = {value}: must be between {low} and {high}")]
    Setting {
        /// Which.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Least.
        low: f64,
        /// Most.
        high: f64,
    },
}

/// Below this the variance is too coarse: the filter would do more harm than good.
const LEAST_SAMPLES: u32 = 16;
/// Ranges of wavelength that are compared.
const RANGES: usize = 8;
/// Weights below this are taken as none.
const LEAST_WEIGHT: f32 = 1e-3;
/// Half side of the patches that are compared.
const PATCH: isize = 1;

/// One half of the guide of a light group, `[pixel][range]`: mean and variance of the mean.
struct Guide {
    mean: Vec<f32>,
    variance: Vec<f32>,
}

/// A copy of an image with less noise, labeled as such; its half-buffers and variance are gone.
///
/// # Errors
/// Images without the statistics of light groups, with too few samples, or denoised already; settings out of range.
pub fn denoise(image: &ComponentImage, settings: &DenoiseSettings) -> Result<ComponentImage, DenoiseError> {
    // Check settings and statistics
    let ranges = [
        ("radius", settings.radius as f64, 1.0, 20.0),
        ("strength", settings.strength, 0.1, 10.0),
        ("normal", settings.normal, 0.01, 10.0),
        ("depth", settings.depth, 1e-4, 10.0),
    ];
    for (name, value, low, high) in ranges {
        if !(low..=high).contains(&value) {
            return Err(DenoiseError::Setting { name, value, low, high });
        }
    }
    if image.denoised.is_some() {
        return Err(DenoiseError::Twice);
    }
    let statistics = image.statistics.as_ref().ok_or(DenoiseError::NoStatistics)?;
    let groups = image.light_groups();
    if statistics.names != groups {
        return Err(DenoiseError::NoStatistics);
    }
    if image.samples_per_pixel < LEAST_SAMPLES {
        return Err(DenoiseError::TooFewSamples(image.samples_per_pixel));
    }
    // Filter every light group with the guides of its two half-buffers
    let (width, height, bands) = (image.width, image.height, image.grid.len());
    let plane = width * height * bands;
    let mut result = image.clone();
    result.statistics = None;
    result.denoised = serde_json::to_string(settings).ok();
    for (index, group) in groups.iter().enumerate() {
        let of_group = index * plane..(index + 1) * plane;
        let variance = &statistics.variance[of_group.clone()];
        let halves = [&statistics.half_a[of_group.clone()], &statistics.half_b[of_group]];
        let guides = halves.map(|half| guide(half, variance, width, height, bands));
        // Share the weights of a pixel among all components of the group
        let weights = Weights { image, settings };
        let members: Vec<usize> =
            (0..image.components.len()).filter(|&c| image.components[c].light_group == *group).collect();
        let rows: Vec<Vec<f32>> = (0..height)
            .into_par_iter()
            .map(|row| {
                let mut out = vec![0.0; members.len() * width * bands];
                for col in 0..width {
                    // Average the neighbors with their weights
                    let near = weights.around(&guides, row, col);
                    for (m, &component) in members.iter().enumerate() {
                        let source = image.stored(component);
                        let start = (m * width + col) * bands;
                        let target = &mut out[start..start + bands];
                        for &(pixel, weight) in &near {
                            let values = &source[pixel * bands..(pixel + 1) * bands];
                            target.iter_mut().zip(values).for_each(|(t, v)| *t += weight * v);
                        }
                    }
                }
                out
            })
            .collect();
        // Copy the rows into the result
        for (row, values) in rows.iter().enumerate() {
            for (m, &component) in members.iter().enumerate() {
                let to = component * plane + row * width * bands;
                let from = m * width * bands;
                result.data[to..to + width * bands].copy_from_slice(&values[from..from + width * bands]);
            }
        }
    }
    // Restore the mean of every part per component and band
    give_back_means(image, &mut result);
    Ok(result)
}

/// Sums over ranges of bands. Noise of the bands of a pixel is one: all ride on the same paths, so standard deviations
/// add. The variance of a half is twice that of the whole; it is smoothed, for it is noisy itself.
fn guide(half: &[f32], variance: &[f32], width: usize, height: usize, bands: usize) -> Guide {
    let count = RANGES.min(bands);
    let (mut mean, mut raw) = (vec![0.0; width * height * count], vec![0.0; width * height * count]);
    for pixel in 0..width * height {
        for band in 0..bands {
            let at = pixel * count + band * count / bands;
            mean[at] += half[pixel * bands + band];
            raw[at] += variance[pixel * bands + band].sqrt();
        }
    }
    raw.iter_mut().for_each(|deviation| *deviation = 2.0 * deviation.powi(2));
    let mut smooth = vec![0.0; raw.len()];
    for (row, col) in (0..height).flat_map(|row| (0..width).map(move |col| (row, col))) {
        let (mut n, at) = (0.0, (row * width + col) * count);
        for (r, c) in window(row, col, 1, width, height) {
            n += 1.0;
            for range in 0..count {
                smooth[at + range] += raw[(r * width + c) * count + range];
            }
        }
        smooth[at..at + count].iter_mut().for_each(|v| *v /= n);
    }
    Guide { mean, variance: smooth }
}

/// Pixels of the image at most `radius` away in each direction.
fn window(
    row: usize,
    col: usize,
    radius: usize,
    width: usize,
    height: usize,
) -> impl Iterator<Item = (usize, usize)> {
    let (r0, r1) = (row.saturating_sub(radius), (row + radius).min(height - 1));
    let (c0, c1) = (col.saturating_sub(radius), (col + radius).min(width - 1));
    (r0..=r1).flat_map(move |r| (c0..=c1).map(move |c| (r, c)))
}

struct Weights<'a> {
    image: &'a ComponentImage,
    settings: &'a DenoiseSettings,
}

impl Weights<'_> {
    /// Neighbors of a pixel with their weights, which add up to one: the mean of the weights that each half gives.
    fn around(&self, guides: &[Guide; 2], row: usize, col: usize) -> Vec<(usize, f32)> {
        let (width, height) = (self.image.width, self.image.height);
        let mut near: Vec<(usize, [f32; 2])> = Vec::new();
        for (r, c) in window(row, col, self.settings.radius, width, height) {
            let feature = self.feature_weight(row * width + col, r * width + c);
            if feature < LEAST_WEIGHT {
                continue;
            }
            let of_half = |guide: &Guide| {
                let distance = self.distance(guide, (row, col), (r, c)).max(0.0);
                let weight = feature.min((-distance).exp());
                if weight < LEAST_WEIGHT { 0.0 } else { weight }
            };
            near.push((r * width + c, [of_half(&guides[0]), of_half(&guides[1])]));
        }
        let sum = |half: usize| near.iter().map(|(_, weights)| weights[half]).sum::<f32>();
        // The pixel itself is always there with weight one.
        let factors = [0.5 / sum(0), 0.5 / sum(1)];
        near.iter()
            .map(|&(pixel, [a, b])| (pixel, a * factors[0] + b * factors[1]))
            .filter(|&(_, weight)| weight > 0.0)
            .collect()
    }

    /// One for the same place of the same part, zero for another part.
    fn feature_weight(&self, a: usize, b: usize) -> f32 {
        let features = &self.image.features;
        if features.part.get(a) != features.part.get(b) {
            return 0.0;
        }
        let mut distance: f32 = 0.0;
        if let (Some(a), Some(b)) = (features.normal.get(a), features.normal.get(b)) {
            let squared: f32 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
            distance = distance.max(squared / (self.settings.normal as f32).powi(2));
        }
        if let (Some(&a), Some(&b)) = (features.depth_m.get(a), features.depth_m.get(b))
            && a.is_finite()
            && b.is_finite()
        {
            let relative = (a - b) / (self.settings.depth as f32 * a.max(f32::MIN_POSITIVE));
            distance = distance.max(relative * relative / 100.0);
        }
        (-distance).exp()
    }

    /// Eq. 3 and 5 of Rousselle et al. 2012: squared difference beyond what noise explains, relative to the noise, mean
    /// over patch and ranges.
    fn distance(&self, guide: &Guide, p: (usize, usize), q: (usize, usize)) -> f32 {
        let (width, height) = (self.image.width as isize, self.image.height as isize);
        let count = guide.mean.len() / (self.image.width * self.image.height);
        let strength = (self.settings.strength * self.settings.strength) as f32;
        let (mut sum, mut n) = (0.0, 0.0);
        for (dr, dc) in (-PATCH..=PATCH).flat_map(|dr| (-PATCH..=PATCH).map(move |dc| (dr, dc))) {
            let at = |(row, col): (usize, usize)| {
                let (row, col) = (row as isize + dr, col as isize + dc);
                let inside = (0..height).contains(&row) && (0..width).contains(&col);
                inside.then(|| (row * width + col) as usize * count)
            };
            let (Some(a), Some(b)) = (at(p), at(q)) else { continue };
            for range in 0..count {
                let (va, vb) = (guide.variance[a + range], guide.variance[b + range]);
                let difference = guide.mean[a + range] - guide.mean[b + range];
                let noise = va + vb;
                n += 1.0;
                if noise > 0.0 {
                    sum += (difference * difference - (va + va.min(vb)))
                        / (f32::MIN_POSITIVE + strength * noise);
                } else if difference != 0.0 {
                    return f32::INFINITY;
                }
            }
        }
        sum / n
    }
}

/// Scales each part so that its mean is that of the raw image, per component and band.
fn give_back_means(raw: &ComponentImage, result: &mut ComponentImage) {
    let bands = raw.grid.len();
    let pixels = raw.width * raw.height;
    let parts = raw.features.part.iter().max().map_or(1, |&most| usize::from(most) + 1);
    let part_of = |pixel: usize| raw.features.part.get(pixel).map_or(0, |&part| usize::from(part));
    for component in 0..raw.components.len() {
        let sums = |image: &ComponentImage| {
            let mut sums = vec![0.0_f64; parts * bands];
            for (pixel, spectrum) in image.stored(component).chunks(bands).enumerate() {
                let of_part = &mut sums[part_of(pixel) * bands..][..bands];
                of_part.iter_mut().zip(spectrum).for_each(|(sum, v)| *sum += f64::from(*v));
            }
            sums
        };
        let (wanted, found) = (sums(raw), sums(result));
        let start = component * pixels * bands;
        for (pixel, spectrum) in result.data[start..start + pixels * bands].chunks_mut(bands).enumerate() {
            for (band, value) in spectrum.iter_mut().enumerate() {
                let at = part_of(pixel) * bands + band;
                if found[at] > 0.0 {
                    *value = (f64::from(*value) * wanted[at] / found[at]) as f32;
                }
            }
        }
    }
}
