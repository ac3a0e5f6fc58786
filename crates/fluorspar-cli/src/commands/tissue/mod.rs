//! `fluorspar tissue`: solve, depth, mc, fit.

mod depth;
mod fit;
mod fit_output;
mod list;
mod mc;
mod mc_output;
mod show;
mod solve;
mod solve_output;
mod source;

pub(crate) use source::{find, site_named};

pub(crate) use list::run as list;
pub(crate) use show::{Options as ShowOptions, run as show};

use crate::commands::actions::actions;

actions! {
    /// Compute reflectance and fluorescence of a tissue.
    Solve(solve::Options) => solve::run,
    /// Tell from which depth and layer the fluorescence of each channel comes.
    Depth(depth::Options) => depth::run,
    /// Trace photons through the layers of a tissue by Monte Carlo: reflectance, transmittance, absorption, fluence, fluorescence.
    Mc(mc::Options) => mc::run,
    /// Fit parameters of a tissue to measured reflectance and fluorescence.
    Fit(fit::Options) => fit::run,
}
