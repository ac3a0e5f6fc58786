//! Parameters of a tissue fitted to measured spectra.

use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::names::did_you_mean;
use fluorspar::spectral::Curve;
use fluorspar::tissue::fit::{MeasuredFluorescence, MeasuredReflectance, TissueFit, Viewing};
use fluorspar::tissue::{DiscreteOrdinates, Population, Site};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_format::{Negative, OutputFolder, SpectrumQuantity};
use serde::Deserialize;

use super::fit_files::{FittedTissue, figure, residuals, section};
use super::source::{SiteOptions, find};
use crate::figure_file::figure_files;
use crate::options::defaults;
use crate::values::{self, check_range};
use crate::{Error, Job, Result, named_spectra};

/// A section, a table, results and a figure.
const FOLDER_BYTES: u64 = 16 << 20;
/// Wavelengths that can be fitted, nm.
const WAVELENGTH_NM: [f64; 2] = [350.0, 800.0];

/// Which tissue is fitted to which spectra.
#[derive(Clone, Debug, Deserialize, clap::Args)]
#[serde(default = "defaults")]
pub struct TissueFitOptions {
    /// The tissue.
    #[command(flatten)]
    #[serde(flatten)]
    pub site: SiteOptions,
    /// Reflectance as measured, 0 to 1 (CSV, its first spectrum), surface reflection excluded. May be repeated.
    #[arg(long, value_name = "CSV", value_hint = ValueHint::FilePath)]
    pub reflectance: Vec<String>,
    /// Measured fluorescence, energy per nm (CSV, its first spectrum). May be repeated, with a --light for each.
    #[arg(long, value_name = "CSV", value_hint = ValueHint::FilePath)]
    pub fluorescence: Vec<String>,
    /// Light of the fluorescence in the same place: a name of the catalogue or a CSV file.
    #[arg(long, value_name = "NAME|CSV")]
    pub light: Vec<String>,
    /// Filter before the instrument: a name of the catalogue or a CSV file. May be repeated.
    #[arg(long, alias = "filter", value_name = "NAME|CSV")]
    pub view_filter: Vec<String>,
    /// What the instrument sees of a white target through the filter, in the same place: energy per nm over the energy of the
    /// light, 1/nm (CSV). One for each fluorescence, or none.
    #[arg(long, value_name = "CSV", value_hint = ValueHint::FilePath)]
    pub leak: Vec<String>,
    /// Fit this parameter only, instead of all that vary among people. May be repeated.
    #[arg(long, value_name = "NAME")]
    pub free: Vec<String>,
    /// Keep this parameter at its value. May be repeated.
    #[arg(long, value_name = "NAME")]
    pub hold: Vec<String>,
    /// Factor on the standard deviations of the prior, which are those among people.
    #[arg(long, value_name = "F", default_value_t = 1.0, value_parser = values::number, allow_negative_numbers = true)]
    pub prior_width: f64,
    /// Standard deviation of the reflectance, of measurement and model.
    #[arg(long, value_name = "E", default_value_t = 0.01, value_parser = values::number, allow_negative_numbers = true)]
    pub reflectance_error: f64,
    /// Standard deviation of the shape of the fluorescence, relative, of measurement and model.
    #[arg(long, value_name = "E", default_value_t = 0.05, value_parser = values::number, allow_negative_numbers = true)]
    pub shape_error: f64,
    /// Standard deviation of the logarithm of the scale of each fluorescence; 0 where it is over the energy of the light on a
    /// white target, 1/nm, and exact [default: the scale is unknown].
    #[arg(long, value_name = "E", value_parser = values::number, allow_negative_numbers = true)]
    pub scale_error: Option<f64>,
    /// First wavelength that is used of the fluorescence, nm [default: that of the file].
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    pub from_nm: Option<f64>,
    /// Last wavelength that is used of the fluorescence, nm [default: that of the file].
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    pub to_nm: Option<f64>,
    /// Step to which spectra are averaged, nm.
    #[arg(long, value_name = "NM", default_value_t = 5.0, value_parser = values::number, allow_negative_numbers = true)]
    pub step_nm: f64,
    /// Name of the fitted tissue.
    #[arg(long, value_name = "NAME", default_value = "fitted")]
    pub name: String,
    /// Folder for tissue.toml (a [[tissue]] section), results.json, residuals.csv and fit.svg, fit.png [default: none].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// Fits a tissue, and writes the results into the folder of the options.
///
/// # Errors
/// An option out of its range or without a meaning, spectra that can't be read or fitted, a folder that can't be written.
pub fn fit(options: &TissueFitOptions, job: &Job) -> Result<FittedTissue> {
    options.check()?;
    let (title, site) = options.site.resolve_site()?;
    options.check_base(&site)?;
    let prior = options.prior(&site)?;
    let files =
        [&options.reflectance, &options.fluorescence, &options.light, &options.view_filter, &options.leak];
    let inputs = options.site.file().into_iter().chain(files.into_iter().flatten().map(PathBuf::from));
    let inputs: Vec<PathBuf> = inputs.collect();
    let out =
        options.out.as_ref().map(|out| OutputFolder::prepare(out, &inputs, FOLDER_BYTES)).transpose()?;
    let reflectances = options.reflectances(job)?;
    let fluorescences = options.fluorescences(job)?;
    let fit = TissueFit { prior: &prior, find: &find, solver: DiscreteOrdinates::DIFFUSE };
    let found = fit.fit(&reflectances, &fluorescences)?;
    if !found.converged {
        let steps = found.steps;
        job.warn(&[format!("the search did not settle in {steps} steps; a narrower prior may help").into()]);
    }
    let found = FittedTissue { name: options.name.clone(), title, fit: found };
    if let Some(out) = out {
        job.status(format!("Wrote {}", write(out, &found)?.display()));
    }
    Ok(found)
}

impl TissueFitOptions {
    fn check(&self) -> Result<()> {
        for (option, value, range, unit) in [
            ("prior_width", self.prior_width, [0.01, 100.0], ""),
            ("reflectance_error", self.reflectance_error, [1e-4, 1.0], ""),
            ("shape_error", self.shape_error, [1e-4, 10.0], ""),
            ("scale_error", self.scale_error.unwrap_or(0.0), [0.0, 100.0], ""),
            ("step_nm", self.step_nm, [1.0, 50.0], "nm"),
            ("from_nm", self.from_nm.unwrap_or(WAVELENGTH_NM[0]), WAVELENGTH_NM, "nm"),
            ("to_nm", self.to_nm.unwrap_or(WAVELENGTH_NM[1]), WAVELENGTH_NM, "nm"),
        ] {
            check_range(option, value, range, unit)?;
        }
        let (spectra, lights, leaks) = (self.fluorescence.len(), self.light.len(), self.leak.len());
        if self.reflectance.is_empty() && spectra == 0 {
            return Err(Error::Input("give ⟨reflectance=CSV⟩, ⟨fluorescence=CSV⟩ or both".into()));
        }
        if lights != spectra {
            return Err(Error::Input(format!(
                "⟨fluorescence⟩ is given {spectra} times and ⟨light⟩ {lights} times; give one light for each spectrum, in the \
                 same order"
            )));
        }
        if leaks != 0 && leaks != spectra {
            return Err(Error::Input(format!(
                "⟨leak⟩ is given {leaks} times and ⟨fluorescence⟩ {spectra} times; give one for each spectrum, or none"
            )));
        }
        Ok(())
    }

