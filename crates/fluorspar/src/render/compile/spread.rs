//! Radial profiles of translucent materials on the bands of a scene.

use fluorspar_accel::bands::to_blocks;

use crate::material::{FluorophoreAmount, PreparedMaterial};
use crate::render::material_spread::{MaterialSpread, RADII, node_areas_mm2, radius_mm};
use crate::spectral::{Curve, WavelengthGrid};
use crate::tissue::{EMITTED_NM, EXCITATIONS_NM, GAUSSIANS, density_per_mm2, gaussian_mm};

/// Wavelengths whose reflected light decides how distances are drawn, nm.
const DRAWN_NM: [f64; 3] = [450.0, 540.0, 620.0];
/// Least share of each ring in that, of what the state with most light there has.
const LEAST_OF_LARGEST: f64 = 0.25;
/// Least share of each ring at all.
const LEAST_SHARE: f64 = 0.003;

/// Profiles of a material; `None` where light leaves where it enters. `light` are the spectra of the light groups.
pub(super) fn compile(
    material: &PreparedMaterial,
    grid: &WavelengthGrid,
    light: &[Option<Curve>],
) -> Option<MaterialSpread> {
    let profiles = &material.states.as_ref()?.profiles;
    if profiles.is_empty() || profiles.len() != material.terms.len() {
        return None;
    }
    let areas = node_areas_mm2();
    let reflected = profiles.iter().zip(&material.terms).map(|(profile, term)| {
        let by_band: Vec<[f64; RADII]> =
            (0..grid.len()).map(|band| densities(&profile.at(grid.center_nm(band)), &areas)).collect();
        let of_radius = |node: usize| {
            let values: Vec<f32> =
                term.bands.iter().zip(&by_band).map(|(r, density)| r * density[node] as f32).collect();
            to_blocks(&values)
        };
        (0..RADII).flat_map(of_radius).collect()
    });
    let emitted = material.fluorophores.iter().map(|amount| emitted(amount, light, &areas));
    let drawn: Vec<[f32; GAUSSIANS]> =
        profiles.iter().flat_map(|profile| DRAWN_NM.map(|nm| profile.at(nm))).collect();
    let (reflected, emitted) = (reflected.collect(), emitted.collect());
    Some(MaterialSpread { cumulative: cumulative(&drawn), reflected, emitted })
}

/// Densities of a mixture at the nodes, 1/mm², such that their interpolation holds all its light.
fn densities(shares: &[f32; GAUSSIANS], areas: &[f64; RADII]) -> [f64; RADII] {
    let density: [f64; RADII] = std::array::from_fn(|node| density_per_mm2(shares, radius_mm(node)));
    let total: f64 = density.iter().zip(areas).map(|(density, area)| density * area).sum();
    density.map(|value| value / total)
}

/// Probabilities of distances up to each node, by the mean of some mixtures.
fn cumulative(mixtures: &[[f32; GAUSSIANS]]) -> [f32; RADII] {
    let beyond = |radius_mm: f64, number: usize| (-0.5 * (radius_mm / gaussian_mm(number)).powi(2)).exp();
    let in_ring = |node: usize, shares: &[f32; GAUSSIANS]| -> f64 {
        let inner = if node == 0 { 0.0 } else { radius_mm(node - 1) };
        let share = |number: usize| beyond(inner, number) - beyond(radius_mm(node), number);
        shares.iter().enumerate().map(|(number, of_one)| f64::from(*of_one) * share(number)).sum()
    };
    // Every ring is drawn now and then, and where a state has much light often enough that weights stay small
    let mut sum = 0.0;
    let mut sums: [f64; RADII] = std::array::from_fn(|node| {
        let of_states = || mixtures.iter().map(|shares| in_ring(node, shares));
        let mean = of_states().sum::<f64>() / mixtures.len().max(1) as f64;
        sum += mean.max(LEAST_OF_LARGEST * of_states().fold(0.0, f64::max)).max(LEAST_SHARE);
        sum
    });
    sums.iter_mut().for_each(|value| *value /= sum);
    sums.map(|value| value as f32)
}

/// `[radius][wavelength of emission]` of a fluorophore under the light of the scene.
fn emitted(amount: &FluorophoreAmount, light: &[Option<Curve>], areas: &[f64; RADII]) -> Vec<f32> {
    let Some(held) = &amount.in_tissue else { return Vec::new() };
    let Some(profiles) = &held.profiles else { return Vec::new() };
    // How much of what excites it lies near each of the known excitations
    let mut weights = [0.0; EXCITATIONS_NM.len()];
    let excitations: Vec<f64> = (350..=600).step_by(5).map(f64::from).collect();
    for (&nm, total_yield) in excitations.iter().zip(held.eem.total_yields(&excitations)) {
        let photons: f64 = light.iter().flatten().map(|spectrum| spectrum.at(nm) * nm).sum();
        let excited = photons * total_yield;
        let nearest = (0..EXCITATIONS_NM.len())
            .min_by(|&a, &b| (EXCITATIONS_NM[a] - nm).abs().total_cmp(&(EXCITATIONS_NM[b] - nm).abs()));
        weights[nearest.unwrap_or(0)] += excited.max(0.0);
    }
    let total: f64 = weights.iter().sum();
    let weights = if total > 0.0 { weights.map(|w| w / total) } else { [1.0 / 3.0; 3] };
    let by_emission = EMITTED_NM.map(|nm| {
        let mut shares = [0.0; GAUSSIANS];
        for (profile, weight) in profiles.iter().zip(weights) {
            shares.iter_mut().zip(profile.at(nm)).for_each(|(sum, share)| *sum += weight as f32 * share);
        }
        densities(&shares, areas)
    });
    (0..RADII).flat_map(|node| by_emission.map(|density| density[node] as f32)).collect()
}
