//! From the sections of an experiment to scene, lens, sensor, captures and analysis.

mod capture;
pub(super) mod context;
pub(super) mod device;
mod error_target;
mod instrument;
mod lesion;
mod light;
pub(super) mod material;
mod object;
pub(super) mod spectrum;
mod surface_mean;

use std::path::PathBuf;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use self::context::{Context, Resolved, hex};
use super::error::{Place, steps};
use super::schema::{ExperimentFile, LensType, MotionSection, SafetySection};
use super::{Experiment, ExperimentError};
use crate::optics::{CameraLens, FilterStack, IdealLens};
use crate::render::{RenderSettings, memory_bytes, tile_row_bytes, whole_image_bytes};
use crate::scene::{Scene, SceneError};
use crate::sensor::{CaptureFrame, CaptureSequence, Demosaicing, Sensor, Spectroradiometer};
use crate::spectral::{Curve, Fluorophore};

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
    /// The filters in front of the lens or behind it, one by one.
    pub view_filters: FilterStack,
    /// Whether the field of view of the camera is that of the lens and the sensor.
    pub field_from_lens: bool,
    /// The lens with the viewing filters; `None` in a file that describes a scene only. Of a traced lens its camera
    /// equation: focal length, f-number, magnification and the traced solid angle.
    pub lens: Option<IdealLens>,
    /// The rays of a traced lens. A render goes through it where the scene's camera holds it, too.
    pub traced_lens: Option<Arc<CameraLens>>,
    /// The sensor; `None` in a file that describes a scene only.
    pub sensor: Option<Sensor>,
    /// Exposures, in order.
    pub captures: Vec<Capture>,
    /// Motion of the image between exposures.
    pub motion: Option<MotionSection>,
    /// How raw frames become linear channels.
    pub develop: ResolvedDevelop,
    /// Spectroradiometers.
    pub spectroradiometers: Vec<ResolvedSpectroradiometer>,
    /// Distances for the safety assessment.
    pub safety: SafetySection,
    /// Distance from the camera to the point that it looks at, mm.
    pub camera_distance_mm: f64,
    /// What to compute from them.
    pub analysis: Option<ResolvedAnalysis>,
    /// Folder for the results, if the file names one.
    pub output_folder: Option<PathBuf>,
    /// What a user should know.
    pub warnings: Vec<String>,
    /// Files that were read, with their digests.
    pub inputs: Vec<InputFile>,
    /// Files of base experiments that were read; they are part of `resolved_toml`.
    pub base_files: Vec<PathBuf>,
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
    /// Filters in front of the sensor in this capture only, multiplied.
    pub filter: Option<Curve>,
    /// Further exposures, in stops from the first, that are merged with it.
    pub bracket_ev: Vec<f64>,
    /// How long the lights are on, ms, if it is not the time of the exposures.
    pub light_on_ms: Option<f64>,
}

/// How raw frames become linear channels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ResolvedDevelop {
    /// Interpolation of the colours.
    pub demosaicing: Demosaicing,
    /// Dark frames for each exposure time and gain; none are taken if 0.
    pub dark_frames: u32,
    /// Flat field.
    pub flat_field: Option<FlatFieldPlan>,
    /// Robust standard deviations from which a pixel counts as bad.
    pub bad_pixel_sigma: Option<f64>,
}

/// Frames of even light.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatFieldPlan {
    /// Frames averaged.
    pub frames: u32,
    /// Signal of the brightest channel on the axis, share of full scale.
    pub level: f64,
    /// Spectrum of the light, any scale.
    pub spectrum: Curve,
}

/// A spectroradiometer and what it looks at.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedSpectroradiometer {
    /// Name.
    pub name: String,
    /// The frame whose lights are on.
    pub frame: CaptureFrame,
    /// What it looks at.
    pub target: SpotOrParts,
    /// The instrument with its filters.
    pub instrument: Spectroradiometer,
}

