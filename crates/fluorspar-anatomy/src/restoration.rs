//! Restorations: the part of a crown that fillings and artificial crowns cover.

use std::collections::BTreeMap;

use super::math::{PI, sin_cos};
use super::teeth::{NECK_V, RIM_V};
use fluorspar::geometry::TriangleMesh;

/// Surfaces of a crown, as dentists abbreviate them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RestoredSurfaces {
    mesial: bool,
    occlusal: bool,
    distal: bool,
    buccal: bool,
    lingual: bool,
}

/// Half width of a filling across the arch over that of the crown.
const HALF_WIDTH: f64 = 0.32;
/// Half length along the arch of a filling between the marginal ridges, over that of the crown.
const HALF_LENGTH: f64 = 0.62;
/// Where a filling of a side ends on the biting surface.
const BOX_END: f64 = 0.3;
/// How far a filling of a side reaches down from the biting edge, and one of an edge, over the height of the crown.
const BOX_DEPTH: f64 = 0.55;
const EDGE_DEPTH: f64 = 0.25;
/// Middle and half height of a filling at the neck of the outer or inner face, over the height of the crown, and sine of half its width.
const NECK_FILLING: [f64; 3] = [0.2, 0.16, 0.6];
/// Triangles of a crown that are fine enough to be cut.
const LEAST_TRIANGLES: usize = 3000;
/// Where the border is no longer looked for, in half sides of a filling.
const FAR: f64 = 8.0;

impl RestoredSurfaces {
    /// Surfaces from their letters: m mesial, o occlusal or i incisal, d distal, b buccal or f facial, l lingual or p palatal. All five are a
    /// crown. `None` of other letters, of a letter twice, and of none.
    pub fn parse(letters: &str) -> Option<Self> {
        let mut found = Self { mesial: false, occlusal: false, distal: false, buccal: false, lingual: false };
        for letter in letters.chars() {
            let surface = match letter.to_ascii_lowercase() {
                'm' => &mut found.mesial,
                'o' | 'i' => &mut found.occlusal,
                'd' => &mut found.distal,
                'b' | 'f' => &mut found.buccal,
                'l' | 'p' => &mut found.lingual,
                _ => return None,
            };
            if std::mem::replace(surface, true) {
                return None;
            }
        }
        (!letters.is_empty()).then_some(found)
    }

    /// Above zero where the restoration covers the crown, at texture coordinates of [`super::teeth::tooth_mesh`].
    fn cover(self, is_front: bool, uv: [f64; 2]) -> f64 {
        let place = Place::of(uv);
        if self == (Self { mesial: true, occlusal: true, distal: true, buccal: true, lingual: true }) {
            return place.height;
        }
        let biting = match (is_front, f64::from(self.mesial) - f64::from(self.distal)) {
            (false, _) => within(place.along / HALF_LENGTH, place.outward / HALF_WIDTH),
            (true, 0.0) => EDGE_DEPTH - place.below(),
            // With one side it is that corner
            (true, side) => (EDGE_DEPTH - place.below()).min(side * place.along),
        };
        let all = [
            (self.mesial, place.on_side(1.0)),
            (self.distal, place.on_side(-1.0)),
            (self.occlusal, biting),
            (self.buccal, place.at_neck(1.0)),
            (self.lingual, place.at_neck(-1.0)),
        ];
        all.into_iter().filter(|(is_there, _)| *is_there).map(|(_, cover)| cover).fold(-FAR, f64::max)
    }
}

/// Above zero within a rectangle with round corners, of half sides of 1; falls evenly, so that borders lie where they are between the
/// vertices of coarse meshes.
fn within(x: f64, y: f64) -> f64 {
    1.0 - (x.powi(4) + y.powi(4)).sqrt().sqrt()
}

