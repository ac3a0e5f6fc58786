//! Reflectance and fluorescence of a tissue.

use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::spectral::Curve;
use fluorspar::tissue::fit::Viewing;
use fluorspar::tissue::{
    Below, DiscreteOrdinates, EffectiveTissue, Incidence, LayerFluorophore, LayeredTissue, Level, LightField,
    Site, TissueError,
};
use fluorspar::units::number_text;
use fluorspar_experiment::{NamedTissue, Warning};
use fluorspar_format::OutputFolder;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::solve_files::{figures, tables};
use super::source::{SiteOptions, balanced, find};
use crate::figure_file::figure_files;
use crate::options::defaults;
use crate::values::{self, check_range};
use crate::{Error, Job, Result, named_spectra};

/// Two tables, results and some figures.
const FOLDER_BYTES: u64 = 32 << 20;
/// Wavelengths at which tissue is known, nm.
const WAVELENGTH_NM: [f64; 2] = [350.0, 800.0];
/// Least distance of the last wavelength from the first, nm.
const LEAST_RANGE_NM: f64 = 20.0;
/// Half width of the light of one wavelength, nm.
const LINE_NM: f64 = 2.5;

/// Which tissue is solved, where, and under which light.
#[derive(Clone, Debug, Deserialize, clap::Args)]
#[serde(default = "defaults")]
pub struct SolveOptions {
    /// The tissue.
    #[command(flatten)]
    #[serde(flatten)]
    pub site: SiteOptions,
    /// Light whose fluorescence is given: a name of the catalogue or a CSV file. May be repeated [default: led_405, led_450].
    #[arg(long, value_name = "NAME|CSV")]
    pub light: Vec<String>,
    /// Light of one wavelength whose fluorescence is given, nm. May be repeated.
    #[arg(long, value_name = "NM", value_parser = values::number, allow_negative_numbers = true)]
    pub excitation_nm: Vec<f64>,
    /// First wavelength, nm.
    #[arg(long, value_name = "NM", default_value_t = 350.0, value_parser = values::number, allow_negative_numbers = true)]
    pub from_nm: f64,
    /// Last wavelength, nm.
    #[arg(long, value_name = "NM", default_value_t = 750.0, value_parser = values::number, allow_negative_numbers = true)]
    pub to_nm: f64,
    /// Step between wavelengths, nm.
    #[arg(long, value_name = "NM", default_value_t = 5.0, value_parser = values::number, allow_negative_numbers = true)]
    pub step_nm: f64,
    /// Directions per hemisphere: 16 give diffuse light to 3e-5, 32 a beam to 3e-4.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = values::whole::<usize, 8, 128>,
        allow_negative_numbers = true)]
    pub nodes: usize,
    /// Folder for results.json, spectra.csv, fluorescence.csv, eem.csv and figures (SVG and PNG) [default: none].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// Light in a tissue by wavelength.
#[derive(Clone, Debug, Serialize)]
pub struct SolvedTissue {
    /// Name for people.
    pub title: String,
    /// The site of the catalogue.
    pub site: String,
    /// What lies below the last layer.
    pub below: String,
    /// Share of diffuse light that the surface reflects at once.
    pub specular_reflectance_of_diffuse_light: f64,
    /// Wavelengths, nm.
    pub wavelength_nm: Vec<f64>,
    /// Of diffuse light, above the surface, without what the surface reflects at once.
    pub reflectance: Vec<f64>,
    /// The same below the surface, for something that reflects by itself.
    pub reflectance_below_surface: Vec<f64>,
    /// Of a beam along the normal, without what the surface reflects at once.
    pub reflectance_of_beam: Vec<f64>,
    /// Fluence just below the surface per irradiance of the beam.
    pub fluence_at_surface: Vec<f64>,
    /// Depth at which the fluence of the beam is that at the surface over e, um.
    pub depth_of_1_over_e_um: Vec<f64>,
    /// Fluorescence under each light.
    pub fluorescence: Vec<SolvedFluorescence>,
    /// What the absorption of the fluorophores themselves changes.
    pub own_absorption: OwnAbsorption,
    /// Matrices of its fluorophores; not serialized.
    #[serde(skip)]
    pub eem: TissueEem,
}

