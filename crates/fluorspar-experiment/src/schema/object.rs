//! Surfaces: meshes, analytic shapes and the mouth.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{FilePath, SpectrumReference, TextureReference};
use fluorspar_anatomy::MouthParameters;

/// The shapes of objects, each with its fields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum ShapeSection {
    /// A mesh from a file.
    Mesh(MeshShape),
    /// A sphere.
    Sphere(SphereShape),
    /// A parallelogram.
    Quad(QuadShape),
    /// A flat disc.
    Disc(DiscShape),
    /// A box.
    Box(BoxShape),
}

/// A mesh from a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct MeshShape {
    /// Path of a .ply, .stl, .obj, .gltf or .glb file.
    pub file: FilePath,
    /// Length of one unit of the file, mm; 1000 for meters. Default 1.
    #[serde(default = "one_millimeter")]
    pub unit_mm: f64,
    /// Relief of the surface. Default: none.
    pub displacement: Option<DisplacementSection>,
    /// Its placements, if there are several.
    #[serde(flatten)]
    pub places: PlacesSection,
}

/// A sphere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereShape {
    /// Center, mm. Default [0, 0, 0].
    #[serde(default)]
    pub center_mm: [f64; 3],
    /// Radius, mm, above 0.
    pub radius_mm: f64,
}

/// A parallelogram that faces `edge_u × edge_v`; texture coordinates run along the edges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct QuadShape {
    /// One corner, mm.
    pub corner_mm: [f64; 3],
    /// First edge from the corner, mm.
    pub edge_u_mm: [f64; 3],
    /// Second edge from the corner, mm.
    pub edge_v_mm: [f64; 3],
    /// Relief of the surface. Default: none.
    pub displacement: Option<DisplacementSection>,
    /// Its placements, if there are several.
    #[serde(flatten)]
    pub places: PlacesSection,
}

/// A flat disc; texture coordinates span its bounding square.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DiscShape {
    /// Center, mm. Default [0, 0, 0].
    #[serde(default)]
    pub center_mm: [f64; 3],
    /// Direction that it faces, of any length. Default [0, 0, 1].
    #[serde(default = "toward_camera")]
    pub normal: [f64; 3],
    /// Radius, mm, above 0.
    pub radius_mm: f64,
}

fn toward_camera() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

/// An axis-parallel box; texture coordinates span every face.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct BoxShape {
    /// Center, mm. Default [0, 0, 0].
    #[serde(default)]
    pub center_mm: [f64; 3],
    /// Lengths of the edges, mm, above 0.
    pub size_mm: [f64; 3],
    /// Its placements, if there are several.
    #[serde(flatten)]
    pub places: PlacesSection,
}

/// Places of one mesh, which is kept once.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PlacesSection {
    /// Places, before `transform` moves them all. Default: one, as given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub instance: Vec<InstanceSection>,
    /// Path of a .csv, .txt or .npy file of more places: twelve numbers each, the three rows of `matrix`.
    pub instance_file: Option<FilePath>,
}

/// Scales, then turns, then moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TransformSection {
    /// Displacement, mm. Default [0, 0, 0].
    pub translate_mm: [f64; 3],
    /// Turns about the x, then the y, then the z axis, degrees. Default [0, 0, 0].
    pub rotate_deg: [f64; 3],
    /// Turn about `axis` by `angle_deg`, applied after `rotate_deg`: the axis, of any length. Default: none.
    pub axis: Option<[f64; 3]>,
    /// Angle of the turn about `axis`, degrees.
    pub angle_deg: Option<f64>,
    /// Factor on all lengths, above 0. Default 1.
    pub scale: f64,
}

impl Default for TransformSection {
    fn default() -> Self {
        Self { translate_mm: [0.0; 3], rotate_deg: [0.0; 3], axis: None, angle_deg: None, scale: 1.0 }
    }
}

