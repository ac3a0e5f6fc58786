//! Scenes, lights and statistics that the tests of light transport share.
#![allow(clippy::unwrap_used, dead_code)]

use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use fluorspar::geometry::TriangleMesh;
use fluorspar::image::ComponentImage;
use fluorspar::light::{
    DiscEmitter, Emitter, EnvironmentLayer, EnvironmentMap, Light, LightGroup, RectangleEmitter,
    SphereEmitter,
};
use fluorspar::material::{
    Coat, Conductor, Dielectric, FluorophoreAmount, Material, Mixture, NormalMap, ScalarTexture, Scattering,
    TwoSided,
};
use fluorspar::optics::PerspectiveCamera;
use fluorspar::render::{Estimator, RenderControl, RenderSettings, render};
use fluorspar::scene::{Object, Scene, Shape, SurfaceEmission};
use fluorspar::spectral::{Curve, Fluorophore, PhotonEem, SeparableTerm, Stokes, WavelengthGrid};
use fluorspar_testkit::{MeanEstimate, sidak, welch_t_test};
use glam::{Vec2, Vec3};

pub(crate) fn run(scene: &Scene, settings: &RenderSettings) -> ComponentImage {
    let stop = AtomicBool::new(false);
    render(scene, settings, &RenderControl { stop: &stop, progress: &|_| {} }).unwrap()
}

pub(crate) fn settings(samples_per_pixel: u32, max_depth: u32) -> RenderSettings {
    RenderSettings { samples_per_pixel, max_depth, seed: 11, ..RenderSettings::default() }
}

pub(crate) fn gaussian(center: f64, sd: f64, height: f64) -> Curve {
    Curve::from_fn(200.0, 1000.0, |nm| height * (-0.5 * ((nm - center) / sd).powi(2)).exp())
}

/// A made-up fluorophore with a Gaussian excitation and emission band and a large yield.
pub(crate) fn dye(name: &str, excitation_nm: f64, emission_nm: f64, photon_yield: f64) -> Fluorophore {
    let area = 25.0 * (2.0 * PI).sqrt();
    let term = SeparableTerm {
        excitation: gaussian(excitation_nm, 35.0, photon_yield),
        emission: gaussian(emission_nm, 25.0, 1.0 / area),
    };
    Fluorophore {
        name: name.into(),
        title: name.into(),
        eem: PhotonEem::separable(vec![term], Stokes::Mask),
        excitation_range_nm: (300.0, 800.0),
        emission_range_nm: (300.0, 800.0),
        source: "made up for tests".into(),
    }
}

pub(crate) fn camera(position: Vec3, target: Vec3, field_deg: f32, side: usize) -> PerspectiveCamera {
    PerspectiveCamera::look_at(position, target, Vec3::Y, field_deg, side, side).unwrap()
}

pub(crate) fn scene(grid: WavelengthGrid, camera: PerspectiveCamera) -> Scene {
    Scene {
        grid,
        objects: Vec::new(),
        materials: Vec::new(),
        fluorophores: Vec::new(),
        light_groups: vec![LightGroup { name: "lamp".into() }],
        lights: Vec::new(),
        camera,
    }
}

