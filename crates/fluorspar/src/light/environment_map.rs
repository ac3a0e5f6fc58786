//! Radiance from all directions, as a map.

use std::f32::consts::PI;

use glam::{DVec3, Quat, Vec3};
use thiserror::Error;

use super::{ApparentSize, EmitterSample};
use crate::geometry::OrientedPoint;
use crate::spectral::Curve;

/// An equirectangular map of the radiance beyond the scene: the sum over layers of `factor(direction) * spectrum`.
///
/// Rows from the top (+y) to the bottom, columns from left to right as seen from inside; the middle of the map lies
/// toward -z and its right half toward +x. Pixels are constant: the map is sampled exactly in proportion to its
/// radiance, summed over wavelengths.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    width: usize,
    height: usize,
    layers: Vec<EnvironmentLayer>,
    /// From world to map.
    rotation: Quat,
    /// Running sums over the pixels of each row, then over rows: probabilities up to and including.
    columns: Vec<f32>,
    rows: Vec<f32>,
    /// Mean radiance over the sphere, summed over wavelengths, with the spectrum of the light left out.
    mean: f64,
}

/// One spectrum of an environment map and its factor in every pixel, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentLayer {
    /// Spectrum of a factor of one; times that of the light it is radiance, W/(sr m² nm).
    pub spectrum: Curve,
    /// Factors, 0 or more.
    pub factors: Vec<f32>,
}

/// Why pixels cannot be an environment map.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum EnvironmentMapError {
    /// The layers do not fill the map.
    #[error("an environment map of {width} x {height} pixels needs {} values per layer; layer {layer} has {values}", width * height)]
    Size {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Layer, from 0.
        layer: usize,
        /// Values given.
        values: usize,
    },
    /// A value is negative or not finite.
    #[error("pixel ({col}, {row}) of layer {layer} is {value}; radiance must be finite and not negative")]
    Value {
        /// Column.
        col: usize,
        /// Row from the top.
        row: usize,
        /// Layer, from 0.
        layer: usize,
        /// The value.
        value: f32,
    },
    /// Nothing shines.
    #[error("the environment map is black everywhere; give a map with values above 0")]
    Black,
}

impl EnvironmentMap {
    /// From layers of the same size, turned by `rotation_deg` about the +y axis: at 90 degrees the middle of the map
    /// lies toward -x.
    ///
    /// # Errors
    /// Layers that do not fill the map, values that are negative or not finite, a map that is black.
    pub fn new(
        width: usize,
        height: usize,
        layers: Vec<EnvironmentLayer>,
        rotation_deg: f64,
    ) -> Result<Self, EnvironmentMapError> {
        // Check the layers
        for (number, layer) in layers.iter().enumerate() {
            let values = layer.factors.len();
            if width == 0 || height == 0 || values != width * height {
                return Err(EnvironmentMapError::Size { width, height, layer: number, values });
            }
            if let Some(index) = layer.factors.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
                let (col, row, value) = (index % width, index / width, layer.factors[index]);
                return Err(EnvironmentMapError::Value { col, row, layer: number, value });
            }
        }
        // Weight layers by the power of their spectra
        let weights: Vec<f64> = layers.iter().map(|layer| layer.spectrum.total()).collect();
        let power = |pixel: usize| -> f64 {
            layers.iter().zip(&weights).map(|(layer, weight)| weight * f64::from(layer.factors[pixel])).sum()
        };
        let mut columns = Vec::with_capacity(width * height);
        let mut rows = Vec::with_capacity(height);
        let mut total = 0.0;
        // Tabulate distributions: columns within each row, rows by their power times solid angle
        for row in 0..height {
            let solid_angle = row_solid_angle(row, width, height);
            let mut sum = 0.0;
            let start = columns.len();
            for col in 0..width {
                sum += power(row * width + col);
                columns.push(sum);
            }
            columns[start..].iter_mut().for_each(|value| *value = if sum > 0.0 { *value / sum } else { 0.0 });
            total += sum * solid_angle;
            rows.push(total);
        }
        if !(total > 0.0 && total.is_finite()) {
            return Err(EnvironmentMapError::Black);
        }
        Ok(Self {
            width,
            height,
            layers,
            rotation: Quat::from_rotation_y(-rotation_deg.to_radians() as f32),
            columns: columns.into_iter().map(|value| value as f32).collect(),
            rows: rows.into_iter().map(|value| (value / total) as f32).collect(),
            mean: total / (4.0 * std::f64::consts::PI),
        })
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Spectra and factors.
    pub fn layers(&self) -> &[EnvironmentLayer] {
        &self.layers
    }

