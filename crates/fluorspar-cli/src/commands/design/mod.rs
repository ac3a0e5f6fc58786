//! `fluorspar design`: lights, filters and sensors compared by what they could prove.

mod compare;
mod outcome;
mod renders;
mod scenes;
mod shard;
mod sweep;

use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::design::DesignSpace;
use fluorspar_experiment::{ResolvedDesign, parse_design};
use fluorspar_session::{Changes, ExperimentSource};

use crate::commands::actions::actions;
use crate::error::CliError;
use crate::message::Messages;
use crate::values::{as_typed, sets};

actions! {
    /// Evaluate all designs of a problem; a killed sweep goes on where it was.
    Sweep(sweep::SweepOptions) => sweep::sweep,
    /// Find the best design: all of them where that is possible, otherwise by exchange of one choice at a time.
    Optimize(sweep::OptimizeOptions) => sweep::optimize,
    /// Evaluate the designs that the file names under [[compare]]. Two finished runs: `fluorspar compare A B`.
    Compare(compare::Options) => compare::run,
    /// Write the scenes that the problem renders as experiments, for several processes to render one of them together.
    Scenes(scenes::Options) => scenes::run,
    /// Make one result of the journals of several `sweep --shard` processes.
    Merge(sweep::MergeOptions) => sweep::merge,
}

/// The design problem and its changes.
#[derive(Clone, Debug, clap::Args)]
struct ProblemArgs {
    /// Design file (.toml), or the name of a built-in problem [default: two-lights].
    #[arg(value_name = "DESIGN", value_hint = ValueHint::FilePath)]
    design: Option<String>,
    /// Folder for the scenes that the problem renders, by digest: problems and processes share them [default:
    /// fluorspar-out/design-renders].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    renders: Option<PathBuf>,
    #[command(flatten)]
    changes: Changes,
}

/// Where results go.
#[derive(Clone, Debug, clap::Args)]
struct Place {
    /// Folder for results.json, designs.csv, designs.jsonl, report.html and its figures [default: fluorspar-out/design-NAME; with --set or
    /// --unset a folder of its own for these changes, fluorspar-out/design-NAME-DIGEST]. The journal of
    /// the work lies beside it.
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    out: Option<PathBuf>,
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
struct Problem {
    source: ExperimentSource,
    resolved: ResolvedDesign,
    space: DesignSpace,
}

impl ProblemArgs {
    fn read(&self) -> Result<ReadProblem, CliError> {
        let source = ExperimentSource::find_design(self.design.as_deref())?;
        let overrides = self.changes.overrides();
        let resolved = parse_design(&source.text, &source.name, &source.base_dir, &sets(&overrides))
            .map_err(|error| as_typed(error, &overrides))?;
        Messages::default().warnings(&resolved.record.warnings);
        let default = || PathBuf::from("fluorspar-out/design-renders");
        let renders = self.renders.clone().unwrap_or_else(default);
        Ok(ReadProblem { source, resolved, is_changed: !overrides.is_empty(), renders })
    }
}

impl ReadProblem {
    /// Renders the scenes that are missing, and prepares the signals.
    fn prepare(self) -> Result<Problem, CliError> {
        let Self { source, resolved, renders, .. } = self;
        let problem = renders::complete(&resolved, &renders, Messages::default())?;
        let space = DesignSpace::new(problem)
            .map_err(|error| CliError::Input(format!("{}: {error}", source.name)))?;
        Ok(Problem { source, resolved, space })
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
