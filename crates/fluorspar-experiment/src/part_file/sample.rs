//! The small file of a flat sample: one light, one homogeneous material, one camera, no geometry.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::document::tree::Document;
use crate::error::{ExperimentError, Place, steps};
use crate::read::read_sections;
use crate::resolve::context::{Context, Resolved, STRENGTH};
use crate::resolve::spectrum::Role;
use crate::resolve::tissue::flat_tissue;
use crate::resolve::{FileRecord, device, fluorophore, problem_of};
use crate::schema::{
    DEFAULT_PORPHYRIN, ExposureTime, FluorophoreSection, FormatVersion, LensSection, SensorSection,
    SpectralSection, SpectrumReference, TissueSection, UniformBins, ViewFilterSection,
};
use fluorspar::geometry::TriangleMesh;
use fluorspar::light::{DistantEmitter, Light, LightGroup};
use fluorspar::material::{FluorophoreAmount, Material, ScalarTexture};
use fluorspar::optics::PerspectiveCamera;
use fluorspar::scene::{Object, Scene, Shape};
use fluorspar::sensor::{AutoExposure, CaptureFrame, SensorMode};
use fluorspar::spectral::{
    Curve, Fluorophore, MAX_WAVELENGTH_NM, MIN_WAVELENGTH_NM, TOOLBOX_SAMPLES, TOOLBOX_START_NM,
    TOOLBOX_STEP_NM, ToolboxEem, WavelengthGrid,
};
use fluorspar::study::{Camera, FlatSample, FluorescenceModel, ViewFilter};
use fluorspar::warning::Warning;
use fluorspar_format::read_toml;
use serde::de::IgnoredAny;

/// Quantity of a measured light spectrum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MeasuredLight {
    /// Irradiance of the sample, W/(m² nm).
    Irradiance,
    /// Radiance of a white reference in place of the sample, W/(sr m² nm): pi times smaller than the irradiance.
    WhiteRadiance,
}

/// Light on a flat sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SampleLight {
    /// Spectrum per nm.
    pub spectrum: SpectrumReference,
    /// Filters between light and sample. Default: none.
    #[serde(default)]
    pub filters: Vec<SpectrumReference>,
    /// Angle at which light passes them, degrees, 0 to 60. Default 0.
    #[serde(default)]
    pub filter_angle_deg: f64,
    /// How strong it is.
    pub strength: SampleStrength,
}

/// Strength of the light: `irradiance_w_per_m2` (the spectrum is relative), or `measured` (it is absolute).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, deny_unknown_fields)]
pub enum SampleStrength {
    /// The spectrum is relative.
    Irradiance {
        /// Irradiance of the sample behind the filters, W/m², over 200 to 1200 nm.
        irradiance_w_per_m2: f64,
    },
    /// The spectrum is absolute.
    Measured {
        /// The measured quantity, without the filters listed here.
        measured: MeasuredLight,
    },
}

/// A flat, homogeneous, matte material: a surface with its `reflectance`, or layered `tissue`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum SampleMaterial {
    /// A surface.
    Surface(SampleSurface),
    /// Layered tissue.
    Tissue(SampleTissue),
}

/// Layered tissue as a flat sample: its reflectance and fluorescence under diffuse light, without specular reflection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SampleTissue {
    /// Name of a `[[tissue]]`, or of a site of the catalogue.
    pub tissue: String,
    /// Factor on what the tissue holds of each fluorophore, 0 or more. Default: 1.
    #[serde(default)]
    pub concentrations: BTreeMap<String, f64>,
}

/// A colored surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SampleSurface {
    /// Diffuse reflectance, 0 to 1.
    pub reflectance: SpectrumReference,
    /// Concentration of each fluorophore, relative to the unit of the catalogue, 0 or more. Default: none.
    #[serde(default)]
    pub concentrations: BTreeMap<String, f64>,
}

/// How the sensor is exposed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SampleExposure {
    /// Exposure time in milliseconds, 1e-6 to 3 600 000, or "auto". Default 30.
    pub exposure_ms: ExposureTime,
    /// Analog gain, 0.01 to 1000. Default 1.
    pub gain: f64,
}

