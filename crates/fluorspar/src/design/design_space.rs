//! All designs of a problem, each evaluated from signals that were prepared once.

use std::sync::Arc;

use serde::Serialize;

use crate::spectral::WavelengthGrid;

use super::criterion::Contrast;
use super::design_camera::FineBands;
use super::prepared_signals::{FilteredCameras, RegionSignals};
use super::problem::{ContrastDefinition, DesignProblem, Split};
use super::region_model::{LibraryError, RegionModel};

/// One design: numbers of what is chosen.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize)]
pub struct Design {
    /// Lights of the exposures, rising.
    pub lights: Vec<usize>,
    /// Viewing filter.
    pub filter: usize,
    /// Sensor.
    pub camera: usize,
    /// Aperture.
    pub lens: usize,
    /// Factor on the lights.
    pub drive: usize,
    /// How the exposures share the budget; 0 of one exposure, which has all of it.
    pub split: usize,
    /// Geometry; 0 where there is none to choose.
    pub geometry: usize,
}

/// All designs of a problem. Designs are numbered from 0 in a fixed order, without gaps and without doubles.
#[derive(Clone, Debug)]
pub struct DesignSpace {
    pub(super) problem: DesignProblem,
    /// Sets of lights, of one exposure first.
    light_sets: Vec<Vec<usize>>,
    /// Signals and contrasts of all regions, by geometry.
    pub(super) geometries: Vec<PreparedGeometry>,
    /// Signals of the people of both groups.
    pub(super) cohort: Option<[Vec<RegionSignals>; 2]>,
}

/// What one geometry shows: of each region its signals and its contrasts.
#[derive(Clone, Debug)]
pub(super) struct PreparedGeometry {
    pub(super) regions: Vec<Arc<RegionSignals>>,
    pub(super) contrasts: Vec<Vec<Contrast>>,
    /// Of each region the standard deviations of the priors of its weights.
    pub(super) priors: Vec<Vec<f64>>,
    /// Of each region the pixels that it covers, over those in the first geometry.
    pub(super) pixel_shares: Vec<f64>,
    /// Irradiance of the most exposed region, W/m², by light; that of the white frame comes last.
    pub(super) irradiances: Vec<f64>,
}

/// Why a problem has no designs.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum DesignError {
    /// A list of choices is empty.
    #[error("there is no {0} to choose from; give at least one")]
    NothingToChoose(&'static str),
    /// Regions differ in bands.
    #[error("the regions have different wavelength bands; give them one grid")]
    Bands,
    /// Geometries show different regions.
    #[error("the geometries show different regions; give each the same ones in the same order")]
    Regions,
    /// More exposures than lights.
    #[error("no number of exposures is between 1 and the {0} lights; give fewer exposures or more lights")]
    Exposures(usize),
}

/// All subsets of `size` out of `count`, in the order of the alphabet.
fn subsets(count: usize, size: usize) -> Vec<Vec<usize>> {
    let mut found = Vec::new();
    let mut current: Vec<usize> = (0..size).collect();
    if size == 0 || size > count {
        return found;
    }
    loop {
        found.push(current.clone());
        let Some(at) = (0..size).rev().find(|&k| current[k] < count - size + k) else { return found };
        current[at] += 1;
        for k in at + 1..size {
            current[k] = current[k - 1] + 1;
        }
    }
}

