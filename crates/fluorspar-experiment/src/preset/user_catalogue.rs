//! A folder of the user whose entries stand beside those of the catalogue.

use std::fs;
use std::path::{Path, PathBuf};

use fluorspar::spectral::CurveModel;
use fluorspar_format::{
    FormatError, SpectrumOptions, SpectrumQuantity, digest_bounded, read_spectra, read_text_bounded,
};

use super::catalogue::built_in_names;
use super::curve_preset::{CurveQuantity, SpectraPreset, curve, quantum_efficiency_of};
use super::kind::{PresetError, PresetKind};
use super::sensor_preset::sensor_of;
use super::site_preset::named_site;
use super::state_preset::state_of;
use super::user_entries::{Entries, MOST_BYTES, UserEntry, keep_entries};

/// Kinds of entries that the folder may hold.
const KINDS: [PresetKind; 7] = [
    PresetKind::Light,
    PresetKind::Filter,
    PresetKind::Reflectance,
    PresetKind::QuantumEfficiency,
    PresetKind::Sensor,
    PresetKind::Site,
    PresetKind::State,
];

/// Lets the entries of a folder stand beside those of the catalogue, for the rest of this process. Its folders `lights`, `filters`,
/// `reflectances`, `qe`, `sensors`, `sites` and `states` hold files in the form of the catalogue (`NAME.toml`), or tables (`NAME.csv`, only of
/// spectra): wavelength, nm, in the first column, one column beside it, for quantum efficiencies one for each channel. A table of a light is brought
/// to a peak of 1. The first folder that is used stays.
///
/// # Errors
/// A file that can't be read or is no such entry, a name of the catalogue.
pub fn use_catalogue(folder: &Path) -> Result<(), PresetError> {
    keep_entries(read_entries(folder)?);
    Ok(())
}

/// Whether [`use_catalogue`] would take a folder; nothing is kept.
///
/// # Errors
/// As those of [`use_catalogue`].
pub fn check_catalogue(folder: &Path) -> Result<(), PresetError> {
    read_entries(folder).map(drop)
}

/// The entries of a folder, each read as whoever uses it will.
fn read_entries(folder: &Path) -> Result<Entries, PresetError> {
    let mut entries = Entries::new();
    if !folder.is_dir() {
        return Err(refused(folder, "there is no such folder"));
    }
    for kind in KINDS {
        let Ok(files) = fs::read_dir(folder.join(kind.folder())) else { continue };
        let mut paths: Vec<PathBuf> = files.filter_map(|file| Some(file.ok()?.path())).collect();
        paths.sort();
        for path in paths {
            let Some(name) = path.file_stem().and_then(|stem| stem.to_str()).map(String::from) else {
                continue;
            };
            let Some(text) = text_of_entry(kind, &name, &path)? else { continue };
            if built_in_names(kind).contains(&name.as_str()) {
                return Err(refused(
                    &path,
                    format!("the catalogue has a {kind} of this name; rename the file"),
                ));
            }
            check(kind, &name, &text).map_err(|error| of_user(&path, error))?;
            let sha256 = digest_bounded(&path, MOST_BYTES).map_err(|error| of_file(&path, &error))?;
            let file = std::path::absolute(&path).unwrap_or_else(|_| path.clone());
            if entries.insert((kind.folder(), name), UserEntry { text, file, sha256 }).is_some() {
                return Err(refused(&path, "there are two files of this name; remove one of them"));
            }
        }
    }
    Ok(entries)
}

fn check(kind: PresetKind, name: &str, text: &str) -> Result<(), PresetError> {
    match kind {
        PresetKind::QuantumEfficiency => quantum_efficiency_of(name, text).map(drop),
        PresetKind::Site => named_site(name, text).map(drop),
        PresetKind::State => state_of(name, text).map(drop),
        PresetKind::Sensor => sensor_of(name, text).map(drop),
        _ => curve(kind, name, text).map(drop),
    }
}

/// An error of an entry, which no file of the program holds.
fn of_user(path: &Path, error: PresetError) -> PresetError {
    match error {
        PresetError::Damaged { message, .. } => refused(path, message),
        other => other,
    }
}

