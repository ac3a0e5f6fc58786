//! Labels of the components of a render, in the order of the film.

use super::settings::RenderSettings;
use crate::image::{Component, LightPath};
use crate::scene::Scene;
use crate::spectral::ExcitationNodes;

/// `[group, and excitation node][reflected, one per fluorophore, multiple]`.
pub(super) fn component_labels(scene: &Scene, settings: &RenderSettings) -> Vec<Component> {
    let mut labels = Vec::new();
    for (number, group) in scene.light_groups.iter().enumerate() {
        let nodes = settings.nodes_of(number).map_or(&[][..], ExcitationNodes::nodes_nm);
        for node_nm in std::iter::once(None).chain(nodes.iter().copied().map(Some)) {
            let mut push = |light| labels.push(Component { light_group: group.name.clone(), node_nm, light });
            push(LightPath::Reflected);
            scene.fluorophores.iter().for_each(|f| push(LightPath::Fluorescence(f.name.clone())));
            push(LightPath::MultipleFluorescence);
        }
    }
    labels
}
