//! The measured spectra: lamps, people, reflectance.

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::Path;

use fluorspar::spectral::Curve;
use fluorspar::tissue::fit::Viewing;
use fluorspar_experiment::preset;

pub(crate) type Fallible<T> = Result<T, Box<dyn Error>>;
/// A spectrum at [`wavelengths`].
pub(crate) type Shape = Vec<f64>;

/// Lamps by the number in the names of the records.
pub(crate) const LAMPS: [&str; 3] = ["405", "415", "450"];
/// People, and the day on which each was seen under all lamps.
pub(crate) const DAYS: [(&str, &str); 4] =
    [("S1", "2024-03-14"), ("S2", "2024-03-19"), ("S3", "2024-03-19"), ("S4", "2024-03-12")];
/// Number of 520 nm in [`wavelengths`].
pub(crate) const NORM: usize = 4;

/// 500 to 700 nm by 5.
pub(crate) fn wavelengths() -> Vec<f64> {
    (0..=40).map(|i| 500.0 + 5.0 * f64::from(i)).collect()
}

/// Whether a wavelength counts: the leak of the 415 nm lamp has a line of its own, which the lip, less fluorescent, reflects.
pub(crate) fn counts(place: &str, lamp: &str, nm: f64) -> bool {
    !(place == "lip" && lamp == "415" && (692.0..708.0).contains(&nm))
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

type Rows = Vec<BTreeMap<String, String>>;

/// Rows of an index, by the names of its columns.
fn index(path: &Path) -> Fallible<Rows> {
    let text = fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().ok_or("an empty file")?.split(',').collect();
    let row =
        |line: &str| names.iter().zip(line.split(',')).map(|(n, v)| (n.to_string(), v.to_string())).collect();
    Ok(lines.map(row).collect())
}

/// Running mean of three samples.
fn smoothed(curve: &Curve) -> Curve {
    let (nm, values) = (curve.wavelengths_nm(), curve.values());
    let mut mean = values.to_vec();
    for i in 1..values.len() - 1 {
        mean[i] = values[i - 1..=i + 1].iter().sum::<f64>() / 3.0;
    }
    Curve::new(nm.to_vec(), mean).unwrap_or_else(|_| curve.clone())
}

fn sampled(curve: &Curve) -> Shape {
    wavelengths().iter().map(|&nm| curve.at(nm)).collect()
}

pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    if values.len() % 2 == 1 { values[half] } else { 0.5 * (values[half - 1] + values[half]) }
}

/// Median of spectra, wavelength by wavelength.
pub(crate) fn median_shape(shapes: &[Shape]) -> Shape {
    (0..wavelengths().len()).map(|i| median(shapes.iter().map(|shape| shape[i]).collect())).collect()
}

/// A spectrum over its value at 520 nm.
pub(crate) fn normalized(spectrum: &[f64]) -> Shape {
    spectrum.iter().map(|value| value / spectrum[NORM]).collect()
}

/// A lamp, as the instrument sees what it excites.
pub(crate) struct Lamp {
    pub(crate) name: &'static str,
    pub(crate) viewing: Viewing,
    /// The same without light that leaks through the filter.
    pub(crate) without_leak: Viewing,
    /// Radiance of a white target by current, mA.
    levels: BTreeMap<u32, f64>,
}

impl Lamp {
    fn new(
        name: &'static str,
        columns: &BTreeMap<String, Curve>,
        rows: &Rows,
        filter: &Curve,
    ) -> Fallible<Self> {
        let of = |condition: &str| -> Vec<(u32, &Curve, &str)> {
            rows.iter()
                .filter(|row| row["condition"] == condition && row["led_nm"] == name)
                .filter_map(|row| {
                    Some((
                        row["current_mA"].parse().ok()?,
                        columns.get(&row["column"])?,
                        row["column"].as_str(),
                    ))
                })
                .collect()
        };
        // Above 500 nm the lamps are noise.
        let nm: Vec<f64> = (190..=245).map(|i| 2.0 * f64::from(i)).collect();
        let mut levels = BTreeMap::new();
        let mut sum = vec![0.0; nm.len()];
        for (current, curve, _) in of("experiment") {
            let values: Vec<f64> = nm.iter().map(|&nm| curve.at(nm).max(0.0)).collect();
            let level = 2.0 * values.iter().sum::<f64>();
            levels.insert(current, level);
            sum.iter_mut().zip(&values).for_each(|(sum, value)| *sum += value / level);
        }
        let without_leak = Viewing::new(&Curve::new(nm, sum)?, filter.clone())?;
        let strong = |(current, _, column): &(u32, &Curve, &str)| *current > 200 && column.ends_with("_0317");
        let leaks: Vec<Shape> = of("unwanted_reflected_475lpf")
            .into_iter()
            .filter(strong)
            .map(|(current, curve, _)| {
                sampled(&smoothed(curve)).iter().map(|v| v / nearest(&levels, current)).collect()
            })
            .collect();
        let mean = |i: usize| leaks.iter().map(|leak| leak[i]).sum::<f64>() / leaks.len() as f64;
        let leak = Curve::new(wavelengths(), (0..wavelengths().len()).map(mean).collect())?;
        Ok(Self { name, viewing: without_leak.clone().with_leak(leak), without_leak, levels })
    }
}

