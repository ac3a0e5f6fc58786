//! Does the estimate find porphyrin in mouths that nobody chose, and does its interval hold the truth?
//!
//! `cargo run --release -p fluorspar-experiment --example porphyrin_in_drawn_mouths -- [MOUTHS [FIRST [FOLDER]]]`
//!
//! Of each mouth everything is drawn: its shape and pose, tissues at the width of their populations, what these hold fixed (layers,
//! scattering, background, vessels) with a log sd of 0.2, camera, LED, power, exposure, and how even the porphyrin lies. It is
//! rendered small, with all bounces, and analyzed as a user would: the catalogue's site of each region, two pixels of the sensor (one of
//! the render) within its rim.
//! The tongue is seen without porphyrin and with three true shares, lip and palate (porphyrin spread evenly, 2e-4 to
//! 5e-3/mm) with and without.
//! The interval is set against that which `design` foretells of such a share.
//! Every region is a line of CSV on standard output; tables follow. FOLDER keeps the renders, 20 MB a mouth, and solved tissues, which saves most of the time.

#![allow(clippy::print_stdout, reason = "printing is what the example is for")]

use std::error::Error;
use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use fluorspar::analysis::{LightFamily, PorphyrinSpread, SharePosterior, SignalLevel};
use fluorspar::image::{ComponentFactors, ComponentImage, LightPath};
use fluorspar::pipeline::{
    AnalyzedFrame, CameraResponse, CapturePlanes, CapturedFrame, FamilyFrame, SeenComponents, analyze_seen,
    capture_from_planes, tissue_family,
};
use fluorspar::render::{RenderControl, render};
use fluorspar::sampling::random::Key;
use fluorspar::study::Study;
use fluorspar::tissue::Population;
use fluorspar_anatomy::sample_person;
use fluorspar_experiment::{parse, preset, resolve, use_cache};
use fluorspar_format::{Cache, ExrOptions, read_component_exr, write_component_exr};

type Fallible<T> = Result<T, Box<dyn Error>>;

/// A part, its material, its site.
const REGIONS: [[&str; 3]; 3] = [
    ["tongue_dorsum", "tongue_dorsum", "dorsal_tongue"],
    ["lower_lip", "lip", "lip"],
    ["hard_palate", "hard_palate", "hard_palate"],
];
/// LEDs with the short-pass before each.
const LEDS: [[&str; 2]; 4] = [
    ["led_385", "short_pass_425"],
    ["led_405", "short_pass_440"],
    ["led_415", "short_pass_450"],
    ["led_450", "short_pass_475"],
];
/// Sensors; two of three cameras have the first.
const SENSORS: [&str; 3] = ["lyu_2021_table_1", "rgb_nir_3um", "multispectral_8_band"];
const PORPHYRIN: &str = "biofilm_porphyrin";
/// What the populations hold fixed, and its spread as a log sd.
const FIXED: [&str; 12] = [
    "biofilm_thickness_um",
    "keratin_thickness_um",
    "superficial_stroma_thickness_um",
    "background_per_mm",
    "background_slope_per_nm",
    "keratin_scattering_per_mm",
    "epithelium_scattering_per_mm",
    "stroma_reduced_scattering_per_mm",
    "stroma_scattering_power",
    "superficial_vessel_radius_um",
    "deep_vessel_radius_um",
    "hemoglobin_g_per_l",
];
const FIXED_LOG_SD: f64 = 0.2;

/// A deviate between two ends that belongs to a key.
fn between(key: Key, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * (key.value() >> 11) as f64 / (1u64 << 53) as f64
}

/// One whose logarithm is even between the ends.
fn log_between(key: Key, ends: [f64; 2]) -> f64 {
    between(key, ends.map(f64::ln)).exp()
}

/// What was drawn of the camera.
struct Drawn {
    led: &'static str,
    sensor: &'static str,
    exposure_ms: f64,
    power: f64,
    even: f64,
}

