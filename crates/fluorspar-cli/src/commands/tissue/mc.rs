//! `fluorspar tissue mc`.

use std::process::ExitCode;

use fluorspar::tissue::monte_carlo::{Ending, Estimate};
use fluorspar_session::tissue::{MonteCarloOptions, TracedTissue, monte_carlo};

use crate::commands::Answering;
use crate::commands::table::{align, short};
use crate::error::{CliError, STOPPED};
use crate::interrupt::interrupted;

pub(super) fn run(options: &Answering<MonteCarloOptions>) -> Result<ExitCode, CliError> {
    options.answer(monte_carlo, describe)?;
    Ok(if interrupted() { ExitCode::from(STOPPED) } else { ExitCode::SUCCESS })
}

/// The results in words and columns.
pub(super) fn describe(found: &TracedTissue) -> String {
    let light = &found.light;
    let title = if found.title.is_empty() { String::new() } else { format!("{}\n", found.title) };
    let incidence = found
        .angle_deg
        .map_or_else(|| "diffuse light".to_string(), |angle| format!("a beam at {} degrees", short(angle)));
    let ending = match light.ending {
        Ending::Photons => "",
        Ending::Error => ", as many as the wanted error took",
        Ending::Interrupted => ", then interrupted",
    };
    let row = |name: String, Estimate { mean, standard_error }: Estimate| {
        let relative =
            if mean == 0.0 { "-".into() } else { format!("{} %", short(100.0 * standard_error / mean)) };
        vec![name, short(mean), short(standard_error), relative]
    };
    let mut rows =
        vec![["share of the incident light", "", "standard error", "relative"].map(String::from).to_vec()];
    rows.push(row("specular reflectance".into(), light.specular_reflectance));
    rows.push(row("diffuse reflectance".into(), light.diffuse_reflectance));
    rows.push(row("transmittance".into(), light.transmittance));
    rows.push(row("  of it unscattered".into(), light.unscattered_transmittance));
    if light.guided.mean > 0.0 {
        rows.push(row("guided sideways".into(), light.guided));
    }
    for (name, absorbed) in found.layers.iter().zip(&light.absorbed_by_layer) {
        rows.push(row(format!("absorbed in {name}"), *absorbed));
    }
    let unit =
        found.emission_nm.map_or_else(|| "photons".to_string(), |nm| format!("photons per nm at {nm} nm"));
    let by_layer = |upward: Estimate, parts: &[Estimate]| {
        let parts = found.layers.iter().zip(parts).filter(|(_, part)| part.mean > 0.0);
        let mut rows = vec![row(format!("fluorescence upward, {unit}"), upward)];
        rows.extend(parts.map(|(name, part)| row(format!("  from {name}"), *part)));
        rows
    };
    if let Some(emission) = &found.fluorescence {
        rows.extend(by_layer(emission.upward, &emission.upward_by_layer));
        rows.push(row(format!("fluorescence downward, {unit}"), emission.downward));
    }
    if let Some(reciprocity) = &found.reciprocity {
        rows.extend(by_layer(reciprocity.upward, &reciprocity.upward_by_layer));
    }
    format!(
        "{title}{incidence}, {} photons, seed {}{ending}\n\n{}",
        light.photons,
        light.seed,
        align(&rows, &[])
    )
}
