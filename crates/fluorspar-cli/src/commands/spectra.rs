//! Lists, shows and plots lights, filters, reflectances and quantum efficiencies of the catalogue or of CSV files.

use std::io::Write;
use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::spectral::Curve;
use fluorspar_experiment::preset::{self, CurvePreset, PresetKind};
use fluorspar_format::{Negative, Output, Outputs, SpectrumColumns, SpectrumQuantity, write_atomically};
use fluorspar_report::Figure;
use fluorspar_report::figures::{PlotCurve, filters, lights, reflectances, sensor_response};
use serde_json::{Value, json};

use super::FigureFormat;
use super::table::{ListOptions, short};
use crate::error::CliError;
use crate::message::Messages;
use crate::named_spectra;

/// Options of `show`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ShowOptions {
    /// Name of the catalogue, or a CSV file.
    #[arg(value_name = "NAME|CSV", value_hint = ValueHint::FilePath)]
    name: String,
    /// Print the answer as JSON.
    ///
    /// With the spectrum every 5 nm.
    #[arg(long)]
    json: bool,
}

/// Options of `plot`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct PlotOptions {
    /// Names of the catalogue, or CSV files.
    #[arg(value_name = "NAME|CSV", required = true, value_hint = ValueHint::FilePath)]
    names: Vec<String>,
    /// File of the figure, .svg or .png.
    #[arg(long, value_name = "FILE", default_value = "spectra.svg", value_hint = ValueHint::FilePath)]
    out: PathBuf,
    /// First wavelength, nm.
    #[arg(long, value_name = "NM", default_value_t = 320.0)]
    from_nm: f64,
    /// Last wavelength, nm.
    #[arg(long, value_name = "NM", default_value_t = 760.0)]
    to_nm: f64,
}

/// A spectrum, or one for each channel.
struct Entry {
    name: String,
    title: String,
    /// What is known of it; nothing of files.
    about: Option<Value>,
    /// Name of the channel, empty where there is one curve.
    curves: Vec<(String, Curve)>,
}

fn entry(name: &str, kind: PresetKind) -> Result<Entry, CliError> {
    if named_spectra::is_file(name) {
        let job = &Messages::default().job();
        let one = |curve| vec![(String::new(), curve)];
        let curves = match kind {
            PresetKind::Light => one(named_spectra::light(name, job)?),
            PresetKind::Filter => one(named_spectra::filters(std::slice::from_ref(&name.to_string()), job)?),
            PresetKind::QuantumEfficiency => {
                let quantity = SpectrumQuantity::QuantumEfficiency;
                let of_file =
                    named_spectra::of_file(name, SpectrumColumns::All, quantity, Negative::Refuse, job)?;
                of_file.curves.into_iter().map(|column| (column.name, column.curve)).collect()
            }
            _ => one(named_spectra::one_column(name, SpectrumQuantity::Fraction, Negative::Refuse, job)?),
        };
        let title = named_spectra::label(name);
        return Ok(Entry { name: name.into(), title, about: None, curves });
    }
    let of_curve = |preset: CurvePreset| Entry {
        name: name.into(),
        title: preset.title.clone(),
        about: Some(json!({
            "description": preset.description,
            "source": preset.source,
            "valid_nm": preset.valid_nm,
            "assumed": preset.assumed,
            "effective_index": preset.effective_index,
            "fit": preset.fit,
            "model": preset.model,
        })),
        curves: vec![(String::new(), preset.curve())],
    };
    Ok(match kind {
        PresetKind::Light => of_curve(preset::light_spectrum(name)?),
        PresetKind::Filter => of_curve(preset::filter(name)?),
        PresetKind::Reflectance => of_curve(preset::reflectance(name)?),
        _ => {
            let preset = preset::quantum_efficiency(name)?;
            Entry {
                name: name.into(),
                title: preset.title.clone(),
                about: Some(json!({
                    "description": preset.description,
                    "source": preset.source,
                    "valid_nm": preset.valid_nm,
                    "assumed": preset.assumed,
                    "fit": preset.fit,
                })),
                curves: preset.channels()?,
            }
        }
    })
}

