//! Tables of excitation-emission matrices as instruments export them, brought to the form that is read.

use std::path::Path;

use fluorspar::quote::excerpt;

use super::csv_eem::CORNER;
use crate::error::shortened_list;
use crate::{Defect, FormatError};

/// Wavelengths of fluorometers, nm: what a cell holds that names a row or a column.
const WAVELENGTHS_NM: std::ops::RangeInclusive<f64> = 100.0..=2000.0;

/// A matrix in the form that is read: each row on the line where it stands in the file.
#[derive(Debug)]
pub(crate) struct EemLayout {
    pub(crate) text: String,
    /// What the file has otherwise, in words.
    pub(crate) read_as: Vec<String>,
    /// Line and corner cell of a header that doesn't say whether rows are emission.
    pub(crate) unstated_axes: Option<(u64, String)>,
}

/// A line of the file in cells, without quotation marks and empty cells at its end.
struct Line<'a> {
    /// Place among the lines, from 0.
    index: usize,
    cells: Vec<&'a str>,
}

/// What a header says of the columns.
struct Columns {
    /// Place of the header among the lines.
    index: usize,
    /// Excitation wavelengths, nm.
    excitation_nm: Vec<f64>,
    /// Places of these among all columns of values, or pairs; `None` where they are all.
    chosen: Option<Vec<usize>>,
    /// Whether each is a pair of columns, emission wavelength and value.
    are_pairs: bool,
    /// The corner cell, where neither it nor the columns say which axis is which.
    unstated_corner: Option<String>,
}

/// Which axis a text names.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Axis {
    Excitation,
    Emission,
}

impl EemLayout {
    /// Finds the matrix in what an instrument exported: below lines about the instrument and above others, cells separated by tabs,
    /// semicolons or commas, decimals with a point or a comma, excitation wavelengths in any words and in either order, columns of values or
    /// pairs of columns, of one sample or of several of which one is wanted. `None` for a file in the own form, and for one in which no rows of numbers are found.
    ///
    /// # Errors
    /// Rows of numbers that can't be read as a matrix without a guess.
    pub(crate) fn of(path: &Path, text: &str, sample: Option<&str>) -> Result<Option<Self>, FormatError> {
        let lines: Vec<&str> = text.lines().collect();
        if is_own_form(&lines) {
            return Ok(None);
        }
        let found = ['\t', ';', ','].into_iter().find_map(|mark| {
            let table: Vec<Line> = all_cells(&lines, mark);
            let runs = runs_of_rows(&table, mark != ',');
            let is_table = |run: &std::ops::Range<usize>| run.len() > 1 && width(&table, run) > 2;
            runs.iter().any(is_table).then_some((mark, table, runs))
        });
        let Some((mark, table, runs)) = found else {
            return refuse_single_spectra(path, &lines).map(|()| None);
        };
        let run = longest(path, &table, runs)?;
        let (above, mut rows) = table.split_at(run.start);
        rows = &rows[..run.len()];
        let has_commas = mark != ',' && decimal_commas(path, rows)?;
        let columns = match headless(rows, has_commas) {
            Some(columns) => {
                rows = &rows[1..];
                columns
            }
            None => columns(path, above, rows, has_commas, sample)?,
        };
        if sample.is_some() && columns.chosen.is_none() {
            return Err(no_samples(path, columns.index as u64 + 1));
        }
        let left_out = table.len() - rows.len() - 1;
        let mut layout = Self::written(path, &lines, &columns, rows, has_commas, left_out)?;
        layout.read_as.extend(sample.map(|name| format!("sample {}", excerpt(name))));
        Ok(Some(layout))
    }

