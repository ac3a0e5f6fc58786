//! glTF 2.0 meshes, as text (.gltf) and binary (.glb).

use std::cell::Cell;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use base64::Engine;
use base64::engine::general_purpose::STANDARD_PAD_INDIFFERENT;
use glam::{Affine3, Affine3A, Mat4, Quat, Vec2, Vec3};
use percent_encoding::percent_decode_str;
use serde_json::{Value, json};

use super::mesh_set::{self, NamedMesh, check};
use super::ply::finish_mesh;
use crate::FormatError;
use crate::store::file::{MAX_MESH_BYTES, guarded, read_file};
use crate::store::output::write_atomically;
use fluorspar::geometry::{MeshInstance, MeshInstances, TriangleMesh};
use fluorspar::quote::excerpt;
use fluorspar::units::LUMINOUS_EFFICACY_LM_PER_W;

const MAGIC: &[u8; 4] = b"glTF";
const JSON_CHUNK: u32 = 0x4E4F_534A;
const BINARY_CHUNK: u32 = 0x004E_4942;
/// Deepest tree of nodes.
const MAX_DEPTH: usize = 64;

/// Most places of meshes.
const MAX_PLACES: usize = 1 << 27;
/// Most triangles, and most vertices, of a file of which all instances become one mesh: more than a scene may have.
const MAX_FLATTENED: u64 = 1 << 25;
/// Elements of accessors that any file may name, those named several times counted as often; large files may name more.
const USUAL_ELEMENTS: u64 = 1 << 25;
/// Elements that a file may name per byte of its buffers.
const ELEMENTS_PER_BYTE: u64 = 4;

/// Reads all triangles of the scene of a glTF file as one mesh, with the transforms of its nodes. Positions, normals
/// and the first texture coordinates are read; materials, skins and morphs are passed over. Buffers may be in the file
/// (.glb, or `data:` URIs in base64) or in files next to it; compressed ones are not supported.
///
/// `unit_m` is the length of one unit of the file, m. The format defines meters (1), but scanners write millimeters
/// (0.001) all the same.
///
/// # Errors
/// Anything that is not such a file; nodes that are no tree.
pub fn read_gltf(path: &Path, unit_m: f64) -> Result<TriangleMesh, FormatError> {
    let content = read_content(path)?;
    for (what, count) in [
        ("triangles", content.placed(|part| part.triangles.len())),
        ("vertices", content.placed(|part| part.positions.len())),
    ] {
        if count > MAX_FLATTENED {
            return Err(FormatError::too_large(
                path,
                format!("its nodes place {count} {what} in all"),
                format!("{MAX_FLATTENED} as one mesh"),
            ));
        }
    }
    finish_mesh(path, content.flattened(), unit_m)
}

/// Reads a glTF file as [`read_gltf`] does, but keeps instanced meshes once: meshes that several
/// nodes name, and those of nodes with the extension EXT_mesh_gpu_instancing. A file without such meshes gives one mesh at
/// one place.
///
/// # Errors
/// As [`read_gltf`]; and places that flatten a mesh.
pub fn read_gltf_instances(path: &Path, unit_m: f64) -> Result<MeshInstances, FormatError> {
    let content = read_content(path)?;
    let mut used: Vec<usize> = content.places.iter().map(|(mesh, _)| *mesh).collect();
    used.sort_unstable();
    if used.windows(2).all(|pair| pair[0] != pair[1]) {
        let mesh = Arc::new(finish_mesh(path, content.flattened(), unit_m)?);
        let instances = vec![MeshInstance { mesh: 0, to_world: Affine3::IDENTITY }];
        return Ok(MeshInstances { meshes: vec![mesh], instances });
    }
    used.dedup();
    let meshes = used
        .iter()
        .map(|&mesh| {
            let mut whole = TriangleMesh::default();
            content.meshes[mesh].iter().for_each(|part| whole.append(part));
            drop_partial_normals(&mut whole);
            finish_mesh(path, whole, unit_m).map(Arc::new)
        })
        .collect::<Result<Vec<_>, _>>()?;
    let instances = content.places.iter().map(|(mesh, transform)| MeshInstance {
        mesh: used.partition_point(|other| other < mesh) as u32,
        to_world: Affine3 {
            matrix3: transform.matrix3.into(),
            translation: Vec3::from(transform.translation) * unit_m as f32,
        },
    });
    let many = MeshInstances { meshes, instances: instances.collect() };
    many.validate().map_err(|error| broken(path, format!("its nodes are damaged: {error}")))?;
    Ok(many)
}

