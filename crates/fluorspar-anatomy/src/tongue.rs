//! The tongue: a body swept along its midline, clipped by what it touches, with papillae on its back.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::clearance::{Field, Obstacles};
use super::dental_arch::JawPose;
use super::math::{PI, bell, curve, lerp, mean, pow, signed_pow, sin_cos, smoothstep, spline, window};
use super::noise::{bumps, fractal_noise, lattice};
use super::parameters::MouthParameters;
use super::surface::{Surface, count, linspace, surface_mesh};
use fluorspar::geometry::TriangleMesh;
use fluorspar::interruption::end_if_interrupted;

/// Steps of the table that turns length along the tongue into place on its midline curve.
const STEPS: usize = 240;
/// Rows and columns of the grid on which contacts are found.
const CONTACT_ROWS: usize = 160;
const CONTACT_COLUMNS: usize = 112;
/// Distance kept from what the tongue touches, mm.
const CLEARANCE_MM: f64 = 0.8;
/// How far around the unpressed body is looked for what it may touch, mm.
const NEAR_MM: f64 = 2.0;

/// How much of the way to where neighboring sections cross the underside may reach in a bend, and over how many steps of
/// the table it is thinned toward it and away from it.
const FREE_OF_BEND: f64 = 0.85;
const THINNING_REACH: usize = 12;

/// Where the front, the sides and the middle of the tongue's back meet, in its texture coordinates.
pub(super) const TIP_END: f64 = 0.12;
pub(super) const LATERAL_END: f64 = 0.09;

/// How much lower the tip of a tongue at rest lies than its body, mm (assumed).
const TIP_DROOP_MM: f64 = 4.5;

/// Share of the half width over the length.
const WIDTH: &[(f64, f64)] =
    &[(0.0, 0.6), (0.12, 0.66), (0.24, 0.76), (0.36, 0.9), (0.5, 1.0), (0.6, 1.0), (0.8, 0.86), (1.0, 0.7)];

/// The midline curve and the sizes that the surfaces of the tongue are built from.
pub(super) struct Tongue<'a> {
    parameters: &'a MouthParameters,
    /// Points of the midline from tip to base in the frame of the mouth, mm, evenly spaced.
    midline: Vec<DVec3>,
    /// Places on the midline by the arc length along the back of the tongue, both as fractions.
    places: Vec<(f64, f64)>,
    /// Length along the back of the tongue.
    length: f64,
    /// Half width, height of the back and of the underside over the midline, at the steps of the table.
    sizes: Vec<[f64; 3]>,
    /// Share of the height of the underside that its bends leave, at the steps of the table.
    thinned: Vec<f64>,
    /// How far the back and the underside are pressed in, as a share of their distance from the midline: rows along
    /// the tongue, columns around it.
    pressed: Field,
    /// Where of these something is near the surface.
    near: Vec<bool>,
}

/// One place along the tongue: center, directions and half sizes.
#[derive(Clone, Copy)]
struct Section {
    center: DVec3,
    side: DVec3,
    up: DVec3,
    half_width: f64,
    back: f64,
    under: f64,
    /// How far the borders hang below the middle.
    sag: f64,
}

/// Values shared by the points of a row.
struct Row {
    v: f64,
    section: Section,
}

/// Values shared by the points of a column: the angle around a section and the place on the superellipse there.
struct Column {
    u: f64,
    sine: f64,
    cosine: f64,
    across: f64,
    upward: f64,
    /// Whether it is shared by back and underside.
    border: bool,
}

impl Column {
    fn new(u: f64) -> Self {
        let (sine, cosine) = sin_cos(PI * (1.0 - u.clamp(0.0, 1.0)));
        let border = u <= 0.0 || u >= 1.0;
        let (sine, cosine) = if border { (0.0, cosine.signum()) } else { (sine.max(0.0), cosine) };
        let (across, upward) = superellipse(sine, cosine);
        Self { u, sine, cosine, across, upward, border }
    }
}

/// Place on the outline of a section across and upward, in half sizes, for an angle: 0 is the patient's left border, a
/// quarter turn the back.
fn superellipse(sine: f64, cosine: f64) -> (f64, f64) {
    (signed_pow(cosine, 2.0 / 2.25), signed_pow(sine, 2.0 / 2.2))
}

/// How far the borders of the tongue hang below the middle, mm: it lies on the lower teeth and between them (assumed).
fn sag(p: &MouthParameters, t: f64) -> f64 {
    const SAG: &[(f64, f64)] =
        &[(0.0, 0.0), (0.08, 0.14), (0.2, 0.3), (0.35, 0.22), (0.48, 0.04), (0.55, 0.0)];
    let free = smoothstep(1.0, 0.3, p.tongue_curl) * smoothstep(14.0, 34.0, p.jaw_opening_mm);
    let aside = p.tongue_shift_mm / 12.0;
    p.tongue_thickness_mm * curve(SAG, t) * free / (1.0 + aside * aside)
}

