//! Parametric anatomy: meshes with named parts, texture coordinates and poses. Nothing here knows of light.
//!
//! # The frame of the mouth
//! Meters. The origin is halfway between the edges of the upper and the lower central incisors; +z points out of the
//! mouth toward the camera, +y up toward the nose, +x to the patient's left (the right of an image of the patient).
//! A camera at 10 cm stands at z = 0.10 m and looks to -z. Triangles are counter-clockwise seen from the side that
//! can be seen: the inside for the walls of the cavity.
//!
//! # Sources
//! Crown sizes: Wheeler's table. Leans of the crowns to the midline: Andrews (1989). Arches: the beta function of Braun and
//! others (1998). Opening, lips, palate and tongue: the ranges stated with each field of [`MouthParameters`]. Papillae of
//! gums and tongue: Chu (2009), Witt (2020). Cusps, leans of the teeth to the outside and the shapes of the soft parts and
//! of the face are drawn after textbook figures (assumed).

mod appearance;
mod cache;
mod cavity;
mod clearance;
mod dental_arch;
mod dimensions;
mod fauces;
mod floor;
mod gingiva;
mod math;
mod mouth;
mod mouth_bytes;
mod noise;
mod palate;
mod parameters;
mod penetration;
mod people;
mod porphyrin_ramp;
mod restoration;
mod surface;
mod teeth;
#[cfg(test)]
mod tests;
mod tongue;
mod views;

pub use appearance::{SurfaceMap, bake_surface_map, surface_map};
pub use cache::{BakedMap, shared_mouth, shared_surface_map};
pub use dental_arch::{TOOTH_KINDS, tooth_kind};
pub use dimensions::MouthDimensions;
pub use mouth::{Mouth, Part, Tissue, generate_mouth};
pub use parameters::{MouthParameters, POSE_FIELDS, ParameterError};
pub use penetration::Penetration;
pub use people::{BOLTON_RANGE, DrawnRestoration, sample_person, sample_restorations};
pub use porphyrin_ramp::PorphyrinRamp;
pub use restoration::{RestoredSurfaces, restored};
pub use views::{EXAMINATION_VIEWS, ExaminationView, POSES};
