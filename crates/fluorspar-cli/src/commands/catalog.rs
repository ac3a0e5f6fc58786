//! `fluorspar catalog`: list, show and plot what is built in, of every kind.

use clap::{Subcommand, ValueEnum};
use fluorspar_experiment::preset::PresetKind;

use super::subcommands::subcommands;
use super::table::ListOptions;
use super::{fluorophore, lens, presets, sensor, spectra, tissue};
use crate::error::CliError;

subcommands! {
    /// List a kind of parts with their main numbers, or everything by name.
    List(ListArgs) => list,
    /// Show one part: its main numbers, what of it is assumed, its source; of an experiment its file.
    Show(ShowArgs) => show,
    /// Draw parts over one axis.
    Plot(PlotArgs) => plot,
}

/// Options of `list`.
#[derive(Clone, Debug, clap::Args)]
struct ListArgs {
    /// The kind; all kinds without it.
    #[arg(value_enum)]
    kind: Option<Kind>,
    #[command(flatten)]
    options: ListOptions,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Kind {
    Light,
    Filter,
    Reflectance,
    Qe,
    Fluorophore,
    Sensor,
    Lens,
    Tissue,
    State,
    Experiment,
    Sample,
    Design,
    Glass,
    Metal,
}

fn list(args: &ListArgs) -> Result<(), CliError> {
    let options = &args.options;
    match args.kind {
        None => presets::list_of(options, &PresetKind::ALL),
        Some(Kind::Light) => spectra::list(options, PresetKind::Light),
        Some(Kind::Filter) => spectra::list(options, PresetKind::Filter),
        Some(Kind::Reflectance) => spectra::list(options, PresetKind::Reflectance),
        Some(Kind::Qe) => spectra::list(options, PresetKind::QuantumEfficiency),
        Some(Kind::Fluorophore) => fluorophore::list(options),
        Some(Kind::Sensor) => sensor::list(options),
        Some(Kind::Lens) => lens::list(options),
        Some(Kind::Tissue) => tissue::list(options),
        Some(Kind::State) => presets::list_of(options, &[PresetKind::State]),
        Some(Kind::Experiment) => presets::list_of(options, &[PresetKind::Experiment]),
        Some(Kind::Sample) => presets::list_of(options, &[PresetKind::Sample]),
        Some(Kind::Design) => presets::list_of(options, &[PresetKind::Design]),
        Some(Kind::Glass) => presets::list_of(options, &[PresetKind::Glass]),
        Some(Kind::Metal) => presets::list_of(options, &[PresetKind::Metal]),
    }
}

/// Options of `show`.
#[derive(Clone, Debug, clap::Args)]
struct ShowArgs {
    #[command(subcommand)]
    part: Shown,
}

#[derive(Clone, Debug, Subcommand)]
#[allow(clippy::large_enum_variant, reason = "a program holds one")]
enum Shown {
    /// A light spectrum.
    Light(spectra::ShowOptions),
    /// A filter.
    Filter(spectra::ShowOptions),
    /// A diffuse reflectance.
    Reflectance(spectra::ShowOptions),
    /// Quantum efficiencies of the channels of a sensor.
    Qe(spectra::ShowOptions),
    /// A fluorophore: source, range, yields and terms.
    Fluorophore(fluorophore::ShowOptions),
    /// A sensor in electrons and as an EMVA 1288 data sheet.
    Sensor(sensor::ShowOptions),
    /// A lens, traced: focal length, pupils, spots, MTF.
    Lens(lens::ReportOptions),
    /// A tissue: parameters, layers, fluorophores, states.
    Tissue(tissue::ShowOptions),
    /// A state of tissue: what it changes, how far that is assumed, its source.
    State(tissue::StateOptions),
    /// The file of an experiment.
    Experiment(presets::FileOptions),
    /// The file of a flat sample.
    Sample(presets::FileOptions),
    /// The file of a design problem.
    Design(presets::FileOptions),
}

fn show(args: &ShowArgs) -> Result<(), CliError> {
    match &args.part {
        Shown::Light(options) => spectra::show(options, PresetKind::Light)?,
        Shown::Filter(options) => spectra::show(options, PresetKind::Filter)?,
        Shown::Reflectance(options) => spectra::show(options, PresetKind::Reflectance)?,
        Shown::Qe(options) => spectra::show(options, PresetKind::QuantumEfficiency)?,
        Shown::Fluorophore(options) => fluorophore::show(options)?,
        Shown::Sensor(options) => sensor::show(options)?,
        Shown::Lens(options) => lens::report(options)?,
        Shown::Tissue(options) => tissue::show(options)?,
        Shown::State(options) => tissue::show_state(options)?,
        Shown::Experiment(options) => presets::show(options, PresetKind::Experiment)?,
        Shown::Sample(options) => presets::show(options, PresetKind::Sample)?,
        Shown::Design(options) => presets::show(options, PresetKind::Design)?,
    }
    Ok(())
}

/// Options of `plot`.
#[derive(Clone, Debug, clap::Args)]
struct PlotArgs {
    #[command(subcommand)]
    parts: Plotted,
}

#[derive(Clone, Debug, Subcommand)]
enum Plotted {
    /// Light spectra.
    Light(spectra::PlotOptions),
    /// Filters.
    Filter(spectra::PlotOptions),
    /// Diffuse reflectances.
    Reflectance(spectra::PlotOptions),
    /// Quantum efficiencies.
    Qe(spectra::PlotOptions),
    /// Excitation-emission matrices of fluorophores, and their emission under a light.
    Fluorophore(fluorophore::PlotOptions),
}

fn plot(args: &PlotArgs) -> Result<(), CliError> {
    match &args.parts {
        Plotted::Light(options) => spectra::plot(options, PresetKind::Light)?,
        Plotted::Filter(options) => spectra::plot(options, PresetKind::Filter)?,
        Plotted::Reflectance(options) => spectra::plot(options, PresetKind::Reflectance)?,
        Plotted::Qe(options) => spectra::plot(options, PresetKind::QuantumEfficiency)?,
        Plotted::Fluorophore(options) => fluorophore::plot(options)?,
    }
    Ok(())
}
