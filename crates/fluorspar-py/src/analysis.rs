//! Analyses of frames.

use std::sync::Arc;

use fluorspar::analysis::{AnalysisError, PorphyrinLayers, RegionError};
use fluorspar::image::SensorImage;
use fluorspar::pipeline::{
    AnalyzedFrame, AnalyzedRegion, Calibration, CapturedFrame, IncompleteRaw, PipelineError, RawExposures,
    analyze_regions, analyze_seen, complete_raw, develop_frames, subtract_what_is_given,
};
use fluorspar::study::Study;
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_format::black_level_doubt;
use fluorspar_report::{analysis_json, dark_frames};
use fluorspar_session::Wanted;
use numpy::{PyArray2, ndarray::Array2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::components::Components;
use crate::error::failed;
use crate::experiment::Experiment;
use crate::frame::{Frame, View};
use crate::process::work_through;
use crate::task::python_value;

/// A map over the frame, `[row, col]`, and its name.
type NamedMap<'py> = (&'static str, Bound<'py, PyArray2<f32>>);

/// The analysis of a frame: numbers of its region as JSON, and maps.
#[pyclass(frozen, module = "fluorspar._fluorspar")]
pub(crate) struct FrameAnalysis {
    analyzed: Arc<AnalyzedFrame>,
    regions: Vec<(String, Result<Arc<AnalyzedFrame>, RegionError>)>,
    warnings: Vec<String>,
}

impl FrameAnalysis {
    fn new((analyzed, regions): (AnalyzedFrame, Vec<AnalyzedRegion>), warnings: Vec<String>) -> Self {
        let shared = |region: AnalyzedRegion| (region.name, region.analyzed.map(Arc::new));
        Self { analyzed: Arc::new(analyzed), regions: regions.into_iter().map(shared).collect(), warnings }
    }
}

#[pymethods]
impl FrameAnalysis {
    /// The numbers, as `analyze --json` prints them.
    #[getter]
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let regions = self
            .regions
            .iter()
            .map(|(name, analyzed)| (name.as_str(), analyzed.as_ref().map(|analyzed| &analyzed.analysis)));
        python_value(py, &analysis_json(&self.analyzed.analysis, regions).map_err(failed)?)
    }

    /// The regions beside that of the analysis that are in view, by name.
    #[getter]
    fn regions(&self) -> Vec<(String, Self)> {
        let alone = |analyzed: &Arc<AnalyzedFrame>| Self {
            analyzed: Arc::clone(analyzed),
            regions: Vec::new(),
            warnings: Vec::new(),
        };
        let seen = self.regions.iter().filter_map(|(name, analyzed)| Some((name, analyzed.as_ref().ok()?)));
        seen.map(|(name, analyzed)| (name.clone(), alone(analyzed))).collect()
    }

    /// What makes the numbers mean something else than one may think.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// Maps of the porphyrin share of each pixel, on the mixture line, `[row, col]`: its value, the ends of its interval, its detection limit; empty
    /// without porphyrin.
    #[getter]
    fn porphyrin_maps<'py>(&self, py: Python<'py>) -> PyResult<Vec<NamedMap<'py>>> {
        let Some(map) = &self.analyzed.porphyrin else { return Ok(Vec::new()) };
        let PorphyrinLayers { share, low, high, detection_limit } = map.layers();
        let layers = [("share", share), ("low", low), ("high", high), ("detection_limit", detection_limit)];
        let array = |(name, values): (&'static str, Vec<f32>)| -> PyResult<NamedMap<'py>> {
            let array = Array2::from_shape_vec((map.height, map.width), values);
            let array = array.map_err(|error| PyValueError::new_err(error.to_string()))?;
            Ok((name, PyArray2::from_owned_array(py, array)))
        };
        layers.into_iter().map(array).collect()
    }
}

/// Frames as they were captured, or developed from the raw ones.
fn developed(
    study: &Study,
    frames: &[PyRef<'_, Frame>],
) -> PyResult<Result<Vec<CapturedFrame>, Vec<RawExposures>>> {
    let captured: Option<Vec<CapturedFrame>> = frames.iter().map(|frame| frame.captured.clone()).collect();
    if let Some(captured) = captured {
        return Ok(Ok(captured));
    }
    let complete = |frame: &PyRef<'_, Frame>| {
        let mut raw = frame.raw.clone();
        complete_raw(study, &mut raw).map_err(|lack| {
            let remedy = match &lack {
                IncompleteRaw::NoExposure => "; give it with describe(FILE, exposure_ms=...)",
                IncompleteRaw::OtherBits { .. } => {
                    "; describe it with describe(FILE, bit_depth=..., replace=True) or dn_per_electron=..., or set sensor.bit_depth"
                }
                _ => "",
            };
            failed(format!("frame \"{}\": {lack}{remedy}", raw.label))
        })?;
        Ok(RawExposures { raw, bracket: Vec::new() })
    };
    Ok(Err(frames.iter().map(complete).collect::<PyResult<_>>()?))
}

