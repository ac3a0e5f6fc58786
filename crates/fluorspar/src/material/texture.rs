//! Scalar fields over texture coordinates: images and procedural maps.

use std::fmt;
use std::sync::Arc;

use glam::Vec2;
use thiserror::Error;

use crate::digest::sha256_of_words;
use crate::sampling::fractal_noise;

/// A scalar that may vary over a surface. Texture coordinates outside `[0, 1]` repeat.
#[derive(Clone, Debug, PartialEq)]
pub enum ScalarTexture {
    /// The same everywhere.
    Constant(f32),
    /// An image, bilinear between pixel centers, with black mapped to `low` and white to `high`.
    Image {
        /// The pixels.
        image: Arc<ImageTexture>,
        /// Value of black.
        low: f32,
        /// Value of white.
        high: f32,
    },
    /// A checkerboard with `columns` by `rows` fields.
    Checker {
        /// Fields along u.
        columns: u32,
        /// Fields along v.
        rows: u32,
        /// Value of the field at the origin and every second one.
        low: f32,
        /// Value of the others.
        high: f32,
    },
    /// Smooth noise: fractal sum of four octaves of value noise.
    Noise {
        /// Lattice cells along u and v of the coarsest octave.
        cells: [f32; 2],
        /// Which noise.
        seed: u32,
        /// Value where the noise is lowest.
        low: f32,
        /// Value where the noise is highest.
        high: f32,
    },
    /// Product of two textures.
    Product(Box<ScalarTexture>, Box<ScalarTexture>),
}

/// Gray image, rows from the top, values 0 to 1 linear.
#[derive(Clone, PartialEq)]
pub struct ImageTexture {
    width: usize,
    height: usize,
    data: Vec<f32>,
    /// Smallest and largest value, which every check of a material and of its scene asks for.
    range: [f32; 2],
}

/// Size, and a digest of the pixels: images are large, and equal ones read the same.
impl fmt::Debug for ImageTexture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ImageTexture")
            .field("width", &self.width)
            .field("height", &self.height)
            .field("sha256", &sha256_of_words(self.data.iter().map(|value| value.to_bits())))
            .finish()
    }
}

/// Invalid pixels of a texture.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("a texture of {width} x {height} pixels needs {} values from 0 up; got {values}, first bad one: {bad:?}", width * height)]
pub struct TextureError {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Values given.
    pub values: usize,
    /// Number of the first value that is negative or not finite.
    pub bad: Option<usize>,
}

impl ImageTexture {
    /// A texture from its pixels, rows from the top.
    ///
    /// # Errors
    /// When the number of values is wrong, or one is negative or not finite.
    pub fn new(width: usize, height: usize, data: Vec<f32>) -> Result<Self, TextureError> {
        let bad = data.iter().position(|v| !(v.is_finite() && *v >= 0.0));
        if width == 0 || height == 0 || data.len() != width * height || bad.is_some() {
            return Err(TextureError { width, height, values: data.len(), bad });
        }
        let range =
            [data.iter().copied().fold(f32::INFINITY, f32::min), data.iter().copied().fold(0.0, f32::max)];
        Ok(Self { width, height, data, range })
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// The pixels, rows from the top.
    pub fn values(&self) -> &[f32] {
        &self.data
    }

    /// Bilinear value; v = 0 is the bottom row.
    pub fn at(&self, uv: Vec2) -> f32 {
        let x = uv.x * self.width as f32 - 0.5;
        let y = (1.0 - uv.y) * self.height as f32 - 0.5;
        let ([left, right], fx) = neighbors(x, self.width);
        let ([above, below], fy) = neighbors(y, self.height);
        let pixel = |row: usize, column: usize| self.data[row * self.width + column];
        let top = pixel(above, left) * (1.0 - fx) + pixel(above, right) * fx;
        let bottom = pixel(below, left) * (1.0 - fx) + pixel(below, right) * fx;
        top * (1.0 - fy) + bottom * fy
    }

    /// Smallest value.
    pub fn min(&self) -> f32 {
        self.range[0]
    }

    /// Largest value.
    pub fn max(&self) -> f32 {
        self.range[1]
    }
}

/// The pixels before and after a place along an axis of so many that repeats, and the share of the way between them.
#[inline(always)]
fn neighbors(x: f32, count: usize) -> ([usize; 2], f32) {
    // Within the image nothing need be rounded or divided
    if (0.0..(count - 1) as f32).contains(&x) {
        let first = x as usize;
        return ([first, first + 1], x - first as f32);
    }
    let floor = x.floor();
    let wrap = |i: f32| (i as i64).rem_euclid(count as i64) as usize;
    ([wrap(floor), wrap(floor + 1.0)], x - floor)
}

impl ScalarTexture {
    /// Value at texture coordinates.
    #[inline]
    pub fn at(&self, uv: Vec2) -> f32 {
        match self {
            Self::Constant(value) => *value,
            _ => self.vary(uv),
        }
    }

