//! How well a target is told from what lies around it: contrast, d', the smallest visible diameter, frames to average.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::pixel_mean::raw_weights;
use super::{ChannelNoise, LineNoise, PixelSelection};
use crate::image::ChannelImage;

/// Lags in rows and columns, pixels, up to which noise is looked at for correlation: an interpolation of colors reaches 4.
const MOST_LAG: isize = 6;
/// Standard errors from which a correlation counts.
const SIGNIFICANT: f64 = 3.5;
/// Pairs of pixels that the correlation at a lag is found from, at most.
const MOST_PAIRS: usize = 200_000;
/// Steps from the rim at which rings of a target end; what lies deeper is one more.
const RING_ENDS: [usize; 3] = [2, 4, 8];

/// One channel of a target and of what lies around it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelContrast {
    /// Channel.
    pub name: String,
    /// Mean of the target above that of its background at the same place, DN.
    pub difference_dn: f64,
    /// Background in the middle of the target, DN.
    pub background_dn: f64,
    /// Difference over background (Weber); none over a background that is dark.
    pub contrast: Option<f64>,
    /// Size of the difference in standard deviations of a pixel, structure of the background included.
    pub cnr: f64,
}

/// How well one frame tells a target from its background.
///
/// All d' are those of linear observers that know where the target is, its colors and its background (signal known exactly): the
/// distance of the means of the decision variable in standard deviations (Barrett and Myers, Foundations of Image Science, 2004,
/// chapter 13).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TargetDetection {
    /// Name of the target.
    pub target: String,
    /// Its number in the image of labels, from 1; 0 without one.
    pub number: usize,
    /// Frame.
    pub frame: String,
    /// Usable pixels of the target.
    pub pixels: usize,
    /// Usable pixels of the background.
    pub background_pixels: usize,
    /// Each channel.
    pub channels: Vec<ChannelContrast>,
    /// d' of one pixel, all channels together, in the covariance that the pixels of target and background have.
    pub d_prime_pixel: f64,
    /// d' of the whole target in the noise that the frame shows, with its correlation between neighbors: Hotelling
    /// observer on rings.
    pub d_prime: f64,
    /// The same in the sensor's noise alone, independent from raw pixel to raw pixel but for lines: `d'² = D^T C^-1 D` with `var_c / (N s_c)`
    /// in `C`, `s_c` the share of the pixels that measure a channel, and what lines share of target less background.
    pub d_prime_of_sensor: f64,
    /// 95 % interval of [`Self::d_prime`] by the noise of frame and render, which few samples make wide.
    #[serde(default)]
    pub d_prime_interval: Option<[f64; 2]>,
    /// d' that is wanted.
    pub wanted_d_prime: f64,
    /// Diameter of a disc of this contrast that has the wanted d', pixels; at least one. A spot that lies askew covers as many pixels.
    pub smallest_diameter_px: f64,
    /// Least diameter that the noise of frame and render allows for, pixels: 95 % of such measurements lie above it.
    #[serde(default)]
    pub smallest_diameter_least_px: f64,
    /// Largest diameter likewise; `None` where the contrast itself is not told from none.
    #[serde(default)]
    pub smallest_diameter_most_px: Option<f64>,
    /// The same diameter of a disc that lies on the surface of the target, tilted as that is, mm; where its distance is known.
    pub smallest_diameter_mm: Option<f64>,
    /// Variance of the whole target by the noise of the render over that by everything else; the numbers above are without it. `None`
    /// without a render.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub render_noise: Option<f64>,
    /// Samples per pixel with which the noise of the render is a quarter of the rest; `None` where it is less already.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples_needed: Option<u32>,
    /// Frames whose mean has the wanted d'. None where no number does: what stays the same in all of them hides the target.
    pub frames_needed: Option<u64>,
}

/// Noise of a render in a frame: independent from pixel to pixel of the render.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderNoise {
    /// Covariance of the channels of a pixel of the render, DN², `[channel][channel]`.
    pub covariance_dn2: Vec<Vec<f64>>,
    /// Columns and rows of the frame for each of the render.
    pub frame_per_render: [f64; 2],
    /// Samples of a pixel.
    pub samples_per_pixel: u32,
}

impl RenderNoise {
    /// Share of a render pixel's variance that a pixel of the frame has. In each direction it averages evenly over `1 / q` pixels of the
    /// render, wherever it lies: `1 - 1 / (3 q)` for `q >= 1`, `q - q² / 3` below.
    fn share_of_pixel(&self) -> f64 {
        let along = |q: f64| if q >= 1.0 { 1.0 - 1.0 / (3.0 * q) } else { q - q * q / 3.0 };
        self.frame_per_render.map(along).iter().product()
    }

    /// Pixels of the frame for each pixel of the render.
    fn frame_pixels(&self) -> f64 {
        self.frame_per_render.iter().product()
    }

    fn matrix(&self, channels: usize) -> DMatrix<f64> {
        DMatrix::from_fn(channels, channels, |i, j| {
            self.covariance_dn2.get(i).and_then(|row| row.get(j)).copied().unwrap_or(0.0)
        })
    }
}

