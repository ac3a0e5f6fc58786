//! `fluorspar filter leak`.

use clap::ValueHint;
use fluorspar::pipeline::{LeakBehindFilters, filter_leak};
use fluorspar_experiment::ResolvedSample;
use fluorspar_session::{Changes, ExperimentSource, filter_list};

use crate::commands::table::{align, short};
use crate::commands::{print_json, print_text};
use crate::error::CliError;
use crate::message::Messages;
use crate::values::{self, Override, check_range};

/// Options of `filter leak`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    /// Sample file (.toml) or the name of a built-in sample [default: tongue-385nm].
    #[arg(value_name = "SAMPLE", value_hint = ValueHint::FilePath)]
    sample: Option<String>,
    /// Filter in front of the lens, instead of those of the sample: a name of the catalogue, a CSV file or a number from 0
    /// to 1. May be repeated: the filters then stand one behind the other; `none` means no filter.
    #[arg(long, value_name = "NAME|CSV|T", allow_negative_numbers = true)]
    view_filter: Vec<String>,
    /// Filter on the light, instead of those of the sample. As `--view-filter`.
    #[arg(long, value_name = "NAME|CSV|T", allow_negative_numbers = true)]
    light_filter: Vec<String>,
    /// Angle of the light to the normal of the filters, degrees. May be repeated.
    #[arg(long, value_name = "DEG", default_values_t = [0.0, 10.0, 20.0, 30.0],
        value_parser = values::number, allow_negative_numbers = true)]
    angle_deg: Vec<f64>,
    #[command(flatten)]
    changes: Changes,
    /// Print the answer as JSON.
    #[arg(long)]
    json: bool,
}

/// Leak up to which the text proposes filters, reflected over fluorescent photons.
const WANTED_LEAK: f64 = 0.01;

pub(super) fn run(options: &Options) -> Result<(), CliError> {
    for angle in &options.angle_deg {
        check_range("angle_deg", *angle, [0.0, 60.0], "degrees")?;
    }
    let source = ExperimentSource::find_sample(options.sample.as_deref())?;
    let mut overrides = Vec::new();
    for (field, option, names) in [
        ("view_filter.filters", "view_filter", &options.view_filter),
        ("light.filters", "light_filter", &options.light_filter),
    ] {
        if !names.is_empty() {
            let typed: Vec<String> = names.iter().map(|name| format!("⟨{option}={name}⟩")).collect();
            let list = filter_list(names, &source.base_dir);
            overrides.push(Override::of_option(field, list, typed.join(" ")));
        }
    }
    overrides.extend(options.changes.overrides());
    let ResolvedSample { sample, record, .. } = source.resolve_sample(&overrides)?;
    Messages::unless(options.json).warnings(&record.warnings);
    let leak = filter_leak(&sample, &options.angle_deg)?;
    if options.json {
        return print_json(&leak);
    }
    let cell = |value: Option<f64>| value.map_or_else(|| "-".into(), short);
    let row = |name: String, behind: &LeakBehindFilters| {
        vec![
            name,
            short(behind.reflected),
            short(behind.fluorescent),
            cell(behind.leak_ratio),
            format!("{} %", short(100.0 * behind.fluorescence_passed)),
            cell(behind.reflected_density),
            behind
                .leak_in_pass_band
                .map_or_else(|| "-".into(), |share| format!("{} %", short(100.0 * share))),
        ]
    };
    let head =
        ["angle", "reflected", "fluorescent", "leak", "fluorescence passed", "density", "leak in pass band"];
    let mut rows = vec![head.map(String::from).to_vec()];
    rows.push(vec![
        "before".into(),
        short(leak.reflected),
        short(leak.fluorescent),
        cell(leak.ratio_before),
        String::new(),
        String::new(),
        String::new(),
    ]);
    rows.push(row("as stated".into(), &leak.as_stated));
    rows.extend(leak.at_angles.iter().map(|at| row(format!("{} deg", at.angle_deg), &at.behind)));
    let behind = match &options.view_filter[..] {
        [] => "the viewing filters of the sample".to_owned(),
        [one] => one.clone(),
        several => format!("{}, one behind the other", several.join(" + ")),
    };
    let mut text = format!(
        "{}: reflected light against fluorescence behind {behind}, photons/(s m2 sr); leak: of photons, before any sensor\n\n{}",
        source.name,
        align(&rows, &[])
    );
    if let Some(ratio) = leak.as_stated.leak_ratio.filter(|ratio| *ratio > WANTED_LEAK) {
        let density = short((ratio / WANTED_LEAK).log10());
        text += &match leak.as_stated.leak_in_pass_band {
            Some(share) if share * ratio > WANTED_LEAK => format!(
                "\nLight that the viewing filters are made to pass is {} of the fluorescence: for a leak of 1 % the light needs a \
                 filter of its own, or the pass band another place.\n",
                short(share * ratio)
            ),
            _ => format!("\nFor a leak of 1 % the viewing filters lack an optical density of {density}.\n"),
        };
    }
    print_text(&text)
}
