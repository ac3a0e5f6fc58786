//! The scenes themselves.

use std::f32::consts::{FRAC_PI_2, TAU};
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

use fluorspar::geometry::TriangleMesh;
use fluorspar::light::{DiscEmitter, Light, LightGroup, RectangleEmitter};
use fluorspar::material::{Coat, FluorophoreAmount, Lambertian, Material, ReflectanceTerm, ScalarTexture};
use fluorspar::optics::{CameraLens, LensSetting, LensState, PerspectiveCamera};
use fluorspar::scene::{Object, Scene, Shape};
use fluorspar::spectral::{Curve, Fluorophore, PhotonEem, SeparableTerm, Stokes, WavelengthGrid};
use fluorspar_anatomy::{MouthParameters, Tissue, generate_mouth};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{DEFAULT_EXPERIMENT, parse, resolve};
use glam::Vec3;

use crate::meshes::{block, bumps, closed_surface, parallelogram};

/// A scene of the benchmarks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BenchmarkScene {
    /// Five walls, two blocks, one light below the ceiling.
    CornellBox,
    /// A bumpy closed cavity with checkered walls and glossy teeth, lit and seen from inside.
    ClosedCavity,
    /// [`BenchmarkScene::ClosedCavity`] without gloss.
    MatteCavity,
    /// [`BenchmarkScene::ClosedCavity`] seen through a traced lens prescription: the wide lens of 3.5 mm in the catalogue,
    /// in two groups of bands.
    CavityThroughLens,
    /// The parametric mouth from 10 cm, with two lights beside the camera.
    Mouth,
    /// The mouth of the default experiment: layered tissue with its own fluorophores under rings of white and of blue lights.
    TissueMouth,
}

/// What may vary between measurements of one scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneOptions {
    /// Wavelength bins.
    pub grid: WavelengthGrid,
    /// Separable fluorophores, 0 to [`MOST_DYES`]; tissue has its own.
    pub fluorophores: usize,
    /// Columns and rows of the image.
    pub side: usize,
}

impl BenchmarkScene {
    /// All scenes.
    pub const ALL: [Self; 6] = [
        Self::CornellBox,
        Self::ClosedCavity,
        Self::MatteCavity,
        Self::CavityThroughLens,
        Self::Mouth,
        Self::TissueMouth,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::CornellBox => "cornell_box",
            Self::ClosedCavity => "closed_cavity",
            Self::MatteCavity => "matte_cavity",
            Self::CavityThroughLens => "cavity_through_lens",
            Self::Mouth => "mouth",
            Self::TissueMouth => "tissue_mouth",
        }
    }

    /// The scene.
    pub fn build(self, options: &SceneOptions) -> Scene {
        match self {
            Self::CornellBox => cornell_box(options),
            Self::ClosedCavity => closed_cavity(options, true),
            Self::MatteCavity => closed_cavity(options, false),
            Self::CavityThroughLens => cavity_through_lens(options),
            Self::Mouth => mouth(options),
            Self::TissueMouth => tissue_mouth(options),
        }
    }
}

/// Curves are given over this range, nm.
const RANGE_NM: (f64, f64) = (330.0, 780.0);

/// A smooth reflectance that rises from `low` to `high` around a wavelength.
fn rising(low: f64, high: f64, center_nm: f64) -> Curve {
    Curve::from_fn(RANGE_NM.0, RANGE_NM.1, |nm| low + (high - low) / (1.0 + (-(nm - center_nm) / 25.0).exp()))
}

/// A smooth hump of reflectance.
fn hump(low: f64, high: f64, center_nm: f64) -> Curve {
    Curve::from_fn(RANGE_NM.0, RANGE_NM.1, |nm| {
        low + (high - low) * (-((nm - center_nm) / 50.0).powi(2)).exp()
    })
}

/// A broad light, `power_w` watts in all.
fn light_spectrum(power_w: f64) -> Curve {
    let shape = Curve::from_fn(RANGE_NM.0, RANGE_NM.1, |nm| {
        1.0 + 0.5 * (nm / 90.0).sin() + 0.3 * (nm - 550.0) / 200.0
    });
    shape.scaled(power_w / shape.total())
}

fn gaussian(center_nm: f64, sd_nm: f64, height: f64) -> Curve {
    Curve::from_fn(250.0, 850.0, |nm| height * (-0.5 * ((nm - center_nm) / sd_nm).powi(2)).exp())
}