    /// The site must be one that the written section can name.
    fn check_base(&self, site: &Site) -> Result<()> {
        if self.out.is_none() || preset::names(PresetKind::Site).contains(&site.name()) {
            return Ok(());
        }
        Err(Error::Input(format!(
            "⟨out⟩: a fit is written as changes of a site of the catalogue, and \"{}\" is none; put its file into the folder sites of \
             the catalogue that FLUORSPAR_CATALOGUE names",
            site.name()
        )))
    }

    /// What may vary, and how much.
    fn prior(&self, site: &Site) -> Result<Population> {
        let all = Population::of(site).widened(self.prior_width);
        let is = |variation: &fluorspar::tissue::Variation, name: &str| {
            variation.name == name || variation.parameters.contains(&name)
        };
        for (option, name) in
            self.free.iter().map(|name| ("free", name)).chain(self.hold.iter().map(|name| ("hold", name)))
        {
            if !all.variations().iter().any(|variation| is(variation, name)) {
                let known: Vec<&str> = all.variations().iter().map(|variation| variation.name).collect();
                let hint = did_you_mean(name, known.iter().copied());
                return Err(Error::Input(format!(
                    "⟨{option}={name}⟩: this does not vary in {}{hint} What varies: {}; what is 0 needs a value first (⟨set⟩)",
                    site.name(),
                    known.join(", ")
                )));
            }
        }
        Ok(all.restricted(|variation| {
            let named = |names: &[String]| names.iter().any(|name| is(variation, name));
            (self.free.is_empty() || named(&self.free)) && !named(&self.hold)
        }))
    }

