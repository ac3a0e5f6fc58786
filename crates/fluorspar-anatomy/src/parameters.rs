//! Parameters of a mouth.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::dental_arch::{Arch, Jaw};
use fluorspar::units::number_text;

/// A parameter outside of what the generator can build.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{field}: {message}")]
pub struct ParameterError {
    /// Name of the parameter.
    pub field: &'static str,
    /// The problem, and the allowed values.
    pub message: String,
}

/// What of [`MouthParameters`] is no shape: its pose, and how finely it is meshed.
pub const POSE_FIELDS: [&str; 7] = [
    "jaw_opening_mm",
    "tongue_protrusion_mm",
    "tongue_shift_mm",
    "tongue_elevation_mm",
    "tongue_curl",
    "lip_retraction_mm",
    "detail",
];

/// Shape and pose of a mouth. Lengths are in millimeters; the defaults describe an adult with all teeth but the
/// wisdom teeth, the mouth opened wide and the tongue slightly out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MouthParameters {
    /// Distance between the edges of the upper and lower central incisors, mm (default 45, 14 to 60). Adults open
    /// to 45-57 mm at most; below 35 mm is a restricted opening.
    pub jaw_opening_mm: f64,
    /// Distance of the upper incisors in front of the lower ones with the jaws closed, mm (default 2.5, 0 to 8).
    pub overjet_mm: f64,
    /// How far the tip of the tongue reaches in front of the lower incisors, mm (default 8, -10 to 25).
    pub tongue_protrusion_mm: f64,
    /// How far the middle of the tongue is raised above its resting place, mm (default 0, -5 to 12).
    pub tongue_elevation_mm: f64,
    /// How far the tip of the tongue is turned aside, positive to the patient's left, mm (default 0, -20 to 20).
    pub tongue_shift_mm: f64,
    /// How far the tip of the tongue is raised toward the upper incisors, so that its underside, the frenulum and the
    /// floor of the mouth show (default 0, 0 to 1; needs an opening of 30 mm or more).
    pub tongue_curl: f64,
    /// Largest width of the tongue, mm (default 48, 36 to 58; adults 45 to 55, assumed).
    pub tongue_width_mm: f64,
    /// Length of the back of the tongue from the tip to the epiglottis, along the midline, mm (default 82, 65 to
    /// 100; 85 in men and 79 in women).
    pub tongue_length_mm: f64,
    /// Thickness of the tongue body, mm (default 21, 14 to 28; adults 20 to 30, assumed).
    pub tongue_thickness_mm: f64,
    /// Distance between the corners of the mouth, mm (default 60, 42 to 72; 54.5 ± 3.0 in men and 50.2 ± 3.5 in
    /// women at rest, more when retracted; Farkas).
    pub lip_opening_width_mm: f64,
    /// How far the lips are drawn back from the edges of the incisors, mm (default 5, -3 to 11). Negative: the lips
    /// cover the edges.
    pub lip_retraction_mm: f64,
    /// Width of the upper arch, mm (default 53.5, 44 to 64): distance between the ends of the line of contact
    /// points, at the distal faces of the second molars. The facial line of the same dental arch is about 8 mm
    /// wider.
    pub upper_arch_width_mm: f64,
    /// Depth of the upper arch, mm (default 42, 34 to 54): from the incisors to the ends of the line of contact
    /// points. Width and depth together must leave room for the teeth.
    pub upper_arch_depth_mm: f64,
    /// Width of the lower arch, mm (default 50.5, 42 to 62), measured as for the upper one.
    pub lower_arch_width_mm: f64,
    /// Depth of the lower arch, mm (default 40.3, 32 to 52), measured as for the upper one.
    pub lower_arch_depth_mm: f64,
    /// Exponent of the beta function that gives both arches their shape (default 0.5, 0.4 to 0.8): smaller is
    /// squarer in front, larger more pointed. Braun and others (1998) found 0.8 for a line along the outer faces;
    /// the line of contact points is 4 mm narrower on each side behind, but not in front, which 0.5 gives.
    pub arch_exponent: f64,
    /// Height of the palate above the plane of the upper teeth at the first molars, mm (default 20, 14 to 26; about
    /// 42 % of the distance between the molars after Korkhaus).
    pub palate_height_mm: f64,
    /// Length of the uvula, mm (default 12, 6 to 18; 10 to 15, assumed).
    pub uvula_length_mm: f64,
    /// Size of the palatine tonsils (default 0.4, 0 to 1): 0 hidden behind the arches, 1 well in front of them.
    pub tonsil_size: f64,
    /// Factor on the crown sizes of Wheeler's table (default 1, 0.85 to 1.15).
    pub tooth_scale: f64,
    /// Further factor on the widths of the lower teeth (default 1, 0.94 to 1.08): sets the overall Bolton ratio, which
    /// is 91.4 % for Wheeler's table and 92.3 to 93.4 % in populations.
    pub lower_tooth_factor: f64,
    /// Factor on the small differences between neighboring teeth in place, turn and size (default 1, 0 to 3).
    pub tooth_irregularity: f64,
    /// How much more dentin shows through the enamel of all teeth, which makes them darker and yellower (default 0, -0.2 to 0.8).
    pub tooth_shade: f64,
    /// Factor on the plaque at the gums (default 1, 0 to 3).
    pub plaque: f64,
    /// Teeth that are not there, as FDI numbers (default: the wisdom teeth 18, 28, 38 and 48).
    pub missing_teeth: Vec<u8>,
    /// Factor on the height of the papillae of the tongue (default 1, 0 to 2; 0 gives a smooth tongue).
    pub papilla_scale: f64,
    /// Seed of everything that varies at random (default 1).
    pub seed: u32,
    /// Factor on the number of mesh rows and columns (default 1, 0.25 to 5). The number of triangles grows with its
    /// square: 0.4 gives about 50 000, 1 about 300 000, 4 about 5 000 000.
    pub detail: f64,
}

