//! The gate of the throat: soft palate with its arches, uvula, hind arches and tonsils.

use glam::{DVec2, DVec3};

use super::dental_arch::JawPose;
use super::math::{PI, bell, curve, lerp, pow, sin_cos, smoothstep};
use super::noise::{bumps, fractal_noise};
use super::palate::{Line, Palate};
use super::parameters::MouthParameters;
use super::surface::{Surface, count, linspace, surface_mesh};
use fluorspar::geometry::TriangleMesh;

/// Where the soft palate goes over into the arches beside it, as a share of its half width.
const ARCH_FROM: f64 = 0.62;

/// The soft palate and what hangs from it, in the frame of the upper jaw.
pub(super) struct Fauces<'a> {
    parameters: &'a MouthParameters,
    palate: &'a Palate<'a>,
    pose: &'a JawPose,
    /// Hind edge of the hard palate and its middle.
    edge: Line,
    crest: DVec3,
}

impl<'a> Fauces<'a> {
    pub(super) fn new(parameters: &'a MouthParameters, palate: &'a Palate<'a>, pose: &'a JawPose) -> Self {
        let edge = palate.hind_line();
        let crest = palate.point(&edge, 0.0);
        Self { parameters, palate, pose, edge, crest }
    }

    /// Point of the soft palate: `k` 0 at the hard palate, 1 at the free edge, 1.5 behind it.
    fn velum(&self, k: f64, across: f64) -> DVec3 {
        let edge = self.palate.point(&self.edge, across);
        let v = k;
        let k = v.min(1.0);
        let a = across.abs();
        // From the vault to a hanging curtain that comes down beside the tongue.
        let x = edge.x * (1.0 + 0.3 * smoothstep(0.0, 0.9, k) * a);
        let drop = 40.0 * pow(a, 3.2) + 24.0 * smoothstep(0.7, 1.0, a) - 1.8 * bell((a - 0.32) / 0.17);
        let edge_height = self.crest.y - 4.5 - drop - 4.0 * bell(x / 4.6);
        let sink = smoothstep(0.0, 1.0, k);
        let mut y = lerp(edge.y, edge_height, sink * (0.5 + 0.5 * k));
        // The raphe is a faint seam, and the muscles beside it swell.
        y += 0.5 * bell(x / 0.9) * (1.0 - k) * smoothstep(0.0, 0.2, k);
        y -= 0.8 * bell((x.abs() - 7.0) / 4.0) * 4.0 * k * (1.0 - k);
        // Its sides come forward, but stay behind the last lower molars.
        let forward = 9.5 * a * a * k * k * (1.0 - 0.9 * smoothstep(0.6, 0.82, a));
        let behind_teeth = 7.0 * smoothstep(0.74, 0.86, a) * k * k;
        let mut z = edge.z - 23.0 * k - 3.5 * (1.0 - a * a) * k + forward - behind_teeth;
        // Its sides run forward into the cheeks behind the last molars: the fold over the pterygomandibular raphe.
        let fold = smoothstep(0.84, 1.0, a) * smoothstep(0.0, 0.35, k);
        let x = x + (18.0 * fold).copysign(across);
        // It turns into the cheek without a crease
        let beside = (x.abs() - 24.0).clamp(0.0, 18.0);
        z += (0.025 + 0.0025 * beside) * beside * beside * smoothstep(0.0, 0.35, k);
        let rough = smoothstep(0.0, 0.2, k) * smoothstep(1.5, 1.2, v);
        y += rough * 0.35 * fractal_noise(self.parameters.seed ^ 0x77, x * 0.25, z * 0.25, 3);
        // The two pits at the border of the hard palate.
        y += 0.6 * bell((x.abs() - 1.7) / 0.7) * bell((k - 0.07) / 0.03);
        // Small mucous glands.
        y -= rough * 0.12 * bumps(self.parameters.seed ^ 0x78, x / 1.6, z / 1.6, 0.4, 0.5);
        if v > 1.0 {
            // A rounded edge, then back and up again.
            let w = (v - 1.0) / 0.5;
            let (sine, cosine) = sin_cos(PI * w.min(0.5));
            z -= 2.6 * (1.0 - cosine) + 3.0 * (w - 0.5).max(0.0);
            y -= 1.5 * sine * smoothstep(1.0, 0.4, w);
            y += 12.0 * (w - 0.45).max(0.0);
        }
        DVec3::new(x, y, z)
    }

    /// Soft palate and the front arches beside it; u from the patient's right to left, v from the hard palate to the
    /// edge and up its hind side.
    pub(super) fn velum_meshes(&self) -> Vec<(&'static str, TriangleMesh)> {
        let detail = self.parameters.detail;
        let side = count(22, detail);
        let from = 0.5 * (1.0 - ARCH_FROM);
        let mut u_values = linspace(0.0, from, side);
        u_values.extend(linspace(from, 1.0 - from, 2 * count(40, detail)).into_iter().skip(1));
        u_values.extend(linspace(1.0 - from, 1.0, side).into_iter().skip(1));
        let mut v_values = linspace(0.0, 1.0, count(50, detail));
        v_values.extend(linspace(1.0, 1.5, count(20, detail)).into_iter().skip(1));
        let surface = Surface::new(&v_values, &u_values, |v, u| {
            (self.pose.point(self.velum(v, 2.0 * u - 1.0)), DVec2::new(u, v / 1.5))
        });
        let (rows, columns) = (v_values.len() - 1, u_values.len() - 1);
        let flip = self.pose.mirrored;
        vec![
            ("soft_palate", surface.mesh(0..rows, side..columns - side, flip)),
            ("palatoglossal_arch_right", surface.mesh(0..rows, 0..side, flip)),
            ("palatoglossal_arch_left", surface.mesh(0..rows, columns - side..columns, flip)),
        ]
    }

