//! Reads a measured fluorophore strictly and says what it holds.

use std::path::Path;

use fluorspar::quote::shell_word;
use fluorspar::spectral::{Stokes, YieldUnit};
use fluorspar_format::{
    ANTI_STOKES_TOLERANCE, AntiStokes, CsvEemOptions, CutTo, Defect, EmptyCells, FormatError, LeastCuts,
    MOST_CUT_NM, MeasuredEem, Negative, ScatterCut, names_excitation_and_emission, read_eem_csv,
    read_fluorophore_csv, read_iset_fluorophore, read_start, refuse_anti_stokes, refuse_scattered_light,
};

use super::file_options::FileOptions;
use crate::{Error, Result};

/// Bytes of a file among which its header is looked for.
const HEADER_BYTES: u64 = 1 << 20;

/// Which reader a file needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Rows emission, columns excitation.
    MatrixCsv,
    /// Columns wavelength, excitation, emission.
    SpectraCsv,
    /// A MATLAB file of isetfluorescence.
    Mat,
}

/// Values over emission (rows) and excitation (columns), relative photons or energy.
struct Matrix {
    emission_nm: Vec<f64>,
    excitation_nm: Vec<f64>,
    values: Vec<f64>,
}

/// What a file holds.
pub struct Measured {
    /// Which reader read it.
    pub kind: Kind,
    /// Name that the file gives itself.
    pub name: Option<String>,
    /// What its values count.
    pub unit: YieldUnit,
    /// Pairs of what and how much, for people.
    pub findings: Vec<(String, String)>,
    /// What was made of its cells, a line each; empty where they are as measured.
    pub changed: Vec<String>,
    /// What is accepted and should not be.
    pub warnings: Vec<String>,
    /// The matrix whose scattered light was cut out, where that was wanted.
    pub without_scatter: Option<MeasuredEem>,
}

impl Measured {
    /// Without warnings, as it is.
    fn as_it_is(kind: Kind, name: Option<String>, unit: YieldUnit, findings: Vec<(String, String)>) -> Self {
        Self { kind, name, unit, findings, changed: Vec::new(), warnings: Vec::new(), without_scatter: None }
    }
}

/// Reads a file with every check that the options leave on.
pub(super) fn read(path: &Path, options: &FileOptions) -> Result<Measured> {
    let kind = kind_of(path);
    if options.cut.is_some() && kind != Kind::MatrixCsv {
        return Err(Error::Input(format!(
            "⟨cut_scatter⟩: {} is no matrix as CSV, and holds no line of scattered light that could be cut; leave it out",
            path.display()
        )));
    }
    if options.sample.is_some() && kind == Kind::Mat {
        return Err(Error::Input(format!(
            "⟨sample⟩: {} is a MATLAB file, of one fluorophore; leave it out",
            path.display()
        )));
    }
    read_kind(kind, path, options).map_err(|error| match error {
        Error::Format(error) => explained(kind, path, options, error),
        other => other,
    })
}

fn read_kind(kind: Kind, path: &Path, options: &FileOptions) -> Result<Measured> {
    match kind {
        Kind::MatrixCsv => matrix_csv(path, options),
        Kind::SpectraCsv => spectra_csv(path, options),
        Kind::Mat => mat(path, options),
    }
}

