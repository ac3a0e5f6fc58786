//! Excitation-emission matrices as tables.

use std::fmt::Write;
use std::path::Path;

use fluorspar::quote::excerpt;

use super::FormatError;
use super::axis::check_axis;
use super::csv_table::{Negative, Table};

/// Unit of the values of an excitation-emission matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EemUnit {
    /// Photons out per photon in.
    Photons,
    /// Energy out per energy in.
    Energy,
    /// The source does not say. Whoever uses the matrix has to decide.
    Unknown,
}

/// An excitation-emission matrix as stored in a file: neither normalized nor converted.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredEem {
    /// Emission wavelength of each row, nm.
    pub emission_nm: Vec<f64>,
    /// Excitation wavelength of each column, nm.
    pub excitation_nm: Vec<f64>,
    /// Values, `[emission][excitation]`.
    pub values: Vec<f64>,
    /// Unit of the values.
    pub unit: EemUnit,
    /// Empty cells, which were taken as zero.
    pub empty_cells: usize,
}

/// Treatment of values at emission wavelengths below the excitation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AntiStokes {
    /// An error when one exceeds this fraction of the largest value.
    Refuse(f64),
    /// Taken as they are.
    Keep,
    /// Replaced by zero.
    SetToZero,
}

/// How to read a matrix. The default refuses anti-Stokes values above 0.1 % of the peak, negative values and empty
/// cells, and takes the unit from the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CsvEemOptions {
    /// Unit of the values of a file that does not state it.
    pub unit: Option<EemUnit>,
    /// Treatment of values at emission wavelengths below the excitation.
    pub anti_stokes: AntiStokes,
    /// Treatment of negative values.
    pub negative: Negative,
    /// Take empty cells as zero instead of refusing them.
    pub empty_as_zero: bool,
}

impl Default for CsvEemOptions {
    fn default() -> Self {
        Self {
            unit: None,
            anti_stokes: AntiStokes::Refuse(1e-3),
            negative: Negative::Refuse,
            empty_as_zero: false,
        }
    }
}

const CORNER: &str = "em_nm\\ex_nm";

/// A matrix as a table in the form that [`read_eem_csv`] reads, without comments: `values` are `[emission][excitation]`.
pub fn eem_csv(excitation_nm: &[f64], emission_nm: &[f64], values: &[f64]) -> String {
    let mut text = String::from(CORNER);
    let push_cells = |text: &mut String, cells: &[f64]| {
        cells.iter().for_each(|cell| _ = write!(text, ",{cell}"));
        text.push('\n');
    };
    push_cells(&mut text, excitation_nm);
    for (nm, row) in emission_nm.iter().zip(values.chunks(excitation_nm.len().max(1))) {
        _ = write!(text, "{nm}");
        push_cells(&mut text, row);
    }
    text
}

/// Reads a matrix: first line excitation wavelengths, first column emission wavelengths, both in nm, corner cell
/// `em_nm\ex_nm`. The unit comes from a comment `# unit: photons` (or `energy`, `unknown`) or from the options.
///
/// # Errors
/// Anything that is not such a table, with file and line.
pub fn read_eem_csv(path: &Path, options: &CsvEemOptions) -> Result<MeasuredEem, FormatError> {
    let table = Table::read(path)?;
    check_corner(path, &table)?;
    let unit = unit(path, &table, options.unit)?;
    let header_line = table.header.line;

    let mut excitation_nm = Vec::with_capacity(table.header.cells.len());
    for column in 1..table.header.cells.len() {
        let wavelength = table.number_in_header(path, column)?.ok_or_else(|| {
            FormatError::at_line(
                path,
                header_line,
                format!("excitation wavelength {column} is empty"),
                "Give every column its excitation wavelength in nm",
            )
        })?;
        excitation_nm.push(wavelength);
    }
    let mut emission_nm = Vec::with_capacity(table.row_count());
    for row in table.rows() {
        let wavelength = table.number(path, row, 0)?.ok_or_else(|| {
            FormatError::at_line(path, row.line, "the emission wavelength is empty", "Give it in nm")
        })?;
        emission_nm.push(wavelength);
    }
    check_axis(path, "the excitation", &excitation_nm, |_| Some(header_line))?;
    check_axis(path, "the emission", &emission_nm, |index| Some(table.line_of(index)))?;
    if excitation_nm.is_empty() {
        return Err(FormatError::at_line(
            path,
            header_line,
            "there is no excitation wavelength",
            format!("Put them on the first line after \"{CORNER}\", separated by commas"),
        ));
    }

    let mut values = Vec::with_capacity(emission_nm.len() * excitation_nm.len());
    let (mut wrong, mut empty_cells) = (WrongCells::default(), 0);
    for (row, emission_nm) in table.rows().zip(&emission_nm) {
        for (column, excitation_nm) in (1..).zip(&excitation_nm) {
            let value = match table.number(path, row, column) {
                Ok(Some(value)) => table.checked_sign(path, row, column, value, options.negative),
                Ok(None) if options.empty_as_zero => {
                    empty_cells += 1;
                    Ok(0.0)
                }
                Ok(None) => {
                    let excitation_nm = *excitation_nm;
                    Err(FormatError::EmptyCell { path: path.into(), line: row.line, excitation_nm })
                }
                Err(error) => Err(error),
            };
            let place = Cell { line: row.line, emission_nm: *emission_nm, excitation_nm: *excitation_nm };
            values.push(value.unwrap_or_else(|error| {
                wrong.add(error, place, table.cell(row, column));
                0.0
            }));
        }
    }
    wrong.refused()?;
    let mut eem = MeasuredEem { emission_nm, excitation_nm, values, unit, empty_cells };
    check_stokes(path, &table, &mut eem, options.anti_stokes)?;
    Ok(eem)
}

