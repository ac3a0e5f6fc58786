//! Photobiological safety of a study's captures, for patient, operator and mucosa.

use std::f64::consts::PI;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::capture::CapturedFrame;
use crate::design::ExposedEye;
use crate::geometry::OrientedPoint;
use crate::light::ApparentSize;
use crate::safety::{
    ApparentSource, Assessment, ExposedTissue, Hazard, Illumination, RetinalObserver, RiskGroup,
    RiskQuantity, assess, repeats_per_day, risk_group,
};
use crate::scene::Shape;
use crate::scene::irradiance::emission_factor;
use crate::sensor::ShutterKind;
use crate::spectral::Curve;
use crate::study::{Capture, SafetyPlan, Study};

/// A person or tissue that is exposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Viewer {
    /// The patient's eye, looking into the lights.
    PatientEye,
    /// The operator's eye, looking at the lit mouth.
    OperatorEye,
    /// The mucosa that is lit.
    Mucosa,
}

impl Viewer {
    /// In words: those of a mouth, or of any other thing that is lit.
    pub fn name(self, is_mouth: bool) -> &'static str {
        match self {
            Self::PatientEye if is_mouth => "patient's eye",
            Self::PatientEye => "eye that looks into the lights",
            Self::OperatorEye => "operator's eye",
            Self::Mucosa if is_mouth => "mucosa",
            Self::Mucosa => "skin in the light",
        }
    }
}

/// One viewer of one capture. Without a distance it holds the reason and no numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewerSafety {
    /// Who.
    pub viewer: Viewer,
    /// Distance, mm; null where it is not known.
    pub distance_mm: Option<f64>,
    /// Why nothing is assessed; null where something is.
    pub not_assessed: Option<String>,
    /// Irradiance over all wavelengths, W/m².
    pub irradiance_w_per_m2: Option<f64>,
    /// Largest angle that a source subtends, mrad; null for mucosa.
    pub source_subtense_mrad: Option<f64>,
    /// All hazards.
    pub hazards: Vec<Assessment>,
    /// Smallest margin of all hazards.
    pub smallest_margin: Option<f64>,
    /// The hazard that has it.
    pub governing: Option<Hazard>,
    /// Captures like this in 8 hours that all limits allow; 0 where one exposure is too many.
    pub captures_per_day: Option<u64>,
}

/// One capture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaptureSafety {
    /// Its name.
    pub name: String,
    /// Time that the lights are on, s.
    pub light_on_s: f64,
    /// Where that time comes from.
    pub light_on_from: String,
    /// Patient, operator, mucosa; empty when the lights are off.
    pub viewers: Vec<ViewerSafety>,
}

/// All captures, one after the other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProgramSafety {
    /// Who.
    pub viewer: Viewer,
    /// Whole sequences of captures in 8 hours that all limits allow.
    pub sequences_per_day: Option<u64>,
}

/// The safety of a study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SafetyReport {
    /// Where the limits come from.
    pub standard: &'static str,
    /// Scope of the report.
    pub caveat: &'static str,
    /// Whether the lights shine into a mouth; elsewhere the viewer `mucosa` is skin in the light.
    pub is_mouth: bool,
    /// Assumptions.
    pub assumptions: Vec<String>,
    /// Each capture.
    pub captures: Vec<CaptureSafety>,
    /// All of them together.
    pub program: Vec<ProgramSafety>,
    /// Risk group of the lights at 200 mm, in continuous operation, the worst of all captures; null when nothing shines.
    pub risk_group: Option<RiskGroup>,
    /// The quantities that it comes from, each of the capture in which it is worst.
    pub risk_quantities: Vec<RiskQuantity>,
}

impl SafetyReport {
    /// Whether anything shines in any capture.
    pub fn has_light(&self) -> bool {
        self.captures.iter().any(|c| !c.viewers.is_empty())
    }
}

const STANDARD: &str =
    "IEC 62471:2006; ICNIRP 2004 (ultraviolet), ICNIRP 2013 (visible and infrared, incoherent)";
const CAVEAT: &str =
    "A calculation from assumed light sources, not a certificate: a certificate needs the measured device.";
/// Where lamps that are not for general lighting are classified: IEC 62471:2006, 6.1.
const CLASSIFICATION_MM: f64 = 200.0;

