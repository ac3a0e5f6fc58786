//! From the sections of an experiment to a study.

mod analyzed_region;
pub(super) mod cached_analysis;
pub(super) mod capture;
mod concentration;
pub(super) mod context;
pub(super) mod device;
mod emitter;
mod error_target;
pub(super) mod fluorophore;
mod gloss;
mod held_fluorophore;
mod instrument;
mod lesion;
mod lesion_spot;
mod light;
mod material;
mod mouth;
pub(super) mod named_tissue;
mod object;
mod record;
mod region;
mod seen;
pub(super) mod spectrum;
pub(super) mod tissue;

pub use self::record::{FileRecord, InputFile};

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;

use self::analyzed_region::FieldPlaces;
use self::cached_analysis::keep_analysis;
use self::capture::Analyses;
use self::context::{Context, Resolved};
use super::error::steps;
use super::schema::{
    AnalysisSection, DiffuseSection, ExperimentFile, LensOrNumber, LensSection, ReflectanceReference,
    ScatteringSection, SpectrumReference,
};
use super::{Experiment, ExperimentError};
use crate::cache::fetch_mouth;
use crate::people::{give_restorations_of, give_tissues_of};
use crate::preset;
use fluorspar::light::{Light, LightGroup};
use fluorspar::optics::PerspectiveCamera;
use fluorspar::render::{RenderSettings, basis_bytes, memory_bytes, tile_row_bytes, whole_image_bytes};
use fluorspar::scene::{Scene, SceneError, SceneWarning};
use fluorspar::spectral::WavelengthGrid;
use fluorspar::study::{AnalysisPlan, Camera, Capture, Study};
use fluorspar::warning::Warning;

/// An experiment ready to run: what it means, and the file that says so.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedExperiment {
    /// Scene, camera and captures, checked.
    pub study: Study,
    /// The file.
    pub record: FileRecord,
}

/// Turns the sections of an experiment into a study, and checks everything that can be checked before rendering. Reads
/// the files that the experiment names and makes the mouth.
///
/// # Errors
/// The first defect found.
pub fn resolve(experiment: &Experiment) -> Result<ResolvedExperiment, ExperimentError> {
    resolve_scene(experiment, true)
}

/// [`resolve`] of what need not shine, such as a part of a scene that others light: without lights there is a dark light group and a
/// warning.
///
/// # Errors
/// The first defect found.
pub fn resolve_unlit(experiment: &Experiment) -> Result<ResolvedExperiment, ExperimentError> {
    resolve_scene(experiment, false)
}

