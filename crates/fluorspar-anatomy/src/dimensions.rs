//! Dimensions measured back from the meshes of a mouth.

use glam::{Vec2, Vec3};

use super::{Mouth, Tissue};
use fluorspar::geometry::TriangleMesh;

/// Dimensions of a generated mouth in millimeters; `None` where the parts that define one are missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MouthDimensions {
    /// Between the edges of the upper and lower central incisors.
    pub jaw_opening_mm: Option<f64>,
    /// Between the distal faces of the upper second molars.
    pub upper_arch_width_mm: Option<f64>,
    /// Between the distal faces of the lower second molars.
    pub lower_arch_width_mm: Option<f64>,
    /// From the upper incisors' edges back to the distal faces of the second molars.
    pub upper_arch_depth_mm: Option<f64>,
    /// From the lower incisors' edges back to the distal faces of the second molars.
    pub lower_arch_depth_mm: Option<f64>,
    /// From the plane through the incisors' edges and first molars to the highest point of the hard palate between the first molars.
    pub palate_height_mm: Option<f64>,
    /// Largest width of the tongue.
    pub tongue_width_mm: f64,
    /// Along the midline of its back, from the tip to the base.
    pub tongue_length_mm: f64,
    /// How far the tongue reaches in front of the lower incisors' edges.
    pub tongue_protrusion_mm: Option<f64>,
    /// Between the corners of the lips.
    pub lip_opening_width_mm: f64,
}

/// Middle of the row of a mesh at a height of its texture, between the rows above and below it.
fn ring(mesh: &TriangleMesh, v: f32) -> Option<Vec3> {
    let rows = || mesh.uvs.iter().map(|uv| uv.y);
    let below = rows().filter(|row| *row <= v).reduce(f32::max)?;
    let above = rows().filter(|row| *row >= v).reduce(f32::min)?;
    let middle = |row: f32| {
        let (sum, count) = mesh
            .uvs
            .iter()
            .zip(&mesh.positions)
            .filter(|(uv, _)| uv.y == row)
            .fold((Vec3::ZERO, 0.0), |(sum, count), (_, position)| (sum + *position, count + 1.0));
        sum / count
    };
    let share = if above > below { (v - below) / (above - below) } else { 0.0 };
    Some(middle(below).lerp(middle(above), share))
}

/// Axis of a crown, from its neck to the middle of its biting surface, and that part of it that is next to its biting
/// edge or at its highest cusps, m: the middle of the places within a tenth of a millimeter of the highest one.
fn axis_and_edge(mesh: &TriangleMesh) -> Option<(Vec3, Vec3)> {
    let at_middle = mesh.uvs.iter().position(|uv| uv.y > 0.9999)?;
    let axis = (mesh.positions[at_middle] - ring(mesh, 0.1)?).normalize();
    let highest = mesh.positions.iter().map(|p| p.dot(axis)).fold(f32::NEG_INFINITY, f32::max);
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for position in mesh.positions.iter().filter(|p| p.dot(axis) > highest - 1e-4) {
        low = low.min(*position);
        high = high.max(*position);
    }
    Some((axis, (low + high) * 0.5))
}

fn edge(mouth: &Mouth, number: u8) -> Option<Vec3> {
    Some(axis_and_edge(&mouth.part(&format!("tooth_{number}"))?.mesh)?.1)
}

/// Middle between the two edges of a pair of teeth.
fn middle(mouth: &Mouth, a: u8, b: u8) -> Option<Vec3> {
    Some((edge(mouth, a)? + edge(mouth, b)?) * 0.5)
}

/// Ends of a crown along the arch, mesial and distal, raised to the height of the biting edge, where the line of contacts
/// is drawn.
fn contacts(mouth: &Mouth, number: u8) -> Option<[Vec3; 2]> {
    let mesh = &mouth.part(&format!("tooth_{number}"))?.mesh;
    let face = |u: f32| {
        let near = |uv: &&Vec2| (uv.x - u).abs() < 0.06 && (uv.y - 0.65).abs() < 0.15;
        let points: Vec<Vec3> =
            mesh.uvs.iter().zip(&mesh.positions).filter(|(uv, _)| near(uv)).map(|(_, p)| *p).collect();
        (!points.is_empty()).then(|| points.iter().sum::<Vec3>() / points.len() as f32)
    };
    let (a, b) = (face(0.25)?, face(0.75)?);
    let along = (b - a).normalize();
    let (axis, edge) = axis_and_edge(mesh)?;
    // The middle of the face, moved out to the end of the crown and up to the edge.
    let end = |middle: Vec3, along: Vec3| {
        let reach = mesh.positions.iter().map(|p| (*p - middle).dot(along)).fold(0.0, f32::max);
        let end = middle + along * reach;
        end + axis * (edge - end).dot(axis)
    };
    Some([end(a, -along), end(b, along)])
}

