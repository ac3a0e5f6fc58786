//! Stanford PLY meshes, text and binary.

use std::borrow::Cow;
use std::io::{BufReader, Read, Write};
use std::path::Path;

use flate2::read::GzDecoder;
use glam::{Vec2, Vec3};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{Encoding, Property, PropertyAccess, PropertyAccessResult};

use super::ply_binary::{payload, read_binary};
use super::polygon::{MOST_CONCAVE_CORNERS, push_triangles};
use crate::FormatError;
use crate::store::file::{MAX_MESH_BYTES, guarded, read_file};
use crate::store::output::write_atomically;
use fluorspar::geometry::TriangleMesh;

/// A PLY file as it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyMesh {
    /// Its mesh, maybe without triangles.
    pub mesh: TriangleMesh,
    /// Faces of fewer than three corners, which are not part of it: how many, and number and corners of the first.
    pub left_out: Option<LeftOutFaces>,
}

/// Faces that are none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LeftOutFaces {
    /// How many.
    pub count: usize,
    /// Number of the first one, from 0.
    pub first: usize,
    /// Its corners, fewer than three.
    pub corners: usize,
}

/// Reads a PLY file, plain or compressed by gzip: vertices with `x y z`, optionally `nx ny nz` and `u v`, `s t` or `texture_u texture_v`; faces
/// with `vertex_indices` (or `vertex_index`), split into triangles. Everything else is passed over.
///
/// `unit_m` is the length of one unit of the file, m: 0.001 for a file in millimeters.
///
/// # Errors
/// Anything that is not such a file, with the line where known; no faces, and faces of fewer than three corners.
pub fn read_ply(path: &Path, unit_m: f64) -> Result<TriangleMesh, FormatError> {
    let PlyMesh { mesh, left_out } = read_any_ply(path)?;
    if let Some(LeftOutFaces { first, corners, .. }) = left_out {
        return Err(FormatError::malformed(
            path,
            format!("face {first} has {corners} corners"),
            "Faces need three or more: triangulate the mesh before exporting it",
        ));
    }
    finish_mesh(path, mesh, unit_m)
}

/// Reads a PLY file as renderers do: faces of fewer than three corners are left out, and there may be none at all. Lengths are
/// those of the file.
///
/// # Errors
/// Anything else that [`read_ply`] refuses.
pub fn read_ply_leniently(path: &Path) -> Result<PlyMesh, FormatError> {
    let found = read_any_ply(path)?;
    let is_empty = found.mesh.triangles.is_empty();
    Ok(PlyMesh { mesh: if is_empty { found.mesh } else { finish_mesh(path, found.mesh, 1.0)? }, ..found })
}

fn read_any_ply(path: &Path) -> Result<PlyMesh, FormatError> {
    let bytes = unpacked(path, read_file(path, MAX_MESH_BYTES)?)?;
    if !bytes.starts_with(b"ply") {
        return Err(FormatError::malformed(
            path,
            "this is not a PLY file",
            "A PLY file begins with the line \"ply\"",
        ));
    }
    guarded(path, "PLY", || parse(path, &bytes))
}

/// The bytes themselves, or what they hold if they are compressed by gzip.
fn unpacked(path: &Path, bytes: Vec<u8>) -> Result<Vec<u8>, FormatError> {
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let mut plain = Vec::new();
    let read = GzDecoder::new(bytes.as_slice()).take(MAX_MESH_BYTES + 1).read_to_end(&mut plain);
    if let Err(error) = read {
        let what = format!("the gzip data are damaged: {error}");
        return Err(FormatError::malformed(path, what, "Copy the file again"));
    }
    if plain.len() as u64 > MAX_MESH_BYTES {
        return Err(FormatError::too_large(
            path,
            "the file is too large when decompressed",
            format!("{MAX_MESH_BYTES} bytes"),
        ));
    }
    Ok(plain)
}

/// The text with a digit on both sides of every decimal point: the parser takes neither `.5` nor `1.`, which C prints and reads.
fn with_full_numbers(bytes: &[u8]) -> Cow<'_, [u8]> {
    let Some(numbers) = payload(bytes) else { return bytes.into() };
    let header = bytes.len() - numbers.len();
    let is_digit = |at: Option<usize>| at.and_then(|at| bytes.get(at)).is_some_and(u8::is_ascii_digit);
    let mut full = Vec::new();
    let mut copied = 0;
    for at in (header..bytes.len()).filter(|at| bytes[*at] == b'.') {
        let [before, after] = [is_digit(at.checked_sub(1)), is_digit(Some(at + 1))];
        if before != after {
            full.extend_from_slice(&bytes[copied..at]);
            full.extend_from_slice(if before { b".0" } else { b"0." });
            copied = at + 1;
        }
    }
    if copied == 0 {
        return bytes.into();
    }
    full.extend_from_slice(&bytes[copied..]);
    full.into()
}

