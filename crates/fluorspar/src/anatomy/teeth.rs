//! Crowns of the teeth, shaped by kind: outlines that change along the crown, and cusps.

use glam::DVec2;

use super::dental_arch::{Jaw, JawPose, Tooth, ToothKind};
use super::math::{PI, bell, curve, exp, lerp, ln, signed_pow, sin_cos, smoothstep};
use super::noise::value_noise;
use super::surface::{count, linspace, surface_mesh};
use crate::geometry::TriangleMesh;

/// Curve over the height of the crown: 0 at the neck, 1 at the biting edge.
type Table = &'static [(f64, f64)];

/// Shape of a crown in units of its own sizes.
struct Form {
    /// Half-width along the arch; 0 stands for the width at the neck, 1 for the full width.
    width: Table,
    /// Distance of the outer and inner surface from the axis, in half-depths.
    outer: Table,
    inner: Table,
    /// Exponent of the superellipse of the sections: 2 is an ellipse, more is squarer.
    squareness: f64,
    /// How much the inner side is narrower than the outer.
    taper: f64,
    /// Shift of the inner side to the distal per depth (rhomboid upper molars).
    skew: f64,
    /// Cusps: place along the arch (distal positive) and outward in half-widths, height below the edge in mm.
    cusps: &'static [[f64; 3]],
    /// Depth of the central fossa below the cusps, mm; 0 for front teeth.
    fossa: f64,
}

const FRONT_WIDTH: Table =
    &[(-0.4, -0.35), (0.0, 0.0), (0.3, 0.72), (0.55, 0.95), (0.72, 1.0), (0.92, 0.99), (1.0, 0.92)];
const INCISOR: Form = Form {
    width: FRONT_WIDTH,
    outer: &[(-0.4, 0.7), (0.0, 0.9), (0.22, 1.0), (0.6, 0.82), (0.93, 0.42), (1.0, 0.26)],
    inner: &[(-0.4, 0.65), (0.0, 0.86), (0.18, 0.92), (0.45, 0.38), (0.75, 0.04), (0.93, -0.04), (1.0, 0.0)],
    squareness: 2.6,
    taper: 0.3,
    skew: 0.0,
    cusps: &[],
    fossa: 0.0,
};
const CANINE: Form = Form {
    width: &[(-0.4, -0.3), (0.0, 0.0), (0.35, 0.6), (0.66, 1.0), (0.85, 0.86), (1.0, 0.66)],
    outer: &[(-0.4, 0.7), (0.0, 0.9), (0.25, 1.0), (0.6, 0.86), (0.9, 0.48), (1.0, 0.3)],
    inner: &[(-0.4, 0.65), (0.0, 0.86), (0.2, 0.95), (0.5, 0.5), (0.8, 0.12), (1.0, 0.0)],
    squareness: 2.3,
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
    width: POSTERIOR_WIDTH,
    outer: POSTERIOR_OUTER,
    inner: POSTERIOR_INNER,
    squareness: 2.3,
    taper: 0.16,
    skew: 0.0,
    cusps: &[[0.0, 0.56, 0.0], [-0.08, -0.5, 0.7]],
    fossa: 2.6,
};
const LOWER_FIRST_PREMOLAR: Form =
    Form { taper: 0.25, cusps: &[[0.0, 0.42, 0.0], [0.0, -0.55, 2.4]], fossa: 2.9, ..UPPER_PREMOLAR };
const LOWER_SECOND_PREMOLAR: Form = Form {
    squareness: 2.6,
    taper: 0.08,
    cusps: &[[0.0, 0.48, 0.0], [-0.38, -0.52, 0.8], [0.38, -0.52, 1.1]],
    fossa: 2.4,
    ..UPPER_PREMOLAR
};
const UPPER_MOLAR: Form = Form {
    squareness: 3.0,
    taper: 0.05,
    skew: 0.1,
    cusps: &[[-0.44, 0.54, 0.2], [0.42, 0.52, 0.5], [-0.36, -0.5, 0.0], [0.48, -0.54, 1.1]],
    fossa: 2.7,
    ..UPPER_PREMOLAR
};
const UPPER_SECOND_MOLAR: Form =
    Form { taper: 0.18, cusps: &[[-0.42, 0.54, 0.1], [0.42, 0.5, 0.6], [-0.1, -0.5, 0.0]], ..UPPER_MOLAR };