/// Least noise of a developed pixel over that of a raw one: interpolation averages over up to four.
const LEAST_DEVELOPED: f64 = 0.25;

/// Covariance of the pixels less that of the render's noise: at least what the sensor leaves of its own after interpolation.
fn without_render(
    covariance: &DMatrix<f64>,
    render: &RenderNoise,
    of_sensor: &[f64],
) -> Option<DMatrix<f64>> {
    let channels = of_sensor.len();
    let rest = covariance - render.matrix(channels) * render.share_of_pixel();
    let scale = DVector::from_iterator(channels, of_sensor.iter().map(|v| (LEAST_DEVELOPED * v).sqrt()));
    let relative = DMatrix::from_fn(channels, channels, |i, j| rest[(i, j)] / (scale[i] * scale[j]));
    let mut eigen = relative.try_symmetric_eigen(1e-12, 1000)?;
    eigen.eigenvalues.iter_mut().for_each(|value| *value = value.max(1.0));
    let kept = eigen.recompose();
    Some(DMatrix::from_fn(channels, channels, |i, j| kept[(i, j)] * scale[i] * scale[j]))
}

impl TargetDetection {
    /// Measures a target in a developed frame, of which the pixels of `background` are the rest. Both may lie under uneven light: a plane
    /// is fitted to each channel. The noise of a render is taken out of that of the frame. `None` for too few usable pixels, and where
    /// nothing varies.
    #[must_use]
    pub fn new(
        name: &str,
        image: &ChannelImage,
        noise: &ChannelNoise,
        [target, background]: [&PixelSelection; 2],
        wanted_d_prime: f64,
        render: Option<&RenderNoise>,
    ) -> Option<Self> {
        let usable = |selection: &PixelSelection| -> Vec<usize> {
            let is_usable = |pixel: &usize| image.saturated.get(*pixel) == Some(&false);
            selection.pixels.iter().copied().filter(is_usable).collect()
        };
        let (inside, around) = (usable(target), usable(background));
        let fit = PlaneFit::new(image, &inside, &around)?;
        let n = inside.len() as f64;
        let sensor = sensor_variances(image, noise, inside.iter().chain(&around).copied());

        // What the best weights of the channels of a pixel make of it
        let covariance = match render {
            Some(render) => without_render(&fit.covariance, render, &sensor.0)?,
            None => fit.covariance.clone(),
        };
        let of_pixel = covariance.clone().cholesky()?.solve(&fit.difference);
        let d_prime_pixel = fit.difference.dot(&of_pixel).max(0.0).sqrt();
        if !(d_prime_pixel.is_finite() && d_prime_pixel > 0.0) {
            return None;
        }
        // The best of the whole target: the weighted sum differs by d', and has unit variance in a pixel where lines share nothing
        let [of_lines, changing] = fit.covariance_by_lines(image, &noise.lines, [&inside, &around]);
        let weights = (covariance / n + &of_lines).cholesky()?.solve(&fit.difference);
        let weights = &weights * (d_prime_pixel / weights.dot(&fit.difference));
        let noise_field = without_lines(fit.weighted(&weights), &noise.lines, image.width);
        let correlation = Correlation::new(&noise_field, image.width, image.height);
        let of_template = |covariance: &DMatrix<f64>| weights.dot(&(covariance * &weights));
        let seen = correlation.variance_of_template(&inside, image.width)? + of_template(&of_lines);

        // The sensor's part in it: independent from raw pixel to raw pixel, and what lines share
        let raw_pixels = |c: usize| n * image.shares.get(c).copied().unwrap_or(1.0);
        let covariance = |variances: &[f64], of_lines: DMatrix<f64>| {
            let own =
                variances.iter().enumerate().map(|(c, var)| (var / raw_pixels(c)).max(f64::MIN_POSITIVE));
            of_lines + DMatrix::from_diagonal(&DVector::from_iterator(variances.len(), own))
        };
        let (of_sensor, changing) = (covariance(&sensor.0, of_lines), covariance(&sensor.1, changing));
        let variances = TemplateVariance {
            seen,
            sensor: of_template(&of_sensor),
            temporal: of_template(&changing),
            render: render.map(|render| {
                let matrix = render.matrix(weights.len());
                weights.dot(&(matrix * &weights)) * render.frame_pixels() / n
            }),
            independent: (inside.len() + around.len()) as f64
                / render.map_or(1.0, |render| render.frame_pixels().max(1.0)),
        };
        let variance = variances.without_render();
        let d_prime = d_prime_pixel / variance.sqrt();

        // The disc that has the wanted d', and what noise makes of it
        let diameter = |variance: f64, d_prime_pixel: f64| {
            let pixels = n * variance * (wanted_d_prime / d_prime_pixel).powi(2);
            (2.0 * (pixels / std::f64::consts::PI).sqrt()).max(1.0)
        };
        let contrast_error = 2.0 * (seen * (1.0 + n / around.len() as f64)).sqrt();
        let [least, most] = variances.interval();
        let [weakest, strongest] = [-contrast_error, contrast_error].map(|error| d_prime_pixel + error);
        Some(Self {
            target: name.into(),
            number: 0,
            frame: image.label.clone(),
            pixels: inside.len(),
            background_pixels: around.len(),
            channels: fit.contrasts(image),
            d_prime_pixel,
            d_prime,
            d_prime_of_sensor: fit.difference.dot(&of_sensor.cholesky()?.solve(&fit.difference)).sqrt(),
            d_prime_interval: Some([weakest.max(0.0) / most.sqrt(), strongest / least.sqrt()]),
            wanted_d_prime,
            smallest_diameter_px: diameter(variance, d_prime_pixel),
            smallest_diameter_least_px: diameter(least, strongest),
            smallest_diameter_most_px: (weakest > 0.0).then(|| diameter(most, weakest)),
            smallest_diameter_mm: None,
            render_noise: variances.render.map(|render| render / variance),
            samples_needed: render.and_then(|render| variances.samples_needed(render.samples_per_pixel)),
            frames_needed: variances.frames_needed((d_prime_pixel / wanted_d_prime).powi(2)),
        })
    }
}