/// What a list and `show` tell of a curve: name, unit and value; none where the curve has no data.
fn numbers(curve: &Curve, kind: PresetKind) -> Vec<(&'static str, &'static str, Option<f64>)> {
    let (first, last) = curve.range_nm();
    let at = |nm: f64| (first..=last).contains(&nm).then(|| curve.at(nm));
    let shown = curve.clipped(250.0, 1000.0);
    let highest = shown.max();
    let density = |nm: f64| at(nm).map(|value| -value.max(1e-30).log10());
    let half = half_maxima_nm(&shown, highest);
    let peak = ("peak_nm", "nm", Some(shown.peak_nm()));
    match kind {
        PresetKind::Light => {
            let moment = shown.times(&Curve::from_fn(250.0, 1000.0, |nm| nm)).total();
            vec![
                peak,
                ("full_width_nm", "nm", Some(half[1] - half[0])),
                ("centroid_nm", "nm", Some(moment / shown.total())),
            ]
        }
        PresetKind::Filter => vec![
            ("highest", "", Some(highest)),
            ("half_from_nm", "nm", Some(half[0])),
            ("half_to_nm", "nm", Some(half[1])),
            ("density_385_nm", "", density(385.0)),
            ("density_450_nm", "", density(450.0)),
        ],
        PresetKind::Reflectance => ["at_400_nm", "at_550_nm", "at_630_nm"]
            .into_iter()
            .zip([400.0, 550.0, 630.0])
            .map(|(name, nm)| (name, "", at(nm)))
            .collect(),
        _ => vec![("highest", "e-/photon", Some(highest)), peak],
    }
}

/// First and last wavelength at which a curve reaches half of its maximum, nm; 0 where it has none.
fn half_maxima_nm(curve: &Curve, highest: f64) -> [f64; 2] {
    let above: Vec<f64> = (0..=3000)
        .map(|i| 250.0 + 0.25 * f64::from(i))
        .filter(|nm| highest > 0.0 && curve.at(*nm) >= 0.5 * highest)
        .collect();
    [above.first(), above.last()].map(|nm| nm.copied().unwrap_or(0.0))
}

pub(crate) fn list(options: &ListOptions, kind: PresetKind) -> Result<(), CliError> {
    let (mut list, mut rows, mut head) = (Vec::new(), Vec::new(), Vec::new());
    for name in preset::names(kind) {
        let entry = entry(name, kind)?;
        let measures = numbers(&entry.curves[0].1, kind);
        let mut row = vec![name.to_string()];
        let mut value = json!({ "name": name, "title": entry.title });
        head = vec!["name"];
        if entry.curves.len() > 1 || kind == PresetKind::QuantumEfficiency {
            let channels: Vec<&str> = entry.curves.iter().map(|(channel, _)| channel.as_str()).collect();
            head.push("channels");
            row.push(channels.join(" "));
            value["channels"] = channels.into();
        } else {
            for (name, _, number) in measures {
                head.push(name);
                row.push(number.map_or_else(|| "-".into(), short));
                value[name] = number.into();
            }
        }
        head.push("title");
        row.push(entry.title);
        rows.push(row);
        list.push(value);
    }
    let last = head.len().saturating_sub(1);
    let left = if kind == PresetKind::QuantumEfficiency { vec![1, last] } else { vec![last] };
    options.print(&list, &head, rows, &left)
}