fn parse(path: &Path, bytes: &[u8]) -> Result<PlyMesh, FormatError> {
    let damaged = |error: ParseError| {
        let what = format!("not a valid PLY file: {}", first_sentence(&error));
        let line = error.line().map(|line| line as u64);
        FormatError::at_line(path, line, what, "Copy the file again, or export the mesh again")
    };
    let mut reader = Reader::new(BufReader::new(bytes));
    let header = Parser::<Skipped>::new().read_header(&mut reader).map_err(damaged)?;
    if let Some(mesh) = read_binary(bytes, &header) {
        return Ok(PlyMesh { mesh, left_out: None });
    }
    let is_text = header.encoding == Encoding::Ascii;
    let text = if is_text { with_full_numbers(bytes) } else { bytes.into() };
    if is_text {
        reader = Reader::new(BufReader::new(&text));
        Parser::<Skipped>::new().read_header(&mut reader).map_err(damaged)?;
    }
    let (mut mesh, mut faces) = (TriangleMesh::default(), Vec::new());
    for (_, element) in &header.elements {
        if element.count > bytes.len() {
            return Err(FormatError::malformed(
                path,
                format!(
                    "the header claims {} elements \"{}\" in {} bytes",
                    element.count,
                    element.name,
                    bytes.len()
                ),
                "Copy the file again",
            ));
        }
        let has = |name: &str| element.properties.contains_key(name);
        match element.name.as_str() {
            "vertex" => {
                if !(has("x") && has("y") && has("z")) {
                    return Err(FormatError::malformed(path, "vertices have no x, y, z", "Export positions"));
                }
                let parser = Parser::<Vertex>::new();
                let vertices =
                    parser.read_payload_for_element(&mut reader, element, &header).map_err(damaged)?;
                mesh.positions = vertices.iter().map(|v| v.position).collect();
                if has("nx") && has("ny") && has("nz") {
                    mesh.normals = vertices.iter().map(|v| v.normal.normalize_or_zero()).collect();
                }
                if (has("u") && has("v")) || (has("s") && has("t")) || (has("texture_u") && has("texture_v"))
                {
                    mesh.uvs = vertices.iter().map(|v| v.uv).collect();
                }
            }
            "face" => {
                let parser = Parser::<Face>::new();
                faces = parser.read_payload_for_element(&mut reader, element, &header).map_err(damaged)?;
            }
            _ => {
                let parser = Parser::<Skipped>::new();
                parser.read_payload_for_element(&mut reader, element, &header).map_err(damaged)?;
            }
        }
    }
    // Faces may stand before the vertices that they name.
    let mut left_out: Option<LeftOutFaces> = None;
    for (number, Face { corners }) in faces.iter().enumerate() {
        if corners.len() < 3 {
            let first = LeftOutFaces { count: 0, first: number, corners: corners.len() };
            left_out.get_or_insert(first).count += 1;
        } else {
            push_face(path, number, corners, &mut mesh)?;
        }
    }
    Ok(PlyMesh { mesh, left_out })
}

/// The parser's message without its place and the nested messages below it.
fn first_sentence(error: &ParseError) -> String {
    let text = error.to_string();
    let text = text.lines().next().unwrap_or_default();
    let text = match text.split_once(": ") {
        Some((place, rest)) if place.starts_with("Line ") => rest,
        _ => text,
    };
    text.trim_end_matches('.').to_string()
}

/// Adds a polygon to the triangles of a mesh.
fn push_face(
    path: &Path,
    number: usize,
    corners: &[i64],
    mesh: &mut TriangleMesh,
) -> Result<(), FormatError> {
    let vertex = |corner: &i64| {
        u32::try_from(*corner).map_err(|_| {
            FormatError::malformed(
                path,
                format!("face {number} names vertex {corner}"),
                "Vertices are numbered from 0: export the mesh again",
            )
        })
    };
    let corners = corners.iter().map(vertex).collect::<Result<Vec<u32>, _>>()?;
    push_polygon(path, number, &corners, mesh)
}

/// Adds a polygon of three or more corners to the triangles of a mesh.
pub(crate) fn push_polygon(
    path: &Path,
    number: usize,
    corners: &[u32],
    mesh: &mut TriangleMesh,
) -> Result<(), FormatError> {
    if push_triangles(&mesh.positions, corners, &mut mesh.triangles) {
        return Ok(());
    }
    Err(FormatError::unsupported(
        path,
        format!(
            "face {number} has {} corners and is not convex; such faces are read up to {MOST_CONCAVE_CORNERS}",
            corners.len()
        ),
        "Triangulate the mesh before exporting it",
    ))
}

