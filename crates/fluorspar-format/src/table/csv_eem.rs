//! Excitation-emission matrices as tables.

use std::fmt::Write;
use std::path::Path;

use fluorspar::quote::excerpt;
use fluorspar::spectral::YieldUnit;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::axis::check_axis;
use super::csv_table::{Negative, Table, comments_of};
use super::eem_layout::{EemLayout, no_samples};
use super::eem_scatter::{ScatterCut, refuse_scattered_light};
use super::instrument_text::{instrument_text, is_missing};
use crate::store::file::{MAX_TEXT_BYTES, read_file};
use crate::{Defect, FormatError};

/// An excitation-emission matrix as stored in a file: neither normalized nor converted.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredEem {
    /// Emission wavelength of each row, nm.
    pub emission_nm: Vec<f64>,
    /// Excitation wavelength of each column, nm.
    pub excitation_nm: Vec<f64>,
    /// Values, `[emission][excitation]`.
    pub values: Vec<f64>,
    /// Unit of the values; `None` where the file says that it is not known, and whoever uses the matrix has to decide.
    pub unit: Option<YieldUnit>,
    /// Places of empty cells among the values, filled as [`CsvEemOptions::empty_cells`] says.
    pub empty_cells: Vec<usize>,
    /// Negative values that were taken as zero: how many, and the lowest. Those that are cut out do not count.
    pub clipped: (usize, f64),
    /// Cells that were cut out of bands of scattered light, by line as in [`ScatterLine::ALL`](crate::ScatterLine::ALL).
    pub cut_cells: [usize; 4],
    /// What the file has otherwise than the form that is written here, in words: lines about an instrument, decimal commas.
    pub read_as: Vec<String>,
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

/// Treatment of empty cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EmptyCells {
    /// An error.
    #[default]
    Refuse,
    /// Zero: nothing fluoresces there.
    Zero,
    /// On a straight line along the emission between the nearest cells with values under the same excitation. Cells below their excitation,
    /// and those without a value to both sides, which lie beyond what was measured, become zero.
    Interpolate,
}

/// How to read a matrix. The default refuses anti-Stokes values above 0.1 % of the peak, negative values and empty
/// cells, and takes the unit from the file.
#[derive(Clone, Debug, PartialEq)]
pub struct CsvEemOptions {
    /// Unit of the values of a file that does not state it.
    pub unit: Option<YieldUnit>,
    /// Treatment of values at emission wavelengths below the excitation.
    pub anti_stokes: AntiStokes,
    /// Treatment of negative values.
    pub negative: Negative,
    /// Treatment of empty cells.
    pub empty_cells: EmptyCells,
    /// Cut bands of scattered excitation light out before the checks.
    pub cut: Option<ScatterCut>,
    /// Name of one of several samples whose scans are in one file.
    pub sample: Option<String>,
}

impl Default for CsvEemOptions {
    fn default() -> Self {
        Self {
            unit: None,
            anti_stokes: AntiStokes::Refuse(1e-3),
            negative: Negative::Refuse,
            empty_cells: EmptyCells::Refuse,
            cut: None,
            sample: None,
        }
    }
}