/// The experiment of a mouth.
fn experiment(number: u64) -> Fallible<(String, Drawn)> {
    let key = Key::new(42).with(number);
    let [led, filter] = LEDS[number as usize % LEDS.len()];
    let kind = [0, 1, 0, 2, 0, 0][number as usize / LEDS.len() % 6];
    let sensor = SENSORS[kind];
    let exposure_ms = log_between(key.with(1), [10.0, 60.0]);
    let power = log_between(key.with(2), [0.5, 2.0]);
    let mut person = toml::Table::try_from(sample_person(1000 + number as u32))?;
    let pose = [
        ("jaw_opening_mm", [28.0, 42.0]),
        ("tongue_protrusion_mm", [0.0, 12.0]),
        ("tongue_elevation_mm", [-1.0, 8.0]),
        ("lip_retraction_mm", [3.0, 11.0]),
        ("detail", [0.5, 0.5]),
    ];
    for (place, (name, ends)) in pose.into_iter().enumerate() {
        person.insert(name.into(), toml::Value::Float(between(key.with(10 + place as u64), ends)));
    }
    let even = [0.0, 0.0, 0.15, 0.5][(key.with(3).value() % 4) as usize];
    let mut text = format!(
        "format = 1\nbase = \"oraleye-2021\"\n[spectral]\nfirst_nm = 370.0\nlast_nm = 720.0\nstep_nm = 5.0\n[camera]\nposition_mm = \
         [{}, {}, {}]\n[render]\nwidth_px = 160\nheight_px = 120\nsamples_per_pixel = 16\nmax_depth = 6\nseed = {number}\n[sensor]\n\
         preset = \"{sensor}\"\ncolumns = 320\nrows = 240\npixel_size_um = 7.5\n{}[[light]]\nname = \"blue\"\n\
         spectrum = \"{led}\"\nfilters = [\"{filter}\"]\nstrength.power_mw = {}\n[[capture]]\nname = \"blue\"\nexposure_ms = {}\n[analysis]\n\
         inset_px = 2\n[[material]]\nname = \"tongue_dorsum\"\nconcentrations = {{ {PORPHYRIN} = {{ anatomy = \"porphyrin\", low = {}, \
         high = 25.0 }} }}\n",
        between(key.with(4), [-8.0, 8.0]),
        between(key.with(5), [12.0, 28.0]),
        between(key.with(6), [90.0, 110.0]),
        // A third of the pixels, each as bright as those of the catalogue
        ["fill_factor = 0.11\n", "", ""][kind],
        2000.0 * power * [1.0, 0.16, 0.54][kind],
        exposure_ms,
        25.0 * even,
    );
    for (place, [_, material, site]) in REGIONS.iter().enumerate() {
        let population = Population::of(&preset::site(site)?);
        let site = population.person(key).typical().clone();
        let mut tissue = site.clone();
        for (nth, name) in FIXED.iter().enumerate() {
            let deviate: f64 = (0..12)
                .map(|i| between(key.with(40 + place as u64).with(nth as u64).with(i), [-0.5, 0.5]))
                .sum();
            let ends = site.parameters().find(|(parameter, _)| parameter.name == *name).map(|(p, _)| p.range);
            let [low, high] = ends.unwrap_or([0.0, f64::INFINITY]);
            tissue.set(name, (tissue.get(name)? * (FIXED_LOG_SD * deviate).exp()).clamp(low, high))?;
        }
        // The amount of porphyrin is drawn for each share
        tissue.set("biofilm_porphyrin_per_mm", 1e-3)?;
        let parameters: Vec<String> =
            tissue.parameters().map(|(parameter, value)| format!("{} = {value:?}", parameter.name)).collect();
        text += &format!(
            "[[tissue]]\nname = \"drawn_{material}\"\nsite = \"{}\"\nparameters = {{ {} }}\n[[material]]\nname = \"{material}\"\n\
             tissue = \"drawn_{material}\"\n",
            site.name(),
            parameters.join(", ")
        );
    }
    text += &toml::to_string(&toml::Table::from_iter([("mouth".to_owned(), toml::Value::Table(person))]))?;
    Ok((text, Drawn { led, sensor, exposure_ms, power, even }))
}

