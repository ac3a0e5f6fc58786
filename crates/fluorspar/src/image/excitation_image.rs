//! What light groups of a render excite at every wavelength, in a short form: of it images under any light spectrum are made.

use rayon::prelude::*;

use super::{ComponentRows, LightPath, SpectralBasis};
use crate::spectral::{Curve, ExcitationNodes, WavelengthGrid};

/// Light groups of a render whose light spectra can be changed without another one.
#[derive(Clone, Debug, PartialEq)]
pub struct ExcitationImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The light groups.
    pub groups: Vec<GroupBasis>,
}

/// What one light group excites.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupBasis {
    /// Name of the light group.
    pub light_group: String,
    /// Wavelengths of the excitation that are kept apart.
    pub nodes: ExcitationNodes,
    /// Reflected light, each fluorophore, and light that fluoresced more than once.
    pub components: Vec<BasisComponent>,
}

/// One component under every light: a sum of a few spectra whose factors vary over the image.
///
/// All pixels of a component are sums of few spectra, because light meets few materials, and noise is in the factors.
#[derive(Clone, Debug, PartialEq)]
pub struct BasisComponent {
    /// Light path.
    pub light: LightPath,
    /// `[spectrum][node][band]`, W/(sr m² nm) for hats of 1 W/nm at their node; for reflected light `[spectrum][band]`, for light of
    /// 1 W/nm everywhere.
    pub spectra: Vec<f32>,
    /// Factors, `[spectrum][row][col]`.
    pub factors: Vec<f32>,
    /// Number of spectra.
    pub rank: usize,
    /// Largest error of a pixel that the short form leaves: root mean square over nodes and bands, each relative to its mean over
    /// the image, relative to the pixel.
    pub error: f64,
}

/// Spectra of a component under one light.
#[derive(Clone, Debug, PartialEq)]
pub struct RelitComponent<'a> {
    /// `[spectrum][band]`.
    spectra: Vec<f32>,
    /// `[spectrum][row][col]`.
    factors: &'a [f32],
    rank: usize,
}

impl GroupBasis {
    /// The components under a light spectrum, that of the first light of the group, in their order.
    pub fn relit(&self, grid: &WavelengthGrid, light: &Curve) -> Vec<RelitComponent<'_>> {
        let nodes: Vec<f32> = self.nodes.weights(light).into_iter().map(|weight| weight as f32).collect();
        let bands: Vec<f32> = light.bin_averages(grid).into_iter().map(|value| value as f32).collect();
        self.components.iter().map(|component| component.under(&nodes, &bands)).collect()
    }

    /// Largest error that the short form leaves, relative to the fluorescence of a pixel: of light that fluoresced once, and that of light
    /// that fluoresced more than once, by its share.
    pub fn error(&self) -> f64 {
        let (mut once, mut more, mut error_of_once, mut error_of_more) = (0.0, 0.0, 0.0_f64, 0.0_f64);
        for component in &self.components {
            match component.light {
                LightPath::Reflected => error_of_once = error_of_once.max(component.error),
                LightPath::Fluorescence(_) => {
                    once += component.mean_level();
                    error_of_once = error_of_once.max(component.error);
                }
                LightPath::MultipleFluorescence => {
                    more += component.mean_level();
                    error_of_more = error_of_more.max(component.error);
                }
            }
        }
        let share = if once + more > 0.0 { more / (once + more) } else { 0.0 };
        error_of_once + share * error_of_more
    }
}

impl BasisComponent {
    fn under(&self, nodes: &[f32], bands: &[f32]) -> RelitComponent<'_> {
        let spectra = if self.light == LightPath::Reflected {
            let spectra = self.spectra.chunks_exact(bands.len());
            spectra.flat_map(|spectrum| spectrum.iter().zip(bands).map(|(a, b)| a * b)).collect()
        } else {
            let mut all = vec![0.0; self.rank * bands.len()];
            let of_spectrum = self.spectra.chunks_exact(nodes.len() * bands.len());
            for (sum, spectrum) in all.chunks_exact_mut(bands.len()).zip(of_spectrum) {
                for (weight, values) in nodes.iter().zip(spectrum.chunks_exact(bands.len())) {
                    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
                }
            }
            all
        };
        RelitComponent { spectra, factors: &self.factors, rank: self.rank }
    }

    /// Sum over nodes and bands of the mean over the image.
    fn mean_level(&self) -> f64 {
        let pixels = self.factors.len() / self.rank.max(1);
        let all: Vec<(usize, f64)> = (0..pixels).map(|pixel| (pixel, 1.0)).collect();
        self.mean_of(&all).iter().sum()
    }

    /// Mean over pixels of the component, each times a factor, `[node][band]`, for reflected light `[band]`.
    pub fn mean_of(&self, pixels: &[(usize, f64)]) -> Vec<f64> {
        let len = self.spectra.len() / self.rank.max(1);
        let all = self.factors.len() / self.rank.max(1);
        let mut mean = vec![0.0; len];
        for (factors, spectrum) in
            self.factors.chunks_exact(all.max(1)).zip(self.spectra.chunks_exact(len.max(1)))
        {
            let factor: f64 = pixels.iter().map(|(pixel, weight)| weight * f64::from(factors[*pixel])).sum();
            let factor = factor / pixels.len().max(1) as f64;
            mean.iter_mut().zip(spectrum).for_each(|(sum, value)| *sum += factor * f64::from(*value));
        }
        mean
    }
}

