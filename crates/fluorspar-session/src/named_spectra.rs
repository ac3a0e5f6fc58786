//! Spectra that options name: of the catalogue, of files, or of one column of a file as an experiment writes it.

use std::path::{Path, PathBuf};

use fluorspar::spectral::Curve;
use fluorspar_experiment::preset;
use fluorspar_experiment::schema::{NameOrTable, SpectrumReference};
use fluorspar_format::{
    MeasuredSpectra, Negative, SpectrumColumns, SpectrumOptions, SpectrumQuantity, read_spectra, read_toml,
};
use serde::Deserialize;

use crate::{Error, Job, Result};

/// Whether a name is that of a file, or a table `{ csv = "FILE", column = .., unit = .. }` that names one.
pub fn is_file(name: &str) -> bool {
    is_table(name) || NameOrTable::is_path(name)
}

fn is_table(name: &str) -> bool {
    name.trim_start().starts_with('{')
}

/// Name of a spectrum for people.
pub fn label(name: &str) -> String {
    let file = match is_table(name) {
        true => table(name, SpectrumColumns::One).map(|table| table.path).unwrap_or_default(),
        false => name.into(),
    };
    Path::new(&file).file_stem().map_or_else(|| name.into(), |s| s.to_string_lossy().into_owned())
}

/// One column of a file.
struct Table {
    path: PathBuf,
    options: SpectrumOptions,
    scale: f64,
}

/// The table that an option writes as an experiment does, with these columns where it names none.
fn table(name: &str, columns: SpectrumColumns) -> Result<Table> {
    #[derive(Deserialize)]
    struct Written {
        spectrum: SpectrumReference,
    }
    let wrong = |what: String| {
        Error::Input(format!(
            "{name}: {what}. Write it like {{ csv = \"FILE\", column = \"T\", unit = \"percent\" }}, with the header of the column"
        ))
    };
    let written: Written = read_toml(&format!("spectrum = {name}")).map_err(|error| {
        // What serde says of a table that none of several kinds has
        wrong(match error.message() {
            message if message.contains("untagged enum") => "a key or a value is wrong".into(),
            message => message.to_string(),
        })
    })?;
    let (path, column, scale, unit) = match written.spectrum {
        SpectrumReference::Table(table) => (table.csv, table.column, table.scale, table.unit),
        SpectrumReference::Matlab(table) => {
            (table.mat, table.column.map(|number| number.to_string()), table.scale, None)
        }
        _ => return Err(wrong("this names no file".into())),
    };
    let columns = column.map_or(columns, |column| SpectrumColumns::Named(vec![column]));
    let options = SpectrumOptions { columns, unit: unit.map(Into::into), ..SpectrumOptions::default() };
    let path: &Path = path.as_ref();
    Ok(Table { path: path.into(), options, scale: scale.unwrap_or(1.0) })
}

/// A table that an option writes, with the path of its file from the root, as TOML; `None` of other texts, and of tables that hold an
/// equation.
pub fn absolute_table(name: &str) -> Option<String> {
    if !is_table(name) {
        return None;
    }
    let mut written: toml::Table = read_toml(&format!("spectrum = {name}")).ok()?;
    let table = written.get_mut("spectrum")?.as_table_mut()?;
    for key in ["csv", "mat"] {
        if let Some(path) = table.get(key).and_then(|path| std::path::absolute(path.as_str()?).ok()) {
            table.insert(key.into(), path.to_string_lossy().into_owned().into());
        }
    }
    Some(toml::Value::Table(table.clone()).to_string())
}

/// Spectra of a file as a quantity; what was taken of it is told.
pub fn of_file(
    name: &str,
    columns: SpectrumColumns,
    quantity: SpectrumQuantity,
    negative: Negative,
    job: &Job,
) -> Result<MeasuredSpectra> {
    let Table { path, options, scale } = match is_table(name) {
        true => table(name, columns)?,
        false => {
            let options = SpectrumOptions { columns, ..SpectrumOptions::default() };
            Table { path: name.into(), options, scale: 1.0 }
        }
    };
    // Who gives a factor speaks of the values as they are stored
    let is_stored = scale != 1.0 && options.unit.is_none();
    let quantity = if is_stored { SpectrumQuantity::Stored } else { quantity };
    let mut spectra = read_spectra(&path, &SpectrumOptions { quantity, negative, ..options })?;
    if scale != 1.0 {
        for column in &mut spectra.curves {
            column.curve = column.curve.scaled(scale);
        }
    }
    if !spectra.read_as.is_empty() {
        job.status(format!("{}: read as {}", path.display(), spectra.read_as.join("; ")));
    }
    Ok(spectra)
}

/// One spectrum of a file: the only column, that which an instrument computed, or the first.
pub fn one_column(name: &str, quantity: SpectrumQuantity, negative: Negative, job: &Job) -> Result<Curve> {
    let column = of_file(name, SpectrumColumns::One, quantity, negative, job)?.curves.into_iter().next();
    column.map(|column| column.curve).ok_or_else(|| Error::Input(format!("{name}: there is no spectrum")))
}

/// Spectral power of a light, of any scale.
pub fn light(name: &str, job: &Job) -> Result<Curve> {
    if !is_file(name) {
        return Ok(preset::light_spectrum(name)?.curve());
    }
    let curve = one_column(name, SpectrumQuantity::SpectralPower, Negative::Refuse, job)?;
    if curve.total() > 0.0 {
        return Ok(curve);
    }
    Err(Error::Input(format!("{name}: the light is dark: all its values are zero")))
}

/// Quantum efficiencies of the channels of a sensor, by their names: of a file each column is one.
pub fn quantum_efficiency(name: &str, job: &Job) -> Result<Vec<(String, Curve)>> {
    if !is_file(name) {
        return Ok(preset::quantum_efficiency(name)?.channels()?);
    }
    let quantity = SpectrumQuantity::QuantumEfficiency;
    let spectra = of_file(name, SpectrumColumns::All, quantity, Negative::ClipToZero, job)?;
    Ok(spectra.curves.into_iter().map(|column| (column.name, column.curve)).collect())
}

/// Transmittance of filters one behind the other.
pub fn filters(names: &[String], job: &Job) -> Result<Curve> {
    names.iter().try_fold(Curve::constant(1.0), |product, name| {
        let curve = if is_file(name) {
            one_column(name, SpectrumQuantity::Transmittance, Negative::Refuse, job)?
        } else {
            preset::filter(name)?.curve()
        };
        if curve.max() > 1.0 {
            return Err(Error::Input(format!(
                "{name}: a filter passes at most 1, but this reaches {}; name the unit of its values: {{ csv = \"FILE\", unit = \"percent\" }}",
                curve.max()
            )));
        }
        Ok(product.times(&curve))
    })
}
