//! Where parts of a mouth intersect.

use fluorspar_accel::{Ray, TriangleBvh};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::{Mouth, Part, Tissue};
use fluorspar::geometry::TriangleMesh;

/// A place where one part penetrates another.
#[derive(Clone, Debug, PartialEq)]
pub struct Penetration {
    /// Name of the part whose vertex is inside the other.
    pub part: String,
    /// Name of the part that it is in.
    pub other: String,
    /// Distance to the nearest surface of the other part among 26 directions, mm: no less than the true depth.
    pub depth_mm: f64,
    /// Where, m.
    pub position: Vec3,
}

/// How far the surface of another part is looked for, m. A deeper vertex is missed, but its neighbors on the way in are
/// not.
const REACH_M: f32 = 0.006;
/// Border of the gums that lies in the fold of the vestibule, in their texture coordinates.
const FORNIX: f32 = 0.27;

/// Parts that bound one body.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Body {
    Tongue,
    Fauces,
    /// Face, lips, cheeks and the wall of the pharynx.
    Sheet,
    Gums,
    Palate,
    Floor,
    Tooth,
}

fn body(part: &Part) -> Body {
    match part.tissue {
        Tissue::TongueDorsum | Tissue::TongueVentral => Body::Tongue,
        Tissue::SoftPalate => Body::Fauces,
        Tissue::Throat if part.name.starts_with("tonsil") => Body::Fauces,
        Tissue::Throat | Tissue::Cheek | Tissue::Lip | Tissue::Skin => Body::Sheet,
        Tissue::Gingiva => Body::Gums,
        Tissue::HardPalate => Body::Palate,
        Tissue::FloorOfMouth => Body::Floor,
        Tissue::Tooth => Body::Tooth,
    }
}

/// Whether a vertex of a part is hidden by design: behind other parts, where the bag of the mouth is closed.
fn hidden(part: &Part, uv: Vec2) -> bool {
    match part.tissue {
        // Root in the gum.
        Tissue::Tooth => uv.y < 0.15,
        // The fold of the vestibule, the ends behind the last teeth, the border to palate and floor.
        Tissue::Gingiva => uv.y < FORNIX || uv.y > 0.93 || (uv.x - 0.5).abs() > 0.44,
        // Above the palate, below the floor, behind the hind arches.
        Tissue::Cheek => uv.y > 0.55 || (uv.x - 0.5).abs() > 0.25,
        Tissue::Throat => true,
        // The sides of the curtain end in the cheeks.
        Tissue::SoftPalate => {
            uv.y > 0.8 || uv.y < 0.1 || (uv.x - 0.5).abs() > 0.4 || part.name.contains("pharyngeal")
        }
        Tissue::HardPalate => !(0.04..0.96).contains(&uv.x) || uv.y > 0.93 || uv.y < 0.04,
        // The root of the tongue and its floor.
        Tissue::TongueDorsum | Tissue::TongueVentral => uv.y > 0.78,
        Tissue::FloorOfMouth => true,
        Tissue::Lip | Tissue::Skin => false,
    }
}

/// Whether two bodies grow together.
fn joined(a: Body, b: Body) -> bool {
    use Body::{Fauces, Floor, Gums, Palate, Sheet, Tongue, Tooth};
    a == b && a != Tooth && a != Gums
        || matches!(
            (a, b),
            (Tooth, Gums)
                | (Gums, Tooth)
                | (Gums, Palate)
                | (Palate, Gums)
                | (Floor, Gums | Tongue | Sheet)
                | (Gums | Tongue | Sheet, Floor)
                | (Fauces, Sheet | Palate)
                | (Sheet | Palate, Fauces)
        )
}

/// The 26 directions to the neighbors of a cell.
fn directions() -> Vec<Vec3> {
    (0..27)
        .filter(|i| *i != 13)
        .map(|i| Vec3::new((i % 3 - 1) as f32, (i / 3 % 3 - 1) as f32, (i / 9 - 1) as f32).normalize())
        .collect()
}

struct Solid {
    body: Body,
    mesh: TriangleMesh,
    names: Vec<(usize, String)>,
    bvh: TriangleBvh,
    low: Vec3,
    high: Vec3,
}

