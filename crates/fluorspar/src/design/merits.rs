//! One design of a space in numbers: exposure times, bounds, limits.

use serde::Serialize;

use crate::sampling::random::Key;
use crate::spectral::Curve;

use super::criterion::{Contrast, Criterion};
use super::design_camera::FineBands;
use super::design_space::{Design, DesignSpace};
use super::evaluation::{
    Assumptions, DesignExposure, RegionMerits, chromaticity_separability, detectability, evaluate_region,
    sample_pixels,
};
use super::eye::smallest_margin_of_all;
use super::prepared_signals::RegionSignals;
use super::problem::{Budget, LightChoice, Split, tissue_margin};
use super::region_model::SignalRates;
use super::score::Score;

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
    /// Electrons of all channels of the first region, one pixel each, the white frame left out: fluorescence and reflected light.
    pub electrons: f64,
    /// Those of fluorescence among them.
    pub fluorescence_e: f64,
    /// Price.
    pub cost: f64,
    /// Largest ratio of reflected to fluorescent electrons.
    pub leak: f64,
    /// Electrons of the brightest pixel, dark ones included, over what it holds.
    pub saturation: f64,
    /// Photobiological margin of the tissue under all exposures together; null where it was not wanted, or nothing counts.
    pub tissue_margin: Option<f64>,
    /// The same of an eye that looks into the lights; null where the problem says of none.
    pub eye_margin: Option<f64>,
}

/// What a viewing filter does to the fluorescence of a region.
#[derive(Clone, Debug, PartialEq)]
pub struct FilteredFluorescence {
    /// Share of its electrons that pass, 0 to 1.
    pub kept: f64,
    /// Share of each fluorophore of the region in those that pass, 0 to 1: one in sum, all 0 where nothing passes.
    pub shares: Vec<f64>,
}

/// A limit that a design does not keep to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LimitExcess {
    /// Name of the limit, as in [`Merits::broken`].
    pub limit: &'static str,
    /// What the design has: of a margin too little, of everything else too much. Times are in seconds.
    pub value: f64,
    /// What the limit allows.
    pub allowed: f64,
}

impl LimitExcess {
    /// Whether it is farther from the limit than another excess of the same limit.
    pub(super) fn is_beyond(&self, other: &Self) -> bool {
        (self.value - self.allowed).abs() > (other.value - other.allowed).abs()
    }
}

