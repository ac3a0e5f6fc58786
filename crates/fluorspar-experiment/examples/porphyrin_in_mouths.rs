//! Do the intervals of the estimate that knows a family of tissues hold the truth in rendered mouths?
//!
//! `cargo run --release -p fluorspar-experiment --example porphyrin_in_mouths [-- MOUTHS [known | other | wrong | all [DRAWS]]]`
//!
//! Each mouth is another person: its shape is drawn, and so are the tissues of tongue, lip and cheek from the populations of their
//! sites. It is rendered small under a LED of 405 nm and one of 450 nm, all bounces between its parts included. Regions keep three
//! pixels away from the rim of their part, where pixels hold light of what lies beside, as a person does who draws them. From its
//! component image come the frames of many draws: amounts of porphyrin, of which every other is none, exposures, noise of the
//! sensor, errors of the library of spectra. The estimate sees the developed frames and the typical tissue of the site, in the
//! first run with a prior as wide as the population that tissues are drawn from, in the others with the usual width: before the other
//! variant of each site, and before tissue of another site. The truth is that of the component image. Mouths are clusters: the standard error of a coverage is that of the mean over mouths.

#![allow(clippy::print_stdout, reason = "printing is what the example is for")]

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use fluorspar::analysis::{
    ChannelNoise, FamilyAverage, LightFamily, PixelSelection, RegionLight, ShareInterval, mean_of_pixels,
};
use fluorspar::image::{ComponentFactors, ComponentImage, LightPath};
use fluorspar::pipeline::{
    CameraResponse, CapturePlanes, FamilyFrame, SeenComponents, analyze_seen, capture_from_planes,
    other_tissue_families, tissue_family,
};
use fluorspar::render::{RenderControl, render};
use fluorspar::sampling::random::Key;
use fluorspar::study::{Study, TissuePrior};
use fluorspar::tissue::{CachedSolutions, Population, Site};
use fluorspar_anatomy::sample_person;
use fluorspar_experiment::{parse, preset, resolve};

type Fallible<T> = Result<T, Box<dyn Error>>;

/// Measurements of each region of each mouth, if nothing else is asked for.
const DRAWS: u64 = 90;
/// People before these had their mouths rendered to set what the estimate knows of indirect light and of the light of teeth.
const FIRST_PERSON: u64 = 20;
/// Pixels of the sensor between a region and the rim of its part: two of the render.
const INSET_PX: u32 = 3;
/// Exposure that the family is made for, s; electrons of others are brought to it.
const TIME_S: f64 = 0.03;
/// Regions: a part, its material, and the site that the estimate takes it for.
const REGIONS: [[&str; 3]; 3] = [
    ["tongue_dorsum", "tongue_dorsum", "dorsal_tongue"],
    ["lower_lip", "lip", "lip"],
    ["cheek_left", "cheek", "buccal_mucosa"],
];
/// The pose of the default experiment, in which all of these are seen.
const POSE: [&str; 5] = [
    "jaw_opening_mm",
    "tongue_protrusion_mm",
    "tongue_elevation_mm",
    "lip_opening_width_mm",
    "lip_retraction_mm",
];
/// Frames of the two estimates.
const LIGHTS: [&str; 2] = ["one light", "two lights"];
const PORPHYRIN: &str = "biofilm_porphyrin";

/// A normal deviate that belongs to a key (Box and Muller).
fn normal(key: Key) -> f64 {
    let uniform = |id: u64| (key.with(id).value() >> 11) as f64 / (1u64 << 53) as f64;
    (-2.0 * (1.0 - uniform(0)).ln()).sqrt() * (std::f64::consts::TAU * uniform(1)).cos()
}