/// A place on a crown.
struct Place {
    /// Over the height of the crown: 0 at the neck, 1 at the rim and beyond it on the biting surface.
    height: f64,
    /// Seen from above, mesial and outward: 1 at the rim and on the wall, 0 in the middle.
    along: f64,
    outward: f64,
}

impl Place {
    fn of([u, v]: [f64; 2]) -> Self {
        let (sine, cosine) = sin_cos(2.0 * PI * u);
        let radius = ((1.0 - v) / (1.0 - RIM_V)).min(1.0);
        Self { height: (v - NECK_V) / (RIM_V - NECK_V), along: radius * sine, outward: -radius * cosine }
    }

    /// How far it is below the rim, over the height of the crown.
    fn below(&self) -> f64 {
        (1.0 - self.height).max(0.0)
    }

    /// A filling of the mesial (1) or distal (-1) side, with its end on the biting surface.
    fn on_side(&self, sign: f64) -> f64 {
        let end = (BOX_END - sign * self.along).max(0.0) / BOX_END;
        within(self.outward / HALF_WIDTH, self.below() / BOX_DEPTH + end)
    }

    /// A filling at the neck of the outer (1) or inner (-1) face.
    fn at_neck(&self, sign: f64) -> f64 {
        let [middle, half_height, half_width] = NECK_FILLING;
        let facing = if sign * self.outward > 0.0 { self.along / half_width } else { FAR };
        within(facing, (self.height - middle) / half_height)
    }
}

/// Cuts the mesh of a crown along the border of a restoration: what is left of the tooth, and the restoration. `number` is the FDI number of
/// the tooth.
pub fn restored(tooth: &TriangleMesh, number: u8, surfaces: RestoredSurfaces) -> [TriangleMesh; 2] {
    let is_front = matches!(number % 10, 1..=3);
    // A filling may lie between the rows of a coarse mesh
    let mut tooth = tooth.clone();
    while tooth.triangles.len() < LEAST_TRIANGLES {
        tooth.subdivide(1);
    }
    let cover: Vec<f64> = tooth
        .uvs
        .iter()
        .map(|uv| surfaces.cover(is_front, [f64::from(uv.x), f64::from(uv.y)]).clamp(-FAR, FAR))
        .collect();
    let cut = |sign: f64| Half::of(&tooth, cover.iter().map(|value| sign * value).collect()).cut();
    [cut(-1.0), cut(1.0)]
}

/// The part of a mesh where a number at its vertices is positive.
struct Half<'a> {
    whole: &'a TriangleMesh,
    inside: Vec<f64>,
    mesh: TriangleMesh,
    /// Vertices of the part by those of the whole, both of them of a cut edge.
    numbers: BTreeMap<[u32; 2], u32>,
}

impl<'a> Half<'a> {
    fn of(whole: &'a TriangleMesh, inside: Vec<f64>) -> Self {
        Self { whole, inside, mesh: TriangleMesh::default(), numbers: BTreeMap::new() }
    }

    fn cut(mut self) -> TriangleMesh {
        for &triangle in &self.whole.triangles {
            let is_in = triangle.map(|vertex| self.inside[vertex as usize] > 0.0);
            // Walk around the triangle: corners inside, and points where the border crosses an edge
            let mut corners = Vec::with_capacity(4);
            for corner in 0..3 {
                let next = (corner + 1) % 3;
                if is_in[corner] {
                    corners.push(self.vertex([triangle[corner]; 2]));
                }
                if is_in[corner] != is_in[next] {
                    let [a, b] = [triangle[corner], triangle[next]];
                    corners.push(self.vertex([a.min(b), a.max(b)]));
                }
            }
            for last in 2..corners.len() {
                self.mesh.triangles.push([corners[0], corners[last - 1], corners[last]]);
            }
        }
        self.mesh
    }

