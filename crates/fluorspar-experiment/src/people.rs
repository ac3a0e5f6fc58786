//! The tissues of a person, drawn from the populations of their sites along with the shape of the mouth.

use std::collections::{BTreeMap, BTreeSet};

use fluorspar::sampling::random::Key;
use fluorspar::tissue::{Population, TissueError};

use crate::preset::{self, PresetError};
use crate::schema::{ExperimentFile, NameOrFile, TissueSection};

/// The tissues that the materials of an experiment are made of, as the person of a number has them: sections that take the place of the sites
/// they are named after. What varies among people is drawn around the typical tissue of the experiment ([`Population::person`]); tissues
/// described by their layers, whose variation is not known, stay as they are.
///
/// # Errors
/// A site or a state that does not exist.
pub fn person_tissues(file: &ExperimentFile, person: u32) -> Result<Vec<TissueSection>, PresetError> {
    let names: BTreeSet<&str> = file.material.iter().filter_map(|material| material.tissue()).collect();
    let of_name = |name: &str| {
        let known = file.tissue.iter().find(|section| section.name == name);
        let section = known.cloned().unwrap_or_else(|| TissueSection {
            name: name.to_owned(),
            site: Some(NameOrFile::from(name.to_owned())),
            states: Vec::new(),
            parameters: BTreeMap::new(),
            layer: Vec::new(),
            refractive_index: None,
            index_below: None,
        });
        section.site.is_some().then(|| drawn(section, Key::new(u64::from(person))))
    };
    names.into_iter().filter_map(of_name).collect()
}

/// Gives an experiment the tissues of a person in place of its own.
///
/// # Errors
/// Those of [`person_tissues`].
pub fn give_tissues_of(person: u32, file: &mut ExperimentFile) -> Result<(), PresetError> {
    for section in person_tissues(file, person)? {
        match file.tissue.iter_mut().find(|known| known.name == section.name) {
            Some(known) => *known = section,
            None => file.tissue.push(section),
        }
    }
    Ok(())
}

/// A section with the parameters of a person.
fn drawn(mut section: TissueSection, person: Key) -> Result<TissueSection, PresetError> {
    let Some(site) = &section.site else { return Ok(section) };
    let mut site = preset::site_or_file(site.as_str())?;
    let states = section.states.iter().map(|name| preset::state(name)).collect::<Result<Vec<_>, _>>()?;
    let mut change = || -> Result<(), TissueError> {
        states.iter().try_for_each(|state| site.apply(state))?;
        section.parameters.iter().try_for_each(|(name, value)| site.set(name, *value))
    };
    change().map_err(|error| PresetError::User {
        path: section.name.clone().into(),
        message: error.to_string(),
    })?;
    let population = Population::of(&site).person(person);
    for parameter in population.variations().iter().flat_map(|variation| variation.parameters) {
        // What a site does not hold it has in nobody
        if let Some(value) = population.typical().get(parameter).ok().filter(|value| *value != 0.0) {
            section.parameters.insert((*parameter).to_owned(), value);
        }
    }
    Ok(section)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::parse;

    /// Logarithms over 400 people: their standard deviation is that of the population to four standard errors, `sd / sqrt(2 n)`, the correlation
    /// of two sites that of a person to three, `(1 - r^2) / sqrt(n)`.
    #[test]
    fn people_differ_and_the_sites_of_one_deviate_alike() {
        let base = parse("format = 1\nbase = \"oraleye-2021\"\n", "base", Path::new("."), &[]).unwrap();
        let people: Vec<Vec<TissueSection>> =
            (1..=400).map(|number| person_tissues(&base.file, number).unwrap()).collect();
        assert_eq!(people[6], person_tissues(&base.file, 7).unwrap());
        let logs = |name: &str| -> Vec<f64> {
            let of = |person: &Vec<TissueSection>| {
                let section = person.iter().find(|section| section.name == name).unwrap();
                section.parameters["superficial_blood_fraction"].ln()
            };
            let all: Vec<f64> = people.iter().map(of).collect();
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            all.into_iter().map(|log| log - mean).collect()
        };
        let product =
            |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / a.len() as f64;
        let [tongue, lip, throat] = ["dorsal_tongue", "lip", "throat"].map(logs);
        let sd = [&tongue, &lip, &throat].map(|site| product(site, site).sqrt());
        assert!(sd.iter().all(|sd| (sd - 0.6).abs() < 0.09), "{sd:?}");
        let alike = product(&tongue, &lip) / (sd[0] * sd[1]);
        assert!((alike - 0.5).abs() < 0.12, "{alike}");
        // A tissue that the experiment derives from a site varies around its own values
        let blood = |name: &str| {
            let of = |person: &Vec<TissueSection>| {
                person.iter().find(|section| section.name == name).unwrap().parameters["deep_blood_fraction"]
            };
            let mut all: Vec<f64> = people.iter().map(of).collect();
            all.sort_by(f64::total_cmp);
            all[200]
        };
        assert!((blood("throat") / 0.1).ln().abs() < 0.15, "{}", blood("throat"));
    }
}
