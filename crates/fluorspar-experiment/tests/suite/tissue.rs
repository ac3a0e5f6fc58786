//! Layered tissue as a material of experiments.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use fluorspar::image::{ComponentImage, LightPath};
use fluorspar::material::CoatAlbedo;
use fluorspar::pipeline::depths_of_light;
use fluorspar::render::{RenderControl, RenderSettings, render};
use fluorspar::spectral::Curve;
use fluorspar::study::Study;
use fluorspar::tissue::{
    Blood, Chromophore, EffectiveTissue, LayerFluorophore, LayeredTissue, Level, ScatteringCoefficient,
    TissueFluorophore, TissueLayer,
};
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{parse, parse_sample, resolve};

/// A patch of lip under even light from everywhere, seen head-on.
const PATCH: &str = r#"
format = 1
spectral = { first_nm = 390.0, last_nm = 710.0, step_nm = 10.0 }
render = { width_px = 12, height_px = 8, samples_per_pixel = 4096, max_depth = 1 }
camera = { position_mm = [0.0, 0.0, 100.0], horizontal_field_deg = 2.0 }

[[light]]
name = "sky"
type = "environment"
spectrum = { type = "led", peak_nm = 420.0, fwhm_short_nm = 60.0, fwhm_long_nm = 60.0 }
strength.radiance_w_per_sr_m2 = 1.0

[[material]]
name = "patch"
type = "tissue"
tissue = "lip"
gloss.roughness = 0.01

[[object]]
name = "patch"
material = "patch"
type = "quad"
corner_mm = [-100.0, -100.0, 0.0]
edge_u_mm = [200.0, 0.0, 0.0]
edge_v_mm = [0.0, 200.0, 0.0]
"#;

fn study(text: &str, changes: &[&str]) -> Study {
    let changes: Vec<String> = changes.iter().map(|change| (*change).to_owned()).collect();
    resolve(&parse(text, "tissue.toml", Path::new("."), &changes).unwrap()).unwrap().study
}

fn refusal(text: &str) -> String {
    match parse(text, "tissue.toml", Path::new("."), &[]).and_then(|experiment| resolve(&experiment)) {
        Ok(_) => panic!("accepted"),
        Err(error) => error.to_string(),
    }
}

fn image(study: &Study, settings: &RenderSettings) -> ComponentImage {
    let stop = AtomicBool::new(false);
    render(&study.scene, settings, &RenderControl { stop: &stop, progress: &|_| {} }).unwrap()
}

/// A band of all pixels, summed over the components that `wanted` selects.
fn pixels(image: &ComponentImage, band: usize, wanted: impl Fn(&LightPath) -> bool) -> Vec<f64> {
    let bands = image.grid.len();
    let mut sums = vec![0.0; image.width * image.height];
    for component in (0..image.components.len()).filter(|&c| wanted(&image.components[c].light)) {
        let spectra = image.component(component);
        let values = spectra.iter().skip(band).step_by(bands);
        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += f64::from(*value));
    }
    sums
}

/// Mean over pixels of a band of the components that `wanted` selects.
fn mean(image: &ComponentImage, band: usize, wanted: impl Fn(&LightPath) -> bool) -> f64 {
    let pixels = pixels(image, band, wanted);
    pixels.iter().sum::<f64>() / pixels.len() as f64
}

fn lip(study: &Study) -> EffectiveTissue {
    let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
    EffectiveTissue::for_grid(&preset::site("lip").unwrap().tissue(&find).unwrap(), &study.scene.grid)
        .unwrap()
}