/// Analyzes the frame that the experiment names; `None` where it has no analysis.
#[pyfunction]
#[pyo3(signature = (experiment, frames, components = None, *, threads = None))]
pub(crate) fn analyze(
    experiment: &Bound<'_, Experiment>,
    frames: Vec<PyRef<'_, Frame>>,
    components: Option<&Bound<'_, Components>>,
    threads: Option<usize>,
) -> PyResult<Option<FrameAnalysis>> {
    let py = experiment.py();
    // Frames of a simulation are developed, with what is subtracted; a frame from a file may come alone
    let is_raw = frames.iter().any(|frame| frame.captured.is_none());
    let labels: Vec<&str> = frames.iter().map(|frame| frame.raw.label.as_str()).collect();
    let is_given = |label: &str| !is_raw || labels.contains(&label);
    if let Some(components) = components
        && let Some(mut view) = View::of_cached_analysis(py, experiment.get(), components.get(), threads)?
    {
        let mut warnings = in_words(&view.subtract_what_is_given(is_given));
        let exposures = developed(view.study(), &frames)?;
        let analyzed =
            work_through(py, threads, || analyzed(view.experiment(), Some(&view), exposures, &mut warnings))?;
        // What was kept is enough for an estimate from a family of tissues; of anything wrong the usual way tells.
        if let Ok(Some(all)) = analyzed
            && all.0.analysis.posterior.is_some()
        {
            return Ok(Some(FrameAnalysis::new(all, warnings)));
        }
    }
    let mut resolved = (*experiment.get().resolved(py, threads)?).clone();
    let mut warnings = in_words(&subtract_what_is_given(&mut resolved.study, is_given));
    let exposures = developed(&resolved.study, &frames)?;
    let mut view = components
        .map(|components| View::whole(py, experiment.get(), components.get(), (false, Wanted::Lit), threads))
        .transpose()?;
    if let Some(view) = &mut view {
        view.subtract_what_is_given(is_given);
    }
    let analyzed =
        work_through(py, threads, || analyzed(&resolved, view.as_ref(), exposures, &mut warnings))?;
    let told = |error: PipelineError| match components.is_none() && needs_parts(&error) {
        true => failed(format!("{error}, or components=")),
        false => failed(error),
    };
    Ok(analyzed.map_err(told)?.map(|all| FrameAnalysis::new(all, warnings)))
}

/// Whether a region is one of parts, which only components tell.
fn needs_parts(error: &PipelineError) -> bool {
    match error {
        PipelineError::Region { error, .. } => needs_parts(error),
        error => matches!(error, PipelineError::Analysis(AnalysisError::Region(RegionError::NoPartMap(_)))),
    }
}

/// What it means that some captures subtract no frame.
fn in_words(left_out: &[(String, String)]) -> Vec<String> {
    let words = |(label, missing): &(String, String)| {
        format!(
            "Nothing is subtracted from \"{label}\" but the black level: the experiment subtracts \"{missing}\", which is not given. Room \
             light counts as light of the region; give the frame \"{missing}\", too"
        )
    };
    left_out.iter().map(words).collect()
}

/// The analysis of frames, developed first if they are raw, and that of further regions. What raw frames may be mistaken for is added to
/// `warnings`; of those of a simulation its capture has told.
fn analyzed(
    experiment: &ResolvedExperiment,
    view: Option<&View>,
    frames: Result<Vec<CapturedFrame>, Vec<RawExposures>>,
    warnings: &mut Vec<String>,
) -> Result<Option<(AnalyzedFrame, Vec<AnalyzedRegion>)>, PipelineError> {
    let study = &experiment.study;
    let frames = match frames {
        Ok(frames) => frames,
        Err(exposures) => {
            for SensorImage { label, data, black_level, white_level, .. } in
                exposures.iter().map(|one| &one.raw)
            {
                if let Some(doubt) = black_level_doubt(data, *black_level, *white_level) {
                    warnings.push(format!(
                        "Frame \"{label}\": {doubt}. Describe it with its own: describe(FILE, black_level=64, ...)"
                    ));
                }
            }
            let calibration = Calibration::of_study(study, exposures.iter().flat_map(RawExposures::all))?;
            let frames = develop_frames(study, exposures, &calibration)?;
            warnings.extend(dark_frames(experiment, &frames));
            frames
        }
    };
    let seen = view.map(View::seen);
    let Some(analyzed) = analyze_seen(study, seen.as_ref(), &frames)? else { return Ok(None) };
    Ok(Some((analyzed, analyze_regions(study, seen.as_ref(), &frames)?)))
}