/// A place of a mesh: stretches, scales, turns, then moves; or a matrix.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InstanceSection {
    /// Factors along the axes of the mesh, none 0; negative ones mirror. Default [1, 1, 1].
    pub stretch: [f64; 3],
    /// Factor on all lengths, above 0. Default 1.
    pub scale: f64,
    /// Turns about the x, then the y, then the z axis, degrees. Default [0, 0, 0].
    pub rotate_deg: [f64; 3],
    /// Turn about `axis` by `angle_deg`, applied after `rotate_deg`: the axis, of any length. Default: none.
    pub axis: Option<[f64; 3]>,
    /// Angle of the turn about `axis`, degrees.
    pub angle_deg: Option<f64>,
    /// Displacement, mm. Default [0, 0, 0].
    pub translate_mm: [f64; 3],
    /// Any affine map instead of all these: three rows of four numbers, the last of each a displacement in mm.
    pub matrix: Option<[[f64; 4]; 3]>,
    /// Part of the image that it belongs to; instances of one name are one part. Default: the name of the object.
    pub part: Option<String>,
    /// Material of its part, the same for all instances of the part. Default: that of the object.
    pub material: Option<String>,
}

impl Default for InstanceSection {
    fn default() -> Self {
        Self {
            stretch: [1.0; 3],
            scale: 1.0,
            rotate_deg: [0.0; 3],
            axis: None,
            angle_deg: None,
            translate_mm: [0.0; 3],
            matrix: None,
            part: None,
            material: None,
        }
    }
}

/// A surface moved along its normals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DisplacementSection {
    /// Height over texture coordinates, in units of `amount_mm`: a map of values from 0 to 1.
    pub map: TextureReference,
    /// Height of the value 1, mm, outward; -100 to 100.
    pub amount_mm: f64,
    /// How often every triangle is split into four before, 0 to 8. Default 0.
    #[serde(default)]
    pub subdivisions: u32,
}

/// Light that a surface emits by itself, evenly in all directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EmissionSection {
    /// Light group that it belongs to.
    pub group: String,
    /// Relative spectral power: its scale does not matter.
    pub spectrum: SpectrumReference,
    /// Radiance over 200 to 1200 nm, W/(sr m²), above 0.
    pub radiance_w_per_sr_m2: f64,
    /// Sides that emit: `"both"`, or `"front"`, that of the geometric normal; the outside of spheres and boxes. The surface
    /// reflects on both. Default "both".
    #[serde(default, skip_serializing_if = "EmissionSides::is_both")]
    pub sides: EmissionSides,
}

/// Sides of a surface that emit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EmissionSides {
    /// Both.
    #[default]
    Both,
    /// That of the geometric normal.
    Front,
}

impl EmissionSides {
    fn is_both(&self) -> bool {
        *self == Self::Both
    }
}

/// A named surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[schemars(extend("x-renamed" = {
    "mesh": "type = \"mesh\" and file = \"...\"",
    "sphere": "type = \"sphere\" and its fields in the object itself",
    "quad": "type = \"quad\" and its fields in the object itself",
    "disc": "type = \"disc\" and its fields in the object itself",
    "box": "type = \"box\" and its fields in the object itself"
}))]
pub struct ObjectSection {
    /// Name, unique among objects and parts of the mouth.
    pub name: String,
    /// Name of its material.
    pub material: String,
    /// Its placement. Default: as given.
    pub transform: Option<TransformSection>,
    /// Light that it emits. Default: none.
    pub emission: Option<EmissionSection>,
    /// Its shape.
    #[serde(flatten)]
    pub shape: ShapeSection,
}

