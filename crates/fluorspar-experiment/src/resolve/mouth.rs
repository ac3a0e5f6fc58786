//! Resolves a `[mouth]` section for materials and objects alike.

use std::collections::BTreeMap;

use super::context::{Context, Resolved};
use crate::cache::cached_mouth;
use crate::error::steps;
use crate::schema::{ExperimentFile, MouthSection};
use fluorspar::names::did_you_mean;
use fluorspar::quote::excerpt;
use fluorspar_anatomy::{EXAMINATION_VIEWS, ExaminationView, POSES, TOOTH_KINDS, Tissue};

/// The tissue that uses a material, or else that of the parts that do, if it is the only one.
pub(super) fn only_tissue(context: &Context<'_>, file: &ExperimentFile, material: &str) -> Option<Tissue> {
    let given = &file.mouth.as_ref()?.materials;
    if TOOTH_KINDS.iter().any(|kind| given.get(*kind).is_some_and(|name| name == material)) {
        return Some(Tissue::Tooth);
    }
    let mut users = Tissue::ALL
        .into_iter()
        .filter(|tissue| given.get(tissue.name()).map_or(tissue.name(), String::as_str) == material);
    let Some(first) = users.next() else {
        // Unused: a misspelled line of [mouth.materials] is reported later, more plainly than a missing tissue.
        let of_its_name = || Tissue::ALL.into_iter().find(|tissue| tissue.name() == material);
        return tissue_of_parts(context, given, material).or_else(of_its_name);
    };
    users.next().is_none().then_some(first)
}

/// The only tissue among the parts of the mouth that were given a material.
fn tissue_of_parts(
    context: &Context<'_>,
    given: &BTreeMap<String, String>,
    material: &str,
) -> Option<Tissue> {
    let is_given = |part: &str| given.get(part).is_some_and(|name| name == material);
    if !given.keys().any(|key| is_given(key)) {
        return None;
    }
    let mouth = cached_mouth(context.mouth.as_ref()?).ok()?;
    let mut tissues = mouth.parts.iter().filter(|part| is_given(&part.name)).map(|part| part.tissue);
    let first = tissues.next()?;
    tissues.all(|tissue| tissue == first).then_some(first)
}

/// Numbers of people that can be drawn.
const PEOPLE: [u64; 2] = [1, 4_000_000_000];

/// Refuses people that there are not, and invalid parameters of a mouth.
pub(super) fn check_person(context: &Context<'_>, section: &MouthSection) -> Resolved<()> {
    if let Some(person) = section.person {
        context.whole_within(&steps!["mouth", "person"], person.into(), PEOPLE)?;
    }
    let valid = section.parameters.validate();
    valid.map_err(|error| context.error(&steps!["mouth", error.field], error.message))
}

/// Refuses the name of a view that there is not.
pub(super) fn check_view(context: &Context<'_>, view: Option<&str>) -> Resolved<()> {
    let Some(name) = view.filter(|name| ExaminationView::find(name).is_none()) else { return Ok(()) };
    let names = || EXAMINATION_VIEWS.iter().chain(&POSES).map(|view| view.name);
    let hint = did_you_mean(name, names());
    let known = names().collect::<Vec<_>>().join(", ");
    context.fail(
        &steps!["mouth", "view"],
        format!("there is no view \"{}\"{hint} Known: {known}", excerpt(name)),
    )
}