impl Default for SampleExposure {
    fn default() -> Self {
        Self { exposure_ms: ExposureTime::Milliseconds(30.0), gain: 1.0 }
    }
}

/// Equations to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SampleCompatibility {
    /// Ours: photon yield densities integrated over wavelength.
    #[default]
    None,
    /// ISETCam's constants and sensor equations: sensor mode `isetcam`, noise flag 0 unless the sensor says otherwise.
    Isetcam,
    /// Energy matrices of peak 1 on 365:5:705 nm without a wavelength step, as the authors' toolbox gives them to
    /// their renderer: the normalization under which the paper's weights hold. These are then the wavelengths, too; the
    /// sensor is that of "isetcam".
    #[serde(alias = "toolbox-eem")]
    ToolboxEem,
}

/// A flat sample: light, material, camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SampleFile {
    /// Version of the form of this file: 1.
    pub format: FormatVersion,
    /// Name for people. Default: empty.
    #[serde(default)]
    pub title: String,
    /// Description of the sample. Default: empty.
    #[serde(default)]
    pub description: String,
    /// Equations to use. Default "none": those of Fluorspar.
    #[serde(default)]
    pub compatibility: SampleCompatibility,
    /// Wavelengths.
    #[serde(default)]
    pub spectral: SpectralSection,
    /// Light.
    pub light: SampleLight,
    /// Material.
    pub sample: SampleMaterial,
    /// Fluorophores besides those of the catalogue, or variants of those.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fluorophore: Vec<FluorophoreSection>,
    /// Layered tissues besides those of the catalogue, or in other states.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tissue: Vec<TissueSection>,
    /// Filters in front of the lens.
    #[serde(default)]
    pub view_filter: ViewFilterSection,
    /// Lens; without it radiances are all that is computed.
    pub lens: Option<LensSection>,
    /// Sensor.
    pub sensor: Option<SensorSection>,
    /// Exposure.
    #[serde(default)]
    pub exposure: SampleExposure,
}

/// A flat sample ready to compute with: what it means, and the file that says so.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedSample {
    /// The sample before its camera.
    pub sample: FlatSample,
    /// The compatibility mode of the file.
    pub compatibility: SampleCompatibility,
    /// The file.
    pub record: FileRecord,
}

/// Whether a text is the file of a flat sample: it has a `[sample]` table.
pub fn is_sample(text: &str) -> bool {
    read_toml::<FileHead>(text).is_ok_and(|head| head.is_of_sample())
}

/// Whether a text is the file of an experiment with a scene, and not of a flat sample: it has sections that these lack, or an experiment
/// of the catalogue as its base.
pub fn is_experiment(text: &str) -> bool {
    read_toml::<FileHead>(text).is_ok_and(|head| {
        let experiments = crate::preset::names(crate::preset::PresetKind::Experiment);
        let of_experiment =
            [&head.object, &head.mouth, &head.material, &head.capture, &head.camera, &head.render];
        !head.is_of_sample()
            && (of_experiment.into_iter().any(Option::is_some)
                || head
                    .base
                    .as_ref()
                    .and_then(toml::Value::as_str)
                    .is_some_and(|base| experiments.contains(&base)))
    })
}

/// What tells the files of experiments and of flat samples apart.
#[derive(Deserialize)]
struct FileHead {
    base: Option<toml::Value>,
    sample: Option<toml::Value>,
    object: Option<IgnoredAny>,
    mouth: Option<IgnoredAny>,
    material: Option<IgnoredAny>,
    capture: Option<IgnoredAny>,
    camera: Option<IgnoredAny>,
    render: Option<IgnoredAny>,
}

impl FileHead {
    fn is_of_sample(&self) -> bool {
        self.sample.as_ref().is_some_and(toml::Value::is_table)
    }
}