/// Fluorescence under one light.
#[derive(Clone, Debug, Serialize)]
pub struct SolvedFluorescence {
    /// Name of the light.
    pub light: String,
    /// Energy that leaves per nm and per unit of energy of the light, 1/nm.
    pub exitance_per_nm: Vec<f64>,
    /// The same over all wavelengths that were solved.
    pub exitance: f64,
    /// What emits it.
    pub emitters: Vec<TissueEmitter>,
}

/// A fluorophore in a layer.
#[derive(Clone, Debug, Serialize)]
pub struct TissueEmitter {
    /// Name of the fluorophore.
    pub fluorophore: String,
    /// Name of the layer.
    pub layer: String,
    /// Share of the exitance.
    pub share: f64,
    /// Its exitance, 1/nm.
    pub exitance_per_nm: Vec<f64>,
}

/// What the absorption of the fluorophores themselves changes, quantum yields assumed: relative, the largest over 400 to 700 nm.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct OwnAbsorption {
    /// Of the reflectance.
    pub change_of_reflectance: f64,
    /// Of the exitance under the lights, the largest of all.
    pub change_of_fluorescence: f64,
}

/// Excitation-emission matrices above the surface, photons per photon and nm, of each fluorophore over all layers.
#[derive(Clone, Debug)]
pub struct TissueEem {
    /// Excitation, nm.
    pub excitation_nm: Vec<f64>,
    /// Emission, nm.
    pub emission_nm: Vec<f64>,
    /// Names, and values by emission, then excitation.
    pub fluorophores: Vec<(String, Vec<f64>)>,
}

/// Solves a tissue, and writes the results into the folder of the options.
///
/// # Errors
/// An option out of its range or without a meaning, a tissue that can't be solved, a folder that can't be written.
pub fn solve(options: &SolveOptions, job: &Job) -> Result<SolvedTissue> {
    for (option, value, range) in [
        ("from_nm", options.from_nm, WAVELENGTH_NM),
        ("to_nm", options.to_nm, WAVELENGTH_NM),
        ("step_nm", options.step_nm, [0.5, 20.0]),
    ] {
        check_range(option, value, range, "nm")?;
    }
    if options.to_nm < options.from_nm + LEAST_RANGE_NM {
        return Err(Error::Input(format!(
            "⟨to_nm={}⟩: must be {LEAST_RANGE_NM} nm or more above ⟨from_nm={}⟩",
            number_text(options.to_nm),
            number_text(options.from_nm)
        )));
    }
    for nm in &options.excitation_nm {
        check_range("excitation_nm", *nm, [options.from_nm + LINE_NM, options.to_nm - LINE_NM], "nm")?;
    }
    let (title, site) = options.site.resolve()?;
    let lights = options.lights(job)?;
    let inputs: Vec<PathBuf> =
        options.site.file().into_iter().chain(options.light.iter().map(PathBuf::from)).collect();
    let out =
        options.out.as_ref().map(|out| OutputFolder::prepare(out, &inputs, FOLDER_BYTES)).transpose()?;
    let found = options.solve(title, &site, &lights)?;
    if let Some(out) = out {
        job.status(format!("Wrote {}", write(out, &found)?.display()));
    }
    Ok(found)
}

/// Share of the energy of a light below which it is told that the rest is left out.
const LEAST_SHARE: f64 = 0.98;

impl SolveOptions {
    /// Names and spectra of the lights.
    fn lights(&self, job: &Job) -> Result<Vec<(String, Viewing)>> {
        let named = |name: &String| {
            let (light, label) = (named_spectra::light(name, job)?, named_spectra::label(name));
            let viewing = Viewing::new(&light, Curve::constant(1.0))?;
            job.warn(self.left_out(&label, &light).as_slice());
            Ok((label, viewing))
        };
        let line = |nm: &f64| Ok((format!("{nm} nm"), line_viewing(*nm)?));
        let default = ["led_405", "led_450"].map(String::from);
        let chosen: &[String] =
            if self.light.is_empty() && self.excitation_nm.is_empty() { &default } else { &self.light };
        chosen.iter().map(named).chain(self.excitation_nm.iter().map(line)).collect()
    }

