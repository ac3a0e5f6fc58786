//! Signals of regions under every light behind every filter in every sensor, prepared once.

use rayon::prelude::*;

use super::design_camera::{FilteredCamera, FineBands};
use super::problem::{DesignProblem, FilterChoice, LightChoice};
use super::region_model::{LibraryError, RegionModel, SignalRates};

/// Signals of one region.
#[derive(Clone, Debug)]
pub(super) struct RegionSignals {
    /// `[light][filter][camera]`.
    lit: Vec<Vec<Vec<SignalRates>>>,
    /// Under the white frame, `[camera]`; empty without one.
    white: Vec<SignalRates>,
}

impl RegionSignals {
    pub(super) fn lit(&self, light: usize, filter: usize, camera: usize) -> &SignalRates {
        &self.lit[light][filter][camera]
    }

    pub(super) fn white(&self, camera: usize) -> Option<&SignalRates> {
        self.white.get(camera)
    }
}

/// Cameras behind filters.
pub(super) struct FilteredCameras<'a> {
    problem: &'a DesignProblem,
    bands: &'a FineBands,
    /// `[light][filter][camera]`.
    lit: Vec<Vec<Vec<FilteredCamera>>>,
    /// Those of the white frame, `[camera]`.
    white: Vec<FilteredCamera>,
}

impl<'a> FilteredCameras<'a> {
    pub(super) fn new(problem: &'a DesignProblem, bands: &'a FineBands) -> Self {
        let behind = |light: &LightChoice| {
            let through = |filter: &FilterChoice| {
                let transmittance = filter.transmittance(light.peak_nm);
                problem.cameras.iter().map(|camera| camera.behind(&transmittance, bands)).collect()
            };
            problem.filters.iter().map(through).collect()
        };
        let lit = problem.lights.par_iter().map(behind).collect();
        let white = problem
            .white
            .iter()
            .flat_map(|white| problem.cameras.iter().map(move |camera| camera.behind(&white.filter, bands)));
        Self { problem, bands, lit, white: white.collect() }
    }

    /// Signals of some regions, seen with a library that may be wrong.
    pub(super) fn signals_of(&self, regions: &[RegionModel], library: &LibraryError) -> Vec<RegionSignals> {
        regions.par_iter().map(|region| self.signals(region, library)).collect()
    }

    fn signals(&self, region: &RegionModel, library: &LibraryError) -> RegionSignals {
        let under = |(light, filters): (&LightChoice, &Vec<Vec<FilteredCamera>>)| {
            let lit = region.under(light, self.bands, library);
            let row = |cameras: &Vec<FilteredCamera>| cameras.iter().map(|c| lit.through(c)).collect();
            filters.iter().map(row).collect()
        };
        let white = self.problem.white.iter().flat_map(|white| {
            let lit = region.under(&white.light, self.bands, library);
            self.white.iter().map(move |camera| lit.through(camera))
        });
        RegionSignals {
            lit: self.problem.lights.par_iter().zip(&self.lit).map(under).collect(),
            white: white.collect(),
        }
    }
}
