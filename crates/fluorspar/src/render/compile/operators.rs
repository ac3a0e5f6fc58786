//! Fluorescence operators, weighted within each band by the spectrum that excites.

use rayon::prelude::*;

use super::excitation_bins::excitation_slices;
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
    excitation_edges_nm: &[f64],
) -> Vec<Vec<FluorescenceOperator>> {
    let slices = excitation_edges_nm.len().max(1);
    group_spectra
        .iter()
        .flat_map(|spectrum| match spectrum {
            Some(spectrum) => {
                excitation_slices(spectrum, excitation_edges_nm).into_iter().map(Some).collect()
            }
            None => vec![None; slices],
        })
        .map(|spectrum| of_matrices(scene, matrices, spectrum.as_ref()))
        .collect()
}

/// `[matrix]`, evenly weighted, for light that already fluoresced.
pub(super) fn unweighted(scene: &Scene, matrices: &[&PhotonEem]) -> Vec<FluorescenceOperator> {
    of_matrices(scene, matrices, None)
}

fn of_matrices(
    scene: &Scene,
    matrices: &[&PhotonEem],
    spectrum: Option<&Curve>,
) -> Vec<FluorescenceOperator> {
    matrices.par_iter().map(|eem| FluorescenceOperator::new(eem, &scene.grid, spectrum)).collect()
}
