//! Crowns of the teeth, shaped by kind: outlines that change along the crown, and cusps.

use glam::{DVec2, DVec3};

use super::dental_arch::{Jaw, JawPose, Tooth, ToothKind, UPPER_INCISOR_DEPTH_MM};
use super::math::{PI, bell, curve, exp, lerp, ln, pow, signed_pow, sin_cos, smoothstep};
use super::noise::value_noise;
use super::surface::{count, surface_mesh};
use fluorspar::geometry::TriangleMesh;

/// Curve over the height of the crown: 0 at the neck, 1 at the biting edge.
type Table = &'static [(f64, f64)];

/// Shape of a crown in units of its own sizes.
struct Form {
    /// Half-widths along the arch of the mesial and the distal side; 0 stands for the width at the neck, 1 for the full width.
    mesial: Table,
    distal: Table,
    /// Distance of the outer and inner surface from the axis, in half-depths.
    outer: Table,
    inner: Table,
    /// Exponents of the superellipses of the sections' outer and inner halves: 2 is an ellipse, more is squarer.
    squareness: [f64; 2],
    /// Relative narrowing of the inner side.
    taper: f64,
    /// Shift of the inner side to the distal per depth (rhomboid upper molars).
    skew: f64,
    /// Cusps: place along the arch (distal positive) and outward in half-widths, height below the edge in mm.
    cusps: &'static [[f64; 3]],
    /// Depth of the central fossa below the cusps, mm; 0 for front teeth.
    fossa: f64,
}

/// Sides that touch over two fifths of the height and part in the third at the gum, where the papilla stands (Stappert and others
/// 2010): the mesial one is straighter.
const INCISOR: Form = Form {
    mesial: &[(-0.4, -0.35), (0.0, 0.0), (0.2, 0.5), (0.4, 0.88), (0.55, 0.98), (0.75, 1.0), (1.0, 0.97)],
    distal: &[(-0.4, -0.35), (0.0, 0.0), (0.2, 0.52), (0.4, 0.9), (0.6, 1.0), (0.8, 0.98), (1.0, 0.86)],
    outer: &[(-0.4, 0.7), (0.0, 0.9), (0.22, 1.0), (0.6, 0.82), (0.93, 0.42), (1.0, 0.26)],
    inner: &[(-0.4, 0.65), (0.0, 0.86), (0.2, 0.94), (0.45, 0.42), (0.75, 0.06), (0.93, -0.03), (1.0, 0.0)],
    squareness: [4.2, 2.0],
    taper: 0.28,
    skew: 0.0,
    cusps: &[],
    fossa: 0.0,
};
const LOWER_INCISOR: Form = Form {
    mesial: &[(-0.4, -0.35), (0.0, 0.0), (0.25, 0.42), (0.5, 0.8), (0.75, 0.99), (0.88, 1.0), (1.0, 0.97)],
    distal: &[(-0.4, -0.35), (0.0, 0.0), (0.25, 0.42), (0.5, 0.8), (0.72, 0.99), (0.85, 1.0), (1.0, 0.94)],
    ..INCISOR
};
const CANINE: Form = Form {
    mesial: &[(-0.4, -0.3), (0.0, 0.0), (0.35, 0.66), (0.62, 0.98), (0.74, 1.0), (0.88, 0.86), (1.0, 0.66)],
    distal: &[(-0.4, -0.3), (0.0, 0.0), (0.3, 0.66), (0.52, 0.98), (0.62, 1.0), (0.82, 0.86), (1.0, 0.66)],
    outer: &[(-0.4, 0.7), (0.0, 0.9), (0.25, 1.0), (0.6, 0.86), (0.9, 0.48), (1.0, 0.3)],
    inner: &[(-0.4, 0.65), (0.0, 0.86), (0.2, 0.95), (0.5, 0.5), (0.8, 0.12), (1.0, 0.0)],
    squareness: [2.9, 2.0],
    taper: 0.3,
    skew: 0.0,
    cusps: &[],
    fossa: 0.0,
};
const POSTERIOR_WIDTH: Table =
    &[(-0.4, -0.5), (0.0, 0.0), (0.35, 0.62), (0.7, 1.0), (0.88, 0.92), (1.0, 0.7)];
const POSTERIOR_OUTER: Table = &[(-0.4, 0.8), (0.0, 0.92), (0.3, 1.0), (0.7, 0.9), (0.9, 0.77), (1.0, 0.66)];
const POSTERIOR_INNER: Table =
    &[(-0.4, 0.75), (0.0, 0.88), (0.45, 1.0), (0.75, 0.94), (0.92, 0.8), (1.0, 0.68)];