impl Default for MouthParameters {
    fn default() -> Self {
        Self {
            jaw_opening_mm: 45.0,
            overjet_mm: 2.5,
            tongue_protrusion_mm: 8.0,
            tongue_elevation_mm: 0.0,
            tongue_shift_mm: 0.0,
            tongue_curl: 0.0,
            tongue_width_mm: 48.0,
            tongue_length_mm: 82.0,
            tongue_thickness_mm: 21.0,
            lip_opening_width_mm: 60.0,
            lip_retraction_mm: 5.0,
            upper_arch_width_mm: 53.5,
            upper_arch_depth_mm: 42.0,
            lower_arch_width_mm: 50.5,
            lower_arch_depth_mm: 40.3,
            arch_exponent: 0.5,
            palate_height_mm: 20.0,
            uvula_length_mm: 12.0,
            tonsil_size: 0.4,
            tooth_scale: 1.0,
            lower_tooth_factor: 1.0,
            tooth_irregularity: 1.0,
            tooth_shade: 0.0,
            plaque: 1.0,
            missing_teeth: vec![18, 28, 38, 48],
            papilla_scale: 1.0,
            seed: 1,
            detail: 1.0,
        }
    }
}

impl MouthParameters {
    /// This mouth with those fields of the shape of another one that a function takes. Seed, pose and the distance between the corners of the
    /// mouth, which a pose changes, stay.
    #[must_use]
    pub fn with_shape_of(&self, given: &Self, takes: impl Fn(&str) -> bool) -> Self {
        let fields = |mouth: &Self| match serde_json::to_value(mouth) {
            Ok(serde_json::Value::Object(fields)) => fields,
            _ => serde_json::Map::new(),
        };
        let mut taken = fields(given);
        let stays =
            |field: &str| POSE_FIELDS.contains(&field) || ["seed", "lip_opening_width_mm"].contains(&field);
        taken.retain(|field, _| !stays(field) && takes(field));
        if taken.is_empty() {
            return self.clone();
        }
        let mut shape = fields(self);
        shape.extend(taken);
        serde_json::from_value(serde_json::Value::Object(shape)).unwrap_or_else(|_| self.clone())
    }

    /// Length of the back of the tongue in this pose, mm: a tongue that is put out is longer. By 0.9 mm per millimeter
    /// in front of the incisors (assumed).
    pub fn tongue_length_in_pose_mm(&self) -> f64 {
        self.tongue_length_mm + 0.9 * self.tongue_protrusion_mm.max(0.0)
    }