    /// Mean over the sphere of the radiance summed over wavelengths, for a light with a spectrum of one, W/(sr m²).
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Spectrum of the mean over the sphere, for a light with a spectrum of one.
    pub fn mean_spectrum(&self) -> Curve {
        let sphere = 4.0 * std::f64::consts::PI;
        let mean = |layer: &EnvironmentLayer| -> f64 {
            (0..self.height)
                .map(|row| {
                    let factors = &layer.factors[row * self.width..(row + 1) * self.width];
                    let sum: f64 = factors.iter().map(|&f| f64::from(f)).sum();
                    sum * row_solid_angle(row, self.width, self.height) / sphere
                })
                .sum()
        };
        let scaled: Vec<Curve> = self.layers.iter().map(|layer| layer.spectrum.scaled(mean(layer))).collect();
        match scaled.as_slice() {
            [only] => only.clone(),
            many => {
                let start = many.iter().map(|c| c.range_nm().0).fold(f64::INFINITY, f64::min);
                let end = many.iter().map(|c| c.range_nm().1).fold(f64::NEG_INFINITY, f64::max);
                Curve::from_fn(start, end, |nm| many.iter().map(|c| c.at(nm)).sum())
            }
        }
    }

    /// Irradiance on a surface of this normal per unit of the spectrum of each layer, sr: a midpoint rule on the numbers
    /// that [`Self::sample`] turns into directions, so that small suns are found.
    pub(crate) fn irradiance_factors(&self, normal: DVec3) -> Vec<f64> {
        const STRATA: usize = 32;
        let mut sums = vec![0.0; self.layers.len()];
        for index in 0..STRATA * STRATA {
            let u = [index % STRATA, index / STRATA].map(|i| (i as f32 + 0.5) / STRATA as f32);
            let (direction, pixel, pdf) = self.sample(u);
            let cos = direction.as_dvec3().dot(normal);
            if cos > 0.0 && pdf > 0.0 {
                let weight = cos / (f64::from(pdf) * (STRATA * STRATA) as f64);
                for (sum, layer) in sums.iter_mut().zip(&self.layers) {
                    *sum += weight * f64::from(layer.factors[pixel]);
                }
            }
        }
        sums
    }

    /// Apparent size of each layer: as if all of its light came from its brightest pixels, which an eye looks at.
    pub(super) fn apparent_sizes(&self, at: OrientedPoint, factors: &[f64]) -> Vec<ApparentSize> {
        let size = |(layer, factor): (&EnvironmentLayer, &f64)| {
            let brightest = layer.factors.iter().copied().fold(0.0, f32::max);
            let solid_angle_sr =
                (factor / f64::from(brightest.max(f32::MIN_POSITIVE))).min(std::f64::consts::PI);
            ApparentSize::of_solid_angle(at.normal, solid_angle_sr)
        };
        self.layers.iter().zip(factors).map(size).collect()
    }

    /// [`Self::sample`] for next-event estimation.
    #[inline]
    pub(super) fn sample_emitter(&self, u: [f32; 2], choice: f32) -> EmitterSample {
        let (direction, pixel, density) = self.sample(u);
        EmitterSample {
            direction,
            distance: f32::INFINITY,
            scale: 1.0,
            pdf: choice * density,
            delta: false,
            pixel,
        }
    }

    /// Number of the pixel that lies in a direction (of world, unit length).
    pub fn pixel(&self, direction: Vec3) -> usize {
        let d = self.rotation * direction;
        let u = 0.5 + d.x.atan2(-d.z) / (2.0 * PI);
        let v = d.y.clamp(-1.0, 1.0).acos() / PI;
        let col = ((u * self.width as f32) as usize).min(self.width - 1);
        let row = ((v * self.height as f32) as usize).min(self.height - 1);
        row * self.width + col
    }

    /// Draws a direction in proportion to the radiance of the map: direction, pixel and density, 1/sr.
    pub fn sample(&self, u: [f32; 2]) -> (Vec3, usize, f32) {
        let (row, v) = pick(&self.rows, u[1]);
        let (col, x) = pick(&self.columns[row * self.width..(row + 1) * self.width], u[0]);
        let (top, bottom) = row_cosines(row, self.height);
        let y = (top + (bottom - top) * f64::from(v)) as f32;
        let angle = ((col as f32 + x) / self.width as f32 - 0.5) * 2.0 * PI;
        let r = (1.0 - y * y).max(0.0).sqrt();
        let direction = self.rotation.inverse() * Vec3::new(r * angle.sin(), y, -r * angle.cos());
        let pixel = row * self.width + col;
        (direction, pixel, self.pdf_of(pixel))
    }

    /// Density of [`Self::sample`] in a direction, 1/sr.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        self.pdf_of(self.pixel(direction))
    }

    fn pdf_of(&self, pixel: usize) -> f32 {
        let (row, col) = (pixel / self.width, pixel % self.width);
        let step = |sums: &[f32], index: usize| sums[index] - if index == 0 { 0.0 } else { sums[index - 1] };
        let in_row = step(&self.columns[row * self.width..(row + 1) * self.width], col);
        step(&self.rows, row) * in_row / row_solid_angle(row, self.width, self.height) as f32
    }
}

/// Cosines of the upper and the lower edge of a row.
fn row_cosines(row: usize, height: usize) -> (f64, f64) {
    let cos = |edge: usize| (std::f64::consts::PI * edge as f64 / height as f64).cos();
    (cos(row), cos(row + 1))
}

/// Solid angle of a pixel, sr.
fn row_solid_angle(row: usize, width: usize, height: usize) -> f64 {
    let (top, bottom) = row_cosines(row, height);
    (top - bottom) * 2.0 * std::f64::consts::PI / width as f64
}