const UPPER_PREMOLAR: Form = Form {
    mesial: POSTERIOR_WIDTH,
    distal: POSTERIOR_WIDTH,
    outer: POSTERIOR_OUTER,
    inner: POSTERIOR_INNER,
    squareness: [3.0, 2.5],
    taper: 0.16,
    skew: 0.0,
    cusps: &[[0.0, 0.56, 0.0], [-0.08, -0.5, 0.7]],
    fossa: 2.6,
};
const LOWER_FIRST_PREMOLAR: Form =
    Form { taper: 0.25, cusps: &[[0.0, 0.42, 0.0], [0.0, -0.55, 2.4]], fossa: 2.9, ..UPPER_PREMOLAR };
const LOWER_SECOND_PREMOLAR: Form = Form {
    squareness: [3.2, 2.7],
    taper: 0.08,
    cusps: &[[0.0, 0.48, 0.0], [-0.38, -0.52, 0.8], [0.38, -0.52, 1.1]],
    fossa: 2.4,
    ..UPPER_PREMOLAR
};
const UPPER_MOLAR: Form = Form {
    squareness: [3.6, 3.0],
    taper: 0.05,
    skew: 0.1,
    cusps: &[[-0.44, 0.54, 0.2], [0.42, 0.52, 0.5], [-0.36, -0.5, 0.0], [0.48, -0.54, 1.1]],
    fossa: 2.7,
    ..UPPER_PREMOLAR
};
const UPPER_SECOND_MOLAR: Form = Form {
    taper: 0.18,
    cusps: &[[-0.42, 0.54, 0.1], [0.42, 0.5, 0.6], [-0.3, -0.5, 0.0], [0.46, -0.5, 1.3]],
    ..UPPER_MOLAR
};
const LOWER_FIRST_MOLAR: Form = Form {
    squareness: [3.6, 3.0],
    taper: 0.08,
    skew: 0.0,
    cusps: &[[-0.5, 0.5, 0.5], [0.08, 0.54, 0.6], [0.58, 0.3, 1.0], [-0.44, -0.52, 0.0], [0.4, -0.5, 0.1]],
    ..UPPER_MOLAR
};
const LOWER_SECOND_MOLAR: Form = Form {
    cusps: &[[-0.46, 0.5, 0.3], [0.46, 0.5, 0.5], [-0.44, -0.52, 0.0], [0.44, -0.5, 0.1]],
    ..LOWER_FIRST_MOLAR
};

fn form(tooth: &Tooth) -> &'static Form {
    match (tooth.jaw, tooth.kind) {
        (Jaw::Upper, ToothKind::CentralIncisor | ToothKind::LateralIncisor) => &INCISOR,
        (Jaw::Lower, ToothKind::CentralIncisor | ToothKind::LateralIncisor) => &LOWER_INCISOR,
        (_, ToothKind::Canine) => &CANINE,
        (Jaw::Upper, ToothKind::FirstPremolar | ToothKind::SecondPremolar) => &UPPER_PREMOLAR,
        (Jaw::Upper, ToothKind::FirstMolar) => &UPPER_MOLAR,
        (Jaw::Upper, ToothKind::SecondMolar | ToothKind::ThirdMolar) => &UPPER_SECOND_MOLAR,
        (Jaw::Lower, ToothKind::FirstPremolar) => &LOWER_FIRST_PREMOLAR,
        (Jaw::Lower, ToothKind::SecondPremolar) => &LOWER_SECOND_PREMOLAR,
        (Jaw::Lower, ToothKind::FirstMolar) => &LOWER_FIRST_MOLAR,
        (Jaw::Lower, ToothKind::SecondMolar | ToothKind::ThirdMolar) => &LOWER_SECOND_MOLAR,
    }
}

