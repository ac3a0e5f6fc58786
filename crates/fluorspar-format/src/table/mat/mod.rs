//! MATLAB files of the ISET toolboxes: fluorophores and spectra, formats 5, 7 and 7.3.

mod v5;
#[cfg(test)]
mod v5_tests;
mod v73;
pub(crate) mod write;

use std::path::Path;

use crate::FormatError;
use crate::error::shortened_list;
use crate::store::file::{guarded, read_file};
use crate::table::axis::check_axis;
use crate::table::csv_fluorophore::is_constant;
use fluorspar::spectral::Curve;

/// How much a file may hold.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MatLimits {
    /// Bytes of the file.
    bytes: u64,
    /// Numbers in all variables.
    values: u64,
}

impl MatLimits {
    /// Fluorophores and spectra, which take kilobytes: a matrix of 4096 x 4096.
    const SPECTRA: Self = Self { bytes: 16 << 20, values: 1 << 24 };
    /// Spectral images.
    pub(crate) const IMAGES: Self = Self { bytes: 1 << 30, values: 1 << 27 };

    /// Bytes that all compressed variables may take together.
    fn inflated(self) -> usize {
        4 * self.values as usize
    }
}

/// A variable or field, as far as it matters here.
#[derive(Debug)]
pub(crate) enum MatValue {
    /// Real numbers, first dimension fastest.
    Numbers {
        dims: Vec<usize>,
        values: Vec<f64>,
    },
    Text(String),
    Struct(Fields),
    /// What is not read, in words: "a sparse matrix".
    Other(&'static str),
}

impl MatValue {
    pub(crate) fn in_words(&self) -> &'static str {
        match self {
            Self::Numbers { .. } => "an array of numbers",
            Self::Text(_) => "a text",
            Self::Struct(_) => "a struct",
            Self::Other(what) => what,
        }
    }
}

/// Variables or fields by name, in file order.
pub(crate) type Fields = Vec<(String, MatValue)>;

/// A fluorophore of the ISET toolboxes, as stored: neither normalized nor converted. Their convention is quanta.
#[derive(Clone, Debug, PartialEq)]
pub struct IsetFluorophore {
    /// Name; empty where the file gives none.
    pub name: String,
    /// Solvent; empty where the file gives none.
    pub solvent: String,
    /// Wavelengths of all spectra and of both sides of the matrix, nm.
    pub wave_nm: Vec<f64>,
    /// Excitation, one value per wavelength.
    pub excitation: Option<Vec<f64>>,
    /// Emission, one value per wavelength.
    pub emission: Option<Vec<f64>>,
    /// Excitation-emission matrix, `[emission][excitation]`.
    pub eem: Option<Vec<f64>>,
    /// Quantum efficiency as stored; the toolbox itself ignores it.
    pub qe: Option<f64>,
    /// Comment of the author.
    pub comment: String,
    /// The excitation is missing or the same everywhere and there is no matrix: only the emission means anything.
    pub emission_only: bool,
}

/// Spectra of a MATLAB file with `wavelength` (or `wave`) and `data`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MatSpectra {
    /// One per column of `data`.
    pub curves: Vec<Curve>,
}

/// Reads a fluorophore: variables (or one struct with fields) `name`, `solvent`, `wave` or `spectrum.wave`,
/// `excitation`, `emission`, `eem` or `donaldsonMatrix`, `qe`, `comment`.
///
/// # Errors
/// Not a MATLAB file, a version 4 file, damage, missing or ill-shaped fields, more than 16 MiB or 2^24 numbers.
pub fn read_iset_fluorophore(path: &Path) -> Result<IsetFluorophore, FormatError> {
    let variables = read_variables(path, MatLimits::SPECTRA)?;
    let fields = holder(path, variables, &["emission", "excitation", "eem", "donaldsonMatrix"])?;
    let wave_nm = wavelengths(path, &fields)?;
    let excitation = spectrum(path, &fields, "excitation", wave_nm.len())?;
    let emission = spectrum(path, &fields, "emission", wave_nm.len())?;
    let eem = match matrix(path, &fields, "eem", wave_nm.len())? {
        None => matrix(path, &fields, "donaldsonMatrix", wave_nm.len())?,
        eem => eem,
    };
    if emission.is_none() && eem.is_none() {
        return Err(FormatError::malformed(
            path,
            "there is neither an emission spectrum nor a matrix",
            "Save the variable \"emission\" or \"eem\"",
        ));
    }
    let qe = match find(&fields, "qe") {
        Some(MatValue::Numbers { values, .. }) => values.first().copied().filter(|qe| qe.is_finite()),
        _ => None,
    };
    let emission_only = eem.is_none() && excitation.as_ref().is_none_or(|values| is_constant(values));
    Ok(IsetFluorophore {
        name: text(&fields, "name"),
        solvent: text(&fields, "solvent"),
        wave_nm,
        excitation,
        emission,
        eem,
        qe,
        comment: text(&fields, "comment"),
        emission_only,
    })
}

