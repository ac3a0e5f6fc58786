//! Roof of the mouth: the vault of the hard palate with its folds.

use glam::{DVec2, DVec3};

use super::dental_arch::{Arch, JawPose, ToothKind};
use super::gingiva::{end_of_border, lingual_border};
use super::math::{bell, pow, smoothstep};
use super::noise::fractal_noise;
use super::parameters::MouthParameters;
use super::surface::{count, linspace, surface_mesh};
use fluorspar::geometry::TriangleMesh;

/// Relative height of the vault across: 1 in the middle, 0 at the gums.
fn vault(across: f64) -> f64 {
    let a = across.abs().min(1.0);
    pow(1.0 - pow(a, 2.3), 0.85)
}

/// The hard palate in the frame of the upper jaw.
pub(super) struct Palate<'a> {
    parameters: &'a MouthParameters,
    arch: &'a Arch,
    /// Front of its border, and how far behind it the first molars stand, mm.
    front: DVec3,
    molars: f64,
    /// Arc length from which on the border runs backward: in front of it the border itself is the first row.
    start: f64,
    /// Height of the vault above the biting plane that gives the wanted height between the folds and unevenness.
    height: f64,
}

/// A line across the palate: what all its points share.
pub(super) struct Line {
    right: DVec3,
    left: DVec3,
    /// Distance behind the front, and height of the vault over the border.
    behind: f64,
    rise: f64,
}

impl<'a> Palate<'a> {
    pub(super) fn new(parameters: &'a MouthParameters, arch: &'a Arch) -> Self {
        let front = lingual_border(arch, 0.0);
        let first_molars = || arch.teeth.iter().filter(|t| t.kind == ToothKind::FirstMolar);
        let molars = first_molars().next().map_or(25.0, |t| front.z - t.edge.z);
        let start = linspace(0.0, 16.0, 64)
            .into_iter()
            .rev()
            .find(|&arc| lingual_border(arch, arc).z > front.z - 0.05)
            .unwrap_or(0.0);
        let mut palate = Self { parameters, arch, front, molars, start, height: parameters.palate_height_mm };
        // The height is that above the plane through the edges of incisors and first molars, in the middle between these.
        let origin = arch.incisors_edge();
        let back = first_molars().map(|t| t.edge).sum::<DVec3>() * 0.5 - origin;
        let normal = DVec3::new(0.0, -back.z, back.y).normalize();
        let end = end_of_border(arch);
        for _ in 0..3 {
            palate.height += parameters.palate_height_mm - palate.highest(end, origin, back, normal);
        }
        palate
    }

    /// Height above a plane through `origin`, mm, at the end of `back`: a tenth of the way before and behind it.
    fn highest(&self, end: f64, origin: DVec3, back: DVec3, normal: DVec3) -> f64 {
        let mut highest = 0.0_f64;
        for arc in linspace(0.0, end, 64) {
            let line = self.line(arc);
            let middle = (line.right + line.left) * 0.5 - origin;
            if (middle.dot(back) / back.length_squared() - 1.0).abs() < 0.12 {
                for across in linspace(-0.5, 0.5, 20) {
                    highest = highest.max((self.point(&line, across) - origin).dot(normal));
                }
            }
        }
        highest
    }

    /// The line across the palate between the gums at an arc length.
    pub(super) fn line(&self, arc: f64) -> Line {
        let (right, left) = (lingual_border(self.arch, -arc), lingual_border(self.arch, arc));
        let base = (right + left) * 0.5;
        // The vault rises steeply behind the incisors and is full at the first molars.
        let behind = self.front.z - base.z;
        let top = self.height * (1.0 + 0.02 * smoothstep(25.0, 45.0, behind))
            + self.arch.spee(base.z) * smoothstep(8.0, 24.0, behind);
        let rise = 1.0 - pow((1.0 - behind / self.molars).max(0.0), 2.6);
        Line { right, left, behind, rise: (top - base.y) * rise.max(0.0) }
    }

    /// Point on a line; `across` from -1 (patient's right) to 1.
    pub(super) fn point(&self, line: &Line, across: f64) -> DVec3 {
        let seed = self.parameters.seed;
        let base = line.right.lerp(line.left, 0.5 * (across + 1.0));
        let behind = self.front.z - base.z;
        let mut height = line.rise * vault(across);
        let x = base.x;
        // Folds behind the incisors, curved and broken at the midline ridge.
        if behind < 26.0 {
            let side = bell(x / 1.6);
            let mut fold = 0.0;
            for (number, place) in [6.5, 10.2, 13.9, 17.6].into_iter().enumerate() {
                let number = number as f64;
                let wander =
                    fractal_noise(seed ^ 0x75, x * 0.3 + 11.0 * number, if x > 0.0 { 3.5 } else { 8.5 }, 2);
                let bend = 0.13 * x.abs() - 0.5 * bell((x.abs() - 6.0) / 3.0) + 1.3 * wander;
                let reach = smoothstep(16.0 - 1.5 * number, 9.0 - number, x.abs());
                fold += (1.0 - 0.1 * number) * bell((behind - place - bend) / 0.9) * reach;
            }
            height -= fold * (1.0 - 0.9 * side) * smoothstep(1.0, 0.75, across.abs());
        }
        // Incisive papilla and the ridge of the midline.
        height -= 1.8 * bell(x / (2.4 - 0.2 * behind).max(0.9)) * bell((behind - 3.2) / 2.6);
        height -= 0.35 * bell(x / 0.9) * smoothstep(4.0, 9.0, behind) * smoothstep(50.0, 34.0, behind);
        height += 0.15 * fractal_noise(seed ^ 0x76, x * 0.35, base.z * 0.35, 3) * (1.0 - across * across);
        // Behind the incisors it leaves the gums along their border, which is not a straight line.
        let fade = smoothstep(6.0, 0.0, line.behind);
        let bow = if fade > 0.0 {
            let at = |arc: f64| lingual_border(self.arch, arc);
            at(across * self.start) - at(-self.start).lerp(at(self.start), 0.5 * (across + 1.0))
        } else {
            DVec3::ZERO
        };
        base + bow * fade + DVec3::Y * (height * smoothstep(0.0, 2.0, line.behind))
    }

    /// Its hind edge, where the soft palate begins.
    pub(super) fn hind_line(&self) -> Line {
        self.line(end_of_border(self.arch))
    }

    /// Its mesh; u from the patient's right to left, v from the incisors to the soft palate.
    pub(super) fn mesh(&self, pose: &JawPose, detail: f64) -> TriangleMesh {
        let end = end_of_border(self.arch);
        let rows = count(64, detail);
        let lines: Vec<Line> =
            linspace(self.start, end, rows).into_iter().map(|arc| self.line(arc)).collect();
        let row_numbers: Vec<f64> = (0..=rows).map(|row| row as f64).collect();
        let u_values = linspace(0.0, 1.0, count(60, detail));
        surface_mesh(&row_numbers, &u_values, pose.mirrored, |row, u| {
            let point = self.point(&lines[row as usize], 2.0 * u - 1.0);
            (pose.point(point), DVec2::new(u, row / rows as f64))
        })
    }
}
