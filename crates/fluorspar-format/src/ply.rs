//! Stanford PLY meshes, text and binary.

use std::io::{BufReader, Read, Write};
use std::path::Path;

use flate2::read::GzDecoder;
use glam::{Vec2, Vec3};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

use super::FormatError;
use super::file::{MAX_MESH_BYTES, guarded, read_file};
use super::output::write_atomically;
use super::ply_binary::read_binary;
use fluorspar::geometry::TriangleMesh;

/// Reads a PLY file, plain or compressed by gzip: vertices with `x y z`, optionally `nx ny nz` and `u v`, `s t` or `texture_u texture_v`; faces
/// with `vertex_indices` (or `vertex_index`), split into fans of triangles. Everything else is passed over.
///
/// `unit_m` is the length of one unit of the file, m: 0.001 for a file in millimeters.
///
/// # Errors
/// Anything that is not such a file, with the line where known.
pub fn read_ply(path: &Path, unit_m: f64) -> Result<TriangleMesh, FormatError> {
    let bytes = unpacked(path, read_file(path, MAX_MESH_BYTES)?)?;
    if !bytes.starts_with(b"ply") {
        return Err(FormatError::malformed(
            path,
            "this is not a PLY file",
            "A PLY file begins with the line \"ply\"",
        ));
    }
    let mesh = guarded(path, "PLY", || parse(path, &bytes))?;
    finish_mesh(path, mesh, unit_m)
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

fn parse(path: &Path, bytes: &[u8]) -> Result<TriangleMesh, FormatError> {
    let damaged = |error: ParseError| FormatError::Malformed {
        path: path.into(),
        line: error.line().map(|line| line as u64),
        what: format!("not a valid PLY file: {}", first_sentence(&error)),
        hint: "Copy the file again, or export the mesh again".into(),
    };
    let mut reader = Reader::new(BufReader::new(bytes));
    let header = Parser::<Skipped>::new().read_header(&mut reader).map_err(damaged)?;
    if let Some(mesh) = read_binary(bytes, &header) {
        return Ok(mesh);
    }
    let mut mesh = TriangleMesh::default();
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
                let faces =
                    parser.read_payload_for_element(&mut reader, element, &header).map_err(damaged)?;
                for (number, face) in faces.iter().enumerate() {
                    push_fan(path, number, &face.corners, &mut mesh.triangles)?;
                }
            }
            _ => {
                let parser = Parser::<Skipped>::new();
                parser.read_payload_for_element(&mut reader, element, &header).map_err(damaged)?;
            }
        }
    }
    Ok(mesh)
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

fn push_fan(
    path: &Path,
    number: usize,
    corners: &[i64],
    triangles: &mut Vec<[u32; 3]>,
) -> Result<(), FormatError> {
    let vertex = |corner: i64| {
        u32::try_from(corner).map_err(|_| {
            FormatError::malformed(
                path,
                format!("face {number} names vertex {corner}"),
                "Vertices are numbered from 0: export the mesh again",
            )
        })
    };
    if corners.len() < 3 {
        return Err(FormatError::malformed(
            path,
            format!("face {number} has {} corners", corners.len()),
            "Faces need three or more: triangulate the mesh before exporting it",
        ));
    }
    for pair in corners[1..].windows(2) {
        triangles.push([vertex(corners[0])?, vertex(pair[0])?, vertex(pair[1])?]);
    }
    Ok(())
}

/// Scales a mesh to meters and checks it.
pub(super) fn finish_mesh(
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