pub(crate) fn quad(corner: Vec3, edge_u: Vec3, edge_v: Vec3) -> Shape {
    Shape::Mesh(Arc::new(TriangleMesh {
        positions: vec![corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..TriangleMesh::default()
    }))
}

pub(crate) fn object(name: &str, shape: Shape, material: usize) -> Object {
    Object { name: name.into(), shape, material, emission: None }
}

pub(crate) fn flat(value: f64) -> Curve {
    Curve::constant(value)
}

pub(crate) fn light(spectrum: Curve, emitter: Emitter) -> Light {
    Light { name: "lamp".into(), group: 0, spectrum, crossed_polarizers: false, emitter }
}

pub(crate) fn with_dyes(mut material: Material, amounts: &[(usize, f32)]) -> Material {
    material.fluorophores = amounts
        .iter()
        .map(|&(fluorophore, c)| FluorophoreAmount::new(fluorophore, ScalarTexture::Constant(c)))
        .collect();
    material
}

pub(crate) fn coated(reflectance: f64, roughness: f32) -> Material {
    let coat = Coat::new(1.4, ScalarTexture::Constant(roughness));
    Material::coated("coated", flat(reflectance), coat)
}

pub(crate) fn glass(index: f32, roughness: f32, transmittance: f64) -> Material {
    let glass = Dielectric {
        refractive_index: index,
        roughness: ScalarTexture::Constant(roughness),
        transmittance: flat(transmittance),
        single_scattering: false,
    };
    Material::new("glass", Scattering::Dielectric(glass))
}

pub(crate) fn metal(n: Curve, k: Curve, roughness: f32) -> Material {
    let roughness = ScalarTexture::Constant(roughness);
    let conductor = Conductor { n, k, roughness, single_scattering: false };
    Material::new("metal", Scattering::Conductor(conductor))
}

pub(crate) fn mixed(first: usize, second: usize, amount: ScalarTexture) -> Material {
    Material::new("mixed", Scattering::Mixture(Mixture { first, second, amount }))
}

pub(crate) fn two_sided(front: usize, back: usize) -> Material {
    Material::new("sides", Scattering::TwoSided(TwoSided { front, back }))
}

/// A map with a bright pixel, some dim ones and some dark ones, of two spectra.
pub(crate) fn patchy_sky(strength: f64) -> Emitter {
    let factors = |seed: usize| {
        (0..8 * 16).map(|i| if i == 37 + seed { 12.0 } else { ((i * 7 + seed) % 4) as f32 * 0.5 }).collect()
    };
    let layers = vec![
        EnvironmentLayer { spectrum: gaussian(390.0, 20.0, strength), factors: factors(0) },
        EnvironmentLayer { spectrum: gaussian(560.0, 60.0, 0.3 * strength), factors: factors(9) },
    ];
    Emitter::EnvironmentMap(Arc::new(EnvironmentMap::new(16, 8, layers, 25.0).unwrap()))
}

/// Slopes of about 20 degrees in all directions.
pub(crate) fn bumps() -> NormalMap {
    let side = 16;
    let rgb: Vec<f32> = (0..side * side)
        .flat_map(|i| {
            let (x, y) = ((i % side) as f32, (i / side) as f32);
            [0.5 + 0.18 * (x * 0.8).sin(), 0.5 + 0.18 * (y * 1.2).cos(), 1.0]
        })
        .collect();
    NormalMap::from_rgb(side, side, &rgb, 1.0).unwrap()
}

/// Lights of every shape for the box of [`lit_box`], by name.
pub(crate) const LIGHTS: [&str; 9] = [
    "disc",
    "rectangle",
    "narrow rectangle",
    "sphere",
    "sky",
    "lamps and sky",
    "bright mesh",
    "bright ball",
    "bright disc",
];

/// Materials of the things in the box of [`lit_box`], by name.
pub(crate) const MATERIALS: [&str; 10] = [
    "lambertian",
    "coated",
    "rough glass",
    "smooth glass",
    "rough metal",
    "mirror",
    "mixed",
    "two-sided",
    "with holes",
    "bumpy",
];

/// An open box with a fluorescent floor, a ball and a tilted plate of one material, under one kind of light. Lights are
/// large, so that scattered rays find them.
pub(crate) fn lit_box(lighting: &str, material: &str, concentration: f32) -> Scene {
    let grid = WavelengthGrid::uniform(360.0, 680.0, 40.0).unwrap();
    let mut scene = scene(grid, camera(Vec3::new(0.0, 0.0, 3.4), Vec3::ZERO, 40.0, 10));
    scene.fluorophores = vec![dye("a", 390.0, 450.0, 0.4), dye("b", 440.0, 560.0, 0.4)];
    let dyes = [(0, concentration), (1, 0.5 * concentration)];
    let white = Material::lambertian("wall", flat(0.6));
    let floor = with_dyes(Material::lambertian("floor", flat(0.4)), &dyes);
    let copper = || {
        // Copper-like: dark in the blue.
        let n = Curve::new(vec![200.0, 560.0, 620.0, 1200.0], vec![1.2, 1.0, 0.25, 0.25]).unwrap();
        let k = Curve::new(vec![200.0, 560.0, 620.0, 1200.0], vec![2.2, 2.6, 3.3, 5.0]).unwrap();
        (n, k)
    };
    scene.materials =
        vec![white, floor, with_dyes(coated(0.3, 0.3), &dyes), Material::lambertian("gray", flat(0.3))];
    let thing = match material {
        "lambertian" => with_dyes(Material::lambertian("thing", flat(0.5)), &dyes),
        "coated" => with_dyes(coated(0.5, 0.25), &dyes),
        "rough glass" => with_dyes(glass(1.5, 0.4, 0.5), &dyes),
        "smooth glass" => with_dyes(glass(1.4, 0.0, 0.5), &dyes),
        "rough metal" => with_dyes(metal(copper().0, copper().1, 0.35), &dyes),
        "mirror" => metal(copper().0, copper().1, 0.0),
        "mixed" => mixed(2, 3, ScalarTexture::Checker { columns: 3, rows: 3, low: 0.2, high: 0.9 }),
        "two-sided" => two_sided(2, 3),
        "with holes" => {
            let opacity = Some(ScalarTexture::Checker { columns: 4, rows: 4, low: 0.3, high: 1.0 });
            Material { opacity, ..with_dyes(Material::lambertian("net", flat(0.5)), &dyes) }
        }
        "mixed with holes" => {
            scene.materials[2].opacity =
                Some(ScalarTexture::Checker { columns: 5, rows: 2, low: 0.2, high: 0.9 });
            let opacity = Some(ScalarTexture::Checker { columns: 4, rows: 4, low: 0.5, high: 1.0 });
            Material { opacity, ..mixed(2, 3, ScalarTexture::Constant(0.4)) }
        }
        "bumpy mixture" => {
            Material { normal_map: Some(bumps()), ..mixed(2, 3, ScalarTexture::Constant(0.4)) }
        }
        "bumpy" => Material { normal_map: Some(bumps()), ..with_dyes(coated(0.5, 0.3), &dyes) },
        other => panic!("no material {other}"),
    };
    scene.materials.push(thing);
    let thing = scene.materials.len() - 1;
    let (x, y, z) = (Vec3::X * 2.0, Vec3::Y * 2.0, Vec3::Z * 2.0);
    let low = Vec3::splat(-1.0);
    scene.objects = vec![
        object("floor", quad(low, z, x), 1),
        object("back", quad(low, x, y), 0),
        object("left", quad(low, y, z), 0),
        object("ball", Shape::Sphere { center: Vec3::new(0.35, -0.5, 0.2), radius_m: 0.45 }, thing),
        object(
            "plate",
            quad(Vec3::new(-0.9, -0.6, 0.1), Vec3::new(0.8, 0.0, 0.2), Vec3::new(0.0, 0.7, -0.3)),
            thing,
        ),
    ];
    let blue = gaussian(390.0, 15.0, 1.0);
    let disc = Emitter::Disc(DiscEmitter {
        center: Vec3::new(0.2, 0.95, 0.3),
        normal: Vec3::NEG_Y,
        radius_m: 0.6,
        exponent: 1.0,
    });
    let rectangle = |exponent: f32| {
        Emitter::Rectangle(RectangleEmitter {
            corner: Vec3::new(-0.7, 0.98, -0.6),
            edge_u: Vec3::X * 1.4,
            edge_v: Vec3::Z * 1.2,
            exponent,
        })
    };
    let bright = |name: &str, shape: Shape| {
        let emission =
            Some(SurfaceEmission { group: 0, radiance: gaussian(390.0, 15.0, 0.3), is_one_sided: false });
        Object { emission, ..object(name, shape, 0) }
    };
    match lighting {
        "disc" => scene.lights.push(light(blue, disc)),
        "rectangle" => scene.lights.push(light(blue, rectangle(1.0))),
        "narrow rectangle" => scene.lights.push(light(blue, rectangle(4.0))),
        "sphere" => {
            let ball = Emitter::Sphere(SphereEmitter { center: Vec3::new(-0.3, 0.6, 0.4), radius_m: 0.35 });
            scene.lights.push(light(blue, ball));
        }
        "sky" => scene.lights.push(light(flat(1.0), patchy_sky(0.1))),
        "lamps and sky" => {
            scene.lights.push(light(blue.clone(), disc));
            scene.lights.push(light(flat(1.0), patchy_sky(0.1)));
            scene.lights.push(light(gaussian(550.0, 40.0, 0.02), Emitter::Environment));
        }
        "bright mesh" => {
            scene.objects.push(bright("lamp", quad(Vec3::new(-0.6, 0.9, -0.5), x * 0.6, z * 0.5)))
        }
        "bright ball" => {
            let ball = Shape::Sphere { center: Vec3::new(-0.3, 0.6, 0.4), radius_m: 0.35 };
            scene.objects.push(bright("lamp", ball));
        }
        "bright disc" => {
            let disc = Shape::Disc { center: Vec3::new(0.1, 0.8, 0.2), normal: Vec3::NEG_Y, radius_m: 0.6 };
            scene.objects.push(bright("lamp", disc));
        }
        other => panic!("no lighting {other}"),
    }
    scene
}

/// Values of one component and band, one per pixel.
fn band_values(image: &ComponentImage, component: usize, band: usize) -> impl Iterator<Item = f64> + '_ {
    image.stored(component).iter().skip(band).step_by(image.grid.len()).map(|&v| f64::from(v))
}