    /// Number of a vertex of the whole, or of the point where the border crosses an edge of it.
    fn vertex(&mut self, edge: [u32; 2]) -> u32 {
        let next = self.mesh.positions.len() as u32;
        let number = *self.numbers.entry(edge).or_insert(next);
        if number == next {
            let [a, b] = edge.map(|vertex| vertex as usize);
            let share = if a == b { 0.0 } else { self.inside[a] / (self.inside[a] - self.inside[b]) } as f32;
            let TriangleMesh { positions, normals, uvs, .. } = self.whole;
            self.mesh.positions.push(positions[a].lerp(positions[b], share));
            self.mesh.normals.push(normals[a].lerp(normals[b], share).normalize_or_zero());
            self.mesh.uvs.push(uvs[a].lerp(uvs[b], share));
        }
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MouthParameters, generate_mouth};

    fn area_mm2(mesh: &TriangleMesh) -> f64 {
        let double: f32 = mesh.triangles.iter().map(|triangle| mesh.triangle_cross(triangle).length()).sum();
        0.5e6 * f64::from(double)
    }

    #[test]
    fn a_crown_is_cut_into_two_meshes_of_its_area() {
        let mouth = generate_mouth(&MouthParameters { detail: 0.25, ..MouthParameters::default() }).unwrap();
        let fine = generate_mouth(&MouthParameters { detail: 2.0, ..MouthParameters::default() }).unwrap();
        // Least and greatest share of the area of crown and root
        let cases = [
            (36, "o", 0.03, 0.15),
            (36, "mod", 0.15, 0.4),
            (46, "b", 0.03, 0.15),
            (33, "b", 0.03, 0.15),
            (16, "MOBDP", 0.7, 0.97),
            (21, "mi", 0.1, 0.3),
            (21, "i", 0.1, 0.4),
            (11, "f", 0.03, 0.2),
        ];
        for (number, letters, least, most) in cases {
            let tooth = &mouth.part(&format!("tooth_{number}")).unwrap().mesh;
            let surfaces = RestoredSurfaces::parse(letters).unwrap();
            let [rest, restoration] = restored(tooth, number, surfaces);
            for mesh in [&rest, &restoration] {
                mesh.validate().unwrap();
            }
            let [whole, rest, share] = [tooth, &rest, &restoration].map(area_mm2);
            assert!((rest + share - whole).abs() < 1e-4 * whole, "{number} {letters}");
            assert!((least..most).contains(&(share / whole)), "{number} {letters}: {}", share / whole);
            let tooth = &fine.part(&format!("tooth_{number}")).unwrap().mesh;
            let of_fine = area_mm2(&restored(tooth, number, surfaces)[1]) / area_mm2(tooth);
            assert!(
                (share / whole / of_fine - 1.0).abs() < 0.15,
                "{number} {letters}: {}",
                share / whole / of_fine
            );
        }
    }

    #[test]
    fn a_filling_lies_on_the_surfaces_that_its_letters_name() {
        let mouth = generate_mouth(&MouthParameters { detail: 0.5, ..MouthParameters::default() }).unwrap();
        // Tooth 36 is on the left: mesial is to the front (+z), buccal to the left (+x)
        let tooth = &mouth.part("tooth_36").unwrap().mesh;
        let middle = |mesh: &TriangleMesh| {
            mesh.positions.iter().copied().sum::<glam::Vec3>() / mesh.positions.len() as f32
        };
        let from_middle = |letters: &str| {
            let surfaces = RestoredSurfaces::parse(letters).unwrap();
            1e3 * (middle(&restored(tooth, 36, surfaces)[1]) - middle(tooth))
        };
        assert!(from_middle("m").z > 2.0 && from_middle("d").z < -2.0);
        assert!(from_middle("b").x > 2.0 && from_middle("l").x < -2.0);
        assert!(from_middle("o").y > 1.0, "the lower teeth bite upward");
    }

    #[test]
    fn other_letters_are_no_surfaces() {
        for letters in ["", "x", "mm", "oi", "m o"] {
            assert_eq!(RestoredSurfaces::parse(letters), None, "{letters}");
        }
    }
}