/// A refusal with the option that lets the file pass, and where one is not enough, with what would be refused after it and the command that has
/// all of them: who follows it should not meet one refusal after another.
fn explained(kind: Kind, path: &Path, options: &FileOptions, error: FormatError) -> Error {
    let mut tried = options.clone();
    let (mut text, mut fixes, mut passes) = (String::new(), 0, false);
    let mut next = Some(error);
    while let Some(error) = next.take() {
        let cure = cured(kind, path, &error, &mut tried);
        if cure.is_none() && fixes == 0 {
            return error.into();
        }
        // The option beside what it cures
        let option = cure.as_ref().map(|cure| format!(" ({})", cure.words)).unwrap_or_default();
        text += &match (fixes, error.line()) {
            (0, _) => error.message_with(&option),
            (_, Some(line)) => format!(". Then, on line {line}, {}", error.problem_with(&option)),
            (_, None) => format!(". Then {}", error.problem_with(&option)),
        };
        if !cure.is_some_and(|cure| cure.passes) {
            break;
        }
        fixes += 1;
        // What else is wrong with the form is told with the unit
        if error.has_more() && matches!(error.defect(), Defect::Unit { .. }) {
            break;
        }
        match read_kind(kind, path, &tried) {
            Ok(_) => passes = true,
            Err(Error::Format(error)) => next = Some(error),
            Err(_) => {}
        }
    }
    if passes && (fixes > 1 || tried.cut.is_some()) {
        let unit = match (options.yield_unit, tried.yield_unit) {
            (None, Some(_)) => ", or with ⟨yield_unit=energy⟩ where the values are energies",
            _ => "",
        };
        text += &format!(". To import the file, run: `{}`{unit}", import_command(path, &tried));
    }
    Error::Input(text)
}

/// What is done about a refusal.
struct Cure {
    /// In words.
    words: String,
    /// Whether the file passes this refusal with the options that were tried.
    passes: bool,
}

impl Cure {
    fn option(words: impl Into<String>) -> Option<Self> {
        Some(Self { words: words.into(), passes: true })
    }
}

/// The option that lets a file pass, which `tried` then has; `None` where none does.
fn cured(kind: Kind, path: &Path, error: &FormatError, tried: &mut FileOptions) -> Option<Cure> {
    match error.defect() {
        Defect::Unit { .. } if tried.yield_unit.is_none() => {
            tried.yield_unit = Some(YieldUnit::Photons);
            Cure::option("⟨yield_unit=photons⟩ or ⟨yield_unit=energy⟩")
        }
        Defect::AntiStokes { .. } | Defect::ScatteredLight { .. } if !tried.allow_anti_stokes => match kind {
            Kind::MatrixCsv => scatter_cured(path, tried),
            _ => {
                tried.allow_anti_stokes = true;
                Cure::option("⟨allow_anti_stokes⟩")
            }
        },
        Defect::Samples(names) if tried.sample.is_none() => {
            tried.sample = names.first().cloned();
            Cure::option(format!("⟨sample={}⟩", shell_word(tried.sample.as_deref().unwrap_or_default())))
        }
        Defect::Negative { .. } if !tried.allow_negative => {
            tried.allow_negative = true;
            Cure::option("⟨allow_negative⟩")
        }
        Defect::EmptyCell { .. } if tried.empty_cells == EmptyCells::Refuse => {
            tried.empty_cells = EmptyCells::Interpolate;
            Cure::option(
                "⟨empty_cells=interpolate⟩ fills them along the emission, ⟨empty_cells=zero⟩ says that nothing fluoresces there",
            )
        }
        _ => None,
    }
}

/// The least band of scattered light that is enough. What is imported without one may be that light and no dye.
fn scatter_cured(path: &Path, tried: &mut FileOptions) -> Option<Cure> {
    let uncut = FileOptions { cut: None, allow_anti_stokes: true, ..tried.clone() };
    let eem = read_eem_csv(path, &csv_options(&uncut)).ok()?;
    let to = tried.cut.map_or(CutTo::Neighbors, |cut| cut.to);
    let LeastCuts { for_all, for_tails, for_lines } = eem.least_cuts(to, ANTI_STOKES_TOLERANCE);
    let cut = |nm: u32| Some(ScatterCut { within_nm: f64::from(nm), to });
    // A wider band than the tails need is cut for single cells of noise: at most a bandpass of it
    const BANDPASS_NM: u32 = 10;
    if let Some(nm) = for_all.filter(|all| for_tails.is_some_and(|tails| *all <= tails + BANDPASS_NM)) {
        tried.cut = cut(nm);
        return Cure::option(format!(
            "`fluorophore import --cut-scatter {nm}` is the narrowest band that removes it; ⟨allow_anti_stokes⟩ keeps the values"
        ));
    }
    let (nm, removes) = match (for_tails, for_lines) {
        (Some(nm), _) => {
            (nm, "removes the lines with their tails; ⟨allow_anti_stokes⟩ keeps the noise of single cells")
        }
        (None, Some(nm)) => (nm, "removes the lines; ⟨allow_anti_stokes⟩ keeps their tails"),
        (None, None) => {
            let words = format!(
                "no band of `fluorophore import --cut-scatter` up to {MOST_CUT_NM} nm leaves a dye: emission that keeps its place while the excitation moves"
            );
            return Some(Cure { words, passes: false });
        }
    };
    tried.allow_anti_stokes = true;
    tried.cut = cut(nm);
    Cure::option(format!(
        "`fluorophore import --cut-scatter {nm}` {removes} below the excitation, which the Stokes mask leaves out"
    ))
}