/// Reads spectra: variables `wavelength` or `wave`, and `data` (a column per spectrum).
///
/// # Errors
/// As [`read_iset_fluorophore`].
pub(crate) fn read_mat_spectra(path: &Path) -> Result<MatSpectra, FormatError> {
    let fields = holder(path, read_variables(path, MatLimits::SPECTRA)?, &["data"])?;
    let wave_nm = wavelengths(path, &fields)?;
    let (dims, values) = match find(&fields, "data") {
        Some(MatValue::Numbers { dims, values }) => (dims, values),
        other => {
            let what = other.map_or("no array", MatValue::in_words);
            return Err(FormatError::unsupported(
                path,
                format!("\"data\" is {what}"),
                "Save spectra as a full array of real numbers",
            ));
        }
    };
    let samples = wave_nm.len();
    let [rows, columns] = dims[..] else { return Err(ill_shaped(path, "data", dims, samples)) };
    let columns_of: Vec<Vec<f64>> = if rows == samples {
        values.chunks_exact(samples.max(1)).map(<[f64]>::to_vec).collect()
    } else if columns == samples {
        (0..rows).map(|row| values.iter().skip(row).step_by(rows).copied().collect()).collect()
    } else {
        return Err(ill_shaped(path, "data", dims, samples));
    };
    let mut curves = Vec::with_capacity(columns_of.len());
    for (column, values) in columns_of.into_iter().enumerate() {
        curves.push(Curve::new(wave_nm.clone(), values).map_err(|error| {
            FormatError::malformed(
                path,
                format!("column {} of \"data\": {error}", column + 1),
                "Fix the data",
            )
        })?);
    }
    Ok(MatSpectra { curves })
}

/// All variables of a file.
pub(crate) fn read_variables(path: &Path, limits: MatLimits) -> Result<Fields, FormatError> {
    let bytes = read_file(path, limits.bytes)?;
    if bytes.starts_with(b"MATLAB 5.0 MAT-file") {
        v5::read(path, &bytes, limits)
    } else if bytes.starts_with(b"MATLAB 7.3 MAT-file") || bytes.starts_with(b"\x89HDF\r\n\x1a\n") {
        guarded(path, "MATLAB 7.3", || v73::read(path, bytes, limits))
    } else if is_version_4(&bytes) {
        Err(FormatError::unsupported(
            path,
            "this is a MATLAB version 4 file",
            "Load it in MATLAB and save it with save(..., '-v7')",
        ))
    } else {
        Err(FormatError::malformed(
            path,
            "this is not a MATLAB file",
            "Save it in MATLAB with save(..., '-v7'), or in Python with scipy.io.savemat",
        ))
    }
}

/// A version 4 file begins with a type number below 5000 whose digits are small, two sizes and a flag 0 or 1.
fn is_version_4(bytes: &[u8]) -> bool {
    let word = |index: usize| {
        let b = bytes.get(4 * index..4 * index + 4)?;
        Some([b[0], b[1], b[2], b[3]])
    };
    let (Some(kind), Some(imaginary)) = (word(0), word(3)) else { return false };
    [
        (u32::from_le_bytes(kind), u32::from_le_bytes(imaginary)),
        (u32::from_be_bytes(kind), u32::from_be_bytes(imaginary)),
    ]
    .iter()
    .any(|&(kind, imaginary)| kind < 5000 && kind / 10 % 10 <= 5 && kind % 10 <= 2 && imaginary <= 1)
}

pub(crate) fn find<'a>(fields: &'a Fields, name: &str) -> Option<&'a MatValue> {
    fields.iter().find(|(field, _)| field == name).map(|(_, value)| value)
}