/// Height below the highest point of the crown of the biting edge or chewing surface, mm; `m` and `b` are the place
/// distally and outward in half-widths.
fn relief(tooth: &Tooth, form: &Form, m: f64, b: f64) -> f64 {
    match tooth.kind {
        ToothKind::CentralIncisor | ToothKind::LateralIncisor => {
            // The distal corner is rounder than the mesial one, most on the upper lateral incisor.
            let round = match (tooth.jaw, tooth.kind) {
                (Jaw::Upper, ToothKind::LateralIncisor) => 1.5,
                (Jaw::Upper, _) => 1.0,
                (Jaw::Lower, _) => 0.55,
            };
            let mamelons = 0.05 * bell((m - 0.3) / 0.12) + 0.05 * bell((m + 0.3) / 0.12);
            let distal = smoothstep(0.25, 1.0, m);
            let mesial = smoothstep(0.55, 1.0, -m);
            round * (0.9 * distal * distal + 0.45 * mesial * mesial) + mamelons
        }
        ToothKind::Canine => {
            // One cusp with a short mesial and a longer distal slope.
            let peak = -0.08;
            let away = m - peak;
            let slope = if away > 0.0 { 2.6 } else { 2.1 };
            slope * ((away * away + 0.015).sqrt() - 0.12)
        }
        _ => {
            // Soft maximum of cusps, the marginal ridges and the floor of the fossa. Cusps are pyramids: one ridge leads to the
            // middle of the crown, others along the rim and down the outside.
            const SHARPNESS: f64 = 3.2;
            /// How round the tip of a cusp is, mm.
            const TIP_MM: f64 = 0.6;
            let (half_width, half_depth) = (0.5 * tooth.width, 0.5 * tooth.depth);
            let mut sum = 0.0;
            let (mut first, mut second) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
            for &[cusp_m, cusp_b, below] in form.cusps {
                let to_middle = DVec2::new(-cusp_m * half_width, -cusp_b * half_depth).normalize();
                let from = DVec2::new((m - cusp_m) * half_width, (b - cusp_b) * half_depth);
                let (along, across) = (from.dot(to_middle), from.perp_dot(to_middle));
                let corner = (along * along * across * across + 0.09).sqrt() - 0.3;
                // Steeper to the outside than to the fossa.
                let slope = lerp(1.15, 0.7, smoothstep(-1.0, 1.0, along));
                let distance =
                    (along * along + across * across + 1.2 * corner + TIP_MM * TIP_MM).sqrt() - TIP_MM;
                let height = -below - slope * distance;
                sum += exp(SHARPNESS * height);
                if height > first {
                    (first, second) = (height, first);
                } else {
                    second = second.max(height);
                }
            }
            let proximal = m.abs();
            sum += exp(SHARPNESS * (-form.fossa + 1.0 * smoothstep(0.4, 0.75, proximal)));
            // Fissures run where the slopes of two cusps meet, and end at the marginal ridges.
            let fissure = 0.6 * bell((first - second) / 0.3) * (1.0 - smoothstep(0.5, 0.75, proximal));
            fissure - ln(sum) / SHARPNESS
        }
    }
}

/// Texture coordinate of the neck and of the rim of the biting surface; below the neck is root, above the rim the biting
/// surface with its middle at 1.
pub(super) const NECK_V: f64 = 0.03;
pub(super) const RIM_V: f64 = 0.9;
/// How far the edge of a front tooth is rounded, mm.
const ROUNDING_MM: f64 = 0.22;

/// How far the inner face of an upper central incisor is behind its outer one, mm, at a place of its texture.
pub(super) fn incisor_thickness_mm(v: f64) -> f64 {
    let height = ((v - NECK_V) / (RIM_V - NECK_V)).clamp(0.0, 1.0);
    0.5 * UPPER_INCISOR_DEPTH_MM * (curve(INCISOR.outer, height) + curve(INCISOR.inner, height))
}

/// Middle of the biting edge of a front tooth, in the frame of its jaw.
pub(super) fn edge_middle(tooth: &Tooth) -> DVec3 {
    let form = form(tooth);
    tooth.edge + tooth.outward * (0.5 * tooth.depth * middle_of_rim(form))
}

/// How far outward of its axis a crown touches its neighbors, mm.
pub(super) fn contact_outward(tooth: &Tooth) -> f64 {
    let form = form(tooth);
    0.25 * tooth.depth * (curve(form.outer, 0.7) - curve(form.inner, 0.7))
}

/// How far outward of a point of the jaw the outer face of a crown lies, along a direction across the arch, mm; beyond the sides of the
/// crown the middle between both faces.
pub(super) fn outer_face(tooth: &Tooth, from: DVec3, outward: DVec3) -> f64 {
    /// In half-widths, so that no corner comes through what lies on the face.
    const WIDER: f64 = 0.06;
    let form = form(tooth);
    let mut out = 0.0;
    for _ in 0..3 {
        let place = from + outward * out - tooth.edge;
        let there = level(tooth, form, 1.0 + place.dot(tooth.biting) / tooth.length);
        let along = place.dot(tooth.distal);
        let share = along.abs() / there.half_widths[usize::from(along > 0.0)];
        let share = (share - WIDER).clamp(0.0, 1.0);
        let round = pow(1.0 - pow(share, form.squareness[0]), 1.0 / form.squareness[0]);
        let face = 0.5 * (there.outer - there.inner + (there.outer + there.inner) * round);
        out += (face * 0.5 * tooth.depth - place.dot(tooth.outward)) / outward.dot(tooth.outward);
    }
    out
}