fn resolve_scene(experiment: &Experiment, needs_light: bool) -> Result<ResolvedExperiment, ExperimentError> {
    let file = &experiment.file;
    let mut context = Context::new(&experiment.document);
    let context = &mut context;
    // The largest file of the cache comes while materials are resolved.
    let mouth = file.mouth.as_ref().map(|mouth| fetch_mouth(&mouth.parameters));

    let Setup { grid, camera, view, mut light_groups, lights } = setup(context, file)?;
    let sensor = camera.sensor.as_ref();
    device::warn_of_shape(context, file, sensor);
    let mut render = device::render_settings(context, &file.render)?;
    fluorophore::check_sections(context, &file.fluorophore)?;
    tissue::check_sections(context, &file.tissue, &file.fluorophore, &grid)?;
    let mut fluorophores = fluorophore::Fluorophores::default();
    let of_person = with_person(context, file)?;
    let mut materials = material::materials(context, of_person.as_ref(), &grid, &mut fluorophores)?;
    // What it could not read is made below.
    let _ = mouth.map(JoinHandle::join);
    let (objects, lesions) =
        object::objects(context, &of_person, &mut materials, &mut fluorophores, &grid, &mut light_groups)?;
    if light_groups.is_empty() && !needs_light {
        context.push_warning(
            "the scene has no lights, so that it can't be rendered; add a [[light]] section".to_owned(),
        );
        light_groups.push(LightGroup { name: "light".into() });
    }
    let captures = capture::captures(context, file, &light_groups, &grid)?;
    let motion = instrument::motion(context, file)?;
    let develop = instrument::develop(context, file, sensor, &grid)?;
    let spectroradiometers = instrument::spectroradiometers(context, file, &captures, &objects, &grid)?;
    let safety = instrument::safety(context, file)?;
    let seen = seen::Seen {
        objects: &objects,
        materials: &materials.list,
        camera: &view,
        grid: &grid,
        sensor,
        fluorophores: &fluorophores,
        lesions: &lesions,
    };
    let Analyses { analysis, regions, of_surfaces } = capture::analyses(context, file, &captures, &seen)?;
    let concentrations = concentration::scale(context, file, &fluorophores, &mut materials.list)?;

    let tissues = tissue::study_tissues(context, file, &materials.list, &materials.recipes, &objects)?;
    let scene = Scene {
        grid,
        objects,
        materials: materials.list,
        fluorophores: fluorophores.list,
        light_groups,
        lights,
        camera: view,
    };
    scene.check().map_err(|error| scene_error(context, file, &error))?;
    render.error_target = error_target::error_target(context, &file.render, &scene, &captures, &camera)?;
    render.excitation_basis = device::excitation_basis(context, &file.render, &scene)?;
    let in_bands = whole_image_bytes(&scene) + basis_bytes(&scene, &render) + tile_row_bytes(&scene, &render);
    device::check_memory(context, file, memory_bytes(&scene, &render), in_bands)?;
    let plans: Vec<&AnalysisPlan> =
        analysis.iter().chain(regions.iter().map(|region| &region.analysis)).collect();
    warn_unused(context, file, &scene, &lesions.copied_materials, &plans);
    for warning in scene.warnings().into_iter().filter_map(|w| that_matters(w, &scene, &camera, &captures)) {
        context.push_warning(Warning::summarized(warning.to_string(), warning.summary()));
    }

    let (complete, resolved_toml, sha256) = write_out(context, file)?;
    fluorophore::note_cut_data(context, &file.fluorophore, scene.fluorophores.iter(), &scene.grid);
    let warnings = context.take_warnings(&scene.grid);
    if context.inputs.is_empty() {
        keep_analysis(file, &of_surfaces, &scene);
    }
    let study = Study {
        scene,
        render,
        time_limit_s: file.render.time_limit_s,
        concentrations,
        camera,
        captures,
        motion,
        develop,
        spectroradiometers,
        safety: Some(safety),
        analysis,
        regions,
        tissues,
    };
    let record = FileRecord {
        title: file.title.clone(),
        description: file.description.clone(),
        output_folder: file.output.folder.as_ref().map(PathBuf::from),
        warnings,
        inputs: std::mem::take(&mut context.inputs),
        base_files: experiment.document.base_files.clone(),
        resolved_toml,
        experiment: Some(Arc::new(complete)),
        sha256,
    };
    Ok(ResolvedExperiment { study, record })
}

/// The file with tissues and restorations of the person of its mouth; estimates know the file alone.
fn with_person<'a>(context: &Context<'_>, file: &'a ExperimentFile) -> Resolved<Cow<'a, ExperimentFile>> {
    let Some(person) = file.mouth.as_ref().and_then(|mouth| mouth.person) else {
        return Ok(Cow::Borrowed(file));
    };
    let mut drawn = file.clone();
    give_tissues_of(person, &mut drawn).map_err(|error| context.error(&steps!["tissue"], error))?;
    give_restorations_of(person, &mut drawn);
    Ok(Cow::Owned(drawn))
}

/// Share of the emission beyond its data that changes no result by more than other errors do, percent.
const LITTLE_EMISSION_PERCENT: f64 = 5.0;
/// Share of a light that the filters of a frame pass from which on the frame is one of reflected light: fluorescence, a thousandth of
/// it, is no matter there.
const REFLECTED_SHARE: f64 = 0.1;

