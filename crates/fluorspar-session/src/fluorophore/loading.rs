//! Fluorophores by name or file, as they would be in an experiment.

use std::path::Path;

use fluorspar::spectral::{Fluorophore, YieldDensity};
use fluorspar::units::number_text;
use fluorspar_experiment::preset::{self, FluorophorePreset};
use fluorspar_experiment::schema::ASSUMED_PHOTON_YIELD;
use fluorspar_experiment::schema::{
    FilePath, FluorophoreSection, FluorophoreSource, MatSource, MatrixSource, TableSource,
};
use fluorspar_experiment::{file_text, parse_sample};
use fluorspar_format::read_toml;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::file_options::FileOptions;
use super::measured::{Kind, Measured, read};
use crate::source::read_text;
use crate::values::quoted;
use crate::{Error, Result};

/// A fluorophore at unit concentration and where it comes from.
pub struct LoadedFluorophore {
    /// At unit concentration.
    pub fluorophore: Fluorophore,
    /// The entry of the catalogue.
    pub preset: Option<FluorophorePreset>,
    /// What the file holds.
    pub measured: Option<Measured>,
}

#[derive(Serialize)]
struct Sections {
    fluorophore: [FluorophoreSection; 1],
}

/// The part of a file that is read here: an experiment has others, too. What a section holds is checked when a sample is made of it.
#[derive(Deserialize)]
struct SectionsOfFile {
    #[serde(default)]
    fluorophore: Vec<NamedSection>,
}

/// A `[[fluorophore]]` whose name is known.
#[derive(Serialize, Deserialize)]
struct NamedSection {
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    #[serde(flatten)]
    fields: toml::Table,
}

/// Sections as TOML.
pub fn section_toml(section: &FluorophoreSection) -> Result<String> {
    file_text(&Sections { fluorophore: [section.clone()] })
        .map_err(|error| Error::Failed(format!("the section can't be written: {error}")))
}

/// Whether a name is that of a file of measured values.
pub(super) fn is_measured_file(name: &str) -> bool {
    let path = Path::new(name);
    let is_toml = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml"));
    !is_toml && (path.extension().is_some() || name.contains(['/', '\\']) || path.is_file())
}

/// By name of the catalogue, or from a file: one that holds measured values, or all of the `[[fluorophore]]` sections of a TOML file.
pub fn load(name: &str, options: &FileOptions) -> Result<Vec<LoadedFluorophore>> {
    let path = Path::new(name);
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
        return from_toml(path, options);
    }
    if is_measured_file(name) {
        let (section, measured) = from_file(path, None, options)?;
        let fluorophore = checked(path, &section)?;
        return Ok(vec![LoadedFluorophore { fluorophore, preset: None, measured: Some(measured) }]);
    }
    let preset = preset::fluorophore(name)?;
    if let Some(option) = options.first_given() {
        return Err(Error::Input(format!(
            "{option}: applies to files only, and {name} is in the catalogue; leave it out"
        )));
    }
    Ok(vec![LoadedFluorophore { fluorophore: preset.fluorophore(), preset: Some(preset), measured: None }])
}

