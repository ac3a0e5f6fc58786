//! The two dental arches: positions of the teeth, and the poses of the two jaws.
//!
//! Each jaw has its own frame in millimeters, the same for both: x to the patient's left, z to the front, and y = `g`
//! from the plane of the biting edges toward the gums (up in the upper jaw, down in the lower one). The origin is the
//! front of the line of contact points.

use glam::{DMat3, DVec3};

use super::math::{PI, curve, pow, sin_cos};
use super::noise::lattice;
use super::parameters::MouthParameters;
use super::teeth::{contact_outward, edge_middle, overlap};

/// Upper or lower jaw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Jaw {
    Upper,
    Lower,
}

/// Kind of a tooth, by its place from the midline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ToothKind {
    CentralIncisor,
    LateralIncisor,
    Canine,
    FirstPremolar,
    SecondPremolar,
    FirstMolar,
    SecondMolar,
    ThirdMolar,
}

const KINDS: [ToothKind; 8] = [
    ToothKind::CentralIncisor,
    ToothKind::LateralIncisor,
    ToothKind::Canine,
    ToothKind::FirstPremolar,
    ToothKind::SecondPremolar,
    ToothKind::FirstMolar,
    ToothKind::SecondMolar,
    ToothKind::ThirdMolar,
];

/// Crown length, mesiodistal width, the same at the neck, and labio- or buccolingual width in mm (Wheeler's table);
/// then the lean of the crown to the outside (assumed) and to the midline (Andrews 1989) in degrees.
pub(super) const UPPER_INCISOR_DEPTH_MM: f64 = 7.0;
const UPPER_TEETH: [[f64; 6]; 8] = [
    [10.5, 8.5, 7.0, UPPER_INCISOR_DEPTH_MM, 17.0, 3.6],
    [9.0, 6.5, 5.0, 6.0, 15.0, 8.0],
    [10.0, 7.5, 5.5, 8.0, 9.0, 8.4],
    [8.5, 7.0, 5.0, 9.0, 3.0, 2.7],
    [8.5, 7.0, 5.0, 9.0, 3.0, 2.8],
    [7.5, 10.0, 8.0, 11.0, 4.0, 5.7],
    [7.0, 9.0, 7.0, 11.0, 6.0, 0.4],
    [6.5, 8.5, 6.5, 10.0, 8.0, 0.0],
];
const LOWER_TEETH: [[f64; 6]; 8] = [
    [9.0, 5.0, 3.5, 6.0, 9.0, 0.5],
    [9.5, 5.5, 4.0, 6.5, 8.0, 0.4],
    [11.0, 7.0, 5.5, 7.5, 3.0, 2.5],
    [8.5, 7.0, 5.0, 7.5, -7.0, 1.3],
    [8.0, 7.0, 5.0, 8.0, -10.0, 1.5],
    [7.5, 11.0, 9.0, 10.5, -14.0, 2.0],
    [7.0, 10.5, 8.0, 10.0, -16.0, 2.9],
    [7.0, 10.0, 7.5, 9.5, -16.0, 5.0],
];

/// Kinds of teeth by the last digit of their FDI numbers.
pub const TOOTH_KINDS: [&str; 4] = ["incisor", "canine", "premolar", "molar"];

/// The kind of a tooth by the name of its part, such as `tooth_11`.
pub fn tooth_kind(part: &str) -> Option<&'static str> {
    let place = part.strip_prefix("tooth_")?.strip_prefix(['1', '2', '3', '4'])?.parse::<usize>().ok()?;
    let kind = match place {
        1 | 2 => 0,
        3 => 1,
        4 | 5 => 2,
        6..=8 => 3,
        _ => return None,
    };
    Some(TOOTH_KINDS[kind])
}