impl DesignSpace {
    /// Prepares the signals of every light behind every filter in every sensor.
    ///
    /// # Errors
    /// A list without choices, regions of different bands.
    pub fn new(problem: DesignProblem) -> Result<Self, DesignError> {
        let grid = check(&problem)?;
        let lights = problem.lights.len();
        let mut counts = problem.exposures.clone();
        counts.sort_unstable();
        counts.dedup();
        let light_sets: Vec<Vec<usize>> = counts.iter().flat_map(|&size| subsets(lights, size)).collect();
        if light_sets.is_empty() {
            return Err(DesignError::Exposures(lights));
        }
        let bands = FineBands::of(&grid);
        let cameras = FilteredCameras::new(&problem, &bands);
        let with_library = |regions: &[RegionModel]| -> Vec<Arc<RegionSignals>> {
            cameras.signals_of(regions, &problem.library).into_iter().map(Arc::new).collect()
        };
        // Flat regions are the same in every geometry
        let flat = with_library(&problem.regions);
        let of_geometry = |geometry: usize| {
            let rendered = problem.geometries.get(geometry).map(|choice| with_library(&choice.regions));
            let regions = || problem.regions_of(geometry);
            let white = problem.white.as_ref().map(|white| &white.light);
            let irradiance = |light| regions().map(|region| region.irradiance(light)).fold(0.0, f64::max);
            PreparedGeometry {
                regions: flat.iter().cloned().chain(rendered.into_iter().flatten()).collect(),
                contrasts: regions().map(|region| contrasts_of(&problem, region)).collect(),
                priors: regions().map(|region| problem.priors_of(region)).collect(),
                pixel_shares: regions().map(|region| region.pixel_share).collect(),
                irradiances: problem.lights.iter().chain(white).map(irradiance).collect(),
            }
        };
        let geometries = (0..problem.geometry_count()).map(of_geometry).collect();
        // A person's own spectra are no error of the library
        let known = LibraryError::default();
        let cohort = problem.cohort.as_ref().map(|cohort| {
            [&cohort.healthy, &cohort.altered].map(|people| cameras.signals_of(people, &known))
        });
        Ok(Self { light_sets, geometries, cohort, problem })
    }

    /// The problem.
    pub fn problem(&self) -> &DesignProblem {
        &self.problem
    }

    /// Sets of one light, which come first.
    fn single_lights(&self) -> usize {
        self.light_sets.partition_point(|set| set.len() == 1)
    }

    /// How many choices a set of lights leaves: filters, sensors, apertures, drives, splits. One exposure has nothing to split.
    fn sizes(&self, set: usize) -> [usize; 5] {
        let p = &self.problem;
        let splits = if set < self.single_lights() { 1 } else { p.splits.len() };
        [p.filters.len(), p.cameras.len(), p.lenses.len(), p.drives.len(), splits]
    }

    /// Designs with a set of lights in one geometry.
    fn designs_with(&self, set: usize) -> u64 {
        self.sizes(set).iter().map(|&size| size as u64).product()
    }

    /// Designs in one geometry whose set of lights comes before this one.
    fn designs_before(&self, set: usize) -> u64 {
        let single = self.single_lights();
        // Sets of one light have as many designs each, and so have all others
        let of_single = set.min(single) as u64 * self.designs_with(0);
        let others = set.saturating_sub(single) as u64;
        of_single + if others > 0 { others * self.designs_with(single) } else { 0 }
    }

    /// Number of designs.
    pub fn len(&self) -> u64 {
        self.problem.geometry_count() as u64 * self.designs_before(self.light_sets.len())
    }

    /// Never true: a space has a design.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The design of a number; the first ones repeat for numbers beyond [`DesignSpace::len`].
    pub fn design(&self, number: u64) -> Design {
        let in_geometry = self.designs_before(self.light_sets.len());
        let (geometry, within) = ((number % self.len() / in_geometry) as usize, number % in_geometry);
        let single = self.single_lights();
        let set = match within.checked_sub(self.designs_before(single)) {
            None => within / self.designs_with(0),
            Some(beyond) => single as u64 + beyond / self.designs_with(single),
        } as usize;
        let mut rest = within - self.designs_before(set);
        let mut digits = [0; 5];
        for (digit, size) in digits.iter_mut().zip(self.sizes(set)).rev() {
            *digit = (rest % size as u64) as usize;
            rest /= size as u64;
        }
        let [filter, camera, lens, drive, split] = digits;
        Design { lights: self.light_sets[set].clone(), filter, camera, lens, drive, split, geometry }
    }