/// Meshes of a file by number, each as its parts, and their placements; in units of the file.
struct FileContent {
    meshes: Vec<Vec<TriangleMesh>>,
    places: Vec<(usize, Affine3A)>,
}

impl FileContent {
    /// A number of each part, summed over all places.
    fn placed(&self, number: impl Fn(&TriangleMesh) -> usize) -> u64 {
        let of_mesh = |parts: &Vec<TriangleMesh>| parts.iter().map(|part| number(part) as u64).sum();
        let of_meshes: Vec<u64> = self.meshes.iter().map(of_mesh).collect();
        self.places.iter().fold(0, |sum: u64, (mesh, _)| sum.saturating_add(of_meshes[*mesh]))
    }

    fn flattened(&self) -> TriangleMesh {
        let mut whole = TriangleMesh::default();
        for (mesh, transform) in &self.places {
            for part in &self.meshes[*mesh] {
                let mut part = part.clone();
                part.transform(transform);
                whole.append(&part);
            }
        }
        drop_partial_normals(&mut whole);
        whole
    }
}

/// Attributes that only some primitives have are dropped.
fn drop_partial_normals(mesh: &mut TriangleMesh) {
    if mesh.normals.len() != mesh.positions.len() {
        mesh.normals.clear();
    }
}

fn read_content(path: &Path) -> Result<FileContent, FormatError> {
    let bytes = read_file(path, MAX_MESH_BYTES)?;
    let (text, blob) = if bytes.starts_with(MAGIC) { chunks(path, &bytes)? } else { (&bytes[..], None) };
    let document: Value = serde_json::from_slice(text).map_err(|error| {
        let what = format!("not a valid glTF file: {error}");
        FormatError::at_line(path, error.line() as u64, what, "Export the mesh again")
    })?;
    let buffers = buffers(path, &document, blob)?;
    guarded(path, "glTF", || {
        let bytes: u64 = buffers.iter().map(|buffer| buffer.len() as u64).sum();
        let left = USUAL_ELEMENTS.max(bytes.saturating_mul(ELEMENTS_PER_BYTE));
        let reader = Reader { path, document: &document, buffers: &buffers, elements_left: Cell::new(left) };
        let mut met = vec![false; document["nodes"].as_array().map_or(0, Vec::len)];
        let count = document["meshes"].as_array().map_or(0, Vec::len);
        let mut places = Vec::new();
        let scene = document["scene"].as_u64().unwrap_or(0) as usize;
        match document["scenes"][scene]["nodes"].as_array() {
            Some(roots) => {
                for root in roots {
                    reader.node(root, Affine3A::IDENTITY, 0, &mut met, &mut places)?;
                }
            }
            None => places = (0..count).map(|mesh| (mesh, Affine3A::IDENTITY)).collect(),
        }
        // Nodes that name no mesh of the file place nothing, and meshes without triangles have no surface.
        places.retain(|(mesh, _)| *mesh < count);
        let mut meshes = vec![Vec::new(); count];
        for &(mesh, _) in &places {
            if meshes[mesh].is_empty() {
                meshes[mesh] = reader.mesh(mesh)?;
            }
        }
        places.retain(|(mesh, _)| !meshes[*mesh].is_empty());
        Ok(FileContent { meshes, places })
    })
}

fn broken(path: &Path, what: impl Into<String>) -> FormatError {
    FormatError::malformed(path, what, "Export the mesh again, uncompressed")
}

/// The text and the binary part of a .glb file.
fn chunks<'b>(path: &Path, bytes: &'b [u8]) -> Result<(&'b [u8], Option<&'b [u8]>), FormatError> {
    let word =
        |at: usize| -> Option<u32> { Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?)) };
    let (mut text, mut blob, mut at) = (None, None, 12);
    while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
        let end = (at + 8).saturating_add(length as usize);
        let Some(chunk) = bytes.get(at + 8..end) else {
            return Err(FormatError::malformed(path, "the file ends too early", "Copy the file again"));
        };
        match kind {
            JSON_CHUNK => text = text.or(Some(chunk)),
            BINARY_CHUNK => blob = blob.or(Some(chunk)),
            _ => {}
        }
        at = end.next_multiple_of(4);
    }
    Ok((text.ok_or_else(|| broken(path, "the file has no description of its content"))?, blob))
}

