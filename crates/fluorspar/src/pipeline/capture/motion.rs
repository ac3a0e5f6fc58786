//! Rigid motion of the image on the sensor from exposure to exposure.

use crate::sampling::random::Key;
use crate::sensor::FilmRates;
use crate::study::{Motion, Study};

/// Where the image lies in each exposure: `drift * start of the exposure + jitter * N(0, 1)` in either direction. The
/// first exposure starts at time 0.
pub(super) struct MotionPath {
    motion: Option<Motion>,
    seed: u64,
    exposure: u64,
    time_s: f64,
}

impl MotionPath {
    pub(super) fn new(study: &Study) -> Self {
        Self { motion: study.motion.clone(), seed: study.render.seed, exposure: 0, time_s: 0.0 }
    }

    /// Steady motion during an exposure: pixels of the sensor per second to the right and down.
    pub(super) fn drift_px_per_s(&self) -> [f64; 2] {
        self.motion.as_ref().map_or([0.0; 2], |motion| motion.drift_px_per_s)
    }

    /// Shift of the next exposure, which takes `exposure_s`: pixels of the sensor to the right and down.
    pub(super) fn next(&mut self, exposure_s: f64) -> [f64; 2] {
        let Some(motion) = &self.motion else { return [0.0; 2] };
        let key = Key::new(self.seed).with_text("motion").with(self.exposure);
        let start_s = self.time_s;
        self.exposure += 1;
        self.time_s += exposure_s + 1e-3 * motion.interval_ms;
        [0, 1].map(|axis| {
            let jitter = if motion.jitter_px > 0.0 {
                let normal = key.with(axis as u64).normal();
                motion.jitter_px * normal
            } else {
                0.0
            };
            motion.drift_px_per_s[axis] * start_s + jitter
        })
    }
}

/// Rates moved by samples to the right and down. Samples are squares of even light: each becomes the mean of the squares that it
/// covers, so light is kept. What moves in at an edge is the edge's own value.
pub(super) fn shifted(rates: &FilmRates, right: f64, down: f64) -> FilmRates {
    let (width, height) = (rates.width, rates.height);
    let mut data = vec![0.0_f32; rates.data.len()];
    // Split the shift into whole pixels and a fraction
    let split = |shift: f64| {
        let whole = shift.floor();
        (whole as i64, (shift - whole) as f32)
    };
    let ((cols, col_part), (rows, row_part)) = (split(right), split(down));
    let clamp = |index: i64, length: usize| index.clamp(0, length as i64 - 1) as usize;
    let lines = data.chunks_exact_mut(width.max(1)).enumerate();
    for (number, out) in lines {
        let plane = &rates.data[number / height * (width * height)..][..width * height];
        let row = (number % height) as i64 - rows;
        let (above, below) = (clamp(row - 1, height), clamp(row, height));
        for (col, out) in out.iter_mut().enumerate() {
            let before = clamp(col as i64 - cols - 1, width);
            let after = clamp(col as i64 - cols, width);
            // Average the four samples that overlap the shifted one
            let corners = [
                (plane[below * width + after], (1.0 - row_part) * (1.0 - col_part)),
                (plane[below * width + before], (1.0 - row_part) * col_part),
                (plane[above * width + after], row_part * (1.0 - col_part)),
                (plane[above * width + before], row_part * col_part),
            ];
            *out = corners
                .iter()
                .filter(|(_, weight)| *weight > 0.0)
                .map(|(value, weight)| weight * value)
                .sum();
        }
    }
    FilmRates { width, height, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_move_by_whole_and_broken_samples() {
        let data: Vec<f32> = (0..60).map(|i| (i * i % 17) as f32).collect();
        let rates = FilmRates { width: 6, height: 5, data };
        let at = |rates: &FilmRates, row: usize, col: usize| rates.data[30 + row * 6 + col];
        assert_eq!(shifted(&rates, 0.0, 0.0), rates);
        let moved = shifted(&rates, 2.0, 1.0);
        assert_eq!(at(&moved, 3, 4), at(&rates, 2, 2));
        assert_eq!(at(&moved, 0, 0), at(&rates, 0, 0), "the edge moves in");
        let back = shifted(&rates, -1.0, 0.0);
        assert_eq!(at(&back, 2, 2), at(&rates, 2, 3));
        let quarter = shifted(&rates, 0.25, 0.0);
        let expected = 0.75 * at(&rates, 2, 3) + 0.25 * at(&rates, 2, 2);
        assert!((at(&quarter, 2, 3) - expected).abs() < 1e-6);
    }

    #[test]
    fn drift_follows_time_and_jitter_its_spread() {
        let section = Motion { drift_px_per_s: [10.0, -4.0], jitter_px: 0.0, interval_ms: 200.0 };
        let path =
            |motion: &Motion| MotionPath { motion: Some(motion.clone()), seed: 3, exposure: 0, time_s: 0.0 };
        let mut steady = path(&section);
        assert_eq!(steady.next(0.05), [0.0, 0.0]);
        let second = steady.next(0.05);
        assert!((second[0] - 2.5).abs() < 1e-12 && (second[1] + 1.0).abs() < 1e-12, "{second:?}");
        let mut shaking = path(&Motion { drift_px_per_s: [0.0; 2], jitter_px: 3.0, ..section });
        let draws: Vec<f64> = (0..2000).flat_map(|_| shaking.next(0.01)).collect();
        let variance = draws.iter().map(|d| d * d).sum::<f64>() / draws.len() as f64;
        // Variance of a normal: 9 (1 +- sqrt(2 / n)), four standard errors.
        assert!((variance / 9.0 - 1.0).abs() < 4.0 * (2.0 / draws.len() as f64).sqrt(), "{variance}");
    }
}
