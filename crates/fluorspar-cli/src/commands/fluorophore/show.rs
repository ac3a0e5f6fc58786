//! `fluorspar catalog show fluorophore`.

use fluorspar::spectral::{Fluorophore, Stokes, YieldDensity};
use fluorspar_experiment::preset::FluorophorePreset;
use fluorspar_session::fluorophore::{
    FileOptions, LoadedFluorophore, emission_peak_nm, everywhere_nm, load, peaks_nm,
};
use serde_json::{Value, json};

use crate::commands::table::align;
use crate::commands::{print_json, print_text};
use crate::error::CliError;

/// Excitation wavelengths of the LEDs in use, nm.
const LIGHTS_NM: [f64; 4] = [365.0, 385.0, 405.0, 450.0];

/// Options of `catalog show fluorophore`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Name of the catalogue, or a file: matrix CSV, excitation and emission CSV, ISET .mat, .toml with a [[fluorophore]] section.
    #[arg(value_name = "NAME|FILE")]
    name: String,
    #[command(flatten)]
    file: FileOptions,
    /// Print the answer as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let mut all = load(&options.name, &options.file)?;
    let Some(loaded) = all.pop().filter(|_| all.is_empty()) else {
        let message = "the file has several [[fluorophore]] sections; `catalog plot fluorophore` draws all, `show` wants a file with one";
        return Err(CliError::Input(format!("{}: {message}", options.name)));
    };
    if options.json { print_json(&as_json(&loaded)?) } else { print_text(&describe(&loaded)) }
}

/// Photons out per photon in: everywhere, and from 500 to 700 nm.
fn yields(fluorophore: &Fluorophore, excitation_nm: f64) -> [f64; 2] {
    [everywhere_nm(fluorophore), (500.0, 700.0)]
        .map(|(from, to)| fluorophore.photon_yield(excitation_nm, from, to))
}

struct Term {
    excitation_peak_nm: f64,
    emission_peak_nm: f64,
    /// Share of the yield at 385 nm; none where there is no yield.
    share_at_385: Option<f64>,
}

fn terms(fluorophore: &Fluorophore) -> Vec<Term> {
    let YieldDensity::Separable(terms) = fluorophore.eem.density() else { return Vec::new() };
    let (from, to) = everywhere_nm(fluorophore);
    let from = if fluorophore.eem.stokes() == Stokes::Mask { 385.0 } else { from };
    let parts: Vec<f64> =
        terms.iter().map(|t| t.excitation.at(385.0) * t.emission.integral(from, to)).collect();
    let total: f64 = parts.iter().sum();
    let term = |(t, part): (&fluorspar::spectral::SeparableTerm, &f64)| Term {
        excitation_peak_nm: t.excitation.peak_nm(),
        emission_peak_nm: t.emission.peak_nm(),
        share_at_385: (total > 0.0).then(|| part / total),
    };
    terms.iter().zip(&parts).map(term).collect()
}

fn as_json(loaded: &LoadedFluorophore) -> Result<Value, CliError> {
    let fluorophore = &loaded.fluorophore;
    let [excitation_nm, emission_nm] = peaks_nm(fluorophore);
    let mut value = match &loaded.preset {
        Some(preset) => serde_json::to_value(preset)?,
        None => json!({
            "name": fluorophore.name,
            "title": fluorophore.title,
            "source": fluorophore.source,
            "excitation_range_nm": fluorophore.excitation_range_nm,
            "emission_range_nm": fluorophore.emission_range_nm,
            "stokes": fluorophore.eem.stokes(),
        }),
    };
    if let Some(measured) = &loaded.measured {
        value["file"] = measured.findings.iter().map(|(what, text)| (what.clone(), json!(text))).collect();
    }
    value["excitation_peak_nm"] = json!(excitation_nm);
    value["emission_peak_nm"] = json!(emission_nm);
    value["yields"] = LIGHTS_NM
        .iter()
        .map(|&nm| {
            let [all, band] = yields(fluorophore, nm);
            json!({ "excitation_nm": nm, "photon_yield": all, "photon_yield_500_700": band })
        })
        .collect();
    value["term_summary"] = terms(fluorophore)
        .iter()
        .map(|t| {
            json!({
                "excitation_peak_nm": t.excitation_peak_nm,
                "emission_peak_nm": t.emission_peak_nm,
                "share_of_yield_at_385_nm": t.share_at_385,
            })
        })
        .collect();
    Ok(value)
}

