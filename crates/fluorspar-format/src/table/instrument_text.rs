//! Text of instruments and other programs: its encoding, line ends, and the table of numbers among its lines.

use std::borrow::Cow;
use std::path::Path;

use super::value_unit::{StatedUnit, stated_unit};
use crate::FormatError;

/// Bytes looked at to tell text from binary files.
const START: usize = 4096;
/// Share of them that may be control characters: some instruments pad lines with them.
const MOST_CONTROLS: f64 = 0.1;

/// Text as instruments write it: UTF-8 or UTF-16 with a mark, or Latin-1; lines may end as in Windows, Unix or old Macs.
pub(crate) fn instrument_text<'a>(path: &Path, bytes: &'a [u8]) -> Result<Cow<'a, str>, FormatError> {
    let wide = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]])).collect();
        String::from_utf16_lossy(&units)
    };
    let text: Cow<'a, str> = if let Some(rest) = bytes.strip_prefix(b"\xFF\xFE") {
        wide(rest, u16::from_le_bytes).into()
    } else if let Some(rest) = bytes.strip_prefix(b"\xFE\xFF") {
        wide(rest, u16::from_be_bytes).into()
    } else {
        refuse_binary(path, bytes)?;
        let rest = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
        match std::str::from_utf8(rest) {
            Ok(text) => text.into(),
            Err(_) => rest.iter().copied().map(char::from).collect::<String>().into(),
        }
    };
    let text: Cow<'a, str> = match text.contains('\0') {
        true => text.replace('\0', "").into(),
        false => text,
    };
    Ok(match text.contains('\r') {
        true => text.replace("\r\n", "\n").replace('\r', "\n").into(),
        false => text,
    })
}

/// Says which binary file this is.
fn refuse_binary(path: &Path, bytes: &[u8]) -> Result<(), FormatError> {
    let start = &bytes[..bytes.len().min(START)];
    let known: [(&[u8], &str); 6] = [
        (b"PK\x03\x04", "a ZIP archive or a spreadsheet"),
        (b"\xD0\xCF\x11\xE0", "a spreadsheet of Excel"),
        (b"%PDF", "a PDF"),
        (b"\x89PNG", "a picture"),
        (b"AVS8", "a binary file of AvaSoft"),
        (b"PEPE", "a binary file of Perkin-Elmer"),
    ];
    let what = known.iter().find(|(mark, _)| start.starts_with(mark)).map(|(_, what)| *what);
    let control = |byte: &&u8| **byte < 32 && !matches!(**byte, b'\n' | b'\r' | b'\t' | 0x0C | 0x1A);
    let what = what.or_else(|| {
        (start.iter().filter(control).count() as f64 > MOST_CONTROLS * start.len() as f64)
            .then_some("a binary file")
    });
    what.map_or(Ok(()), |what| {
        let hint = "Export the spectra as text (CSV) from the program that wrote it";
        Err(FormatError::unsupported(path, format!("this is {what}, not text"), hint))
    })
}

/// How the cells of a table are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Form {
    /// What separates cells; `None` for blanks.
    mark: Option<char>,
    has_decimal_commas: bool,
}

/// In the order in which they are preferred where a table reads well in several.
const FORMS: [Form; 8] = [
    Form { mark: Some('\t'), has_decimal_commas: false },
    Form { mark: Some('\t'), has_decimal_commas: true },
    Form { mark: Some(';'), has_decimal_commas: false },
    Form { mark: Some(';'), has_decimal_commas: true },
    Form { mark: Some(','), has_decimal_commas: false },
    Form { mark: None, has_decimal_commas: false },
    Form { mark: None, has_decimal_commas: true },
    // Cells in quotation marks
    Form { mark: Some(','), has_decimal_commas: true },
];