/// What of a warning changes a result; `None` where nothing does.
fn that_matters(
    warning: SceneWarning,
    scene: &Scene,
    camera: &Camera,
    captures: &[Capture],
) -> Option<SceneWarning> {
    match warning {
        SceneWarning::ExcitationOutsideData(mut cases) => {
            cases.retain(|case| !is_for_reflection(&case.light, scene, camera, captures));
            (!cases.is_empty()).then_some(SceneWarning::ExcitationOutsideData(cases))
        }
        SceneWarning::EmissionOutsideData(mut cases) => {
            cases.retain(|case| case.percent > LITTLE_EMISSION_PERCENT);
            (!cases.is_empty()).then_some(SceneWarning::EmissionOutsideData(cases))
        }
        other => Some(other),
    }
}

/// Whether all frames under a light see it reflected.
fn is_for_reflection(name: &str, scene: &Scene, camera: &Camera, captures: &[Capture]) -> bool {
    let Some(light) = scene.lights.iter().find(|light| light.name.light() == name) else { return false };
    let group = &scene.light_groups[light.group].name;
    let passed = |capture: &Capture| {
        let seen = light.spectrum.times(&camera.view_filter.transmittance);
        let seen = capture.filter.as_ref().map_or(seen.clone(), |filter| seen.times(filter));
        seen.total() > REFLECTED_SHARE * light.spectrum.total()
    };
    let mut under_it = captures.iter().filter(|capture| capture.frame.drive(group) > 0.0).peekable();
    under_it.peek().is_some() && under_it.all(passed)
}

/// The shapes of an experiment at their places, with the camera that looks at them: what can be shown without light. Every material
/// is gray, there are no lights, lesions and holes, and nothing is solved.
///
/// # Errors
/// The first defect found.
pub fn resolve_shapes(experiment: &Experiment) -> Result<Scene, ExperimentError> {
    let mut file = with_person(&Context::new(&experiment.document), &experiment.file)?.into_owned();
    for material in &mut file.material {
        material.scattering = ScatteringSection::Diffuse(DiffuseSection {
            reflectance: ReflectanceReference::Spectrum(SpectrumReference::Constant(0.5)),
            gloss: None,
            concentrations: BTreeMap::new(),
        });
        (material.opacity, material.normal_map) = (None, None);
    }
    file.mouth.iter_mut().for_each(|mouth| mouth.lesion.clear());
    file.object.iter_mut().for_each(|object| object.emission = None);
    let mut context = Context::new(&experiment.document);
    let context = &mut context;
    let grid = device::grid(context, &file.spectral)?;
    device::check_camera(context, &file.camera)?;
    let (_, camera) = camera(context, &file, &grid)?;
    let mut fluorophores = fluorophore::Fluorophores::default();
    let mut materials = material::materials(context, &file, &grid, &mut fluorophores)?;
    let (objects, _) =
        object::objects(context, &file, &mut materials, &mut fluorophores, &grid, &mut Vec::new())?;
    let (materials, fluorophores) = (materials.list, fluorophores.list);
    Ok(Scene { grid, objects, materials, fluorophores, light_groups: Vec::new(), lights: Vec::new(), camera })
}

