//! What a parameter of a site does to the light that returns.

use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::spectral::{Curve, StandardObserver, WavelengthGrid, daylight_d65};
use fluorspar::tissue::{DiscreteOrdinates, EffectiveTissue, Level, Site};
use fluorspar_format::OutputFolder;
use serde::{Deserialize, Serialize};

use super::depth::{RANGE_NM, STEP_NM, check_inside, line, wavelengths};
use super::solve::{beams, depth_of_1_over_e_um, fluorescence, line_viewing};
use super::source::{SiteOptions, balanced, find};
use super::sweep_files::write;
use crate::options::defaults;
use crate::values;
use crate::{Error, Job, Left, Result};

/// Three tables, results, a page and its figures.
const FOLDER_BYTES: u64 = 64 << 20;
/// Directions per hemisphere of the beam: as `tissue solve` has them.
const BEAM_NODES: usize = 32;

/// Which parameter of which site is changed.
#[derive(Clone, Debug, Deserialize, clap::Args)]
#[serde(default = "defaults")]
pub struct TissueSweepOptions {
    /// The tissue.
    #[command(flatten)]
    #[serde(flatten)]
    pub site: SiteOptions,
    /// The parameter and its first and last value, for instance superficial_blood_fraction=0.002..0.05.
    #[arg(value_name = "PARAMETER=FROM..TO")]
    pub range: String,
    /// Number of values, evenly from the first to the last.
    #[arg(long, value_name = "N", default_value_t = 11, value_parser = values::whole::<usize, 2, 200>,
        allow_negative_numbers = true)]
    pub steps: usize,
    /// Light of one wavelength, which excites the fluorescence, nm.
    #[arg(long, value_name = "NM", default_value_t = 405.0, value_parser = values::number, allow_negative_numbers = true)]
    pub excitation_nm: f64,
    /// Folder for report.html, results.json, sweep.csv, reflectance.csv, fluorescence.csv and figures (SVG and PNG) [default: none].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// A tissue by the value of one of its parameters.
#[derive(Clone, Debug, Serialize)]
pub struct SweptTissue {
    /// Name for people.
    pub title: String,
    /// The site of the catalogue.
    pub site: String,
    /// The parameter.
    pub parameter: String,
    /// Its unit; empty for a pure number.
    pub unit: String,
    /// What it is.
    pub meaning: String,
    /// Its value in the site as it was given.
    pub typical: f64,
    /// Excitation, nm.
    pub excitation_nm: f64,
    /// Wavelengths of the spectra, nm.
    pub wavelength_nm: Vec<f64>,
    /// The tissue at each value.
    pub points: Vec<SweptPoint>,
}

/// A tissue at one value of the parameter.
#[derive(Clone, Debug, Serialize)]
pub struct SweptPoint {
    /// The value.
    pub value: f64,
    /// Chromaticity x, y (CIE 1931) of the light reflected under D65; none where there is none.
    pub reflected_xy: Option<[f64; 2]>,
    /// Luminance of that light over that of a white surface, 0 to 1.
    pub luminance_factor: f64,
    /// Chromaticity x, y of the fluorescence; none where there is none.
    pub fluorescence_xy: Option<[f64; 2]>,
    /// Energy that returns as fluorescence per unit of energy of the light.
    pub exitance: f64,
    /// Depth above which half of the fluorescence arises, um; none where there is none.
    pub median_depth_um: Option<f64>,
    /// Depth at which the fluence of a beam of the excitation is that at the surface over e, um.
    pub depth_of_1_over_e_um: f64,
    /// Reflectance of diffuse light above the surface, without what the surface reflects at once.
    pub reflectance: Vec<f64>,
    /// Energy that leaves as fluorescence per nm and per unit of energy of the light, 1/nm.
    pub exitance_per_nm: Vec<f64>,
}