/// The command that imports a file with these options.
fn import_command(path: &Path, options: &FileOptions) -> String {
    let file = path.display().to_string();
    let mut command = format!("fluorspar fluorophore import {}", shell_word(&file));
    if let Some(sample) = &options.sample {
        command += &format!(" --sample {}", shell_word(sample));
    }
    match options.yield_unit {
        Some(YieldUnit::Photons) => command += " --yield-unit photons",
        Some(YieldUnit::Energy) => command += " --yield-unit energy",
        None => {}
    }
    if let Some(photon_yield) = options.photon_yield {
        command += &format!(" --photon-yield {photon_yield}");
    }
    for (is_given, option) in [
        (options.stokes == Stokes::Off, " --stokes off"),
        (options.allow_negative, " --allow-negative"),
        (options.empty_cells == EmptyCells::Zero, " --empty-cells zero"),
        (options.empty_cells == EmptyCells::Interpolate, " --empty-cells interpolate"),
        (options.allow_anti_stokes, " --allow-anti-stokes"),
    ] {
        command += if is_given { option } else { "" };
    }
    if let Some(cut) = options.cut {
        let to = if cut.to == CutTo::Zero { " --cut-to zero" } else { "" };
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        command +=
            &format!(" --cut-scatter {}{to} --out {}", cut.within_nm, shell_word(&format!("{stem}.toml")));
    }
    command
}

/// By ending, or else by the cells of the header. A file that can't be opened is left to its reader to explain.
fn kind_of(path: &Path) -> Kind {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mat")) {
        return Kind::Mat;
    }
    let text = read_start(path, HEADER_BYTES).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let header = text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'));
    let cells: Vec<String> = header
        .unwrap_or_default()
        .split([',', ';', '\t'])
        .map(|cell| cell.trim_matches(|c: char| c == '"' || c.is_whitespace()).to_lowercase())
        .collect();
    let plain: Vec<&str> = cells.iter().map(String::as_str).collect();
    let is_plain = plain.iter().any(|cell| matches!(*cell, "excitation" | "emission" | "wavelength_nm"));
    if is_plain || names_excitation_and_emission(&plain) { Kind::SpectraCsv } else { Kind::MatrixCsv }
}

fn negative(options: &FileOptions) -> Negative {
    if options.allow_negative { Negative::ClipToZero } else { Negative::Refuse }
}

/// The unit of a matrix, which must be known.
fn stated_unit(path: &Path, unit: Option<YieldUnit>) -> Result<YieldUnit> {
    unit.ok_or_else(|| {
        Error::Input(format!(
            "{}: the file says that the unit of its values is unknown. Decide with ⟨yield_unit=photons⟩ or ⟨yield_unit=energy⟩",
            path.display()
        ))
    })
}

/// How a matrix is read.
fn csv_options(options: &FileOptions) -> CsvEemOptions {
    CsvEemOptions {
        unit: options.yield_unit,
        anti_stokes: if options.allow_anti_stokes {
            AntiStokes::Keep
        } else {
            AntiStokes::Refuse(ANTI_STOKES_TOLERANCE)
        },
        negative: negative(options),
        empty_cells: options.empty_cells,
        cut: options.cut,
        sample: options.sample.clone(),
    }
}

