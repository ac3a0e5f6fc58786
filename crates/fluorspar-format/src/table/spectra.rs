//! Spectra as tables: of this program's form, and as instruments and other programs write them.

use fluorspar::quote::excerpt;
use fluorspar::spectral::Curve;
use fluorspar::units::counted;
use std::path::Path;

use super::axis::check_axis;
use super::cgats::{cgats_table, is_cgats};
use super::csv_table::{Header, Negative, Row, Table, comments_of};
use super::instrument_text::{TextTable, find_table, has_other_nm, instrument_text, names_wavelengths};
use super::jcamp::jcamp_table;
use super::mat::read_mat_spectra;
use super::spectrometer::{PLAUSIBLE, RawColumns, RawRow, ratio, without_noisy_ends};
use super::tm27::tm27_table;
use super::value_unit::{
    Conversion, SpectrumQuantity, StatedUnit, ValueUnit, factor_of, is_relative, lengths_of, stated_unit,
};
use crate::FormatError;
use crate::error::shortened_list;
use crate::store::file::{MAX_TEXT_BYTES, read_file};

/// Which columns of values to read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum SpectrumColumns {
    /// All of them.
    #[default]
    All,
    /// The only one, or that which an instrument computed from its others, or else the first; which, is told.
    One,
    /// Those with these headers, in this order.
    Named(Vec<String>),
}

/// How to read a table of spectra. The default reads every column as stored and refuses negative values and empty cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SpectrumOptions {
    /// Which columns.
    pub columns: SpectrumColumns,
    /// What the values are converted to.
    pub quantity: SpectrumQuantity,
    /// Unit of the values, whatever the file says of it.
    pub unit: Option<ValueUnit>,
    /// Treatment of negative values. Where they are refused, those of a converted quantity that are noise about 0 become 0.
    pub negative: Negative,
    /// Leave out samples whose cell is empty, column by column, instead of refusing them.
    pub skip_empty_cells: bool,
}

/// One column of a table of spectra.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCurve {
    /// Header of the column.
    pub name: String,
    /// The spectrum.
    pub curve: Curve,
    /// Its standard error, of a column beside it that says so.
    pub standard_error: Option<Curve>,
}

/// Spectra of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredSpectra {
    /// One per column, one at least.
    pub curves: Vec<NamedCurve>,
    /// What was taken of the file, and as what, in words; empty for a plain table in the wanted unit.
    pub read_as: Vec<String>,
}

/// Share of the largest value, or of the sum of all above 0, up to which values below 0 are noise.
pub(crate) const NOISE: f64 = 0.03;
/// Samples before and behind one of those many, over which noise averages out.
const NOISE_WITHIN: usize = 10;
/// Largest quantum efficiency: below 300 nm a photon may free two electrons.
const LARGEST_EFFICIENCY: f64 = 2.0;
/// Values of a wavelength, nm, where no header says that it is one.
const PLAUSIBLE_NM: std::ops::RangeInclusive<f64> = 150.0..=3000.0;
/// The longest, nm, of sunlight, which begins below 380 nm: infrared spectra in 1/cm do not.
const LONGEST_OF_SUNLIGHT_NM: f64 = 4500.0;
/// Wavelengths in micrometers: of none is it so few nm.
const MICROMETERS: std::ops::RangeInclusive<f64> = 0.15..=30.0;
/// Share of a wavelength within which another is that of the same band.
const NEAR: f64 = 0.05;
/// Share of the largest value within which values are as low as the lowest.
const LEVEL: f64 = 0.02;
/// Share of the largest value below which no light at all is left where it has none.
const LEAST_PEDESTAL: f64 = 0.05;
/// Optical density beside which one of 0 is none.
const LEAST_OPAQUE: f64 = 2.0;
/// Share of the lines that may give a wavelength once more: curves read off a figure do where they are steep.
const MOST_DOUBLED: f64 = 0.1;
/// Wavelengths in nm where a line above the table states their unit.
const STATED_NM: std::ops::RangeInclusive<f64> = 100.0..=20_000.0;

/// Reads spectra from a text file, a MATLAB file of ISET (`.mat`), JCAMP-DX, IES TM-27 (`.spdx`), or CGATS.
///
/// A text is read as instruments and spreadsheets write it: cells between commas, semicolons, tabs or blanks, decimals with a point or a comma,
/// lines about the instrument above and below, wavelengths in either direction. The header names the wavelengths and their unit (nm
/// where it is missing and the values are between 150 and 3000), and the unit of the values, which become the wanted quantity:
/// percent, optical density, decibels, A/W, photons, counts. Columns of standard errors go with the column before them.
///
/// # Errors
/// Anything that is not such a table, a unit that isn't known or isn't of the quantity, with file, line and column.
pub fn read_spectra(path: &Path, options: &SpectrumOptions) -> Result<MeasuredSpectra, FormatError> {
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("mat")) {
        return matlab_spectra(path, options);
    }
    let (table, read_as, preamble) = text_table(path)?;
    SpectrumReader { path, table: &table, preamble: &preamble, options, read_as }.read()
}

/// Line and cells of the header of a table in a text file.
pub(crate) fn headers_of(path: &Path) -> Result<(Header, Vec<(u64, String)>), FormatError> {
    let Table { header, comments, .. } = text_table(path)?.0;
    Ok((header, comments))
}

/// The table of a text file, what it has otherwise than a plain one, and the lines above it.
fn text_table(path: &Path) -> Result<(Table, Vec<String>, Vec<String>), FormatError> {
    let bytes = read_file(path, MAX_TEXT_BYTES)?;
    let text = instrument_text(path, &bytes)?;
    Ok(match foreign_table(path, &text)? {
        Some(TextTable { header_line, header, rows, preamble, read_as, .. }) => {
            let header = Header { line: header_line, cells: header };
            (Table::of_rows(path, header, rows, comments_of(&text))?, read_as, preamble)
        }
        None => (Table::parse(path, &text)?, Vec::new(), Vec::new()),
    })
}

/// The table of a file in a form of its own, or found among lines of text.
fn foreign_table(path: &Path, text: &str) -> Result<Option<TextTable>, FormatError> {
    let start = text.trim_start();
    if start.starts_with("##") {
        return jcamp_table(path, text).map(Some);
    }
    if start.starts_with('<') && text.contains("SpectralData") {
        return tm27_table(path, text).map(Some);
    }
    let is_page = ["<html", "<!doctype html"].iter().any(|mark| text_starts_with(start, mark));
    if is_page {
        let hint = "Copy its table into a text file, with a line such as \"wavelength_nm,transmittance\" above the numbers";
        return Err(FormatError::unsupported(path, "this is an HTML page, not a table", hint));
    }
    if start.starts_with('<') {
        return tm27_table(path, text).map(Some);
    }
    if is_cgats(text) {
        return cgats_table(path, text).map(Some);
    }
    for (mark, of) in [("PE ", "Perkin-Elmer (PEDS)"), ("Date Saved,", "a Sekonic spectrometer")] {
        if start.starts_with(mark) && (text.contains("PEDS") || text.contains("Spectral Data ")) {
            let hint = "Export it as a table, or write one: below a line such as \"wavelength_nm,power\" the wavelengths and their values";
            return Err(FormatError::unsupported(
                path,
                format!("this is a file of {of}, in a form that isn't read"),
                hint,
            ));
        }
    }
    let table = find_table(text);
    table.as_ref().map_or(Ok(()), |table| table.refuse_doubtful_commas(path))?;
    Ok(table)
}

