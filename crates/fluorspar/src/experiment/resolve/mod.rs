//! From the sections of an experiment to scene, lens, sensor, captures and analysis.

mod capture;
pub(super) mod context;
pub(super) mod device;
mod lesion;
mod light;
pub(super) mod material;
mod object;
pub(super) mod spectrum;

use std::path::PathBuf;

use sha2::{Digest, Sha256};

use self::context::{Context, Resolved, hex};
use super::error::{Step, steps};
use super::schema::ExperimentFile;
use super::{Experiment, ExperimentError};
use crate::optics::IdealLens;
use crate::render::{RenderSettings, memory_bytes};
use crate::scene::{Scene, SceneError};
use crate::sensor::{CaptureFrame, CaptureSequence, Sensor};
use crate::spectral::Curve;

/// An experiment ready to run.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedExperiment {
    /// Name for people.
    pub title: String,
    /// What the experiment shows.
    pub description: String,
    /// The scene, checked.
    pub scene: Scene,
    /// Effort, seed and memory limit of the render.
    pub render: RenderSettings,
    /// Seconds after which to stop rendering.
    pub time_limit_s: Option<f64>,
    /// Transmittance of the filters in front of the lens; part of `lens.transmittance`, too.
    pub view_filter: Curve,
    /// The lens with the viewing filters; `None` in a file that describes a scene only.
    pub lens: Option<IdealLens>,
    /// The sensor; `None` in a file that describes a scene only.
    pub sensor: Option<Sensor>,
    /// Exposures, in order.
    pub captures: Vec<Capture>,
    /// What to compute from them.
    pub analysis: Option<ResolvedAnalysis>,
    /// Folder for the results, if the file names one.
    pub output_folder: Option<PathBuf>,
    /// What a user should know.
    pub warnings: Vec<String>,
    /// Files that were read, with their digests.
    pub inputs: Vec<InputFile>,
    /// The complete experiment as a file: base, overrides and defaults written out, paths absolute. Reading it
    /// gives the same experiment and the same `sha256`.
    pub resolved_toml: String,
    /// Digest of everything that decides the result: the resolved file without title, description and output, the
    /// contents (not the places) of all files it names, and the entries of the catalogue in use.
    pub sha256: String,
}

/// One exposure.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Lights, time and gain.
    pub frame: CaptureFrame,
    /// Label of the earlier frame whose image is subtracted.
    pub subtract: Option<String>,
}

/// What to compute from the captures.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedAnalysis {
    /// Label of the frame that is analysed.
    pub frame: String,
    /// Names of the parts that form the region of interest; empty means all.
    pub parts: Vec<String>,
    /// Rectangle of the sensor: column, row, width, height.
    pub rectangle_px: Option<[u32; 4]>,
    /// Name of the porphyrin.
    pub porphyrin: String,
    /// Fluorophores that form the bulk, with their amounts.
    pub bulk: Vec<(String, f64)>,
    /// Least channel sum that has a chromaticity, in standard deviations of its noise.
    pub noise_threshold: f64,
}

/// A file that an experiment reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputFile {
    /// Where it is.
    pub path: PathBuf,
    /// Digest of its content.
    pub sha256: String,
}

impl ResolvedExperiment {
    /// The frames of all captures.
    pub fn capture_sequence(&self) -> CaptureSequence {
        CaptureSequence { frames: self.captures.iter().map(|capture| capture.frame.clone()).collect() }
    }
}

impl Context<'_> {
    /// Checks that an entry of a list has a name, and one of its own.
    pub(super) fn unique_name<'n>(
        &self,
        at: &[Step],
        name: &str,
        earlier: impl IntoIterator<Item = &'n str>,
    ) -> Resolved<()> {
        let at = [at, &steps!["name"]].concat();
        if name.trim().is_empty() {
            return self.fail(&at, "must not be empty");
        }
        if earlier.into_iter().any(|other| other == name) {
            return self.fail(&at, "an earlier entry has this name; every entry needs its own");
        }
        Ok(())
    }
}