/// Variances of the decision variable over a whole target.
#[derive(Clone, Copy, Debug)]
struct TemplateVariance {
    /// In the frame.
    seen: f64,
    /// By the noise of the sensor.
    sensor: f64,
    /// By that part of it which changes from frame to frame.
    temporal: f64,
    /// By the noise of the render.
    render: Option<f64>,
    /// Independent values that the variances are found from.
    independent: f64,
}

impl TemplateVariance {
    /// Standard error of a variance.
    fn error(&self) -> f64 {
        // What is seen and what is taken out of it are found from the same number of values
        let render = self.render.unwrap_or(0.0);
        (2.0 / self.independent).sqrt() * self.seen.hypot(render)
    }

    /// Variance without the noise of the render: with a render at least that of the sensor.
    fn without_render(&self) -> f64 {
        match self.render {
            Some(render) => (self.seen - render).max(self.sensor),
            None => self.seen,
        }
    }

    /// Two standard errors to both sides.
    fn interval(&self) -> [f64; 2] {
        let (variance, error) = (self.without_render(), 2.0 * self.error());
        let least = if self.render.is_some() { self.sensor.min(variance) } else { 0.1 * variance };
        [(variance - error).max(least), variance + error]
    }

    /// Frames whose mean has no more than this variance.
    fn frames_needed(&self, wanted: f64) -> Option<u64> {
        let variance = self.without_render();
        if variance <= wanted {
            return Some(1);
        }
        // What is left over in a frame stays the same in all of them, where it is more than the error of the variance
        let fixed = variance - self.temporal;
        let is_fixed = fixed > SIGNIFICANT * self.error();
        let (fixed, changing) = if is_fixed { (fixed, self.temporal) } else { (0.0, variance) };
        let frames = (changing / (wanted - fixed)).ceil();
        (1.0..1e9).contains(&frames).then_some(frames as u64)
    }

    /// Samples per pixel that make the variance of the render a quarter of the rest; `None` where it is no more.
    fn samples_needed(&self, samples: u32) -> Option<u32> {
        let factor = 4.0 * self.render? / self.without_render();
        (factor > 1.0).then(|| (f64::from(samples) * factor).ceil().min(1e6) as u32)
    }
}

/// A plane under target and background in each channel, and what the target adds to it.
struct PlaneFit {
    /// What the target adds, by channel, DN.
    difference: DVector<f64>,
    /// The plane in the middle of the target, DN.
    level: DVector<f64>,
    /// Covariance of the channels of a pixel about the fit, DN².
    covariance: DMatrix<f64>,
    /// Pixels, and what is left of their channels, DN.
    residuals: Vec<(usize, DVector<f64>)>,
}

impl PlaneFit {
    /// Least squares of `a + b x + c y + D [inside]`; `None` for fewer than four pixels more than unknowns.
    fn new(image: &ChannelImage, inside: &[usize], around: &[usize]) -> Option<Self> {
        const UNKNOWNS: usize = 4;
        let channels = image.channels.len();
        let pixels =
            || inside.iter().map(|&pixel| (pixel, 1.0)).chain(around.iter().map(|&pixel| (pixel, 0.0)));
        let count = inside.len() + around.len();
        if inside.is_empty() || around.len() < UNKNOWNS + channels || count < 2 * UNKNOWNS + channels {
            return None;
        }
        // Coordinates about the middle of the target
        let place = |pixel: usize| [pixel % image.width, pixel / image.width].map(|v| v as f64 + 0.5);
        let middle =
            [0, 1].map(|axis| inside.iter().map(|&p| place(p)[axis]).sum::<f64>() / inside.len() as f64);
        let scale = 1.0 / (count as f64).sqrt();
        let row = |pixel: usize, is_inside: f64| {
            let [x, y] = place(pixel);
            [1.0, (x - middle[0]) * scale, (y - middle[1]) * scale, is_inside]
        };
        let values = |pixel: usize| (0..channels).map(move |c| f64::from(image.data[pixel * channels + c]));
        let mut normal = DMatrix::<f64>::zeros(UNKNOWNS, UNKNOWNS);
        let mut right = DMatrix::<f64>::zeros(UNKNOWNS, channels);
        for (pixel, is_inside) in pixels() {
            let row = row(pixel, is_inside);
            for i in 0..UNKNOWNS {
                for j in 0..UNKNOWNS {
                    normal[(i, j)] += row[i] * row[j];
                }
                values(pixel).enumerate().for_each(|(c, value)| right[(i, c)] += row[i] * value);
            }
        }
        let solution = normal.cholesky()?.solve(&right);
        let mut covariance = DMatrix::<f64>::zeros(channels, channels);
        let mut residuals = Vec::with_capacity(count);
        for (pixel, is_inside) in pixels() {
            let row = row(pixel, is_inside);
            let fitted = |c: usize| (0..UNKNOWNS).map(|i| row[i] * solution[(i, c)]).sum::<f64>();
            let left =
                DVector::from_iterator(channels, values(pixel).enumerate().map(|(c, v)| v - fitted(c)));
            covariance += &left * left.transpose();
            residuals.push((pixel, left));
        }
        covariance /= (count - UNKNOWNS) as f64;
        Some(Self {
            difference: solution.row(3).transpose(),
            level: solution.row(0).transpose(),
            covariance,
            residuals,
        })
    }