/// Most dyes of a scene.
pub const MOST_DYES: usize = 16;

/// Separable dyes with one term each.
fn dyes(count: usize) -> Vec<Fluorophore> {
    const PEAKS_NM: [(f64, f64); 5] =
        [(380.0, 460.0), (405.0, 635.0), (450.0, 530.0), (365.0, 420.0), (430.0, 590.0)];
    // Each round lies a little further
    (0..count.min(MOST_DYES))
        .map(|index| {
            let further_nm = 8.0 * (index / PEAKS_NM.len()) as f64;
            let (excitation_nm, emission_nm) = PEAKS_NM[index % PEAKS_NM.len()];
            let (excitation_nm, emission_nm) = (excitation_nm + further_nm, emission_nm + further_nm);
            let term = SeparableTerm {
                excitation: gaussian(excitation_nm, 30.0, 0.1),
                emission: gaussian(emission_nm, 22.0, 1.0 / (22.0 * (2.0 * PI).sqrt())),
            };
            Fluorophore {
                name: format!("dye_{index}"),
                title: format!("Dye {index}"),
                eem: PhotonEem::separable(vec![term], Stokes::Mask),
                excitation_range_nm: (250.0, 850.0),
                emission_range_nm: (250.0, 850.0),
                source: "made up for benchmarks".into(),
            }
        })
        .collect()
}

/// Fluorophores of a material: of many each is less, so that a surface gives no more photons than it gets.
fn amounts(fluorophores: impl ExactSizeIterator<Item = usize>) -> Vec<FluorophoreAmount> {
    let amount = 0.5 * (5.0 / fluorophores.len().max(1) as f32).min(1.0);
    fluorophores
        .map(|fluorophore| FluorophoreAmount::new(fluorophore, ScalarTexture::Constant(amount)))
        .collect()
}

fn object(name: &str, mesh: TriangleMesh, material: usize) -> Object {
    Object { name: name.into(), shape: Shape::Mesh(Arc::new(mesh)), material, emission: None }
}

fn empty(options: &SceneOptions, position: Vec3, target: Vec3, field_deg: f32) -> Scene {
    let camera = PerspectiveCamera::look_at(position, target, Vec3::Y, field_deg, options.side, options.side);
    #[allow(clippy::expect_used, reason = "the positions are constants, and side 0 is refused by the caller")]
    let camera = camera.expect("the camera looks somewhere");
    Scene {
        grid: options.grid.clone(),
        objects: Vec::new(),
        materials: Vec::new(),
        fluorophores: dyes(options.fluorophores),
        light_groups: vec![LightGroup { name: "lamp".into() }],
        lights: Vec::new(),
        camera,
    }
}

fn cornell_box(options: &SceneOptions) -> Scene {
    let mut scene = empty(options, Vec3::new(0.0, 1.0, 3.9), Vec3::new(0.0, 1.0, 0.0), 39.0);
    let white = Curve::from_fn(RANGE_NM.0, RANGE_NM.1, |nm| 0.73 + 0.05 * ((nm - 400.0) / 300.0));
    scene.materials.push(Material::lambertian("white", white.clone()));
    scene.materials.push(Material::lambertian("red", rising(0.06, 0.63, 600.0)));
    scene.materials.push(Material::lambertian("green", hump(0.08, 0.45, 530.0)));
    // The fluorescent ones reflect less, so that no more photons leave than arrive.
    let dull = white.scaled(0.75);
    for (name, fluorophores) in [("floor", 0..1), ("block", 1..2)] {
        let mut material = Material::lambertian(name, dull.clone());
        material.fluorophores =
            amounts(fluorophores.start.min(options.fluorophores)..fluorophores.end.min(options.fluorophores));
        scene.materials.push(material);
    }
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let corner = Vec3::new(-1.0, 0.0, -1.0);
    scene.objects.push(object("floor", parallelogram(corner, z, x), 3));
    scene.objects.push(object("ceiling", parallelogram(corner + y, x, z), 0));
    scene.objects.push(object("back", parallelogram(corner, x, y), 0));
    scene.objects.push(object("left", parallelogram(corner, y, z), 1));
    scene.objects.push(object("right", parallelogram(corner + x, z, y), 2));
    scene.objects.push(object("short_block", block(Vec3::new(0.35, 0.0, 0.3), 0.3, 0.6, -0.3), 4));
    scene.objects.push(object("tall_block", block(Vec3::new(-0.35, 0.0, -0.3), 0.3, 1.2, 0.3), 0));
    scene.lights.push(Light {
        name: "ceiling_light".into(),
        group: 0,
        spectrum: light_spectrum(10.0),
        crossed_polarizers: false,
        emitter: RectangleEmitter {
            corner: Vec3::new(-0.25, 1.99, -0.2),
            edge_u: Vec3::X * 0.5,
            edge_v: Vec3::Z * 0.4,
            exponent: 1.0,
        }
        .into(),
    });
    scene
}

