//! Layered tissue as a material: what its surface reflects and emits, in every state that it has somewhere.

use std::sync::Arc;

use rayon::prelude::*;

use super::lambertian::Lambertian;
use super::state_grid::{MAX_NODES, MappedParameter, StateGrid};
use super::texture::ScalarTexture;
use super::{FluorophoreAmount, TissueEmission};
use crate::spectral::{Curve, Fluorophore, PhotonEem, WavelengthGrid};
use crate::tissue::{
    DiscreteOrdinates, EffectiveTissue, LayerFluorophore, LayeredTissue, Level, TissueError,
};

/// Relative error that a mean of states may have half way between two nodes, as far as 8 nodes suffice.
pub const INTERPOLATION_ERROR: f64 = 0.01;
/// Most nodes of a parameter that [`TissueSurface::varying`] chooses.
const MOST_NODES: usize = MAX_NODES;
/// Wavelengths at which states are compared, nm: bands and gaps of hemoglobin, usual lamps, porphyrin.
const PROBES_NM: [f64; 12] =
    [385.0, 405.0, 420.0, 435.0, 450.0, 500.0, 520.0, 540.0, 560.0, 580.0, 635.0, 700.0];

/// Reflectance and fluorescence of layered tissue for light that passed its surface, on a grid of states.
///
/// The surface itself is not part of it: a coat of the tissue's refractive index reflects there, and lets light in and out
/// with its Fresnel factors. Under diffuse light the two together give the reflectance and the fluorescence that the solver
/// finds with the surface: both are divided by the share `1 - E` of diffuse light that a smooth surface lets in.
#[derive(Clone, Debug, PartialEq)]
pub struct TissueSurface {
    /// Parameters that vary over the surface, and the states in their order.
    pub grid: StateGrid,
    /// Reflectance of each state.
    pub reflectances: Vec<Curve>,
    /// Fluorophores of the tissue, with what each emits in each state.
    pub emissions: Vec<SurfaceFluorescence>,
}

/// The light of one fluorophore of a tissue, of all its layers.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceFluorescence {
    /// The fluorophore as the catalogue has it.
    pub fluorophore: Arc<Fluorophore>,
    /// Photon yield density of the tissue in each state, for light that passed the surface.
    pub states: Vec<Arc<PhotonEem>>,
}

impl TissueSurface {
    /// A tissue from its states, in the order of the grid. All must have the same fluorophores.
    ///
    /// # Errors
    /// A fluorescence that can't be brought into a short form.
    pub fn new(grid: StateGrid, states: &[EffectiveTissue]) -> Result<Self, TissueError> {
        let mut emissions: Vec<SurfaceFluorescence> = Vec::new();
        for state in states {
            let passed = 1.0 / (1.0 - state.specular_reflectance());
            for (fluorophore, eem) in by_fluorophore(state)? {
                let eem = Arc::new(eem.scaled(passed));
                match emissions.iter_mut().find(|known| known.fluorophore.name == fluorophore.name) {
                    Some(known) => known.states.push(eem),
                    None => emissions.push(SurfaceFluorescence { fluorophore, states: vec![eem] }),
                }
            }
        }
        let reflectances = states
            .iter()
            .map(|state| {
                let passed = 1.0 / (1.0 - state.specular_reflectance());
                state.reflectance(Level::AboveSurface).scaled(passed)
            })
            .collect();
        Ok(Self { grid, reflectances, emissions })
    }

