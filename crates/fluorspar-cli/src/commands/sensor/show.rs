//! `fluorspar catalog show sensor`.

use fluorspar::sensor::photon_transfer::sensitivity_threshold_e;
use fluorspar::sensor::{Sensor, SensorMode};
use serde_json::{Value, json};

use super::SensorArgs;
use crate::commands::table::{align, short};
use crate::commands::{print_json, print_text};
use crate::error::CliError;
use crate::message::Messages;

/// Options of `catalog show sensor`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    sensor: SensorArgs,
    /// Print the answer as JSON.
    #[arg(long, conflicts_with = "toml")]
    json: bool,
    /// Print the complete sensor file, every default written out.
    #[arg(long)]
    toml: bool,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let resolved = options.sensor.resolve(Messages::unless(options.json || options.toml))?;
    if options.toml {
        print_text(&resolved.resolved_toml)
    } else if options.json {
        print_json(&as_json(&resolved.sensor))
    } else {
        print_text(&describe(&resolved.title, &resolved.sensor))
    }
}

/// Rows of name, value and unit.
fn facts(sensor: &Sensor) -> Vec<(&'static str, f64, &'static str)> {
    let model = sensor.model();
    let k = model.base_dn_per_electron() * model.analog_gain;
    let dark_noise_e = model.dark_noise_electrons(1.0);
    let last_code_e = (f64::from(model.max_code()) - model.black_level_dn) / k;
    let full_e = model.well_capacity_e.min(last_code_e);
    // A data sheet counts from its saturation capacity (EMVA 1288), which lies below full scale
    let saturation_e = model.saturation_capacity_e(1.0);
    let threshold_e = sensitivity_threshold_e(dark_noise_e, k);
    vec![
        ("pixel pitch", model.pixel_size_um, "um"),
        ("system gain", k, "DN/e-"),
        ("temporal dark noise", dark_noise_e, "e-"),
        ("full well", model.well_capacity_e, "e-"),
        ("last code", last_code_e, "e-"),
        ("full scale", full_e, "e-"),
        ("saturation capacity", saturation_e, "e-"),
        ("dark current", model.dark_electrons_per_s(), "e-/s"),
        ("DSNU", model.dsnu_electrons(), "e-"),
        ("PRNU", model.prnu_percent, "%"),
        ("sensitivity threshold", threshold_e, "e-"),
        ("dynamic range", 20.0 * (saturation_e / threshold_e).log10(), "dB"),
        ("largest SNR", 10.0 * saturation_e.log10(), "dB"),
    ]
}

fn efficiencies(sensor: &Sensor) -> Vec<(String, f64, f64)> {
    let peak = |c: &fluorspar::sensor::ChannelQe| (c.name.clone(), c.curve.max(), c.curve.peak_nm());
    sensor.effective_qe().channels().iter().map(peak).collect()
}

fn mode(sensor: &Sensor) -> &'static str {
    match sensor.model().mode {
        SensorMode::Physical => "physical",
        SensorMode::NoiseFree => "noise_free",
        SensorMode::Isetcam { .. } => "isetcam",
    }
}

fn as_json(sensor: &Sensor) -> Value {
    let list = facts(sensor);
    let quantities: Vec<Value> = list
        .iter()
        .map(|(name, value, unit)| json!({ "quantity": name, "value": value, "unit": unit }))
        .collect();
    let channels: Vec<Value> = efficiencies(sensor)
        .iter()
        .map(|(name, peak, nm)| json!({ "channel": name, "quantum_efficiency": peak, "peak_nm": nm }))
        .collect();
    json!({
        "columns": sensor.model().columns,
        "rows": sensor.model().rows,
        "image_size_px": sensor.image_size(),
        "bit_depth": sensor.model().bit_depth,
        "mode": mode(sensor),
        "quantities": quantities,
        "channels": channels,
        "model": sensor.model().resolved(),
    })
}

fn describe(title: &str, sensor: &Sensor) -> String {
    let model = sensor.model();
    let [columns, rows] = sensor.image_size();
    let mut lines = vec![
        vec!["pixels".into(), format!("{} x {}", model.columns, model.rows), String::new()],
        vec!["raw images".into(), format!("{columns} x {rows}, {} bits", model.bit_depth), String::new()],
        vec!["equations".into(), mode(sensor).into(), String::new()],
    ];
    lines.extend(
        facts(sensor).into_iter().map(|(name, value, unit)| vec![name.into(), short(value), unit.into()]),
    );
    lines.extend(efficiencies(sensor).into_iter().map(|(name, peak, nm)| {
        vec![format!("quantum efficiency {name}"), format!("{:.1}", 100.0 * peak), format!("% at {nm:.0} nm")]
    }));
    let head = if title.is_empty() { String::new() } else { format!("{title}\n\n") };
    format!("{head}{}", align(&lines, &[2]))
}