/// Mean of one component and band over pixels, with the standard error from pixel to pixel.
pub(crate) fn band_mean(image: &ComponentImage, component: usize, band: usize) -> MeanEstimate {
    MeanEstimate::of(&band_values(image, component, band).collect::<Vec<_>>())
}

/// Renders with other seeds, as independent measurements.
pub(crate) fn repeat(scene: &Scene, runs: u64, settings: &RenderSettings) -> Vec<ComponentImage> {
    (0..runs)
        .map(|i| run(scene, &RenderSettings { seed: 1000 * settings.seed + i, ..settings.clone() }))
        .collect()
}

/// Compares the mean of every component and band over two sets of independent renders by Welch's t-test. All tests of
/// the call together reject equal means with the probability `significance` (Sidak). On failure maps are saved and
/// named in the message.
pub(crate) fn assert_same_light(name: &str, a: &[ComponentImage], b: &[ComponentImage], significance: f64) {
    let (bands, components) = (a[0].grid.len(), a[0].components.len());
    let level = sidak(significance, components * bands);
    let mut failures = Vec::new();
    // Bands that hold less than 1e-5 of the brightest of their component are the far tails of lights and emission spectra,
    // where the quadrature of excitation within a band shows: no instrument sees that.
    let brightest: Vec<f64> = (0..components)
        .map(|component| {
            (0..bands).map(|band| band_mean(&a[0], component, band).mean.abs()).fold(0.0, f64::max)
        })
        .collect();
    for (component, &brightest) in brightest.iter().enumerate() {
        for band in 0..bands {
            let means = |images: &[ComponentImage]| -> Vec<f64> {
                images.iter().map(|image| band_mean(image, component, band).mean).collect()
            };
            let (x, y) = (means(a), means(b));
            // Without light on either side there is nothing to compare; single precision leaves 1e-6.
            let scale = x.iter().chain(&y).fold(0.0_f64, |m, v| m.max(v.abs()));
            let (mean_x, mean_y) = (MeanEstimate::of(&x).mean, MeanEstimate::of(&y).mean);
            if (mean_x - mean_y).abs() <= 1e-6 * scale || scale <= 1e-5 * brightest {
                continue;
            }
            let p = welch_t_test(&x, &y);
            if p.is_nan() || p < level {
                failures.push(format!(
                    "{} at {} nm: {mean_x:.6e} and {mean_y:.6e}, p = {p:.1e}",
                    a[0].components[component].label(),
                    a[0].grid.center_nm(band)
                ));
            }
        }
    }
    if !failures.is_empty() {
        let folder = save_error_maps(name, a, b);
        panic!("{name}: the two estimates differ\n{}\nmaps in {}", failures.join("\n"), folder.display());
    }
}