/// Two spectra in a checkerboard over the texture coordinates; the second must not be lower anywhere.
fn checkered(name: &str, a: Curve, b: &Curve, [columns, rows]: [u32; 2], coat: Option<Coat>) -> Material {
    let difference = Curve::from_fn(RANGE_NM.0, RANGE_NM.1, |nm| (b.at(nm) - a.at(nm)).max(0.0));
    let mut base = Lambertian::uniform(a);
    base.reflectance.push(ReflectanceTerm {
        spectrum: difference,
        weight: ScalarTexture::Checker { columns, rows, low: 0.0, high: 1.0 },
    });
    Material::with_base(name, base, coat)
}

/// A film of saliva.
fn wet(roughness: f32) -> Coat {
    Coat::new(1.4, ScalarTexture::Constant(roughness))
}

fn closed_cavity(options: &SceneOptions, gloss: bool) -> Scene {
    let mut scene = empty(options, Vec3::new(0.0, 0.002, 0.032), Vec3::new(0.0, -0.002, -0.03), 75.0);
    let coat = |roughness: f32| gloss.then(|| wet(roughness));
    let mut mucosa =
        checkered("mucosa", rising(0.25, 0.6, 590.0), &rising(0.35, 0.7, 570.0), [24, 12], coat(0.3));
    let mut tooth =
        checkered("tooth", rising(0.4, 0.6, 490.0), &rising(0.45, 0.7, 480.0), [8, 4], coat(0.15));
    let mut tongue =
        checkered("tongue", rising(0.15, 0.4, 600.0), &rising(0.2, 0.5, 590.0), [16, 16], coat(0.4));
    for material in [&mut mucosa, &mut tooth, &mut tongue] {
        material.fluorophores = amounts(0..options.fluorophores);
    }
    scene.materials.extend([mucosa, tooth, tongue]);

    let axes = Vec3::new(0.030, 0.025, 0.040);
    let wall = closed_surface(Vec3::ZERO, axes, 189, true, bumps(9.0, 0.04));
    scene.objects.push(object("wall", wall, 0));
    let tongue = closed_surface(
        Vec3::new(0.0, -0.014, -0.01),
        Vec3::new(0.016, 0.006, 0.022),
        115,
        false,
        bumps(7.0, 0.06),
    );
    scene.objects.push(object("tongue", tongue, 2));
    for tooth in 0..16 {
        // Eight above and eight below, on two arches that open toward the camera.
        let upper = tooth < 8;
        let angle = TAU * 0.5 * ((tooth % 8) as f32 + 0.5) / 8.0 - FRAC_PI_2;
        let y = if upper { 0.0075 } else { -0.0065 };
        let center = Vec3::new(0.019 * angle.sin(), y, 0.004 - 0.022 * angle.cos());
        let mesh = closed_surface(center, Vec3::new(0.0028, 0.0042, 0.0026), 25, false, bumps(5.0, 0.05));
        scene.objects.push(object(&format!("tooth_{}", tooth + 1), mesh, 1));
    }
    for (name, x) in [("left_light", -0.009_f32), ("right_light", 0.009)] {
        let center = Vec3::new(x, 0.002, 0.032);
        scene.lights.push(Light {
            name: name.into(),
            group: 0,
            spectrum: light_spectrum(0.05),
            crossed_polarizers: false,
            emitter: DiscEmitter { center, normal: Vec3::NEG_Z, radius_m: 0.0025, exponent: 1.0 }.into(),
        });
    }
    scene
}

/// Wide enough to see the cavity as the pinhole does, focused on the teeth in front.
fn cavity_through_lens(options: &SceneOptions) -> Scene {
    const FILM_MM: f64 = 3.6;
    const FOCUS_MM: f64 = 45.0;
    const BAND_GROUPS: usize = 2;
    let mut scene = closed_cavity(options, true);
    #[allow(clippy::expect_used, reason = "the lens ships with the library and focuses at this distance")]
    let state = {
        let lens = preset::lens("wide_3_5mm").expect("the lens is in the catalogue").lens;
        let setting = LensSetting { object_distance_mm: Some(FOCUS_MM), ..LensSetting::default() };
        LensState::new(&lens, setting).expect("the lens can be focused")
    };
    scene.camera.lens = Some(Arc::new(CameraLens::new(state, FILM_MM, FILM_MM, &options.grid, BAND_GROUPS)));
    scene
}

