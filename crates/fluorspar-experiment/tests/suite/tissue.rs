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
use fluorspar::tissue::{EffectiveTissue, LayerFluorophore, Level, Site};
use fluorspar_experiment::{parse, parse_sample, preset, resolve};

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

/// Mean over pixels of a band of the components that `wanted` selects.
fn mean(image: &ComponentImage, band: usize, wanted: impl Fn(&LightPath) -> bool) -> f64 {
    let bands = image.grid.len();
    let chosen = (0..image.components.len()).filter(|&c| wanted(&image.components[c].light));
    let of = |component: usize| {
        let values = image.component(component).iter().skip(band).step_by(bands);
        let (count, sum) =
            values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + f64::from(*value)));
        sum / count
    };
    chosen.map(of).sum()
}

fn lip(study: &Study) -> EffectiveTissue {
    let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
    EffectiveTissue::for_grid(&Site::named("lip").unwrap().tissue(&find).unwrap(), &study.scene.grid).unwrap()
}

/// Under diffuse light a rendered patch shows `E(o) + (1 - E(o)) R / (1 - E)` of the solver's R with its Fresnel surface, and
/// its fluorescence with the same factor: the surface is counted once.
#[test]
fn a_rendered_patch_under_diffuse_light_is_that_of_the_solver() {
    let study = study(PATCH, &[]);
    let rendered = image(&study, &study.render);
    let solved = lip(&study);
    let (specular, _) = CoatAlbedo::shared(1.4).at(1.0, 0.01);
    let specular = f64::from(specular);
    let out = (1.0 - specular) / (1.0 - solved.specular_reflectance());
    let light = study.scene.lights[0].whole_spectrum().into_owned();
    let bands = light.bin_averages(&study.scene.grid);
    let reflectance = light.times(&solved.reflectance(Level::AboveSurface)).bin_averages(&study.scene.grid);
    let brightest = bands.iter().copied().fold(0.0, f64::max);
    // Radiance of even light over a white surface is that of the light: exitance and irradiance share the factor pi.
    let range = (study.scene.grid.start_nm(), study.scene.grid.end_nm());
    let photons = light.clipped(range.0, range.1).times(&Curve::from_fn(range.0, range.1, |nm| nm));
    let per_nm = Curve::from_fn(range.0, range.1, |nm| 1.0 / nm);
    let mut fluorescent = vec![0.0; bands.len()];
    for part in solved.parts() {
        let emitted = solved.eem(part, Level::AboveSurface).unwrap().photon_exitance(&photons, range);
        let energy = emitted.times(&per_nm).bin_averages(&study.scene.grid);
        fluorescent.iter_mut().zip(energy).for_each(|(sum, value)| *sum += value);
    }
    for band in 0..bands.len() {
        if bands[band] > 0.05 * brightest {
            let expected = specular * bands[band] + out * reflectance[band];
            let found = mean(&rendered, band, |light| *light == LightPath::Reflected);
            // 390 000 samples of a lobe choice, each with a relative spread of about 0.75: 4.8e-3 is four standard errors.
            // The tables of the coat hold to 2e-3 of the light.
            let tolerance = 4.8e-3 * expected + 2e-3 * bands[band];
            assert!((found - expected).abs() < tolerance, "band {band}: {found}, expected {expected}");
        }
        let found = mean(&rendered, band, |light| matches!(light, LightPath::Fluorescence(_)));
        let expected = out * fluorescent[band];
        let tolerance = 4.8e-3 * expected + 1e-6 * fluorescent.iter().copied().fold(0.0, f64::max);
        assert!((found - expected).abs() < tolerance, "band {band}: {found}, expected {expected}");
    }
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
    let blood = patch("states = [\"hyperaemia\"]");
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
    let mut site = Site::named("lip").unwrap();
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
}

/// A flat sample of tissue reflects and emits what the solver finds, with factors on what it holds.
#[test]
fn a_flat_sample_of_tissue_is_that_of_the_solver() {
    let text = "format = 1\n[spectral]\nfirst_nm = 390.0\nlast_nm = 710.0\nstep_nm = 10.0\n[light]\nspectrum = \"led_405\"\n\
                strength.irradiance_w_per_m2 = 100.0\n[sample]\ntissue = \"lip\"\nconcentrations = { collagen = 0.5 }\n";
    let sample = parse_sample(text, "lip.toml", Path::new("."), &[]).unwrap().sample;
    let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
    let tissue = Site::named("lip").unwrap().tissue(&find).unwrap();
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
    let text = preset::experiment("oraleye-2021").unwrap().text;
    let changes = ["mouth.detail=0.25".to_owned(), "spectral.step_nm=10".to_owned()];
    let mut study = resolve(&parse(text, "mouth", Path::new("."), &changes).unwrap()).unwrap().study;
    assert!(study.tissues.iter().any(|tissue| tissue.parts.contains(&"tongue_tip".to_owned())));
    study.tissues.retain(|tissue| ["tongue_dorsum", "cheek"].contains(&tissue.name.as_str()));
    let mut bloody = study.tissues[0].clone();
    let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
    let mut site = Site::named("dorsal_tongue").unwrap();
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
