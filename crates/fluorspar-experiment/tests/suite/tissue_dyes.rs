//! Dyes in layers of sites: what they absorb and emit, against the site's own fluorophores, Monte Carlo and the balance of photons.
#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use fluorspar::sampling::random::Key;
use fluorspar::spectral::Fluorophore;
use fluorspar::tissue::monte_carlo::{
    MonteCarloControl, MonteCarloSettings, ScoringGrid, simulate_fluorescence,
};
use fluorspar::tissue::{
    DiscreteOrdinates, EffectiveTissue, Incidence, LayerFluorophore, LayeredTissue, Level, Population, Site,
};
use fluorspar_experiment::{parse, parse_tissue, preset, resolve};

fn catalogue(name: &str) -> Option<Arc<Fluorophore>> {
    preset::fluorophore(name).ok().map(|known| Arc::new(known.fluorophore()))
}

/// The tissue of a file with one section on a site.
fn try_tissue(site: &str, rest: &str) -> Result<LayeredTissue, String> {
    let text = format!("format = 1\n[[tissue]]\nname = \"mine\"\nsite = \"{site}\"\n{rest}");
    let named = parse_tissue(&text, "mine.toml", Path::new(".")).map_err(|error| error.to_string())?.1;
    named.tissue(&catalogue).map_err(|error| error.to_string())
}

fn solved(tissue: &LayeredTissue) -> EffectiveTissue {
    let nm: Vec<f64> = (0..=70).map(|i| 390.0 + 5.0 * f64::from(i)).collect();
    EffectiveTissue::new(tissue, &nm, DiscreteOrdinates::DIFFUSE).unwrap()
}

/// Fluorescence per nm of all parts that `wanted` selects by layer and fluorophore.
fn emitted(tissue: &EffectiveTissue, [emission, excitation]: [f64; 2], wanted: &str) -> f64 {
    let of = |part: &LayerFluorophore| {
        let layer = &tissue.tissue().layers[part.layer];
        format!("{} in {}", layer.fluorophores[part.fluorophore].fluorophore.name, layer.name)
    };
    let parts = tissue.parts().into_iter().filter(|part| of(part).contains(wanted));
    parts.map(|part| tissue.yield_density(part, emission, excitation, Level::AboveSurface)).sum()
}

#[test]
fn a_fluorophore_given_by_hand_is_that_of_the_site() {
    let site = solved(&preset::site("dorsal_tongue").unwrap().tissue(&catalogue).unwrap());
    let by_hand = solved(
        &try_tissue(
            "dorsal_tongue",
            "parameters = { biofilm_porphyrin_per_mm = 0.0 }\n[[tissue.layer]]\nname = \"biofilm\"\n\
             fluorophores = { biofilm_porphyrin = { strength_per_mm = 1.525e-3 } }\n",
        )
        .unwrap(),
    );
    for pair in [[635.0, 405.0], [600.0, 420.0], [675.0, 450.0]] {
        let [expected, found] = [&site, &by_hand].map(|tissue| emitted(tissue, pair, "biofilm_porphyrin"));
        assert!(expected > 0.0 && (found / expected - 1.0).abs() < 1e-12, "{pair:?}: {found}, {expected}");
    }
}

/// `ln(10) epsilon c`: 20 umol/l of 120 000 / (M cm) are 0.553 per mm, of which the hundredth part is emitted.
#[test]
fn a_concentration_absorbs_and_emits_what_is_published() {
    let dyed = |umol_per_l: f64| {
        try_tissue(
            "buccal_mucosa",
            &format!(
                "[[tissue.layer]]\nname = \"epithelium\"\nfluorophores.protoporphyrin_ix_in_tissue.concentration_umol_per_l = \
                 {umol_per_l:?}\n"
            ),
        )
        .unwrap()
    };
    let [plain, pink] = [0.0, 20.0].map(dyed);
    let [before, after] = [&plain, &pink].map(|tissue| tissue.layer("epithelium").unwrap());
    let more = after.absorption_per_mm(408.0) - before.absorption_per_mm(408.0);
    assert!((more / 0.5526 - 1.0).abs() < 1e-3, "{more}");
    let strength = after.fluorophores.last().unwrap().strength_per_mm;
    assert!((strength / (0.01 * 0.5526) - 1.0).abs() < 1e-3, "{strength}");
    // Twice the dye is less than twice the light: it lies in its own shadow.
    let [twenty, forty] =
        [20.0, 40.0].map(|amount| emitted(&solved(&dyed(amount)), [635.0, 405.0], "protop"));
    assert!(twenty > 0.0 && forty > 1.5 * twenty && forty < 1.98 * twenty, "{twenty}, {forty}");
    // So does what lies below.
    let below = [&plain, &pink].map(|tissue| emitted(&solved(tissue), [520.0, 405.0], "stroma"));
    assert!(below[1] < 0.97 * below[0], "{below:?}");
}