fn mouth(options: &SceneOptions) -> Scene {
    let mut scene = empty(options, Vec3::new(0.0, 0.0, 0.10), Vec3::ZERO, 40.0);
    #[allow(clippy::expect_used, reason = "the default parameters are valid")]
    let mouth = generate_mouth(&MouthParameters::default()).expect("the default mouth can be generated");
    let spectrum = |tissue: Tissue| match tissue {
        Tissue::Tooth => rising(0.45, 0.65, 480.0),
        Tissue::Skin => rising(0.25, 0.6, 580.0),
        Tissue::TongueDorsum | Tissue::TongueVentral => rising(0.15, 0.45, 600.0),
        _ => rising(0.18, 0.5, 590.0),
    };
    for (index, part) in mouth.parts.iter().enumerate() {
        let is_wet = part.tissue != Tissue::Skin;
        let base = Lambertian::uniform(spectrum(part.tissue));
        let mut material = Material::with_base(&part.name, base, is_wet.then(|| wet(0.25)));
        if is_wet {
            material.fluorophores = amounts(0..options.fluorophores);
        }
        scene.materials.push(material);
        scene.objects.push(object(&part.name, part.mesh.clone(), index));
    }
    for (name, x) in [("left_light", -0.03_f32), ("right_light", 0.03)] {
        let center = Vec3::new(x, 0.0, 0.10);
        scene.lights.push(Light {
            name: name.into(),
            group: 0,
            spectrum: light_spectrum(0.2),
            crossed_polarizers: false,
            emitter: DiscEmitter { center, normal: (-center).normalize(), radius_m: 0.0025, exponent: 1.0 }
                .into(),
        });
    }
    scene
}

/// The fluorophores are those of the tissues, whatever the options say.
fn tissue_mouth(options: &SceneOptions) -> Scene {
    let sets = [
        format!("spectral={{edges_nm={:?}}}", options.grid.edges_nm()),
        format!("render.width_px={}", options.side),
        format!("render.height_px={}", options.side),
        "unset analysis".into(),
    ];
    #[allow(clippy::expect_used, reason = "the experiment ships with the library")]
    let study = {
        let preset = preset::text(PresetKind::Experiment, DEFAULT_EXPERIMENT)
            .expect("the experiment is in the catalogue");
        let experiment = parse(preset, "built in", Path::new("."), &sets).expect("it can be read");
        resolve(&experiment).expect("it is valid").study
    };
    study.scene
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use fluorspar::render::{RenderControl, RenderSettings, render};

    use super::*;

    #[test]
    fn every_scene_is_physical_and_has_the_stated_size() {
        for (fluorophores, scene) in [0, 2, 5].into_iter().cycle().zip(BenchmarkScene::ALL) {
            let grid = WavelengthGrid::default();
            let built = scene.build(&SceneOptions { grid, fluorophores, side: 8 });
            assert!(built.check().is_ok(), "{}: {:?}", scene.name(), built.check());
        }
        let options = SceneOptions { grid: WavelengthGrid::default(), fluorophores: 5, side: 8 };
        // Light comes through the lens, to the corners of the film.
        let through_lens = BenchmarkScene::CavityThroughLens.build(&options);
        let settings = RenderSettings { samples_per_pixel: 64, ..RenderSettings::default() };
        let stop = AtomicBool::new(false);
        let image =
            render(&through_lens, &settings, &RenderControl { stop: &stop, progress: &|_| {} }).unwrap();
        let sum = image.recombine(|_| 1.0);
        assert!((0..64).all(|i| sum.pixel(i / 8, i % 8).iter().sum::<f32>() > 0.0));
        let cavity = BenchmarkScene::ClosedCavity.build(&options);
        let triangles: usize = cavity
            .objects
            .iter()
            .map(|o| match &o.shape {
                Shape::Mesh(mesh) => mesh.triangles.len(),
                _ => 0,
            })
            .sum();
        assert!((225_000..240_000).contains(&triangles), "{triangles}");
    }
}
