//! What moves the estimate of a region on the mixture line, and by how much.

use serde::{Deserialize, Serialize};

use super::mixture_line::DETECTION_Z;
use super::{ChannelNoise, LineEstimate, MixtureLine, RegionLight};
use crate::sampling::Z_95;

/// One thing that moves the estimate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BudgetItem {
    /// Its name.
    pub source: String,
    /// The share that the estimate would be without it.
    pub without: f64,
    /// How far it moves the estimate.
    pub change: f64,
}

/// Error budget of an estimate on the line, in shares of the electrons. A simulation knows where the light came from; so each part
/// can be taken away.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorBudget {
    /// The estimate.
    pub share: f64,
    /// Half of the 95 % interval that the sensor's noise leaves.
    pub sensor_noise: f64,
    /// Everything else: leaked light, light of other parts, light that fluoresced twice, indirect light, the rim of the region.
    #[serde(alias = "items")]
    pub terms: Vec<BudgetItem>,
    /// The estimate and the root of the summed squares of the sensor's noise and of all changes, either way. It may reach below
    /// zero. Errors of the library of spectra and the variety of tissue are not in it.
    pub total_interval: [f64; 2],
    /// The same as `a_p / (a_b + a_p)`, within 0 to 1.
    pub fraction_total_interval: [f64; 2],
    /// The estimate if the same light came without that of the porphyrin.
    pub blank: f64,
    /// Smallest share that is told from the blank, counted from it, with errors of 5 % either way by the sensor's noise. Bias of
    /// the line is not in it: see [`Self::terms`].
    pub detection_limit: f64,
}

/// The mean of a region and what is known of it.
#[derive(Clone, Copy, Debug)]
pub struct BudgetInput<'a> {
    /// The line that the estimate lies on.
    pub line: &'a MixtureLine,
    /// The line of flat samples under direct light.
    pub direct_line: &'a MixtureLine,
    /// Mean R, G, B, DN.
    pub mean_rgb_dn: [f64; 3],
    /// Variance of that mean by pixels, DN².
    pub variance_dn2: [f64; 3],
    /// Its covariance by what lines share, DN².
    pub lines_dn2: [[f64; 3]; 3],
    /// Mean R, G, B of another frame that was subtracted, DN, and the ratio of the exposure times; zeros without one.
    pub subtracted: ([f64; 3], f64),
    /// Noise of the frame's pixels.
    pub noise: ChannelNoise,
    /// Mean R, G, B without the pixels at the rim of the region, DN, if any are left.
    pub inner_rgb_dn: Option<[f64; 3]>,
    /// Where the light in R, G and B was emitted, e-.
    pub light: &'a RegionLight,
}

impl BudgetInput<'_> {
    /// The estimate on a line if the mean were another: less light brings less shot noise, and as much of lines.
    fn estimate(&self, line: &MixtureLine, rgb_dn: [f64; 3]) -> Option<LineEstimate> {
        let (subtracted, ratio) = self.subtracted;
        let variance_dn2 = [0, 1, 2].map(|c| {
            let of_pixel = |dn: f64| self.noise.variance_over(dn, subtracted[c], ratio);
            let here = of_pixel(self.mean_rgb_dn[c]);
            if here > 0.0 { self.variance_dn2[c] * of_pixel(rgb_dn[c]) / here } else { self.variance_dn2[c] }
        });
        line.project_shared(rgb_dn, variance_dn2, self.lines_dn2)
    }
}

/// What remains of a mean, DN, without a part of the light, e-. Parts are taken in proportion to all of the light: means of interpolated
/// pixels hold a little of what lies around the region, and noise.
fn left_of(all: &[f64], part: [f64; 3], mean_dn: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|c| {
        let share = all.get(c).filter(|all| **all > 0.0).map_or(0.0, |all| part[c] / all);
        mean_dn[c] * (1.0 - share)
    })
}