/// Under diffuse light a rendered patch shows `E(o) + (1 - E(o)) R / (1 - E)` of the solver's R with its Fresnel surface, and
/// its fluorescence with the same factor: the surface is counted once.
#[test]
fn a_rendered_patch_under_diffuse_light_is_that_of_the_solver() {
    let samples = ["render.samples_per_pixel=2048"];
    let violet = study(PATCH, &samples);
    let rendered = image(&violet, &violet.render);
    let solved = lip(&violet);
    let (specular, _) = CoatAlbedo::shared(1.4).at(1.0, 0.01);
    let specular = f64::from(specular);
    let out = (1.0 - specular) / (1.0 - solved.specular_reflectance());
    // Radiance of even light over a white surface is that of the light: exitance and irradiance share the factor pi.
    let light = violet.scene.lights[0].whole_spectrum().into_owned();
    let grid = &violet.scene.grid;
    let range = (grid.start_nm(), grid.end_nm());
    let photons = light.clipped(range.0, range.1).times(&Curve::from_fn(range.0, range.1, |nm| nm));
    let per_nm = Curve::from_fn(range.0, range.1, |nm| 1.0 / nm);
    let mut fluorescent = vec![0.0; grid.len()];
    for part in solved.parts() {
        let emitted = solved.eem(part, Level::AboveSurface).unwrap().photon_exitance(&photons, range);
        let energy = emitted.times(&per_nm).bin_averages(grid);
        fluorescent.iter_mut().zip(energy).for_each(|(sum, value)| *sum += value);
    }
    for (band, fluorescent) in fluorescent.into_iter().enumerate() {
        // Nearer to the light its photons excite within their own band, of which a renderer knows the half.
        if grid.center_nm(band) < 425.0 {
            continue;
        }
        let of_pixels = pixels(&rendered, band, |light| matches!(light, LightPath::Fluorescence(_)));
        assert_met(of_pixels, out * fluorescent, &format!("fluorescence, band {band}"));
    }

    // Within a band a renderer knows means only; of light that is even over each band they are all that counts.
    let even = study(PATCH, &[samples[0], "light.sky.spectrum=1.0"]);
    let rendered = image(&even, &even.render);
    let bands = even.scene.lights[0].whole_spectrum().bin_averages(grid);
    let reflectance = solved.reflectance(Level::AboveSurface).bin_averages(grid);
    for band in 0..bands.len() {
        let of_pixels = pixels(&rendered, band, |light| *light == LightPath::Reflected);
        let expected = bands[band] * (specular + out * reflectance[band]);
        assert_met(of_pixels, expected, &format!("reflected, band {band}"));
    }
}

