//! Fluorescence operators, weighted within each band by the spectrum that excites.

use rayon::prelude::*;

use crate::geometry::OrientedPoint;
use crate::interruption::end_if_interrupted;
use crate::render::RenderSettings;
use crate::render::fluorescence_operator::FluorescenceOperator;
use crate::scene::Scene;
use crate::scene::irradiance::{direct_irradiance, group_spectrum};
use crate::spectral::{Curve, ExcitationNodes, PhotonEem};

/// Spectrum of each light group at points of the scene, on any scale; `None` for groups without light. Lights of all
/// kinds are weighted by their unoccluded irradiance at the points.
pub(super) fn group_spectra(scene: &Scene, points: &[OrientedPoint]) -> Vec<Option<Curve>> {
    let parts = direct_irradiance(scene, points);
    (0..scene.light_groups.len()).map(|group| group_spectrum(&parts, group)).collect()
}

/// `[spectrum kept apart][matrix]`, excitation weighted by it; nothing for excitation nodes.
pub(super) fn of_groups(
    scene: &Scene,
    matrices: &[&PhotonEem],
    group_spectra: &[Option<Curve>],
    settings: &RenderSettings,
) -> Vec<Vec<FluorescenceOperator>> {
    group_spectra
        .iter()
        .enumerate()
        .flat_map(|(group, spectrum)| {
            let nodes = settings.nodes_of(group).map_or(0, ExcitationNodes::len);
            std::iter::once(of_matrices(scene, matrices, spectrum.as_ref())).chain(vec![Vec::new(); nodes])
        })
        .collect()
}

/// `[matrix]`, evenly weighted, for light that already fluoresced.
pub(super) fn unweighted(scene: &Scene, matrices: &[&PhotonEem]) -> Vec<FluorescenceOperator> {
    of_matrices(scene, matrices, None)
}

fn of_matrices(scene: &Scene, matrices: &[&PhotonEem], light: Option<&Curve>) -> Vec<FluorescenceOperator> {
    let operator = |eem: &&PhotonEem| {
        end_if_interrupted();
        FluorescenceOperator::new(eem, &scene.grid, light)
    };
    matrices.par_iter().map(operator).collect()
}
