//! `fluorspar fluorophore fit`.

use std::path::{Path, PathBuf};

use clap::ValueHint;
use fluorspar::analysis::{ComponentSets, FitError, MixtureFit, SpectralMixture};
use fluorspar::spectral::Curve;
use fluorspar_format::{
    NamedCurve, Negative, OutputFolder, SpectrumColumns, SpectrumOptions, SpectrumQuantity, read_spectra,
};

use super::FileOptions;
use super::fit_components::Components;
use super::fit_output::{FitReport, as_json, describe, figure, fit_table, sets_table};
use crate::args::Answer;
use crate::commands::{print_json, print_text};
use crate::error::CliError;
use crate::message::Messages;
use crate::values::{self, check_range};

/// Two tables and results, and two figures for each spectrum.
const FOLDER_BYTES: u64 = 32 << 20;
/// Wavelengths that can be fitted, nm.
const WAVELENGTH_NM: [f64; 2] = [350.0, 800.0];
/// Most samples of a spectrum.
const MOST_SAMPLES: usize = 10_000;

/// Options of `fluorophore fit`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    /// Measured spectra (CSV): energy per nm, one spectrum in each column beside the wavelength.
    #[arg(value_name = "CSV", value_hint = ValueHint::FilePath)]
    pub(super) spectra: PathBuf,
    /// Column to fit. May be repeated [default: all].
    #[arg(long, value_name = "NAME")]
    column: Vec<String>,
    /// Fluorophore that the spectra may hold: names of the catalogue or files, separated by commas. May be repeated.
    #[arg(long, value_name = "NAME|FILE", value_delimiter = ',')]
    pub(super) fluorophore: Vec<String>,
    /// Component besides fluorophores, as the instrument would see it: each spectrum of a CSV file. May be repeated.
    #[arg(long, value_name = "CSV", value_hint = ValueHint::FilePath)]
    pub(super) component: Vec<PathBuf>,
    /// Light that excites the fluorophores: a name of the catalogue or a CSV file.
    #[arg(long, value_name = "NAME|CSV")]
    pub(super) light: Option<String>,
    /// Filter on the light: a name of the catalogue or a CSV file. May be repeated.
    #[arg(long, value_name = "NAME|CSV")]
    pub(super) light_filter: Vec<String>,
    /// Filter before the instrument: a name of the catalogue or a CSV file. May be repeated.
    #[arg(long = "view-filter", alias = "filter", value_name = "NAME|CSV")]
    pub(super) filter: Vec<String>,
    /// Irradiance of the sample behind the light's filters, W/m², where the spectra are radiances in W/(sr m² nm).
    #[arg(long, value_name = "W_PER_M2", value_parser = values::number, allow_negative_numbers = true)]
    pub(super) irradiance: Option<f64>,
    /// Take the spectra as relative: weights then tell ratios of concentrations.
    #[arg(long, conflicts_with = "irradiance")]
    pub(super) relative: bool,
    /// Component below one layer of blood, whose optical density is fitted. May be repeated.
    #[arg(long, value_name = "NAME", conflicts_with = "tissue")]
    pub(super) below_blood: Vec<String>,
    /// Tissue in whose layers the fluorophores lie, and whose blood is fitted: a site of the catalogue or a file with one [[tissue]]
    /// section. Without --fluorophore all that it holds.
    #[arg(long, value_name = "SITE|FILE")]
    pub(super) tissue: Option<String>,
    /// Fit one amount of blood that all spectra have in common.
    #[arg(long)]
    common_blood: bool,
    /// Standard errors of the spectra (CSV): the same columns and wavelengths [default: from the residuals].
    #[arg(long, value_name = "CSV", value_hint = ValueHint::FilePath)]
    standard_errors: Option<PathBuf>,
    /// First wavelength that is used, nm [default: that of the file].
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    from_nm: Option<f64>,
    /// Last wavelength that is used, nm [default: that of the file].
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    to_nm: Option<f64>,
    /// Difference from the best set, by AICc, up to which a set of components counts as supported.
    #[arg(long, value_name = "DELTA", default_value_t = 4.0, value_parser = values::number, allow_negative_numbers = true)]
    within: f64,
    /// Fit all components only, and compare no sets of them.
    #[arg(long)]
    no_sets: bool,
    #[command(flatten)]
    pub(super) file: FileOptions,
    /// Folder for fit.csv, sets.csv, results.json and a figure of each spectrum (SVG and PNG) [default: none].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    out: Option<PathBuf>,
    #[command(flatten)]
    answer: Answer,
}

