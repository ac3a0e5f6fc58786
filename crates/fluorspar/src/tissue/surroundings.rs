//! What reaches a site of a mouth by way of other surfaces.

use serde::Serialize;

/// Light on and from a site of a mouth that came by way of other surfaces, as far as it is known before anything is measured:
/// log-normal, each as its median and the standard deviation of its logarithm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Surroundings {
    /// Light that tissue reflects once more before it leaves, over the reflectance of the tissue.
    pub indirect: [f64; 2],
    /// Light of teeth on the site over that which teeth give off under the same light.
    pub teeth: [f64; 2],
    /// Where the numbers come from.
    pub source: &'static str,
    /// Whether they are assumed rather than taken from rendered mouths.
    pub assumed: bool,
}

/// The spread is wider than among those mouths (log sd 0.1 to 0.35), which share a pose.
const RENDERED: &str =
    "medians of the site in twenty rendered mouths, rounded; the spread is assumed, wider than theirs";

pub(super) const TONGUE: Surroundings =
    Surroundings { indirect: [0.17, 0.4], teeth: [0.055, 0.5], source: RENDERED, assumed: false };
pub(super) const LIP: Surroundings =
    Surroundings { indirect: [0.08, 0.5], teeth: [0.01, 0.6], source: RENDERED, assumed: false };
pub(super) const CHEEK: Surroundings =
    Surroundings { indirect: [0.4, 0.4], teeth: [0.04, 0.5], source: RENDERED, assumed: false };
pub(super) const ELSEWHERE: Surroundings = Surroundings {
    indirect: [0.25, 0.6],
    teeth: [0.04, 0.9],
    source: "between the sites that were rendered",
    assumed: true,
};