    /// What is left of the weighted sum of the channels, by pixel.
    fn weighted(&self, weights: &DVector<f64>) -> Vec<(usize, f64)> {
        self.residuals.iter().map(|(pixel, left)| (*pixel, left.dot(weights))).collect()
    }

    /// Covariance of what the target adds by what lines share, DN²: by all of it, and by what changes from frame to frame.
    fn covariance_by_lines(
        &self,
        image: &ChannelImage,
        lines: &LineNoise,
        [inside, around]: [&[usize]; 2],
    ) -> [DMatrix<f64>; 2] {
        let channels: Vec<usize> = (0..image.channels.len()).collect();
        let of_channel = |&channel: &usize| {
            let less =
                raw_weights(image, channel, around).into_iter().map(|(pixel, weight)| (pixel, -weight));
            raw_weights(image, channel, inside).into_iter().chain(less).collect()
        };
        let weights: Vec<Vec<(usize, f64)>> =
            if lines.is_none() { Vec::new() } else { channels.iter().map(of_channel).collect() };
        let changing = LineNoise { fixed_dn: [0.0; 2], column_gain: 0.0, ..*lines };
        [*lines, changing].map(|lines| lines.covariance(image, &channels, &weights, self.level.as_slice()))
    }

    fn contrasts(&self, image: &ChannelImage) -> Vec<ChannelContrast> {
        let of = |(c, name): (usize, &String)| {
            let (difference_dn, background_dn) = (self.difference[c], self.level[c]);
            let deviation = self.covariance[(c, c)].sqrt();
            ChannelContrast {
                name: name.clone(),
                difference_dn,
                background_dn,
                contrast: (background_dn > image.noise_floor_dn).then(|| difference_dn / background_dn),
                cnr: difference_dn.abs() / deviation.max(f64::MIN_POSITIVE),
            }
        };
        image.channels.iter().enumerate().map(of).collect()
    }
}

/// Mean variances of the channels of some pixels by noise that is independent from pixel to pixel, DN²: all of it, and what changes from
/// frame to frame. Patterns of the sensor, and what calibration frames leave of them, are the same in all frames.
fn sensor_variances(
    image: &ChannelImage,
    noise: &ChannelNoise,
    pixels: impl Iterator<Item = usize>,
) -> (Vec<f64>, Vec<f64>) {
    let channels = image.channels.len();
    let floor_dn = image.noise_floor_dn.min(noise.floor_dn);
    let temporal = ChannelNoise { gain_spread: 0.0, floor_dn, ..*noise };
    let mut sums = (vec![0.0; channels], vec![0.0; channels]);
    let mut count = 0.0f64;
    for pixel in pixels {
        count += 1.0;
        for channel in 0..channels {
            let value_dn = f64::from(image.data[pixel * channels + channel]);
            let pattern = image.calibration.as_ref().map_or(0.0, |by| by.pattern_dn2(channel, value_dn));
            sums.0[channel] += noise.of_value(image, channel, pixel);
            sums.1[channel] += (temporal.of_value(image, channel, pixel) - pattern).max(0.0);
        }
    }
    let mean =
        |sums: Vec<f64>| sums.into_iter().map(|sum| (sum / count.max(1.0)).max(f64::MIN_POSITIVE)).collect();
    (mean(sums.0), mean(sums.1))
}

/// A field without the means of its lines, of which the sensor's noise is known: lags of few pixels don't tell it. In a mosaic neighbors in a
/// line rest on other lines.
fn without_lines(mut field: Vec<(usize, f64)>, lines: &LineNoise, width: usize) -> Vec<(usize, f64)> {
    let of_columns = lines.column_dn + lines.fixed_dn[1] + lines.column_gain;
    for (is_row, noise) in [(true, lines.row_dn + lines.fixed_dn[0]), (false, of_columns)] {
        if noise <= 0.0 {
            continue;
        }
        let line = |pixel: usize| {
            let place = [pixel / width, pixel % width];
            if is_row { (place[0], place[1] % 2) } else { (place[1], place[0] % 2) }
        };
        let mut sums: BTreeMap<(usize, usize), [f64; 2]> = BTreeMap::new();
        for &(pixel, value) in &field {
            let [sum, count] = sums.entry(line(pixel)).or_default();
            (*sum, *count) = (*sum + value, *count + 1.0);
        }
        // The means take noise of pixels along
        let kept = (1.0 - sums.len() as f64 / field.len() as f64).sqrt();
        for (pixel, value) in &mut field {
            let [sum, count] = sums[&line(*pixel)];
            *value = (*value - sum / count) / kept.max(0.5);
        }
    }
    field
}