/// Half width, height of the back and of the underside over the midline, mm.
fn half_sizes(p: &MouthParameters, t: f64) -> [f64; 3] {
    const BACK: &[(f64, f64)] =
        &[(0.0, 0.17), (0.1, 0.22), (0.3, 0.34), (0.55, 0.44), (0.75, 0.46), (1.0, 0.4)];
    const UNDER: &[(f64, f64)] =
        &[(0.0, 0.15), (0.12, 0.19), (0.24, 0.26), (0.42, 0.56), (0.58, 0.9), (0.75, 0.85), (1.0, 0.6)];
    let round = p.tongue_thickness_mm * tip(t, 0.16, 2.0);
    [
        0.502 * p.tongue_width_mm * curve(WIDTH, t) * tip(t, 0.24, 2.1),
        curve(BACK, t) * round,
        curve(UNDER, t) * round,
    ]
}

impl<'a> Tongue<'a> {
    /// `incisors_z` is the place of the lower incisors' edges in the frame of the mouth, mm.
    pub(super) fn new(
        parameters: &'a MouthParameters,
        pose: &JawPose,
        incisors_z: f64,
        obstacles: &Obstacles,
    ) -> Self {
        let pressed = Field {
            rows: CONTACT_ROWS + 1,
            columns: CONTACT_COLUMNS,
            cyclic: true,
            values: vec![0.0; (CONTACT_ROWS + 1) * CONTACT_COLUMNS],
        };
        let sizes = (0..=STEPS).map(|i| half_sizes(parameters, i as f64 / STEPS as f64)).collect();
        let mut tongue = Self {
            parameters,
            midline: Vec::new(),
            places: Vec::new(),
            length: 0.0,
            sizes,
            thinned: vec![1.0; STEPS + 1],
            pressed,
            near: Vec::new(),
        };
        let mut tip = parameters.tongue_protrusion_mm - 0.2;
        let wanted = parameters.tongue_length_in_pose_mm();
        let mut length = wanted;
        tongue.reach(tip, length, pose, obstacles);
        // Correct path and length until the surface, pressed and with its furrows, is as long and reaches as far as
        // wanted. A raised tip, or one that is held back by what it touches, stays where it is.
        for _ in 0..3 {
            let missing = incisors_z + parameters.tongue_protrusion_mm - tongue.foremost();
            let missing = if parameters.tongue_curl > 0.0 || missing.abs() > 4.0 { 0.0 } else { missing };
            let longer = tongue.length_of_back() / wanted;
            if missing.abs() < 0.02 && (longer - 1.0).abs() < 0.004 {
                break;
            }
            tip += missing;
            length /= longer.clamp(0.95, 1.05);
            tongue.reach(tip, length, pose, obstacles);
        }
        tongue.press_between(obstacles);
        tongue
    }

    /// Builds the body with the tip of its path at this place in front of the lower incisors and with this length along
    /// the back of the unpressed body, mm.
    fn reach(&mut self, tip: f64, wanted: f64, pose: &JawPose, obstacles: &Obstacles) {
        let path = Self::path(self.parameters, tip, pose, obstacles);
        // Cut the path where the back of the tongue has its length: the secant through the last two cuts.
        let (mut before, mut part) = (0.6, 0.75);
        self.measure(&path, before);
        let mut missing_before = self.length - wanted;
        for _ in 0..12 {
            self.measure(&path, part);
            let missing = self.length - wanted;
            if missing.abs() < 1e-6 || missing == missing_before {
                break;
            }
            let next = part - missing * (part - before) / (missing - missing_before);
            (before, missing_before) = (part, missing);
            part = next.clamp(0.3, 1.0);
        }
        self.press(obstacles);
    }

    /// Length of the midline of the back, without its papillae.
    fn length_of_back(&self) -> f64 {
        let middle = Column::new(0.5);
        let points: Vec<DVec3> =
            linspace(0.0, 1.0, 32).into_iter().map(|v| self.point(&self.row(v), &middle, 1.0)).collect();
        lengths(&points)[32]
    }

    /// Foremost place of the surface, mm in front of the frame's origin.
    fn foremost(&self) -> f64 {
        let mut foremost = f64::NEG_INFINITY;
        let columns: Vec<Column> = linspace(0.1, 0.9, 16).into_iter().map(Column::new).collect();
        for row in linspace(0.0, 0.06, 12).into_iter().map(|v| self.row(v)) {
            for column in &columns {
                foremost =
                    foremost.max(self.point(&row, column, 1.0).z).max(self.point(&row, column, -1.0).z);
            }
        }
        foremost
    }

