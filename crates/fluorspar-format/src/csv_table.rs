//! Comma-separated tables as lines of cells, with the place of every cell.

use fluorspar::quote::excerpt;
use std::path::Path;

use super::FormatError;
use super::file::{MAX_TEXT_BYTES, as_text, read_file};

/// One line of a table.
pub(super) struct Row {
    /// Line in the file, from 1.
    pub(super) line: u64,
    pub(super) cells: Vec<String>,
}

/// A header line and the lines below it, all of one length.
pub(super) struct Table {
    pub(super) header: Row,
    pub(super) rows: Vec<Row>,
    /// Text of the comment lines, without `#`.
    pub(super) comments: Vec<(u64, String)>,
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
    /// Reads a table whose cells are separated by commas, tabs or semicolons (whichever the header line uses).
    /// Lines that begin with `#` are comments.
    pub(super) fn read(path: &Path) -> Result<Self, FormatError> {
        let bytes = read_file(path, MAX_TEXT_BYTES)?;
        Self::parse(path, as_text(path, &bytes)?)
    }

    fn parse(path: &Path, text: &str) -> Result<Self, FormatError> {
        let lines = || text.lines().enumerate().map(|(index, line)| (index as u64 + 1, line.trim()));
        let comments = lines()
            .filter_map(|(number, line)| line.strip_prefix('#').map(|text| (number, text.trim().to_string())))
            .collect();
        let header = lines().map(|(_, line)| line).find(|line| !line.is_empty() && !line.starts_with('#'));
        let delimiter = match header {
            Some(line) if line.contains(',') => b',',
            Some(line) if line.contains('\t') => b'\t',
            Some(line) if line.contains(';') => b';',
            _ => b',',
        };
        // Line by line: a quoted cell may not run over several lines, and every cell keeps its place.
        let mut rows = Vec::new();
        for (number, line) in lines().filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
            let mut reader = csv::ReaderBuilder::new()
                .has_headers(false)
                .trim(csv::Trim::All)
                .delimiter(delimiter)
                .buffer_capacity(line.len().clamp(64, 8192))
                .from_reader(line.as_bytes());
            let mut record = csv::StringRecord::new();
            reader.read_record(&mut record).map_err(|error| {
                FormatError::at_line(
                    path,
                    number,
                    format!("this line can't be read: {error}"),
                    "Save it as CSV",
                )
            })?;
            if !record.iter().all(str::is_empty) {
                rows.push(Row { line: number, cells: record.iter().map(String::from).collect() });
            }
        }
        if rows.is_empty() {
            return Err(FormatError::malformed(
                path,
                "the file holds no table",
                "Give a header line and lines of numbers",
            ));
        }
        let header = rows.remove(0);
        for row in &rows {
            if row.cells.len() != header.cells.len() {
                return Err(FormatError::at_line(
                    path,
                    row.line,
                    format!(
                        "this line has {} cells but the header has {}",
                        row.cells.len(),
                        header.cells.len()
                    ),
                    "Give every line one cell per column",
                ));
            }
        }
        if rows.is_empty() {
            return Err(FormatError::at_line(
                path,
                header.line,
                "the file ends after the header line",
                "Give at least two lines of numbers",
            ));
        }
        Ok(Self { header, rows, comments })
    }

    /// Name of a column for messages: its header, or its number where the header is empty.
    pub(super) fn column_name(&self, column: usize) -> String {
        match self.header.cells[column].as_str() {
            "" => format!("number {}", column + 1),
            name => format!("\"{}\"", excerpt(name)),
        }
    }

    /// The number in a cell; `None` where the cell is empty.
    pub(super) fn number(&self, path: &Path, row: &Row, column: usize) -> Result<Option<f64>, FormatError> {
        let text = row.cells[column].as_str();
        if text.is_empty() {
            return Ok(None);
        }
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value)),
            Ok(_) => Err(FormatError::at_line(
                path,
                row.line,
                format!("column {} holds {}", self.column_name(column), excerpt(text)),
                "Every value must be a finite number: remove the line or leave the cell empty and skip empty cells",
            )),
            Err(_) if text.contains(',') => Err(FormatError::at_line(
                path,
                row.line,
                format!(
                    "column {} holds \"{}\", which is not a number",
                    self.column_name(column),
                    excerpt(text)
                ),
                "Write decimals with a point",
            )),
            Err(_) => Err(FormatError::at_line(
                path,
                row.line,
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
    pub(super) fn checked_sign(
        &self,
        path: &Path,
        row: &Row,
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
            Negative::Refuse => Err(FormatError::at_line(
                path,
                row.line,
                format!("column {} holds {value}, below zero", self.column_name(column)),
                "Subtract the background correctly, or allow or clip negative values on purpose",
            )),
        }
    }
}