fn text_starts_with(text: &str, mark: &str) -> bool {
    text.get(..mark.len()).is_some_and(|start| start.eq_ignore_ascii_case(mark))
}

fn matlab_spectra(path: &Path, options: &SpectrumOptions) -> Result<MeasuredSpectra, FormatError> {
    let spectra = read_mat_spectra(path)?;
    let count = spectra.curves.len();
    let rows_of = |curve: &Curve| -> Vec<(u64, Vec<String>)> {
        let samples = curve.wavelengths_nm().iter().zip(curve.values());
        samples.map(|(nm, value)| (0, vec![nm.to_string(), value.to_string()])).collect()
    };
    let mut curves = Vec::with_capacity(count);
    let mut read_as = Vec::new();
    for (number, curve) in (1..).zip(&spectra.curves) {
        let header = Header { line: 0, cells: vec!["wavelength_nm".into(), format!("{number}")] };
        let table = Table::of_rows(path, header, rows_of(curve), Vec::new())?;
        let reader = SpectrumReader { path, table: &table, preamble: &[], options, read_as: Vec::new() };
        let columns = [ValueColumn { axis: 0, start: None, values: 1, error: None }];
        let read = reader.read_columns(Axes { scale_to_nm: AxisUnit::Nanometers }, &columns)?;
        read_as.extend(read.read_as.into_iter().filter(|_| number == 1));
        curves.extend(read.curves);
    }
    let wanted: Vec<usize> = match &options.columns {
        SpectrumColumns::All => (0..count).collect(),
        SpectrumColumns::One => vec![0],
        SpectrumColumns::Named(names) => {
            let place =
                |name: &String| name.parse::<usize>().ok().filter(|number| (1..=count).contains(number));
            let found = names.iter().map(|name| {
                place(name).map(|number| number - 1).ok_or_else(|| {
                    let what = format!("there is no column \"{}\"", excerpt(name));
                    let columns = counted(count, "column", "columns");
                    FormatError::malformed(path, what, format!("\"data\" has {columns}; they count from 1"))
                })
            });
            found.collect::<Result<_, _>>()?
        }
    };
    if options.columns == SpectrumColumns::One && count > 1 {
        read_as.push(format!("column 1 of {count}"));
    }
    let curves = wanted.into_iter().filter_map(|place| curves.get(place).cloned()).collect();
    Ok(MeasuredSpectra { curves, read_as })
}

/// Unit of a column of wavelengths.
#[derive(Clone, Copy, PartialEq, Eq)]
enum AxisUnit {
    Nanometers,
    Micrometers,
    Meters,
    Angstroms,
    Wavenumbers,
    ElectronVolts,
}

impl AxisUnit {
    fn in_nm(self, value: f64) -> f64 {
        match self {
            Self::Nanometers => value,
            Self::Micrometers => 1e3 * value,
            Self::Meters => 1e9 * value,
            Self::Angstroms => 0.1 * value,
            Self::Wavenumbers => 1e7 / value,
            Self::ElectronVolts => 1_239.841_984 / value,
        }
    }

    fn in_words(self) -> Option<&'static str> {
        Some(match self {
            Self::Nanometers => return None,
            Self::Micrometers => "wavelengths in micrometers",
            Self::Meters => "wavelengths in meters",
            Self::Angstroms => "wavelengths in angstroms",
            Self::Wavenumbers => "wavenumbers in 1/cm",
            Self::ElectronVolts => "photon energies in eV",
        })
    }

    /// The unit that a text names.
    fn named(text: &str) -> Option<Self> {
        let lower = text.to_lowercase();
        let words: Vec<&str> =
            lower.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
        let has = |names: &[&str]| words.iter().any(|word| names.iter().any(|name| word == name));
        let starts = |name: &str| words.iter().any(|word| word.starts_with(name));
        // Wavelengths in A; "(A)" and "[A]" stand for nothing else behind that word
        let is_angstrom = starts("wave") && ["(a)", "[a]"].iter().any(|unit| lower.ends_with(unit));
        if has(&["nm"]) || starts("nanomet") {
            Some(Self::Nanometers)
        } else if has(&["um", "µm", "μm", "micron", "microns"]) || starts("micromet") {
            Some(Self::Micrometers)
        } else if has(&["cm", "wavenumber", "wavenumbers"]) {
            Some(Self::Wavenumbers)
        } else if has(&["ev"]) {
            Some(Self::ElectronVolts)
        } else if has(&["m"]) || starts("meter") || starts("metre") {
            Some(Self::Meters)
        } else if is_angstrom || has(&["å", "aa"]) || starts("angstr") || starts("ångstr") {
            Some(Self::Angstroms)
        } else {
            None
        }
    }
}

/// What the columns of wavelengths hold.
#[derive(Clone, Copy)]
struct Axes {
    scale_to_nm: AxisUnit,
}

/// A column of values, with that of its wavelengths and that of its standard errors.
#[derive(Clone, Copy)]
struct ValueColumn {
    axis: usize,
    /// Column of the lower edges of bands, where the axis has the upper ones.
    start: Option<usize>,
    values: usize,
    error: Option<usize>,
}

struct SpectrumReader<'a> {
    path: &'a Path,
    table: &'a Table,
    preamble: &'a [String],
    options: &'a SpectrumOptions,
    read_as: Vec<String>,
}

