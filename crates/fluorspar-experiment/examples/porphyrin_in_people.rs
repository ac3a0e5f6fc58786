//! What the estimate of a tissue family says about measured lips and tongues.
//!
//! `cargo run --release -p fluorspar-experiment --example porphyrin_in_people -- FOLDER`
//!
//! FOLDER holds `tissue/`, `lights/`, `fluorophores/` and `blood/` of the reference data, which do not ship. Each measured
//! spectrum, 500 to 700 nm behind its long-pass, goes to sensors of three, four, eight and sixteen channels; a thousand pixels are
//! averaged. The lamp, its leak through the filter, the filter and the sensor are known; the person is not. One line for each lamp,
//! then for pairs of records of one person and day under two lamps. Tongues are compared with a fit of their spectra that knows no
//! sensor: the five terms and the blood with which the authors of the data describe them.

#![allow(clippy::print_stdout, reason = "printing is what the example is for")]

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fluorspar::analysis::{BloodBefore, LightFamily, MixtureComponent, SharePosterior, SpectralMixture};
use fluorspar::optics::IdealLens;
use fluorspar::pipeline::{CameraResponse, FamilyFrame, tissue_family};
use fluorspar::sensor::{Sensor, SensorModel, SpectralQe};
use fluorspar::spectral::{Curve, WavelengthGrid};
use fluorspar::study::TissuePrior;
use fluorspar::tissue::CachedSolutions;
use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::{DEFAULT_SAMPLE, parse_sample};

type Fallible<T> = Result<T, Box<dyn Error>>;

/// Where the measured spectra hold, nm.
const BAND_NM: [f64; 2] = [500.0, 700.0];
/// Pixels whose mean is measured.
const PIXELS: f64 = 1000.0;
/// Exposure, s, of a lamp whose light makes 1 W/(sr m²) on a white target: thousands of electrons.
const TIME_S: f64 = 600.0;

/// Columns of a file of spectra.
fn spectra(path: &Path) -> Fallible<BTreeMap<String, Curve>> {
    let text = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().ok_or("an empty file")?.split(',').collect();
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap_or(0.0)).collect()).collect();
    let nm: Vec<f64> = rows.iter().map(|row| row[0]).collect();
    let column = |i: usize| Curve::new(nm.clone(), rows.iter().map(|row| row[i]).collect());
    names.iter().enumerate().skip(1).map(|(i, name)| Ok((name.to_string(), column(i)?))).collect()
}

/// Rows of an index, by the names of its columns.
fn index(path: &Path) -> Fallible<Vec<BTreeMap<String, String>>> {
    let text = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().ok_or("an empty file")?.split(',').collect();
    let row =
        |line: &str| names.iter().zip(line.split(',')).map(|(n, v)| (n.to_string(), v.to_string())).collect();
    Ok(lines.map(row).collect())
}

/// A lamp: its irradiance where a white target shows 1 W/(sr m²), leak included, and its level by current, mA.
struct Lamp {
    irradiance: Curve,
    levels: BTreeMap<u32, f64>,
}

impl Lamp {
    fn level(&self, current: u32) -> f64 {
        self.levels.iter().min_by_key(|(known, _)| known.abs_diff(current)).map_or(1.0, |(_, level)| *level)
    }
}

