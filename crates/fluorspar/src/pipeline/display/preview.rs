//! Previews: developed frames and radiance images in 8-bit sRGB.

use glam::DMat3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::image::{ChannelImage, SpectralImage, StatisticsKind};
use crate::pipeline::capture::direct_light::group_spectrum;
use crate::pipeline::estimate::frame_light::frame_light;
use crate::render::{ComponentBands, RenderSettings};
use crate::sensor::Sensor;
use crate::spectral::{
    Curve, QuantumEfficiency, Radiance, Spectrum, StandardObserver, WavelengthGrid, encode_srgb, linear_srgb,
};
use crate::study::{Capture, Study};
use crate::units::photons_per_joule;

/// An 8-bit sRGB image, `[row, col, channel]`, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Preview {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// R, G, B of every pixel.
    pub rgb: Vec<u8>,
}

impl Preview {
    /// The image as large as it fits in a cell of `[width, height]`, each pixel the mean of those below it, between dark borders.
    pub fn fitted(&self, [width, height]: [usize; 2]) -> Preview {
        let scale = (self.width as f64 / width as f64).max(self.height as f64 / height as f64);
        let left = 0.5 * (width as f64 - self.width as f64 / scale);
        let top = 0.5 * (height as f64 - self.height as f64 / scale);
        let span = |index: usize, border: f64, size: usize| {
            let at = |edge: f64| ((edge - border) * scale).clamp(0.0, size as f64) as usize;
            let first = at(index as f64);
            let is_outside =
                index as f64 + 0.5 < border || (index as f64 + 0.5 - border) * scale > size as f64;
            if is_outside {
                0..0
            } else {
                first..at(index as f64 + 1.0).clamp(first + 1, size.max(first + 1))
            }
        };
        let mut rgb = Vec::with_capacity(3 * width * height);
        for row in 0..height {
            let rows = span(row, top, self.height);
            for col in 0..width {
                let columns = span(col, left, self.width);
                let count = (rows.len() * columns.len()) as u32;
                let mut sums = [0_u32; 3];
                let below =
                    rows.clone().flat_map(|row| columns.clone().map(move |col| 3 * (row * self.width + col)));
                for at in below {
                    for (sum, value) in sums.iter_mut().zip(self.rgb.get(at..at + 3).unwrap_or(&[0; 3])) {
                        *sum += u32::from(*value);
                    }
                }
                rgb.extend(sums.map(|sum| sum.checked_div(count).unwrap_or(16) as u8));
            }
        }
        Preview { width, height, rgb }
    }
}

/// How channel values become colors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColorRendering {
    /// Linear sRGB from R, G, B digital numbers, rows first, before the exposure scale.
    pub matrix: [[f64; 3]; 3],
    /// Gain of dark tissue next to bright teeth, with highlights compressed: 1 is linear.
    pub lift: f64,
}

/// Colors that are the sensor's own channels.
const OWN_CHANNELS: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Percentile of the brightest channel that becomes white.
const WHITE_PERCENTILE: f64 = 0.995;

// The next four were chosen by eye on the default experiment; previews depend on them, and no number does.
/// White is never less than so many times the noise of a dark pixel.
const LEAST_WHITE: f64 = 50.0;
/// The same in a frame that holds nothing but noise: its pixels are within two of 256 steps.
const DARK_WHITE: f64 = 2e4;
/// Standard deviations of the noise that the brightest pixels of a frame with light exceed. Of noise alone 99.5 % of the largest of
/// three channels lie below 3.1.
const NOISE_ALONE: f64 = 5.0;
/// Lift of a frame under visible light.
const LIFT_REFLECTED: f64 = 1.8;
/// Lift of a fluorescence frame, where teeth are ten times brighter than tissue.
const LIFT_FLUORESCENT: f64 = 2.5;
/// Share of the full well that white surfaces are exposed to, for the noise of a color.
const EXPOSED_WELL: f64 = 0.8;
/// Pixels over which an eye averages the noise of a color.
const PIXELS_SEEN_TOGETHER: f64 = 4.0;

