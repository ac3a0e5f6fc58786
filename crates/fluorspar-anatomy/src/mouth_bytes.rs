//! A mouth as bytes, and back.

use fluorspar::geometry::TriangleMesh;
use glam::{Vec2, Vec3};

use super::{Mouth, Part, Tissue};

impl Mouth {
    /// All parts with the bits of their coordinates, for [`Self::from_bytes`].
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        count(&mut bytes, self.parts.len());
        for part in &self.parts {
            for text in [part.name.as_str(), part.tissue.name()] {
                count(&mut bytes, text.len());
                bytes.extend(text.as_bytes());
            }
            let TriangleMesh { positions, normals, uvs, triangles } = &part.mesh;
            for vectors in [positions, normals] {
                count(&mut bytes, vectors.len());
                bytes.extend(vectors.iter().flat_map(Vec3::to_array).flat_map(f32::to_le_bytes));
            }
            count(&mut bytes, uvs.len());
            bytes.extend(uvs.iter().flat_map(Vec2::to_array).flat_map(f32::to_le_bytes));
            count(&mut bytes, triangles.len());
            bytes.extend(triangles.as_flattened().iter().flat_map(|corner| corner.to_le_bytes()));
        }
        bytes
    }

    /// The mouth of [`Self::to_bytes`]; `None` of other bytes.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let mut rest = bytes;
        let mut parts = Vec::new();
        for _ in 0..number(&mut rest)? {
            let name = String::from_utf8(items::<1>(&mut rest)?.concat()).ok()?;
            let tissue = items::<1>(&mut rest)?.concat();
            let tissue = Tissue::ALL.into_iter().find(|t| t.name().as_bytes() == tissue)?;
            let vectors = |rest: &mut &[u8]| -> Option<Vec<Vec3>> {
                Some(
                    items::<12>(rest)?
                        .iter()
                        .map(|v| Vec3::new(float(v, 0), float(v, 4), float(v, 8)))
                        .collect(),
                )
            };
            let (positions, normals) = (vectors(&mut rest)?, vectors(&mut rest)?);
            let uvs = items::<8>(&mut rest)?.iter().map(|v| Vec2::new(float(v, 0), float(v, 4))).collect();
            let corner = |v: &[u8], at: usize| u32::from_le_bytes([v[at], v[at + 1], v[at + 2], v[at + 3]]);
            let triangles =
                items::<12>(&mut rest)?.iter().map(|v| [corner(v, 0), corner(v, 4), corner(v, 8)]).collect();
            let mesh = TriangleMesh { positions, normals, uvs, triangles };
            mesh.validate().ok()?;
            parts.push(Part { name, tissue, mesh });
        }
        rest.is_empty().then_some(Self { parts })
    }
}

fn count(bytes: &mut Vec<u8>, number: usize) {
    bytes.extend((number as u64).to_le_bytes());
}

fn number(rest: &mut &[u8]) -> Option<usize> {
    let (word, after) = rest.split_first_chunk::<8>()?;
    *rest = after;
    usize::try_from(u64::from_le_bytes(*word)).ok()
}

/// A number of items of so many bytes.
fn items<'a, const BYTES: usize>(rest: &mut &'a [u8]) -> Option<&'a [[u8; BYTES]]> {
    let length = number(rest)?.checked_mul(BYTES)?;
    let (items, after) = rest.split_at_checked(length)?;
    *rest = after;
    Some(items.as_chunks().0)
}

fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MouthParameters, generate_mouth};

    #[test]
    fn a_mouth_comes_back_and_damaged_bytes_do_not() {
        let parameters = MouthParameters { detail: 0.25, ..MouthParameters::default() };
        let mouth = generate_mouth(&parameters).unwrap();
        let bytes = mouth.to_bytes();
        assert!(Mouth::from_bytes(&bytes) == Some(mouth));
        for length in [0, 7, 8, 40, bytes.len() / 2, bytes.len() - 1] {
            assert_eq!(Mouth::from_bytes(&bytes[..length]), None);
        }
        assert_eq!(Mouth::from_bytes(&[bytes, vec![0]].concat()), None);
        assert_eq!(Mouth::from_bytes(&[0xff; 64]), None);
    }
}
