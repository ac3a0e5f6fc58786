//! Renders that keep excitation apart by wavelength: as exact as they say, under any light, and the same from their file.
#![allow(clippy::unwrap_used)]

use std::convert::Infallible;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::design::RegionResponse;
use fluorspar::image::{ComponentImage, ComponentRows, ExcitationImage, LightPath, RelitRows};
use fluorspar::pipeline::{PipelineError, check_same_scene, relight_with_basis, render_with_basis};
use fluorspar::render::{
    Checkpoint, ComponentBands, FilmRenderer, RenderControl, RenderSettings, basis_bytes, memory_bytes,
    render, tile_row_bytes, whole_image_bytes,
};
use fluorspar::spectral::{Curve, CurveModel};
use fluorspar::study::Study;
use fluorspar_experiment::{parse, resolve};
use fluorspar_format::{ComponentFile, ExrOptions, write_component_exr};

/// Spheres of single fluorophores on a table, which also light each other.
fn study(changes: &[&str]) -> Study {
    let base = [
        "render.width_px=24",
        "render.height_px=40",
        "render.samples_per_pixel=4",
        "spectral.first_nm=320",
        "spectral.last_nm=700",
    ];
    let changes: Vec<String> = base.iter().chain(changes).map(|change| (*change).into()).collect();
    let text = "format = 1\nbase = \"fluorescent-sphere\"";
    resolve(&parse(text, "test", Path::new("."), &changes).unwrap()).unwrap().study
}

/// Depth 3: no path ends by roulette, which looks at the light spectrum, so that all lights share their paths.
fn settings(study: &Study) -> RenderSettings {
    RenderSettings { max_depth: 3, component_bands: ComponentBands::All, ..study.render.clone() }
}

fn control(stop: &AtomicBool) -> RenderControl<'_> {
    RenderControl { stop, progress: &|_| {} }
}

fn plain(study: &Study) -> ComponentImage {
    let settings = RenderSettings { excitation_basis: None, ..settings(study) };
    render(&study.scene, &settings, &control(&AtomicBool::new(false))).unwrap()
}

fn with_basis(study: &Study) -> (ComponentImage, ExcitationImage) {
    let scene = &study.scene;
    // One row of tiles at a time
    let limit = whole_image_bytes(scene)
        + basis_bytes(scene, &settings(study))
        + tile_row_bytes(scene, &settings(study));
    let settings = RenderSettings { memory_limit_bytes: limit, ..settings(study) };
    assert!(limit < memory_bytes(scene, &settings));
    let renderer = FilmRenderer::for_rows(scene, &settings).unwrap();
    let stop = AtomicBool::new(false);
    let rendered = render_with_basis(&renderer, &settings, scene, |share, film| {
        let checkpoint = Checkpoint { is_due: &|| false, on_pause: &mut |_| true };
        renderer.fill(share, film, &control(&stop), checkpoint)
    });
    rendered.unwrap().unwrap()
}

/// The study under another light of its violet group.
fn under(study: &Study, light: &Curve) -> Study {
    let mut other = study.clone();
    other.scene.lights.iter_mut().filter(|light| light.group == 0).for_each(|l| l.spectrum = light.clone());
    other
}

fn led(peak_nm: f64, fwhm_nm: f64) -> Curve {
    Curve::from_model(&CurveModel::Led {
        peak_nm,
        fwhm_short_nm: fwhm_nm,
        fwhm_long_nm: 1.2 * fwhm_nm,
        shape: 2.0,
        tails: Vec::new(),
    })
}

/// The spectra of an image whose lights are changed.
fn relit(
    image: &ComponentImage,
    study: &Study,
    other: &Study,
    basis: &ExcitationImage,
) -> (ComponentImage, f64) {
    let found = relight_with_basis(study, other, image, basis).unwrap();
    check_same_scene(&found.shown, other).unwrap();
    let size = [image.width, image.height, image.grid.len()];
    let rows = RelitRows { rows: image, size, relit: &found.components };
    let found_rows: Result<_, Infallible> = rows.map_rows(|_| true, |_, _, lines| lines.to_vec());
    let mut made = image.clone();
    let (width, bands) = (image.width, image.grid.len());
    for (component, row, lines) in found_rows.unwrap() {
        let start = (component * image.height + row) * width * bands;
        for (at, value) in made.data[start..start + width * bands].iter_mut().enumerate() {
            *value = lines[at % bands * width + at / bands];
        }
    }
    (made, found.changed[0].1)
}

