//! Reads a measured fluorophore strictly and says what it holds.

use std::path::Path;

use fluorspar_format::{
    AntiStokes, CsvEemOptions, EemUnit, FormatError, Negative, read_eem_csv, read_fluorophore_csv,
    read_iset_fluorophore, read_start, refuse_scattered_light,
};

use super::{FileOptions, Unit};
use crate::error::CliError;

/// Largest share of the peak that a value below its excitation may have, as the reader of matrices has it.
const ANTI_STOKES_TOLERANCE: f64 = 1e-3;
/// Bytes of a file among which its header is looked for.
const HEADER_BYTES: u64 = 1 << 20;

/// Which reader a file needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Rows emission, columns excitation.
    MatrixCsv,
    /// Columns wavelength, excitation, emission.
    SpectraCsv,
    /// A MATLAB file of isetfluorescence.
    Mat,
}

/// Values over emission (rows) and excitation (columns), relative photons or energy.
struct Matrix {
    emission_nm: Vec<f64>,
    excitation_nm: Vec<f64>,
    values: Vec<f64>,
}

/// What a file holds.
pub(super) struct Measured {
    pub(super) kind: Kind,
    /// Name that the file gives itself.
    pub(super) name: Option<String>,
    pub(super) unit: Unit,
    /// Pairs of what and how much, for people.
    pub(super) findings: Vec<(String, String)>,
}

/// Reads a file with every check that the options leave on.
pub(super) fn read(path: &Path, options: &FileOptions) -> Result<Measured, CliError> {
    let read = match kind_of(path) {
        Kind::MatrixCsv => matrix_csv(path, options),
        Kind::SpectraCsv => spectra_csv(path, options),
        Kind::Mat => mat(path, options),
    };
    read.map_err(|error| match &error {
        CliError::Format(format) => match option_for(format, options) {
            Some(option) => CliError::Input(format!("{error} ({option})")),
            None => error,
        },
        _ => error,
    })
}

/// The option that lets a file pass.
fn option_for(error: &FormatError, options: &FileOptions) -> Option<&'static str> {
    match error {
        FormatError::Unit { .. } if options.yield_unit.is_none() => {
            Some("--yield-unit photons or --yield-unit energy")
        }
        FormatError::AntiStokes { .. } | FormatError::ScatteredLight { .. } => Some("--allow-anti-stokes"),
        FormatError::Negative { .. } => Some("--allow-negative"),
        FormatError::EmptyCell { .. } => Some("--empty-as-zero"),
        _ => None,
    }
}

/// By ending, or else by the cells of the header. A file that can't be opened is left to its reader to explain.
fn kind_of(path: &Path) -> Kind {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mat")) {
        return Kind::Mat;
    }
    let text = read_start(path, HEADER_BYTES).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let header = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'));
    let cells: Vec<String> = header
        .unwrap_or_default()
        .split([',', ';', '\t'])
        .map(|cell| cell.trim_matches(|c: char| c == '"' || c.is_whitespace()).to_lowercase())
        .collect();
    if cells.iter().any(|cell| matches!(cell.as_str(), "excitation" | "emission" | "wavelength_nm")) {
        Kind::SpectraCsv
    } else {
        Kind::MatrixCsv
    }
}

fn negative(options: &FileOptions) -> Negative {
    if options.allow_negative { Negative::ClipToZero } else { Negative::Refuse }
}

/// The unit of a matrix, which must be known.
fn stated_unit(path: &Path, unit: EemUnit) -> Result<Unit, CliError> {
    match unit {
        EemUnit::Photons => Ok(Unit::Photons),
        EemUnit::Energy => Ok(Unit::Energy),
        EemUnit::Unknown => Err(CliError::Input(format!(
            "{}: the file says that the unit of its values is unknown. Decide with --yield-unit photons or --yield-unit energy",
            path.display()
        ))),
    }
}

