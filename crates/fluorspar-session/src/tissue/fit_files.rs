//! A fitted tissue: JSON, a section of an experiment, a table and a figure.

use fluorspar::tissue::fit::{Fit, FittedParameter, FittedSpectrum};
use fluorspar::units::number_text;
use fluorspar_experiment::preset;
use fluorspar_format::csv_cell;
use fluorspar_report::Figure;
use fluorspar_report::figures::{SpectrumFit, spectrum_fits};
use serde::{Serialize, Serializer};
use serde_json::{Value, json};

use crate::values::{csv, quoted, short};

/// A tissue whose parameters were fitted to spectra.
#[derive(Clone, Debug)]
pub struct FittedTissue {
    /// Name in files.
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Parameters with intervals, and the spectra as the tissue has them.
    pub fit: Fit,
}

impl Serialize for FittedTissue {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        as_json(self).serialize(serializer)
    }
}

/// Six digits.
fn rounded(value: f64) -> String {
    let text = format!("{value:.5e}");
    text.parse().map_or(text, number_text)
}

/// A `[[tissue]]` section: every parameter in which the fitted tissue differs from its site.
pub(super) fn section(FittedTissue { name, fit: found, .. }: &FittedTissue) -> crate::Result<String> {
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

fn as_json(FittedTissue { name, fit: found, .. }: &FittedTissue) -> Value {
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
pub(super) fn residuals(FittedTissue { fit: found, .. }: &FittedTissue) -> String {
    let rows = found.spectra.iter().flat_map(|spectrum| {
        let name = csv_cell(&spectrum.name);
        let values = spectrum.wavelengths_nm.iter().zip(&spectrum.measured).zip(&spectrum.model);
        values.map(move |((nm, measured), model)| {
            format!("{name},{nm},{measured},{model},{}", model - measured)
        })
    });
    csv("spectrum,wavelength_nm,measured,model,difference", rows)
}

pub(super) fn figure(FittedTissue { title, fit: found, .. }: &FittedTissue) -> Figure {
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
