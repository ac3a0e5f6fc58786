//! How well a camera tells a spot of blood from a spot that lost collagen, where both are equally dark in the blue frame.
//!
//!     cargo run --release -p fluorspar-experiment --example blood_or_collagen
//!
//! A spot of blood (a bruise, dilated vessels) is dark under blue light and under white light; one that lost collagen, as
//! dysplasia does, under blue light only. Both are spots of a cheek. First three patches of one cheek (normal, blood,
//! collagen) are rendered and captured under both lights, and the developed pixels of both spots are compared: what the noise of
//! the sensor allows. Then people are drawn, each with a spot of one kind, and the ratios of spot to surroundings are compared:
//! what the differences among people and among spots allow. `d'` is the distance of both means in standard deviations, of
//! the logarithms of all channels together; intervals are 95 %, by the jackknife. An ideal observer is right in the share
//! `Phi(d' / 2)` of the cases.
#![allow(clippy::print_stdout, reason = "this program prints a table")]

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use fluorspar::analysis::{SpotScale, SpotSeparation};
use fluorspar::image::ChannelImage;
use fluorspar::pipeline::{capture, predict};
use fluorspar::render::{RenderControl, render};
use fluorspar::sampling::random::{Key, KeyedRng};
use fluorspar::spectral::Fluorophore;
use fluorspar::study::FlatSample;
use fluorspar::tissue::{EffectiveTissue, Level, Population, Site};
use fluorspar_experiment::{parse, parse_sample, preset, resolve};
use rand::RngExt;
use rand_distr::StandardNormal;

type Answer<T> = Result<T, Box<dyn Error>>;

const SENSORS: [&str; 2] = ["lyu_2021_table_1", "pi_camera_3"];
/// What a spot of the second kind keeps of its collagen, elastin and lipopigment.
const KEPT: f64 = 0.4;
/// Parameters of the fibers.
const FIBERS: [&str; 6] = [
    "superficial_collagen_per_mm",
    "deep_collagen_per_mm",
    "superficial_elastin_per_mm",
    "deep_elastin_per_mm",
    "superficial_lipopigment_per_mm",
    "deep_lipopigment_per_mm",
];
/// Spread of the logarithm of either change among spots. \[assumed\]
const SPOT_SPREAD: f64 = 0.3;
/// People with a spot of either kind.
const PEOPLE: u64 = 150;
/// Pixels of a spot: 5 mm wide, seen from 100 mm.
const PIXELS: f64 = 3000.0;

fn main() -> Answer<()> {
    let cheek = preset::site("buccal_mucosa")?;
    for sensor in SENSORS {
        let cameras = [sample(sensor, false)?, sample(sensor, true)?];
        let blood = equal_blood(&cameras[0], &cheek)?;
        println!("\n{sensor}: blood x {blood:.2} is as dark in green under blue light as fibers x {KEPT}");
        let spots = [spot(&cheek, blood, 1.0)?, spot(&cheek, 1.0, KEPT)?];
        for (frame, camera) in ["blue", "white"].iter().zip(&cameras) {
            let normal = channels(camera, &cheek)?;
            for (kind, site) in ["blood", "collagen"].iter().zip(&spots) {
                let ratios: Vec<String> = channels(camera, site)?
                    .iter()
                    .zip(&normal)
                    .map(|((name, spot), (_, around))| format!("{name} {:.3}", spot / around))
                    .collect();
                println!("  {frame} frame, {kind} spot over surroundings: {}", ratios.join(", "));
            }
        }
        rendered(sensor, blood)?;
        among_people(&cameras, &cheek, blood)?;
    }
    Ok(())
}

/// A flat sample under the lights of the default experiment, to be filled with tissue: blue behind its filter, or white.
fn sample(sensor: &str, white: bool) -> Answer<FlatSample> {
    let light = if white {
        "spectrum = \"white_led\"\nstrength.irradiance_w_per_m2 = 1.5"
    } else {
        "spectrum = \"led_385\"\nfilters = [\"short_pass_425\"]\nstrength.irradiance_w_per_m2 = 1000.0"
    };
    let text = format!(
        "format = 1\n[light]\n{light}\n[sample]\nreflectance = 0.1\n[view_filter]\nfilters = [\"view_475_700\"]\n[lens]\n\
         focal_length_mm = 3.0\nf_number = 4.0\ntransmittance = 0.9\nfocus_distance_mm = 100.0\n[sensor]\npreset = \"{sensor}\"\n\
         quantum_efficiency = \"consumer_rgb_cmos\"\n"
    );
    Ok(parse_sample(&text, "camera", Path::new("."), &[])?.sample)
}

/// A cheek with a factor on its superficial blood and one on its fibers.
fn spot(around: &Site, blood: f64, fibers: f64) -> Answer<Site> {
    let mut site = around.clone();
    let name = "superficial_blood_fraction";
    site.set(name, (blood * site.get(name)?).min(1.0))?;
    for name in FIBERS {
        site.set(name, fibers * site.get(name)?)?;
    }
    Ok(site)
}

