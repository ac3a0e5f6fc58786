//! Layered tissue.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