/// Entry of a running sum that holds a number, and the place within it.
fn pick(sums: &[f32], u: f32) -> (usize, f32) {
    let mut index = sums.partition_point(|&sum| sum <= u).min(sums.len() - 1);
    // The last entries may be empty.
    while index > 0 && sums[index] == sums[index - 1] {
        index -= 1;
    }
    let before = if index == 0 { 0.0 } else { sums[index - 1] };
    (index, ((u - before) / (sums[index] - before)).clamp(0.0, 0.999_999_9))
}

#[cfg(test)]
mod tests {
    use fluorspar_testkit::chi_square_over_sphere;

    use super::*;
    use crate::sampling::hash_u64;

    fn map(width: usize, height: usize, factors: Vec<f32>, rotation_deg: f64) -> EnvironmentMap {
        let layer = EnvironmentLayer { spectrum: Curve::constant(1.0), factors };
        EnvironmentMap::new(width, height, vec![layer], rotation_deg).unwrap()
    }

    #[test]
    fn directions_follow_the_radiance() {
        let (width, height) = (16, 10);
        let factors =
            (0..width * height).map(|i| ((i * 7) % 5) as f32 * if i == 37 { 40.0 } else { 1.0 }).collect();
        let map = map(width, height, factors, 30.0);
        chi_square_over_sphere(
            200_000,
            20,
            40,
            24,
            |i| {
                let bits = hash_u64(i as u64 ^ 0xE21);
                let u = [(bits >> 40) as f32, (bits & 0xFF_FFFF) as f32].map(|b| b / 16_777_216.0);
                let (direction, pixel, density) = map.sample(u);
                assert!(density > 0.0 && map.layers()[0].factors[pixel] > 0.0);
                Some(direction.normalize().as_dvec3().to_array())
            },
            |d| f64::from(map.pdf(Vec3::new(d[0] as f32, d[1] as f32, d[2] as f32))),
        )
        .assert_accepted(0.01);
    }

    #[test]
    fn directions_of_the_map_are_those_documented() {
        let mut factors = vec![0.0; 8 * 4];
        factors[8 + 4] = 1.0; // Just right of the middle, just above the horizon.
        let bright = map(8, 4, factors.clone(), 0.0);
        let toward = |map: &EnvironmentMap, d: Vec3| map.layers()[0].factors[map.pixel(d.normalize())];
        assert_eq!(toward(&bright, Vec3::new(0.1, 0.1, -1.0)), 1.0);
        assert_eq!(toward(&bright, Vec3::new(-0.1, 0.1, -1.0)), 0.0);
        assert_eq!(toward(&map(8, 4, factors, 90.0), Vec3::new(-1.0, 0.1, -0.1)), 1.0);
    }

    #[test]
    fn an_even_map_is_even() {
        let even = map(6, 5, vec![2.0; 30], 0.0);
        assert!((even.mean() - 2.0 * Curve::constant(1.0).total()).abs() < 1e-9);
        for i in 0..100 {
            let u = [(i as f32 + 0.5) / 100.0, (i * 37 % 100) as f32 / 100.0];
            assert!((even.sample(u).2 * 4.0 * PI - 1.0).abs() < 1e-5);
        }
        assert_eq!(even.mean_spectrum().at(500.0), 2.0);
    }

    /// An even map is an environment; of one bright row the closed form is `pi (sin^2 b - sin^2 a)`.
    #[test]
    fn irradiance_follows_closed_forms() {
        use std::f64::consts::PI;
        let factor = |row: Option<usize>| {
            let factors =
                (0..16 * 8).map(|i| if row.is_none_or(|row| i / 16 == row) { 1.0 } else { 0.0 }).collect();
            map(16, 8, factors, 30.0).irradiance_factors(DVec3::Y)[0]
        };
        // 32 strata along each axis, midpoint rule over a cosine that ends in a kink: better than 1 / 32^2 times 2 pi.
        assert!((factor(None) - PI).abs() < 6e-3, "{}", factor(None));
        for row in 0..4 {
            let sine2 = |edge: usize| (PI * edge as f64 / 8.0).sin().powi(2);
            let expected = PI * (sine2(row + 1) - sine2(row));
            assert!((factor(Some(row)) - expected).abs() < 1e-3 * expected, "{row}: {}", factor(Some(row)));
        }
        assert_eq!(factor(Some(5)), 0.0);
    }

    #[test]
    fn bad_maps_are_refused() {
        let layer = |factors| vec![EnvironmentLayer { spectrum: Curve::constant(1.0), factors }];
        assert!(matches!(
            EnvironmentMap::new(2, 2, layer(vec![1.0; 3]), 0.0),
            Err(EnvironmentMapError::Size { .. })
        ));
        assert!(matches!(
            EnvironmentMap::new(2, 1, layer(vec![1.0, -1.0]), 0.0),
            Err(EnvironmentMapError::Value { col: 1, row: 0, .. })
        ));
        assert_eq!(EnvironmentMap::new(1, 1, layer(vec![0.0]), 0.0), Err(EnvironmentMapError::Black));
    }
}
