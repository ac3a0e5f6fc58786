//! Where the light of a region was emitted, and the share of the porphyrin in it: the truth that an estimate is after.

use serde::{Deserialize, Serialize};

/// Mean electrons per pixel of a region in R, G and B, by where their light was emitted, e-. Known in a simulation only.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RegionLight {
    /// Light whose only fluorescence was in the porphyrin, by whatever way it came.
    pub porphyrin: [f64; 3],
    /// The same of the other fluorophores that the materials of the region hold.
    pub bulk: [f64; 3],
    /// The same of fluorophores that the region does not hold: light of teeth, reflected here.
    pub other_parts: [f64; 3],
    /// Light that fluoresced more than once. Which fluorophore emitted it last is not kept.
    pub fluoresced_twice: [f64; 3],
    /// Light that never fluoresced: what leaks through the filters.
    pub reflected: [f64; 3],
}

/// What is meant by the share of the porphyrin.
pub const SHARE_DEFINITION: &str = "electrons in R, G and B from light whose only fluorescence was in the porphyrin, over those \
     from light whose only fluorescence was in any fluorophore of the region's materials, by whatever way it came: means over \
     the pixels of the region, without noise";

/// The share of the porphyrin in the light of a region, as a simulation knows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PorphyrinTruth {
    /// What the share is: [`SHARE_DEFINITION`].
    pub definition: String,
    /// The share, 0 to 1.
    pub share: f64,
    /// The share if light that fluoresced twice is counted, all of it as of other fluorophores, or all of it as of the porphyrin.
    pub share_with_light_that_fluoresced_twice: [f64; 2],
    /// The electrons that it was computed from.
    pub electrons: RegionLight,
}

/// Sum over the channels.
fn total(rgb: [f64; 3]) -> f64 {
    rgb.iter().sum()
}

/// Channel by channel.
fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|c| a[c] + b[c])
}

impl RegionLight {
    /// All light, e-.
    #[must_use]
    pub fn all(&self) -> [f64; 3] {
        let fluorescence = plus(plus(self.bulk, self.porphyrin), self.other_parts);
        plus(plus(fluorescence, self.fluoresced_twice), self.reflected)
    }

    /// The share of the porphyrin; `None` without fluorescence.
    #[must_use]
    pub fn truth(&self) -> Option<PorphyrinTruth> {
        let (porphyrin, others) = (total(self.porphyrin), total(self.bulk));
        let twice = total(self.fluoresced_twice);
        let all = porphyrin + others;
        (all > 0.0).then(|| PorphyrinTruth {
            definition: SHARE_DEFINITION.into(),
            share: porphyrin / all,
            share_with_light_that_fluoresced_twice: [
                porphyrin / (all + twice),
                (porphyrin + twice) / (all + twice),
            ],
            electrons: *self,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_counts_light_that_fluoresced_once_in_the_region() {
        let light = RegionLight {
            porphyrin: [8.0, 1.0, 1.0],
            bulk: [25.0, 50.0, 15.0],
            other_parts: [5.0, 10.0, 5.0],
            fluoresced_twice: [1.0, 0.0, 0.0],
            reflected: [0.0, 0.0, 7.0],
        };
        let truth = light.truth().unwrap();
        assert!((truth.share - 0.1).abs() < 1e-15);
        let [low, high] = truth.share_with_light_that_fluoresced_twice;
        assert!((low - 10.0 / 101.0).abs() < 1e-15 && (high - 11.0 / 101.0).abs() < 1e-15);
        assert_eq!(light.all(), [39.0, 61.0, 28.0]);
        assert_eq!(RegionLight { reflected: [1.0; 3], ..RegionLight::default() }.truth(), None);
    }
}
