//! `fluorspar run`: what a run found, in words.

use std::process::ExitCode;

use fluorspar::findings::region_findings;
use fluorspar_report::finding_lines;
use fluorspar_session::{FinishedExperiment, RunOptions, run as run_experiment};

use super::analyze::{assumed_tissue, regions_table};
use super::{Answering, print_json, print_text};
use crate::error::{CliError, STOPPED};
use crate::message::Messages;

pub(crate) fn run(options: &Answering<RunOptions>) -> Result<ExitCode, CliError> {
    let messages = Messages::default();
    let job = messages.job();
    let finished = run_experiment(&options.task, &job)?;
    if options.form.json {
        print_json(&finished)?;
    } else if let Some(text) = describe(&finished) {
        print_text(&text)?;
    }
    Ok(if finished.is_complete { ExitCode::SUCCESS } else { ExitCode::from(STOPPED) })
}

fn describe(FinishedExperiment { experiment, analysis, regions, .. }: &FinishedExperiment) -> Option<String> {
    let analysis = analysis.as_ref()?;
    let mut lines = finding_lines(&region_findings(analysis), &analysis.analyte, false);
    lines.extend(assumed_tissue(analysis));
    let table = regions_table(experiment, analysis, regions);
    Some(if table.is_empty() { lines.join("\n") } else { format!("{}\n{table}", lines.join("\n")) })
}
