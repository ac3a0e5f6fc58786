//! The tongue: a body swept along its midline, with papillae on its back.

use glam::{DVec2, DVec3};

use super::dental_arch::{Arch, JawPose};
use super::math::{PI, bell, curve, lerp, pow, signed_pow, sin_cos, smooth_max, smoothstep, spline};
use super::noise::{bumps, fractal_noise};
use super::parameters::MouthParameters;
use super::surface::{count, grid_mesh, linspace};
use crate::geometry::TriangleMesh;

/// Steps of the table that turns length along the tongue into place on its midline curve.
const STEPS: usize = 240;

/// The midline curve, the poses and sizes that the surfaces of the tongue are built from.
pub(super) struct Tongue<'a> {
    parameters: &'a MouthParameters,
    arch: &'a Arch,
    pose: &'a JawPose,
    /// Points of the midline between the borders, in the frame of the lower jaw with y up from the biting plane, and
    /// their arc length as a fraction of the whole.
    midline: Vec<(f64, DVec3)>,
    /// Places on the midline by the arc length along the back of the tongue, both as fractions.
    places: Vec<(f64, f64)>,
    /// Arc length of the hind end of the last lower tooth.
    hindmost: f64,
    /// Length along the back of the tongue.
    length: f64,
}

impl<'a> Tongue<'a> {
    pub(super) fn new(parameters: &'a MouthParameters, arch: &'a Arch, pose: &'a JawPose) -> Self {
        let hindmost = arch.teeth.iter().filter(|t| t.present).map(|t| t.middle.abs() + t.half_room);
        let hindmost = hindmost.fold(0.0, f64::max) - 1.0;
        let (midline, places) = (Vec::new(), Vec::new());
        let mut tongue = Self { parameters, arch, pose, midline, places, hindmost, length: 0.0 };
        // Stretch the curve behind the tip until the back of the tongue has the wanted length.
        let mut tip = parameters.tongue_protrusion_mm;
        for _ in 0..6 {
            let (mut low, mut high) = (0.3, 2.5);
            for _ in 0..30 {
                let stretch = 0.5 * (low + high);
                tongue.shape_midline(tip, stretch);
                if tongue.length < parameters.tongue_length_mm {
                    low = stretch;
                } else {
                    high = stretch;
                }
            }
            // The thick tip reaches further than its midline: draw it back by as much.
            let reach = (0..=40)
                .flat_map(|i| [1.0, -1.0].map(|side| tongue.midline_point(0.005 * f64::from(i), side).z));
            tip -= reach.fold(f64::NEG_INFINITY, f64::max) - parameters.tongue_protrusion_mm;
        }
        tongue
    }

    fn shape_midline(&mut self, tip_z: f64, stretch: f64) {
        let p = self.parameters;
        // Over the lower lip where this covers the teeth, and hanging down when far out.
        let over_lip = (1.5 - p.lip_retraction_mm).max(0.0);
        let hanging = 0.3 * (p.tongue_protrusion_mm - 8.0).max(0.0);
        let mouth_tip = DVec3::new(0.0, -0.5 * p.jaw_opening_mm + 2.6 + over_lip - hanging, tip_z);
        let tip = self.pose.inverse_point(mouth_tip);
        let (tip_height, tip_z) = (-tip.y, tip.z);
        let flatten = lerp(0.55, 1.0, smoothstep(20.0, 45.0, p.jaw_opening_mm));
        // Distance behind the tip and height above the biting plane of the lower teeth.
        let knots = [
            (0.0, tip_height),
            (9.0, lerp(tip_height, 5.0, 0.75)),
            (18.0, 5.3 * flatten),
            (32.0, 5.4 * flatten),
            (46.0, 3.0 * flatten),
            (57.0, -0.8),
            (65.0, -5.5),
            (71.0, -12.0),
            (75.0, -21.0),
        ]
        .map(|(behind, height)| {
            let raised = p.tongue_elevation_mm
                * bell((behind - 34.0) / 20.0)
                * smoothstep(0.0, 14.0, behind)
                * flatten;
            DVec3::new(0.0, height + raised, tip_z - behind * if behind < 5.0 { 1.0 } else { stretch })
        });
        let last = (knots.len() - 1) as f64;
        let points: Vec<DVec3> =
            (0..=STEPS).map(|i| spline(&knots, last * i as f64 / STEPS as f64)).collect();
        // Arc lengths along the midline first, then along the back of the tongue above it.
        let fractions = |points: &[DVec3]| {
            let mut sum = 0.0;
            let mut sums = vec![0.0];
            for pair in points.windows(2) {
                sum += pair[0].distance(pair[1]);
                sums.push(sum);
            }
            (sums, sum)
        };
        let (sums, sum) = fractions(&points);
        self.midline = sums.iter().map(|s| s / sum).zip(points).collect();
        let back: Vec<DVec3> = (0..=STEPS)
            .map(|i| {
                let v = i as f64 / STEPS as f64;
                let (point, up) = self.frame(v);
                point + up * self.heights(v).0
            })
            .collect();
        let (sums, length) = fractions(&back);
        self.length = length;
        self.places = sums.iter().enumerate().map(|(i, s)| (s / length, i as f64 / STEPS as f64)).collect();
    }