/// Saves the means of both sets as tables, and for every component an image (PPM) of the differences in standard errors:
/// white is none, red is 4 or more too bright in the first set, blue too dark. Returns the folder.
pub(crate) fn save_error_maps(name: &str, a: &[ComponentImage], b: &[ComponentImage]) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("fluorspar-transport-{}", name.replace([' ', '/'], "-")));
    std::fs::create_dir_all(&folder).unwrap();
    let average = |images: &[ComponentImage]| {
        let mut mean = images[0].clone();
        for (index, value) in mean.data.iter_mut().enumerate() {
            *value = images.iter().map(|i| i.data[index]).sum::<f32>() / images.len() as f32;
        }
        mean
    };
    for (set, images) in [("first", a), ("second", b)] {
        std::fs::write(folder.join(format!("{set}.csv")), table(&average(images))).unwrap();
    }
    for component in 0..a[0].components.len() {
        save_difference_image(&folder.join(format!("component-{component}.ppm")), a, b, component);
    }
    folder
}

/// Radiance of every component and band, one line per pixel of a component.
fn table(image: &ComponentImage) -> String {
    let bands = image.grid.len();
    let centers: Vec<String> = (0..bands).map(|band| format!("{} nm", image.grid.center_nm(band))).collect();
    let mut text = format!("component,row,column,{}\n", centers.join(","));
    for component in 0..image.components.len() {
        for (pixel, values) in image.stored(component).chunks(bands).enumerate() {
            let (row, column) = (pixel / image.width, pixel % image.width);
            let values: Vec<String> = values.iter().map(f32::to_string).collect();
            text += &format!("{component},{row},{column},{}\n", values.join(","));
        }
    }
    text
}

