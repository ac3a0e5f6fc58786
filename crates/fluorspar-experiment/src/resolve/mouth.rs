//! Resolves a `[mouth]` section for materials and objects alike.

use super::context::{Context, Resolved};
use crate::error::steps;
use crate::schema::ExperimentFile;
use fluorspar_anatomy::{MouthParameters, Tissue};

/// The tissue that uses a material, if it is the only one.
pub(super) fn only_tissue(file: &ExperimentFile, material: &str) -> Option<Tissue> {
    let given = &file.mouth.as_ref()?.materials;
    let mut users = Tissue::ALL
        .into_iter()
        .filter(|tissue| given.get(tissue.name()).map_or(tissue.name(), String::as_str) == material);
    let Some(first) = users.next() else {
        // Unused: a misspelled line of [mouth.materials] is reported later, more plainly than a missing tissue.
        return Tissue::ALL.into_iter().find(|tissue| tissue.name() == material);
    };
    users.next().is_none().then_some(first)
}

/// Refuses invalid parameters of a mouth.
pub(super) fn check_parameters(context: &Context<'_>, parameters: &MouthParameters) -> Resolved<()> {
    parameters.validate().map_err(|error| context.error(&steps!["mouth", error.field], error.message))
}
