//! Comma-separated tables as lines of cells, with the place of every cell.

use fluorspar::quote::excerpt;
use std::path::Path;

use crate::{Defect, FormatError};

/// Most columns of a table.
const MAX_COLUMNS: usize = 10_000;

/// The first line of a table.
pub(crate) struct Header {
    /// Line in the file, from 1.
    pub(crate) line: u64,
    pub(crate) cells: Vec<String>,
}

/// One line below the header.
#[derive(Clone, Copy)]
pub(crate) struct Row {
    /// Line in the file, from 1.
    pub(crate) line: u64,
    /// Number among the rows, from 0.
    index: usize,
}

/// A header line and the lines below it, all of one length.
pub(crate) struct Table {
    pub(crate) header: Header,
    /// Line of each row.
    lines: Vec<u64>,
    /// Text of all cells below the header, one after the other, row by row.
    text: String,
    /// Where the text of each cell ends.
    ends: Vec<usize>,
    /// Text of the comment lines, without `#`.
    pub(crate) comments: Vec<(u64, String)>,
}

/// Treatment of negative values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Negative {
    /// An error that names the cell.
    #[default]
    Refuse,
    /// Taken as they are.
    Keep,
    /// Replaced by zero.
    ClipToZero,
}

impl Table {
    /// A table of rows that were found elsewhere, each with its line in the file.
    pub(crate) fn of_rows(
        path: &Path,
        header: Header,
        rows: Vec<(u64, Vec<String>)>,
        comments: Vec<(u64, String)>,
    ) -> Result<Self, FormatError> {
        check_width(path, header.cells.len())?;
        let mut table = (Vec::new(), String::new(), Vec::new());
        for (line, cells) in rows {
            push_row(path, &header, line, cells.len(), cells.iter().map(String::as_str), &mut table)?;
        }
        let (lines, text, ends) = table;
        Ok(Self { header, lines, text, ends, comments })
    }