/// Covariance of a noise field between pixels at a lag, where it is told from none.
struct Correlation {
    /// Lags in rows and columns, and the covariance there; both signs of a lag, and no lag first.
    lags: Vec<(isize, isize, f64)>,
}

impl Correlation {
    fn new(field: &[(usize, f64)], width: usize, height: usize) -> Self {
        let dense = DenseField::new(field, width, height);
        let step = field.len().div_ceil(MOST_PAIRS).max(1);
        let of_lag = |down: isize, right: isize| -> (f64, f64) {
            let products = field.iter().step_by(step).filter_map(|&(pixel, value)| {
                let (row, col) = ((pixel / width) as isize + down, (pixel % width) as isize + right);
                Some(value * dense.at(row, col)?)
            });
            products.fold((0.0, 0.0), |(sum, pairs), product| (sum + product, pairs + 1.0))
        };
        let (sum, pairs) = of_lag(0, 0);
        let variance = sum / f64::max(pairs, 1.0);
        let mut lags = vec![(0, 0, variance)];
        for down in 0..=MOST_LAG {
            for right in -MOST_LAG..=MOST_LAG {
                if down == 0 && right <= 0 {
                    continue;
                }
                let (sum, pairs) = of_lag(down, right);
                let covariance = sum / f64::max(pairs, 1.0);
                if covariance.abs() * pairs.sqrt() > SIGNIFICANT * variance {
                    lags.extend([(down, right, covariance), (-down, -right, covariance)]);
                }
            }
        }
        Self { lags }
    }

    /// Variance of the best estimate of a level that all pixels of a target share, as a weighted sum of the means of rings at some
    /// distances from its rim (a channelized Hotelling observer): `1 / (1ᵀ C⁻¹ 1)` with the covariance C of these means. Where that is
    /// none of any noise, the variance of the mean of all pixels. No finer template is tried: what noise lacks at the finest details a
    /// target lacks as well.
    fn variance_of_template(&self, inside: &[usize], width: usize) -> Option<f64> {
        let ring = rings(inside, width);
        let count = ring.iter().flatten().max().map_or(0, |last| last + 1);
        let mut sums = DMatrix::<f64>::zeros(count, count);
        let mut sizes = vec![0.0; count];
        for &pixel in inside {
            let Some(own) = ring[pixel] else { continue };
            sizes[own] += 1.0;
            let (row, col) = ((pixel / width) as isize, (pixel % width) as isize);
            for &(down, right, covariance) in &self.lags {
                let (r, c) = (row + down, col + right);
                if r < 0 || !(0..width as isize).contains(&c) {
                    continue;
                }
                if let Some(&Some(other)) = ring.get(r as usize * width + c as usize) {
                    sums[(own, other)] += covariance;
                }
            }
        }
        let n: f64 = sizes.iter().sum();
        let of_mean = sums.iter().sum::<f64>() / (n * n);
        let covariance = DMatrix::from_fn(count, count, |i, j| sums[(i, j)] / (sizes[i] * sizes[j]));
        let ones = DVector::from_element(count, 1.0);
        let best = covariance.cholesky().map(|factor| 1.0 / factor.solve(&ones).sum());
        best.filter(|variance| *variance > 0.0).or((of_mean > 0.0).then_some(of_mean))
    }
}

/// Values of some pixels of an image; NaN at the others.
struct DenseField {
    values: Vec<f64>,
    width: usize,
    height: usize,
}

impl DenseField {
    fn new(field: &[(usize, f64)], width: usize, height: usize) -> Self {
        let mut values = vec![f64::NAN; width * height];
        field.iter().for_each(|&(pixel, value)| values[pixel] = value);
        Self { values, width, height }
    }

    /// The value of a pixel, which may lie outside the image.
    fn at(&self, row: isize, col: isize) -> Option<f64> {
        let inside = (0..self.height as isize).contains(&row) && (0..self.width as isize).contains(&col);
        inside.then(|| self.values[row as usize * self.width + col as usize]).filter(|value| !value.is_nan())
    }
}

