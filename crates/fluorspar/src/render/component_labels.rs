//! Labels of the components of a render, in the order of the film.

use super::settings::RenderSettings;
use crate::image::{Component, EXCITATION_MARK, LightPath};
use crate::scene::Scene;

/// `[group and excitation bin][reflected, one per fluorophore, multiple]`.
pub(super) fn component_labels(scene: &Scene, settings: &RenderSettings) -> Vec<Component> {
    let mut labels = Vec::new();
    for group in &scene.light_groups {
        for name in excitation_names(&group.name, &settings.excitation_edges_nm) {
            let mut push = |light| labels.push(Component { light_group: name.clone(), light });
            push(LightPath::Reflected);
            scene.fluorophores.iter().for_each(|f| push(LightPath::Fluorescence(f.name.clone())));
            push(LightPath::MultipleFluorescence);
        }
    }
    labels
}

/// Names of the excitation bins of a light group.
fn excitation_names(group: &str, edges_nm: &[f64]) -> Vec<String> {
    if edges_nm.is_empty() {
        return vec![group.into()];
    }
    let mut names: Vec<String> =
        edges_nm.windows(2).map(|edge| format!("{group}{EXCITATION_MARK}{}-{}", edge[0], edge[1])).collect();
    names.push(format!("{group}{EXCITATION_MARK}rest"));
    names
}
