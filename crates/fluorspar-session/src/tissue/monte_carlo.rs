//! Photons traced through the layers of a tissue.

use std::path::PathBuf;

use clap::ValueHint;
use fluorspar::names::did_you_mean;
use fluorspar::tissue::monte_carlo::{
    Estimate, FluorescenceResult, MonteCarloControl, MonteCarloResult, MonteCarloSettings,
    ReciprocalFluorescence, Ring, ScoredQuantity, ScoringGrid, StandardErrorTarget,
    fluorescence_by_reciprocity, simulate, simulate_fluorescence,
};
use fluorspar::tissue::{Incidence, TissueError};
use fluorspar_experiment::ResolvedLayers;
use fluorspar_format::OutputFolder;
use serde::{Deserialize, Serialize};

use super::monte_carlo_files::{figures, tables};
use super::source::TissueOptions;
use crate::options::defaults;
use crate::values::{self, check_range};
use crate::{Error, Job, Left, Result};

/// Most photons of a simulation.
const MOST_PHOTONS: u64 = 1_000_000_000_000;
/// Two tables of at most fifty thousand lines, two figures and the results.
const FOLDER_BYTES: u64 = 64 << 20;
/// Numbers of rings.
const RADIAL_BINS: [f64; 2] = [1.0, 20_000.0];

/// Through which tissue photons are traced, and how many.
#[derive(Clone, Debug, Deserialize, clap::Args)]
#[serde(default = "defaults")]
pub struct MonteCarloOptions {
    /// The tissue.
    #[command(flatten)]
    #[serde(flatten)]
    pub tissue: TissueOptions,
    /// Angle of the incident beam to the normal, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = values::number, allow_negative_numbers = true)]
    pub angle_deg: f64,
    /// Diffuse light, the same from all directions above, instead of a beam.
    #[arg(long, conflicts_with = "angle_deg")]
    pub diffuse: bool,
    /// Photons to trace; with `--error` the most.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = values::whole::<u64, 1, MOST_PHOTONS>,
        allow_negative_numbers = true)]
    pub photons: u64,
    /// Stop once the standard error of one result is below this share of it, for instance 0.001.
    #[arg(long, value_name = "E", value_parser = values::number, allow_negative_numbers = true)]
    pub error: Option<f64>,
    /// The result that `--error` is about: reflectance, transmittance, fluorescence, or the absorption of the layer of this
    /// name [default: fluorescence where the file has it, else reflectance].
    #[arg(long, value_name = "WHAT", requires = "error")]
    pub error_of: Option<String>,
    /// Seed of the random numbers: the same one gives the same results, whatever the number of threads.
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = values::seed, allow_negative_numbers = true)]
    pub seed: u64,
    /// Find the fluorescence from the fluences of both wavelengths, by reciprocity, instead of tracing it: it is less noisy,
    /// but without distances from the beam.
    #[arg(long)]
    pub reciprocity: bool,
    /// Largest width of bins of depth, mm; every layer has its own bins.
    #[arg(long, value_name = "MM", default_value_t = 0.01, value_parser = values::number, allow_negative_numbers = true)]
    pub depth_step_mm: f64,
    /// Depth to which fluence is scored, mm.
    #[arg(long, value_name = "MM", default_value_t = 5.0, value_parser = values::number, allow_negative_numbers = true)]
    pub depth_limit_mm: f64,
    /// Width of the rings around the beam in which leaving light is scored, mm.
    #[arg(long, value_name = "MM", default_value_t = 0.02, value_parser = values::number, allow_negative_numbers = true)]
    pub radial_step_mm: f64,
    /// Number of rings.
    #[arg(long, value_name = "N", default_value_t = 500, value_parser = values::whole::<usize, 1, 20_000>,
        allow_negative_numbers = true)]
    pub radial_bins: usize,
    /// Folder for results.json, radius.csv, depth.csv and the figures radius.svg and depth.svg [default: none].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub out: Option<PathBuf>,
}

/// What photons did in a tissue.
#[derive(Clone, Debug, Serialize)]
pub struct TracedTissue {
    /// Name for people; may be empty.
    pub title: String,
    /// Names of the layers.
    pub layers: Vec<String>,
    /// Angle of the beam, degrees; `None` of diffuse light.
    pub angle_deg: Option<f64>,
    /// Wavelength at which the fluorescence is per nm; without it the fluorescence is that of the whole emission.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub emission_nm: Option<f64>,
    /// At the excitation, where there is fluorescence.
    pub light: MonteCarloResult,
    /// Emission traced forward.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fluorescence: Option<TracedEmission>,
    /// Emission by reciprocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reciprocity: Option<ReciprocalFluorescence>,
}

