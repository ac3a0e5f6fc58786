//! What the estimate of a tissue family says about measured lips and tongues.
//!
//! `cargo run --release -p fluorspar-experiment --example porphyrin_in_people -- FOLDER`
//!
//! FOLDER holds `tissue/` and `lights/` of the reference data, which do not ship. Each measured spectrum, 500 to 700 nm behind its
//! long-pass, goes to a consumer sensor; a thousand pixels are averaged. The lamp, its leak through the filter, the filter and the
//! sensor are known; the person is not. One line per lamp, then pairs of records of one person and day under two lamps.

#![allow(clippy::print_stdout, reason = "printing is what the example is for")]

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fluorspar::analysis::{LightFamily, SharePosterior};
use fluorspar::optics::IdealLens;
use fluorspar::pipeline::{CameraResponse, FamilyFrame, tissue_family};
use fluorspar::sensor::{Sensor, SensorModel, SpectralQe};
use fluorspar::spectral::{Curve, WavelengthGrid};
use fluorspar::study::TissuePrior;
use fluorspar::tissue::{KeptSolutions, Site};
use fluorspar_experiment::preset;

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

/// The sensor behind a lens with a filter, for light of 500 to 700 nm.
fn camera(filter: &Curve, light: Option<&Curve>, grid: &WavelengthGrid) -> Fallible<CameraResponse> {
    let qe = SpectralQe::from_curves(preset::quantum_efficiency("consumer_rgb_cmos")?.channels()?)?;
    let sensor = Sensor::new(SensorModel::default(), qe)?;
    let transmittance = filter.clipped(BAND_NM[0], BAND_NM[1]);
    let lens = IdealLens { transmittance, ..IdealLens::new(8.0, 2.0) };
    Ok(CameraResponse::new(&lens, &sensor, grid, light))
}

/// A measured spectrum as electrons of R, G and B, per unit of the lamp.
struct Record {
    person_and_day: String,
    lamp: &'static str,
    electrons: Vec<f64>,
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
    // The filter is in the measurement already
    let bare = camera(&Curve::constant(1.0), None, grid)?;
    let rgb = bare.rgb().ok_or("R, G and B")?;
    let mut found = Vec::new();
    for row in rows.iter().filter(|row| row["site"] == place && row["flag"].is_empty()) {
        let Some(name) = LAMPS.iter().find(|name| **name == row["led_nm"]) else { continue };
        let usable = row["current_mA"].parse::<u32>().ok().zip(columns.get(&row["column"]));
        let (Some((current, curve)), Some(lamp)) = (usable, lamps.get(name)) else { continue };
        if !PEOPLE.contains(&row["subject"].as_str()) {
            continue;
        }
        let radiance: Vec<f64> = curve.bin_averages(grid).iter().map(|l| l / lamp.level(current)).collect();
        let electrons = rgb.map(|channel| bare.channel_electrons(channel, &radiance, TIME_S)).to_vec();
        let person_and_day = format!("{} {}", row["subject"], row["date"]);
        found.push(Record { person_and_day, lamp: name, electrons });
    }
    Ok(found)
}

fn family(
    site: &str,
    lamps: &[(&str, &Lamp)],
    filter: &Curve,
    grid: &WavelengthGrid,
) -> Fallible<LightFamily> {
    let site = Site::named(site)?;
    let fluorophores = site
        .fluorophores()
        .iter()
        .map(|name| Ok(Arc::new(preset::fluorophore(name)?.fluorophore())))
        .collect::<Fallible<_>>()?;
    let (width, library_error) = (TissuePrior::WIDTH, TissuePrior::LIBRARY_ERROR);
    let kept = KeptSolutions::default();
    let prior = TissuePrior { site, fluorophores, width, library_error, surroundings: false, kept };
    let frame = |(name, lamp): &(&str, &Lamp)| -> Fallible<FamilyFrame> {
        Ok(FamilyFrame {
            label: (*name).into(),
            irradiance: lamp.irradiance.clone(),
            camera: camera(filter, None, grid)?,
            camera_of_reflected: camera(filter, Some(&lamp.irradiance), grid)?,
            time_s: TIME_S,
        })
    };
    let frames = lamps.iter().map(frame).collect::<Fallible<Vec<_>>>()?;
    Ok(tissue_family(&prior, &frames, grid)?)
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
         misfit {:.1}",
        zero,
        posteriors.len(),
        median(of(&|p| p.median)),
        median(of(&|p| p.upper_limit)),
        of(&|p| p.upper_limit).into_iter().fold(0.0, f64::max),
        median(of(&|p| p.probability_of_none)),
        posteriors.iter().filter(|p| p.foreign).count(),
        median(of(&|p| p.misfit)),
    );
}

fn main() -> Fallible<()> {
    let folder: PathBuf = std::env::args().nth(1).ok_or("give the folder of the reference data")?.into();
    let filter = preset::filter("long_pass_488_k2")?.curve();
    let grid = WavelengthGrid::uniform(380.0, 700.0, 5.0)?;
    let mut lamps = BTreeMap::new();
    for name in LAMPS {
        lamps.insert(name, lamp(&folder, name, &filter)?);
    }
    for (site, place) in [("lip", "lip"), ("dorsal_tongue", "tongue")] {
        let records = records(&folder, place, &lamps, &grid)?;
        let noise = |electrons: &[f64]| -> Vec<f64> {
            electrons.iter().map(|e| (e + 190.0 + (0.02 * e).powi(2)) / (0.25 * PIXELS)).collect()
        };
        let mut all = Vec::new();
        for name in LAMPS {
            let family = family(site, &[(name, &lamps[name])], &filter, &grid)?;
            println!("{site} {name}: model error {:.4?}", family.model_error);
            let of_lamp = records.iter().filter(|record| record.lamp == name);
            let posteriors: Vec<SharePosterior> =
                of_lamp.filter_map(|r| family.posterior(&r.electrons, &noise(&r.electrons))).collect();
            report(&format!("{site} {name} nm"), &posteriors);
            if let Some(first) = posteriors.first() {
                println!("  for instance: {}", first.lines().join("\n  "));
            }
            all.extend(posteriors);
        }
        report(&format!("{site}, one lamp"), &all);
        for [a, b] in [["405", "450"], ["415", "450"]] {
            let family = family(site, &[(a, &lamps[a]), (b, &lamps[b])], &filter, &grid)?;
            let mut pairs = Vec::new();
            for first in records.iter().filter(|record| record.lamp == a) {
                let same =
                    |record: &&Record| record.lamp == b && record.person_and_day == first.person_and_day;
                for second in records.iter().filter(same) {
                    let electrons = [first.electrons.as_slice(), second.electrons.as_slice()].concat();
                    pairs.extend(family.posterior(&electrons, &noise(&electrons)));
                }
            }
            report(&format!("{site} {a} and {b} nm"), &pairs);
        }
    }
    Ok(())
}
