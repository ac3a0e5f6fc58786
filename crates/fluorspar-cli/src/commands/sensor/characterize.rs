//! `fluorspar sensor characterize`: a sensor measured as EMVA 1288 measures cameras.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{ArgAction, ValueEnum, ValueHint};
use fluorspar::sensor::{Characterization, CharacterizationSettings, SensorProblem, characterize};
use fluorspar::units::number_text;
use fluorspar_experiment::ResolvedSensor;
use fluorspar_format::{FileFormat, OutputFolder, write_atomically};
use fluorspar_report::Figure;
use fluorspar_report::figures::{PhotonTransferPlot, SnrPlot, photon_transfer, signal_to_noise};
use serde_json::{Value, json};

use super::SensorArgs;
use crate::args::Answer;
use crate::commands::table::{align, short};
use crate::commands::{print_json, print_text};
use crate::error::CliError;
use crate::message::Messages;
use crate::values;

/// Options of `sensor characterize`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    #[command(flatten)]
    sensor: SensorArgs,
    /// Folder for results.json, sensor.toml and the figures [default: fluorspar-out/NAME-emva1288].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    out: Option<PathBuf>,
    /// Format of the figures.
    #[arg(long, value_enum, default_value = "svg")]
    format: Format,
    /// Exposure time of the flats, ms.
    #[arg(long, value_name = "MS", default_value_t = 10.0, value_parser = values::number, allow_negative_numbers = true)]
    exposure_ms: f64,
    /// Gain on top of the sensor's.
    #[arg(long, value_name = "G", default_value_t = 1.0, value_parser = values::number, allow_negative_numbers = true)]
    gain: f64,
    /// Columns and rows in the middle of the sensor that are measured.
    #[arg(long, num_args = 2, action = ArgAction::Set, value_names = ["COLUMNS", "ROWS"], default_values_t = [640, 480],
        value_parser = values::whole::<usize, 16, 100_000>, allow_negative_numbers = true)]
    region: Vec<usize>,
    /// Steps of the light from dark to saturation.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = values::whole::<usize, 10, 100_000>,
        allow_negative_numbers = true)]
    levels: usize,
    /// Frames that are averaged for the fixed patterns.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = values::whole::<usize, 4, 100_000>,
        allow_negative_numbers = true)]
    stack: usize,
    /// Seed of the temporal noise.
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = values::whole::<u64, 0, { u64::MAX }>,
        allow_negative_numbers = true)]
    seed: u64,
    #[command(flatten)]
    answer: Answer,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    Svg,
    Png,
    Both,
}

impl Options {
    /// A problem of a setting, about the option that was typed for it.
    fn typed(&self, problem: &SensorProblem) -> String {
        let [columns, rows] = [self.region[0], self.region[1]];
        let typed = match problem.field.as_str() {
            "characterization.region[0]" | "characterization.region[1]" => {
                format!("--region {columns} {rows}")
            }
            "characterization.levels" => format!("--levels {}", self.levels),
            "characterization.stack" => format!("--stack {}", self.stack),
            "characterization.exposure_s" | "exposure.time_s" => {
                let typed = number_text(self.exposure_ms);
                return format!("--exposure-ms {typed}: must be between 1e-6 and 3600000 milliseconds");
            }
            "exposure.gain" => format!("--gain {}", number_text(self.gain)),
            _ => return problem.to_string(),
        };
        format!("{typed}: {}", problem.message)
    }
}

pub(super) fn run(options: &Options) -> Result<(), CliError> {
    let messages = Messages::default();
    let resolved = options.sensor.resolve(messages)?;
    let settings = CharacterizationSettings {
        region: [options.region[0], options.region[1]],
        exposure_s: options.exposure_ms * 1e-3,
        gain: options.gain,
        levels: options.levels,
        stack: options.stack,
        seed: options.seed,
    };
    let target = options
        .out
        .clone()
        .unwrap_or_else(|| Path::new("fluorspar-out").join(format!("{}-emva1288", options.sensor.stem())));
    /// Two tables and two figures of a few hundred points.
    const FOLDER_BYTES: u64 = 4 << 20;
    let folder = OutputFolder::prepare(&target, &options.sensor.files(&resolved), FOLDER_BYTES)?;
    let measured = characterize(&resolved.sensor, &settings)
        .map_err(|problem| CliError::Input(options.typed(&problem)))?;
    let results = as_json(&resolved, &measured)?;
    let write = |name: &str, bytes: &[u8]| {
        write_atomically(&folder.path().join(name), |file| file.write_all(bytes))
            .map_err(|error| folder.at_its_place(error))
    };
    write("results.json", serde_json::to_string_pretty(&results)?.as_bytes())?;
    write("sensor.toml", resolved.resolved_toml.as_bytes())?;
    for (name, figure) in figures(&measured) {
        if options.format != Format::Png {
            write(&format!("{name}.svg"), figure.to_svg().as_bytes())?;
        }
        if options.format != Format::Svg {
            write(&format!("{name}.png"), &figure.to_png()?)?;
        }
    }
    let place = folder.finish()?;
    if options.answer.json {
        print_json(&results)?;
    } else {
        messages.warnings(&measured.warnings);
        print_text(&describe(&resolved, &measured))?;
        messages.status(format!("Wrote {}", place.display()));
    }
    Ok(())
}

