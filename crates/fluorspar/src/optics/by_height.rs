//! Functions of the height on the film.

use glam::DVec2;
use rayon::prelude::*;

/// A function of the height on the film, linear between even nodes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ByHeight {
    step_mm: f64,
    values: Vec<f64>,
}

impl ByHeight {
    pub(super) fn new(radius_mm: f64, nodes: usize, f: impl Fn(f64) -> f64 + Sync) -> Self {
        let step_mm = radius_mm / (nodes - 1) as f64;
        Self { step_mm, values: (0..nodes).into_par_iter().map(|i| f(i as f64 * step_mm)).collect() }
    }

    pub(super) fn at(&self, height_mm: f64) -> f64 {
        let position = (height_mm / self.step_mm).min((self.values.len() - 1) as f64);
        let left = (position as usize).min(self.values.len() - 2);
        let t = position - left as f64;
        self.values[left] * (1.0 - t) + self.values[left + 1] * t
    }

    /// The value at the height of a place, as a vector from the axis toward it.
    pub(super) fn along(&self, place_mm: DVec2) -> DVec2 {
        let radius = place_mm.length();
        if radius > 0.0 { place_mm / radius * self.at(radius) } else { DVec2::ZERO }
    }
}