pub(crate) const CORNER: &str = "em_nm\\ex_nm";

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
/// `em_nm\ex_nm`; or one as an instrument exports it, where nothing of it has to be guessed. The unit comes from a comment `# unit: photons`
/// (or `energy`, `unknown`) or from the options.
///
/// # Errors
/// Anything that is not such a table, with file and line.
pub fn read_eem_csv(path: &Path, options: &CsvEemOptions) -> Result<MeasuredEem, FormatError> {
    let bytes = read_file(path, MAX_TEXT_BYTES)?;
    let text = &*instrument_text(path, &bytes)?;
    let layout = EemLayout::of(path, text, options.sample.as_deref()).map_err(|wrong| {
        // The unit first, whose option a front adds
        match unit(path, &comments_of(text), options.unit) {
            Err(unit) if !matches!(wrong.defect(), Defect::Samples(_)) => together(unit, vec![wrong]),
            _ => wrong,
        }
    })?;
    if layout.is_none() && options.sample.is_some() {
        return Err(no_samples(path, 1));
    }
    let table = Table::parse(path, layout.as_ref().map_or(text, |layout| layout.text.as_str()))?;
    let Axes { unit, emission_nm, excitation_nm } = axes(path, &table, options.unit)?;

    let mut values = Vec::with_capacity(emission_nm.len() * excitation_nm.len());
    let is_cut =
        |emission_nm, excitation_nm| options.cut.is_some_and(|cut| cut.has(emission_nm, excitation_nm));
    let (mut wrong, mut empty, mut clipped) = (WrongCells::default(), Vec::new(), (0, 0.0));
    for (row, emission_nm) in table.rows().zip(&emission_nm) {
        for (column, excitation_nm) in (1..).zip(&excitation_nm) {
            let number = match is_missing(table.cell(row, column)) {
                true => Ok(None),
                false => table.number(path, row, column),
            };
            let value = match number {
                // What is cut out has no value
                Ok(Some(value)) if value < 0.0 && is_cut(*emission_nm, *excitation_nm) => Ok(0.0),
                Ok(Some(value)) => {
                    if value < 0.0 && options.negative == Negative::ClipToZero {
                        clipped = (clipped.0 + 1, f64::min(clipped.1, value));
                    }
                    table.checked_sign(path, row, column, value, options.negative)
                }
                Ok(None) if options.empty_cells != EmptyCells::Refuse => {
                    empty.push(values.len());
                    Ok(0.0)
                }
                Ok(None) => Err(Defect::EmptyCell { excitation_nm: *excitation_nm }.at(path, row.line)),
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
    let (read_as, unstated_axes) = layout.map_or_else(Default::default, |l| (l.read_as, l.unstated_axes));
    let cut_cells = [0; 4];
    let mut eem = MeasuredEem {
        emission_nm,
        excitation_nm,
        values,
        unit,
        empty_cells: empty,
        clipped,
        cut_cells,
        read_as,
    };
    if options.empty_cells == EmptyCells::Interpolate {
        eem.interpolate();
    }
    if let Some((line, corner)) = unstated_axes {
        eem.take_rows_as_emission(path, line, &corner)?;
    }
    if let Some(cut) = options.cut {
        eem.cut_scattered_light(cut);
    }
    check_stokes(path, &|row| table.line_of(row), &mut eem, options.anti_stokes)?;
    Ok(eem)
}

/// What the header, the first column and the comments of a table say.
struct Axes {
    unit: Option<YieldUnit>,
    emission_nm: Vec<f64>,
    excitation_nm: Vec<f64>,
}

fn axes(path: &Path, table: &Table, given: Option<YieldUnit>) -> Result<Axes, FormatError> {
    let mut wrong_form: Vec<FormatError> = Vec::new();
    let unit = unit(path, &table.comments, given).unwrap_or_else(|error| {
        wrong_form.push(error);
        None
    });
    wrong_form.extend(check_corner(path, &table.header.cells[0], table.header.line).err());
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
    wrong_form.extend(check_axis(path, "the excitation", &excitation_nm, |_| Some(header_line)).err());
    wrong_form
        .extend(check_axis(path, "the emission", &emission_nm, |index| Some(table.line_of(index))).err());
    let mut wrong_form = wrong_form.into_iter();
    if let Some(first) = wrong_form.next() {
        return Err(together(first, wrong_form.collect()));
    }
    if excitation_nm.is_empty() {
        return Err(FormatError::at_line(
            path,
            header_line,
            "there is no excitation wavelength",
            format!("Put them on the first line after \"{CORNER}\", separated by commas"),
        ));
    }
    Ok(Axes { unit, emission_nm, excitation_nm })
}

/// All that is wrong with the form of a file at once: who corrects it by hand should not meet one refusal after another.
fn together(first: FormatError, next: Vec<FormatError>) -> FormatError {
    let words = |error: FormatError| match error.line() {
        Some(line) => format!("line {line}: {}", error.problem()),
        None => error.problem(),
    };
    first.and(&next.into_iter().map(words).collect::<Vec<_>>(), 0)
}

impl MeasuredEem {
    /// Takes the rows of a file that names no axes as emission, where what it has says so.
    fn take_rows_as_emission(&mut self, path: &Path, line: u64, corner: &str) -> Result<(), FormatError> {
        let by_form = self.rows_are_emission_by_form(corner);
        let by_light = self.rows_are_emission_by_light();
        if let (Some((true, form)), Some(false)) = (by_form, by_light) {
            return Err(FormatError::at_line(
                path,
                line,
                format!(
                    "the axes are not named: rows would be emission, as {form}, but most light would then lie below its excitation"
                ),
                format!(
                    "Transpose the table if columns are emission, and write \"{CORNER}\" into the corner cell"
                ),
            ));
        }
        let by_steps = || self.rows_are_finer().map(|rows| (rows, "the finer scan is emission"));
        let by_light = by_light.map(|rows| (rows, "most light is then above its excitation"));
        match by_form.or(by_light).or_else(by_steps) {
            None => check_corner(path, corner, line),
            Some((true, reason)) => {
                self.read_as.push(format!("rows taken as emission, as {reason}"));
                Ok(())
            }
            Some((false, reason)) => Err(FormatError::at_line(
                path,
                line,
                format!("the axes are not named, and columns would be emission, as {reason}"),
                format!(
                    "Transpose the table, so that rows are emission and columns excitation, and write \"{CORNER}\" into the corner cell"
                ),
            )),
        }
    }

    /// Whether rows are emission by the words of an instrument, or as wavelengths of an array of detectors, which are no whole numbers, while those of a
    /// monochromator that is set to excite are.
    fn rows_are_emission_by_form(&self, corner: &str) -> Option<(bool, &'static str)> {
        let plain: String = corner.to_lowercase().split_whitespace().collect();
        if plain == "sample-blank" {
            return Some((true, "an Aqualog writes \"Sample - Blank\" above it"));
        }
        if ["wavelength", "wavelength(nm)", "wavelength[nm]", "nm"].contains(&plain.as_str()) {
            return Some((true, "the corner names wavelengths of scans"));
        }
        let is_whole = |axis: &[f64]| axis.iter().all(|nm| (nm - nm.round()).abs() < 1e-6);
        let reason = "emission wavelengths are no whole numbers";
        match (is_whole(&self.emission_nm), is_whole(&self.excitation_nm)) {
            (false, true) => Some((true, reason)),
            (true, false) => Some((false, reason)),
            _ => None,
        }
    }

    /// Whether rows are emission by the light off the line of first-order scatter, which lies to both sides of it.
    fn rows_are_emission_by_light(&self) -> Option<bool> {
        let (mut below, mut above) = (0.0, 0.0);
        let columns = self.excitation_nm.len();
        for (place, value) in self.values.iter().enumerate() {
            let nm = self.emission_nm[place / columns] - self.excitation_nm[place % columns];
            if nm > OFF_LINE_NM {
                above += value.max(0.0);
            } else if nm < -OFF_LINE_NM {
                below += value.max(0.0);
            }
        }
        let clearly = |more: f64, less: f64| more > CLEARLY_MORE * less;
        clearly(above, below).then_some(true).or(clearly(below, above).then_some(false))
    }

    /// Whether rows are emission as that of the two evenly spaced axes that has the smaller steps.
    fn rows_are_finer(&self) -> Option<bool> {
        let step = |axis: &[f64]| -> Option<f64> {
            let steps = || axis.windows(2).map(|pair| pair[1] - pair[0]);
            let (least, most) = (steps().fold(f64::INFINITY, f64::min), steps().fold(0.0, f64::max));
            (axis.len() > 2 && most - least < 0.01 * most).then_some(most)
        };
        let (rows, columns) = (step(&self.emission_nm)?, step(&self.excitation_nm)?);
        (rows < 0.75 * columns).then_some(true).or((columns < 0.75 * rows).then_some(false))
    }

    /// Fills empty cells from their neighbors along the emission ([`EmptyCells::Interpolate`]).
    fn interpolate(&mut self) {
        let (rows, columns) = (self.emission_nm.len(), self.excitation_nm.len());
        let mut is_empty = vec![false; self.values.len()];
        self.empty_cells.iter().for_each(|place| is_empty[*place] = true);
        let measured = self.values.clone();
        for &place in &self.empty_cells {
            let (row, column) = (place / columns, place % columns);
            let has_value = |row: &usize| !is_empty[row * columns + column];
            let at = |row: usize| (self.emission_nm[row], measured[row * columns + column]);
            let sides = ((0..row).rev().find(has_value).map(at), (row..rows).find(has_value).map(at));
            if let (Some(before), Some(after)) = sides
                && self.emission_nm[row] >= self.excitation_nm[column]
            {
                self.values[place] = on_the_line(before, after, self.emission_nm[row]);
            }
        }
    }

    /// The matrix as a table that [`read_eem_csv`] takes, below comments, a line each.
    #[must_use]
    pub fn to_csv(&self, comments: &[String]) -> String {
        let mut text: String = comments.iter().map(|line| format!("# {line}\n")).collect();
        text += &format!("# unit: {}\n{CORNER}", self.unit.map_or("unknown", YieldUnit::name));
        text.extend(self.excitation_nm.iter().map(|nm| format!(",{nm}")));
        for (row, emission_nm) in self.values.chunks(self.excitation_nm.len().max(1)).zip(&self.emission_nm) {
            text += &format!("\n{emission_nm}");
            text.extend(row.iter().map(|value| format!(",{value}")));
        }
        text.push('\n');
        text
    }
}

/// The value at `nm` on the straight line through two points.
pub(crate) fn on_the_line((nm_0, value_0): (f64, f64), (nm_1, value_1): (f64, f64), nm: f64) -> f64 {
    value_0 + (nm - nm_0) / (nm_1 - nm_0) * (value_1 - value_0)
}

/// How many times more light must lie above its excitation than below it to tell the axes apart.
const CLEARLY_MORE: f64 = 2.0;
/// Distance from emission = excitation that light of the lamp hardly reaches, nm.
const OFF_LINE_NM: f64 = 15.0;

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
        self.first.map_or(Ok(()), |first| Err(first.and(&self.next, self.more)))
    }
}

fn check_corner(path: &Path, corner: &str, line: u64) -> Result<(), FormatError> {
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
    Err(FormatError::at_line(path, line, what, hint))
}

/// The unit that a comment `# unit: photons` states; `None` within where it says that it is unknown.
pub(super) fn stated_unit_of(
    path: &Path,
    comments: &[(u64, String)],
) -> Result<Option<Option<YieldUnit>>, FormatError> {
    let mut stated = None;
    for (line, comment) in comments {
        let lower = comment.to_lowercase();
        let Some(text) = lower.strip_prefix("unit:").or_else(|| lower.strip_prefix("units:")) else {
            continue;
        };
        stated = Some(match text.trim() {
            "photon" | "photons" | "quanta" => Some(YieldUnit::Photons),
            "energy" => Some(YieldUnit::Energy),
            "unknown" => None,
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
    Ok(stated)
}

fn unit(
    path: &Path,
    comments: &[(u64, String)],
    given: Option<YieldUnit>,
) -> Result<Option<YieldUnit>, FormatError> {
    match (stated_unit_of(path, comments)?, given) {
        (Some(Some(stated)), Some(given)) if stated != given => Err(FormatError::unit(
            path,
            format!(
                "the file states that its values count {}, but {} was requested",
                stated.name(),
                given.name()
            ),
            "Leave the choice to the file, or correct its comment",
        )),
        (_, Some(given)) => Ok(Some(given)),
        (Some(stated), None) => Ok(stated),
        (None, None) => Err(FormatError::unit(
            path,
            "the file does not say whether its values count photons or energy (the two differ by the ratio of emission to excitation wavelength)",
            "Add a line \"# unit: photons\" or \"# unit: energy\", or give the unit when reading",
        )),
    }
}

pub(crate) fn check_stokes(
    path: &Path,
    line_of: &dyn Fn(usize) -> u64,
    eem: &mut MeasuredEem,
    rule: AntiStokes,
) -> Result<(), FormatError> {
    let columns = eem.excitation_nm.len();
    let (mut below, mut total, mut peak) = (0.0, 0.0, 0.0_f64);
    for (row, &emission) in eem.emission_nm.iter().enumerate() {
        for (column, &excitation) in eem.excitation_nm.iter().enumerate() {
            let cell = &mut eem.values[row * columns + column];
            let value = cell.abs();
            peak = peak.max(value);
            // Scattered light is no sign of the axes
            let off_line = if (emission - excitation).abs() > OFF_LINE_NM { value } else { 0.0 };
            total += off_line;
            if emission < excitation {
                below += off_line;
                if rule == AntiStokes::SetToZero {
                    *cell = 0.0;
                }
            }
        }
    }
    if rule != AntiStokes::Keep && below > 0.5 * total {
        return Err(Defect::Transposed { percent: 100.0 * below / total }.of(path));
    }
    if rule != AntiStokes::Keep {
        refuse_scattered_light(path, &eem.emission_nm, &eem.excitation_nm, &eem.values)?;
        if eem.has_overflow_mark()
            && let Some(overflow) = eem.overflow()
        {
            return Err(FormatError::malformed(path, overflow.to_string(), "Or empty these cells"));
        }
    }
    let AntiStokes::Refuse(tolerance) = rule else { return Ok(()) };
    let mut wrong = WrongCells::default();
    for (row, &emission_nm) in eem.emission_nm.iter().enumerate() {
        for (column, &excitation_nm) in eem.excitation_nm.iter().enumerate() {
            let value = eem.values[row * columns + column];
            if emission_nm < excitation_nm && value.abs() > tolerance * peak {
                let line = line_of(row);
                let percent_of_peak = 100.0 * value / peak;
                let error = Defect::AntiStokes { emission_nm, excitation_nm, value, percent_of_peak };
                wrong.add(
                    error.at(path, line),
                    Cell { line, emission_nm, excitation_nm },
                    &value.to_string(),
                );
            }
        }
    }
    wrong.refused()
}
