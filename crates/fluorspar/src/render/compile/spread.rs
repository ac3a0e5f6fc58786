//! Radial profiles of translucent materials on the bands of a scene.

use fluorspar_accel::bands::to_blocks;

use crate::material::{FluorophoreAmount, PreparedMaterial};
use crate::render::material_spread::{MaterialSpread, RADII, node_areas_mm2, radius_mm};
use crate::spectral::{Curve, WavelengthGrid};
use crate::tissue::{EMITTED_NM, EXCITATIONS_NM, GAUSSIANS, density_per_mm2, gaussian_mm};

/// Wavelengths whose reflected light decides how distances are drawn, nm.
const DRAWN_NM: [f64; 3] = [450.0, 540.0, 620.0];
/// Least share of each ring in that, of what the state or the fluorophore with most light there has.
const LEAST_OF_LARGEST: f64 = 0.25;
/// Least share of each ring at all.
const LEAST_SHARE: f64 = 0.003;

/// Shares of Gaussians.
type Mixture = [f32; GAUSSIANS];

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
    let drawn: Vec<Mixture> = profiles.iter().flat_map(|profile| DRAWN_NM.map(|nm| profile.at(nm))).collect();
    let emitted: Vec<Vec<Mixture>> =
        material.fluorophores.iter().map(|amount| emitted(amount, light)).collect();
    let cumulative = cumulative(&drawn, &emitted.concat());
    let emitted = emitted.iter().map(|mixtures| at_nodes(mixtures, &areas)).collect();
    Some(MaterialSpread { cumulative, reflected: reflected.collect(), emitted })
}

/// Densities of some mixtures at the nodes, `[node][mixture]`.
fn at_nodes(mixtures: &[Mixture], areas: &[f64; RADII]) -> Vec<f32> {
    let of_all: Vec<_> = mixtures.iter().map(|shares| densities(shares, areas)).collect();
    let at = |node: usize| of_all.iter().map(move |density| density[node] as f32);
    (0..RADII).flat_map(at).collect()
}

/// Densities of a mixture at the nodes, 1/mm², such that their interpolation holds all its light.
fn densities(shares: &Mixture, areas: &[f64; RADII]) -> [f64; RADII] {
    let density: [f64; RADII] = std::array::from_fn(|node| density_per_mm2(shares, radius_mm(node)));
    let total: f64 = density.iter().zip(areas).map(|(density, area)| density * area).sum();
    density.map(|value| value / total)
}

/// Probabilities of distances up to each node. Fluorescence from above the scattering layers leaves nearer to where it was excited than
/// reflected light.
fn cumulative(reflected: &[Mixture], emitted: &[Mixture]) -> [f32; RADII] {
    let beyond = |radius_mm: f64, number: usize| (-0.5 * (radius_mm / gaussian_mm(number)).powi(2)).exp();
    let in_ring = |node: usize, shares: &Mixture| -> f64 {
        let inner = if node == 0 { 0.0 } else { radius_mm(node - 1) };
        let share = |number: usize| beyond(inner, number) - beyond(radius_mm(node), number);
        shares.iter().enumerate().map(|(number, of_one)| f64::from(*of_one) * share(number)).sum()
    };
    // Every ring is drawn now and then, and where a state has much light often enough that weights stay small
    let mut sum = 0.0;
    let mut sums: [f64; RADII] = std::array::from_fn(|node| {
        // What is drawn like the root of the mean square varies least; most images show more reflected light
        let square = |mixtures: &[Mixture]| {
            let squares = mixtures.iter().map(|shares| in_ring(node, shares).powi(2));
            squares.sum::<f64>() / mixtures.len().max(1) as f64
        };
        let mean = ((2.0 * square(reflected) + square(emitted)) / 3.0).sqrt();
        let all = reflected.iter().chain(emitted).map(|shares| in_ring(node, shares));
        sum += mean.max(LEAST_OF_LARGEST * all.fold(0.0, f64::max)).max(LEAST_SHARE);
        sum
    });
    sums.iter_mut().for_each(|value| *value /= sum);
    sums.map(|value| value as f32)
}

/// Mixtures by wavelength of emission of a fluorophore under the light of the scene.
fn emitted(amount: &FluorophoreAmount, light: &[Option<Curve>]) -> Vec<Mixture> {
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
    let at = |nm: &f64| {
        let mut shares = [0.0; GAUSSIANS];
        for (profile, weight) in profiles.iter().zip(weights) {
            shares.iter_mut().zip(profile.at(*nm)).for_each(|(sum, share)| *sum += weight as f32 * share);
        }
        shares
    };
    EMITTED_NM.iter().map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::{Material, ScalarTexture, TissueSurface};
    use crate::tissue::site_tests::{any, tongue};

    /// The light of a fluorophore high up in the tissue leaves near to where it was excited: distances must be drawn there, too.
    #[test]
    fn no_light_that_entered_elsewhere_weighs_much_more_than_it_is() {
        let grid = WavelengthGrid::uniform(380.0, 660.0, 20.0).unwrap();
        let tissue = || tongue().tissue(&any).unwrap();
        let surface = TissueSurface::varying(Vec::new(), |_| Ok(tissue()), &grid, true).unwrap();
        let one = ScalarTexture::Constant(1.0);
        let amounts = (0..surface.emissions.len()).flat_map(|number| surface.amounts(number, number, &one));
        let material = Material {
            fluorophores: amounts.collect(),
            ..Material::with_base("tongue", surface.base(), None)
        };
        let prepared = &crate::material::PreparedMaterials::new(&[material], &grid)[0];
        let spread = compile(prepared, &grid, &[Some(Curve::constant(1.0))]).unwrap();
        for (number, emitted) in spread.emitted.iter().enumerate() {
            for (nm, wavelength) in EMITTED_NM.iter().enumerate() {
                let (mut most, mut square) = (0.0_f64, 0.0);
                for ring in 1..RADII {
                    let share = f64::from(spread.cumulative[ring] - spread.cumulative[ring - 1]);
                    let area = std::f64::consts::PI * (radius_mm(ring).powi(2) - radius_mm(ring - 1).powi(2));
                    let at = |node: usize| f64::from(emitted[node * EMITTED_NM.len() + nm]);
                    let weight = 0.5 * (at(ring - 1) + at(ring)) / (share / area);
                    (most, square) = (most.max(weight), square + share * weight * weight);
                }
                assert!(most < 6.0 && square < 2.0, "{number} at {wavelength} nm: {most}, {square}");
            }
        }
    }
}