impl ErrorBudget {
    /// The budget; `None` where the region has no chromaticity.
    #[must_use]
    pub fn new(input: &BudgetInput<'_>) -> Option<Self> {
        let BudgetInput { line, mean_rgb_dn, light, .. } = *input;
        let here = input.estimate(line, mean_rgb_dn)?;
        let estimate = |rgb: [f64; 3]| input.estimate(line, rgb);
        // Electrons of R, G and B: a line has no others
        let without = |electrons: &[f64]| {
            let &[red, green, blue] = electrons else { return None };
            Some(left_of(&light.all(), [red, green, blue], mean_rgb_dn))
        };
        let mut terms = Vec::new();
        let mut item = |source: &str, other: Option<LineEstimate>| {
            if let Some(other) = other {
                let (without, change) = (other.position, here.position - other.position);
                terms.push(BudgetItem { source: source.into(), without, change });
            }
        };
        let estimate_without = |electrons: &[f64]| without(electrons).and_then(estimate);
        item("leaked light", estimate_without(&light.reflected));
        item("light of other parts", estimate_without(&light.other_parts));
        item("light that fluoresced twice", estimate_without(&light.fluoresced_twice));
        item("indirect light", input.estimate(input.direct_line, mean_rgb_dn));
        item("rim of the region", input.inner_rgb_dn.and_then(estimate));

        let sensor_noise = Z_95 * here.position_standard_error;
        let squares: f64 = terms.iter().map(|item| item.change * item.change).sum();
        let half = sensor_noise.hypot(squares.sqrt());
        let total_interval = [here.position - half, here.position + half];
        let blank = estimate_without(&light.porphyrin)?;
        Some(Self {
            share: here.position,
            sensor_noise,
            terms,
            total_interval,
            fraction_total_interval: total_interval.map(|share| line.fraction(share.clamp(0.0, 1.0)).0),
            blank: blank.position,
            detection_limit: DETECTION_Z * blank.position_standard_error,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::LineNoise;

    /// A mixture with known parts: each is taken away exactly.
    #[test]
    fn every_part_is_taken_away() {
        let (bulk, porphyrin) = ([20.0, 60.0, 20.0], [8.0, 1.0, 1.0]);
        let line = MixtureLine::new(bulk, porphyrin).unwrap();
        // Indirect light makes the ends redder than those of a flat sample.
        let direct_line = MixtureLine::new([18.0, 62.0, 20.0], porphyrin).unwrap();
        let light = RegionLight {
            channels: ["R", "G", "B"].map(String::from).to_vec(),
            porphyrin: porphyrin.to_vec(),
            bulk: bulk.to_vec(),
            pigment: Vec::new(),
            other_parts: vec![0.0; 3],
            fluoresced_twice: vec![0.0; 3],
            reflected: vec![0.0, 2.0, 0.0],
        };
        let input = BudgetInput {
            line: &line,
            direct_line: &direct_line,
            mean_rgb_dn: [0, 1, 2].map(|channel| 0.5 * light.all()[channel]),
            variance_dn2: [1e-4; 3],
            lines_dn2: [[0.0; 3]; 3],
            inner_rgb_dn: None,
            light: &light,
            subtracted: ([0.0; 3], 0.0),
            noise: ChannelNoise {
                floor_dn: 1.0,
                dn_per_electron: 0.5,
                gain_spread: 0.0,
                lines: LineNoise::default(),
            },
        };
        let budget = ErrorBudget::new(&input).unwrap();
        let item = |name: &str| budget.terms.iter().find(|item| item.source == name).unwrap();
        assert!((item("leaked light").without - 10.0 / 110.0).abs() < 1e-12);
        assert!(item("indirect light").without > budget.share + 0.01);
        assert_eq!(item("light of other parts").change, 0.0);
        // Without the porphyrin the leak alone is left, which is green.
        assert!(budget.blank < 0.0);
        // Counted from the blank: a limit is never below zero, and twice the noise doubles it.
        let noisier = ErrorBudget::new(&BudgetInput { variance_dn2: [4e-4; 3], ..input }).unwrap();
        assert!(budget.detection_limit > 0.0);
        assert!((noisier.detection_limit / budget.detection_limit - 2.0).abs() < 1e-9);
        // Shot noise falls with the light: where nothing leaks, that of the bulk alone is left
        let clean = RegionLight { reflected: vec![0.0; 3], ..light.clone() };
        let mean_rgb_dn = [0, 1, 2].map(|channel| 0.5 * clean.all()[channel]);
        let input = BudgetInput { light: &clean, mean_rgb_dn, ..input };
        let of_bulk = [0, 1, 2].map(|c| {
            let [mean, bulk] = [mean_rgb_dn[c], 0.5 * bulk[c]].map(|dn| input.noise.variance(dn));
            1e-4 * bulk / mean
        });
        let expected =
            DETECTION_Z * line.project(bulk.map(|e| 0.5 * e), of_bulk).unwrap().position_standard_error;
        let clean = ErrorBudget::new(&input).unwrap();
        assert!(clean.blank.abs() < 1e-12 && (clean.detection_limit / expected - 1.0).abs() < 1e-12);
        // A mean that interpolation at the rim pulls down has the same blank
        let pulled = [mean_rgb_dn[0] * 0.99, mean_rgb_dn[1], mean_rgb_dn[2]];
        let pulled = ErrorBudget::new(&BudgetInput { mean_rgb_dn: pulled, ..input }).unwrap();
        assert!(pulled.blank.abs() < 0.01, "{}", pulled.blank);
        let [low, high] = budget.total_interval;
        assert!(low < 10.0 / 110.0 && high > 10.0 / 110.0);
        assert!(high - budget.share > budget.sensor_noise);
    }
}