/// The study that a component image was rendered from, where its surfaces are those of another experiment that is resolved
/// already: camera, lights and settings of the render are resolved again, materials and meshes are taken over. `None` where the
/// two experiments differ in more than that.
///
/// # Errors
/// The first defect found.
pub fn resolve_rendered(
    rendered: &Experiment,
    now: &Experiment,
    resolved: &ResolvedExperiment,
) -> Result<Option<Study>, ExperimentError> {
    let file = &rendered.file;
    if !have_same_surfaces(file, &now.file) {
        return Ok(None);
    }
    let mut context = Context::new(&rendered.document);
    let context = &mut context;
    let mut study = resolved.study.clone();
    let error_target = study.render.error_target.take();
    study.render = RenderSettings { error_target, ..device::render_settings(context, &file.render)? };
    let Setup { camera, view, light_groups, lights, .. } = setup(context, file)?;
    // Groups of lights come first, then those of surfaces that emit.
    if study.scene.light_groups.get(..light_groups.len()) != Some(light_groups.as_slice()) {
        return Ok(None);
    }
    (study.camera, study.scene.camera, study.scene.lights) = (camera, view, lights);
    Ok(Some(study))
}

fn have_same_surfaces(file: &ExperimentFile, other: &ExperimentFile) -> bool {
    other_surfaces(file, other).is_none()
}

/// The first section that gives two files other surfaces.
fn other_surfaces(file: &ExperimentFile, other: &ExperimentFile) -> Option<&'static str> {
    let is_same = [
        ("mouth", file.mouth == other.mouth),
        ("spectral", file.spectral == other.spectral),
        ("fluorophore", file.fluorophore == other.fluorophore),
        ("tissue", file.tissue == other.tissue),
        ("material", file.material == other.material),
        ("object", file.object == other.object),
    ];
    is_same.into_iter().find(|(_, is_same)| !is_same).map(|(section, _)| section)
}

/// The first section that gives an experiment other surfaces than one that was rendered; `None` where they have the same.
pub fn section_of_other_surfaces(rendered: &Experiment, now: &Experiment) -> Option<&'static str> {
    other_surfaces(&complete(&rendered.file), &complete(&now.file))
}

/// Whether two experiments show the same scene in the same view: they differ in viewing filters, captures, concentrations,
/// development, analysis, instruments, motion, seed and words at most.
pub fn show_the_same_scene(rendered: &Experiment, now: &Experiment) -> bool {
    // The file of a render has its defaults written out
    let (now, mut other) = (complete(&now.file), complete(&rendered.file));
    other.title.clone_from(&now.title);
    other.description.clone_from(&now.description);
    other.output.clone_from(&now.output);
    other.render.seed = now.render.seed;
    other.view_filter.clone_from(&now.view_filter);
    other.concentration.clone_from(&now.concentration);
    other.capture.clone_from(&now.capture);
    other.motion.clone_from(&now.motion);
    other.develop.clone_from(&now.develop);
    other.spectroradiometer.clone_from(&now.spectroradiometer);
    other.safety.clone_from(&now.safety);
    other.analysis.clone_from(&now.analysis);
    other.target.clone_from(&now.target);
    other.files.clone_from(&now.files);
    other == now
}

/// A rendered experiment as if it had been rendered with the samples, the error target and the limits of another one: these decide how
/// much noise an image has, not what it shows.
#[must_use]
pub fn with_sampling_of(rendered: &Experiment, now: &Experiment) -> Experiment {
    let mut rendered = rendered.clone();
    let own = std::mem::replace(&mut rendered.file.render, now.file.render.clone());
    let shown = &mut rendered.file.render;
    (shown.width_px, shown.height_px, shown.max_depth) = (own.width_px, own.height_px, own.max_depth);
    shown.regularize = own.regularize;
    shown.excitation_basis_nm = own.excitation_basis_nm;
    shown.seed = own.seed;
    rendered
}