pub(crate) fn show(options: &ShowOptions, kind: PresetKind) -> Result<(), CliError> {
    let entry = entry(&options.name, kind)?;
    if options.json {
        let nm: Vec<f64> = (0..=120).map(|i| 300.0 + 5.0 * f64::from(i)).collect();
        let as_json = |(channel, curve): &(String, Curve)| {
            let (first, last) = curve.range_nm();
            let mut value = json!({ "channel": channel, "data_from_nm": first, "data_to_nm": last });
            for (name, _, number) in numbers(curve, kind) {
                value[name] = number.into();
            }
            value["value"] = nm.iter().map(|nm| curve.at(*nm)).collect::<Vec<f64>>().into();
            value
        };
        let curves: Vec<Value> = entry.curves.iter().map(as_json).collect();
        return super::print_json(&json!({
            "name": entry.name,
            "title": entry.title,
            "about": entry.about,
            "wavelength_nm": nm,
            "curves": curves,
        }));
    }
    let mut text = format!("{}: {}\n", entry.name, entry.title);
    for (channel, curve) in &entry.curves {
        let facts = numbers(curve, kind).into_iter().map(|(name, unit, number)| {
            let words = name.trim_end_matches("_nm").replace('_', " ");
            match number {
                Some(number) => format!("{words} {} {unit}", short(number)).trim_end().to_string(),
                None => format!("{words} not measured"),
            }
        });
        let label = if channel.is_empty() { String::new() } else { format!("{channel}: ") };
        text += &format!("{label}{}\n", facts.collect::<Vec<String>>().join(", "));
    }
    let about = entry.about.unwrap_or_default();
    for (field, label) in [("description", ""), ("source", "Source: "), ("assumed", "Assumed: ")] {
        let words = match &about[field] {
            Value::String(words) => words.clone(),
            Value::Array(list) => list.iter().filter_map(Value::as_str).collect::<Vec<_>>().join(", "),
            _ => continue,
        };
        if !words.is_empty() {
            text += &format!("{label}{words}\n");
        }
    }
    super::print_text(&text)
}

pub(crate) fn plot(options: &PlotOptions, kind: PresetKind) -> Result<(), CliError> {
    let format = FigureFormat::of(&options.out)?;
    let inputs: Vec<PathBuf> = options.names.iter().map(PathBuf::from).collect();
    let set = Outputs::new().and(Output::file("--out", &options.out)).reading(&inputs).declare()?;
    let range_nm = wavelengths(options.from_nm, options.to_nm)?;
    let (mut shown, mut sensors) = (Vec::new(), Vec::new());
    for name in &options.names {
        let Entry { title, curves, .. } = entry(name, kind)?;
        let drawn = curves.iter().map(|(channel, curve)| {
            plot_curve(if channel.is_empty() { &title } else { channel }, curve, range_nm)
        });
        match kind {
            PresetKind::QuantumEfficiency => sensors.push((title.clone(), drawn.collect())),
            _ => shown.extend(drawn),
        }
    }
    let figure = match kind {
        PresetKind::Light => lights(&shown, &[]),
        PresetKind::Filter => filters(&shown),
        PresetKind::Reflectance => reflectances(&shown),
        _ => sensor_response(&[], &sensors),
    };
    write_figure(&options.out, format, &figure)?;
    set.finish()?;
    Messages::default().status(format!("Wrote {}", options.out.display()));
    Ok(())
}

/// A range of wavelengths to draw.
pub(super) fn wavelengths(from_nm: f64, to_nm: f64) -> Result<[f64; 2], CliError> {
    if (200.0..=1200.0).contains(&from_nm) && (200.0..=1200.0).contains(&to_nm) && to_nm - from_nm >= 10.0 {
        return Ok([from_nm, to_nm]);
    }
    Err(CliError::Input(format!(
        "--from-nm {from_nm} --to-nm {to_nm}: give wavelengths between 200 and 1200 nm, the second at least 10 nm above the first"
    )))
}

/// A curve every nanometer.
pub(super) fn plot_curve(name: impl Into<String>, curve: &Curve, [from_nm, to_nm]: [f64; 2]) -> PlotCurve {
    let nm: Vec<f64> = (0..=(to_nm - from_nm) as usize).map(|i| from_nm + i as f64).collect();
    let values = nm.iter().map(|nm| curve.at(*nm)).collect();
    PlotCurve::new(name, nm, values)
}

/// Writes a figure in the form of its name.
pub(super) fn write_figure(
    path: &std::path::Path,
    format: FigureFormat,
    figure: &Figure,
) -> Result<(), CliError> {
    let bytes = format.bytes(figure)?;
    Ok(write_atomically(path, |file| file.write_all(&bytes))?)
}