fn matrix_csv(path: &Path, options: &FileOptions) -> Result<Measured> {
    let read = read_eem_csv(path, &csv_options(options))?;
    let unit = stated_unit(path, read.unit)?;
    let without_scatter = options.cut.map(|_| MeasuredEem { unit: Some(unit), ..read.clone() });
    let of_peak = options.cut.and_then(|cut| peak_beside_cut(&read, cut));
    let of_peak = read.overflow().map(|overflow| overflow.to_string()).or(of_peak);
    let matrix =
        Matrix { emission_nm: read.emission_nm, excitation_nm: read.excitation_nm, values: read.values };
    let mut findings = vec![("content".into(), format!("excitation-emission matrix of {}", unit.name()))];
    if !read.read_as.is_empty() {
        findings.push(("form of the file".into(), read.read_as.join("; ")));
    }
    describe(path, &matrix, &mut findings)?;
    let peak = matrix.values.iter().copied().fold(0.0, f64::max);
    let of_cells = [
        ("empty cells", empty_cells(&matrix, &read.empty_cells, options.empty_cells)),
        ("negative cells", negative_cells(read.clipped, peak)),
    ];
    let changed = of_cells.iter().filter(|(_, words)| words != NO_CELL);
    let changed = changed.map(|(what, words)| format!("{what}: {words}")).collect();
    findings.extend(of_cells.into_iter().map(|(what, words)| (what.into(), words)));
    let mut warnings = accepted_scatter(path, &matrix, options);
    warnings.extend(of_peak);
    Ok(Measured { kind: Kind::MatrixCsv, name: None, unit, findings, changed, warnings, without_scatter })
}

/// A largest value in or beside a band that was cut out.
fn peak_beside_cut(eem: &MeasuredEem, cut: ScatterCut) -> Option<String> {
    let [excitation_nm, emission_nm] = eem.peak_beside(cut)?;
    Some(format!(
        "the largest value that is left, at excitation {excitation_nm} nm and emission {emission_nm} nm, lies in or beside a band of \
         --cut-scatter {}: the dye may emit most within it. Take a narrower one, or measure with a narrower bandpass or a blank subtracted",
        cut.within_nm
    ))
}

/// What a matrix holds of scattered light though it was accepted.
fn accepted_scatter(path: &Path, matrix: &Matrix, options: &FileOptions) -> Vec<String> {
    if !options.allow_anti_stokes {
        return Vec::new();
    }
    let found = refuse_scattered_light(path, &matrix.emission_nm, &matrix.excitation_nm, &matrix.values);
    let words = |error: FormatError| {
        format!(
            "--allow-anti-stokes accepts what is no fluorescence: {}; `fluorophore import --cut-scatter NM` does so",
            error.problem()
        )
    };
    found.err().map(words).into_iter().collect()
}

/// Said of cells of which there are none.
const NO_CELL: &str = "none";

/// What was made of empty cells.
fn empty_cells(matrix: &Matrix, places: &[usize], choice: EmptyCells) -> String {
    const TOLD: usize = 3;
    let columns = matrix.excitation_nm.len();
    let filled = |place: &&usize| matrix.values[**place] != 0.0;
    let told = |place: &usize| {
        let [emission_nm, excitation_nm] =
            [matrix.emission_nm[place / columns], matrix.excitation_nm[place % columns]];
        format!("{} at emission {emission_nm} nm, excitation {excitation_nm} nm", matrix.values[*place])
    };
    let told: Vec<String> = places.iter().filter(filled).take(TOLD).map(told).collect();
    let filled = places.iter().filter(filled).count();
    match (places.len(), choice) {
        (0, _) => NO_CELL.into(),
        (count, EmptyCells::Interpolate) => {
            let more = if filled > told.len() { ", and others" } else { "" };
            let values = if told.is_empty() { String::new() } else { format!(": {}{more}", told.join("; ")) };
            let zero = count - filled;
            format!(
                "{filled} interpolated along the emission{values}; {zero} taken as zero, below the excitation or beyond the values"
            )
        }
        (count, _) => format!("{count}, taken as zero: no fluorescence there"),
    }
}

