//! The report and the folder of one run of an experiment.

mod folder;
mod report;
mod safety_section;

pub use folder::{RunFolderError, write_run_components, write_run_folder};
pub use report::{NamedFigure, RunReport, run_report};

use fluorspar::experiment::ResolvedExperiment;
use fluorspar::image::ComponentImage;
use fluorspar::pipeline::{AnalyzedFrame, CapturedFrame, FrameLeak, Preview, SpectroradiometerReading};

/// Everything that one run produced.
#[derive(Clone, Copy, Debug)]
pub struct RunResults<'a> {
    /// The experiment.
    pub experiment: &'a ResolvedExperiment,
    /// The experiment file as the user gave it.
    pub experiment_text: &'a str,
    /// The render.
    pub components: &'a ComponentImage,
    /// Raw and developed frames.
    pub frames: &'a [CapturedFrame],
    /// Pictures of the developed frames, in the same order.
    pub previews: &'a [Preview],
    /// Reflected light against fluorescence in each frame that has light.
    pub leaks: &'a [FrameLeak],
    /// Readings of the experiment's spectroradiometers.
    pub spectra: &'a [SpectroradiometerReading],
    /// The analysed frame, if the experiment asks for one.
    pub analysis: Option<&'a AnalyzedFrame>,
}
