//! Electrons of every component of a render in every channel of a camera.

use std::sync::Arc;

use rayon::prelude::*;

/// Electrons per second that each component of a render frees in each channel of a camera, at the samples of the film:
/// `[component][channel][row][col]`, e-/s in one pixel, at the rendered powers and concentrations.
///
/// Lens, filters and quantum efficiency are in them. A drive, a concentration, an exposure time or a gain is a factor: a frame
/// is a weighted sum ([`ChannelPlanes::weighted_sum`]), not a pass over spectra.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelPlanes {
    /// Columns of the film samples: those of the render.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Components of the render.
    pub components: usize,
    /// Channels of the sensor; on a sensor with electrical crosstalk twice as many: see `Sensor::film_weights`.
    pub channels: usize,
    /// Digest of the camera that the planes are of.
    pub camera: String,
    /// `[component][channel][row][col]`, e-/s; clones share them.
    pub data: Arc<Vec<f32>>,
}

/// Pixels that are summed at once: their sums stay in the nearest cache.
const BLOCK: usize = 1024;

impl ChannelPlanes {
    /// Planes without light.
    pub fn dark([width, height]: [usize; 2], components: usize, channels: usize, camera: String) -> Self {
        let data = Arc::new(vec![0.0; components * channels * width * height]);
        Self { width, height, components, channels, camera, data }
    }

    /// One channel of one component, `[row][col]`, e-/s.
    pub fn plane(&self, component: usize, channel: usize) -> &[f32] {
        let pixels = self.width * self.height;
        &self.data[(component * self.channels + channel) * pixels..][..pixels]
    }

    /// One channel of one component, `[row][col]`, e-/s.
    pub fn plane_mut(&mut self, component: usize, channel: usize) -> &mut [f32] {
        let pixels = self.width * self.height;
        let start = (component * self.channels + channel) * pixels;
        &mut self.data_mut()[start..start + pixels]
    }

    /// All values, to change those of this clone only.
    pub fn data_mut(&mut self) -> &mut [f32] {
        let values: &mut Vec<f32> = Arc::make_mut(&mut self.data);
        values
    }

    /// Sum of all components, each times its factors: `[channel][row][col]`, e-/s. Components whose factor is zero are not
    /// touched. Sums are formed in double precision and rounded once.
    ///
    /// # Panics
    /// In debug builds, when there are not as many factors as components.
    pub fn weighted_sum(&self, factors: &ComponentFactors) -> Vec<f32> {
        debug_assert_eq!(factors.even.len(), self.components);
        let pixels = self.width * self.height;
        let mut sum = vec![0.0_f32; self.channels * pixels];
        if pixels == 0 {
            return sum;
        }
        let blocks_per_plane = pixels.div_ceil(BLOCK);
        let blocks: Vec<(usize, &mut [f32])> = sum
            .chunks_mut(pixels)
            .enumerate()
            .flat_map(|(channel, plane)| {
                plane.chunks_mut(BLOCK).enumerate().map(move |(i, b)| (channel * blocks_per_plane + i, b))
            })
            .collect();
        blocks.into_par_iter().with_min_len(16).for_each(|(index, out)| {
            let (channel, first) = (index / blocks_per_plane, index % blocks_per_plane * BLOCK);
            let mut sums = [0.0_f64; BLOCK];
            for component in (0..self.components).filter(|component| factors.even[*component] != 0.0) {
                let values = &self.plane(component, channel)[first..first + out.len()];
                factors.add(component, first, values, &mut sums);
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = sum as f32;
            }
        });
        sum
    }
}

/// Factors on the components of a render: one for the whole image each, and where a mask was painted one for every pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct ComponentFactors {
    /// Factor on each component.
    pub even: Vec<f64>,
    /// Further factor on each pixel of a component, `[row][col]`; none is 1.
    pub maps: Vec<Option<Arc<[f32]>>>,
}

impl ComponentFactors {
    /// Leaves every component as it is.
    pub fn ones(components: usize) -> Self {
        Self { even: vec![1.0; components], maps: vec![None; components] }
    }

    /// Whether some component has a factor for every pixel.
    pub fn has_maps(&self) -> bool {
        self.maps.iter().any(Option::is_some)
    }

    /// The same factors times one for each component.
    #[must_use]
    pub fn times(&self, factors: impl IntoIterator<Item = f64>) -> Self {
        let even = self.even.iter().zip(factors).map(|(own, other)| own * other).collect();
        Self { even, maps: self.maps.clone() }
    }

    /// Factor on a pixel of a component.
    pub fn at(&self, component: usize, pixel: usize) -> f64 {
        let even = self.even[component];
        self.maps[component].as_ref().map_or(even, |map| even * f64::from(map[pixel]))
    }

    /// Adds the values of a component, pixels from `first` on, times its factors.
    fn add(&self, component: usize, first: usize, values: &[f32], sums: &mut [f64]) {
        let even = self.even[component];
        match &self.maps[component] {
            None => sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += even * f64::from(*value)),
            Some(map) => {
                for ((sum, value), factor) in sums.iter_mut().zip(values).zip(&map[first..]) {
                    *sum += even * f64::from(*factor) * f64::from(*value);
                }
            }
        }
    }

    /// Multiplies a row of a component, `[band][col]`, by the maps alone.
    pub fn scale_row(&self, component: usize, row: usize, width: usize, lines: &mut [f32]) {
        let Some(map) = &self.maps[component] else { return };
        for line in lines.chunks_exact_mut(width) {
            line.iter_mut().zip(&map[row * width..]).for_each(|(value, factor)| *value *= factor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_exact_to_rounding_and_follow_masks() {
        let mut planes = ChannelPlanes::dark([50, 41], 3, 2, String::new());
        planes
            .data_mut()
            .iter_mut()
            .enumerate()
            .for_each(|(i, value)| *value = 1.0 + (i * 7919 % 613) as f32);
        let mask: Arc<[f32]> = (0..50 * 41).map(|i| (i % 3) as f32).collect();
        let factors =
            ComponentFactors { even: vec![0.5, 0.0, 3.0], maps: vec![None, None, Some(mask.clone())] };
        let sum = planes.weighted_sum(&factors);
        for channel in 0..2 {
            for pixel in 0..50 * 41 {
                let value = |component| f64::from(planes.plane(component, channel)[pixel]);
                let expected = 0.5 * value(0) + 3.0 * f64::from(mask[pixel]) * value(2);
                let error = f64::from(sum[channel * 50 * 41 + pixel]) / expected - 1.0;
                // One rounding to single precision.
                assert!(error.abs() <= 2f64.powi(-24), "{error}");
            }
        }
        let mut row = vec![2.0; 100];
        factors.scale_row(2, 1, 50, &mut row);
        assert_eq!((row[0], row[1], row[51]), (4.0, 0.0, 0.0));
    }
}
