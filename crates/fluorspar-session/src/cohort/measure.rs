//! What is found in a view of a person.

use fluorspar::analysis::{Analysis, AnalysisError, TargetDetection};
use fluorspar::findings::{Finding, FindingId, PersonFinding, region_findings};
use fluorspar::image::ComponentFactors;
use fluorspar::pipeline::{
    AnalyzedRegion, CapturePlanes, CapturedFrame, PipelineError, SeenComponents, analyze_regions,
    analyze_seen, capture_from_planes, check_captures,
};
use fluorspar::scene::Shape;
use fluorspar::study::{AnalysisPlan, Capture, RegionPlan, Study, TargetPlace};
use fluorspar_experiment::CohortStudy;
use fluorspar_experiment::schema::LesionSection;

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
    let study = &examined.experiment.study;
    let held = |lesion| cohort.has_lesion(person, lesion);
    let is_on_part = cohort.lesions().iter().any(|lesion| is_on(study, lesion, part) && held(lesion));
    let is_main = analyzed_frame == Some(analysis.frame.as_str());
    // Where no porphyrin can't be excluded the finding has no value; people together need one
    let median =
        analysis.posterior.as_ref().filter(|found| !found.is_no_estimate()).map(|found| found.median);
    let is_wanted = |finding: &Finding| is_main || OF_FURTHER_FRAMES.contains(&finding.id);
    let of_person = |mut finding: Finding| {
        if finding.id == FindingId::Share {
            finding.value = finding.value.or(median);
        }
        let (part, has_lesion) = match lesion_of(cohort.lesions(), &finding) {
            Some(lesion) if !is_shown(examined, lesion, analysis) => return None,
            Some(lesion) => (lesion.part.as_str(), held(lesion)),
            None => (part, is_on_part),
        };
        Some(PersonFinding::of(&finding, [view, part, &analysis.frame], has_lesion))
    };
    region_findings(analysis).into_iter().filter(is_wanted).filter_map(of_person).collect()
}

/// What is found of a target; a tissue or a fluorophore of its name is something else.
const OF_TARGETS: [FindingId; 7] = [
    FindingId::TargetSeparation,
    FindingId::TargetSeparationOfPixel,
    FindingId::TargetSeparationOfSensor,
    FindingId::SmallestDiameter,
    FindingId::FramesNeeded,
    FindingId::TargetContrast,
    FindingId::TargetCnr,
];

/// The lesion that a finding is of.
fn lesion_of<'a>(lesions: &'a [LesionSection], finding: &Finding) -> Option<&'a LesionSection> {
    let is_of = |lesion: &&LesionSection| finding.name.as_ref() == Some(&lesion.name);
    lesions.iter().find(is_of).filter(|_| OF_TARGETS.contains(&finding.id))
}

/// Share of a lesion from which on a view of other parts shows it; of less, at its edge, the contrast says little. \[assumed\]
const LEAST_SEEN: f64 = 0.25;

/// Whether a view is of a part that a lesion lies on, or shows enough of it.
fn is_shown(examined: &ExaminedView<'_>, lesion: &LesionSection, analysis: &Analysis) -> bool {
    let study = &examined.experiment.study;
    let seen_mm2 = |target: &TargetDetection| {
        let mm_per_px = target.smallest_diameter_mm.map(|mm| mm / target.smallest_diameter_px);
        target.pixels as f64 * mm_per_px.unwrap_or(0.0).powi(2)
    };
    let seen_mm2 = analysis.targets.iter().filter(|target| target.target == lesion.name).map(seen_mm2);
    examined.view.parts.iter().any(|part| is_on(study, lesion, part))
        || seen_mm2.fold(0.0, f64::max) >= LEAST_SEEN * 1e6 * area_m2(study, lesion, |_| true)
}

/// Whether a lesion lies on a part: its own, or one that it goes on to.
fn is_on(study: &Study, lesion: &LesionSection, part: &str) -> bool {
    lesion.part == part || area_m2(study, lesion, |on| on == part) > 0.0
}