impl RelitComponent<'_> {
    /// Whether there is no light.
    pub(crate) fn is_dark(&self) -> bool {
        self.rank == 0
    }

    /// Sums of the bands of each spectrum times weights `[channel][band]`: `[channel][spectrum]`.
    pub(crate) fn through(&self, weights: &[f64], bands: usize) -> Vec<f64> {
        let sum = |weights: &[f64], spectrum: &[f32]| -> f64 {
            weights.iter().zip(spectrum).map(|(weight, value)| weight * f64::from(*value)).sum()
        };
        let of_channel =
            |weights| self.spectra.chunks_exact(bands).map(move |spectrum| sum(weights, spectrum));
        weights.chunks_exact(bands).flat_map(of_channel).collect()
    }

    /// Factors of one row, `[spectrum][col]`.
    pub(crate) fn factor_lines(&self, row: usize, width: usize) -> Vec<f32> {
        let pixels = self.factors.len() / self.rank.max(1);
        (0..self.rank)
            .flat_map(|k| self.factors[k * pixels + row * width..][..width].iter().copied())
            .collect()
    }

    /// One row of an image of some columns and bands, `[band][col]`, W/(sr m² nm).
    fn row(&self, row: usize, width: usize, bands: usize, lines: &mut [f32]) {
        lines.fill(0.0);
        let pixels = self.factors.len() / self.rank.max(1);
        for spectrum in 0..self.rank {
            let factors = &self.factors[spectrum * pixels + row * width..][..width];
            let values = &self.spectra[spectrum * bands..][..bands];
            for (line, value) in lines.chunks_exact_mut(width).zip(values).filter(|(_, value)| **value != 0.0)
            {
                line.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += value * factor);
            }
        }
    }
}

/// Rows of a render, some of whose components are under another light.
pub struct RelitRows<'a, R> {
    /// The rows as they were rendered.
    pub rows: &'a R,
    /// Columns, rows and bands of the image.
    pub size: [usize; 3],
    /// For each component what takes its place, if anything does.
    pub relit: &'a [Option<RelitComponent<'a>>],
}

