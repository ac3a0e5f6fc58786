//! Where the light of a region was emitted, and the share of the porphyrin in it: the truth that an estimate is after.

use serde::{Deserialize, Serialize};

use super::Analyte;

/// Mean electrons per unsaturated pixel of a region in some channels, by where their light was emitted, e-. Known in a simulation only.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RegionLight {
    /// Names of the channels: R, G and B where the camera has them, otherwise all of the frame that see light.
    #[serde(default = "red_green_blue")]
    pub channels: Vec<String>,
    /// Light whose only fluorescence was in the porphyrin, by whatever way it came.
    pub porphyrin: Vec<f64>,
    /// The same of the other fluorophores that the materials of the region hold.
    pub bulk: Vec<f64>,
    /// That of plant pigment among these.
    #[serde(default)]
    pub pigment: Vec<f64>,
    /// The same of fluorophores that the region does not hold: light of teeth, reflected here.
    pub other_parts: Vec<f64>,
    /// Light that fluoresced more than once. Which fluorophore emitted it last is not kept.
    pub fluoresced_twice: Vec<f64>,
    /// Light that never fluoresced: what leaks through the filters.
    pub reflected: Vec<f64>,
}

/// The channels of results that name none.
fn red_green_blue() -> Vec<String> {
    ["R", "G", "B"].map(String::from).to_vec()
}

/// The share of the porphyrin in the light of a region, as a simulation knows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PorphyrinTruth {
    /// What the share is, in words.
    pub definition: String,
    /// The share, 0 to 1.
    pub share: f64,
    /// The share if light that fluoresced twice is counted, all of it as of other fluorophores, or all of it as of the porphyrin.
    pub share_with_light_that_fluoresced_twice: [f64; 2],
    /// The share of all red emission, porphyrin and plant pigment together.
    #[serde(default)]
    pub red: f64,
    /// The electrons that it was computed from.
    pub electrons: RegionLight,
}

/// Sum over the channels.
fn total(electrons: &[f64]) -> f64 {
    electrons.iter().sum()
}

impl RegionLight {
    /// All light of each channel, e-.
    #[must_use]
    pub fn all(&self) -> Vec<f64> {
        let parts = [&self.porphyrin, &self.bulk, &self.other_parts, &self.fluoresced_twice, &self.reflected];
        let sum = |channel: usize| parts.iter().filter_map(|part| part.get(channel)).sum();
        (0..self.porphyrin.len()).map(sum).collect()
    }

    /// What is meant by the share of the porphyrin.
    fn definition(&self, analyte: &Analyte) -> String {
        let channels = match self.channels.as_slice() {
            [] => "all channels".into(),
            [only] => only.clone(),
            [others @ .., last] => format!("{} and {last}", others.join(", ")),
        };
        format!(
            "electrons in {channels} from light whose only fluorescence was in the {analyte}, over those from light whose only \
             fluorescence was in any fluorophore of the region's materials, by whatever way it came: means over the \
             unsaturated pixels of the region, without noise"
        )
    }

    /// The share of the porphyrin, or of what else is looked for; `None` without fluorescence.
    #[must_use]
    pub fn truth(&self, analyte: &Analyte) -> Option<PorphyrinTruth> {
        let (porphyrin, others) = (total(&self.porphyrin), total(&self.bulk));
        let twice = total(&self.fluoresced_twice);
        let all = porphyrin + others;
        (all > 0.0).then(|| PorphyrinTruth {
            definition: self.definition(analyte),
            share: porphyrin / all,
            red: (porphyrin + total(&self.pigment)) / all,
            share_with_light_that_fluoresced_twice: [
                porphyrin / (all + twice),
                (porphyrin + twice) / (all + twice),
            ],
            electrons: self.clone(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(channels: &[&str], parts: [&[f64]; 5]) -> RegionLight {
        let [porphyrin, bulk, other_parts, fluoresced_twice, reflected] = parts.map(<[f64]>::to_vec);
        let channels = channels.iter().map(|name| (*name).to_owned()).collect();
        RegionLight {
            channels,
            porphyrin,
            bulk,
            pigment: Vec::new(),
            other_parts,
            fluoresced_twice,
            reflected,
        }
    }

    #[test]
    fn the_share_counts_light_that_fluoresced_once_in_the_region() {
        let found = light(
            &["R", "G", "B"],
            [&[8.0, 1.0, 1.0], &[25.0, 50.0, 15.0], &[5.0, 10.0, 5.0], &[1.0, 0.0, 0.0], &[0.0, 0.0, 7.0]],
        );
        let truth = found.truth(&Analyte::default()).unwrap();
        assert!((truth.share - 0.1).abs() < 1e-15);
        let [low, high] = truth.share_with_light_that_fluoresced_twice;
        assert!((low - 10.0 / 101.0).abs() < 1e-15 && (high - 11.0 / 101.0).abs() < 1e-15);
        assert_eq!(found.all(), [39.0, 61.0, 28.0]);
        assert!(truth.definition.starts_with("electrons in R, G and B from light"), "{}", truth.definition);
        let nothing = [0.0; 3];
        assert_eq!(
            light(&["R", "G", "B"], [&nothing, &nothing, &nothing, &nothing, &[1.0; 3]])
                .truth(&Analyte::default()),
            None
        );
    }

    #[test]
    fn one_channel_and_many_have_a_share_as_well() {
        let one =
            light(&["mono"], [&[1.0], &[3.0], &[0.0], &[0.0], &[0.0]]).truth(&Analyte::default()).unwrap();
        assert!((one.share - 0.25).abs() < 1e-15 && one.definition.starts_with("electrons in mono from"));
        let parts: [&[f64]; 5] = [&[2.0, 0.0], &[1.0, 1.0], &[0.0; 2], &[0.0; 2], &[0.0; 2]];
        assert!(
            (light(&["band_1", "band_2"], parts).truth(&Analyte::default()).unwrap().share - 0.5).abs()
                < 1e-15
        );
    }

    /// Results that were written before channels had names.
    #[test]
    fn electrons_without_channels_are_those_of_red_green_and_blue() {
        let of = r#"{"porphyrin":[1.0,0.0,0.0],"bulk":[1.0,1.0,1.0],"other_parts":[0.0,0.0,0.0],"fluoresced_twice":[0.0,0.0,0.0],"reflected":[0.0,0.0,0.0]}"#;
        let read: RegionLight = serde_json::from_str(of).unwrap();
        assert_eq!(read.channels, ["R", "G", "B"]);
    }
}