const LOWER_FIRST_MOLAR: Form = Form {
    squareness: 3.0,
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
        (_, ToothKind::CentralIncisor | ToothKind::LateralIncisor) => &INCISOR,
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
            // Soft maximum of rounded cones at the cusps, the marginal ridges and the floor of the fossa.
            const SHARPNESS: f64 = 3.2;
            let (half_width, half_depth) = (0.5 * tooth.width, 0.5 * tooth.depth);
            let mut sum = 0.0;
            let mut highest = 0.0_f64;
            for cusp in form.cusps {
                let dx = (m - cusp[0]) * half_width;
                let dy = (b - cusp[1]) * half_depth;
                // Steeper to the outside than to the fossa.
                let outside = if dy * cusp[1] > 0.0 { 1.15 } else { 0.78 };
                let distance = (dx * dx * 0.8 + dy * dy + 0.16).sqrt() - 0.4;
                sum += exp(SHARPNESS * (-cusp[2] - outside * distance));
                highest = highest.max(-cusp[2]);
            }
            let ridge = 1.1 * smoothstep(0.45, 0.72, m.abs());
            let floor = -form.fossa + ridge;
            sum += exp(SHARPNESS * floor);
            let groove = 0.22 * bell(b / 0.09) * (1.0 - smoothstep(0.45, 0.65, m.abs()));
            groove - ln(sum) / SHARPNESS
        }
    }
}

/// Mesh of one crown with the upper part of its root, in the frame of the mouth.
pub(super) fn tooth_mesh(tooth: &Tooth, pose: &JawPose, seed: u32, detail: f64) -> TriangleMesh {
    let form = form(tooth);
    let front = form.cusps.is_empty();
    // The wall runs from the root to the rim of the biting surface (v = 1), the cap from there to the middle (v = 2).
    let wall = count(18, detail);
    let mut v_values: Vec<f64> = (0..=wall)
        .map(|i| {
            let x = i as f64 / wall as f64;
            // Rows are closer together toward the rim.
            -0.38 + 1.38 * (1.0 - (1.0 - x) * (1.0 - 0.55 * x))
        })
        .collect();
    let cap = if front { count(4, detail) } else { count(11, detail) };
    v_values.extend(linspace(1.0, 2.0, cap).into_iter().skip(1));
    let around = count(if front { 36 } else { 44 }, detail);
    let u_values = linspace(0.0, 1.0, around);
    let number_seed = seed.wrapping_add(u32::from(tooth.number) * 977);
    let section = |height: f64, u: f64| {
        // u = 0 is lingual, 0.25 mesial, 0.5 buccal, 0.75 distal.
        let (sine, cosine) = sin_cos(2.0 * PI * u);
        let power = 2.0 / form.squareness;
        let half_width = 0.5 * lerp(tooth.neck_width, tooth.width, curve(form.width, height));
        let outer = curve(form.outer, height);
        let inner = curve(form.inner, height);
        let b = 0.5 * (outer - inner) - 0.5 * (outer + inner) * signed_pow(cosine, power);
        let inside = 0.5 * (1.0 + cosine) * smoothstep(1.05, 0.6, height);
        let mut m = -half_width / (0.5 * tooth.width) * signed_pow(sine, power) * (1.0 - form.taper * inside);
        m -= form.skew * b * smoothstep(0.0, 0.4, height);
        // Shallow grooves between the lobes of the outer face.
        let lobes = if front { 0.02 } else { 0.045 };
        let groove = if front {
            bell((m - 0.3) / 0.16) + bell((m + 0.3) / 0.16)
        } else if form.cusps.len() > 2 {
            bell((m - 0.02) / 0.16)
        } else {
            0.0
        };
        let face = smoothstep(0.1, 0.6, -cosine) * smoothstep(0.25, 0.7, height);
        DVec2::new(m, b - lobes * groove * face)
    };
    let flip = (tooth.middle < 0.0) != pose.mirrored;
    surface_mesh(&v_values, &u_values, flip, |v, u| {
        let texture_u = u;
        // The seam closes exactly.
        let u = if u >= 1.0 { 0.0 } else { u };
        let rim = section(v.min(1.0), u);
        let (place, height) = if v <= 1.0 {
            let top = tooth.length - relief(tooth, form, section(1.0, u).x, section(1.0, u).y);
            (rim, v * top)
        } else {
            let centre_b = 0.5 * (curve(form.outer, 1.0) - curve(form.inner, 1.0));
            let place = DVec2::new(0.0, centre_b).lerp(rim, 2.0 - v);
            let mut height = tooth.length - relief(tooth, form, place.x, place.y);
            if front {
                // A rounded edge instead of a flat one.
                let t = 2.0 - v;
                height += 0.22 * (1.0 - t * t);
            }
            (place, height)
        };
        // Enamel is not perfectly even.
        let ripple = 0.03 * value_noise(number_seed, place.x * 4.0 + 9.0, place.y * 4.0 + height * 0.9);
        let m = place.x * 0.5 * tooth.width;
        let b = place.y * 0.5 * tooth.depth + ripple;
        let point =
            tooth.edge + tooth.distal * m + tooth.outward * b + tooth.biting * (height - tooth.length);
        (pose.point(point), DVec2::new(texture_u, height / tooth.length))
    })
}