    /// Point of the midline and the direction to the back of the tongue.
    fn frame(&self, v: f64) -> (DVec3, DVec3) {
        let at = |v: f64| {
            let i = self.midline.partition_point(|p| p.0 < v).clamp(1, STEPS);
            let ((v0, p0), (v1, p1)) = (self.midline[i - 1], self.midline[i]);
            p0.lerp(p1, (v - v0) / (v1 - v0))
        };
        let along = (at((v + 0.06).min(1.0)) - at((v - 0.06).max(0.0))).normalize();
        (at(v), DVec3::new(0.0, -along.z, along.y))
    }

    /// Place on the midline for a fraction of the length along the back.
    fn place(&self, v: f64) -> f64 {
        let i = self.places.partition_point(|p| p.0 < v).clamp(1, STEPS);
        let ((v0, t0), (v1, t1)) = (self.places[i - 1], self.places[i]);
        lerp(t0, t1, ((v - v0) / (v1 - v0)).clamp(0.0, 1.0))
    }

    /// Half of the width.
    fn half_width(&self, v: f64) -> f64 {
        const SHAPE: &[(f64, f64)] = &[
            (0.0, 0.52),
            (0.1, 0.62),
            (0.2, 0.77),
            (0.34, 0.93),
            (0.48, 1.0),
            (0.58, 1.0),
            (0.78, 0.84),
            (1.0, 0.66),
        ];
        0.5 * self.parameters.tongue_width_mm * curve(SHAPE, v) * Self::tip(v, 0.2, 2.0)
    }

    /// 0 at the tip, rising like the end of a superellipse to 1 at `reach`.
    fn tip(v: f64, reach: f64, exponent: f64) -> f64 {
        let x = (1.0 - v / reach).max(0.0);
        pow((1.0 - pow(x, exponent)).max(0.0), 1.0 / exponent)
    }

    /// Heights of the back above and of the underside below the midline curve.
    fn heights(&self, v: f64) -> (f64, f64) {
        const BACK: &[(f64, f64)] =
            &[(0.0, 0.15), (0.1, 0.22), (0.3, 0.38), (0.55, 0.47), (0.75, 0.45), (1.0, 0.4)];
        const UNDER: &[(f64, f64)] =
            &[(0.0, 0.13), (0.12, 0.17), (0.22, 0.24), (0.42, 0.62), (0.58, 0.95), (0.75, 0.85), (1.0, 0.6)];
        let thickness = self.parameters.tongue_thickness_mm;
        let tip = Self::tip(v, 0.14, 2.0);
        (thickness * curve(BACK, v) * tip, thickness * curve(UNDER, v) * tip)
    }

    /// Lifts a point of the jaw frame (y up) over the lower teeth.
    fn drape(&self, point: DVec3) -> DVec3 {
        if point.y > 5.0 || point.y < -60.0 {
            return point;
        }
        let (distance, arc) = self.arch.distance(point.x, point.z);
        let half = lerp(3.2, 5.6, smoothstep(14.0, 28.0, arc));
        let centre = lerp(-1.0, -0.6, smoothstep(14.0, 28.0, arc));
        let away = ((distance - centre).abs() - half).max(0.0);
        let top = 0.9 - self.arch.spee(point.z) - 2.5 * (away + (arc - self.hindmost).max(0.0));
        DVec3::new(point.x, smooth_max(point.y, top, 1.6), point.z)
    }

    /// Point of the midline of the back (`side` 1) or the underside (-1), without papillae and folds.
    fn midline_point(&self, v: f64, side: f64) -> DVec3 {
        let (middle, up) = self.frame(v);
        let (back, under) = self.heights(v);
        let point = self.drape(middle + up * if side > 0.0 { back } else { -under });
        self.pose.point(DVec3::new(point.x, -point.y, point.z))
    }

    /// A point of the back (`side` 1) or the underside (-1), in the frame of the mouth.
    fn point(&self, v: f64, u: f64, side: f64) -> DVec3 {
        let t = self.place(v);
        let (middle, up) = self.frame(t);
        let half_width = self.half_width(t);
        let (back, under) = self.heights(t);
        let (sine, cosine) = sin_cos(PI * (1.0 - u.clamp(0.0, 1.0)));
        // The border belongs to both sides and must be the same to the last bit.
        let border = u <= 0.0 || u >= 1.0;
        let sine = if border { 0.0 } else { sine.max(0.0) };
        let cosine = if border { cosine.signum() } else { cosine };
        let height = if side > 0.0 { back } else { -under };
        let x = half_width * signed_pow(cosine, 2.0 / 2.15);
        let y = height * pow(sine, 2.0 / 2.3);
        let smooth = middle + DVec3::X * x + up * y;
        let mut point = self.drape(smooth);
        if !border {
            let outward = (DVec3::X * (cosine / (half_width + 0.1))
                + up * (side * sine / (height.abs() + 0.1)))
                .normalize();
            // Where the tongue lies on teeth it is pressed smooth.
            let pressed = bell((point.y - smooth.y) / 0.7);
            let window = smoothstep(0.0, 0.04, v) * smoothstep(0.05, 0.4, sine) * pressed;
            let across = half_width * 1.1 * (0.5 * PI) * (2.0 * u - 1.0);
            let along = self.length * v;
            let relief = if side > 0.0 {
                self.dorsal_relief(across, along, v, x)
            } else {
                self.ventral_relief(x, along, v)
            };
            point += outward * (relief * window);
        }
        self.pose.point(DVec3::new(point.x, -point.y, point.z))
    }