impl<R: ComponentRows> ComponentRows for RelitRows<'_, R> {
    type Error = R::Error;

    fn basis(&self, component: usize) -> Option<&SpectralBasis> {
        let is_relit = self.relit.get(component).is_some_and(Option::is_some);
        if is_relit { None } else { self.rows.basis(component) }
    }

    fn map_rows<T: Send>(
        &self,
        wanted: impl Fn(usize) -> bool + Sync,
        visit: impl Fn(usize, usize, &[f32]) -> T + Sync,
    ) -> Result<Vec<(usize, usize, T)>, R::Error> {
        let [width, height, bands] = self.size;
        let relit = |component: usize| self.relit.get(component).and_then(Option::as_ref);
        let changed = (0..self.relit.len()).filter(|component| wanted(*component));
        let changed: Vec<(usize, &RelitComponent<'_>)> =
            changed.filter_map(|component| Some((component, relit(component)?))).collect();
        let rows: Vec<(usize, &RelitComponent<'_>, usize)> =
            changed.iter().flat_map(|(c, of)| (0..height).map(move |row| (*c, *of, row))).collect();
        let made = rows.into_par_iter().map_init(
            || vec![0.0_f32; width * bands],
            |lines, (component, of, row)| {
                of.row(row, width, bands, lines);
                (component, row, visit(component, row, lines))
            },
        );
        let mut made: Vec<(usize, usize, T)> = made.collect();
        if (0..self.relit.len()).any(|component| wanted(component) && relit(component).is_none()) {
            made.extend(self.rows.map_rows(|c| wanted(c) && relit(c).is_none(), visit)?);
        }
        Ok(made)
    }
}

/// Most spectra of a component.
const MOST_SPECTRA: usize = 64;
/// Error below which a pixel needs no further spectrum; that of light that fluoresced more than once, which is a hundredth of the
/// fluorescence, and the share of the mean below which pixels count as dark as that.
const PIXEL_ERROR: f32 = 1e-3;
const MULTIPLE_ERROR: f32 = 1e-2;
const DARK_PIXEL: f32 = 0.1;
/// Pixels that are brought into the short form at once.
const AT_ONCE: usize = 4096;
/// Sums that run side by side.
const LANES: usize = 16;

/// Brings the pixels of a component into the short form, some at a time, in any order of their rows.
///
/// Spectra are taken from the pixels themselves: the one that is farthest from all sums of the spectra so far becomes, after
/// orthogonalization, the next spectrum, until every pixel is near enough. Values are divided by their mean over the image, so
/// that dim excitations and emissions are kept as exactly as bright ones.
pub(crate) struct BasisBuilder {
    /// Scale of each value, 1 over its mean; empty until there is light.
    scale: Vec<f32>,
    /// Orthonormal spectra of scaled values.
    spectra: Vec<Vec<f32>>,
    /// `[pixel][spectrum]` with as many spectra as there were at the time.
    factors: Vec<(usize, Vec<f32>)>,
    pixels: usize,
    light: LightPath,
    error: f32,
}

impl BasisBuilder {
    /// A builder of a component of an image of so many pixels, whose values have the given means `[node][band]`, or next to.
    pub(crate) fn new(light: LightPath, pixels: usize, means: &[f32], bands: usize) -> Self {
        let scale = scale_of(means, bands);
        Self { scale, spectra: Vec::new(), factors: Vec::new(), pixels, light, error: 0.0 }
    }

    /// The light path of the component.
    pub(crate) fn light(&self) -> &LightPath {
        &self.light
    }

    /// Adds pixels from a number on, `[pixel][node][band]`, which are used up.
    pub(crate) fn add(&mut self, first: usize, bands: usize, values: &mut [f32], len: usize) {
        if self.scale.is_empty() {
            // Nothing is known from the pilot: begin with what is here
            let count = (values.len() / len.max(1)).max(1) as f32;
            let mut means = vec![0.0; len];
            for pixel in values.chunks_exact(len) {
                means.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value / count);
            }
            self.scale = scale_of(&means, bands);
            if self.scale.is_empty() {
                return;
            }
        }
        for (number, block) in values.chunks_mut(AT_ONCE * len).enumerate() {
            self.add_block(first + number * AT_ONCE, block, len);
        }
    }

    fn add_block(&mut self, first: usize, values: &mut [f32], len: usize) {
        // Scale the values, and take away what the spectra hold of them
        let (scale, spectra) = (&self.scale, &self.spectra);
        let mut pixels: Vec<Remainder<'_>> = values
            .par_chunks_exact_mut(len)
            .map(|values| {
                values.iter_mut().zip(scale).for_each(|(value, scale)| *value *= scale);
                let size = (dot(values, values) / len as f32).sqrt().max(DARK_PIXEL);
                let mut pixel = Remainder { values, size, factors: Vec::with_capacity(spectra.len()) };
                spectra.iter().for_each(|spectrum| pixel.take(spectrum));
                pixel
            })
            .collect();
        // Add spectra until every pixel is near enough
        let enough = match self.light {
            LightPath::MultipleFluorescence => MULTIPLE_ERROR,
            _ => PIXEL_ERROR,
        };
        loop {
            let errors = pixels.par_iter().map(Remainder::error).collect::<Vec<f32>>();
            let worst = (0..errors.len()).max_by(|a, b| errors[*a].total_cmp(&errors[*b]));
            let Some(worst) = worst else { return };
            if errors[worst] <= enough || self.spectra.len() == MOST_SPECTRA {
                self.error = self.error.max(errors[worst]);
                break;
            }
            let mut spectrum = pixels[worst].values.to_vec();
            for known in &self.spectra {
                let part = dot(&spectrum, known);
                spectrum.iter_mut().zip(known).for_each(|(value, known)| *value -= part * known);
            }
            let length = dot(&spectrum, &spectrum).sqrt();
            spectrum.iter_mut().for_each(|value| *value /= length);
            pixels.par_iter_mut().for_each(|pixel| pixel.take(&spectrum));
            self.spectra.push(spectrum);
        }
        for (number, pixel) in pixels.into_iter().enumerate() {
            self.factors.push((first + number, pixel.factors));
        }
    }

    /// The short form.
    pub(crate) fn finish(self) -> BasisComponent {
        let rank = self.spectra.len();
        let mut factors = vec![0.0; rank * self.pixels];
        for (pixel, of_pixel) in &self.factors {
            for (spectrum, factor) in of_pixel.iter().enumerate() {
                factors[spectrum * self.pixels + pixel] = *factor;
            }
        }
        let unscaled = |spectrum: Vec<f32>| spectrum.into_iter().zip(&self.scale).map(|(value, s)| value / s);
        let spectra = self.spectra.into_iter().flat_map(unscaled).collect();
        BasisComponent { light: self.light, spectra, factors, rank, error: f64::from(self.error) }
    }
}