/// One place in the arch, with or without its tooth.
#[derive(Clone, Debug)]
pub(super) struct Tooth {
    /// FDI number.
    pub(super) number: u8,
    pub(super) jaw: Jaw,
    pub(super) kind: ToothKind,
    pub(super) present: bool,
    /// Crown length, mesiodistal width, the same at the neck, buccolingual width, mm.
    pub(super) length: f64,
    pub(super) width: f64,
    pub(super) neck_width: f64,
    pub(super) depth: f64,
    /// Arc length of its middle along the arch, positive on the patient's left, mm.
    pub(super) middle: f64,
    /// Half of the room it has along the arch, mm.
    pub(super) half_room: f64,
    /// Lean of the crown to the outside, rad.
    pub(super) tilt: f64,
    /// In the frame of the jaw: point between the biting edges, and the directions to the distal, outer and biting
    /// sides of the crown.
    pub(super) edge: DVec3,
    pub(super) distal: DVec3,
    pub(super) outward: DVec3,
    pub(super) biting: DVec3,
}

impl Tooth {
    /// Half of the depth at the neck to the outer and to the inner side.
    pub(super) fn neck_depths(&self) -> (f64, f64) {
        (0.5 * self.depth * 0.92, 0.5 * self.depth * 0.88)
    }

    /// Makes the crown narrower on the side of a neighbor; the other side stays where it is.
    fn narrow(&mut self, by_mm: f64, neighbor: DVec3) {
        self.neck_width *= 1.0 - by_mm / self.width;
        self.width -= by_mm;
        self.edge -= self.distal * (0.5 * by_mm * (neighbor - self.edge).dot(self.distal).signum());
    }
}

/// A dental arch: the curve of contact points and the teeth on it.
#[derive(Clone, Debug)]
pub(super) struct Arch {
    pub(super) jaw: Jaw,
    /// Points of the left half of the curve with their arc length.
    points: Vec<(f64, DVec3)>,
    /// Teeth from the patient's right to left.
    pub(super) teeth: Vec<Tooth>,
    /// Arc length behind the last tooth where the gums begin to close.
    pub(super) end: f64,
    profile: StationTables,
    depth: f64,
}

/// Quantities that change smoothly from tooth to tooth, as tables over the arc length.
#[derive(Clone, Debug, Default)]
struct StationTables {
    tilt: Vec<(f64, f64)>,
    length: Vec<(f64, f64)>,
    outer: Vec<(f64, f64)>,
    inner: Vec<(f64, f64)>,
    /// Place of the axes of the crowns outward of the curve of contact points.
    axis: Vec<(f64, f64)>,
}

/// The arch at one arc length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Station {
    /// Point on the axes of the crowns, at the height of the biting edges: a little inside of the contact points.
    pub(super) point: DVec3,
    /// Unit vector to the outside, level.
    pub(super) outward: DVec3,
    /// Tangent of the lean of the crowns to the outside.
    pub(super) lean: f64,
    /// Length of the crowns.
    pub(super) length: f64,
    /// Distances of the outer and inner tooth surface at the neck from the tooth axis.
    pub(super) outer: f64,
    pub(super) inner: f64,
    /// Number of the tooth, or of its gap.
    pub(super) nearest: usize,
    /// Place within a tooth: -1 and 1 at its contacts, 0 in its middle.
    pub(super) across: f64,
    /// 1 at teeth, falling to 0 within a gap.
    pub(super) toothed: f64,
}