impl Form {
    /// Cells of a line, without quotation marks around them and empty ones at the end.
    fn cells(self, line: &str) -> Vec<&str> {
        let mut cells: Vec<&str> = match self.mark {
            // A cell is empty in front of a tab
            None => line.starts_with('\t').then_some("").into_iter().chain(line.split_whitespace()).collect(),
            Some(mark) => {
                let mut is_quoted = false;
                let split = line.split(|c: char| {
                    is_quoted ^= c == '"';
                    c == mark && !is_quoted
                });
                split.map(|cell| cell.trim().trim_matches('"').trim()).collect()
            }
        };
        while cells.last().is_some_and(|cell| cell.is_empty()) {
            cells.pop();
        }
        cells
    }

    fn number(self, cell: &str) -> Option<f64> {
        let cell = cell.strip_suffix("nm").map_or(cell, str::trim_end);
        let has_comma = self.has_decimal_commas && cell.contains(',');
        let value = if has_comma { cell.replace(',', ".").parse::<f64>() } else { cell.parse() };
        value.ok().filter(|value| value.is_finite())
    }

    /// Whether cells may be a row of a spectrum: a number, and others that are numbers or missing.
    fn is_row(self, cells: &[&str]) -> bool {
        let [first, values @ ..] = cells else { return false };
        let is_number = |cell: &&str| self.number(cell).is_some();
        is_number(first)
            && values.iter().any(is_number)
            && values.iter().all(|cell| is_number(cell) || is_missing(cell))
    }

    /// A cell with a decimal point, or empty where there is no value.
    fn plain(self, cell: &str) -> String {
        match self.number(cell) {
            Some(_) => cell.trim_end_matches("nm").trim_end().replace(',', "."),
            None if is_missing(cell) => String::new(),
            _ => cell.to_string(),
        }
    }
}

/// Whether a cell says that there is no value.
pub(crate) fn is_missing(cell: &str) -> bool {
    ["", "-", "--", "---", "na", "n/a", "#n/a", "nan", "null", "none"]
        .iter()
        .any(|word| cell.eq_ignore_ascii_case(word))
}

/// A table of numbers among lines of text.
#[derive(Debug)]
pub(crate) struct TextTable {
    /// Line of the header, from 1; that of the first row where there is none.
    pub(crate) header_line: u64,
    /// A text for each column; empty ones without a header.
    pub(crate) header: Vec<String>,
    /// Line and cells of each row, decimals with a point, missing values empty.
    pub(crate) rows: Vec<(u64, Vec<String>)>,
    /// Lines above the table.
    pub(crate) preamble: Vec<String>,
    /// What the file has otherwise than a plain table, in words.
    pub(crate) read_as: Vec<String>,
    /// Line and text of a cell with a comma, and one with a point in the same column, where commas are taken for decimal ones.
    pub(crate) mixed: Option<(u64, String, String)>,
}

/// What is said of a table of them.
const DECIMAL_COMMAS: &str = "decimal commas";

impl TextTable {
    /// Refuses commas that may part cells and decimals alike, or thousands as well as decimals.
    ///
    /// # Errors
    /// Rows of more cells than are named, a second of several columns without a name that holds nothing but 0, and what looks like thousands.
    pub(crate) fn refuse_doubtful_commas(&self, path: &Path) -> Result<(), FormatError> {
        const AS_IF: &str = "as where commas stand for decimals, too";
        let columns = self.header.len();
        let Some((line, first)) = self.rows.first() else { return Ok(()) };
        let hint = "Export decimals with a point, or semicolons between cells; otherwise name all columns in a header line";
        let is_zero = |cell: &String| cell.parse() == Ok(0.0);
        if self.rows.iter().all(|(_, row)| row.len() > columns) {
            let cells = first.len();
            let what = format!("this line has {cells} cells but the header has {columns}, {AS_IF}");
            return Err(FormatError::at_line(path, *line, what, hint));
        }
        if columns > 2
            && self.header.iter().all(String::is_empty)
            && self.rows.iter().all(|(_, row)| is_zero(&row[1]) && row.iter().all(|cell| !cell.contains('.')))
        {
            let what = format!("the second column holds nothing but 0, {AS_IF}");
            return Err(FormatError::at_line(path, *line, what, hint));
        }
        let has_commas = self.read_as.iter().any(|said| said == DECIMAL_COMMAS);
        let thousands = || (0..columns).filter(|_| has_commas).find_map(|column| self.thousands(column));
        let doubtful = self.mixed.clone().or_else(thousands);
        doubtful.map_or(Ok(()), |(line, cell, other)| {
            let what =
                format!("{cell} stands in a column with {other}: its comma may part thousands or decimals");
            let hint = "Write thousands without a comma, or all decimals of the column alike";
            Err(FormatError::at_line(path, line, what, hint))
        })
    }