impl SpectrumReader<'_> {
    fn read(mut self) -> Result<MeasuredSpectra, FormatError> {
        self.refuse_matrix()?;
        if self.table.header.cells.len() < 2 {
            return Err(self.in_header(
                "there is only a wavelength column",
                "Give at least one column of values; cells are separated by commas",
            ));
        }
        let axis = self.first_axis()?;
        let unit = self.axis_unit(axis)?;
        let columns = self.value_columns(axis);
        let is_used = |column: usize| columns.iter().any(|of| of.axis == column || of.start == Some(column));
        let mut others = (0..self.headers().len()).filter(|column| !is_used(*column));
        let beside = others.find(|column| is_used(axis) && self.is_beside(axis, *column));
        let [named, other] = [axis, beside.unwrap_or(axis)].map(|column| self.table.column_name(column));
        self.say(beside.map(|_| format!("{named} as wavelengths, not {other}")));
        let chosen = self.chosen(&columns)?;
        // Who names a column knows what it holds, as of a mirror that stands for a filter
        if !matches!(self.options.columns, SpectrumColumns::Named(_)) {
            chosen.iter().try_for_each(|column| self.refuse_reflectance(column.values))?;
        }
        self.read_columns(Axes { scale_to_nm: unit }, &chosen)
    }

    fn headers(&self) -> &[String] {
        &self.table.header.cells
    }

    fn in_header(&self, what: impl Into<String>, hint: impl Into<String>) -> FormatError {
        FormatError::at_line(self.path, self.table.header.line, what, hint)
    }

    fn refuse_matrix(&self) -> Result<(), FormatError> {
        let header = self.headers()[0].as_str();
        if !header.contains('\\') {
            return Ok(());
        }
        Err(self.in_header(
            format!("the first cell is \"{}\": this is an excitation-emission matrix", excerpt(header)),
            "Read it as a matrix, or give a first column \"wavelength_nm\"",
        ))
    }

    /// The first column of wavelengths: by its name, or else the first whose values go one way and may be wavelengths.
    fn first_axis(&mut self) -> Result<usize, FormatError> {
        let is_index = |header: &str| {
            let lower = header.to_lowercase();
            ["pixel", "index", "bandwidth", "fwhm", "frequency", "raman shift", "time"]
                .iter()
                .any(|word| lower.starts_with(word))
                || ["thz", "mev"].iter().any(|unit| lower.contains(unit))
        };
        let headers = self.headers();
        if let Some(named) = headers.iter().position(|header| names_wavelengths(header) && !is_index(header))
        {
            return Ok(named);
        }
        let names_unit =
            |header: &String| AxisUnit::named(header).is_some() && !is_index(header) && !has_other_nm(header);
        if let Some(named) = headers.iter().position(names_unit) {
            return Ok(named);
        }
        let stated = self.axis_unit_above();
        let unit = stated.unwrap_or(AxisUnit::Nanometers);
        let range_nm = if stated.is_some() { STATED_NM } else { PLAUSIBLE_NM };
        let is_headless = headers.iter().all(String::is_empty);
        let plausible = |column: &usize| {
            let numbers: Vec<f64> = self
                .table
                .rows()
                .filter_map(|row| self.table.number(self.path, row, *column).ok().flatten())
                .map(|value| unit.in_nm(value))
                .collect();
            let least = if is_headless { 0.85 } else { 1.0 };
            let steps = |goes: fn(&[f64]) -> bool| {
                numbers.windows(2).filter(|pair| goes(pair)).count() as f64
                    >= least * numbers.len().saturating_sub(1) as f64
            };
            let rises = || steps(|pair| pair[0] < pair[1]);
            let falls = || steps(|pair| pair[0] > pair[1]);
            // Curves that were read off a figure
            let is_x = || {
                headers[*column].split_whitespace().last().is_some_and(|word| word.eq_ignore_ascii_case("x"))
            };
            numbers.len() == self.table.row_count()
                && !is_index(&headers[*column])
                && (numbers.iter().all(|value| range_nm.contains(value)) || is_of_sunlight(&numbers))
                && (rises() || falls() || is_x())
        };
        // Two lines are too few to tell
        let few = !is_headless && self.table.row_count() < 8;
        let found = (0..headers.len()).find(plausible).filter(|_| !few);
        match found {
            Some(column)
                if is_headless
                    && self.table.row_count() >= 8
                    && headers.len() > column + 2
                    && plausible(&(column + 1))
                    && !self.are_bands(column) =>
            {
                Err(FormatError::at_line(
                    self.path,
                    self.table.line_of(0),
                    format!("columns {} and {} may both be wavelengths", column + 1, column + 2),
                    "Put a line above the numbers that names every column, such as \"pixel,wavelength_nm,counts\", or \"start_nm,end_nm,power\" of bands",
                ))
            }
            Some(column) => {
                let name = match self.headers()[column].as_str() {
                    "" => format!("column {}", column + 1),
                    header => format!("\"{}\"", excerpt(header)),
                };
                self.read_as.push(format!("{name} as wavelengths"));
                Ok(column)
            }
            None if is_headless => Err(FormatError::at_line(
                self.path,
                self.table.line_of(0),
                "no line names the columns, and none holds wavelengths between 150 and 3000 nm that rise or fall",
                "Put a line such as \"wavelength_nm,transmittance\" above the numbers",
            )),
            None => Err(self.in_header(
                format!("the first column is \"{}\", not a wavelength", excerpt(&self.headers()[0])),
                "Put the wavelength first and call it \"wavelength_nm\"",
            )),
        }
    }

    /// Unit of the wavelengths: of their header, or of a line above the table.
    fn axis_unit(&mut self, axis: usize) -> Result<AxisUnit, FormatError> {
        let header = &self.headers()[axis];
        let lower = header.to_lowercase();
        let is_reciprocal = ["1/", "-1", "⁻¹"].iter().any(|mark| lower.contains(mark));
        if is_reciprocal && lengths_of(&lower).iter().any(|mm| *mm != 10.0) {
            let what = format!("the wavelengths are \"{}\", whose unit isn't known here", excerpt(header));
            return Err(self.in_header(what, "Give them in nm, or as wavenumbers in 1/cm"));
        }
        let stated = AxisUnit::named(header).or_else(|| self.axis_unit_above());
        let unit = match stated {
            Some(unit) => unit,
            None => self.likely_axis_unit(axis)?,
        };
        self.read_as.extend(unit.in_words().map(String::from));
        Ok(unit)
    }

    /// Unit of wavelengths that no header states: nanometers, unless they are too short or too long for it.
    fn likely_axis_unit(&self, axis: usize) -> Result<AxisUnit, FormatError> {
        let rows = self.table.rows();
        let numbers: Vec<f64> =
            rows.filter_map(|row| self.table.number(self.path, row, axis).ok().flatten()).collect();
        if !numbers.is_empty() && numbers.iter().all(|value| MICROMETERS.contains(value)) {
            return Ok(AxisUnit::Micrometers);
        }
        let (low, high) = numbers.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(*v), h.max(*v)));
        let is_unclear = low >= 100.0 && high > *PLAUSIBLE_NM.end() && !is_of_sunlight(&numbers);
        if is_unclear && high <= 20_000.0 {
            return Err(self.in_header(
                format!("the wavelengths run from {low} to {high} without a unit"),
                "Write the unit into the header of the column: \"wavelength (nm)\", \"wavelength (angstrom)\", \"wavenumber (cm-1)\"",
            ));
        }
        Ok(AxisUnit::Nanometers)
    }

    /// Unit of the wavelengths, of a line above the table that speaks of units.
    fn axis_unit_above(&self) -> Option<AxisUnit> {
        let is_about = |line: &&String| {
            let lower = line.to_lowercase();
            lower.contains("unit") && (lower.contains("wavelength") || lower.starts_with('x'))
        };
        self.preamble.iter().filter(is_about).find_map(|line| AxisUnit::named(line))
    }

    /// Columns of values: all but wavelengths, other axes and standard errors.
    fn value_columns(&self, first_axis: usize) -> Vec<ValueColumn> {
        let mut columns: Vec<ValueColumn> = Vec::new();
        let (mut axis, mut start) = (first_axis, None);
        let is_filled = |column: usize| self.table.rows().any(|row| !self.table.cell(row, column).is_empty());
        for (column, header) in self.headers().iter().enumerate() {
            let lower = header.to_lowercase();
            let is_other_axis = [
                "pixel",
                "index",
                "no.",
                "nr.",
                "wavenumber",
                "raman shift",
                "frequency",
                "bandwidth",
                "fwhm",
                "slit width",
            ]
            .iter()
            .any(|word| lower.starts_with(word));
            // Those of a band, side by side
            let are_edges = column == axis + 1
                && (is_edge(&self.headers()[axis]) && is_edge(header) || self.are_bands(axis));
            if column == first_axis || ((names_wavelengths(header) || are_edges) && self.is_axis(column)) {
                start = are_edges.then_some(axis);
                axis = column;
            } else if is_other_axis
                || self.is_beside(axis, column)
                || (header.is_empty() && (column < first_axis || !is_filled(column)))
            {
            } else if is_standard_error(&lower) {
                if let Some(last) = columns.last_mut() {
                    last.error = Some(column);
                }
            } else {
                columns.push(ValueColumn { axis, start, values: column, error: None });
            }
        }
        if columns.iter().any(|column| !self.is_text(column.values)) {
            columns.retain(|column| !self.is_text(column.values));
        }
        columns
    }

    /// Whether a column holds no number, but words: names of samples, dates, remarks.
    fn is_text(&self, column: usize) -> bool {
        let cells = || self.table.rows().map(|row| self.table.cell(row, column));
        // "90 %" is a value with a unit
        let begins_as_number = |cell: &str| {
            cell.trim_start_matches(['-', '+', '<', '>', '.', ' ']).starts_with(|c: char| c.is_ascii_digit())
        };
        cells().any(|cell| cell.contains(char::is_alphanumeric)) && !cells().any(begins_as_number)
    }

    /// Whether a column that is called a wavelength holds some.
    fn is_axis(&self, column: usize) -> bool {
        let numbers =
            self.table.rows().filter_map(|row| self.table.number(self.path, row, column).ok().flatten());
        let unit = AxisUnit::named(&self.headers()[column]).unwrap_or(AxisUnit::Nanometers);
        let mut numbers = numbers.peekable();
        numbers.peek().is_some() && numbers.all(|value| PLAUSIBLE_NM.contains(&unit.in_nm(value)))
    }

    /// Whether a column and the next one hold the edges of bands side by side: each band begins where the one before it ends.
    fn are_bands(&self, start: usize) -> bool {
        let edges = |row| {
            let edge = |column| self.table.number(self.path, row, column).ok().flatten();
            Some([edge(start)?, edge(start + 1)?])
        };
        let Some(bands) = self.table.rows().map(edges).collect::<Option<Vec<_>>>() else { return false };
        bands.len() >= 4
            && bands.windows(2).all(|pair| (pair[0][1] - pair[1][0]).abs() <= 1e-9 * pair[0][1].abs())
    }

    /// Whether a column holds nearly the wavelengths of another, as edges of bands do.
    fn is_beside(&self, axis: usize, column: usize) -> bool {
        let number = |row, column| self.table.number(self.path, row, column).ok().flatten();
        let is_near = |row: Row| {
            let (nm, other) = (number(row, axis), number(row, column));
            nm.zip(other).is_some_and(|(nm, other)| (other - nm).abs() < NEAR * nm)
        };
        self.table.row_count() >= 4 && self.table.rows().all(is_near)
    }

    fn chosen(&mut self, columns: &[ValueColumn]) -> Result<Vec<ValueColumn>, FormatError> {
        // A column without a name is called by its number
        let name_of = |column: &ValueColumn| match self.headers()[column.values].as_str() {
            "" => (column.values + 1).to_string(),
            name => name.to_string(),
        };
        let names: Vec<String> = columns.iter().map(name_of).collect();
        if columns.is_empty() {
            return Err(self.in_header("there is no column of values", "Give one beside the wavelengths"));
        }
        match &self.options.columns {
            SpectrumColumns::All => Ok(columns.to_vec()),
            SpectrumColumns::One => {
                let place = match computed_column(&names) {
                    Some(place) => place,
                    None => self.likely_column(columns, &names)?,
                };
                let name = self.table.column_name(columns[place].values);
                let is_comparison = is_comparison(&names[place]);
                self.read_as.extend(match columns.len() {
                    1 if is_comparison => Some(format!("column {name} as the values: there is no other")),
                    1 => None,
                    _ if self.headers().iter().all(String::is_empty) => {
                        Some(format!("column {name} of {}", self.headers().len()))
                    }
                    _ => Some(format!("column {name} of {}", shortened_list(&names))),
                });
                let is_raw = !is_comparison && RawColumns::is_raw(&names[place]);
                let dark = names.iter().find(|name| is_raw && is_comparison_with_dark(name));
                self.read_as.extend(dark.map(|dark| format!("\"{}\" is not subtracted", excerpt(dark))));
                Ok(vec![columns[place]])
            }
            SpectrumColumns::Named(wanted) => wanted
                .iter()
                .map(|name| {
                    let is_named = |header: &str| header == name;
                    // With or without the unit in brackets
                    let is_short =
                        |header: &str| header.split(['(', '[']).next().unwrap_or("").trim() == name;
                    let exact = names.iter().any(|header| is_named(header));
                    let mut found = columns
                        .iter()
                        .zip(&names)
                        .filter(|(_, header)| if exact { is_named(header) } else { is_short(header) });
                    match (found.next(), found.next()) {
                        (Some((column, _)), None) => Ok(*column),
                        (Some(_), Some(_)) => Err(self.in_header(
                            format!("two columns are called \"{}\"", excerpt(name)),
                            "Give each column its own name",
                        )),
                        _ => self.column_of_color(columns, name).ok_or_else(|| {
                            self.in_header(
                                format!("there is no column \"{}\"", excerpt(name)),
                                format!("Columns are: {}", shortened_list(&names)),
                            )
                        }),
                    }
                })
                .collect(),
        }
    }

    /// The only column of efficiencies whose header has the letter or the color of a channel among its words: "QE_B", "blue channel".
    fn column_of_color(&self, columns: &[ValueColumn], channel: &str) -> Option<ValueColumn> {
        let color =
            [("R", "red"), ("G", "green"), ("B", "blue")].into_iter().find(|(of, _)| *of == channel)?.1;
        let is_of = |word: String| word.eq_ignore_ascii_case(channel) || word == color;
        let mut found = columns.iter().filter(|column| words_of(&self.headers()[column.values]).any(is_of));
        found.next().filter(|_| found.next().is_none()).copied()
    }

    /// The first column behind the wavelengths that is by its name no dark, reference or background.
    fn likely_column(&self, columns: &[ValueColumn], names: &[String]) -> Result<usize, FormatError> {
        let path = self.path.display();
        let of_kinds: Vec<(&str, &str)> =
            names.iter().filter_map(|name| Some((name.as_str(), kind_of(name)?))).collect();
        if let Some((other, _)) = of_kinds.iter().find(|(_, kind)| *kind != of_kinds[0].1) {
            let [first, other] = [of_kinds[0].0, other].map(excerpt);
            return Err(self.in_header(
                format!("columns \"{first}\" and \"{other}\" are of different things"),
                format!("Name the one that is meant: {{ csv = \"{path}\", column = \"{first}\" }} or column = \"{other}\", between apostrophes on a command line"),
            ));
        }
        let rank =
            |place: &usize| (columns[*place].values < columns[*place].axis, is_comparison(&names[*place]));
        let place = (0..columns.len()).min_by_key(rank).unwrap_or(0);
        let is_raw = RawColumns::find(names).is_some_and(|raw| raw.sample == place);
        if is_raw && self.options.quantity.is_fraction() {
            return Err(self.in_header(
                "the columns are what was measured: sample, dark and reference",
                "Export the transmittance or reflectance, or add a column of it: (sample - dark) / (reference - dark)",
            ));
        }
        Ok(place)
    }

    fn read_columns(mut self, axes: Axes, columns: &[ValueColumn]) -> Result<MeasuredSpectra, FormatError> {
        let mut curves = Vec::with_capacity(columns.len());
        for column in columns {
            curves.push(self.read_column(axes, *column)?);
        }
        Ok(MeasuredSpectra { curves, read_as: self.read_as })
    }

    /// What states the unit of a column: its header, or else a line above the table that speaks of units.
    fn words_of_unit(&self, column: usize) -> &str {
        const UNITS: [&str; 7] = ["unit", "(qntm)", "y axis", "y-axis", "yaxis", "in percent", "in %"];
        const QUANTITIES: [&str; 7] = ["transmi", "reflect", "irradi", "absorb", "od", "%t", "%r"];
        let header = self.headers()[column].as_str();
        let is_coefficient = self.options.quantity == SpectrumQuantity::Coefficient;
        let is_about = |line: &&String| {
            let lower = line.trim_start_matches(['#', ' ']).to_lowercase().replace("optical density", "od");
            // Unit 3 is a place
            let is_number = |rest: &str| {
                rest.trim_start_matches('s').trim_start().starts_with(|letter: char| letter.is_ascii_digit())
            };
            let is_named = UNITS.iter().any(|word| {
                lower.split_once(word).is_some_and(|(_, rest)| *word != "unit" || !is_number(rest))
            });
            let is_quantity =
                QUANTITIES.iter().any(|word| lower.starts_with(word)) && is_followed_by_unit(&lower);
            (is_named || is_quantity)
                && !lower.starts_with('x')
                && (matches!(stated_unit(line), StatedUnit::Known(_))
                    || is_coefficient && !lengths_of(&lower).is_empty())
        };
        match stated_unit(header) {
            StatedUnit::Unstated if !is_coefficient || lengths_of(&header.to_lowercase()).is_empty() => {
                self.preamble.iter().find(is_about).map_or(header, String::as_str)
            }
            _ => header,
        }
    }

    /// Refuses a column whose header names what is no transmittance or reflectance, where one of these is wanted.
    fn refuse_other_quantity(&self, column: usize) -> Result<(), FormatError> {
        const OTHERS: [&str; 10] = [
            "absorptance",
            "absorptivity",
            "absorption",
            "extinction",
            "attenuation",
            "density",
            "nd",
            "k/s",
            "1-r",
            "a",
        ];
        let header = self.headers()[column].to_lowercase();
        let mut words = header.split(|c: char| c.is_whitespace() || "([,".contains(c));
        let first = words.next().unwrap_or_default();
        let states = |word: &str| {
            let word = word.trim_matches(|c: char| !c.is_alphanumeric());
            ["t", "r"].contains(&word) || word.starts_with("trans") || word.starts_with("refl")
        };
        let stated = stated_unit(&self.headers()[column]);
        let is_logarithm =
            matches!(stated, StatedUnit::Known(ValueUnit::OpticalDensity | ValueUnit::Decibel));
        // Beside B an A is the name of a sample, as any a is
        let is_b = |other: &String| other == "B" || other.starts_with("B ");
        let is_sample =
            first == "a" && (self.headers()[column].starts_with('a') || self.headers().iter().any(is_b));
        let is_asked =
            self.options.quantity.is_fraction() && !is_sample && !is_logarithm && !words.any(states);
        match OTHERS.iter().find(|other| is_asked && first == **other) {
            None => Ok(()),
            Some(other) => Err(FormatError::unit(
                self.path,
                format!(
                    "column {} is of {other}, not of what passes or comes back",
                    self.table.column_name(column)
                ),
                "Export the transmittance or reflectance",
            )),
        }
    }

    /// Refuses a reflectance where a transmittance is wanted. Beside G an R is red.
    fn refuse_reflectance(&self, column: usize) -> Result<(), FormatError> {
        let is_asked = self.options.quantity == SpectrumQuantity::Transmittance
            && !self.headers().iter().any(|header| header == "G");
        let texts = [self.headers()[column].as_str(), self.words_of_unit(column)];
        if !is_asked || !texts.into_iter().any(is_reflectance) {
            return Ok(());
        }
        let name = self.table.column_name(column);
        let header = excerpt(&self.headers()[column]);
        Err(FormatError::unit(
            self.path,
            format!("column {name} is of what comes back, not of what passes"),
            format!(
                "Export the transmittance; of a mirror, name the column: {{ csv = \"{}\", column = \"{header}\" }}",
                self.path.display()
            ),
        ))
    }

    /// Refuses a responsivity by any of its names without a unit: it may be in A/W, or of another scale.
    fn refuse_responsivity(&self, column: usize) -> Result<(), FormatError> {
        let header = &self.headers()[column];
        let words = words_of(header).collect::<Vec<_>>().join(" ");
        let is_named = ["sensitivit", "spectral respons"].iter().any(|name| words.contains(name));
        let is_responsivity = words.contains("responsiv") || is_named && !is_relative(header);
        let is_asked = self.options.quantity == SpectrumQuantity::QuantumEfficiency && is_responsivity;
        if !is_asked || stated_unit(self.words_of_unit(column)) != StatedUnit::Unstated {
            return Ok(());
        }
        let column = self.table.column_name(column);
        let what = format!(
            "column {column} has no unit: a responsivity has A/W, a quantum efficiency is a fraction"
        );
        Err(FormatError::unit(self.path, what, unit_hint(self.path, ValueUnit::AmperesPerWatt)))
    }

    /// The unit of a column: as given, or as the file says.
    fn unit(&self, column: usize) -> Result<Option<ValueUnit>, FormatError> {
        if self.options.quantity == SpectrumQuantity::Stored {
            return Ok(None);
        }
        if let Some(unit) = self.options.unit {
            return match self.options.quantity.absolute_factor("") {
                Ok(Some(_)) if unit != ValueUnit::Energy => Err(self.not_absolute(column, unit.name())),
                _ => Ok(Some(unit)),
            };
        }
        if let Some(factor) = self.options.quantity.absolute_factor(self.words_of_unit(column)).transpose() {
            return match factor {
                Ok(_) => Ok(None),
                Err(stated) => Err(self.not_absolute(column, &stated)),
            };
        }
        self.refuse_other_quantity(column)?;
        self.refuse_responsivity(column)?;
        match stated_unit(self.words_of_unit(column)) {
            StatedUnit::Known(unit) => Ok(Some(unit)),
            StatedUnit::Unstated => Ok(None),
            StatedUnit::Unknown(unit) => Err(FormatError::unit(
                self.path,
                format!(
                    "column {} is in \"{}\", which isn't known here",
                    self.table.column_name(column),
                    excerpt(&unit)
                ),
                "Export it in %, OD, dB, A/W, photons, counts or W, or write the right unit into the header, as in \"T (%)\"",
            )),
        }
    }

    /// A column of another unit than the absolute one that is wanted.
    fn not_absolute(&self, column: usize, stated: &str) -> FormatError {
        let wanted = self.options.quantity.absolute_unit();
        FormatError::unit(
            self.path,
            format!("column {} is in \"{}\"", self.table.column_name(column), excerpt(stated)),
            format!(
                "Values are taken as they are: convert them to {wanted}, or give their factor as `scale`"
            ),
        )
    }

    fn read_column(&mut self, axes: Axes, column: ValueColumn) -> Result<NamedCurve, FormatError> {
        self.say(column.start.map(|_| match self.options.quantity {
            SpectrumQuantity::SpectralPower => {
                "the middles of bands as wavelengths, values per nm of the band".into()
            }
            _ => "the middles of bands as wavelengths".into(),
        }));
        let (mut unit, lines) = self.ratio(column)?;
        let mut samples = self.samples(axes, column, lines)?;
        let is_converted = self.options.quantity != SpectrumQuantity::Stored && self.options.unit.is_none();
        let words = self.words_of_unit(column.values);
        let factor = match self.options.quantity.absolute_factor(words) {
            Ok(Some(factor)) => factor,
            _ if is_converted => factor_of(words),
            _ => 1.0,
        };
        if factor != 1.0 {
            self.say(Some(format!("values times {factor}")));
            samples.iter_mut().for_each(|sample| {
                sample.value *= factor;
                sample.error = sample.error.map(|error| error * factor);
            });
        }
        self.sort(&mut samples);
        if unit == Some(ValueUnit::OpticalDensity) && self.options.quantity.is_fraction() {
            self.refuse_density_of_zero(column.values, &samples)?;
        }
        if self.options.quantity.is_fraction() {
            let largest = self.must_be_percent(&samples, column.values).filter(|_| unit.is_none());
            if let Some(largest) = largest {
                self.say(Some(format!("without a unit, with values up to {largest:.1}, taken for percent")));
                unit = Some(ValueUnit::Percent);
            }
            self.leave_out_noisy_ends(unit, &mut samples);
        }
        let nm: Vec<f64> = samples.iter().map(|sample| sample.nm).collect();
        check_axis(self.path, "the", &nm, |index| Some(samples[index].row.line))?;
        let name = self.headers()[column.values].clone();
        let convert = unit.map(|unit| {
            let is_loss = samples.iter().map(|sample| sample.value).sum::<f64>() > 0.0;
            Conversion::new(unit, self.options.quantity, is_loss).map_err(|what| {
                let what = format!("column {}: {what}", self.table.column_name(column.values));
                FormatError::unit(
                    self.path,
                    what,
                    "Choose a file or column that holds one, or correct the unit in the header",
                )
            })
        });
        let convert = convert.transpose()?;
        let converted =
            |sample: &Sample| convert.map_or(sample.value, |convert| convert.of(sample.nm, sample.value));
        self.say(convert.and_then(Conversion::in_words).map(String::from));
        let is_efficiency = self.options.quantity == SpectrumQuantity::QuantumEfficiency;
        let is_doubtful = is_efficiency && self.options.unit.is_none() && is_relative(&name);
        self.say(is_doubtful.then(|| "relative values, taken for electrons per photon".into()));
        let mut values: Vec<f64> = samples.iter().map(converted).collect();
        self.check_values(column.values, unit, &samples, &mut values)?;
        let errors = samples.iter().map(|sample| {
            sample.error.map(|error| match convert {
                Some(convert) => convert.of_error(sample.nm, sample.value, error),
                None => error,
            })
        });
        let errors: Option<Vec<f64>> = errors.collect();
        let standard_error = errors.filter(|_| column.error.is_some()).map(|e| Curve::new(nm.clone(), e));
        let curve = Curve::new(nm, values).map_err(|error| {
            FormatError::malformed(
                self.path,
                format!("column {} is not a valid spectrum: {error}", self.table.column_name(column.values)),
                "Check the column",
            )
        })?;
        Ok(NamedCurve { name, curve, standard_error: standard_error.and_then(Result::ok) })
    }

    /// Adds to what is said of the file, once.
    fn say(&mut self, words: Option<String>) {
        self.read_as.extend(words.filter(|words| !self.read_as.contains(words)));
    }

    /// Unit of a column: as stated, or as it follows from what a spectrometer measured beside it; and the lines where that had light.
    fn ratio(
        &mut self,
        column: ValueColumn,
    ) -> Result<(Option<ValueUnit>, std::ops::RangeInclusive<u64>), FormatError> {
        let stated = self.unit(column.values)?;
        let all = 0..=u64::MAX;
        let raw = RawColumns::find(self.headers()).filter(|_| {
            let is_computed = !RawColumns::is_raw(&self.headers()[column.values]);
            is_computed && self.options.quantity.is_fraction()
        });
        let Some(raw) = raw else { return Ok((stated, all)) };
        let mut rows = Vec::with_capacity(self.table.row_count());
        let mut lines = Vec::with_capacity(self.table.row_count());
        for row in self.table.rows() {
            // A ratio without light is infinite or none; wrong cells are told where the column is read
            let cell = |column| self.table.number(self.path, row, column).ok().flatten();
            if let (Some(sample), Some(dark), Some(reference)) =
                (cell(raw.sample), cell(raw.dark), cell(raw.reference))
            {
                rows.push(RawRow { sample, dark, reference, computed: cell(column.values) });
                lines.push(row.line);
            }
        }
        let Some((unit, lit)) = ratio(&rows) else { return Ok((stated, all)) };
        let left_out = lines.len() - lit.len();
        self.say((left_out > 0).then(|| {
            let lines = counted(left_out, "line", "lines");
            format!("without {lines} at the ends, where the reference has no light")
        }));
        Ok((stated.or(Some(unit)), lines[lit.start]..=lines[lit.end - 1]))
    }

    /// Leaves out the noise at the ends of a transmittance or reflectance.
    fn leave_out_noisy_ends(&mut self, unit: Option<ValueUnit>, samples: &mut Vec<Sample>) {
        let Some(kept) = without_noisy_ends(&fractions(unit, samples)) else { return };
        if kept.len() < samples.len() {
            let (first, last) = (samples[kept.start].nm, samples[kept.end - 1].nm);
            self.say(Some(format!("{first:.1} to {last:.1} nm; beyond lies noise")));
            samples.truncate(kept.end);
            samples.drain(..kept.start);
        }
    }

    fn samples(
        &self,
        axes: Axes,
        column: ValueColumn,
        lines: std::ops::RangeInclusive<u64>,
    ) -> Result<Vec<Sample>, FormatError> {
        let is_filled = |row: &Row| !self.table.cell(*row, column.values).is_empty();
        let last_filled = self.table.rows().filter(is_filled).last().map_or(0, |row| row.line);
        let mut samples = Vec::with_capacity(self.table.row_count());
        for row in self.table.rows().filter(|row| lines.contains(&row.line)) {
            let value = self.table.number(self.path, row, column.values)?;
            let Some(nm) = self.table.number(self.path, row, column.axis)? else {
                // The end of the shorter of two pairs of columns
                let has_pairs = || self.headers()[1..].iter().any(|header| names_wavelengths(header));
                if value.is_none() && (column.axis > 0 || has_pairs()) {
                    continue;
                }
                return Err(FormatError::at_line(
                    self.path,
                    row.line,
                    "the wavelength is empty",
                    "Give every line a wavelength in nm",
                ));
            };
            let cell =
                |column: Option<usize>| column.map(|of| self.table.number(self.path, row, of)).transpose();
            let nm = cell(column.start)?.flatten().map_or(nm, |start| 0.5 * (start + nm));
            let error = cell(column.error)?.flatten();
            match value {
                Some(value) => samples.push(Sample { row, nm: axes.scale_to_nm.in_nm(nm), value, error }),
                None if self.options.skip_empty_cells => {}
                // A spectrometer computes no value where it has no light: at the ends
                None if self.options.quantity != SpectrumQuantity::Stored
                    && (samples.is_empty() || row.line > last_filled) => {}
                None => {
                    let nm = axes.scale_to_nm.in_nm(nm);
                    return Err(FormatError::at_line(
                        self.path,
                        row.line,
                        format!("column {} has no value at {nm} nm", self.table.column_name(column.values)),
                        "Fill the cell, or remove the lines without a value: a straight line bridges the gap",
                    ));
                }
            }
        }
        Ok(samples)
    }

    /// Sorts samples by wavelength, and takes the mean of those few that have the same.
    fn sort(&mut self, samples: &mut Vec<Sample>) {
        let rises = samples.windows(2).all(|pair| pair[0].nm < pair[1].nm);
        let falls = samples.windows(2).all(|pair| pair[0].nm > pair[1].nm);
        if rises {
            return;
        }
        samples.sort_by(|a, b| a.nm.total_cmp(&b.nm));
        // Readings that differ; a line that stands in twice is one
        let differing = |run: &&[Sample]| run.iter().any(|sample| sample.value != run[0].value);
        let by_wavelength = || samples.chunk_by(|a, b| a.nm == b.nm);
        let count = by_wavelength().count();
        let doubled: usize = by_wavelength().filter(differing).map(|run| run.len() - 1).sum();
        self.say((!falls && doubled < count).then(|| "lines sorted by wavelength".to_string()));
        if doubled as f64 > MOST_DOUBLED * count as f64 {
            samples.dedup_by(|b, a| a.nm == b.nm && a.value == b.value);
            return;
        }
        let means: Vec<f64> = by_wavelength()
            .map(|run| run.iter().map(|sample| sample.value).sum::<f64>() / run.len() as f64)
            .collect();
        samples.dedup_by(|b, a| a.nm == b.nm);
        samples.iter_mut().zip(means).for_each(|(sample, mean)| sample.value = mean);
        if doubled == 0 {
            return;
        }
        let words = counted(doubled, "wavelength", "wavelengths");
        self.say(Some(format!("{words} given twice: the mean of the values")));
    }

    /// Instruments that have no light left may write an optical density of 0.
    fn refuse_density_of_zero(&self, column: usize, samples: &[Sample]) -> Result<(), FormatError> {
        let is_wrong = |zero: &Sample, beside: &Sample| zero.value == 0.0 && beside.value >= LEAST_OPAQUE;
        let wrong = samples.windows(2).find_map(|pair| {
            let [a, b] = [&pair[0], &pair[1]];
            is_wrong(a, b).then_some((a, b)).or(is_wrong(b, a).then_some((b, a)))
        });
        wrong.map_or(Ok(()), |(zero, beside)| {
            let column = self.table.column_name(column);
            Err(FormatError::at_line(
                self.path,
                zero.row.line,
                format!("column {column} holds an optical density of 0 at {} nm beside {} at {} nm", zero.nm, beside.value, beside.nm),
                "Write the largest density that is measured where no light was left, or 0.001 where the filter is clear",
            ))
        })
    }

    /// The largest value of a transmittance or reflectance without a unit, where it is so large that it must be percent.
    fn must_be_percent(&self, samples: &[Sample], column: usize) -> Option<f64> {
        if without_noisy_ends(&fractions(None, samples)).is_some() {
            return None;
        }
        let percent = fractions(Some(ValueUnit::Percent), samples);
        let kept = without_noisy_ends(&percent)?;
        // One value that is larger than those beside it is a wrong pixel
        let beside = |pair: &[f64]| pair[0].min(pair[1]);
        let shared = percent[kept.clone()].windows(2).map(beside).fold(0.0, f64::max);
        let largest = percent[kept].iter().copied().fold(0.0, f64::max);
        let names = |text: &str| {
            let lower = text.to_lowercase();
            let mut words = lower.split(|c: char| !c.is_alphanumeric());
            words.any(|word| ["transmi", "reflect", "remission"].iter().any(|start| word.starts_with(start)))
        };
        // No optical density is as large as the second
        let least = if names(&self.headers()[column]) || self.preamble.iter().any(|line| names(line)) {
            0.015
        } else {
            0.15
        };
        (shared > least).then_some(100.0 * largest)
    }

    /// What to do with values that are too large: one of them, or most.
    fn hint_of_large(&self, unit: Option<ValueUnit>, values: &[f64]) -> String {
        let largest = values.iter().copied().fold(0.0, f64::max);
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let is_alone = sorted.iter().rev().nth(1).is_none_or(|second| PLAUSIBLE.contains(second));
        let path = self.path.display();
        let is_fraction = self.options.quantity.is_fraction();
        let percent = 100.0 * if is_fraction { *PLAUSIBLE.end() } else { LARGEST_EFFICIENCY };
        match self.options.quantity {
            _ if is_alone && values.len() > 2 && (unit.is_some() || largest > percent) => {
                "Correct this value, or remove the line".into()
            }
            _ if is_alone && values.len() > 2 => {
                format!(
                    "Correct this value, or remove the line. Of a narrow band in percent: {}",
                    unit_hint(self.path, ValueUnit::Percent)
                )
            }
            _ if unit.is_none() && largest <= percent => unit_hint(self.path, ValueUnit::Percent),
            _ if is_fraction => format!(
                "Choose a column that holds a transmittance or reflectance; if its white was too dark, give the file as \
                 {{ csv = \"{path}\", scale = 0.25 }}, with the factor that makes it one"
            ),
            _ => format!(
                "Choose a column that holds a quantum efficiency, or give the file as {{ csv = \"{path}\", scale = 0.01 }}, with the factor that makes it one"
            ),
        }
    }

    /// Applies the rule for negative values and, of fractions, for those above 1.
    fn check_values(
        &mut self,
        column: usize,
        unit: Option<ValueUnit>,
        samples: &[Sample],
        values: &mut [f64],
    ) -> Result<(), FormatError> {
        let quantity = self.options.quantity;
        let largest = values.iter().copied().fold(0.0, f64::max);
        let sum_of = |sign: f64| values.iter().map(|value| (sign * value).max(0.0)).sum::<f64>();
        let is_noisy = sum_of(-1.0) <= NOISE * sum_of(1.0);
        let refuses = self.options.negative == Negative::Refuse;
        let around = around(values);
        let hint_of_large = self.hint_of_large(unit, values);
        let (mut below, mut above) = ((0, 0.0_f64), (0, 1.0_f64));
        for ((sample, value), near) in samples.iter().zip(values.iter_mut()).zip(around) {
            let is_noise = quantity != SpectrumQuantity::Stored
                && *value < 0.0
                && (is_noisy || value.max(near.mean + near.within) >= -NOISE * largest);
            if is_noise && refuses {
                below = (below.0 + 1, below.1.min(*value));
                *value = 0.0;
            }
            let too_large = match quantity {
                _ if quantity.is_fraction() && value.min(near.mean - near.within) > *PLAUSIBLE.end() => {
                    Some("more than 1")
                }
                SpectrumQuantity::QuantumEfficiency if *value > LARGEST_EFFICIENCY => {
                    Some("more electrons than a photon frees")
                }
                _ => None,
            };
            if let Some(what) = too_large {
                let column = self.table.column_name(column);
                let what = format!("column {column} holds {}, {what}{}", sample.value, in_unit(unit));
                return Err(FormatError::at_line(self.path, sample.row.line, what, hint_of_large));
            }
            if quantity.is_fraction() && *value > 1.0 && refuses {
                above = (above.0 + 1, above.1.max(*value));
                *value = 1.0;
            }
            *value = self.table.checked_sign(self.path, sample.row, column, *value, self.options.negative)?;
        }
        let words = |(count, extreme): (usize, f64), what: &str| {
            (count > 0)
                .then(|| format!("{} {what}, as far as {extreme:.2e}", counted(count, "value", "values")))
        };
        if quantity == SpectrumQuantity::SpectralPower {
            self.say(pedestal(samples).map(|percent| {
                format!("never below {percent:.0} % of the largest value, and level there: is the dark subtracted?")
            }));
        }
        self.say(words(below, "below 0 taken as 0"));
        self.say(words(above, "above 1 taken as 1"));
        Ok(())
    }
}

