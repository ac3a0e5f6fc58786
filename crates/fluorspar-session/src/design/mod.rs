//! Lights, filters and sensors compared by what they could prove.

mod compare;
mod found;
mod outcome;
mod renders;
mod scenes;
mod sweep;

pub use compare::{ComparedDesigns, compare};
pub use found::{DesignKey, FoundDesigns, ToldDesign};
pub use outcome::{DesignOutcome, criterion_text};
pub use scenes::{DesignScene, DesignScenes, scenes};
pub use sweep::{MergeOptions, OptimizeOptions, Sweep, SweepOptions, merge, optimize, sweep};

use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::design::DesignSpace;
use fluorspar_experiment::{ResolvedDesign, parse_design};
use serde::Deserialize;

use crate::values::{as_typed, sets};
use crate::{Changes, Error, ExperimentSource, Job, Result};

/// The design problem and its changes.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct ProblemOptions {
    /// Design file (.toml), or the name of a built-in problem [default: two-lights].
    #[arg(value_name = "DESIGN", value_hint = ValueHint::FilePath)]
    pub design: Option<String>,
    /// Folder for the scenes that the problem renders, by digest: problems and processes share them [default:
    /// fluorspar-out/design-renders].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub renders: Option<PathBuf>,
    /// Changes by path.
    #[command(flatten)]
    #[serde(flatten)]
    pub changes: Changes,
}

/// Where results go.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct Place {
    /// Folder for results.json, designs.csv, designs.jsonl, report.html and its figures [default: fluorspar-out/design-NAME; with --set or
    /// --unset a folder of its own for these changes, fluorspar-out/design-NAME-DIGEST]. The journal of
    /// the work lies beside it.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// A problem as its file says it.
struct ReadProblem {
    /// Where it was read from.
    source: ExperimentSource,
    resolved: ResolvedDesign,
    /// Whether it differs from the file by options of the command.
    is_changed: bool,
    /// Folder of rendered scenes.
    renders: PathBuf,
}

/// A problem, ready to be searched.
pub struct PreparedProblem {
    /// Where it was read from.
    pub source: ExperimentSource,
    /// Its file.
    pub resolved: ResolvedDesign,
    /// Its designs.
    pub space: DesignSpace,
}

impl PreparedProblem {
    /// Name for people.
    pub fn title(&self) -> &str {
        let title = &self.resolved.record.title;
        if title.is_empty() { &self.source.stem } else { title }
    }
}

impl ProblemOptions {
    fn read(&self, job: &Job) -> Result<ReadProblem> {
        let source = ExperimentSource::find_design(self.design.as_deref())?;
        let overrides = self.changes.overrides();
        let resolved = parse_design(&source.text, &source.name, &source.base_dir, &sets(&overrides))
            .map_err(|error| as_typed(error, &overrides))?;
        job.warn(&resolved.record.warnings);
        let default = || PathBuf::from("fluorspar-out/design-renders");
        let renders = self.renders.clone().unwrap_or_else(default);
        Ok(ReadProblem { source, resolved, is_changed: !overrides.is_empty(), renders })
    }
}

impl ReadProblem {
    /// Renders the scenes that are missing, and prepares the signals.
    fn prepare(self, job: &Job) -> Result<PreparedProblem> {
        let Self { source, resolved, renders, .. } = self;
        let problem = renders::complete(&resolved, &renders, job)?;
        let space =
            DesignSpace::new(problem).map_err(|error| Error::Input(format!("{}: {error}", source.name)))?;
        Ok(PreparedProblem { source, resolved, space })
    }

    /// The folder of results. That of a changed problem is its own, so that nothing is written over what the file itself gave.
    fn folder(&self, place: &Place) -> PathBuf {
        let default = || {
            let of_file = format!("fluorspar-out/design-{}", self.source.stem);
            PathBuf::from(match self.is_changed {
                true => format!("{of_file}-{}", &self.resolved.record.sha256[..8]),
                false => of_file,
            })
        };
        place.out.clone().unwrap_or_else(default)
    }

    /// Files that were read.
    fn inputs(&self) -> Vec<PathBuf> {
        self.source.files(&self.resolved.record)
    }
}
