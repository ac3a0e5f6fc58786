//! `fluorspar fluorophore import`.

use std::io::Write;
use std::path::{Component, Path, PathBuf};

use clap::ValueHint;
use fluorspar::spectral::Stokes;
use fluorspar_experiment::Warning;
use fluorspar_experiment::schema::{FilePath, FluorophoreSection, FluorophoreSource};
use fluorspar_format::{
    CutTo, EmptyCells, Output, OutputSet, Outputs, ScatterCut, read_start, write_atomically,
};
use fluorspar_session::fluorophore::{
    FileOptions, checked, everywhere_nm, from_file, peaks_nm, section_toml,
};

use crate::commands::print_text;
use crate::error::CliError;
use crate::message::Messages;
use crate::values::{self, check_range};

/// Options of `fluorophore import`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    /// Matrix CSV (rows emission, columns excitation), CSV with the columns wavelength_nm, excitation, emission, or
    /// MATLAB file of isetfluorescence.
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    input: PathBuf,
    /// Name of the fluorophore, by which materials refer to it [default: that of the file].
    #[arg(long)]
    name: Option<String>,
    #[command(flatten)]
    file: FileOptions,
    /// File for the section, .toml, or `-` for standard output.
    #[arg(long, value_name = "FILE", default_value = "-", value_hint = ValueHint::FilePath)]
    out: PathBuf,
    /// Replace the file of --out, if it is a section that `import` wrote.
    #[arg(long)]
    replace: bool,
    /// Cut scattered excitation light out of a matrix: the cells within NM of emission = 1, 2 and 3 x excitation, and, where it is
    /// seen, of the Raman line of water. The section then refers to a matrix without it, which is written beside --out.
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    cut_scatter: Option<f64>,
    /// What cut cells become: what a straight line along the emission between the cells beside the band has, or 0.
    #[arg(long, value_parser = values::choice::<CutTo>(&["neighbors", "zero"]), default_value = "neighbors",
        requires = "cut_scatter")]
    cut_to: CutTo,
}

/// Distances from the lines of scattered light that may be cut, nm.
const CUT_NM: [f64; 2] = [0.5, 100.0];
/// How the text of a section begins.
const WRITTEN_BY_IMPORT: &str = "# Measured fluorophore from ";

/// The cut that was asked for.
fn cut(options: &Options) -> Result<Option<ScatterCut>, CliError> {
    let Some(within_nm) = options.cut_scatter else { return Ok(None) };
    check_range("cut_scatter", within_nm, CUT_NM, "nm")?;
    if options.out.as_os_str() == "-" {
        return Err(CliError::Input(
            "--cut-scatter: the matrix without scattered light is a file beside the section; name the section with --out FILE.toml".into(),
        ));
    }
    Ok(Some(ScatterCut { within_nm, to: options.cut_to }))
}

/// What was cut, in words.
fn cut_in_words(cut: ScatterCut, [first, second, third, water]: [usize; 4]) -> String {
    let to = match cut.to {
        CutTo::Neighbors => {
            "interpolated along the emission, at the ends of the emission the nearest value, below the excitation 0"
        }
        CutTo::Zero => "set to 0",
    };
    format!(
        "{first} cells within {} nm of emission = excitation, {second} of emission = 2 x excitation, {third} of emission = 3 x excitation and {water} of the \
         Raman line of water, {to}",
        cut.within_nm
    )
}

