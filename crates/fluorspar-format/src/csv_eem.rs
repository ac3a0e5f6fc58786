//! Excitation-emission matrices as tables.

use std::fmt::Write;
use std::path::Path;

use fluorspar::quote::excerpt;

use super::FormatError;
use super::axis::check_axis;
use super::csv_table::{Negative, Table, comments_of};
use super::eem_layout::EemLayout;
use super::file::{MAX_TEXT_BYTES, as_text, read_file};

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
    /// Places of empty cells among the values, filled as [`CsvEemOptions::empty_cells`] says.
    pub empty_cells: Vec<usize>,
    /// Negative values that were taken as zero: how many, and the lowest. Those that are cut out do not count.
    pub clipped: (usize, f64),
    /// Cells that were cut out of bands of scattered light of the first and of the second order.
    pub cut_cells: [usize; 2],
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CsvEemOptions {
    /// Unit of the values of a file that does not state it.
    pub unit: Option<EemUnit>,
    /// Treatment of values at emission wavelengths below the excitation.
    pub anti_stokes: AntiStokes,
    /// Treatment of negative values.
    pub negative: Negative,
    /// Treatment of empty cells.
    pub empty_cells: EmptyCells,
    /// Cut bands of scattered excitation light out before the checks.
    pub cut: Option<ScatterCut>,
}

/// Bands of scattered excitation light that are cut out: the cells so near the lines emission = excitation and emission = 2 x excitation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatterCut {
    /// Largest distance from a line to either side, nm.
    pub within_nm: f64,
    /// What the cells become.
    pub to: CutTo,
}

impl ScatterCut {
    /// The band in which a cell lies: 0 of the first order, 1 of the second.
    fn order(self, emission_nm: f64, excitation_nm: f64) -> Option<usize> {
        [1.0, 2.0].iter().position(|order| (emission_nm - order * excitation_nm).abs() <= self.within_nm)
    }
}

/// What cells of a band that is cut out become.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CutTo {
    /// On a straight line along the emission between the nearest cells beside the band, under the same excitation; where it reaches the end of
    /// the column, the value of the nearest cell. Cells below their excitation become zero.
    Neighbors,
    /// Zero.
    Zero,
}

impl Default for CsvEemOptions {
    fn default() -> Self {
        Self {
            unit: None,
            anti_stokes: AntiStokes::Refuse(1e-3),
            negative: Negative::Refuse,
            empty_cells: EmptyCells::Refuse,
            cut: None,
        }
    }
}