/// The render of a mouth, from FOLDER where it is kept.
fn rendered(study: &Study, number: u64, folder: Option<&Path>) -> Fallible<ComponentImage> {
    let path = folder.map(|folder| folder.join(format!("{number}.exr")));
    if let Some(path) = path.as_ref().filter(|path| path.exists()) {
        return Ok(read_component_exr(path)?.image);
    }
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let image = render(&study.scene, &study.render, &control)?;
    if let Some(path) = &path {
        write_component_exr(path, &image, &ExrOptions::default())?;
    }
    Ok(image)
}

/// A region as it was estimated.
struct Case {
    part: &'static str,
    sensor: &'static str,
    led: &'static str,
    truth: f64,
    found: SharePosterior,
    /// Width of the interval over that which the typical tissue would have.
    of_foretold: Option<f64>,
}

impl Case {
    fn holds(&self) -> bool {
        self.found.interval[0] <= self.truth && self.truth <= self.found.interval[1]
    }
}

/// What the camera sees of the typical tissue.
fn family(study: &Study, drawn: &Drawn, site: &str) -> Fallible<LightFamily> {
    let (Some(prior), Some(lens), Some(sensor)) = (
        study.analysis.as_ref().and_then(|plan| plan.tissue.as_ref()),
        study.camera.lens_behind_filters(),
        &study.camera.sensor,
    ) else {
        return Err(site.into());
    };
    let filter = LEDS.iter().find(|[led, _]| *led == drawn.led).map_or("", |[_, filter]| filter);
    let irradiance = preset::light_spectrum(drawn.led)?.curve().times(&preset::filter(filter)?.curve());
    let grid = &study.scene.grid;
    let camera = CameraResponse::new(&lens, sensor, grid, None);
    let frame = FamilyFrame {
        label: "blue".into(),
        channels: camera.seeing_channels(),
        camera_of_reflected: CameraResponse::new(&lens, sensor, grid, Some(&irradiance)),
        camera,
        irradiance,
        time_s: 1e-3 * drawn.exposure_ms,
    };
    Ok(tissue_family(prior, &[frame], grid)?)
}

/// The width of an interval over that which the design of the camera foretells of the share, with as much light.
fn of_foretold(
    family: &LightFamily,
    frame: &CapturedFrame,
    analyzed: &AnalyzedFrame,
    share: f64,
) -> Option<f64> {
    let (found, image) = (analyzed.analysis.posterior.as_ref()?, &frame.developed);
    let (pixels, channels) = (&analyzed.region.pixels, image.channels.len());
    let mean = |name: &String| -> Option<f64> {
        let channel = image.channels.iter().position(|channel| channel == name)?;
        let dn: f64 = pixels.iter().map(|pixel| f64::from(image.data[pixel * channels + channel])).sum();
        Some(dn / frame.raw.dn_per_electron / pixels.len() as f64)
    };
    let electrons = family.channel_of.iter().map(mean).collect::<Option<Vec<f64>>>()?;
    // Photon noise; a channel of a mosaic has about a fourth of the pixels
    let variance = electrons.iter().map(|e| 4.0 * e.max(1.0) / pixels.len() as f64).collect();
    let blocks = found.blocks.as_ref()?.blocks.len();
    let level = SignalLevel { electrons, variance, blocks };
    let [low, high] = family.expected_interval(&level, share, PorphyrinSpread::Usual)?;
    Some((found.interval[1] - found.interval[0]) / (high - low))
}