/// Area of a lesion on some parts, where its map is at least a half.
fn area_m2(study: &Study, lesion: &LesionSection, is_counted: impl Fn(&str) -> bool) -> f64 {
    let targets = study.analysis.iter().flat_map(|plan| &plan.targets);
    let spots =
        targets.filter(|target| target.name == lesion.name).filter_map(|target| match &target.place {
            TargetPlace::Spot(spots) => Some(spots),
            TargetPlace::Region(_) => None,
        });
    let counted = spots.flatten().filter(|(part, _)| is_counted(part));
    let areas = counted.filter_map(|(part, map)| {
        let object = study.scene.objects.iter().find(|object| object.name == *part)?;
        let Shape::Mesh(mesh) = &object.shape else { return None };
        let is_inside = |triangle: &&[u32; 3]| {
            let [a, b, c] = triangle.map(|vertex| mesh.uvs[vertex as usize]);
            map.at((a + b + c) / 3.0) >= 0.5
        };
        let inside = mesh.triangles.iter().filter(is_inside);
        Some(inside.map(|triangle| 0.5 * f64::from(mesh.triangle_cross(triangle).length())).sum::<f64>())
    });
    areas.sum()
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::atomic::AtomicBool;

    use fluorspar::render::{RenderControl, render};
    use fluorspar_experiment::{ExaminationView, parse_cohort};

    use super::*;
    use crate::cohort::examine::Examination;
    use crate::cohort::outcome::unseen;

    /// Parts that no view lists are measured where they are seen; a spot on the back of the tongue is not one of its border.
    #[test]
    fn lesions_are_measured_wherever_they_are_seen() {
        let lesion = |name: &str, part: &str, size_mm: [f64; 2]| {
            format!(
                "[[mouth.lesion]]\nname = \"{name}\"\npart = \"{part}\"\nblood_um = 40.0\nsize_mm = {size_mm:?}\n"
            )
        };
        let (lip, back) =
            (lesion("lip", "upper_lip", [12.0, 6.0]), lesion("back", "tongue_dorsum", [12.0, 6.0]));
        let cheek = lesion("cheek", "cheek_left", [60.0, 60.0]);
        let text = format!(
            "format = 1\nbase = \"oraleye-2021-surface\"\n[people]\ncount = 1\nprevalence = 1.0\n\
             [spectral]\nfirst_nm = 360.0\nlast_nm = 720.0\nstep_nm = 20.0\n\
             [render]\nwidth_px = 64\nheight_px = 48\nsamples_per_pixel = 2\n\
             [sensor]\ncolumns = 64\nrows = 48\npixel_size_um = 37.5\nfill_factor = 0.0044\n[mouth]\ndetail = 0.25\n{lip}{back}{cheek}"
        );
        let cohort = parse_cohort(&text, "cohort.toml", Path::new("."), &[]).unwrap();
        let view = ExaminationView::find("lips").unwrap();
        let Examination { experiment, .. } = Examination::prepare(&cohort, 1, view).unwrap();
        let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
        let components = render(&experiment.study.scene, &experiment.study.render, &control).unwrap();
        let examined = ExaminedView { person: 1, view, experiment: &experiment, components: &components };
        let found = findings_of_view(&cohort, &examined).unwrap();
        let contrasts = |name: &str| {
            let is_of = |finding: &&PersonFinding| {
                finding.quantity.id == FindingId::TargetContrast
                    && finding.quantity.name.as_deref() == Some(name)
            };
            found.iter().filter(is_of).count()
        };
        assert!(contrasts("lip") > 0);
        assert_eq!(contrasts("cheek"), 0);
        let found: Vec<(u32, PersonFinding)> = found.into_iter().map(|finding| (1, finding)).collect();
        let said: Vec<String> = unseen(cohort.lesions(), &found).iter().map(ToString::to_string).collect();
        assert!(
            said.iter().any(|said| said.starts_with("Lesion \"cheek\" is measured in nobody")),
            "{said:?}"
        );
        assert!(!said.iter().any(|said| said.contains("\"lip\"")), "{said:?}");
        let back = &cohort.lesions()[1];
        let lies = ["tongue_dorsum", "tongue_lateral_left", "tongue_ventral"]
            .map(|part| is_on(&experiment.study, back, part));
        assert_eq!(lies, [true, false, false]);
        // A tissue of its name is not a lesion
        let named = |id| Finding { name: Some("lip".into()), ..Finding::new(id, 1.0) };
        let of = |id| lesion_of(cohort.lesions(), &named(id)).is_some();
        assert!(of(FindingId::TargetContrast) && !of(FindingId::ProbabilityOfNone));
    }
}