/// Reads the file of a flat sample and turns it into curves. Overrides and paths are as for an experiment.
///
/// # Errors
/// The first defect found.
pub fn parse_sample(
    text: &str,
    source_name: &str,
    base_dir: &Path,
    overrides: &[String],
) -> Result<ResolvedSample, ExperimentError> {
    let (document, mut file) = read_sections::<SampleFile>(text, source_name, base_dir, overrides)?;
    if file.compatibility == SampleCompatibility::ToolboxEem && file.spectral == SpectralSection::default() {
        file.spectral = SpectralSection::Uniform(UniformBins {
            first_nm: TOOLBOX_START_NM,
            last_nm: TOOLBOX_START_NM + TOOLBOX_STEP_NM * (TOOLBOX_SAMPLES - 1) as f64,
            step_nm: TOOLBOX_STEP_NM,
        });
    }
    if file.compatibility != SampleCompatibility::None
        && let Some(sensor) = &mut file.sensor
        && sensor.model.mode == SensorMode::Physical
    {
        sensor.model.mode = SensorMode::Isetcam { noise_flag: 0 };
    }
    resolve_sample(&document, &file)
}

fn resolve_sample(document: &Document, file: &SampleFile) -> Resolved<ResolvedSample> {
    let mut context = Context::new(document);
    let context = &mut context;
    let grid = device::grid(context, &file.spectral)?;
    if file.compatibility == SampleCompatibility::ToolboxEem
        && grid.centers_nm() != ToolboxEem::wavelengths_nm()
    {
        let message = "compatibility \"toolbox_eem\" needs the wavelengths 365 to 705 nm in steps of 5 nm; remove [spectral] and --step-nm";
        return context.fail(&steps!["spectral"], message);
    }
    let irradiance = irradiance(context, &file.light, &grid)?;
    fluorophore::check_sections(context, &file.fluorophore)?;
    let held = (file.tissue.as_slice(), file.fluorophore.as_slice());
    let material = material(context, &steps!["sample"], &file.sample, held, &grid)?;
    let scene = as_scene(&grid, &irradiance, &material);
    if let Some(scene) = &scene {
        scene.check().map_err(|error| context.error(&steps!["sample"], problem_of(&error)))?;
        for warning in scene.warnings() {
            context.push_warning(Warning::summarized(warning.to_string(), warning.summary()));
        }
    }

    let camera = camera(context, file, &grid)?;
    context.check_filter_data([&irradiance], &grid)?;
    let exposure = exposure(context, file)?;
    let (resolved_toml, sha256) = write_out(context, file)?;
    let used = material.fluorophores.iter().map(|(fluorophore, _)| fluorophore);
    fluorophore::note_cut_data(context, &file.fluorophore, used, &grid);
    let warnings = context.take_warnings(&grid);
    let sample = FlatSample {
        grid,
        irradiance,
        reflectance: material.reflectance,
        fluorophores: material.fluorophores,
        porphyrin: Some(material.porphyrin.into()),
        model: match file.compatibility {
            SampleCompatibility::ToolboxEem => FluorescenceModel::Toolbox,
            SampleCompatibility::None | SampleCompatibility::Isetcam => FluorescenceModel::Physical,
        },
        camera,
        exposure,
    };
    let record = FileRecord {
        title: file.title.clone(),
        description: file.description.clone(),
        output_folder: None,
        warnings,
        inputs: std::mem::take(&mut context.inputs),
        base_files: document.base_files.clone(),
        resolved_toml,
        experiment: None,
        sha256,
    };
    Ok(ResolvedSample { sample, compatibility: file.compatibility, record })
}

/// What a sample reflects and emits.
pub(crate) struct Sampled {
    pub(crate) reflectance: Curve,
    /// Fluorophores at unit concentration, and their concentrations.
    pub(crate) fluorophores: Vec<(Fluorophore, f64)>,
    porphyrin: &'static str,
}