    /// The table of a text, whose cells are separated by commas, tabs or semicolons (whichever the header line uses).
    /// Lines that begin with `#` are comments.
    pub(crate) fn parse(path: &Path, text: &str) -> Result<Self, FormatError> {
        let lines = || text.lines().enumerate().map(|(index, line)| (index as u64 + 1, line.trim()));
        let comments = comments_of(text);
        // What is left without comments and empty lines is read in one go; the numbers of its lines are kept.
        let (mut plain, mut numbers) = (String::with_capacity(text.len()), Vec::new());
        for (number, line) in lines().filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
            plain.push_str(line);
            plain.push('\n');
            numbers.push(number);
        }
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .delimiter(delimiter_of(plain.lines().next().unwrap_or_default()))
            .terminator(csv::Terminator::Any(b'\n'))
            .from_reader(plain.as_bytes());
        let mut header: Option<Header> = None;
        let mut table = (Vec::new(), String::new(), Vec::new());
        let mut record = csv::StringRecord::new();
        let mut next = 0;
        loop {
            let line = numbers.get(next).copied().unwrap_or(0);
            let more = reader.read_record(&mut record).map_err(|error| {
                let what = format!("this line can't be read: {error}");
                FormatError::at_line(path, line, what, "Save it as CSV")
            })?;
            if !more {
                break;
            }
            // A quoted cell may not run over several lines.
            let read = reader.position().line() as usize - 1;
            if read > next + 1 {
                let what = "a quotation mark is not closed on this line";
                return Err(FormatError::at_line(path, line, what, "Close it, or remove it"));
            }
            next += 1;
            if record.iter().all(str::is_empty) {
                continue;
            }
            match &header {
                None => header = Some(header_of(path, line, &record)?),
                Some(header) => push_row(path, header, line, record.len(), record.iter(), &mut table)?,
            }
        }
        let Some(header) = header else {
            return Err(FormatError::malformed(
                path,
                "the file holds no table",
                "Give a header line and lines of numbers",
            ));
        };
        let (lines, text, ends) = table;
        if lines.is_empty() {
            return Err(FormatError::at_line(
                path,
                header.line,
                "the file ends after the header line",
                "Give at least two lines of numbers",
            ));
        }
        Ok(Self { header, lines, text, ends, comments })
    }

    /// Number of rows below the header.
    pub(crate) fn row_count(&self) -> usize {
        self.lines.len()
    }

    /// The rows below the header.
    pub(crate) fn rows(&self) -> impl Iterator<Item = Row> {
        self.lines.iter().enumerate().map(|(index, &line)| Row { line, index })
    }

    /// Line of a row in the file, from 1.
    pub(crate) fn line_of(&self, row: usize) -> u64 {
        self.lines[row]
    }

    /// Text of a cell.
    pub(crate) fn cell(&self, row: Row, column: usize) -> &str {
        let number = row.index * self.header.cells.len() + column;
        let start = if number == 0 { 0 } else { self.ends[number - 1] };
        &self.text[start..self.ends[number]]
    }

    /// Name of a column for messages: its header, or its number where the header is empty.
    pub(crate) fn column_name(&self, column: usize) -> String {
        match self.header.cells[column].as_str() {
            "" => format!("number {}", column + 1),
            name => format!("\"{}\"", excerpt(name)),
        }
    }

    /// The number in a cell; `None` where the cell is empty.
    pub(crate) fn number(&self, path: &Path, row: Row, column: usize) -> Result<Option<f64>, FormatError> {
        self.number_of(path, row.line, column, self.cell(row, column))
    }

    /// The number in a cell of the header; `None` where the cell is empty.
    pub(crate) fn number_in_header(&self, path: &Path, column: usize) -> Result<Option<f64>, FormatError> {
        self.number_of(path, self.header.line, column, &self.header.cells[column])
    }

    fn number_of(
        &self,
        path: &Path,
        line: u64,
        column: usize,
        text: &str,
    ) -> Result<Option<f64>, FormatError> {
        if text.is_empty() {
            return Ok(None);
        }
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value)),
            Ok(_) => Err(FormatError::at_line(
                path,
                line,
                format!("column {} holds {}", self.column_name(column), excerpt(text)),
                "Give a finite number, or remove the line",
            )),
            Err(_) if text.contains(['<', '>']) => Err(FormatError::at_line(
                path,
                line,
                format!("column {} holds \"{}\", a bound", self.column_name(column), excerpt(text)),
                "Write the bound as the value, such as 6 for > 6, or remove the line",
            )),
            Err(_) if text.contains(',') => Err(FormatError::at_line(
                path,
                line,
                format!(
                    "column {} holds \"{}\", which is not a number",
                    self.column_name(column),
                    excerpt(text)
                ),
                "Write decimals with a point",
            )),
            Err(_) => Err(FormatError::at_line(
                path,
                line,
                format!(
                    "column {} holds \"{}\", which is not a number",
                    self.column_name(column),
                    excerpt(text)
                ),
                "Write numbers like 385 or 1.5e-3",
            )),
        }
    }

    /// Applies the rule for negative values to one of them.
    pub(crate) fn checked_sign(
        &self,
        path: &Path,
        row: Row,
        column: usize,
        value: f64,
        rule: Negative,
    ) -> Result<f64, FormatError> {
        if value >= 0.0 {
            return Ok(value);
        }
        match rule {
            Negative::Keep => Ok(value),
            Negative::ClipToZero => Ok(0.0),
            Negative::Refuse => {
                Err(Defect::Negative { column: self.column_name(column), value }.at(path, row.line))
            }
        }
    }
}

/// Text of the lines that begin with `#`, without it, and their lines from 1.
pub(crate) fn comments_of(text: &str) -> Vec<(u64, String)> {
    let lines = text.lines().enumerate().map(|(index, line)| (index as u64 + 1, line.trim()));
    lines
        .filter_map(|(number, line)| line.strip_prefix('#').map(|text| (number, text.trim().to_string())))
        .collect()
}

/// What separates the cells of a table with this header line.
fn delimiter_of(header: &str) -> u8 {
    [b',', b'\t', b';'].into_iter().find(|mark| header.as_bytes().contains(mark)).unwrap_or(b',')
}

fn check_width(path: &Path, columns: usize) -> Result<(), FormatError> {
    if columns > MAX_COLUMNS {
        let what = format!("the header has {columns} columns");
        return Err(FormatError::too_large(path, what, format!("{MAX_COLUMNS} columns")));
    }
    Ok(())
}

fn header_of(path: &Path, line: u64, record: &csv::StringRecord) -> Result<Header, FormatError> {
    check_width(path, record.len())?;
    Ok(Header { line, cells: record.iter().map(String::from).collect() })
}

/// Appends a row to the lines, the text and the ends of cells of a table.
fn push_row<'a>(
    path: &Path,
    header: &Header,
    line: u64,
    width: usize,
    record: impl Iterator<Item = &'a str>,
    (lines, text, ends): &mut (Vec<u64>, String, Vec<usize>),
) -> Result<(), FormatError> {
    if width != header.cells.len() {
        return Err(FormatError::at_line(
            path,
            line,
            format!("this line has {width} cells but the header has {}", header.cells.len()),
            "Give every line one cell per column",
        ));
    }
    lines.push(line);
    for cell in record {
        text.push_str(cell);
        ends.push(text.len());
    }
    Ok(())
}