/// Wrong cells of a file that are told.
const MOST_CELLS: usize = 20;

/// Where a value stands.
struct Cell {
    line: u64,
    emission_nm: f64,
    excitation_nm: f64,
}

/// The wrong cells of a file, told together: who corrects them needs all.
#[derive(Default)]
struct WrongCells {
    first: Option<FormatError>,
    next: Vec<String>,
    more: usize,
}

impl WrongCells {
    fn add(&mut self, error: FormatError, place: Cell, text: &str) {
        let Cell { line, emission_nm, excitation_nm } = place;
        if self.first.is_none() {
            self.first = Some(error);
        } else if self.next.len() + 1 < MOST_CELLS {
            let held = if text.is_empty() { "nothing".into() } else { excerpt(text) };
            self.next.push(format!(
                "line {line} (emission {emission_nm} nm, excitation {excitation_nm} nm) holds {held}"
            ));
        } else {
            self.more += 1;
        }
    }

    fn refused(self) -> Result<(), FormatError> {
        match self.first {
            None => Ok(()),
            Some(first) if self.next.is_empty() => Err(first),
            Some(first) => {
                Err(FormatError::Cells { first: Box::new(first), next: self.next, more: self.more })
            }
        }
    }
}

fn check_corner(path: &Path, table: &Table) -> Result<(), FormatError> {
    let corner = table.header.cells[0].as_str();
    let plain: String = corner.to_lowercase().chars().filter(|c| !c.is_whitespace()).collect();
    if plain == CORNER {
        return Ok(());
    }
    let (what, hint) = if plain == "ex_nm\\em_nm" {
        (
            "the corner cell is \"ex_nm\\em_nm\": rows are excitation".to_string(),
            format!("Transpose the table so that rows are emission, and write \"{CORNER}\""),
        )
    } else if corner.is_empty() || corner.parse::<f64>().is_ok() {
        (
            "the corner cell is missing".to_string(),
            format!("Write \"{CORNER}\" there: rows are emission, columns excitation, both in nm"),
        )
    } else {
        (
            format!("the corner cell is \"{}\"", excerpt(corner)),
            format!("Write \"{CORNER}\" if rows are emission and columns excitation, both in nm"),
        )
    };
    Err(FormatError::at_line(path, table.header.line, what, hint))
}

fn unit(path: &Path, table: &Table, given: Option<EemUnit>) -> Result<EemUnit, FormatError> {
    let mut stated = None;
    for (line, comment) in &table.comments {
        let lower = comment.to_lowercase();
        let Some(text) = lower.strip_prefix("unit:").or_else(|| lower.strip_prefix("units:")) else {
            continue;
        };
        stated = Some(match text.trim() {
            "photon" | "photons" | "quanta" => EemUnit::Photons,
            "energy" => EemUnit::Energy,
            "unknown" => EemUnit::Unknown,
            other => {
                return Err(FormatError::at_line(
                    path,
                    *line,
                    format!("the unit \"{}\" is not known", excerpt(other)),
                    "Write \"# unit: photons\" or \"# unit: energy\"",
                ));
            }
        });
    }
    match (stated, given) {
        (Some(EemUnit::Unknown), Some(given)) => Ok(given),
        (Some(stated), Some(given)) if stated != given => Err(FormatError::unit(
            path,
            format!(
                "the file states that its values count {}, but {} was requested",
                name(stated),
                name(given)
            ),
            "Leave the choice to the file, or correct its comment",
        )),
        (Some(unit), _) | (None, Some(unit)) => Ok(unit),
        (None, None) => Err(FormatError::unit(
            path,
            "the unit of the values is unknown: photons or energy (they differ by emission/excitation wavelength)",
            "Add a line \"# unit: photons\" or \"# unit: energy\", or give the unit when reading",
        )),
    }
}

fn name(unit: EemUnit) -> &'static str {
    match unit {
        EemUnit::Photons => "photons",
        EemUnit::Energy => "energy",
        EemUnit::Unknown => "something unknown",
    }
}

