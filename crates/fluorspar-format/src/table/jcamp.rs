//! Spectra of JCAMP-DX, version 4.24 and later: tables of pairs, and of evenly spaced values as plain numbers.

use std::path::Path;

use super::instrument_text::TextTable;
use crate::FormatError;

/// What a block says of its table.
struct Block {
    x_units: String,
    y_units: String,
    x_factor: f64,
    y_factor: f64,
    first_x: Option<f64>,
    last_x: Option<f64>,
    points: Option<f64>,
}

impl Block {
    fn new() -> Self {
        let none = String::new;
        Self {
            x_units: none(),
            y_units: none(),
            x_factor: 1.0,
            y_factor: 1.0,
            first_x: None,
            last_x: None,
            points: None,
        }
    }

    fn take(&mut self, label: &str, value: &str) {
        let number = || value.replace(',', ".").parse::<f64>().ok();
        match label {
            "XUNITS" => self.x_units = value.into(),
            "YUNITS" => self.y_units = value.into(),
            "XFACTOR" => self.x_factor = number().unwrap_or(1.0),
            "YFACTOR" => self.y_factor = number().unwrap_or(1.0),
            "FIRSTX" => self.first_x = number(),
            "LASTX" => self.last_x = number(),
            "NPOINTS" => self.points = number(),
            _ => {}
        }
    }

    /// Step between values of an evenly spaced table.
    fn step(&self) -> Option<f64> {
        let (first, last, points) = (self.first_x?, self.last_x?, self.points?);
        (points > 1.0).then(|| (last - first) / (points - 1.0))
    }
}

/// The table of a file that says that it was processed, or else the last: spectrometers write sample, dark and reference beside
/// the spectrum that they computed.
pub(crate) fn jcamp_table(path: &Path, text: &str) -> Result<TextTable, FormatError> {
    let mut tables: Vec<TextTable> = Vec::new();
    let mut processed = None;
    let mut is_processed = false;
    let mut block = Block::new();
    let mut lines = text.lines().enumerate().map(|(index, line)| (index as u64 + 1, line)).peekable();
    while let Some((number, line)) = lines.next() {
        let plain = line.split("$$").next().unwrap_or_default();
        let Some((label, value)) = plain.trim().strip_prefix("##").and_then(|rest| rest.split_once('='))
        else {
            continue;
        };
        let label: String = label.to_uppercase().chars().filter(|c| c.is_ascii_alphanumeric()).collect();
        match label.as_str() {
            "TITLE" => {
                block = Block::new();
                is_processed = value.to_uppercase().contains("PROCESSED");
            }
            "XYDATA" | "XYPOINTS" | "PEAKTABLE" => {
                let mut rows = Vec::new();
                while let Some((number, line)) = lines.next_if(|(_, line)| !line.trim().starts_with("##")) {
                    let plain = line.split("$$").next().unwrap_or_default().trim();
                    if !plain.is_empty() {
                        push(path, &block, value.contains("++"), number, plain, &mut rows)?;
                    }
                }
                processed = processed.or(is_processed.then_some(tables.len()));
                tables.push(TextTable {
                    mixed: None,
                    header_line: number,
                    header: vec![format!("wavelength {}", block.x_units), block.y_units.clone()],
                    rows,
                    preamble: Vec::new(),
                    read_as: Vec::new(),
                });
            }
            _ => block.take(&label, value.trim()),
        }
    }
    let count = tables.len();
    let place = processed.unwrap_or(count.saturating_sub(1));
    let mut table =
        tables.into_iter().nth(place).filter(|table| !table.rows.is_empty()).ok_or_else(|| {
            FormatError::unsupported(
                path,
                "this JCAMP-DX file holds no table XYDATA, XYPOINTS or PEAK TABLE",
                "Export the spectrum as text (CSV)",
            )
        })?;
    table.read_as.push(if count > 1 {
        format!("JCAMP-DX, spectrum {} of {count}", place + 1)
    } else {
        "JCAMP-DX".into()
    });
    Ok(table)
}

/// Appends the samples of a line.
fn push(
    path: &Path,
    block: &Block,
    is_evenly_spaced: bool,
    line: u64,
    text: &str,
    rows: &mut Vec<(u64, Vec<String>)>,
) -> Result<(), FormatError> {
    let wrong = |what: &str| {
        Err(FormatError::at_line(
            path,
            line,
            what,
            "Export the spectrum as text (CSV), or as pairs (XYPOINTS)",
        ))
    };
    let number = |cell: &str| cell.replace(',', ".").parse::<f64>().ok();
    let mut add = |x: f64, y: f64| {
        rows.push((line, vec![(x * block.x_factor).to_string(), (y * block.y_factor).to_string()]))
    };
    if is_evenly_spaced {
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(number).collect();
        let (Some([x, values @ ..]), Some(step)) = (numbers.as_deref(), block.step()) else {
            return wrong("this line of XYDATA is compressed, or FIRSTX, LASTX or NPOINTS is missing");
        };
        for (place, y) in values.iter().enumerate() {
            add(x + place as f64 * step / block.x_factor, *y);
        }
        return Ok(());
    }
    // Pairs stand between semicolons or blanks; a comma separates x and y, or writes decimals where blanks do
    for pair in text.split(';').map(str::trim).filter(|pair| !pair.is_empty()) {
        let by_blanks: Vec<&str> = pair.split_whitespace().map(|cell| cell.trim_end_matches(',')).collect();
        let by_commas: Vec<&str> = pair.split(',').map(str::trim).collect();
        let cells = if by_commas.len() == 2
            && by_blanks.len() < 3
            && !(by_blanks.len() == 2 && pair.contains(' ') && !pair.contains(", "))
        {
            by_commas
        } else {
            by_blanks
        };
        let numbers: Option<Vec<f64>> = cells.iter().map(|cell| number(cell)).collect();
        // A comma within each pair, blanks between them
        let parted = || {
            let halves = cells.iter().map(|cell| cell.split_once(',')).collect::<Option<Vec<_>>>()?;
            halves.into_iter().flat_map(|(x, y)| [x, y]).map(|half| half.parse().ok()).collect()
        };
        match numbers.or_else(parted).as_deref() {
            Some(pairs) if !pairs.is_empty() && pairs.len().is_multiple_of(2) => {
                pairs.chunks(2).for_each(|pair| add(pair[0], pair[1]));
            }
            _ => return wrong("this line holds no pairs of numbers"),
        }
    }
    Ok(())
}
