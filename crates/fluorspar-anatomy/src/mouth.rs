//! The mouth: its parts, with names and tissues, made in the order in which they give way to each other.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::clearance::Obstacles;
use super::dental_arch::{Arch, Jaw, JawPose, jaw_poses};
use super::fauces::Fauces;
use super::palate::Palate;
use super::tongue::Tongue;
use super::{
    MouthDimensions, MouthParameters, ParameterError, Penetration, cavity, dimensions, floor, gingiva,
    penetration, surface, teeth,
};
use fluorspar::geometry::TriangleMesh;

/// Tissue of a part, which selects its material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Tissue {
    /// Back of the tongue, keratinized, with papillae; where porphyrins are found.
    TongueDorsum,
    /// Underside of the tongue, thin smooth mucosa.
    TongueVentral,
    /// Gums.
    Gingiva,
    /// Crowns of teeth.
    Tooth,
    /// Keratinized mucosa over bone.
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

impl Tissue {
    /// Every tissue.
    pub const ALL: [Self; 11] = [
        Self::TongueDorsum,
        Self::TongueVentral,
        Self::Gingiva,
        Self::Tooth,
        Self::HardPalate,
        Self::SoftPalate,
        Self::Throat,
        Self::FloorOfMouth,
        Self::Cheek,
        Self::Lip,
        Self::Skin,
    ];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::TongueDorsum => "tongue_dorsum",
            Self::TongueVentral => "tongue_ventral",
            Self::Gingiva => "gingiva",
            Self::Tooth => "tooth",
            Self::HardPalate => "hard_palate",
            Self::SoftPalate => "soft_palate",
            Self::Throat => "throat",
            Self::FloorOfMouth => "floor_of_mouth",
            Self::Cheek => "cheek",
            Self::Lip => "lip",
            Self::Skin => "skin",
        }
    }
}

/// One named surface of a mouth.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Unique name: `tongue_dorsum`, `upper_gingiva`, `tooth_11` (FDI numbers), ...
    pub name: String,
    /// Its tissue.
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

    /// Places where a part penetrates another by more than `tolerance_mm`, the deepest first, one for every pair of parts;
    /// places where they grow together (teeth in gums, the root of the tongue, the folds) do not count. Looks at every
    /// `stride`-th vertex.
    pub fn penetrations(&self, tolerance_mm: f64, stride: usize) -> Vec<Penetration> {
        penetration::penetrations(self, tolerance_mm, stride)
    }

    /// Dimensions measured on the meshes, to check them against the parameters.
    pub fn dimensions(&self) -> MouthDimensions {
        dimensions::measure(self)
    }
}

/// Makes a mouth. The same parameters give the same bits on every platform and for any number of threads.
///
/// # Errors
/// A parameter out of its range, see [`MouthParameters::validate`].
pub fn generate_mouth(parameters: &MouthParameters) -> Result<Mouth, ParameterError> {
    parameters.validate()?;
    let (upper_pose, lower_pose) = jaw_poses(parameters);
    let (upper, lower) = (Arch::new(parameters, Jaw::Upper), Arch::new(parameters, Jaw::Lower));
    let poses = (&upper_pose, &lower_pose);
    let arches = (&upper, &lower);
    // What is soft gives way to what is hard, in this order: teeth and bone, cheeks and lips, palate, tongue. Contacts
    // are found on coarse meshes, so that they do not depend on the level of detail.
    let coarse = MouthParameters { detail: 0.5 * parameters.detail.clamp(0.7, 1.0), ..parameters.clone() };
    let palate = Palate::new(parameters, &upper);
    let hard = hard_parts(&coarse, &palate, arches, poses);
    let sheet = cavity::Sheet::new(parameters, &Obstacles::new(hard.iter().map(|part| &part.mesh)));
    let mut around = hard;
    around.extend(fauces_parts(&Fauces::new(&coarse, &palate, &upper_pose)));
    around.extend(sheet.parts(coarse.detail));
    let around = Obstacles::new(around.iter().map(|part| &part.mesh));
    let incisors_z = lower_pose.point(lower.incisors_edge()).z;
    let tongue = Tongue::new(parameters, &lower_pose, incisors_z, &around);

    let mut parts = tongue_parts(&tongue);
    let frenulum = tongue.frenulum_mesh(floor::frenulum_foot(parameters, &lower, &lower_pose));
    parts.push(part("frenulum", Tissue::FloorOfMouth, frenulum));
    let floor = floor::floor_mesh(parameters, &lower, &lower_pose);
    parts.push(part("floor_of_mouth", Tissue::FloorOfMouth, floor));
    parts.extend(fauces_parts(&Fauces::new(parameters, &palate, &upper_pose)));
    parts.extend(sheet.parts(parameters.detail));
    parts.extend(hard_parts(parameters, &palate, arches, poses));
    surface::smooth_normals(&mut parts);
    Ok(Mouth { parts })
}

fn tongue_parts(tongue: &Tongue<'_>) -> Vec<Part> {
    let back = tongue.back_meshes().into_iter();
    let mut parts: Vec<Part> = back.map(|(name, mesh)| part(name, Tissue::TongueDorsum, mesh)).collect();
    parts.push(part("tongue_ventral", Tissue::TongueVentral, tongue.ventral_mesh()));
    parts
}

fn part(name: &str, tissue: Tissue, mesh: TriangleMesh) -> Part {
    Part { name: name.to_owned(), tissue, mesh }
}

/// Gums, hard palate and teeth.
fn hard_parts(
    p: &MouthParameters,
    palate: &Palate<'_>,
    arches: (&Arch, &Arch),
    poses: (&JawPose, &JawPose),
) -> Vec<Part> {
    let gums = [("upper_gingiva", arches.0, poses.0, 0), ("lower_gingiva", arches.1, poses.1, 0x100)];
    let mut parts: Vec<Part> = gums
        .into_iter()
        .map(|(name, arch, pose, salt)| {
            part(name, Tissue::Gingiva, gingiva::gingiva_mesh(arch, pose, p.seed ^ salt, p.detail))
        })
        .collect();
    parts.push(part("hard_palate", Tissue::HardPalate, palate.mesh(poses.0, p.detail)));
    let mut teeth: Vec<Part> = [(arches.0, poses.0), (arches.1, poses.1)]
        .into_iter()
        .flat_map(|(arch, pose)| {
            arch.teeth.iter().filter(|tooth| tooth.present).map(move |tooth| (tooth, pose))
        })
        .map(|(tooth, pose)| {
            let mesh = teeth::tooth_mesh(tooth, pose, p.seed, p.detail);
            part(&format!("tooth_{}", tooth.number), Tissue::Tooth, mesh)
        })
        .collect();
    teeth.sort_by(|a, b| a.name.cmp(&b.name));
    parts.extend(teeth);
    parts
}

fn fauces_parts(fauces: &Fauces<'_>) -> Vec<Part> {
    let mut parts: Vec<Part> =
        fauces.velum_meshes().into_iter().map(|(name, mesh)| part(name, Tissue::SoftPalate, mesh)).collect();
    parts.push(part("uvula", Tissue::SoftPalate, fauces.uvula_mesh()));
    for (name, side) in [("right", -1.0), ("left", 1.0)] {
        let arch = fauces.hind_arch_mesh(side);
        parts.push(part(&format!("palatopharyngeal_arch_{name}"), Tissue::SoftPalate, arch));
        parts.push(part(&format!("tonsil_{name}"), Tissue::Throat, fauces.tonsil_mesh(side)));
    }
    parts
}
