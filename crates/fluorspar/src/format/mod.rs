//! Files: spectra and matrices in, images and meshes in and out. Every reader explains what is wrong and how to
//! mend it, and survives any bytes; every writer leaves a complete file or none.

mod axis;
mod csv_eem;
mod csv_fluorophore;
mod csv_spectrum;
mod csv_table;
mod error;
mod file;
mod provenance;

pub use csv_eem::{AntiStokes, CsvEemOptions, EemTable, EemUnit, read_eem_csv};
pub use csv_fluorophore::{CsvFluorophore, read_fluorophore_csv};
pub use csv_spectrum::{CsvColumns, CsvSpectrumOptions, NamedCurve, read_spectrum_csv};
pub use csv_table::Negative;
pub use error::FormatError;
pub use file::write_atomically;
pub use provenance::{Loaded, Provenance};