fn lamp(folder: &Path, name: &str, filter: &Curve) -> Fallible<Lamp> {
    let columns = spectra(&folder.join("lights/oe_tongue_lip_excitation_lights.csv"))?;
    let rows = index(&folder.join("lights/oe_tongue_lip_excitation_lights_index.csv"))?;
    let of = |condition: &'static str| {
        let wanted =
            move |row: &&BTreeMap<String, String>| row["condition"] == condition && row["led_nm"] == name;
        rows.iter().filter(wanted).filter_map(|row| {
            Some((row["current_mA"].parse::<u32>().ok()?, columns.get(&row["column"])?, &row["column"]))
        })
    };
    let (below, above): (Vec<f64>, Vec<f64>) =
        ((380..490).map(f64::from).collect(), (500..=700).step_by(5).map(f64::from).collect());
    let mut lamp = Lamp { irradiance: Curve::constant(0.0), levels: BTreeMap::new() };
    let mut shape = vec![0.0; below.len()];
    for (current, curve, _) in of("experiment") {
        let values: Vec<f64> = below.iter().map(|&nm| curve.at(nm).max(0.0)).collect();
        let level: f64 = values.iter().sum();
        lamp.levels.insert(current, level);
        shape.iter_mut().zip(&values).for_each(|(sum, value)| *sum += value / level);
    }
    let total: f64 = shape.iter().sum();
    // Behind the filter: what a white target sends through it
    let strong = |(current, _, column): &(u32, &Curve, &String)| *current > 200 && column.ends_with("_0317");
    let leaks: Vec<_> = of("unwanted_reflected_475lpf").filter(strong).collect();
    let leak = |nm: f64| {
        let mean = leaks.iter().map(|(current, curve, _)| curve.at(nm) / lamp.level(*current)).sum::<f64>();
        (mean / leaks.len() as f64 / filter.at(nm).max(0.05)).max(0.0)
    };
    let pi = std::f64::consts::PI;
    let values = shape.iter().map(|value| pi * value / total).chain(above.iter().map(|&nm| pi * leak(nm)));
    let values = values.collect();
    lamp.irradiance = Curve::new([below.as_slice(), above.as_slice()].concat(), values)?;
    Ok(lamp)
}

/// The paper's sensor with a quantum efficiency that stands for its own, which is not public.
const RGB: &str = "lyu_2021_table_1";
const SENSORS: [&str; 4] = [RGB, "rgb_nir_3um", "multispectral_8_band", "multispectral_16_band"];

/// A sensor of the catalogue.
fn sensor(name: &str) -> Fallible<Sensor> {
    if name == RGB {
        let qe = SpectralQe::from_curves(preset::quantum_efficiency("consumer_rgb_cmos")?.channels()?)?;
        return Ok(Sensor::new(SensorModel::default(), qe)?);
    }
    let sample = preset::text(PresetKind::Sample, DEFAULT_SAMPLE)?;
    let text: Vec<&str> = sample.lines().filter(|line| !line.starts_with("quantum_efficiency")).collect();
    let change = format!("sensor.preset=\"{name}\"");
    let sample = parse_sample(&text.join("\n"), DEFAULT_SAMPLE, Path::new("."), &[change])?.sample;
    Ok(sample.camera.sensor.ok_or("a sensor")?)
}

/// A sensor behind a lens with a filter, for light of 500 to 700 nm.
fn camera(sensor: &Sensor, filter: &Curve, light: Option<&Curve>, grid: &WavelengthGrid) -> CameraResponse {
    let transmittance = filter.clipped(BAND_NM[0], BAND_NM[1]);
    let lens = IdealLens { transmittance, ..IdealLens::new(8.0, 2.0) };
    CameraResponse::new(&lens, sensor, grid, light)
}

/// A measured spectrum.
struct Record {
    person_and_day: String,
    lamp: &'static str,
    /// Radiance per unit of the lamp, W/(sr m² nm).
    radiance: Vec<f64>,
    /// Spectrum of 500 to 700 nm, 1 at 520 nm.
    shape: Vec<f64>,
}

impl Record {
    /// Electrons of the channels of a bare camera (the filter is in the measurement already), and the variance of their means.
    fn electrons(&self, bare: &CameraResponse) -> [Vec<f64>; 2] {
        let channels = bare.seeing_channels();
        let share = 1.0 / bare.channels().len() as f64;
        let electrons: Vec<f64> =
            channels.iter().map(|c| bare.channel_electrons(*c, &self.radiance, TIME_S)).collect();
        let pixels = if bare.rgb().is_some() { 0.25 * PIXELS } else { share * PIXELS };
        let variance = electrons.iter().map(|e| (e + 190.0 + (0.02 * e).powi(2)) / pixels).collect();
        [electrons, variance]
    }
}