/// Assesses every capture of a study; `None` where it has no safety plan.
///
/// The light is that which reaches a place directly, unshaded. Patient's eye: on the axis of the camera at the stated distance,
/// facing the camera. Mucosa: likewise at its distance. Operator's eye: sees a disc of the stated diameter and
/// reflectance, lit as the mucosa is. Frames that were taken give the times of automatic exposures; without them their
/// longest time is assumed.
pub fn assess_safety(study: &Study, frames: &[CapturedFrame]) -> Option<SafetyReport> {
    let settings = study.safety.as_ref()?;
    let mucosa_mm = settings.mucosa_distance_mm;
    let mut captures = Vec::new();
    let mut lamps = Vec::new();
    for capture in &study.captures {
        // Assess each viewer of a capture
        let (light_on_s, light_on_from) = light_on(study, capture, frames);
        let at_mucosa = illumination(study, capture, axis_point(study, mucosa_mm));
        let mut viewers = Vec::new();
        if !at_mucosa.sources.is_empty() {
            lamps.push(illumination(study, capture, axis_point(study, CLASSIFICATION_MM)));
            let observer = if settings.aphakic { RetinalObserver::Aphakic } else { RetinalObserver::Normal };
            viewers.push(match settings.patient_eye_distance_mm {
                None => refused(Viewer::PatientEye, "safety.patient_eye_distance_mm"),
                Some(mm) => {
                    let light = illumination(study, capture, axis_point(study, mm));
                    viewer(Viewer::PatientEye, mm, &light, light_on_s, ExposedTissue::Eye(observer))
                }
            });
            viewers.push(match settings.operator_eye_distance_mm {
                None => refused(Viewer::OperatorEye, "safety.operator_eye_distance_mm"),
                Some(mm) => {
                    let light = reflected(&at_mucosa, mm, settings.lit_diameter_mm, settings.reflectance);
                    let target = ExposedTissue::Eye(RetinalObserver::Normal);
                    viewer(Viewer::OperatorEye, mm, &light, light_on_s, target)
                }
            });
            let target = ExposedTissue::Skin { safety_factor: settings.mucosa_safety_factor };
            viewers.push(viewer(Viewer::Mucosa, mucosa_mm, &at_mucosa, light_on_s, target));
        }
        captures.push(CaptureSafety {
            name: capture.frame.label.clone(),
            light_on_s,
            light_on_from,
            viewers,
        });
    }
    // Classify the lamps of each capture as continuous light
    let (risk_group, risk_quantities) = risk_group(&lamps).unzip();
    let program = program(&captures);
    Some(SafetyReport {
        standard: STANDARD,
        caveat: CAVEAT,
        is_mouth: settings.is_mouth,
        assumptions: assumptions(study, settings),
        captures,
        program,
        risk_group,
        risk_quantities: risk_quantities.unwrap_or_default(),
    })
}

fn assumptions(study: &Study, settings: &SafetyPlan) -> Vec<String> {
    let mucosa_mm = settings.mucosa_distance_mm;
    let factor = settings.mucosa_safety_factor;
    let (limits, lit) = match (settings.is_mouth, factor) {
        (true, _) => (
            format!(
                "mucosa {mucosa_mm:.1} mm from the camera on its axis; there are no limits for mucosa: those for skin divided by {factor}"
            ),
            "mucosa",
        ),
        (false, 1.0) => {
            (format!("skin {mucosa_mm:.1} mm from the camera on its axis, limits for skin"), "object")
        }
        (false, _) => (
            format!(
                "skin {mucosa_mm:.1} mm from the camera on its axis, limits for skin divided by {factor}"
            ),
            "object",
        ),
    };
    let mut list = vec![
        "lights at the power that the experiment states, unshaded; objects that shine included".into(),
        limits,
        format!(
            "the operator sees a disc of {} mm with a reflectance of {}, lit as the {lit}; specular images of the light sources are not counted",
            settings.lit_diameter_mm, settings.reflectance
        ),
        "the eye looks into the lights without blinking, pupil as the limits assume; eyes do not accommodate below 100 mm".into(),
        "doses of all captures within 8 hours add up; burns are judged per capture".into(),
        "risk group at 200 mm, as if the lights shone continuously; lasers are not covered".into(),
    ];
    if settings.aphakic {
        let who = if settings.is_mouth { "the patient" } else { "who looks into the lights" };
        list.push(format!("{who} is an infant or has no lens in the eye: A(lambda) in place of B(lambda)"));
    }
    if study.scene.lights.iter().any(|light| light.emitter.is_distant()) {
        list.push("parallel light is taken as a point source".into());
    }
    list
}

fn refused(viewer: Viewer, field: &str) -> ViewerSafety {
    ViewerSafety {
        viewer,
        distance_mm: None,
        not_assessed: Some(format!("its distance is not known; give {field}")),
        irradiance_w_per_m2: None,
        source_subtense_mrad: None,
        hazards: Vec::new(),
        smallest_margin: None,
        governing: None,
        captures_per_day: None,
    }
}