impl ColorRendering {
    /// Least-squares map from the responses of the camera's training reflectances under the frame's light to their colors under
    /// an equal-energy light, the noise of the sensor included: a channel with little color and much noise
    /// (blue behind a long-pass filter) gets a small weight. `None` when the channels can't be distinguished.
    fn for_reflectances(sensor: &Sensor, filter: &Curve, light: &Curve, study: &Study) -> Option<Self> {
        let grid = &study.scene.grid;
        let qe: Vec<Spectrum<QuantumEfficiency>> = ["R", "G", "B"]
            .iter()
            .map(|name| Some(sensor.qe().on_grid(sensor.qe().find(name)?, grid)))
            .collect::<Option<_>>()?;
        let lit = light.times(filter).bin_averages(grid);
        let photons: Vec<f64> =
            lit.iter().enumerate().map(|(b, v)| v * photons_per_joule(grid.center_nm(b))).collect();
        let observer = StandardObserver::new(grid);
        let respond = |reflectance: &dyn Fn(f64) -> f64| -> [f64; 3] {
            std::array::from_fn(|c| {
                (0..grid.len())
                    .map(|b| photons[b] * qe[c][b] * reflectance(grid.center_nm(b)) * grid.width_nm(b))
                    .sum()
            })
        };
        let color = |reflectance: &dyn Fn(f64) -> f64| -> [f64; 3] {
            let even: Vec<f32> = (0..grid.len()).map(|b| reflectance(grid.center_nm(b)) as f32).collect();
            linear_srgb(observer.xyz(&even))
        };
        let white = respond(&|_| 1.0);
        if white.iter().any(|&w| w <= 0.0) {
            return None;
        }
        let white_color = color(&|_| 1.0);
        let brightest = white.iter().copied().fold(0.0, f64::max);
        let model = sensor.model();
        // Variance of a response relative to that of a white surface: shot noise, read noise, gain spread.
        let variance = |channel: usize, share: f64| -> f64 {
            let of_white_e = EXPOSED_WELL * model.well_capacity_e * white[channel] / brightest;
            let signal_e = of_white_e * share;
            let spread_e = 0.01 * model.prnu_percent * signal_e;
            let variance_e2 = signal_e + model.read_noise_electrons().powi(2) + spread_e * spread_e;
            variance_e2 / (of_white_e * of_white_e)
        };
        let mut normal = [[0.0; 3]; 3];
        let mut right = [[0.0; 3]; 3];
        let mut add = |reflectance: &dyn Fn(f64) -> f64, weight: f64| {
            let (x, y) = (respond(reflectance), color(reflectance));
            for i in 0..3 {
                for j in 0..3 {
                    normal[i][j] += weight * x[i] / white[i] * x[j] / white[j];
                    right[i][j] += weight * x[i] / white[i] * y[j] / white_color[j];
                }
                normal[i][i] += weight * variance(i, x[i] / white[i]) / PIXELS_SEEN_TOGETHER;
            }
        };
        // The training reflectances, whose colors matter here, and a flat one that weighs as much as all others.
        let training = &study.camera.training_reflectances;
        for surface in training {
            add(&|nm| surface.at(nm), 1.0);
        }
        add(&|_| 1.0, training.len() as f64);
        let inverse = inverse(normal)?;
        let mut matrix = [[0.0; 3]; 3];
        for out in 0..3 {
            for channel in 0..3 {
                let value: f64 = (0..3).map(|k| inverse[channel][k] * right[k][out]).sum();
                matrix[out][channel] = value / white[channel];
            }
            // The noise term takes a little from all colors; white stays white.
            let of_white: f64 = matrix[out].iter().zip(white).map(|(m, w)| m * w).sum();
            if of_white > 0.0 {
                matrix[out].iter_mut().for_each(|m| *m /= of_white);
            }
        }
        Some(Self { matrix, lift: LIFT_REFLECTED })
    }

    /// Whether colors are the sensor's own channels.
    pub fn is_of_own_channels(&self) -> bool {
        self.matrix == OWN_CHANNELS
    }

    /// Colors of pixels before the exposure scale. Without R, G and B the first channel counts as each of them.
    fn colors<'a>(&'a self, image: &'a ChannelImage) -> impl Fn(usize) -> [f64; 3] + Sync + 'a {
        let find = |name: &str| image.channels.iter().position(|c| c == name);
        let channels = match [find("R"), find("G"), find("B")] {
            [Some(r), Some(g), Some(b)] => [r, g, b],
            _ => [0; 3],
        };
        let matrix = self.matrix;
        // A channel that clips takes its share of the color with it: what is brighter than white is white
        let is_white = move |pixel: usize| matrix != OWN_CHANNELS && image.saturated[pixel];
        move |pixel| {
            let values = &image.data[pixel * image.channels.len()..][..image.channels.len()];
            let [r, g, b] = channels.map(|c| f64::from(values[c]));
            let color = matrix.map(|[of_r, of_g, of_b]| of_r * r + of_g * g + of_b * b);
            if is_white(pixel) { [largest(color); 3] } else { color }
        }
    }

    /// The rendering of one frame of a study: colors as under white light where the light source covers the visible range;
    /// the sensor's own channels where it does not (fluorescence), dim tissue lifted.
    pub fn of_frame(study: &Study, capture: &Capture) -> Self {
        let own = Self { matrix: OWN_CHANNELS, lift: LIFT_FLUORESCENT };
        let (Some(sensor), Some(lens)) = (&study.camera.sensor, study.camera.lens_behind_filters()) else {
            return own;
        };
        let Some(light) = frame_light(study, capture, None) else { return own };
        if !covers_the_visible_range(&light) {
            return own;
        }
        Self::for_reflectances(sensor, &lens.transmittance, &light, study).unwrap_or(own)
    }
}

