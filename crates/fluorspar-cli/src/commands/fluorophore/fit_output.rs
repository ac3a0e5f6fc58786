//! What a fit of spectra found: text, JSON, tables and figures.

use fluorspar::analysis::{ComponentSets, FittedWeight, MixtureFit};
use fluorspar_format::csv_cell;
use fluorspar_report::Figure;
use fluorspar_report::figures::{MixturePlot, PlotCurve, mixture_fit};
use serde_json::{Value, json};

use super::fit::Fitted;
use crate::commands::table::{align, short};
use crate::error::CliError;

/// Supported sets that the text lists.
const SETS_SHOWN: usize = 5;

/// What was asked, and what was found of each spectrum.
pub(super) struct FitReport {
    pub(super) file: String,
    /// Light and filters.
    pub(super) light: Option<String>,
    /// Unit of the spectra.
    pub(super) unit: &'static str,
    /// What a weight of 1 is.
    pub(super) weight_unit: &'static str,
    /// What the amount of blood is.
    pub(super) blood: Option<String>,
    /// The amount that all spectra have in common.
    pub(super) common_blood: Option<f64>,
    pub(super) fitted: Vec<Fitted>,
}

pub(super) fn as_json(report: &FitReport) -> Result<Value, CliError> {
    let spectrum = |fitted: &Fitted| -> Result<Value, CliError> {
        Ok(json!({
            "name": fitted.name,
            "wavelength_nm": fitted.wavelengths_nm,
            "measured": fitted.measured,
            "fit": serde_json::to_value(&fitted.fit)?,
            "sets": serde_json::to_value(&fitted.sets)?,
        }))
    };
    Ok(json!({
        "file": report.file,
        "light": report.light,
        "unit": report.unit,
        "unit_of_weights": report.weight_unit,
        "blood": report.blood,
        "common_blood": report.common_blood,
        "spectra": report.fitted.iter().map(spectrum).collect::<Result<Vec<_>, _>>()?,
    }))
}

/// Measured, model, what is left, and each component, wavelength by wavelength.
pub(super) fn fit_table(report: &FitReport) -> String {
    let names = report.fitted.first().map_or(&[][..], |fitted| &fitted.fit.weights);
    let names: Vec<String> = names.iter().map(|weight| csv_cell(&weight.name).into_owned()).collect();
    let mut table = format!("spectrum,wavelength_nm,measured,model,residual,{}\n", names.join(","));
    for fitted in &report.fitted {
        let (name, fit) = (csv_cell(&fitted.name), &fitted.fit);
        for (i, nm) in fitted.wavelengths_nm.iter().enumerate() {
            let parts: Vec<String> = fit.contributions.iter().map(|part| part[i].to_string()).collect();
            let (measured, model, residual) = (fitted.measured[i], fit.fitted[i], fit.residual[i]);
            table += &format!("{name},{nm},{measured},{model},{residual},{}\n", parts.join(","));
        }
    }
    table
}

/// The supported sets of each spectrum.
pub(super) fn sets_table(report: &FitReport) -> String {
    let mut table = "spectrum,rank,difference,akaike_weight,rms,blood,components\n".to_string();
    for fitted in &report.fitted {
        let supported = fitted.sets.iter().flat_map(|sets| &sets.supported);
        for (rank, set) in supported.enumerate() {
            let blood = set.blood.map_or_else(String::new, |amount| amount.to_string());
            table += &format!(
                "{},{},{},{},{},{blood},{}\n",
                csv_cell(&fitted.name),
                rank + 1,
                set.difference,
                set.akaike_weight,
                set.rms,
                csv_cell(&set.components.join(" + "))
            );
        }
    }
    table
}

