//! Fluorescence operators, weighted within each band by the spectrum that excites.

use rayon::prelude::*;

use crate::geometry::OrientedPoint;
use crate::interruption::end_if_interrupted;
use crate::render::RenderSettings;
use crate::render::fluorescence_operator::{BinWeight, FluorescenceOperator, SampledEem};
use crate::scene::Scene;
use crate::scene::irradiance::{direct_irradiance, group_spectrum};
use crate::spectral::{Curve, ExcitationNodes, PhotonEem};

/// Spectrum of each light group at points of the scene, on any scale; `None` for groups without light. Lights of all
/// kinds are weighted by their unoccluded irradiance at the points.
pub(super) fn group_spectra(scene: &Scene, points: &[OrientedPoint]) -> Vec<Option<Curve>> {
    let parts = direct_irradiance(scene, points);
    (0..scene.light_groups.len()).map(|group| group_spectrum(&parts, group)).collect()
}

/// Operators of all matrices.
pub(super) struct Operators {
    /// `[spectrum kept apart][matrix]`, excitation weighted by it; nothing for excitation nodes.
    pub(super) of_groups: Vec<Vec<FluorescenceOperator>>,
    /// `[matrix]`, evenly weighted, for light that already fluoresced.
    pub(super) unweighted: Vec<FluorescenceOperator>,
}

/// Samples every matrix once for the spectra of all light groups.
pub(super) fn compile(
    scene: &Scene,
    matrices: &[&PhotonEem],
    group_spectra: &[Option<Curve>],
    settings: &RenderSettings,
) -> Operators {
    let spectra = group_spectra.iter().map(Option::as_ref).chain([None]);
    let weights: Vec<BinWeight<'_>> = spectra.map(|light| BinWeight::new(&scene.grid, light)).collect();
    let of_matrix = |eem: &&PhotonEem| -> Vec<FluorescenceOperator> {
        end_if_interrupted();
        let sampled = SampledEem::new(eem, &scene.grid);
        weights.iter().map(|weight| sampled.operator(weight)).collect()
    };
    let found: Vec<Vec<FluorescenceOperator>> = matrices.par_iter().map(of_matrix).collect();
    let mut by_weight: Vec<Vec<FluorescenceOperator>> = weights.iter().map(|_| Vec::new()).collect();
    for operator in found.into_iter().flat_map(|of_matrix| of_matrix.into_iter().enumerate()) {
        by_weight[operator.0].push(operator.1);
    }
    let unweighted = by_weight.pop().unwrap_or_default();
    let of_groups = by_weight.into_iter().enumerate().flat_map(|(group, operators)| {
        let nodes = settings.nodes_of(group).map_or(0, ExcitationNodes::len);
        std::iter::once(operators).chain(vec![Vec::new(); nodes])
    });
    Operators { of_groups: of_groups.collect(), unweighted }
}