    /// Dense points from the tip to a base deeper than needed, in the frame of the mouth.
    fn path(p: &MouthParameters, tip: f64, pose: &JawPose, obstacles: &Obstacles) -> Vec<DVec3> {
        let above = |z: f64, height: f64| pose.point(DVec3::new(0.0, -height, z));
        let half = 0.5 * p.jaw_opening_mm;
        let wide = smoothstep(12.0, 42.0, p.jaw_opening_mm);
        // Height of the middle above the biting plane of the lower teeth, behind the incisors.
        let heights: &[(f64, f64)] = &[
            (-72.0, -28.0),
            (-66.0, -17.0),
            (-58.0, -8.5),
            (-46.0, -2.2),
            (-32.0, 2.0),
            (-18.0, 4.2),
            (-3.0, 4.8),
        ];
        let lying = |z: f64| {
            let raised = p.tongue_elevation_mm * bell((z + 32.0) / 18.0);
            let flat = lerp(0.45, 1.0, wide);
            // Put out, the tongue flattens behind.
            let stretched = 0.16 * p.tongue_protrusion_mm.max(0.0) * bell((z + 44.0) / 16.0);
            let height = curve(heights, z) - stretched;
            let height = if height > 0.0 { height * flat } else { height };
            above(z, height + raised * flat)
        };
        // Over the lower lip, then hanging down.
        let over_lip = (3.0 - p.lip_retraction_mm).clamp(0.0, 7.0);
        let out = |z: f64| {
            let from = lying(-3.0);
            let beyond = z + 3.0;
            let droop = 0.06 * beyond + 0.021 * beyond * beyond;
            let lip = over_lip * smoothstep(0.0, 8.0, beyond);
            DVec3::new(0.0, (from.y - droop + lip).max(-half - 26.0), from.z + beyond)
        };
        let mut points: Vec<DVec3> = Vec::new();
        let mut z = tip;
        while z > -58.0 {
            let mut point = if z > -3.0 { out(z) } else { lying(z) };
            // A tip behind the incisors rests low.
            if tip < 0.0 {
                point.y -= 2.6 * smoothstep(0.0, -6.0, tip) * bell((z - tip) / 7.0);
            }
            points.push(point);
            z -= 1.0;
        }
        let root = [
            lying(-56.0),
            lying(-58.0),
            above(-63.0, -10.0),
            above(-67.0, -19.0),
            above(-69.0, -30.0),
            above(-70.0, -60.0),
        ];
        for i in 0..40 {
            points.push(spline(&root, 1.0 + 4.0 * f64::from(i) / 40.0));
        }
        if p.tongue_curl > 0.0 {
            points = Self::raised(p, pose, &points);
        }
        Self::shift(p, tip, &mut points);
        Self::lift(p, obstacles, &mut points);
        // At rest the tip lies on the edges of the incisors or behind them.
        let resting = TIP_DROOP_MM
            * smoothstep(14.0, 1.0, tip)
            * smoothstep(0.3, 0.0, p.tongue_curl)
            * smoothstep(20.0, 34.0, p.jaw_opening_mm);
        for (i, point) in points.iter_mut().enumerate() {
            point.y -= resting * bell(i as f64 / 8.0);
        }
        for _ in 0..12 {
            let before = points.clone();
            for i in 1..points.len() - 1 {
                points[i] = (before[i - 1] + before[i] * 2.0 + before[i + 1]) * 0.25;
            }
        }
        points
    }

    /// Moves the path to the side, more and more toward the tip.
    fn shift(p: &MouthParameters, tip: f64, points: &mut [DVec3]) {
        let count = points.len() as f64;
        for (i, point) in points.iter_mut().enumerate() {
            let t = 1.0 - (i as f64 / count) / 0.62;
            let aside = p.tongue_shift_mm * t.max(0.0) * t.max(0.0);
            // Between the teeth there is less room than in front of them, and little between closed lips.
            let outside = lerp(7.0, 20.0, smoothstep(14.0, 38.0, p.jaw_opening_mm));
            let between = if tip > 3.0 { outside.min(9.0) } else { 3.5 };
            let room = lerp(between, outside, smoothstep(0.0, 12.0, point.z));
            point.x += aside / (1.0 + (aside / room) * (aside / room)).sqrt();
        }
    }

    /// Lifts the path over teeth, gum and lip, wherever they are, but not against the upper ones.
    fn lift(p: &MouthParameters, obstacles: &Obstacles, points: &mut [DVec3]) {
        let half = 0.5 * p.jaw_opening_mm;
        let mut lift = vec![0.0_f64; points.len()];
        let mut most = vec![f64::INFINITY; points.len()];
        for (i, point) in points.iter().enumerate().filter(|(_, point)| point.z > -16.0) {
            if p.tongue_curl >= 0.5 {
                break;
            }
            let (lift, most) = (&mut lift[i], &mut most[i]);
            let from = DVec3::new(point.x, (0.15 * half).max(point.y), point.z);
            let above = obstacles.distance(from, DVec3::Y, 60.0).unwrap_or(60.0);
            // The highest under the body counts, less toward its sides, where the body is thinner.
            for across in [0.0, -0.2, 0.2, -0.4, 0.4, -0.6, 0.6] {
                let beside = DVec3::X * (across * 0.38 * p.tongue_width_mm);
                if let Some(gap) = obstacles.distance(from + beside, DVec3::NEG_Y, 40.0) {
                    // Never higher than halfway between what is below and above.
                    if across == 0.0 {
                        *most = (from.y + 0.5 * (above - gap) - point.y).max(0.0);
                    }
                    let needed = (0.27 * p.tongue_thickness_mm).min(0.5 * (gap + above));
                    let needed = needed * (1.0 - across * across) - 4.0 * smoothstep(-6.0, -16.0, point.z);
                    *lift = lift.max(from.y - gap + needed - point.y);
                }
            }
        }
        // A smooth rise that is nowhere less than needed: bends that are narrower than the body would fold its underside.
        lift = window(&lift, 7, &|near| near.iter().copied().fold(0.0, f64::max));
        lift = window(&lift, 7, &mean);
        most = window(&most, 2, &|near| near.iter().copied().fold(f64::INFINITY, f64::min));
        most = window(&most, 2, &mean);
        for (point, (lift, most)) in points.iter_mut().zip(lift.into_iter().zip(most)) {
            point.y += lift.min(most);
        }
    }

