//! What masks tell apart.

use std::collections::BTreeSet;

use fluorspar::pipeline::part_color;
use fluorspar_experiment::{ResolvedExperiment, has_drawn_restorations, restoration_name};
use serde_json::{Value, json};

use crate::cohort::CohortWork;
use crate::{Error, Result};

/// Names of lesions and parts. The number of each, from 1, is its id in annotations and its number in masks; lesions come first.
pub(super) struct Categories {
    pub(super) lesions: Vec<String>,
    parts: Vec<String>,
}

impl Categories {
    /// Lesions of the file, surfaces of a view of anybody, and what only some may have: every tooth and its restorations.
    ///
    /// # Errors
    /// More than masks have numbers for.
    pub(super) fn of(work: &CohortWork, experiment: &ResolvedExperiment) -> Result<Self> {
        let lesions: Vec<String> = work.cohort.lesions().iter().map(|lesion| lesion.name.clone()).collect();
        let numbers = || (1..=4).flat_map(|quadrant| (1..=8).map(move |place| 10 * quadrant + place));
        let teeth = numbers().map(|number| format!("tooth_{number}"));
        let names = experiment.study.scene.objects.iter().map(|object| object.name.clone());
        let mouth = work.cohort.experiment.file.mouth.iter();
        let restorations: Vec<String> = match has_drawn_restorations(&work.cohort.experiment.file) {
            true => numbers().map(restoration_name).collect(),
            false => mouth.flat_map(|mouth| &mouth.restoration).map(|one| one.name.clone()).collect(),
        };
        let parts: Vec<String> =
            names.chain(teeth).chain(restorations).collect::<BTreeSet<_>>().into_iter().collect();
        let all = lesions.len() + parts.len();
        if all > usize::from(u8::MAX) {
            return Err(Error::Input(format!(
                "{}: {all} lesions and objects are more than the 255 that masks have numbers for; join objects",
                work.source.name
            )));
        }
        Ok(Self { lesions, parts })
    }

    /// Number of a lesion; 0 of what has no name here.
    pub(super) fn lesion(&self, name: &str) -> u8 {
        number(&self.lesions, 0, name)
    }

    /// Number of a part; 0 of what has no name here.
    pub(super) fn part(&self, name: &str) -> u8 {
        number(&self.parts, self.lesions.len(), name)
    }

    /// Color of each number.
    pub(super) fn palette(&self) -> Vec<[u8; 3]> {
        let colors = (1..=self.lesions.len() + self.parts.len()).map(part_color);
        std::iter::once([0; 3]).chain(colors).collect()
    }

    /// The categories of COCO.
    pub(super) fn coco(&self) -> Vec<Value> {
        let kinds = [("lesion", &self.lesions), ("part", &self.parts)];
        let names = kinds.into_iter().flat_map(|(kind, names)| names.iter().map(move |name| (kind, name)));
        let category = |(id, (kind, name))| json!({ "id": id, "name": name, "supercategory": kind });
        (1..).zip(names).map(|pair: (u8, _)| category(pair)).collect()
    }
}

/// Number of a name in a list that follows on `before` others.
fn number(names: &[String], before: usize, name: &str) -> u8 {
    names.iter().position(|known| known == name).map_or(0, |index| (before + index + 1) as u8)
}
