//! Layered tissue as a material: what its surface reflects and emits, in every state that it has somewhere.

use std::sync::Arc;

use glam::Vec2;

use super::lambertian::Lambertian;
use super::state_grid::{MappedParameter, StateGrid};
use super::texture::ScalarTexture;
use super::tissue_nodes::{Probe, between, choose_nodes};
use super::{FluorophoreAmount, TissueEmission};
use crate::spectral::{Curve, Fluorophore, PhotonEem, WavelengthGrid};
use crate::tissue::{
    EffectiveTissue, LayeredTissue, Level, PHOTONS, RadialProfile, TissueError, TissueProfiles,
    radial_profiles,
};

/// Relative error of reflectance and fluorescence that a mean of states may have between its nodes.
pub const INTERPOLATION_ERROR: f64 = 0.01;
/// Most places between the nodes of several parameters at which the tissue is solved to see how far the means are off.
const MOST_CELLS: usize = 24;

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
    /// Largest relative error found between the states, of reflectance or of fluorescence; 0 where nothing was compared.
    pub error: f64,
}

/// The light of one fluorophore of a tissue, of all its layers.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceFluorescence {
    /// The fluorophore as the catalogue has it.
    pub fluorophore: Arc<Fluorophore>,
    /// Photon yield density of the tissue in each state, for light that passed the surface.
    pub states: Vec<Arc<PhotonEem>>,
    /// How far from where it enters light leaves in each state; none where it leaves where it enters.
    pub profiles: Vec<Arc<[RadialProfile; 3]>>,
}

impl TissueSurface {
    /// A tissue from its states, in the order of the grid.
    ///
    /// # Errors
    /// A fluorescence that can't be brought into a short form.
    pub fn new(grid: StateGrid, states: &[EffectiveTissue]) -> Result<Self, TissueError> {
        let mut emissions: Vec<SurfaceFluorescence> = Vec::new();
        for (number, state) in states.iter().enumerate() {
            let passed = 1.0 / (1.0 - state.specular_reflectance());
            for (fluorophore, eem) in by_fluorophore(state)? {
                let eem = Arc::new(eem.scaled(passed));
                let name = &fluorophore.name;
                let known = emissions.iter().position(|known| known.fluorophore.name == *name);
                let place = known.unwrap_or_else(|| {
                    emissions.push(SurfaceFluorescence {
                        fluorophore,
                        states: Vec::new(),
                        profiles: Vec::new(),
                    });
                    emissions.len() - 1
                });
                // States before that held none of it emit nothing
                let emitted = &mut emissions[place].states;
                emitted.resize(number, Arc::new(eem.as_ref().clone().scaled(0.0)));
                emitted.push(eem);
            }
        }
        for SurfaceFluorescence { states: emitted, .. } in &mut emissions {
            let dark = Arc::new(emitted[0].as_ref().clone().scaled(0.0));
            emitted.resize(states.len(), dark);
        }
        let reflectances = states
            .iter()
            .map(|state| {
                let passed = 1.0 / (1.0 - state.specular_reflectance());
                state.reflectance(Level::AboveSurface).scaled(passed)
            })
            .collect();
        Ok(Self { grid, reflectances, emissions, error: 0.0 })
    }