/// Distance to the nearest surface around a point, when that surface is seen from within.
fn depth_inside(solid: &Solid, point: Vec3, directions: &[Vec3]) -> Option<(f32, u32)> {
    let mut nearest: Option<(f32, u32, bool)> = None;
    for &direction in directions {
        let t_max = nearest.map_or(REACH_M, |(t, ..)| t);
        if let Some(hit) = solid.bvh.closest(&Ray { origin: point, direction, t_min: 0.0, t_max }) {
            let triangle = solid.mesh.triangles[hit.triangle as usize];
            let within = solid.mesh.triangle_cross(&triangle).dot(direction) > 0.0;
            nearest = Some((hit.t, hit.triangle, within));
        }
    }
    nearest.filter(|(.., within)| *within).map(|(t, triangle, _)| (t, triangle))
}

/// Finds vertices that lie in another body by more than `tolerance_mm`, the deepest first, one for every pair of
/// parts. Every `stride`-th vertex is tested.
pub(super) fn penetrations(mouth: &Mouth, tolerance_mm: f64, stride: usize) -> Vec<Penetration> {
    let mut solids: Vec<Solid> = Vec::new();
    // Join the parts of one body
    for part in &mouth.parts {
        let of = body(part);
        let shared = !matches!(of, Body::Tooth | Body::Gums);
        let place = solids.iter().position(|s| shared && s.body == of);
        if let Some(i) = place {
            let count = solids[i].mesh.triangles.len();
            solids[i].mesh.append(&part.mesh);
            solids[i].names.push((count, part.name.clone()));
        } else {
            let Ok(bvh) = TriangleBvh::build(&[], &[]) else { return Vec::new() };
            let names = vec![(0, part.name.clone())];
            let mesh = part.mesh.clone();
            solids.push(Solid { body: of, mesh, names, bvh, low: Vec3::ZERO, high: Vec3::ZERO });
        }
    }
    // Build a tree and bounds per body
    for solid in &mut solids {
        let Ok(bvh) = TriangleBvh::build(&solid.mesh.positions, &solid.mesh.triangles) else {
            return Vec::new();
        };
        solid.bvh = bvh;
        (solid.low, solid.high) = solid.mesh.bounds();
    }
    let directions = directions();
    // Measure how deep a vertex lies inside other bodies
    let look = &|part: &Part, vertex: usize| -> Vec<Penetration> {
        if hidden(part, part.mesh.uvs[vertex]) {
            return Vec::new();
        }
        let (own, position) = (body(part), part.mesh.positions[vertex]);
        solids
            .iter()
            .filter(|solid| {
                !joined(own, solid.body)
                    && solid.names[0].1 != part.name
                    && position.cmpge(solid.low).all()
                    && position.cmple(solid.high).all()
            })
            .filter_map(|solid| {
                let (depth, triangle) = depth_inside(solid, position, &directions)?;
                let depth_mm = f64::from(depth) * 1e3;
                let name = solid.names.iter().rev().find(|(first, _)| *first <= triangle as usize)?;
                // Penetration of parts that are hidden by design is allowed
                let uv = solid.mesh.uvs[solid.mesh.triangles[triangle as usize][0] as usize];
                let other = mouth.part(&name.1)?;
                let counts =
                    depth_mm > tolerance_mm && !hidden(other, uv) && part.mesh.normals[vertex].is_finite();
                counts.then(|| Penetration {
                    part: part.name.clone(),
                    other: name.1.clone(),
                    depth_mm,
                    position,
                })
            })
            .collect()
    };
    // Test all vertices, deepest first, one result per pair of parts
    let mut all: Vec<Penetration> = mouth
        .parts
        .par_iter()
        .flat_map_iter(|part| {
            (0..part.mesh.positions.len()).step_by(stride.max(1)).flat_map(move |v| look(part, v))
        })
        .collect();
    all.sort_by(|a, b| b.depth_mm.total_cmp(&a.depth_mm));
    let mut seen = std::collections::BTreeSet::new();
    all.retain(|p| seen.insert((p.part.clone(), p.other.clone())));
    all
}