    fn written(
        path: &Path,
        lines: &[&str],
        columns: &Columns,
        rows: &[Line],
        has_commas: bool,
        left_out: usize,
    ) -> Result<Self, FormatError> {
        let nm = &columns.excitation_nm;
        let is_falling = nm.windows(2).all(|pair| pair[1] < pair[0]);
        let order: Vec<usize> =
            if is_falling { (0..nm.len()).rev().collect() } else { (0..nm.len()).collect() };
        // Comments stay: one of them has the unit
        let comment = |line: &&str| {
            if line.trim_start().starts_with('#') { (*line).to_string() } else { String::new() }
        };
        let mut written: Vec<String> = lines.iter().map(comment).collect();
        written[columns.index] = CORNER.into();
        for &column in &order {
            written[columns.index] += &format!(",{}", nm[column]);
        }
        let plain = |cell: &str| if has_commas { cell.replace(',', ".") } else { cell.to_string() };
        for row in rows {
            let cells = values_of(path, columns, row, has_commas)?;
            let line = &mut written[row.index];
            *line = plain(row.cells.get(columns.emission_place()).copied().unwrap_or_default());
            for &column in order.iter().filter(|column| **column < cells.len()) {
                *line += &format!(",{}", plain(cells[column]));
            }
            // Too many, for the reader to tell
            for cell in cells.iter().skip(nm.len()) {
                *line += &format!(",{}", plain(cell));
            }
        }
        let said = [
            (left_out > 0).then(|| match left_out {
                1 => "a line beside the table is left out".into(),
                count => format!("{count} lines beside the table are left out"),
            }),
            has_commas.then(|| "decimal commas".into()),
            columns.are_pairs.then(|| "a pair of columns for each excitation".into()),
            is_falling.then(|| "columns from long to short excitation".into()),
        ];
        let unstated = columns.unstated_corner.as_ref();
        Ok(Self {
            text: written.join("\n"),
            read_as: said.into_iter().flatten().collect(),
            unstated_axes: unstated.map(|corner| (columns.index as u64 + 1, corner.clone())),
        })
    }
}

/// Cells of all lines that hold something and are no comments.
fn all_cells<'a>(lines: &[&'a str], mark: char) -> Vec<Line<'a>> {
    let held = lines.iter().enumerate().filter(|(_, line)| !line.trim_start().starts_with('#'));
    held.map(|(index, line)| Line { index, cells: cells(line, mark) })
        .filter(|line| !line.cells.is_empty())
        .collect()
}

fn cells(line: &str, mark: char) -> Vec<&str> {
    let mut cells: Vec<&str> = line.split(mark).map(|cell| cell.trim().trim_matches('"').trim()).collect();
    while cells.last().is_some_and(|cell| cell.is_empty()) {
        cells.pop();
    }
    cells
}

/// Whether the first line of a table has the corner cell of the own form, and the table its order, no commas but those between its cells, and no
/// lines about an instrument above or below its rows.
fn is_own_form(lines: &[&str]) -> bool {
    let table: Vec<&str> = lines
        .iter()
        .map(|line| line.trim())
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .collect();
    let Some((first, rows)) = table.split_first() else { return true };
    let mark = [',', '\t', ';'].into_iter().find(|mark| first.contains(*mark)).unwrap_or(',');
    let header = cells(first, mark);
    let corner: String = header.first().unwrap_or(&"").to_lowercase().split_whitespace().collect();
    if corner != CORNER || (mark != ',' && rows.iter().any(|line| line.contains(','))) {
        return false;
    }
    let nm: Vec<f64> = header[1..].iter().filter_map(|cell| number(cell, false)).collect();
    let is_falling = nm.len() > 1 && nm.windows(2).all(|pair| pair[1] < pair[0]);
    let is_beside = |line: &&str| {
        let cells = cells(line, mark);
        cells.len() < header.len() && cells.first().is_none_or(|cell| number(cell, false).is_none())
    };
    !is_falling && !rows.first().is_some_and(is_beside) && !rows.last().is_some_and(is_beside)
}

fn number(cell: &str, has_commas: bool) -> Option<f64> {
    let value = if has_commas { cell.replace(',', ".").parse::<f64>() } else { cell.parse::<f64>() };
    value.ok().filter(|value| value.is_finite())
}

/// Whether a line may be a row of a matrix: a wavelength, and cells of which half at least hold numbers or nothing.
fn is_row(line: &Line, has_commas: bool) -> bool {
    let [first, values @ ..] = &line.cells[..] else { return false };
    let is_wavelength = number(first, has_commas).is_some_and(|nm| WAVELENGTHS_NM.contains(&nm));
    let good = values.iter().filter(|cell| cell.is_empty() || number(cell, has_commas).is_some()).count();
    is_wavelength && !values.is_empty() && 2 * good >= values.len()
}

/// Ranges of lines that are rows, one after the other.
fn runs_of_rows(table: &[Line], has_commas: bool) -> Vec<std::ops::Range<usize>> {
    let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
    for place in (0..table.len()).filter(|place| is_row(&table[*place], has_commas)) {
        match runs.last_mut() {
            Some(run) if run.end == place => run.end += 1,
            _ => runs.push(place..place + 1),
        }
    }
    runs
}

/// Most cells of a line of a run.
fn width(table: &[Line], run: &std::ops::Range<usize>) -> usize {
    table[run.clone()].iter().map(|line| line.cells.len()).max().unwrap_or(0)
}