/// Light in, light out: forward photons of the dye and the solver's reciprocity agree, in a layer that the dye darkens.
#[test]
fn a_dye_agrees_with_monte_carlo() {
    let tissue = try_tissue(
        "dorsal_tongue",
        "[[tissue.layer]]\nname = \"biofilm\"\nfluorophores.fluorescein.concentration_umol_per_l = 500.0\n",
    )
    .unwrap();
    let pair = [520.0, 450.0];
    let [emission, excitation] = pair;
    let stop = AtomicBool::new(false);
    let grid = ScoringGrid { radial_bins: 1, ..ScoringGrid::default() };
    let settings = MonteCarloSettings { seed: 3, photons: 60_000, grid, ..MonteCarloSettings::default() };
    let traced = simulate_fluorescence(
        &tissue.optics(excitation),
        &tissue.optics(emission),
        &tissue.strengths_per_mm_nm(excitation, emission),
        Incidence::Lambertian,
        &settings,
        &MonteCarloControl { stop: &stop, progress: &|_| {} },
    )
    .unwrap();
    let film = tissue.layers.iter().position(|layer| layer.name == "biofilm").unwrap();
    let found = traced.upward_by_layer[film];
    let expected = emitted(&solved(&tissue), pair, "in biofilm");
    assert!(found.standard_error < 0.02 * expected, "{found:?}");
    assert!((found.mean - expected).abs() < 3.0 * found.standard_error, "{found:?}, solved {expected}");
}

#[test]
fn layers_that_would_gain_photons_are_refused() {
    let held = |fluorophore: &str| {
        try_tissue("lip", &format!("[[tissue.layer]]\nname = \"keratin\"\nfluorophores.{fluorophore}\n"))
    };
    let said = held("collagen = { strength_per_mm = 0.3 }").unwrap_err();
    for words in
        ["tissue[0] \"mine\": layer", "layer 'keratin', fluorophore 'collagen': under ", " nm the layer"]
    {
        assert!(said.contains(words), "{words}: {said}");
    }
    let dark = held("collagen = { strength_per_mm = 0.3, quantum_yield = 0.5 }").unwrap();
    assert!(dark.layer("keratin").unwrap().absorption_per_mm(405.0) > 0.6);
    assert!(solved(&dark).largest_photon_return() < 1.0);
    let said = held("fluorescein = { strength_per_mm = 0.01, at_nm = 450.0 }").unwrap_err();
    assert!(said.contains("quantum_yield: give its quantum yield"), "{said}");
}

#[test]
fn sites_of_the_catalogue_emit_less_than_they_absorb() {
    let nm: Vec<f64> = (0..=80).map(|i| 350.0 + 5.0 * f64::from(i)).collect();
    for name in preset::names(preset::PresetKind::Site) {
        let site = preset::site(name).unwrap();
        let holds = |site: &Site| site.tissue(&catalogue).unwrap().check_photon_balance(&nm);
        holds(&site).unwrap();
        let population = Population::of(&site);
        for person in 0..20 {
            let drawn = population.draw(&mut Key::new(person).rng());
            holds(&drawn).unwrap_or_else(|error| panic!("{name}, person {person}: {error}"));
        }
        for state in preset::names(preset::PresetKind::State) {
            let mut site = site.clone();
            if site.apply(&preset::state(state).unwrap()).is_ok() {
                holds(&site).unwrap_or_else(|error| panic!("{name}, {state}: {error}"));
            }
        }
    }
}

/// A dye of a file of one's own is a component like the others, and scales like them.
#[test]
fn a_dye_of_ones_own_is_a_component() {
    let text = "format = 1\nbase = \"flat-patch\"\n[[fluorophore]]\nname = \"mydye\"\nsource = \"fluorescein\"\n\
        [[tissue]]\nname = \"mine\"\nsite = \"lip\"\n[[tissue.layer]]\nname = \"basal layer\"\n\
        fluorophores.mydye.concentration_umol_per_l = 3.0\n[[material]]\nname = \"patch\"\ntype = \"tissue\"\ntissue = \"mine\"\n\
        concentrations = { mydye = 0.5 }\n";
    let parsed = |changes: &[String]| parse(text, "dye.toml", Path::new("."), changes);
    let study = resolve(&parsed(&[]).unwrap()).unwrap().study;
    let names: Vec<&str> = study.scene.fluorophores.iter().map(|f| f.name.as_str()).collect();
    assert!(names.contains(&"mydye") && names.contains(&"collagen"), "{names:?}");
    let path = "tissue.mine.layer.basal layer.fluorophores.mydye.concentration_umol_per_l=0";
    let said = resolve(&parsed(&[path.into()]).unwrap()).map(drop).unwrap_err().to_string();
    assert!(said.contains("holds no mydye"), "{said}");
}