    /// A cell of a column whose commas look like those of thousands, with its line, and one without a comma.
    fn thousands(&self, column: usize) -> Option<(u64, String, String)> {
        // Wavelengths in steps of a third, which rise or fall with decimals alone
        let values = self.rows.iter().filter_map(|(_, row)| row[column].parse::<f64>().ok());
        if values.clone().is_sorted() || values.map(|value| -value).is_sorted() {
            return None;
        }
        let cells = self.rows.iter().map(|(line, row)| (*line, row[column].as_str()));
        let (with, without): (Vec<_>, Vec<_>) =
            cells.filter(|(_, cell)| !cell.is_empty()).partition(|(_, cell)| cell.contains('.'));
        let is_like_thousands = |(_, cell): &(u64, &str)| {
            cell.split_once('.').is_some_and(|(before, behind)| {
                !before.starts_with(['0', '-']) && before.len() <= 3 && behind.len() == 3
            })
        };
        let is_doubtful = with.iter().all(is_like_thousands);
        let ((line, cell), (_, other)) = with.first().zip(without.first()).filter(|_| is_doubtful)?;
        Some((*line, cell.replace('.', ","), (*other).to_owned()))
    }
}

/// Words for a wavelength in headers.
const WAVELENGTH_WORDS: [&str; 15] = [
    "wavelength",
    "wavelengths",
    "wave",
    "waves",
    "lambda",
    "λ",
    "wl",
    "wvl",
    "nm",
    "nanometers",
    "nanometer",
    "nanometres",
    "nanometre",
    "wellenlänge",
    "longueur",
];

/// Whether the nm in a header are those of a light, `LED 405 nm`, or what values are per.
pub(crate) fn has_other_nm(header: &str) -> bool {
    let lower = header.to_lowercase();
    ["/nm", "nm-1", "nm^-1", "nm⁻¹", "per nm"].iter().any(|unit| lower.contains(unit))
        || lower
            .split_once("nm")
            .is_some_and(|(before, _)| before.trim_end().ends_with(|c: char| c.is_ascii_digit()))
}

/// Whether a header names wavelengths, in whatever unit; W/nm and mA/W are none.
pub(crate) fn names_wavelengths(header: &str) -> bool {
    let lower = header.to_lowercase().replace("w.length", "wavelength");
    let is_of_them = |word: &str| WAVELENGTH_WORDS.contains(&word) && !(word == "nm" && has_other_nm(header));
    let has_word = || lower.split(|c: char| !c.is_alphanumeric()).any(is_of_them);
    let is_of_values = || matches!(stated_unit(header), StatedUnit::Known(_));
    lower == "w" || lower.starts_with("wavelength") || (has_word() && !is_of_values())
}

/// Lines above the rows among which the header is looked for.
const HEADER_WITHIN: usize = 4;

/// Marks in front of all rows: of columns with nothing in them.
fn empty_in_front(text: &str) -> usize {
    let lines = || text.lines().map(|line| line.trim_matches(' '));
    let is_row = |line: &str, from: usize| {
        FORMS.iter().any(|form| form.cells(line).get(from..).is_some_and(|cells| form.is_row(cells)))
    };
    let rows = lines().filter(|line| is_row(line.trim_start_matches(MARKS), 0));
    let least =
        rows.map(marks_in_front).try_fold(usize::MAX, |least, marks| (marks > 0).then_some(least.min(marks)));
    // Some of the rows may have words in these columns
    least
        .filter(|least| !lines().any(|line| marks_in_front(line) < *least && is_row(line, *least)))
        .unwrap_or(0)
}

/// What may separate cells, besides blanks.
const MARKS: [char; 3] = ['\t', ';', ','];