fn arch(mouth: &Mouth, incisors: [u8; 2], molars: [u8; 2]) -> Option<(f64, f64)> {
    let front = (contacts(mouth, incisors[0])?[0] + contacts(mouth, incisors[1])?[0]) * 0.5;
    let (right, left) = (contacts(mouth, molars[0])?[1], contacts(mouth, molars[1])?[1]);
    let behind = (right + left) * 0.5 - front;
    // The depth is measured along the arch's own plane, which leans with the jaw.
    let depth = (behind.y * behind.y + behind.z * behind.z).sqrt();
    Some((f64::from((left.x - right.x).abs()) * 1e3, f64::from(depth) * 1e3))
}

fn palate_height(mouth: &Mouth) -> Option<f64> {
    let front = middle(mouth, 11, 21)?;
    let (right, left) = (edge(mouth, 16)?, edge(mouth, 26)?);
    let normal = (right - front).cross(left - front).normalize();
    let height = |p: &Vec3| f64::from((*p - front).dot(normal)) * 1e3;
    let palate = &mouth.part("hard_palate")?.mesh;
    let behind = (right + left) * 0.5 - front;
    let at_molars = |p: &&Vec3| ((**p - front).dot(behind) / behind.length_squared() - 1.0).abs() < 0.1;
    Some(palate.positions.iter().filter(at_molars).map(|p| height(p).abs()).fold(0.0, f64::max))
}

pub(super) fn measure(mouth: &Mouth) -> MouthDimensions {
    let upper = arch(mouth, [11, 21], [17, 27]);
    let lower = arch(mouth, [41, 31], [47, 37]);
    let millimeters = |meters: f32| f64::from(meters) * 1e3;
    let tongue =
        mouth.parts.iter().filter(|part| part.tissue == Tissue::TongueDorsum).map(|part| &part.mesh).fold(
            None,
            |all: Option<TriangleMesh>, mesh| {
                let mut all = all.unwrap_or_default();
                all.append(mesh);
                Some(all)
            },
        );
    let tongue = tongue.as_ref();
    // Midline points of the back, thinned out so that the papillae do not count as length.
    let mut back: Vec<(f32, Vec3)> = tongue
        .map(|mesh| {
            let on_midline = |u: f32| (u - 0.5).abs() < 1e-3;
            mesh.uvs
                .iter()
                .zip(&mesh.positions)
                .filter(|(uv, _)| on_midline(uv.x))
                .map(|(uv, p)| (uv.y, *p))
                .collect()
        })
        .unwrap_or_default();
    back.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut kept: Vec<(f32, Vec3)> = Vec::new();
    let last = back.len().saturating_sub(1);
    for (number, point) in back.iter().enumerate() {
        if number == last || kept.last().is_none_or(|k| point.0 - k.0 > 0.03) {
            kept.push(*point);
        }
    }
    let length: f32 = kept.windows(2).map(|pair| pair[0].1.distance(pair[1].1)).sum();
    let width = tongue.map_or(0.0, |mesh| mesh.bounds().1.x - mesh.bounds().0.x);
    let front = tongue.map(|mesh| mesh.bounds().1.z);
    let corners = mouth.part("upper_lip").map_or(0.0, |part| {
        // The lips' margin is the innermost place at the height of the corners.
        let ends = |right: bool| {
            part.mesh
                .uvs
                .iter()
                .zip(&part.mesh.positions)
                .filter(|(uv, _)| if right { uv.x >= 1.0 } else { uv.x <= 0.0 })
                .map(|(_, p)| p.x.abs())
                .fold(f32::INFINITY, f32::min)
        };
        ends(true) + ends(false)
    });
    MouthDimensions {
        jaw_opening_mm: middle(mouth, 11, 21)
            .zip(middle(mouth, 41, 31))
            .map(|(upper, lower)| millimeters((upper - lower).length())),
        upper_arch_width_mm: upper.map(|a| a.0),
        lower_arch_width_mm: lower.map(|a| a.0),
        upper_arch_depth_mm: upper.map(|a| a.1),
        lower_arch_depth_mm: lower.map(|a| a.1),
        palate_height_mm: palate_height(mouth),
        tongue_width_mm: millimeters(width),
        tongue_length_mm: millimeters(length),
        tongue_protrusion_mm: front
            .zip(middle(mouth, 41, 31))
            .map(|(tongue, incisors)| millimeters(tongue - incisors.z)),
        lip_opening_width_mm: millimeters(corners),
    }
}
