//! Roof of the mouth: the vault of the hard palate with its folds.

use glam::{DVec2, DVec3};

use super::dental_arch::{Arch, JawPose, ToothKind};
use super::gingiva::{end_of_border, lingual_border};
use super::math::{bell, pow, smoothstep};
use super::noise::fractal_noise;
use super::parameters::MouthParameters;
use super::surface::{count, linspace, surface_mesh};
use crate::geometry::TriangleMesh;

/// How much of the vault's height is reached at a place across: 1 in the middle, 0 at the gums.
fn vault(across: f64) -> f64 {
    let a = across.abs().min(1.0);
    pow(1.0 - pow(a, 2.3), 0.85)
}

/// Point of the hard palate in the jaw frame: `arc` along the gums, `across` from -1 (patient's right) to 1.
pub(super) fn hard_palate_point(parameters: &MouthParameters, arch: &Arch, arc: f64, across: f64) -> DVec3 {
    let (right, left) = (lingual_border(arch, -arc), lingual_border(arch, arc));
    let base = right.lerp(left, 0.5 * (across + 1.0));
    // The vault rises steeply behind the incisors and is full at the first molars.
    let front = lingual_border(arch, 0.0);
    let behind = front.z - base.z;
    let top = parameters.palate_height_mm * (1.0 + 0.02 * smoothstep(25.0, 45.0, behind))
        + arch.spee(base.z) * smoothstep(8.0, 24.0, behind);
    let molar =
        arch.teeth.iter().find(|t| t.kind == ToothKind::FirstMolar).map_or(25.0, |t| front.z - t.edge.z);
    let start = smoothstep(-0.4 * molar, molar, 0.0);
    let rise = (smoothstep(-0.4 * molar, molar, behind) - start) / (1.0 - start);
    let mut height = (top - base.y) * rise.max(0.0) * vault(across);
    let x = base.x;
    // Folds behind the incisors, curved and broken at the midline ridge.
    let side = bell(x / 1.6);
    let mut fold = 0.0;
    for (number, place) in [5.5, 9.5, 13.5, 17.5].into_iter().enumerate() {
        let number = number as f64;
        let bend = 0.13 * x.abs() - 0.5 * bell((x.abs() - 6.0) / 3.0)
            + 0.6
                * fractal_noise(
                    parameters.seed ^ 0x75,
                    x * 0.3 + 11.0 * number,
                    if x > 0.0 { 3.5 } else { 8.5 },
                    2,
                );
        let reach = smoothstep(16.0 - 1.5 * number, 9.0 - number, x.abs());
        fold += (1.0 - 0.1 * number) * bell((behind - place - bend) / 0.9) * reach;
    }
    height -= fold * (1.0 - 0.9 * side) * smoothstep(1.0, 0.75, across.abs());
    // Incisive papilla and the ridge of the midline.
    height -= 1.0 * bell(x / 1.7) * bell((behind - 2.6) / 2.0);
    height -= 0.35 * bell(x / 0.9) * smoothstep(4.0, 9.0, behind) * smoothstep(50.0, 34.0, behind);
    height +=
        0.15 * fractal_noise(parameters.seed ^ 0x76, x * 0.35, base.z * 0.35, 3) * (1.0 - across * across);
    // All columns start from one point behind the incisors.
    base + DVec3::Y * (height * smoothstep(0.0, 1.2, behind))
}

/// Mesh of the hard palate; u from the patient's right to left, v from the incisors to the soft palate.
pub(super) fn hard_palate_mesh(parameters: &MouthParameters, arch: &Arch, pose: &JawPose) -> TriangleMesh {
    let detail = parameters.detail;
    let end = end_of_border(arch);
    let v_values = linspace(0.0, 1.0, count(64, detail));
    let u_values = linspace(0.0, 1.0, count(60, detail));
    surface_mesh(&v_values, &u_values, pose.mirrored, |v, u| {
        let arc = end * v;
        (pose.point(hard_palate_point(parameters, arch, arc, 2.0 * u - 1.0)), DVec2::new(u, v))
    })
}