/// The longest run. Another one of as many cells would be a part of the matrix that is left out.
fn longest(
    path: &Path,
    table: &[Line],
    runs: Vec<std::ops::Range<usize>>,
) -> Result<std::ops::Range<usize>, FormatError> {
    let best =
        runs.iter().max_by_key(|run| (run.len(), std::cmp::Reverse(run.start))).cloned().unwrap_or(0..0);
    let other = runs.iter().find(|run| **run != best && width(table, run) == width(table, &best));
    let Some(other) = other else { return Ok(best) };
    let gap = if other.start < best.start { other.end } else { best.end };
    let line = table[gap].index as u64 + 1;
    let what = format!("\"{}\" stands between rows of the table", excerpt(&table[gap].cells.join(" ")));
    Err(FormatError::at_line(
        path,
        line,
        what,
        "Leave one table of numbers in the file, without other lines in it",
    ))
}

/// Whether decimals are written with a comma, of cells that tabs or semicolons separate.
fn decimal_commas(path: &Path, rows: &[Line]) -> Result<bool, FormatError> {
    let cells = || rows.iter().flat_map(|row| row.cells.iter().map(move |cell| (row.index, *cell)));
    let with_comma = || cells().filter(|(_, cell)| cell.contains(','));
    let Some((index, cell)) = with_comma().next() else { return Ok(false) };
    let looks_like_thousands = |cell: &str| {
        let (whole, rest) = cell.split_once(',').unwrap_or((cell, ""));
        rest.len() == 3 && !whole.starts_with('0') && (1..=3).contains(&whole.len())
    };
    let has_point =
        cells().any(|(_, cell)| cell.contains('.') && number(&cell.replace(',', ""), false).is_some());
    if has_point || with_comma().all(|(_, cell)| looks_like_thousands(cell)) {
        let what = format!("\"{}\" may have a decimal comma or one between thousands", excerpt(cell));
        let hint = "Export without commas between thousands, or with decimal points";
        return Err(FormatError::at_line(path, index as u64 + 1, what, hint));
    }
    Ok(true)
}

/// The wavelength that a cell of a header names, nm, and the axis, if it says so: `350`, `350.0 nm`, `EX 350.0`, `sample_EX_350.00`.
fn named_wavelength(cell: &str, has_commas: bool) -> Option<(Option<Axis>, f64)> {
    let plain = if has_commas { cell.replace(',', ".") } else { cell.to_string() }.to_lowercase();
    let words: Vec<&str> =
        plain.split(|c: char| !(c.is_alphanumeric() || c == '.')).filter(|w| !w.is_empty()).collect();
    let value = |word: &str| {
        let word = word.trim_start_matches(char::is_alphabetic).trim_end_matches("nm");
        word.parse::<f64>().ok().filter(|nm| WAVELENGTHS_NM.contains(nm))
    };
    // What follows the name of an axis, else what precedes nm, else the only word
    let named = words.iter().rposition(|word| axis_of(word).is_some());
    if let Some(place) = named {
        let nm = value(words[place]).or_else(|| words.get(place + 1).and_then(|word| value(word)))?;
        return Some((axis_of(words[place]), nm));
    }
    let unit = words.iter().rposition(|word| word.ends_with("nm"));
    let word = match unit {
        Some(place) if words[place] == "nm" => words.get(place.checked_sub(1)?)?,
        Some(place) => words[place],
        None if words.len() == 1 && words[0].starts_with(|c: char| c.is_ascii_digit()) => words[0],
        None => return None,
    };
    value(word).map(|nm| (None, nm))
}

/// The axis that a word names: `ex`, `exc`, `excitation`, `em`, `emission`, digits behind them or not.
fn axis_of(word: &str) -> Option<Axis> {
    match word.trim_end_matches(|c: char| !c.is_alphabetic()) {
        "ex" | "exc" | "excitation" | "λex" => Some(Axis::Excitation),
        "em" | "emi" | "emission" | "λem" => Some(Axis::Emission),
        _ => None,
    }
}

/// Whether a header names excitation alone (or emission alone), and no wavelength: `excitation`, `EGFP ex`.
pub(crate) fn names_spectrum(header: &str, axis: Axis) -> bool {
    axes_in(header) == [axis] && named_wavelength(header, false).is_none()
}

/// Axes that a corner cell names, in their order.
fn axes_in(corner: &str) -> Vec<Axis> {
    corner.to_lowercase().split(|c: char| !c.is_alphanumeric()).filter_map(axis_of).collect()
}

