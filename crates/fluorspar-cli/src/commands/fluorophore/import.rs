//! `fluorspar fluorophore import`.

use std::io::Write;
use std::path::{Component, Path, PathBuf};

use clap::ValueHint;
use fluorspar_experiment::schema::{FilePath, FluorophoreSection};
use fluorspar_format::{Output, OutputSet, Outputs, write_atomically};

use super::loading::{checked, everywhere_nm, from_file, peaks_nm, section_toml};
use super::{FileOptions, StokesChoice};
use crate::commands::print_text;
use crate::error::CliError;
use crate::message::Messages;

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
}

pub(super) fn run(options: &Options) -> Result<(), CliError> {
    let to_stdout = options.out.as_os_str() == "-";
    let set = if to_stdout { None } else { Some(declare(&options.out, &options.input)?) };
    let (mut section, measured) = from_file(&options.input, options.name.as_deref(), &options.file)?;
    let fluorophore = checked(&options.input, &section)?;

    let folder = if to_stdout { Path::new(".") } else { options.out.parent().unwrap_or(Path::new(".")) };
    refer_from(folder, &mut section);
    let text = format!(
        "# Measured fluorophore from {}. Put this section into an experiment or flat sample; paths start at its folder.\n\
         # photon_yield: photons out per photon in at the best excitation, concentration 1{}.\n{}",
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
    let masked = if options.file.stokes == StokesChoice::Mask { ", emission below it masked" } else { "" };
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
    let Some(set) = set else { return print_text(&text) };
    write_atomically(&options.out, |file| file.write_all(text.as_bytes()))?;
    set.finish()?;
    messages.status(format!("Wrote fluorophore \"{}\" to {}", section.name, options.out.display()));
    Ok(())
}

fn declare(out: &Path, input: &Path) -> Result<OutputSet, CliError> {
    let shown = out.display();
    if !out.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
        return Err(CliError::Input(format!(
            "--out {shown}: the name must end in .toml, or be - for standard output"
        )));
    }
    if out.exists() {
        return Err(CliError::Input(format!(
            "--out {shown}: this exists already and is kept; choose another name or remove it, or append a fluorophore of another name with --out - >> {shown}"
        )));
    }
    Ok(Outputs::new().and(Output::file("--out", out)).reading(&[input.to_path_buf()]).declare()?)
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