    /// A tissue of which some parameters vary over the surface. `tissue` makes it from their values, in their order. Where a
    /// parameter comes without nodes, they are added between the smallest and the largest value that its map has, with bent
    /// weights between them, until the means of the states are within [`INTERPOLATION_ERROR`] of the tissue, as far as 8
    /// nodes suffice; [`Self::error`] tells how far they are off.
    ///
    /// Where it is `translucent`, light leaves at some distance from where it enters ([`radial_profiles`]).
    ///
    /// # Errors
    /// Parameters that `tissue` or the solver refuses.
    pub fn varying(
        parameters: Vec<MappedParameter>,
        tissue: impl Fn(&[f64]) -> Result<LayeredTissue, TissueError>,
        bands: &WavelengthGrid,
        translucent: bool,
    ) -> Result<Self, TissueError> {
        // Choose the nodes of each parameter, the others in the middle of their ranges
        let range = |map: &ScalarTexture| [f64::from(map.min()), f64::from(map.max())];
        let middles: Vec<f64> =
            parameters.iter().map(|parameter| between(range(&parameter.map), 0.5)).collect();
        let mut grid = StateGrid { parameters, profiles: Vec::new() };
        let mut error = 0.0_f64;
        let mut chosen_axes = Vec::new();
        for (place, parameter) in grid.parameters.iter_mut().enumerate().filter(|(_, p)| p.nodes.is_empty()) {
            let probes = |values: &[f64]| {
                let with = |value: &f64| {
                    let mut values = middles.clone();
                    values[place] = *value;
                    tissue(&values)
                };
                Probe::of(&values.iter().map(with).collect::<Result<Vec<_>, _>>()?, bands)
            };
            let chosen = choose_nodes(range(&parameter.map), probes)?;
            error = error.max(chosen.error);
            parameter.nodes = chosen.nodes;
            parameter.bends = chosen.bends;
            chosen_axes.push(place);
        }

        // Solve all states
        let tissues = (0..grid.len())
            .map(|state| {
                let values: Vec<f64> = grid.parameters_of(state).into_iter().map(f64::from).collect();
                tissue(&values)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let states = EffectiveTissue::several_for_grid(&tissues, bands)?;
        if chosen_axes.len() > 1 {
            error = error.max(error_in_cells(&grid, &chosen_axes, &states, &tissue, bands)?);
        }
        let surface = Self { error, ..Self::new(grid, &states)? };
        if !translucent {
            return Ok(surface);
        }
        Ok(surface.with_profiles(radial_profiles(&tissues, PHOTONS)))
    }

    /// The same with profiles of all states.
    fn with_profiles(mut self, profiles: Vec<TissueProfiles>) -> Self {
        for emission in &mut self.emissions {
            let name = &emission.fluorophore.name;
            let of_state = |state: &TissueProfiles| {
                state
                    .fluorescence
                    .iter()
                    .find(|(held, _)| held == name)
                    .map(|(_, found)| Arc::new(found.clone()))
            };
            // A state without it has any profile: nothing leaves by it
            let known: Vec<_> = profiles.iter().map(of_state).collect();
            let Some(any) = known.iter().flatten().next().cloned() else { continue };
            emission.profiles = known.into_iter().map(|found| found.unwrap_or_else(|| any.clone())).collect();
        }
        self.grid.profiles = profiles.into_iter().map(|state| state.reflected).collect();
        self
    }

    /// The same tissue over a surface with other maps of its parameters, in their order.
    #[must_use]
    pub fn with_maps(mut self, maps: impl IntoIterator<Item = ScalarTexture>) -> Self {
        self.grid.parameters.iter_mut().zip(maps).for_each(|(parameter, map)| parameter.map = map);
        self
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
            in_tissue: Some(TissueEmission {
                eem: eem.clone(),
                term,
                profiles: self.emissions[emission].profiles.get(term).cloned(),
            }),
        };
        states.iter().enumerate().map(amount).collect()
    }
}

/// Largest relative error of the means of the states in the middles of the cells between them: of those axes whose nodes were
/// chosen, the others at their first node.
fn error_in_cells(
    grid: &StateGrid,
    axes: &[usize],
    states: &[EffectiveTissue],
    tissue: &impl Fn(&[f64]) -> Result<LayeredTissue, TissueError>,
    bands: &WavelengthGrid,
) -> Result<f64, TissueError> {
    let intervals = |axis: &usize| grid.parameters[*axis].nodes.len() - 1;
    let cells: usize = axes.iter().map(intervals).product();
    let probes: Vec<Probe> = states.iter().map(|state| Probe::of_solution(state, bands)).collect();
    let checked = cells.min(MOST_CELLS);
    // Spread what is checked evenly over all cells
    let middles: Vec<Vec<f64>> =
        (0..checked).map(|number| middle_of_cell(grid, axes, number * cells / checked)).collect();
    let tissues = middles.iter().map(|values| tissue(values)).collect::<Result<Vec<_>, _>>()?;
    let error = |(values, exact): (&Vec<f64>, &Probe)| {
        let mut values = values.iter();
        let here =
            grid.with_maps(|_| ScalarTexture::Constant(values.next().map_or(0.0, |value| *value as f32)));
        let weights = here.weights_at(Vec2::ZERO);
        exact.error_of_mean(weights.into_iter().map(f64::from).zip(&probes))
    };
    Ok(middles.iter().zip(&Probe::of(&tissues, bands)?).map(error).fold(0.0, f64::max))
}

/// Values of the parameters in the middle of a cell; those beside the axes are at their first nodes.
fn middle_of_cell(grid: &StateGrid, axes: &[usize], cell: usize) -> Vec<f64> {
    let mut rest = cell;
    let mut values: Vec<f64> = grid.parameters.iter().map(|p| f64::from(p.nodes[0])).collect();
    for axis in axes {
        let nodes = &grid.parameters[*axis].nodes;
        let interval = rest % (nodes.len() - 1);
        rest /= nodes.len() - 1;
        values[*axis] = between([interval, interval + 1].map(|node| f64::from(nodes[node])), 0.5);
    }
    values
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
