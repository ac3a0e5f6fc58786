//! `fluorspar tissue`.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::{fluorspar, listing};

const LAYERS: &str = "format = 1\ntitle = \"mucosa\"\n\
    [[layer]]\nname = \"epithelium\"\nthickness_mm = 0.1\nrefractive_index = 1.4\nabsorption_per_mm = 0.175\n\
    scattering_per_mm = 5.9\nanisotropy = 0.97\n\
    [layer.emission]\nstrength_per_mm = 0.002\nabsorption_per_mm = 0.067\nscattering_per_mm = 3.6\n\
    [[layer]]\nname = \"stroma\"\nthickness_mm = 1.0\nrefractive_index = 1.4\nabsorption_per_mm = 0.46\n\
    scattering_per_mm = 24.0\nanisotropy = 0.88\n\
    [layer.emission]\nstrength_per_mm = 0.01\nabsorption_per_mm = 0.11\nscattering_per_mm = 18.0\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("mucosa.toml"), LAYERS).unwrap();
    folder
}

fn mc(folder: &Path, more: &[&str]) -> Value {
    let args = ["tissue", "mc", "mucosa.toml", "--json"].iter().chain(more).copied();
    fluorspar(folder, args).json()
}

fn mean(value: &Value) -> f64 {
    value["mean"].as_f64().unwrap()
}

#[test]
fn photons_are_traced_to_tables_and_figures() {
    let folder = folder();
    let args =
        ["tissue", "mc", "mucosa.toml", "--photons", "20000", "--out", "out", "--radial-step-mm", "0.1"];
    let text = fluorspar(folder.path(), args).well().stdout;
    assert!(text.contains("absorbed in stroma") && text.contains("from epithelium"), "{text}");
    let names: Vec<String> = listing(&folder.path().join("out"))
        .into_keys()
        .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    let expected =
        ["depth.csv", "depth.svg", "fluorspar-folder.json", "radius.csv", "radius.svg", "results.json"];
    assert_eq!(names, expected);
    let read = |name: &str| fs::read_to_string(folder.path().join("out").join(name)).unwrap();
    let results: Value = serde_json::from_str(&read("results.json")).unwrap();
    let light = &results["light"];
    let absorbed = light["absorbed_by_layer"].as_array().unwrap().iter();
    let leaving = ["specular_reflectance", "diffuse_reflectance", "transmittance"].map(|name| &light[name]);
    let sum: f64 = absorbed.chain(leaving).map(mean).sum();
    // Russian roulette keeps the weight on average: packets of 1e-4 that grow tenfold or end.
    assert!((sum - 1.0).abs() < 1e-5, "{sum}");

    // The rings hold what leaves: 500 of 0.1 mm.
    let table = read("radius.csv");
    let head = table.lines().next().unwrap();
    assert!(
        head.starts_with("inner_mm,outer_mm,reflected_per_mm2,") && head.contains("fluorescence_per_mm2")
    );
    let reflected: f64 = table
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect::<Vec<f64>>())
        .map(|row| std::f64::consts::PI * (row[1] * row[1] - row[0] * row[0]) * row[2])
        .sum();
    assert!((reflected / mean(&light["diffuse_reflectance"]) - 1.0).abs() < 1e-9, "{reflected}");
    assert!(read("depth.csv").starts_with("layer,upper_mm,lower_mm,fluence,"));
    for (figure, words) in [("radius.svg", "distance from the beam (mm)"), ("depth.svg", "epithelium")] {
        let drawing = read(figure);
        assert!(drawing.contains(words) && !drawing.contains("NaN"), "{figure}");
    }
}

#[test]
fn an_error_ends_the_work_with_the_same_numbers_on_any_threads() {
    let folder = folder();
    let reflectance = ["--error", "0.02", "--error-of", "reflectance", "--diffuse", "--seed", "3"];
    let alone = mc(folder.path(), &[&reflectance[..], &["--threads", "1"]].concat());
    assert_eq!(alone["light"]["ending"], "error");
    let reached = &alone["light"]["diffuse_reflectance"];
    assert!(reached["standard_error"].as_f64().unwrap() <= 0.02 * mean(reached));
    assert_eq!(mc(folder.path(), &[&reflectance[..], &["--threads", "3"]].concat()), alone);

    let fluorescence = mc(folder.path(), &["--error", "0.01"]);
    let by_reciprocity = mc(folder.path(), &["--error", "0.01", "--reciprocity"]);
    let [forward, reciprocal] =
        [&fluorescence["fluorescence"]["upward"], &by_reciprocity["reciprocity"]["upward"]];
    let error = |value: &Value| value["standard_error"].as_f64().unwrap();
    let standard_error = error(forward).hypot(error(reciprocal));
    assert!(error(forward) <= 0.01 * mean(forward));
    assert!((mean(forward) - mean(reciprocal)).abs() < 4.0 * standard_error, "{forward} {reciprocal}");
}

