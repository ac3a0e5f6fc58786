//! Which light groups are kept apart by excitation wavelength, and at which nodes.

use super::settings::BasisSettings;
use crate::scene::Scene;
use crate::spectral::{Curve, ExcitationNodes, PhotonEem};

/// Error of fluorescence that the choice of the nodes may leave; what the short form of the image leaves comes on top.
const NODE_ERROR: f64 = 0.003;
/// Light beyond the peaks that the nodes cover, nm: tails of lights are longer on the red side.
const BEYOND_NM: [f64; 2] = [20.0, 60.0];
/// Share of the light of a group that must lie within the nodes for the group to be kept apart.
const LEAST_INSIDE: f64 = 0.9;
/// Ranges of emission, nm, whose excitation must be right each.
const EMISSION_NM: [[f64; 2]; 3] = [[440.0, 500.0], [500.0, 590.0], [590.0, 720.0]];
/// Most matrices of one fluorophore that are looked at.
const MOST_MATRICES: usize = 4;

/// Why a scene can't be rendered with an excitation basis.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BasisError {
    /// No light group has its light there.
    #[error(
        "no light group has 90 % of its light between {} and {} nm; give the range in which the peaks of your lights lie",
        .span_nm[0], .span_nm[1]
    )]
    NoGroup {
        /// First and last node, nm.
        span_nm: [f64; 2],
    },
    /// The wavelength grid does not hold the lights.
    #[error(
        "lights with peaks from {} to {} nm have light from {} nm on, but the wavelength grid begins at {} nm; set \
         spectral.first_nm = {}, or begin the range at {} nm", .peaks_nm[0], .peaks_nm[1], .from_nm, .grid_nm, .from_nm, .least_nm
    )]
    Grid {
        /// Range of the peaks, nm.
        peaks_nm: [f64; 2],
        /// Where the light of the first of them begins, nm.
        from_nm: f64,
        /// Where the grid begins, nm.
        grid_nm: f64,
        /// First peak whose light lies in the grid, nm.
        least_nm: f64,
    },
    /// Lights of one group whose spectra are not in proportion.
    #[error("the lights of group \"{group}\" differ in their spectra; give each spectrum a group of its own")]
    Unlike {
        /// The light group.
        group: String,
    },
}

/// Chooses the light groups of a scene that are kept apart by excitation wavelength, and nodes with which every light of 8 nm and
/// more (full width at half maximum) with a peak in `peaks_nm` excites all fluorophores of the scene to within 0.3 %.
///
/// # Errors
/// No group with its light there, a group whose lights differ, a wavelength grid that does not hold the lights.
pub fn choose_basis(scene: &Scene, peaks_nm: [f64; 2]) -> Result<BasisSettings, BasisError> {
    let edges = scene.grid.edges_nm();
    let from_nm = peaks_nm[0] - BEYOND_NM[0];
    if from_nm < edges[0] - 0.5 * scene.grid.width_nm(0) - 1e-9 {
        let (grid_nm, least_nm) = (edges[0], edges[0] + BEYOND_NM[0]);
        return Err(BasisError::Grid { peaks_nm, from_nm, grid_nm, least_nm: least_nm.ceil() });
    }
    // Ends of the nodes at edges of bands, so that reflected light is whole in each
    let first = edges.partition_point(|edge| *edge <= from_nm).saturating_sub(1);
    let last = edges.partition_point(|edge| *edge < peaks_nm[1] + BEYOND_NM[1]).min(edges.len() - 1);
    let span_nm = [edges[first], edges[last]];
    let mut groups = Vec::new();
    for (number, group) in scene.light_groups.iter().enumerate() {
        let spectra = scene.group_spectra(number);
        let inside = |light: &Curve| light.integral(span_nm[0], span_nm[1]) >= LEAST_INSIDE * light.total();
        let mapped = scene.lights.iter().any(|light| light.group == number && light.spectra().len() > 1);
        if spectra.is_empty() || mapped || !spectra.iter().all(|light| inside(light)) {
            continue;
        }
        if !spectra.iter().all(|light| are_in_proportion(&spectra[0], light)) {
            return Err(BasisError::Unlike { group: group.name.clone() });
        }
        groups.push(number);
    }
    if groups.is_empty() {
        return Err(BasisError::NoGroup { span_nm });
    }
    let responses = excitation_responses(scene);
    Ok(BasisSettings { groups, nodes: ExcitationNodes::choose(span_nm, peaks_nm, &responses, NODE_ERROR) })
}

/// Whether two spectra differ by a factor only.
pub(crate) fn are_in_proportion(a: &Curve, b: &Curve) -> bool {
    let (total_a, total_b) = (a.total(), b.total());
    let nodes = a.wavelengths_nm().iter().chain(b.wavelengths_nm());
    let highest = a.max() / total_a;
    total_a > 0.0
        && total_b > 0.0
        && nodes.into_iter().all(|nm| (a.at(*nm) / total_a - b.at(*nm) / total_b).abs() <= 1e-6 * highest)
}

/// How the fluorescence of a scene depends on the wavelength that excites: for each fluorophore, some of the matrices that it has in
/// tissue, and ranges of emission; alone and times the reflectance of the surface, as light excites that was reflected before.
pub(crate) fn excitation_responses(scene: &Scene) -> Vec<Curve> {
    let mut found = Vec::new();
    let mut seen: Vec<(*const PhotonEem, usize)> = Vec::new();
    for material in &scene.materials {
        for amount in &material.fluorophores {
            let in_tissue = amount.in_tissue.as_ref();
            let own = scene.fluorophores.get(amount.fluorophore).map(|fluorophore| &fluorophore.eem);
            let Some(eem) = in_tissue.map(|state| &*state.eem).or(own) else { continue };
            let of_this = seen.iter().filter(|(_, fluorophore)| *fluorophore == amount.fluorophore).count();
            let known = seen.iter().any(|(matrix, _)| std::ptr::eq(*matrix, eem));
            if known || of_this >= MOST_MATRICES || amount.concentration.max() <= 0.0 {
                continue;
            }
            seen.push((eem, amount.fluorophore));
            let term = in_tissue.map_or(0, |state| state.term);
            let reflectance = material.diffuse().and_then(|diffuse| diffuse.reflectance.get(term));
            let reflectance = reflectance.map(|term| &term.spectrum);
            for range_nm in EMISSION_NM {
                let excited = excitation_spectrum(eem, range_nm);
                if excited.max() <= 0.0 {
                    continue;
                }
                found.extend(reflectance.map(|reflectance| excited.times(reflectance)));
                found.push(excited);
            }
        }
    }
    found
}

/// Photons that a matrix emits in a range, by excitation wavelength, without the Stokes mask: what it cuts off lies at wavelengths
/// that the light itself has, where reflected light is stronger by orders of magnitude.
fn excitation_spectrum(eem: &PhotonEem, [from_nm, to_nm]: [f64; 2]) -> Curve {
    const STEP_NM: f64 = 10.0;
    let count = ((to_nm - from_nm) / STEP_NM) as usize;
    let emitted = |nm: f64| (0..count).map(|i| eem.unmasked(from_nm + (i as f64 + 0.5) * STEP_NM, nm)).sum();
    let nodes: Vec<f64> = (0..=170).map(|i| 280.0 + 2.0 * f64::from(i)).collect();
    let values = nodes.iter().map(|nm| emitted(*nm)).collect();
    Curve::new(nodes, values).unwrap_or_else(|_| Curve::constant(0.0))
}