/// Whether surfaces have colors under this light.
fn covers_the_visible_range(light: &Curve) -> bool {
    light.integral(500.0, 650.0) >= 0.2 * light.total()
}

/// Inverse of a 3 x 3 matrix; `None` when it is singular.
pub(super) fn inverse(m: [[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    // Columns for rows, there and back: the inverse of the transpose is the transpose of the inverse.
    let matrix = DMat3::from_cols_array_2d(&m);
    let scale: f64 = m.iter().flatten().map(|v| v.abs()).sum::<f64>().powi(3);
    (matrix.determinant().abs() > 1e-12 * scale).then(|| matrix.inverse().to_cols_array_2d())
}

/// Turns a developed frame into an image, scaled so that all but the brightest half percent fits.
/// Frames without R, G and B become gray.
pub fn preview(image: &ChannelImage, rendering: &ColorRendering) -> Preview {
    preview_with_white(image, rendering, preview_white(image, rendering))
}

/// Level of the brightest channel that all but the brightest half percent of the pixels stay below, DN: about what [`preview`]
/// shows as white. 0 of an image without pixels.
pub fn bright_level_dn(image: &ChannelImage) -> f64 {
    let pixels = image.data.chunks_exact(image.channels.len().max(1));
    let mut levels: Vec<f32> = pixels.map(|pixel| pixel.iter().copied().fold(0.0, f32::max)).collect();
    if levels.is_empty() {
        return 0.0;
    }
    let index = ((levels.len() as f64 * WHITE_PERCENTILE) as usize).min(levels.len() - 1);
    f64::from(*levels.select_nth_unstable_by(index, f32::total_cmp).1)
}

/// The level that [`preview`] shows as white: that which all but the brightest half percent of the pixels stay below, and never noise
/// alone. On the scale of the rendering's colors, for which [`preview_with_white`] takes it.
pub fn preview_white(image: &ChannelImage, rendering: &ColorRendering) -> f64 {
    let gain = rendering.matrix[1].iter().sum::<f64>().abs().max(f64::MIN_POSITIVE);
    white_level(image.width * image.height, rendering.colors(image), image.noise_floor_dn * gain)
}

/// As [`preview`], with a white of one's own: frames with the same rendering and white are exposed alike.
pub fn preview_with_white(image: &ChannelImage, rendering: &ColorRendering, white: f64) -> Preview {
    let size = [image.width, image.height];
    to_srgb(size, rendering.colors(image), white.max(f64::MIN_POSITIVE), rendering.lift)
}

/// Turns a radiance image into the image that an eye would see (CIE 1931), scaled as [`preview`].
pub fn radiance_preview(image: &SpectralImage<Radiance>) -> Preview {
    balanced(image, [1.0; 3])
}

/// As [`radiance_preview`], of a scene under one light group alone, with white surfaces white as in [`preview`]: the
/// colors of surfaces, not of the light source. Light that leaves no surface a color (that which excites fluorescence) is shown as
/// it is.
pub fn light_group_preview(image: &SpectralImage<Radiance>, study: &Study, group: &str) -> Preview {
    let white = group_spectrum(study, group).filter(covers_the_visible_range).map(|light| {
        let values: Vec<f32> = light.bin_averages(image.grid()).iter().map(|value| *value as f32).collect();
        linear_srgb(StandardObserver::new(image.grid()).xyz(&values))
    });
    let white = white.filter(|white| white.iter().all(|channel| *channel > 0.0)).unwrap_or([1.0; 3]);
    balanced(image, white)
}

/// Leaves of a study what [`light_group_preview`] shows: the light of one group. Under white light fluorescence is next to nothing
/// beside what is reflected, and bands of 20 nm show the same colors: both make the render cheap. A study without the group keeps all.
pub fn reduce_to_preview(study: &mut Study, group: &str) {
    const BAND_NM: f64 = 20.0;
    let Some(index) = study.scene.light_groups.iter().position(|other| other.name == group) else { return };
    let shows_colors = group_spectrum(study, group).is_some_and(|light| covers_the_visible_range(&light));
    let scene = &mut study.scene;
    scene.lights.retain(|light| light.group == index);
    scene.lights.iter_mut().for_each(|light| light.group = 0);
    for object in &mut scene.objects {
        object.emission = object.emission.take().filter(|emission| emission.group == index);
        object.emission.iter_mut().for_each(|emission| emission.group = 0);
    }
    scene.light_groups = vec![scene.light_groups.swap_remove(index)];
    study.render = RenderSettings {
        statistics: StatisticsKind::None,
        error_target: None,
        excitation_basis: None,
        component_bands: ComponentBands::All,
        ..study.render.clone()
    };
    if !shows_colors {
        return;
    }
    scene.fluorophores.clear();
    scene.materials.iter_mut().for_each(|material| material.fluorophores.clear());
    // A traced lens is made for the bands of its scene
    if scene.camera.lens.is_none() {
        let (edges, end) = (scene.grid.edges_nm(), scene.grid.end_nm());
        let mut wide = vec![edges[0]];
        for &edge in &edges[1..] {
            if edge - wide[wide.len() - 1] >= BAND_NM || edge == end {
                wide.push(edge);
            }
        }
        scene.grid = WavelengthGrid::from_edges(&wide).unwrap_or_else(|_| scene.grid.clone());
    }
}

/// The image in which a surface of this color is white.
fn balanced(image: &SpectralImage<Radiance>, white: [f64; 3]) -> Preview {
    let observer = StandardObserver::new(image.grid());
    let linear: Vec<[f64; 3]> = image
        .data()
        .chunks_exact(image.bands())
        .map(|spectrum| linear_srgb(observer.xyz(spectrum)))
        .map(|color| std::array::from_fn(|c| color[c] / white[c]))
        .collect();
    let white_level = white_level(linear.len(), |pixel| linear[pixel], 0.0);
    to_srgb([image.width(), image.height()], |pixel| linear[pixel], white_level, LIFT_REFLECTED)
}

/// The level that becomes white. `linear` gives the color of a pixel, `noise` the standard deviation of a dark one, on the same scale.
fn white_level(pixels: usize, linear: impl Fn(usize) -> [f64; 3] + Sync, noise: f64) -> f64 {
    let mut brightest: Vec<f32> =
        (0..pixels).into_par_iter().map(|pixel| largest(linear(pixel)) as f32).collect();
    let index = ((brightest.len() as f64 * WHITE_PERCENTILE) as usize).min(brightest.len().saturating_sub(1));
    if brightest.is_empty() {
        return 1.0;
    }
    let (_, value, _) = brightest.select_nth_unstable_by(index, f32::total_cmp);
    // A dark frame must look dark, and one of noise alone black
    let least = if f64::from(*value) < NOISE_ALONE * noise { DARK_WHITE } else { LEAST_WHITE };
    f64::from(*value).max(least * noise).max(f64::MIN_POSITIVE)
}

fn largest([r, g, b]: [f64; 3]) -> f64 {
    r.max(g).max(b)
}

/// `linear` is asked for the white and again here: the colors of a whole frame would take as much memory as all else.
fn to_srgb(
    [width, height]: [usize; 2],
    linear: impl Fn(usize) -> [f64; 3] + Sync,
    white: f64,
    lift: f64,
) -> Preview {
    // One step for a few pixels at once: divisions of several are as fast as those of one
    const AT_ONCE: usize = 64;
    // Extended Reinhard operator (Reinhard et al. 2002, Eq. 4) on the largest channel: keeps hues, maps `white` to 1.
    let factor = |color: [f64; 3]| {
        let x = lift * largest(color).max(0.0) / white;
        lift * (1.0 + x / (lift * lift)) / (1.0 + x) / white
    };
    let mut rgb = vec![[0; 3]; width * height];
    rgb.par_chunks_mut(AT_ONCE).with_min_len(16).enumerate().for_each(|(chunk, rgb)| {
        let (mut colors, mut factors) = ([[0.0; 3]; AT_ONCE], [0.0; AT_ONCE]);
        let of_chunk = colors.iter_mut().take(rgb.len()).enumerate();
        of_chunk.for_each(|(index, color)| *color = linear(AT_ONCE * chunk + index));
        factors.iter_mut().zip(&colors).for_each(|(value, color)| *value = factor(*color));
        for ((rgb, color), factor) in rgb.iter_mut().zip(&colors).zip(&factors) {
            *rgb = color.map(|value| encode_srgb(value * factor));
        }
    });
    Preview { width, height, rgb: rgb.into_flattened() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_fitted_by_means() {
        let rgb = (0..8 * 4).flat_map(|i| [10 * (i % 8) as u8, 100, 0]).collect();
        let fitted = Preview { width: 8, height: 4, rgb }.fitted([4, 4]);
        let at = |row: usize, col: usize| &fitted.rgb[3 * (row * 4 + col)..][..3];
        // Two rows of two-by-two means between dark borders.
        assert_eq!(at(0, 0), [16; 3]);
        assert_eq!([at(1, 0), at(2, 3)], [[5, 100, 0], [65, 100, 0]]);
        let larger = Preview { width: 1, height: 1, rgb: vec![7, 8, 9] }.fitted([3, 3]);
        assert_eq!(larger.rgb, [7, 8, 9].repeat(9));
    }
}
