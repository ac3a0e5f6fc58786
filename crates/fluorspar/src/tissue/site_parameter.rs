//! Parameters of sites: values, names, ranges, meanings, and where values come from.

use serde::Deserialize;

/// A parameter of a [`super::Site`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SiteParameter {
    /// Name, with the unit at its end.
    pub name: &'static str,
    /// Smallest and largest value.
    pub range: [f64; 2],
    /// What it is.
    pub meaning: &'static str,
}

/// Where the value of a parameter comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// Fitted to measurements of the site.
    Fitted,
    /// Published, of this site or of tissue in general.
    Published,
    /// Assumed.
    Assumed,
}

impl Basis {
    /// In one word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fitted => "fitted",
            Self::Published => "published",
            Self::Assumed => "assumed",
        }
    }
}

impl SiteParameter {
    /// Unit, by the end of its name: "um", "1/mm", "1/nm", "g/l", or none.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        [("_um", "um"), ("_per_mm", "1/mm"), ("_per_nm", "1/nm"), ("_g_per_l", "g/l")]
            .into_iter()
            .find_map(|(end, unit)| self.name.ends_with(end).then_some(unit))
            .unwrap_or("")
    }
}

/// Ranges that several parameters share.
const STRENGTH_PER_MM: [f64; 2] = [0.0, 0.05];
const SHARE: [f64; 2] = [0.0, 1.0];
const INDEX: [f64; 2] = [1.3, 1.8];
const POWER: [f64; 2] = [0.0, 4.0];