fn viewer(
    who: Viewer,
    mm: f64,
    light: &Illumination,
    light_on_s: f64,
    target: ExposedTissue,
) -> ViewerSafety {
    let hazards = assess(light, light_on_s, target);
    let worst = hazards
        .iter()
        .filter_map(|a| a.margin.map(|margin| (margin, a.hazard)))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let too_much = worst.is_some_and(|(margin, _)| margin < 1.0);
    let captures_per_day =
        if too_much { Some(0) } else { hazards.iter().filter_map(|a| a.exposures_per_day).min() };
    ViewerSafety {
        viewer: who,
        distance_mm: Some(mm),
        not_assessed: None,
        irradiance_w_per_m2: Some(light.total_irradiance()),
        source_subtense_mrad: matches!(target, ExposedTissue::Eye(_))
            .then(|| 1e3 * light.largest_subtense_rad()),
        hazards,
        smallest_margin: worst.map(|w| w.0),
        governing: worst.map(|w| w.1),
        captures_per_day,
    }
}

/// Time that the lights of a capture are on.
fn light_on(study: &Study, capture: &Capture, frames: &[CapturedFrame]) -> (f64, String) {
    if let Some(ms) = capture.light_on_ms {
        return (ms * 1e-3, "light_on_ms".into());
    }
    let (exposures_s, from) = exposures(capture, frames);
    let Some(sensor) = &study.camera.sensor else { return (exposures_s.iter().sum(), from.into()) };
    let shutter = sensor.model().shutter;
    let source = match shutter.kind {
        _ if sensor.model().strobe.is_some() => "strobe".into(),
        ShutterKind::Rolling if shutter.row_time_us > 0.0 => format!("{from}, all rows"),
        _ => from.into(),
    };
    (exposures_s.iter().map(|exposure_s| sensor.lamp_on_s(*exposure_s)).sum(), source)
}

/// Exposure times of a capture, that of its frame and those of its bracket, s, and where they come from.
fn exposures(capture: &Capture, frames: &[CapturedFrame]) -> (Vec<f64>, &'static str) {
    if let Some(frame) = frames.iter().find(|frame| frame.raw.label == capture.frame.label) {
        let all = std::iter::once(&frame.raw).chain(&frame.bracket);
        return (all.map(|raw| raw.exposure_s).collect(), "exposure time");
    }
    let (first_ms, from) = match capture.frame.exposure_ms {
        Some(ms) => (ms, "exposure time"),
        None => {
            let rule = capture.frame.auto_exposure.unwrap_or_default();
            (rule.max_exposure_ms, "longest time of the automatic exposure")
        }
    };
    let factors = std::iter::once(1.0).chain(capture.bracket_ev.iter().map(|stops| stops.exp2()));
    (factors.map(|factor| first_ms * 1e-3 * factor).collect(), from)
}

fn axis_point(study: &Study, distance_mm: f64) -> OrientedPoint {
    let camera = &study.scene.camera;
    let forward = camera.forward.as_dvec3();
    OrientedPoint { position: camera.position.as_dvec3() + forward * (1e-3 * distance_mm), normal: -forward }
}

/// Everything that shines at a point in a capture.
fn illumination(study: &Study, capture: &Capture, at: OrientedPoint) -> Illumination {
    illumination_by(study, at, |light_group| capture.frame.drive(light_group))
}

/// An eye on the axis of the camera that looks into the lights of one group, for each watt of its first light: what it would get of any
/// other light in their place.
pub fn eye_before_group(
    study: &Study,
    light_group: &str,
    distance_mm: f64,
    observer: RetinalObserver,
) -> ExposedEye {
    let own = |name: &str| if name == light_group { 1.0 } else { 0.0 };
    let light = illumination_by(study, axis_point(study, distance_mm), own);
    let group = study.scene.light_groups.iter().position(|group| group.name == light_group);
    let spectra = group.map_or_else(Vec::new, |group| study.scene.group_spectra(group));
    let first_w = spectra.first().map_or(0.0, |spectrum| spectrum.total()).max(f64::MIN_POSITIVE);
    let totals: Vec<f64> = light.spectra.iter().map(Curve::total).collect();
    let per_watt = |source: &ApparentSource| ApparentSource {
        spectrum: 0,
        irradiance_factor: source.irradiance_factor * totals[source.spectrum] / first_w,
        ..source.clone()
    };
    ExposedEye { sources: light.sources.iter().map(per_watt).collect(), observer }
}

