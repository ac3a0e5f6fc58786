//! What a fit of tissue found: text, JSON, a section of an experiment, a table and a figure.

use fluorspar::tissue::fit::{Fit, FittedParameter, FittedSpectrum};
use fluorspar::units::number_text;
use fluorspar_experiment::preset;
use fluorspar_format::csv_cell;
use fluorspar_report::Figure;
use fluorspar_report::figures::{SpectrumFit, spectrum_fits};
use serde_json::{Value, json};

use crate::commands::quoted;
use crate::commands::table::{align, short};
use crate::error::CliError;

/// Above this share of the prior's standard deviation the data said little.
const UNSEEN: f64 = 0.9;

/// Six digits.
fn rounded(value: f64) -> String {
    let text = format!("{value:.5e}");
    text.parse().map_or(text, number_text)
}

/// A `[[tissue]]` section: every parameter in which the fitted tissue differs from its site.
pub(super) fn section(name: &str, found: &Fit) -> Result<String, CliError> {
    let site = &found.site;
    let original = preset::site(site.name())?;
    let mut text = format!(
        "# Fitted to {}.\nformat = 1\n\n[[tissue]]\nname = {}\nsite = {}\n\n[tissue.parameters]\n",
        found.spectra.iter().map(|spectrum| spectrum.name.replace('\n', " ")).collect::<Vec<_>>().join(", "),
        quoted(name),
        quoted(site.name())
    );
    for (parameter, value) in site.parameters() {
        if original.get(parameter.name)? == value {
            continue;
        }
        let fitted = found.parameters.iter().find(|fitted| fitted.parameter == parameter.name);
        let interval = fitted.map_or_else(String::new, |fitted| {
            let [low, high] = fitted.interval_95.map(short);
            format!(" # {low} to {high} with 95 %")
        });
        text += &format!("{} = {}{interval}\n", parameter.name, rounded(value));
    }
    Ok(text)
}

pub(super) fn as_json(name: &str, found: &Fit) -> Value {
    let parameter = |p: &FittedParameter| {
        json!({
            "name": p.name,
            "parameter": p.parameter,
            "value": p.value,
            "interval_95": p.interval_95,
            "prior": p.prior,
            "prior_interval_95": p.prior_interval_95,
            "deviation_relative_to_prior": p.relative_deviation,
        })
    };
    let spectrum = |s: &FittedSpectrum| {
        json!({
            "name": s.name,
            "wavelength_nm": s.wavelengths_nm,
            "measured": s.measured,
            "model": s.model,
            "scale": s.scale,
            "scale_interval_95": s.scale_interval_95,
            "relative_rms": s.relative_rms(),
        })
    };
    let all: serde_json::Map<String, Value> =
        found.site.parameters().map(|(parameter, value)| (parameter.name.into(), json!(value))).collect();
    json!({
        "name": name,
        "site": found.site.name(),
        "converged": found.converged,
        "steps": found.steps,
        "chi_square": found.chi_square,
        "fitted": found.parameters.iter().map(parameter).collect::<Vec<_>>(),
        "spectra": found.spectra.iter().map(spectrum).collect::<Vec<_>>(),
        "parameters": all,
    })
}

/// Measured and model, wavelength by wavelength.
pub(super) fn residuals(found: &Fit) -> String {
    let mut table = "spectrum,wavelength_nm,measured,model,difference\n".to_string();
    for spectrum in &found.spectra {
        let name = csv_cell(&spectrum.name);
        for ((nm, measured), model) in
            spectrum.wavelengths_nm.iter().zip(&spectrum.measured).zip(&spectrum.model)
        {
            table += &format!("{name},{nm},{measured},{model},{}\n", model - measured);
        }
    }
    table
}

pub(super) fn figure(title: &str, found: &Fit) -> Figure {
    let fits: Vec<SpectrumFit> = found
        .spectra
        .iter()
        .map(|spectrum| SpectrumFit {
            name: spectrum.name.clone(),
            wavelength_nm: spectrum.wavelengths_nm.clone(),
            measured: spectrum.measured.clone(),
            model: spectrum.model.clone(),
        })
        .collect();
    spectrum_fits(&format!("Fit of {title}"), &fits)
}

/// Where a spectrum is off most: wavelength, and difference relative to the root mean square of the spectrum.
fn worst(spectrum: &FittedSpectrum) -> (f64, f64) {
    let count = spectrum.measured.len() as f64;
    let level = (spectrum.measured.iter().map(|v| v * v).sum::<f64>() / count).sqrt();
    let differences = spectrum.model.iter().zip(&spectrum.measured).map(|(model, v)| (model - v) / level);
    let most = |a: (f64, f64), b: (f64, f64)| if b.1.abs() > a.1.abs() { b } else { a };
    spectrum.wavelengths_nm.iter().copied().zip(differences).fold((0.0, 0.0), most)
}

pub(super) fn describe(title: &str, found: &Fit) -> String {
    format!(
        "{title} ({}), fitted in {} steps\n\n{}\n{}",
        found.site.name(),
        found.steps,
        align(&parameter_rows(found), &[7]),
        align(&spectrum_rows(found), &[])
    )
}

/// The fitted parameters, below their heads.
fn parameter_rows(found: &Fit) -> Vec<Vec<String>> {
    let heads = ["parameter", "value", "95 % from", "to", "prior", "from", "to", ""];
    let mut rows = vec![heads.map(String::from).to_vec()];
    rows.extend(found.parameters.iter().map(|p| {
        let [low, high] = p.interval_95.map(short);
        let [prior_low, prior_high] = p.prior_interval_95.map(short);
        let unseen = if p.relative_deviation > UNSEEN { "not seen in these spectra" } else { "" };
        vec![p.name.into(), short(p.value), low, high, short(p.prior), prior_low, prior_high, unseen.into()]
    }));
    rows
}

/// How well each spectrum is met, below the heads.
fn spectrum_rows(found: &Fit) -> Vec<Vec<String>> {
    let mut rows = vec![["spectrum", "relative rms", "most", "at nm", "scale"].map(String::from).to_vec()];
    rows.extend(found.spectra.iter().map(|spectrum| {
        let (nm, difference) = worst(spectrum);
        let scale = spectrum.scale_interval_95.map_or_else(String::new, |[low, high]| {
            format!("{} ({} to {})", short(spectrum.scale), short(low), short(high))
        });
        vec![
            spectrum.name.clone(),
            format!("{:.1} %", 100.0 * spectrum.relative_rms()),
            format!("{:+.1} %", 100.0 * difference),
            number_text(nm),
            scale,
        ]
    }));
    rows
}
