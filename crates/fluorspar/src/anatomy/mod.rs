//! Parametric anatomy: meshes with named parts, texture coordinates and poses. Nothing here knows of light.
//!
//! # The frame of the mouth
//! Metres. The origin is halfway between the edges of the upper and the lower central incisors; +z points out of the
//! mouth toward the camera, +y up toward the nose, +x to the patient's left (the right of a picture of the patient).
//! A camera at 10 cm stands at z = 0.10 m and looks to -z. Triangles are counter-clockwise seen from the side that
//! can be seen: the inside for the walls of the cavity.
//!
//! # Sources
//! Crown sizes: Wheeler's table. Arches: the beta function of Braun and others (1998). Opening, lips, palate and
//! tongue: the ranges stated with each field of [`MouthParameters`]. Cusps, leans of the teeth and the shapes of the
//! soft parts are drawn after textbook figures (assumed).

mod cavity;
mod dental_arch;
mod dimensions;
mod floor;
mod gingiva;
mod math;
mod noise;
mod palate;
mod parameters;
mod surface;
mod teeth;
#[cfg(test)]
mod tests;
mod tongue;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use dimensions::MouthDimensions;
pub use parameters::{MouthParameters, ParameterError};

use crate::geometry::TriangleMesh;
use dental_arch::{Arch, Jaw, jaw_poses};
use tongue::Tongue;

/// What a part consists of, to choose its material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Tissue {
    /// Back of the tongue, keratinised, with papillae; where porphyrins are found.
    TongueDorsum,
    /// Underside of the tongue, thin smooth mucosa.
    TongueVentral,
    /// Gums.
    Gingiva,
    /// Crowns of teeth.
    Tooth,
    /// Keratinised mucosa over bone.
    HardPalate,
    /// Soft palate and uvula.
    SoftPalate,
    /// Walls of the pharynx.
    Throat,
    /// Floor of the mouth under the tongue.
    FloorOfMouth,
    /// Lining of the cheeks and of the vestibule.
    Cheek,
    /// Red of the lips and their inner side.
    Lip,
    /// Facial skin.
    Skin,
}

/// One named surface of a mouth.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Unique name: `tongue_dorsum`, `upper_gingiva`, `tooth_11` (FDI numbers), ...
    pub name: String,
    /// What it consists of.
    pub tissue: Tissue,
    /// Its surface in the frame of the mouth, with smooth normals and texture coordinates.
    pub mesh: TriangleMesh,
}

/// A generated mouth.
#[derive(Clone, Debug, PartialEq)]
pub struct Mouth {
    /// Its parts, in a fixed order.
    pub parts: Vec<Part>,
}

impl Mouth {
    /// The part of this name.
    pub fn part(&self, name: &str) -> Option<&Part> {
        self.parts.iter().find(|part| part.name == name)
    }

    /// Triangles in all parts.
    pub fn triangle_count(&self) -> usize {
        self.parts.iter().map(|part| part.mesh.triangles.len()).sum()
    }

    /// Dimensions measured on the meshes, to check them against the parameters.
    pub fn dimensions(&self) -> MouthDimensions {
        dimensions::measure(self)
    }
}

/// Makes a mouth. The same parameters give the same bits on every platform.
///
/// # Errors
/// A parameter out of its range, see [`MouthParameters::validate`].
pub fn generate_mouth(parameters: &MouthParameters) -> Result<Mouth, ParameterError> {
    parameters.validate()?;
    let (upper_pose, lower_pose) = jaw_poses(parameters);
    let upper = Arch::new(parameters, Jaw::Upper);
    let lower = Arch::new(parameters, Jaw::Lower);
    let (seed, detail) = (parameters.seed, parameters.detail);
    let part = |name: &str, tissue, mesh| Part { name: name.to_owned(), tissue, mesh };
    let tongue = Tongue::new(parameters, &lower, &lower_pose);
    let mut parts = vec![
        part("tongue_dorsum", Tissue::TongueDorsum, tongue.dorsum_mesh()),
        part("tongue_ventral", Tissue::TongueVentral, tongue.ventral_mesh()),
        part("upper_gingiva", Tissue::Gingiva, gingiva::gingiva_mesh(&upper, &upper_pose, seed, detail)),
        part(
            "lower_gingiva",
            Tissue::Gingiva,
            gingiva::gingiva_mesh(&lower, &lower_pose, seed ^ 0x100, detail),
        ),
        part("hard_palate", Tissue::HardPalate, palate::hard_palate_mesh(parameters, &upper, &upper_pose)),
        part("soft_palate", Tissue::SoftPalate, palate::soft_palate_mesh(parameters, &upper, &upper_pose)),
        part("floor_of_mouth", Tissue::FloorOfMouth, floor::floor_mesh(parameters, &lower, &lower_pose)),
    ];
    parts.extend(cavity::cavity_parts(parameters));
    let mut teeth: Vec<Part> = Vec::new();
    for (arch, pose) in [(&upper, &upper_pose), (&lower, &lower_pose)] {
        for tooth in arch.teeth.iter().filter(|tooth| tooth.present) {
            let mesh = teeth::tooth_mesh(tooth, pose, seed, detail);
            teeth.push(part(&format!("tooth_{}", tooth.number), Tissue::Tooth, mesh));
        }
    }
    teeth.sort_by(|a, b| a.name.cmp(&b.name));
    parts.extend(teeth);
    surface::smooth_normals(&mut parts);
    Ok(Mouth { parts })
}