    /// Whether another texture is this one, images by identity: cheap, and false for equal copies of an image.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (
                Self::Image { image: a, low, high },
                Self::Image { image: b, low: other_low, high: other_high },
            ) => Arc::ptr_eq(a, b) && low == other_low && high == other_high,
            (Self::Product(a, b), Self::Product(c, d)) => a.is_same(c) && b.is_same(d),
            (Self::Image { .. } | Self::Product(..), _) | (_, Self::Image { .. } | Self::Product(..)) => {
                false
            }
            (a, b) => a == b,
        }
    }

    fn vary(&self, uv: Vec2) -> f32 {
        match self {
            Self::Constant(value) => *value,
            Self::Image { image, low, high } => low + (high - low) * image.at(uv),
            Self::Checker { columns, rows, low, high } => {
                // Within the unit square nothing need be rounded, which is slow on old processors.
                let part = |x: f32| if (0.0..1.0).contains(&x) { x } else { x - x.floor() };
                let field = |x: f32, n: u32| (part(x) * n as f32) as u32;
                if (field(uv.x, *columns) + field(uv.y, *rows)).is_multiple_of(2) { *low } else { *high }
            }
            Self::Noise { cells, seed, low, high } => {
                low + (high - low) * fractal_noise(uv * Vec2::from_array(*cells), *seed)
            }
            Self::Product(a, b) => a.at(uv) * b.at(uv),
        }
    }

    /// An upper bound of the value anywhere.
    pub fn max(&self) -> f32 {
        match self {
            Self::Constant(value) => *value,
            Self::Image { image, low, high } => {
                let white = low + (high - low) * image.max();
                white.max(*low)
            }
            Self::Checker { low, high, .. } | Self::Noise { low, high, .. } => low.max(*high),
            Self::Product(a, b) => a.max() * b.max(),
        }
    }

    /// A lower bound of the value anywhere; 0 or more where all parts are.
    pub fn min(&self) -> f32 {
        match self {
            Self::Constant(value) => *value,
            Self::Image { image, low, high } => {
                let of = |gray: f32| low + (high - low) * gray;
                of(image.min()).min(of(image.max()))
            }
            Self::Checker { low, high, .. } | Self::Noise { low, high, .. } => low.min(*high),
            Self::Product(a, b) => a.min() * b.min(),
        }
    }

    /// The value, when it is the same everywhere.
    pub fn constant(&self) -> Option<f32> {
        match self {
            Self::Constant(value) => Some(*value),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_is_exact_at_pixel_centers_with_v_up() {
        let image = ImageTexture::new(2, 2, vec![0.1, 0.2, 0.3, 0.4]).unwrap();
        assert_eq!(image.at(Vec2::new(0.25, 0.75)), 0.1);
        assert_eq!(image.at(Vec2::new(0.75, 0.25)), 0.4);
        assert!(ImageTexture::new(2, 2, vec![0.0; 3]).is_err());
        assert_eq!(ImageTexture::new(1, 1, vec![f32::NAN]).unwrap_err().bad, Some(0));
    }

    #[test]
    fn procedural_maps_stay_within_their_bounds() {
        let maps = [
            ScalarTexture::Noise { cells: [5.0, 5.0], seed: 1, low: 0.2, high: 0.8 },
            ScalarTexture::Checker { columns: 4, rows: 4, low: 0.0, high: 1.0 },
        ];
        for map in maps {
            for i in 0..2000 {
                let uv = Vec2::new(i as f32 * 0.017 - 3.0, i as f32 * 0.0031);
                let value = map.at(uv);
                assert!((map.min()..=map.max()).contains(&value), "{map:?} at {uv}: {value}");
            }
        }
    }
}