fn matrix_csv(path: &Path, options: &FileOptions) -> Result<Measured, CliError> {
    let given = options.yield_unit.map(|unit| match unit {
        Unit::Photons => EemUnit::Photons,
        Unit::Energy => EemUnit::Energy,
    });
    let read = read_eem_csv(
        path,
        &CsvEemOptions {
            unit: given,
            anti_stokes: if options.allow_anti_stokes {
                AntiStokes::Keep
            } else {
                AntiStokes::Refuse(ANTI_STOKES_TOLERANCE)
            },
            negative: negative(options),
            empty_as_zero: options.empty_as_zero,
        },
    )?;
    let unit = stated_unit(path, read.unit)?;
    let matrix =
        Matrix { emission_nm: read.emission_nm, excitation_nm: read.excitation_nm, values: read.values };
    let mut findings = vec![("content".into(), format!("excitation-emission matrix of {}", word(unit)))];
    describe(path, &matrix, &mut findings)?;
    findings.push(("empty cells".into(), empty_cells(read.empty_cells)));
    Ok(Measured { kind: Kind::MatrixCsv, name: None, unit, findings })
}

/// What was made of empty cells. Nothing is interpolated: what lies in a hole of a matrix is not known.
fn empty_cells(count: usize) -> String {
    match count {
        0 => "none".into(),
        count => format!(
            "{count}, taken as zero: no fluorescence there. Where it was only cut out with scattered light, fill them from their neighbors"
        ),
    }
}

fn spectra_csv(path: &Path, options: &FileOptions) -> Result<Measured, CliError> {
    let read = read_fluorophore_csv(path, negative(options))?;
    if read.emission_only {
        return Err(emission_only(path));
    }
    let unit = options.yield_unit.unwrap_or(Unit::Photons);
    let mut findings = vec![("content".into(), "excitation and emission spectra".to_string())];
    let range = |(first, last): (f64, f64)| format!("{first} to {last} nm");
    for (name, curve) in [("excitation", &read.excitation), ("emission", &read.emission)] {
        if curve.max() <= 0.0 {
            return Err(nothing(path));
        }
        let text = format!(
            "{}, {} samples, peak at {} nm",
            range(curve.range_nm()),
            curve.values().len(),
            curve.peak_nm()
        );
        findings.push((name.into(), text));
    }
    findings.push(("unit of emission".into(), taken_as(unit, options.yield_unit.is_some())));
    Ok(Measured { kind: Kind::SpectraCsv, name: None, unit, findings })
}

fn mat(path: &Path, options: &FileOptions) -> Result<Measured, CliError> {
    let read = read_iset_fluorophore(path)?;
    if read.emission_only {
        return Err(emission_only(path));
    }
    let refuse_negative = |what: &str, values: &[f64]| match values.iter().position(|value| *value < 0.0) {
        Some(index) if !options.allow_negative => Err(CliError::Input(format!(
            "{}: value {} of \"{what}\" is {}, below zero. Subtract the background correctly, or take negative values as \
             zero with --allow-negative",
            path.display(),
            index + 1,
            values[index]
        ))),
        _ => Ok(()),
    };
    let unit = options.yield_unit.unwrap_or(Unit::Photons);
    let name = Some(read.name).filter(|name| !name.is_empty());
    let mut findings = Vec::new();
    if let Some(values) = read.eem {
        refuse_negative("eem", &values)?;
        findings.push(("content".into(), format!("ISET fluorophore, matrix of {}", word(unit))));
        let values = values.into_iter().map(|value| value.max(0.0)).collect();
        let matrix = Matrix { emission_nm: read.wave_nm.clone(), excitation_nm: read.wave_nm, values };
        let percent = 100.0 * anti_stokes_share(&matrix);
        if percent > 50.0 && !options.allow_anti_stokes {
            return Err(FormatError::Transposed { path: path.into(), percent }.into());
        }
        if !options.allow_anti_stokes {
            refuse_scattered_light(path, &matrix.emission_nm, &matrix.excitation_nm, &matrix.values)?;
            refuse_anti_stokes(path, &matrix)?;
        }
        describe(path, &matrix, &mut findings)?;
    } else if let (Some(excitation), Some(emission)) = (read.excitation, read.emission) {
        findings.push(("content".into(), "ISET fluorophore, excitation and emission spectra".into()));
        for (what, values) in [("excitation", excitation), ("emission", emission)] {
            refuse_negative(what, &values)?;
            let best = (0..values.len()).fold(0, |best, i| if values[i] > values[best] { i } else { best });
            if values[best] <= 0.0 {
                return Err(nothing(path));
            }
            let (first, last) = (read.wave_nm[0], read.wave_nm[read.wave_nm.len() - 1]);
            let text =
                format!("{first} to {last} nm, {} samples, peak at {} nm", values.len(), read.wave_nm[best]);
            findings.push((what.into(), text));
        }
    } else {
        return Err(emission_only(path));
    }
    let by_convention = if options.yield_unit.is_some() {
        "as given"
    } else {
        "the convention of those files; --yield-unit changes it"
    };
    findings.push(("unit".into(), format!("{} ({by_convention})", word(unit))));
    Ok(Measured { kind: Kind::Mat, name, unit, findings })
}

