//! Scenes as experiment files: they render to the same light.

use std::fs;

use fluorspar::render::{ComponentBands, RenderControl, RenderSettings, render};
use fluorspar::spectral::{Radiance, Spectrum};
use fluorspar_experiment::{parse, resolve};
use fluorspar_pbrt::{ConvertedScene, PbrtStudy, to_experiment};

use super::support::load_text;

const HEAD: &str = "LookAt 0 0 10  0 0 0  0 1 0\nCamera \"perspective\" \"float fov\" 40\n\
    Film \"image\" \"integer xresolution\" 24 \"integer yresolution\" 16\nSampler \"halton\" \"integer pixelsamples\" 4\n\
    Integrator \"path\" \"integer maxdepth\" 4\nWorldBegin\n";
const QUAD: &str = "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point P\" [-9 -9 -1  9 -9 -1  9 9 -1  -9 9 -1] \
                    \"float uv\" [0 0 1 0 1 1 0 1]\n";
const SUN: &str = "LightSource \"distant\" \"point from\" [1 2 9] \"spectrum L\" [300 1 500 3 900 2]\n";

/// Mean radiance in each band of a scene and of the experiment that it becomes.
fn both(study: &PbrtStudy) -> [Vec<f64>; 2] {
    let converted: ConvertedScene = to_experiment(study, "a scene", "files").unwrap();
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("files")).unwrap();
    converted.write_files(&folder.path().join("files")).unwrap();
    let parsed = parse(&converted.text, "a.toml", folder.path(), &[]).unwrap_or_else(|e| panic!("{e}"));
    let resolved = resolve(&parsed).unwrap_or_else(|error| panic!("{error}\n{}", converted.text));
    let control = RenderControl { stop: &std::sync::atomic::AtomicBool::new(false), progress: &|_| () };
    [&study.study, &resolved.study].map(|study| {
        let all_bands = RenderSettings { component_bands: ComponentBands::All, ..study.render.clone() };
        let image = render(&study.scene, &all_bands, &control).unwrap();
        let mean: Spectrum<Radiance> = image.recombine(|_| 1.0).mean_spectrum();
        mean.values().to_vec()
    })
}

/// The paths are the same. What differs is rounded on the way: places in millimeters, powers as sums over the spectrum, maps in
/// 16 bits.
fn assert_same_light(text: &str) -> PbrtStudy {
    let study = load_text(text);
    let [pbrt, experiment] = both(&study);
    let most = pbrt.iter().copied().fold(0.0, f64::max);
    assert!(most > 0.0, "the scene is dark");
    for (band, (a, b)) in pbrt.iter().zip(&experiment).enumerate() {
        assert!((a - b).abs() <= 2e-4 * most, "band {band}: {a} {b}, most {most}\n{text}");
    }
    study
}

#[test]
fn shapes_and_lights_become_experiments() {
    let shapes = "Material \"matte\" \"rgb Kd\" [0.7 0.3 0.2]\n".to_string()
        + QUAD
        + "AttributeBegin Translate 2 0 0 Shape \"sphere\" \"float radius\" 1 AttributeEnd\n\
           AttributeBegin Translate -2 1 1 Rotate 30 1 0 0 Shape \"disk\" \"float radius\" 1 AttributeEnd\n\
           ObjectBegin \"leaf\" Shape \"cylinder\" \"float radius\" 0.3 ObjectEnd\n\
           AttributeBegin Translate 0 2 0 ObjectInstance \"leaf\" AttributeEnd\n\
           AttributeBegin Translate 0 -2 0 Scale 1 2 1 ObjectInstance \"leaf\" AttributeEnd\n";
    let lights = [
        SUN,
        "LightSource \"point\" \"point from\" [1 1 5] \"rgb I\" [20 30 20]\n",
        "LightSource \"spot\" \"point from\" [0 0 8] \"point to\" [0 0 0] \"rgb I\" [30 30 30] \"float coneangle\" 25\n",
        "LightSource \"infinite\" \"rgb L\" [0.5 0.6 0.9]\n",
        "AttributeBegin AreaLightSource \"diffuse\" \"blackbody L\" [3000 5]\nTranslate 0 3 4 Rotate 180 1 0 0 Shape \"disk\" \
         \"float radius\" 1 AttributeEnd\n",
    ];
    for light in lights {
        assert_same_light(&format!("{HEAD}{light}{shapes}"));
    }
}

#[test]
fn materials_and_textures_become_experiments() {
    let materials = [
        "Material \"glass\" \"float eta\" 1.5",
        "Material \"metal\" \"spectrum eta\" \"metal-Cu-eta\" \"spectrum k\" \"metal-Cu-k\" \"float roughness\" 0.1",
        "Material \"plastic\" \"rgb Kd\" [0.2 0.5 0.2] \"rgb Ks\" [0.5 0.5 0.5]",
        "Texture \"c\" \"spectrum\" \"checkerboard\" \"float uscale\" 4 \"float vscale\" 4 \"rgb tex1\" [1 0 0] \"rgb tex2\" [0 0 1]\n\
         Material \"matte\" \"texture Kd\" \"c\"",
        "MakeNamedMaterial \"a\" \"string type\" \"matte\" \"rgb Kd\" [0.9 0.9 0.1]\nMakeNamedMaterial \"b\" \"string type\" \
         \"mirror\"\nMaterial \"mix\" \"string namedmaterial1\" \"a\" \"string namedmaterial2\" \"b\" \"rgb amount\" [0.3 0.3 0.3]",
        "Texture \"n\" \"float\" \"bilerp\" \"float v00\" 0.1 \"float v11\" 0.9\nMaterial \"uber\" \"texture opacity\" \"n\"",
    ];
    for material in materials {
        let ball = "AttributeBegin Translate 0 0 1 Shape \"sphere\" \"float radius\" 1.5 AttributeEnd\n";
        let sky = "LightSource \"infinite\" \"rgb L\" [0.2 0.3 0.4]\n";
        assert_same_light(&format!("{HEAD}{SUN}{sky}{material}\n{QUAD}{ball}"));
    }
}

