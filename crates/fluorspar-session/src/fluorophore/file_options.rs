//! How files of measured fluorophores are read.

use fluorspar::spectral::{Stokes, YieldUnit};
use fluorspar_format::{EmptyCells, ScatterCut};
use serde::Deserialize;

use crate::options::defaults;
use crate::values;

/// How a file is read.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default = "defaults")]
pub struct FileOptions {
    /// Which of several samples or dyes in one file.
    #[arg(long, value_name = "NAME")]
    pub sample: Option<String>,
    /// Unit of the values of a file that does not state it.
    #[arg(long, value_parser = values::choice::<YieldUnit>(&["photons", "energy"]))]
    pub yield_unit: Option<YieldUnit>,
    /// Photons out per photon that falls on it, absorbed or not, at the best excitation and concentration 1, of a file; a dye of quantum
    /// yield Q and absorbance A has Q (1 - 10^-A) [default: 0.001, assumed].
    #[arg(long, value_name = "Y", value_parser = values::number, allow_negative_numbers = true)]
    pub photon_yield: Option<f64>,
    /// Whether emission below the excitation wavelength of a file is masked or used unchanged.
    #[arg(long, value_parser = values::choice::<Stokes>(&["mask", "off"]), default_value = "mask")]
    pub stokes: Stokes,
    /// Take negative values of a file as zero instead of refusing them.
    #[arg(long)]
    pub allow_negative: bool,
    /// Accept values of a file at emission wavelengths below the excitation.
    #[arg(long)]
    pub allow_anti_stokes: bool,
    /// What becomes of empty cells of a matrix: refused, taken as zero, or interpolated along the emission between the nearest values (zero
    /// below the excitation and beyond the values).
    #[arg(long, value_parser = values::choice::<EmptyCells>(&["refuse", "zero", "interpolate"]), default_value = "refuse")]
    pub empty_cells: EmptyCells,
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
            (self.stokes != Stokes::Mask, "⟨stokes=off⟩"),
            (self.allow_negative, "⟨allow_negative⟩"),
            (self.allow_anti_stokes, "⟨allow_anti_stokes⟩"),
            (self.empty_cells != EmptyCells::Refuse, "⟨empty_cells⟩"),
        ]
        .into_iter()
        .find_map(|(given, option)| given.then_some(option))
    }
}
