//! `fluorspar fluorophore`: import, fit.

mod fit;
mod fit_components;
mod fit_output;
mod import;
mod list;
mod loading;
mod measured;
mod plot;
mod show;

pub(crate) use list::run as list;
pub(crate) use plot::{Options as PlotOptions, run as plot};
pub(crate) use show::{Options as ShowOptions, run as show};

use clap::ValueEnum;
use fluorspar_experiment::schema::EmptyCellsChoice;
use fluorspar_format::ScatterCut;

use crate::commands::actions::actions;
use crate::values;

actions! {
    /// Check a measured fluorophore and write its section of an experiment.
    Import(import::Options) => import::run,
    /// Fit measured spectra as sums of fluorophores: weights with intervals, and which sets describe them as well.
    Fit(fit::Options) => fit::run,
}

/// How a file is read.
#[derive(Clone, Debug, clap::Args)]
struct FileOptions {
    /// Which of several samples or dyes in one file.
    #[arg(long, value_name = "NAME")]
    sample: Option<String>,
    /// Unit of the values of a file that does not state it.
    #[arg(long, value_enum)]
    yield_unit: Option<Unit>,
    /// Photons out per photon that falls on it, absorbed or not, at the best excitation and concentration 1, of a file; a dye of quantum
    /// yield Q and absorbance A has Q (1 - 10^-A) [default: 0.001, assumed].
    #[arg(long, value_name = "Y", value_parser = values::number, allow_negative_numbers = true)]
    photon_yield: Option<f64>,
    /// Whether emission below the excitation wavelength of a file is masked or used unchanged.
    #[arg(long, value_enum, default_value = "mask")]
    stokes: StokesChoice,
    /// Take negative values of a file as zero instead of refusing them.
    #[arg(long)]
    allow_negative: bool,
    /// Accept values of a file at emission wavelengths below the excitation.
    #[arg(long)]
    allow_anti_stokes: bool,
    /// What becomes of empty cells of a matrix: refused, taken as zero, or interpolated along the emission between the nearest values (zero
    /// below the excitation and beyond the values).
    #[arg(long, value_enum, default_value = "refuse")]
    empty_cells: Empty,
    /// Set by `import`, which writes what it has cut.
    #[arg(skip)]
    cut: Option<ScatterCut>,
}

impl FileOptions {
    /// The first option that was given and is not as without it.
    fn first_given(&self) -> Option<&'static str> {
        [
            (self.sample.is_some(), "--sample"),
            (self.yield_unit.is_some(), "--yield-unit"),
            (self.photon_yield.is_some(), "--photon-yield"),
            (self.stokes != StokesChoice::Mask, "--stokes off"),
            (self.allow_negative, "--allow-negative"),
            (self.allow_anti_stokes, "--allow-anti-stokes"),
            (self.empty_cells != Empty::Refuse, "--empty-cells"),
        ]
        .into_iter()
        .find_map(|(given, option)| given.then_some(option))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Unit {
    Photons,
    Energy,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Empty {
    Refuse,
    Zero,
    Interpolate,
}

impl From<Empty> for EmptyCellsChoice {
    fn from(choice: Empty) -> Self {
        match choice {
            Empty::Refuse => Self::Refuse,
            Empty::Zero => Self::Zero,
            Empty::Interpolate => Self::Interpolate,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum StokesChoice {
    Mask,
    Off,
}