pub(super) const CORNER: &str = "em_nm\\ex_nm";

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
    let text = as_text(path, &bytes)?;
    let layout = EemLayout::of(path, text).map_err(|wrong| {
        // The unit first, whose option a front adds
        match unit(path, &comments_of(text), options.unit) {
            Err(unit) => together(unit, vec![wrong]),
            Ok(_) => wrong,
        }
    })?;
    let table = Table::parse(path, layout.as_ref().map_or(text, |layout| layout.text.as_str()))?;
    let Axes { unit, emission_nm, excitation_nm } = axes(path, &table, options.unit)?;

    let mut values = Vec::with_capacity(emission_nm.len() * excitation_nm.len());
    let is_cut = |emission_nm, excitation_nm| {
        options.cut.is_some_and(|cut| cut.order(emission_nm, excitation_nm).is_some())
    };
    let (mut wrong, mut empty, mut clipped) = (WrongCells::default(), Vec::new(), (0, 0.0));
    for (row, emission_nm) in table.rows().zip(&emission_nm) {
        for (column, excitation_nm) in (1..).zip(&excitation_nm) {
            let value = match table.number(path, row, column) {
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
    let (read_as, unstated_axes) = layout.map_or_else(Default::default, |l| (l.read_as, l.unstated_axes));
    let cut_cells = [0; 2];
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
    unit: EemUnit,
    emission_nm: Vec<f64>,
    excitation_nm: Vec<f64>,
}

fn axes(path: &Path, table: &Table, given: Option<EemUnit>) -> Result<Axes, FormatError> {
    let mut wrong_form: Vec<FormatError> = Vec::new();
    let unit = unit(path, &table.comments, given).unwrap_or_else(|error| {
        wrong_form.push(error);
        EemUnit::Unknown
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
        None => error.problem().to_string(),
    };
    match next.is_empty() {
        true => first,
        false => {
            let next = next.into_iter().map(words).collect();
            FormatError::Cells { first: Box::new(first), next, more: 0 }
        }
    }
}

/// Widths of band that [`MeasuredEem::least_cuts`] tries, nm.
const MOST_CUT_NM: u32 = 100;

/// The least widths of [`ScatterCut`] that are enough, whole nm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LeastCuts {
    /// So that nothing is refused; `None` where no width up to 100 nm does.
    pub for_all: Option<u32>,
    /// So that no line of scattered light is seen and its tails below the excitation are no more than the tolerance, on average over the matrix: single
    /// cells may still hold more, as noise does anywhere.
    pub for_tails: Option<u32>,
}

impl MeasuredEem {
    /// The least widths of band that cut enough of the scattered light out of a matrix, which is read with [`AntiStokes::Keep`] and without a
    /// cut, for values below their excitation up to a share of the peak.
    #[must_use]
    pub fn least_cuts(&self, to: CutTo, tolerance: f64) -> LeastCuts {
        let cut = |within_nm: u32| {
            let mut eem = self.clone();
            eem.cut_scattered_light(ScatterCut { within_nm: f64::from(within_nm), to });
            eem
        };
        let passes = |eem: &mut MeasuredEem, rule| check_stokes(Path::new(""), &|_| 0, eem, rule).is_ok();
        let background = self.background();
        let has_no_tail = |within_nm: u32, eem: &MeasuredEem| {
            let peak = eem.values.iter().copied().fold(0.0, f64::max);
            let window = f64::from(within_nm)..f64::from(within_nm) + BANDPASS_NM;
            let (mut sum, mut count) = (0.0, 0.0_f64);
            for (nm_below, value) in self.below_excitation().filter(|(nm, _)| window.contains(nm)) {
                if nm_below > window.start {
                    sum += value;
                    count += 1.0;
                }
            }
            sum / count.max(1.0) - background <= tolerance * peak
        };
        let widths = || 1..=MOST_CUT_NM;
        LeastCuts {
            for_all: widths().find(|nm| passes(&mut cut(*nm), AntiStokes::Refuse(tolerance))),
            for_tails: widths().find(|nm| {
                let mut eem = cut(*nm);
                has_no_tail(*nm, &eem) && passes(&mut eem, AntiStokes::SetToZero)
            }),
        }
    }

    /// Values below their excitation, and how far, nm.
    fn below_excitation(&self) -> impl Iterator<Item = (f64, f64)> {
        let columns = self.excitation_nm.len();
        let places = self.values.iter().enumerate();
        places
            .map(move |(place, value)| {
                (self.excitation_nm[place % columns] - self.emission_nm[place / columns], *value)
            })
            .filter(|(nm_below, _)| *nm_below > 0.0)
    }

    /// Median of the values so far below their excitation that neither fluorescence nor a tail of scattered light is there: dark counts, stray
    /// light. 0 without such values.
    fn background(&self) -> f64 {
        let far = self.below_excitation().filter(|(nm_below, _)| *nm_below > 5.0 * BANDPASS_NM);
        let mut far: Vec<f64> = far.map(|(_, value)| value).collect();
        far.sort_by(f64::total_cmp);
        far.get(far.len() / 2).copied().unwrap_or(0.0)
    }

    /// Takes the rows of a file that doesn't say so as emission, where most light is then at wavelengths above its excitation.
    fn take_rows_as_emission(&mut self, path: &Path, line: u64, corner: &str) -> Result<(), FormatError> {
        let (mut below, mut above) = (0.0, 0.0);
        let columns = self.excitation_nm.len();
        for (place, value) in self.values.iter().enumerate() {
            let (emission_nm, excitation_nm) =
                (self.emission_nm[place / columns], self.excitation_nm[place % columns]);
            if emission_nm > excitation_nm {
                above += value.max(0.0);
            } else if emission_nm < excitation_nm {
                below += value.max(0.0);
            }
        }
        if below > CLEARLY_MORE * above {
            return Err(FormatError::at_line(
                path,
                line,
                "the axes are not named, and most light would lie at emission wavelengths below the excitation if rows were emission",
                format!(
                    "Transpose the table, so that rows are emission and columns excitation, and write \"{CORNER}\" into the corner cell"
                ),
            ));
        }
        if above <= CLEARLY_MORE * below {
            return check_corner(path, corner, line);
        }
        self.read_as.push("rows taken as emission, as most light is then above its excitation".into());
        Ok(())
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

    /// Cuts the bands of scattered light of both orders out, and counts their cells. The neighbors of one band may not be cells of the other.
    fn cut_scattered_light(&mut self, cut: ScatterCut) {
        let (rows, columns) = (self.emission_nm.len(), self.excitation_nm.len());
        let measured = self.values.clone();
        for column in 0..columns {
            let order = |row: usize| cut.order(self.emission_nm[row], self.excitation_nm[column]);
            let kept = |row: &usize| order(*row).is_none();
            for row in 0..rows {
                let Some(order) = order(row) else { continue };
                self.cut_cells[order] += 1;
                let at = |row: usize| (self.emission_nm[row], measured[row * columns + column]);
                let (below, above) = ((0..row).rev().find(kept).map(at), (row..rows).find(kept).map(at));
                // Below its excitation nothing fluoresces, whatever stands beside the band
                let is_below = self.emission_nm[row] < self.excitation_nm[column];
                self.values[row * columns + column] = match (cut.to, below, above) {
                    _ if is_below => 0.0,
                    (CutTo::Zero, ..) | (_, None, None) => 0.0,
                    (_, Some((_, value)), None) | (_, None, Some((_, value))) => value,
                    (_, Some(below), Some(above)) => on_the_line(below, above, self.emission_nm[row]),
                };
            }
        }
    }

    /// The matrix as a table that [`read_eem_csv`] takes, below comments, a line each.
    #[must_use]
    pub fn to_csv(&self, comments: &[String]) -> String {
        let mut text: String = comments.iter().map(|line| format!("# {line}\n")).collect();
        text += &format!(
            "# unit: {}\n{CORNER}",
            if self.unit == EemUnit::Unknown { "unknown" } else { name(self.unit) }
        );
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
fn on_the_line((nm_0, value_0): (f64, f64), (nm_1, value_1): (f64, f64), nm: f64) -> f64 {
    value_0 + (nm - nm_0) / (nm_1 - nm_0) * (value_1 - value_0)
}

/// How many times more light must lie above its excitation than below it to tell the axes apart: scattered light is about as much on both
/// sides.
const CLEARLY_MORE: f64 = 2.0;

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

fn unit(path: &Path, comments: &[(u64, String)], given: Option<EemUnit>) -> Result<EemUnit, FormatError> {
    let mut stated = None;
    for (line, comment) in comments {
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
            "the file does not say whether its values count photons or energy (the two differ by the ratio of emission to excitation wavelength)",
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
                let line = line_of(row);
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
