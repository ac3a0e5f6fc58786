//! Sites of the catalogue against people: color, brightness under violet light and shapes of fluorescence that were measured,
//! which `data/measured_sites.toml` lists with their sources.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "these are tests")]

use std::collections::BTreeMap;
use std::sync::Arc;

use fluorspar::sampling::random::Key;
use fluorspar::spectral::{Curve, StandardObserver, WavelengthGrid, daylight_d65};
use fluorspar::tissue::{DiscreteOrdinates, EffectiveTissue, Level, Population, Site};
use fluorspar_experiment::preset;
use serde::Deserialize;

#[derive(Deserialize)]
struct Measured {
    color: Vec<Color>,
    pair: Vec<Pair>,
    violet: Violet,
    shape_nm: [f64; 5],
    shape: Vec<Shape>,
}

#[derive(Deserialize)]
struct Place {
    site: String,
    #[serde(default)]
    set: BTreeMap<String, f64>,
}

#[derive(Deserialize)]
struct Color {
    site: String,
    space: String,
    mean: Option<[f64; 3]>,
    sd: Option<[f64; 3]>,
    low: Option<[f64; 3]>,
    high: Option<[f64; 3]>,
    #[serde(default)]
    misses: Vec<usize>,
}

#[derive(Deserialize)]
struct Pair {
    first: Place,
    second: Place,
    signs: [f64; 3],
    difference: Option<[f64; 2]>,
}

#[derive(Deserialize)]
struct Violet {
    brightest: String,
    darkest: String,
    alike: Vec<String>,
    factor: f64,
}

#[derive(Deserialize)]
struct Shape {
    site: String,
    low: [f64; 5],
    high: [f64; 5],
    margin: f64,
}

fn measured() -> Measured {
    toml::from_str(include_str!("../../data/measured_sites.toml")).unwrap()
}

fn solved(Place { site, set }: &Place) -> EffectiveTissue {
    let mut site = preset::site(site).unwrap();
    for (name, value) in set {
        site.set(name, *value).unwrap();
    }
    of_site(&site)
}

/// A site as it looks from above.
pub(crate) fn of_site(site: &Site) -> EffectiveTissue {
    let find = |name: &str| Some(Arc::new(preset::fluorophore(name).ok()?.fluorophore()));
    let nm: Vec<f64> = (0..=74).map(|i| 380.0 + 5.0 * f64::from(i)).collect();
    EffectiveTissue::new(&site.tissue(&find).unwrap(), &nm, DiscreteOrdinates::DIFFUSE).unwrap()
}

fn of_catalogue(site: &str) -> EffectiveTissue {
    solved(&Place { site: site.into(), set: BTreeMap::new() })
}

/// X, Y and Z of a reflectance under D65, and of white.
fn tristimulus(reflectance: &Curve) -> [[f64; 3]; 2] {
    let grid = WavelengthGrid::uniform(380.0, 750.0, 5.0).unwrap();
    let light = daylight_d65().bin_averages(&grid);
    let seen = |reflectance: &dyn Fn(f64) -> f64| {
        let bands = grid.centers_nm().into_iter().zip(&light);
        let radiance: Vec<f32> = bands.map(|(nm, light)| (light * reflectance(nm)) as f32).collect();
        StandardObserver::new(&grid).xyz(&radiance)
    };
    [seen(&|nm| reflectance.at(nm)), seen(&|_| 1.0)]
}