#[test]
fn sites_of_the_catalogue_fluoresce_less_with_more_blood() {
    let folder = folder();
    let site = |more: &[&str]| {
        let start = ["tissue", "mc", "dorsal_tongue", "--wavelength-nm", "405", "--emission-nm", "520"];
        let rest = ["--photons", "10000", "--reciprocity", "--diffuse", "--json"];
        fluorspar(folder.path(), start.iter().chain(&rest).chain(more).copied()).json()
    };
    let [normal, bloody] = [site(&[]), site(&["--state", "hyperaemia"])];
    let upward = |found: &Value| mean(&found["reciprocity"]["upward"]);
    // Ten times the superficial blood: .40 of normal at 520 nm under 405 nm, within .03, here with 3 % of noise.
    let ratio = upward(&bloody) / upward(&normal);
    assert!((ratio - 0.40).abs() < 0.05, "{ratio}");
    let set = ["--set", "superficial_blood_fraction=0.03"];
    assert_eq!(upward(&site(&set)), upward(&bloody));
    let wrong: [(&[&str], &str); 6] = [
        (&["dorsal_tongue"], "give the wavelength of the light, --wavelength-nm 405"),
        (&["dorsal_tounge", "--wavelength-nm", "405"], "dorsal_tongue"),
        (&["lip", "--wavelength-nm", "405", "--state", "ill"], "hyperaemia"),
        (&["lip", "--wavelength-nm", "405", "--set", "blood=1"], "superficial_blood_fraction"),
        (&["lip", "--wavelength-nm", "405", "--emission-nm", "380"], "nothing fluoresces there under 405 nm"),
        (&["mucosa.toml", "--wavelength-nm", "405"], "a file of layers states its optical properties itself"),
    ];
    for (words, message) in wrong {
        let said = fluorspar(folder.path(), ["tissue", "mc"].iter().chain(words).copied());
        assert!(said.code == Some(2) && said.stderr.contains(message), "{message}: {said:#?}");
    }
}

#[test]
fn wrong_input_is_told_with_its_place_and_range() {
    let folder = folder();
    let before = listing(folder.path());
    let wrong: [(&[&str], &str); 9] = [
        (&["--error", "2"], "relative_standard_error is 2, outside 1e-5 to 0.5"),
        (&["--error", "0.1", "--error-of", "strom"], "did you mean \"stroma\"?"),
        (&["--depth-step-mm", "0"], "depth_step_mm is 0, outside 1e-6 to 10000"),
        (&["--depth-step-mm", "0.00001"], "are more than 50000; make the steps wider"),
        (&["--angle-deg", "90"], "--angle-deg 90: must be between 0 and 89 degrees"),
        (&["--photons", "0"], "give a whole number from 1"),
        (
            &["--set", "layer.stroma.emission.strength_per_mm=1"],
            "emission.strength_per_mm = 1: must be between 0 and 0.46",
        ),
        (&["--set", "layer.stroma.anisotropy=1"], "must be between -0.99 and 0.995"),
        (&["--out", "mucosa.toml"], "this is a file"),
    ];
    for (more, message) in wrong {
        let said = fluorspar(folder.path(), ["tissue", "mc", "mucosa.toml"].iter().chain(more).copied());
        assert_eq!(said.code, Some(2), "{said:#?}");
        assert!(said.stderr.contains(message) && said.stdout.is_empty(), "{message}: {said:#?}");
    }
    fs::write(folder.path().join("dark.toml"), LAYERS.split("[layer.emission]").next().unwrap()).unwrap();
    let said = fluorspar(folder.path(), ["tissue", "mc", "dark.toml", "--reciprocity"]);
    assert!(said.code == Some(2) && said.stderr.contains("the layers do not fluoresce"), "{said:#?}");
    fs::remove_file(folder.path().join("dark.toml")).unwrap();
    assert_eq!(listing(folder.path()), before);
}