fn as_json(resolved: &ResolvedSensor, measured: &Characterization) -> Result<Value, CliError> {
    let mut value = serde_json::to_value(measured)?;
    value["format"] = json!(FileFormat::RESULTS.version());
    value["title"] = json!(resolved.title);
    value["provenance"] = json!({
        "program": "fluorspar",
        "version": env!("CARGO_PKG_VERSION"),
        "sensor_toml": resolved.resolved_toml,
    });
    Ok(value)
}

fn figures(measured: &Characterization) -> [(&'static str, Figure); 2] {
    let transfer = PhotonTransferPlot::of(measured);
    // Signals from half an electron to saturation, evenly on a logarithmic axis.
    let steps = 200;
    let signal = |step: usize| {
        let share = step as f64 / steps as f64;
        0.5 * (2.0 * measured.saturation_capacity_e).powf(share)
    };
    let curve = |ratio: &dyn Fn(f64) -> f64| -> Vec<[f64; 2]> {
        (0..=steps).map(|step| [signal(step), ratio(signal(step))]).collect()
    };
    let snr = SnrPlot {
        temporal: curve(&|e| measured.snr(e, false)),
        with_patterns: curve(&|e| measured.snr(e, true)),
        ideal: curve(&f64::sqrt),
        threshold_e: measured.sensitivity_threshold_e,
        saturation_e: measured.saturation_capacity_e,
    };
    [("photon_transfer", photon_transfer(&transfer)), ("signal_to_noise", signal_to_noise(&snr))]
}

/// What is measured, with its unit.
fn quantity_rows(m: &Characterization) -> Vec<Vec<String>> {
    let row = |name: &str, value: f64, unit: &str| vec![name.to_string(), short(value), unit.to_string()];
    let mut rows = vec![
        row("system gain K", m.gain_dn_per_e, "DN/e-"),
        row("inverse 1/K", m.gain_e_per_dn, "e-/DN"),
        row("temporal dark noise", m.dark_noise_e, "e-"),
        row("saturation capacity", m.saturation_capacity_e, "e-"),
        row("full scale", m.full_scale_e, "e-"),
        row("DSNU", m.dsnu_e.total, "e-"),
        row("  rows, columns", m.dsnu_e.row.hypot(m.dsnu_e.column), "e-"),
        row("PRNU", m.prnu_percent.total, "%"),
        row("  rows, columns", m.prnu_percent.row.hypot(m.prnu_percent.column), "%"),
        row("dark current", m.dark_current_e_per_s, "e-/s"),
        row("linearity error", m.linearity_error_percent, "%"),
        row("sensitivity threshold", m.sensitivity_threshold_e, "e-"),
        row("dynamic range", m.dynamic_range_db, "dB"),
        row("largest SNR", m.snr_max_db, "dB"),
    ];
    if let Some(doubling) = m.doubling_temperature_k {
        rows.insert(10, row("doubles every", doubling, "K"));
    }
    rows
}

fn describe(resolved: &ResolvedSensor, m: &Characterization) -> String {
    let title = if resolved.title.is_empty() { String::new() } else { format!("{}\n\n", resolved.title) };
    let mut text = format!("{title}{}", align(&quantity_rows(m), &[2]));
    if !m.recovered.is_empty() {
        let mut rows: Vec<Vec<String>> =
            vec![["put in and found again", "set", "measured", "error", ""].map(String::from).to_vec()];
        rows.extend(m.recovered.iter().map(|r| {
            let error = r.relative_error.map_or_else(|| "-".into(), |e| format!("{:+.2} %", 100.0 * e));
            vec![r.quantity.clone(), short(r.set), short(r.measured), error, r.unit.clone()]
        }));
        text += &format!("\n{}", align(&rows, &[4]));
    }
    text
}
