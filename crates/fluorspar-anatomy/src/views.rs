//! The views of an oral examination, and other poses worth an image.

use super::MouthParameters;

/// A pose of the mouth with a place for the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExaminationView {
    /// Name in commands.
    pub name: &'static str,
    /// Description.
    pub title: &'static str,
    /// Parts that are examined, the one in the middle first.
    pub parts: &'static [&'static str],
    /// Camera, in the frame of the mouth, mm.
    pub camera_mm: [f64; 3],
    /// Target of the camera, mm.
    pub look_at_mm: [f64; 3],
    /// Width of the image at that point, mm.
    pub width_mm: f64,
    /// Jaw opening, mm.
    pub jaw_opening_mm: f64,
    /// Tongue in front of the lower incisors, mm.
    pub tongue_protrusion_mm: f64,
    /// Tongue to the patient's left, mm.
    pub tongue_shift_mm: f64,
    /// Tip of the tongue raised, 0 to 1.
    pub tongue_curl: f64,
    /// Lips drawn back, mm.
    pub lip_retraction_mm: f64,
    /// Corners of the mouth drawn apart, as by a cheek retractor: added to the width of the opening, mm.
    pub corner_retraction_mm: f64,
}

const REST: ExaminationView = ExaminationView {
    name: "",
    title: "",
    parts: &["tongue_dorsum"],
    camera_mm: [0.0, 0.0, 100.0],
    look_at_mm: [0.0, 0.0, -10.0],
    width_mm: 78.0,
    jaw_opening_mm: 42.0,
    tongue_protrusion_mm: 0.0,
    tongue_shift_mm: 0.0,
    tongue_curl: 0.0,
    lip_retraction_mm: 7.0,
    corner_retraction_mm: 0.0,
};

/// The nine sites of an oral examination.
pub const EXAMINATION_VIEWS: [ExaminationView; 9] = [
    ExaminationView {
        name: "lips",
        title: "Lips and the gums in front",
        parts: &["lower_lip", "upper_gingiva"],
        camera_mm: [0.0, 2.0, 110.0],
        look_at_mm: [0.0, 0.0, 5.0],
        jaw_opening_mm: 18.0,
        tongue_protrusion_mm: -8.0,
        lip_retraction_mm: 9.0,
        ..REST
    },
    ExaminationView {
        name: "right-cheek",
        title: "Right cheek",
        parts: &["cheek_right"],
        camera_mm: [52.0, 2.0, 78.0],
        look_at_mm: [-25.0, 0.0, -16.0],
        width_mm: 56.0,
        jaw_opening_mm: 40.0,
        tongue_protrusion_mm: -8.0,
        tongue_shift_mm: 8.0,
        lip_retraction_mm: 10.0,
        corner_retraction_mm: 8.0,
        ..REST
    },
    ExaminationView {
        name: "left-cheek",
        title: "Left cheek",
        parts: &["cheek_left"],
        camera_mm: [-52.0, 2.0, 78.0],
        look_at_mm: [25.0, 0.0, -16.0],
        width_mm: 56.0,
        jaw_opening_mm: 40.0,
        tongue_protrusion_mm: -8.0,
        tongue_shift_mm: -8.0,
        lip_retraction_mm: 10.0,
        corner_retraction_mm: 8.0,
        ..REST
    },
    ExaminationView {
        name: "hard-palate",
        title: "Hard palate and upper teeth",
        parts: &["hard_palate"],
        camera_mm: [0.0, -62.0, 62.0],
        look_at_mm: [0.0, 26.0, -18.0],
        width_mm: 66.0,
        jaw_opening_mm: 50.0,
        tongue_protrusion_mm: -6.0,
        lip_retraction_mm: 9.0,
        ..REST
    },
    ExaminationView {
        name: "throat",
        title: "Soft palate, uvula, tonsils and pharynx",
        parts: &["soft_palate", "pharyngeal_wall"],
        camera_mm: [0.0, 5.0, 92.0],
        look_at_mm: [0.0, 2.0, -50.0],
        width_mm: 60.0,
        jaw_opening_mm: 46.0,
        tongue_protrusion_mm: 10.0,
        ..REST
    },
    ExaminationView {
        name: "dorsal-tongue",
        title: "Back of the tongue",
        camera_mm: [0.0, 20.0, 100.0],
        look_at_mm: [0.0, -15.0, 0.0],
        width_mm: 80.0,
        tongue_protrusion_mm: 22.0,
        ..REST
    },
    ExaminationView {
        name: "right-tongue",
        title: "Right border of the tongue",
        parts: &["tongue_lateral_right"],
        camera_mm: [-76.0, -8.0, 68.0],
        look_at_mm: [0.0, -13.0, 6.0],
        width_mm: 60.0,
        tongue_protrusion_mm: 22.0,
        tongue_shift_mm: 16.0,
        ..REST
    },
    ExaminationView {
        name: "left-tongue",
        title: "Left border of the tongue",
        parts: &["tongue_lateral_left"],
        camera_mm: [76.0, -8.0, 68.0],
        look_at_mm: [0.0, -13.0, 6.0],
        width_mm: 60.0,
        tongue_protrusion_mm: 22.0,
        tongue_shift_mm: -16.0,
        ..REST
    },
    ExaminationView {
        name: "ventral-tongue",
        title: "Underside of the tongue and floor of the mouth",
        parts: &["tongue_ventral", "floor_of_mouth"],
        camera_mm: [0.0, 52.0, 82.0],
        look_at_mm: [0.0, -9.5, -10.0],
        width_mm: 66.0,
        jaw_opening_mm: 50.0,
        tongue_curl: 1.0,
        lip_retraction_mm: 11.0,
        ..REST
    },
];

