//! Scenes written for pbrt and read back.

use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::image::ComponentImage;
use fluorspar::render::{RenderControl, RenderSettings, render};
use fluorspar::scene::Scene;
use fluorspar::study::Study;
use fluorspar_experiment::{parse, resolve};
use fluorspar_pbrt::{PbrtOptions, PbrtStudy, load, to_gltf, to_pbrt};
use fluorspar_testkit::{sidak, welch_t_test};

/// Repeats of a render with other seeds.
const REPEATS: u64 = 6;

fn study_of(text: &str) -> Study {
    let parsed = parse(text, "a.toml", Path::new("."), &[]).unwrap_or_else(|error| panic!("{error}"));
    resolve(&parsed).unwrap_or_else(|error| panic!("{error}")).study
}

/// What is lost on the way to pbrt, and the scene that is read back, with its text.
fn there_and_back(study: &Study) -> (Vec<String>, PbrtStudy, String) {
    let written = to_pbrt(&study.scene, &study.render, &|_| 1.0, "a scene", "files");
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("files")).unwrap();
    written.write_files(&folder.path().join("files")).unwrap();
    let path = folder.path().join("a.pbrt");
    fs::write(&path, &written.text).unwrap();
    let options = PbrtOptions { grid: study.scene.grid.clone(), ..PbrtOptions::default() };
    let back = load(&path, &options).unwrap_or_else(|error| panic!("{error}\n{}", written.text));
    (written.lost, back, written.text)
}

fn rendered(scene: &Scene, settings: &RenderSettings, seed: u64) -> ComponentImage {
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| () };
    render(scene, &RenderSettings { seed, ..settings.clone() }, &control).unwrap()
}

/// Mean radiance in quarters of the image and of the spectrum.
fn parts(image: &ComponentImage) -> Vec<f64> {
    let sum = image.recombine(|_| 1.0);
    let (width, height, bands) = (sum.width(), sum.height(), sum.bands());
    let mut means = vec![0.0; 16];
    for row in 0..height {
        for col in 0..width {
            let quarter = 2 * (2 * row / height) + 2 * col / width;
            for (band, value) in sum.pixel(row, col).iter().enumerate() {
                means[4 * quarter + 4 * band / bands] += f64::from(*value);
            }
        }
    }
    means
}

/// Both scenes show the same surfaces at the same places, and their light differs by no more than repeats do.
fn assert_same_picture(study: &Study, back: &PbrtStudy, text: &str) {
    let [here, there] = [&study.scene, &back.study.scene]
        .map(|scene| (0..REPEATS).map(|seed| rendered(scene, &study.render, seed + 1)).collect::<Vec<_>>());
    let depths = |images: &[ComponentImage]| images[0].features.depth_m.clone();
    let (a, b) = (depths(&here), depths(&there));
    // Two that see nothing are alike: their difference is no number
    let is_near = |(a, b): &(&f32, &f32)| a == b || (*a - *b).abs() < 1e-4 * **a;
    let far = a.len() - a.iter().zip(&b).filter(is_near).count();
    assert!(far * 100 <= a.len(), "{far} of {} pixels see something else\n{text}", a.len());
    let [here, there] = [here, there].map(|images| images.iter().map(parts).collect::<Vec<_>>());
    for part in 0..16 {
        let of = |all: &[Vec<f64>]| all.iter().map(|parts| parts[part]).collect::<Vec<f64>>();
        let (a, b) = (of(&here), of(&there));
        let [mean_a, mean_b] = [&a, &b].map(|values| values.iter().sum::<f64>() / values.len() as f64);
        if mean_a == 0.0 && mean_b == 0.0 {
            continue;
        }
        let p = welch_t_test(&a, &b);
        assert!(p > sidak(1e-4, 16), "part {part}: {mean_a} {mean_b}, p = {p:e}\n{text}");
        // Noise hides no other scene
        assert!((mean_a / mean_b - 1.0).abs() < 0.05, "part {part}: {mean_a} {mean_b}\n{text}");
    }
}

const HEAD: &str = "format = 1\n[render]\nwidth_px = 24\nheight_px = 16\nsamples_per_pixel = 64\nmax_depth = 4\n[spectral]\nfirst_nm = 380\n\
    last_nm = 700\nstep_nm = 10\n[camera]\nposition_mm = [20, 90, 260]\nlook_at_mm = [0, 15, 0]\nhorizontal_field_deg = 40\n";
const TABLE: &str = "[[object]]\nname = \"table\"\nmaterial = \"paint\"\ntype = \"quad\"\ncorner_mm = [-150, 0, 150]\nedge_u_mm = [300, 0, 0]\n\
    edge_v_mm = [0, 0, -300]\n";