/// The experiment of a person: shape, and tissues drawn from the populations of `sites`, in the order of the regions.
fn experiment(number: u64, sites: &[Site; 3]) -> Fallible<String> {
    let mut person = toml::Table::try_from(sample_person(number as u32 + 1))?;
    person.retain(|name, _| !POSE.contains(&name));
    person.insert("detail".into(), toml::Value::Float(0.5));
    let mut text = String::from(
        "format = 1\nbase = \"oraleye-2021\"\n[spectral]\nfirst_nm = 370.0\nlast_nm = 700.0\nstep_nm = 5.0\n[render]\n\
         width_px = 128\nheight_px = 96\nsamples_per_pixel = 12\nmax_depth = 5\n[sensor]\ncolumns = 192\nrows = 144\n\
         pixel_size_um = 11.3\nfill_factor = 0.04\n[[light]]\nname = \"blue\"\nspectrum = \"led_405\"\n[[light]]\nname = \"white\"\nspectrum = \"led_450\"\n\
         filters = [\"short_pass_475\"]\nhalf_angle_deg = 25.0\nstrength.power_mw = 2000.0\n[[capture]]\nname = \"white\"\n\
         exposure_ms = 30.0\n[analysis]\ntissue = \"none\"\n",
    );
    for ([_, material, _], site) in REGIONS.iter().zip(sites) {
        let key = Key::new(15).with(number).with(material.len() as u64);
        let (population, site) = (Population::of(site), site.name());
        let variations = population.variations().iter().enumerate();
        // The amount of porphyrin is drawn for each measurement.
        let deviation = |(place, variation): (usize, &fluorspar::tissue::Variation)| {
            if variation.name.contains("porphyrin") { 0.0 } else { normal(key.with(place as u64)) }
        };
        let mut tissue = population.tissue_at(&variations.map(deviation).collect::<Vec<f64>>());
        if tissue.get("biofilm_porphyrin_per_mm")? == 0.0 {
            tissue.set("biofilm_porphyrin_per_mm", 1e-3)?;
        }
        let parameters: Vec<String> =
            tissue.parameters().map(|(parameter, value)| format!("{} = {value:?}", parameter.name)).collect();
        text += &format!(
            "[[tissue]]\nname = \"drawn_{material}\"\nsite = \"{site}\"\nparameters = {{ {} }}\n[[material]]\nname = \"{material}\"\n\
             tissue = \"drawn_{material}\"\n",
            parameters.join(", ")
        );
    }
    text += &toml::to_string(&toml::Table::from_iter([("mouth".to_owned(), toml::Value::Table(person))]))?;
    Ok(text)
}

/// A rendered mouth.
struct Mouth {
    study: Study,
    image: ComponentImage,
    planes: CapturePlanes,
}

impl Mouth {
    fn new(number: u64, sites: &[Site; 3]) -> Fallible<Self> {
        let mut study = resolve(&parse(&experiment(number, sites)?, "person", Path::new("."), &[])?)?.study;
        study.captures.retain(|capture| capture.frame.label != "ambient");
        study.captures.iter_mut().for_each(|capture| capture.subtract = None);
        let control = RenderControl { stop: &AtomicBool::new(false), progress: &|_| {} };
        let image = render(&study.scene, &study.render, &control)?;
        let planes = CapturePlanes::new(&study, &image)?;
        Ok(Self { study, image, planes })
    }

    fn seen<'a>(&'a self, factors: &'a ComponentFactors) -> SeenComponents<'a> {
        SeenComponents { image: &self.image, planes: &self.planes, captures: &self.study.captures, factors }
    }

    /// The pixels of a part, and where the electrons of an exposure of [`TIME_S`] come from; `None` where few pixels show it.
    fn region(&self, part: &str) -> Fallible<Option<(PixelSelection, RegionLight)>> {
        let mut study = self.study.clone();
        let Some(plan) = &mut study.analysis else { return Ok(None) };
        plan.parts = vec![part.to_owned()];
        plan.inset_px = INSET_PX;
        let factors = ComponentFactors::ones(self.image.components.len());
        let seen = self.seen(&factors);
        let frames = capture_from_planes(&study, &seen)?;
        let Ok(Some(analyzed)) = analyze_seen(&study, Some(&seen), &frames) else { return Ok(None) };
        let light = analyzed.analysis.truth.map(|truth| truth.electrons);
        Ok(light.filter(|_| analyzed.region.pixels.len() >= 50).map(|light| (analyzed.region, light)))
    }

