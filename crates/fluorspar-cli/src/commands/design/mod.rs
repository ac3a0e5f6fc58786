//! `fluorspar design`: designs in words.

mod words;

use fluorspar_session::design::{
    self, MergeOptions, OptimizeOptions, ProblemOptions, Sweep, SweepOptions, sweep,
};

use self::words::{describe, describe_compared, describe_scenes};
use crate::commands::Answering;
use crate::commands::subcommands::subcommands;
use crate::error::CliError;
use crate::message::Messages;

subcommands! {
    /// Evaluate all designs of a problem; a killed sweep goes on where it was.
    Sweep(Answering<SweepOptions>) => run_sweep,
    /// Find the best design: all of them where that is possible, otherwise by exchange of one choice at a time.
    Optimize(Answering<OptimizeOptions>) => |options| options.answer(design::optimize, describe),
    /// Evaluate the designs that the file names under [[compare]]. Two finished runs: `fluorspar compare A B`.
    Compare(Answering<ProblemOptions>) => |options| options.answer(design::compare, describe_compared),
    /// Write the scenes that the problem renders as experiments, for several processes to render one of them together.
    Scenes(Answering<ProblemOptions>) => |options| options.answer(design::scenes, describe_scenes),
    /// Make one result of the journals of several `sweep --shard` processes.
    Merge(Answering<MergeOptions>) => |options| options.answer(design::merge, describe),
}

fn run_sweep(options: &Answering<SweepOptions>) -> Result<(), CliError> {
    let swept = sweep(&options.task, &Messages::default().job())?;
    match &swept {
        Sweep::All(outcome) => options.print(outcome, |outcome| describe(outcome)),
        // Its status says it
        Sweep::Shard { .. } if !options.form.json => Ok(()),
        Sweep::Shard { .. } => crate::commands::print_json(&swept),
    }
}
