//! What shall be seen, and what it is told from.

use std::sync::Arc;

use crate::analysis::RegionOfInterest;
use crate::material::ImageTexture;

/// A target: something that frames shall tell from what lies around it.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// Name.
    pub name: String,
    /// Where it is.
    pub place: TargetPlace,
    /// What it is told from; `None` for a ring around it.
    pub background: Option<RegionOfInterest>,
}

impl Target {
    /// Most targets of an analysis, for which the image of labels has numbers.
    pub const MOST: usize = u8::MAX as usize;
}

/// Where a target is.
#[derive(Clone, Debug, PartialEq)]
pub enum TargetPlace {
    /// Pixels of the sensor.
    Region(RegionOfInterest),
    /// A spot on surfaces of the scene, on each of these parts where the map of its texture coordinates is at least one half.
    Spot(Vec<(String, Arc<ImageTexture>)>),
}