/// All regions of a mouth.
fn of_mouth(number: u64, folder: Option<&Path>) -> Fallible<Vec<Case>> {
    let (text, drawn) = experiment(number)?;
    let mut study = resolve(&parse(&text, "mouth", Path::new("."), &[])?)?.study;
    study.captures.retain(|capture| capture.frame.label == "blue");
    study.captures.iter_mut().for_each(|capture| capture.subtract = None);
    let image = rendered(&study, number, folder)?;
    let planes = CapturePlanes::new(&study, &image)?;
    let mut cases = Vec::new();
    for [part, _, site] in REGIONS {
        let Some(plan) = &mut study.analysis else { continue };
        plan.parts = vec![part.to_owned()];
        if let Some(prior) = &mut plan.tissue {
            prior.site = preset::site(site)?;
        }
        let family = family(&study, &drawn, site)?;
        // The odds of the porphyrin at the amounts of the render give the amounts of all shares
        let mut odds = None;
        let key = Key::new(43).with(number).with(part.len() as u64);
        let is_tongue = part == "tongue_dorsum";
        for nth in 0..if is_tongue { 5 } else { 3 } {
            let amount = match (nth, odds) {
                (0, _) | (_, None) => 1.0,
                (1, _) => 0.0,
                (_, Some(odds)) if is_tongue => {
                    let share = log_between(key.with(nth), [0.02, 0.3]);
                    share / (1.0 - share) / odds
                }
                _ => log_between(key, [0.2, 5.0]),
            };
            let mut factors = ComponentFactors::ones(image.components.len());
            for (factor, component) in factors.even.iter_mut().zip(&image.components) {
                if component.light == LightPath::Fluorescence(PORPHYRIN.into()) {
                    *factor = amount;
                }
            }
            study.render.seed = 100 * number + nth;
            let seen = SeenComponents {
                image: &image,
                planes: &planes,
                captures: &study.captures,
                factors: &factors,
            };
            let frames = capture_from_planes(&study, &seen)?;
            let analyzed = match analyze_seen(&study, Some(&seen), &frames) {
                Ok(Some(analyzed)) => analyzed,
                _ => break,
            };
            if analyzed.region.pixels.len() < 200 {
                break;
            }
            let Some(truth) = &analyzed.analysis.truth else { break };
            let (of_porphyrin, of_bulk) =
                (truth.electrons.porphyrin.iter().sum::<f64>(), truth.electrons.bulk.iter().sum::<f64>());
            if odds.is_none() {
                odds = Some(of_porphyrin / of_bulk);
                continue;
            }
            let red_truth = truth.red;
            let truth = of_porphyrin / (of_porphyrin + of_bulk);
            let of_foretold =
                if truth >= 0.05 { of_foretold(&family, &frames[0], &analyzed, truth) } else { None };
            let Some(found) = analyzed.analysis.posterior else { continue };
            let blocks = found.blocks.as_ref();
            println!(
                "{number},{},{},{:.1},{:.2},{},{part},{},{},{truth:.4},{:.4},{:.4},{:.4},{:.4},{},{:.3},{:.3},{:.2},{:.3},{:.1},{},{:.4},{:.4},{},{:.4},{:.4},{:.4},{:.3}",
                drawn.sensor,
                drawn.led,
                drawn.exposure_ms,
                drawn.power,
                drawn.even,
                analyzed.region.pixels.len(),
                blocks.map_or(0, |b| b.blocks.len()),
                found.median,
                found.interval[0],
                found.interval[1],
                found.probability_of_none,
                found.of_mean.map_or(String::new(), |m| format!("{:.4}-{:.4}", m.interval[0], m.interval[1])),
                blocks.map_or(0.0, |b| b.probability_of_even),
                blocks.map_or(0.0, |b| b.probability_of_patchy),
                blocks.map_or(0.0, |b| b.place_factor),
                blocks.map_or(0.0, |b| b.chlorophyll),
                found.misfit,
                found.foreign || found.doubt.as_ref().is_some_and(|doubt| doubt.is_strong),
                found.visible.as_ref().and_then(|v| v.in_patches).unwrap_or(1.0),
                found.visible.as_ref().and_then(|v| v.evenly).unwrap_or(1.0),
                found
                    .visible
                    .as_ref()
                    .and_then(|v| v.limited_by.clone())
                    .unwrap_or_default()
                    .replace(',', ""),
                red_truth,
                found.red.map_or(f64::NAN, |red| red.interval[0]),
                found.red.map_or(f64::NAN, |red| red.interval[1]),
                of_foretold.unwrap_or(f64::NAN),
            );
            cases.push(Case { part, sensor: drawn.sensor, led: drawn.led, truth, found, of_foretold });
        }
    }
    Ok(cases)
}

