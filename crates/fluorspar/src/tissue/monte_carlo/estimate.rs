//! Sums of independent groups of photons, and means with standard errors from them.

use serde::Serialize;

/// Groups of photons. Each holds as many as any other; photon `i` of a group has a random stream of its own.
pub(super) const GROUPS: usize = 256;

/// A mean with its standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Estimate {
    /// Mean.
    pub mean: f64,
    /// Standard error of the mean, from the spread of 256 groups of photons; itself uncertain by 4 %.
    pub standard_error: f64,
}

impl Estimate {
    /// Mean and standard error of equally weighted independent values.
    pub(super) fn of(values: impl Iterator<Item = f64> + Clone) -> Self {
        let number = values.clone().count() as f64;
        let mean = values.clone().sum::<f64>() / number;
        let squares: f64 = values.map(|value| (value - mean).powi(2)).sum();
        let standard_error = (squares / (number * (number - 1.0))).sqrt();
        // Values without any scatter differ by the rounding of their sums.
        let is_rounding = standard_error < 1e-14 * mean.abs();
        Self { mean, standard_error: if is_rounding { 0.0 } else { standard_error } }
    }

    /// Standard error over mean; infinite while nothing was scored.
    #[must_use]
    pub fn relative_error(&self) -> f64 {
        if self.mean == 0.0 { f64::INFINITY } else { (self.standard_error / self.mean).abs() }
    }
}

/// What every group has scored.
#[derive(Clone, Debug)]
pub(super) struct GroupSums {
    /// Photons in each group.
    pub(super) photons_per_group: u64,
    /// Scores of each group.
    pub(super) sums: Vec<Vec<f64>>,
}

impl GroupSums {
    pub(super) fn new(scores: usize) -> Self {
        Self { photons_per_group: 0, sums: vec![vec![0.0; scores]; GROUPS] }
    }

    /// Photons of all groups.
    pub(super) fn photons(&self) -> u64 {
        self.photons_per_group * GROUPS as u64
    }

    /// Mean per photon of a function that is linear in the scores.
    pub(super) fn estimate(&self, score: impl Fn(&[f64]) -> f64) -> Estimate {
        let photons = self.photons_per_group as f64;
        Estimate::of(self.sums.iter().map(|scores| score(scores) / photons))
    }
}