    /// Electrons and variances of the mean of a region in both frames, for an amount of porphyrin, brought to an exposure of
    /// [`TIME_S`].
    fn measured(&self, region: &PixelSelection, amount: f64, key: Key) -> Fallible<Option<[Vec<f64>; 2]>> {
        let mut factors = ComponentFactors::ones(self.image.components.len());
        for (factor, component) in factors.even.iter_mut().zip(&self.image.components) {
            if component.light == LightPath::Fluorescence(PORPHYRIN.into()) {
                *factor = amount;
            }
        }
        let mut study = self.study.clone();
        let time_s = TIME_S * (0.5 * normal(key.with(1))).exp();
        study.render.seed = key.with(2).value();
        study.captures.iter_mut().for_each(|capture| capture.frame.exposure_ms = Some(1e3 * time_s));
        if let Some(sensor) = &mut study.camera.sensor {
            let mut model = sensor.model().clone();
            model.device_seed = key.with(3).value();
            *sensor = fluorspar::sensor::Sensor::new(model, sensor.qe().clone())?;
        }
        let frames = capture_from_planes(&study, &self.seen(&factors))?;
        let (mut electrons, mut variance) = (Vec::new(), Vec::new());
        for label in ["blue", "white"] {
            let Some(frame) = frames.iter().find(|frame| frame.raw.label == label) else { return Ok(None) };
            let (image, k) = (&frame.developed, frame.raw.dn_per_electron);
            let Some(sensor) = &study.camera.sensor else { return Ok(None) };
            let noise = ChannelNoise::of_image(
                image,
                k,
                sensor.model().image_prnu_percent() / 100.0,
                k * sensor.model().image_dsnu_electrons(),
            );
            let usable: Vec<usize> =
                region.pixels.iter().copied().filter(|&pixel| !image.saturated[pixel]).collect();
            let Some([mean, of_mean]) = mean_of_pixels(image, &usable, &noise, None)? else {
                return Ok(None);
            };
            let scale = TIME_S / time_s / k;
            electrons.extend(mean.map(|dn| scale * dn));
            variance.extend(of_mean.map(|dn2| scale * scale * dn2));
        }
        Ok(Some([electrons, variance]))
    }
}

/// The family of a site that the estimate is told, and those of the tissues that it compares.
struct Told {
    named: LightFamily,
    others: Vec<LightFamily>,
}

impl Told {
    fn average(&self) -> FamilyAverage<'_> {
        let probability_of_named = TissuePrior::SITE_PROBABILITY;
        FamilyAverage { named: &self.named, others: &self.others, probability_of_named }
    }
}

/// The families before the camera of a study, under its blue light and, if wanted, the other one.
fn told(study: &Study, site: &str, frames: &[&str], width: f64) -> Fallible<Told> {
    let site = preset::site(site)?;
    let teeth = preset::site("tooth")?;
    let names = site.fluorophores().iter().chain(teeth.fluorophores());
    let fluorophores = names.map(|name| Ok(Arc::new(preset::fluorophore(name)?.fluorophore())));
    let prior = TissuePrior {
        fluorophores: fluorophores.collect::<Fallible<_>>()?,
        site,
        width,
        library_error: TissuePrior::LIBRARY_ERROR,
        teeth: Some(teeth),
        site_probability: TissuePrior::SITE_PROBABILITY,
        others: preset::compared_sites()?,
        kept: CachedSolutions::default(),
    };
    let lens = study.camera.lens_behind_filters().ok_or("a lens")?;
    let sensor = study.camera.sensor.as_ref().ok_or("a sensor")?;
    let grid = &study.scene.grid;
    let frame = |label: &&str| -> Fallible<FamilyFrame> {
        let group =
            study.scene.light_groups.iter().position(|group| group.name == *label).ok_or("a light group")?;
        let light = study.scene.lights.iter().find(|light| light.group == group).ok_or("a light")?;
        let spectrum = light.whole_spectrum();
        let irradiance = spectrum.scaled(1000.0 / spectrum.total());
        let camera = CameraResponse::new(&lens, sensor, grid, None);
        Ok(FamilyFrame {
            label: (*label).to_owned(),
            channels: camera.seeing_channels(),
            camera,
            camera_of_reflected: CameraResponse::new(&lens, sensor, grid, Some(&irradiance)),
            irradiance,
            time_s: TIME_S,
        })
    };
    let frames = frames.iter().map(frame).collect::<Fallible<Vec<_>>>()?;
    Ok(Told {
        named: tissue_family(&prior, &frames, grid)?,
        others: other_tissue_families(&prior, &frames, grid)?,
    })
}

/// Coverage of the measurements of a region in all mouths.
#[derive(Default)]
struct Coverage {
    held: Vec<f64>,
    /// Held by the interval of the family that is told alone.
    alone: Vec<f64>,
    /// With a warning that the region is foreign to the family, or other tissue.
    warned: Vec<f64>,
    /// Held, or with such a warning.
    told: Vec<f64>,
    zero_held: Vec<f64>,
    cases: usize,
    errors: Vec<f64>,
    widths: Vec<f64>,
    truths: Vec<f64>,
}

