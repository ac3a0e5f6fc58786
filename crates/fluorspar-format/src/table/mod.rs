//! Tables of numbers: spectra, fluorophores, excitation-emission matrices.

pub(crate) mod axis;
pub(crate) mod cgats;
pub(crate) mod csv_cell;
pub(crate) mod csv_eem;
pub(crate) mod csv_fluorophore;
pub(crate) mod csv_table;
pub(crate) mod eem_layout;
pub(crate) mod eem_scatter;
pub(crate) mod instrument_text;
pub(crate) mod jcamp;
pub(crate) mod mat;
pub(crate) mod parquet;
pub(crate) mod spectra;
pub(crate) mod spectrometer;
pub(crate) mod tm27;
pub(crate) mod value_unit;