/// Solves a site at several values of a parameter, and writes the results into the folder of the options.
///
/// # Errors
/// A parameter that the site does not have, a range outside that of the parameter, a tissue that can't be solved, a folder that can't be
/// written.
pub fn sweep(options: &TissueSweepOptions, job: &Job) -> Result<SweptTissue> {
    check_inside("excitation_nm", options.excitation_nm)?;
    let (title, site) = options.site.resolve_site()?;
    let (name, ends) = options.range()?;
    let typical = site.get(name)?;
    let sites = options.sites(&site, name, ends)?;
    let inputs: Vec<PathBuf> = options.site.file().into_iter().collect();
    let out =
        options.out.as_ref().map(|out| OutputFolder::prepare(out, &inputs, FOLDER_BYTES)).transpose()?;

    let nm = wavelengths();
    let share_done = job.listener.begin("Solving", "the sweep", Left::Nothing);
    let mut points = Vec::with_capacity(sites.len());
    for (i, (value, site)) in sites.iter().enumerate() {
        points.push(point(*value, site, &nm, options.excitation_nm)?);
        share_done((i + 1) as f64 / sites.len() as f64);
    }
    drop(share_done);
    let parameter = site.parameters().map(|(parameter, _)| parameter).find(|known| known.name == name);
    let found = SweptTissue {
        title,
        site: site.name().into(),
        parameter: name.into(),
        unit: parameter.map_or("", |parameter| parameter.unit()).into(),
        meaning: parameter.map_or("", |parameter| parameter.meaning).into(),
        typical,
        excitation_nm: options.excitation_nm,
        wavelength_nm: nm,
        points,
    };
    if let Some(out) = out {
        job.status(format!("Open {}", write(out, &found)?.join("report.html").display()));
    }
    Ok(found)
}

impl TissueSweepOptions {
    /// The values of the parameter from one to another, and the site with each.
    fn sites(&self, site: &Site, name: &str, [from, to]: [f64; 2]) -> Result<Vec<(f64, Site)>> {
        let at = |value: f64| -> Result<(f64, Site)> {
            let mut site = site.clone();
            site.set(name, value)?;
            site.check_followed(name, value)?;
            Ok((value, site))
        };
        // Ends that are out of range are told as they were given
        [from, to].into_iter().try_for_each(|end| at(end).map(drop))?;
        let last = (self.steps - 1) as f64;
        (0..self.steps).map(|i| at((from * (last - i as f64) + to * i as f64) / last)).collect()
    }

    /// Name of the parameter, its first and its last value.
    fn range(&self) -> Result<(&str, [f64; 2])> {
        let refused = |why: &str| Error::Input(format!("\"{}\": {why}", self.range));
        let ends = self.range.split_once('=').and_then(|(name, range)| Some((name, range.split_once("..")?)));
        let (name, (from, to)) = ends.ok_or_else(|| {
            refused("write PARAMETER=FROM..TO, such as superficial_blood_fraction=0.002..0.05")
        })?;
        let number = |text: &str| values::number(text).map_err(|why| refused(&why));
        let [from, to] = [number(from)?, number(to)?];
        if from >= to {
            return Err(refused("the first value must be below the last"));
        }
        Ok((name.trim(), [from, to]))
    }
}

/// The tissue at one value.
fn point(value: f64, site: &Site, nm: &[f64], excitation_nm: f64) -> Result<SweptPoint> {
    let tissue = balanced(site.tissue(&find)?)?;
    let solved = EffectiveTissue::new(&tissue, nm, DiscreteOrdinates::DIFFUSE)?;
    let of_tissue = solved.reflectance(Level::AboveSurface);
    let glow = fluorescence("", &line_viewing(excitation_nm)?, &solved, nm);
    let emitted = Curve::new(nm.to_vec(), glow.exitance_per_nm.clone());
    let emitted = emitted.map_err(|error| Error::Failed(error.to_string()))?;
    let white = daylight_d65();
    let reflected = tristimulus(|nm| white.at(nm) * of_tissue.at(nm))?;
    let of_glow = tristimulus(|nm| emitted.at(nm))?;
    let origins = solved.depth_of_fluorescence(&line(excitation_nm)?, &Curve::constant(1.0));
    let beam = beams(&tissue, &[excitation_nm], BEAM_NODES)?;
    let thickness_mm: f64 = tissue.layers.iter().map(|layer| 1e-3 * layer.thickness_um).sum();
    Ok(SweptPoint {
        value,
        reflected_xy: chromaticity(reflected),
        luminance_factor: reflected[1] / tristimulus(|nm| white.at(nm))?[1],
        fluorescence_xy: chromaticity(of_glow),
        exitance: glow.exitance,
        median_depth_um: origins.quantile_um(0.5),
        depth_of_1_over_e_um: depth_of_1_over_e_um(&beam[0], thickness_mm),
        reflectance: nm.iter().map(|nm| of_tissue.at(*nm)).collect(),
        exitance_per_nm: glow.exitance_per_nm,
    })
}