impl DesignSpace {
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
        let signals = &self.geometries[design.geometry].regions[region];
        signals.lit(design.lights[exposure], design.filter, design.camera)
    }

    fn exposure(&self, design: &Design, exposure: usize, time_s: f64) -> DesignExposure<'_> {
        let p = &self.problem;
        DesignExposure {
            camera: &p.cameras[design.camera],
            light: p.lights[design.lights[exposure]].light * p.drives[design.drive],
            lens_sr: p.lens_sr(design.geometry, design.lens),
            time_s,
        }
    }

    /// The white frame, exposed to its level in the first region.
    fn white_exposure(&self, design: &Design) -> Option<DesignExposure<'_>> {
        let p = &self.problem;
        let white = p.white.as_ref()?;
        let camera = &p.cameras[design.camera];
        let lens_sr = p.lens_sr(design.geometry, design.lens);
        let mut exposure = DesignExposure { camera, light: white.light.light, lens_sr, time_s: 1.0 };
        let rates = self.geometries[design.geometry].regions[0].white(design.camera)?;
        let brightest = (0..rates.leak.len())
            .map(|c| rates.leak[c] + rates.fluorescence[c].iter().sum::<f64>())
            .fold(0.0, f64::max);
        let per_second = brightest * exposure.light * lens_sr + camera.dark_e_per_s;
        exposure.time_s = white.level * camera.full_e / per_second.max(1e-300);
        Some(exposure)
    }

    /// Exposures of a design, the white frame last.
    pub(super) fn exposures(&self, design: &Design) -> Vec<DesignExposure<'_>> {
        let times = self.times(design);
        let lit = times.iter().enumerate().map(|(k, &time_s)| self.exposure(design, k, time_s));
        lit.chain(self.white_exposure(design)).collect()
    }

    /// Signals of a region or a person in every exposure, the white frame last.
    fn in_exposures<'a>(signals: &'a RegionSignals, design: &Design) -> Vec<&'a SignalRates> {
        let &Design { filter, camera, .. } = design;
        let lit = design.lights.iter().map(|&light| signals.lit(light, filter, camera));
        lit.chain(signals.white(camera)).collect()
    }

    /// Pixels of the sensor that a region covers.
    #[must_use]
    pub fn pixels_of(&self, design: &Design, region: usize) -> f64 {
        self.problem.assumptions.pixels * self.geometries[design.geometry].pixel_shares[region]
    }

    pub(super) fn region_signals(&self, region: usize, design: &Design) -> Vec<&SignalRates> {
        Self::in_exposures(&self.geometries[design.geometry].regions[region], design)
    }

    fn group_signals(&self, group: usize, design: &Design) -> Option<Vec<Vec<&SignalRates>>> {
        let people = &self.cohort.as_ref()?[group];
        Some(people.iter().map(|person| Self::in_exposures(person, design)).collect())
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
    fn tissue_margin(&self, design: &Design, exposures: &[DesignExposure<'_>]) -> Option<f64> {
        let p = &self.problem;
        let irradiances = &self.geometries[design.geometry].irradiances;
        let lights = design.lights.iter().map(|&k| (&p.lights[k], irradiances[k] * p.drives[design.drive]));
        let white = p.white.as_ref().zip(irradiances.last()).map(|(white, level)| (&white.light, *level));
        let margin = |((light, irradiance), exposure): ((&LightChoice, f64), &DesignExposure<'_>)| {
            tissue_margin(&light.spectrum.scaled(irradiance), exposure.time_s, p.tissue_safety_factor)
        };
        let inverse: f64 =
            lights.chain(white).zip(exposures).filter_map(margin).map(|margin| 1.0 / margin).sum();
        (inverse > 0.0).then(|| 1.0 / inverse)
    }

    /// Photobiological margin of an eye that looks into the lights in all exposures: doses of a hazard add, burns are judged by
    /// exposure.
    fn eye_margin(&self, design: &Design, exposures: &[DesignExposure<'_>]) -> Option<f64> {
        let p = &self.problem;
        let (eye, is_rendered) = p.eye_of(design.geometry)?;
        let drive = p.drives[design.drive];
        let lights = design.lights.iter().map(|&k| (&p.lights[k], drive));
        let white = p.white.as_ref().map(|white| (&white.light, 1.0));
        let of_exposure = |((light, factor), exposure): ((&LightChoice, f64), &DesignExposure<'_>)| {
            let amount = factor * if is_rendered { light.power_w } else { light.light };
            eye.hazards(&light.spectrum.scaled(amount), exposure.time_s)
        };
        smallest_margin_of_all(lights.chain(white).zip(exposures).map(of_exposure))
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

    /// What the viewing filter of a design does to the fluorescence of the first region, in electrons of all channels of all its exposures.
    /// `None` where the sensor would see no fluorescence without the filter.
    pub fn filtered_fluorescence(&self, design: &Design) -> Option<FilteredFluorescence> {
        let p = &self.problem;
        let region = p.regions_of(design.geometry).next()?;
        let bands = FineBands::of(&region.response.grid);
        let (camera, times) = (&p.cameras[design.camera], self.times(design));
        let through = |filter: &Curve, spectra: &[Vec<f64>]| -> Vec<f64> {
            let channels = camera.behind(filter, &bands).by_band;
            let of = |weights: &[f64], spectrum: &[f64]| -> f64 {
                weights.iter().zip(spectrum).map(|(w, value)| w * value).sum()
            };
            spectra.iter().map(|s| channels.iter().map(|weights| of(weights, s)).sum()).collect()
        };
        let mut all = 0.0;
        let mut parts = vec![0.0; region.response.fluorescence.len()];
        for (&light, time_s) in design.lights.iter().zip(times) {
            let choice = &p.lights[light];
            let amount = choice.light * time_s;
            let filter = p.filters[design.filter].transmittance(choice.peak_nm);
            let spectra = region.response.fluorescence_under(&choice.spectrum);
            for (part, electrons) in parts.iter_mut().zip(through(&filter, &spectra)) {
                *part += amount * electrons;
            }
            all += amount * through(&Curve::constant(1.0), &spectra).iter().sum::<f64>();
        }
        let passed: f64 = parts.iter().sum();
        if passed > 0.0 {
            parts.iter_mut().for_each(|part| *part /= passed);
        }
        (all > 0.0).then(|| FilteredFluorescence { kept: passed / all, shares: parts })
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
        let geometry = &self.geometries[design.geometry];
        let by_region: Vec<Vec<&SignalRates>> =
            (0..geometry.regions.len()).map(|region| self.region_signals(region, design)).collect();
        let of_region = |(number, signals): (usize, &Vec<&SignalRates>)| {
            let pixels = self.pixels_of(design, number);
            let assumptions = Assumptions { pixels, ..p.assumptions };
            let known = (geometry.priors[number].as_slice(), &assumptions);
            evaluate_region(signals, &exposures, &is_white, known, &geometry.contrasts[number])
        };
        let regions: Vec<RegionMerits> = by_region.iter().enumerate().map(of_region).collect();
        let wants_detection = full || p.criterion == Criterion::Detection;
        let detectability =
            if wants_detection { self.cohort_detectability(design, &exposures) } else { None };
        let loss = match p.criterion {
            Criterion::Detection => detectability.map_or(f64::INFINITY, |d| 1.0 / d),
            Criterion::Leak => regions.iter().map(|region| region.leak).fold(0.0, f64::max),
            _ => self.worst_loss(&regions, &geometry.contrasts),
        };
        let times_s: Vec<f64> = exposures.iter().map(|exposure| exposure.time_s).collect();
        let largest = |pick: fn(&RegionMerits) -> f64| regions.iter().map(pick).fold(0.0, f64::max);
        let of_lights = |electrons: fn(&DesignExposure<'_>, &SignalRates) -> f64| -> f64 {
            let under_lights = exposures.iter().zip(&by_region[0]).take(design.lights.len());
            under_lights.map(|(exposure, rates)| electrons(exposure, rates)).sum()
        };
        let mut merits = Merits {
            loss,
            broken: Vec::new(),
            color_separability: if full {
                self.color_separability(&by_region, &exposures, &geometry.pixel_shares)
            } else {
                None
            },
            detectability,
            time_s: times_s.iter().sum(),
            times_s,
            electrons: of_lights(|exposure, rates| exposure.electrons(rates)),
            fluorescence_e: of_lights(|exposure, rates| exposure.fluorescence_electrons(rates)),
            cost: self.cost(design),
            leak: largest(|region| region.leak),
            saturation: largest(|region| region.saturation),
            tissue_margin: (full || p.limits.tissue_margin.is_some())
                .then(|| self.tissue_margin(design, &exposures))
                .flatten(),
            eye_margin: (full || p.limits.eye_margin.is_some())
                .then(|| self.eye_margin(design, &exposures))
                .flatten(),
            regions,
        };
        merits.broken = self.excesses(&merits).iter().map(|excess| excess.limit).collect();
        merits
    }

    /// Loss of the worst region. A region that holds nothing of the part of a contrast says nothing about it.
    fn worst_loss(&self, regions: &[RegionMerits], contrasts: &[Vec<Contrast>]) -> f64 {
        let criterion = self.problem.criterion;
        let counts = |contrasts: &&Vec<Contrast>| match criterion {
            Criterion::Contrast(number) => {
                contrasts.get(number).is_some_and(|contrast| contrast.part.iter().any(|part| *part > 0.0))
            }
            _ => true,
        };
        let counted = regions.iter().zip(contrasts).filter(|(_, contrasts)| counts(contrasts));
        counted
            .map(|(region, contrasts)| region.loss(criterion, contrasts))
            .reduce(f64::max)
            .unwrap_or(f64::INFINITY)
    }

    fn color_separability(
        &self,
        by_region: &[Vec<&SignalRates>],
        exposures: &[DesignExposure<'_>],
        pixel_shares: &[f64],
    ) -> Option<f64> {
        let pixels = |region: usize| self.problem.assumptions.pixels * pixel_shares[region];
        let pairs = (0..by_region.len()).flat_map(|a| (a + 1..by_region.len()).map(move |b| (a, b)));
        pairs
            .map(|(a, b)| {
                chromaticity_separability(&by_region[a], &by_region[b], exposures, [a, b].map(pixels))
            })
            .reduce(f64::min)
    }

    /// The limits that a design does not keep to. Times that use up their limit exceed it by rounding at most, which is no excess.
    pub(super) fn excesses(&self, merits: &Merits) -> Vec<LimitExcess> {
        const ROUNDING: f64 = 1e-12;
        let limits = &self.problem.limits;
        let is_margin = |name: &str| name.ends_with("margin");
        [
            ("tissue_margin", merits.tissue_margin, limits.tissue_margin),
            ("eye_margin", merits.eye_margin, limits.eye_margin),
            ("leak", Some(merits.leak), limits.leak),
            ("saturation", Some(merits.saturation), limits.saturation),
            ("time", Some(merits.time_s * (1.0 - ROUNDING)), limits.time_s),
            ("cost", Some(merits.cost), limits.cost),
        ]
        .into_iter()
        .filter_map(|(limit, value, allowed)| Some(LimitExcess { limit, value: value?, allowed: allowed? }))
        .filter(|of| if is_margin(of.limit) { of.value < of.allowed } else { of.value > of.allowed })
        .collect()
    }
}