/// A struct of parameters, and the same by name with their ranges.
macro_rules! parameters {
    ($(#[$about:meta])* $structure:ident { $($name:ident: $range:expr, $meaning:literal;)* }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        #[allow(rustdoc::broken_intra_doc_links, reason = "[assumed] is no link")]
        pub struct $structure {
            $(#[doc = $meaning] pub $name: f64,)*
        }

        impl $structure {
            /// Names, ranges and meanings, in this order.
            pub const PARAMETERS: &'static [SiteParameter] =
                &[$(SiteParameter { name: stringify!($name), range: $range, meaning: $meaning }),*];

            pub(super) fn values(&self) -> Vec<f64> {
                vec![$(self.$name),*]
            }

            pub(super) fn value_mut(&mut self, index: usize) -> Option<&mut f64> {
                [$(&mut self.$name),*].into_iter().nth(index)
            }
        }
    };
}

parameters! {
    /// Parameters of mucosa and skin.
    MucosaParameters {
        biofilm_thickness_um: [0.0, 200.0], "Biofilm, the uppermost part of the keratin layer and at most half of it.";
        keratin_thickness_um: [1.0, 1000.0], "Keratin or superficial layer, the biofilm included.";
        epithelium_thickness_um: [10.0, 2000.0], "Epithelium below the keratin.";
        superficial_stroma_thickness_um: [10.0, 3000.0], "Stroma with capillaries only.";
        deep_stroma_thickness_um: [100.0, 50_000.0], "Stroma or muscle below; nothing returns from under it.";
        background_per_mm: [0.0, 0.8], "Absorption at 420 nm of all layers without blood and pigment.";
        background_slope_per_nm: [0.0, 0.05], "The background falls as exp(-slope (lambda - 420 nm)).";
        keratin_scattering_per_mm: [0.0, 40.0], "Scattering of the keratin layer at 420 nm, anisotropy 0.97.";
        epithelium_scattering_per_mm: [0.0, 40.0], "Scattering of the epithelium at 420 nm, anisotropy 0.97.";
        epithelium_scattering_power: POWER, "Both fall as (lambda / 420 nm)^-power.";
        stroma_reduced_scattering_per_mm: [0.0, 10.0], "Reduced scattering of the stroma at 500 nm, anisotropy 0.88.";
        stroma_scattering_power: POWER, "It falls as (lambda / 500 nm)^-power.";
        superficial_blood_fraction: SHARE, "Volume of blood in the superficial stroma.";
        superficial_vessel_radius_um: [0.0, 1000.0], "Radius of its vessels.";
        deep_blood_fraction: SHARE, "Volume of blood, and myoglobin as blood, in the deep stroma.";
        deep_vessel_radius_um: [0.0, 1000.0], "Radius of its vessels.";
        oxygen_saturation: SHARE, "Oxygen saturation of all blood.";
        hemoglobin_g_per_l: [50.0, 250.0], "Hemoglobin in whole blood.";
        melanin_fraction: SHARE, "Volume of melanosomes in the basal layer, the lowest 20 um of the epithelium.";
        refractive_index: INDEX, "Refractive index of all layers.";
        biofilm_porphyrin_per_mm: STRENGTH_PER_MM, "Porphyrin of the biofilm, strength at 405 nm.";
        biofilm_chlorophyll_per_mm: STRENGTH_PER_MM, "Chlorophyll of food in the biofilm, strength at 405 nm.";
        keratin_per_mm: STRENGTH_PER_MM, "Keratin of biofilm and keratin layer, strength at 405 nm.";
        nadh_per_mm: STRENGTH_PER_MM, "NADH of the epithelium, strength at 405 nm.";
        fad_per_mm: STRENGTH_PER_MM, "FAD of the epithelium, strength at 405 nm.";
        superficial_collagen_per_mm: STRENGTH_PER_MM, "Collagen of the superficial stroma, strength at 405 nm.";
        deep_collagen_per_mm: STRENGTH_PER_MM, "Collagen of the deep stroma, strength at 405 nm.";
        superficial_elastin_per_mm: STRENGTH_PER_MM, "Elastin of the superficial stroma, strength at 405 nm.";
        deep_elastin_per_mm: STRENGTH_PER_MM, "Elastin of the deep stroma, strength at 405 nm.";
        superficial_lipopigment_per_mm: STRENGTH_PER_MM, "Orange emitter of the superficial stroma, strength at 405 nm. [assumed]";
        deep_lipopigment_per_mm: STRENGTH_PER_MM, "Orange emitter of the deep stroma, strength at 405 nm. [assumed]";
        flavin_aggregate_per_mm: STRENGTH_PER_MM, "Another orange emitter, in the epithelium, strength at 405 nm. [assumed]";
    }
}

parameters! {
    /// Parameters of a tooth crown.
    ToothParameters {
        enamel_thickness_um: [100.0, 3000.0], "Enamel.";
        dentin_thickness_um: [50.0, 10_000.0], "Dentin; nothing returns from under it.";
        enamel_scattering_per_mm: [0.0, 40.0], "Scattering of enamel at 633 nm, anisotropy 0.68.";
        enamel_scattering_power: POWER, "It falls as (lambda / 633 nm)^-power.";
        dentin_scattering_per_mm: [0.0, 40.0], "Scattering of dentin at 543 nm, anisotropy 0.93.";
        dentin_scattering_power: POWER, "It falls as (lambda / 543 nm)^-power.";
        enamel_background_per_mm: [0.0, 0.8], "Absorption of enamel at 420 nm.";
        dentin_background_per_mm: [0.0, 0.8], "Absorption of dentin at 420 nm.";
        background_slope_per_nm: [0.0, 0.05], "Both fall as exp(-slope (lambda - 420 nm)).";
        enamel_refractive_index: INDEX, "Refractive index of enamel.";
        dentin_refractive_index: INDEX, "Refractive index of dentin.";
        biofilm_porphyrin_per_mm: STRENGTH_PER_MM, "Porphyrin of plaque, as if the enamel held it, strength at 405 nm.";
        enamel_per_mm: STRENGTH_PER_MM, "Fluorescence of enamel, strength at 405 nm.";
        dentin_per_mm: STRENGTH_PER_MM, "Fluorescence of dentin, strength at 405 nm.";
    }
}
