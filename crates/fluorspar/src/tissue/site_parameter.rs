//! Parameters of the sites of the catalogue: names, ranges, meanings.

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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

    /// Where values of a site that was measured come from, and in what. At sites that were not, what would be fitted is
    /// assumed: [`super::Site::basis`].
    #[must_use]
    pub(super) fn source(&self) -> (Basis, &'static str) {
        match self.name {
            "epithelium_thickness_um" => {
                (Basis::Published, "Prestin et al. 2012, optical coherence tomography of 143 people")
            }
            "keratin_scattering_per_mm" | "epithelium_scattering_per_mm" => (
                Basis::Published,
                "Pavlova et al., J. Biomed. Opt. 13, 064012, 2008 [by way of another source]",
            ),
            "hemoglobin_g_per_l" => (Basis::Published, "whole blood of adults"),
            "refractive_index" => (Basis::Published, "soft tissue [from memory]"),
            "superficial_vessel_radius_um" => (Basis::Published, "capillaries"),
            "background_per_mm"
            | "background_slope_per_nm"
            | "stroma_reduced_scattering_per_mm"
            | "stroma_scattering_power"
            | "deep_blood_fraction"
            | "deep_vessel_radius_um"
            | "oxygen_saturation" => (Basis::Fitted, "measured reflectance"),
            "superficial_blood_fraction" | "superficial_stroma_thickness_um" => {
                (Basis::Fitted, "measured reflectance and fluorescence")
            }
            "nadh_per_mm" => (Basis::Published, "what cells have; 405 to 450 nm hardly excite it"),
            name if name.contains("lipopigment") || name.starts_with("flavin") => {
                (Basis::Assumed, "an orange emitter that in-vivo spectra ask for; what it is is not known")
            }
            name if name.ends_with("_per_mm") => (Basis::Fitted, "fluorescence in vivo, 500 to 700 nm"),
            _ => (Basis::Assumed, ""),
        }
    }
}

const fn parameter(name: &'static str, range: [f64; 2], meaning: &'static str) -> SiteParameter {
    SiteParameter { name, range, meaning }
}

/// Ranges that several parameters share.
const STRENGTH_PER_MM: [f64; 2] = [0.0, 0.05];
const SHARE: [f64; 2] = [0.0, 1.0];
const INDEX: [f64; 2] = [1.3, 1.8];
const POWER: [f64; 2] = [0.0, 4.0];

