//! Floor of the mouth under the tongue.

use glam::{DVec2, DVec3};

use super::dental_arch::{Arch, JawPose};
use super::gingiva::{end_of_border, lingual_border};
use super::math::{bell, pow, smoothstep};
use super::noise::fractal_noise;
use super::parameters::MouthParameters;
use super::surface::{count, grid_mesh, linspace};
use crate::geometry::TriangleMesh;

/// Depth of the floor below the plane of the lower teeth, mm (10 to 15, assumed).
const DEPTH_MM: f64 = 16.0;

/// Part of its texture that lies between the gums, and how far it reaches behind them, mm.
const ALONG_GUMS: f64 = 0.8;
const BEHIND_MM: f64 = 14.0;

/// Mesh of the floor of the mouth; u from the patient's right to left, v from the incisors to the back.
pub(super) fn floor_mesh(parameters: &MouthParameters, arch: &Arch, pose: &JawPose) -> TriangleMesh {
    let detail = parameters.detail;
    let end = end_of_border(arch);
    let v_values = linspace(0.0, 1.0, count(40, detail));
    let u_values = linspace(0.0, 1.0, count(40, detail));
    let front = lingual_border(arch, 0.0);
    grid_mesh(&v_values, &u_values, pose.mirrored, |v, u| {
        let across = 2.0 * u - 1.0;
        // Behind the gums it goes on to the root of the tongue.
        let (arc, beyond) = (end * (v / ALONG_GUMS).min(1.0), (v - ALONG_GUMS).max(0.0) / (1.0 - ALONG_GUMS));
        let (right, left) = (lingual_border(arch, -arc), lingual_border(arch, arc));
        let base = right.lerp(left, u) - DVec3::Z * (BEHIND_MM * beyond);
        let behind = front.z - base.z;
        let bowl = pow(1.0 - across * across, 0.7) * smoothstep(0.0, 12.0, behind);
        let mut depth = (DEPTH_MM - base.y).max(1.0) * bowl;
        // Fold of the frenulum and the two sublingual folds beside it.
        depth -= 2.5 * bell(base.x / 1.4) * bell((behind - 9.0) / 7.0);
        let fold = 4.0 + 0.28 * behind;
        depth -= 1.8 * bell((base.x.abs() - fold) / 2.2) * smoothstep(3.0, 8.0, behind) * bowl;
        depth += 0.4 * fractal_noise(parameters.seed ^ 0x66, base.x * 0.3, base.z * 0.3, 2) * bowl;
        (pose.point(base + DVec3::Y * depth), DVec2::new(u, v))
    })
}