/// Radiance of a component in a range of wavelengths by pixel.
fn sums(image: &ComponentImage, component: usize, [from_nm, to_nm]: [f64; 2]) -> Vec<f64> {
    let bands = image.grid.len();
    let inside: Vec<usize> =
        (0..bands).filter(|band| (from_nm..to_nm).contains(&image.grid.center_nm(*band))).collect();
    let pixel = |spectrum: &[f32]| inside.iter().map(|band| f64::from(spectrum[*band])).sum();
    image.component(component).chunks_exact(bands).map(pixel).collect()
}

#[test]
fn a_basis_follows_every_light_to_half_a_percent() {
    let study = study(&["render.excitation_basis_nm=[345, 480]"]);
    let (image, basis) = with_basis(&study);
    assert_eq!(image.data, plain(&study).data, "a basis changes the image itself");
    assert_eq!(basis.groups.len(), 1, "only the violet light is narrow");
    let short_pass = Curve::from_fn(300.0, 800.0, |nm| 1.0 / (1.0 + ((nm - 452.0) / 0.8).exp()));
    let lights = [
        led(346.0, 8.0),
        led(391.3, 8.0),
        led(405.0, 14.0),
        led(455.0, 25.0).times(&short_pass),
        led(479.0, 8.0),
        // Light far beyond the nodes, which a viewing filter may pass
        Curve::from_fn(300.0, 800.0, |nm| led(405.0, 14.0).at(nm) + 3e-4 * led(600.0, 14.0).at(nm)),
    ];
    let mut worst = [0.0_f64; 2];
    for (number, light) in lights.iter().enumerate() {
        // A tenth of the power as well
        let other =
            under(&study, &light.scaled(0.1 * study.scene.lights[0].spectrum.total() / light.total()));
        let direct = plain(&other);
        let (made, stated) = relit(&image, &study, &other, &basis);
        assert!(stated < 5e-3, "{number}: {stated}");
        for (component, label) in image.components.iter().enumerate() {
            let ranges: &[[f64; 2]] = match label.light {
                LightPath::Reflected if number + 1 == lights.len() => &[[320.0, 520.0], [560.0, 640.0]],
                LightPath::Reflected => &[[320.0, 520.0]],
                // Behind the light: in its own bands fluorescence drowns in what it reflects
                _ => &[[500.0, 560.0], [560.0, 620.0], [620.0, 700.0]],
            };
            for range_nm in ranges {
                let (made, direct) = (sums(&made, component, *range_nm), sums(&direct, component, *range_nm));
                // Under the spectrum of a light a path takes part in what fluoresces again at random, so pixels differ: not looked at
                if label.light == LightPath::MultipleFluorescence {
                    continue;
                }
                let mean = direct.iter().sum::<f64>() / direct.len() as f64;
                for (a, b) in made.iter().zip(&direct) {
                    let error = (a - b).abs() / b.max(0.2 * mean).max(f64::MIN_POSITIVE);
                    let kind = usize::from(label.light != LightPath::Reflected);
                    worst[kind] = worst[kind].max(error);
                }
            }
        }
    }
    eprintln!("reflected {:.2e}, fluorescent {:.2e}", worst[0], worst[1]);
    // 0.1 % of the short form for reflected light; 0.3 % of the nodes come on top
    assert!(worst[0] < 2e-3 && worst[1] < 5e-3, "{worst:?}");

    let refused = relight_with_basis(&study, &under(&study, &led(650.0, 10.0)), &image, &basis).unwrap_err();
    assert!(matches!(&refused, PipelineError::OutsideBasis(outside) if outside.percent > 99.0), "{refused}");
}