fn catalogue(name: &str) -> Option<Arc<Fluorophore>> {
    Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()))
}

/// Electrons of each channel of one pixel that sees a tissue.
fn channels(camera: &FlatSample, site: &Site) -> Answer<Vec<(String, f64)>> {
    let solved = EffectiveTissue::for_grid(&site.tissue(&catalogue)?, &camera.grid)?;
    let mut filled = camera.clone();
    filled.reflectance = solved.reflectance(Level::AboveSurface);
    filled.fluorophores = solved
        .parts()
        .into_iter()
        .map(|part| Ok((solved.fluorophore(part, Level::AboveSurface)?, 1.0)))
        .collect::<Answer<_>>()?;
    filled.porphyrin = None;
    let predicted = predict(&filled)?;
    Ok(predicted.channels.into_iter().map(|(name, channel)| (name, channel.electrons)).collect())
}

fn green(camera: &FlatSample, site: &Site) -> Answer<f64> {
    let channels = channels(camera, site)?;
    Ok(channels.iter().find(|(name, _)| name == "G").map_or(0.0, |(_, electrons)| *electrons))
}

/// The factor on the blood that makes a spot as dark in green as one that lost fibers: by bisection of its logarithm.
fn equal_blood(camera: &FlatSample, cheek: &Site) -> Answer<f64> {
    let wanted = green(camera, &spot(cheek, 1.0, KEPT)?)?;
    let [mut low, mut high] = [1.0_f64, 100.0];
    for _ in 0..16 {
        let middle = (low * high).sqrt();
        if green(camera, &spot(cheek, middle, 1.0)?)? > wanted { low = middle } else { high = middle }
    }
    Ok((low * high).sqrt())
}

/// Renders and captures both spots beside normal mucosa, and compares their pixels.
fn rendered(sensor: &str, blood: f64) -> Answer<()> {
    let study = resolve(&parse(&scene(sensor, blood), "spots", Path::new("."), &[])?)?.study;
    let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
    let components = render(&study.scene, &study.render, &control)?;
    let frames = capture(&study, &components)?;
    let of_spots = |frames: &[&ChannelImage], channels: &[&str]| {
        // Patches fill the thirds of the image: the middles of the second and of the third, away from their edges
        [0.5, 5.0 / 6.0].map(|center| pixels(frames, channels, center))
    };
    let blue = &frames[0].developed;
    let white = &frames[1].developed;
    println!("  rendered and captured, pixel by pixel:");
    print_row("green of the blue frame", &of_spots(&[blue], &["G"]));
    print_row("all of the blue frame", &of_spots(&[blue], &["R", "G", "B"]));
    print_row("green of both frames", &of_spots(&[blue, white], &["G"]));
    print_row("all of both frames", &of_spots(&[blue, white], &["R", "G", "B"]));
    Ok(())
}

/// Three patches of cheek side by side under blue and white light.
fn scene(sensor: &str, blood: f64) -> String {
    let cheek = preset::site("buccal_mucosa").ok();
    let find = |name: &str| cheek.as_ref().and_then(|cheek| cheek.get(name).ok()).unwrap_or(0.0);
    let fibers: Vec<String> = FIBERS.iter().map(|name| format!("{name} = {:?}", KEPT * find(name))).collect();
    let bloody = format!("superficial_blood_fraction = {:?}", blood * find("superficial_blood_fraction"));
    let mut text = format!(
        "format = 1\n[render]\nwidth_px = 96\nheight_px = 32\nsamples_per_pixel = 32\nmax_depth = 1\n[camera]\n\
         position_mm = [0.0, 0.0, 100.0]\nhorizontal_field_deg = 40.0\n[lens]\nfocal_length_mm = 3.0\nf_number = 4.0\n\
         transmittance = 0.9\nvignetting = \"none\"\n[view_filter]\nfilters = [\"view_475_700\"]\n[sensor]\npreset = \"{sensor}\"\n\
         columns = 192\nrows = 64\npixel_size_um = 11.3\nquantum_efficiency = \"consumer_rgb_cmos\"\n[[light]]\nname = \"blue\"\n\
         type = \"distant\"\naim.direction = [0.0, 0.0, -1.0]\nspectrum = \"led_385\"\nfilters = [\"short_pass_425\"]\n\
         strength.irradiance_w_per_m2 = 1000.0\n[[light]]\nname = \"white\"\ntype = \"distant\"\naim.direction = [0.0, 0.0, -1.0]\n\
         spectrum = \"white_led\"\nstrength.irradiance_w_per_m2 = 1.5\n[[capture]]\nname = \"blue\"\nlight_groups = {{ blue = 1.0 }}\n\
         exposure_ms = \"auto\"\n[[capture]]\nname = \"white\"\nlight_groups = {{ white = 1.0 }}\nexposure_ms = \"auto\"\n"
    );
    let kinds = [("normal", String::new()), ("blood", bloody), ("collagen", fibers.join(", "))];
    for (place, (name, parameters)) in kinds.iter().enumerate() {
        text += &format!(
            "[[tissue]]\nname = \"{name}\"\nsite = \"buccal_mucosa\"\nparameters = {{ {parameters} }}\n[[material]]\nname = \"{name}\"\n\
             type = \"tissue\"\ntissue = \"{name}\"\ngloss.roughness = 1.0\n[[object]]\nname = \"{name}\"\nmaterial = \"{name}\"\n\
             type = \"quad\"\ncorner_mm = [{:?}, -50.0, 0.0]\nedge_u_mm = [25.0, 0.0, 0.0]\nedge_v_mm = [0.0, 100.0, 0.0]\n",
            -37.5 + 25.0 * place as f64
        );
    }
    text
}