    /// The uvula hangs from the middle of the edge; u around it, v from its root to its end.
    pub(super) fn uvula_mesh(&self) -> TriangleMesh {
        let detail = self.parameters.detail;
        let length = self.parameters.uvula_length_mm;
        let root = self.velum(0.95, 0.0) + DVec3::new(0.0, 1.6, -2.6);
        const RADIUS: &[(f64, f64)] =
            &[(0.0, 3.6), (0.25, 3.3), (0.5, 2.7), (0.74, 3.0), (0.9, 2.3), (0.97, 1.3), (1.0, 0.0)];
        let seed = self.parameters.seed;
        let v_values: Vec<f64> =
            linspace(0.0, 1.0, count(44, detail)).iter().map(|v| v * (1.4 - 0.4 * v)).collect();
        let u_values = linspace(0.0, 1.0, count(40, detail));
        surface_mesh(&v_values, &u_values, !self.pose.mirrored, |v, u| {
            let around = if u >= 1.0 { 0.0 } else { u };
            let (sine, cosine) = sin_cos(2.0 * PI * around);
            let sway = 0.8 * fractal_noise(seed ^ 0x79, 0.5 + 2.0 * v, 7.5, 1);
            let center = root + DVec3::new(sway * v, -(length + 4.5) * v, 2.0 * v - 2.4 * v * v);
            let r = curve(RADIUS, v)
                * (1.0 + 0.06 * fractal_noise(seed ^ 0x7a, 3.0 * cosine + 9.0, 3.0 * sine + 4.0 * v, 2));
            // Broad where it leaves the palate.
            let (wide, deep) =
                (1.0 + 0.3 * smoothstep(0.35, 0.0, v), lerp(0.5, 1.0, smoothstep(0.0, 0.35, v)));
            (
                self.pose.point(center + DVec3::new(r * wide * cosine, 0.0, 0.85 * r * deep * sine)),
                DVec2::new(u, v),
            )
        })
    }

    /// A hind arch (`side` 1 is the patient's left): a fold behind the tonsil, narrower than the front arch. u from
    /// the palate downward, v from the wall over the edge to behind.
    pub(super) fn hind_arch_mesh(&self, side: f64) -> TriangleMesh {
        let detail = self.parameters.detail;
        let seed = self.parameters.seed ^ if side > 0.0 { 0x7b } else { 0x7c };
        let top = self.velum(1.0, 0.0);
        let edge = |u: f64| {
            let x = 6.0 + 13.5 * pow(u, 0.5) - 2.5 * u * u + 0.5 * fractal_noise(seed, 3.0 * u, 0.5, 2);
            DVec3::new(x, top.y + 3.0 - 40.0 * u, top.z - 3.2 - 1.5 * u)
        };
        let v_values = linspace(0.0, 1.0, count(26, detail));
        let u_values = linspace(0.0, 1.0, count(40, detail));
        surface_mesh(&v_values, &u_values, (side > 0.0) == self.pose.mirrored, |v, u| {
            let e = edge(u);
            let wall = DVec3::new(34.0, e.y + 9.0 * (1.0 - u), e.z + 1.0);
            // A round edge of 2 mm.
            let point = if v < 0.6 {
                let t = v / 0.6;
                let mut p = wall.lerp(e, t);
                p.z += 1.4 * bell((t - 0.86) / 0.2) + 0.4 * fractal_noise(seed ^ 3, p.x * 0.3, p.y * 0.2, 2);
                p
            } else {
                let t = (v - 0.6) / 0.4;
                let (sine, cosine) = sin_cos(PI * t);
                e + DVec3::new(-0.9 * sine + 9.0 * t * t * t, 0.0, -1.6 * (1.0 - cosine) - 2.0 * t * t)
            };
            (self.pose.point(DVec3::new(side * point.x, point.y, point.z)), DVec2::new(u, v))
        })
    }

    /// A palatine tonsil between the arches.
    pub(super) fn tonsil_mesh(&self, side: f64) -> TriangleMesh {
        let detail = self.parameters.detail;
        let seed = self.parameters.seed ^ if side > 0.0 { 0x7d } else { 0x7e };
        let top = self.velum(1.0, 0.0);
        let size = self.parameters.tonsil_size;
        let center = DVec3::new(22.8 - 3.0 * size, top.y - 17.0, top.z + 2.5);
        let half = DVec3::new(4.5 + 2.5 * size, 8.0 + 2.0 * size, 4.5);
        let v_values = linspace(0.0, 1.0, count(30, detail));
        let u_values = linspace(0.0, 1.0, count(36, detail));
        surface_mesh(&v_values, &u_values, (side < 0.0) == self.pose.mirrored, |v, u| {
            let around = if u >= 1.0 { 0.0 } else { u };
            let ((s, c), (vs, vc)) = (sin_cos(2.0 * PI * around), sin_cos(PI * v));
            let ball = DVec3::new(vs * c, vc, vs * s);
            let crypt = bumps(seed, 3.2 * ball.y + 2.0 * ball.x, 3.2 * ball.z + 9.0, 0.45, 0.7);
            let r = 1.0 - 0.16 * crypt
                + 0.1 * fractal_noise(seed ^ 5, 2.0 * ball.y, 2.0 * ball.z + 1.5 * ball.x, 2);
            let p = center + ball * half * r;
            (self.pose.point(DVec3::new(side * p.x, p.y, p.z)), DVec2::new(u, v))
        })
    }
}