impl Arch {
    pub(super) fn new(parameters: &MouthParameters, jaw: Jaw) -> Self {
        let (width, depth) = match jaw {
            Jaw::Upper => (parameters.upper_arch_width_mm, parameters.upper_arch_depth_mm),
            Jaw::Lower => (parameters.lower_arch_width_mm, parameters.lower_arch_depth_mm),
        };
        let mut points = beta_curve(width, depth, parameters.arch_exponent);
        let (half_length, last) = points[points.len() - 1];
        // Behind the second molars the arch goes straight back.
        points.push((half_length + 40.0, last + DVec3::new(-1.5, 0.0, -40.0)));
        let sizes = Self::sizes(parameters, jaw);
        let spacing = half_length / sizes[..7].iter().map(|s| s[1]).sum::<f64>();
        let mut arch =
            Self { jaw, points, teeth: Vec::new(), end: 0.0, profile: StationTables::default(), depth };
        for side in [1.0, -1.0] {
            let mut start = 0.0;
            for (place, size) in sizes.iter().enumerate() {
                let half_room = 0.5 * size[1] * spacing;
                let quadrant = match (jaw, side > 0.0) {
                    (Jaw::Upper, false) => 1,
                    (Jaw::Upper, true) => 2,
                    (Jaw::Lower, true) => 3,
                    (Jaw::Lower, false) => 4,
                };
                let number = quadrant * 10 + place as u8 + 1;
                arch.place_tooth(parameters, number, *size, side * (start + half_room), half_room);
                start += 2.0 * half_room;
            }
        }
        arch.teeth.sort_by(|a, b| a.middle.total_cmp(&b.middle));
        arch.part_neighbors();
        // The edges of the central incisors are the origin: they define the opening.
        let mut shift = -arch.incisors_edge();
        shift.x = 0.0;
        for tooth in &mut arch.teeth {
            tooth.edge += shift;
        }
        for (_, point) in &mut arch.points {
            point.z += shift.z;
        }
        // Without wisdom teeth the gums end soon behind the second molars.
        let last =
            arch.teeth.iter().filter(|t| t.present).map(|t| t.middle.abs() + t.half_room).fold(0.0, f64::max);
        arch.end = last.max(half_length + 3.0);
        let table = |value: &dyn Fn(&Tooth) -> f64| {
            arch.teeth.iter().map(|t| (t.middle, value(t))).collect::<Vec<_>>()
        };
        arch.profile = StationTables {
            tilt: table(&|t| t.tilt),
            length: table(&|t| t.length),
            outer: table(&|t| t.neck_depths().0),
            inner: table(&|t| t.neck_depths().1),
            axis: table(&|t| {
                let (point, _, outward) = arch.frame(t.middle);
                (t.edge - point).dot(outward)
            }),
        };
        arch
    }

    pub(super) fn sizes(parameters: &MouthParameters, jaw: Jaw) -> [[f64; 6]; 8] {
        let mut sizes = match jaw {
            Jaw::Upper => UPPER_TEETH,
            Jaw::Lower => LOWER_TEETH,
        };
        for size in &mut sizes {
            for length in &mut size[..4] {
                *length *= parameters.tooth_scale;
            }
            if jaw == Jaw::Lower {
                size[1] *= parameters.lower_tooth_factor;
                size[2] *= parameters.lower_tooth_factor;
            }
        }
        sizes
    }

    /// Length of the arch between the distal faces of its second molars, and the sum of the widths of the teeth that
    /// belong there.
    pub(super) fn room_mm(parameters: &MouthParameters, jaw: Jaw) -> (f64, f64) {
        let (width, depth) = match jaw {
            Jaw::Upper => (parameters.upper_arch_width_mm, parameters.upper_arch_depth_mm),
            Jaw::Lower => (parameters.lower_arch_width_mm, parameters.lower_arch_depth_mm),
        };
        let room = 2.0 * beta_curve(width, depth, parameters.arch_exponent).last().map_or(0.0, |p| p.0);
        (room, 2.0 * Self::sizes(parameters, jaw)[..7].iter().map(|s| s[1]).sum::<f64>())
    }

