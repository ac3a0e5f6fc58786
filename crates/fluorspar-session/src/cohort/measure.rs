//! What is found in a view of a person.

use fluorspar::analysis::{Analysis, AnalysisError};
use fluorspar::findings::{Finding, FindingId, PersonFinding, region_findings};
use fluorspar::image::ComponentFactors;
use fluorspar::pipeline::{
    AnalyzedRegion, CapturePlanes, CapturedFrame, PipelineError, SeenComponents, analyze_regions,
    analyze_seen, capture_from_planes, check_captures,
};
use fluorspar::study::{AnalysisPlan, Capture, RegionPlan, Study};
use fluorspar_experiment::CohortStudy;

use super::examine::ExaminedView;
use crate::Result;

/// What is measured in frames beside that of the analysis.
const OF_FURTHER_FRAMES: [FindingId; 4] =
    [FindingId::ChromaticityR, FindingId::ChromaticityG, FindingId::MedianSignal, FindingId::PixelsUsed];

/// Captures a view and analyzes its parts: the frame of the analysis with all its estimates, then colors and signals of the other frames
/// with light. Parts that no pixel shows are left out.
pub(super) fn findings_of_view(
    cohort: &CohortStudy,
    examined: &ExaminedView<'_>,
) -> Result<Vec<PersonFinding>> {
    measured(cohort, examined).map_err(|error| examined.failed(error))
}

fn measured(cohort: &CohortStudy, examined: &ExaminedView<'_>) -> Result<Vec<PersonFinding>, PipelineError> {
    let (study, image) = (&examined.experiment.study, examined.components);
    check_captures(study, image)?;
    let planes = CapturePlanes::new(study, image)?;
    let factors = ComponentFactors::ones(image.components.len());
    let seen = SeenComponents { image, planes: &planes, captures: &study.captures, factors: &factors };
    let frames = capture_from_planes(study, &seen)?;
    let study = &with_further_frames(study, &frames);
    let main = match analyze_seen(study, Some(&seen), &frames) {
        Ok(analyzed) => analyzed.map(|analyzed| analyzed.analysis),
        Err(PipelineError::Analysis(AnalysisError::Region(why))) if why.is_out_of_view() => None,
        Err(error) => return Err(error),
    };
    let regions = analyze_regions(study, Some(&seen), &frames)?;
    let in_view = regions
        .iter()
        .filter_map(|region: &AnalyzedRegion| Some((region.name.as_str(), &region.in_view()?.analysis)));
    let first = examined.view.parts.first().copied().unwrap_or_default();
    let all = main.as_ref().map(|analysis| (first, analysis)).into_iter().chain(in_view);
    let analyzed_frame = study.analysis.as_ref().map(|plan| plan.frame.as_str());
    Ok(all
        .flat_map(|(part, analysis)| findings_of(cohort, examined, part, analysis, analyzed_frame))
        .collect())
}

/// The study with every part of its analysis as a region of each other frame with light, for colors alone.
fn with_further_frames(study: &Study, frames: &[CapturedFrame]) -> Study {
    let mut study = study.clone();
    let Some(plan) = &study.analysis else { return study };
    let is_lit = |capture: &&Capture| capture.frame.lights.values().any(|drive| *drive > 0.0);
    let has_colors = |capture: &&Capture| {
        frames.iter().any(|f| f.raw.label == capture.frame.label && f.developed.channels.len() == 3)
    };
    let others = study.captures.iter().filter(is_lit).filter(has_colors);
    let others = others.map(|capture| capture.frame.label.clone()).filter(|label| *label != plan.frame);
    let of_main = plan.parts.first().map(|part| RegionPlan { name: part.clone(), analysis: plan.clone() });
    let plans: Vec<RegionPlan> = of_main.iter().chain(&study.regions).cloned().collect();
    let colors_of = |frame: String| {
        plans.iter().map(move |region| RegionPlan {
            name: region.name.clone(),
            analysis: AnalysisPlan {
                frame: frame.clone(),
                porphyrin: None,
                tissue: None,
                targets: Vec::new(),
                further_frames: Vec::new(),
                ..region.analysis.clone()
            },
        })
    };
    let further: Vec<RegionPlan> = others.flat_map(colors_of).collect();
    study.regions.extend(further);
    study
}

/// The findings of a part in a frame.
fn findings_of(
    cohort: &CohortStudy,
    examined: &ExaminedView<'_>,
    part: &str,
    analysis: &Analysis,
    analyzed_frame: Option<&str>,
) -> Vec<PersonFinding> {
    let (person, view) = (examined.person, examined.view.name);
    let held = |lesion| cohort.has_lesion(person, lesion);
    let is_on_part = cohort.lesions().iter().any(|lesion| held(lesion) && reaches(&lesion.part, part));
    let is_main = analyzed_frame == Some(analysis.frame.as_str());
    // Where no porphyrin can't be excluded the finding has no value; people together need one
    let median =
        analysis.posterior.as_ref().filter(|found| !found.is_no_estimate()).map(|found| found.median);
    let is_wanted = |finding: &Finding| is_main || OF_FURTHER_FRAMES.contains(&finding.id);
    let of_person = |mut finding: Finding| {
        if finding.id == FindingId::Share {
            finding.value = finding.value.or(median);
        }
        let (part, has_lesion) =
            match cohort.lesions().iter().find(|lesion| finding.name.as_ref() == Some(&lesion.name)) {
                // At the edge of a view that is of something else it says little
                Some(lesion) if !examined.view.parts.iter().any(|part| reaches(&lesion.part, part)) => {
                    return None;
                }
                Some(lesion) => (lesion.part.as_str(), held(lesion)),
                None => (part, is_on_part),
            };
        Some(PersonFinding::of(&finding, [view, part, &analysis.frame], has_lesion))
    };
    region_findings(analysis).into_iter().filter(is_wanted).filter_map(of_person).collect()
}

/// Whether a lesion on a part may reach another: the parts of the tongue share a border.
fn reaches(on: &str, part: &str) -> bool {
    on == part || (on.starts_with("tongue_") && part.starts_with("tongue_"))
}
