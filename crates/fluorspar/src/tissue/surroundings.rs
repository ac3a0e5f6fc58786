//! What reaches a site of a mouth by way of other surfaces.

use serde::{Deserialize, Serialize};

/// Light on and from a site of a mouth that came by way of other surfaces, as far as it is known before anything is measured:
/// log-normal, each as its median and the standard deviation of its logarithm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surroundings {
    /// Light that tissue reflects once more before it leaves, over the reflectance of the tissue.
    pub indirect: [f64; 2],
    /// Light of teeth on the site over that which teeth give off under the same light.
    pub teeth: [f64; 2],
    /// Where the numbers come from.
    pub source: String,
    /// Whether they are assumed rather than taken from rendered mouths.
    pub assumed: bool,
}
