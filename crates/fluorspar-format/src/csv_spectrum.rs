//! Spectra as tables: wavelength in the first column, one spectrum in each other column.

use fluorspar::quote::excerpt;
use std::path::Path;

use super::FormatError;
use super::axis::check_axis;
use super::csv_table::{Negative, Table};
use fluorspar::spectral::Curve;

/// Which value columns to read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CsvColumns {
    /// All of them.
    #[default]
    All,
    /// Those with these headers, in this order.
    Named(Vec<String>),
    /// Those with these numbers, in this order; 1 is the first column after the wavelength.
    Numbered(Vec<usize>),
}

/// How to read a table of spectra. The default reads every column and refuses negative values and empty cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CsvSpectrumOptions {
    /// Which columns.
    pub columns: CsvColumns,
    /// Treatment of negative values.
    pub negative: Negative,
    /// Leave out samples whose cell is empty, column by column, instead of refusing them.
    pub skip_empty_cells: bool,
}

/// One column of a table of spectra.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCurve {
    /// Header of the column.
    pub name: String,
    /// The spectrum.
    pub curve: Curve,
}

/// Reads spectra from a CSV file. `#` begins a comment line.
///
/// The first line names the columns; the first column must say that it is a wavelength in nm: `wavelength_nm`,
/// `wavelength [nm]`, `wave_nm`, `nm` and the like.
///
/// # Errors
/// Anything that is not such a table, with file, line and column.
pub fn read_spectrum_csv(path: &Path, options: &CsvSpectrumOptions) -> Result<Vec<NamedCurve>, FormatError> {
    let table = Table::read(path)?;
    check_wavelength_header(path, &table)?;
    let columns = selected_columns(path, &table, &options.columns)?;
    let wavelength_nm = wavelengths(path, &table)?;
    columns.into_iter().map(|column| read_column(path, &table, &wavelength_nm, column, options)).collect()
}

fn wavelengths(path: &Path, table: &Table) -> Result<Vec<f64>, FormatError> {
    let mut wavelength_nm = Vec::with_capacity(table.row_count());
    for row in table.rows() {
        wavelength_nm.push(table.number(path, row, 0)?.ok_or_else(|| {
            FormatError::at_line(
                path,
                row.line,
                "the wavelength is empty",
                "Give every line a wavelength in nm",
            )
        })?);
    }
    check_axis(path, "the", &wavelength_nm, |index| Some(table.line_of(index))).map(|()| wavelength_nm)
}

fn read_column(
    path: &Path,
    table: &Table,
    wavelength_nm: &[f64],
    column: usize,
    options: &CsvSpectrumOptions,
) -> Result<NamedCurve, FormatError> {
    let (mut at, mut values) = (Vec::new(), Vec::new());
    for (row, &nm) in table.rows().zip(wavelength_nm) {
        match table.number(path, row, column)? {
            Some(value) => {
                at.push(nm);
                values.push(table.checked_sign(path, row, column, value, options.negative)?);
            }
            None if options.skip_empty_cells => {}
            None => {
                return Err(FormatError::at_line(
                    path,
                    row.line,
                    format!("column {} is empty at {nm} nm", table.column_name(column)),
                    "Fill the cell or remove the line",
                ));
            }
        }
    }
    let curve = Curve::new(at, values).map_err(|error| {
        FormatError::malformed(
            path,
            format!("column {} is not a valid spectrum: {error}", table.column_name(column)),
            "Check the column",
        )
    })?;
    Ok(NamedCurve { name: table.header.cells[column].clone(), curve })
}