/// Scales a mesh to meters and checks it.
pub(crate) fn finish_mesh(
    path: &Path,
    mut mesh: TriangleMesh,
    unit_m: f64,
) -> Result<TriangleMesh, FormatError> {
    if !(unit_m.is_finite() && unit_m > 0.0) {
        return Err(FormatError::unit(
            path,
            format!("the unit of length is {unit_m} m"),
            "Give a positive length, for instance 0.001 for millimeters",
        ));
    }
    let scale = unit_m as f32;
    for position in &mut mesh.positions {
        *position *= scale;
    }
    mesh.validate().map_err(|error| {
        FormatError::malformed(path, error.to_string(), "Fix the mesh or export it again")
    })?;
    Ok(mesh)
}

/// Writes a mesh as little-endian binary PLY, in meters.
///
/// # Errors
/// When the mesh is not valid or the file can't be written.
pub fn write_ply(path: &Path, mesh: &TriangleMesh) -> Result<(), FormatError> {
    mesh.validate()
        .map_err(|error| FormatError::unwritable(path, error.to_string(), "Fix the mesh first"))?;
    write_atomically(path, |writer| {
        write!(
            writer,
            "ply\nformat binary_little_endian 1.0\ncomment written by fluorspar, meters\nelement vertex {}\n",
            mesh.positions.len()
        )?;
        let groups: [(&[&str], bool); 3] = [
            (&["x", "y", "z"], true),
            (&["nx", "ny", "nz"], !mesh.normals.is_empty()),
            (&["u", "v"], !mesh.uvs.is_empty()),
        ];
        for name in groups.iter().filter(|(_, present)| *present).flat_map(|(names, _)| names.iter()) {
            writeln!(writer, "property float {name}")?;
        }
        write!(
            writer,
            "element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
            mesh.triangles.len()
        )?;
        for (index, position) in mesh.positions.iter().enumerate() {
            let normal = mesh.normals.get(index).map(Vec3::to_array);
            let uv = mesh.uvs.get(index).map(Vec2::to_array);
            let values = position.to_array().into_iter().chain(normal.into_iter().flatten());
            for value in values.chain(uv.into_iter().flatten()) {
                writer.write_all(&value.to_le_bytes())?;
            }
        }
        for triangle in &mesh.triangles {
            writer.write_all(&[3])?;
            for vertex in triangle {
                writer.write_all(&vertex.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

struct Vertex {
    position: Vec3,
    normal: Vec3,
    uv: Vec2,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { position: Vec3::ZERO, normal: Vec3::ZERO, uv: Vec2::ZERO }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let slot = match name {
            "x" => &mut self.position.x,
            "y" => &mut self.position.y,
            "z" => &mut self.position.z,
            "nx" => &mut self.normal.x,
            "ny" => &mut self.normal.y,
            "nz" => &mut self.normal.z,
            "u" | "s" | "texture_u" => &mut self.uv.x,
            "v" | "t" | "texture_v" => &mut self.uv.y,
            _ => return PropertyAccessResult::Ignored,
        };
        *slot = match property {
            Property::Char(value) => f32::from(value),
            Property::UChar(value) => f32::from(value),
            Property::Short(value) => f32::from(value),
            Property::UShort(value) => f32::from(value),
            Property::Int(value) => value as f32,
            Property::UInt(value) => value as f32,
            Property::Float(value) => value,
            Property::Double(value) => value as f32,
            _ => return PropertyAccessResult::Ignored,
        };
        PropertyAccessResult::Set
    }
}

struct Face {
    corners: Vec<i64>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self { corners: Vec::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        fn widen<T: Into<i64>>(values: Vec<T>) -> Vec<i64> {
            values.into_iter().map(Into::into).collect()
        }
        if name != "vertex_indices" && name != "vertex_index" {
            return PropertyAccessResult::Ignored;
        }
        self.corners = match property {
            Property::ListChar(values) => widen(values),
            Property::ListUChar(values) => widen(values),
            Property::ListShort(values) => widen(values),
            Property::ListUShort(values) => widen(values),
            Property::ListInt(values) => widen(values),
            Property::ListUInt(values) => widen(values),
            _ => return PropertyAccessResult::Ignored,
        };
        PropertyAccessResult::Set
    }
}

/// An element nobody asked for.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }

    fn set_property(&mut self, _: &str, _: Property) -> PropertyAccessResult {
        PropertyAccessResult::Ignored
    }
}
