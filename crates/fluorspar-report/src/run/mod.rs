//! The report and the folder of one run of an experiment.

mod dark_frames;
mod depth_section;
mod folder;
mod overview;
mod region_outline;
mod regions_section;
mod report;
mod safety_section;
mod view_filters;
mod words;

pub(crate) use overview::scene_rests_on;
pub use regions_section::{region_warnings, regions_matrix};
pub(crate) use words::capital;

pub use dark_frames::{LEAKING, dark_frames, leaking_frames};
pub use folder::{
    RunFolderError, analysis_json, evaluation_json, write_frame_report, write_run_components,
    write_run_folder,
};
pub use report::{NamedFigure, RunReport, run_report, stopped_early};
pub use safety_section::exceeded_limits;

use fluorspar::image::ComponentImage;
use fluorspar::pipeline::{Evaluation, LiveView};
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_format::FrameFact;

/// Everything that one run produced.
#[derive(Clone, Copy, Debug)]
pub struct RunResults<'a> {
    /// The experiment.
    pub experiment: &'a ResolvedExperiment,
    /// The experiment file as the user gave it.
    pub experiment_text: &'a str,
    /// The render; `None` for frames of another origin, and where its spectra were not read.
    pub components: Option<&'a ComponentImage>,
    /// Frames that follow sliders, where the page shall have them.
    pub live: Option<&'a LiveView>,
    /// Everything that was computed from it.
    pub evaluation: &'a Evaluation,
    /// Where the frames come from.
    pub frames_from: FrameOrigin,
    /// What the frames are that were given.
    pub described_frames: &'a [(String, Vec<FrameFact>)],
    /// Ending of the raw files `raw_FRAME` beside the report; `None` where there are none.
    pub raw_ending: Option<&'a str>,
}

/// Where the frames of a report come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameOrigin {
    /// They were computed from a scene.
    Simulated,
    /// They were given, for instance by a real camera.
    Given,
}
