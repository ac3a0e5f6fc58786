//! The file that says which frames are what.

use std::path::{Path, PathBuf};

use fluorspar::names::did_you_mean;
use fluorspar::pipeline::KnownTarget;
use fluorspar::spectral::{Curve, Fluorophore};
use fluorspar::study::Study;
use fluorspar_experiment::preset;
use fluorspar_experiment::schema::FormatVersion;
use fluorspar_format::{Negative, SpectrumQuantity, read_toml};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::fluorophore::{FileOptions, load};
use crate::named_spectra::{is_file, light, one_column};
use crate::options::defaults;
use crate::photographs::files_below;
use crate::source::read_text;
use crate::{Error, Job, Result};

/// A file, a folder of files, or a list of files, relative to the file that names them.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
enum Files {
    One(PathBuf),
    Many(Vec<PathBuf>),
}

/// A number, or the name of a spectrum of the catalogue or its CSV file.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
enum NumberOrName {
    Number(f64),
    Name(String),
}

/// A file of `fluorspar calibrate`: which frames of a camera are what.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibrationText {
    /// Version of the form: 1.
    #[serde(rename = "format")]
    _format: FormatVersion,
    /// Name of the camera. Default: that of the file.
    #[serde(default)]
    title: String,
    /// Experiment that describes the camera before it is calibrated: name or file.
    experiment: String,
    /// Frames without light, several of each exposure time.
    dark: Files,
    /// Frames of even light, several of each exposure time.
    flat: Files,
    /// Frames of known targets.
    #[serde(default)]
    target: Vec<TargetText>,
}

/// A known target: what it reflects under a light of the camera, or what it sends by itself.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct TargetText {
    /// Its name.
    name: String,
    /// Its frames.
    frames: Files,
    /// Capture of the experiment under whose light they were taken.
    capture: String,
    /// Diffuse reflectance, 0 to 1, or a spectrum.
    reflectance: Option<NumberOrName>,
    /// What a fluorescent reference has on it: a fluorophore of the catalogue, or of a file that `fluorophore import` wrote.
    fluorophore: Option<String>,
    /// Its concentration, above 0. Default 1.
    #[schemars(range(min = 0))]
    concentration: Option<f64>,
    /// Spectrum of a light source, instead of `reflectance`.
    spectrum: Option<String>,
    /// Radiance of the light source over all wavelengths, W/(sr m2). Default: not known, so that only the balance of channels is told.
    radiance_w_per_sr_m2: Option<f64>,
    /// Standard error of what is known, percent, 0 to 100.
    #[schemars(range(min = 0, max = 100))]
    uncertainty_percent: f64,
    /// Whether the viewing filter is before the lens. Default true.
    #[serde(default = "in_place")]
    viewing_filter: bool,
    /// Column, row, width and height of its pixels. Default: the middle ninth of the frame.
    region_px: Option<[usize; 4]>,
}

fn in_place() -> bool {
    true
}

/// A known target and its frames.
#[derive(Clone, Debug)]
pub(super) struct Target {
    pub(super) name: String,
    pub(super) files: Vec<PathBuf>,
    pub(super) capture: String,
    pub(super) known: KnownTarget,
    /// Relative standard error.
    pub(super) uncertainty: f64,
    pub(super) has_filters: bool,
    /// Column, row, width, height.
    pub(super) region_px: Option<[usize; 4]>,
}

/// Which frames are what, with paths as the working folder has them.
#[derive(Clone, Debug)]
pub(super) struct CalibrationFile {
    pub(super) title: String,
    /// Name or file of the experiment.
    pub(super) experiment: String,
    pub(super) dark: Vec<PathBuf>,
    pub(super) flat: Vec<PathBuf>,
    pub(super) targets: Vec<Target>,
}

impl CalibrationFile {
    pub(super) fn read(path: &Path, job: &Job) -> Result<Self> {
        let wrong = |why: String| Error::Input(format!("{}: {why}", path.display()));
        let text = read_text(path)?;
        let file: CalibrationText = read_toml(&text).map_err(|error| wrong(error.to_string()))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let beside = folder.join(&file.experiment);
        let experiment = if beside.is_file() { beside.display().to_string() } else { file.experiment };
        let target = |text: &TargetText| {
            let about = |why: String| wrong(format!("target \"{}\": {why}", text.name));
            Ok(Target {
                name: text.name.clone(),
                files: listed(folder, &text.frames, "frames").map_err(about)?,
                capture: text.capture.clone(),
                known: known(text, folder, job)?.map_err(about)?,
                uncertainty: within(text.uncertainty_percent, [0.0, 100.0], "uncertainty_percent")
                    .map_err(about)?
                    * 1e-2,
                has_filters: text.viewing_filter,
                region_px: text.region_px,
            })
        };
        Ok(Self {
            title: file.title,
            experiment,
            dark: listed(folder, &file.dark, "dark").map_err(wrong)?,
            flat: listed(folder, &file.flat, "flat").map_err(wrong)?,
            targets: file.target.iter().map(target).collect::<Result<_>>()?,
        })
    }