/// Everything that shines at a point with the light groups driven like this.
fn illumination_by(study: &Study, at: OrientedPoint, drive_of: impl Fn(&str) -> f64) -> Illumination {
    let scene = &study.scene;
    let mut light = Illumination::default();
    let mut add = |spectrum: &Curve, factor: f64, size: ApparentSize| {
        if factor <= 0.0 {
            return;
        }
        let index = light.spectra.iter().position(|other| other == spectrum).unwrap_or_else(|| {
            light.spectra.push(spectrum.clone());
            light.spectra.len() - 1
        });
        light.sources.push(ApparentSource {
            spectrum: index,
            irradiance_factor: factor,
            direction: size.direction.to_array(),
            subtense_rad: size.subtense_rad,
            solid_angle_sr: size.solid_angle_sr,
        });
    };
    // Add the lights that are on
    for source in &scene.lights {
        let drive = drive_of(&scene.light_groups[source.group].name);
        if drive > 0.0 {
            let factors = source.emitter.irradiance_factors(at);
            let sizes = source.emitter.apparent_sizes(at, &factors);
            for ((spectrum, factor), size) in source.spectra().iter().zip(factors).zip(sizes) {
                add(spectrum, drive * factor, size);
            }
        }
    }
    // Add emissive objects
    for object in &scene.objects {
        let Some(emission) = &object.emission else { continue };
        let drive = drive_of(&scene.light_groups[emission.group].name);
        if drive > 0.0 {
            // Even radiance: irradiance over radiance is the projected solid angle.
            let solid_angle_sr = emission_factor(&object.shape, emission, at);
            let middle = |(low, high): (Vec3, Vec3)| 0.5 * (low + high).as_dvec3();
            let center = match &object.shape {
                Shape::Sphere { center, .. } | Shape::Disc { center, .. } => center.as_dvec3(),
                Shape::Mesh(mesh) => middle(mesh.bounds()),
                Shape::Instances(many) => middle(many.bounds()),
            };
            let direction = (center - at.position).try_normalize().unwrap_or(at.normal);
            let size = ApparentSize::of_solid_angle(direction, solid_angle_sr);
            add(&emission.radiance, drive * solid_angle_sr, size);
        }
    }
    light
}

/// A lit disc seen from a distance: `L = R E / pi`, solid angle `pi r² / (r² + d²)`.
fn reflected(mucosa: &Illumination, distance_mm: f64, diameter_mm: f64, reflectance: f64) -> Illumination {
    let radius = 0.5 * diameter_mm;
    let solid_angle_sr = PI * radius * radius / (radius * radius + distance_mm * distance_mm);
    let sources = mucosa
        .sources
        .iter()
        .map(|source| ApparentSource {
            spectrum: source.spectrum,
            irradiance_factor: source.irradiance_factor * reflectance / PI * solid_angle_sr,
            direction: [0.0, 0.0, 1.0],
            subtense_rad: diameter_mm / distance_mm,
            solid_angle_sr,
        })
        .collect();
    Illumination { spectra: mucosa.spectra.clone(), sources }
}

/// Doses add up: the hazard that is used up first decides.
fn program(captures: &[CaptureSafety]) -> Vec<ProgramSafety> {
    [Viewer::PatientEye, Viewer::OperatorEye, Viewer::Mucosa]
        .into_iter()
        .filter(|who| captures.iter().flat_map(|c| &c.viewers).any(|v| v.viewer == *who))
        .map(|who| ProgramSafety { viewer: who, sequences_per_day: sequences_per_day(captures, who) })
        .collect()
}

/// How often a viewer may see all captures in a day: until the daily dose of some hazard is used up.
fn sequences_per_day(captures: &[CaptureSafety], who: Viewer) -> Option<u64> {
    let seen = || captures.iter().flat_map(|of| of.viewers.iter().map(move |viewer| (of.light_on_s, viewer)));
    let seen = || seen().filter(|(_, viewer)| viewer.viewer == who);
    if seen().any(|(_, viewer)| viewer.not_assessed.is_some()) {
        return None;
    }
    if seen().any(|(_, viewer)| viewer.smallest_margin.is_some_and(|margin| margin < 1.0)) {
        return Some(0);
    }
    let exposures: Vec<(f64, &[Assessment])> =
        seen().map(|(seconds, viewer)| (seconds, &viewer.hazards[..])).collect();
    let hazards = exposures.iter().flat_map(|(_, hazards)| *hazards);
    hazards.filter_map(|of| repeats_per_day(of.hazard, &exposures)).min()
}