/// Parameters of mucosa and skin.
pub(super) const SOFT: &[SiteParameter] = &[
    parameter(
        "biofilm_thickness_um",
        [0.0, 200.0],
        "Biofilm, the uppermost part of the keratin layer and at most half of it.",
    ),
    parameter("keratin_thickness_um", [1.0, 1000.0], "Keratin or superficial layer, the biofilm included."),
    parameter("epithelium_thickness_um", [10.0, 2000.0], "Epithelium below the keratin."),
    parameter("superficial_stroma_thickness_um", [10.0, 3000.0], "Stroma with capillaries only."),
    parameter(
        "deep_stroma_thickness_um",
        [100.0, 50_000.0],
        "Stroma or muscle below; nothing returns from under it.",
    ),
    parameter(
        "background_per_mm",
        [0.0, 0.8],
        "Absorption at 420 nm of all layers without blood and pigment.",
    ),
    parameter(
        "background_slope_per_nm",
        [0.0, 0.05],
        "The background falls as exp(-slope (lambda - 420 nm)).",
    ),
    parameter(
        "keratin_scattering_per_mm",
        [0.0, 40.0],
        "Scattering of the keratin layer at 420 nm, anisotropy 0.97.",
    ),
    parameter(
        "epithelium_scattering_per_mm",
        [0.0, 40.0],
        "Scattering of the epithelium at 420 nm, anisotropy 0.97.",
    ),
    parameter("epithelium_scattering_power", POWER, "Both fall as (lambda / 420 nm)^-power."),
    parameter(
        "stroma_reduced_scattering_per_mm",
        [0.0, 10.0],
        "Reduced scattering of the stroma at 500 nm, anisotropy 0.88.",
    ),
    parameter("stroma_scattering_power", POWER, "It falls as (lambda / 500 nm)^-power."),
    parameter("superficial_blood_fraction", SHARE, "Volume of blood in the superficial stroma."),
    parameter("superficial_vessel_radius_um", [0.0, 1000.0], "Radius of its vessels."),
    parameter("deep_blood_fraction", SHARE, "Volume of blood, and myoglobin as blood, in the deep stroma."),
    parameter("deep_vessel_radius_um", [0.0, 1000.0], "Radius of its vessels."),
    parameter("oxygen_saturation", SHARE, "Oxygen saturation of all blood."),
    parameter("hemoglobin_g_per_l", [50.0, 250.0], "Hemoglobin in whole blood."),
    parameter(
        "melanin_fraction",
        SHARE,
        "Volume of melanosomes in the basal layer, the lowest 20 um of the epithelium.",
    ),
    parameter("refractive_index", INDEX, "Refractive index of all layers."),
    parameter("biofilm_porphyrin_per_mm", STRENGTH_PER_MM, "Porphyrin of the biofilm, strength at 405 nm."),
    parameter(
        "biofilm_chlorophyll_per_mm",
        STRENGTH_PER_MM,
        "Chlorophyll of food in the biofilm, strength at 405 nm.",
    ),
    parameter("keratin_per_mm", STRENGTH_PER_MM, "Keratin of biofilm and keratin layer, strength at 405 nm."),
    parameter("nadh_per_mm", STRENGTH_PER_MM, "NADH of the epithelium, strength at 405 nm."),
    parameter("fad_per_mm", STRENGTH_PER_MM, "FAD of the epithelium, strength at 405 nm."),
    parameter(
        "superficial_collagen_per_mm",
        STRENGTH_PER_MM,
        "Collagen of the superficial stroma, strength at 405 nm.",
    ),
    parameter("deep_collagen_per_mm", STRENGTH_PER_MM, "Collagen of the deep stroma, strength at 405 nm."),
    parameter(
        "superficial_elastin_per_mm",
        STRENGTH_PER_MM,
        "Elastin of the superficial stroma, strength at 405 nm.",
    ),
    parameter("deep_elastin_per_mm", STRENGTH_PER_MM, "Elastin of the deep stroma, strength at 405 nm."),
    parameter(
        "superficial_lipopigment_per_mm",
        STRENGTH_PER_MM,
        "Orange emitter of the superficial stroma, strength at 405 nm. [assumed]",
    ),
    parameter(
        "deep_lipopigment_per_mm",
        STRENGTH_PER_MM,
        "Orange emitter of the deep stroma, strength at 405 nm. [assumed]",
    ),
    parameter(
        "flavin_aggregate_per_mm",
        STRENGTH_PER_MM,
        "Another orange emitter, in the epithelium, strength at 405 nm. [assumed]",
    ),
];

/// Parameters of a tooth crown.
pub(super) const TOOTH: &[SiteParameter] = &[
    parameter("enamel_thickness_um", [100.0, 3000.0], "Enamel."),
    parameter("dentin_thickness_um", [500.0, 10_000.0], "Dentin; nothing returns from under it."),
    parameter("enamel_scattering_per_mm", [0.0, 40.0], "Scattering of enamel at 543 nm, anisotropy 0.96."),
    parameter("enamel_scattering_power", POWER, "It falls as (lambda / 543 nm)^-power."),
    parameter("dentin_scattering_per_mm", [0.0, 40.0], "Scattering of dentin at 543 nm, anisotropy 0.93."),
    parameter("dentin_scattering_power", POWER, "It falls as (lambda / 543 nm)^-power."),
    parameter("enamel_background_per_mm", [0.0, 0.8], "Absorption of enamel at 420 nm."),
    parameter("dentin_background_per_mm", [0.0, 0.8], "Absorption of dentin at 420 nm."),
    parameter("background_slope_per_nm", [0.0, 0.05], "Both fall as exp(-slope (lambda - 420 nm))."),
    parameter("enamel_refractive_index", INDEX, "Refractive index of enamel."),
    parameter("dentin_refractive_index", INDEX, "Refractive index of dentin."),
    parameter("enamel_per_mm", STRENGTH_PER_MM, "Fluorescence of enamel, strength at 405 nm."),
    parameter("dentin_per_mm", STRENGTH_PER_MM, "Fluorescence of dentin, strength at 405 nm."),
];
