//! States of the catalogue against lesions of people: brightness under violet light and color in white light, over those of the same
//! site without a lesion, which `data/measured_lesions.toml` lists with their sources.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::collections::BTreeMap;

use fluorspar::tissue::{EffectiveTissue, Level};
use fluorspar_experiment::preset;
use serde::Deserialize;

use crate::measured_sites::{apart, brightness, lab, of_site};

#[derive(Deserialize)]
struct Measured {
    green: Green,
    order: Vec<States>,
    color: Vec<States>,
}

#[derive(Deserialize)]
struct Green {
    site: String,
    sites: Vec<String>,
    healthy: [f64; 2],
    factor: f64,
    means: Vec<Mean>,
}

#[derive(Deserialize)]
struct Mean {
    state: String,
    value: f64,
}

#[derive(Deserialize)]
struct States {
    states: Vec<String>,
    #[serde(default)]
    signs: [f64; 3],
    #[serde(default)]
    least: f64,
}

fn measured() -> Measured {
    toml::from_str(include_str!("../../data/measured_lesions.toml")).unwrap()
}

fn solved(site: &str, state: Option<&str>) -> EffectiveTissue {
    let mut site = preset::site(site).unwrap();
    if let Some(state) = state {
        site.apply(&preset::state(state).unwrap()).unwrap();
    }
    of_site(&site)
}

#[test]
fn lesions_are_as_dark_under_violet_light_as_measured() {
    let Measured { green, .. } = measured();
    let [darkest, brightest] = green.healthy;
    for Mean { state, value } in &green.means {
        let [low, high] = [value / brightest, value / darkest];
        let ratio = |site: &String| brightness(&solved(site, Some(state))) / brightness(&solved(site, None));
        let most = ratio(&green.site);
        println!("{state}: {most:.3} at {}, in {low:.3} to {high:.3}", green.site);
        assert!((low..=high).contains(&most), "{state}: {most}");
        for site in &green.sites {
            let ratio = ratio(site);
            println!("  {ratio:.3} at {site}");
            assert!((low / green.factor..=high * green.factor).contains(&ratio), "{state}, {site}: {ratio}");
        }
    }
    let sites = || green.sites.iter().chain([&green.site]);
    let ratio =
        |site: &String| brightness(&solved(site, Some("keratosis"))) / brightness(&solved(site, None));
    println!("keratosis: {:.3?}", sites().map(ratio).collect::<Vec<_>>());
    assert!(sites().all(|site| ratio(site) > 1.0));
}

#[test]
fn lesions_are_darker_the_more_severe_they_are() {
    let Measured { green, order, .. } = measured();
    for States { states, .. } in &order {
        for site in green.sites.iter().chain([&green.site]) {
            let of: Vec<f64> = states.iter().map(|state| brightness(&solved(site, Some(state)))).collect();
            assert!(of.windows(2).all(|pair| pair[1] < 0.97 * pair[0]), "{site}, {states:?}: {of:?}");
        }
    }
}

#[test]
fn lesions_are_white_red_or_gray_in_white_light() {
    let Measured { green, color, .. } = measured();
    let of = |tissue: &EffectiveTissue| lab(&tissue.reflectance(Level::AboveSurface));
    let mut seen = BTreeMap::new();
    for site in green.sites.iter().chain([&green.site]) {
        let healthy = of(&solved(site, None));
        for (States { signs, least, .. }, state) in
            color.iter().flat_map(|c| c.states.iter().map(move |s| (c, s)))
        {
            let lesion = of(&solved(site, Some(state)));
            let difference = apart(lesion, healthy);
            assert!(difference > *least, "{site}, {state}: {difference}");
            seen.insert((state, site), difference);
            for i in 0..3 {
                assert!(
                    signs[i] * (lesion[i] - healthy[i]) >= 0.0,
                    "{site}, {state}: {lesion:?}, {healthy:?}"
                );
            }
        }
    }
    println!("{seen:.1?}");
}
