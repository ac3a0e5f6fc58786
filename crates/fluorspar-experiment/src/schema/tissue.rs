//! Layered tissue.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{NameOrFile, SpectrumReference};

/// Layered tissue with blood and depth: a site of the catalogue, in some state, with other parameters; or layers that are
/// described one by one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TissueSection {
    /// Name by which materials and samples refer to it.
    pub name: String,
    /// Site that it starts from: of the catalogue, for instance "dorsal_tongue", or the path of a site file (.toml). Without it `layer`
    /// describes the tissue.
    #[schemars(extend("x-mutually-exclusive-with" = ["layer", "refractive_index", "index_below"]))]
    pub site: Option<NameOrFile>,
    /// States of a site, for instance "inflammation", applied one after the other. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub states: Vec<String>,
    /// Parameters of a site by name, each in the unit that ends its name, for instance `epithelium_thickness_um = 250.0`. They take
    /// the place of those of the site in its state. Default: none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, f64>,
    /// The layers in place of a site, the uppermost first; with a site what its layers hold in addition, a dye for instance.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub layer: Vec<TissueLayerSection>,
    /// Refractive index of layers that do not state their own, 1 to 3. Default 1.4 (mucosa).
    pub refractive_index: Option<f64>,
    /// Refractive index of what lies below the last layer, 1 to 3; nothing returns from there, but its surface reflects.
    /// Default: that of the last layer.
    pub index_below: Option<f64>,
}

/// One homogeneous layer of tissue, or an addition to the layer of a site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TissueLayerSection {
    /// Name, unique in its tissue; with a site that of its layer, for instance "basal layer".
    pub name: String,
    /// Thickness, um, 0.1 to 1e6. 1 mm = 1000 um. Layers of a site have their own.
    pub thickness_um: Option<f64>,
    /// How it scatters. Layers of a site have their own.
    pub scattering: Option<LayerScatteringSection>,
    /// What absorbs in it. Default: nothing.
    #[serde(default)]
    pub absorption: LayerAbsorptionSection,
    /// What fluoresces in it, by the name of a `[[fluorophore]]` or of the catalogue. Default: nothing.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub fluorophores: BTreeMap<String, LayerFluorophoreSection>,
    /// Refractive index, 1 to 3. Default: that of the tissue.
    pub refractive_index: Option<f64>,
}

/// Scattering of a layer: `scattering_per_mm` or `reduced_per_mm`, a number that follows a power law or a spectrum.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayerScatteringSection {
    /// Anisotropy factor of Henyey and Greenstein, the mean cosine of the scattering angle, -0.99 to 0.995.
    pub anisotropy: f64,
    /// Scattering coefficient, 1/mm, 0 to 40, not reduced by the anisotropy: the value at `at_nm`, or a spectrum.
    #[schemars(extend("x-mutually-exclusive-with" = ["reduced_per_mm"]))]
    pub scattering_per_mm: Option<SpectrumReference>,
    /// Reduced scattering coefficient, that times (1 - anisotropy), 1/mm, 0 to 10: the value at `at_nm`, or a spectrum.
    #[schemars(extend("x-mutually-exclusive-with" = ["scattering_per_mm"]))]
    pub reduced_per_mm: Option<SpectrumReference>,
    /// Wavelength of a coefficient that is a number, nm, 200 to 1200. Default 500.
    pub at_nm: Option<f64>,
    /// A coefficient that is a number falls as (wavelength / at_nm)^-power, 0 to 4. Default 0.
    pub power: Option<f64>,
}

/// What absorbs in a layer; the coefficients add up.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayerAbsorptionSection {
    /// Blood in vessels. Default: none.
    pub blood: Option<BloodSection>,
    /// Melanosomes (Jacques 2013). Default: none.
    pub melanin: Option<VolumeSection>,
    /// Water. Default: none.
    pub water: Option<VolumeSection>,
    /// Beta-carotene, as in hexane. Default: none.
    pub beta_carotene: Option<CaroteneSection>,
    /// Tissue without blood and pigment. Default: none.
    pub background: Option<BackgroundSection>,
    /// Absorption coefficients (natural logarithm) of anything else by name, spectra in 1/mm, 0 to 400; 1/cm = 0.1/mm. Default: none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub curves: BTreeMap<String, SpectrumReference>,
}

/// Blood in vessels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BloodSection {
    /// Volume of blood per volume of tissue, 0 to 1; mucosa has 0.002 to 0.1.
    pub volume_fraction: f64,
    /// Oxygen saturation, 0 to 1. Default 0.9 (assumed).
    #[serde(default = "saturation")]
    pub saturation: f64,
    /// Hemoglobin in whole blood, g/l, 50 to 250. Default 150.
    #[serde(default = "hemoglobin")]
    pub hemoglobin_g_per_l: f64,
    /// Radius of the vessels, um, 0 (blood is spread evenly) to 1000. Default 4 (capillaries).
    #[serde(default = "capillary")]
    pub vessel_radius_um: f64,
}

/// Something that fills a share of the volume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VolumeSection {
    /// Its volume per volume of tissue, 0 to 1.
    pub volume_fraction: f64,
}

/// Beta-carotene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaroteneSection {
    /// Concentration, umol/l, 0 to 100; plasma has 0.1 to 2.
    pub concentration_umol_per_l: f64,
}

/// An absorption that falls exponentially with the wavelength.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BackgroundSection {
    /// Absorption coefficient at `at_nm`, 1/mm, 0 to 0.8; soft tissue has 0.01 to 0.3.
    pub absorption_per_mm: f64,
    /// Wavelength of that value, nm, 200 to 1200. Default 420.
    #[serde(default = "background_nm")]
    pub at_nm: f64,
    /// It falls as exp(-slope_per_nm (wavelength - at_nm)), 1/nm, 0 to 0.05. Default 0.00835 (fitted to tongues).
    #[serde(default = "background_slope")]
    pub slope_per_nm: f64,
}

/// A fluorophore in a layer: `strength_per_mm`, or the concentration of a dye.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayerFluorophoreSection {
    /// Concentration, umol/l, of a dye of the catalogue whose molar absorption and quantum yield are published
    /// (`catalog show fluorophore`). Its own absorption is added to that of the layer.
    #[schemars(extend("x-mutually-exclusive-with" = ["strength_per_mm", "at_nm", "quantum_yield"]))]
    pub concentration_umol_per_l: Option<f64>,
    /// Absorption coefficient of the fluorophore at `at_nm` times its quantum yield, 1/mm, 0 to 400; mucosa has 1e-5 to 1e-2.
    #[schemars(extend("x-mutually-exclusive-with" = ["concentration_umol_per_l"]))]
    pub strength_per_mm: Option<f64>,
    /// Wavelength of that value, nm, 200 to 1200; the fluorophore must be excited there. Default 405.
    pub at_nm: Option<f64>,
    /// Quantum yield, 0.001 to 1: the absorption that the emission implies is added to that of the layer. Default: the layer's
    /// absorption holds it already.
    pub quantum_yield: Option<f64>,
}

defaults! {
    saturation: f64 = 0.9;
    hemoglobin: f64 = 150.0;
    capillary: f64 = 4.0;
    background_nm: f64 = 420.0;
    background_slope: f64 = 0.008_35;
}
