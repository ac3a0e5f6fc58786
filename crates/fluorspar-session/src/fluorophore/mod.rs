//! Fluorophores: measured ones read from files, and spectra fitted with them.

mod file_options;
mod fit;
mod fit_components;
mod fit_files;
mod loading;
mod measured;

pub use file_options::FileOptions;
pub use fit::{FitOptions, FittedMixture, fit};
pub use fit_files::FittedSpectra;
pub use loading::{
    LoadedFluorophore, checked, emission_peak_nm, everywhere_nm, from_file, load, peaks_nm, section_toml,
};
pub use measured::{Kind, Measured};
