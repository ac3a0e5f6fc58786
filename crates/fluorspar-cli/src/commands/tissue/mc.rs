//! `fluorspar tissue mc`.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueHint;
use fluorspar::names::did_you_mean;
use fluorspar::tissue::monte_carlo::{
    Estimate, FluorescenceResult, MonteCarloControl, MonteCarloResult, MonteCarloSettings,
    ReciprocalFluorescence, Ring, ScoredQuantity, ScoringGrid, StandardErrorTarget,
    fluorescence_by_reciprocity, simulate, simulate_fluorescence,
};
use fluorspar::tissue::{Incidence, TissueError};
use fluorspar_experiment::ResolvedLayers;
use fluorspar_format::{OutputFolder, write_atomically};
use serde::Serialize;

use super::mc_output::{describe, figures, tables};
use super::source::TissueArgs;
use crate::args::Answer;
use crate::commands::{print_json, print_text};
use crate::error::{CliError, STOPPED};
use crate::interrupt::{Left, STOP, interrupted, save_when_interrupted};
use crate::message::Messages;
use crate::progress::WorkReport;
use crate::values::{self, check_range};

/// Most photons of a simulation.
const MOST_PHOTONS: u64 = 1_000_000_000_000;
/// Two tables of at most fifty thousand lines, two figures and the results.
const FOLDER_BYTES: u64 = 64 << 20;

/// Options of `tissue mc`.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct Options {
    #[command(flatten)]
    tissue: TissueArgs,
    /// Angle of the incident beam to the normal, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = values::number, allow_negative_numbers = true)]
    angle_deg: f64,
    /// Diffuse light, the same from all directions above, instead of a beam.
    #[arg(long, conflicts_with = "angle_deg")]
    diffuse: bool,
    /// Photons to trace; with `--error` the most.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = values::whole::<u64, 1, MOST_PHOTONS>,
        allow_negative_numbers = true)]
    photons: u64,
    /// Stop once the standard error of one result is below this share of it, for instance 0.001.
    #[arg(long, value_name = "E", value_parser = values::number, allow_negative_numbers = true)]
    error: Option<f64>,
    /// The result that `--error` is about: reflectance, transmittance, fluorescence, or the absorption of the layer of this
    /// name [default: fluorescence where the file has it, else reflectance].
    #[arg(long, value_name = "WHAT", requires = "error")]
    error_of: Option<String>,
    /// Seed of the random numbers: the same one gives the same results, whatever the number of threads.
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = values::seed, allow_negative_numbers = true)]
    seed: u64,
    /// Find the fluorescence from the fluences of both wavelengths, by reciprocity, instead of tracing it: it is less noisy,
    /// but without distances from the beam.
    #[arg(long)]
    reciprocity: bool,
    /// Largest width of bins of depth, mm; every layer has its own bins.
    #[arg(long, value_name = "MM", default_value_t = 0.01, value_parser = values::number, allow_negative_numbers = true)]
    depth_step_mm: f64,
    /// Depth to which fluence is scored, mm.
    #[arg(long, value_name = "MM", default_value_t = 5.0, value_parser = values::number, allow_negative_numbers = true)]
    depth_limit_mm: f64,
    /// Width of the rings around the beam in which leaving light is scored, mm.
    #[arg(long, value_name = "MM", default_value_t = 0.02, value_parser = values::number, allow_negative_numbers = true)]
    radial_step_mm: f64,
    /// Number of rings.
    #[arg(long, value_name = "N", default_value_t = 500, value_parser = values::whole::<usize, 1, 20_000>,
        allow_negative_numbers = true)]
    radial_bins: usize,
    /// Folder for results.json, radius.csv, depth.csv and the figures radius.svg and depth.svg [default: none].
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    out: Option<PathBuf>,
    #[command(flatten)]
    answer: Answer,
}

/// What was found, as `--json` and results.json have it.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Found {
    /// Name for people; may be empty.
    pub(super) title: String,
    /// Names of the layers.
    pub(super) layers: Vec<String>,
    /// Whether the light was diffuse, else a beam at this angle, degrees.
    pub(super) angle_deg: Option<f64>,
    /// Wavelength at which the fluorescence is per nm; without it the fluorescence is that of the whole emission.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) emission_nm: Option<f64>,
    /// At the excitation, where there is fluorescence.
    pub(super) light: MonteCarloResult,
    /// Emission traced forward.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) fluorescence: Option<Emission>,
    /// Emission by reciprocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) reciprocity: Option<ReciprocalFluorescence>,
}

/// Fluorescence without what the excitation does.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Emission {
    /// In photons per incident photon.
    pub(super) upward: Estimate,
    pub(super) downward: Estimate,
    pub(super) upward_by_layer: Vec<Estimate>,
    pub(super) rings: Vec<Ring>,
}