    /// The number of a design; `None` where its lights are not rising or something does not exist. Designs of one exposure that differ in
    /// their split are the same.
    pub fn number(&self, design: &Design) -> Option<u64> {
        let by_lights =
            |set: &Vec<usize>| set.len().cmp(&design.lights.len()).then_with(|| set.cmp(&design.lights));
        let set = self.light_sets.binary_search_by(by_lights).ok()?;
        let &Design { filter, camera, lens, drive, split, geometry, .. } = design;
        let p = &self.problem;
        let split = match split < p.splits.len() {
            true if set < self.single_lights() => 0,
            _ => split,
        };
        let digits = [filter, camera, lens, drive, split];
        let within = digits.iter().zip(self.sizes(set)).try_fold(0, |number, (&digit, size)| {
            (digit < size).then(|| number * size as u64 + digit as u64)
        })?;
        let before = geometry as u64 * self.designs_before(self.light_sets.len()) + self.designs_before(set);
        (geometry < p.geometry_count()).then_some(before + within)
    }

    /// A design in words.
    pub fn describe(&self, design: &Design) -> String {
        let p = &self.problem;
        let lights: Vec<&str> = design.lights.iter().map(|&k| p.lights[k].name.as_str()).collect();
        let mut text = lights.join(" + ");
        let mut add = |many: bool, what: String| {
            if many {
                text += &format!(", {what}");
            }
        };
        let geometry = p.geometries.get(design.geometry).map(|geometry| geometry.name.clone());
        add(p.geometries.len() > 1, geometry.unwrap_or_default());
        add(p.cameras.len() > 1, p.cameras[design.camera].name.clone());
        add(p.filters.len() > 1, p.filters[design.filter].name.clone());
        add(p.lenses.len() > 1, format!("f/{}", p.lenses[design.lens].f_number));
        add(p.drives.len() > 1, format!("drive {}", p.drives[design.drive]));
        let split = match p.splits[design.split] {
            Split::EqualTime => "equal times".into(),
            Split::EqualElectrons => "equal electrons".into(),
            Split::First(share) => format!("{:.0} % for the first", 100.0 * share),
        };
        add(p.splits.len() > 1 && design.lights.len() > 1, split);
        text
    }
}

/// Checks that there is something to choose, and gives the bands of the regions.
fn check(problem: &DesignProblem) -> Result<WavelengthGrid, DesignError> {
    let lists = [
        ("region", problem.regions_of(0).next().is_none()),
        ("light", problem.lights.is_empty()),
        ("viewing filter", problem.filters.is_empty()),
        ("sensor", problem.cameras.is_empty()),
        ("aperture", problem.lenses.is_empty()),
        ("drive", problem.drives.is_empty()),
        ("split", problem.splits.is_empty()),
    ];
    if let Some((what, _)) = lists.iter().find(|(_, empty)| *empty) {
        return Err(DesignError::NothingToChoose(what));
    }
    let names = |geometry| problem.regions_of(geometry).map(|region| &region.response.name);
    if (1..problem.geometry_count()).any(|geometry| !names(geometry).eq(names(0))) {
        return Err(DesignError::Regions);
    }
    let rendered = problem.geometries.iter().flat_map(|geometry| &geometry.regions);
    let cohort = problem.cohort.iter().flat_map(|cohort| cohort.healthy.iter().chain(&cohort.altered));
    let mut grids = problem.regions.iter().chain(rendered).chain(cohort).map(|region| &region.response.grid);
    let Some(grid) = grids.next() else { return Err(DesignError::NothingToChoose("region")) };
    if grids.any(|other| other != grid) {
        return Err(DesignError::Bands);
    }
    Ok(grid.clone())
}

fn contrasts_of(problem: &DesignProblem, region: &RegionModel) -> Vec<Contrast> {
    let amounts = |names: &[String]| -> Vec<f64> {
        let amount = |name: &str| if names.iter().any(|other| other == name) { 1.0 } else { 0.0 };
        region.response.fluorescence.iter().map(|f| f.amount * amount(&f.name)).collect()
    };
    let contrast = |definition: &ContrastDefinition| Contrast {
        name: definition.name.clone(),
        part: amounts(&definition.part),
        whole: amounts(&definition.whole),
    };
    problem.contrasts.iter().map(contrast).collect()
}