/// What is measured at one wavelength.
struct Sample {
    row: Row,
    nm: f64,
    value: f64,
    error: Option<f64>,
}

/// Mean of the values around a sample, and three standard errors of it.
#[derive(Clone, Copy)]
struct Around {
    mean: f64,
    within: f64,
}

/// What lies around each value, where there are many; each itself where there are few.
fn around(values: &[f64]) -> Vec<Around> {
    if values.len() < 10 * NOISE_WITHIN {
        return values.iter().map(|value| Around { mean: *value, within: 0.0 }).collect();
    }
    let around_place = |place: usize| {
        let end = (place + NOISE_WITHIN + 1).min(values.len());
        let near = &values[place.saturating_sub(NOISE_WITHIN)..end];
        let count = near.len() as f64;
        let mean = near.iter().sum::<f64>() / count;
        let variance = near.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
        Around { mean, within: 3.0 * (variance / count).sqrt() }
    };
    (0..values.len()).map(around_place).collect()
}

/// Percent of the largest value above which all values of a light stay, where a third of them are as low as the lowest: its dark.
fn pedestal(samples: &[Sample]) -> Option<f64> {
    let mut sorted: Vec<f64> = samples.iter().map(|sample| sample.value).collect();
    sorted.sort_by(f64::total_cmp);
    let [first, .., last] = sorted[..] else { return None };
    let third = sorted[sorted.len() / 3];
    let is_level = third - first < LEVEL * last;
    (sorted.len() >= 20 && is_level && first > LEAST_PEDESTAL * last && third < 0.5 * last)
        .then_some(100.0 * first / last)
}

