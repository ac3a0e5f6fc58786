//! Gums: a profile swept along the arch, with a scalloped margin around the necks of the teeth.

use glam::{DVec2, DVec3};

use super::dental_arch::{Arch, JawPose, Station};
use super::math::{PI, bell, lerp, pow, sin_cos, smoothstep, spline};
use super::noise::fractal_noise;
use super::surface::{count, linspace, surface_mesh};
use fluorspar::geometry::TriangleMesh;

/// How far the gums reach behind the arch, mm.
const BEHIND_MM: f64 = 2.0;

/// Height of the papillae in crowns: they fill the spaces below the contacts (42 % in front, Chu and others 2009).
const PAPILLA_SHARE: f64 = 0.45;

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
    let Station { length, outer, inner, toothed, .. } = station;
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
    // Between the teeth the gum lies behind their outer faces.
    let outer_margin = outer * (1.0 - 0.27 * pow(across, 5.0) * toothed - 0.2 * (1.0 - toothed));
    let inner_edge = inner * (1.0 - 0.3 * pow(across, 2.0) * toothed - 0.2 * (1.0 - toothed));
    // Roots bulge under the gum.
    let root = 0.55 * bell(across / 0.55) * toothed;
    let saddle = lerp(length - 0.4, contact + 0.9, papilla);
    let saddle = lerp(length + 0.2, saddle, toothed);
    let at =
        |out: f64, g: f64| station.point + station.outward * (out - station.lean * g.max(0.0)) + DVec3::Y * g;
    let knots = [
        (outer + 2.2, length + 11.0),
        (outer + 1.2, length + 8.2),
        (outer + 0.7 + root, length + 5.4),
        (outer + 0.5 + root, length + 2.4),
        (lerp(outer, outer_margin, 0.55) + 0.62, lerp(margin, length + 2.4, 0.4)),
        (outer_margin + 0.5, margin + 0.35),
        (outer_margin + 0.1, margin - 0.05),
        (outer_margin - 0.7, margin + 0.12 - 0.7 * (1.0 - toothed)),
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
    let rows = count(34, detail);
    let last_knot = 14.0;
    let v_values = linspace(0.0, 1.0, rows);
    let mut columns: Vec<Vec<DVec3>> = Vec::with_capacity(arcs.len());
    for &arc in &arcs {
        let knots = profile(arch, arc);
        columns.push(v_values.iter().map(|v| spline(&knots, v * last_knot)).collect());
    }
    let u_values: Vec<f64> = (0..arcs.len()).map(|i| i as f64).collect();
    let row_numbers: Vec<f64> = (0..=rows).map(|i| i as f64).collect();
    surface_mesh(&row_numbers, &u_values, pose.mirrored, |row, column| {
        let arc = arcs[column as usize];
        let mut point = columns[column as usize][row as usize];
        let v = row / rows as f64;
        // Slight unevenness of the attached gum; none at the border that palate and floor share.
        let station = arch.station(arc);
        let window = smoothstep(0.0, 0.1, v) * smoothstep(1.0, 0.9, v);
        point += station.outward * (0.12 * window * fractal_noise(seed ^ 0x61, arc * 0.45, v * 14.0, 2));
        (pose.point(point), DVec2::new(0.5 + 0.5 * arc / end, v))
    })
}

/// Stations along the arch, the same number for every tooth, so that all papillae are alike.
fn stations(arch: &Arch, end: f64, per_tooth: usize) -> Vec<f64> {
    let mut arcs = vec![-end];
    arcs.extend(linspace(-end, -arch.end, 3).into_iter().skip(1));
    for tooth in &arch.teeth {
        let (low, high) = (tooth.middle - tooth.half_room, tooth.middle + tooth.half_room);
        let (low, high) = (low.max(-arch.end), high.min(arch.end));
        // Closer together at the papillae.
        let turns = linspace(-0.5 * PI, 0.5 * PI, per_tooth).into_iter().skip(1);
        arcs.extend(turns.map(|turn| 0.5 * (low + high + (high - low) * sin_cos(turn).0)));
    }
    arcs.extend(linspace(arch.end, end, 3).into_iter().skip(1));
    arcs
}
