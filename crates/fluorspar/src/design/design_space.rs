//! All designs of a problem, each evaluated from signals that were prepared once.

use std::cmp::Ordering;

use rayon::prelude::*;
use serde::Serialize;

use crate::sampling::random::Key;
use crate::spectral::WavelengthGrid;

use super::criterion::{Contrast, Criterion};
use super::design_camera::{FilteredCamera, FineBands};
use super::evaluation::{
    DesignExposure, RegionMerits, chromaticity_separability, detectability, evaluate_region, sample_pixels,
};
use super::problem::{Budget, DesignProblem, LightChoice, Split, tissue_margin};
use super::region_model::{RegionModel, SignalRates};

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
    /// How the exposures share the budget.
    pub split: usize,
}

/// Figures of merit of a design.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Merits {
    /// By the criterion of the problem, of the worst region: less is better; null where the design can't do it at all.
    pub loss: f64,
    /// Limits that the design does not keep to.
    pub broken: Vec<&'static str>,
    /// By region.
    pub regions: Vec<RegionMerits>,
    /// Smallest distance of the colors of two regions, in standard deviations of the noise; null for one region.
    pub color_separability: Option<f64>,
    /// `d'` of the cohort; null without one.
    pub detectability: Option<f64>,
    /// Exposure times, s; that of the white frame comes last.
    pub times_s: Vec<f64>,
    /// All of them together, s.
    pub time_s: f64,
    /// Electrons of all channels of the first region, one pixel each, the white frame left out.
    pub electrons: f64,
    /// Price.
    pub cost: f64,
    /// Largest ratio of reflected to fluorescent electrons.
    pub leak: f64,
    /// Electrons of the brightest pixel over what it holds.
    pub saturation: f64,
    /// Photobiological margin of all exposures together; null where it was not wanted, or nothing counts.
    pub safety_margin: Option<f64>,
}

/// What a search needs of a design.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Loss; infinite where a limit is broken.
    pub loss: f64,
    /// Time of all exposures, s.
    pub time_s: f64,
    /// Price.
    pub cost: f64,
    /// Number of exposures.
    pub exposures: usize,
}

impl Score {
    /// Whether this design is at least as good as another in all that counts, and better in something.
    pub fn dominates(&self, other: &Self) -> bool {
        let (a, b) = (self.objectives(), other.objectives());
        a.iter().zip(&b).all(|(a, b)| a <= b) && a != b
    }

    fn objectives(&self) -> [f64; 4] {
        [self.loss, self.time_s, self.cost, self.exposures as f64]
    }
}

/// Numbers of the scores that no other dominates, the best loss first. Of equals the first counts.
pub fn pareto_front(scores: &[Score]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..scores.len()).filter(|&k| scores[k].loss.is_finite()).collect();
    let compare = |a: &f64, b: &f64| a.total_cmp(b);
    order.sort_by(|&a, &b| {
        let (x, y) = (scores[a].objectives(), scores[b].objectives());
        let by = x.iter().zip(&y).map(|(x, y)| compare(x, y)).find(|order| *order != Ordering::Equal);
        by.unwrap_or(a.cmp(&b))
    });
    let mut front: Vec<usize> = Vec::new();
    for candidate in order {
        let beaten = |&kept: &usize| {
            scores[kept].dominates(&scores[candidate])
                || scores[kept].objectives() == scores[candidate].objectives()
        };
        if !front.iter().any(beaten) {
            front.push(candidate);
        }
    }
    front
}

/// Signals by `[light][filter][camera]` of one region.
type Signals = Vec<Vec<Vec<SignalRates>>>;