/// Words for the unit that a value has in the file.
fn in_unit(unit: Option<ValueUnit>) -> String {
    unit.map_or(String::new(), |unit| format!(" in unit \"{}\"", unit.name()))
}

/// Samples as fractions, where their unit is one of a ratio or none.
fn fractions(unit: Option<ValueUnit>, samples: &[Sample]) -> Vec<f64> {
    let convert = unit.and_then(|unit| Conversion::new(unit, SpectrumQuantity::Fraction, true).ok());
    samples.iter().map(|of| convert.map_or(of.value, |convert| convert.of(of.nm, of.value))).collect()
}

/// Whether wavelengths run from the ultraviolet far into the infrared, as those of tables of sunlight.
fn is_of_sunlight(nm: &[f64]) -> bool {
    let (low, high) = nm.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(*v), h.max(*v)));
    (*PLAUSIBLE_NM.start()..380.0).contains(&low) && high <= LONGEST_OF_SUNLIGHT_NM
}

fn unit_hint(path: &Path, likely: ValueUnit) -> String {
    let names = ValueUnit::ALL.map(ValueUnit::name);
    format!(
        "Give the file as {{ csv = \"{}\", unit = \"{}\" }}, between apostrophes on a command line; units are {}",
        path.display(),
        likely.name(),
        names.join(", ")
    )
}