/// Bandpass of an instrument, nm, at least: scattered light is as wide.
const BANDPASS_NM: f64 = 10.0;
/// Excitation wavelengths over which values must follow the excitation to be scattered light, nm. Emission keeps its place: in its own
/// maximum, or in the tail beyond, it looks so over less.
const SCATTER_SPAN_NM: f64 = 40.0;
/// Share of the peak below which scattered light changes little.
const LEAST_SCATTER: f64 = 0.02;

/// Refuses a matrix, `[emission][excitation]`, whose values follow the excitation or twice the excitation: in three columns or more, over
/// 40 nm of excitation, the values within a bandpass of that line are more than twice all those one bandpass to three beside it.
///
/// # Errors
/// [`FormatError::ScatteredLight`].
pub fn refuse_scattered_light(
    path: &Path,
    emission_nm: &[f64],
    excitation_nm: &[f64],
    values: &[f64],
) -> Result<(), FormatError> {
    let steps = emission_nm.windows(2).map(|pair| pair[1] - pair[0]);
    let step_nm = steps.fold(0.0, f64::max);
    let wide_nm = BANDPASS_NM.max(0.75 * step_nm);
    for order in [1_u8, 2] {
        let columns = excitation_nm.len();
        let distance =
            |row: usize, column: usize| emission_nm[row] - f64::from(order) * excitation_nm[column];
        let largest = |column: usize, wanted: &dyn Fn(f64) -> bool| -> Option<f64> {
            let rows = (0..emission_nm.len()).filter(|row| wanted(distance(*row, column)));
            rows.map(|row| values[row * columns + column]).reduce(f64::max)
        };
        // What is left of the matrix without the line
        let beside = |column: usize| largest(column, &|nm| nm.abs() > wide_nm).unwrap_or(0.0);
        let peak = (0..columns).map(beside).fold(0.0, f64::max);
        let scattered = |column: &usize| -> bool {
            let on_line = largest(*column, &|nm| nm.abs() <= wide_nm);
            let above = largest(*column, &|nm| nm > wide_nm && nm <= 3.0 * wide_nm);
            let below = largest(*column, &|nm| nm < -wide_nm && nm >= -3.0 * wide_nm).unwrap_or(0.0);
            let (Some(on_line), Some(above)) = (on_line, above) else { return false };
            on_line > LEAST_SCATTER * peak && on_line > 2.0 * above.max(below)
        };
        let found: Vec<usize> = (0..columns).filter(scattered).collect();
        let (Some(first), Some(last)) = (found.first(), found.last()) else { continue };
        let span = [excitation_nm[*first], excitation_nm[*last]];
        if found.len() < 3 || span[1] - span[0] < SCATTER_SPAN_NM {
            continue;
        }
        let on_line = found.iter().filter_map(|column| largest(*column, &|nm| nm.abs() <= wide_nm));
        let scattered_peak = on_line.fold(0.0, f64::max);
        return Err(FormatError::ScatteredLight {
            path: path.into(),
            order,
            excitation_nm: span,
            percent_of_peak: 100.0 * scattered_peak / if peak > 0.0 { peak } else { scattered_peak },
        });
    }
    Ok(())
}

fn check_stokes(
    path: &Path,
    table: &Table,
    eem: &mut MeasuredEem,
    rule: AntiStokes,
) -> Result<(), FormatError> {
    let columns = eem.excitation_nm.len();
    let (mut below, mut total, mut peak) = (0.0, 0.0, 0.0_f64);
    for (row, &emission) in eem.emission_nm.iter().enumerate() {
        for (column, &excitation) in eem.excitation_nm.iter().enumerate() {
            let cell = &mut eem.values[row * columns + column];
            let value = cell.abs();
            total += value;
            peak = peak.max(value);
            if emission < excitation {
                below += value;
                if rule == AntiStokes::SetToZero {
                    *cell = 0.0;
                }
            }
        }
    }
    if rule != AntiStokes::Keep && below > 0.5 * total {
        return Err(FormatError::Transposed { path: path.into(), percent: 100.0 * below / total });
    }
    if rule != AntiStokes::Keep {
        refuse_scattered_light(path, &eem.emission_nm, &eem.excitation_nm, &eem.values)?;
    }
    let AntiStokes::Refuse(tolerance) = rule else { return Ok(()) };
    let mut wrong = WrongCells::default();
    for (row, &emission_nm) in eem.emission_nm.iter().enumerate() {
        for (column, &excitation_nm) in eem.excitation_nm.iter().enumerate() {
            let value = eem.values[row * columns + column];
            if emission_nm < excitation_nm && value.abs() > tolerance * peak {
                let line = table.line_of(row);
                let error = FormatError::AntiStokes {
                    path: path.into(),
                    line: Some(line),
                    emission_nm,
                    excitation_nm,
                    value,
                    percent_of_peak: 100.0 * value / peak,
                };
                wrong.add(error, Cell { line, emission_nm, excitation_nm }, &value.to_string());
            }
        }
    }
    wrong.refused()
}
