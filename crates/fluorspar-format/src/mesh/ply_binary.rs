//! Payloads of binary PLY files as large as memory, decoded in place and by all threads.

use glam::{Vec2, Vec3};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, PropertyType, ScalarType};
use rayon::prelude::*;

use fluorspar::geometry::TriangleMesh;

/// Vertices or faces that a thread decodes at a time.
const AT_ONCE: usize = 1 << 16;

/// The mesh of a binary file whose vertices hold numbers only and whose faces are all triangles, as nearly all are. `None` for every
/// other file, and for one that is damaged: the general reader says what is wrong with it.
pub(crate) fn read_binary(bytes: &[u8], header: &Header) -> Option<TriangleMesh> {
    let order = match header.encoding {
        Encoding::BinaryLittleEndian => Order::Little,
        Encoding::BinaryBigEndian => Order::Big,
        Encoding::Ascii => return None,
    };
    let mut rest = payload(bytes)?;
    let mut mesh = TriangleMesh::default();
    for (_, element) in &header.elements {
        let stride = stride(element)?;
        let (own, others) = rest.split_at_checked(stride.checked_mul(element.count)?)?;
        rest = others;
        match element.name.as_str() {
            "vertex" => vertices(element, stride, own, order, &mut mesh)?,
            "face" => mesh.triangles = triangles(element, stride, own, order)?,
            _ => {}
        }
    }
    Some(mesh)
}

/// What follows the header.
pub(crate) fn payload(bytes: &[u8]) -> Option<&[u8]> {
    let mut rest = bytes;
    loop {
        let end = rest.iter().position(|byte| *byte == b'\n')?;
        let (line, others) = (&rest[..end], &rest[end + 1..]);
        if line.trim_ascii() == b"end_header" {
            return Some(others);
        }
        rest = others;
    }
}

#[derive(Clone, Copy)]
enum Order {
    Little,
    Big,
}

fn size(kind: &ScalarType) -> usize {
    match kind {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Bytes of an entry, where all have as many: a list counts as one of three numbers.
fn stride(element: &ElementDef) -> Option<usize> {
    let of_property = |kind: &PropertyType| match kind {
        PropertyType::Scalar(kind) => Some(size(kind)),
        PropertyType::List(count, kind) if element.name == "face" => Some(size(count) + 3 * size(kind)),
        PropertyType::List(..) => None,
    };
    element.properties.iter().map(|(_, property)| of_property(&property.data_type)).sum()
}

/// Place in an entry and type of a number.
type Field = (usize, ScalarType);

fn field(element: &ElementDef, names: &[&str]) -> Option<Field> {
    let mut at = 0;
    for (name, property) in &element.properties {
        let PropertyType::Scalar(kind) = &property.data_type else { return None };
        if names.contains(&name.as_str()) {
            return Some((at, kind.clone()));
        }
        at += size(kind);
    }
    None
}

fn number(entry: &[u8], (at, kind): &Field, order: Order) -> f32 {
    fn bytes<const N: usize>(entry: &[u8], at: usize, order: Order) -> [u8; N] {
        let mut bytes = [0; N];
        bytes.copy_from_slice(&entry[at..at + N]);
        if let Order::Big = order {
            bytes.reverse();
        }
        bytes
    }
    match kind {
        ScalarType::Char => f32::from(i8::from_le_bytes(bytes(entry, *at, order))),
        ScalarType::UChar => f32::from(entry[*at]),
        ScalarType::Short => f32::from(i16::from_le_bytes(bytes(entry, *at, order))),
        ScalarType::UShort => f32::from(u16::from_le_bytes(bytes(entry, *at, order))),
        ScalarType::Int => i32::from_le_bytes(bytes(entry, *at, order)) as f32,
        ScalarType::UInt => u32::from_le_bytes(bytes(entry, *at, order)) as f32,
        ScalarType::Float => f32::from_le_bytes(bytes(entry, *at, order)),
        ScalarType::Double => f64::from_le_bytes(bytes(entry, *at, order)) as f32,
    }
}

fn vertices(
    element: &ElementDef,
    stride: usize,
    own: &[u8],
    order: Order,
    mesh: &mut TriangleMesh,
) -> Option<()> {
    let all = |names: &[&[&str]]| names.iter().map(|names| field(element, names)).collect::<Option<Vec<_>>>();
    let positions = all(&[&["x"], &["y"], &["z"]])?;
    let vectors = |fields: &[Field]| -> Vec<Vec3> {
        let vector = |entry: &[u8]| {
            let [x, y, z] = [0, 1, 2].map(|axis| number(entry, &fields[axis], order));
            Vec3::new(x, y, z)
        };
        own.par_chunks_exact(stride).with_min_len(AT_ONCE).map(vector).collect()
    };
    mesh.positions = vectors(&positions);
    if let Some(normals) = all(&[&["nx"], &["ny"], &["nz"]]) {
        mesh.normals = vectors(&normals);
        mesh.normals.par_iter_mut().for_each(|normal| *normal = normal.normalize_or_zero());
    }
    // The general reader takes whichever of these names come last; a file has one pair of them.
    let pairs = [["u", "v"], ["s", "t"], ["texture_u", "texture_v"]];
    let mut present = pairs.iter().filter_map(|[u, v]| all(&[&[u], &[v]]));
    match (present.next(), present.next()) {
        (Some(fields), None) => {
            let pair =
                |entry: &[u8]| Vec2::new(number(entry, &fields[0], order), number(entry, &fields[1], order));
            mesh.uvs = own.par_chunks_exact(stride).with_min_len(AT_ONCE).map(pair).collect();
        }
        (None, _) => {}
        (Some(_), Some(_)) => return None,
    }
    Some(())
}

/// Bytes of a face before the list of its corners, of faces that have one such list, of the usual types: one byte that counts, four
/// that name a vertex. Anything else is left to the general reader.
fn place_of_corners(element: &ElementDef) -> Option<usize> {
    let mut at = 0;
    let mut found = None;
    for (name, property) in &element.properties {
        match &property.data_type {
            PropertyType::List(count, kind) if found.is_none() => {
                let is_index = name == "vertex_indices" || name == "vertex_index";
                let is_usual = size(count) == 1 && matches!(kind, ScalarType::Int | ScalarType::UInt);
                if !is_index || !is_usual {
                    return None;
                }
                found = Some(at);
                at += 1 + 3 * size(kind);
            }
            PropertyType::List(..) => return None,
            PropertyType::Scalar(kind) => at += size(kind),
        }
    }
    found
}

/// The corners of faces, if all of them have three.
fn triangles(element: &ElementDef, stride: usize, own: &[u8], order: Order) -> Option<Vec<[u32; 3]>> {
    let at = place_of_corners(element)?;
    let face = |entry: &[u8]| -> Option<[u32; 3]> {
        let (count, corners) = entry[at..].split_first()?;
        let (words, _) = corners.as_chunks::<4>();
        let corner = |word: [u8; 4]| match order {
            Order::Little => u32::from_le_bytes(word),
            Order::Big => u32::from_be_bytes(word),
        };
        // Numbers below zero of signed ones are large unsigned ones, which the general reader names.
        let corners = [corner(words[0]), corner(words[1]), corner(words[2])];
        (*count == 3 && corners.iter().all(|corner| i32::try_from(*corner).is_ok())).then_some(corners)
    };
    own.par_chunks_exact(stride).with_min_len(AT_ONCE).map(face).collect()
}