/// Place of the middle of the rim outward, in half-depths.
fn middle_of_rim(form: &Form) -> f64 {
    0.5 * (curve(form.outer, 1.0) - curve(form.inner, 1.0))
}

/// How far the ridges beside the lingual fossa of a front tooth stand out, in half-depths.
fn marginal_ridge(m: f64, height: f64) -> f64 {
    0.16 * smoothstep(0.4, 0.8, m.abs()) * smoothstep(0.2, 0.42, height) * smoothstep(1.0, 0.85, height)
}

/// A row of a crown: what all its points share.
struct Level {
    height: f64,
    /// To the mesial and to the distal.
    half_widths: [f64; 2],
    outer: f64,
    inner: f64,
}

/// A column of a crown: cosine and powers of sine and cosine around it. Column 0 is lingual, a quarter mesial, half buccal, three
/// quarters distal.
struct Meridian {
    cosine: f64,
    across: f64,
    outward: f64,
}

fn level(tooth: &Tooth, form: &Form, height: f64) -> Level {
    let half_width = |table| 0.5 * lerp(tooth.neck_width, tooth.width, curve(table, height));
    Level {
        height,
        half_widths: [half_width(form.mesial), half_width(form.distal)],
        outer: curve(form.outer, height),
        inner: curve(form.inner, height),
    }
}

/// Columns of a crown, the first one again at the end: the seam closes exactly.
fn meridians(form: &Form, around: usize) -> Vec<Meridian> {
    (0..=around)
        .map(|i| {
            let (sine, cosine) = sin_cos(2.0 * PI * (i % around) as f64 / around as f64);
            let power = 2.0 / form.squareness[usize::from(cosine > 0.0)];
            Meridian { cosine, across: signed_pow(sine, power), outward: signed_pow(cosine, power) }
        })
        .collect()
}

/// How deep the wall of a crown penetrates that of another one, mm: the deepest of its places, each by the shorter of the
/// ways out along the arch and across it.
pub(super) fn overlap(tooth: &Tooth, other: &Tooth) -> f64 {
    let (own_form, form) = (form(tooth), form(other));
    let columns = meridians(own_form, 32);
    let mut deepest = 0.0_f64;
    for step in 0..=10 {
        let own = level(tooth, own_form, 0.4 + 0.06 * f64::from(step));
        for column in &columns {
            let place = section(tooth, own_form, &own, column);
            let from = tooth.edge - other.edge
                + tooth.distal * (place.x * 0.5 * tooth.width)
                + tooth.outward * (place.y * 0.5 * tooth.depth)
                + tooth.biting * ((own.height - 1.0) * tooth.length);
            let height = 1.0 + from.dot(other.biting) / other.length;
            if !(0.0..1.0).contains(&height) {
                continue;
            }
            // The other way round than in `section`.
            let mut there = level(other, form, height);
            let b = from.dot(other.outward) / (0.5 * other.depth);
            if form.cusps.is_empty() {
                there.inner += marginal_ridge(from.dot(other.distal) / (0.5 * other.width), height);
            }
            // A little larger than it is, for the unevenness of enamel.
            const MARGIN_MM: f64 = 0.03;
            let half_depth = 0.5 * (there.outer + there.inner) + MARGIN_MM / (0.5 * other.depth);
            let y = (b - 0.5 * (there.outer - there.inner)) / half_depth;
            if y.abs() >= 1.0 {
                continue;
            }
            let n = form.squareness[usize::from(y < 0.0)];
            let inside = smoothstep(0.0, 0.8, -signed_pow(y, 0.5 * n)) * smoothstep(1.05, 0.6, height);
            let skew = form.skew * b * smoothstep(0.0, 0.4, height) * 0.5 * other.width;
            let along = from.dot(other.distal) + skew;
            let half_width =
                there.half_widths[usize::from(along > 0.0)] * (1.0 - form.taper * inside) + MARGIN_MM;
            let x = (along / half_width).abs();
            if x >= 1.0 {
                continue;
            }
            let along = (pow(1.0 - pow(y.abs(), n), 1.0 / n) - x) * half_width;
            let across = (pow(1.0 - pow(x, n), 1.0 / n) - y.abs()) * half_depth * 0.5 * other.depth;
            deepest = deepest.max(along.min(across));
        }
    }
    deepest
}