    fn place_tooth(
        &mut self,
        parameters: &MouthParameters,
        number: u8,
        size: [f64; 6],
        middle: f64,
        half_room: f64,
    ) {
        // Small differences between neighbors, in -1..1.
        let amount = parameters.tooth_irregularity;
        let vary = |channel: u32| {
            amount * (2.0 * lattice(parameters.seed, i32::from(number), 0, 40 + channel) - 1.0)
        };
        let (point, along, outward) = self.frame(middle);
        let distal = along * middle.signum();
        let (turn_sin, turn_cos) = sin_cos(0.05 * vary(0));
        let (distal, outward) =
            (distal * turn_cos + outward * turn_sin, outward * turn_cos - distal * turn_sin);
        let tilt = (size[4] + 1.2 * vary(1)) * PI / 180.0;
        let (tilt_sin, tilt_cos) = sin_cos(tilt);
        let (tip_sin, _) = sin_cos((size[5] + vary(2)) * PI / 180.0);
        let biting = (outward * tilt_sin - DVec3::Y * tilt_cos - distal * tip_sin).normalize();
        let outward = (outward - biting * outward.dot(biting)).normalize();
        let distal = (distal - biting * distal.dot(biting) - outward * distal.dot(outward)).normalize();
        let kind = KINDS[usize::from(number % 10) - 1];
        // The canines stand a little outside of the curve, the lower incisors' edges are level.
        let bulge = if kind == ToothKind::Canine { 0.5 } else { 0.0 };
        // Only the incisors' edges define the opening: they stay at their height.
        let height = if number % 10 == 1 { 0.0 } else { 0.18 * vary(3) };
        let step = if self.jaw == Jaw::Upper && kind == ToothKind::LateralIncisor { 0.5 } else { 0.0 };
        let scale = 1.0 + 0.012 * vary(4);
        // A crown fills its room, or leaves the room that the arch has to spare.
        // Neighbors that are turned need their corners' room.
        let contact = 1.02 - 0.014 * parameters.tooth_irregularity;
        let width = (size[1] * 1.05 * scale).min(2.0 * half_room * contact);
        let mut tooth = Tooth {
            number,
            jaw: self.jaw,
            kind,
            present: !parameters.missing_teeth.contains(&number),
            length: size[0] * scale,
            width,
            neck_width: size[2] * width / size[1],
            depth: size[3] * scale,
            middle,
            half_room,
            tilt,
            edge: point + outward * (bulge + 0.2 * vary(5)) + DVec3::Y * (height + step),
            distal,
            outward,
            biting,
        };
        // Neighbors touch on the curve.
        tooth.edge -= outward * contact_outward(&tooth);
        // Width and depth of the arch are those between the outermost contacts of central incisors and second molars:
        // whatever their turn and width, these stand on the curve.
        let contact = match number % 10 {
            1 => Some((self.frame(0.0).0, -0.5 * width)),
            7 => Some((self.frame(middle + half_room.copysign(middle)).0, 0.5 * width)),
            _ => None,
        };
        if let Some((on_curve, reach)) = contact {
            let at = tooth.edge + distal * reach + outward * contact_outward(&tooth);
            tooth.edge.z += on_curve.z - at.z;
            if number % 10 == 7 {
                tooth.edge.x += on_curve.x - at.x;
            }
        }
        self.teeth.push(tooth);
    }

    /// Makes crowns narrower until no two neighbors intersect: turned ones, and those around a bend, touch with
    /// their corners.
    fn part_neighbors(&mut self) {
        const ENOUGH_MM: f64 = 0.02;
        const LEAST_MM: f64 = 0.08;
        for _ in 0..16 {
            let mut parted = true;
            for i in 1..self.teeth.len() {
                let (a, b) = (&self.teeth[i - 1], &self.teeth[i]);
                if !a.present || !b.present {
                    continue;
                }
                let deep = overlap(a, b).max(overlap(b, a));
                if deep > ENOUGH_MM {
                    parted = false;
                    // The way out may be longer along the arch than across it.
                    let by = 0.5 * deep.max(LEAST_MM);
                    let (before, this) = (a.edge, b.edge);
                    self.teeth[i - 1].narrow(by, this);
                    self.teeth[i].narrow(by, before);
                }
            }
            if parted {
                break;
            }
        }
        self.close_contacts(ENOUGH_MM);
    }