/// Fluorescence without what the excitation does, in photons per incident photon.
#[derive(Clone, Debug, Serialize)]
pub struct TracedEmission {
    /// What leaves through the surface.
    pub upward: Estimate,
    /// What leaves through the bottom.
    pub downward: Estimate,
    /// The part of each layer in what leaves through the surface.
    pub upward_by_layer: Vec<Estimate>,
    /// What leaves through the surface, by distance from the beam.
    pub rings: Vec<Ring>,
}

/// Traces photons through the layers of a tissue until all are traced or the job is stopped, and writes the results into the folder of the
/// options.
///
/// # Errors
/// An option out of its range or without a meaning, layers that can't be traced, a folder that can't be written.
pub fn monte_carlo(options: &MonteCarloOptions, job: &Job) -> Result<TracedTissue> {
    check_range("angle_deg", options.angle_deg, [0.0, 89.0], "degrees")?;
    check_range("radial_bins", options.radial_bins as f64, RADIAL_BINS, "")?;
    let layers = options.tissue.resolve()?;
    if options.reciprocity && layers.emission.is_none() {
        let message = "⟨reciprocity⟩: the layers do not fluoresce; give each a [layer.emission] table, or a site its ⟨emission_nm⟩";
        return Err(Error::Input(message.into()));
    }
    let settings = options.settings(&layers)?;
    let inputs: Vec<PathBuf> = options.tissue.file().into_iter().collect();
    let out =
        options.out.as_ref().map(|out| OutputFolder::prepare(out, &inputs, FOLDER_BYTES)).transpose()?;
    let thicknesses_mm: Vec<f64> = layers.stack.layers.iter().map(|layer| layer.thickness_mm).collect();
    let found = options.trace(layers, &settings, job)?;
    if let Some(out) = out {
        job.status(format!("Wrote {}", write(out, &found, &thicknesses_mm)?.display()));
    }
    Ok(found)
}

/// Writes all files of the results.
fn write(out: OutputFolder, found: &TracedTissue, thicknesses_mm: &[f64]) -> Result<PathBuf> {
    let mut files = vec![("results.json".to_string(), serde_json::to_string_pretty(found)?)];
    files.extend(tables(found).map(|(name, table)| (format!("{name}.csv"), table)));
    let figures = figures(found, thicknesses_mm);
    files.extend(figures.map(|(name, figure)| (format!("{name}.svg"), figure.to_svg())));
    Ok(out.finish_with(files.into_iter().map(|(name, text)| (name, text.into_bytes())))?)
}

impl MonteCarloOptions {
    fn settings(&self, layers: &ResolvedLayers) -> Result<MonteCarloSettings> {
        let quantity = match self.error_of.as_deref() {
            None if layers.emission.is_some() && !self.reciprocity => ScoredQuantity::Fluorescence,
            None => ScoredQuantity::DiffuseReflectance,
            Some(what) => quantity(what, layers)?,
        };
        let target = self
            .error
            .map(|relative_standard_error| StandardErrorTarget { quantity, relative_standard_error });
        let grid = ScoringGrid {
            depth_step_mm: self.depth_step_mm,
            depth_limit_mm: self.depth_limit_mm,
            radial_step_mm: self.radial_step_mm,
            radial_bins: self.radial_bins,
        };
        Ok(MonteCarloSettings { seed: self.seed, photons: self.photons, target, grid })
    }

    fn trace(
        &self,
        layers: ResolvedLayers,
        settings: &MonteCarloSettings,
        job: &Job,
    ) -> Result<TracedTissue> {
        let incidence = match self.diffuse {
            true => Incidence::Lambertian,
            false => Incidence::Collimated { cosine: self.angle_deg.to_radians().cos() },
        };
        let angle_deg = (!self.diffuse).then_some(self.angle_deg);
        let found = |light| TracedTissue {
            title: layers.title,
            layers: layers.names,
            angle_deg,
            emission_nm: self.tissue.emission_nm,
            light,
            fluorescence: None,
            reciprocity: None,
        };
        let stack = &layers.stack;
        let Some(emission) = layers.emission else {
            return Ok(found(with_progress(job, |control| simulate(stack, incidence, settings, control))?));
        };
        let strengths = &emission.strengths_per_mm;
        if self.reciprocity {
            let light = with_progress(job, |control| simulate(stack, incidence, settings, control))?;
            // Another seed: the errors of the two fluences shall be independent.
            let other = MonteCarloSettings { seed: settings.seed ^ (1 << 62), ..*settings };
            let diffuse = with_progress(job, |control| {
                simulate(&emission.stack, Incidence::Lambertian, &other, control)
            })?;
            let reciprocity = fluorescence_by_reciprocity(&light, &diffuse, strengths)?;
            return Ok(TracedTissue { reciprocity: Some(reciprocity), ..found(light) });
        }
        let FluorescenceResult { excitation, upward, downward, upward_by_layer, rings } =
            with_progress(job, |control| {
                simulate_fluorescence(stack, &emission.stack, strengths, incidence, settings, control)
            })?;
        let fluorescence = Some(TracedEmission { upward, downward, upward_by_layer, rings });
        Ok(TracedTissue { fluorescence, ..found(excitation) })
    }
}