/// Under the spectrum of a light, what fluoresces again is drawn at random; a basis carries all of it. Their means agree over seeds, each of
/// which gives both the same paths.
#[test]
fn what_fluoresces_again_agrees_on_average() {
    const SEEDS: u64 = 24;
    let differences: Vec<[f64; 2]> = (0..SEEDS)
        .map(|seed| {
            let seed = format!("render.seed={seed}");
            let study =
                study(&["render.excitation_basis_nm=[345, 480]", "render.samples_per_pixel=16", &seed]);
            let (image, basis) = with_basis(&study);
            let light = led(405.0, 14.0);
            let power = study.scene.lights[0].spectrum.total();
            let other = under(&study, &light.scaled(power / light.total()));
            let (made, _) = relit(&image, &study, &other, &basis);
            let direct = plain(&other);
            let total = |image: &ComponentImage| -> f64 {
                let again = |component: &usize| {
                    let label = &image.components[*component];
                    label.light == LightPath::MultipleFluorescence
                        && label.light_group == study.scene.light_groups[0].name
                };
                (0..image.components.len()).filter(again).flat_map(|c| sums(image, c, [500.0, 700.0])).sum()
            };
            [total(&made), total(&direct)]
        })
        .collect();
    let count = SEEDS as f64;
    let made: f64 = differences.iter().map(|[made, _]| made).sum::<f64>() / count;
    let mean = differences.iter().map(|[made, direct]| direct - made).sum::<f64>() / count;
    let squares: f64 = differences.iter().map(|[made, direct]| (direct - made - mean).powi(2)).sum();
    let error = (squares / (count - 1.0) / count).sqrt();
    println!("{made:.3e} on the basis; differs by {mean:.1e} ± {error:.1e}");
    // Four standard errors, 1 in 1500 by Student's t of 23; and few enough that a factor could not hide
    assert!(mean.abs() <= 4.0 * error + 0.02 * made && error < 0.25 * made, "{made}: {mean} ± {error}");
}

#[test]
fn a_region_of_a_render_sends_what_its_image_shows() {
    let study = study(&["render.excitation_basis_nm=[370, 440]", "render.height_px=16"]);
    let settings = settings(&study);
    let renderer = FilmRenderer::for_rows(&study.scene, &settings).unwrap();
    let stop = AtomicBool::new(false);
    let (image, basis) = render_with_basis(&renderer, &settings, &study.scene, |share, film| {
        let checkpoint = Checkpoint { is_due: &|| false, on_pause: &mut |_| true };
        renderer.fill(share, film, &control(&stop), checkpoint)
    })
    .unwrap()
    .unwrap();

    // The file keeps it to the last bit
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("components.exr");
    write_component_exr(&path, &image, &ExrOptions { excitation: Some(&basis), ..Default::default() })
        .unwrap();
    let read = ComponentFile::open(&path).unwrap().excitation_basis().unwrap().unwrap();
    let held = |basis: &ExcitationImage| {
        let components = basis.groups[0].components.iter().filter(|component| component.rank > 0);
        components.cloned().collect::<Vec<_>>()
    };
    assert_eq!(held(&read), held(&basis));
    assert_eq!(read.groups[0].nodes, basis.groups[0].nodes);

    let pixels: Vec<usize> = (0..image.width * image.height).filter(|pixel| pixel % 3 == 0).collect();
    let whole: Vec<(usize, f64)> = pixels.iter().map(|pixel| (*pixel, 1.0)).collect();
    let region = RegionResponse::of_render("third", &image.grid, &read.groups[0], &whole);
    let light = led(402.0, 10.0);
    let (made, _) = relit(&image, &study, &under(&study, &light), &basis);
    let sent = region.fluorescence_under(&light);
    let bands = image.grid.len();
    let mean = |component: usize, band: usize| {
        let values = pixels.iter().map(|pixel| f64::from(made.component(component)[pixel * bands + band]));
        values.sum::<f64>() / pixels.len() as f64
    };
    for (component, label) in made.components.iter().enumerate().filter(|(_, c)| c.light_group == "violet") {
        let name = match &label.light {
            LightPath::Fluorescence(name) => name.as_str(),
            LightPath::MultipleFluorescence => "multiple",
            LightPath::Reflected => {
                // Nearly even within a band: the light is formed on fine samples, the reflectance is linear
                let reflected = light.times(&region.reflected).bin_averages(&image.grid);
                let total: f64 = (0..bands).map(|band| mean(component, band)).sum();
                assert!((reflected.iter().sum::<f64>() / total - 1.0).abs() < 2e-3);
                continue;
            }
        };
        let Some(index) = region.fluorescence.iter().position(|of| of.name == name) else { continue };
        let peak = sent[index].iter().copied().fold(0.0, f64::max);
        for (band, value) in sent[index].iter().enumerate() {
            assert!((value - mean(component, band)).abs() < 1e-4 * peak, "{name} {band}: {value}");
        }
    }
}