fn marks_in_front(line: &str) -> usize {
    line.len() - line.trim_start_matches(MARKS).len()
}

/// Finds the table: the longest run of lines of numbers, however they are separated. `None` where no two lines follow each other that
/// hold numbers.
pub(crate) fn find_table(text: &str) -> Option<TextTable> {
    let empty = empty_in_front(text);
    // Marks in front stand for cells, as below the end of the first of several pairs
    let lines = text.lines().enumerate().map(|(index, line)| {
        let line = line.trim_end().trim_start_matches(' ');
        (index as u64 + 1, line[marks_in_front(line).min(empty)..].trim_start_matches(' '))
    });
    let all: Vec<(u64, &str)> = lines.filter(|(_, line)| !line.is_empty()).collect();
    let held: Vec<(u64, &str)> = all.iter().copied().filter(|(_, line)| !line.starts_with('#')).collect();
    let cells_of = |form: Form| held.iter().map(|(_, line)| form.cells(line)).collect::<Vec<_>>();
    let (form, run) = longest_runs(text, cells_of).into_iter().rev().max_by_key(|(_, run)| run.len())?;
    if run.len() < 2 {
        return None;
    }
    let cells = cells_of(form);
    let first_line = held[run.start].0;
    let above_run: Vec<(u64, &str)> =
        all.iter().copied().filter(|(number, _)| *number < first_line).collect();
    let lengths = || cells[run.clone()].iter().map(Vec::len);
    // Rows may be shorter than the header
    let widest = lengths().max()?;
    let mut counts = std::collections::BTreeMap::new();
    lengths().for_each(|length| *counts.entry(length).or_insert(0) += 1);
    let usual = || counts.iter().rev().max_by_key(|(_, count)| **count).map(|(length, _)| *length);
    let is_as_wide = |line: &str| FORMS.iter().any(|way| way.cells(line).len() == widest);
    let mut near = above_run.iter().rev().take(HEADER_WITHIN);
    let width = if near.any(|(_, line)| is_as_wide(line)) { widest } else { usual()? };
    let region = extended(form, &cells, run, width);
    let first_line = held[region.start].0;
    let above: Vec<(u64, &str)> = all.iter().copied().filter(|(number, _)| *number < first_line).collect();
    let found = header(form, &above, width);
    let (header_line, header, used) = found.unwrap_or_else(|| (first_line, vec![String::new(); width], 0));
    let comments = |lines: &[(u64, &str)]| lines.iter().filter(|(_, line)| line.starts_with('#')).count();
    let left_out = (above.len() - comments(&above)).saturating_sub(used) + held.len() - region.end;
    let mixed = form.has_decimal_commas.then(|| mixed_commas(form, &held, &cells, region.clone())).flatten();
    let rows = region.map(|place| {
        let mut row: Vec<String> = cells[place].iter().map(|cell| form.plain(cell)).collect();
        row.resize(row.len().max(width), String::new());
        (held[place].0, row)
    });
    let read_as = [
        (left_out > 0).then(|| format!("without {left_out} lines beside the table")),
        form.has_decimal_commas.then(|| DECIMAL_COMMAS.to_string()),
    ];
    Some(TextTable {
        header_line,
        header,
        rows: rows.collect(),
        preamble: above.into_iter().map(|(_, line)| line.trim().to_string()).collect(),
        read_as: read_as.into_iter().flatten().collect(),
        mixed,
    })
}

/// Line and text of a cell with a comma in a column that has a cell with a point, and that one.
fn mixed_commas(
    form: Form,
    held: &[(u64, &str)],
    cells: &[Vec<&str>],
    rows: std::ops::Range<usize>,
) -> Option<(u64, String, String)> {
    let width = cells[rows.clone()].iter().map(Vec::len).max()?;
    (0..width).find_map(|column| {
        let with = |mark: char| {
            let mut places = rows.clone();
            let is_such = |cell: &&str| cell.contains(mark) && form.number(cell).is_some();
            let place = places.find(|place| cells[*place].get(column).is_some_and(is_such))?;
            Some((held[place].0, cells[place][column].to_owned()))
        };
        with(',').zip(with('.')).map(|((line, cell), (_, other))| (line, cell, other))
    })
}