    /// The path with its front turned up, both taken at the same share of their length.
    fn raised(p: &MouthParameters, pose: &JawPose, lying: &[DVec3]) -> Vec<DVec3> {
        let above = |z: f64, height: f64| pose.point(DVec3::new(0.0, -height, z));
        let half = 0.5 * p.jaw_opening_mm;
        let top = half - 8.5;
        let foot = above(-32.0, 4.0);
        let knots = [
            DVec3::new(0.0, top, -11.0),
            DVec3::new(0.0, lerp(foot.y, top, 0.66), -14.5),
            DVec3::new(0.0, lerp(foot.y, top, 0.3), -22.0),
            foot,
            above(-41.0, 0.0),
            above(-50.0, -4.0),
            above(-58.0, -8.0),
            above(-64.0, -16.0),
            above(-68.0, -28.0),
            above(-70.0, -60.0),
        ];
        let turned: Vec<DVec3> =
            (0..=STEPS).map(|i| spline(&knots, 9.0 * i as f64 / STEPS as f64 * 0.9999)).collect();
        let n = lying.len();
        let even = |points: &[DVec3]| {
            let sums = lengths(points);
            let whole = sums[sums.len() - 1];
            (0..n).map(|i| at_length(points, &sums, whole * i as f64 / (n - 1) as f64)).collect::<Vec<_>>()
        };
        let (a, b) = (even(lying), even(&turned));
        let t = smoothstep(0.0, 1.0, p.tongue_curl);
        a.iter().zip(&b).map(|(a, b)| a.lerp(*b, t)).collect()
    }

    /// Takes the first `part` of the path as midline and measures the back above it.
    fn measure(&mut self, path: &[DVec3], part: f64) {
        let sums = lengths(path);
        let whole = sums[sums.len() - 1] * part;
        self.midline = (0..=STEPS).map(|i| at_length(path, &sums, whole * i as f64 / STEPS as f64)).collect();
        let back: Vec<DVec3> = (0..=STEPS)
            .map(|i| {
                let (center, _, up) = self.frame(i as f64 / STEPS as f64);
                center + up * self.sizes[i][1]
            })
            .collect();
        let sums = lengths(&back);
        self.length = sums[STEPS];
        self.places =
            sums.iter().enumerate().map(|(i, s)| (s / self.length, i as f64 / STEPS as f64)).collect();
        self.thin();
    }

    /// Thins the underside where the body bends around it so tightly that its sections would cross: it reaches at most
    /// [`FREE_OF_BEND`] of the way to where they meet.
    fn thin(&mut self) {
        let frames: Vec<_> = (0..=STEPS).map(|i| self.frame(i as f64 / STEPS as f64)).collect();
        let shares: Vec<f64> = (0..=STEPS)
            .map(|i| {
                let (a, b) = (i.saturating_sub(1), (i + 1).min(STEPS));
                let ((from, _, up_before), (to, _, up_after)) = (frames[a], frames[b]);
                let along = (to - from).normalize();
                // How far the middle goes, and how much less a point 1 mm below it.
                let bend = (up_after - up_before).dot(along) / (to - from).length();
                let under = half_sizes(self.parameters, i as f64 / STEPS as f64)[2];
                if bend * under > FREE_OF_BEND { FREE_OF_BEND / (bend * under) } else { 1.0 }
            })
            .collect();
        let lowest = window(&shares, THINNING_REACH, &|near| near.iter().copied().fold(1.0, f64::min));
        self.thinned = window(&lowest, THINNING_REACH, &mean);
    }

    /// Point of the midline, and the directions to the patient's left and to the back of the tongue.
    fn frame(&self, t: f64) -> (DVec3, DVec3, DVec3) {
        let at = |t: f64| {
            let x = t.clamp(0.0, 1.0) * STEPS as f64;
            let i = (x.floor() as usize).min(STEPS - 1);
            self.midline[i].lerp(self.midline[i + 1], x - i as f64)
        };
        let along = (at(t + 0.05) - at(t - 0.05)).normalize();
        let side = (DVec3::X - along * along.x).normalize();
        (at(t), side, side.cross(along))
    }

    fn section(&self, t: f64) -> Section {
        let (center, side, up) = self.frame(t);
        let [half_width, back, under] = half_sizes(self.parameters, t);
        let x = t.clamp(0.0, 1.0) * STEPS as f64;
        let i = (x.floor() as usize).min(STEPS - 1);
        let under = under * lerp(self.thinned[i], self.thinned[i + 1], x - i as f64);
        Section { center, side, up, half_width, back, under, sag: sag(self.parameters, t) }
    }

    /// Offset of the surface from the middle of a section, from [`superellipse`] at its angle.
    fn offset(section: &Section, across: f64, upward: f64) -> DVec3 {
        let height = if upward > 0.0 { section.back } else { section.under };
        section.side * (section.half_width * across)
            + section.up * (height * upward - section.sag * across * across)
    }

