//! Layered tissue.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{GlossSection, TextureReference};

/// Layered tissue with blood and depth: a site of the catalogue, in some state, with other parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TissueSection {
    /// Name by which materials and samples refer to it.
    pub name: String,
    /// Site of the catalogue that it starts from, for instance "dorsal_tongue".
    pub site: String,
    /// States of the tissue, for instance "inflammation", applied one after the other. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub states: Vec<String>,
    /// Parameters by name, each in the unit that ends its name, for instance `epithelium_thickness_um = 250.0`. They take the
    /// place of those of the site in its state. Default: none.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

/// Layered tissue below its wet surface: reflectance and fluorescence are those that light in its layers gives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TissueMaterialSection {
    /// Name of a `[[tissue]]`, or of a site of the catalogue.
    pub tissue: String,
    /// Factors on parameters of the tissue over the surface, by name, at most 3: `superficial_blood_fraction = { noise = [8, 8], low = 0.5, high
    /// = 3.0 }`. Amounts of fluorophores are `concentrations`. Default: none.
    #[serde(default)]
    pub vary: BTreeMap<String, TextureReference>,
    /// The wet surface; its refractive index is that of the tissue. Default: that index, roughness 0.2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gloss: Option<GlossSection>,
    /// Factor on what the tissue holds of each fluorophore, 0 or more. Default: 1.
    #[serde(default)]
    pub concentrations: BTreeMap<String, TextureReference>,
}