/// A spectrum within the wavelengths that are used.
struct Measured {
    name: String,
    wavelengths_nm: Vec<f64>,
    values: Vec<f64>,
    errors: Option<Vec<f64>>,
}

/// A spectrum and what was found of it.
pub(super) struct Fitted {
    pub(super) name: String,
    pub(super) wavelengths_nm: Vec<f64>,
    pub(super) measured: Vec<f64>,
    pub(super) fit: MixtureFit,
    pub(super) sets: Option<ComponentSets>,
}

pub(super) fn run(options: &Options) -> Result<(), CliError> {
    options.check()?;
    let out = options
        .out
        .as_ref()
        .map(|out| OutputFolder::prepare(out, &options.inputs(), FOLDER_BYTES))
        .transpose()?;
    let measured = options.measured()?;
    let components = Components::read(options)?;
    let mixtures = mixtures(&components, &measured)?;
    let common = if options.common_blood { Some(options.common_blood(&measured, &mixtures)?) } else { None };
    let mut fitted = Vec::new();
    for (spectrum, mixture) in measured.iter().zip(&mixtures) {
        let found = options.fit(spectrum, mixture, common);
        fitted.push(found.map_err(|error| options.wrong(Some(&spectrum.name), &error))?);
    }
    let report = FitReport {
        file: options.spectra.display().to_string(),
        light: components.light(),
        unit: components.unit(),
        weight_unit: components.weight_unit(),
        blood: components.blood(),
        common_blood: common,
        fitted,
    };
    if let Some(out) = out {
        let place = write(out, &report)?;
        Messages::default().status(format!("Wrote {}", place.display()));
    }
    if options.answer.json { print_json(&as_json(&report)?) } else { print_text(&describe(&report)) }
}