/// A material at a place of a file, with the fluorophores and tissues of that file.
pub(crate) fn material(
    context: &mut Context<'_>,
    at: &Place,
    section: &SampleMaterial,
    (tissues, of_file): (&[TissueSection], &[FluorophoreSection]),
    grid: &WavelengthGrid,
) -> Resolved<Sampled> {
    let at_amounts = at.field("concentrations");
    match section {
        SampleMaterial::Surface(surface) => {
            let at = at.field("reflectance");
            let reflectance = context.spectrum(&at, &surface.reflectance, Role::Reflectance, 0.0, grid)?;
            let mut fluorophores = fluorophore::Fluorophores::default();
            let mut concentrations = Vec::new();
            for (name, &amount) in &surface.concentrations {
                let at = at_amounts.field(name);
                context.within(&at, amount, [0.0, 1e6], "")?;
                fluorophores.index(context, &at, of_file, name)?;
                concentrations.push(amount);
            }
            let fluorophores = fluorophores.list.into_iter().zip(concentrations).collect();
            Ok(Sampled { reflectance, fluorophores, porphyrin: DEFAULT_PORPHYRIN })
        }
        SampleMaterial::Tissue(section) => {
            let flat = flat_tissue(context, &at.field("tissue"), tissues, of_file, &section.tissue, grid)?;
            for (name, &factor) in &section.concentrations {
                let at = at_amounts.field(name);
                context.within(&at, factor, [0.0, 1e6], "")?;
                let held = flat.fluorophores.iter().map(|fluorophore| fluorophore.name.as_str());
                context.known(&at, name, held, "the tissue holds no such fluorophore")?;
            }
            let factor = |name: &str| section.concentrations.get(name).copied().unwrap_or(1.0);
            let fluorophores = flat.fluorophores.into_iter().map(|f| (factor(&f.name), f));
            Ok(Sampled {
                reflectance: flat.reflectance,
                fluorophores: fluorophores.map(|(factor, fluorophore)| (fluorophore, factor)).collect(),
                porphyrin: TISSUE_PORPHYRIN,
            })
        }
    }
}

/// The porphyrin of layered tissue, whose share is estimated.
const TISSUE_PORPHYRIN: &str = "biofilm_porphyrin";

fn refuse_own_light(context: &Context<'_>, filter: &ViewFilter) -> Resolved<()> {
    match filter.stack.autofluorescence {
        None => Ok(()),
        Some(_) => context.fail(
            &steps!["view_filter", "autofluorescence"],
            "a filter is excited by a whole scene, and a flat sample is none; remove it",
        ),
    }
}

/// Lens, filters and sensor before a sample.
fn camera(context: &mut Context<'_>, file: &SampleFile, grid: &WavelengthGrid) -> Resolved<Camera> {
    let view_filter = device::view_filter(context, &file.view_filter, grid)?;
    refuse_own_light(context, &view_filter)?;
    let lens = match &file.lens {
        Some(section) => {
            if section.image_formation().is_some() {
                let message = "a flat sample has no image; remove this field";
                return context.fail(&steps!["lens", "image_formation"], message);
            }
            Some(device::lens(context, section, None, None, grid)?)
        }
        None if view_filter.stack.lens_angles => {
            let message = "there is no [lens] whose rays have angles";
            return context.fail(&steps!["view_filter", "angles"], message);
        }
        None => None,
    };
    let view_filter = match &lens {
        Some(lens) => view_filter.with_lens(lens, None),
        None => view_filter,
    };
    let sensor = match &file.sensor {
        Some(section) => Some(device::sensor(context, section, grid)?),
        None => None,
    };
    if sensor.is_some() && lens.is_none() {
        return context.fail(&steps!["sensor"], "a sensor needs a [lens] section");
    }
    Ok(Camera { lens, view_filter, sensor, ..Camera::default() })
}

/// The one exposure of a sample.
fn exposure(context: &Context<'_>, file: &SampleFile) -> Resolved<CaptureFrame> {
    let at = |key: &str| steps!["exposure", key];
    context.within(&at("gain"), file.exposure.gain, [0.01, 1000.0], "")?;
    let (exposure_ms, auto_exposure) =
        context.exposure(&at("exposure_ms"), file.exposure.exposure_ms, AutoExposure::default())?;
    Ok(CaptureFrame {
        label: "sample".into(),
        lights: BTreeMap::new(),
        exposure_ms,
        auto_exposure,
        gain: file.exposure.gain,
    })
}