/// Number of the ring of each pixel of a target, by its steps from the rim; `None` beside the target.
fn rings(inside: &[usize], width: usize) -> Vec<Option<usize>> {
    let last = RING_ENDS.len();
    let mut ring = vec![None; inside.iter().max().map_or(0, |pixel| pixel + 1)];
    inside.iter().for_each(|&pixel| ring[pixel] = Some(last));
    let mut steps = vec![usize::MAX; ring.len()];
    let mut rest = inside.to_vec();
    for step in 1..=RING_ENDS[last - 1] {
        let is_beyond = |pixel: Option<usize>| match pixel.filter(|&pixel| pixel < ring.len()) {
            Some(pixel) => ring[pixel].is_none() || steps[pixel] < step,
            None => true,
        };
        let is_rim = |&pixel: &usize| {
            let col = pixel % width;
            let sides = [
                (col > 0).then(|| pixel - 1),
                (col + 1 < width).then_some(pixel + 1),
                pixel.checked_sub(width),
                Some(pixel + width),
            ];
            sides.into_iter().any(is_beyond)
        };
        let (rim, inner): (Vec<usize>, Vec<usize>) = rest.into_iter().partition(|pixel| is_rim(pixel));
        rim.iter().for_each(|&pixel| steps[pixel] = step);
        let number = RING_ENDS.iter().position(|end| step <= *end);
        rim.iter().for_each(|&pixel| ring[pixel] = number);
        rest = inner;
    }
    without_empty(&ring)
}

