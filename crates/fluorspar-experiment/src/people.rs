//! People: shape of the mouth, its tissues and its fillings, drawn from populations.

use std::collections::{BTreeMap, BTreeSet};

use fluorspar::sampling::random::Key;
use fluorspar::tissue::{Population, TissueError};
use fluorspar_anatomy::{MouthParameters, POSE_FIELDS, sample_person, sample_restorations};
use fluorspar_format::read_toml;
use serde::Serialize;

use crate::preset::{self, PresetError};
use crate::schema::{ExperimentFile, MaterialSection, NameOrFile, RestorationSection, TissueSection};

/// What is drawn of a person, as sections of an experiment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Person {
    /// Shape of the mouth; its seed is the number of the person.
    pub mouth: MouthParameters,
    /// Tissues, in place of those of the experiment.
    #[serde(rename = "tissue")]
    pub tissues: Vec<TissueSection>,
    /// Materials of their restorations that the experiment lacks.
    #[serde(rename = "material")]
    pub materials: Vec<MaterialSection>,
    /// Fillings and crowns.
    #[serde(skip)]
    pub restorations: Vec<RestorationSection>,
}

/// What restorations of people are made of.
const RESTORATIVE_MATERIALS: &str = include_str!("../data/restorative_materials.toml");

impl Person {
    /// The person of a number, for the materials of an experiment.
    ///
    /// # Errors
    /// A site or a state of a tissue that does not exist.
    pub fn draw(file: &ExperimentFile, number: u32) -> Result<Self, PresetError> {
        Self::with_shape(file, number, sample_person(number))
    }

    /// The same with another shape of the mouth.
    ///
    /// # Errors
    /// As [`Self::draw`].
    pub fn with_shape(
        file: &ExperimentFile,
        number: u32,
        mouth: MouthParameters,
    ) -> Result<Self, PresetError> {
        let tissues = person_tissues(file, number)?;
        let (restorations, materials) = person_restorations(file, number, &mouth.missing_teeth);
        Ok(Self { mouth, tissues, materials, restorations })
    }

    /// Parameters of the tissues by `TISSUE.PARAMETER`.
    fn of_tissues(&self) -> impl Iterator<Item = (String, f64)> {
        self.tissues.iter().flat_map(|tissue| {
            tissue
                .parameters
                .iter()
                .map(|(parameter, value)| (format!("{}.{parameter}", tissue.name), *value))
        })
    }
}

/// A table of people, a line each: number, shape, ratio of the widths of their teeth, restorations, parameters of their tissues. All are of
/// one experiment. `is_posed` adds pose and detail of their mouths.
///
/// # Errors
/// None that is known: parameters that have no JSON.
pub fn people_csv(people: &[Person], is_posed: bool) -> Result<String, serde_json::Error> {
    let fields = serde_json::to_value(MouthParameters::default())?;
    let is_told = |name: &&String| is_posed || !POSE_FIELDS.contains(&name.as_str());
    let names: Vec<&String> =
        fields.as_object().map(|fields| fields.keys().filter(is_told).collect()).unwrap_or_default();
    let shape: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
    let tissues =
        people.first().map(|person| person.of_tissues().map(|(name, _)| format!(",{name}")).collect());
    let tissues: String = tissues.unwrap_or_default();
    let mut table = format!("person,{},bolton_ratio,restorations{tissues}\n", shape.join(","));
    for person in people {
        let values = serde_json::to_value(&person.mouth)?;
        let cell = |name: &&String| match &values[name.as_str()] {
            serde_json::Value::Array(list) => {
                list.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
            }
            other => other.to_string(),
        };
        let row: Vec<String> = names.iter().map(cell).collect();
        let tissues: String = person.of_tissues().map(|(_, value)| format!(",{value:.6e}")).collect();
        let (number, ratio) = (person.mouth.seed, person.mouth.bolton_ratio());
        let restorations = person.restorations.iter();
        let restorations: Vec<String> =
            restorations.map(|one| format!("{} {} {}", one.tooth, one.surfaces, one.material)).collect();
        table += &format!("{number},{},{ratio:.4},{}{tissues}\n", row.join(","), restorations.join("; "));
    }
    Ok(table)
}