/// A spot on a part of the mouth with its own color and fluorophores: an ellipse, or a painted mask.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LesionSection {
    /// Name, unique among lesions.
    pub name: String,
    /// Part that it is on: `tongue_dorsum`, `cheek_left`, ...
    pub part: String,
    /// Middle of the ellipse in texture coordinates of the part, 0 to 1. The parts of the back of the tongue share one map.
    /// Default [0.5, 0.5].
    #[serde(default = "center_of_texture")]
    pub center: [f64; 2],
    /// Lengths of the axes of the ellipse, mm, 0.1 to 200. Default [8, 6].
    #[serde(default = "lesion_size")]
    pub size_mm: [f64; 2],
    /// Turn of the first axis from the direction of u toward that of v, degrees. Default 0.
    #[serde(default)]
    pub angle_deg: f64,
    /// Width over which it fades out, mm, 0 or more. Default 1.
    #[serde(default = "lesion_edge")]
    pub edge_mm: f64,
    /// Standard deviation of the distance of its border from the middle over that of the ellipse, 0 to 0.5; the area stays. Default 0.
    pub border_irregularity: Option<f64>,
    /// Number of small spots of the same kind around it, 0 to 50. Default 0.
    pub satellites: Option<u32>,
    /// Seed of border and satellites. Default 0.
    pub seed: Option<u64>,
    /// Path of a gray PNG on the texture coordinates of the part instead of the ellipse: white is inside. Of colors the mean
    /// of red, green and blue is taken, with a warning.
    pub mask: Option<FilePath>,
    /// Reflectance inside. Default: that of the part.
    pub reflectance: Option<SpectrumReference>,
    /// Extra blood above the reflecting layer, as a layer of whole blood of this thickness, µm, 0 to 200; fluorescence stays. Default 0.
    #[serde(default)]
    pub blood_um: f64,
    /// States of layered tissue inside, for instance "dysplasia_moderate". Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub states: Vec<String>,
    /// Factors on parameters of layered tissue inside, for instance `superficial_blood_fraction = 10.0`. Default: none.
    #[serde(default)]
    pub tissue: BTreeMap<String, f64>,
    /// Concentrations inside, in the unit of the catalogue, or as factors on what layered tissue holds; fluorophores that are not named stay as they are around.
    #[serde(default)]
    pub concentrations: BTreeMap<String, f64>,
}

fn center_of_texture() -> [f64; 2] {
    [0.5, 0.5]
}

fn lesion_size() -> [f64; 2] {
    [8.0, 6.0]
}

/// A mesh of one's own in place of parts of the mouth, for instance an intraoral scan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScanSection {
    /// Name of the new part.
    pub name: String,
    /// Path of a .ply, .stl, .obj, .gltf or .glb file.
    pub mesh: FilePath,
    /// Parts that it replaces; `tooth_*` stands for all whose names begin so. Default: none.
    #[serde(default)]
    pub replaces: Vec<String>,
    /// Name of its material.
    pub material: String,
    /// Length of one unit of the file, mm; 1000 for meters. Default 1.
    pub unit_mm: Option<f64>,
    /// Its placement in the frame of the mouth. Default: as given.
    pub transform: Option<TransformSection>,
}

/// A filling or an artificial crown on a tooth, a part of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RestorationSection {
    /// Name of the new part.
    pub name: String,
    /// FDI number of the tooth.
    pub tooth: u8,
    /// Its surfaces that are restored, by their letters: m mesial, o occlusal (i incisal), d distal, b buccal (f facial), l lingual (p
    /// palatal); "mobdl" is a crown.
    pub surfaces: String,
    /// Name of its material.
    pub material: String,
}

/// A parametric mouth. Its frame: origin between the incisors, +z out of the mouth, +y up, +x to the patient's left.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MouthSection {
    /// Material of each tissue (`tongue_dorsum`, `gingiva`, `tooth`, ...), of a kind of teeth (`incisor`, `canine`, `premolar`,
    /// `molar`) or of a single part (`tooth_11`, `upper_gingiva`, ...). Default: the material that has the name of the tissue.
    #[serde(default)]
    pub materials: BTreeMap<String, String>,
    /// Spots, sores and stains on the parts. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lesion: Vec<LesionSection>,
    /// Own scans in place of parts. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scan: Vec<ScanSection>,
    /// Fillings and artificial crowns. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub restoration: Vec<RestorationSection>,
    /// Placement of the mouth. Default: in its own frame.
    pub transform: Option<TransformSection>,
    /// Name of a view of `fluorspar mouth view --list`, such as "tongue-out": pose of jaw, tongue and lips (drawn apart as by
    /// retractors) and place of the camera, as far as this file does not give them. Default: none.
    pub view: Option<String>,
    /// Number of a person of `fluorspar mouth sample`, 1 to 4 000 000 000: shape of mouth and teeth, as far as this file does not give
    /// it, fillings, and tissues, which vary around those of this file. Default: none.
    pub person: Option<u32>,
    /// Shape and pose.
    #[serde(flatten)]
    pub parameters: MouthParameters,
}

defaults! {
    one_millimeter: f64 = 1.0;
    lesion_edge: f64 = 1.0;
}