/// X, Y and Z of a spectrum of energy.
fn tristimulus(spectrum: impl Fn(f64) -> f64) -> Result<[f64; 3]> {
    let grid = WavelengthGrid::uniform(RANGE_NM[0], RANGE_NM[1], STEP_NM);
    let grid = grid.map_err(|error| Error::Failed(error.to_string()))?;
    let values: Vec<f32> = grid.centers_nm().into_iter().map(|nm| spectrum(nm) as f32).collect();
    Ok(StandardObserver::new(&grid).xyz(&values))
}

/// x and y; none of no light.
fn chromaticity([x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
    let sum = x + y + z;
    (sum > 0.0).then(|| [x / sum, y / sum])
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::solve::{SolveOptions, solve};
    use super::*;
    use crate::Listener;

    /// Hears nothing.
    struct Silent;

    impl Listener for Silent {
        fn status(&self, _: &str) {}
        fn warnings(&self, _: &[fluorspar_experiment::Warning]) {}
        fn begin(&self, _: &'static str, _: &'static str, _: Left) -> Box<dyn Fn(f64) + Sync> {
            Box::new(|_| {})
        }
    }

    fn job() -> Job {
        Job::new(Arc::default(), Arc::new(Silent))
    }

    fn swept(range: &str) -> Result<SweptTissue> {
        let site = SiteOptions { site: "lip".into(), ..SiteOptions::default() };
        sweep(&TissueSweepOptions { site, range: range.into(), steps: 3, ..defaults() }, &job())
    }

    #[test]
    fn a_point_of_a_sweep_is_the_tissue_of_that_value() {
        let found = swept("superficial_blood_fraction=0.002..0.05").unwrap();
        let values: Vec<f64> = found.points.iter().map(|p| p.value).collect();
        assert!(values[0] == 0.002 && (values[1] - 0.026).abs() < 1e-15 && values[2] == 0.05, "{values:?}");
        let site = SiteOptions {
            site: "lip".into(),
            set: vec!["superficial_blood_fraction=0.05".into()],
            ..SiteOptions::default()
        };
        let options = SolveOptions { site, excitation_nm: vec![405.0], ..defaults() };
        let alone = solve(&options, &job()).unwrap();
        let last = &found.points[2];
        assert_eq!(alone.wavelength_nm, found.wavelength_nm);
        assert_eq!(alone.reflectance, last.reflectance);
        assert_eq!(alone.fluorescence[0].exitance, last.exitance);
        let at_405 = found.wavelength_nm.iter().position(|nm| *nm == 405.0).unwrap();
        assert_eq!(alone.depth_of_1_over_e_um[at_405], last.depth_of_1_over_e_um);
        // More blood: darker, redder, less fluorescence
        for pair in found.points.windows(2) {
            assert!(pair[1].luminance_factor < pair[0].luminance_factor);
            assert!(pair[1].exitance < pair[0].exitance);
            assert!(pair[1].reflected_xy.unwrap()[0] > pair[0].reflected_xy.unwrap()[0]);
        }
    }

    #[test]
    fn wrong_sweeps_are_refused_with_a_remedy() {
        for (range, words) in [
            ("superficial_blood=0..1", "superficial_blood_fraction"),
            ("superficial_blood_fraction=0.1..2", "superficial_blood_fraction is 2, outside 0 to 1"),
            ("biofilm_thickness_um=0..10", "biofilm_thickness_um is 10, outside 0 to 7.5"),
            ("superficial_blood_fraction=0.1", "write PARAMETER=FROM..TO"),
            ("superficial_blood_fraction=0.1..0.1", "the first value must be below the last"),
            ("superficial_blood_fraction=a..0.1", "give a number"),
        ] {
            let said = swept(range).unwrap_err().to_string();
            assert!(said.contains(words), "{range}: {said}");
        }
    }
}