/// CIELAB of a reflectance under D65.
pub(crate) fn lab(reflectance: &Curve) -> [f64; 3] {
    let [xyz, white] = tristimulus(reflectance);
    let root = |c: usize| (xyz[c] / white[c]).cbrt();
    let [x, y, z] = [root(0), root(1), root(2)];
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Color difference.
pub(crate) fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

/// Y in percent, x and y of a reflectance under D65.
fn chromaticity(reflectance: &Curve) -> [f64; 3] {
    let [xyz, white] = tristimulus(reflectance);
    let sum: f64 = xyz.iter().sum();
    [100.0 * xyz[1] / white[1], xyz[0] / sum, xyz[1] / sum]
}

/// Fluorescence under 405 nm as energy per nm, up to a factor common to all.
fn fluorescence(tissue: &EffectiveTissue, nm: f64) -> f64 {
    let parts = tissue.parts().into_iter();
    parts.map(|part| tissue.yield_density(part, nm, 405.0, Level::AboveSurface)).sum::<f64>() / nm
}

/// Fluorescence from 500 to 600 nm under 405 nm, up to a factor common to all.
pub(crate) fn brightness(tissue: &EffectiveTissue) -> f64 {
    (0..=20).map(|i| fluorescence(tissue, 500.0 + 5.0 * f64::from(i))).sum()
}

#[test]
fn sites_have_the_measured_colors() {
    for Color { site, space, mean, sd, low, high, misses } in measured().color {
        let reflectance = of_catalogue(&site).reflectance(Level::AboveSurface);
        let found = if space == "Lab" { lab(&reflectance) } else { chromaticity(&reflectance) };
        let ends = |sign: f64| std::array::from_fn(|i| mean.unwrap()[i] + sign * sd.unwrap()[i]);
        let (low, high): ([f64; 3], [f64; 3]) =
            (low.unwrap_or_else(|| ends(-1.0)), high.unwrap_or_else(|| ends(1.0)));
        println!("{site} {space} {found:.4?} in {low:.4?} to {high:.4?}");
        let outside: Vec<usize> = (0..3).filter(|&i| !(low[i]..=high[i]).contains(&found[i])).collect();
        assert_eq!(outside, misses, "{site}: {found:?}");
    }
}

/// Standard deviations of drawn people lie within a factor of 1.5 of those of measured ones: the colors of gums, the tongue's Y and b of
/// teeth, with a standard error of 9 % here. The tongue's x spreads 1.6 times as far, about a redder mean.
#[test]
fn people_differ_in_color_as_measured() {
    for (site, compared) in [("gingiva", 0..3), ("dorsal_tongue", 0..1), ("canine", 2..3)] {
        let Color { space, sd, .. } = measured().color.into_iter().find(|color| color.site == site).unwrap();
        let population = Population::of_people(&preset::site(site).unwrap());
        let people: Vec<[f64; 3]> = (0..60)
            .map(|person| {
                let drawn = population.draw(&mut Key::new(11).with(person).rng());
                let reflectance = of_site(&drawn).reflectance(Level::AboveSurface);
                if space == "Lab" { lab(&reflectance) } else { chromaticity(&reflectance) }
            })
            .collect();
        for i in 0..3 {
            let mean = people.iter().map(|color| color[i]).sum::<f64>() / 60.0;
            let found = (people.iter().map(|color| (color[i] - mean).powi(2)).sum::<f64>() / 59.0).sqrt();
            let ratio = found / sd.unwrap()[i];
            println!("{site} {space} {i}: {found:.3}, {ratio:.2} of the measured");
            assert!(!compared.contains(&i) || (1.0 / 1.5..1.5).contains(&ratio), "{site} {i}: {ratio}");
        }
    }
}

#[test]
fn places_differ_as_measured() {
    let color = |place: &Place| lab(&solved(place).reflectance(Level::AboveSurface));
    for Pair { first, second, signs, difference } in measured().pair {
        let (a, b) = (color(&first), color(&second));
        println!(
            "{} {:?}: {a:.2?}, {} {b:.2?}, apart {:.2}",
            first.site,
            first.set,
            second.site,
            apart(a, b)
        );
        for i in 0..3 {
            assert!(signs[i] * (a[i] - b[i]) >= 0.0, "{} {:?}: {a:?}, {b:?}", first.site, first.set);
        }
        if let Some([least, most]) = difference {
            assert!((least..=most).contains(&apart(a, b)), "{}: {}", first.site, apart(a, b));
        }
    }
}

#[test]
fn teeth_of_mouths_have_the_colors_of_the_sites() {
    let [incisor, neck] =
        ["tooth_incisor", "tooth_neck"].map(|name| preset::reflectance(name).unwrap().curve());
    let half = Curve::from_fn(350.0, 750.0, |nm| 0.5 * (incisor.at(nm) + neck.at(nm)));
    for (curve, site) in [(incisor, "tooth"), (half, "canine")] {
        let of_site = lab(&of_catalogue(site).reflectance(Level::AboveSurface));
        assert!(apart(lab(&curve), of_site) < 1.0, "{site}: {:?}, {of_site:?}", lab(&curve));
    }
}

#[test]
fn sites_are_as_bright_under_violet_light_as_measured() {
    let Violet { brightest, darkest, alike, factor } = measured().violet;
    let brightness = |site: &String| brightness(&of_catalogue(site));
    let others: Vec<f64> = alike.iter().map(brightness).collect();
    let (least, most) =
        others.iter().fold((f64::MAX, 0.0_f64), |(least, most), b| (least.min(*b), most.max(*b)));
    let (brightest, darkest) = (brightness(&brightest), brightness(&darkest));
    println!("darkest {darkest:.3e}, {alike:?} {others:?}, brightest {brightest:.3e}");
    assert!(most < factor * least && brightest > 1.05 * most && darkest < 0.95 * least, "{others:?}");
}

#[test]
fn fluorescence_has_the_published_shapes() {
    let Measured { shape_nm, shape, .. } = measured();
    for Shape { site, low, high, margin } in shape {
        let tissue = of_catalogue(&site);
        let found = shape_nm.map(|nm| fluorescence(&tissue, nm) / fluorescence(&tissue, 520.0));
        println!("{site} {found:.3?} in {low:?} to {high:?}, {margin}");
        for i in 0..5 {
            // A comparison with NaN, where nothing was published, is false.
            assert!(
                !(found[i] < low[i] - margin || found[i] > high[i] + margin),
                "{site}, {} nm: {}",
                shape_nm[i],
                found[i]
            );
        }
    }
}
