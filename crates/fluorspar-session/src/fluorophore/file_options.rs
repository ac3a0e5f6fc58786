//! How files of measured fluorophores are read.

use clap::ValueEnum;
use fluorspar_experiment::schema::EmptyCellsChoice;
use fluorspar_format::ScatterCut;
use serde::Deserialize;

use crate::options::defaults;
use crate::values;

/// How a file is read.
#[derive(Clone, Debug, Deserialize, clap::Args)]
#[serde(default = "defaults")]
pub struct FileOptions {
    /// Which of several samples or dyes in one file.
    #[arg(long, value_name = "NAME")]
    pub sample: Option<String>,
    /// Unit of the values of a file that does not state it.
    #[arg(long, value_enum)]
    pub yield_unit: Option<Unit>,
    /// Photons out per photon that falls on it, absorbed or not, at the best excitation and concentration 1, of a file; a dye of quantum
    /// yield Q and absorbance A has Q (1 - 10^-A) [default: 0.001, assumed].
    #[arg(long, value_name = "Y", value_parser = values::number, allow_negative_numbers = true)]
    pub photon_yield: Option<f64>,
    /// Whether emission below the excitation wavelength of a file is masked or used unchanged.
    #[arg(long, value_enum, default_value = "mask")]
    pub stokes: StokesChoice,
    /// Take negative values of a file as zero instead of refusing them.
    #[arg(long)]
    pub allow_negative: bool,
    /// Accept values of a file at emission wavelengths below the excitation.
    #[arg(long)]
    pub allow_anti_stokes: bool,
    /// What becomes of empty cells of a matrix: refused, taken as zero, or interpolated along the emission between the nearest values (zero
    /// below the excitation and beyond the values).
    #[arg(long, value_enum, default_value = "refuse")]
    pub empty_cells: Empty,
    /// Set by `import`, which writes what it has cut.
    #[arg(skip)]
    #[serde(skip)]
    pub cut: Option<ScatterCut>,
}

impl FileOptions {
    /// The first option that was given and is not as without it.
    pub(super) fn first_given(&self) -> Option<&'static str> {
        [
            (self.sample.is_some(), "⟨sample⟩"),
            (self.yield_unit.is_some(), "⟨yield_unit⟩"),
            (self.photon_yield.is_some(), "⟨photon_yield⟩"),
            (self.stokes != StokesChoice::Mask, "⟨stokes=off⟩"),
            (self.allow_negative, "⟨allow_negative⟩"),
            (self.allow_anti_stokes, "⟨allow_anti_stokes⟩"),
            (self.empty_cells != Empty::Refuse, "⟨empty_cells⟩"),
        ]
        .into_iter()
        .find_map(|(given, option)| given.then_some(option))
    }
}

/// What values count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// Photons.
    Photons,
    /// Energy.
    Energy,
}

/// What becomes of empty cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Empty {
    /// They are refused.
    Refuse,
    /// They are zero.
    Zero,
    /// They lie between their neighbors.
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

/// Whether emission below the excitation is masked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum StokesChoice {
    /// It is.
    Mask,
    /// It is used unchanged.
    Off,
}
