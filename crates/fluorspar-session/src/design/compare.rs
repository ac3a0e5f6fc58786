//! The designs that a file names, side by side.

use fluorspar_report::JudgedDesign;
use serde::{Serialize, Serializer};
use serde_json::json;

use super::outcome::{compared, criterion_text, design_json, provenance};
use super::{PreparedProblem, ProblemOptions};
use crate::{Error, Job, Result};

/// The designs that a file names.
pub struct ComparedDesigns {
    /// The problem.
    pub problem: PreparedProblem,
    /// The designs in the order of the file.
    pub designs: Vec<JudgedDesign>,
}

impl Serialize for ComparedDesigns {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { problem, designs } = self;
        let space = &problem.space;
        let designs: Vec<_> = designs.iter().map(|judged| design_json(space, judged)).collect();
        let (provenance, criterion) = (provenance(problem), criterion_text(space));
        json!({ "provenance": provenance, "criterion": criterion, "designs": designs }).serialize(serializer)
    }
}

/// Evaluates the designs that a file names.
///
/// # Errors
/// A defect of the file; one that names none; scenes that can't be rendered.
pub fn compare(options: &ProblemOptions, job: &Job) -> Result<ComparedDesigns> {
    let read = options.read(job)?;
    if !read.resolved.names_compared {
        return Err(Error::Input(format!(
            "{}: there is no design to compare; name some, each as [[compare]] with name, lights and what else it chooses, or rank all \
             with `fluorspar design sweep`",
            read.source.name
        )));
    }
    let problem = read.prepare(job)?;
    Ok(ComparedDesigns { designs: compared(&problem)?, problem })
}
