//! Factors on concentrations.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::FilePath;

/// A factor on all concentrations of a fluorophore, or a mask that is painted on a finished render, such as { mask = "patch.png",
/// inside = 3.0 }.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(extend("x-merge" = "replace"))]
pub enum ConcentrationFactor {
    /// Factor, 0 to 1e6: on every material of the scene.
    Even(f64),
    /// Factors inside and outside of a mask.
    Painted(PaintedMask),
}

/// A mask over the rendered image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PaintedMask {
    /// Gray or RGB PNG of the proportions of the render, of any size: 1 where it is white, 0 where it is black; values between
    /// mix. Of RGB the brightest channel counts.
    pub mask: FilePath,
    /// Factor inside, 0 to 1e6.
    pub inside: f64,
    /// Factor outside, 0 to 1e6. Default 1.
    #[serde(default = "unchanged")]
    pub outside: f64,
}

defaults! {
    unchanged: f64 = 1.0;
}