fn is_standard_error(lower: &str) -> bool {
    let joined: String = lower.chars().filter(|c| c.is_alphanumeric()).collect();
    let words: Vec<String> = words_of(lower).collect();
    let of_last = |name: &str| words.last().is_some_and(|word| word == name);
    ["standarddev", "standarderror", "stderr", "uncertainty"].iter().any(|name| joined.starts_with(name))
        || ["sem", "sigma", "se", "err", "error", "errors", "uncertainty"].iter().any(|name| of_last(name))
        || words.iter().any(|word| matches!(word.as_str(), "std" | "stdev" | "stddev" | "sd" | "stderr"))
        || matches!(lower.trim(), "+/-" | "±")
}

/// Whether a quantity at the begin of a line is followed by its unit and nothing else: `reflectance (%)`, `irradiance, W/m2`; not
/// `reflectance standard: Spectralon (99 %)`.
fn is_followed_by_unit(line: &str) -> bool {
    let rest = line.trim_start_matches(|letter: char| letter.is_alphabetic() || letter == '%').trim();
    let inner = rest.trim_start_matches([':', '=', ',']).trim();
    let is_bracketed = rest.starts_with(['(', '[']) && rest.ends_with([')', ']', ':']);
    let is_short = inner.split_whitespace().count() <= 2 && !inner.starts_with(char::is_alphabetic);
    is_bracketed
        || inner.is_empty()
        || (rest != inner && inner.split_whitespace().count() <= 2)
        || is_short
        || inner.starts_with("in ")
}