/// Checks what an experiment says of wavelengths, settings of the render, camera, lens, sensor, filters, lights, mouth, captures,
/// development, motion and safety, in milliseconds, as [`resolve`] does. Materials, objects, analysis and the images and meshes that
/// they read are left to that.
///
/// # Errors
/// The first defect found.
pub fn check_settings(experiment: &Experiment) -> Result<(), ExperimentError> {
    let file = &experiment.file;
    let mut context = Context::new(&experiment.document);
    let context = &mut context;
    device::render_settings(context, &file.render)?;
    let Setup { grid, camera, light_groups, .. } = setup(context, file)?;
    fluorophore::check_sections(context, &file.fluorophore)?;
    if let Some(section) = &file.mouth {
        mouth::check_person(context, section)?;
    }
    // Surfaces that emit have light groups of their own
    if file.object.iter().all(|object| object.emission.is_none()) {
        capture::captures(context, file, &light_groups, &grid)?;
    }
    instrument::motion(context, file)?;
    instrument::develop(context, file, camera.sensor.as_ref(), &grid)?;
    instrument::safety(context, file)?;
    let labels: Vec<&str> = file.capture.iter().map(|capture| capture.name.as_str()).collect();
    match &file.analysis {
        Some(section) => capture::check_frame(context, section, &labels, FieldPlaces::OF_ANALYSIS),
        None => Ok(()),
    }
}

/// What the captures of a finished render need of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct CapturesOfRender {
    /// Camera, lights, captures and development. There are no surfaces, no analysis and no instruments.
    pub study: Study,
    /// [`FileRecord::resolved_toml`].
    pub resolved_toml: String,
    /// [`FileRecord::experiment`].
    pub complete: ExperimentFile,
    /// Files that were read, with their digests.
    pub inputs: Vec<InputFile>,
    /// What is odd about a camera that is not that of the render.
    pub warnings: Vec<Warning>,
}

impl CapturesOfRender {
    /// The experiment that they are of, without its surfaces. Its digest, which counts files of surfaces, is empty.
    #[must_use]
    pub fn into_resolved(self, now: &Experiment) -> ResolvedExperiment {
        let Self { study, resolved_toml, complete, inputs, warnings } = self;
        let record = FileRecord {
            title: now.file.title.clone(),
            description: now.file.description.clone(),
            output_folder: None,
            warnings,
            inputs,
            base_files: Vec::new(),
            resolved_toml,
            experiment: Some(Arc::new(complete)),
            sha256: String::new(),
        };
        ResolvedExperiment { study, record }
    }
}

/// The captures of an experiment that shows the same scene as the one that was rendered, by its camera or another in its place,
/// without its surfaces: nothing is meshed or solved, and no mesh or map is read. `fluorophores` are the names that the render knows.
///
/// `None` where more has changed, or where [`resolve`] could find fault with what this does not look at: analysis and instruments
/// that are not those of the render, regions on another sensor, captures of other names.
///
/// # Errors
/// The first defect found.
pub fn resolve_captures(
    rendered: &Experiment,
    now: &Experiment,
    fluorophores: &[&str],
) -> Result<Option<CapturesOfRender>, ExperimentError> {
    let (file, other) = (&now.file, &rendered.file);
    let names = |file: &ExperimentFile| file.capture.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
    let is_checked = file.analysis == other.analysis
        && file.target == other.target
        && file.spectroradiometer == other.spectroradiometer
        && file.safety == other.safety
        && file.render.relative_error.is_none()
        && names(file) == names(other);
    // Surfaces that emit are lights.
    let shines = file.object.iter().any(|object| object.emission.is_some());
    let is_same = show_the_same_scene(rendered, now);
    if !is_checked || shines || !(is_same || differ_in_the_camera(rendered, now)) {
        return Ok(None);
    }
    let mut context = Context::new(&now.document);
    let context = &mut context;
    let render = device::render_settings(context, &file.render)?;
    let Setup { grid, camera, view, light_groups, lights } = setup(context, file)?;
    if !is_same {
        device::warn_of_shape(context, file, camera.sensor.as_ref());
        let rendered = self::camera(&mut Context::new(&rendered.document), other, &grid)?;
        if !shows_to((&rendered.0, &rendered.1), (&camera, &view)) {
            return Ok(None);
        }
    }
    let concentrations = concentration::changes(context, file, fluorophores)?;
    let captures = capture::captures(context, file, &light_groups, &grid)?;
    let motion = instrument::motion(context, file)?;
    let develop = instrument::develop(context, file, camera.sensor.as_ref(), &grid)?;
    let (complete, resolved_toml, _) = write_out(context, file)?;
    // Of the same camera the render has warned
    let warnings = if is_same { Vec::new() } else { context.take_warnings(&grid) };
    let scene = Scene {
        grid,
        objects: Vec::new(),
        materials: Vec::new(),
        fluorophores: Vec::new(),
        light_groups,
        lights,
        camera: view,
    };
    let study = Study { render, concentrations, camera, captures, motion, develop, ..Study::new(scene) };
    let inputs = std::mem::take(&mut context.inputs);
    Ok(Some(CapturesOfRender { study, resolved_toml, complete, inputs, warnings }))
}

