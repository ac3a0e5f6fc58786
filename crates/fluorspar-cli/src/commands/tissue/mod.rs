//! `fluorspar tissue`: solve, sweep, depth, mc, fit.

mod depth;
mod fit;
mod list;
mod mc;
mod show;
mod solve;
mod sweep;

pub(crate) use list::run as list;
pub(crate) use show::{Options as ShowOptions, StateOptions, run as show, run_state as show_state};

use fluorspar_session::tissue::{
    self, DepthOptions, MonteCarloOptions, SolveOptions, TissueFitOptions, TissueSweepOptions,
};

use crate::commands::Answering;
use crate::commands::subcommands::subcommands;

subcommands! {
    /// Compute reflectance and fluorescence of a tissue.
    Solve(Answering<SolveOptions>) => |options| options.answer(tissue::solve, solve::describe),
    /// Solve a tissue at several values of a parameter: a table, curves and a page of its color, its fluorescence and its depths.
    Sweep(Answering<TissueSweepOptions>) => |options| options.answer(tissue::sweep, sweep::describe),
    /// Tell from which depth and layer the fluorescence of each channel comes.
    Depth(Answering<DepthOptions>) => |options| options.answer(tissue::depth, depth::describe),
    /// Trace photons through the layers of a tissue by Monte Carlo: reflectance, transmittance, absorption, fluence, fluorescence.
    Mc(Answering<MonteCarloOptions>) => mc::run,
    /// Fit parameters of a tissue to measured reflectance and fluorescence.
    Fit(Answering<TissueFitOptions>) => |options| options.answer(tissue::fit, fit::describe),
}