/// Whether a header is that of an edge of bands.
fn is_edge(header: &str) -> bool {
    const EDGES: [&str; 12] =
        ["start", "end", "from", "to", "lower", "upper", "low", "high", "min", "max", "begin", "stop"];
    words_of(header).any(|word| EDGES.contains(&word.as_str()))
}

fn words_of(header: &str) -> impl Iterator<Item = String> {
    let lower = header.to_lowercase();
    let words: Vec<String> = lower.split(|c: char| !c.is_alphanumeric()).map(String::from).collect();
    words.into_iter().filter(|word| !word.is_empty())
}

/// Whether a column holds by its name what a measurement is compared with, and no measurement.
fn is_comparison(header: &str) -> bool {
    const COMPARISONS: [&str; 8] =
        ["dark", "background", "bkg", "bg", "baseline", "reference", "ref", "blank"];
    let is_corrected =
        words_of(header).any(|word| word.starts_with("correct") || word.starts_with("subtract"));
    !is_corrected && words_of(header).next().is_some_and(|word| COMPARISONS.contains(&word.as_str()))
}

fn is_comparison_with_dark(header: &str) -> bool {
    is_comparison(header) && !words_of(header).any(|word| word.starts_with("ref"))
}

/// What a column is of by its name, of kinds that can't stand for each other.
fn kind_of(header: &str) -> Option<&'static str> {
    words_of(header).find_map(|word| match word.as_str() {
        "t" | "ts" | "tp" | "tavg" => Some("transmittance"),
        "r" | "rs" | "rp" | "ravg" => Some("reflectance"),
        "ex" | "exc" => Some("excitation"),
        "em" => Some("emission"),
        _ => ["transmittance", "reflectance", "excitation", "emission", "dichroic"]
            .into_iter()
            .find(|kind| word.starts_with(&kind[..7])),
    })
}

/// Whether a text names a reflectance and no transmittance; what is anti-reflective passes more.
fn is_reflectance(text: &str) -> bool {
    let is = |kind: &str| words_of(text).any(|word| kind_of(&word) == Some(kind));
    is("reflectance") && !is("transmittance") && !words_of(text).any(|word| word == "anti")
}

/// The column that a spectrometer computed from its sample, dark and reference.
fn computed_column(names: &[String]) -> Option<usize> {
    let has_dark = names.iter().any(|name| {
        let lower = name.to_lowercase();
        lower.starts_with("dark") || lower == "d"
    });
    let mut computed = (0..names.len()).filter(|place| !RawColumns::is_raw(&names[*place]));
    has_dark.then(|| computed.next_back()).flatten()
}