    /// Averages over steps around multiples of the step, between two wavelengths.
    fn sampled(
        &self,
        name: &str,
        quantity: SpectrumQuantity,
        [from_nm, to_nm]: [f64; 2],
        job: &Job,
    ) -> Result<(Vec<f64>, Vec<f64>)> {
        let curve = named_spectra::one_column(name, quantity, Negative::Keep, job)?;
        let (first, last) = curve.range_nm();
        let (first, last) = (first.max(from_nm), last.min(to_nm));
        let half = 0.5 * self.step_nm;
        let number = |nm: f64| nm / self.step_nm;
        let steps = number(first).ceil() as i64..=number(last).floor() as i64;
        let nm: Vec<f64> = steps.map(|step| step as f64 * self.step_nm).collect();
        let mean = |nm: &f64| {
            let [from, to] = [(nm - half).max(first), (nm + half).min(last)];
            curve.integral(from, to) / (to - from)
        };
        let values = nm.iter().map(mean).collect();
        Ok((nm, values))
    }

    fn reflectances(&self, job: &Job) -> Result<Vec<MeasuredReflectance>> {
        let read = |name: &String| {
            let (wavelengths_nm, values) =
                self.sampled(name, SpectrumQuantity::Fraction, WAVELENGTH_NM, job)?;
            if values.iter().any(|value| *value > 1.0) {
                let message = format!("{name}: reflectance is at most 1; are the values in percent?");
                return Err(Error::Input(message));
            }
            Ok(MeasuredReflectance {
                name: name.clone(),
                wavelengths_nm,
                values,
                error: self.reflectance_error,
            })
        };
        self.reflectance.iter().map(read).collect()
    }

    fn fluorescences(&self, job: &Job) -> Result<Vec<MeasuredFluorescence>> {
        let filter = named_spectra::filters(&self.view_filter, job)?;
        let used = [self.from_nm.unwrap_or(WAVELENGTH_NM[0]), self.to_nm.unwrap_or(WAVELENGTH_NM[1])];
        let read = |(i, (name, light)): (usize, (&String, &String))| {
            let mut viewing = Viewing::new(&named_spectra::light(light, job)?, filter.clone())?;
            if let Some(leak) = self.leak.get(i) {
                let leak: Curve = named_spectra::one_column(
                    leak,
                    SpectrumQuantity::SpectralPower,
                    Negative::ClipToZero,
                    job,
                )?;
                viewing = viewing.with_leak(leak);
            }
            let (wavelengths_nm, values) = self.sampled(name, SpectrumQuantity::SpectralPower, used, job)?;
            Ok(MeasuredFluorescence {
                name: format!("{name} under {}", named_spectra::label(light)),
                viewing,
                wavelengths_nm,
                values,
                relative_error: self.shape_error,
                scale_uncertainty: self.scale_error.unwrap_or(f64::INFINITY),
            })
        };
        self.fluorescence.iter().zip(&self.light).enumerate().map(read).collect()
    }
}

/// Writes all files of the results.
fn write(out: OutputFolder, found: &FittedTissue) -> Result<PathBuf> {
    let files = [
        ("tissue.toml".into(), section(found)?.into_bytes()),
        ("results.json".into(), serde_json::to_string_pretty(found)?.into_bytes()),
        ("residuals.csv".into(), residuals(found).into_bytes()),
    ];
    Ok(out.finish_with(files.into_iter().chain(figure_files("fit", &figure(found))?))?)
}
