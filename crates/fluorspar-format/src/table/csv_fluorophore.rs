//! Fluorophores as tables of excitation and emission.

use std::path::Path;

use super::csv_eem::stated_unit_of;
use super::csv_table::{Header, Negative};
use super::eem_layout::{Axis, names_spectrum, no_samples, no_such_sample, sample_of};
use super::instrument_text::names_wavelengths;
use super::spectra::{MeasuredSpectra, SpectrumColumns, SpectrumOptions, headers_of, read_spectra};
use super::value_unit::{StatedUnit, ValueUnit, stated_unit};
use crate::{Defect, FormatError};
use fluorspar::spectral::{Curve, YieldUnit};

/// Excitation and emission spectra of a fluorophore, as stored: neither normalized nor converted.
#[derive(Clone, Debug, PartialEq)]
pub struct CsvFluorophore {
    /// Excitation.
    pub excitation: Curve,
    /// Emission.
    pub emission: Curve,
    /// The excitation is the same everywhere: it was never measured and only the emission means anything.
    pub emission_only: bool,
    /// What the emission counts, where a comment `# unit: energy` or its header says so.
    pub stated: Option<YieldUnit>,
    /// What was taken of the file, and as what, in words.
    pub read_as: Vec<String>,
}

/// Reads a table with the columns `wavelength_nm`, `excitation` and `emission`, or as databases of dyes write them, `EGFP ex` and `EGFP em`; of
/// several dyes that which `sample` names. Empty cells are left out column by column, so that the two spectra may cover different
/// ranges.
///
/// # Errors
/// As [`read_spectra`]; [`Defect::Samples`] of several dyes of which none is named.
pub fn read_fluorophore_csv(
    path: &Path,
    negative: Negative,
    sample: Option<&str>,
) -> Result<CsvFluorophore, FormatError> {
    let (Header { line, cells }, comments) = headers_of(path)?;
    let names = columns(path, line, &cells, sample)?;
    let of_header = names.get(1).and_then(|name| match stated_unit(name) {
        StatedUnit::Known(ValueUnit::Energy) => Some(YieldUnit::Energy),
        StatedUnit::Known(ValueUnit::Photons | ValueUnit::Counts) => Some(YieldUnit::Photons),
        _ => None,
    });
    let options = SpectrumOptions {
        columns: SpectrumColumns::Named(names),
        negative,
        skip_empty_cells: true,
        ..SpectrumOptions::default()
    };
    let MeasuredSpectra { curves, read_as } = read_spectra(path, &options)?;
    let mut curves = curves.into_iter().map(|column| column.curve);
    let (Some(excitation), Some(emission)) = (curves.next(), curves.next()) else {
        return Err(FormatError::malformed(path, "columns are missing", "Give excitation and emission"));
    };
    let emission_only = is_constant(excitation.values());
    let stated = stated_unit_of(path, &comments)?.flatten().or(of_header);
    Ok(CsvFluorophore { excitation, emission, emission_only, stated, read_as })
}

/// Whether cells of a header name columns of excitation and of emission.
#[must_use]
pub fn names_excitation_and_emission(cells: &[&str]) -> bool {
    [Axis::Excitation, Axis::Emission].iter().all(|axis| cells.iter().any(|cell| names_spectrum(cell, *axis)))
}

/// Headers of the columns of excitation and emission.
fn columns(
    path: &Path,
    line: u64,
    headers: &[String],
    wanted: Option<&str>,
) -> Result<Vec<String>, FormatError> {
    let plain = ["excitation", "emission"];
    let is_plain = wanted.is_none() && plain.iter().all(|word| headers.iter().any(|header| header == word));
    let named = |axis: Axis| -> Vec<&String> {
        headers.iter().filter(|header| names_spectrum(header, axis)).collect()
    };
    let [mut excitation, mut emission] = [Axis::Excitation, Axis::Emission].map(named);
    let are_wavelengths = |of: &Vec<&String>| !of.is_empty() && of.iter().all(|name| names_wavelengths(name));
    if [&excitation, &emission].into_iter().all(are_wavelengths) {
        let what =
            "the columns are wavelengths of excitation and emission: single values in a list, no spectra";
        let hint =
            "Put values side by side, below a line \"em_nm\\ex_nm,350,360\" of excitation wavelengths in nm";
        return Err(FormatError::at_line(path, line, what, hint));
    }
    // Each spectrum may have wavelengths of its own
    for of_axis in [&mut excitation, &mut emission] {
        of_axis.retain(|name| !names_wavelengths(name));
    }
    let header_of = |name: &str, of_axis: &[&String]| -> Option<String> {
        of_axis.iter().find(|header| sample_of(header) == name).map(|header| header.to_string())
    };
    let both = |name: &str| Some(vec![header_of(name, &excitation)?, header_of(name, &emission)?]);
    let mut names: Vec<&str> = Vec::new();
    for name in excitation.iter().map(|header| sample_of(header)) {
        if both(name).is_some() && !names.contains(&name) {
            names.push(name);
        }
    }
    match (wanted, &names[..]) {
        // What is missing is told by its name
        _ if is_plain => Ok(plain.map(String::from).to_vec()),
        (None, []) => Ok(plain.map(String::from).to_vec()),
        (Some(_), [] | [""]) => Err(no_samples(path, line)),
        (Some(name), _) => both(name).ok_or_else(|| no_such_sample(path, line, name, &names)),
        (None, [only]) => Ok(both(only).unwrap_or_default()),
        (None, _) => Err(Defect::Samples(names.into_iter().map(String::from).collect()).at(path, line)),
    }
}

/// Whether all values are one and the same.
pub(crate) fn is_constant(values: &[f64]) -> bool {
    values.windows(2).all(|pair| pair[0] == pair[1])
}