    /// What is said of a light that lies in part where the tissue is not solved.
    fn left_out(&self, label: &str, light: &Curve) -> Option<Warning> {
        let share = light.integral(self.from_nm, self.to_nm) / light.total();
        (share < LEAST_SHARE).then(|| {
            let (from, to) = (number_text(self.from_nm), number_text(self.to_nm));
            let percent = number_text((100.0 * share).round());
            Warning::from(format!(
                "{label}: {percent} % of its energy lies from {from} to {to} nm, where the tissue is solved: numbers are of that part alone"
            ))
        })
    }

    fn wavelengths(&self) -> Vec<f64> {
        let number = ((self.to_nm - self.from_nm) / self.step_nm).floor() as usize;
        (0..=number).map(|i| self.from_nm + self.step_nm * i as f64).collect()
    }

    fn solve(&self, title: String, site: &NamedTissue, lights: &[(String, Viewing)]) -> Result<SolvedTissue> {
        let (tissue, nm) = (balanced(site.tissue(&find)?)?, self.wavelengths());
        let solver = DiscreteOrdinates::new(self.nodes)?;
        let solved = EffectiveTissue::new(&tissue, &nm, solver)?;
        let at = |level| -> Vec<f64> {
            let curve = solved.reflectance(level);
            nm.iter().map(|&nm| curve.at(nm)).collect()
        };
        let beams = beams(&tissue, &nm, self.nodes)?;
        let thickness_mm: f64 = tissue.layers.iter().map(|layer| 1e-3 * layer.thickness_um).sum();
        let fluorescence: Vec<SolvedFluorescence> =
            lights.iter().map(|(name, light)| fluorescence(name, light, &solved, &nm)).collect();
        let own_absorption = own_absorption(&solved, &nm, solver, lights, &fluorescence)?;
        Ok(SolvedTissue {
            title,
            site: site.name().to_owned(),
            below: match tissue.below {
                Below::Black => "black: nothing returns from below the last layer".into(),
                Below::Index(index) => {
                    format!("a medium of index {index}: its surface reflects, nothing returns from within it")
                }
            },
            specular_reflectance_of_diffuse_light: solved.specular_reflectance(),
            reflectance: at(Level::AboveSurface),
            reflectance_below_surface: at(Level::BelowSurface),
            reflectance_of_beam: beams.iter().map(|field| field.reflectance).collect(),
            fluence_at_surface: beams.iter().map(|field| field.fluence(0.0)).collect(),
            depth_of_1_over_e_um: beams
                .iter()
                .map(|field| depth_of_1_over_e_um(field, thickness_mm))
                .collect(),
            fluorescence,
            own_absorption,
            eem: eem(&solved, &nm),
            wavelength_nm: nm,
        })
    }
}

/// Light of one wavelength, without a filter behind it.
pub(super) fn line_viewing(nm: f64) -> Result<Viewing> {
    // A line that is no wider than the steps of a light.
    let curve = Curve::new(vec![nm - LINE_NM, nm, nm + LINE_NM], vec![0.0, 1.0, 0.0]);
    let curve = curve.map_err(|error| Error::Input(format!("⟨excitation_nm={nm}⟩: {error}")))?;
    Ok(Viewing::new(&curve, Curve::constant(1.0))?)
}

/// A beam along the normal at each wavelength.
pub(super) fn beams(tissue: &LayeredTissue, nm: &[f64], nodes: usize) -> Result<Vec<LightField>> {
    let solver = DiscreteOrdinates::new(nodes.max(32))?;
    let solve = |&nm: &f64| solver.solve(&tissue.optics(nm), Incidence::NORMAL);
    Ok(nm.par_iter().map(solve).collect::<Result<_, TissueError>>()?)
}

/// Bisection between the surface and the bottom.
pub(super) fn depth_of_1_over_e_um(field: &LightField, thickness_mm: f64) -> f64 {
    let wanted = field.fluence(0.0) / std::f64::consts::E;
    let [mut above, mut below] = [0.0, thickness_mm];
    for _ in 0..40 {
        let middle = 0.5 * (above + below);
        if field.fluence(middle) > wanted { above = middle } else { below = middle }
    }
    1e3 * above
}

/// Integral of samples, by trapezoids.
fn integral(nm: &[f64], values: &[f64]) -> f64 {
    nm.windows(2).zip(values.windows(2)).map(|(nm, v)| 0.5 * (nm[1] - nm[0]) * (v[0] + v[1])).sum()
}

