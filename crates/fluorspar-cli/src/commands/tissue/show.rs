//! `fluorspar catalog show tissue` and `fluorspar catalog show state`.

use fluorspar::tissue::{
    Basis, LayeredTissue, Population, Site, SiteParameter, Spread, Surroundings, TissueLayer, TissueState,
};
use fluorspar::units::number_text;
use fluorspar_experiment::NamedTissue;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_session::tissue::{SiteOptions, find};
use serde_json::{Value, json};

use crate::commands::table::{align, short};
use crate::commands::{print_json, print_text};
use crate::error::CliError;

/// Wavelengths at which coefficients are told, nm.
const TOLD_NM: [f64; 3] = [405.0, 520.0, 635.0];

/// Options of `catalog show tissue`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Options {
    #[command(flatten)]
    site: SiteOptions,
    /// Print the answer as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(options: &Options) -> Result<(), CliError> {
    let (title, site) = options.site.resolve()?;
    let tissue = site.tissue(&find)?;
    match site {
        NamedTissue::Site(site) if options.json => print_json(&as_json(&title, &site, &tissue)),
        NamedTissue::Site(site) => print_text(&describe(&title, &site, &tissue)),
        NamedTissue::Layers { .. } if options.json => {
            print_json(&json!({ "title": title, "layers": layers_as_json(&tissue, None) }))
        }
        NamedTissue::Layers { .. } => print_text(&format!("{title}\n\n{}", layer_table(&tissue))),
    }
}

/// Options of `catalog show state`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct StateOptions {
    /// Its name in the catalogue.
    #[arg(value_name = "NAME")]
    name: String,
    /// Print the answer as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run_state(options: &StateOptions) -> Result<(), CliError> {
    let state = preset::state(&options.name)?;
    if options.json {
        return print_json(&state_as_json(&state));
    }
    let TissueState { name, title, description, source, .. } = &state;
    print_text(&format!("{title} ({name})\n{description}\n{source}\n\n{}\n", changes(&state).join("\n")))
}

fn state_as_json(state: &TissueState) -> Value {
    let TissueState { name, title, description, source, factors, values, gray_per_mm } = state;
    json!({ "name": name, "title": title, "description": description, "source": source, "factors": factors, "values": values,
        "gray_per_mm": gray_per_mm })
}

/// What a state changes, each in words.
fn changes(state: &TissueState) -> Vec<String> {
    let factors = state.factors.iter().map(|(name, factor)| format!("{name} x {factor}"));
    let values = state.values.iter().map(|(name, value)| format!("{name} = {value}"));
    let gray = state.gray_per_mm.iter().map(|(layer, more)| format!("{layer} absorbs {more}/mm more"));
    values.chain(factors).chain(gray).collect()
}

/// How a parameter varies among people: in words, and its standard deviations among people and within a person.
fn variation(population: &Population, name: &str) -> Option<(String, [f64; 2])> {
    let variation = population.variations().iter().find(|v| v.parameters.contains(&name))?;
    let deviations = [variation.between_people, variation.within_person];
    let text = match variation.spread {
        Spread::Factor => format!("x {:.2}", variation.standard_deviation().exp()),
        Spread::Difference => format!("+- {:.2}", variation.standard_deviation()),
    };
    Some((text, deviations))
}

/// The states that the site can have.
fn states(site: &Site) -> impl Iterator<Item = TissueState> + '_ {
    let known = preset::names(PresetKind::State).into_iter();
    known.filter_map(|name| preset::state(name).ok()).filter(|state| site.clone().apply(state).is_ok())
}

fn as_json(title: &str, site: &Site, tissue: &LayeredTissue) -> Value {
    let population = Population::of_people(site);
    let parameter = |(parameter, value): (&SiteParameter, f64)| {
        let (basis, source) = site.basis(parameter.name);
        let deviations = variation(&population, parameter.name).map(|(_, deviations)| deviations);
        json!({
            "name": parameter.name,
            "value": value,
            "unit": parameter.unit(),
            "range": parameter.range,
            "basis": basis.name(),
            "source": source,
            "meaning": parameter.meaning,
            "deviation_between_people": deviations.map(|d| d[0]),
            "deviation_within_person": deviations.map(|d| d[1]),
        })
    };
    json!({
        "site": site.name(),
        "title": title,
        "description": site.description(),
        "assumed": site.is_assumed(),
        "source": site.source(),
        "parameters": site.parameters().map(parameter).collect::<Vec<_>>(),
        "layers": layers_as_json(tissue, Some(site)),
        "states": states(site).map(|state| state_as_json(&state)).collect::<Vec<_>>(),
        "surroundings": site.surroundings(),
    })
}