/// How often none is excluded and the truth held, of some cases.
fn tabulate(what: &str, cases: &[&Case]) {
    let share = |is: &dyn Fn(&&&Case) -> bool| cases.iter().filter(is).count() as f64 / cases.len() as f64;
    let mut widths: Vec<f64> = cases.iter().map(|c| c.found.interval[1] - c.found.interval[0]).collect();
    let mut errors: Vec<f64> = cases.iter().map(|c| c.found.median - c.truth).collect();
    widths.sort_by(f64::total_cmp);
    errors.sort_by(f64::total_cmp);
    let mut foretold: Vec<f64> = cases.iter().filter_map(|case| case.of_foretold).collect();
    foretold.sort_by(f64::total_cmp);
    let middle = |sorted: &[f64]| sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN);
    println!(
        "| {what} | {} | {:.2} | {:.2} | {:.2} | {:.3} | {:+.3} | {:.2} |",
        cases.len(),
        share(&|c| c.found.excludes_none()),
        share(&|c| c.holds()),
        share(&|c| c.truth < c.found.interval[0]),
        middle(&widths),
        middle(&errors),
        middle(&foretold),
    );
}

fn main() -> Fallible<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |place: usize, default: u64| arguments.get(place).map_or(Ok(default), |text| text.parse());
    let (mouths, first) = (number(0, 40)?, number(1, 0)?);
    let folder = arguments.get(2).map(Path::new);
    if let Some(folder) = folder {
        fs::create_dir_all(folder)?;
        use_cache(Cache::new(folder.join("cache"), 2 << 30, "drawn mouths"));
    }
    println!(
        "mouth,sensor,led,exposure_ms,power,even,part,pixels,blocks,truth,median,low,high,none,mean,even,patchy,places,chlorophyll,misfit,\
         warned,visible_in_patches,visible_evenly,limit,red_truth,red_low,red_high,of_foretold"
    );
    let mut cases = Vec::new();
    for mouth in first..first + mouths {
        match of_mouth(mouth, folder) {
            Ok(found) => cases.extend(found),
            Err(error) => println!("# mouth {mouth}: {error}"),
        }
    }
    println!(
        "| cases | number | excludes none | holds | above the truth | width | error of the median | width over foretold |\n|---|---|---|---|---|---|---|---|"
    );
    for sensor in SENSORS {
        for (name, parts) in [("tongue", &REGIONS[..1]), ("lip, palate", &REGIONS[1..])] {
            for [low, high] in [[0.0, 0.002], [0.002, 0.05], [0.05, 0.25], [0.25, 1.0]] {
                let is = |case: &&Case| {
                    case.sensor == sensor
                        && parts.iter().any(|[part, ..]| *part == case.part)
                        && (low..high).contains(&case.truth)
                };
                let found: Vec<&Case> = cases.iter().filter(is).collect();
                if !found.is_empty() {
                    tabulate(&format!("{sensor}, {name}, {low} to {high}"), &found);
                }
            }
        }
    }
    for [led, _] in LEDS {
        let is = |case: &&Case| {
            case.led == led
                && case.part == "tongue_dorsum"
                && case.sensor == SENSORS[0]
                && (0.05..0.25).contains(&case.truth)
        };
        tabulate(
            &format!("{led}, tongue, R, G, B, 0.05 to 0.25"),
            &cases.iter().filter(is).collect::<Vec<_>>(),
        );
    }
    tabulate("all", &cases.iter().collect::<Vec<_>>());
    Ok(())
}
