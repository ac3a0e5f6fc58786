//! Layered tissues of a scene.

use crate::tissue::LayeredTissue;

/// A layered tissue of a scene. The image knows it by its material; this is what it is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyTissue {
    /// Name of its material.
    pub name: String,
    /// Names of the objects that are made of it.
    pub parts: Vec<String>,
    /// Its layers, in the mean state over these objects.
    pub tissue: LayeredTissue,
}
