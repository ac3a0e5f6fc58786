//! `fluorspar catalog list sensor`.

use fluorspar_experiment::preset::{self, PresetKind};
use serde_json::json;

use super::of_catalogue;
use crate::commands::table::{ListOptions, short};
use crate::error::CliError;

const HEAD: [&str; 8] =
    ["name", "channels", "pixels", "pitch um", "bits", "well e-", "dark noise e-", "title"];

pub(crate) fn run(options: &ListOptions) -> Result<(), CliError> {
    let mut list = Vec::new();
    let mut rows = Vec::new();
    for name in preset::names(PresetKind::Sensor) {
        let preset = preset::sensor(name)?;
        let sensor = of_catalogue(name, &[])?.sensor;
        let model = sensor.model();
        let channels: Vec<&str> =
            sensor.qe().channels().iter().map(|channel| channel.name.as_str()).collect();
        rows.push(vec![
            name.into(),
            channels.join(" "),
            format!("{} x {}", model.columns, model.rows),
            short(model.pixel_size_um),
            model.bit_depth.to_string(),
            short(model.well_capacity_e),
            short(model.dark_noise_electrons(1.0)),
            preset.title.clone(),
        ]);
        list.push(json!({
            "name": name,
            "title": preset.title,
            "description": preset.description,
            "source": preset.source,
            "assumed": preset.assumed,
            "channels": channels,
            "columns": model.columns,
            "rows": model.rows,
            "pixel_size_um": model.pixel_size_um,
            "bit_depth": model.bit_depth,
            "well_capacity_e": model.well_capacity_e,
            "dark_noise_e": model.dark_noise_electrons(1.0),
        }));
    }
    options.print(&list, &HEAD, rows, &[1, 2, 7])
}