fn refused(path: &Path, message: impl Into<String>) -> PresetError {
    PresetError::User { path: path.into(), message: message.into() }
}

fn of_file(path: &Path, error: &FormatError) -> PresetError {
    refused(path, error.to_string())
}

/// An entry in the form of the catalogue; `None` of files that are none.
fn text_of_entry(kind: PresetKind, name: &str, path: &Path) -> Result<Option<String>, PresetError> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("toml") => read_text_bounded(path, MOST_BYTES).map(Some).map_err(|error| of_file(path, &error)),
        Some("csv") if !matches!(kind, PresetKind::Sensor | PresetKind::Site | PresetKind::State) => {
            text_of_table(kind, name, path).map(Some)
        }
        _ => Ok(None),
    }
}

/// A table in the form of the catalogue.
fn text_of_table(kind: PresetKind, name: &str, path: &Path) -> Result<String, PresetError> {
    let is_qe = kind == PresetKind::QuantumEfficiency;
    let read_as = match kind {
        PresetKind::Light => SpectrumQuantity::SpectralPower,
        PresetKind::Filter => SpectrumQuantity::Transmittance,
        PresetKind::Reflectance => SpectrumQuantity::Fraction,
        _ => SpectrumQuantity::QuantumEfficiency,
    };
    let options = SpectrumOptions { quantity: read_as, ..SpectrumOptions::default() };
    let columns = read_spectra(path, &options).map_err(|error| of_file(path, &error))?.curves;
    if columns.is_empty() || (!is_qe && columns.len() > 1) {
        let message =
            format!("a {kind} has one column beside the wavelength, this table has {}", columns.len());
        return Err(refused(path, message));
    }
    let mut valid_nm = [f64::INFINITY, 0.0];
    let failed = |error: toml::ser::Error| refused(path, error.to_string());
    // In the order of the columns
    let mut models = toml::Table::new();
    for column in &columns {
        let curve = &column.curve;
        let (first, last) = curve.range_nm();
        valid_nm = [valid_nm[0].min(first), valid_nm[1].max(last)];
        let scale = if kind == PresetKind::Light { 1.0 / curve.max().max(f64::MIN_POSITIVE) } else { 1.0 };
        let value = curve.values().iter().map(|value| value * scale).collect();
        let model = CurveModel::Table { wavelength_nm: curve.wavelengths_nm().to_vec(), value };
        // Channels are called without the unit of their column, "R (%)"
        let channel = column.name.split(['(', '[']).next().unwrap_or_default().trim();
        models.insert(channel.into(), toml::Value::try_from(model).map_err(failed)?);
    }
    let first = models.values().next().cloned().filter(|_| !is_qe);
    let entry = SpectraPreset {
        name: name.into(),
        title: name.into(),
        description: "Table of the user.".into(),
        source: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        quantity: CurveQuantity::of(kind),
        valid_nm,
        assumed: Vec::new(),
        effective_index: None,
        fit: None,
        model: first.unwrap_or(toml::Value::Table(models)),
    };
    toml::to_string(&entry).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset::text;

    /// Spectra are looked at in fine steps: over any range there would be more of them than memory.
    #[test]
    fn entries_over_ranges_that_are_none_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("filters")).unwrap();
        let valid = text(PresetKind::Filter, "notch_405").unwrap().replace("notch_405", "mine");
        let range = "valid_nm = [350.0, 750.0]";
        assert!(valid.contains(range));
        let told = |range_nm: &str| {
            let text = valid.replace(range, &format!("valid_nm = {range_nm}"));
            fs::write(folder.path().join("filters/mine.toml"), text).unwrap();
            check_catalogue(folder.path()).map_err(|error| error.to_string())
        };
        assert_eq!(told("[350.0, 750.0]"), Ok(()));
        for wrong in ["[0.0, 1e18]", "[900.0, 300.0]", "[nan, 900.0]", "[-inf, 900.0]"] {
            let said = told(wrong).unwrap_err();
            assert!(
                said.ends_with("mine.toml: valid_nm must be two growing wavelengths from 0 to 30000, nm"),
                "{said}"
            );
        }
    }
}