/// People before they ate.
const PEOPLE: [&str; 4] = ["S1", "S2", "S3", "S4"];
const LAMPS: [&str; 3] = ["405", "415", "450"];

fn records(
    folder: &Path,
    place: &str,
    lamps: &BTreeMap<&'static str, Lamp>,
    grid: &WavelengthGrid,
) -> Fallible<Vec<Record>> {
    let columns = spectra(&folder.join("tissue/oe_tongue_lip_fluorescence.csv"))?;
    let rows = index(&folder.join("tissue/oe_tongue_lip_fluorescence_index.csv"))?;
    let mut found = Vec::new();
    for row in rows.iter().filter(|row| row["site"] == place && row["flag"].is_empty()) {
        let Some(name) = LAMPS.iter().find(|name| **name == row["led_nm"]) else { continue };
        let usable = row["current_mA"].parse::<u32>().ok().zip(columns.get(&row["column"]));
        let (Some((current, curve)), Some(lamp)) = (usable, lamps.get(name)) else { continue };
        if !PEOPLE.contains(&row["subject"].as_str()) {
            continue;
        }
        found.push(Record {
            person_and_day: format!("{} {}", row["subject"], row["date"]),
            lamp: name,
            radiance: curve.bin_averages(grid).iter().map(|l| l / lamp.level(current)).collect(),
            shape: fitted_nm().map(|nm| curve.at(nm) / curve.at(520.0)).collect(),
        });
    }
    Ok(found)
}

fn family(
    site: &str,
    lamps: &[(&str, &Lamp)],
    sensor: &Sensor,
    filter: &Curve,
    grid: &WavelengthGrid,
) -> Fallible<LightFamily> {
    let site = preset::site(site)?;
    let fluorophores = site
        .fluorophores()
        .iter()
        .map(|name| Ok(Arc::new(preset::fluorophore(name)?.fluorophore())))
        .collect::<Fallible<_>>()?;
    let (width, library_error) = (TissuePrior::WIDTH, TissuePrior::LIBRARY_ERROR);
    let kept = CachedSolutions::default();
    let prior = TissuePrior {
        site,
        fluorophores,
        width,
        library_error,
        teeth: None,
        site_probability: 1.0,
        others: Vec::new(),
        kept,
    };
    let frame = |(name, lamp): &(&str, &Lamp)| FamilyFrame {
        label: (*name).into(),
        irradiance: lamp.irradiance.clone(),
        // As that of the data, which hold the filter already
        channels: camera(sensor, &Curve::constant(1.0), None, grid).seeing_channels(),
        camera: camera(sensor, filter, None, grid),
        camera_of_reflected: camera(sensor, filter, Some(&lamp.irradiance), grid),
        time_s: TIME_S,
    };
    let frames: Vec<FamilyFrame> = lamps.iter().map(frame).collect();
    Ok(tissue_family(&prior, &frames, grid)?)
}

/// The terms with which the authors of the data describe their spectra: collagen below blood, FAD, porphyrin, chlorophyll, and a broad
/// band, center and standard deviation in nm.
struct SpectralFit(SpectralMixture);

const TERMS: [&str; 4] = ["collagen1_smooth", "fad_webfluor", "porphyrinbjurshammar", "chlorophylla_7"];
const PORPHYRIN: usize = 2;
const BROAD_NM: [f64; 2] = [425.1, 386.7];
const STEP_NM: f64 = 2.0;

fn fitted_nm() -> impl Iterator<Item = f64> + Clone {
    (0..=100).map(|i| BAND_NM[0] + STEP_NM * f64::from(i))
}