    /// Refuses targets of captures that the experiment does not have.
    pub(super) fn check(&self, study: &Study, path: &Path) -> Result<()> {
        let known: Vec<&str> = study.captures.iter().map(|capture| capture.frame.label.as_str()).collect();
        match self.targets.iter().find(|target| !known.contains(&target.capture.as_str())) {
            Some(target) => Err(Error::Input(format!(
                "{}: target \"{}\": the experiment has no capture \"{}\"{} Its captures are {}",
                path.display(),
                target.name,
                target.capture,
                did_you_mean(&target.capture, known.iter().copied()),
                known.join(", ")
            ))),
            None => Ok(()),
        }
    }

    /// All frames.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        let of_targets = self.targets.iter().flat_map(|target| &target.files);
        self.dark.iter().chain(&self.flat).chain(of_targets)
    }
}

fn within(value: f64, [least, most]: [f64; 2], field: &str) -> Result<f64, String> {
    match (least..=most).contains(&value) {
        true => Ok(value),
        false => Err(format!("{field} = {value} is outside {least} to {most}")),
    }
}

/// The files of a list, or those below a folder.
fn listed(folder: &Path, files: &Files, field: &str) -> Result<Vec<PathBuf>, String> {
    let given: Vec<PathBuf> = match files {
        Files::One(path) => vec![folder.join(path)],
        Files::Many(paths) => paths.iter().map(|path| folder.join(path)).collect(),
    };
    let mut all = Vec::new();
    for path in given {
        match path.is_dir() {
            true => all.extend(files_below(&path)),
            false if path.is_file() => all.push(path),
            false => {
                return Err(format!(
                    "{field}: there is no file or folder {}; put the frames there, or write where they are",
                    path.display()
                ));
            }
        }
    }
    let count = all.len();
    all.sort();
    all.dedup();
    match all.len() {
        0 => Err(format!("{field}: there are no frames (DNG, TIFF or PNG with its description) here")),
        distinct if distinct < count => {
            Err(format!("{field}: a file is named twice; each frame counts once"))
        }
        _ => Ok(all),
    }
}

/// What is known of a target. The outer error is that of a file.
fn known(text: &TargetText, folder: &Path, job: &Job) -> Result<Result<KnownTarget, String>> {
    let named =
        |name: &str| if is_file(name) { folder.join(name).display().to_string() } else { name.to_owned() };
    let wrong = |why: &str| Ok(Err(why.to_owned()));
    let reflectance = match (&text.reflectance, &text.spectrum, text.radiance_w_per_sr_m2) {
        (Some(NumberOrName::Number(value)), None, None) => match within(*value, [1e-3, 1.0], "reflectance") {
            Ok(value) => Curve::constant(value),
            Err(why) => return Ok(Err(why)),
        },
        (Some(NumberOrName::Name(name)), None, None) if is_file(name) => {
            one_column(&named(name), SpectrumQuantity::Fraction, Negative::Refuse, job)?
        }
        (Some(NumberOrName::Name(name)), None, None) => preset::reflectance(name)?.curve(),
        (None, Some(spectrum), radiance) if text.fluorophore.is_none() => {
            let curve = light(&named(spectrum), job)?;
            let scale = radiance.unwrap_or(1.0) / curve.total();
            if !(scale > 0.0 && scale.is_finite()) {
                return wrong("radiance_w_per_sr_m2 must be above 0");
            }
            return Ok(Ok(KnownTarget::Source {
                radiance: curve.scaled(scale),
                is_absolute: radiance.is_some(),
            }));
        }
        _ => {
            return wrong(
                "give what is known of it: `reflectance` of a tile (a number, a name of the catalogue or a CSV file), with its `fluorophore` if it \
                 has one, or `spectrum` of a source, with `radiance_w_per_sr_m2` if that was measured",
            );
        }
    };
    let of_file = text.fluorophore.as_deref().map(named);
    Ok(fluorophore(of_file, text.concentration)?
        .map(|fluorophore| KnownTarget::Tile { reflectance, fluorophore }))
}

/// What a tile fluoresces with, and its concentration.
fn fluorophore(
    name: Option<String>,
    concentration: Option<f64>,
) -> Result<Result<Option<(Fluorophore, f64)>, String>> {
    let wrong = |why: &str| Ok(Err(why.to_owned()));
    let Some(name) = name else {
        return match concentration {
            None => Ok(Ok(None)),
            Some(_) => wrong("concentration: of which `fluorophore`? Give one, or leave this out"),
        };
    };
    let concentration = concentration.unwrap_or(1.0);
    if !(concentration > 0.0 && concentration <= 1e6) {
        return wrong("concentration must be above 0, and 1e6 at most");
    }
    if is_file(&name) && Path::new(&name).extension().is_none_or(|ending| ending != "toml") {
        return wrong(
            "fluorophore: measured values tell no yield; write them with theirs as a file by `fluorspar fluorophore import`, and give that",
        );
    }
    let mut found = load(&name, &defaults::<FileOptions>())?;
    match (found.len(), found.pop()) {
        (1, Some(found)) => Ok(Ok(Some((found.fluorophore, concentration)))),
        _ => wrong("the file of its `fluorophore` has several; give a file of one"),
    }
}
