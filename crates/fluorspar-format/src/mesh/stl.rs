//! Stereolithography meshes (STL), text and binary.

use fluorspar::quote::excerpt;
use std::collections::HashMap;
use std::path::Path;

use glam::Vec3;

use super::ply::finish_mesh;
use crate::FormatError;
use crate::store::file::{MAX_MESH_BYTES, guarded, read_file};
use fluorspar::geometry::TriangleMesh;

/// Bytes before the triangles of a binary file: a free text and their number.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// Reads an STL file. Corners at the same place become one vertex; the file's own normals are passed over, and there
/// are no texture coordinates.
///
/// `unit_m` is the length of one unit of the file, m: 0.001 for a file in millimeters.
///
/// # Errors
/// Anything that is not such a file, with the line where known.
pub fn read_stl(path: &Path, unit_m: f64) -> Result<TriangleMesh, FormatError> {
    let bytes = read_file(path, MAX_MESH_BYTES)?;
    let corners = guarded(path, "STL", || {
        // Binary files may begin with "solid", too: their length tells.
        let binary = bytes.get(80..HEADER).is_some_and(|count| {
            let count = u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize;
            bytes.len() == HEADER + TRIANGLE * count
        });
        if binary {
            Ok(bytes[HEADER..].chunks_exact(TRIANGLE).flat_map(binary_triangle).collect())
        } else if bytes.trim_ascii_start().get(..5).is_some_and(|start| start.eq_ignore_ascii_case(b"solid"))
        {
            text_corners(path, &bytes)
        } else {
            Err(FormatError::malformed(
                path,
                "not a valid STL file: its length does not fit its number of triangles",
                "Copy the file again, or export the mesh again",
            ))
        }
    })?;
    let mut mesh = TriangleMesh::default();
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    for triangle in corners.chunks_exact(3) {
        let vertices = [0, 1, 2].map(|k| {
            let corner: Vec3 = triangle[k];
            // Adding zero turns -0 into +0.
            *known.entry(corner.to_array().map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
                mesh.positions.push(corner);
                mesh.positions.len() as u32 - 1
            })
        });
        // Slivers whose corners coincide have no area.
        if vertices[0] != vertices[1] && vertices[1] != vertices[2] && vertices[2] != vertices[0] {
            mesh.triangles.push(vertices);
        }
    }
    finish_mesh(path, mesh, unit_m)
}

fn binary_triangle(record: &[u8]) -> [Vec3; 3] {
    let number = |at: usize| f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
    [12, 24, 36].map(|at| Vec3::new(number(at), number(at + 4), number(at + 8)))
}

fn text_corners(path: &Path, bytes: &[u8]) -> Result<Vec<Vec3>, FormatError> {
    let text = String::from_utf8_lossy(bytes);
    let mut corners = Vec::new();
    // Words, however they are put into lines; a name of a solid may be any word
    let of_line = |(index, line)| {
        let words = str::split_whitespace(line).enumerate();
        words.map(move |(place, word)| (index, line, place == 0, word))
    };
    let mut words = text.lines().enumerate().flat_map(of_line).peekable();
    let mut before = "";
    while let Some((index, line, is_first, word)) = words.next() {
        let is_vertex = word.eq_ignore_ascii_case("vertex");
        let is_in_loop = ["loop", "vertex"].iter().any(|other| before.eq_ignore_ascii_case(other));
        before = word;
        if !(is_vertex && (is_in_loop || is_first)) {
            continue;
        }
        let mut number = || words.next().and_then(|(.., word)| word.parse::<f32>().ok());
        let corner = [number(), number(), number()];
        let is_more = words.peek().is_some_and(|(.., word)| word.parse::<f32>().is_ok());
        let [Some(x), Some(y), Some(z)] = corner.map(|number| number.filter(|_| !is_more)) else {
            let what = format!("\"{}\" is not a vertex", excerpt(line.trim()));
            let hint = "A vertex has three numbers: export the mesh again";
            return Err(FormatError::at_line(path, index as u64 + 1, what, hint));
        };
        corners.push(Vec3::new(x, y, z));
    }
    match corners.len() % 3 {
        0 => Ok(corners),
        _ => Err(FormatError::malformed(
            path,
            format!("{} corners do not make triangles", corners.len()),
            "Copy the file again, or export the mesh again",
        )),
    }
}
