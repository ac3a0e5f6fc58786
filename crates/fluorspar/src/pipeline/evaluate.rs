//! Everything after the render, each result once.

use super::capture::{
    CapturePlanes, CapturedFrame, SeenComponents, SpectroradiometerReading, capture_from_planes,
    check_captures, read_spectroradiometers,
};
use super::display::{ColorRendering, Preview, preview};
use super::error::PipelineError;
use super::estimate::{
    AnalyzedFrame, AnalyzedRegion, DepthOfLight, FrameLeak, RegionRadiance, analyze_regions, analyze_seen,
    depths_of_light, frame_leak,
};
use super::safety::{SafetyReport, assess_safety};
use crate::image::{ComponentFactors, ComponentImage};
use crate::study::{Capture, Study};

/// Results of a study, computed from its component image.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Raw and developed frames, one for each capture.
    pub frames: Vec<CapturedFrame>,
    /// Images of the developed frames for people, in the same order.
    pub previews: Vec<Preview>,
    /// The analyzed frame, if the study has an analysis.
    pub analysis: Option<AnalyzedFrame>,
    /// Regions beside that of the analysis, of the same frame.
    pub regions: Vec<AnalyzedRegion>,
    /// Mean radiance of the analyzed region under the lights of the analyzed frame.
    pub region_radiance: Option<RegionRadiance>,
    /// Reflected light against fluorescence in each frame that has light, over the analyzed region or the whole frame.
    pub leaks: Vec<FrameLeak>,
    /// From how deep the fluorescence of layered tissues comes, in the frames that are made of fluorescence.
    pub depths: Vec<DepthOfLight>,
    /// Readings of the spectroradiometers.
    pub spectra: Vec<SpectroradiometerReading>,
    /// Photobiological safety of the captures, if the study has a plan for it.
    pub safety: Option<SafetyReport>,
}

impl Evaluation {
    /// The leak of the analyzed frame.
    pub fn analyzed_leak(&self) -> Option<&FrameLeak> {
        let frame = &self.analysis.as_ref()?.analysis.frame;
        self.leaks.iter().find(|leak| leak.frame == *frame)
    }
}

/// Runs the whole chain of a study on its component image: captures, analysis, spectroradiometers, previews, leaks and
/// safety. A study without captures has its spectroradiometers and its safety only.
///
/// # Errors
/// The first stage that can't be run: captures without a lens or a sensor, an image of another study, a region without
/// pixels.
pub fn evaluate(study: &Study, components: &ComponentImage) -> Result<Evaluation, PipelineError> {
    if study.captures.is_empty() {
        return evaluate_from_planes(study, components, None);
    }
    check_captures(study, components)?;
    let planes = CapturePlanes::new(study, components)?;
    evaluate_from_planes(study, components, Some(&planes))
}

/// [`evaluate`] with the channel planes of the captures; a study without captures needs none.
///
/// # Errors
/// Those of [`evaluate`].
pub fn evaluate_from_planes(
    study: &Study,
    components: &ComponentImage,
    planes: Option<&CapturePlanes>,
) -> Result<Evaluation, PipelineError> {
    let Some(planes) = planes else {
        return evaluate_frames(study, components, None, Vec::new(), None, Vec::new());
    };
    let factors = ComponentFactors::ones(components.components.len());
    let seen = SeenComponents { image: components, planes, captures: &study.captures, factors: &factors };
    let frames = capture_from_planes(study, &seen)?;
    let analysis = analyze_seen(study, Some(&seen), &frames)?;
    let regions = analyze_regions(study, Some(&seen), &frames)?;
    evaluate_frames(study, components, Some(&seen), frames, analysis, regions)
}

/// What follows from frames, their analysis with that of further regions, and the spectra of what is `seen` in them: radiance, leaks,
/// depths, previews, readings and safety.
///
/// # Errors
/// Those of [`evaluate`].
pub fn evaluate_frames(
    study: &Study,
    components: &ComponentImage,
    seen: Option<&SeenComponents<'_>>,
    frames: Vec<CapturedFrame>,
    analysis: Option<AnalyzedFrame>,
    regions: Vec<AnalyzedRegion>,
) -> Result<Evaluation, PipelineError> {
    // Measure the radiance itself
    let spectra = read_spectroradiometers(study, components)?;
    let region = analysis.as_ref().map(|analyzed| &analyzed.region);
    let region_radiance = region.and_then(|region| RegionRadiance::of_analysis(study, components, region));

    // Render the frames for people and split their electrons
    let mut previews = Vec::with_capacity(frames.len());
    let mut leaks = Vec::new();
    for (frame, capture) in frames.iter().zip(&study.captures) {
        previews.push(preview(&frame.developed, &ColorRendering::of_frame(study, capture)));
        if let Some(seen) = seen {
            leaks.extend(frame_leak(study, components, seen, capture, frame.raw.exposure_s, region)?);
        }
    }

    let depths = depths_of_light(study, &of_fluorescence(study, &leaks)).map_err(PipelineError::Depths)?;
    let safety = assess_safety(study, &frames);
    Ok(Evaluation { frames, previews, analysis, regions, region_radiance, leaks, depths, spectra, safety })
}

/// The captures whose light is fluorescence: light that comes from below the surface.
fn of_fluorescence<'a>(study: &'a Study, leaks: &[FrameLeak]) -> Vec<&'a Capture> {
    let fluorescent = leaks.iter().filter(|leak| !leak.is_reflectance());
    fluorescent.filter_map(|leak| study.capture(&leak.frame)).collect()
}