pub(super) fn fluorescence(
    name: &str,
    light: &Viewing,
    solved: &EffectiveTissue,
    nm: &[f64],
) -> SolvedFluorescence {
    let mut total = vec![0.0; nm.len()];
    let mut emitters = Vec::new();
    for part in solved.parts() {
        let layer = &solved.tissue().layers[part.layer];
        let emitted = light.fluorescence(solved, part, nm);
        total.iter_mut().zip(&emitted).for_each(|(sum, value)| *sum += value);
        emitters.push(TissueEmitter {
            fluorophore: layer.fluorophores[part.fluorophore].fluorophore.name.clone(),
            layer: layer.name.clone(),
            share: integral(nm, &emitted),
            exitance_per_nm: emitted,
        });
    }
    let exitance = integral(nm, &total);
    emitters.iter_mut().for_each(|emitter| emitter.share /= exitance.max(f64::MIN_POSITIVE));
    SolvedFluorescence { light: name.into(), exitance_per_nm: total, exitance, emitters }
}

fn own_absorption(
    solved: &EffectiveTissue,
    nm: &[f64],
    solver: DiscreteOrdinates,
    lights: &[(String, Viewing)],
    without: &[SolvedFluorescence],
) -> Result<OwnAbsorption> {
    let tissue = solved.tissue().with_own_absorption(Site::quantum_yield);
    let with = EffectiveTissue::new(&tissue, nm, solver)?;
    let [a, b] = [&with, solved].map(|tissue| tissue.reflectance(Level::AboveSurface));
    let largest = |changes: &mut dyn Iterator<Item = f64>| {
        changes.fold(0.0, |most: f64, change| if change.abs() > most.abs() { change } else { most })
    };
    let seen = nm.iter().filter(|nm| (400.0..=700.0).contains(*nm));
    let changes = |(light, before): (&(String, Viewing), &SolvedFluorescence)| {
        fluorescence(&light.0, &light.1, &with, nm).exitance / before.exitance.max(f64::MIN_POSITIVE) - 1.0
    };
    Ok(OwnAbsorption {
        change_of_reflectance: largest(&mut seen.map(|&nm| a.at(nm) / b.at(nm) - 1.0)),
        change_of_fluorescence: largest(&mut lights.iter().zip(without).map(changes)),
    })
}

/// Matrices on the wavelengths that were solved: excitation up to 520 nm.
fn eem(solved: &EffectiveTissue, nm: &[f64]) -> TissueEem {
    let excitation_nm: Vec<f64> = nm.iter().copied().filter(|nm| *nm <= 520.0).collect();
    let mut fluorophores: Vec<(String, Vec<f64>)> = Vec::new();
    for part in solved.parts() {
        let held = &solved.tissue().layers[part.layer].fluorophores[part.fluorophore];
        let values = matrix(solved, part, nm, &excitation_nm);
        match fluorophores.iter_mut().find(|(name, _)| *name == held.fluorophore.name) {
            Some((_, sum)) => sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value),
            None => fluorophores.push((held.fluorophore.name.clone(), values)),
        }
    }
    TissueEem { excitation_nm, emission_nm: nm.to_vec(), fluorophores }
}

fn matrix(solved: &EffectiveTissue, part: LayerFluorophore, nm: &[f64], excitation_nm: &[f64]) -> Vec<f64> {
    // One column after the other, each from one light; then by rows.
    let columns: Vec<Vec<f64>> = excitation_nm
        .par_iter()
        .map(|&x| solved.emission(part, &[(x, 1.0)], nm, Level::AboveSurface))
        .collect();
    (0..nm.len()).flat_map(|row| columns.iter().map(move |column| column[row])).collect()
}

/// Writes all files of the results.
fn write(out: OutputFolder, found: &SolvedTissue) -> Result<PathBuf> {
    let results = serde_json::to_string_pretty(found)?;
    let mut files = vec![("results.json".to_string(), results.into_bytes())];
    files.extend(tables(found).into_iter().map(|(name, table)| (format!("{name}.csv"), table.into_bytes())));
    for (name, figure) in figures(found) {
        files.extend(figure_files(&name, &figure)?);
    }
    Ok(out.finish_with(files)?)
}