    /// Makes neighbors that almost touch wider toward each other until they do.
    fn close_contacts(&mut self, enough_mm: f64) {
        const STEP_MM: f64 = 0.03;
        const MOST_STEPS: usize = 6;
        for i in 1..self.teeth.len() {
            let (a, b) = (&self.teeth[i - 1], &self.teeth[i]);
            if !a.present || !b.present {
                continue;
            }
            let (mut a, mut b) = (a.clone(), b.clone());
            for _ in 0..MOST_STEPS {
                let (before, this) = (a.edge, b.edge);
                a.narrow(-STEP_MM, this);
                b.narrow(-STEP_MM, before);
                if overlap(&a, &b).max(overlap(&b, &a)) > enough_mm {
                    break;
                }
                (self.teeth[i - 1], self.teeth[i]) = (a.clone(), b.clone());
            }
        }
    }

    /// Middle between the edges of the central incisors.
    pub(super) fn incisors_edge(&self) -> DVec3 {
        let incisors = self.teeth.iter().filter(|t| t.kind == ToothKind::CentralIncisor);
        incisors.map(edge_middle).sum::<DVec3>() * 0.5
    }

    /// Point, direction along the arch (to the patient's left) and direction to the outside at an arc length.
    fn frame(&self, arc: f64) -> (DVec3, DVec3, DVec3) {
        let at = |s: f64| {
            let distance = s.abs().min(self.points[self.points.len() - 1].0);
            let i = self.points.partition_point(|p| p.0 < distance).clamp(1, self.points.len() - 1);
            let ((s0, p0), (s1, p1)) = (self.points[i - 1], self.points[i]);
            let p = p0.lerp(p1, (distance - s0) / (s1 - s0));
            DVec3::new(if s < 0.0 { -p.x } else { p.x }, 0.0, p.z)
        };
        let along = (at(arc + 0.75) - at(arc - 0.75)).normalize();
        let mut point = at(arc);
        point.y = self.spee(point.z);
        (point, along, DVec3::new(-along.z, 0.0, along.x))
    }

    /// Height of the biting surfaces against the flat plane: the curve of Spee.
    pub(super) fn spee(&self, z: f64) -> f64 {
        let f = (-z / self.depth).clamp(0.0, 1.0);
        let bow = 4.0 * f * (1.0 - f);
        if self.jaw == Jaw::Upper { -bow } else { 1.5 * bow }
    }

    pub(super) fn station(&self, arc: f64) -> Station {
        let (point, _, outward) = self.frame(arc);
        let distance = |t: &Tooth| (arc - t.middle).abs() - t.half_room;
        let nearest = (0..self.teeth.len())
            .min_by(|&a, &b| distance(&self.teeth[a]).total_cmp(&distance(&self.teeth[b])))
            .unwrap_or(0);
        let tooth = &self.teeth[nearest];
        let across = ((arc - tooth.middle) / tooth.half_room).clamp(-1.0, 1.0);
        // A gap falls from a tooth beside it, but has no papilla toward another gap.
        let beside = if across > 0.0 { nearest.checked_add(1) } else { nearest.checked_sub(1) };
        let is_beside_tooth = beside.and_then(|i| self.teeth.get(i)).is_some_and(|t| t.present);
        let a2 = across * across;
        let (tilt_sin, tilt_cos) = sin_cos(curve(&self.profile.tilt, arc));
        Station {
            point: point + outward * curve(&self.profile.axis, arc),
            outward,
            lean: tilt_sin / tilt_cos,
            length: curve(&self.profile.length, arc),
            outer: curve(&self.profile.outer, arc),
            inner: curve(&self.profile.inner, arc),
            nearest,
            across,
            toothed: if tooth.present {
                1.0
            } else if is_beside_tooth {
                a2 * a2 * a2
            } else {
                0.0
            },
        }
    }
}

/// Left half of the beta function of Braun and others (1998), `z = depth (4 (1/4 - (x/width)²))^exponent - depth`, with
/// the arc length from the front.
fn beta_curve(width: f64, depth: f64, exponent: f64) -> Vec<(f64, DVec3)> {
    const STEPS: usize = 240;
    let mut points: Vec<(f64, DVec3)> = Vec::with_capacity(STEPS + 2);
    for i in 0..=STEPS {
        let (sine, cosine) = sin_cos(0.5 * PI * i as f64 / STEPS as f64);
        let height = pow(cosine.max(0.0), 2.0 * exponent);
        let point = DVec3::new(0.5 * width * sine, 0.0, depth * (height - 1.0));
        let arc = points.last().map_or(0.0, |&(s, p)| s + p.distance(point));
        points.push((arc, point));
    }
    points
}