    /// A tissue of which some parameters vary over the surface. `tissue` makes it from their values, in their order. Where a
    /// parameter comes without nodes, they are added between the smallest and the largest value that its map has, until half
    /// way between two of them the mean of the states is within [`INTERPOLATION_ERROR`] of the state there, up to 8 nodes.
    /// Returns the surface and the largest relative error that was left half way between such nodes, of reflectance or of
    /// fluorescence.
    ///
    /// # Errors
    /// Parameters that `tissue` or the solver refuses.
    pub fn varying(
        parameters: Vec<MappedParameter>,
        tissue: impl Fn(&[f64]) -> Result<LayeredTissue, TissueError> + Sync,
        bands: &WavelengthGrid,
    ) -> Result<(Self, f64), TissueError> {
        // Choose the nodes of each parameter, the others in the middle of their ranges
        let range = |map: &ScalarTexture| [f64::from(map.min()), f64::from(map.max())];
        let middles: Vec<f64> = parameters.iter().map(|parameter| middle(range(&parameter.map))).collect();
        let mut grid = StateGrid { parameters };
        let mut largest = 0.0_f64;
        for (place, parameter) in grid.parameters.iter_mut().enumerate().filter(|(_, p)| p.nodes.is_empty()) {
            let probe = |value: f64| {
                let mut values = middles.clone();
                values[place] = value;
                Probe::new(&tissue(&values)?, bands)
            };
            let (nodes, error) = choose_nodes(range(&parameter.map), probe)?;
            largest = largest.max(error);
            parameter.nodes = nodes;
        }

        // Solve all states
        let states = (0..grid.len())
            .into_par_iter()
            .map(|state| {
                let values: Vec<f64> = grid.parameters_of(state).into_iter().map(f64::from).collect();
                EffectiveTissue::for_grid(&tissue(&values)?, bands)
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok((Self::new(grid, &states)?, largest))
    }

    /// The diffuse reflection below the surface.
    pub fn base(&self) -> Lambertian {
        Lambertian::of_states(self.reflectances.clone(), self.grid.clone())
    }

    /// Amounts of one of its fluorophores, number `emission`, that is `fluorophore` of the scene: `factor` over the surface
    /// times what the tissue holds.
    pub fn amounts(
        &self,
        emission: usize,
        fluorophore: usize,
        factor: &ScalarTexture,
    ) -> Vec<FluorophoreAmount> {
        let states = self.emissions.get(emission).map_or(&[][..], |emission| &emission.states);
        let amount = |(term, eem): (usize, &Arc<PhotonEem>)| FluorophoreAmount {
            fluorophore,
            concentration: factor.clone(),
            in_tissue: Some(TissueEmission { eem: eem.clone(), term }),
        };
        states.iter().enumerate().map(amount).collect()
    }
}

/// Where a value lies half way between two: by ratio where both are above 0.
fn middle([low, high]: [f64; 2]) -> f64 {
    if low > 0.0 { (low * high).sqrt() } else { 0.5 * (low + high) }
}

/// Nodes of a parameter in a range, and the largest relative error half way between them.
fn choose_nodes(
    range: [f64; 2],
    probe: impl Fn(f64) -> Result<Probe, TissueError>,
) -> Result<(Vec<f32>, f64), TissueError> {
    let [low, mut high] = range;
    if high <= low {
        // A map that is the same everywhere still needs two nodes.
        high = low.max(f64::MIN_POSITIVE) * (1.0 + 1e-3);
    }
    let mut nodes = vec![(low, probe(low)?), (high, probe(high)?)];
    loop {
        // Find the interval with the largest error half way
        let mut worst = (0.0, 0, None);
        for (place, pair) in nodes.windows(2).enumerate() {
            let [(a, left), (b, right)] = pair else { continue };
            let between = middle([*a, *b]);
            let exact = probe(between)?;
            let error = exact.error_of_mean(left, right, (between - a) / (b - a));
            if error >= worst.0 {
                worst = (error, place, Some((between, exact)));
            }
        }
        let (error, place, node) = worst;
        match node {
            Some(node) if error > INTERPOLATION_ERROR && nodes.len() < MOST_NODES => {
                nodes.insert(place + 1, node)
            }
            _ => return Ok((nodes.iter().map(|(value, _)| *value as f32).collect(), error)),
        }
    }
}

/// What a tissue does at a few wavelengths.
struct Probe(Vec<f64>);

impl Probe {
    fn new(tissue: &LayeredTissue, bands: &WavelengthGrid) -> Result<Self, TissueError> {
        let inside = |nm: &f64| (bands.start_nm()..=bands.end_nm()).contains(nm);
        let mut nm: Vec<f64> = PROBES_NM.into_iter().filter(inside).collect();
        if nm.len() < 2 {
            nm = vec![bands.start_nm(), bands.end_nm()];
        }
        let solved = EffectiveTissue::new(tissue, &nm, DiscreteOrdinates::DIFFUSE)?;
        let reflectance = solved.reflectance(Level::AboveSurface);
        let mut values: Vec<f64> = nm.iter().map(|&nm| reflectance.at(nm)).collect();
        let parts = solved.parts();
        for (index, &excitation) in nm.iter().enumerate() {
            for &emission in &nm[index + 1..] {
                let of_part = |part: &LayerFluorophore| {
                    solved.yield_density(*part, emission, excitation, Level::AboveSurface)
                };
                values.push(parts.iter().map(of_part).sum());
            }
        }
        Ok(Self(values))
    }

    /// Largest relative error of the mean of two others, with the weight of the second, in place of this one.
    fn error_of_mean(&self, first: &Self, second: &Self, weight: f64) -> f64 {
        let pairs = first.0.iter().zip(&second.0).map(|(a, b)| a + weight * (b - a));
        let errors = self.0.iter().zip(pairs).filter(|(exact, _)| **exact > 0.0);
        errors.map(|(exact, mean)| (mean / exact - 1.0).abs()).fold(0.0, f64::max)
    }
}

/// The fluorescence of a tissue by fluorophore, layers together.
fn by_fluorophore(tissue: &EffectiveTissue) -> Result<Vec<(Arc<Fluorophore>, PhotonEem)>, TissueError> {
    let mut found: Vec<(Arc<Fluorophore>, Vec<PhotonEem>)> = Vec::new();
    for part in tissue.parts() {
        let layer = &tissue.tissue().layers[part.layer];
        let fluorophore = layer.fluorophores[part.fluorophore].fluorophore.clone();
        let eem = tissue.eem(part, Level::AboveSurface)?;
        match found.iter_mut().find(|(known, _)| known.name == fluorophore.name) {
            Some((_, eems)) => eems.push(eem),
            None => found.push((fluorophore, vec![eem])),
        }
    }
    // Matrices of one fluorophore in several layers have its mask: their sum is separable, too.
    let sum = |eems: Vec<PhotonEem>| PhotonEem::weighted_sum(eems.iter().map(|eem| (1.0, eem)));
    Ok(found.into_iter().filter_map(|(fluorophore, eems)| Some((fluorophore, sum(eems)?))).collect())
}
