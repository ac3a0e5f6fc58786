//! States of tissue of the catalogue.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::catalogue::{damaged, parse_text, text};
use super::curve_preset::check_name;
use super::kind::{PresetError, PresetKind};
use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;
use fluorspar::tissue::{MucosaParameters, TissueState, ToothParameters};

/// Largest factor on a parameter.
const MAX_FACTOR: f64 = 1000.0;

/// The file of a state.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StateFile {
    name: String,
    title: String,
    description: String,
    source: String,
    #[serde(default)]
    factors: BTreeMap<String, f64>,
    #[serde(default)]
    values: BTreeMap<String, f64>,
    #[serde(default)]
    gray_per_mm: BTreeMap<String, f64>,
}

/// A state of tissue of the catalogue.
///
/// # Errors
/// When there is no such state.
pub fn state(name: &str) -> Result<TissueState, PresetError> {
    state_of(name, text(PresetKind::State, name)?)
}

/// The state that the text of a file describes.
pub(super) fn state_of(name: &str, text: &str) -> Result<TissueState, PresetError> {
    let kind = PresetKind::State;
    let file: StateFile = parse_text(kind, name, text)?;
    check_name(kind, name, &file.name)?;
    file.check().map_err(|message| damaged(kind, name, message))?;
    let StateFile { name, title, description, source, factors, values, gray_per_mm } = file;
    let [factors, values, gray_per_mm] = [factors, values, gray_per_mm].map(|map| map.into_iter().collect());
    Ok(TissueState { name, title, description, source, factors, values, gray_per_mm })
}

impl StateFile {
    /// Refuses parameters that no tissue has, and changes that can't be made.
    fn check(&self) -> Result<(), String> {
        let known = || MucosaParameters::PARAMETERS.iter().chain(ToothParameters::PARAMETERS);
        for name in self.factors.keys().chain(self.values.keys()) {
            if !known().any(|parameter| parameter.name == name) {
                let hint = did_you_mean(name, known().map(|parameter| parameter.name));
                return Err(format!("no tissue has a parameter \"{}\"{hint}", excerpt(name)));
            }
        }
        if let Some(name) = self.factors.keys().find(|name| self.values.contains_key(*name)) {
            return Err(format!("{name} has a factor and a value; remove one"));
        }
        let wrong = self.factors.iter().find(|(_, factor)| !(0.0..=MAX_FACTOR).contains(*factor));
        if let Some((name, _)) = wrong {
            return Err(format!("factors.{name}: must be between 0 and {MAX_FACTOR}"));
        }
        if self.factors.is_empty() && self.values.is_empty() && self.gray_per_mm.is_empty() {
            return Err("it changes nothing; give factors, values or gray_per_mm".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{names, site};
    use super::*;
    use fluorspar::tissue::Population;

    #[test]
    fn every_mucosa_can_have_every_state() {
        let sites = names(PresetKind::Site).into_iter().map(|name| site(name).unwrap());
        for site in sites.filter(|site| site.get("keratin_per_mm").is_ok()) {
            for name in names(PresetKind::State) {
                site.clone().apply(&state(name).unwrap()).unwrap_or_else(|error| panic!("{name}: {error}"));
            }
        }
    }

    /// What a state sets is alike in all people; what it multiplies differs as it does without the state.
    #[test]
    fn no_state_makes_fluorophores_alike_in_all_people() {
        let population = Population::of(&site("buccal_mucosa").unwrap());
        let strengths = population.variations().iter().filter(|variation| variation.fluorophore.is_some());
        let strengths: Vec<&str> = strengths.flat_map(|variation| variation.parameters).copied().collect();
        for name in names(PresetKind::State) {
            let state = state(name).unwrap();
            assert!(state.values.iter().all(|(name, _)| !strengths.contains(&name.as_str())), "{name}");
        }
    }

    #[test]
    fn wrong_states_are_refused_with_a_remedy() {
        let heading = "name = \"s\"\ntitle = \"S\"\ndescription = \"d\"\nsource = \"s\"\n";
        for (rest, words) in [
            ("", "it changes nothing; give"),
            ("factors = { keratin_thicknes_um = 2.0 }", "; did you mean \"keratin_thickness_um\"?"),
            ("factors = { fad_per_mm = 2.0 }\nvalues = { fad_per_mm = 0.0 }", "remove one"),
            ("factors = { fad_per_mm = -2.0 }", "factors.fad_per_mm: must be between 0 and 1000"),
        ] {
            let file: StateFile = toml::from_str(&format!("{heading}{rest}\n")).unwrap();
            let said = file.check().unwrap_err();
            assert!(said.contains(words), "{words}: {said}");
        }
    }
}
