//! Regions of the sensor, and targets that shall be told from what lies around them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::FilePath;

/// A rectangle of the sensor, [column, row, width, height], or a table of parts and shapes, such as { mask = "spot.png" }.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(extend("x-merge" = "replace"))]
pub enum RegionReference {
    /// Column, row, width, height.
    Rectangle([u32; 4]),
    /// Parts and shapes.
    Shapes(SensorRegionSection),
}

/// A region of the sensor: where all that is given holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorRegionSection {
    /// Parts of the scene, by object name. Default: all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<String>,
    /// Only pixels of this rectangle of the sensor: column, row, width, height. Default: none.
    pub rectangle_px: Option<[u32; 4]>,
    /// Only pixels whose center lies in this polygon: corners [x, y] in pixels of the raw image, x to the right and y downward from its
    /// upper left corner. Default: none.
    pub polygon_px: Option<Vec<[f64; 2]>>,
    /// Only pixels of this mask, an image of the size of the raw image: PNG, TIFF or NumPy, where not zero is inside. Default: none.
    pub mask: Option<FilePath>,
}

/// Something that shall be seen: a lesion of the mouth, parts of the scene, or a shape on the sensor. The analysis tells how well. Every
/// `[[mouth.lesion]]` is a target already.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct TargetSection {
    /// Name, unique among targets.
    pub name: String,
    /// Name of a `[[mouth.lesion]]`, where the target is one. Default: none.
    pub lesion: Option<String>,
    /// Where it lies, where it is no lesion.
    #[serde(flatten)]
    pub place: SensorRegionSection,
    /// What the target is told from. Default: a ring around it, of about its area, two pixels away; of a lesion on its own part.
    pub background: Option<RegionReference>,
}

impl SensorRegionSection {
    /// Whether it has a shape on the sensor.
    pub(crate) fn has_shape(&self) -> bool {
        self.rectangle_px.is_some() || self.polygon_px.is_some() || self.mask.is_some()
    }
}