    /// Overall Bolton ratio: sum of the widths of the lower teeth from first molar to first molar over that of the upper.
    pub fn bolton_ratio(&self) -> f64 {
        let sum = |jaw| Arch::sizes(self, jaw)[..6].iter().map(|size| size[1]).sum::<f64>();
        sum(Jaw::Lower) / sum(Jaw::Upper)
    }

    /// Checks every parameter, alone and together.
    ///
    /// # Errors
    /// The first parameter that cannot be built, with the allowed range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        let ranges = [
            ("jaw_opening_mm", self.jaw_opening_mm, 14.0, 60.0),
            ("overjet_mm", self.overjet_mm, 0.0, 8.0),
            ("tongue_protrusion_mm", self.tongue_protrusion_mm, -10.0, 25.0),
            ("tongue_elevation_mm", self.tongue_elevation_mm, -5.0, 12.0),
            ("tongue_shift_mm", self.tongue_shift_mm, -20.0, 20.0),
            ("tongue_curl", self.tongue_curl, 0.0, 1.0),
            ("tongue_width_mm", self.tongue_width_mm, 36.0, 58.0),
            ("tongue_length_mm", self.tongue_length_mm, 65.0, 100.0),
            ("tongue_thickness_mm", self.tongue_thickness_mm, 14.0, 28.0),
            ("lip_opening_width_mm", self.lip_opening_width_mm, 42.0, 72.0),
            ("lip_retraction_mm", self.lip_retraction_mm, -3.0, 11.0),
            ("upper_arch_width_mm", self.upper_arch_width_mm, 44.0, 64.0),
            ("upper_arch_depth_mm", self.upper_arch_depth_mm, 34.0, 54.0),
            ("lower_arch_width_mm", self.lower_arch_width_mm, 42.0, 62.0),
            ("lower_arch_depth_mm", self.lower_arch_depth_mm, 32.0, 52.0),
            ("arch_exponent", self.arch_exponent, 0.4, 0.8),
            ("palate_height_mm", self.palate_height_mm, 14.0, 26.0),
            ("uvula_length_mm", self.uvula_length_mm, 6.0, 18.0),
            ("tonsil_size", self.tonsil_size, 0.0, 1.0),
            ("tooth_scale", self.tooth_scale, 0.85, 1.15),
            ("lower_tooth_factor", self.lower_tooth_factor, 0.94, 1.08),
            ("tooth_irregularity", self.tooth_irregularity, 0.0, 3.0),
            ("tooth_shade", self.tooth_shade, -0.2, 0.8),
            ("plaque", self.plaque, 0.0, 3.0),
            ("papilla_scale", self.papilla_scale, 0.0, 2.0),
            ("detail", self.detail, 0.25, 5.0),
        ];
        for (field, value, low, high) in ranges {
            // Written so that NaN fails too.
            if !(low..=high).contains(&value) {
                return Err(ParameterError {
                    field,
                    message: format!("{} is not between {low} and {high}", number_text(value)),
                });
            }
        }
        if self.tongue_curl > 0.0 && self.jaw_opening_mm < 30.0 {
            return Err(ParameterError {
                field: "tongue_curl",
                message: format!(
                    "a tongue can't be raised at an opening of {} mm; open the jaws to 30 mm or more, or set it to 0",
                    self.jaw_opening_mm
                ),
            });
        }
        for &number in &self.missing_teeth {
            if !(1..=4).contains(&(number / 10)) || !(1..=8).contains(&(number % 10)) {
                return Err(ParameterError {
                    field: "missing_teeth",
                    message: format!(
                        "{number} is not a permanent tooth; use FDI numbers 11-18, 21-28, 31-38 and 41-48"
                    ),
                });
            }
        }
        for (jaw, field) in [(Jaw::Upper, "upper_arch_depth_mm"), (Jaw::Lower, "lower_arch_depth_mm")] {
            let (room, needed) = Arch::room_mm(self, jaw);
            let ratio = room / needed;
            if !(0.88..=1.15).contains(&ratio) {
                return Err(ParameterError {
                    field,
                    message: format!(
                        "the arch is {room:.0} mm long, but its teeth measure {needed:.0} mm; the arch must be between \
                         0.88 and 1.15 times as long: change the depth, the width or tooth_scale"
                    ),
                });
            }
        }
        Ok(())
    }
}
