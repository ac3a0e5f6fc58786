//! Spectra fitted as sums of fluorophores: JSON, tables and figures.

use fluorspar_format::csv_cell;
use fluorspar_report::Figure;
use fluorspar_report::figures::{MixturePlot, PlotCurve, mixture_fit};
use serde::Serialize;

use super::fit::FittedMixture;
use crate::values::csv;

/// Spectra fitted as sums of fluorophores.
#[derive(Clone, Debug, Serialize)]
pub struct FittedSpectra {
    /// The file of the spectra.
    pub file: String,
    /// Light and filters.
    pub light: Option<String>,
    /// Unit of the spectra.
    pub unit: &'static str,
    /// What a weight of 1 is.
    #[serde(rename = "unit_of_weights")]
    pub weight_unit: &'static str,
    /// What the amount of blood is.
    pub blood: Option<String>,
    /// The amount that all spectra have in common.
    pub common_blood: Option<f64>,
    /// The spectra in the order of their columns.
    #[serde(rename = "spectra")]
    pub fitted: Vec<FittedMixture>,
}

/// Measured, model, what is left, and each component, wavelength by wavelength.
pub(super) fn fit_table(report: &FittedSpectra) -> String {
    let names = report.fitted.first().map_or(&[][..], |fitted| &fitted.fit.weights);
    let names: Vec<String> = names.iter().map(|weight| csv_cell(&weight.name).into_owned()).collect();
    let rows = report.fitted.iter().flat_map(|fitted| {
        let (name, fit) = (csv_cell(&fitted.name), &fitted.fit);
        fitted.wavelengths_nm.iter().enumerate().map(move |(i, nm)| {
            let parts: Vec<String> = fit.contributions.iter().map(|part| part[i].to_string()).collect();
            let (measured, model, residual) = (fitted.measured[i], fit.fitted[i], fit.residual[i]);
            format!("{name},{nm},{measured},{model},{residual},{}", parts.join(","))
        })
    });
    csv(&format!("spectrum,wavelength_nm,measured,model,residual,{}", names.join(",")), rows)
}

/// The supported sets of each spectrum.
pub(super) fn sets_table(report: &FittedSpectra) -> String {
    let rows = report.fitted.iter().flat_map(|fitted| {
        let supported = fitted.sets.iter().flat_map(|sets| &sets.supported).enumerate();
        supported.map(|(rank, set)| {
            let [name, components] =
                [&fitted.name, &set.components.join(" + ")].map(|text| csv_cell(text).into_owned());
            let blood = set.blood.map_or_else(String::new, |amount| amount.to_string());
            let (rank, difference, weight, rms) = (rank + 1, set.difference, set.akaike_weight, set.rms);
            format!("{name},{rank},{difference},{weight},{rms},{blood},{components}")
        })
    });
    csv("spectrum,rank,difference,akaike_weight,rms,blood,components", rows)
}

/// Overlay above, residual below.
pub(super) fn figure(report: &FittedSpectra, fitted: &FittedMixture) -> Figure {
    let curve =
        |name: &str, values: &[f64]| PlotCurve::new(name, fitted.wavelengths_nm.clone(), values.to_vec());
    let parts = fitted.fit.weights.iter().zip(&fitted.fit.contributions);
    let parts = parts.filter(|(weight, _)| weight.is_free).map(|(weight, part)| curve(&weight.name, part));
    mixture_fit(&MixturePlot {
        title: fitted.name.clone(),
        unit: report.unit.into(),
        measured: curve("measured", &fitted.measured),
        model: curve("sum", &fitted.fit.fitted),
        parts: parts.collect(),
        residual: curve("measured less sum", &fitted.fit.residual),
    })
}