    /// Finds how far every fiber from the midline to the surface can reach.
    fn press(&mut self, obstacles: &Obstacles) {
        let around: Vec<(f64, f64)> = (0..CONTACT_COLUMNS)
            .map(|column| {
                let (sine, cosine) = sin_cos(2.0 * PI * column as f64 / CONTACT_COLUMNS as f64);
                superellipse(sine, cosine)
            })
            .collect();
        let values: Vec<f64> = (0..=CONTACT_ROWS)
            .into_par_iter()
            .flat_map_iter(|row| {
                end_if_interrupted();
                let section = self.section(self.place(row as f64 / CONTACT_ROWS as f64));
                around.iter().map(move |&(across, upward)| {
                    let offset = Self::offset(&section, across, upward);
                    let length = offset.length();
                    if length < 0.3 {
                        return f64::NEG_INFINITY;
                    }
                    match obstacles.distance(section.center, offset / length, length + NEAR_MM) {
                        // Rays that graze keep their distance along the normal, not along the fiber.
                        Some(hit) => (length - (hit - CLEARANCE_MM * 1.6)).clamp(0.0, 0.97 * length),
                        None => f64::NEG_INFINITY,
                    }
                })
            })
            .collect();
        self.near = values.iter().map(|value| *value > f64::NEG_INFINITY).collect();
        self.pressed.values = values.into_iter().map(|value| value.max(0.0)).collect();
        self.spread();
    }

    fn spread(&mut self) {
        let row_step = self.length / CONTACT_ROWS as f64;
        let around = 2.0 * self.parameters.tongue_width_mm / CONTACT_COLUMNS as f64;
        if self.pressed.values.iter().any(|v| *v > 0.0) {
            self.pressed.spread(0.9, row_step, around);
        }
    }

    /// Looks between the fibers that [`Self::press`] followed, where something was near: edges and cusps are thinner than
    /// their distance. Presses the surface in around what they missed.
    fn press_between(&mut self, obstacles: &Obstacles) {
        let cell = |row: usize, column: usize| row * CONTACT_COLUMNS + column % CONTACT_COLUMNS;
        let body = &*self;
        // What a fiber between others would have to be pressed in, if anything is in its way.
        let needed = |row: f64, column: f64| -> Option<f64> {
            let section = body.section(body.place(row / CONTACT_ROWS as f64));
            let (sine, cosine) = sin_cos(2.0 * PI * column / CONTACT_COLUMNS as f64);
            let (across, upward) = superellipse(sine, cosine);
            let offset = Self::offset(&section, across, upward);
            let length = offset.length();
            if length < 0.3 {
                return None;
            }
            let pressed = body.pressed.at(row, column);
            let reach = length - pressed + CLEARANCE_MM;
            let hit = obstacles.distance(section.center, offset / length, reach)?;
            Some((pressed + reach - hit).min(0.97 * length))
        };
        // The root is held by the floor of the mouth.
        let missed: Vec<(usize, f64)> = (0..CONTACT_ROWS * 4 / 5)
            .into_par_iter()
            .flat_map_iter(|row| {
                end_if_interrupted();
                let mut missed = Vec::new();
                for column in 0..CONTACT_COLUMNS {
                    let corners =
                        [(row, column), (row, column + 1), (row + 1, column), (row + 1, column + 1)]
                            .map(|(row, column)| cell(row, column));
                    if !corners.iter().any(|&corner| body.near[corner]) {
                        continue;
                    }
                    for (down, along) in [(0.0, 0.5), (0.5, 0.0), (0.5, 0.5)] {
                        if let Some(needed) = needed(row as f64 + down, column as f64 + along) {
                            missed.extend(corners.map(|corner| (corner, needed)));
                        }
                    }
                }
                missed
            })
            .collect();
        for (corner, needed) in &missed {
            let value = &mut self.pressed.values[*corner];
            *value = value.max(*needed);
        }
        if !missed.is_empty() {
            self.spread();
        }
    }

    /// Place on the midline for a fraction of the length along the back.
    fn place(&self, v: f64) -> f64 {
        let i = self.places.partition_point(|p| p.0 < v).clamp(1, STEPS);
        let ((v0, t0), (v1, t1)) = (self.places[i - 1], self.places[i]);
        lerp(t0, t1, ((v - v0) / (v1 - v0)).clamp(0.0, 1.0))
    }

    fn row(&self, v: f64) -> Row {
        Row { v, section: self.section(self.place(v)) }
    }

    /// A point of the back (`side` 1) or the underside (-1), in the frame of the mouth.
    fn point(&self, row: &Row, column: &Column, side: f64) -> DVec3 {
        let (v, section) = (row.v, &row.section);
        let &Column { u, sine, cosine, across, upward, border } = column;
        let offset = Self::offset(section, across, side * upward);
        let length = offset.length();
        // The border belongs to both sides and must be the same to the last bit.
        let turn = if border {
            if cosine > 0.0 { 0.0 } else { 0.5 }
        } else if side > 0.0 {
            0.5 * (1.0 - u)
        } else {
            1.0 - 0.5 * (1.0 - u)
        };
        // The end of the root lies among what it grows together with.
        let free = smoothstep(0.97, 0.87, v);
        let pressed = free * self.pressed.at(v * CONTACT_ROWS as f64, turn * CONTACT_COLUMNS as f64);
        let remaining = if length > 1e-6 { ((length - pressed) / length).max(0.03) } else { 1.0 };
        let mut point = section.center + offset * remaining;
        if !border {
            // Where the tongue is pressed against something it is smooth.
            let window = smoothstep(0.0, 0.035, v) * smoothstep(0.02, 0.3, sine) * bell(pressed / 0.8);
            if window > 1e-6 {
                let outward = (section.side * (cosine / (section.half_width + 0.1))
                    + section.up * (side * sine / (section.back + 0.1)))
                    .normalize();
                let relief = if side > 0.0 {
                    let (across, along) = lengths_at(self.parameters, u, v);
                    dorsal_relief(self.parameters, across, along, v)
                } else {
                    let along = self.parameters.tongue_length_mm * v;
                    ventral_relief(self.parameters, section.half_width * cosine, along, v)
                };
                point += outward * (relief * window);
            }
        }
        point
    }

