//! A flat sample in numbers, without geometry.

use std::path::Path;

use clap::ValueHint;
use fluorspar::pipeline::{Prediction, predict as predict_sample};
use fluorspar::units::number_text;
use fluorspar_experiment::{ResolvedSample, SampleCompatibility};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::values::{self, Override, number, quoted};
use crate::{Changes, Error, ExperimentSource, Job, Result, named_spectra};

/// Which flat sample is predicted, with which changes.
#[derive(Clone, Debug, Default, Deserialize, clap::Args)]
#[serde(default)]
pub struct PredictOptions {
    /// Sample file (.toml) or the name of a built-in sample [default: tongue-385nm].
    #[arg(value_name = "SAMPLE", value_hint = ValueHint::FilePath)]
    pub sample: Option<String>,
    /// Changes by path.
    #[command(flatten)]
    #[serde(flatten)]
    pub changes: Changes,
    /// Light: a name of the catalogue or a CSV file.
    #[arg(long, value_name = "NAME|CSV")]
    pub light: Option<String>,
    /// Irradiance of the sample behind the light's filters, W/m².
    #[arg(long, value_name = "W_PER_M2", value_parser = values::number, allow_negative_numbers = true)]
    pub irradiance: Option<f64>,
    /// Filter on the light, instead of those of the sample: a name of the catalogue, a CSV file or a number from 0 to 1. May
    /// be repeated; `none` means no filter.
    #[arg(long, value_name = "NAME|CSV|T", allow_negative_numbers = true)]
    pub light_filter: Vec<String>,
    /// Reflectance of the sample, diffuse: a name of the catalogue, a CSV file or a number from 0 to 1.
    #[arg(long, value_name = "NAME|CSV|R", allow_negative_numbers = true)]
    pub reflectance: Option<String>,
    /// Concentration of a fluorophore. May be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    pub concentration: Vec<String>,
    /// Filter in front of the lens, instead of those of the sample. As `--light-filter`.
    #[arg(long, value_name = "NAME|CSV|T", allow_negative_numbers = true)]
    pub view_filter: Vec<String>,
    /// Exposure time in milliseconds, or `auto`.
    #[arg(long, value_name = "MS|auto", allow_negative_numbers = true)]
    pub exposure_ms: Option<String>,
    /// Step between wavelength bands, which is their width, nm.
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    pub step_nm: Option<f64>,
    /// Equations to use: Fluorspar's, ISETCam's sensor, or the normalized matrices of the authors' toolbox as well.
    #[arg(long, value_parser = values::choice::<SampleCompatibility>(&["none", "isetcam", "toolbox-eem"]), value_name = "WHOSE")]
    pub compatibility: Option<SampleCompatibility>,
}

/// Spectra and mean sensor values of a flat sample.
#[derive(Clone, Debug, Serialize)]
pub struct PredictedSample {
    /// The sample with its changes.
    #[serde(skip)]
    pub sample: ResolvedSample,
    /// Where it was read from, as messages have it.
    #[serde(skip)]
    pub source: String,
    /// Its numbers.
    #[serde(flatten)]
    pub prediction: Prediction,
    /// Program, units, warnings and the sample as a file.
    pub provenance: Value,
}

/// Predicts a flat sample.
///
/// # Errors
/// A sample or an option that is wrong.
pub fn predict(options: &PredictOptions, job: &Job) -> Result<PredictedSample> {
    let source = ExperimentSource::find_sample(options.sample.as_deref())?;
    let sample = source.resolve_sample(&options.overrides(&source.base_dir)?)?;
    job.warn(&sample.record.warnings);
    let prediction = predict_sample(&sample.sample)?;
    let provenance = provenance(&sample);
    Ok(PredictedSample { sample, source: source.name, prediction, provenance })
}

/// A name of the catalogue, or a file, which is relative to where the program runs and not to the sample's folder.
fn name_or_file(text: &str, folder: &Path) -> String {
    if let Some(table) = named_spectra::absolute_table(text) {
        return table;
    }
    match std::path::absolute(text) {
        Ok(path) if named_spectra::is_file(text) && folder != Path::new(".") => {
            quoted(&path.to_string_lossy())
        }
        _ => quoted(text),
    }
}

