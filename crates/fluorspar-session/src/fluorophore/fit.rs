//! Measured spectra as sums of fluorophores.

use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::analysis::{ComponentSets, FitError, MixtureFit, SpectralMixture};
use fluorspar::spectral::Curve;
use fluorspar_format::{
    NamedCurve, Negative, OutputFolder, SpectrumColumns, SpectrumOptions, SpectrumQuantity, read_spectra,
};
use serde::{Deserialize, Serialize};

use super::file_options::FileOptions;
use super::fit_components::Components;
use super::fit_files::{FittedSpectra, figure, fit_table, sets_table};
use crate::figure_file::figure_files;
use crate::options::defaults;
use crate::values::{self, check_range};
use crate::{Error, Job, Result};

/// Two tables and results, and two figures for each spectrum.
const FOLDER_BYTES: u64 = 32 << 20;
/// Wavelengths that can be fitted, nm.
const WAVELENGTH_NM: [f64; 2] = [350.0, 800.0];
/// Most samples of a spectrum.
const MOST_SAMPLES: usize = 10_000;

/// Which spectra are fitted, and with what.
#[derive(Clone, Debug, Deserialize, clap::Args)]
#[serde(default = "defaults")]
pub struct FitOptions {
    /// Measured spectra (CSV): energy per nm, one spectrum in each column beside the wavelength.
    #[arg(value_name = "CSV", value_hint = ValueHint::FilePath)]
    pub spectra: PathBuf,
    /// Column to fit. May be repeated [default: all].
    #[arg(long, value_name = "NAME")]
    pub column: Vec<String>,
    /// Fluorophore that the spectra may hold: names of the catalogue or files, separated by commas. May be repeated.
    #[arg(long, value_name = "NAME|FILE", value_delimiter = ',')]
    pub fluorophore: Vec<String>,
    /// Component besides fluorophores, as the instrument would see it: each spectrum of a CSV file. May be repeated.
    #[arg(long, value_name = "CSV", value_hint = ValueHint::FilePath)]
    pub component: Vec<PathBuf>,
    /// Light that excites the fluorophores: a name of the catalogue or a CSV file.
    #[arg(long, value_name = "NAME|CSV")]
    pub light: Option<String>,
    /// Filter on the light: a name of the catalogue or a CSV file. May be repeated.
    #[arg(long, value_name = "NAME|CSV")]
    pub light_filter: Vec<String>,
    /// Filter before the instrument: a name of the catalogue or a CSV file. May be repeated.
    #[arg(long, alias = "filter", value_name = "NAME|CSV")]
    pub view_filter: Vec<String>,
    /// Irradiance of the sample behind the light's filters, W/m², where the spectra are radiances in W/(sr m² nm).
    #[arg(long, value_name = "W_PER_M2", value_parser = values::number, allow_negative_numbers = true)]
    pub irradiance: Option<f64>,
    /// Take the spectra as relative: weights then tell ratios of concentrations.
    #[arg(long, conflicts_with = "irradiance")]
    pub relative: bool,
    /// Component below one layer of blood, whose optical density is fitted. May be repeated.
    #[arg(long, value_name = "NAME", conflicts_with = "tissue")]
    pub below_blood: Vec<String>,
    /// Tissue in whose layers the fluorophores lie, and whose blood is fitted: a site of the catalogue or a file with one [[tissue]]
    /// section. Without --fluorophore all that it holds.
    #[arg(long, value_name = "SITE|FILE")]
    pub tissue: Option<String>,
    /// Fit one amount of blood that all spectra have in common.
    #[arg(long)]
    pub common_blood: bool,
    /// Standard errors of the spectra (CSV): the same columns and wavelengths [default: from the residuals].
    #[arg(long, value_name = "CSV", value_hint = ValueHint::FilePath)]
    pub standard_errors: Option<PathBuf>,
    /// First wavelength that is used, nm [default: that of the file].
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    pub from_nm: Option<f64>,
    /// Last wavelength that is used, nm [default: that of the file].
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    pub to_nm: Option<f64>,
    /// Difference from the best set, by AICc, up to which a set of components counts as supported.
    #[arg(long, value_name = "DELTA", default_value_t = 4.0, value_parser = values::number, allow_negative_numbers = true)]
    pub within: f64,
    /// Fit all components only, and compare no sets of them.
    #[arg(long)]
    pub no_sets: bool,
    /// How files of fluorophores are read.
    #[command(flatten)]
    #[serde(flatten)]
    pub file: FileOptions,
    /// Folder for fit.csv, sets.csv, results.json and a figure of each spectrum (SVG and PNG) [default: none].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// A spectrum within the wavelengths that are used.
struct Measured {
    name: String,
    wavelengths_nm: Vec<f64>,
    values: Vec<f64>,
    errors: Option<Vec<f64>>,
}

/// A spectrum and its fit.
#[derive(Clone, Debug, Serialize)]
pub struct FittedMixture {
    /// Name of its column.
    pub name: String,
    /// Wavelengths that are used, nm.
    #[serde(rename = "wavelength_nm")]
    pub wavelengths_nm: Vec<f64>,
    /// As measured.
    pub measured: Vec<f64>,
    /// The sum that is closest.
    pub fit: MixtureFit,
    /// Which sets of components describe it as well, where they are compared.
    pub sets: Option<ComponentSets>,
}

/// Fits measured spectra as sums of fluorophores, and writes the results into the folder of the options.
///
/// # Errors
/// An option out of its range or without a meaning, spectra that can't be read or fitted, a folder that can't be written.
pub fn fit(options: &FitOptions, job: &Job) -> Result<FittedSpectra> {
    options.check()?;
    let out = options
        .out
        .as_ref()
        .map(|out| OutputFolder::prepare(out, &options.inputs(), FOLDER_BYTES))
        .transpose()?;
    let measured = options.measured(job)?;
    let components = Components::read(options, job)?;
    let mixtures = mixtures(&components, &measured)?;
    let common = if options.common_blood { Some(options.common_blood(&measured, &mixtures)?) } else { None };
    let mut fitted = Vec::new();
    for (spectrum, mixture) in measured.iter().zip(&mixtures) {
        let found = options.fit(spectrum, mixture, common);
        fitted.push(found.map_err(|error| options.wrong(Some(&spectrum.name), &error))?);
    }
    let report = FittedSpectra {
        file: options.spectra.display().to_string(),
        light: components.light(),
        unit: components.unit(),
        weight_unit: components.weight_unit(),
        blood: components.blood(),
        common_blood: common,
        fitted,
    };
    if let Some(out) = out {
        job.status(format!("Wrote {}", write(out, &report)?.display()));
    }
    Ok(report)
}

/// The components at the wavelengths of each spectrum, made once for spectra that share them.
fn mixtures(components: &Components, measured: &[Measured]) -> Result<Vec<SpectralMixture>> {
    let mut made: Vec<SpectralMixture> = Vec::new();
    for (place, spectrum) in measured.iter().enumerate() {
        let same = measured[..place].iter().position(|other| other.wavelengths_nm == spectrum.wavelengths_nm);
        let mixture = match same {
            Some(other) => made[other].clone(),
            None => components.mixture(&spectrum.wavelengths_nm, &spectrum.name)?,
        };
        made.push(mixture);
    }
    Ok(made)
}

impl FitOptions {
    fn check(&self) -> Result<()> {
        self.check_numbers()?;
        let says = |message: &str| Err(Error::Input(message.into()));
        let has_fluorophores = !self.fluorophore.is_empty() || self.tissue.is_some();
        if !has_fluorophores && self.component.is_empty() {
            return says(
                "there is nothing to fit with; give ⟨fluorophore⟩ with names of the catalogue (`fluorspar catalog list fluorophore`), \
                 ⟨tissue⟩ or ⟨component⟩",
            );
        }
        if has_fluorophores && self.light.is_none() {
            return says("give the light that excites the fluorophores, for instance ⟨light=led_405⟩");
        }
        if has_fluorophores && self.irradiance.is_none() && !self.relative {
            return says(
                "give ⟨irradiance⟩, W/m² on the sample, for spectra in W/(sr m² nm), or ⟨relative⟩ for spectra of any scale",
            );
        }
        if self.common_blood && self.below_blood.is_empty() && self.tissue.is_none() {
            return says(
                "⟨common_blood⟩: there is no blood; give ⟨below_blood⟩ or ⟨tissue⟩, or leave it out",
            );
        }
        Ok(())
    }