/// Mean over pixels within 1e-3 of what is expected. Pixels are independent renders of the same: their scatter gives the standard error
/// of the mean, of which four must fit into the tolerance beside what is found.
fn assert_met(pixels: Vec<f64>, expected: f64, what: &str) {
    let n = pixels.len() as f64;
    let mean = pixels.iter().sum::<f64>() / n;
    let error = (pixels.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt();
    assert!((mean / expected - 1.0).abs() < 1e-3, "{what}: {mean}, expected {expected}");
    assert!(4.0 * error < 1e-3 * expected, "{what}: standard error {}", error / expected);
}

/// Ten times the blood is darker in white light and in fluorescence; less collagen in fluorescence alone.
#[test]
fn lesions_of_tissue_change_both_pictures() {
    let light = |study: &Study, fluorescence: bool| {
        let settings = RenderSettings { samples_per_pixel: 4, ..study.render.clone() };
        let band = study.scene.grid.len() / 2;
        mean(&image(study, &settings), band, |light| {
            matches!(light, LightPath::Fluorescence(_)) == fluorescence
        })
    };
    let patch = |tissue: &str| {
        let text = PATCH.replace("tissue = \"lip\"", "tissue = \"mine\"");
        let section = format!("\n[[tissue]]\nname = \"mine\"\nsite = \"lip\"\n{tissue}\n");
        study(
            &(text + &section),
            &[
                "light.sky.spectrum={ type = \"led\", peak_nm = 480.0, fwhm_short_nm = 200.0, fwhm_long_nm = 200.0 }",
            ],
        )
    };
    let normal = patch("");
    let blood = patch("states = [\"hyperemia\"]");
    let collagen = patch("parameters = { deep_collagen_per_mm = 0.0, deep_elastin_per_mm = 0.0 }");
    assert!(light(&blood, false) < 0.97 * light(&normal, false));
    assert!(light(&blood, true) < 0.8 * light(&normal, true));
    assert!((light(&collagen, false) / light(&normal, false) - 1.0).abs() < 1e-6);
    assert!(light(&collagen, true) < 0.6 * light(&normal, true));
}

/// Half way, by ratio, between two blood contents of a map the surface is as the tissue of that content, to the error of interpolation.
#[test]
fn maps_of_parameters_give_the_tissue_of_each_place() {
    let varied = PATCH.replace(
        "gloss.roughness = 0.01",
        "gloss.roughness = 0.01\nvary = { superficial_blood_fraction = { checker = [1, 2], low = 0.5, high = 4.0 } }",
    );
    let study = study(&varied, &[]);
    let base = study.scene.materials[0].diffuse().unwrap();
    let states = base.states.as_ref().unwrap();
    let nodes = &states.parameters[0].nodes;
    assert!(nodes.len() > 2 && nodes[0] == 0.5 && nodes[nodes.len() - 1] == 4.0, "{nodes:?}");
    let [low, high] = [f64::from(nodes[0]), f64::from(nodes[1])];
    let between = (low * high).sqrt();
    let weight = (between - low) / (high - low);
    let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
    let mut site = preset::site("lip").unwrap();
    site.set("superficial_blood_fraction", between * site.get("superficial_blood_fraction").unwrap())
        .unwrap();
    let exact = EffectiveTissue::for_grid(&site.tissue(&find).unwrap(), &study.scene.grid).unwrap();
    let passed = 1.0 / (1.0 - exact.specular_reflectance());
    for nm in [420.0, 500.0, 540.0, 580.0, 635.0] {
        let exact: f64 = passed * Curve::at(&exact.reflectance(Level::AboveSurface), nm);
        let [low, high] = [0, 1].map(|state: usize| base.reflectance[state].spectrum.at(nm));
        let mean = low + weight * (high - low);
        assert!((mean / exact - 1.0).abs() < 0.015, "{nm} nm: {mean}, exact {exact}");
    }
}

#[test]
fn tissues_that_make_no_sense_are_refused_with_what_is_known() {
    let tissue = |lines: &str| {
        format!(
            "{}\n[[tissue]]\nname = \"mine\"\nsite = \"lip\"\n{lines}",
            PATCH.replace("tissue = \"lip\"", "tissue = \"mine\"")
        )
    };
    let message = refusal(&PATCH.replace("tissue = \"lip\"", "tissue = \"lipp\""));
    assert!(message.contains("did you mean \"lip\"") && message.contains("dorsal_tongue"), "{message}");
    let message = refusal(&tissue("parameters = { oxygen_saturation = 93.0 }"));
    assert!(message.contains("93") && message.contains("0 to 1"), "{message}");
    let message = refusal(&tissue("states = [\"inflamed\"]"));
    assert!(message.contains("inflammation"), "{message}");
    let message = refusal(&PATCH.replace("gloss.roughness = 0.01", "vary = { blood = 2.0 }"));
    assert!(message.contains("superficial_blood_fraction"), "{message}");
    let message = refusal(&PATCH.replace("gloss.roughness = 0.01", "vary = { melanin_fraction = 2.0 }"));
    assert!(message.contains("changes nothing"), "{message}");
    let message =
        refusal(&PATCH.replace("gloss.roughness = 0.01", "concentrations = { protoporphyrin_ix = 1.0 }"));
    assert!(message.contains("holds no protoporphyrin_ix") && message.contains("collagen"), "{message}");
    let vary = |maps: &str| PATCH.replace("gloss.roughness = 0.01", &format!("vary = {{ {maps} }}"));
    let map = "{ checker = [1, 2], low = 0.5, high = 2.0 }";
    let four =
        ["deep_blood_fraction", "superficial_blood_fraction", "epithelium_thickness_um", "background_per_mm"];
    let message = refusal(&vary(&four.map(|name| format!("{name} = {map}")).join(", ")));
    assert!(message.contains("tissue of material[0] \"patch\" varies by 4, "), "{message}");
    assert!(four.iter().all(|name| message.contains(name)), "{message}");
    // More light than is absorbed
    for (text, place) in [
        (tissue("parameters = { background_per_mm = 0.0 }"), "tissue[0] \"mine\": parameters"),
        (vary("background_per_mm = 0.01"), "material[0] \"patch\": tissue"),
        (
            vary("background_per_mm = { checker = [1, 2], low = 0.01, high = 1.0 }"),
            "material[0] \"patch\": tissue",
        ),
    ] {
        let message = refusal(&text);
        assert!(message.contains(place) && message.contains("the layer emits"), "{message}");
    }
}

/// A flat sample of tissue reflects and emits what the solver finds, with factors on what it holds.
#[test]
fn a_flat_sample_of_tissue_is_that_of_the_solver() {
    let text = "format = 1\n[spectral]\nfirst_nm = 390.0\nlast_nm = 710.0\nstep_nm = 10.0\n[light]\nspectrum = \"led_405\"\n\
                strength.irradiance_w_per_m2 = 100.0\n[sample]\ntissue = \"lip\"\nconcentrations = { collagen = 0.5 }\n";
    let sample = parse_sample(text, "lip.toml", Path::new("."), &[]).unwrap().sample;
    let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
    let tissue = preset::site("lip").unwrap().tissue(&find).unwrap();
    let solved = EffectiveTissue::for_grid(&tissue, &sample.grid).unwrap();
    for nm in [400.0, 450.0, 540.0, 580.0, 700.0] {
        let expected: f64 = solved.reflectance(Level::AboveSurface).at(nm);
        assert!((sample.reflectance.at(nm) / expected - 1.0).abs() < 1e-12, "{nm} nm");
    }
    for (emission, excitation) in [(500.0, 405.0), (560.0, 405.0), (640.0, 450.0)] {
        let found: f64 =
            sample.fluorophores.iter().map(|(held, factor)| factor * held.eem.at(emission, excitation)).sum();
        let of = |part: LayerFluorophore| {
            let name = &tissue.layers[part.layer].fluorophores[part.fluorophore].fluorophore.name;
            let factor = if name == "collagen" { 0.5 } else { 1.0 };
            factor * solved.yield_density(part, emission, excitation, Level::AboveSurface)
        };
        let expected: f64 = solved.parts().into_iter().map(of).sum();
        // Matrices are compressed to 1e-4 of their norm.
        assert!((found / expected - 1.0).abs() < 1e-3, "{emission}, {excitation}: {found}, {expected}");
    }
}

/// Red light comes from deeper than green and blue, from the layers that hold the fluorophores; a bloody tissue
/// shows only what lies above the blood.
#[test]
fn each_channel_sees_its_depth() {
    let text = preset::text(PresetKind::Experiment, "oraleye-2021").unwrap();
    let changes = ["mouth.detail=0.25".to_owned(), "spectral.step_nm=10".to_owned()];
    let mut study = resolve(&parse(text, "mouth", Path::new("."), &changes).unwrap()).unwrap().study;
    assert!(study.tissues.iter().any(|tissue| tissue.parts.contains(&"tongue_tip".to_owned())));
    study.tissues.retain(|tissue| ["tongue_dorsum", "cheek"].contains(&tissue.name.as_str()));
    let mut bloody = study.tissues[0].clone();
    let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
    let mut site = preset::site("dorsal_tongue").unwrap();
    site.set("superficial_blood_fraction", 0.06).unwrap();
    bloody.name = "bloody tongue".into();
    bloody.tissue = site.tissue(&find).unwrap();
    study.tissues.push(bloody);

    let blue = study.capture("blue").unwrap();
    let depths = depths_of_light(&study, &[blue]).unwrap();
    let of = |tissue: &str, channel: &str| {
        depths.iter().find(|depth| depth.tissue == tissue && depth.channel == channel).unwrap()
    };
    for tissue in ["tongue_dorsum", "cheek"] {
        let [red, green, blue] = ["R", "G", "B"].map(|channel| of(tissue, channel));
        assert!(red.median_um > green.median_um || tissue == "tongue_dorsum", "{red:?} {green:?}");
        for depth in [red, green, blue] {
            assert!((20.0..900.0).contains(&depth.median_um), "{depth:?}");
            assert!(depth.median_um < depth.depth_90_um && depth.quantiles_um.is_sorted(), "{depth:?}");
            assert!((depth.layers.iter().map(|layer| layer.share).sum::<f64>() - 1.0).abs() < 1e-9);
        }
    }
    let [healthy, bloody] = ["tongue_dorsum", "bloody tongue"].map(|tissue| of(tissue, "G"));
    assert!(bloody.depth_90_um < healthy.depth_90_um, "{bloody:?} {healthy:?}");
    // In the dark nothing comes from anywhere.
    let dark = study.capture("ambient").unwrap();
    assert!(depths_of_light(&study, &[dark]).unwrap().is_empty());
}

/// The photons that tissue emits do not depend on the width of the bands. The same paths carry all of them; what is left is
/// the discretization of the light within bands of 10 nm.
#[test]
fn photons_of_tissue_do_not_depend_on_the_bands() {
    let narrow =
        "light.sky.spectrum={ type = \"led\", peak_nm = 425.0, fwhm_short_nm = 15.0, fwhm_long_nm = 15.0 }";
    let photons = |step_nm: u32| -> [f64; 2] {
        // All grids reach from 385 to 715 nm.
        let half = f64::from(step_nm) / 2.0;
        let ends = [
            format!("spectral.step_nm={step_nm}"),
            format!("spectral.first_nm={:?}", 385.0 + half),
            format!("spectral.last_nm={:?}", 715.0 - half),
        ];
        let study = study(PATCH, &[narrow, &ends[0], &ends[1], &ends[2]]);
        let settings = RenderSettings { samples_per_pixel: 4, ..study.render.clone() };
        let image = image(&study, &settings);
        let grid = &study.scene.grid;
        let bands = || grid.centers_nm().into_iter().zip(grid.widths_nm()).enumerate();
        [true, false].map(|fluorescent| {
            let wanted = |light: &LightPath| matches!(light, LightPath::Fluorescence(_)) == fluorescent;
            bands().map(|(band, (nm, width))| nm * width * mean(&image, band, wanted)).sum()
        })
    };
    let fine = photons(1);
    for step_nm in [2, 5, 10] {
        for (found, expected) in photons(step_nm).into_iter().zip(fine) {
            assert!((found / expected - 1.0).abs() < 5e-3, "{step_nm} nm: {found}, {expected}");
        }
    }
}

/// A tissue as the `[[tissue.layer]]` sections of a file.
fn as_layers(tissue: &LayeredTissue) -> String {
    let scattering = |layer: &TissueLayer| match &layer.scattering.coefficient {
        ScatteringCoefficient::PowerLaw { scattering_per_mm, at_nm, power } => {
            format!("scattering_per_mm = {scattering_per_mm:?}, at_nm = {at_nm:?}, power = {power:?}")
        }
        ScatteringCoefficient::ReducedPowerLaw { reduced_per_mm, at_nm, power } => {
            format!("reduced_per_mm = {reduced_per_mm:?}, at_nm = {at_nm:?}, power = {power:?}")
        }
        other => panic!("{other:?}"),
    };
    let absorption = |chromophore: &Chromophore| match chromophore {
        Chromophore::Blood(Blood { volume_fraction, saturation, hemoglobin_g_per_l, vessel_radius_um }) => {
            format!(
                "blood = {{ volume_fraction = {volume_fraction:?}, saturation = {saturation:?}, hemoglobin_g_per_l = \
                 {hemoglobin_g_per_l:?}, vessel_radius_um = {vessel_radius_um:?} }}"
            )
        }
        Chromophore::Melanin { volume_fraction } => {
            format!("melanin = {{ volume_fraction = {volume_fraction:?} }}")
        }
        Chromophore::Background { absorption_per_mm, at_nm, slope_per_nm } => format!(
            "background = {{ absorption_per_mm = {absorption_per_mm:?}, at_nm = {at_nm:?}, slope_per_nm = {slope_per_nm:?} }}"
        ),
        other => panic!("{other:?}"),
    };
    let mut text = format!("refractive_index = {:?}\n", tissue.refractive_index);
    for layer in &tissue.layers {
        let held = |held: &TissueFluorophore| {
            let name = &held.fluorophore.name;
            format!("{name} = {{ strength_per_mm = {:?}, at_nm = {:?} }}", held.strength_per_mm, held.at_nm)
        };
        let index = layer.refractive_index.map(|index| format!("refractive_index = {index:?}\n"));
        text += &format!(
            "[[tissue.layer]]\nname = \"{}\"\nthickness_um = {:?}\n{}scattering = {{ anisotropy = {:?}, {} }}\nabsorption = {{ {} \
             }}\nfluorophores = {{ {} }}\n",
            layer.name.replace(' ', "_"),
            layer.thickness_um,
            index.unwrap_or_default(),
            layer.scattering.anisotropy,
            scattering(layer),
            layer.absorption.iter().map(absorption).collect::<Vec<_>>().join(", "),
            layer.fluorophores.iter().map(held).collect::<Vec<_>>().join(", "),
        );
    }
    text
}

/// Sites that are written out layer by layer reflect and emit as the sites do, to the order in which absorptions add up.
#[test]
fn a_site_written_out_layer_by_layer_is_the_site() {
    let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
    for site in ["lip", "facial_skin", "tooth"] {
        let layers = as_layers(&preset::site(site).unwrap().tissue(&find).unwrap());
        let sample = |tissue: &str| {
            let text = format!(
                "format = 1\n[spectral]\nfirst_nm = 390.0\nlast_nm = 710.0\nstep_nm = 20.0\n[light]\nspectrum = \"led_405\"\n\
                 strength.irradiance_w_per_m2 = 100.0\n[sample]\ntissue = \"{tissue}\"\n[[tissue]]\nname = \"mine\"\n{layers}"
            );
            parse_sample(&text, "mine.toml", Path::new("."), &[]).unwrap_or_else(|e| panic!("{e}")).sample
        };
        let [mine, known] = ["mine", site].map(sample);
        for nm in [400.0, 450.0, 540.0, 635.0, 700.0] {
            assert!(
                (mine.reflectance.at(nm) / known.reflectance.at(nm) - 1.0).abs() < 1e-9,
                "{site} {nm} nm"
            );
        }
        for (fluorophore, _) in &known.fluorophores {
            let same = mine.fluorophores.iter().find(|(other, _)| other.name == fluorophore.name).unwrap();
            let [a, b] = [&same.0, fluorophore].map(|f| f.eem.at(540.0, 410.0));
            assert!((a - b).abs() <= 1e-9 * b, "{site} {}: {a}, {b}", fluorophore.name);
        }
    }
}

/// Maps vary the parameters of layers as they vary those of sites; overrides reach into layers; files hold spectra of coefficients.
#[test]
fn layers_vary_over_a_surface_and_can_be_changed() {
    let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
    let layers = as_layers(&preset::site("lip").unwrap().tissue(&find).unwrap());
    let material = |tissue: &str, parameter: &str| {
        PATCH.replace("tissue = \"lip\"", &format!("tissue = \"{tissue}\"")).replace(
            "gloss.roughness = 0.01",
            &format!("vary = {{ {parameter} = {{ checker = [1, 2], low = 0.5, high = 2.0 }} }}"),
        ) + &format!("\n[[tissue]]\nname = \"mine\"\n{layers}")
    };
    let coarse = ["spectral.step_nm=20"];
    let [mine, known] = [
        study(&material("mine", "superficial_stroma_blood_fraction"), &coarse),
        study(&material("lip", "superficial_blood_fraction"), &coarse),
    ]
    .map(|study| study.scene.materials[0].diffuse().unwrap().clone());
    assert_eq!(mine.reflectance.len(), known.reflectance.len());
    for (a, b) in mine.reflectance.iter().zip(&known.reflectance) {
        assert!((a.spectrum.at(540.0) / b.spectrum.at(540.0) - 1.0).abs() < 1e-6);
    }

    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("ink.csv"), "nm,per_mm\n380,2\n720,2\n").unwrap();
    let reflectance = |changes: &[&str]| {
        let changes: Vec<String> = coarse.iter().chain(changes).map(|c| (*c).to_owned()).collect();
        let text = material("mine", "keratin_thickness_um");
        let experiment = parse(&text, "mine.toml", folder.path(), &changes).unwrap_or_else(|e| panic!("{e}"));
        let study = resolve(&experiment).unwrap_or_else(|e| panic!("{e}")).study;
        study.scene.materials[0].diffuse().unwrap().reflectance[0].spectrum.at(635.0)
    };
    let plain = reflectance(&[]);
    let ink = folder.path().join("ink.csv");
    let inked =
        format!("tissue.mine.layer.epithelium.absorption.curves.ink={{ csv = {:?} }}", ink.to_str().unwrap());
    assert!(reflectance(&[&inked]) < 0.8 * plain);
    assert!(reflectance(&["tissue.mine.layer.deep_stroma.scattering.reduced_per_mm=0.5"]) < 0.9 * plain);
    // Another kind of tissue takes the place of the layers.
    let skin = reflectance(&["tissue.mine.site=\"facial_skin\""]);
    assert!((skin / plain - 1.0).abs() > 1e-3, "{skin}, {plain}");
}