impl SpectralFit {
    fn read(folder: &Path) -> Fallible<Self> {
        let at = |curve: &Curve| -> Vec<f64> { fitted_nm().map(|nm| curve.at(nm)).collect() };
        let mut terms = Vec::new();
        for name in TERMS {
            let columns = spectra(&folder.join(format!("fluorophores/toolbox/{name}.csv")))?;
            let values = at(columns.get("emission").ok_or("an emission spectrum")?);
            terms.push(MixtureComponent { name: name.into(), values });
        }
        let [center, sd] = BROAD_NM;
        let broad = fitted_nm().map(|nm| (-0.5 * ((nm - center) / sd).powi(2)).exp()).collect();
        terms.push(MixtureComponent { name: "broad".into(), values: broad });
        let blood = spectra(&folder.join("blood/hemoglobin_oxy_molar_extinction.csv"))?;
        let blood = blood.into_values().next().ok_or("an extinction")?;
        let extinction = at(&blood).into_iter().map(|e| e / blood.max()).collect();
        let blood = BloodBefore::Layer { extinction, below: vec![0], largest: 40.0 };
        Ok(Self(SpectralMixture::new(fitted_nm().collect(), terms, blood)?))
    }

    /// Share of the porphyrin in the electrons of a camera that counts, and its standard error.
    fn share(&self, record: &Record, bare: &CameraResponse, grid: &WavelengthGrid) -> Fallible<[f64; 2]> {
        let found = self.0.fit(&record.shape, None)?;
        let counted = bare.rgb().map_or_else(|| bare.seeing_channels(), Vec::from);
        let nm: Vec<f64> = fitted_nm().collect();
        let electrons = |spectrum: Vec<f64>| -> Fallible<f64> {
            let radiance = Curve::new(nm.clone(), spectrum)?.bin_averages(grid);
            Ok(counted.iter().map(|c| bare.channel_electrons(*c, &radiance, 1.0)).sum())
        };
        let all = electrons(found.fitted.clone())?;
        let of_one = electrons(self.0.components()[PORPHYRIN].values.clone())? / all;
        let porphyrin = &found.weights[PORPHYRIN];
        Ok([porphyrin.weight * of_one, porphyrin.standard_error.unwrap_or(f64::INFINITY) * of_one])
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    if values.is_empty() { f64::NAN } else { values[values.len() / 2] }
}

fn report(what: &str, posteriors: &[SharePosterior]) {
    let of = |value: &dyn Fn(&SharePosterior) -> f64| -> Vec<f64> { posteriors.iter().map(value).collect() };
    let zero = posteriors.iter().filter(|p| p.interval[0] == 0.0).count();
    println!(
        "{what}: {} of {} hold 0; median of medians {:.4}, of upper limits {:.3} (largest {:.3}); P(none) {:.2}; foreign {}; \
         misfit {:.1} of {}",
        zero,
        posteriors.len(),
        median(of(&|p| p.median)),
        median(of(&|p| p.upper_limit)),
        of(&|p| p.upper_limit).into_iter().fold(0.0, f64::max),
        median(of(&|p| p.probability_of_none)),
        posteriors.iter().filter(|p| p.foreign).count(),
        median(of(&|p| p.misfit)),
        posteriors.first().map_or(0, |p| p.data),
    );
    let Some(first) = posteriors.first() else { return };
    let without = first.without.iter().enumerate().map(|(place, known)| {
        format!("{} {:.3}", known.source, median(of(&|p: &SharePosterior| p.without[place].interval[1])))
    });
    let wide = median(of(&|p| p.with_prior_twice_as_wide[1]));
    println!(
        "    upper ends without {}; with a prior twice as wide {wide:.3}",
        without.collect::<Vec<_>>().join(", ")
    );
}

/// Estimates beside the fits of the spectra.
fn compare(what: &str, found: &[(SharePosterior, [f64; 2])]) {
    let sure: Vec<_> = found.iter().filter(|(_, [share, error])| *share > 3.0 * error).collect();
    let excluded = sure.iter().filter(|(posterior, _)| posterior.interval[0] > 0.0).count();
    let n = found.len() as f64;
    let pairs: Vec<[f64; 2]> =
        found.iter().map(|(posterior, [share, _])| [posterior.median, *share]).collect();
    let mean = |of: &dyn Fn(&[f64; 2]) -> f64| pairs.iter().map(of).sum::<f64>() / n;
    let [a, b] = [mean(&|pair| pair[0]), mean(&|pair| pair[1])];
    let moment = |i: usize, j: usize| mean(&|pair| (pair[i] - [a, b][i]) * (pair[j] - [a, b][j]));
    println!(
        "{what}: {excluded} of {} above three standard errors exclude 0 ({} records); r {:.3}, bias {:+.4}, mean share of the fits {b:.3}",
        sure.len(),
        found.len(),
        moment(0, 1) / (moment(0, 0) * moment(1, 1)).sqrt(),
        a - b,
    );
}

/// One site before one sensor: under each lamp, then under two.
fn of_sensor(
    [site, place]: [&str; 2],
    sensor: &Sensor,
    records: &[Record],
    lamps: &BTreeMap<&'static str, Lamp>,
    fits: &SpectralFit,
    grid: &WavelengthGrid,
) -> Fallible<()> {
    let filter = preset::filter("long_pass_488_k2")?.curve();
    let bare = camera(sensor, &Curve::constant(1.0), None, grid);
    let family = |lamps: &[(&str, &Lamp)]| family(site, lamps, sensor, &filter, grid);
    let mut all = Vec::new();
    for name in LAMPS {
        let family = family(&[(name, &lamps[name])])?;
        let mut of_lamp = Vec::new();
        for record in records.iter().filter(|record| record.lamp == name) {
            let [electrons, variance] = record.electrons(&bare);
            let share = fits.share(record, &bare, grid)?;
            of_lamp.extend(family.posterior(&electrons, &variance).map(|posterior| (posterior, share)));
        }
        let posteriors: Vec<SharePosterior> =
            of_lamp.iter().map(|(posterior, _)| posterior.clone()).collect();
        report(&format!("  {place} {name} nm"), &posteriors);
        compare(&format!("  {place} {name} nm against fits"), &of_lamp);
        all.extend(of_lamp);
    }
    let posteriors: Vec<SharePosterior> = all.iter().map(|(posterior, _)| posterior.clone()).collect();
    report(&format!("  {place}, one lamp"), &posteriors);
    compare(&format!("  {place}, one lamp, against fits"), &all);
    for [a, b] in [["405", "450"], ["415", "450"]] {
        let family = family(&[(a, &lamps[a]), (b, &lamps[b])])?;
        let mut pairs = Vec::new();
        for first in records.iter().filter(|record| record.lamp == a) {
            let share = fits.share(first, &bare, grid)?;
            let same = |record: &&Record| record.lamp == b && record.person_and_day == first.person_and_day;
            for second in records.iter().filter(same) {
                let both = [first.electrons(&bare), second.electrons(&bare)];
                let [electrons, variance] =
                    [0, 1].map(|i| both.iter().flat_map(|d| d[i].clone()).collect::<Vec<_>>());
                pairs.extend(family.posterior(&electrons, &variance).map(|posterior| (posterior, share)));
            }
        }
        let posteriors: Vec<SharePosterior> = pairs.iter().map(|(posterior, _)| posterior.clone()).collect();
        report(&format!("  {place} {a} and {b} nm"), &posteriors);
        compare(&format!("  {place} {a} and {b} nm against fits"), &pairs);
    }
    Ok(())
}

fn main() -> Fallible<()> {
    let folder: PathBuf = std::env::args().nth(1).ok_or("give the folder of the reference data")?.into();
    let filter = preset::filter("long_pass_488_k2")?.curve();
    let grid = WavelengthGrid::uniform(380.0, 700.0, 5.0)?;
    let mut lamps = BTreeMap::new();
    for name in LAMPS {
        lamps.insert(name, lamp(&folder, name, &filter)?);
    }
    let fits = SpectralFit::read(&folder)?;
    for place in [["lip", "lip"], ["dorsal_tongue", "tongue"]] {
        let records = records(&folder, place[1], &lamps, &grid)?;
        for name in SENSORS {
            println!("{name}");
            of_sensor(place, &sensor(name)?, &records, &lamps, &fits, &grid)?;
        }
    }
    Ok(())
}