fn irradiance(context: &mut Context<'_>, light: &SampleLight, grid: &WavelengthGrid) -> Resolved<Curve> {
    let role = match light.strength {
        SampleStrength::Measured { .. } => Role::AbsolutePower,
        SampleStrength::Irradiance { .. } => Role::Light,
    };
    if role == Role::AbsolutePower && light.spectrum.catalogue_name().is_some() {
        let message = "spectra of the catalogue are relative; give strength.irradiance_w_per_m2, or a measured spectrum";
        return context.fail(&steps!["light", "spectrum"], message);
    }
    let mut curve = context.spectrum(&steps!["light", "spectrum"], &light.spectrum, role, 0.0, grid)?;
    let angle_deg = light.filter_angle_deg;
    context.within(&steps!["light", "filter_angle_deg"], angle_deg, [0.0, 60.0], "degrees")?;
    for (index, filter) in light.filters.iter().enumerate() {
        let at = steps!["light", "filters", index];
        curve = curve.times(&context.spectrum(&at, filter, Role::Filter, angle_deg, grid)?);
    }
    let total = curve.integral(MIN_WAVELENGTH_NM, MAX_WAVELENGTH_NM);
    if total <= 0.0 {
        return context.fail(&steps!["light"], "no light reaches the sample; check spectrum and filters");
    }
    match light.strength {
        SampleStrength::Irradiance { irradiance_w_per_m2: value } => {
            let at = steps!["light", "strength", "irradiance_w_per_m2"];
            Ok(curve.scaled(context.within(&at, value, STRENGTH, "W/m²")? / total))
        }
        SampleStrength::Measured { measured: MeasuredLight::Irradiance } => Ok(curve),
        SampleStrength::Measured { measured: MeasuredLight::WhiteRadiance } => {
            Ok(curve.scaled(std::f64::consts::PI))
        }
    }
}

/// A scene that holds nothing but the sample and its light, for the checks that scenes have.
fn as_scene(grid: &WavelengthGrid, irradiance: &Curve, sampled: &Sampled) -> Option<Scene> {
    let mut material = Material::lambertian("sample", sampled.reflectance.clone());
    let held = sampled.fluorophores.iter().filter(|(_, amount)| *amount > 0.0);
    let (fluorophores, amounts): (Vec<_>, Vec<_>) = held.map(|(f, amount)| (f.clone(), *amount)).unzip();
    material.fluorophores = amounts
        .into_iter()
        .enumerate()
        .map(|(fluorophore, amount)| {
            FluorophoreAmount::new(fluorophore, ScalarTexture::Constant(amount as f32))
        })
        .collect();
    let mesh = TriangleMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        triangles: vec![[0, 1, 2]],
        ..TriangleMesh::default()
    };
    let camera = PerspectiveCamera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 40.0, 1, 1)?;
    Some(Scene {
        grid: grid.clone(),
        objects: vec![Object {
            name: "sample".into(),
            shape: Shape::Mesh(Arc::new(mesh)),
            material: 0,
            emission: None,
        }],
        materials: vec![material],
        fluorophores,
        light_groups: vec![LightGroup { name: "light".into() }],
        lights: vec![Light {
            name: "light".into(),
            group: 0,
            spectrum: irradiance.clone(),
            crossed_polarizers: false,
            emitter: DistantEmitter { direction: Vec3::NEG_Z }.into(),
        }],
        camera,
    })
}

fn write_out(context: &Context<'_>, file: &SampleFile) -> Resolved<(String, String)> {
    let mut complete = file.clone();
    if let Some(sensor) = &mut complete.sensor {
        sensor.model = device::filled(&sensor.model);
    }
    context.write_out(complete, |file| {
        file.title.clear();
        file.description.clear();
    })
}