    fn check_numbers(&self) -> Result<()> {
        for (option, value, range, unit) in [
            ("from_nm", self.from_nm.unwrap_or(WAVELENGTH_NM[0]), WAVELENGTH_NM, "nm"),
            ("to_nm", self.to_nm.unwrap_or(WAVELENGTH_NM[1]), WAVELENGTH_NM, "nm"),
            ("irradiance", self.irradiance.unwrap_or(1.0), [1e-9, 1e9], "W/m²"),
            ("within", self.within, [0.0, 1000.0], ""),
        ] {
            check_range(option, value, range, unit)?;
        }
        Ok(())
    }

    fn inputs(&self) -> Vec<PathBuf> {
        let names = [&self.fluorophore, &self.light_filter, &self.view_filter].into_iter().flatten();
        let names = names.chain(&self.light).chain(&self.tissue).map(PathBuf::from);
        names
            .chain(self.component.iter().cloned())
            .chain(self.standard_errors.clone())
            .chain([self.spectra.clone()])
            .collect()
    }

    /// An error that names file and column.
    fn wrong(&self, column: Option<&str>, error: &FitError) -> Error {
        let fix = match error {
            FitError::ManySets { .. } => ", or ⟨no_sets⟩",
            FitError::FewSamples { .. } => ": take components away, or use more wavelengths",
            _ => "",
        };
        let column = column.map_or_else(String::new, |column| format!(", column \"{column}\""));
        Error::Input(format!("{}{column}: {error}{fix}", self.spectra.display()))
    }