    fn rows(&self) -> Vec<f64> {
        let detail = self.parameters.detail;
        // Rows are packed at the tip, where the surface turns over.
        let tip_rows = count(15, detail);
        let mut v_values: Vec<f64> = (0..=tip_rows)
            .map(|i| {
                let x = i as f64 / tip_rows as f64;
                0.03 * x * x
            })
            .collect();
        v_values.extend(linspace(0.03, TIP_END, count(34, detail)).into_iter().skip(1));
        v_values.extend(linspace(TIP_END, 1.0, count(226, detail)).into_iter().skip(1));
        v_values
    }

    /// The back: u from the patient's right border (0) over the midline to the left (1), v from the tip (0) to the
    /// base (1). Cut into the middle, the tip and the two sides, which share its texture coordinates.
    pub(super) fn back_meshes(&self) -> Vec<(&'static str, TriangleMesh)> {
        let side = count(24, self.parameters.detail);
        let mut u_values = linspace(0.0, LATERAL_END, side);
        u_values.extend(
            linspace(LATERAL_END, 1.0 - LATERAL_END, 2 * count(92, self.parameters.detail))
                .into_iter()
                .skip(1),
        );
        u_values.extend(linspace(1.0 - LATERAL_END, 1.0, side).into_iter().skip(1));
        let v_values = self.rows();
        let surface = self.surface(&v_values, &u_values, 1.0);
        let row = v_values.partition_point(|v| *v < TIP_END);
        let (left, right) = (u_values.len() - 1 - side, side);
        let (rows, columns) = (v_values.len() - 1, u_values.len() - 1);
        vec![
            ("tongue_dorsum", surface.mesh(row..rows, right..left, true)),
            ("tongue_tip", surface.mesh(0..row, 0..columns, true)),
            ("tongue_lateral_right", surface.mesh(row..rows, 0..right, true)),
            ("tongue_lateral_left", surface.mesh(row..rows, left..columns, true)),
        ]
    }

    /// The underside, with the same texture coordinates on the shared border.
    pub(super) fn ventral_mesh(&self) -> TriangleMesh {
        let u_values = linspace(0.0, 1.0, 2 * count(34, self.parameters.detail));
        let v_values = self.rows();
        let (rows, columns) = (v_values.len() - 1, u_values.len() - 1);
        self.surface(&v_values, &u_values, -1.0).mesh(0..rows, 0..columns, false)
    }

    fn surface(&self, v_values: &[f64], u_values: &[f64], side: f64) -> Surface {
        let rows: Vec<Row> = v_values.iter().map(|&v| self.row(v)).collect();
        let columns: Vec<Column> = u_values.iter().map(|&u| Column::new(u)).collect();
        let numbers = |n: usize| (0..n).map(|i| i as f64).collect::<Vec<_>>();
        Surface::new(&numbers(rows.len()), &numbers(columns.len()), |row, column| {
            let (row, column) = (&rows[row as usize], &columns[column as usize]);
            (self.point(row, column, side), DVec2::new(column.u, row.v))
        })
    }

    /// The frenulum: a fold from the underside down to the floor of the mouth, with a hollow free edge.
    pub(super) fn frenulum_mesh(&self, floor: DVec3) -> TriangleMesh {
        let detail = self.parameters.detail;
        let under = |v: f64| self.point(&self.row(v), &Column::new(0.5), -1.0);
        let (top, deep_top) = (under(0.17), under(0.42));
        let deep_floor = floor + DVec3::new(0.0, 1.0, -12.0);
        // Where the tongue lies on the floor the fold is short, but not nothing.
        let down = (floor - top).normalize();
        let height = top.distance(floor).max(4.0);
        // Across its edge, backward: from there to where it is rooted.
        let rooted = (deep_top - top) + (deep_floor - floor);
        let back = (rooted - down * rooted.dot(down)).normalize();
        let side = down.cross(back);
        let depths = [deep_top - top, deep_floor - floor].map(|way| way.dot(back).max(4.0));
        let v_values = linspace(0.0, 1.0, count(30, detail));
        let u_values = linspace(0.0, 1.0, count(16, detail));
        surface_mesh(&v_values, &u_values, false, |v, u| {
            let hollow = 4.0 * v * (1.0 - v);
            let edge = top + down * (height * v) + back * (0.1 * height * hollow);
            let w = 2.0 * u - 1.0;
            let (depth, flare) = (w * w, 1.2 + 3.5 * (1.0 - hollow));
            let (sine, _) = sin_cos(0.5 * PI * w);
            let beside = sine * (0.8 + flare * depth);
            (edge + back * (lerp(depths[0], depths[1], v) * depth) + side * beside, DVec2::new(u, v))
        })
    }
}