/// The components at the wavelengths of each spectrum, made once for spectra that share them.
fn mixtures(components: &Components, measured: &[Measured]) -> Result<Vec<SpectralMixture>, CliError> {
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

impl Options {
    fn check(&self) -> Result<(), CliError> {
        self.check_numbers()?;
        let says = |message: &str| Err(CliError::Input(message.into()));
        let has_fluorophores = !self.fluorophore.is_empty() || self.tissue.is_some();
        if !has_fluorophores && self.component.is_empty() {
            return says(
                "there is nothing to fit with; give --fluorophore with names of the catalogue (`fluorspar catalog list fluorophore`), \
                 --tissue or --component",
            );
        }
        if has_fluorophores && self.light.is_none() {
            return says("give the light that excites the fluorophores, for instance --light led_405");
        }
        if has_fluorophores && self.irradiance.is_none() && !self.relative {
            return says(
                "give --irradiance, W/m² on the sample, for spectra in W/(sr m² nm), or --relative for spectra of any scale",
            );
        }
        if self.common_blood && self.below_blood.is_empty() && self.tissue.is_none() {
            return says(
                "--common-blood: there is no blood; give --below-blood or --tissue, or leave it out",
            );
        }
        Ok(())
    }

    fn check_numbers(&self) -> Result<(), CliError> {
        for (option, value, range, unit) in [
            ("--from-nm", self.from_nm.unwrap_or(WAVELENGTH_NM[0]), WAVELENGTH_NM, "nm"),
            ("--to-nm", self.to_nm.unwrap_or(WAVELENGTH_NM[1]), WAVELENGTH_NM, "nm"),
            ("--irradiance", self.irradiance.unwrap_or(1.0), [1e-9, 1e9], "W/m²"),
            ("--within", self.within, [0.0, 1000.0], ""),
        ] {
            check_range(option, value, range, unit)?;
        }
        Ok(())
    }

    fn inputs(&self) -> Vec<PathBuf> {
        let names = [&self.fluorophore, &self.light_filter, &self.filter].into_iter().flatten();
        let names = names.chain(&self.light).chain(&self.tissue).map(PathBuf::from);
        names
            .chain(self.component.iter().cloned())
            .chain(self.standard_errors.clone())
            .chain([self.spectra.clone()])
            .collect()
    }

    /// An error that names file and column.
    fn wrong(&self, column: Option<&str>, error: &FitError) -> CliError {
        let fix = match error {
            FitError::ManySets { .. } => ", or --no-sets",
            FitError::FewSamples { .. } => ": take components away, or use more wavelengths",
            _ => "",
        };
        let column = column.map_or_else(String::new, |column| format!(", column \"{column}\""));
        CliError::Input(format!("{}{column}: {error}{fix}", self.spectra.display()))
    }

    fn read(&self, path: &Path) -> Result<Vec<NamedCurve>, CliError> {
        let columns = match self.column.is_empty() {
            true => SpectrumColumns::All,
            false => SpectrumColumns::Named(self.column.clone()),
        };
        // Absolute spectra are radiances, whatever their header
        let quantity = match self.irradiance {
            Some(_) => SpectrumQuantity::Stored,
            None => SpectrumQuantity::SpectralPower,
        };
        let options = SpectrumOptions {
            columns,
            quantity,
            negative: Negative::Keep,
            skip_empty_cells: true,
            unit: None,
        };
        let read = read_spectra(path, &options)?;
        if !read.read_as.is_empty() {
            Messages::default().status(format!("{}: read as {}", path.display(), read.read_as.join("; ")));
        }
        Ok(read.curves)
    }

    /// The columns that are fitted, within the wavelengths that are used.
    fn measured(&self) -> Result<Vec<Measured>, CliError> {
        let curves = self.read(&self.spectra)?;
        let errors = self.standard_errors.as_ref().map(|path| Ok::<_, CliError>((path, self.read(path)?)));
        let errors = errors.transpose()?;
        let (from, to) = (self.from_nm.unwrap_or(WAVELENGTH_NM[0]), self.to_nm.unwrap_or(WAVELENGTH_NM[1]));
        let measured = |NamedCurve { name, curve, standard_error }: &NamedCurve| {
            let used = |nm: &f64| (from..=to).contains(nm);
            let samples = || curve.wavelengths_nm().iter().zip(curve.values()).filter(|(nm, _)| used(nm));
            let wavelengths_nm: Vec<f64> = samples().map(|(nm, _)| *nm).collect();
            let count = wavelengths_nm.len();
            if !(1..=MOST_SAMPLES).contains(&count) {
                return Err(CliError::Input(format!(
                    "{}, column \"{name}\": {count} samples between {from} and {to} nm; give wavelengths that hold 1 to \
                     {MOST_SAMPLES} of them (--from-nm, --to-nm)",
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

    fn common_blood(&self, measured: &[Measured], mixtures: &[SpectralMixture]) -> Result<f64, CliError> {
        let other = measured.iter().find(|spectrum| spectrum.wavelengths_nm != measured[0].wavelengths_nm);
        if let Some(other) = other {
            return Err(CliError::Input(format!(
                "--common-blood: column \"{}\" has other wavelengths than \"{}\"; choose a range that all have (--from-nm, --to-nm)",
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
    ) -> Result<Fitted, FitError> {
        let held = common.map(|amount| mixture.behind(amount));
        let mixture = held.as_ref().unwrap_or(mixture);
        let errors = spectrum.errors.as_deref();
        let fit = mixture.fit(&spectrum.values, errors)?;
        let sets = match self.no_sets {
            true => None,
            false => Some(mixture.sets(&spectrum.values, errors, &fit, self.within)?),
        };
        Ok(Fitted {
            name: spectrum.name.clone(),
            wavelengths_nm: spectrum.wavelengths_nm.clone(),
            measured: spectrum.values.clone(),
            fit,
            sets,
        })
    }
}

/// Standard errors of a column, at its wavelengths.
fn errors_at(
    path: &Path,
    curves: &[NamedCurve],
    name: &str,
    wavelengths_nm: &[f64],
) -> Result<Vec<f64>, CliError> {
    let says = |what: String| CliError::Input(format!("--standard-errors {}: {what}", path.display()));
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
fn write(out: OutputFolder, report: &FitReport) -> Result<PathBuf, CliError> {
    let mut files = vec![
        ("fit.csv".to_string(), fit_table(report).into_bytes()),
        ("results.json".to_string(), serde_json::to_string_pretty(&as_json(report)?)?.into_bytes()),
    ];
    if report.fitted.iter().any(|fitted| fitted.sets.is_some()) {
        files.push(("sets.csv".to_string(), sets_table(report).into_bytes()));
    }
    for (number, fitted) in report.fitted.iter().enumerate() {
        let name = if report.fitted.len() == 1 { "fit".into() } else { format!("fit_{:02}", number + 1) };
        let figure = figure(report, fitted);
        files.push((format!("{name}.svg"), figure.to_svg().into_bytes()));
        files.push((format!("{name}.png"), figure.to_png()?));
    }
    Ok(out.finish_with(files)?)
}