/// The fluorophores of the sections of a file, as `import` writes it; an experiment has them, too.
fn from_toml(path: &Path, options: &FileOptions) -> Result<Vec<LoadedFluorophore>> {
    let failed = |what: String| Error::Input(format!("{}: {what}", path.display()));
    if let Some(option) = options.first_given() {
        return Err(failed(format!(
            "{option} applies to files of measured values; change the section in this file"
        )));
    }
    let text = read_text(path)?;
    let file: SectionsOfFile = read_toml(&text).map_err(|error| failed(error.to_string()))?;
    if file.fluorophore.is_empty() {
        return Err(failed(
            "the file has no [[fluorophore]] section; give one that `fluorophore import` wrote".into(),
        ));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let load = |section: &NamedSection| -> Result<LoadedFluorophore> {
        let name = section.name.as_deref();
        let name = name.ok_or_else(|| failed("a [[fluorophore]] has no name; give it one".into()))?;
        let text = toml::to_string(&json!({ "fluorophore": [section] }))
            .map_err(|error| Error::Failed(format!("the section can't be read: {error}")))?;
        Ok(LoadedFluorophore {
            fluorophore: as_sample(path, name, &text, folder)?,
            preset: None,
            measured: None,
        })
    };
    file.fluorophore.iter().map(load).collect()
}

/// Reads a file strictly and makes its section, with an absolute path.
pub fn from_file(
    path: &Path,
    name: Option<&str>,
    options: &FileOptions,
) -> Result<(FluorophoreSection, Measured)> {
    let photon_yield = options.photon_yield.unwrap_or(ASSUMED_PHOTON_YIELD);
    if !(1e-12..=1.0).contains(&photon_yield) {
        return Err(Error::Input(format!(
            "⟨photon_yield={}⟩: must be between 1e-12 and 1 (photons out per photon in)",
            number_text(photon_yield)
        )));
    }
    if path.is_dir() {
        return Err(Error::Input(format!("{}: this is a folder; give a file in it", path.display())));
    }
    let measured = read(path, options)?;
    let stem = path.file_stem().map_or_else(|| "imported".into(), |stem| stem.to_string_lossy().into_owned());
    let of_file = || measured.name.clone().or_else(|| options.sample.clone());
    let name = name.map(String::from).or_else(of_file).unwrap_or(stem);
    if name.trim().is_empty() {
        return Err(Error::Input("⟨name⟩: the name is empty; give one that materials can refer to".into()));
    }
    let file = std::path::absolute(path).unwrap_or_else(|_| path.into());
    let file = FilePath::from(file.to_string_lossy().into_owned());
    let unit = Some(measured.unit);
    let sample = options.sample.clone();
    let section = FluorophoreSection {
        name,
        title: None,
        source: match measured.kind {
            Kind::MatrixCsv => FluorophoreSource::Matrix(MatrixSource { eem_csv: file, unit, sample }),
            Kind::SpectraCsv => FluorophoreSource::Table(TableSource { csv: file, unit, sample }),
            Kind::Mat => FluorophoreSource::Mat(MatSource { mat: file, unit }),
        },
        photon_yield: Some(photon_yield),
        stokes: Some(options.stokes),
        allow_negative: options.allow_negative,
        allow_anti_stokes: options.allow_anti_stokes,
        empty_cells: options.empty_cells,
    };
    Ok((section, measured))
}

/// The fluorophore that an experiment makes of a section: on a black surface, at concentration 1.
pub fn checked(path: &Path, section: &FluorophoreSection) -> Result<Fluorophore> {
    as_sample(path, &section.name, &section_toml(section)?, Path::new("."))
}

/// The same of a section as TOML, whose paths start at a folder.
fn as_sample(path: &Path, name: &str, section: &str, folder: &Path) -> Result<Fluorophore> {
    let text = format!(
        "format = 1\n[light]\nspectrum = \"equal_energy\"\nstrength.irradiance_w_per_m2 = 1.0\n[sample]\nreflectance = 0.0\n\
         [sample.concentrations]\n{} = 1.0\n{section}",
        quoted(name)
    );
    let sample = parse_sample(&text, &path.display().to_string(), folder, &[]).map_err(|error| {
        let details = error.details();
        Error::Input(format!("{}: {}", path.display(), details.message))
    })?;
    let found = sample.sample.fluorophores.into_iter().next();
    found
        .map(|(fluorophore, _)| fluorophore)
        .ok_or_else(|| Error::Failed(format!("{}: the file gave no fluorophore", path.display())))
}

/// Where a fluorophore emits at all, nm: a model beyond its data, too.
pub fn everywhere_nm(fluorophore: &Fluorophore) -> (f64, f64) {
    match fluorophore.eem.density() {
        YieldDensity::Separable(_) => (200.0, 1200.0),
        YieldDensity::Table(_) => fluorophore.emission_range_nm,
    }
}

/// Excitation with the largest yield, and where the emission under it is largest, nm.
pub fn peaks_nm(fluorophore: &Fluorophore) -> [f64; 2] {
    let nodes = |(first, last): (f64, f64)| -> Vec<f64> {
        (0..=(last - first).floor().max(1.0) as usize).map(|i| (first + i as f64).min(last)).collect()
    };
    let largest = |nodes: &[f64], values: &[f64]| {
        let best = (0..values.len()).fold(0, |best, i| if values[i] > values[best] { i } else { best });
        nodes.get(best).copied().unwrap_or(f64::NAN)
    };
    let excitation = nodes(fluorophore.excitation_range_nm);
    let excitation_nm = largest(&excitation, &fluorophore.eem.total_yields(&excitation));
    [excitation_nm, emission_peak_nm(fluorophore, excitation_nm)]
}

/// Where the emission under one excitation is largest, nm.
pub fn emission_peak_nm(fluorophore: &Fluorophore, excitation_nm: f64) -> f64 {
    let (first, last) = fluorophore.emission_range_nm;
    let mut best = (f64::NAN, 0.0);
    for i in 0..=(last - first).floor().max(1.0) as usize {
        let nm = (first + i as f64).min(last);
        let value = fluorophore.eem.at(nm, excitation_nm);
        if value > best.1 {
            best = (nm, value);
        }
    }
    best.0
}
