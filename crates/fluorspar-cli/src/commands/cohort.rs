//! `fluorspar cohort`: what many people show, in words.

use fluorspar_report::cohort_report;
use fluorspar_session::{CohortOptions, ExaminedCohort, cohort};

use super::{Answering, print_json, print_text};
use crate::error::CliError;
use crate::message::Messages;

pub(crate) fn run(options: &Answering<CohortOptions>) -> Result<(), CliError> {
    let examined = cohort(&options.task, &Messages::default().job())?;
    match &examined {
        _ if options.form.json => print_json(&examined),
        ExaminedCohort::All(outcome) => print_text(&cohort_report(&outcome.0).lead.join("\n")),
        // Its status says it
        ExaminedCohort::Shard(_) => Ok(()),
    }
}
