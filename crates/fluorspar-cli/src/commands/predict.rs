//! `fluorspar predict`: a flat sample in numbers.

use std::path::Path;
use std::process::ExitCode;

use clap::{ValueEnum, ValueHint};
use fluorspar::pipeline::{ChannelPrediction, Prediction, predict};
use fluorspar::study::FlatSample;
use fluorspar::units::number_text;
use fluorspar_experiment::{ResolvedSample, SampleCompatibility};
use serde_json::{Value, json};

use super::quoted;
use super::table::{align, short};
use crate::args::{Answer, Changes};
use crate::error::CliError;
use crate::experiment_source::ExperimentSource;
use crate::message::Messages;
use crate::named_spectra;
use crate::values::{self, Override, number};

/// Options of `predict`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Sample file (.toml) or the name of a built-in sample [default: tongue-385nm].
    #[arg(value_name = "SAMPLE", value_hint = ValueHint::FilePath)]
    sample: Option<String>,
    #[command(flatten)]
    changes: Changes,
    /// Light: a name of the catalogue or a CSV file.
    #[arg(long, value_name = "NAME|CSV")]
    light: Option<String>,
    /// Irradiance of the sample behind the light's filters, W/m².
    #[arg(long, value_name = "W_PER_M2", value_parser = values::number, allow_negative_numbers = true)]
    irradiance: Option<f64>,
    /// Filter on the light, instead of those of the sample: a name of the catalogue, a CSV file or a number from 0 to 1. May
    /// be repeated; `none` means no filter.
    #[arg(long, value_name = "NAME|CSV|T", allow_negative_numbers = true)]
    light_filter: Vec<String>,
    /// Reflectance of the sample, diffuse: a name of the catalogue, a CSV file or a number from 0 to 1.
    #[arg(long, value_name = "NAME|CSV|R", allow_negative_numbers = true)]
    reflectance: Option<String>,
    /// Concentration of a fluorophore. May be repeated.
    #[arg(long, value_name = "NAME=VALUE")]
    concentration: Vec<String>,
    /// Filter in front of the lens, instead of those of the sample. As `--light-filter`.
    #[arg(long, value_name = "NAME|CSV|T", allow_negative_numbers = true)]
    view_filter: Vec<String>,
    /// Exposure time in milliseconds, or `auto`.
    #[arg(long, value_name = "MS|auto", allow_negative_numbers = true)]
    exposure_ms: Option<String>,
    /// Step between wavelength bands, which is their width, nm.
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    step_nm: Option<f64>,
    /// Equations to use: Fluorspar's, ISETCam's sensor, or the normalized matrices of the authors' toolbox as well.
    #[arg(long, value_enum, value_name = "WHOSE")]
    compatibility: Option<Compatibility>,
    #[command(flatten)]
    answer: Answer,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Compatibility {
    None,
    Isetcam,
    ToolboxEem,
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
pub(crate) fn filter_list(names: &[String], folder: &Path) -> String {
    let items = names.iter().map(|name| number_or(name, |name| name_or_file(name, folder)));
    format!("[{}]", items.collect::<Vec<_>>().join(", "))
}

impl Options {
    /// All changes; those that were given as `--set` come last and win.
    fn overrides(&self, folder: &Path) -> Result<Vec<Override>, CliError> {
        let mut all = Vec::new();
        let named = |path: &str, option: &str, text: &String, value: String| {
            Override::of_option(path, value, format!("{option} {text}"))
        };
        let filters = |path: &str, option: &str, names: &[String]| {
            let typed: Vec<String> = names.iter().map(|name| format!("{option} {name}")).collect();
            (!names.is_empty())
                .then(|| Override::of_option(path, filter_list(names, folder), typed.join(" ")))
        };
        all.extend(
            self.light
                .as_ref()
                .map(|text| named("light.spectrum", "--light", text, name_or_file(text, folder))),
        );
        all.extend(
            self.irradiance
                .map(|value| Override::number("light.strength.irradiance_w_per_m2", value, "--irradiance")),
        );
        all.extend(filters("light.filters", "--light-filter", &self.light_filter));
        all.extend(self.reflectance.as_ref().map(|text| {
            let value = number_or(text, |text| name_or_file(text, folder));
            named("sample.reflectance", "--reflectance", text, value)
        }));
        for text in &self.concentration {
            let parts = text.split_once('=').map(|(name, value)| (name.trim(), number(value)));
            match parts {
                Some((name, Ok(value))) if !name.is_empty() && !name.contains('"') => {
                    let path = format!("sample.concentrations.\"{name}\"");
                    all.push(Override::of_option(
                        &path,
                        number_text(value),
                        format!("--concentration {text}"),
                    ));
                }
                _ => {
                    return Err(CliError::Input(format!(
                        "--concentration {text}: write a name and a number, for instance --concentration fad=0.2"
                    )));
                }
            }
        }
        all.extend(filters("view_filter.filters", "--view-filter", &self.view_filter));
        all.extend(
            self.exposure_ms
                .as_ref()
                .map(|text| named("exposure.exposure_ms", "--exposure-ms", text, number_or(text, quoted))),
        );
        all.extend(self.step_nm.map(|value| Override::number("spectral.step_nm", value, "--step-nm")));
        all.extend(self.compatibility.map(|whose| {
            let (typed, value) = match whose {
                Compatibility::None => ("none", "none"),
                Compatibility::Isetcam => ("isetcam", "isetcam"),
                Compatibility::ToolboxEem => ("toolbox-eem", "toolbox_eem"),
            };
            Override::of_option("compatibility", quoted(value), format!("--compatibility {typed}"))
        }));
        all.extend(self.changes.overrides());
        Ok(all)
    }
}

pub(crate) fn run(options: &Options) -> Result<ExitCode, CliError> {
    let source = ExperimentSource::find_sample(options.sample.as_deref())?;
    let overrides = options.overrides(&source.base_dir)?;
    let sample = source.resolve_sample(&overrides)?;
    Messages::default().warnings(&sample.record.warnings);
    let prediction = predict(&sample.sample)?;
    if options.answer.json {
        super::print_json(&as_json(&sample, &prediction)?)?;
    } else {
        super::print_text(&describe(&sample, &source.name, &prediction))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn as_json(sample: &ResolvedSample, prediction: &Prediction) -> Result<Value, CliError> {
    let mut value = serde_json::to_value(prediction)?;
    value["provenance"] = json!({
        "program": "fluorspar",
        "version": env!("CARGO_PKG_VERSION"),
        "sha256": sample.record.sha256,
        "compatibility": sample.compatibility,
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
        "warnings": sample.record.warnings,
        "sample_toml": sample.record.resolved_toml,
    });
    Ok(value)
}

/// Channels as people name them: R, G and B first, in this order.
fn in_usual_order(prediction: &Prediction) -> Vec<(&String, &ChannelPrediction)> {
    let place = |name: &str| ["R", "G", "B"].iter().position(|usual| *usual == name).unwrap_or(3);
    let mut channels: Vec<_> = prediction.channels.iter().collect();
    channels.sort_by_key(|(name, _)| place(name));
    channels
}

/// The irradiance, and how much of it the wavelengths of the sample leave out.
fn light_on_sample(sample: &FlatSample, inside: f64) -> String {
    let all = sample.irradiance.total();
    if (all - inside).abs() <= 1e-5 * all {
        return format!("{} W/m2", short(all));
    }
    let (from, to) = (sample.grid.start_nm(), sample.grid.end_nm());
    format!("{} W/m2 ({} of it between {from} and {to} nm, the rest is left out)", short(all), short(inside))
}

fn describe(resolved: &ResolvedSample, source: &str, prediction: &Prediction) -> String {
    let title = if resolved.record.title.is_empty() {
        Path::new(source)
            .file_name()
            .map_or_else(|| source.into(), |name| name.to_string_lossy().into_owned())
    } else {
        resolved.record.title.clone()
    };
    let mut text = format!("{title}\n\n");
    for (name, value) in facts(resolved, prediction) {
        text += &format!("{name:<20} {value}\n");
    }
    let channels = in_usual_order(prediction);
    text += &format!("\n{}", align(&radiance_rows(&resolved.sample, prediction, &channels), &[]));
    if !channels.is_empty() {
        text += &format!("\n{}", align(&channel_rows(&channels), &[]));
    }
    text
}

/// Integral of a density over the bands of a sample.
fn integral(sample: &FlatSample, values: &[f64]) -> f64 {
    values.iter().zip(sample.grid.widths_nm()).map(|(v, w)| v * w).sum()
}

/// Wavelength of the largest value, a dash without any.
fn peak_nm(prediction: &Prediction, values: &[f64]) -> String {
    let best = (0..values.len()).fold(0, |best, b| if values[b] > values[best] { b } else { best });
    if values.iter().any(|v| *v > 0.0) { format!("{}", prediction.wavelength_nm[best]) } else { "-".into() }
}

/// What is known of the sample as a whole.
fn facts(resolved: &ResolvedSample, prediction: &Prediction) -> Vec<(&'static str, String)> {
    let sample = &resolved.sample;
    let light = light_on_sample(sample, integral(sample, &prediction.irradiance));
    let peak = peak_nm(prediction, &prediction.irradiance);
    let mut facts = vec![("light on the sample", format!("{light}, peak at {peak} nm"))];
    if let Some(value) = prediction.photon_yield_500_700 {
        facts.push(("photons out", format!("{value:.3e} between 500 and 700 nm per photon in")));
    }
    if let Some(seconds) = prediction.exposure_s {
        facts.push(("exposure", format!("{} ms, gain {}", short(seconds * 1e3), sample.exposure.gain)));
    }
    if let Some(leak) = prediction.leak_ratio {
        facts.push(("leak", format!("{} reflected per fluorescent electron", short(leak))));
    }
    if let Some(porphyrin) = &prediction.porphyrin {
        let estimate = &porphyrin.measured.estimate;
        let [low, high] = estimate.fraction_interval;
        let value = format!(
            "{:.4} from the color of one pixel ({low:.4} to {high:.4} by sensor noise), true {:.4}; of {} over it and one unit of all others, \
             no share of the light",
            estimate.fraction, porphyrin.true_fraction, porphyrin.name
        );
        facts.push(("ratio of amounts", value));
    }
    if resolved.compatibility == SampleCompatibility::ToolboxEem {
        let value = "the authors' toolbox: matrices of peak 1, so fluorescence has no absolute level";
        facts.push(("equations", value.into()));
    }
    facts
}

/// Table of the light that leaves the sample: what is reflected, by fluorophore, and all of it.
fn radiance_rows(
    sample: &FlatSample,
    prediction: &Prediction,
    channels: &[(&String, &ChannelPrediction)],
) -> Vec<Vec<String>> {
    let head = ["radiance from the sample", "W/(sr m2)", "peak nm"].map(String::from).into_iter();
    let electrons = channels.iter().map(|(name, _)| format!("{name} e-"));
    let mut rows: Vec<Vec<String>> = vec![head.chain(electrons).chain(["r".into(), "g".into()]).collect()];
    let mut add = |name: &str, values: &[f64], electrons: Vec<f64>, rg: Option<[f64; 2]>| {
        let mut row = vec![name.to_string(), short(integral(sample, values)), peak_nm(prediction, values)];
        row.extend(electrons.into_iter().map(|e| format!("{e:.1}")));
        let cell = |i: usize| rg.map_or_else(|| "-".into(), |rg| format!("{:.4}", rg[i]));
        row.extend([cell(0), cell(1)]);
        rows.push(row);
    };
    let of = |pick: &dyn Fn(&ChannelPrediction) -> f64| {
        channels.iter().map(|(_, channel)| pick(channel)).collect::<Vec<f64>>()
    };
    add("reflected", &prediction.radiance.reflected, of(&|c| c.electrons_reflected), None);
    for (name, values) in &prediction.radiance.fluorescence {
        let rg = prediction.fluorophore_chromaticity.get(name).and_then(Option::as_ref).map(|c| [c.r, c.g]);
        let electrons = of(&|c| c.electrons_fluorescence.get(name).copied().unwrap_or(0.0));
        add(name, values, electrons, rg);
    }
    let rg = prediction.chromaticity.as_ref().map(|c| [c.r, c.g]);
    add("total", &prediction.radiance.total, of(&|c| c.electrons), rg);
    if channels.is_empty() {
        rows.iter_mut().for_each(|row| row.truncate(3));
    }
    rows
}

/// Table of the signal of each channel.
fn channel_rows(channels: &[(&String, &ChannelPrediction)]) -> Vec<Vec<String>> {
    let head = ["channel", "electrons", "volts", "DN", "noise DN", ""].map(String::from).to_vec();
    let row = |(name, c): &(&String, &ChannelPrediction)| {
        vec![
            (*name).clone(),
            format!("{:.1}", c.electrons),
            format!("{:.5}", c.volts),
            format!("{:.1}", c.dn),
            format!("{:.2}", c.noise_dn),
            if c.saturated { "saturated" } else { "" }.into(),
        ]
    };
    std::iter::once(head).chain(channels.iter().map(row)).collect()
}