/// Turns the sections of an experiment into scene, lens, sensor, captures and analysis, and checks everything that can
/// be checked before rendering. Reads the files that the experiment names and makes the mouth.
///
/// # Errors
/// The first defect found.
pub fn resolve(experiment: &Experiment) -> Result<ResolvedExperiment, ExperimentError> {
    let file = &experiment.file;
    let mut context = Context::new(&experiment.document);
    let context = &mut context;

    let grid = device::grid(context, &file.spectral)?;
    let render = device::render_settings(context, &file.render)?;
    device::check_camera(context, &file.camera)?;
    let sensor = match &file.sensor {
        Some(section) => Some(device::sensor(context, section, &grid)?),
        None => None,
    };
    let view_filter = device::view_filter(context, &file.view_filter, &grid)?;
    let lens = match &file.lens {
        Some(section) => {
            let distance_mm = Some(file.camera.distance_mm());
            Some(device::lens(context, section, distance_mm, &view_filter, &grid)?)
        }
        None => None,
    };
    let camera = device::camera(context, file, lens.as_ref(), sensor.as_ref())?;

    let mut light_groups = Vec::new();
    let lights = light::lights(context, &file.light, &camera, &grid, &mut light_groups)?;
    material::check_sections(context, &file.fluorophore)?;
    let mut fluorophores = material::Fluorophores::default();
    let mut materials = material::materials(context, file, &grid, &mut fluorophores)?;
    let objects =
        object::objects(context, file, &mut materials, &mut fluorophores, &grid, &mut light_groups)?;
    let captures = capture::captures(context, file, &light_groups)?;
    let analysis = capture::analysis(context, file, &captures, &objects)?;

    let scene =
        Scene { grid, objects, materials, fluorophores: fluorophores.list, light_groups, lights, camera };
    scene.check().map_err(|error| scene_error(context, file, &error))?;
    device::check_memory(context, file, memory_bytes(&scene))?;
    warn_unused(context, file, &scene);
    for warning in scene.warnings() {
        context.push_warning(warning.to_string());
    }

    let (resolved_toml, sha256) = write_out(context, file)?;
    Ok(ResolvedExperiment {
        title: file.title.clone(),
        description: file.description.clone(),
        scene,
        render,
        time_limit_s: file.render.time_limit_s,
        view_filter,
        lens,
        sensor,
        captures,
        analysis,
        output_folder: file.output.folder.as_ref().map(PathBuf::from),
        warnings: std::mem::take(&mut context.warnings),
        inputs: std::mem::take(&mut context.inputs),
        resolved_toml,
        sha256,
    })
}

/// Puts an error of the finished scene where it belongs in the file.
fn scene_error(context: &Context<'_>, file: &ExperimentFile, error: &SceneError) -> ExperimentError {
    match error {
        SceneError::CreatesPhotons { material, .. } => {
            let index = file.material.iter().position(|section| section.name == *material).unwrap_or(0);
            context.error(&steps!["material", index], error.to_string()).without_value()
        }
        SceneError::Mesh { object, .. } => {
            match file.object.iter().position(|section| section.name == *object) {
                Some(index) => context.error(&steps!["object", index], error.to_string()),
                None => context.error(&steps!["mouth"], error.to_string()),
            }
        }
        SceneError::Nothing(what) => {
            let section = if *what == "lights" { "a [[light]]" } else { "an [[object]] or a [mouth]" };
            context.error(&[], format!("{error}; add {section} section"))
        }
        _ => context.error(&[], error.to_string()),
    }
}

fn warn_unused(context: &mut Context<'_>, file: &ExperimentFile, scene: &Scene) {
    for (index, material) in scene.materials.iter().enumerate() {
        if !scene.objects.iter().any(|object| object.material == index) {
            context
                .warn(&steps!["material", index], format!("no object uses material \"{}\"", material.name));
        }
    }
    for (index, section) in file.fluorophore.iter().enumerate() {
        if !scene.fluorophores.iter().any(|fluorophore| fluorophore.name == section.name) {
            context.warn(&steps!["fluorophore", index], "no material contains it");
        }
    }
}

/// The resolved file and its digest.
fn write_out(context: &Context<'_>, file: &ExperimentFile) -> Resolved<(String, String)> {
    let mut complete = file.clone();
    complete.base = None;
    complete.spectral.fill();
    for light in &mut complete.light {
        light.group.get_or_insert_with(|| light.name.clone());
    }
    if let Some(lens) = &mut complete.lens {
        lens.focus_distance_mm.get_or_insert(complete.camera.distance_mm());
    }
    if let Some(sensor) = &mut complete.sensor {
        sensor.model = device::filled(&sensor.model);
    }
    let failed =
        |error: toml::ser::Error| context.error(&[], format!("the experiment can't be written out: {error}"));
    let text = toml::to_string(&complete).map_err(failed)?;

    complete.title.clear();
    complete.description.clear();
    complete.output = super::schema::OutputSection::default();
    let mut value = toml::Value::try_from(&complete).map_err(failed)?;
    replace_paths(&mut value, context);
    let mut digest = Sha256::new();
    digest.update(toml::to_string(&value).map_err(failed)?.as_bytes());
    context.digest_presets(&mut digest);
    Ok((text, hex(&digest.finalize())))
}

/// Puts the digest of a file where its path stands: the same experiment elsewhere is the same experiment.
pub(super) fn replace_paths(value: &mut toml::Value, context: &Context<'_>) {
    match value {
        toml::Value::String(text) => {
            if let Some(input) = context.inputs.iter().find(|input| input.path.as_os_str() == text.as_str()) {
                *text = format!("sha256:{}", input.sha256);
            }
        }
        toml::Value::Array(items) => items.iter_mut().for_each(|item| replace_paths(item, context)),
        toml::Value::Table(table) => table.iter_mut().for_each(|(_, item)| replace_paths(item, context)),
        _ => {}
    }
}