/// What was made of negative values, and how much that is: noise is cut to one side.
fn negative_cells((count, lowest): (usize, f64), peak: f64) -> String {
    if count == 0 {
        return NO_CELL.into();
    }
    let percent = 100.0 * lowest.abs() / peak.max(f64::MIN_POSITIVE);
    format!(
        "{count}, taken as zero, the lowest {lowest} ({percent:.2} % of the peak): what is left of noise about zero is positive"
    )
}

/// What a file or the option says that the emission counts.
fn unit_of_emission(
    path: &Path,
    stated: Option<YieldUnit>,
    given: Option<YieldUnit>,
) -> Result<Option<YieldUnit>> {
    match (stated, given) {
        (Some(stated), Some(given)) if stated != given => Err(Error::Input(format!(
            "{}: it says that its emission counts {}, and ⟨yield_unit={}⟩ was given; leave that out, or correct the file",
            path.display(),
            stated.name(),
            given.name()
        ))),
        _ => Ok(given.or(stated)),
    }
}

fn spectra_csv(path: &Path, options: &FileOptions) -> Result<Measured> {
    let read = read_fluorophore_csv(path, negative(options), options.sample.as_deref())?;
    if read.emission_only {
        return Err(emission_only(path));
    }
    let unit = unit_of_emission(path, read.stated, options.yield_unit)?;
    let mut findings = vec![("content".into(), "excitation and emission spectra".to_string())];
    findings.extend((!read.read_as.is_empty()).then(|| ("form of the file".into(), read.read_as.join("; "))));
    let range = |(first, last): (f64, f64)| format!("{first} to {last} nm");
    for (name, curve) in [("excitation", &read.excitation), ("emission", &read.emission)] {
        if curve.max() <= 0.0 {
            return Err(nothing(path, &format!("the {name}")));
        }
        let text = format!(
            "{}, {} samples, peak at {} nm",
            range(curve.range_nm()),
            curve.values().len(),
            curve.peak_nm()
        );
        findings.push((name.into(), text));
    }
    findings.push(("unit of emission".into(), taken_as(unit.unwrap_or(YieldUnit::Photons), unit.is_some())));
    let unit = unit.unwrap_or(YieldUnit::Photons);
    Ok(Measured::as_it_is(Kind::SpectraCsv, None, unit, findings))
}

fn mat(path: &Path, options: &FileOptions) -> Result<Measured> {
    let read = read_iset_fluorophore(path)?;
    if read.emission_only {
        return Err(emission_only(path));
    }
    let refuse_negative = |what: &str, values: &[f64]| match values.iter().position(|value| *value < 0.0) {
        Some(index) if !options.allow_negative => Err(Error::Input(format!(
            "{}: value {} of \"{what}\" is {}, below zero. Subtract the background correctly, or take negative values as \
             zero with ⟨allow_negative⟩",
            path.display(),
            index + 1,
            values[index]
        ))),
        _ => Ok(()),
    };
    let unit = options.yield_unit.unwrap_or(YieldUnit::Photons);
    let name = Some(read.name).filter(|name| !name.is_empty());
    let (mut findings, mut warnings) = (Vec::new(), Vec::new());
    if let Some(values) = read.eem {
        refuse_negative("eem", &values)?;
        findings.push(("content".into(), format!("ISET fluorophore, matrix of {}", unit.name())));
        let values = values.into_iter().map(|value| value.max(0.0)).collect();
        let matrix = Matrix { emission_nm: read.wave_nm.clone(), excitation_nm: read.wave_nm, values };
        let percent = 100.0 * anti_stokes_share(&matrix);
        if percent > 50.0 && !options.allow_anti_stokes {
            return Err(Defect::Transposed { percent }.of(path).into());
        }
        if !options.allow_anti_stokes {
            refuse_scattered_light(path, &matrix.emission_nm, &matrix.excitation_nm, &matrix.values)?;
            refuse_anti_stokes(path, &matrix.emission_nm, &matrix.excitation_nm, &matrix.values)?;
        }
        warnings = accepted_scatter(path, &matrix, options);
        describe(path, &matrix, &mut findings)?;
    } else if let (Some(excitation), Some(emission)) = (read.excitation, read.emission) {
        findings.push(("content".into(), "ISET fluorophore, excitation and emission spectra".into()));
        for (what, values) in [("excitation", excitation), ("emission", emission)] {
            refuse_negative(what, &values)?;
            let best = (0..values.len()).fold(0, |best, i| if values[i] > values[best] { i } else { best });
            if values[best] <= 0.0 {
                return Err(nothing(path, &format!("the {what}")));
            }
            let (first, last) = (read.wave_nm[0], read.wave_nm[read.wave_nm.len() - 1]);
            let text =
                format!("{first} to {last} nm, {} samples, peak at {} nm", values.len(), read.wave_nm[best]);
            findings.push((what.into(), text));
        }
    } else {
        return Err(emission_only(path));
    }
    let by_convention = if options.yield_unit.is_some() {
        "as given"
    } else {
        "the convention of those files; --yield-unit changes it"
    };
    findings.push(("unit".into(), format!("{} ({by_convention})", unit.name())));
    Ok(Measured { warnings, ..Measured::as_it_is(Kind::Mat, name, unit, findings) })
}

