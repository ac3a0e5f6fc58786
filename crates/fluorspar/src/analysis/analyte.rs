//! What texts call the fluorophore whose share is estimated.

use std::fmt;

use serde::{Deserialize, Serialize};

/// The word for every kind of porphyrin.
const PORPHYRIN: &str = "porphyrin";
/// Those of plant pigment: chlorophyll, and what is left of it in food.
const PLANT_PIGMENTS: [&str; 3] = ["chlorophyll", "pheophytin", "pheophorbide"];

/// The name, for people, of the fluorophore whose share of the light is estimated: "porphyrin" for every kind of it, else its title.
///
/// It displays as that word; [`Self::default`] is the porphyrin.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Analyte(String);

impl Analyte {
    /// The fluorophore of a name, with its title.
    #[must_use]
    pub fn new(name: &str, title: &str) -> Self {
        if Self::names_porphyrin(name) { Self::default() } else { Self(title.into()) }
    }

    /// Whether a fluorophore of this name is a porphyrin: all of the catalogue, and those of experiments, have the word in their names.
    #[must_use]
    pub fn names_porphyrin(name: &str) -> bool {
        name.contains(PORPHYRIN)
    }

    /// Whether a fluorophore of this name is plant pigment, as of food, which is red as porphyrin is.
    #[must_use]
    pub fn names_plant_pigment(name: &str) -> bool {
        PLANT_PIGMENTS.iter().any(|pigment| name.contains(pigment))
    }

    /// Whether a porphyrin is looked for.
    #[must_use]
    pub fn is_porphyrin(&self) -> bool {
        self.0 == PORPHYRIN
    }

    /// The word at the begin of a sentence.
    #[must_use]
    pub fn capitalized(&self) -> String {
        let mut letters = self.0.chars();
        letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
    }
}

impl Default for Analyte {
    fn default() -> Self {
        Self(PORPHYRIN.into())
    }
}

impl fmt::Display for Analyte {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_porphyrin_has_one_word_and_others_their_titles() {
        let word = |name: &str, title: &str| Analyte::new(name, title).to_string();
        assert_eq!(word("protoporphyrin_ix", "Protoporphyrin IX"), "porphyrin");
        assert_eq!(word("fad", "FAD"), "FAD");
        assert_eq!(Analyte::new("x", "éosine").capitalized(), "Éosine");
    }
}