/// Overlay above, residual below.
pub(super) fn figure(report: &FitReport, fitted: &Fitted) -> Figure {
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

pub(super) fn describe(report: &FitReport) -> String {
    let mut text = match &report.light {
        Some(light) => format!("{} under {light}\n", report.file),
        None => format!("{}\n", report.file),
    };
    text += &format!("spectra: {}; a weight of 1 is {}\n", report.unit, report.weight_unit);
    if let (Some(blood), Some(amount)) = (&report.blood, report.common_blood) {
        text += &format!("{blood}, common to all: {}\n", short(amount));
    }
    for fitted in &report.fitted {
        text += &format!("\n{}", describe_one(report, fitted));
    }
    text
}

fn describe_one(report: &FitReport, fitted: &Fitted) -> String {
    let fit = &fitted.fit;
    let (first, last) = (fitted.wavelengths_nm.first(), fitted.wavelengths_nm.last());
    let (first, last) = (first.copied().unwrap_or_default(), last.copied().unwrap_or_default());
    let mut text =
        format!("{}: {} bands from {first} to {last} nm\n", fitted.name, fitted.wavelengths_nm.len());
    if let (Some(what), Some(blood)) = (&report.blood, &fit.blood) {
        let [low, high] = blood.interval.map(short);
        text += &format!("{what}: {} ({low} to {high} with 95 %)\n", short(blood.amount));
    }
    text += &residuals(fit);
    text += &weights(fit, fitted.sets.as_ref());
    if let Some(sets) = &fitted.sets {
        text += &format!("\n{}", sets_in_words(sets));
    }
    text
}

/// What is left, and how many independent bands that makes.
fn residuals(fit: &MixtureFit) -> String {
    let scatter = &fit.scatter;
    let together = match scatter.correlation.share > 0.0 {
        true => format!(
            "{:.0} % of their variance go together over {} nm; the bands count as {:.1} independent ones",
            100.0 * scatter.correlation.share,
            short(scatter.correlation.length_nm),
            scatter.effective_bands
        ),
        false => "independent of each other".into(),
    };
    let mut text = format!(
        "residuals {} rms, {:.2} % of the largest value; {together}\n",
        short(fit.rms),
        100.0 * fit.relative_rms
    );
    if let Some(found) = &fit.chi_square {
        text += &format!(
            "chi-square {} where {} are expected of the standard errors (probability {})\n",
            short(found.chi_square),
            short(found.expected),
            short(found.probability)
        );
    }
    text
}

fn weights(fit: &MixtureFit, sets: Option<&ComponentSets>) -> String {
    let mut head = vec!["component", "weight", "95 % from", "to", "of the light"];
    if sets.is_some() {
        head.extend(["in supported sets", "Akaike weight"]);
    }
    head.push("");
    let mut rows: Vec<Vec<String>> = vec![head.iter().map(|cell| (*cell).into()).collect()];
    let row = |weight: &FittedWeight| {
        let [low, high] = weight.interval.map(short);
        let share = format!("{:.1} %", 100.0 * weight.share);
        let mut row = vec![weight.name.clone(), short(weight.weight), low, high, share];
        if let Some(sets) = sets {
            let member = sets.components.iter().find(|member| member.name == weight.name);
            row.push(member.map_or_else(String::new, |member| {
                format!("{} of {}", member.supported_sets, sets.supported.len())
            }));
            row.push(member.map_or_else(String::new, |member| format!("{:.3}", member.akaike_weight)));
        }
        let state = match (weight.is_free, weight.standard_error.is_none()) {
            (_, true) => "others make it up",
            (false, false) => "at zero",
            (true, false) => "",
        };
        row.push(state.into());
        row
    };
    rows.extend(fit.weights.iter().map(row));
    align(&rows, &[head.len() - 1])
}

/// Which components the data want, and which they can't tell apart.
fn sets_in_words(sets: &ComponentSets) -> String {
    let count = sets.supported.len();
    if count == 0 {
        return "the bands are too few to compare sets of components\n".into();
    }
    let too_large = match sets.too_large {
        0 => String::new(),
        number => format!("; {number} more have too many components for so few bands"),
    };
    let mut text = format!(
        "{count} of {} sets are supported: within {} of the best, by AICc of {:.1} bands{too_large}\n",
        sets.compared, sets.within, sets.effective_bands
    );
    let mut rows = vec![["difference", "Akaike weight", "set"].map(String::from).to_vec()];
    rows.extend(sets.supported.iter().take(SETS_SHOWN).map(|set| {
        let names = if set.components.is_empty() { "nothing".into() } else { set.components.join(", ") };
        vec![format!("{:.2}", set.difference), format!("{:.3}", set.akaike_weight), names]
    }));
    text += &align(&rows, &[2]);
    let named = |wanted: usize| {
        let members = sets.components.iter().filter(|member| member.supported_sets == wanted);
        members.map(|member| member.name.as_str()).collect::<Vec<_>>().join(", ")
    };
    for (what, names) in [("in every supported set", named(count)), ("in none", named(0))] {
        if !names.is_empty() {
            text += &format!("{what}: {names}\n");
        }
    }
    let pairs: Vec<String> =
        sets.interchangeable.iter().map(|[one, other]| format!("{one} and {other}")).collect();
    if !pairs.is_empty() {
        text += &format!("can't be told apart: {}\n", pairs.join("; "));
    }
    text
}