/// A first row without a corner cell: one wavelength less than the others have cells.
fn headless(rows: &[Line], has_commas: bool) -> Option<Columns> {
    let [first, second, ..] = rows else { return None };
    let numbers = first.cells.iter().map(|cell| number(cell, has_commas));
    let excitation_nm: Vec<f64> = numbers.collect::<Option<_>>()?;
    let is_header = first.cells.len() + 1 == second.cells.len() && are_wavelengths(&excitation_nm);
    let unstated_corner = Some(String::new());
    is_header.then_some(Columns {
        index: first.index,
        excitation_nm,
        chosen: None,
        are_pairs: false,
        unstated_corner,
    })
}

fn are_wavelengths(nm: &[f64]) -> bool {
    let mut sorted = nm.to_vec();
    sorted.sort_by(f64::total_cmp);
    nm.iter().all(|nm| WAVELENGTHS_NM.contains(nm)) && sorted.windows(2).all(|pair| pair[0] < pair[1])
}

/// The sample that a cell of a header names before the axis: `a` of `a_EX_350.00`, `EGFP` of `EGFP ex`.
pub(crate) fn sample_of(cell: &str) -> &str {
    let is_of_word = |c: char| c.is_alphanumeric() || c == '.';
    let starts_word = |place: usize| !cell[..place].ends_with(is_of_word);
    let word = |place: usize| cell[place..].split(|c: char| !is_of_word(c)).next().unwrap_or_default();
    let mut places = cell.char_indices().rev().map(|(place, _)| place);
    let axis = places.find(|place| starts_word(*place) && axis_of(&word(*place).to_lowercase()).is_some());
    cell[..axis.unwrap_or(0)].trim_end_matches(|c: char| c.is_whitespace() || "_-:,".contains(c))
}

/// The columns of the wanted sample, of those with these names and wavelengths; `None` where there is one sample.
fn chosen(
    path: &Path,
    line: u64,
    samples: &[&str],
    nm: &[f64],
    wanted: Option<&str>,
) -> Result<Option<Vec<usize>>, FormatError> {
    let places =
        |name: &str| -> Vec<usize> { (0..nm.len()).filter(|place| samples[*place] == name).collect() };
    let mut names: Vec<&str> = Vec::new();
    samples.iter().filter(|name| !name.is_empty()).for_each(|name| {
        if !names.contains(name) {
            names.push(name);
        }
    });
    match wanted {
        Some(_) if names.is_empty() => Err(no_samples(path, line)),
        Some(name) if !names.contains(&name) => Err(no_such_sample(path, line, name, &names)),
        Some(name) => Ok(Some(places(name))),
        None if names.len() > 1 && !are_wavelengths(nm) => {
            Err(Defect::Samples(names.into_iter().map(String::from).collect()).at(path, line))
        }
        None => Ok(None),
    }
}

/// A sample is wanted of a file that names none.
pub(crate) fn no_samples(path: &Path, line: u64) -> FormatError {
    FormatError::at_line(path, line, "the columns name no samples", "Leave the choice of a sample out")
}

/// A sample is wanted that the file has not.
pub(crate) fn no_such_sample(path: &Path, line: u64, name: &str, names: &[&str]) -> FormatError {
    let names: Vec<String> = names.iter().map(|name| (*name).to_string()).collect();
    let what = format!("there is no sample \"{}\"", excerpt(name));
    FormatError::at_line(path, line, what, format!("Samples are: {}", shortened_list(&names)))
}