/// Wavelengths, lights and camera of an experiment.
#[derive(Clone, Debug)]
pub(crate) struct Setup {
    pub(crate) grid: WavelengthGrid,
    pub(crate) camera: Camera,
    pub(crate) view: PerspectiveCamera,
    pub(crate) light_groups: Vec<LightGroup>,
    pub(crate) lights: Vec<Light>,
}

/// Resolves wavelengths, lights and camera.
pub(crate) fn setup(context: &mut Context<'_>, file: &ExperimentFile) -> Resolved<Setup> {
    context.known_files.clone_from(&file.files);
    let grid = device::grid(context, &file.spectral)?;
    device::check_camera(context, &file.camera)?;
    let (camera, view) = camera(context, file, &grid)?;
    let mut light_groups = Vec::new();
    let lights = light::lights(context, &file.light, &view, &grid, &mut light_groups)?;
    context.check_filter_data(lights.iter().map(|light| &light.spectrum), &grid)?;
    Ok(Setup { grid, camera, view, light_groups, lights })
}

/// Whether two experiments differ in lens and sensor, and in what [`show_the_same_scene`] leaves free, at most, and nothing else that is
/// checked looks at the sensor: no region lies on it.
fn differ_in_the_camera(rendered: &Experiment, now: &Experiment) -> bool {
    let file = &now.file;
    let lies_on_sensor = |section: &AnalysisSection| {
        section.place.has_shape()
            || section.compared_px.is_some()
            || section.region.iter().any(|region| region.place.has_shape())
    };
    let is_free = file.target.is_empty()
        && file.spectroradiometer.is_empty()
        && !file.analysis.as_ref().is_some_and(lies_on_sensor)
        && file.sensor.as_ref().is_some_and(|sensor| sensor.model.region_px.is_none());
    let mut other = rendered.clone();
    other.file.sensor.clone_from(&file.sensor);
    other.file.lens.clone_from(&file.lens);
    is_free && show_the_same_scene(&other, now)
}

/// Whether an image through one camera can be taken for what another one in its place sees: it keeps its field of view, which the lens
/// and the sensor of both must give where they differ in it, as [`check_same_scene`](fluorspar::pipeline::check_same_scene) demands.
fn shows_to(rendered: (&Camera, &PerspectiveCamera), now: (&Camera, &PerspectiveCamera)) -> bool {
    let ((old, old_view), (new, new_view)) = (rendered, now);
    let seen_as = PerspectiveCamera {
        tan_half_width: new_view.tan_half_width,
        aperture: new_view.aperture.clone(),
        ..old_view.clone()
    };
    let has_field =
        old_view.tan_half_width == new_view.tan_half_width || (old.field_from_lens && new.field_from_lens);
    has_field && seen_as == *new_view
}