/// Poses of tongue and jaw seen from several sides, in the manner of Fig. 2 of Lyu and others (2021), which shows such
/// poses without numbers: the numbers are ours.
pub const POSES: [ExaminationView; 4] = [
    ExaminationView { name: "open", title: "Mouth open, tongue at rest", width_mm: 116.0, ..REST },
    ExaminationView {
        name: "tongue-out",
        title: "Tongue out, from the side",
        camera_mm: [75.0, 14.0, 86.0],
        look_at_mm: [0.0, -6.0, -2.0],
        width_mm: 116.0,
        tongue_protrusion_mm: 24.0,
        ..REST
    },
    ExaminationView {
        name: "tongue-aside",
        title: "Tongue to the patient's left, from above",
        camera_mm: [0.0, 55.0, 95.0],
        look_at_mm: [0.0, -8.0, -4.0],
        width_mm: 112.0,
        tongue_protrusion_mm: 20.0,
        tongue_shift_mm: 18.0,
        ..REST
    },
    ExaminationView {
        name: "tongue-up",
        title: "Tip of the tongue raised, from the side",
        camera_mm: [-50.0, 8.0, 98.0],
        look_at_mm: [2.0, -1.0, -6.0],
        width_mm: 112.0,
        tongue_curl: 0.8,
        ..REST
    },
];

impl ExaminationView {
    /// The view of this name among [`EXAMINATION_VIEWS`] and [`POSES`].
    pub fn find(name: &str) -> Option<&'static Self> {
        EXAMINATION_VIEWS.iter().chain(&POSES).find(|view| view.name == name)
    }

    /// A person in this pose.
    pub fn pose(&self, person: &MouthParameters) -> MouthParameters {
        MouthParameters {
            jaw_opening_mm: self.jaw_opening_mm,
            tongue_protrusion_mm: self.tongue_protrusion_mm,
            tongue_shift_mm: self.tongue_shift_mm,
            tongue_curl: self.tongue_curl,
            tongue_elevation_mm: 0.0,
            lip_retraction_mm: self.lip_retraction_mm,
            // No wider than can be built.
            lip_opening_width_mm: (person.lip_opening_width_mm + self.corner_retraction_mm)
                .min(person.lip_opening_width_mm.max(72.0)),
            ..person.clone()
        }
    }

    /// Horizontal field of view, degrees.
    pub fn horizontal_field_deg(&self) -> f64 {
        let square: f64 = self.camera_mm.iter().zip(self.look_at_mm).map(|(a, b)| (a - b) * (a - b)).sum();
        2.0 * (0.5 * self.width_mm / square.sqrt()).atan().to_degrees()
    }
}