    /// Sulcus, papillae and lingual tonsil: height above the smooth back, mm, from the lengths across and along.
    fn dorsal_relief(&self, across: f64, along: f64, v: f64, x: f64) -> f64 {
        let seed = self.parameters.seed;
        let scale = self.parameters.papilla_scale;
        // The midline groove wanders a little and is deepest in the middle third.
        let wander = 0.5 * fractal_noise(seed ^ 0x11, along * 0.06, 0.5, 2);
        let depth = 1.5 * smoothstep(0.06, 0.3, v) * smoothstep(0.74, 0.6, v);
        let mut height = -depth * (0.65 * bell((x - wander) / 1.3) + 0.55 * bell((x - wander) / 4.5));
        height += 0.55 * fractal_noise(seed ^ 0x12, across * 0.12, along * 0.1, 3);
        // Terminal sulcus: a V that opens to the front.
        let from_sulcus = v - (0.74 - 0.0035 * across.abs());
        let front = smoothstep(0.012, -0.02, from_sulcus);
        height -= 0.6 * bell(from_sulcus / 0.008);
        // Papillae finer than the mesh are left out.
        let resolved = smoothstep(0.2, 0.8, self.parameters.detail);
        let filiform = resolved * bumps(seed ^ 0x13, across / 0.95, along / 0.95, 0.62, 1.0) * 0.24;
        let rarity =
            lerp(0.72, 0.08, smoothstep(0.0, 0.45, v + 0.012 * (18.0 - across.abs()).max(0.0) * 0.3));
        let fungiform = resolved.sqrt() * bumps(seed ^ 0x14, across / 1.9, along / 1.9, 0.34, rarity) * 0.5;
        let tonsil = bumps(seed ^ 0x15, across / 4.2, along / 4.2, 0.68, 0.95) * 1.1;
        height += scale * (front * filiform.max(fungiform) + (1.0 - front) * tonsil);
        // Vallate papillae stand in front of the sulcus, each in its moat.
        for number in -4..=4 {
            let place = f64::from(number) * 4.4;
            let v_place = 0.722 - 0.0035 * place.abs();
            let (dx, dy) = (across - place, (v - v_place) * self.length);
            let r = (dx * dx + dy * dy).sqrt();
            let size = 1.25 - 0.08 * f64::from(number).abs();
            height += scale
                * resolved
                * (0.8 * smoothstep(size, 0.72 * size, r) - 0.4 * bell((r - 1.15 * size) / 0.35));
        }
        height
    }

    /// Frenulum and the fringed folds of the underside.
    fn ventral_relief(&self, x: f64, along: f64, v: f64) -> f64 {
        let free = smoothstep(0.05, 0.16, v) * smoothstep(0.5, 0.35, v);
        let fringe =
            6.0 + 0.12 * along + 0.8 * fractal_noise(self.parameters.seed ^ 0x16, along * 0.3, x.signum(), 2);
        free * (1.6 * bell(x / 1.1) + 0.6 * bell((x.abs() - fringe) / 0.7))
            + 0.3 * fractal_noise(self.parameters.seed ^ 0x17, x * 0.25, along * 0.25, 3)
    }

    fn mesh(&self, side: f64, columns: usize) -> TriangleMesh {
        let detail = self.parameters.detail;
        // Rows are packed at the tip, where the surface turns over.
        let tip_rows = count(12, detail);
        let mut v_values: Vec<f64> = (0..=tip_rows)
            .map(|i| {
                let x = i as f64 / tip_rows as f64;
                0.03 * x * x
            })
            .collect();
        v_values.extend(linspace(0.03, 1.0, count(250, detail)).into_iter().skip(1));
        let u_values = linspace(0.0, 1.0, columns);
        grid_mesh(&v_values, &u_values, side > 0.0, |v, u| (self.point(v, u, side), DVec2::new(u, v)))
    }

    /// The back of the tongue: u from the patient's right border (0) over the midline to the left (1), v from the tip
    /// (0) to the base (1).
    pub(super) fn dorsum_mesh(&self) -> TriangleMesh {
        self.mesh(1.0, 2 * count(115, self.parameters.detail))
    }

    /// The underside, with the same texture coordinates on the shared border.
    pub(super) fn ventral_mesh(&self) -> TriangleMesh {
        self.mesh(-1.0, 2 * count(30, self.parameters.detail))
    }
}
