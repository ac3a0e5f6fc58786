//! Fluorescence operators, weighted within each band by the spectrum that excites.

use rayon::prelude::*;

use super::excitation_bins::{Slice, Slicing};
use crate::geometry::OrientedPoint;
use crate::render::fluorescence_operator::FluorescenceOperator;
use crate::scene::Scene;
use crate::scene::irradiance::{direct_irradiance, group_spectrum};
use crate::spectral::{Curve, PhotonEem};

/// Spectrum of each light group at points of the scene, on any scale; `None` for groups without light. Lights of all
/// kinds are weighted by their unoccluded irradiance at the points.
pub(super) fn group_spectra(scene: &Scene, points: &[OrientedPoint]) -> Vec<Option<Curve>> {
    let parts = direct_irradiance(scene, points);
    (0..scene.light_groups.len()).map(|group| group_spectrum(&parts, group)).collect()
}

/// `[group and excitation bin][matrix]`, excitation weighted by the spectrum of the group.
pub(super) fn of_groups(
    scene: &Scene,
    matrices: &[&PhotonEem],
    group_spectra: &[Option<Curve>],
    slicing: &Slicing<'_>,
) -> Vec<Vec<FluorescenceOperator>> {
    group_spectra
        .iter()
        .enumerate()
        .flat_map(|(group, spectrum)| match spectrum {
            Some(spectrum) => slicing.slices(group, spectrum).into_iter().map(Some).collect(),
            None => vec![None; slicing.count(group)],
        })
        .map(|slice| of_matrices(scene, matrices, slice.as_ref()))
        .collect()
}

/// `[matrix]`, evenly weighted, for light that already fluoresced.
pub(super) fn unweighted(scene: &Scene, matrices: &[&PhotonEem]) -> Vec<FluorescenceOperator> {
    of_matrices(scene, matrices, None)
}

fn of_matrices(scene: &Scene, matrices: &[&PhotonEem], slice: Option<&Slice>) -> Vec<FluorescenceOperator> {
    let operator = |eem: &&PhotonEem| match slice {
        // Light of a hat lies in its own bands alone.
        Some(Slice { curve, is_hat: true }) => FluorescenceOperator::of_lit_bands(eem, &scene.grid, curve),
        slice => FluorescenceOperator::new(eem, &scene.grid, slice.map(|slice| &slice.curve)),
    };
    matrices.par_iter().map(operator).collect()
}