/// Level of the nearest current.
fn nearest(levels: &BTreeMap<u32, f64>, current: u32) -> f64 {
    levels.iter().min_by_key(|(known, _)| known.abs_diff(current)).map_or(1.0, |(_, level)| *level)
}

/// What was measured at a place of the mouth under a lamp, per unit of the lamp.
pub(crate) struct Measured {
    /// On the day with all lamps.
    by_person: BTreeMap<&'static str, Vec<Shape>>,
    /// On all days.
    pub(crate) all: Vec<Shape>,
}

impl Measured {
    /// Median shape and level at 520 nm of some people, one vote each.
    pub(crate) fn votes(&self, whose: impl Fn(&str) -> bool) -> (Shape, f64) {
        let people: Vec<(Shape, f64)> =
            self.by_person.keys().filter(|person| whose(person)).filter_map(|p| self.person(p)).collect();
        let shapes: Vec<Shape> = people.iter().map(|(shape, _)| shape.clone()).collect();
        (median_shape(&shapes), median(people.iter().map(|(_, level)| *level).collect()))
    }

    /// Median shape and level of one person.
    pub(crate) fn person(&self, person: &str) -> Option<(Shape, f64)> {
        let records = self.by_person.get(person)?;
        let shapes: Vec<Shape> = records.iter().map(|s| normalized(s)).collect();
        Some((median_shape(&shapes), median(records.iter().map(|s| s[NORM]).collect())))
    }

    /// Median shape and level of all records.
    pub(crate) fn pooled(&self) -> (Shape, f64) {
        let shapes: Vec<Shape> = self.all.iter().map(|s| normalized(s)).collect();
        (median_shape(&shapes), median(self.all.iter().map(|s| s[NORM]).collect()))
    }

    /// Smallest and largest ratio to 520 nm.
    pub(crate) fn range(&self, i: usize) -> [f64; 2] {
        let ratios = || self.all.iter().map(move |s| s[i] / s[NORM]);
        [ratios().fold(f64::MAX, f64::min), ratios().fold(0.0, f64::max)]
    }
}

/// All that is compared.
pub(crate) struct Reference {
    pub(crate) lamps: Vec<Lamp>,
    columns: BTreeMap<String, Curve>,
    rows: Rows,
    reflectance: std::path::PathBuf,
}

impl Reference {
    pub(crate) fn read(folder: &Path) -> Fallible<Self> {
        let lights = folder.join("lights/oe_tongue_lip_excitation_lights.csv");
        let light_columns = spectra(&lights)?;
        let light_rows = index(&lights.with_file_name("oe_tongue_lip_excitation_lights_index.csv"))?;
        let filter = preset::filter("long_pass_488_k2")?.curve();
        let lamp = |name| Lamp::new(name, &light_columns, &light_rows, &filter);
        Ok(Self {
            lamps: LAMPS.into_iter().map(lamp).collect::<Fallible<_>>()?,
            columns: spectra(&folder.join("tissue/oe_tongue_lip_fluorescence.csv"))?,
            rows: index(&folder.join("tissue/oe_tongue_lip_fluorescence_index.csv"))?,
            reflectance: folder.join("reflectance"),
        })
    }

    /// Columns whose index carries a flag.
    pub(crate) fn flagged(&self) -> Vec<&str> {
        self.rows.iter().filter(|r| !r["flag"].is_empty()).map(|r| r["column"].as_str()).collect()
    }

    pub(crate) fn measured(&self, place: &str, lamp: &Lamp) -> Measured {
        let mut found = Measured { by_person: BTreeMap::new(), all: Vec::new() };
        let wanted = |row: &&BTreeMap<String, String>| {
            row["site"] == place && row["led_nm"] == lamp.name && row["flag"].is_empty()
        };
        for row in self.rows.iter().filter(wanted) {
            let (Some((person, day)), Ok(current), Some(curve)) = (
                DAYS.iter().find(|(person, _)| *person == row["subject"]),
                row["current_mA"].parse(),
                self.columns.get(&row["column"]),
            ) else {
                continue;
            };
            let level = nearest(&lamp.levels, current);
            let spectrum: Shape = sampled(&smoothed(curve)).iter().map(|v| v / level).collect();
            if *day == row["date"] {
                found.by_person.entry(person).or_default().push(spectrum.clone());
            }
            found.all.push(spectrum);
        }
        found
    }

    /// Mean of all columns of some files of reflectance.
    pub(crate) fn mean_reflectance(&self, files: &[String], nm: &[f64]) -> Fallible<Shape> {
        let mut curves = Vec::new();
        for file in files {
            curves.extend(spectra(&self.reflectance.join(file))?.into_values());
        }
        Ok(nm.iter().map(|&nm| curves.iter().map(|c| c.at(nm)).sum::<f64>() / curves.len() as f64).collect())
    }
}