#[test]
fn fluorescence_and_parallel_rays_become_experiments() {
    let mut values = "400 10 700".to_string();
    for i in 0..31 * 31 {
        let (row, column) = (i / 31, i % 31);
        let value = if row > column { ((row * 7 + column * 3) % 11) as f64 / 10.0 } else { 0.0 };
        values.push_str(&format!(" {value}"));
    }
    let material = format!(
        "Material \"matte\" \"rgb Kd\" [0.2 0.2 0.2] \"photolumi fluorescence\" [{values}] \"float concentration\" 0.02\n"
    );
    let study = assert_same_light(&format!("{HEAD}{SUN}{material}{QUAD}"));
    assert_eq!(study.study.scene.fluorophores.len(), 1);
    let parallel = HEAD
        .replace("\"perspective\" \"float fov\" 40", "\"orthographic\" \"float screenwindow\" [-3 3 -2 2]");
    let study = assert_same_light(&format!("{parallel}{SUN}{material}{QUAD}"));
    assert_eq!(study.study.scene.camera.parallel_half_width_m, Some(3.0));
}

/// Pixels of a window see what those of the whole image see, whatever way it is asked for; an experiment holds them in its image.
#[test]
fn windows_are_parts_of_the_whole_image() {
    let film =
        |more: &str| format!("Film \"image\" \"integer xresolution\" 15 \"integer yresolution\" 10 {more}\n");
    let scene = "WorldBegin LightSource \"infinite\" Shape \"sphere\"\n";
    let camera_of = |text: String| load_text(&text).study.scene.camera.clone();
    for kind in ["\"perspective\" \"float fov\" 40", "\"orthographic\""] {
        let whole = camera_of(format!("Camera {kind}\n{}{scene}", film("")));
        let crops = [
            // ceil(15 * 0.3) to ceil(15 * 0.8), ceil(10 * 0.41) to ceil(10 * 0.95)
            film("\"float cropwindow\" [ .3 .8 .41 .95 ]"),
            film("\"float cropwindow\" [ 0 1 0 1 ] \"integer pixelbounds\" [ 5 12 5 10 ]"),
        ];
        for crop in crops {
            let text = format!("Camera {kind}\n{crop}{scene}");
            let window = camera_of(text.clone());
            assert_eq!((window.width, window.height), (7, 5));
            let converted = to_experiment(&load_text(&text), "s", "files").unwrap();
            assert!(converted.lost.iter().any(|line| line.contains("off its axis")), "{:?}", converted.lost);
            // Columns 3 to 11 and rows 0 to 9 lie about the middle
            assert!(["width_px = 9", "height_px = 10"].iter().all(|side| converted.text.contains(side)));
            for (x, y) in [(0.5, 0.5), (6.5, 4.5)] {
                let ((from, along), (at, wanted)) = (window.ray(x, y), whole.ray(5.0 + x, 5.0 + y));
                assert!(from.abs_diff_eq(at, 1e-6) && along.abs_diff_eq(wanted, 1e-6), "{kind} {crop}");
            }
        }
    }
}

/// An orthographic camera sees lengths, not angles: a disc of radius 1 fills pi/24 of a window of 6 x 4, near or far.
#[test]
fn parallel_rays_see_things_as_large_as_they_are() {
    for (distance, left) in [(1.0, -3.0), (8.0, -3.0), (8.0, -1.5)] {
        let right = left + 6.0;
        let text = format!(
            "Camera \"orthographic\" \"float screenwindow\" [{left} {right} -2 2]\nFilm \"image\" \"integer xresolution\" 240 \"integer \
             yresolution\" 160\nWorldBegin LightSource \"infinite\" \"rgb L\" [0 0 0]\nAreaLightSource \"diffuse\" \"rgb L\" \
             [1 1 1] \"bool twosided\" true\nTranslate 1 0 {distance} Shape \"disk\" \"float radius\" 1\n"
        );
        let study = load_text(&text);
        let image = super::support::rendered(&study, 1, 40);
        let lit: Vec<usize> = (0..image.pixels.len()).filter(|i| image.pixels[*i] > 0.0).collect();
        let share = lit.len() as f64 / image.pixels.len() as f64;
        // Its outline crosses about 320 pixels, each lit or not by one sample: 9 pixels, three standard errors.
        assert!((share - std::f64::consts::PI / 24.0).abs() < 30.0 / image.pixels.len() as f64, "{share}");
        let column = lit.iter().map(|i| (i % 240) as f64 + 0.5).sum::<f64>() / lit.len() as f64;
        let expected = 240.0 * (1.0 - left) / 6.0;
        assert!((column - expected).abs() < 0.5, "the middle of the disc is at 1: {column}");
    }
}