/// The variables themselves where one of them has a wanted name, else the fields of a struct that has one.
pub(crate) fn holder(path: &Path, variables: Fields, wanted: &[&str]) -> Result<Fields, FormatError> {
    let has = |fields: &Fields| wanted.iter().any(|name| find(fields, name).is_some());
    if has(&variables) {
        return Ok(variables);
    }
    let names: Vec<String> = variables.iter().map(|(name, _)| name.clone()).collect();
    for (_, value) in variables {
        if let MatValue::Struct(fields) = value
            && has(&fields)
        {
            return Ok(fields);
        }
    }
    Err(FormatError::malformed(
        path,
        format!("there is no variable or field \"{}\"", wanted[0]),
        format!(
            "The file holds: {}",
            if names.is_empty() { "nothing".into() } else { shortened_list(&names) }
        ),
    ))
}

pub(crate) fn text(fields: &Fields, name: &str) -> String {
    match find(fields, name) {
        Some(MatValue::Text(text)) => text.trim().to_string(),
        _ => String::new(),
    }
}

pub(crate) fn wavelengths(path: &Path, fields: &Fields) -> Result<Vec<f64>, FormatError> {
    let in_spectrum = match find(fields, "spectrum") {
        Some(MatValue::Struct(spectrum)) => find(spectrum, "wave"),
        _ => None,
    };
    let found = find(fields, "wave").or(in_spectrum).or_else(|| find(fields, "wavelength"));
    let Some(MatValue::Numbers { dims, values }) = found else {
        return Err(FormatError::malformed(
            path,
            "there are no wavelengths",
            "Save a vector \"wave\" (or \"spectrum.wave\" or \"wavelength\") in nm",
        ));
    };
    if values.len() < 2 || dims.iter().filter(|&&n| n > 1).count() > 1 {
        return Err(FormatError::malformed(
            path,
            format!("the wavelengths are an array of size {}", size(dims)),
            "Give a vector of at least two wavelengths in nm",
        ));
    }
    check_axis(path, "the", values, |_| None)?;
    Ok(values.clone())
}

/// A vector with one finite number per wavelength; `None` where the field is missing or empty.
fn spectrum(
    path: &Path,
    fields: &Fields,
    name: &str,
    samples: usize,
) -> Result<Option<Vec<f64>>, FormatError> {
    array(path, fields, name, samples, samples)
}

/// A square matrix, transposed from columns to rows.
fn matrix(path: &Path, fields: &Fields, name: &str, samples: usize) -> Result<Option<Vec<f64>>, FormatError> {
    let Some(by_column) = array(path, fields, name, samples, samples * samples)? else { return Ok(None) };
    let mut by_row = Vec::with_capacity(by_column.len());
    for row in 0..samples {
        by_row.extend(by_column.iter().skip(row).step_by(samples));
    }
    Ok(Some(by_row))
}

fn array(
    path: &Path,
    fields: &Fields,
    name: &str,
    samples: usize,
    expected: usize,
) -> Result<Option<Vec<f64>>, FormatError> {
    let (dims, values) = match find(fields, name) {
        Some(MatValue::Numbers { dims, values }) => (dims, values),
        Some(MatValue::Other(what)) => {
            return Err(FormatError::unsupported(
                path,
                format!("\"{name}\" is {what}"),
                "Save it as a full array of real numbers",
            ));
        }
        _ => return Ok(None),
    };
    if values.is_empty() {
        return Ok(None);
    }
    let square = expected != samples;
    if values.len() != expected || (square && dims[..] != [samples, samples]) {
        return Err(ill_shaped(path, name, dims, samples));
    }
    if let Some(index) = values.iter().position(|value| !value.is_finite()) {
        return Err(FormatError::malformed(
            path,
            format!("value {} of \"{name}\" is {}", index + 1, values[index]),
            "Every value must be a finite number: write 0 where nothing was measured",
        ));
    }
    Ok(Some(values.clone()))
}

fn ill_shaped(path: &Path, name: &str, dims: &[usize], samples: usize) -> FormatError {
    FormatError::malformed(
        path,
        format!("\"{name}\" has the size {} for {samples} wavelengths", size(dims)),
        "Resample it to the wavelengths of the file",
    )
}

pub(crate) fn size(dims: &[usize]) -> String {
    dims.iter().map(usize::to_string).collect::<Vec<_>>().join(" x ")
}