/// Numbers of rings without those that no pixel is in.
fn without_empty(ring: &[Option<usize>]) -> Vec<Option<usize>> {
    let mut used: Vec<usize> = ring.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    ring.iter().map(|number| used.iter().position(|other| Some(*other) == *number)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::CalibrationNoise;
    use crate::sampling::random::Key;
    use rand::RngExt;
    use rand_distr::StandardNormal;

    const SIDE: usize = 120;

    /// A disc of a radius in the middle of an image, and the ring of twice its area around it.
    fn disc_and_ring(radius: f64) -> [PixelSelection; 2] {
        let r2 = |pixel: usize| {
            let [x, y] = [pixel % SIDE, pixel / SIDE].map(|v| v as f64 - SIDE as f64 / 2.0);
            x * x + y * y
        };
        let select = |keep: &dyn Fn(f64) -> bool| PixelSelection {
            width: SIDE,
            height: SIDE,
            pixels: (0..SIDE * SIDE).filter(|&pixel| keep(r2(pixel))).collect(),
        };
        [
            select(&|r2| r2 < radius * radius),
            select(&|r2| r2 >= (radius + 2.0).powi(2) && r2 < 4.0 * radius * radius),
        ]
    }

    /// One channel: background 1000 DN on a slope, a disc `difference` above it, white noise of this standard deviation, averaged over
    /// `box_px` pixels in both directions.
    fn image(difference: f64, sigma: f64, box_px: usize, radius: f64) -> ChannelImage {
        let mut rng = Key::new(11).rng();
        let white: Vec<f64> =
            (0..SIDE * SIDE).map(|_| sigma * rng.sample::<f64, _>(StandardNormal)).collect();
        let noise = |row: usize, col: usize| {
            let taps = (0..box_px).flat_map(|r| (0..box_px).map(move |c| (r, c)));
            let sum: f64 = taps.map(|(r, c)| white[(row + r) % SIDE * SIDE + (col + c) % SIDE]).sum();
            sum / (box_px * box_px) as f64
        };
        let [disc, _] = disc_and_ring(radius);
        let is_inside = |pixel: usize| disc.pixels.binary_search(&pixel).is_ok();
        let value = |pixel: usize| {
            let (row, col) = (pixel / SIDE, pixel % SIDE);
            let base = 1000.0 + 0.8 * (col as f64 - SIDE as f64 / 2.0);
            (base + noise(row, col) + if is_inside(pixel) { difference } else { 0.0 }) as f32
        };
        ChannelImage {
            width: SIDE,
            height: SIDE,
            channels: vec!["mono".into()],
            data: (0..SIDE * SIDE).map(value).collect(),
            saturated: vec![false; SIDE * SIDE],
            noise_floor_dn: sigma,
            full_scale_dn: 4000.0,
            shares: vec![1.0],
            interpolation: None,
            subtracted: None,
            calibration: None,
            label: "blue".into(),
        }
    }

    fn found(difference: f64, sigma: f64, box_px: usize, radius: f64, wanted: f64) -> TargetDetection {
        let noise = ChannelNoise {
            floor_dn: sigma,
            dn_per_electron: 0.0,
            gain_spread: 0.0,
            lines: LineNoise::default(),
        };
        let [disc, ring] = disc_and_ring(radius);
        let image = image(difference, sigma, box_px, radius);
        TargetDetection::new("disc", &image, &noise, [&disc, &ring], wanted, None).unwrap()
    }

    /// Noise of a render whose pixels are three by three of the frame, four times as large as that of the sensor in standard deviation,
    /// hides nothing: it is known and taken out. d' and the diameter are those of the sensor's noise, 4.2 pixels, within the interval that
    /// is told; left in, noise of this size makes it `sqrt(1 + 9 * 16)` times as wide.
    #[test]
    fn noise_of_a_render_is_taken_out() {
        let (difference, sigma, radius) = (20.0, 25.0, 25.0);
        let [disc, ring] = disc_and_ring(radius);
        let mut image = image(difference, sigma, 1, radius);
        let mut rng = Key::new(12).rng();
        let coarse: Vec<f64> =
            (0..40 * 40).map(|_| 4.0 * sigma * rng.sample::<f64, _>(StandardNormal)).collect();
        for (pixel, value) in image.data.iter_mut().enumerate() {
            *value += coarse[pixel / SIDE / 3 * 40 + pixel % SIDE / 3] as f32;
        }
        let noise = ChannelNoise {
            floor_dn: sigma,
            dn_per_electron: 0.0,
            gain_spread: 0.0,
            lines: LineNoise::default(),
        };
        let render = RenderNoise {
            covariance_dn2: vec![vec![16.0 * sigma * sigma]],
            frame_per_render: [3.0; 2],
            samples_per_pixel: 4,
        };
        let measure =
            |render| TargetDetection::new("disc", &image, &noise, [&disc, &ring], 3.29, render).unwrap();
        let (left_in, told) = (measure(None), measure(Some(&render)));
        let expected = 2.0 * ((3.29 * sigma / difference).powi(2) / std::f64::consts::PI).sqrt();
        let most = told.smallest_diameter_most_px.unwrap();
        assert!(told.smallest_diameter_least_px < expected && expected < most, "{expected}: {told:?}");
        assert!(left_in.smallest_diameter_px > 5.0 * expected, "{left_in:?}");
        // Of 144 times the variance a quarter is left with 4 * 144 times the samples, as far as 144 is known.
        let ratio = told.render_noise.unwrap();
        assert!(told.samples_needed == Some((16.0 * ratio).ceil() as u32), "{told:?}");
        assert!(left_in.render_noise.is_none() && left_in.samples_needed.is_none());
    }

    #[test]
    fn noise_above_what_is_wanted_takes_more_than_one_frame() {
        let of = |temporal: f64, independent: f64| TemplateVariance {
            seen: 1.2,
            sensor: temporal,
            temporal,
            render: None,
            independent,
        };
        // The excess over the temporal noise is less than its error: all may change from frame to frame
        assert_eq!(of(0.9, 200.0).frames_needed(1.0), Some(2));
        assert_eq!(of(0.9, 200.0).frames_needed(0.1), Some(12));
        // It is more: 0.3 stays
        assert_eq!(of(0.9, 1e6).frames_needed(0.4), Some(9));
        assert_eq!(of(0.9, 1e6).frames_needed(0.2), None);
    }

    /// A disc of contrast C in white noise: d' = C L sqrt(N) / sigma, one pixel C L / sigma. The difference is known to
    /// sigma sqrt(1/N + 1/M) and the deviation to 1 / sqrt(2 (N + M)): 3 % of d' together here, of which four are allowed.
    #[test]
    fn a_disc_in_white_noise_has_the_d_prime_of_the_closed_form() {
        let (difference, sigma, radius) = (-20.0, 25.0, 20.0);
        let told = found(difference, sigma, 1, radius, 3.29);
        let n = told.pixels as f64;
        let expected = difference.abs() * n.sqrt() / sigma;
        let error = (1.0 / n + 1.0 / told.background_pixels as f64).sqrt() * sigma / difference.abs();
        assert!((told.d_prime / expected - 1.0).abs() < 4.0 * (error + 0.5 / n.sqrt()), "{told:?}");
        assert!((told.d_prime_pixel / (0.8) - 1.0).abs() < 4.0 * (error + 0.5 / n.sqrt()), "{told:?}");
        // The sensor's noise is all there is.
        assert!((told.d_prime_of_sensor / told.d_prime - 1.0).abs() < 0.08, "{told:?}");
        let contrast = told.channels[0].contrast.unwrap();
        assert!((contrast + 0.02).abs() < 4.0 * 0.02 * error, "{contrast}");
        // By inversion: the disc of this diameter has N with C sqrt(N) / sigma = 3.29.
        let diameter = 2.0 * ((3.29 * sigma / difference).powi(2) / std::f64::consts::PI).sqrt();
        assert!(
            (told.smallest_diameter_px / diameter - 1.0).abs() < 4.0 * (error + 0.5 / n.sqrt()),
            "{told:?}"
        );
        assert_eq!(told.frames_needed, Some(1));
    }

    /// A flat field whose factors err by 1 % leaves 10 of 1000 DN in every pixel of every frame, beside 5 DN that change: of 1257 pixels no
    /// mean of frames has more than d' `sqrt(1257) 1.5 / 10` of 5.3, which the interval of one frame does not know.
    #[test]
    fn what_a_flat_field_leaves_is_the_same_in_all_frames() {
        let (difference, sigma, radius) = (1.5, 125f64.sqrt(), 20.0);
        let [disc, ring] = disc_and_ring(radius);
        let mut image = image(difference, sigma, 1, radius);
        image.noise_floor_dn = 5.0;
        image.calibration = Some(CalibrationNoise {
            variance_dn2: vec![100.0; SIDE * SIDE],
            scale_variance: vec![0.01],
            dark_pattern_dn2: Vec::new(),
            factor_variance: vec![1e-4],
            line_variance: Vec::new(),
            has_dark: false,
            has_flat: true,
        });
        let noise = ChannelNoise {
            floor_dn: 5.0,
            dn_per_electron: 0.0,
            gain_spread: 0.0,
            lines: LineNoise::default(),
        };
        let measure =
            |wanted| TargetDetection::new("disc", &image, &noise, [&disc, &ring], wanted, None).unwrap();
        let told = measure(7.0);
        assert_eq!(told.frames_needed, None, "{told:?}");
        assert!(measure(0.9 * told.d_prime).frames_needed == Some(1), "{told:?}");
        // The error of the scale is that of target and background alike
        assert!((told.d_prime_of_sensor / told.d_prime - 1.0).abs() < 0.1, "{told:?}");
        // Nor does the interval depend on what is wanted
        let [low, high] = told.d_prime_interval.unwrap();
        assert!(low < told.d_prime && told.d_prime < high && high < 3.0 * told.d_prime, "{told:?}");
        assert_eq!(measure(0.01).d_prime_interval, told.d_prime_interval);
    }

    /// What rows share hides a target as much as differences over frames scatter: the deviation of 100 is known to 0.07, held to four of that.
    #[test]
    fn noise_of_rows_is_in_the_d_prime() {
        const FRAMES: usize = 100;
        let (difference, sigma, radius) = (20.0, 10.0, 20.0);
        let [disc, ring] = disc_and_ring(radius);
        let exact = image(difference, 0.0, 1, radius);
        let lines = LineNoise { row_dn: 3.0, fixed_dn: [4.0, 0.0], ..LineNoise::default() };
        let noise = ChannelNoise { floor_dn: sigma, dn_per_electron: 0.0, gain_spread: 0.0, lines };
        let mut rng = Key::new(13).rng();
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let mut frame = || {
            let rows: Vec<f64> = (0..SIDE).map(|_| 5.0 * normal()).collect();
            let mut image = ChannelImage { noise_floor_dn: sigma.hypot(3.0), ..exact.clone() };
            for (pixel, value) in image.data.iter_mut().enumerate() {
                *value += (rows[pixel / SIDE] + sigma * normal()) as f32;
            }
            TargetDetection::new("disc", &image, &noise, [&disc, &ring], 3.29, None).unwrap()
        };
        let told: Vec<TargetDetection> = (0..FRAMES).map(|_| frame()).collect();
        let mean = |of: &dyn Fn(&TargetDetection) -> f64| told.iter().map(of).sum::<f64>() / FRAMES as f64;
        let added = mean(&|t| t.channels[0].difference_dn);
        let deviation = mean(&|t| (t.channels[0].difference_dn - added).powi(2)).sqrt();
        for of in [mean(&|t| t.d_prime), mean(&|t| t.d_prime_of_sensor)] {
            assert!((of * deviation / added - 1.0).abs() < 4.0 * 0.07, "{of} for {}", added / deviation);
        }
        // Independent from pixel to pixel it would be three times as much
        assert!(added / deviation < 0.5 * difference * (disc.pixels.len() as f64).sqrt() / sigma.hypot(5.0));
    }

    /// d' grows by the root of the number of frames.
    #[test]
    fn frames_are_averaged_until_the_wanted_d_prime_is_reached() {
        let told = found(2.0, 25.0, 1, 20.0, 12.0);
        let expected = (12.0 / told.d_prime).powi(2);
        let frames = told.frames_needed.unwrap() as f64;
        assert!((frames / expected - 1.0).abs() < 0.1, "{frames} of {expected}, {told:?}");
    }

    /// Noise averaged over 3 x 3 pixels has a ninth of the variance, and a mean over a large target no less of it than before: its d' is
    /// that of the white noise, not that of independent pixels, which would be three times as large.
    #[test]
    fn correlated_noise_counts_with_its_correlation() {
        let (difference, sigma, radius) = (30.0, 60.0, 25.0);
        let told = found(difference, sigma, 3, radius, 3.29);
        let n = told.pixels as f64;
        let of_white = difference * n.sqrt() / sigma;
        // Noise at the rim averages over a part of the ring beside it, which the observer does not see: a little above. The difference is
        // known to 5 %.
        let ratio = told.d_prime / of_white;
        assert!((0.8..1.25).contains(&ratio), "{ratio}: {told:?}");
        let independent = told.d_prime_pixel * n.sqrt();
        assert!(independent > 2.0 * told.d_prime, "{independent}: {told:?}");
    }

    #[test]
    fn too_little_to_measure_is_no_measurement() {
        let noise = ChannelNoise {
            floor_dn: 1.0,
            dn_per_electron: 0.0,
            gain_spread: 0.0,
            lines: LineNoise::default(),
        };
        let [disc, ring] = disc_and_ring(10.0);
        let nothing = PixelSelection { pixels: Vec::new(), ..disc.clone() };
        let image = image(10.0, 1.0, 1, 10.0);
        let measure = |target: &PixelSelection, background: &PixelSelection| {
            TargetDetection::new("disc", &image, &noise, [target, background], 3.29, None)
        };
        assert!(measure(&nothing, &ring).is_none() && measure(&disc, &nothing).is_none());
        let mut full = image.clone();
        full.saturated.fill(true);
        assert!(TargetDetection::new("disc", &full, &noise, [&disc, &ring], 3.29, None).is_none());
    }
}
