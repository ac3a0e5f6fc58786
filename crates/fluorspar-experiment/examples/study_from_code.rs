//! A study built from code, without any file: scene, light, lens, filter, sensor, captures, analysis.
//!
//! It is the flat patch of the catalogue (`base = "flat-patch"`), and a test holds that both give the same bits. The patch
//! holds 0.1 units of porphyrin beside one unit of bulk, so the fraction should be 0.1 / 1.1 = 0.091.

use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use fluorspar::geometry::TriangleMesh;
use fluorspar::light::{DistantEmitter, Emitter, Light, LightGroup};
use fluorspar::material::{FluorophoreAmount, Material, ScalarTexture};
use fluorspar::optics::{Filter, FilterStack, IdealLens, PerspectiveCamera, Vignetting};
use fluorspar::pipeline::evaluate;
use fluorspar::render::{ComponentBands, RenderControl, RenderSettings, render};
use fluorspar::scene::{Object, Scene, Shape};
use fluorspar::sensor::{CaptureFrame, Sensor, SensorModel, SpectralQe};
use fluorspar::spectral::WavelengthGrid;
use fluorspar::study::{AnalysisPlan, Camera, Capture, LineEnds, SafetyPlan, Study, ViewFilter};
use fluorspar_experiment::preset;
use glam::Vec3;

/// Fluorophores of the patch and their concentrations, in the catalogue's unit.
const FLUOROPHORES: [(&str, f64); 5] =
    [("collagen", 0.2), ("elastin", 1.0), ("fad", 0.2), ("keratin", 0.2), ("protoporphyrin_ix", 0.1)];
/// From the camera to the patch, mm.
const DISTANCE_MM: f64 = 100.0;

/// A square of tissue-like material under parallel light that fills the image.
fn scene(camera: PerspectiveCamera) -> Result<Scene, Box<dyn Error>> {
    // The light behind its filter, 1000 W/m² on a surface that faces it.
    let light = preset::light_spectrum("led_385")?.curve().times(&preset::filter("short_pass_425")?.curve());
    let blue = light.scaled(1.0 / light.integral(200.0, 1200.0)).scaled(1000.0);

    let mut patch = Material::lambertian("patch", preset::reflectance("tongue_dorsum")?.curve());
    let mut fluorophores = Vec::new();
    for (index, (name, concentration)) in FLUOROPHORES.into_iter().enumerate() {
        fluorophores.push(preset::fluorophore(name)?.fluorophore());
        let concentration = ScalarTexture::Constant(concentration as f32);
        patch.fluorophores.push(FluorophoreAmount::new(index, concentration));
    }
    let square =
        TriangleMesh::quad(Vec3::new(-0.1, -0.1, 0.0), Vec3::new(0.2, 0.0, 0.0), Vec3::new(0.0, 0.2, 0.0));
    Ok(Scene {
        grid: WavelengthGrid::default(),
        objects: vec![Object {
            name: "patch".into(),
            shape: Shape::Mesh(Arc::new(square)),
            material: 0,
            emission: None,
        }],
        materials: vec![patch],
        fluorophores,
        light_groups: vec![LightGroup { name: "blue".into() }],
        lights: vec![Light {
            name: "blue".into(),
            group: 0,
            spectrum: blue,
            crossed_polarizers: false,
            emitter: Emitter::Distant(DistantEmitter { direction: Vec3::NEG_Z }),
        }],
        camera,
    })
}

/// A 3 mm lens at f/4 behind a long-pass filter, and a small sensor with the data sheet of the paper.
fn camera() -> Result<Camera, Box<dyn Error>> {
    let lens = IdealLens {
        object_distance_mm: Some(DISTANCE_MM),
        vignetting: Vignetting::None,
        ..IdealLens::new(3.0, 4.0)
    };
    let filter = preset::filter("view_475_700")?;
    let filter = Filter { curve: filter.curve(), effective_index: filter.effective_index };
    let stack = FilterStack { filters: vec![filter], ..FilterStack::default() };
    let qe = SpectralQe::from_curves(preset::quantum_efficiency("consumer_rgb_cmos")?.channels()?)?;
    let model = SensorModel { columns: 320, rows: 240, ..SensorModel::default() };
    Ok(Camera {
        lens: Some(lens.into()),
        view_filter: ViewFilter::at_fixed_angle(stack),
        sensor: Some(Sensor::new(model, qe)?),
        field_from_lens: true,
        training_reflectances: preset::reflectance_curves(),
    })
}

/// The whole study: a dark and a lit frame, and the porphyrin fraction of their difference.
pub(crate) fn study() -> Result<Study, Box<dyn Error>> {
    let camera = camera()?;
    let (lens, sensor) = camera.lens.as_ref().zip(camera.sensor.as_ref()).ok_or("lens and sensor")?;
    let half_field = (0.5 * sensor.model().width_mm() / lens.equation.image_distance_mm()).atan();
    let field_deg = (2.0 * half_field).to_degrees() as f32;
    let position = Vec3::new(0.0, 0.0, (1e-3 * DISTANCE_MM) as f32);
    let view = PerspectiveCamera::look_at(position, Vec3::ZERO, Vec3::Y, field_deg, 64, 48);
    let scene = scene(view.ok_or("a view")?)?;

    let dark = Capture::from(CaptureFrame::fixed::<&str>("ambient", [], 30.0));
    let lit = CaptureFrame::fixed("blue", [("blue", 1.0)], 30.0);
    let lit = Capture { subtract: Some("ambient".into()), ..Capture::from(lit) };
    let bulk = FLUOROPHORES.iter().filter(|(name, _)| *name != "protoporphyrin_ix");
    let analysis = AnalysisPlan {
        frame: "blue".into(),
        parts: vec!["patch".into()],
        inset_px: 0,
        rectangle_px: None,
        polygon: None,
        mask: None,
        compared: None,
        targets: Vec::new(),
        wanted_d_prime: AnalysisPlan::WANTED_D_PRIME,
        porphyrin: Some("protoporphyrin_ix".into()),
        bulk: bulk.map(|(name, amount)| ((*name).into(), *amount)).collect(),
        fluorophores: scene.fluorophores.clone(),
        further_frames: Vec::new(),
        tissue: None,
        line_ends: LineEnds::Scene,
        noise_threshold: fluorspar::analysis::DEFAULT_NOISE_THRESHOLD,
    };
    Ok(Study {
        render: RenderSettings {
            samples_per_pixel: 16,
            max_depth: 2,
            component_bands: ComponentBands::Basis,
            regularize: false,
            ..RenderSettings::default()
        },
        camera,
        captures: vec![dark, lit],
        // No mouth: limits are those of skin
        safety: Some(SafetyPlan {
            mucosa_safety_factor: 1.0,
            is_mouth: false,
            ..SafetyPlan::new(DISTANCE_MM)
        }),
        analysis: Some(analysis),
        ..Study::new(scene)
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let study = study()?;
    study.scene.check()?;
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let components = render(&study.scene, &study.render, &control)?;
    let evaluation = evaluate(&study, &components)?;

    let analyzed = evaluation.analysis.ok_or("no analysis")?;
    let region = analyzed.analysis.mixture.and_then(|mixture| mixture.region).ok_or("no mixture line")?;
    let [low, high] = region.estimate.fraction_interval;
    #[expect(clippy::print_stdout, reason = "what an example is for")]
    {
        println!("porphyrin fraction {:.4} ({low:.4} to {high:.4})", region.estimate.fraction);
    }
    Ok(())
}