impl Coverage {
    fn add(&mut self, other: &Self) {
        self.held.extend(&other.held);
        self.alone.extend(&other.alone);
        self.warned.extend(&other.warned);
        self.told.extend(&other.told);
        self.zero_held.extend(&other.zero_held);
        self.cases += other.cases;
        self.errors.extend(&other.errors);
        self.widths.extend(&other.widths);
        self.truths.extend(&other.truths);
    }

    fn print(&self, what: &str) {
        let [held, error] = of_clusters(&self.held);
        let [alone, alone_error] = of_clusters(&self.alone);
        let [[warned, _], [told, _]] = [of_clusters(&self.warned), of_clusters(&self.told)];
        let [zero, zero_error] = of_clusters(&self.zero_held);
        println!(
            "{what}: {} cases, held {held:.3} +- {error:.3}, by the tissue that is told alone {alone:.3} +- {alone_error:.3}, warned {warned:.3}, held or warned \
             {told:.3}, of those without porphyrin {zero:.3} +- {zero_error:.3}, median error \
             {:+.4}, median width {:.3}, median share where there is some {:.3}",
            self.cases,
            median(&self.errors),
            median(&self.widths),
            median(&self.truths),
        );
    }
}

/// Mean over clusters, with its standard error.
fn of_clusters(clusters: &[f64]) -> [f64; 2] {
    let n = clusters.len() as f64;
    let mean = clusters.iter().sum::<f64>() / n;
    let squares: f64 = clusters.iter().map(|value| (value - mean).powi(2)).sum();
    [mean, (squares / (n - 1.0) / n).sqrt()]
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Logarithm of porphyrin over other fluorescence.
fn log_odds(light: &RegionLight) -> f64 {
    (light.porphyrin.iter().sum::<f64>() / light.bulk.iter().sum::<f64>()).ln()
}

/// A site with the optics of the other variant of the tongue: every parameter changed as there, in proportion, the saturation by the
/// difference. It scatters half as much and holds less of everything.
fn other_variant(name: &str) -> Fallible<Site> {
    let [from, to] = [preset::site("dorsal_tongue")?, preset::site("dorsal_tongue_b")?];
    let mut site = preset::site(name)?;
    for (parameter, value) in preset::site(name)?.parameters() {
        let [from, to] = [from.get(parameter.name)?, to.get(parameter.name)?];
        let changed = match parameter.name {
            "oxygen_saturation" => value + to - from,
            _ if from > 0.0 => value * to / from,
            _ => value,
        };
        site.set(parameter.name, changed.clamp(parameter.range[0], parameter.range[1]))?;
    }
    Ok(site)
}

/// All regions of some mouths whose tongue, lip and cheek are drawn around `sites`.
fn run(mouths: u64, what: &str, sites: &[Site; 3], width: f64, draws: u64) -> Fallible<()> {
    let start = Instant::now();
    let people = FIRST_PERSON..FIRST_PERSON + mouths;
    let rendered = people.map(|number| Mouth::new(number, sites)).collect::<Fallible<Vec<_>>>()?;
    println!(
        "{mouths} mouths, {what}, prior {width} times as wide as the population, rendered in {:.0} s",
        start.elapsed().as_secs_f64()
    );
    let mut all = [Coverage::default(), Coverage::default()];
    for [part, _, site] in REGIONS {
        let regions = rendered.iter().map(|mouth| mouth.region(part)).collect::<Fallible<Vec<_>>>()?;
        let study = &rendered[0].study;
        let families = [told(study, site, &["blue"], width)?, told(study, site, &["blue", "white"], width)?];
        // Maps give each region another mean amount: in the middle of the mouths it is that of the middle of the prior
        let first = &families[0].named;
        let middle = first.share(&vec![0.0; first.nuisances().len()], first.porphyrin.median);
        let found: Vec<f64> = regions.iter().flatten().map(|(_, light)| log_odds(light)).collect();
        let scale = ((middle / (1.0 - middle)).ln() - median(&found)).exp();
        let mut of_part = [Coverage::default(), Coverage::default()];
        for (number, (mouth, region)) in rendered.iter().zip(&regions).enumerate() {
            let Some((region, light)) = region else { continue };
            let key = Key::new(16).with(number as u64).with(part.len() as u64);
            let found = of_region(mouth, region, light, &families, scale, (key, draws))?;
            of_part.iter_mut().zip(&found).for_each(|(coverage, found)| coverage.add(found));
        }
        for ((coverage, all), lights) in of_part.iter().zip(&mut all).zip(LIGHTS) {
            coverage.print(&format!("{part}, {lights}, {} mouths", coverage.held.len()));
            all.add(coverage);
        }
    }
    for (coverage, lights) in all.iter().zip(LIGHTS) {
        coverage.print(&format!("all regions, {lights}"));
    }
    println!("{:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

/// Measurements of one region, under one light and under two.
fn of_region(
    mouth: &Mouth,
    region: &PixelSelection,
    light: &RegionLight,
    families: &[Told; 2],
    scale: f64,
    (key, draws): (Key, u64),
) -> Fallible<[Coverage; 2]> {
    let mut coverages = [Coverage::default(), Coverage::default()];
    let mut hits = [Vec::new(), Vec::new()];
    let mut told = [Vec::new(), Vec::new()];
    let mut alone = [Vec::new(), Vec::new()];
    let mut warnings = [Vec::new(), Vec::new()];
    let mut zeros = [Vec::new(), Vec::new()];
    let family = &families[1].named;
    for draw in 0..draws {
        let key = key.with(draw);
        let amount =
            if draw % 2 == 0 { 0.0 } else { scale * (family.porphyrin.log_sd * normal(key.with(10))).exp() };
        let Some([mut electrons, variance]) = mouth.measured(region, amount, key)? else { continue };
        let nuisances: Vec<f64> =
            (0..family.nuisances().len()).map(|place| normal(key.with(20 + place as u64))).collect();
        for (value, factor) in electrons.iter_mut().zip(family.library_factors(&nuisances)) {
            *value *= factor;
        }
        let odds = amount * log_odds(light).exp();
        let truth = odds / (1.0 + odds);
        for (which, average) in families.iter().map(Told::average).enumerate() {
            let family = average.named;
            let n = family.frame_of.len();
            let found = average.share_interval(&electrons[..n], &variance[..n]);
            let of_named = family.share_interval(&electrons[..n], &variance[..n]);
            let Some(ShareInterval { median: middle, interval: [low, high], warned }) = found else {
                continue;
            };
            let is_held = low <= truth && truth <= high;
            let holds = |found: ShareInterval| found.interval[0] <= truth && truth <= found.interval[1];
            hits[which].push(f64::from(u8::from(is_held)));
            alone[which].push(f64::from(u8::from(of_named.is_some_and(holds))));
            warnings[which].push(f64::from(u8::from(warned)));
            told[which].push(f64::from(u8::from(is_held || warned)));
            let coverage = &mut coverages[which];
            if amount == 0.0 {
                zeros[which].push(f64::from(u8::from(low == 0.0)));
            } else {
                coverage.truths.push(truth);
            }
            coverage.errors.push(middle - truth);
            coverage.widths.push(high - low);
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    for (which, coverage) in coverages.iter_mut().enumerate() {
        coverage.cases = hits[which].len();
        coverage.held.push(mean(&hits[which]));
        coverage.alone.push(mean(&alone[which]));
        coverage.warned.push(mean(&warnings[which]));
        coverage.told.push(mean(&told[which]));
        coverage.zero_held.push(mean(&zeros[which]));
    }
    Ok(coverages)
}

fn main() -> Fallible<()> {
    let mut arguments = std::env::args().skip(1);
    let mouths = arguments.next().map_or(Ok(20), |text| text.parse())?;
    let wanted = arguments.next();
    let draws = arguments.next().map_or(Ok(DRAWS), |text| text.parse())?;
    let is_wanted = |run: &str| wanted.as_deref().is_none_or(|wanted| wanted == run || wanted == "all");
    let usual = TissuePrior::WIDTH;
    let [tongue, lip, cheek] = REGIONS.map(|[_, _, site]| site);
    if is_wanted("known") {
        let sites = [preset::site(tongue)?, preset::site(lip)?, preset::site(cheek)?];
        run(mouths, "the sites of the estimate", &sites, 1.0, draws)?;
    }
    if is_wanted("other") {
        let sites = [other_variant(tongue)?, other_variant(lip)?, other_variant(cheek)?];
        run(mouths, "other variants of the sites", &sites, usual, draws)?;
    }
    if is_wanted("wrong") {
        // Lips and cheeks that are not what the estimate takes them for
        let sites = [other_variant(tongue)?, preset::site(cheek)?, preset::site("soft_palate")?];
        run(mouths, "other tissue in the place of lip and cheek", &sites, usual, draws)?;
    }
    Ok(())
}