/// Sensor, lens and filters, and the view that they give.
fn camera(
    context: &mut Context<'_>,
    file: &ExperimentFile,
    grid: &WavelengthGrid,
) -> Resolved<(Camera, PerspectiveCamera)> {
    let sensor = match &file.sensor {
        Some(section) => Some(device::sensor(context, section, grid)?),
        None => None,
    };
    let view_filter = device::view_filter(context, &file.view_filter, grid)?;
    let film_mm = sensor.as_ref().map(|sensor| {
        let width_mm = sensor.model().width_mm();
        [width_mm, width_mm * f64::from(file.render.height_px) / f64::from(file.render.width_px)]
    });
    let lens = match &file.lens {
        Some(section) => {
            if film_mm.is_none() && matches!(section, LensSection::Traced(_)) {
                let message = "a traced lens needs a [sensor]: its size is that of the film";
                return context.fail(&steps!["lens"], message);
            }
            Some(device::lens(context, section, Some(file.camera.distance_mm()), film_mm, grid)?)
        }
        None if view_filter.stack.lens_angles => {
            let message = "there is no [lens] whose rays have angles";
            return context.fail(&steps!["view_filter", "angles"], message);
        }
        None => None,
    };
    let view_filter = match &lens {
        Some(lens) => view_filter.with_lens(lens, film_mm),
        None => view_filter,
    };
    let view = device::camera(context, file, lens.as_ref(), sensor.as_ref())?;
    let camera = Camera {
        lens,
        view_filter,
        sensor,
        field_from_lens: file.camera.horizontal_field_deg == LensOrNumber::FromLens,
        training_reflectances: preset::reflectance_curves(),
    };
    Ok((camera, view))
}

/// What is wrong with a scene, without the name of the material or object, which the place in the file gives already.
pub(super) fn problem_of(error: &SceneError) -> String {
    match error {
        SceneError::CreatesPhotons { excess, .. } => excess.to_string(),
        SceneError::Mesh { source, .. } => source.to_string(),
        _ => error.to_string(),
    }
}

/// Puts an error of the finished scene where it belongs in the file.
fn scene_error(context: &Context<'_>, file: &ExperimentFile, error: &SceneError) -> ExperimentError {
    match error {
        SceneError::CreatesPhotons { material, .. } => {
            let index = file.material.iter().position(|section| section.name == *material).unwrap_or(0);
            context.error(&steps!["material", index], problem_of(error)).without_value()
        }
        SceneError::Mesh { object, .. } => {
            match file.object.iter().position(|section| section.name == *object) {
                Some(index) => context.error(&steps!["object", index], problem_of(error)),
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
    plans: &[&AnalysisPlan],
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
        let absent = plans.iter().flat_map(|plan| &plan.fluorophores);
        if !scene.fluorophores.iter().chain(absent).any(|fluorophore| fluorophore.name == section.name) {
            context.warn(&steps!["fluorophore", index], "no material contains it");
        }
    }
}

/// The resolved file and its digest.
fn write_out(context: &Context<'_>, file: &ExperimentFile) -> Resolved<(ExperimentFile, String, String)> {
    let mut complete = complete(file);
    for (name, path) in &context.render_files {
        let digests = context.inputs.iter().filter(|input| input.path == *path);
        complete.files.extend(digests.map(|input| (name.clone(), input.sha256.clone())));
    }
    let (text, digest) = context.write_out(complete.clone(), |decisive| {
        decisive.title.clear();
        decisive.description.clear();
        decisive.output = super::schema::OutputSection::default();
        // They count by their content where they are named
        decisive.files.clear();
    })?;
    Ok((complete, text, digest))
}

/// The file with all that it leaves to defaults. Completing it again changes nothing.
pub(crate) fn complete(file: &ExperimentFile) -> ExperimentFile {
    let mut complete = file.clone();
    complete.base = None;
    for light in &mut complete.light {
        light.group.get_or_insert_with(|| light.name.clone());
    }
    if let Some(lens) = &mut complete.lens {
        lens.focus_distance_mm().get_or_insert(complete.camera.distance_mm());
    }
    if let Some(sensor) = &mut complete.sensor {
        sensor.model = device::filled(&sensor.model);
    }
    complete
}
