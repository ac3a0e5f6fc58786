//! Porphyrin on the back of a tongue as a simple map, for any tongue whose u runs across and whose v runs from tip to
//! base. [`SurfaceMap::Porphyrin`](super::SurfaceMap::Porphyrin) follows the papillae of a generated mouth instead.

use glam::Vec2;
use rayon::prelude::*;

use fluorspar::sampling::{fractal_noise, smoothstep};

/// A mid-posterior maximum along the midline, none at the sides, broken into patches by noise. With `u` across (0.5 is
/// the midline) and `v` from tip (0) to base (1): `exp(-(u - 0.5)^2 / (2 sigma^2)) * ramp(v) * patches(u, v)`, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PorphyrinRamp {
    /// Standard deviation across, as a fraction of the tongue's width, above 0.
    pub sigma: f32,
    /// Fraction of the length at which the ramp from the tip is complete, above 0.
    pub full_at: f32,
    /// 0 is smooth, 1 fully broken into patches.
    pub patchiness: f32,
    /// Which patches.
    pub seed: u32,
}

impl PorphyrinRamp {
    /// Value at texture coordinates, 0 to 1.
    pub fn at(&self, uv: Vec2) -> f32 {
        let across = (uv.x - 0.5) / self.sigma;
        let ramp = smoothstep(uv.y / self.full_at) * (1.0 - 0.6 * smoothstep((uv.y - 0.9) / 0.1));
        let noise = fractal_noise(uv * Vec2::new(9.0, 14.0), self.seed);
        let patches = smoothstep((noise - 0.38) / 0.3);
        (-0.5 * across * across).exp() * ramp * (1.0 - self.patchiness + self.patchiness * patches)
    }

    /// Samples the map at the centers of `columns` by `rows` pixels, rows from the top (v = 1).
    pub fn bake(&self, columns: usize, rows: usize) -> Vec<f32> {
        (0..rows * columns)
            .into_par_iter()
            .map(|pixel| {
                let u = ((pixel % columns) as f32 + 0.5) / columns as f32;
                let v = 1.0 - ((pixel / columns) as f32 + 0.5) / rows as f32;
                self.at(Vec2::new(u, v))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn porphyrin_avoids_tip_and_sides() {
        let ramp = PorphyrinRamp { sigma: 0.2, full_at: 0.6, patchiness: 0.0, seed: 0 };
        assert_eq!(ramp.at(Vec2::new(0.5, 0.0)), 0.0);
        assert!(ramp.at(Vec2::new(0.0, 0.7)) < 0.05);
        assert!(ramp.at(Vec2::new(0.5, 0.7)) > 0.99);
    }

    #[test]
    fn pixels_are_values_at_their_centers() {
        let ramp = PorphyrinRamp { sigma: 0.3, full_at: 0.6, patchiness: 0.8, seed: 2 };
        let pixels = ramp.bake(4, 8);
        assert!(pixels.iter().all(|value| (0.0..=1.0).contains(value)));
        assert_eq!(pixels[4 + 2], ramp.at(Vec2::new(2.5 / 4.0, 1.0 - 1.5 / 8.0)));
    }
}
