//! The designs that a file names, side by side.

use fluorspar_report::cures;
use serde_json::json;

use super::ProblemArgs;
use super::outcome::{compared, criterion_text, design_json, legend, provenance, remarks, table};
use crate::args::Answer;
use crate::commands::{print_json, print_text};
use crate::error::CliError;

/// Options of `design compare`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    #[command(flatten)]
    problem: ProblemArgs,
    #[command(flatten)]
    answer: Answer,
}

pub(super) fn run(options: &Options) -> Result<(), CliError> {
    let read = options.problem.read()?;
    if !read.resolved.names_compared {
        return Err(CliError::Input(format!(
            "{}: there is no design to compare; name some, each as [[compare]] with name, lights and what else it chooses, or rank all \
             with `fluorspar design sweep`",
            read.source.name
        )));
    }
    let problem = read.prepare()?;
    let designs = compared(&problem);
    if options.answer.json {
        let designs: Vec<_> = designs.iter().map(|judged| design_json(&problem.space, judged)).collect();
        let criterion = criterion_text(&problem.space);
        print_json(
            &json!({ "provenance": provenance(&problem), "criterion": criterion, "designs": designs }),
        )?;
    } else {
        let space = &problem.space;
        let table = table(space, designs.iter(), &[]);
        let mut text = format!(
            "by {}\n{}\n{table}{}\n",
            criterion_text(space),
            remarks(space),
            legend(space, designs.first())
        );
        if designs.iter().all(|judged| !judged.merits.loss.is_finite()) {
            for cure in cures(space, designs.into_iter().map(|judged| judged.design)) {
                text += &format!("{cure}\n");
            }
        }
        print_text(&text)?;
    }
    Ok(())
}