/// Layers, with the parameters of the site that hold the strengths of their fluorophores.
fn layers_as_json(tissue: &LayeredTissue, site: Option<&Site>) -> Value {
    let layer = |layer: &TissueLayer| {
        let held = layer.fluorophores.iter().map(|held| {
            let name = &held.fluorophore.name;
            json!({
                "name": name,
                "strength_per_mm": held.strength_per_mm,
                "at_nm": held.at_nm,
                "parameter": site.and_then(|site| site.strength_parameter(&layer.name, name)),
            })
        });
        json!({
            "name": layer.name,
            "thickness_um": layer.thickness_um,
            "anisotropy": layer.scattering.anisotropy,
            "wavelength_nm": TOLD_NM,
            "absorption_per_mm": TOLD_NM.map(|nm| layer.absorption_per_mm(nm)),
            "scattering_per_mm": TOLD_NM.map(|nm| layer.scattering.scattering_per_mm(nm)),
            "fluorophores": held.collect::<Vec<_>>(),
        })
    };
    tissue.layers.iter().map(layer).collect()
}

fn layer_table(tissue: &LayeredTissue) -> String {
    let mut layers = vec![["layer", "um"].map(String::from).to_vec()];
    layers[0].extend(TOLD_NM.map(|nm| format!("absorption at {nm} nm, 1/mm")));
    layers[0].push("fluorophores: strength, 1/mm".into());
    layers.extend(tissue.layers.iter().map(|layer| {
        let held = layer.fluorophores.iter().map(|held| {
            format!("{} {} at {} nm", held.fluorophore.name, short(held.strength_per_mm), held.at_nm)
        });
        let mut row = vec![layer.name.clone(), short(layer.thickness_um)];
        row.extend(TOLD_NM.map(|nm| short(layer.absorption_per_mm(nm))));
        row.push(held.collect::<Vec<_>>().join(", "));
        row
    }));
    align(&layers, &[5])
}

fn describe(title: &str, site: &Site, tissue: &LayeredTissue) -> String {
    let states = states(site).map(|state| format!("  {}: {}\n", state.name, changes(&state).join(", ")));
    format!(
        "{title} ({})\n{}\n{}\n\n{}\n{}\n{}\n\"people\": the standard deviation among people and places, a factor or a difference.\n\n{}\n\
         States [assumed sizes]:\n{}",
        site.name(),
        site.description(),
        site.source(),
        align(&parameter_rows(site), &[2, 3, 4, 5, 6]),
        sources(site),
        layer_table(tissue),
        describe_surroundings(site.surroundings()),
        states.collect::<String>()
    )
}

/// Where the values come from: the parameters of each source.
fn sources(site: &Site) -> String {
    let mut of_source: Vec<((Basis, &str), Vec<&str>)> = Vec::new();
    for (parameter, _) in site.parameters() {
        let from = site.basis(parameter.name);
        match of_source.iter_mut().find(|(known, _)| *known == from) {
            Some((_, names)) => names.push(parameter.name),
            None => of_source.push((from, vec![parameter.name])),
        }
    }
    let named = of_source.iter().filter(|((_, source), _)| !source.is_empty());
    named
        .map(|((basis, source), names)| format!("{}, {source}: {}\n", basis.name(), names.join(", ")))
        .collect()
}

/// The parameters of a site, below their heads.
fn parameter_rows(site: &Site) -> Vec<Vec<String>> {
    let population = Population::of_people(site);
    let heads = ["parameter", "value", "unit", "range", "basis", "people", "meaning"];
    let mut rows = vec![heads.map(String::from).to_vec()];
    rows.extend(site.parameters().map(|(parameter, value)| {
        let [least, most] = parameter.range.map(number_text);
        vec![
            parameter.name.into(),
            short(value),
            parameter.unit().into(),
            format!("{least} to {most}"),
            site.basis(parameter.name).0.name().into(),
            variation(&population, parameter.name).map_or_else(String::new, |(text, _)| text),
            parameter.meaning.into(),
        ]
    }));
    rows
}

fn describe_surroundings(around: &Surroundings) -> String {
    let ([indirect, indirect_sd], [teeth, teeth_sd]) = (around.indirect, around.teeth);
    let basis = if around.assumed { "[assumed] " } else { "" };
    format!(
        "In a mouth, by way of other surfaces: light that tissue reflects once more, over its reflectance, {indirect} (log sd \
         {indirect_sd}); light of teeth, over what they give off, {teeth} (log sd {teeth_sd}). {basis}{}\n",
        around.source
    )
}
