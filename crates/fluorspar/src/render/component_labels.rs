//! Labels of the components of a render, in the order of the film.

use super::settings::RenderSettings;
use crate::image::{Component, ExcitationBin, LightPath};
use crate::scene::Scene;
use crate::spectral::ExcitationNodes;

/// `[group and excitation bin][reflected, one per fluorophore, multiple]`.
pub(super) fn component_labels(scene: &Scene, settings: &RenderSettings) -> Vec<Component> {
    let mut labels = Vec::new();
    for (number, group) in scene.light_groups.iter().enumerate() {
        let nodes = settings.nodes_of(number).map_or(&[][..], ExcitationNodes::nodes_nm);
        let nodes = nodes.iter().map(|nm| Some(ExcitationBin::Node(*nm)));
        for excitation in excitation_bins(&settings.excitation_edges_nm).into_iter().chain(nodes) {
            let mut push =
                |light| labels.push(Component { light_group: group.name.clone(), excitation, light });
            push(LightPath::Reflected);
            scene.fluorophores.iter().for_each(|f| push(LightPath::Fluorescence(f.name.clone())));
            push(LightPath::MultipleFluorescence);
        }
    }
    labels
}

/// The excitation bins that are kept apart; one that is all of the spectrum where there are no edges.
fn excitation_bins(edges_nm: &[f64]) -> Vec<Option<ExcitationBin>> {
    if edges_nm.is_empty() {
        return vec![None];
    }
    let between = edges_nm.windows(2).map(|edges| Some(ExcitationBin::Between([edges[0], edges[1]])));
    between.chain([Some(ExcitationBin::Outside)]).collect()
}