fn buffers(path: &Path, document: &Value, blob: Option<&[u8]>) -> Result<Vec<Vec<u8>>, FormatError> {
    let empty = Vec::new();
    let list = document["buffers"].as_array().unwrap_or(&empty);
    let mut buffers = Vec::with_capacity(list.len());
    for (number, buffer) in list.iter().enumerate() {
        buffers.push(self::buffer(path, number, buffer["uri"].as_str(), blob)?);
    }
    Ok(buffers)
}

/// The content of a buffer: the binary part of the file, a file next to it, or base64 in its URI.
fn buffer(
    path: &Path,
    number: usize,
    uri: Option<&str>,
    blob: Option<&[u8]>,
) -> Result<Vec<u8>, FormatError> {
    let Some(uri) = uri else {
        return match blob {
            Some(blob) if number == 0 => Ok(blob.to_vec()),
            _ => Err(FormatError::malformed(
                path,
                format!("buffer {number} has no content: it has no URI, and there is no binary part for it"),
                "Export the mesh as .glb",
            )),
        };
    };
    if let Some(data) = uri.strip_prefix("data:") {
        let content = data.split_once(";base64,").map(|(_, text)| STANDARD_PAD_INDIFFERENT.decode(text));
        return match content {
            Some(Ok(content)) => Ok(content),
            Some(Err(error)) => Err(broken(path, format!("buffer {number} is not valid base64: {error}"))),
            None => Err(broken(path, format!("buffer {number} is a data URI without base64"))),
        };
    }
    let decoded = percent_decode_str(uri).decode_utf8_lossy();
    let uri = if path.with_file_name(uri).is_file() { uri } else { &*decoded };
    if uri.contains("..") || uri.starts_with(['/', '\\']) || uri.contains(':') {
        let shown = excerpt(uri);
        return Err(broken(path, format!("the file \"{shown}\" of buffer {number} is not next to the file")));
    }
    read_file(&path.with_file_name(uri), MAX_MESH_BYTES).map_err(|error| match error.is_not_found() {
        true => FormatError::malformed(
            path,
            format!("the file \"{}\" of buffer {number} is missing", excerpt(uri)),
            "Put it next to this file, or export the mesh as .glb",
        ),
        false => error,
    })
}

/// Modes of primitives that are surfaces: triangles, and two ways of sharing their corners.
const TRIANGLES: u64 = 4;
const STRIP: u64 = 5;
const FAN: u64 = 6;

fn mode_of(primitive: &Value) -> u64 {
    primitive["mode"].as_u64().unwrap_or(TRIANGLES)
}

/// Triangles of a primitive: glTF 2.0, section 3.7.2.1.
fn triangles_of(mode: u64, indices: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        STRIP => {
            let turned = |(number, t): (usize, &[u32])| match number % 2 {
                0 => [t[0], t[1], t[2]],
                _ => [t[0], t[2], t[1]],
            };
            indices.windows(3).enumerate().map(turned).collect()
        }
        FAN => indices.get(1..).unwrap_or_default().windows(2).map(|t| [t[0], t[1], indices[0]]).collect(),
        _ => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    }
}

struct Reader<'a> {
    path: &'a Path,
    document: &'a Value,
    buffers: &'a [Vec<u8>],
    /// How many elements of accessors may still be named.
    elements_left: Cell<u64>,
}