/// A rigid motion from the frame of a jaw to the frame of the mouth; the lower jaw's is mirrored.
#[derive(Clone, Copy, Debug)]
pub(super) struct JawPose {
    matrix: DMat3,
    origin: DVec3,
    /// Whether triangles change their winding.
    pub(super) mirrored: bool,
}

impl JawPose {
    pub(super) fn point(&self, p: DVec3) -> DVec3 {
        self.matrix * p + self.origin
    }
}

/// Rotation about x: positive angles turn the front down.
fn rotation(angle: f64) -> DMat3 {
    let (sine, cosine) = sin_cos(angle);
    DMat3::from_cols(DVec3::X, DVec3::new(0.0, cosine, sine), DVec3::new(0.0, -sine, cosine))
}

/// Poses of the upper and the lower jaw for the wanted opening.
///
/// The lower jaw turns about the condyles, 85 mm behind and 33 mm above the upper incisors' edges, while these slide
/// forward and down along the joint by a quarter of the opening. The head is then leaned back until the incisors'
/// edges stand one above the other and the plane of the opening faces the camera.
pub(super) fn jaw_poses(parameters: &MouthParameters) -> (JawPose, JawPose) {
    let condyle = DVec3::new(0.0, 33.0, -85.0);
    let slide = DVec3::new(0.0, -0.43, 0.9) * (0.25 * parameters.jaw_opening_mm);
    let mirror = DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0));
    let closed = DVec3::new(0.0, 2.0, -parameters.overjet_mm);
    let lower_edge = |angle: f64| rotation(angle) * (closed - condyle) + condyle + slide;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if lower_edge(middle).length() < parameters.jaw_opening_mm {
            low = middle;
        } else {
            high = middle;
        }
    }
    let angle = 0.5 * (low + high);
    let edge = lower_edge(angle);
    // Columns of the rotation that turns the line between the edges upright.
    let up = -edge.normalize();
    let upright = DMat3::from_cols(DVec3::X, DVec3::new(0.0, up.y, -up.z), DVec3::new(0.0, up.z, up.y));
    let origin = upright * (edge * -0.5);
    let upper = JawPose { matrix: upright, origin, mirrored: false };
    let lower = JawPose {
        matrix: upright * rotation(angle) * mirror,
        origin: upright * edge + origin,
        mirrored: true,
    };
    (upper, lower)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_incisors_edges_stand_one_above_the_other() {
        for opening in [20.0, 45.0, 60.0] {
            let parameters = MouthParameters { jaw_opening_mm: opening, ..MouthParameters::default() };
            let (upper, lower) = jaw_poses(&parameters);
            assert!((upper.point(DVec3::ZERO) - DVec3::new(0.0, 0.5 * opening, 0.0)).length() < 1e-9);
            assert!((lower.point(DVec3::ZERO) - DVec3::new(0.0, -0.5 * opening, 0.0)).length() < 1e-9);
            let back = DVec3::new(0.0, 0.0, -40.0);
            let gap = upper.point(back).y - lower.point(back).y;
            assert!(gap < opening && gap > 0.4 * opening, "the jaws close toward the back: {gap}");
            assert!(upper.point(DVec3::Y).y > upper.point(DVec3::ZERO).y);
            assert!(lower.point(DVec3::Y).y < lower.point(DVec3::ZERO).y);
        }
    }

    #[test]
    fn the_default_arches_have_room_for_their_teeth() {
        for jaw in [Jaw::Upper, Jaw::Lower] {
            let (room, needed) = Arch::room_mm(&MouthParameters::default(), jaw);
            assert!((room / needed - 1.0).abs() < 0.03, "{jaw:?}: {room} for {needed}");
        }
    }
}