fn save_difference_image(path: &Path, a: &[ComponentImage], b: &[ComponentImage], component: usize) {
    let (width, height, bands) = (a[0].width, a[0].height, a[0].grid.len());
    let at = |images: &[ComponentImage], pixel: usize| {
        let sums: Vec<f64> = images
            .iter()
            .map(|i| {
                i.stored(component)[pixel * bands..(pixel + 1) * bands].iter().map(|&v| f64::from(v)).sum()
            })
            .collect();
        MeanEstimate::of(&sums)
    };
    let rgb: Vec<u8> = (0..width * height)
        .flat_map(|pixel| {
            let (x, y) = (at(a, pixel), at(b, pixel));
            let error = x.standard_error.hypot(y.standard_error);
            let z = if error > 0.0 { (x.mean - y.mean) / error } else { 0.0 };
            let fade = (255.0 * (1.0 - (z.abs() / 4.0).min(1.0))) as u8;
            if z > 0.0 { [255, fade, fade] } else { [fade, fade, 255] }
        })
        .collect();
    let head = format!("P6\n{width} {height}\n255\n").into_bytes();
    std::fs::write(path, [head, rgb].concat()).unwrap();
}

/// Next-event estimation with multiple importance sampling against scattered directions alone.
pub(crate) fn compare_estimators(lighting: &str, material: &str, samples: u32, runs: u64, significance: f64) {
    let scene = lit_box(lighting, material, 1.0);
    let guided = repeat(&scene, runs, &settings(samples, 6));
    let blind = RenderSettings { estimator: Estimator::ScatteringOnly, seed: 7, ..settings(4 * samples, 6) };
    let blind = repeat(&scene, runs, &blind);
    assert_same_light(&format!("{lighting} on {material}"), &guided, &blind, significance);
}
