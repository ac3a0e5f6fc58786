//! Compares tissues of the catalogue with the reflectance and the fluorescence of people.
//!
//! `cargo run --release -p fluorspar-experiment --example tissue_against_people -- FOLDER`
//!
//! FOLDER holds `tissue/`, `lights/` and `reflectance/` of the reference data, which do not ship. The measured lamps excite the
//! tissue, the Hoya K2 long-pass of the catalogue (often called a 475 nm filter) stands before the instrument, and the lamp light
//! that leaks through it is added as the tissue reflects it. Spectra are compared from 500 to 700 nm every 5 nm, each divided by
//! its value at 520 nm: the median of people, one vote each over the days on which they were seen under all lamps, and the
//! median of all records beside it. Measured light is divided by that of the lamp of the same current on a white target.

#![allow(clippy::print_stdout, reason = "printing is what the example is for")]

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use fluorspar::spectral::{Curve, Fluorophore};
use fluorspar::tissue::{DiscreteOrdinates, EffectiveTissue, Level, Site, TissueState};
use fluorspar_experiment::preset;

type Fallible<T> = Result<T, Box<dyn Error>>;
/// A spectrum at [`wavelengths`].
type Shape = Vec<f64>;

/// Lamps by the number in the names of the records.
const LAMPS: [&str; 3] = ["405", "415", "450"];
/// Day of each person on which all lamps were used.
const DAYS: [(&str, &str); 4] =
    [("S1", "2024-03-14"), ("S2", "2024-03-19"), ("S3", "2024-03-19"), ("S4", "2024-03-12")];
/// Number of 520 nm in [`wavelengths`].
const NORM: usize = 4;
/// Wavelengths of the ratios, nm.
const RATIOS_NM: [f64; 5] = [540.0, 580.0, 600.0, 635.0, 675.0];

/// 500 to 700 nm by 5.
fn wavelengths() -> Vec<f64> {
    (0..=40).map(|i| 500.0 + 5.0 * f64::from(i)).collect()
}

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

/// Values at [`wavelengths`], of the running mean of three samples.
fn smoothed(curve: &Curve) -> Shape {
    let (nm, values) = (curve.wavelengths_nm(), curve.values());
    let mut mean = values.to_vec();
    for i in 1..values.len() - 1 {
        mean[i] = values[i - 1..=i + 1].iter().sum::<f64>() / 3.0;
    }
    let curve = Curve::new(nm.to_vec(), mean).unwrap_or_else(|_| curve.clone());
    wavelengths().iter().map(|&nm| curve.at(nm)).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    if values.len() % 2 == 1 { values[half] } else { 0.5 * (values[half - 1] + values[half]) }
}

/// Median of spectra, wavelength by wavelength.
fn median_shape(shapes: &[Shape]) -> Shape {
    (0..wavelengths().len()).map(|i| median(shapes.iter().map(|shape| shape[i]).collect())).collect()
}

fn normalized(spectrum: &[f64]) -> Shape {
    spectrum.iter().map(|value| value / spectrum[NORM]).collect()
}

