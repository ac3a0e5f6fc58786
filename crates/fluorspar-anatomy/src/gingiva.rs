//! Gums: a profile swept along the arch, with a scalloped margin around the necks of the teeth.

use glam::{DVec2, DVec3};

use super::dental_arch::{Arch, JawPose, Station};
use super::math::{PI, bell, lerp, pow, sin_cos, smoothstep, spline};
use super::noise::{bumps, fractal_noise};
use super::surface::{count, linspace, surface_mesh};
use super::teeth::outer_face;
use fluorspar::geometry::TriangleMesh;

/// How far the gums reach behind the arch, mm.
const BEHIND_MM: f64 = 2.0;

/// Height of the papillae in crowns: they fill the spaces below the contacts (42 % in front, Chu and others 2009).
const PAPILLA_SHARE: f64 = 0.45;

/// How far outward papillae stand between the crowns, in outer half-depths of these, and how round their edges along the crowns are, mm
/// (assumed).
const PAPILLA_OUTWARD: f64 = 0.68;
const PAPILLA_ROUNDING_MM: f64 = 0.35;

/// How far the frenulum of a lip stands out of the vestibule's floor, mm (assumed).
const FRENULUM_MM: f64 = 2.0;

/// Knots of the profile at the far ends of the attached gum and of its free part, at the margin, and the last one.
const LINING_KNOT: f64 = 2.4;
const FREE_KNOT: f64 = 4.3;
const MARGIN_KNOT: f64 = 6.0;
const LAST_KNOT: f64 = 14.0;

/// Arc length of the hind ends of the gums.
pub(super) fn end_of_gums(arch: &Arch) -> f64 {
    arch.end + BEHIND_MM
}

/// Arc length to which palate and floor of the mouth are attached to the gums.
pub(super) fn end_of_border(arch: &Arch) -> f64 {
    end_of_gums(arch) - 1.0
}

/// Knots of the profile at a station from the vestibule over the margin to the tongue side, in the jaw frame.
fn profile(arch: &Arch, arc: f64) -> Vec<DVec3> {
    let station = arch.station(arc);
    let Station { length, outer, inner, toothed, nearest, .. } = station;
    let across = station.across.abs();
    // 0 at the middle of a tooth, 1 at its contacts: papillae are pointed, the margin between them is round.
    let papilla = pow(across, 2.8);
    let contact = length - 0.7 - PAPILLA_SHARE * length;
    let margin = lerp(length - 0.7, contact, papilla);
    // On the tongue side papillae are lower.
    let inner_margin = lerp(length - 0.9, contact + 1.0, papilla);
    // A gap is healed over by a rounded ridge.
    let margin = lerp(length + 1.9, margin, toothed);
    let inner_margin = lerp(length + 1.9, inner_margin, toothed);
    let inner_edge = inner * (1.0 - 0.3 * pow(across, 2.0) * toothed - 0.2 * (1.0 - toothed));
    // Roots bulge under the gum, with soft grooves between them.
    let root = 0.27 * (1.0 + sin_cos(PI * across).1) * toothed;
    let saddle = lerp(length - 0.4, contact + 0.9, papilla);
    let saddle = lerp(length + 0.2, saddle, toothed);
    let at =
        |out: f64, g: f64| station.point + station.outward * (out - station.lean * g.max(0.0)) + DVec3::Y * g;
    // The margin lies on the crown as a thin edge; between the crowns papillae stand out.
    let face = |g: f64| {
        let (crown, papilla) =
            (outer_face(&arch.teeth[nearest], at(0.0, g), station.outward), PAPILLA_OUTWARD * outer);
        let apart = ((crown - papilla).powi(2) + PAPILLA_ROUNDING_MM * PAPILLA_ROUNDING_MM).sqrt();
        lerp(0.8 * outer, 0.5 * (crown + papilla + apart), toothed)
    };
    let collar = lerp(margin, length + 2.4, 0.5);
    let (edge, free) = (face(margin), face(margin + 0.9));
    let neck = face(collar).max(face(0.5 * (margin + 0.9 + collar)));
    // The frenulum of the lip, a fold in the midline.
    let fold = FRENULUM_MM * bell(arc / 0.9);
    let knots = [
        (outer + 2.2 + fold, length + 11.0),
        (outer + 1.2 + fold, length + 8.2),
        (outer + 0.7 + root + 0.4 * fold, length + 5.4),
        (outer + 0.5 + root, length + 2.4),
        ((0.5 * (outer + neck) + 0.6).max(neck + 0.45), collar),
        (free + 0.34, margin + 0.9),
        (edge + 0.08, margin - 0.02),
        (edge - 0.6, margin + 0.2 - 0.7 * (1.0 - toothed)),
        (0.0, saddle),
        (0.7 - inner_edge, inner_margin + 0.12 - 0.7 * (1.0 - toothed)),
        (-inner_edge - 0.1, inner_margin - 0.05),
        (-inner_edge - 0.5, inner_margin + 0.35),
        (-lerp(inner, inner_edge, 0.5) - 0.9, lerp(inner_margin, length + 2.4, 0.5)),
        (-inner - 1.5, length + 2.8),
        (-inner - 2.6, length + 4.6),
    ];
    let mut points: Vec<DVec3> = knots.iter().map(|&(out, g)| at(out, g)).collect();
    // The hind end closes like a thumb.
    let end = end_of_gums(arch);
    let closing = smoothstep(end - 6.5, end, arc.abs());
    if closing > 0.0 {
        let heart = at(0.5, length + 6.5);
        let shrink = 1.0 - (1.0 - (1.0 - closing * closing).max(0.0).sqrt()) * 0.995;
        for point in &mut points {
            *point = heart + (*point - heart) * shrink;
        }
    }
    points
}