    /// What the spectra are: radiances, where the irradiance is told.
    pub(super) fn quantity(&self) -> SpectrumQuantity {
        if self.irradiance.is_some() {
            SpectrumQuantity::AbsolutePower
        } else {
            SpectrumQuantity::SpectralPower
        }
    }

    fn read(&self, path: &Path, job: &Job) -> Result<Vec<NamedCurve>> {
        let columns = match self.column.is_empty() {
            true => SpectrumColumns::All,
            false => SpectrumColumns::Named(self.column.clone()),
        };
        let options = SpectrumOptions {
            columns,
            quantity: self.quantity(),
            negative: Negative::Keep,
            skip_empty_cells: true,
            unit: None,
        };
        let read = read_spectra(path, &options)?;
        if !read.read_as.is_empty() {
            job.status(format!("{}: read as {}", path.display(), read.read_as.join("; ")));
        }
        Ok(read.curves)
    }

    /// The columns that are fitted, within the wavelengths that are used.
    fn measured(&self, job: &Job) -> Result<Vec<Measured>> {
        let curves = self.read(&self.spectra, job)?;
        let errors = self.standard_errors.as_ref().map(|path| Ok::<_, Error>((path, self.read(path, job)?)));
        let errors = errors.transpose()?;
        let (from, to) = (self.from_nm.unwrap_or(WAVELENGTH_NM[0]), self.to_nm.unwrap_or(WAVELENGTH_NM[1]));
        let measured = |NamedCurve { name, curve, standard_error }: &NamedCurve| {
            let used = |nm: &f64| (from..=to).contains(nm);
            let samples = || curve.wavelengths_nm().iter().zip(curve.values()).filter(|(nm, _)| used(nm));
            let wavelengths_nm: Vec<f64> = samples().map(|(nm, _)| *nm).collect();
            let count = wavelengths_nm.len();
            if !(1..=MOST_SAMPLES).contains(&count) {
                return Err(Error::Input(format!(
                    "{}, column \"{name}\": {count} samples between {from} and {to} nm; give wavelengths that hold 1 to \
                     {MOST_SAMPLES} of them (⟨from_nm⟩, ⟨to_nm⟩)",
                    self.spectra.display(),
                )));
            }
            let errors = match &errors {
                Some((path, curves)) => Some(errors_at(path, curves, name, &wavelengths_nm)?),
                None => {
                    standard_error.as_ref().map(|of| wavelengths_nm.iter().map(|nm| of.at(*nm)).collect())
                }
            };
            Ok(Measured {
                name: name.clone(),
                values: samples().map(|(_, value)| *value).collect(),
                errors,
                wavelengths_nm,
            })
        };
        curves.iter().map(measured).collect()
    }