fn rms(a: &[f64], b: &[f64], counts: impl Fn(usize) -> bool) -> f64 {
    let squares: Vec<f64> = (0..a.len()).filter(|&i| counts(i)).map(|i| (a[i] - b[i]).powi(2)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// A lamp: energy per 2 nm, together 1, and the light that leaks through the filter off a white target, per unit of the lamp.
#[derive(Default)]
struct Lamp {
    lines: Vec<(f64, f64)>,
    leak: Shape,
    /// Radiance of a white target by current, mA.
    levels: BTreeMap<u32, f64>,
}

fn lamp(name: &str, columns: &BTreeMap<String, Curve>, rows: &[BTreeMap<String, String>]) -> Fallible<Lamp> {
    let of = |condition: &str| -> Vec<(u32, &Curve, &str)> {
        rows.iter()
            .filter(|row| row["condition"] == condition && row["led_nm"] == name)
            .filter_map(|row| {
                Some((row["current_mA"].parse().ok()?, columns.get(&row["column"])?, row["column"].as_str()))
            })
            .collect()
    };
    let excitation: Vec<f64> = (190..=245).map(|i| 2.0 * f64::from(i)).collect();
    let mut levels = BTreeMap::new();
    let mut sum = vec![0.0; excitation.len()];
    for (current, curve, _) in of("experiment") {
        let values: Vec<f64> = excitation.iter().map(|&nm| curve.at(nm).max(0.0)).collect();
        let level = 2.0 * values.iter().sum::<f64>();
        levels.insert(current, level);
        sum.iter_mut().zip(&values).for_each(|(sum, value)| *sum += value / level);
    }
    let total: f64 = sum.iter().sum();
    let lines = excitation
        .iter()
        .zip(&sum)
        .map(|(nm, value)| (*nm, value / total))
        .filter(|(_, v)| *v > 1e-5)
        .collect();
    let strong = |(current, _, column): &(u32, &Curve, &str)| *current > 200 && column.ends_with("_0317");
    let leaks: Vec<Shape> = of("unwanted_reflected_475lpf")
        .into_iter()
        .filter(strong)
        .map(|(current, curve, _)| smoothed(curve).iter().map(|v| v / nearest(&levels, current)).collect())
        .collect();
    let mean = |i: usize| leaks.iter().map(|leak| leak[i]).sum::<f64>() / leaks.len() as f64;
    Ok(Lamp { lines, leak: (0..wavelengths().len()).map(mean).collect(), levels })
}

/// Level of the nearest current.
fn nearest(levels: &BTreeMap<u32, f64>, current: u32) -> f64 {
    levels.iter().min_by_key(|(known, _)| known.abs_diff(current)).map_or(1.0, |(_, level)| *level)
}

/// What was measured at a place of the mouth under a lamp, per unit of the lamp.
struct Measured {
    by_person: BTreeMap<String, Vec<Shape>>,
    all: Vec<Shape>,
}

fn measured(
    site: &str,
    name: &str,
    lamp: &Lamp,
    columns: &BTreeMap<String, Curve>,
    rows: &[BTreeMap<String, String>],
) -> Measured {
    let mut found = Measured { by_person: BTreeMap::new(), all: Vec::new() };
    for row in
        rows.iter().filter(|row| row["site"] == site && row["led_nm"] == name && row["flag"].is_empty())
    {
        let (Some((person, day)), Ok(current), Some(curve)) = (
            DAYS.iter().find(|(person, _)| *person == row["subject"]),
            row["current_mA"].parse(),
            columns.get(&row["column"]),
        ) else {
            continue;
        };
        let spectrum: Shape = smoothed(curve).iter().map(|v| v / nearest(&lamp.levels, current)).collect();
        if *day == row["date"] {
            found.by_person.entry(person.to_string()).or_default().push(spectrum.clone());
        }
        found.all.push(spectrum);
    }
    found
}

impl Measured {
    /// Median shape and level at 520 nm, one vote per person.
    fn votes(&self) -> (Shape, f64) {
        let shapes =
            |records: &Vec<Shape>| median_shape(&records.iter().map(|s| normalized(s)).collect::<Vec<_>>());
        let people: Vec<Shape> = self.by_person.values().map(shapes).collect();
        let levels = self.by_person.values().map(|records| median(records.iter().map(|s| s[NORM]).collect()));
        (median_shape(&people), median(levels.collect()))
    }

    /// Median shape and level of all records.
    fn pooled(&self) -> (Shape, f64) {
        let shapes: Vec<Shape> = self.all.iter().map(|s| normalized(s)).collect();
        (median_shape(&shapes), median(self.all.iter().map(|s| s[NORM]).collect()))
    }

    /// Smallest and largest ratio to 520 nm.
    fn range(&self, i: usize) -> [f64; 2] {
        let ratios = || self.all.iter().map(move |s| s[i] / s[NORM]);
        [ratios().fold(f64::MAX, f64::min), ratios().fold(0.0, f64::max)]
    }
}

fn catalogue(name: &str) -> Option<Arc<Fluorophore>> {
    preset::fluorophore(name).ok().map(|known| Arc::new(known.fluorophore()))
}

fn solved(site: &Site) -> Fallible<EffectiveTissue> {
    let nm: Vec<f64> = (0..=152).map(|i| 370.0 + 2.5 * f64::from(i)).collect();
    Ok(EffectiveTissue::new(&site.tissue(&catalogue)?, &nm, DiscreteOrdinates::DIFFUSE)?)
}

/// What the instrument would see of a tissue, per unit of the lamp.
fn seen(tissue: &EffectiveTissue, lamp: &Lamp, filter: &Curve) -> Fallible<Shape> {
    let eems = tissue
        .parts()
        .into_iter()
        .map(|part| tissue.eem(part, Level::AboveSurface))
        .collect::<Result<Vec<_>, _>>()?;
    let reflectance = tissue.reflectance(Level::AboveSurface);
    let at = |(i, &m): (usize, &f64)| {
        let emitted =
            |&(x, energy): &(f64, f64)| energy * x / m * eems.iter().map(|eem| eem.at(m, x)).sum::<f64>();
        filter.at(m) * lamp.lines.iter().map(emitted).sum::<f64>() + reflectance.at(m) * lamp.leak[i]
    };
    Ok(wavelengths().iter().enumerate().map(at).collect())
}

/// Root mean square of the reflectance from 390 to 740 nm against the mean of some files.
fn reflectance_error(tissue: &EffectiveTissue, folder: &Path, files: &[&str]) -> Fallible<f64> {
    let mut curves = Vec::new();
    for file in files {
        curves.extend(spectra(&folder.join("reflectance").join(file))?.into_values());
    }
    let reflectance = tissue.reflectance(Level::AboveSurface);
    let nm: Vec<f64> = (0..=70).map(|i| 390.0 + 5.0 * f64::from(i)).collect();
    let model: Shape = nm.iter().map(|&nm| reflectance.at(nm)).collect();
    let mean: Shape =
        nm.iter().map(|&nm| curves.iter().map(|c| c.at(nm)).sum::<f64>() / curves.len() as f64).collect();
    Ok(rms(&model, &mean, |_| true))
}

/// One line for a lamp; returns how many ratios lie within the range of people, widened by 0.02.
fn compare(name: &str, site: &str, model: &[f64], level: f64, people: &Measured) -> usize {
    // The leak of the 415 nm lamp has a line of its own at 700 nm.
    let line = |nm: f64| site == "lip" && name == "415" && (692.0..708.0).contains(&nm);
    let counts = |i: usize| !line(wavelengths()[i]);
    let ((votes, vote_level), (pooled, pooled_level)) = (people.votes(), people.pooled());
    let place = |nm: f64| ((nm - 500.0) / 5.0) as usize;
    let inside = |nm: &&f64| {
        let [low, high] = people.range(place(**nm));
        (low - 0.02..=high + 0.02).contains(&model[place(**nm)])
    };
    let count = RATIOS_NM.iter().filter(inside).count();
    println!(
        "  {name} nm: rms {:.3} (all records {:.3}), F520 x {:.2} ({:.2}) of measured, {count} of 5 ratios within people",
        rms(model, &votes, counts),
        rms(model, &pooled, counts),
        level / vote_level,
        level / pooled_level,
    );
    let off: Vec<String> = (0..model.len())
        .filter(|&i| counts(i) && (model[i] - votes[i]).abs() > 0.04)
        .map(|i| format!("{} nm {:+.3}", wavelengths()[i], model[i] - votes[i]))
        .collect();
    if !off.is_empty() {
        println!("      off by more than 0.04: {}", off.join(", "));
    }
    count
}

fn main() -> Fallible<()> {
    let folder: PathBuf = std::env::args().nth(1).ok_or("give the folder of the reference data")?.into();
    let filter = preset::filter("long_pass_488_k2")?.curve();
    let light_columns = spectra(&folder.join("lights/oe_tongue_lip_excitation_lights.csv"))?;
    let light_rows = index(&folder.join("lights/oe_tongue_lip_excitation_lights_index.csv"))?;
    let columns = spectra(&folder.join("tissue/oe_tongue_lip_fluorescence.csv"))?;
    let rows = index(&folder.join("tissue/oe_tongue_lip_fluorescence_index.csv"))?;
    let flagged: Vec<&str> =
        rows.iter().filter(|r| !r["flag"].is_empty()).map(|r| r["column"].as_str()).collect();
    println!("left out because of their flags: {}", flagged.join(", "));
    let lamps = LAMPS.map(|name| lamp(name, &light_columns, &light_rows));
    let lips = ["oe_s2_lip.csv", "oe_s3_lip.csv", "oe_s4_lip.csv"];
    let tongues = ["tongue_mean_350_780.csv"];
    let compared: [(&str, &str, &[&str]); 3] = [
        ("dorsal_tongue", "tongue", &tongues),
        ("dorsal_tongue_b", "tongue", &tongues),
        ("lip", "lip", &lips),
    ];
    for (name, place, files) in compared {
        let site = Site::named(name)?;
        let mut without = site.clone();
        without.set("superficial_lipopigment_per_mm", 0.0)?;
        without.set("deep_lipopigment_per_mm", 0.0)?;
        for (site, what) in [(site, ""), (without, " without the orange emitter, all else unchanged")] {
            let tissue = solved(&site)?;
            println!("{name}{what}: reflectance rms {:.4}", reflectance_error(&tissue, &folder, files)?);
            let mut inside = 0;
            for (lamp_name, lamp) in LAMPS.iter().zip(&lamps) {
                let lamp = lamp.as_ref().map_err(ToString::to_string)?;
                let model = seen(&tissue, lamp, &filter)?;
                let people = measured(place, lamp_name, lamp, &columns, &rows);
                inside += compare(lamp_name, place, &normalized(&model), model[NORM], &people);
            }
            println!("  {inside} of 15 ratios within people");
        }
        for state in TissueState::ALL {
            let (normal, mut changed) = (Site::named(name)?, Site::named(name)?);
            changed.apply(state)?;
            let (normal, changed) = (solved(&normal)?, solved(&changed)?);
            let mut factors = Vec::new();
            for lamp in &lamps {
                let mut dark = Lamp { leak: vec![0.0; wavelengths().len()], ..Lamp::default() };
                dark.lines.clone_from(&lamp.as_ref().map_err(ToString::to_string)?.lines);
                let [a, b] = [seen(&changed, &dark, &filter)?, seen(&normal, &dark, &filter)?];
                factors.push(format!("{:.2}", a[NORM] / b[NORM]));
            }
            println!("  {}: fluorescence at 520 nm x {}", state.name(), factors.join(", "));
        }
    }
    Ok(())
}