/// The nearest line above the rows that names a wavelength for each column.
fn columns(
    path: &Path,
    above: &[Line],
    rows: &[Line],
    has_commas: bool,
    sample: Option<&str>,
) -> Result<Columns, FormatError> {
    let width = rows.iter().map(|row| row.cells.len()).max().unwrap_or(0);
    for line in above.iter().rev() {
        // Empty cells separate the names of pairs, which may hold commas
        let pairs: Vec<String> =
            line.cells.split(|cell| cell.is_empty()).map(|cells| cells.join(", ")).collect();
        let are_pairs = line.cells.len() > 1
            && width.div_ceil(2) == pairs.len()
            && pairs.iter().all(|name| !name.is_empty());
        let cells: Vec<&str> = match are_pairs {
            true => pairs.iter().map(String::as_str).collect(),
            false => line.cells.iter().skip(1).copied().collect(),
        };
        let named = cells.iter().map(|cell| named_wavelength(cell, has_commas));
        let Some(found) = named.collect::<Option<Vec<_>>>().filter(|found| !found.is_empty()) else {
            continue;
        };
        if !are_pairs && line.cells.len() != width {
            continue;
        }
        let mut excitation_nm: Vec<f64> = found.iter().map(|(_, nm)| *nm).collect();
        let mut samples: Vec<&str> = cells.iter().map(|cell| sample_of(cell)).collect();
        if samples.iter().any(|name| !name.is_empty()) {
            samples.iter_mut().filter(|name| name.is_empty()).for_each(|name| *name = "unnamed");
        }
        let chosen = chosen(path, line.index as u64 + 1, &samples, &excitation_nm, sample)?;
        if let Some(chosen) = &chosen {
            excitation_nm = chosen.iter().map(|place| excitation_nm[*place]).collect();
        }
        if !are_wavelengths(&excitation_nm) {
            continue;
        }
        let corner = if are_pairs { "" } else { line.cells[0] };
        let axes = axes_in(corner);
        let of_columns = found.iter().find_map(|(axis, _)| *axis);
        if of_columns == Some(Axis::Emission) || axes == [Axis::Excitation, Axis::Emission] {
            return Err(FormatError::at_line(
                path,
                line.index as u64 + 1,
                "the columns are emission and the rows excitation",
                "Transpose the table, or export it, so that rows are emission and columns excitation",
            ));
        }
        let is_stated = of_columns.is_some() || axes.first() == Some(&Axis::Emission);
        let unstated_corner = (!is_stated).then(|| corner.to_string());
        return Ok(Columns { index: line.index, excitation_nm, chosen, are_pairs, unstated_corner });
    }
    let line = rows.first().map_or(1, |row| row.index as u64 + 1);
    Err(FormatError::at_line(
        path,
        line,
        format!(
            "no line above these rows names the excitation wavelengths of their {} columns, all different, between 100 and 2000 nm",
            width.saturating_sub(1)
        ),
        format!("Put \"{CORNER}\" and them on the line above, in nm, as many as there are columns of values"),
    ))
}

impl Columns {
    /// Place of the emission wavelength among the cells of a row.
    fn emission_place(&self) -> usize {
        if self.are_pairs { 2 * self.places()[0] } else { 0 }
    }

    fn places(&self) -> Vec<usize> {
        self.chosen.clone().unwrap_or_else(|| (0..self.excitation_nm.len()).collect())
    }
}

/// The cells of a row that hold values.
fn values_of<'a>(
    path: &Path,
    columns: &Columns,
    row: &'a Line,
    has_commas: bool,
) -> Result<Vec<&'a str>, FormatError> {
    let places = columns.places();
    let cell = |place: usize| row.cells.get(place).copied().unwrap_or("");
    if !columns.are_pairs {
        // Empty cells at the end of a line are cells, and too many are told
        let count = places.len().max(if columns.chosen.is_none() { row.cells.len() - 1 } else { 0 });
        return Ok((0..count).map(|at| cell(1 + places.get(at).copied().unwrap_or(at))).collect());
    }
    let emission = |place: usize| number(cell(place), has_commas);
    let first = columns.emission_place();
    if let Some(at) = places.iter().position(|place| emission(2 * place) != emission(first)) {
        let what = format!(
            "the scan at excitation {} nm has the emission wavelength \"{}\" where the first has \"{}\"",
            columns.excitation_nm[at],
            excerpt(cell(2 * places[at])),
            excerpt(cell(first))
        );
        let hint = "Export all scans over the same emission wavelengths, or interpolate them to one";
        return Err(FormatError::at_line(path, row.index as u64 + 1, what, hint));
    }
    Ok(places.iter().map(|place| cell(2 * place + 1)).collect())
}

/// A file of two columns of numbers is one spectrum, whatever program wrote it.
fn refuse_single_spectra(path: &Path, lines: &[&str]) -> Result<(), FormatError> {
    const LEAST_ROWS: usize = 5;
    let is_pair = |line: &&str| {
        let by_mark = |mark: char| {
            let cells = cells(line, mark);
            cells.len() == 2 && cells.iter().all(|cell| number(cell, mark != ',').is_some())
        };
        let by_space: Vec<&str> = line.split_whitespace().collect();
        let spaced = by_space.len() == 2 && by_space.iter().all(|cell| number(cell, true).is_some());
        spaced || ['\t', ';', ','].into_iter().any(by_mark)
    };
    let mut pairs = lines.iter().enumerate().filter(|(_, line)| is_pair(line)).map(|(place, _)| place);
    let Some(first) = pairs.next() else { return Ok(()) };
    if 1 + pairs.count() < LEAST_ROWS {
        return Ok(());
    }
    Err(FormatError::at_line(
        path,
        first as u64 + 1,
        "from here on there are two columns of numbers: one spectrum, not a matrix",
        format!(
            "Export the scans of all excitations as one table, or put their values side by side below a line \"{CORNER},350,360\" of excitation \
             wavelengths in nm; of excitation and emission spectra alone make a table \"wavelength_nm,excitation,emission\""
        ),
    ))
}
