//! Wavefront OBJ meshes.

use std::path::Path;

use glam::{Vec2, Vec3};

use super::ply::{finish_mesh, push_polygon};
use crate::FormatError;
use crate::store::file::{MAX_MESH_BYTES, guarded, read_file};
use fluorspar::geometry::TriangleMesh;

/// Reads all shapes of an OBJ file as one mesh; polygons are split into triangles, materials are ignored. Normals and
/// texture coordinates are kept when every corner has them.
///
/// `unit_m` is the length of one unit of the file, m: 0.001 for a file in millimeters.
///
/// # Errors
/// Anything that is not such a file, with the line where known.
pub fn read_obj(path: &Path, unit_m: f64) -> Result<TriangleMesh, FormatError> {
    let bytes = one_line_each(read_file(path, MAX_MESH_BYTES)?);
    if let Some(line) = line_of_wild_index(&bytes) {
        let what = "not a valid OBJ file: face vertex index out of bounds";
        return Err(FormatError::at_line(path, line, what, "Export the mesh again"));
    }
    let models = guarded(path, "OBJ", || {
        let options = tobj::LoadOptions {
            single_index: true,
            triangulate: false,
            ignore_points: true,
            ignore_lines: true,
        };
        let no_materials = |_: &Path| Ok((Vec::new(), Default::default()));
        match tobj::load_obj_buf(&mut bytes.as_slice(), &options, no_materials) {
            Ok((models, _)) => Ok(models),
            Err(error) => {
                let what = format!("not a valid OBJ file: {error}");
                Err(FormatError::at_line(path, suspicious_line(&bytes), what, "Export the mesh again"))
            }
        }
    })?;
    let mut mesh = TriangleMesh::default();
    for model in models.into_iter().map(|model| model.mesh).filter(|mesh| !mesh.indices.is_empty()) {
        let mut part = TriangleMesh {
            positions: model.positions.chunks_exact(3).map(Vec3::from_slice).collect(),
            normals: model.normals.chunks_exact(3).map(Vec3::from_slice).collect(),
            uvs: model.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(),
            triangles: Vec::new(),
        };
        if model.face_arities.is_empty() {
            part.triangles = model.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        }
        let mut rest = model.indices.as_slice();
        for (number, arity) in model.face_arities.iter().enumerate() {
            let (corners, others) = rest.split_at_checked(*arity as usize).unwrap_or((rest, &[]));
            push_polygon(path, number, corners, &mut part)?;
            rest = others;
        }
        // Where only some corners of a shape have them, the reader's lists are too short to tell which.
        let vertices = part.positions.len();
        part.normals.truncate(if part.normals.len() == vertices { vertices } else { 0 });
        part.uvs.truncate(if part.uvs.len() == vertices { vertices } else { 0 });
        part.validate().map_err(|error| {
            FormatError::malformed(path, format!("a shape is damaged: {error}"), "Export the mesh again")
        })?;
        mesh.append(&part);
    }
    finish_mesh(path, mesh, unit_m)
}

/// The bytes with lines that a backslash continues in one, followed by as many line ends: those behind keep their numbers. Comments end where their
/// lines do.
fn one_line_each(bytes: Vec<u8>) -> Vec<u8> {
    if !bytes.contains(&b'\\') {
        return bytes;
    }
    let (mut joined, mut owed, mut is_comment) = (Vec::with_capacity(bytes.len()), 0, false);
    for line in bytes.split(|&byte| byte == b'\n') {
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        is_comment = if owed == 0 { line.trim_ascii_start().starts_with(b"#") } else { is_comment };
        match line.strip_suffix(b"\\").filter(|_| !is_comment) {
            Some(part) => {
                joined.extend_from_slice(part);
                joined.push(b' ');
                owed += 1;
            }
            None => {
                joined.extend_from_slice(line);
                joined.extend(std::iter::repeat_n(b'\n', 1 + owed));
                owed = 0;
            }
        }
    }
    joined
}

/// The first face, line or point, by its line from 1, with an index that the decoder would compute with before it compares
/// it: one of more digits than the vertices of any mesh take, or one that counts back beyond the first entry.
fn line_of_wild_index(bytes: &[u8]) -> Option<u64> {
    const DIGITS: usize = 10;
    // Positions, texture coordinates and normals so far.
    let mut counts = [0_u64; 3];
    for (index, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let line = line.trim_ascii_start();
        match line {
            [b'v', b' ' | b'\t', ..] => counts[0] += 1,
            [b'v', b't', ..] => counts[1] += 1,
            [b'v', b'n', ..] => counts[2] += 1,
            [b'f' | b'l' | b'p', rest @ ..] => {
                let is_huge = |digits: &[u8]| digits.len() > DIGITS;
                let wild = rest.split(|byte| !byte.is_ascii_digit()).any(is_huge)
                    || (rest.contains(&b'-') && counts_back_too_far(rest, counts));
                if wild {
                    return Some(index as u64 + 1);
                }
            }
            _ => {}
        }
    }
    None
}

/// Whether a corner, `position/texture/normal`, has a negative index beyond what there is so far.
fn counts_back_too_far(corners: &[u8], counts: [u64; 3]) -> bool {
    corners.split(u8::is_ascii_whitespace).any(|corner| {
        corner.split(|&byte| byte == b'/').zip(counts).any(|(part, count)| {
            let back = part.strip_prefix(b"-").and_then(|digits| str::from_utf8(digits).ok());
            back.and_then(|digits| digits.parse::<u64>().ok()).is_some_and(|back| back > count)
        })
    })
}

/// The first vertex or face line whose numbers can't be read, from 1.
fn suspicious_line(bytes: &[u8]) -> Option<u64> {
    let lines = bytes.split(|&byte| byte == b'\n').enumerate();
    let mut vertices = 0_i64;
    for (index, line) in lines {
        let text = String::from_utf8_lossy(line);
        let mut words = text.split_whitespace();
        let kind = words.next().unwrap_or_default();
        let fine = match kind {
            "v" | "vn" | "vt" => {
                vertices += i64::from(kind == "v");
                let numbers: Vec<_> = words.map(str::parse::<f64>).collect();
                numbers.len() >= if kind == "vt" { 1 } else { 3 } && numbers.iter().all(Result::is_ok)
            }
            "f" => words.all(|corner| {
                let vertex = corner.split('/').next().unwrap_or_default().parse::<i64>();
                vertex.is_ok_and(|vertex| vertex != 0 && vertex.abs() <= vertices)
            }),
            _ => std::str::from_utf8(line).is_ok(),
        };
        if !fine {
            return Some(index as u64 + 1);
        }
    }
    None
}