fn word(unit: Unit) -> &'static str {
    match unit {
        Unit::Photons => "photons",
        Unit::Energy => "energy",
    }
}

fn taken_as(unit: Unit, given: bool) -> String {
    format!("{} ({})", word(unit), if given { "as given" } else { "assumed; --yield-unit energy changes it" })
}

fn emission_only(path: &Path) -> CliError {
    CliError::Input(format!(
        "{}: the excitation is missing or the same everywhere: it was never measured, and only the shape of the emission means \
         anything. Take a measured excitation from elsewhere and name both files in the experiment: excitation_csv, emission_csv",
        path.display()
    ))
}

fn nothing(path: &Path) -> CliError {
    CliError::Input(format!("{}: the fluorophore emits nothing: all its values are zero", path.display()))
}

/// Share of the sum of all values that lies below its excitation.
fn anti_stokes_share(matrix: &Matrix) -> f64 {
    let (mut below, mut total) = (0.0, 0.0);
    for (row, emission) in matrix.values.chunks_exact(matrix.excitation_nm.len()).zip(&matrix.emission_nm) {
        for (value, excitation) in row.iter().zip(&matrix.excitation_nm) {
            total += value;
            if emission < excitation {
                below += value;
            }
        }
    }
    if total > 0.0 { below / total } else { 0.0 }
}

fn refuse_anti_stokes(path: &Path, matrix: &Matrix) -> Result<(), FormatError> {
    let columns = matrix.excitation_nm.len();
    let peak = matrix.values.iter().copied().fold(0.0, f64::max);
    for (index, &value) in matrix.values.iter().enumerate() {
        let (emission_nm, excitation_nm) =
            (matrix.emission_nm[index / columns], matrix.excitation_nm[index % columns]);
        if emission_nm < excitation_nm && value > ANTI_STOKES_TOLERANCE * peak {
            return Err(FormatError::AntiStokes {
                path: path.into(),
                line: None,
                emission_nm,
                excitation_nm,
                value,
                percent_of_peak: 100.0 * value / peak,
            });
        }
    }
    Ok(())
}

/// Grid, peak and anti-Stokes share of a matrix.
fn describe(path: &Path, matrix: &Matrix, findings: &mut Vec<(String, String)>) -> Result<(), CliError> {
    for (name, axis) in [("excitation", &matrix.excitation_nm), ("emission", &matrix.emission_nm)] {
        let (Some(first), Some(last), true) = (axis.first(), axis.last(), axis.len() > 1) else {
            return Err(CliError::Input(format!(
                "{}: a matrix needs at least two {name} wavelengths; this one has {}",
                path.display(),
                axis.len()
            )));
        };
        findings.push((name.into(), format!("{first} to {last} nm, {} samples", axis.len())));
    }
    let columns = matrix.excitation_nm.len();
    let best = (0..matrix.values.len())
        .fold(0, |best, i| if matrix.values[i] > matrix.values[best] { i } else { best });
    if matrix.values[best] <= 0.0 {
        return Err(nothing(path));
    }
    let peak = [matrix.excitation_nm[best % columns], matrix.emission_nm[best / columns]];
    findings.push(("peak".into(), format!("excitation {} nm, emission {} nm", peak[0], peak[1])));
    let share = 100.0 * anti_stokes_share(matrix);
    findings.push(("anti-Stokes".into(), format!("{share:.3} % of the sum of all values")));
    Ok(())
}
