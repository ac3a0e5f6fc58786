//! `fluorspar analyze`: the analysis of frames, or of many photographs, in words.

use std::collections::BTreeSet;

use fluorspar::analysis::Analysis;
use fluorspar::findings::region_findings;
use fluorspar::pipeline::AnalyzedRegion;
use fluorspar::units::counted;
use fluorspar_experiment::ResolvedExperiment;
use fluorspar_report::{ASSUMED_GAIN, NumberMatrix, finding_lines, regions_matrix};
use fluorspar_session::{
    AnalyzeOptions, Analyzed, AnalyzedFrames, AnalyzedPhotographs, FailedPhotograph, analyze,
};

use super::Answering;
use super::table::align;
use crate::error::CliError;
use crate::message::Messages;

pub(crate) fn run(options: &Answering<AnalyzeOptions>) -> Result<(), CliError> {
    let analyzed = analyze(&options.task, &Messages::default().job())?;
    options.print(&analyzed, |analyzed| match analyzed {
        Analyzed::Frames(frames) => describe(frames),
        Analyzed::Photographs(photographs) => describe_photographs(photographs),
    })?;
    match &analyzed {
        Analyzed::Photographs(photographs) => no_answer(&photographs.failures),
        Analyzed::Frames(_) if options.task.out.is_none() => {
            Messages::default().status("Next: the same with --out FOLDER writes a report and maps");
            Ok(())
        }
        Analyzed::Frames(_) => Ok(()),
    }
}

/// How many photographs have how many numbers, and where these are.
fn describe_photographs(found: &AnalyzedPhotographs) -> String {
    let AnalyzedPhotographs { folder, photographs, estimates, .. } = found;
    if estimates.is_empty() {
        return format!("{photographs} photographs, no region placed");
    }
    let apart = estimates.iter().filter(|estimate| estimate.lies_apart);
    let apart = apart.map(|of| (&of.frame, &of.number.region)).collect::<BTreeSet<_>>().len();
    let table = folder.join("patients.csv");
    format!(
        "{photographs} photographs, {} numbers, {} apart from the others: {}",
        estimates.len(),
        counted(apart, "region", "regions"),
        table.display()
    )
}

/// An error that names photographs without an answer, where there are some.
pub(crate) fn no_answer(failures: &[FailedPhotograph]) -> Result<(), CliError> {
    if failures.is_empty() {
        return Ok(());
    }
    Err(CliError::Input(FailedPhotograph::list(failures)))
}

fn describe(AnalyzedFrames { experiment, analysis, regions }: &AnalyzedFrames) -> String {
    let mut text = describe_region(analysis);
    for region in regions {
        let told = match &region.analyzed {
            Ok(analyzed) => describe_region(&analyzed.analysis),
            Err(why) => format!("Not in view: {why}\n"),
        };
        text += &format!("\nRegion \"{}\". {told}", region.name);
    }
    text + &regions_table(experiment, analysis, regions)
}

/// The findings of a region, and what they may be mistaken for.
fn describe_region(analysis: &Analysis) -> String {
    let mut text = format!("Frame \"{}\", {}\n", analysis.frame, analysis.region_description);
    for line in finding_lines(&region_findings(analysis), &analysis.analyte, true) {
        text += &format!("{line}\n");
    }
    text.extend(assumed_tissue(analysis).map(|line| line + "\n"));
    if analysis.gain_is_assumed {
        text += &format!("Electrons, signal to noise and noise in intervals: {ASSUMED_GAIN}\n");
    }
    for warning in &analysis.warnings {
        text += &format!("warning: {warning}\n");
    }
    text
}

/// The regions of a frame as lines; empty where there is only that of the analysis.
pub(crate) fn regions_table(
    experiment: &ResolvedExperiment,
    analysis: &Analysis,
    regions: &[AnalyzedRegion],
) -> String {
    let Some(NumberMatrix { caption, columns, rows, note }) = regions_matrix(experiment, analysis, regions)
    else {
        return String::new();
    };
    let cells: Vec<Vec<String>> = std::iter::once(columns).chain(rows).collect();
    format!("\n{caption}\n{}{note}\n", align(&cells, &[0, 2]))
}

/// What is assumed of the tissue, as a line.
pub(crate) fn assumed_tissue(analysis: &Analysis) -> Option<String> {
    let prior = &analysis.posterior.as_ref()?.prior;
    Some(format!("  Assumed of the tissue: {prior}"))
}