fn describe(loaded: &LoadedFluorophore) -> String {
    let fluorophore = &loaded.fluorophore;
    let [excitation_nm, emission_nm] = peaks_nm(fluorophore);
    let mut text = format!("{}: {}\n", fluorophore.name, fluorophore.title);
    if let Some(preset) = &loaded.preset {
        text += &format!("{}\n", preset.description);
    }
    text.push('\n');
    let mut say = |what: &str, value: String| text += &format!("{what:<14} {value}\n");
    if let Some(measured) = &loaded.measured {
        say("file", fluorophore.source.clone());
        measured.findings.iter().for_each(|(what, value)| say(what, value.clone()));
    } else {
        say("source", fluorophore.source.clone());
        let range = |(first, last): (f64, f64)| format!("{first} to {last} nm");
        say("excitation", range(fluorophore.excitation_range_nm));
        say("emission", range(fluorophore.emission_range_nm));
    }
    say("best", format!("excitation {excitation_nm:.0} nm, emission {emission_nm:.0} nm"));
    say(
        "stokes",
        match fluorophore.eem.stokes() {
            Stokes::Mask => "mask: nothing is emitted below the excitation".into(),
            Stokes::Off => "off: emission below the excitation is kept".into(),
        },
    );
    if let Some(preset) = &loaded.preset {
        describe_preset(preset, &mut say);
    }

    text += "\nphotons out per photon in, concentration 1\n";
    let mut rows = vec![["excitation nm", "everywhere", "500-700 nm", "peak nm"].map(String::from).to_vec()];
    for nm in LIGHTS_NM {
        let [all, band] = yields(fluorophore, nm);
        let peak = emission_peak_nm(fluorophore, nm);
        let peak = if peak.is_nan() { "-".into() } else { format!("{peak:.0}") };
        rows.push(vec![format!("{nm}"), format!("{all:.3e}"), format!("{band:.3e}"), peak]);
    }
    text += &align(&rows, &[]);

    let terms = terms(fluorophore);
    if terms.is_empty() {
        return text;
    }
    text += "\nsum of separable terms\n";
    let mut rows =
        vec![["term", "excitation nm", "emission nm", "of the yield at 385 nm"].map(String::from).to_vec()];
    for (index, term) in terms.iter().enumerate() {
        rows.push(vec![
            format!("{}", index + 1),
            format!("{:.0}", term.excitation_peak_nm),
            format!("{:.0}", term.emission_peak_nm),
            term.share_at_385.map_or_else(|| "-".into(), |share| format!("{:.1} %", 100.0 * share)),
        ]);
    }
    text + &align(&rows, &[])
}

fn describe_preset(preset: &FluorophorePreset, say: &mut impl FnMut(&str, String)) {
    let assumed = |field: &str| if preset.assumed.iter().any(|a| a == field) { " (assumed)" } else { "" };
    say(
        "photon yield",
        format!("{} at the best excitation, concentration 1{}", preset.photon_yield, assumed("photon_yield")),
    );
    if let Some(dye) = &preset.published {
        say("medium", dye.medium.clone());
        say("quantum yield", format!("{} photons out per photon absorbed", dye.quantum_yield));
        say(
            "absorption",
            format!("{} l/(mol cm) at {} nm", dye.molar_absorption_per_m_cm, dye.excitation_peak_nm),
        );
        say("concentration", "1 is 1 umol/l through 1 mm, a thin layer".into());
    }
    let fit = &preset.fit;
    if fit.cells == 0 {
        say("fit", "none: a model".into());
    } else {
        say(
            "fit",
            format!(
                "{:.1} % error over {} values of {}",
                100.0 * fit.relative_frobenius,
                fit.cells,
                fit.reference
            ),
        );
    }
    if let Some(mask) = &fit.mask {
        say(
            "fit mask",
            format!(
                "emission at least {} nm above the excitation, {} nm from its second order",
                mask.stokes_gap_nm, mask.second_order_gap_nm
            ),
        );
    }
    if !fit.note.is_empty() {
        say("fit note", fit.note.clone());
    }
    if !preset.assumed.is_empty() {
        say("assumed", preset.assumed.join(", "));
    }
}
