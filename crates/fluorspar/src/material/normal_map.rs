//! Normal maps.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use thiserror::Error;

/// Shading normals over texture coordinates, in the frame of the surface: x along u, y along v, z outward.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalMap {
    width: usize,
    height: usize,
    normals: Arc<Vec<Vec3>>,
}

/// Invalid pixels of a normal map.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum NormalMapError {
    /// Not three values per pixel.
    #[error("a normal map of {width} x {height} pixels needs {} values (red, green, blue); got {values}", 3 * width * height)]
    Size {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Values given.
        values: usize,
    },
    /// A normal that points into the surface.
    #[error(
        "the normal of pixel ({col}, {row}) points into the surface: its blue is {blue:.3}, below 0.5. Give a \
         tangent-space normal map with linear values (not sRGB-encoded)"
    )]
    Inward {
        /// Column.
        col: usize,
        /// Row from the top.
        row: usize,
        /// Blue, 0 to 1.
        blue: f32,
    },
}

impl NormalMap {
    /// From red, green and blue between 0 and 1, rows from the top: `normal = 2 rgb - 1`, z outward. `strength` scales
    /// the slopes: 0 is flat, 1 as stored.
    ///
    /// # Errors
    /// When the number of values is wrong or a normal does not point outward.
    pub fn from_rgb(width: usize, height: usize, rgb: &[f32], strength: f32) -> Result<Self, NormalMapError> {
        if width == 0 || height == 0 || rgb.len() != 3 * width * height {
            return Err(NormalMapError::Size { width, height, values: rgb.len() });
        }
        let mut normals = Vec::with_capacity(width * height);
        for (index, pixel) in rgb.chunks_exact(3).enumerate() {
            let normal = Vec3::new(2.0 * pixel[0] - 1.0, 2.0 * pixel[1] - 1.0, 2.0 * pixel[2] - 1.0);
            if !(normal.z > 0.0 && normal.is_finite()) {
                return Err(NormalMapError::Inward {
                    col: index % width,
                    row: index / width,
                    blue: pixel[2],
                });
            }
            normals.push(Vec3::new(normal.x * strength, normal.y * strength, normal.z).normalize());
        }
        Ok(Self { width, height, normals: Arc::new(normals) })
    }

    /// Unit normal at texture coordinates, bilinear between pixel centers; coordinates repeat, v = 0 is the bottom row.
    pub fn at(&self, uv: Vec2) -> Vec3 {
        let x = uv.x * self.width as f32 - 0.5;
        let y = (1.0 - uv.y) * self.height as f32 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let wrap = |i: f32, n: usize| (i as i64).rem_euclid(n as i64) as usize;
        let pixel = |dx: f32, dy: f32| {
            self.normals[wrap(y0 + dy, self.height) * self.width + wrap(x0 + dx, self.width)]
        };
        let top = pixel(0.0, 0.0) * (1.0 - fx) + pixel(1.0, 0.0) * fx;
        let bottom = pixel(0.0, 1.0) * (1.0 - fx) + pixel(1.0, 1.0) * fx;
        (top * (1.0 - fy) + bottom * fy).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_become_unit_normals() {
        let flat = NormalMap::from_rgb(1, 1, &[0.5, 0.5, 1.0], 1.0).unwrap();
        assert_eq!(flat.at(Vec2::new(3.2, -0.4)), Vec3::Z);
        let tilted = NormalMap::from_rgb(1, 1, &[1.0, 0.5, 1.0], 1.0).unwrap().at(Vec2::ZERO);
        assert!((tilted - Vec3::new(1.0, 0.0, 1.0).normalize()).length() < 1e-6);
        assert_eq!(NormalMap::from_rgb(1, 1, &[1.0, 0.5, 1.0], 0.0).unwrap().at(Vec2::ZERO), Vec3::Z);
        assert!(matches!(
            NormalMap::from_rgb(1, 1, &[0.5, 0.5, 0.4], 1.0),
            Err(NormalMapError::Inward { .. })
        ));
        assert!(matches!(NormalMap::from_rgb(2, 1, &[0.5; 3], 1.0), Err(NormalMapError::Size { .. })));
    }
}
