//! A study: scene, camera and program of captures as plain values.
//!
//! A study names no file and no format. Code builds one directly; a front such as `fluorspar-experiment` makes one
//! from a file. Everything in [`crate::pipeline`] takes a study or parts of it.
//!
//! | type | what | file |
//! |---|---|---|
//! | [`Study`] | scene, render settings, camera, captures, instruments, analysis | `mod.rs` |
//! | [`Camera`], [`Lens`], [`ViewFilter`] | from the scene to the digital numbers | `camera.rs` |
//! | [`ConcentrationChange`], [`Capture`], [`Motion`], [`Develop`], [`FlatFieldPlan`] | the exposures and how they become linear channels | `program.rs` |
//! | [`SpectroradiometerPlan`], [`SafetyPlan`], [`AnalysisPlan`], [`RegionPlan`] | what is measured and computed besides | `program.rs` |
//! | [`Target`], [`TargetPlace`] | what shall be seen, and what it is told from | `target.rs` |
//! | [`StudyTissue`] | a layered tissue of the scene, for what is told about it beside the image | `study_tissue.rs` |
//! | [`FlatSample`] | the small study of a flat, homogeneous sample without geometry | `flat_sample.rs` |

mod camera;
mod flat_sample;
mod program;
mod study_tissue;
mod target;

pub use camera::{Camera, Lens, ViewFilter};
pub use flat_sample::{FlatSample, FluorescenceModel};
pub use program::{
    AnalysisPlan, Capture, ConcentrationChange, Develop, FlatFieldPlan, LineEnds, Motion, PaintedFactor,
    RegionPlan, SafetyPlan, SpectroradiometerPlan, SpectroradiometerTarget, TissuePrior,
};

pub use study_tissue::StudyTissue;
pub use target::{Target, TargetPlace};

use crate::analysis::Analyte;
use crate::render::RenderSettings;
use crate::scene::Scene;
use crate::sensor::CaptureSequence;

/// A scene, the camera that looks at it, and what is done with its light.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// The scene.
    pub scene: Scene,
    /// Effort, seed and memory limit of the render.
    pub render: RenderSettings,
    /// Seconds after which to stop rendering.
    pub time_limit_s: Option<f64>,
    /// Factors on concentrations.
    pub concentrations: Vec<ConcentrationChange>,
    /// Lens, viewing filters and sensor.
    pub camera: Camera,
    /// Exposures, in order.
    pub captures: Vec<Capture>,
    /// Motion of the image between exposures.
    pub motion: Option<Motion>,
    /// How raw frames become linear channels.
    pub develop: Develop,
    /// Spectroradiometers in the place of the camera.
    pub spectroradiometers: Vec<SpectroradiometerPlan>,
    /// Distances and assumptions of a photobiological safety assessment, if one is wanted.
    pub safety: Option<SafetyPlan>,
    /// Analysis of the captures.
    pub analysis: Option<AnalysisPlan>,
    /// Regions that are analyzed beside it.
    pub regions: Vec<RegionPlan>,
    /// Layered tissues of the scene.
    pub tissues: Vec<StudyTissue>,
}

impl Study {
    /// A study of a scene alone: default render settings, no lens, no sensor, no captures.
    pub fn new(scene: Scene) -> Self {
        Self {
            scene,
            render: RenderSettings::default(),
            time_limit_s: None,
            concentrations: Vec::new(),
            camera: Camera::default(),
            captures: Vec::new(),
            motion: None,
            develop: Develop::default(),
            spectroradiometers: Vec::new(),
            safety: None,
            analysis: None,
            regions: Vec::new(),
            tissues: Vec::new(),
        }
    }

    /// The frames of all captures.
    pub fn capture_sequence(&self) -> CaptureSequence {
        CaptureSequence { frames: self.captures.iter().map(|capture| capture.frame.clone()).collect() }
    }

    /// The capture of a name.
    pub fn capture(&self, label: &str) -> Option<&Capture> {
        self.captures.iter().find(|capture| capture.frame.label == label)
    }

    /// What texts call the fluorophore whose share an analysis of this study looks for; the porphyrin where it looks for none.
    #[must_use]
    pub fn analyte(&self, plan: &AnalysisPlan) -> Analyte {
        let Some(name) = &plan.porphyrin else { return Analyte::default() };
        let known = self.scene.fluorophores.iter().chain(&plan.fluorophores);
        let titles: Vec<(&str, &str)> = known.map(|f| (f.name.as_str(), f.title.as_str())).collect();
        match titles.iter().find(|(known, _)| known == name) {
            Some((_, title)) => Analyte::new(name, title),
            None => Analyte::new(name, &name.replace('_', " ")),
        }
    }

    /// The capture that is analyzed.
    pub fn analyzed_capture(&self) -> Option<&Capture> {
        self.capture(&self.analysis.as_ref()?.frame)
    }
}