pub(super) fn run(options: &Options) -> Result<(), CliError> {
    let to_stdout = options.out.as_os_str() == "-";
    let cut = cut(options)?;
    let matrix_out = cut.map(|_| options.out.with_file_name(matrix_name(&options.out)));
    let set = if to_stdout { None } else { Some(declare(options, matrix_out.as_deref())?) };
    let file_options = FileOptions { cut, ..options.file.clone() };
    let (mut section, mut measured) = from_file(&options.input, options.name.as_deref(), &file_options)?;
    let mut remark = String::new();
    if let (Some(cut), Some(place), Some(eem)) = (cut, &matrix_out, &measured.without_scatter) {
        let words = cut_in_words(cut, eem.cut_cells);
        let input = options.input.file_name().unwrap_or_default().to_string_lossy();
        let comments = [format!("{input} without scattered excitation light: {words}")];
        let comments: Vec<String> = comments.into_iter().chain(measured.changed.iter().cloned()).collect();
        write_atomically(place, |file| file.write_all(eem.to_csv(&comments).as_bytes()))?;
        let absolute = std::path::absolute(place).unwrap_or_else(|_| place.clone());
        for path in section.source.files_mut() {
            *path = FilePath::from(absolute.to_string_lossy().into_owned());
        }
        // What was decided about samples and cells is done in the new file
        if let FluorophoreSource::Matrix(matrix) = &mut section.source {
            matrix.sample = None;
        }
        section.allow_negative = false;
        section.empty_cells = EmptyCells::Refuse;
        remark = format!("# Scattered excitation light is cut out: {words}.\n");
        measured.findings.push(("scattered light".into(), format!("cut out: {words}")));
    }
    remark.extend(measured.changed.iter().map(|words| format!("# {words}.\n")));
    let fluorophore = checked(&options.input, &section)?;

    let folder = if to_stdout { Path::new(".") } else { options.out.parent().unwrap_or(Path::new(".")) };
    refer_from(folder, &mut section);
    let text = format!(
        "{WRITTEN_BY_IMPORT}{}. Put this section into an experiment or flat sample, and its name into the\n\
         # `concentrations` of a material or sample; paths start at the folder of that file.\n\
         # photon_yield: photons out per photon in at the best excitation, concentration 1{}.\n{remark}{}",
        options.input.file_name().unwrap_or_default().to_string_lossy(),
        if options.file.photon_yield.is_some() { "" } else { " [assumed]" },
        section_toml(&section)?
    );
    let messages = Messages::default();
    messages.status(options.input.display());
    for (what, value) in &measured.findings {
        messages.status(format!("  {what:<16} {value}"));
    }
    let [excitation_nm, emission_nm] = peaks_nm(&fluorophore);
    let (from_nm, to_nm) = everywhere_nm(&fluorophore);
    let total = fluorophore.photon_yield(excitation_nm, from_nm, to_nm);
    let masked = if options.file.stokes == Stokes::Mask { ", emission below it masked" } else { "" };
    messages.status(format!(
        "  {:<16} {total:.3e} photons out per photon in at {excitation_nm:.0} nm, most of them near {emission_nm:.0} nm{masked}",
        "total yield"
    ));
    if options.file.photon_yield.is_none() {
        messages.status(format!(
            "  {:<16} assumed, as for the catalogue; give --photon-yield where it is known",
            "its scale"
        ));
    }
    let warnings: Vec<Warning> = measured.warnings.iter().cloned().map(Warning::from).collect();
    messages.warnings(&warnings);
    let Some(set) = set else { return print_text(&text) };
    write_atomically(&options.out, |file| file.write_all(text.as_bytes()))?;
    set.finish()?;
    messages.status(format!("Wrote fluorophore \"{}\" to {}", section.name, options.out.display()));
    Ok(())
}

/// Name of the matrix without scattered light beside a section.
fn matrix_name(out: &Path) -> String {
    format!("{}-without-scatter.csv", out.file_stem().unwrap_or_default().to_string_lossy())
}

/// Whether a file is a section that this command wrote.
fn is_ours(path: &Path) -> bool {
    let start = read_start(path, WRITTEN_BY_IMPORT.len() as u64).unwrap_or_default();
    start == WRITTEN_BY_IMPORT.as_bytes()
}

/// Whether a file is a matrix that this command wrote.
fn is_our_matrix(path: &Path) -> bool {
    let start = read_start(path, 4096).unwrap_or_default();
    let text = String::from_utf8_lossy(&start);
    text.lines().next().is_some_and(|line| line.contains("without scattered excitation light: "))
}

fn declare(options: &Options, matrix: Option<&Path>) -> Result<OutputSet, CliError> {
    let (out, input) = (&options.out, &options.input);
    let shown = out.display();
    if !out.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
        return Err(CliError::Input(format!(
            "--out {shown}: the name must end in .toml, or be - for standard output"
        )));
    }
    if out.exists() && !options.replace {
        return Err(CliError::Input(format!(
            "--out {shown}: this exists already and is kept; choose another name, replace it with --replace, or append a fluorophore of another \
             name with --out - >> {shown}"
        )));
    }
    if out.exists() && !is_ours(out) {
        return Err(CliError::Input(format!(
            "--replace: {shown} does not begin as `import` writes it, so something else would be lost; choose another name for --out"
        )));
    }
    let output = |place: &Path| match options.replace {
        true => Output::continued("--out", place),
        false => Output::file("--out", place),
    };
    let mut outputs = Outputs::new().and(output(out));
    if let Some(matrix) = matrix {
        // One of this command without its section is what is left where the section was refused
        if matrix.exists() && !is_our_matrix(matrix) {
            return Err(CliError::Input(format!(
                "--cut-scatter: {} exists already and is kept; choose another name for --out",
                matrix.display()
            )));
        }
        // At its place before the section, which is checked with it
        outputs = outputs.and(Output::continued("--out", matrix));
    }
    Ok(outputs.reading(&[input.to_path_buf()]).declare()?)
}

/// Makes the paths of a section relative to the folder of the file that it will be in.
fn refer_from(folder: &Path, section: &mut FluorophoreSection) {
    for path in section.source.files_mut() {
        *path = FilePath::from(relative(folder, path.as_ref()));
    }
}

/// The way from a folder to a file, with slashes; the file itself where they share no more than the root.
fn relative(folder: &Path, file: &Path) -> String {
    let absolute = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.into());
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let (from, to) = (absolute(folder), absolute(file));
    let (from, to): (Vec<Component<'_>>, Vec<Component<'_>>) =
        (from.components().collect(), to.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let only_root = to[..shared].iter().all(|part| matches!(part, Component::Prefix(_) | Component::RootDir));
    if only_root {
        return file.to_string_lossy().into_owned();
    }
    let up = from[shared..].iter().map(|_| "..".to_string());
    let down = to[shared..].iter().map(|part| part.as_os_str().to_string_lossy().into_owned());
    up.chain(down).collect::<Vec<_>>().join("/")
}
