//! `fluorspar plot`: the chain of a camera on one axis of wavelengths.

use clap::ValueHint;
use fluorspar::spectral::{Curve, Fluorophore};
use fluorspar_experiment::preset;
use fluorspar_format::{Output, Outputs};
use fluorspar_report::figures::{PlotCurve, chain};
use serde::Serialize;
use std::path::PathBuf;

use super::FigureFormat;
use super::spectra::{plot_curve, wavelengths, write_figure};
use super::table::{align, short};
use crate::error::CliError;
use crate::message::Messages;
use crate::named_spectra;

/// Options of `plot`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    /// Light: a name of the catalogue or a CSV file. May be repeated.
    #[arg(long, value_name = "NAME|CSV")]
    light: Vec<String>,
    /// Filter on the light. May be repeated.
    #[arg(long, value_name = "NAME|CSV")]
    light_filter: Vec<String>,
    /// Fluorophore of the catalogue: its excitation, and its emission under the first light. May be repeated.
    #[arg(long, value_name = "NAME")]
    fluorophore: Vec<String>,
    /// Filter in front of the lens. May be repeated.
    #[arg(long, value_name = "NAME|CSV")]
    view_filter: Vec<String>,
    /// Quantum efficiency of the sensor, a name of the catalogue or a CSV file with a column for each channel.
    #[arg(long, value_name = "NAME|CSV")]
    qe: Option<String>,
    /// File of the figure, .svg or .png.
    #[arg(long, value_name = "FILE", default_value = "chain.svg", value_hint = ValueHint::FilePath)]
    out: PathBuf,
    /// First wavelength, nm.
    #[arg(long, value_name = "NM", default_value_t = 320.0)]
    from_nm: f64,
    /// Last wavelength, nm.
    #[arg(long, value_name = "NM", default_value_t = 760.0)]
    to_nm: f64,
    #[command(flatten)]
    answer: crate::args::Answer,
}

/// Refuses several names behind one option, with what to type instead.
fn refuse_lists(option: &str, names: &[String]) -> Result<(), CliError> {
    let list = names.iter().find(|name| name.contains(',') && !named_spectra::is_file(name));
    let Some(list) = list else { return Ok(()) };
    let each = list.split(',').map(|name| format!("{option} {}", name.trim()));
    Err(CliError::Input(format!(
        "{option} {list}: it takes one name. Repeat it: {}",
        each.collect::<Vec<_>>().join(" ")
    )))
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let format = FigureFormat::of(&options.out)?;
    let range_nm = wavelengths(options.from_nm, options.to_nm)?;
    let inputs: Vec<PathBuf> = options
        .light
        .iter()
        .chain(&options.light_filter)
        .chain(&options.view_filter)
        .chain(&options.qe)
        .map(PathBuf::from)
        .collect();
    let set = Outputs::new().and(Output::file("--out", &options.out)).reading(&inputs).declare()?;
    for (option, names) in [
        ("--light", &options.light),
        ("--light-filter", &options.light_filter),
        ("--fluorophore", &options.fluorophore),
        ("--view-filter", &options.view_filter),
    ] {
        refuse_lists(option, names)?;
    }
    let job = &Messages::default().job();
    let read = |name: &String| named_spectra::filters(std::slice::from_ref(name), job);
    let read_all = |names: &[String]| names.iter().map(read).collect::<Result<Vec<Curve>, _>>();
    let (light_filters, view_filters) = (read_all(&options.light_filter)?, read_all(&options.view_filter)?);
    let behind = light_filters.iter().fold(Curve::constant(1.0), |product, curve| product.times(curve));
    let mut lights = Vec::new();
    for name in &options.light {
        let curve = named_spectra::light(name, job)?.times(&behind);
        lights.push((name, curve));
    }
    let fluorophores: Vec<Fluorophore> = options
        .fluorophore
        .iter()
        .map(|name| Ok(preset::fluorophore(name)?.fluorophore()))
        .collect::<Result<_, CliError>>()?;
    let one = |name: &str, curve: &Curve| plot_curve(named_spectra::label(name), curve, range_nm);
    let light_curves: Vec<PlotCurve> = lights.iter().map(|(name, curve)| one(name, curve)).collect();
    let names = options.light_filter.iter().chain(&options.view_filter);
    let filters = names.zip(light_filters.iter().chain(&view_filters));
    let filter_curves: Vec<PlotCurve> = filters.map(|(name, curve)| one(name, curve)).collect();
    let first = lights.first().map(|(_, curve)| curve);
    let excitation = fluorophores
        .iter()
        .map(|f| plot_curve(f.title.clone(), &excitation(f), range_nm))
        .collect::<Vec<_>>();
    let emission = fluorophores
        .iter()
        .map(|f| plot_curve(f.title.clone(), &emission(f, first), range_nm))
        .collect::<Vec<_>>();
    let channels = match &options.qe {
        Some(name) => named_spectra::quantum_efficiency(name, job)?,
        None => Vec::new(),
    };
    let efficiency: Vec<PlotCurve> =
        channels.iter().map(|(channel, curve)| plot_curve(channel.clone(), curve, range_nm)).collect();
    if light_curves.is_empty() && filter_curves.is_empty() && excitation.is_empty() && efficiency.is_empty() {
        return Err(CliError::Input(
            "there is nothing to draw; name a --light, --light-filter, --fluorophore, --view-filter or --qe"
                .into(),
        ));
    }
    let all = [&light_curves, &filter_curves, &excitation, &emission, &efficiency];
    write_figure(
        &options.out,
        format,
        &chain(&light_curves, &filter_curves, &excitation, &emission, &efficiency),
    )?;
    set.finish()?;
    let kept =
        kept_by_filters(options.view_filter.iter().zip(&view_filters), &fluorophores, &lights, &channels);
    if options.answer.json {
        let names = ["lights", "filters", "excitation", "emission", "quantum_efficiency"];
        let list = |curves: &Vec<PlotCurve>| -> serde_json::Value {
            let as_json = |curve: &PlotCurve| serde_json::json!({ "name": curve.name, "wavelength_nm": curve.wavelength_nm, "value": curve.value });
            curves.iter().map(as_json).collect()
        };
        let mut answer = serde_json::json!({ "file": options.out, "kept": kept });
        for (name, curves) in names.into_iter().zip(all) {
            answer[name] = list(curves);
        }
        super::print_json(&answer)?;
    } else {
        if !kept.is_empty() {
            super::print_text(&kept_text(&kept))?;
        }
        Messages::default().status(format!("Wrote {}", options.out.display()));
    }
    Ok(())
}

