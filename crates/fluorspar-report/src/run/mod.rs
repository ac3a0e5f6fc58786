//! The report and the folder of one run of an experiment.

mod depth_section;
mod folder;
mod report;
mod safety_section;

pub use folder::{RunFolderError, write_run_components, write_run_folder};
pub use report::{NamedFigure, RunReport, run_report};

use fluorspar::image::ComponentImage;
use fluorspar::pipeline::Evaluation;
use fluorspar_experiment::ResolvedExperiment;

/// Everything that one run produced.
#[derive(Clone, Copy, Debug)]
pub struct RunResults<'a> {
    /// The experiment.
    pub experiment: &'a ResolvedExperiment,
    /// The experiment file as the user gave it.
    pub experiment_text: &'a str,
    /// The render.
    pub components: &'a ComponentImage,
    /// Everything that was computed from it.
    pub evaluation: &'a Evaluation,
}