fn taken_as(unit: YieldUnit, given: bool) -> String {
    format!(
        "{} ({})",
        unit.name(),
        if given { "as given" } else { "assumed; --yield-unit energy changes it" }
    )
}

fn emission_only(path: &Path) -> Error {
    Error::Input(format!(
        "{}: the excitation is missing or the same everywhere: it was never measured, and only the shape of the emission means \
         anything. Take a measured excitation from elsewhere and name both files in the experiment: excitation_csv, emission_csv",
        path.display()
    ))
}

/// A part of a fluorophore that is zero everywhere.
fn nothing(path: &Path, what: &str) -> Error {
    Error::Input(format!(
        "{}: {what} is zero at every wavelength. Check the column or export it again",
        path.display()
    ))
}

/// Share of the sum of all values that lies below its excitation.
fn anti_stokes_share(matrix: &Matrix) -> f64 {
    let (mut below, mut total) = (0.0, 0.0);
    for (row, emission) in matrix.values.chunks_exact(matrix.excitation_nm.len()).zip(&matrix.emission_nm) {
        for (value, excitation) in row.iter().zip(&matrix.excitation_nm) {
            total += value;
            if emission < excitation {
                below += value;
            }
        }
    }
    if total > 0.0 { below / total } else { 0.0 }
}

/// Grid, peak and anti-Stokes share of a matrix.
fn describe(path: &Path, matrix: &Matrix, findings: &mut Vec<(String, String)>) -> Result<()> {
    for (name, axis) in [("excitation", &matrix.excitation_nm), ("emission", &matrix.emission_nm)] {
        let (Some(first), Some(last), true) = (axis.first(), axis.last(), axis.len() > 1) else {
            return Err(Error::Input(format!(
                "{}: a matrix needs at least two {name} wavelengths; this one has {}. Measure at more of them, or give excitation and emission spectra as the \
                 columns wavelength_nm, excitation, emission",
                path.display(),
                axis.len()
            )));
        };
        findings.push((name.into(), format!("{first} to {last} nm, {} samples", axis.len())));
    }
    let columns = matrix.excitation_nm.len();
    let best = (0..matrix.values.len())
        .fold(0, |best, i| if matrix.values[i] > matrix.values[best] { i } else { best });
    if matrix.values[best] <= 0.0 {
        return Err(nothing(path, "the matrix"));
    }
    let peak = [matrix.excitation_nm[best % columns], matrix.emission_nm[best / columns]];
    findings.push(("peak".into(), format!("excitation {} nm, emission {} nm", peak[0], peak[1])));
    let share = 100.0 * anti_stokes_share(matrix);
    findings.push(("anti-Stokes".into(), format!("{share:.3} % of the sum of all values")));
    Ok(())
}