/// Place of a crown's surface at a level, distally and outward in half-sizes.
fn section(tooth: &Tooth, form: &Form, level: &Level, meridian: &Meridian) -> DVec2 {
    let (height, front) = (level.height, form.cusps.is_empty());
    let b = 0.5 * (level.outer - level.inner) - 0.5 * (level.outer + level.inner) * meridian.outward;
    let inside = smoothstep(0.0, 0.8, meridian.cosine) * smoothstep(1.05, 0.6, height);
    let half_width = level.half_widths[usize::from(meridian.across < 0.0)];
    let mut m = -half_width / (0.5 * tooth.width) * meridian.across * (1.0 - form.taper * inside);
    m -= form.skew * b * smoothstep(0.0, 0.4, height);
    if front {
        // Shallow grooves between the lobes of the outer face; marginal ridges around the fossa of the inner one.
        let lobes = bell((m - 0.3) / 0.16) + bell((m + 0.3) / 0.16);
        let face = smoothstep(0.1, 0.6, -meridian.cosine) * smoothstep(0.25, 0.7, height);
        let ridge = marginal_ridge(m, height) * smoothstep(0.0, 0.25, meridian.cosine);
        DVec2::new(m, b - 0.02 * lobes * face - ridge)
    } else if form.cusps.len() > 2 {
        // The groove between the buccal cusps runs down the face.
        let face = smoothstep(0.1, 0.6, -meridian.cosine) * smoothstep(0.3, 0.75, height);
        DVec2::new(m, b - 0.05 * bell((m - 0.02) / 0.14) * face)
    } else {
        DVec2::new(m, b)
    }
}

/// Mesh of one crown with the upper part of its root, in the frame of the mouth. The texture runs around the crown (u)
/// and from the root over the rim to the middle of the biting surface (v).
pub(super) fn tooth_mesh(tooth: &Tooth, pose: &JawPose, seed: u32, detail: f64) -> TriangleMesh {
    let form = form(tooth);
    let front = form.cusps.is_empty();
    // The wall runs from the root to the rim, the cap from there to the middle.
    let wall = count(18, detail);
    let levels: Vec<Level> = (0..=wall)
        .map(|i| {
            let x = i as f64 / wall as f64;
            // Rows are closer together toward the rim.
            level(tooth, form, -0.38 + 1.38 * (1.0 - (1.0 - x) * (1.0 - 0.55 * x)))
        })
        .collect();
    let cap = if front { count(5, detail) } else { count(20, detail) };
    let around = count(if front { 40 } else { 72 }, detail);
    let meridians = meridians(form, around);
    let top_level = level(tooth, form, 1.0);
    let rounding = if front { ROUNDING_MM } else { 0.0 };
    let rim: Vec<(DVec2, f64)> = meridians
        .iter()
        .map(|meridian| {
            let place = section(tooth, form, &top_level, meridian);
            (place, tooth.length - rounding - relief(tooth, form, place.x, place.y))
        })
        .collect();
    let middle = DVec2::new(0.0, middle_of_rim(form));
    let number_seed = seed.wrapping_add(u32::from(tooth.number) * 977);
    let flip = (tooth.middle < 0.0) != pose.mirrored;
    let rows: Vec<f64> = (0..=wall + cap).map(|i| i as f64).collect();
    let columns: Vec<f64> = (0..=around).map(|i| i as f64).collect();
    surface_mesh(&rows, &columns, flip, |row, column| {
        let (row, column) = (row as usize, column as usize);
        let (rim_place, rim_height) = rim[column];
        let (place, height, texture_v) = if let Some(level) = levels.get(row) {
            let texture_v = if level.height < 0.0 {
                NECK_V * (1.0 + level.height / 0.38)
            } else {
                lerp(NECK_V, RIM_V, level.height)
            };
            (section(tooth, form, level, &meridians[column]), level.height * rim_height, texture_v)
        } else {
            let inward = (row - wall) as f64 / cap as f64;
            let t = 1.0 - inward;
            let place = middle.lerp(rim_place, t);
            // The edge of a front tooth is rounded instead of flat.
            let height = tooth.length - relief(tooth, form, place.x, place.y) - rounding * t * t;
            (place, height, lerp(RIM_V, 1.0, inward))
        };
        // Enamel is not perfectly even.
        let ripple = 0.03 * value_noise(number_seed, place.x * 4.0 + 9.0, place.y * 4.0 + height * 0.9);
        let m = place.x * 0.5 * tooth.width;
        let b = place.y * 0.5 * tooth.depth + ripple;
        let point =
            tooth.edge + tooth.distal * m + tooth.outward * b + tooth.biting * (height - tooth.length);
        (pose.point(point), DVec2::new(column as f64 / around as f64, texture_v))
    })
}