/// What a viewing filter by itself keeps of the fluorescence, and lets pass of the light.
#[derive(Debug, Serialize)]
struct Kept {
    view_filter: String,
    fluorophore: String,
    /// Share of the fluorescence that it keeps, %: in electrons of all channels with a quantum efficiency, else in photons.
    fluorescence_kept_percent: f64,
    /// Share of the first light that passes it, %, likewise; `None` without a light.
    light_passed_percent: Option<f64>,
    /// The same of each light.
    lights_passed: Vec<LightPassed>,
    /// Wavelengths between which it was counted, nm.
    range_nm: [f64; 2],
}

/// How much of a light passes a viewing filter.
#[derive(Clone, Debug, Serialize)]
struct LightPassed {
    light: String,
    percent: f64,
}

/// What each viewing filter keeps of each fluorophore under the first light. Engineers choose a long-pass by it and by what leaks.
fn kept_by_filters<'a>(
    filters: impl Iterator<Item = (&'a String, &'a Curve)>,
    fluorophores: &[Fluorophore],
    lights: &[(&String, Curve)],
    channels: &[(String, Curve)],
) -> Vec<Kept> {
    let light = lights.first().map(|(_, curve)| curve);
    // Of all channels of the sensor together
    let of_all = |nm: f64| channels.iter().map(|(_, curve)| curve.at(nm)).sum::<f64>();
    let efficiency = match channels {
        [] => Curve::constant(1.0),
        _ => Curve::from_fn(COUNTED_NM[0], COUNTED_NM[1], of_all),
    };
    let share = |photons: &Curve, filter: &Curve| {
        let sum = |curve: &Curve| curve.integral(COUNTED_NM[0], COUNTED_NM[1]);
        let seen = photons.times(&efficiency);
        let all = sum(&seen);
        if all > 0.0 { 100.0 * sum(&seen.times(filter)) / all } else { 0.0 }
    };
    let photons = |light: &Curve| light.times(&Curve::from_fn(COUNTED_NM[0], COUNTED_NM[1], |nm| nm));
    let mut kept = Vec::new();
    for (name, filter) in filters {
        let passed = |(name, light): &(&String, Curve)| LightPassed {
            light: named_spectra::label(name),
            percent: share(&photons(light), filter),
        };
        let lights_passed: Vec<LightPassed> = lights.iter().map(passed).collect();
        kept.extend(fluorophores.iter().map(|fluorophore| Kept {
            view_filter: named_spectra::label(name),
            fluorophore: fluorophore.title.clone(),
            fluorescence_kept_percent: share(&emission(fluorophore, light), filter),
            light_passed_percent: lights_passed.first().map(|passed| passed.percent),
            lights_passed: lights_passed.clone(),
            range_nm: COUNTED_NM,
        }));
    }
    kept
}

/// Wavelengths over which photons are counted, nm.
const COUNTED_NM: [f64; 2] = [300.0, 900.0];

/// The same as a table.
fn kept_text(kept: &[Kept]) -> String {
    let mut head = ["viewing filter", "fluorophore", "fluorescence kept"].map(String::from).to_vec();
    let passed = kept.first().map_or(&[][..], |of| &of.lights_passed);
    head.extend(match passed {
        [] | [_] => vec!["light passed".into()],
        // The fluorescence is that under the first one
        several => several.iter().map(|passed| format!("{} passed", passed.light)).collect(),
    });
    let row = |of: &Kept| {
        let mut row = vec![
            of.view_filter.clone(),
            of.fluorophore.clone(),
            format!("{:.1} %", of.fluorescence_kept_percent),
        ];
        row.extend(of.lights_passed.iter().map(|passed| format!("{} %", short(passed.percent))));
        if of.lights_passed.is_empty() {
            row.push("-".into());
        }
        row
    };
    let rows: Vec<Vec<String>> = std::iter::once(head).chain(kept.iter().map(row)).collect();
    align(&rows, &[])
}

/// Photons that a fluorophore emits in all by excitation wavelength.
fn excitation(fluorophore: &Fluorophore) -> Curve {
    let nm: Vec<f64> = (0..=500).map(|i| 250.0 + f64::from(i)).collect();
    let values = fluorophore.eem.total_yields(&nm);
    Curve::new(nm, values).unwrap_or_else(|_| Curve::constant(0.0))
}

/// Emission under a light, or at the best excitation without one.
fn emission(fluorophore: &Fluorophore, light: Option<&Curve>) -> Curve {
    let best = excitation(fluorophore).peak_nm();
    let line = Curve::new(vec![best - 1.0, best, best + 1.0], vec![0.0, 1.0, 0.0]);
    let light = light.cloned().or(line.ok()).unwrap_or_else(|| Curve::constant(1.0));
    let (first, last) = light.range_nm();
    fluorophore.eem.photon_exitance(&light.times(&Curve::from_fn(first, last, |nm| nm)), (300.0, 900.0))
}
