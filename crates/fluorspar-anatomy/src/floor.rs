//! Floor of the mouth under the tongue.

use glam::{DVec2, DVec3};

use super::dental_arch::{Arch, JawPose};
use super::gingiva::{end_of_border, lingual_border};
use super::math::{bell, pow, smoothstep};
use super::noise::fractal_noise;
use super::parameters::MouthParameters;
use super::surface::{count, linspace, surface_mesh};
use fluorspar::geometry::TriangleMesh;

/// Depth of the floor below the plane of the lower teeth, mm (10 to 15, assumed).
const DEPTH_MM: f64 = 14.0;

/// Where the frenulum ends in its texture.
const FRENULUM_FOOT: f64 = 0.2;

/// Part of its texture that lies between the gums, and how far it reaches behind them, mm.
const ALONG_GUMS: f64 = 0.8;
const BEHIND_MM: f64 = 14.0;

/// Point of the floor in the jaw frame: `across` from -1 (patient's right) to 1, `v` from the incisors to the back.
fn floor_point(p: &MouthParameters, arch: &Arch, across: f64, v: f64) -> DVec3 {
    let end = end_of_border(arch);
    let front = lingual_border(arch, 0.0);
    // Behind the gums it continues to the root of the tongue.
    let (arc, beyond) = (end * (v / ALONG_GUMS).min(1.0), (v - ALONG_GUMS).max(0.0) / (1.0 - ALONG_GUMS));
    let (right, left) = (lingual_border(arch, -arc), lingual_border(arch, arc));
    let base = right.lerp(left, 0.5 * (across + 1.0)) - DVec3::Z * (BEHIND_MM * beyond);
    let behind = front.z - base.z;
    let bowl = pow(1.0 - across * across, 0.6) * smoothstep(0.0, 9.0, behind);
    let mut depth = (DEPTH_MM - base.y).max(1.0) * bowl;
    // Foot of the frenulum, the two sublingual folds beside it and the caruncles in front of them, where their ducts open.
    depth -= 1.6 * bell(base.x / 1.4) * bell((behind - 9.0) / 6.0);
    let fold = 2.2 + 0.42 * behind;
    let lumps = 1.0 + 0.3 * fractal_noise(p.seed ^ 0x67, behind * 0.5, base.x.signum() * 5.0, 2);
    depth -= 2.6 * lumps * bell((base.x.abs() - fold) / 1.9) * smoothstep(5.0, 10.0, behind) * bowl;
    depth -= 2.2 * bell((base.x.abs() - 2.8) / 1.3) * bell((behind - 7.0) / 1.8);
    depth += 0.4 * fractal_noise(p.seed ^ 0x66, base.x * 0.3, base.z * 0.3, 2) * bowl;
    base + DVec3::Y * depth
}

/// Where the frenulum ends behind the lower incisors, in the frame of the mouth.
pub(super) fn frenulum_foot(p: &MouthParameters, arch: &Arch, pose: &JawPose) -> DVec3 {
    pose.point(floor_point(p, arch, 0.0, FRENULUM_FOOT) + DVec3::Y * 1.0)
}

/// Mesh of the floor of the mouth; u from the patient's right to left, v from the incisors to the back.
pub(super) fn floor_mesh(parameters: &MouthParameters, arch: &Arch, pose: &JawPose) -> TriangleMesh {
    let detail = parameters.detail;
    let v_values = linspace(0.0, 1.0, count(64, detail));
    let u_values = linspace(0.0, 1.0, count(64, detail));
    surface_mesh(&v_values, &u_values, pose.mirrored, |v, u| {
        (pose.point(floor_point(parameters, arch, 2.0 * u - 1.0, v)), DVec2::new(u, v))
    })
}
