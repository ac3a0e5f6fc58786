//! Spectra that options name: of the catalogue, or of CSV files.

use std::path::Path;

use fluorspar::spectral::Curve;
use fluorspar_experiment::preset;
use fluorspar_format::{CsvColumns, CsvSpectrumOptions, Negative, read_spectrum_csv};

use crate::error::CliError;

/// Whether a name is that of a file.
pub(crate) fn is_file(name: &str) -> bool {
    name.contains(['/', '\\']) || name.to_ascii_lowercase().ends_with(".csv")
}

/// Name of a spectrum for people.
pub(crate) fn label(name: &str) -> String {
    Path::new(name).file_stem().map_or_else(|| name.into(), |s| s.to_string_lossy().into_owned())
}

/// The first spectrum of a file.
pub(crate) fn first_column(name: &str, negative: Negative) -> Result<Curve, CliError> {
    let columns = CsvColumns::Numbered(vec![1]);
    let options = CsvSpectrumOptions { columns, negative, ..CsvSpectrumOptions::default() };
    let column = read_spectrum_csv(Path::new(name), &options)?.into_iter().next();
    column.map(|column| column.curve).ok_or_else(|| CliError::Input(format!("{name}: there is no spectrum")))
}

/// Spectral power of a light, of any scale.
pub(crate) fn light(name: &str) -> Result<Curve, CliError> {
    if !is_file(name) {
        return Ok(preset::light_spectrum(name)?.curve());
    }
    let curve = first_column(name, Negative::Refuse)?;
    if curve.total() > 0.0 {
        return Ok(curve);
    }
    Err(CliError::Input(format!("{name}: the light is dark: all its values are zero")))
}

/// Transmittance of filters one behind the other.
pub(crate) fn filters(names: &[String]) -> Result<Curve, CliError> {
    names.iter().try_fold(Curve::constant(1.0), |product, name| {
        let curve =
            if is_file(name) { first_column(name, Negative::Refuse)? } else { preset::filter(name)?.curve() };
        if curve.max() > 1.0 {
            return Err(CliError::Input(format!(
                "{name}: a filter passes at most 1, but this reaches {}; are the values in percent?",
                curve.max()
            )));
        }
        Ok(product.times(&curve))
    })
}