/// The tissues that the materials of an experiment are made of, as the person of a number has them: sections that take the place of the sites
/// they are named after. What varies among people is drawn around the typical tissue of the experiment ([`Population::person`]); tissues
/// described by their layers, whose variation is not known, stay as they are.
///
/// # Errors
/// A site or a state that does not exist.
fn person_tissues(file: &ExperimentFile, person: u32) -> Result<Vec<TissueSection>, PresetError> {
    let names: BTreeSet<&str> = file.material.iter().filter_map(|material| material.tissue()).collect();
    let of_name = |name: &str| {
        let known = file.tissue.iter().find(|section| section.name == name);
        let section = known.cloned().unwrap_or_else(|| TissueSection {
            name: name.to_owned(),
            site: Some(NameOrFile::from(name.to_owned())),
            ..TissueSection::default()
        });
        section.site.is_some().then(|| drawn(section, Key::new(u64::from(person))))
    };
    names.into_iter().filter_map(of_name).collect()
}

/// Whether the people of an experiment have fillings and crowns of their own: what it has of them, and its scans, are everybody's.
#[must_use]
pub fn has_drawn_restorations(file: &ExperimentFile) -> bool {
    file.mouth.as_ref().is_some_and(|mouth| mouth.restoration.is_empty() && mouth.scan.is_empty())
}

/// Fillings and crowns of the person of a number, and what of their materials an experiment lacks. Teeth with a lesion have none.
fn person_restorations(
    file: &ExperimentFile,
    person: u32,
    missing: &[u8],
) -> (Vec<RestorationSection>, Vec<MaterialSection>) {
    if !has_drawn_restorations(file) {
        return (Vec::new(), Vec::new());
    }
    let lesions = || file.mouth.iter().flat_map(|mouth| &mouth.lesion);
    let is_sound = |tooth: u8| lesions().all(|lesion| lesion.part != format!("tooth_{tooth}"));
    let mut drawn = sample_restorations(person, missing);
    drawn.retain(|one| is_sound(one.tooth));
    let is_used = |material: &MaterialSection| drawn.iter().any(|one| one.material == material.name);
    let is_known = |material: &MaterialSection| file.material.iter().any(|known| known.name == material.name);
    let all = read_toml::<BTreeMap<String, Vec<MaterialSection>>>(RESTORATIVE_MATERIALS).unwrap_or_default();
    let materials = all.into_values().flatten().filter(|one| is_used(one) && !is_known(one)).collect();
    let restorations = drawn.into_iter().map(|one| RestorationSection {
        name: restoration_name(one.tooth),
        tooth: one.tooth,
        surfaces: one.surfaces.into(),
        material: one.material.into(),
    });
    (restorations.collect(), materials)
}

/// Name of the restoration of a person on a tooth.
#[must_use]
pub fn restoration_name(tooth: u8) -> String {
    format!("restoration_{tooth}")
}

/// Gives the mouth of an experiment, which has the shape of a person, the fillings and crowns of that person.
pub fn give_restorations_of(person: u32, file: &mut ExperimentFile) {
    let missing = file.mouth.as_ref().map(|mouth| mouth.parameters.missing_teeth.clone()).unwrap_or_default();
    let (restorations, materials) = person_restorations(file, person, &missing);
    if let Some(mouth) = &mut file.mouth {
        mouth.restoration.extend(restorations);
    }
    file.material.extend(materials);
}

/// Gives an experiment the tissues of a person in place of its own.
///
/// # Errors
/// A site or a state that does not exist.
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
    let population = Population::of_people(&site).person(person);
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
