//! States of mucosa as changes of parameters.

use super::tissue_error::TissueError;

/// A state of mucosa: factors on parameters of a [`super::Site`].
///
/// Directions follow Pavlova et al., Clin. Cancer Res. 14, 2396 (2008, 49 biopsies): epithelial fluorescence falls with
/// inflammation and rises with dysplasia, that of the stroma falls with both. All sizes are assumed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TissueState {
    /// Less coenzymes and collagen, more superficial blood, thicker epithelium.
    Inflammation,
    /// Ten times the superficial blood.
    Hyperemia,
    /// More coenzymes, less collagen, more blood, thicker epithelium that scatters more.
    Dysplasia,
}

impl TissueState {
    /// All states.
    pub const ALL: [Self; 3] = [Self::Inflammation, Self::Hyperemia, Self::Dysplasia];

    /// Its name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Inflammation => "inflammation",
            Self::Hyperemia => "hyperemia",
            Self::Dysplasia => "dysplasia",
        }
    }

    /// A state by its name.
    ///
    /// # Errors
    /// A name that no state has, with all names.
    pub fn named(name: &str) -> Result<Self, TissueError> {
        let found = Self::ALL.into_iter().find(|state| state.name() == name);
        found.ok_or_else(|| TissueError::NoSuchState {
            name: name.to_string(),
            known: Self::ALL.map(Self::name).to_vec(),
        })
    }

    /// Parameters that it changes, with the factors. \[assumed sizes\]
    #[must_use]
    pub fn factors(self) -> &'static [(&'static str, f64)] {
        match self {
            Self::Inflammation => &[
                ("nadh_per_mm", 0.8),
                ("fad_per_mm", 0.8),
                ("superficial_collagen_per_mm", 0.4),
                ("deep_collagen_per_mm", 0.4),
                ("superficial_elastin_per_mm", 0.4),
                ("deep_elastin_per_mm", 0.4),
                ("superficial_blood_fraction", 4.0),
                ("epithelium_thickness_um", 1.3),
            ],
            Self::Hyperemia => &[("superficial_blood_fraction", 10.0)],
            Self::Dysplasia => &[
                ("nadh_per_mm", 1.5),
                ("fad_per_mm", 1.5),
                ("superficial_collagen_per_mm", 0.4),
                ("deep_collagen_per_mm", 0.4),
                ("superficial_elastin_per_mm", 0.4),
                ("deep_elastin_per_mm", 0.4),
                ("superficial_blood_fraction", 2.0),
                ("epithelium_thickness_um", 1.7),
                ("epithelium_scattering_per_mm", 1.6),
            ],
        }
    }
}