impl Reader<'_> {
    fn node(
        &self,
        number: &Value,
        above: Affine3A,
        depth: usize,
        met: &mut [bool],
        places: &mut Vec<(usize, Affine3A)>,
    ) -> Result<(), FormatError> {
        let number = number.as_u64().unwrap_or(u64::MAX) as usize;
        let node = &self.document["nodes"][number];
        if !node.is_object() || depth > MAX_DEPTH {
            return Err(broken(self.path, "its tree of nodes is damaged"));
        }
        // Nodes form a strict tree: glTF 2.0, section 3.5.3.
        match met.get_mut(number) {
            Some(met) if !*met => *met = true,
            _ => {
                let what = format!("node {number} appears twice in its tree of nodes");
                return Err(FormatError::malformed(self.path, what, "Give every node one parent"));
            }
        }
        let here = above * transform(node);
        if let Some(mesh) = node["mesh"].as_u64() {
            for own in self.gpu_instances(node)? {
                places.push((mesh as usize, here * own));
            }
            if places.len() > MAX_PLACES {
                return Err(FormatError::too_large(
                    self.path,
                    "the meshes have too many placements",
                    format!("{MAX_PLACES}"),
                ));
            }
        }
        for child in node["children"].as_array().into_iter().flatten() {
            self.node(child, here, depth + 1, met, places)?;
        }
        Ok(())
    }

    /// Places of the mesh of a node within the node: the extension EXT_mesh_gpu_instancing, or the node itself.
    fn gpu_instances(&self, node: &Value) -> Result<Vec<Affine3A>, FormatError> {
        let attributes = &node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
        let values = |name: &str, size: usize| -> Result<Option<Vec<f32>>, FormatError> {
            attributes[name].as_u64().map(|accessor| self.floats(accessor, size)).transpose()
        };
        let (translations, rotations, scales) =
            (values("TRANSLATION", 3)?, values("ROTATION", 4)?, values("SCALE", 3)?);
        let lengths = [(&translations, 3), (&rotations, 4), (&scales, 3)];
        let mut counts = lengths.iter().filter_map(|(list, size)| list.as_ref().map(|l| l.len() / size));
        let Some(count) = counts.next() else { return Ok(vec![Affine3A::IDENTITY]) };
        if counts.any(|other| other != count) {
            return Err(broken(self.path, "the lists of places of a node differ in length"));
        }
        let vector = |list: &Option<Vec<f32>>, number: usize, otherwise: Vec3| {
            list.as_ref().map_or(otherwise, |list| Vec3::from_slice(&list[3 * number..]))
        };
        let place = |number: usize| {
            let turn = rotations
                .as_ref()
                .map_or(Quat::IDENTITY, |list| Quat::from_slice(&list[4 * number..]).normalize());
            let scale = vector(&scales, number, Vec3::ONE);
            Affine3A::from_scale_rotation_translation(scale, turn, vector(&translations, number, Vec3::ZERO))
        };
        Ok((0..count).map(place).collect())
    }

    /// Parts of a mesh.
    fn mesh(&self, number: usize) -> Result<Vec<TriangleMesh>, FormatError> {
        let primitives = self.document["meshes"][number]["primitives"].as_array();
        // Points and lines have no surface
        let is_surface = |primitive: &&Value| mode_of(primitive) >= TRIANGLES;
        let mut parts = Vec::new();
        for primitive in primitives.into_iter().flatten().filter(is_surface) {
            let part = self.primitive(primitive)?;
            if part.triangles.is_empty() {
                continue;
            }
            part.validate().map_err(|error| broken(self.path, format!("a mesh is damaged: {error}")))?;
            parts.push(part);
        }
        Ok(parts)
    }

    /// Triangles of a part of a mesh.
    fn primitive(&self, primitive: &Value) -> Result<TriangleMesh, FormatError> {
        let attributes = &primitive["attributes"];
        let vectors = |name: &str, size: usize| -> Result<Vec<f32>, FormatError> {
            attributes[name].as_u64().map_or(Ok(Vec::new()), |accessor| self.floats(accessor, size))
        };
        let positions: Vec<Vec3> = vectors("POSITION", 3)?.chunks_exact(3).map(Vec3::from_slice).collect();
        let normals = vectors("NORMAL", 3)?.chunks_exact(3).map(Vec3::from_slice).collect();
        // Its v runs downward.
        let uvs = vectors("TEXCOORD_0", 2)?.chunks_exact(2).map(|c| Vec2::new(c[0], 1.0 - c[1])).collect();
        let indices = match primitive["indices"].as_u64() {
            Some(accessor) => self.whole_numbers(accessor)?,
            None => (0..positions.len() as u32).collect(),
        };
        let triangles = triangles_of(mode_of(primitive), &indices);
        Ok(TriangleMesh { positions, normals, uvs, triangles })
    }

    /// Bytes of the elements of an accessor, its component type and their number.
    fn elements(&self, accessor: u64, size: usize) -> Result<(Vec<&[u8]>, u64), FormatError> {
        let damaged = || broken(self.path, format!("accessor {accessor} is damaged or compressed"));
        let entry = &self.document["accessors"][accessor as usize];
        if entry["sparse"].is_object() {
            let what = format!("accessor {accessor} is sparse");
            return Err(FormatError::unsupported(
                self.path,
                what,
                "Export the mesh without sparse accessors",
            ));
        }
        let view = &self.document["bufferViews"][entry["bufferView"].as_u64().ok_or_else(damaged)? as usize];
        let kind = entry["componentType"].as_u64().ok_or_else(damaged)?;
        let width = size
            * match kind {
                5120 | 5121 => 1,
                5122 | 5123 => 2,
                5125 | 5126 => 4,
                _ => return Err(damaged()),
            };
        let buffer = self.buffers.get(view["buffer"].as_u64().unwrap_or(0) as usize).ok_or_else(damaged)?;
        let offset = |object: &Value| object["byteOffset"].as_u64().unwrap_or(0);
        let start = offset(view).checked_add(offset(entry)).ok_or_else(damaged)?;
        let stride = view["byteStride"].as_u64().unwrap_or(width as u64);
        let count = entry["count"].as_u64().ok_or_else(damaged)?;
        // Elements may not overlap, so that there are no more than the buffer has bytes.
        if stride < width as u64 || count > buffer.len() as u64 {
            return Err(damaged());
        }
        let left = self.elements_left.get().checked_sub(count).ok_or_else(|| {
            let what = "the meshes reuse the elements of their buffers too often";
            let limit = format!(
                "{USUAL_ELEMENTS} elements, or {ELEMENTS_PER_BYTE} for each byte of the buffers if that is more"
            );
            FormatError::too_large(self.path, what, limit)
        })?;
        self.elements_left.set(left);
        (0..count)
            .map(|i| {
                let from = usize::try_from(start.checked_add(i.checked_mul(stride)?)?).ok()?;
                buffer.get(from..from.checked_add(width)?)
            })
            .collect::<Option<Vec<_>>>()
            .map(|list| (list, kind))
            .ok_or_else(damaged)
    }

    fn floats(&self, accessor: u64, size: usize) -> Result<Vec<f32>, FormatError> {
        let (elements, kind) = self.elements(accessor, size)?;
        // Whole numbers are parts of the largest, or themselves: KHR_mesh_quantization
        let is_normalized =
            self.document["accessors"][accessor as usize]["normalized"].as_bool() == Some(true);
        let of = |value: f32, most: f32| if is_normalized { (value / most).max(-1.0) } else { value };
        let number = |bytes: &[u8]| match kind {
            5126 => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            5120 => of(f32::from(bytes[0].cast_signed()), 127.0),
            5121 => of(f32::from(bytes[0]), 255.0),
            5122 => of(f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
            5123 => of(f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
            _ => f32::NAN,
        };
        Ok(elements.iter().flat_map(|e| e.chunks_exact(e.len() / size)).map(number).collect())
    }

    fn whole_numbers(&self, accessor: u64) -> Result<Vec<u32>, FormatError> {
        let (elements, kind) = self.elements(accessor, 1)?;
        let number = |bytes: &&[u8]| match kind {
            5121 => Some(u32::from(bytes[0])),
            5123 => Some(u32::from(u16::from_le_bytes([bytes[0], bytes[1]]))),
            5125 => Some(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
            _ => None,
        };
        elements
            .iter()
            .map(number)
            .collect::<Option<_>>()
            .ok_or_else(|| broken(self.path, "vertex indices are not whole numbers"))
    }
}

/// Transform of a node against its parent.
fn transform(node: &Value) -> Affine3A {
    let numbers = |key: &str| -> Option<Vec<f32>> {
        node[key].as_array().map(|list| list.iter().map(|v| v.as_f64().unwrap_or(0.0) as f32).collect())
    };
    if let Some(matrix) = numbers("matrix").filter(|m| m.len() == 16) {
        return Affine3A::from_mat4(Mat4::from_cols_slice(&matrix));
    }
    let vector = |key: &str, otherwise: Vec3| {
        numbers(key).filter(|v| v.len() == 3).map_or(otherwise, |v| Vec3::from_slice(&v))
    };
    let rotation = numbers("rotation").filter(|r| r.len() == 4);
    let rotation = rotation.map_or(Quat::IDENTITY, |r| Quat::from_slice(&r).normalize());
    Affine3A::from_scale_rotation_translation(
        vector("scale", Vec3::ONE),
        rotation,
        vector("translation", Vec3::ZERO),
    )
}

/// Buffer of a file that is written, with what lies where in it.
#[derive(Default)]
struct BufferWriter {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

/// Use of a buffer view: vertices, or indices of vertices.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

impl BufferWriter {
    /// Adds values, and returns the number of their accessor.
    fn add(&mut self, values: Vec<u8>, target: u32, mut accessor: Value) -> usize {
        let (offset, length) = (self.bytes.len(), values.len());
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": length, "target": target }));
        self.bytes.extend(values);
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds a mesh, and returns its attributes and indices.
    fn add_mesh(&mut self, mesh: &TriangleMesh) -> (Value, usize) {
        let count = mesh.positions.len();
        let mut floats = |values: &mut dyn Iterator<Item = f32>, mut accessor: Value| -> Value {
            accessor["componentType"] = json!(5126);
            accessor["count"] = json!(count);
            json!(self.add(values.flat_map(f32::to_le_bytes).collect(), VERTICES, accessor))
        };
        let (low, high) = mesh.bounds();
        let mut attributes = json!({});
        attributes["POSITION"] = floats(
            &mut mesh.positions.iter().flat_map(|p| p.to_array()),
            json!({ "type": "VEC3", "min": low.to_array(), "max": high.to_array() }),
        );
        if !mesh.normals.is_empty() {
            let normals = &mut mesh.normals.iter().flat_map(|n| n.to_array());
            attributes["NORMAL"] = floats(normals, json!({ "type": "VEC3" }));
        }
        if !mesh.uvs.is_empty() {
            let uvs = &mut mesh.uvs.iter().flat_map(|uv| [uv.x, 1.0 - uv.y]);
            attributes["TEXCOORD_0"] = floats(uvs, json!({ "type": "VEC2" }));
        }
        let indices: Vec<u8> = mesh.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let indices = self.add(
            indices,
            INDICES,
            json!({ "componentType": 5125, "count": 3 * mesh.triangles.len(), "type": "SCALAR" }),
        );
        (attributes, indices)
    }
}

/// A light of a glTF file (`KHR_lights_punctual`).
#[derive(Clone, Debug, PartialEq)]
pub struct GltfLight {
    /// Its name.
    pub name: String,
    /// Where it is, m.
    pub position: Vec3,
    /// Where it shines to; unit vector.
    pub direction: Vec3,
    /// Linear sRGB, 1 at most.
    pub color: [f64; 3],
    /// How it shines.
    pub kind: GltfLightKind,
    /// Radiant intensity, W/sr; of distant light irradiance, W/m².
    pub radiant: f64,
}

/// How a light of a glTF file shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GltfLightKind {
    /// To all sides.
    Point,
    /// Within a cone, even up to an angle from its axis and dark from another one on, rad.
    Spot([f64; 2]),
    /// In parallel.
    Directional,
}

/// A perspective camera of a glTF file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GltfCamera {
    /// Where it is, m.
    pub position: Vec3,
    /// Where it looks to; unit vector.
    pub forward: Vec3,
    /// Up in its image; unit vector.
    pub up: Vec3,
    /// Vertical field of view, rad.
    pub vertical_field: f64,
    /// Width over height.
    pub aspect: f64,
}

/// Writes the meshes as a binary glTF file (.glb) in meters: one node for every mesh, with normals and texture
/// coordinates where there are some, and one material in its color for every name.
///
/// # Errors
/// When a mesh is not valid or the file can't be written.
pub fn write_gltf(path: &Path, meshes: &[NamedMesh<'_>]) -> Result<(), FormatError> {
    write_gltf_scene(path, meshes, None, &[])
}

/// [`write_gltf`] with a camera and lights. Their intensities are in candela, of distant light in lux, as the format has it, made from
/// watts by 683 lm/W whatever the spectrum: what programs divide by to get watts back. `extras` hold the watts.
///
/// # Errors
/// As [`write_gltf`].
pub fn write_gltf_scene(
    path: &Path,
    meshes: &[NamedMesh<'_>],
    camera: Option<&GltfCamera>,
    lights: &[GltfLight],
) -> Result<(), FormatError> {
    check(path, meshes)?;
    let mut buffer = BufferWriter::default();
    let (mut list, mut nodes) = (Vec::new(), Vec::new());
    let materials = mesh_set::materials(meshes);
    for part in meshes {
        let (attributes, indices) = buffer.add_mesh(part.mesh);
        let material = materials.iter().position(|(name, _)| *name == part.material);
        list.push(json!({ "name": part.name, "primitives": [
            { "attributes": attributes, "indices": indices, "material": material }] }));
        nodes.push(json!({ "name": part.name, "mesh": list.len() - 1 }));
    }
    if let Some(camera) = camera {
        nodes.push(json!({ "name": "camera", "camera": 0, "matrix": looking(camera.position, camera.forward, camera.up) }));
    }
    for (number, light) in lights.iter().enumerate() {
        let matrix = looking(light.position, light.direction, light.direction.any_orthonormal_vector());
        let own = json!({ "KHR_lights_punctual": { "light": number } });
        nodes.push(json!({ "name": light.name, "matrix": matrix, "extensions": own }));
    }
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "fluorspar" },
        "scene": 0,
        "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
        "nodes": nodes,
        "meshes": list,
        "materials": materials.iter().map(|(name, [r, g, b])| json!({ "name": name, "pbrMetallicRoughness": {
            "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.4 } })).collect::<Vec<_>>(),
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{ "byteLength": buffer.bytes.len() }],
    });
    if let Some(camera) = camera {
        document["cameras"] = json!([{ "type": "perspective", "perspective": {
            "yfov": camera.vertical_field, "aspectRatio": camera.aspect, "znear": 1e-3 } }]);
    }
    if !lights.is_empty() {
        document["extensionsUsed"] = json!(["KHR_lights_punctual"]);
        let lights: Vec<Value> = lights.iter().map(light_json).collect();
        document["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    }
    write_chunks(path, document.to_string().into_bytes(), buffer.bytes)
}

fn light_json(light: &GltfLight) -> Value {
    let (kind, quantity) = match light.kind {
        GltfLightKind::Point => ("point", "radiant_intensity_w_per_sr"),
        GltfLightKind::Spot(_) => ("spot", "radiant_intensity_w_per_sr"),
        GltfLightKind::Directional => ("directional", "irradiance_w_per_m2"),
    };
    let mut described = json!({
        "name": light.name,
        "type": kind,
        "color": light.color,
        "intensity": LUMINOUS_EFFICACY_LM_PER_W * light.radiant,
        "extras": { quantity: light.radiant },
    });
    if let GltfLightKind::Spot([inner, outer]) = light.kind {
        described["spot"] = json!({ "innerConeAngle": inner, "outerConeAngle": outer });
    }
    described
}

/// Transform of a node that looks along a direction: against its z axis.
fn looking(position: Vec3, forward: Vec3, up: Vec3) -> [f32; 16] {
    let right = forward.cross(up).normalize_or_zero();
    let axes = [right, right.cross(forward), -forward].map(|axis| axis.extend(0.0));
    Mat4::from_cols(axes[0], axes[1], axes[2], position.extend(1.0)).to_cols_array()
}

/// Writes the JSON and the binary chunk of a .glb file.
fn write_chunks(path: &Path, mut text: Vec<u8>, mut blob: Vec<u8>) -> Result<(), FormatError> {
    text.resize(text.len().next_multiple_of(4), b' ');
    blob.resize(blob.len().next_multiple_of(4), 0);
    let Ok(whole) = u32::try_from(12 + 8 + text.len() + 8 + blob.len()) else {
        return Err(FormatError::unwritable(
            path,
            "the meshes take more than 4 GiB",
            "Lower the level of detail",
        ));
    };
    write_atomically(path, |writer| {
        writer.write_all(MAGIC)?;
        for word in [2, whole, text.len() as u32, JSON_CHUNK] {
            writer.write_all(&word.to_le_bytes())?;
        }
        writer.write_all(&text)?;
        for word in [blob.len() as u32, BINARY_CHUNK] {
            writer.write_all(&word.to_le_bytes())?;
        }
        writer.write_all(&blob)
    })
}