    fn common_blood(&self, measured: &[Measured], mixtures: &[SpectralMixture]) -> Result<f64> {
        let other = measured.iter().find(|spectrum| spectrum.wavelengths_nm != measured[0].wavelengths_nm);
        if let Some(other) = other {
            return Err(Error::Input(format!(
                "⟨common_blood⟩: column \"{}\" has other wavelengths than \"{}\"; choose a range that all have (⟨from_nm⟩, ⟨to_nm⟩)",
                other.name, measured[0].name
            )));
        }
        let spectra: Vec<(&[f64], Option<&[f64]>)> = measured
            .iter()
            .map(|spectrum| (spectrum.values.as_slice(), spectrum.errors.as_deref()))
            .collect();
        mixtures[0].common_blood(&spectra).map_err(|error| self.wrong(None, &error))
    }

    fn fit(
        &self,
        spectrum: &Measured,
        mixture: &SpectralMixture,
        common: Option<f64>,
    ) -> Result<FittedMixture, FitError> {
        let held = common.map(|amount| mixture.behind(amount));
        let mixture = held.as_ref().unwrap_or(mixture);
        let errors = spectrum.errors.as_deref();
        let fit = mixture.fit(&spectrum.values, errors)?;
        let sets = match self.no_sets {
            true => None,
            false => Some(mixture.sets(&spectrum.values, errors, &fit, self.within)?),
        };
        Ok(FittedMixture {
            name: spectrum.name.clone(),
            wavelengths_nm: spectrum.wavelengths_nm.clone(),
            measured: spectrum.values.clone(),
            fit,
            sets,
        })
    }
}

/// Standard errors of a column, at its wavelengths.
fn errors_at(path: &Path, curves: &[NamedCurve], name: &str, wavelengths_nm: &[f64]) -> Result<Vec<f64>> {
    let says = |what: String| Error::Input(format!("⟨standard_errors={}⟩: {what}", path.display()));
    let curve = curves.iter().find(|curve| curve.name == name);
    let curve: &Curve = match curve {
        Some(curve) => &curve.curve,
        None => return Err(says(format!("there is no column \"{name}\"; give one for each spectrum"))),
    };
    let known = curve.wavelengths_nm();
    match wavelengths_nm.iter().find(|nm| !known.contains(nm)) {
        Some(nm) => Err(says(format!(
            "column \"{name}\" has no value at {nm} nm; give the wavelengths of the spectrum"
        ))),
        None => Ok(wavelengths_nm.iter().map(|nm| curve.at(*nm)).collect()),
    }
}

/// Writes all files of the results.
fn write(out: OutputFolder, report: &FittedSpectra) -> Result<PathBuf> {
    let mut files = vec![
        ("fit.csv".to_string(), fit_table(report).into_bytes()),
        ("results.json".to_string(), serde_json::to_string_pretty(&report)?.into_bytes()),
    ];
    if report.fitted.iter().any(|fitted| fitted.sets.is_some()) {
        files.push(("sets.csv".to_string(), sets_table(report).into_bytes()));
    }
    for (number, fitted) in report.fitted.iter().enumerate() {
        let name = if report.fitted.len() == 1 { "fit".into() } else { format!("fit_{:02}", number + 1) };
        files.extend(figure_files(&name, &figure(report, fitted))?);
    }
    Ok(out.finish_with(files)?)
}