/// The longest run of rows in each form, in their order. Lines are divided once for each mark, and not at all by one that the text
/// does not have: a line of one cell is no row.
fn longest_runs<'t>(
    text: &str,
    cells_of: impl Fn(Form) -> Vec<Vec<&'t str>>,
) -> Vec<(Form, std::ops::Range<usize>)> {
    let mut runs: Vec<(Form, std::ops::Range<usize>)> = Vec::new();
    for form in FORMS {
        let is_known = runs.iter().any(|(known, _)| known.mark == form.mark);
        if is_known || form.mark.is_some_and(|mark| !text.contains(mark)) {
            continue;
        }
        let cells = cells_of(form);
        let alike = FORMS.into_iter().filter(|other| other.mark == form.mark);
        runs.extend(alike.map(|form| (form, longest_run(form, &cells))));
    }
    runs.sort_by_key(|(form, _)| FORMS.iter().position(|known| known == form));
    runs
}

/// Wrong lines in sequence among the rows of a table; more separate two tables.
const LINES_BETWEEN: usize = 2;

/// The longest run of rows of one length.
fn longest_run(form: Form, cells: &[Vec<&str>]) -> std::ops::Range<usize> {
    let mut best = 0..0;
    let mut run = 0..0;
    for (place, line) in cells.iter().enumerate() {
        if !form.is_row(line) {
            continue;
        }
        run = if run.end == place && !run.is_empty() { run.start..place + 1 } else { place..place + 1 };
        if run.len() > best.len() {
            best = run.clone();
        }
    }
    best
}

/// The run with all other lines that must be rows of the same table, so that a wrong one among them is told: those as wide that begin with
/// a number, or go on where the first of several spectra has ended, and what lies between.
fn extended(
    form: Form,
    cells: &[Vec<&str>],
    run: std::ops::Range<usize>,
    width: usize,
) -> std::ops::Range<usize> {
    // Between blanks, a line of text has lower-case words: what stands for a value (nan, *****, > 6) has none
    let is_value =
        |cell: &&str| is_missing(cell) || !cell.contains(char::is_lowercase) || cell.parse::<f64>().is_ok();
    let is_as_wide = |line: &Vec<&str>| match form.mark {
        Some(_) => line.len() == width,
        None => line.len() >= width && line[1..].iter().all(is_value),
    };
    let belongs = |line: &Vec<&str>| is_as_wide(line) && form.number(line[0]).is_some();
    let is_row = |line: &Vec<&str>| belongs(line) && form.is_row(line);
    let goes_on = |line: &Vec<&str>| {
        let empty = line.iter().take_while(|cell| cell.is_empty()).count();
        form.mark.is_some() && empty > 0 && line.len() <= width && form.is_row(&line[empty..])
    };
    let mut start = run.start;
    while let Some(back) = cells[..start].iter().rev().take(LINES_BETWEEN + 1).position(is_row) {
        start -= back + 1;
    }
    while start > 0 && belongs(&cells[start - 1]) {
        start -= 1;
    }
    let mut end = run.end;
    while let Some(more) =
        cells[end..].iter().take(LINES_BETWEEN + 1).position(|line| belongs(line) || goes_on(line))
    {
        end += more + 1;
    }
    start..end
}