/// Logarithms of channels of the pixels around a place of the image, 0 left to 1 right; every second one in both
/// directions, as neighbors share raw values.
fn pixels(frames: &[&ChannelImage], channels: &[&str], center: f64) -> Vec<Vec<f64>> {
    let size = [frames[0].width, frames[0].height];
    let middle = (center * size[0] as f64) as usize;
    let reach = size[0] / 12;
    let mut found = Vec::new();
    for row in (size[1] / 4..3 * size[1] / 4).step_by(2) {
        for column in (middle - reach..middle + reach).step_by(2) {
            let value = |image: &&ChannelImage, name: &&str| {
                let channel = image.channels.iter().position(|other| other == name)?;
                let value = image.data[(row * size[0] + column) * image.channels.len() + channel];
                (value > 0.0).then(|| f64::from(value).ln())
            };
            let all = frames.iter().flat_map(|image| channels.iter().map(move |name| value(image, name)));
            found.extend(all.collect::<Option<Vec<f64>>>());
        }
    }
    found
}

/// Draws people with a spot of either kind, and compares the ratios of spot to surroundings.
fn among_people(cameras: &[FlatSample; 2], cheek: &Site, blood: f64) -> Answer<()> {
    let population = Population::of(cheek);
    let mut ratios: [Vec<Vec<f64>>; 2] = Default::default();
    for (kind, people) in ratios.iter_mut().enumerate() {
        for number in 0..PEOPLE {
            let person = Key::new(14).with(kind as u64).with(number);
            let around = population.person(person).typical().clone();
            let mut rng = person.rng();
            let change = (SPOT_SPREAD * rng.sample::<f64, _>(StandardNormal)).exp();
            let site = match kind {
                0 => spot(&around, (blood * change).max(1.0), 1.0)?,
                _ => spot(&around, 1.0, (KEPT * change).min(1.0))?,
            };
            let mut of_person = Vec::new();
            for camera in cameras {
                let read_e = camera.camera.sensor.as_ref().map_or(0.0, |s| s.model().read_noise_electrons());
                let [spot, around] = [channels(camera, &site)?, channels(camera, &around)?];
                of_person.extend(spot.iter().zip(&around).map(|((_, spot), (_, around))| {
                    noisy(*spot, read_e, &mut rng).ln() - noisy(*around, read_e, &mut rng).ln()
                }));
            }
            people.push(of_person);
        }
    }
    // Channels come in the order of their names: B, G, R of the blue frame, then of the white one
    println!("  {PEOPLE} people with a spot of either kind:");
    let chosen = |which: &[usize]| {
        [0, 1].map(|kind: usize| {
            ratios[kind].iter().map(|all| which.iter().map(|&i| all[i]).collect()).collect::<Vec<Vec<f64>>>()
        })
    };
    print_row("green of the blue frame", &chosen(&[1]));
    print_row("all of the blue frame", &chosen(&[0, 1, 2]));
    print_row("green of both frames", &chosen(&[1, 4]));
    print_row("all of both frames", &chosen(&[0, 1, 2, 3, 4, 5]));
    Ok(())
}

/// The mean of a spot as a sensor measures it.
fn noisy(electrons: f64, read_e: f64, rng: &mut KeyedRng) -> f64 {
    let deviation = ((electrons + read_e * read_e) / (PIXELS / 4.0)).sqrt();
    (electrons + deviation * rng.sample::<f64, _>(StandardNormal)).max(1e-3)
}

fn print_row(what: &str, classes: &[Vec<Vec<f64>>; 2]) {
    if let Some(found) = SpotSeparation::new(Vec::new(), Vec::new(), SpotScale::Logarithms, classes) {
        let [low, high] = found.d_prime_interval;
        println!("    {what:<24} d' {:5.2} ({low:.2} to {high:.2})", found.d_prime);
    }
}
