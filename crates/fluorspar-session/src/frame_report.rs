//! The report of frames: from a component image, or of a camera.

use std::path::Path;

use fluorspar::image::ComponentImage;
use fluorspar::pipeline::{
    AnalyzedFrame, AnalyzedRegion, CapturedFrame, ColorRendering, Evaluation, LiveView, SeenComponents,
    assess_safety, evaluate_frames, preview,
};
use fluorspar::study::Study;
use fluorspar_experiment::{ResolvedExperiment, Warning};
use fluorspar_format::FrameFact;
use fluorspar_report::{FrameOrigin, RunReport, RunResults, dark_frames, run_report, write_frame_report};

use crate::{Job, Result};

/// What the report of frames is made from.
pub(crate) struct FrameReport<'a> {
    pub(crate) experiment: &'a ResolvedExperiment,
    pub(crate) experiment_text: &'a str,
    pub(crate) frames: Vec<CapturedFrame>,
    pub(crate) analysis: Option<AnalyzedFrame>,
    /// Frames that follow sliders.
    pub(crate) live: Option<LiveView>,
    /// Regions beside that of the analysis.
    pub(crate) regions: Vec<AnalyzedRegion>,
    /// What the frames show, and its spectra; `None` where they are not known.
    pub(crate) components: Option<(&'a ComponentImage, SeenComponents<'a>)>,
    pub(crate) frames_from: FrameOrigin,
    /// What the frames are that were given, by file.
    pub(crate) described_frames: Vec<(String, Vec<FrameFact>)>,
    /// Ending of the raw files beside the report.
    pub(crate) raw_ending: Option<&'a str>,
}

impl<'a> FrameReport<'a> {
    /// A report on simulated frames alone, without analysis and files.
    pub(crate) fn simulated(
        experiment: &'a ResolvedExperiment,
        experiment_text: &'a str,
        frames: Vec<CapturedFrame>,
    ) -> Self {
        Self {
            experiment,
            experiment_text,
            frames,
            analysis: None,
            live: None,
            regions: Vec::new(),
            components: None,
            frames_from: FrameOrigin::Simulated,
            described_frames: Vec::new(),
            raw_ending: None,
        }
    }

    /// Writes `report.html`, previews and figures into a folder. Returns what they are made from.
    pub(crate) fn write(mut self, folder: &Path) -> Result<Evaluation> {
        let evaluation = self.evaluated()?;
        write_frame_report(folder, &self.results(&evaluation))?;
        Ok(evaluation)
    }

    /// The page and its figures, without files.
    pub(crate) fn page(mut self) -> Result<RunReport> {
        let evaluation = self.evaluated()?;
        Ok(run_report(&self.results(&evaluation)))
    }

    fn evaluated(&mut self) -> Result<Evaluation> {
        let study = &self.experiment.study;
        let (frames, analysis) = (std::mem::take(&mut self.frames), self.analysis.take());
        let regions = std::mem::take(&mut self.regions);
        Ok(match self.components {
            Some((components, seen)) => {
                evaluate_frames(study, components, Some(&seen), frames, analysis, regions)?
            }
            None => Evaluation { regions, ..without_spectra(study, frames, analysis, self.frames_from) },
        })
    }

    fn results<'r>(&'r self, evaluation: &'r Evaluation) -> RunResults<'r> {
        RunResults {
            experiment: self.experiment,
            experiment_text: self.experiment_text,
            components: None,
            live: self.live.as_ref(),
            evaluation,
            frames_from: self.frames_from,
            described_frames: &self.described_frames,
            raw_ending: self.raw_ending,
        }
    }
}

/// What frames tell by themselves.
fn without_spectra(
    study: &Study,
    frames: Vec<CapturedFrame>,
    analysis: Option<AnalyzedFrame>,
    frames_from: FrameOrigin,
) -> Evaluation {
    let shown = |frame: &CapturedFrame| {
        let rendering = study.capture(&frame.raw.label).map(|c| ColorRendering::of_frame(study, c));
        rendering.map(|rendering| preview(&frame.developed, &rendering))
    };
    Evaluation {
        previews: frames.iter().filter_map(shown).collect(),
        analysis,
        regions: Vec::new(),
        region_radiance: None,
        leaks: Vec::new(),
        depths: Vec::new(),
        spectra: Vec::new(),
        // The lights of a recorded frame are not those of the experiment
        safety: match frames_from {
            FrameOrigin::Simulated => assess_safety(study, &frames),
            FrameOrigin::Given => None,
        },
        frames,
    }
}

/// Warns of frames that see next to nothing.
pub(crate) fn warn_of_darkness(experiment: &ResolvedExperiment, frames: &[CapturedFrame], job: &Job) {
    let warnings: Vec<Warning> = dark_frames(experiment, frames).into_iter().map(Warning::from).collect();
    job.warn(&warnings);
}
