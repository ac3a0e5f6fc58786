//! Fluorophores as tables of excitation and emission.

use std::path::Path;

use super::FormatError;
use super::csv_table::Negative;
use super::spectra::{SpectrumColumns, SpectrumOptions, read_spectra};
use fluorspar::spectral::Curve;

/// Excitation and emission spectra of a fluorophore, as stored: neither normalized nor converted.
#[derive(Clone, Debug, PartialEq)]
pub struct CsvFluorophore {
    /// Excitation.
    pub excitation: Curve,
    /// Emission.
    pub emission: Curve,
    /// The excitation is the same everywhere: it was never measured and only the emission means anything.
    pub emission_only: bool,
}

/// Reads a table with the columns `wavelength_nm`, `excitation` and `emission`. Empty cells are left out column by
/// column, so that the two spectra may cover different ranges.
///
/// # Errors
/// As [`read_spectra`].
pub fn read_fluorophore_csv(path: &Path, negative: Negative) -> Result<CsvFluorophore, FormatError> {
    let options = SpectrumOptions {
        columns: SpectrumColumns::Named(vec!["excitation".into(), "emission".into()]),
        negative,
        skip_empty_cells: true,
        ..SpectrumOptions::default()
    };
    let mut curves = read_spectra(path, &options)?.curves.into_iter().map(|column| column.curve);
    let (Some(excitation), Some(emission)) = (curves.next(), curves.next()) else {
        return Err(FormatError::malformed(path, "columns are missing", "Give excitation and emission"));
    };
    let emission_only = is_constant(excitation.values());
    Ok(CsvFluorophore { excitation, emission, emission_only })
}

/// Whether all values are one and the same.
pub(super) fn is_constant(values: &[f64]) -> bool {
    values.windows(2).all(|pair| pair[0] == pair[1])
}