fn ball(name: &str, material: &str, x_mm: f64) -> String {
    format!(
        "[[object]]\nname = \"{name}\"\nmaterial = \"{material}\"\ntype = \"sphere\"\ncenter_mm = [{x_mm}, 20, 0]\nradius_mm = 20\n"
    )
}

#[test]
fn an_aperture_stays() {
    let text = "format = 1\n[camera]\nlook_at_mm = [0, 0, -20]\nhorizontal_field_deg = 30\naperture_mm = 4\n[[light]]\nname = \"sky\"\n\
                type = \"environment\"\nspectrum = 1\nstrength.radiance_w_per_sr_m2 = 1\n[[material]]\nname = \"paint\"\nreflectance = 0.5\n";
    let study = study_of(&format!("{text}{TABLE}"));
    let (lost, back, text) = there_and_back(&study);
    assert!(lost.is_empty(), "{lost:?}");
    let [here, there] = [&study, &back.study]
        .map(|study| study.scene.camera.aperture.as_ref().map(|a| [a.radius(), a.focus()]));
    assert_eq!(here, Some([2e-3, 0.12]));
    assert_eq!(there, here, "{text}");
}

#[test]
fn materials_and_lights_come_back_from_version_4() {
    let materials = "[[material]]\nname = \"paint\"\nreflectance = \"enamel\"\n\
        [[material]]\nname = \"lacquer\"\nreflectance = 0.4\ngloss = { refractive_index = 1.5, roughness = 0.2 }\n\
        [[material]]\nname = \"gold\"\ntype = \"conductor\"\nmetal = \"gold\"\nroughness = 0.3\n\
        [[material]]\nname = \"half\"\ntype = \"mix\"\nfirst = \"paint\"\nsecond = \"gold\"\namount = 0.3\n";
    let lights = "[[light]]\nname = \"sheet\"\ntype = \"rectangle\"\nspectrum = \"led_450\"\nposition_mm = [-60, 160, 80]\naim.look_at_mm = [0, 20, 0]\n\
        size_mm = [40, 30]\nstrength.power_mw = 1000\n\
        [[light]]\nname = \"ring\"\ntype = \"annulus\"\nspectrum = \"halogen\"\nposition_mm = [60, 150, 80]\naim.look_at_mm = [0, 20, 0]\n\
        inner_radius_mm = 10\nradius_mm = 20\nstrength.power_mw = 600\n\
        [[light]]\nname = \"spot\"\ntype = \"spot\"\nspectrum = \"halogen\"\nposition_mm = [0, 200, 100]\naim.look_at_mm = [0, 0, 0]\n\
        cone_deg = [10, 20]\nstrength.power_mw = 100\n\
        [[light]]\nname = \"sun\"\ntype = \"distant\"\nspectrum = \"led_500\"\naim.direction = [0.2, -1, -0.5]\n\
        strength.irradiance_w_per_m2 = 2\n\
        [[light]]\nname = \"room\"\ntype = \"environment\"\nspectrum = \"halogen\"\nstrength.radiance_w_per_sr_m2 = 0.5\n";
    let balls = ball("a", "lacquer", -60.0) + &ball("b", "gold", -10.0) + &ball("c", "half", 40.0);
    let study = study_of(&format!("{HEAD}{lights}{materials}{TABLE}{balls}"));
    let (lost, back, text) = there_and_back(&study);
    assert!(lost.is_empty() && text.contains("of pbrt, version 4 in meters"), "{lost:?}");
    assert_same_picture(&study, &back, &text);
    // Amounts hold in whatever way spectra of lights are read
    let options = PbrtOptions { emission: fluorspar_pbrt::Emission::Photometric, ..PbrtOptions::default() };
    let folder = tempfile::tempdir().unwrap();
    let written = to_pbrt(&study.scene, &study.render, &|_| 1.0, "a scene", "files");
    fs::create_dir(folder.path().join("files")).unwrap();
    written.write_files(&folder.path().join("files")).unwrap();
    fs::write(folder.path().join("a.pbrt"), &written.text).unwrap();
    let photometric = load(&folder.path().join("a.pbrt"), &options).unwrap();
    for (a, b) in photometric.study.scene.lights.iter().zip(&back.study.scene.lights) {
        let ratio = a.spectrum.total() * 683.0 / b.spectrum.total();
        assert!((ratio - 1.0).abs() < 1e-3, "{}: {ratio}", a.name);
    }
}