/// All designs of a problem. Designs are numbered from 0 in a fixed order, without gaps and without doubles.
#[derive(Clone, Debug)]
pub struct DesignSpace {
    problem: DesignProblem,
    /// Sets of lights, of one exposure first.
    light_sets: Vec<Vec<usize>>,
    regions: Vec<Signals>,
    cohort: Option<[Vec<Signals>; 2]>,
    /// Signals of the white frame, by camera, of regions and of both groups.
    white: Vec<Vec<SignalRates>>,
    white_cohort: Option<[Vec<Vec<SignalRates>>; 2]>,
    contrasts: Vec<Vec<Contrast>>,
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
        let prepared = Prepared::new(&problem, &bands);
        let library = |region: &RegionModel| region.clone().with_library_error(&problem.library);
        let regions: Vec<RegionModel> = problem.regions.iter().map(library).collect();
        let contrasts = problem.regions.iter().map(|region| contrasts_of(&problem, region)).collect();
        let white_of = |regions: &[RegionModel]| prepared.white(&problem, regions, &bands);
        let all = |regions: &[RegionModel]| -> Vec<Signals> {
            regions.par_iter().map(|region| prepared.signals(&problem, region, &bands)).collect()
        };
        Ok(Self {
            light_sets,
            regions: all(&regions),
            white: white_of(&regions),
            cohort: problem.cohort.as_ref().map(|cohort| [all(&cohort.healthy), all(&cohort.altered)]),
            white_cohort: problem
                .cohort
                .as_ref()
                .map(|cohort| [white_of(&cohort.healthy), white_of(&cohort.altered)]),
            contrasts,
            problem,
        })
    }

    /// The problem.
    pub fn problem(&self) -> &DesignProblem {
        &self.problem
    }

    /// How many choices each variable has: sets of lights, filters, sensors, apertures, drives, splits.
    fn sizes(&self) -> [usize; 6] {
        let p = &self.problem;
        [
            self.light_sets.len(),
            p.filters.len(),
            p.cameras.len(),
            p.lenses.len(),
            p.drives.len(),
            p.splits.len(),
        ]
    }

    /// Number of designs.
    pub fn len(&self) -> u64 {
        self.sizes().iter().map(|&size| size as u64).product()
    }

    /// Never true: a space has a design.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The design of a number; the last ones repeat for numbers beyond [`DesignSpace::len`].
    pub fn design(&self, number: u64) -> Design {
        let sizes = self.sizes();
        let mut rest = number % self.len();
        let mut digits = [0; 6];
        for (digit, size) in digits.iter_mut().zip(sizes).rev() {
            *digit = (rest % size as u64) as usize;
            rest /= size as u64;
        }
        let [set, filter, camera, lens, drive, split] = digits;
        Design { lights: self.light_sets[set].clone(), filter, camera, lens, drive, split }
    }

    /// The number of a design; `None` where its lights are not rising or something does not exist.
    pub fn number(&self, design: &Design) -> Option<u64> {
        let set = self.light_sets.binary_search_by(|set| {
            set.len().cmp(&design.lights.len()).then_with(|| set.cmp(&design.lights))
        });
        let digits = [set.ok()?, design.filter, design.camera, design.lens, design.drive, design.split];
        let sizes = self.sizes();
        digits
            .iter()
            .zip(sizes)
            .try_fold(0, |number, (&digit, size)| (digit < size).then(|| number * size as u64 + digit as u64))
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

    /// Exposure times, s, of the fluorescence under the lights of a design.
    fn times(&self, design: &Design) -> Vec<f64> {
        let p = &self.problem;
        let count = design.lights.len() as f64;
        let share = |k: usize| match p.splits[design.split] {
            Split::First(first) if design.lights.len() > 1 => {
                if k == 0 {
                    first
                } else {
                    (1.0 - first) / (count - 1.0)
                }
            }
            _ => 1.0 / count,
        };
        // Electrons per second of each exposure in the first region
        let per_second: Vec<f64> = (0..design.lights.len())
            .map(|k| self.exposure(design, k, 1.0).electrons(self.rates(0, design, k)))
            .collect();
        let equal_electrons = p.splits[design.split] == Split::EqualElectrons;
        let weight = |k: usize| if equal_electrons { 1.0 / per_second[k].max(1e-300) } else { share(k) };
        let sum: f64 = (0..design.lights.len()).map(weight).sum();
        let scale = match p.budget {
            Budget::Time(seconds) => seconds / sum,
            Budget::Electrons(electrons) => {
                let collected: f64 = (0..design.lights.len()).map(|k| weight(k) * per_second[k]).sum();
                electrons / collected.max(1e-300)
            }
        };
        (0..design.lights.len()).map(|k| scale * weight(k)).collect()
    }

    fn rates(&self, region: usize, design: &Design, exposure: usize) -> &SignalRates {
        &self.regions[region][design.lights[exposure]][design.filter][design.camera]
    }

    fn exposure(&self, design: &Design, exposure: usize, time_s: f64) -> DesignExposure<'_> {
        let p = &self.problem;
        DesignExposure {
            camera: &p.cameras[design.camera],
            light: p.lights[design.lights[exposure]].light * p.drives[design.drive],
            lens_sr: p.lenses[design.lens].solid_angle_sr,
            time_s,
        }
    }

    /// The white frame, exposed to its level in the first region.
    fn white_exposure(&self, design: &Design) -> Option<DesignExposure<'_>> {
        let p = &self.problem;
        let white = p.white.as_ref()?;
        let camera = &p.cameras[design.camera];
        let lens_sr = p.lenses[design.lens].solid_angle_sr;
        let mut exposure = DesignExposure { camera, light: white.light.light, lens_sr, time_s: 1.0 };
        let rates = &self.white[0][design.camera];
        let brightest = (0..rates.leak.len())
            .map(|c| rates.leak[c] + rates.fluorescence[c].iter().sum::<f64>())
            .fold(0.0, f64::max);
        exposure.time_s = white.level * camera.full_e / (brightest * exposure.light * lens_sr).max(1e-300);
        Some(exposure)
    }

    /// Exposures of a design, the white frame last.
    fn exposures(&self, design: &Design) -> Vec<DesignExposure<'_>> {
        let times = self.times(design);
        let lit = times.iter().enumerate().map(|(k, &time_s)| self.exposure(design, k, time_s));
        lit.chain(self.white_exposure(design)).collect()
    }

    fn region_signals(&self, region: usize, design: &Design) -> Vec<&SignalRates> {
        let lit = (0..design.lights.len()).map(|k| self.rates(region, design, k));
        lit.chain(self.white.get(region).map(|by_camera| &by_camera[design.camera])).collect()
    }

    fn group_signals(&self, group: usize, design: &Design) -> Option<Vec<Vec<&SignalRates>>> {
        let people = &self.cohort.as_ref()?[group];
        let white = self.white_cohort.as_ref().map(|groups| &groups[group]);
        let people = people.iter().enumerate().map(|(person, signals)| {
            let lit = design.lights.iter().map(|&light| &signals[light][design.filter][design.camera]);
            let white =
                white.and_then(|people| people.get(person)).map(|by_camera| &by_camera[design.camera]);
            lit.chain(white).collect::<Vec<&SignalRates>>()
        });
        Some(people.collect())
    }

    fn cohort_detectability(&self, design: &Design, exposures: &[DesignExposure<'_>]) -> Option<f64> {
        let (healthy, altered) = (self.group_signals(0, design)?, self.group_signals(1, design)?);
        detectability(&healthy, &altered, exposures, &self.problem.assumptions)
    }

    fn cost(&self, design: &Design) -> f64 {
        let p = &self.problem;
        let lights: f64 = design.lights.iter().map(|&k| p.lights[k].cost).sum();
        let white = p.white.as_ref().map_or(0.0, |white| white.light.cost);
        lights
            + white
            + p.cameras[design.camera].cost
            + p.filters[design.filter].cost_for(design.lights.len())
    }

    /// Photobiological margin of the tissue under all exposures together: doses add, so their inverse margins do.
    fn safety_margin(&self, design: &Design, exposures: &[DesignExposure<'_>]) -> Option<f64> {
        let p = &self.problem;
        let lights = design.lights.iter().map(|&k| (&p.lights[k], p.drives[design.drive]));
        let white = p.white.as_ref().map(|white| (&white.light, 1.0));
        let margin = |((light, drive), exposure): ((&LightChoice, f64), &DesignExposure<'_>)| {
            tissue_margin(light, drive, exposure.time_s, p.tissue_safety_factor)
        };
        let inverse: f64 =
            lights.chain(white).zip(exposures).filter_map(margin).map(|margin| 1.0 / margin).sum();
        (inverse > 0.0).then(|| 1.0 / inverse)
    }

    /// Pixels of a region in every exposure of a design, `[exposure][channel][pixel]`, e-, with the sensor's noise. Functions of the
    /// seed alone.
    pub fn sample_electrons(
        &self,
        design: &Design,
        region: usize,
        pixels: usize,
        seed: u64,
    ) -> Vec<Vec<Vec<f64>>> {
        let key = Key::new(seed).with_text("pixels of a design").with(region as u64);
        let exposures = self.exposures(design);
        let signals = self.region_signals(region, design);
        let of = |(number, (exposure, rates)): (usize, (&DesignExposure<'_>, &&SignalRates))| {
            let channels = 0..rates.leak.len();
            channels.map(|c| sample_pixels(exposure, rates, c, pixels, key.with(number as u64))).collect()
        };
        exposures.iter().zip(&signals).enumerate().map(of).collect()
    }

    /// All figures of merit of a design.
    pub fn evaluate(&self, design: &Design) -> Merits {
        self.merits(design, true)
    }

    /// What a search needs; the safety of the light is assessed where it is limited.
    pub fn score(&self, design: &Design) -> Score {
        let merits = self.merits(design, false);
        Score {
            loss: if merits.broken.is_empty() { merits.loss } else { f64::INFINITY },
            time_s: merits.time_s,
            cost: merits.cost,
            exposures: design.lights.len(),
        }
    }

    fn merits(&self, design: &Design, full: bool) -> Merits {
        let p = &self.problem;
        let exposures = self.exposures(design);
        let is_white: Vec<bool> = (0..exposures.len()).map(|k| k >= design.lights.len()).collect();
        let by_region: Vec<Vec<&SignalRates>> =
            (0..self.regions.len()).map(|region| self.region_signals(region, design)).collect();
        let of_region = |(signals, contrasts): (&Vec<&SignalRates>, &Vec<Contrast>)| {
            evaluate_region(signals, &exposures, &is_white, &p.assumptions, contrasts)
        };
        let regions: Vec<RegionMerits> = by_region.iter().zip(&self.contrasts).map(of_region).collect();
        let wants_detection = full || p.criterion == Criterion::Detection;
        let detectability =
            if wants_detection { self.cohort_detectability(design, &exposures) } else { None };
        let loss = match p.criterion {
            Criterion::Detection => detectability.map_or(f64::INFINITY, |d| 1.0 / d),
            _ => regions
                .iter()
                .zip(&self.contrasts)
                .map(|(region, contrasts)| region.loss(p.criterion, contrasts))
                .fold(0.0, f64::max),
        };
        let wants_safety = full || p.limits.safety_margin.is_some();
        let times_s: Vec<f64> = exposures.iter().map(|exposure| exposure.time_s).collect();
        let largest = |pick: fn(&RegionMerits) -> f64| regions.iter().map(pick).fold(0.0, f64::max);
        let mut merits = Merits {
            loss,
            broken: Vec::new(),
            color_separability: if full { self.color_separability(&by_region, &exposures) } else { None },
            detectability,
            time_s: times_s.iter().sum(),
            times_s,
            electrons: exposures
                .iter()
                .zip(&by_region[0])
                .take(design.lights.len())
                .map(|(exposure, rates)| exposure.electrons(rates))
                .sum(),
            cost: self.cost(design),
            leak: largest(|region| region.leak),
            saturation: largest(|region| region.saturation),
            safety_margin: if wants_safety { self.safety_margin(design, &exposures) } else { None },
            regions,
        };
        merits.broken = self.broken_limits(&merits);
        merits
    }

    fn color_separability(
        &self,
        by_region: &[Vec<&SignalRates>],
        exposures: &[DesignExposure<'_>],
    ) -> Option<f64> {
        let pixels = self.problem.assumptions.pixels;
        let pairs = (0..by_region.len()).flat_map(|a| (a + 1..by_region.len()).map(move |b| (a, b)));
        pairs
            .map(|(a, b)| chromaticity_separability(&by_region[a], &by_region[b], exposures, pixels))
            .reduce(f64::min)
    }

    fn broken_limits(&self, merits: &Merits) -> Vec<&'static str> {
        let limits = &self.problem.limits;
        let above = |value: f64, limit: Option<f64>| limit.is_some_and(|limit| value > limit);
        let below = |value: Option<f64>, limit: Option<f64>| matches!((value, limit), (Some(value), Some(limit)) if value < limit);
        let mut broken = Vec::new();
        for (name, is_broken) in [
            ("safety_margin", below(merits.safety_margin, limits.safety_margin)),
            ("leak", above(merits.leak, limits.leak)),
            ("saturation", above(merits.saturation, limits.saturation)),
            ("time", above(merits.time_s, limits.time_s)),
            ("cost", above(merits.cost, limits.cost)),
        ] {
            if is_broken {
                broken.push(name);
            }
        }
        broken
    }
}

/// Checks that there is something to choose, and gives the bands of the regions.
fn check(problem: &DesignProblem) -> Result<WavelengthGrid, DesignError> {
    let lists = [
        ("region", problem.regions.is_empty()),
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
    let grid = &problem.regions[0].response.grid;
    let cohort = problem.cohort.iter().flat_map(|cohort| cohort.healthy.iter().chain(&cohort.altered));
    if problem.regions.iter().chain(cohort).any(|region| region.response.grid != *grid) {
        return Err(DesignError::Bands);
    }
    Ok(grid.clone())
}

fn contrasts_of(problem: &DesignProblem, region: &RegionModel) -> Vec<Contrast> {
    let amounts = |names: &[String]| -> Vec<f64> {
        let amount = |name: &str| if names.iter().any(|other| other == name) { 1.0 } else { 0.0 };
        region.response.fluorescence.iter().map(|f| f.amount * amount(&f.name)).collect()
    };
    let contrast = |definition: &super::problem::ContrastDefinition| Contrast {
        name: definition.name.clone(),
        part: amounts(&definition.part),
        whole: amounts(&definition.whole),
    };
    problem.contrasts.iter().map(contrast).collect()
}

/// Cameras behind filters, `[light][filter][camera]`.
struct Prepared {
    cameras: Vec<Vec<Vec<FilteredCamera>>>,
}

impl Prepared {
    fn new(problem: &DesignProblem, bands: &FineBands) -> Self {
        let behind = |light: &LightChoice| {
            let through = |filter: &super::problem::FilterChoice| {
                let transmittance = filter.transmittance(light.peak_nm);
                problem.cameras.iter().map(|camera| camera.behind(&transmittance, bands)).collect()
            };
            problem.filters.iter().map(through).collect()
        };
        Self { cameras: problem.lights.par_iter().map(behind).collect() }
    }

    fn signals(&self, problem: &DesignProblem, region: &RegionModel, bands: &FineBands) -> Signals {
        let under = |(light, filters): (&LightChoice, &Vec<Vec<FilteredCamera>>)| {
            let lit = region.under(&light.spectrum, bands);
            let row = |cameras: &Vec<FilteredCamera>| cameras.iter().map(|c| lit.through(c)).collect();
            filters.iter().map(row).collect()
        };
        problem.lights.par_iter().zip(&self.cameras).map(under).collect()
    }

    /// Signals of the white frame, `[region][camera]`; nothing without one.
    fn white(
        &self,
        problem: &DesignProblem,
        regions: &[RegionModel],
        bands: &FineBands,
    ) -> Vec<Vec<SignalRates>> {
        let Some(white) = &problem.white else { return Vec::new() };
        let cameras: Vec<FilteredCamera> =
            problem.cameras.iter().map(|camera| camera.behind(&white.filter, bands)).collect();
        let of = |region: &RegionModel| {
            let lit = region.under(&white.light.spectrum, bands);
            cameras.iter().map(|camera| lit.through(camera)).collect()
        };
        regions.par_iter().map(of).collect()
    }
}