pub(super) fn run(options: &Options) -> Result<ExitCode, CliError> {
    check_range("--angle-deg", options.angle_deg, [0.0, 89.0], "degrees")?;
    let layers = options.tissue.resolve()?;
    if options.reciprocity && layers.emission.is_none() {
        let message = "--reciprocity: the layers do not fluoresce; give each a [layer.emission] table, or a site its --emission-nm";
        return Err(CliError::Input(message.into()));
    }
    let settings = options.settings(&layers)?;
    let inputs: Vec<PathBuf> = options.tissue.file().into_iter().collect();
    let out =
        options.out.as_ref().map(|out| OutputFolder::prepare(out, &inputs, FOLDER_BYTES)).transpose()?;
    let found = options.trace(layers.clone(), &settings)?;
    let place = out.map(|out| write(out, &found, &layers)).transpose()?;
    if options.answer.json {
        print_json(&found)?;
    } else {
        print_text(&describe(&found, &layers))?;
    }
    if let Some(place) = place {
        Messages::default().status(format!("Wrote {}", place.display()));
    }
    Ok(if interrupted() { ExitCode::from(STOPPED) } else { ExitCode::SUCCESS })
}

/// Writes all files of the results.
fn write(out: OutputFolder, found: &Found, layers: &ResolvedLayers) -> Result<PathBuf, CliError> {
    let results = serde_json::to_string_pretty(found)?;
    let mut files = vec![("results.json".to_string(), results)];
    files.extend(tables(found).map(|(name, table)| (format!("{name}.csv"), table)));
    files.extend(figures(found, layers).map(|(name, figure)| (format!("{name}.svg"), figure.to_svg())));
    for (name, text) in files {
        write_atomically(&out.path().join(name), |file| file.write_all(text.as_bytes()))
            .map_err(|error| out.at_its_place(error))?;
    }
    Ok(out.finish()?)
}

impl Options {
    fn settings(&self, layers: &ResolvedLayers) -> Result<MonteCarloSettings, CliError> {
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

    fn trace(&self, layers: ResolvedLayers, settings: &MonteCarloSettings) -> Result<Found, CliError> {
        let incidence = match self.diffuse {
            true => Incidence::Lambertian,
            false => Incidence::Collimated { cosine: self.angle_deg.to_radians().cos() },
        };
        let messages = Messages::default();
        let angle_deg = (!self.diffuse).then_some(self.angle_deg);
        let found = |light| Found {
            title: layers.title,
            layers: layers.names,
            angle_deg,
            emission_nm: self.tissue.emission_nm(),
            light,
            fluorescence: None,
            reciprocity: None,
        };
        let stack = &layers.stack;
        let Some(emission) = layers.emission else {
            return Ok(found(with_progress(messages, |control| {
                simulate(stack, incidence, settings, control)
            })?));
        };
        let strengths = &emission.strengths_per_mm;
        if self.reciprocity {
            let light = with_progress(messages, |control| simulate(stack, incidence, settings, control))?;
            // Another seed: the errors of the two fluences shall be independent.
            let other = MonteCarloSettings { seed: settings.seed ^ (1 << 62), ..*settings };
            let diffuse = with_progress(messages, |control| {
                simulate(&emission.stack, Incidence::Lambertian, &other, control)
            })?;
            let reciprocity = fluorescence_by_reciprocity(&light, &diffuse, strengths)?;
            return Ok(Found { reciprocity: Some(reciprocity), ..found(light) });
        }
        let FluorescenceResult { excitation, upward, downward, upward_by_layer, rings } =
            with_progress(messages, |control| {
                simulate_fluorescence(stack, &emission.stack, strengths, incidence, settings, control)
            })?;
        let fluorescence = Some(Emission { upward, downward, upward_by_layer, rings });
        Ok(Found { fluorescence, ..found(excitation) })
    }
}

/// The result that an error target names.
fn quantity(what: &str, layers: &ResolvedLayers) -> Result<ScoredQuantity, CliError> {
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
            Err(CliError::Input(format!("--error-of {what}: there is no such result{hint} Known: {known}")))
        }
    }
}

/// Runs a simulation that Ctrl-C ends with what it has, and reports how far it has come.
fn with_progress<R>(
    messages: Messages,
    simulation: impl FnOnce(&MonteCarloControl<'_>) -> Result<R, TissueError>,
) -> Result<R, CliError> {
    save_when_interrupted(Left::Results);
    let report = WorkReport::begin("Tracing", "tracing", messages);
    let control = MonteCarloControl {
        stop: &STOP,
        progress: &|progress| report.share_done(progress.photons_done as f64 / progress.photons_total as f64),
    };
    let result = simulation(&control);
    report.end();
    Ok(result?)
}