/// The header above the rows: its line, its cells, and how many lines it takes.
fn header(form: Form, above: &[(u64, &str)], width: usize) -> Option<(u64, Vec<String>, usize)> {
    // "YAxis,Counts" says what an axis is of
    let is_axis = |cell: &&str| cell.to_lowercase().ends_with("axis");
    let names_axis = |cells: &[&str]| matches!(cells, [axis, of, ..] if is_axis(axis) && (names_wavelengths(of) || axis.starts_with(['y', 'Y'])));
    if above.last().is_some_and(|(_, line)| names_axis(&form.cells(line))) {
        return None;
    }
    let cells_of = |line: &str| -> Option<Vec<String>> {
        let line = line.trim_start_matches(['#', '%']).trim();
        let of_other_marks = FORMS.into_iter().filter(|other| !other.has_decimal_commas);
        let as_wide = |cells: &Vec<&str>| {
            let mut numbers = cells.iter().filter(|cell| form.number(cell).is_some());
            let is_named =
                names_wavelengths(cells[0]) || (numbers.next().is_none() && !cells[0].ends_with(':'));
            cells.len() == width && is_named
        };
        let found = std::iter::once(form)
            .chain(of_other_marks)
            .map(|way| way.cells(line))
            .filter(|cells| !cells.is_empty())
            .find(as_wide);
        // The last columns may have no name, or the last names no column
        let other = || {
            let mut cells = form.cells(line);
            let is_header = cells.len() > 1 && names_wavelengths(cells[0]);
            if form.mark == Some(',')
                && is_header
                && let Some(joined) = with_commas(line, width)
            {
                return Some(joined);
            }
            // Where commas part cells, more of them in a row may be decimal ones
            let places = if form.mark == Some(',') { line.split(',').count() } else { width };
            cells.resize(width.min(places), "");
            is_header.then(|| cells.into_iter().map(String::from).collect())
        };
        found.map(|cells| cells.into_iter().map(String::from).collect()).or_else(other)
    };
    let near = above.iter().rev().take(HEADER_WITHIN).enumerate();
    let (distance, number, cells) = near
        .filter_map(|(distance, (number, line))| Some((distance, *number, cells_of(line)?)))
        .find(|(distance, _, cells)| *distance == 0 || names_wavelengths(&cells[0]))?;
    let above_it = above.len().checked_sub(distance + 2).map(|place| above[place].1);
    if let (Some(mark), Some(line)) = (form.mark, above_it)
        && let Some(named) = named_pairs(mark, line, &cells)
    {
        return Some((number, named, 2));
    }
    // Names above a line of units
    let names = above_it.and_then(cells_of);
    let names = names.filter(|names| names_wavelengths(&names[0]) && cells[0].starts_with(['[', '(']));
    Some(match names {
        None => (number, cells, 1),
        Some(names) => {
            let both =
                names.iter().zip(&cells).map(|(name, unit)| format!("{name} {unit}").trim().to_string());
            (number, both.collect(), 2)
        }
    })
}

/// Names that have a comma of their own before their unit: "Wavelength, nm,Optical density, OD" of two columns.
fn with_commas(line: &str, width: usize) -> Option<Vec<String>> {
    let cells: Vec<&str> = line.split(',').collect();
    if cells.len() <= width || line.contains('"') {
        return None;
    }
    let blank = |cell: &&str| cell.starts_with(' ');
    let joined: Vec<String> = match cells.iter().filter(|cell| !blank(cell)).count() == width {
        true => cells.chunk_by(|_, next| blank(next)).map(|names| names.join(",")).collect(),
        false if cells.len() == 2 * width => cells.chunks(2).map(|pair| pair.join(",")).collect(),
        false => return None,
    };
    Some(joined.iter().map(|name| name.trim().to_owned()).collect())
}

/// The header of pairs of columns, with the names of samples from a line above it, which names each pair once: `a,,b,,`. A name may hold the mark between
/// cells, or be missing.
fn named_pairs(mark: char, line: &str, cells: &[String]) -> Option<Vec<String>> {
    let are_pairs = cells.len() > 2
        && cells.len().is_multiple_of(2)
        && cells.chunks(2).all(|pair| names_wavelengths(&pair[0]) && !names_wavelengths(&pair[1]));
    let plain = |name| -> &str { str::trim_end_matches(name, mark).trim().trim_matches('"').trim() };
    let names: Vec<&str> = line.split(&format!("{mark}{mark}")).map(plain).collect();
    let is_named = are_pairs && (0..=1).any(|more| names.len() == cells.len() / 2 + more);
    is_named.then(|| {
        let named = cells.chunks(2).zip(names).flat_map(|(pair, name)| {
            let values = if name.is_empty() { pair[1].clone() } else { format!("{name} ({})", pair[1]) };
            [pair[0].clone(), values]
        });
        named.collect()
    })
}