/// A number as TOML, or else a name or file.
fn number_or(text: &str, other: impl Fn(&str) -> String) -> String {
    // `nan` and `inf` are names that nothing has.
    number(text).map_or_else(|_| other(text), number_text)
}

/// A list of filters as TOML.
pub fn filter_list(names: &[String], folder: &Path) -> String {
    let items = names.iter().map(|name| number_or(name, |name| name_or_file(name, folder)));
    format!("[{}]", items.collect::<Vec<_>>().join(", "))
}

impl PredictOptions {
    /// All changes; those that were given as `--set` come last and win.
    fn overrides(&self, folder: &Path) -> Result<Vec<Override>> {
        let given = |option: &str, text: &str| format!("⟨{option}={text}⟩");
        let named = |path: &str, option: &str, text: &Option<String>, value: &dyn Fn(&str) -> String| {
            text.as_ref().map(|text| Override::of_option(path, value(text), given(option, text)))
        };
        let filters = |path: &str, option: &str, names: &[String]| {
            let typed: Vec<String> = names.iter().map(|name| given(option, name)).collect();
            let list = filter_list(names, folder);
            (!names.is_empty()).then(|| Override::of_option(path, list, typed.join(" ")))
        };
        let numeric = |path: &str, option: &str, value: Option<f64>| {
            value.map(|value| Override::number(path, value, option))
        };
        let spectrum = |text: &str| name_or_file(text, folder);
        let reflectance = |text: &str| number_or(text, spectrum);
        let mut all = Vec::new();
        all.extend(named("light.spectrum", "light", &self.light, &spectrum));
        all.extend(numeric("light.strength.irradiance_w_per_m2", "irradiance", self.irradiance));
        all.extend(filters("light.filters", "light_filter", &self.light_filter));
        all.extend(named("sample.reflectance", "reflectance", &self.reflectance, &reflectance));
        for text in &self.concentration {
            let parts = text.split_once('=').map(|(name, value)| (name.trim(), number(value)));
            let Some((name, Ok(value))) = parts.filter(|(name, _)| !name.is_empty() && !name.contains('"'))
            else {
                return Err(Error::Input(format!(
                    "⟨concentration={text}⟩: write a name and a number, for instance ⟨concentration=fad=0.2⟩"
                )));
            };
            let path = format!("sample.concentrations.\"{name}\"");
            all.push(Override::of_option(&path, number_text(value), given("concentration", text)));
        }
        all.extend(filters("view_filter.filters", "view_filter", &self.view_filter));
        let exposure = |text: &str| number_or(text, quoted);
        all.extend(named("exposure.exposure_ms", "exposure_ms", &self.exposure_ms, &exposure));
        all.extend(numeric("spectral.step_nm", "step_nm", self.step_nm));
        all.extend(self.compatibility.map(|whose| {
            let name = values::name_of(&whose);
            Override::of_option(
                "compatibility",
                quoted(&name),
                given("compatibility", &name.replace('_', "-")),
            )
        }));
        all.extend(self.changes.overrides());
        Ok(all)
    }
}

fn provenance(ResolvedSample { compatibility, record, .. }: &ResolvedSample) -> Value {
    json!({
        "program": "fluorspar",
        "version": env!("CARGO_PKG_VERSION"),
        "sha256": record.sha256,
        "compatibility": compatibility,
        "units": {
            "wavelength_nm": "nm, centers of the bands",
            "irradiance": "W/(m2 nm)",
            "radiance": "W/(sr m2 nm), from the sample, before any filter",
            "sensor_irradiance": "W/(m2 nm), behind viewing filter and lens",
            "exposure_s": "s",
            "electrons": "mean photo-electrons per pixel",
            "volts": "V at the converter, dark signal included",
            "dn": "DN, black level included, not rounded",
            "noise_dn": "DN rms, temporal noise of one pixel",
            "chromaticity": "1, share of R and of G in R + G + B, from photo-electrons",
            "leak_ratio": "1, reflected over fluorescent electrons",
            "porphyrin": "1, fractions of porphyrin in porphyrin and bulk; electrons are means of one pixel in R, G, B",
            "photon_yield_500_700": "1, photons emitted per photon that arrives",
        },
        "warnings": record.warnings,
        "sample_toml": record.resolved_toml,
    })
}