/// 0 at the tip, rising like the end of a superellipse to 1 at `reach`.
fn tip(v: f64, reach: f64, exponent: f64) -> f64 {
    let x = (1.0 - v / reach).max(0.0);
    pow((1.0 - pow(x, exponent)).max(0.0), 1.0 / exponent)
}

fn lengths(points: &[DVec3]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut sums = vec![0.0];
    for pair in points.windows(2) {
        sum += pair[0].distance(pair[1]);
        sums.push(sum);
    }
    sums
}

fn at_length(points: &[DVec3], sums: &[f64], length: f64) -> DVec3 {
    let i = sums.partition_point(|s| *s < length).clamp(1, points.len() - 1);
    let t = (length - sums[i - 1]) / (sums[i] - sums[i - 1]).max(1e-9);
    points[i - 1].lerp(points[i], t.clamp(0.0, 1.0))
}

/// Lengths across the back from the midline and along it from the tip at texture coordinates, mm, at rest: papillae and
/// maps keep their places when the tongue moves.
pub(super) fn lengths_at(p: &MouthParameters, u: f64, v: f64) -> (f64, f64) {
    let half_width = 0.5 * p.tongue_width_mm * curve(WIDTH, v) * tip(v, 0.24, 2.1);
    (half_width * 1.1 * (0.5 * PI) * (2.0 * u - 1.0), p.tongue_length_mm * v)
}

/// Density of the filiform papillae, 0 to 1: none behind the terminal sulcus.
pub(super) fn in_front_of_sulcus(across: f64, v: f64) -> f64 {
    smoothstep(0.012, -0.02, v - sulcus_place(across))
}

/// Terminal sulcus: a V that opens to the front.
fn sulcus_place(across: f64) -> f64 {
    0.74 - 0.0035 * across.abs()
}

/// Height of the filiform papillae, 0 to 1, at lengths across and along, mm.
pub(super) fn filiform(seed: u32, across: f64, along: f64) -> f64 {
    bumps(seed ^ 0x13, across / 0.62, along / 0.72, 0.66, 1.0)
}

/// Distance of the places where a fungiform papilla may stand, mm, and their radius there.
const FUNGIFORM_CELL_MM: f64 = 1.75;
const FUNGIFORM_RADIUS: f64 = 0.27;
/// How high papillae stand out, mm (filiform 0.2, fungiform 0.39, Andablo-Reyes and others 2020).
const FILIFORM_MM: f64 = 0.2;
const FUNGIFORM_MM: f64 = 0.39;

/// Share of their places that fungiform papillae take: 29 in a square centimeter at the tip, 7 to 8 in the middle, 3 behind
/// and at the sides there (Witt 2020).
fn fungiform_density(across: f64, v: f64) -> f64 {
    let per_cm2 = curve(&[(0.03, 29.0), (0.12, 20.0), (0.3, 9.0), (0.45, 7.0), (0.62, 3.0)], v);
    let at_side = 4.0 * smoothstep(12.0, 22.0, across.abs()) * smoothstep(0.5, 0.2, v);
    (per_cm2 + at_side) * 0.01 * FUNGIFORM_CELL_MM * FUNGIFORM_CELL_MM
}

/// Height of the fungiform papillae, 0 to 1: dense at the tip, rare behind.
pub(super) fn fungiform(seed: u32, across: f64, along: f64, v: f64) -> f64 {
    let [x, y] = [across, along].map(|length| length / FUNGIFORM_CELL_MM);
    bumps(seed ^ 0x14, x, y, FUNGIFORM_RADIUS, fungiform_density(across, v))
}

/// Foliate papillae: four to eight upright folds of the border in front of the palatoglossal arch, mm.
fn foliate(seed: u32, across: f64, along: f64, v: f64) -> f64 {
    let there = smoothstep(19.0, 25.0, across.abs()) * smoothstep(0.5, 0.56, v) * smoothstep(0.74, 0.68, v);
    if there <= 0.0 {
        return 0.0;
    }
    let wander = 0.5 * fractal_noise(seed ^ 0x1a, along * 0.3, across * 0.2, 2);
    let (sine, _) = sin_cos(2.0 * PI * (along / 2.1 + wander));
    there * (0.45 * sine.abs() - 0.2)
}