/// A pixel without what the spectra so far hold of it.
struct Remainder<'a> {
    values: &'a mut [f32],
    /// Root mean square of the pixel.
    size: f32,
    factors: Vec<f32>,
}

impl Remainder<'_> {
    fn take(&mut self, spectrum: &[f32]) {
        let factor = dot(self.values, spectrum);
        self.values.iter_mut().zip(spectrum).for_each(|(value, of)| *value -= factor * of);
        self.factors.push(factor);
    }

    fn error(&self) -> f32 {
        (dot(self.values, self.values) / self.values.len() as f32).sqrt() / self.size
    }
}

/// Scale of values with the given means `[node][band]`: the inverse of the mean plus a fiftieth of the brightest band of the
/// node and a thousandth of the brightest of all. Empty where all is dark.
fn scale_of(means: &[f32], bands: usize) -> Vec<f32> {
    let most = |values: &[f32]| values.iter().copied().filter(|value| value.is_finite()).fold(0.0, f32::max);
    let brightest = most(means);
    if brightest <= 0.0 {
        return Vec::new();
    }
    let of_node = |node: &[f32]| {
        let least = 0.02 * most(node) + 1e-3 * brightest;
        node.iter().map(|mean| 1.0 / (mean + least)).collect::<Vec<f32>>()
    };
    means.chunks(bands).flat_map(of_node).collect()
}

/// Scalar product, by sums that run side by side.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let (a, a_rest) = a.as_chunks::<LANES>();
    let (b, b_rest) = b.as_chunks::<LANES>();
    let mut sums = [0.0_f32; LANES];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    struct Nothing;

    impl ComponentRows for Nothing {
        type Error = Infallible;

        fn basis(&self, _: usize) -> Option<&SpectralBasis> {
            None
        }

        fn map_rows<T: Send>(
            &self,
            _: impl Fn(usize) -> bool + Sync,
            _: impl Fn(usize, usize, &[f32]) -> T + Sync,
        ) -> Result<Vec<(usize, usize, T)>, Infallible> {
            Ok(Vec::new())
        }
    }

    /// Twelve pixels that are sums of three spectra of two nodes and three bands, one of them dim.
    fn pixels() -> Vec<f32> {
        let spectra = [
            [1.0, 2.0, 3.0, 1e-3, 0.0, 2e-3],
            [0.0, 1.0, 0.5, 2e-3, 1e-3, 0.0],
            [3.0, 0.0, 1.0, 0.0, 1e-3, 1e-3],
        ];
        let factor = |pixel: usize, k: usize| 0.2 + ((pixel * (k + 2) * 7919 + k) % 97) as f32 / 97.0;
        let value = |pixel: usize, at: usize| (0..3).map(|k| factor(pixel, k) * spectra[k][at]).sum();
        (0..12).flat_map(|pixel| (0..6).map(move |at| (pixel, at))).map(|(p, at)| value(p, at)).collect()
    }

    #[test]
    fn sums_of_three_spectra_take_three_and_come_back() {
        let all = pixels();
        let means: Vec<f32> = (0..6).map(|at| all.iter().skip(at).step_by(6).sum::<f32>() / 12.0).collect();
        for means in [means, vec![0.0; 6]] {
            let mut builder = BasisBuilder::new(LightPath::Fluorescence("a".into()), 12, &means, 3);
            for rows in [1, 0, 2] {
                builder.add(4 * rows, 3, &mut all[24 * rows..24 * (rows + 1)].to_vec(), 6);
            }
            let component = builder.finish();
            assert_eq!(component.rank, 3);
            assert!(component.error < 1e-3);
            // The second node alone, half as bright: relative to its own mean it is as exact as the bright one
            let relit = component.under(&[0.0, 0.5], &[1.0; 3]);
            let rows = RelitRows { rows: &Nothing, size: [4, 3, 3], relit: &[Some(relit)] };
            let Ok(found) = rows.map_rows(|_| true, |_, _, lines| lines.to_vec());
            assert_eq!(found.len(), 3);
            for (_, row, lines) in found {
                for (at, value) in lines.iter().enumerate() {
                    let expected = 0.5 * all[6 * (4 * row + at % 4) + 3 + at / 4];
                    assert!((value - expected).abs() < 1e-3 * 0.5 * 2e-3, "{value} {expected}");
                }
            }
            let mean = component.mean_of(&[(2, 1.0), (5, 1.0)]);
            assert!((mean[1] - f64::from(0.5 * (all[13] + all[31]))).abs() < 2e-3);
        }
    }
}