fn selected_columns(path: &Path, table: &Table, columns: &CsvColumns) -> Result<Vec<usize>, FormatError> {
    let headers = &table.header.cells;
    if headers.len() < 2 {
        return Err(FormatError::at_line(
            path,
            table.header.line,
            "there is only a wavelength column",
            "Give at least one column of values; cells are separated by commas",
        ));
    }
    let available = || shortened_list(&headers[1..]);
    match columns {
        CsvColumns::All => Ok((1..headers.len()).collect()),
        CsvColumns::Named(names) => names
            .iter()
            .map(|name| {
                let mut found = (1..headers.len()).filter(|&column| headers[column] == *name);
                match (found.next(), found.next()) {
                    (Some(column), None) => Ok(column),
                    (Some(_), Some(_)) => Err(FormatError::at_line(
                        path,
                        table.header.line,
                        format!("two columns are called \"{}\"", excerpt(name)),
                        "Give each column its own name or choose the column by number",
                    )),
                    _ => Err(FormatError::at_line(
                        path,
                        table.header.line,
                        format!("there is no column \"{}\"", excerpt(name)),
                        format!("Columns are: {}", available()),
                    )),
                }
            })
            .collect(),
        CsvColumns::Numbered(numbers) => numbers
            .iter()
            .map(|&number| {
                if (1..headers.len()).contains(&number) {
                    return Ok(number);
                }
                Err(FormatError::at_line(
                    path,
                    table.header.line,
                    format!("there is no value column number {number}"),
                    format!("Columns are numbered from 1 after the wavelength: {}", available()),
                ))
            })
            .collect(),
    }
}

/// The first of some names, and how many more there are.
pub(super) fn shortened_list(names: &[String]) -> String {
    let mut list = names.iter().take(12).map(|name| excerpt(name)).collect::<Vec<_>>().join(", ");
    if names.len() > 12 {
        list.push_str(&format!(" and {} more", names.len() - 12));
    }
    list
}

fn check_wavelength_header(path: &Path, table: &Table) -> Result<(), FormatError> {
    let header = table.header.cells[0].as_str();
    let wrong =
        |what: String, hint: &str| Err(FormatError::at_line(path, table.header.line, what, hint.to_string()));
    if header.contains('\\') {
        return wrong(
            format!("the first cell is \"{}\": this is an excitation-emission matrix", excerpt(header)),
            "Read it as a matrix, or give a first column \"wavelength_nm\"",
        );
    }
    if header.parse::<f64>().is_ok() {
        return wrong(
            "the header line is missing: the file begins with numbers".into(),
            "Put a line such as \"wavelength_nm,transmittance\" above them",
        );
    }
    let lower = header.to_lowercase();
    let words: Vec<&str> =
        lower.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
    let has = |names: &[&str]| words.iter().any(|word| names.contains(word));
    let in_unit = |unit: &str, hint: &str| {
        wrong(format!("the first column \"{}\" is in {unit}", excerpt(header)), hint)
    };
    if has(&["nm", "nanometer", "nanometers", "nanometre", "nanometres"]) {
        Ok(())
    } else if has(&[
        "um",
        "µm",
        "μm",
        "micron",
        "microns",
        "micrometer",
        "micrometers",
        "micrometre",
        "micrometres",
    ]) {
        in_unit("micrometers", "Multiply it by 1000 and call it \"wavelength_nm\"")
    } else if has(&["m", "meter", "meters", "metre", "metres"]) {
        in_unit("meters", "Multiply it by 1e9 and call it \"wavelength_nm\"")
    } else if has(&["angstrom", "angstroms", "å", "aa"]) {
        in_unit("angstroms", "Divide it by 10 and call it \"wavelength_nm\"")
    } else if has(&["cm", "wavenumber", "ev"]) {
        in_unit("wavenumbers or energies", "Convert it to nanometers and call it \"wavelength_nm\"")
    } else if has(&["wavelength", "wavelengths", "wave", "lambda", "λ", "wl"]) {
        wrong(
            format!("the first column \"{}\" states no unit", excerpt(header)),
            "Call it \"wavelength_nm\" if it is in nanometers",
        )
    } else {
        wrong(
            format!("the first column is \"{}\", not a wavelength", excerpt(header)),
            "Put the wavelength first and call it \"wavelength_nm\"",
        )
    }
}