/// Point where the gum goes over into palate or floor of the mouth, in the jaw frame.
pub(super) fn lingual_border(arch: &Arch, arc: f64) -> DVec3 {
    let points = profile(arch, arc);
    points[points.len() - 1]
}

/// Mesh of the gums of one jaw, in the frame of the mouth. The texture runs from the patient's right to left (u) and
/// from the vestibule over the margin to the tongue side (v).
pub(super) fn gingiva_mesh(arch: &Arch, pose: &JawPose, seed: u32, detail: f64) -> TriangleMesh {
    let end = end_of_gums(arch);
    let arcs = stations(arch, end, count(12, detail));
    // Closest together on the attached gum and around the margin.
    let mut v_values = linspace(0.0, 0.14, count(4, detail));
    v_values.extend(linspace(0.14, 0.54, count(22, detail)).into_iter().skip(1));
    v_values.extend(linspace(0.54, 1.0, count(14, detail)).into_iter().skip(1));
    let mut columns: Vec<Vec<DVec3>> = Vec::with_capacity(arcs.len());
    for &arc in &arcs {
        let knots = profile(arch, arc);
        columns.push(v_values.iter().map(|v| spline(&knots, v * LAST_KNOT)).collect());
    }
    let u_values: Vec<f64> = (0..arcs.len()).map(|i| i as f64).collect();
    let row_numbers: Vec<f64> = (0..v_values.len()).map(|i| i as f64).collect();
    surface_mesh(&row_numbers, &u_values, pose.mirrored, |row, column| {
        let arc = arcs[column as usize];
        let v = v_values[row as usize];
        let station = arch.station(arc);
        let point = columns[column as usize][row as usize] + station.outward * relief(seed, arc, v);
        (pose.point(point), DVec2::new(0.5 + 0.5 * arc / end, v))
    })
}

/// Unevenness of the attached gum with its stipples, and the shallow grooves that part it from the free margin and from the lining
/// of the vestibule, mm; none at the border that palate and floor share.
fn relief(seed: u32, arc: f64, v: f64) -> f64 {
    let knot = v * LAST_KNOT;
    let window = smoothstep(0.0, 0.1, v) * smoothstep(1.0, 0.9, v);
    let attached =
        smoothstep(LINING_KNOT, LINING_KNOT + 0.4, knot) * smoothstep(FREE_KNOT, FREE_KNOT - 0.4, knot);
    let grooves = 0.06 * bell((knot - FREE_KNOT) / 0.35) + 0.1 * bell((knot - LINING_KNOT) / 0.4);
    // The margin clings to the crowns.
    let loose = 1.0 - bell((knot - MARGIN_KNOT) / 0.9);
    let uneven = 0.12 * loose * fractal_noise(seed ^ 0x61, arc * 0.45, knot, 2);
    window * (uneven - grooves) - 0.09 * attached * bumps(seed ^ 0x42, arc / 1.1, 2.2 * knot / 1.1, 0.5, 0.8)
}

/// Stations along the arch, the same number for every tooth, so that all papillae are alike.
fn stations(arch: &Arch, end: f64, per_tooth: usize) -> Vec<f64> {
    let mut arcs = vec![-end];
    arcs.extend(linspace(-end, -arch.end, 3).into_iter().skip(1));
    for tooth in &arch.teeth {
        let (low, high) = (tooth.middle - tooth.half_room, tooth.middle + tooth.half_room);
        let (low, high) = (low.max(-arch.end), high.min(arch.end));
        // Closer together at the papillae.
        let places = linspace(-1.0, 1.0, per_tooth).into_iter().skip(1);
        arcs.extend(places.map(|place| {
            let place = lerp(place, sin_cos(0.5 * PI * place).0, 0.7);
            0.5 * (low + high + (high - low) * place)
        }));
    }
    arcs.extend(linspace(arch.end, end, 3).into_iter().skip(1));
    arcs
}