/// The result that an error target names.
fn quantity(what: &str, layers: &ResolvedLayers) -> Result<ScoredQuantity> {
    if let Some(layer) = layers.names.iter().position(|name| name == what) {
        return Ok(ScoredQuantity::Absorbed(layer));
    }
    match what {
        "reflectance" => Ok(ScoredQuantity::DiffuseReflectance),
        "transmittance" => Ok(ScoredQuantity::Transmittance),
        "fluorescence" => Ok(ScoredQuantity::Fluorescence),
        _ => {
            let shares = ["reflectance", "transmittance", "fluorescence"];
            let known: Vec<&str> =
                shares.into_iter().chain(layers.names.iter().map(String::as_str)).collect();
            let hint = did_you_mean(what, known.iter().copied());
            let known = known.join(", ");
            Err(Error::Input(format!("⟨error_of={what}⟩: there is no such result{hint} Known: {known}")))
        }
    }
}

/// Runs a simulation that ends with what it has when the job is stopped, and reports how far it has come.
fn with_progress<R>(
    job: &Job,
    simulation: impl FnOnce(&MonteCarloControl<'_>) -> Result<R, TissueError>,
) -> Result<R> {
    let share_done = job.listener.begin("Tracing", "tracing", Left::Results);
    Ok(simulation(&MonteCarloControl {
        stop: &job.stop,
        progress: &|progress| share_done(progress.photons_done as f64 / progress.photons_total as f64),
    })?)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread;

    use fluorspar::tissue::monte_carlo::Ending;
    use fluorspar_experiment::Warning;

    use super::super::source::SiteOptions;
    use super::*;
    use crate::Listener;

    /// Hears nothing.
    struct Silent;

    impl Listener for Silent {
        fn status(&self, _: &str) {}
        fn warnings(&self, _: &[Warning]) {}
        fn begin(&self, _: &'static str, _: &'static str, _: Left) -> Box<dyn Fn(f64) + Sync> {
            Box::new(|_| {})
        }
    }

    /// Photons in the lip, in a pool of one thread.
    fn traced(photons: u64, stop: &Arc<AtomicBool>) -> Result<TracedTissue> {
        let tissue = TissueOptions {
            site: SiteOptions { site: "lip".into(), ..SiteOptions::default() },
            excitation_nm: Some(405.0),
            ..TissueOptions::default()
        };
        let options = MonteCarloOptions { tissue, photons, ..defaults() };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        pool.install(|| monte_carlo(&options, &Job::new(stop.clone(), Arc::new(Silent))))
    }

    #[test]
    fn a_task_that_is_stopped_stops_no_other() {
        let running = Arc::default();
        let alone = traced(2000, &running).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let (ended, other) = thread::scope(|scope| {
            let endless = scope.spawn(|| traced(1_000_000_000, &stop));
            let other = scope.spawn(|| traced(2000, &running)).join().unwrap().unwrap();
            stop.store(true, Ordering::SeqCst);
            (endless.join().unwrap(), other)
        });
        // It was stopped before its first photon or after
        assert!(ended.is_err() || ended.is_ok_and(|traced| traced.light.ending == Ending::Interrupted));
        assert_eq!(serde_json::to_value(&other).unwrap(), serde_json::to_value(alone).unwrap());
        assert_eq!(other.light.ending, Ending::Photons);
    }

    #[test]
    fn defaults_stand_at_the_options() {
        let options: MonteCarloOptions = defaults();
        assert_eq!((options.photons, options.radial_bins, options.depth_step_mm), (1_000_000, 500, 0.01));
        let known = <MonteCarloOptions as crate::TaskOptions>::known();
        let state = known.iter().find(|option| option.name == "state").unwrap();
        assert!(state.is_list && state.is_text && known.iter().any(|option| option.name == "angle_deg"));
    }
}