/// Sulcus, papillae and lingual tonsil: height above the smooth back, mm, from the lengths across and along.
fn dorsal_relief(p: &MouthParameters, across: f64, along: f64, v: f64) -> f64 {
    let (seed, scale, length, x) = (p.seed, p.papilla_scale, p.tongue_length_mm, across);
    // The midline groove wanders a little and is deepest in the middle third.
    let wander = 0.8 * fractal_noise(seed ^ 0x11, along * 0.06, 0.5, 2);
    let depth = smoothstep(0.05, 0.3, v) * smoothstep(0.76, 0.6, v);
    let mut height = -depth * (0.75 * bell((x - wander) / 0.8) + 1.3 * bell((x - wander) / 5.5));
    // Shallow folds that lead away from it, and the swell of the muscle.
    let fold = fractal_noise(seed ^ 0x18, across * 0.05 + 3.0, along * 0.22 - across.abs() * 0.1, 2);
    height -= 0.5 * depth * smoothstep(0.15, 0.45, fold) * smoothstep(2.0, 6.0, across.abs());
    height += 0.7 * fractal_noise(seed ^ 0x12, across * 0.1, along * 0.08, 3);
    height += foliate(seed, across, along, v);
    let front = in_front_of_sulcus(across, v);
    height -= 0.6 * bell((v - sulcus_place(across)) / 0.008);
    // Papillae finer than the mesh are left out.
    let resolved = smoothstep(0.35, 1.0, p.detail);
    if front > 0.0 && resolved > 0.0 {
        let hairs = resolved * filiform(seed, across, along) * FILIFORM_MM;
        let domes = smoothstep(0.0, 0.6, fungiform(seed, across, along, v));
        let mushrooms = resolved.sqrt() * domes * FUNGIFORM_MM;
        height += scale * front * hairs.max(mushrooms);
    }
    if front < 1.0 {
        height += scale * (1.0 - front) * bumps(seed ^ 0x15, across / 4.2, along / 4.2, 0.68, 0.95) * 1.1;
    }
    // Vallate papillae stand in front of the sulcus, each in its moat.
    for number in -4..=4 {
        if !(0.6..0.78).contains(&v) {
            break;
        }
        let place = f64::from(number) * 4.4;
        let v_place = 0.722 - 0.0035 * place.abs();
        let (dx, dy) = (across - place, (v - v_place) * length);
        let r = (dx * dx + dy * dy).sqrt();
        let size = 1.25 - 0.08 * f64::from(number).abs();
        height +=
            scale * resolved * (0.7 * smoothstep(size, 0.5 * size, r) - 0.5 * bell((r - 1.2 * size) / 0.4));
    }
    height
}

/// Veins and the fringed folds of the underside.
fn ventral_relief(p: &MouthParameters, x: f64, along: f64, v: f64) -> f64 {
    let seed = p.seed;
    let uneven = 0.25 * fractal_noise(seed ^ 0x17, x * 0.25, along * 0.25, 3);
    let free = smoothstep(0.05, 0.16, v) * smoothstep(0.5, 0.35, v);
    if free <= 0.0 {
        return uneven;
    }
    // The fringed fold lies outside of the vein; its edge is notched.
    let fringe = 9.5 + 0.12 * along + 0.9 * fractal_noise(seed ^ 0x16, along * 0.3, x.signum(), 2);
    let notches = 0.7 + 0.6 * fractal_noise(seed ^ 0x1e, along * 0.9, x.signum() * 2.0, 2);
    let fringed = 0.9 * notches * bell((x.abs() - fringe) / 0.55);
    uneven + free * (fringed + 0.35 * veins(seed, x, along) - 0.5 * bell(x / 2.0))
}

/// Distance of the deep lingual vein from the midline, mm.
fn vein_place(seed: u32, along: f64, x: f64) -> f64 {
    let side = x.signum() * 3.0;
    4.2 + 0.06 * along
        + 1.6 * fractal_noise(seed ^ 0x19, along * 0.12, side, 2)
        + 0.5 * fractal_noise(seed ^ 0x1b, along * 0.4, side, 2)
}

/// The deep lingual veins with their branches on the underside, 0 to 1, at lengths across and along, mm: a stem on each side,
/// thinner toward the tip, from which branches run aside and forward.
pub(super) fn veins(seed: u32, x: f64, along: f64) -> f64 {
    const STEP_MM: f64 = 7.0;
    const REACH_MM: f64 = 15.0;
    let swell = 1.0 + 0.4 * fractal_noise(seed ^ 0x1c, along * 0.25, x.signum() * 5.0, 2);
    let width = swell * lerp(0.35, 1.15, smoothstep(6.0, 34.0, along));
    let stem = vein_place(seed, along, x);
    // Nothing reaches further aside.
    if (x.abs() - stem).abs() > 16.0 {
        return 0.0;
    }
    let mut vein = bell((x.abs() - stem) / width);
    let first = (along / STEP_MM).floor() as i32;
    for number in first..=first + 3 {
        let odds = |channel: u32| lattice(seed, number, x.signum() as i32, 30 + channel);
        let root = STEP_MM * (f64::from(number) + odds(0));
        let forward = root - along;
        if !(0.0..REACH_MM).contains(&forward) || odds(1) < 0.2 {
            continue;
        }
        // Most branches run outward, some to the midline.
        let slope = if odds(2) < 0.7 { lerp(0.3, 0.8, odds(3)) } else { -0.3 };
        let wander = 0.9 * fractal_noise(seed ^ 0x1d, along * 0.35, f64::from(number) * 3.7 + x.signum(), 2);
        let place = vein_place(seed, root, x) + slope * forward + wander * smoothstep(0.0, 5.0, forward);
        let thin = lerp(0.55, 0.2, forward / REACH_MM);
        vein = vein.max(0.9 * bell((x.abs() - place) / thin) * smoothstep(REACH_MM, 0.6 * REACH_MM, forward));
    }
    vein
}
