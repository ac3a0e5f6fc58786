//! `fluorspar fluorophore`: import, fit.

mod fit;
mod import;
mod list;
mod plot;
mod show;

pub(crate) use list::run as list;
pub(crate) use plot::{Options as PlotOptions, run as plot};
pub(crate) use show::{Options as ShowOptions, run as show};

use fluorspar_session::fluorophore::{FitOptions, fit as fit_spectra};

use crate::commands::Answering;
use crate::commands::subcommands::subcommands;

subcommands! {
    /// Check a measured fluorophore and write its section of an experiment.
    Import(import::Options) => import::run,
    /// Fit measured spectra as sums of fluorophores: weights with intervals, and which sets describe them as well.
    Fit(Answering<FitOptions>) => |options| options.answer(fit_spectra, fit::describe),
}