#[test]
fn fluorescence_comes_back_from_version_3() {
    let materials = "[[material]]\nname = \"paint\"\nreflectance = 0.3\n\
        [[material]]\nname = \"elastin\"\nreflectance = 0.1\nconcentrations = { elastin = 100.0 }\n\
        [[material]]\nname = \"tooth\"\nreflectance = \"enamel\"\ngloss = { refractive_index = 1.6, roughness = 0.12 }\n\
        concentrations = { dentin = 0.4, enamel = 0.6 }\n";
    let lights = "[[light]]\nname = \"violet\"\ntype = \"rectangle\"\nspectrum = \"halogen\"\nposition_mm = [-60, 160, 80]\n\
        aim.look_at_mm = [0, 20, 0]\nsize_mm = [40, 40]\nstrength.power_mw = 1000\n";
    // Names that pbrt can't hold, and that a disk takes for the same
    let materials = materials.replace("\"tooth\"", "'a \"tooth\"'");
    let balls = ball("a", "elastin", -40.0) + &ball("b", "tooth", 30.0).replace("\"tooth\"", "'a \"tooth\"'");
    let study = study_of(&format!("{HEAD}{lights}{materials}{TABLE}{balls}"));
    let (lost, back, text) = there_and_back(&study);
    assert!(lost.is_empty() && text.contains("a scene of pbrt-v3-spectral"), "{lost:?}");
    assert_eq!(back.study.scene.fluorophores.len(), 2);
    assert_same_picture(&study, &back, &text);
    // Fluorescence alone: reflected light would hide it
    let fluorescent = |scene: &Scene| {
        let image = rendered(scene, &study.render, 1);
        let fluoresced = image.recombine(|component| {
            f64::from(u8::from(component.light != fluorspar::image::LightPath::Reflected))
        });
        fluoresced.mean_spectrum().values().iter().sum::<f64>()
    };
    let [here, there] = [&study.scene, &back.study.scene].map(fluorescent);
    assert!(here > 0.0 && (here / there - 1.0).abs() < 0.02, "{here} {there}");
}

/// What glTF holds: places to 1e-6 m, a camera that sees the same, watts.
#[test]
fn a_drawing_has_camera_and_lights() {
    let study = study_of("format = 1\nbase = \"fluorescent-sphere\"");
    let drawn = to_gltf(&study.scene, &|_| 0.5);
    assert_eq!(drawn.parts.len(), study.scene.objects.len());
    let camera = drawn.camera.unwrap();
    let horizontal = 2.0 * ((0.5 * camera.vertical_field).tan() * camera.aspect).atan().to_degrees();
    assert!((horizontal - 40.0).abs() < 1e-4, "{horizontal}");
    let sphere = drawn.parts.iter().find(|part| part.name == "white_sphere").unwrap();
    let (low, high) = sphere.mesh.bounds();
    assert!(
        (low - glam::Vec3::new(0.02, 0.0, -0.02)).length() < 1e-5 && (high.y - 0.04).abs() < 1e-6,
        "{low} {high}"
    );
    assert!(sphere.color.iter().all(|value| (0.9..=1.0).contains(value)), "{:?}", sphere.color);
    // At half its drive, cos to one side: half of its power over pi ahead
    let power = study.scene.lights[0].spectrum.total();
    assert!(drawn.lights.len() == 1 && (0.8..1.0).contains(&power), "{power}");
    assert!(
        (drawn.lights[0].radiant * std::f64::consts::PI / (0.5 * power) - 1.0).abs() < 1e-6,
        "{:?}",
        drawn.lights[0]
    );
    assert!(drawn.lost.iter().any(|what| what.contains("\"room\"")), "{:?}", drawn.lost);
}

/// An LED becomes a spot of the same power that is as bright ahead.
#[test]
fn narrow_light_keeps_its_power_and_its_axis() {
    let light = "[[light]]\nname = \"led\"\ntype = \"spot\"\nspectrum = \"led_450\"\nposition_mm = [0, 150, 80]\naim.look_at_mm = [0, 0, 0]\n\
        half_angle_deg = 25\nstrength.power_mw = 200\n";
    for concentrations in ["", "concentrations = { elastin = 1.0 }\n"] {
        let material = format!("[[material]]\nname = \"paint\"\nreflectance = 0.3\n{concentrations}");
        let study = study_of(&format!("{HEAD}{light}{material}{TABLE}"));
        let (lost, back, text) = there_and_back(&study);
        assert!(lost[0].starts_with("the pattern of light led: a spot of the same power"), "{lost:?}");
        let [here, there] = [&study.scene, &back.study.scene].map(|scene| &scene.lights[0].spectrum);
        assert!((here.total() / there.total() - 1.0).abs() < 1e-3, "{text}");
        // What the axis meets gets as much
        let ahead = |scene: &Scene| {
            let image = rendered(scene, &RenderSettings { max_depth: 1, ..study.render.clone() }, 1);
            let sum = image.recombine(|_| 1.0);
            sum.pixel(9, 12).iter().sum::<f32>()
        };
        let [here, there] = [&study.scene, &back.study.scene].map(ahead);
        assert!((here / there - 1.0).abs() < 0.05, "{here} {there}\n{text}");
    }
}
