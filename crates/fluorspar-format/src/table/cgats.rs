//! Spectra of CGATS (`.txt`, `.ti3`, `.sp`): a line for each sample, with a field for each wavelength.

use std::path::Path;

use super::instrument_text::TextTable;
use crate::FormatError;

/// Values of reflectances above which they are percent.
const LARGEST_FRACTION: f64 = 2.0;

/// Whether a text is a table of CGATS.
pub(crate) fn is_cgats(text: &str) -> bool {
    text.lines().any(|line| line.trim() == "BEGIN_DATA_FORMAT")
}

/// The first table with spectra, with a column for each of its samples.
pub(crate) fn cgats_table(path: &Path, text: &str) -> Result<TextTable, FormatError> {
    let within = |name: &str| -> Vec<(u64, &str)> {
        let lines = (1..).zip(text.lines().map(str::trim));
        let from = lines.skip_while(|(_, line)| *line != format!("BEGIN_{name}")).skip(1);
        let held = from.take_while(|(_, line)| *line != format!("END_{name}"));
        held.filter(|(_, line)| !line.is_empty() && !line.starts_with('#')).collect()
    };
    let fields: Vec<&str> =
        within("DATA_FORMAT").iter().flat_map(|(_, line)| line.split_whitespace()).collect();
    let spectrum: Vec<(usize, &str)> =
        fields.iter().enumerate().filter_map(|(place, field)| Some((place, wavelength(field)?))).collect();
    let is_id = |field: &&str| field.starts_with("SAMPLE");
    let id = fields.iter().position(|field| *field == "SAMPLE_NAME").or(fields.iter().position(is_id));
    let mut samples: Vec<(u64, Vec<&str>)> = Vec::new();
    for (number, line) in within("DATA") {
        match samples.last_mut().filter(|(_, cells)| cells.len() < fields.len()) {
            // A sample may go on in the next line
            Some((_, cells)) => cells.extend(cells_of(line)),
            None => samples.push((number, cells_of(line))),
        }
    }
    let Some(first) = samples.first().map(|(line, _)| *line).filter(|_| spectrum.len() > 1) else {
        let what = "this CGATS file holds no spectra, whose fields would be SPEC_380, SPEC_390 and so on";
        return Err(FormatError::unsupported(path, what, "Export spectra, not colors or densities"));
    };
    if let Some((line, cells)) = samples.iter().find(|(_, cells)| cells.len() != fields.len()) {
        let what =
            format!("this sample has {} cells but the format has {} fields", cells.len(), fields.len());
        return Err(FormatError::at_line(path, *line, what, "Export the file again"));
    }
    let values = || spectrum.iter().flat_map(|(place, _)| samples.iter().map(|(_, cells)| cells[*place]));
    let is_percent = values().filter_map(|cell| cell.parse().ok()).any(|value: f64| value > LARGEST_FRACTION);
    let unit = if is_percent { " (%)" } else { "" };
    let names = (1..).zip(&samples).map(|(number, (_, cells))| match id {
        Some(place) => format!("{}{unit}", cells[place]),
        None => format!("sample {number}{unit}"),
    });
    let row = |(place, nm): &(usize, &str)| {
        let values = samples.iter().map(|(_, cells)| cells[*place].to_string());
        (first, std::iter::once(nm.to_string()).chain(values).collect())
    };
    Ok(TextTable {
        mixed: None,
        header_line: first,
        header: std::iter::once("wavelength_nm".into()).chain(names).collect(),
        rows: spectrum.iter().map(row).collect(),
        preamble: Vec::new(),
        read_as: vec!["CGATS".into()],
    })
}

/// Cells between blanks, some of them in quotation marks.
fn cells_of(line: &str) -> Vec<&str> {
    let mut is_quoted = false;
    let split = line.split(|c: char| {
        is_quoted ^= c == '"';
        c.is_whitespace() && !is_quoted
    });
    split.filter(|cell| !cell.is_empty()).map(|cell| cell.trim_matches('"')).collect()
}

/// The wavelength of a field, nm: of `SPEC_380`, `SPECTRAL_NM380`, `nm380`.
fn wavelength(field: &str) -> Option<&str> {
    let nm = field.trim_start_matches(|c: char| !c.is_ascii_digit());
    let upper = field[..field.len() - nm.len()].to_uppercase();
    let is_spectral = ["SPEC", "NM", "R_", "WL"].iter().any(|start| upper.starts_with(start));
    (is_spectral && nm.parse::<f64>().is_ok_and(|nm| (100.0..=3000.0).contains(&nm))).then_some(nm)
}
