//! `fluorspar lens`: report.

mod list;
mod report;

pub(crate) use list::run as list;
pub(crate) use report::{Options as ReportOptions, run as report};

use crate::commands::subcommands::subcommands;

subcommands! {
    /// Trace a lens: focal length, pupils, illumination, distortion, field curvature, spots, MTF, drawings.
    Report(report::Options) => report::run,
}