/// What a spectroradiometer looks at.
#[derive(Clone, Debug, PartialEq)]
pub enum SpotOrParts {
    /// A round spot.
    Spot {
        /// Its middle, from the left and the top edge of the picture, 0 to 1.
        aim: [f64; 2],
        /// Its full angle, degrees.
        acceptance_deg: f64,
    },
    /// All pixels that show these parts.
    Parts(Vec<String>),
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
    /// Those of these fluorophores that no material of the scene holds: their responses are predicted as well.
    pub absent_fluorophores: Vec<Fluorophore>,
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
        at: &Place,
        name: &str,
        earlier: impl IntoIterator<Item = &'n str>,
    ) -> Resolved<()> {
        let at = at.field("name");
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
    let mut render = device::render_settings(context, &file.render)?;
    device::check_camera(context, &file.camera)?;
    let sensor = match &file.sensor {
        Some(section) => Some(device::sensor(context, section, &grid)?),
        None => None,
    };
    let filters = device::view_filter(context, &file.view_filter, &grid)?;
    let film_mm = sensor.as_ref().map(|sensor| {
        let width_mm = sensor.model().width_mm();
        [width_mm, width_mm * f64::from(file.render.height_px) / f64::from(file.render.width_px)]
    });
    let resolved_lens = match &file.lens {
        Some(section) => {
            if film_mm.is_none() && section.kind == LensType::Traced {
                let message = "a traced lens needs a [sensor]: its size is that of the film";
                return context.fail(&steps!["lens"], message);
            }
            let distance_mm = Some(file.camera.distance_mm());
            Some(device::lens(context, section, distance_mm, &filters, film_mm, true, &grid)?)
        }
        None if filters.0.lens_angles => {
            let message = "there is no [lens] whose rays have angles";
            return context.fail(&steps!["view_filter", "angles"], message);
        }
        None => None,
    };
    let camera = device::camera(context, file, resolved_lens.as_ref(), sensor.as_ref())?;
    let (view_filters, fixed) = filters;
    let (lens, traced_lens, view_filter) = match resolved_lens {
        Some(lens) => (Some(lens.equation), lens.traced, lens.view_filter),
        None => (None, None, fixed),
    };

    let mut light_groups = Vec::new();
    let lights = light::lights(context, &file.light, &camera, &grid, &mut light_groups)?;
    material::check_sections(context, &file.fluorophore)?;
    let mut fluorophores = material::Fluorophores::default();
    let mut materials = material::materials(context, file, &grid, &mut fluorophores)?;
    let (objects, copied_materials) =
        object::objects(context, file, &mut materials, &mut fluorophores, &grid, &mut light_groups)?;
    let captures = capture::captures(context, file, &light_groups, &grid)?;
    let motion = instrument::motion(context, file)?;
    let develop = instrument::develop(context, file, sensor.as_ref(), &grid)?;
    let spectroradiometers = instrument::spectroradiometers(context, file, &captures, &objects, &grid)?;
    let safety = instrument::safety(context, file)?;
    let seen = capture::Seen {
        objects: &objects,
        materials: &materials,
        camera: &camera,
        sensor: sensor.as_ref(),
        fluorophores: &fluorophores,
    };
    let analysis = capture::analysis(context, file, &captures, &seen)?;

    let scene =
        Scene { grid, objects, materials, fluorophores: fluorophores.list, light_groups, lights, camera };
    scene.check().map_err(|error| scene_error(context, file, &error))?;
    let optics = lens.as_ref().zip(sensor.as_ref());
    render.error_target = error_target::error_target(context, &file.render, &scene, &captures, optics)?;
    let in_bands = whole_image_bytes(&scene) + tile_row_bytes(&scene, &render);
    device::check_memory(context, file, memory_bytes(&scene, &render), in_bands)?;
    warn_unused(context, file, &scene, &copied_materials, analysis.as_ref());
    for warning in scene.warnings() {
        context.push_warning(warning.to_string());
    }

    let (resolved_toml, sha256) = write_out(context, file)?;
    let warnings = context.take_warnings(&scene.grid);
    Ok(ResolvedExperiment {
        title: file.title.clone(),
        description: file.description.clone(),
        scene,
        render,
        time_limit_s: file.render.time_limit_s,
        view_filter,
        view_filters,
        field_from_lens: file.camera.horizontal_field_deg == super::schema::FieldOfView::FromLens,
        lens,
        traced_lens,
        sensor,
        captures,
        motion,
        develop,
        spectroradiometers,
        safety,
        camera_distance_mm: file.camera.distance_mm(),
        analysis,
        output_folder: file.output.folder.as_ref().map(PathBuf::from),
        warnings,
        inputs: std::mem::take(&mut context.inputs),
        base_files: experiment.document.base_files.clone(),
        resolved_toml,
        sha256,
    })
}

/// The message of an error without the name in front, which the place in the file gives already.
pub(super) fn without_name(error: &SceneError, name: &str) -> String {
    let message = error.to_string();
    message.strip_prefix(name).map_or_else(|| message.clone(), String::from)
}

/// Puts an error of the finished scene where it belongs in the file.
fn scene_error(context: &Context<'_>, file: &ExperimentFile, error: &SceneError) -> ExperimentError {
    match error {
        SceneError::CreatesPhotons { material, .. } => {
            let index = file.material.iter().position(|section| section.name == *material).unwrap_or(0);
            let message = without_name(error, &format!("material \"{material}\" "));
            context.error(&steps!["material", index], message).without_value()
        }
        SceneError::Mesh { object, .. } => {
            match file.object.iter().position(|section| section.name == *object) {
                Some(index) => {
                    let message = without_name(error, &format!("object \"{object}\": "));
                    context.error(&steps!["object", index], message)
                }
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

fn warn_unused(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    scene: &Scene,
    copied_materials: &[usize],
    analysis: Option<&ResolvedAnalysis>,
) {
    for (index, material) in file.material.iter().enumerate() {
        // A material of which all parts have lesions is used by its copies only.
        if !scene.objects.iter().any(|object| object.material == index) && !copied_materials.contains(&index)
        {
            context
                .warn(&steps!["material", index], format!("no object uses material \"{}\"", material.name));
        }
    }
    for (index, section) in file.fluorophore.iter().enumerate() {
        let absent = analysis.iter().flat_map(|analysis| &analysis.absent_fluorophores);
        if !scene.fluorophores.iter().chain(absent).any(|fluorophore| fluorophore.name == section.name) {
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
        lens.fill();
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
