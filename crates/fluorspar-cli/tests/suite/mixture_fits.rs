//! `fluorspar fluorophore fit`: spectra of known samples come back as what they were made of.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use fluorspar::analysis::{BloodBefore, MixtureComponent, SpectralMixture};
use fluorspar::spectral::{Curve, oxyhemoglobin_extinction};
use fluorspar_experiment::preset;
use serde_json::Value;

use crate::support::{fluorspar, listing};

const LIGHT: [&str; 4] = ["--light", "led_405", "--light-filter", "short_pass_450"];

/// A table of spectra at 500 to 700 nm by 4 nm.
fn write_table(path: &Path, spectra: &[(&str, &dyn Fn(f64) -> f64)]) {
    let names: Vec<&str> = spectra.iter().map(|(name, _)| *name).collect();
    let mut text = format!("wavelength_nm,{}\n", names.join(","));
    for nm in (500..=700).step_by(4) {
        let values: Vec<String> = spectra.iter().map(|(_, f)| f(f64::from(nm)).to_string()).collect();
        text += &format!("{nm},{}\n", values.join(","));
    }
    fs::write(path, text).unwrap();
}

/// Radiance of a flat sample, W/(sr m² nm), as `predict` has it, on bins of 1 nm.
fn predicted(folder: &Path, concentrations: &[&str]) -> Curve {
    let mut args = vec!["predict", "--json", "--step-nm", "1", "--irradiance", "10", "--reflectance", "0"];
    args.extend(LIGHT);
    args.extend(concentrations.iter().flat_map(|concentration| ["--concentration", concentration]));
    let said = fluorspar(folder, args).json();
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    Curve::new(numbers(&said["wavelength_nm"]), numbers(&said["radiance"]["total"])).unwrap()
}

/// A little noise that goes together with nothing: a sine of about two samples' length.
fn ripple(nm: f64) -> f64 {
    (0.7 * nm).sin()
}

fn weight<'a>(said: &'a Value, spectrum: usize, name: &str) -> &'a Value {
    let weights = said["spectra"][spectrum]["fit"]["weights"].as_array().unwrap();
    weights.iter().find(|weight| weight["name"] == name).unwrap()
}

/// What the flat sample holds else.
const NONE: [&str; 5] = ["fad=0", "elastin=0", "collagen=0", "keratin=0", "protoporphyrin_ix=0"];

#[test]
fn known_samples_come_back_with_tables_and_figures() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mixture = predicted(folder, &[&NONE[..], &["fad=2", "protoporphyrin_ix=0.1"]].concat());
    let alone = predicted(folder, &[&NONE[..], &["fad=1"]].concat());
    let size = 0.01 * mixture.max();
    write_table(
        &folder.join("dyes.csv"),
        &[
            ("both", &|nm| mixture.at(nm) + size * ripple(nm)),
            ("alone, really", &|nm| alone.at(nm) + size * ripple(nm)),
        ],
    );
    // A comma in a name would open a column.
    let text = fs::read_to_string(folder.join("dyes.csv")).unwrap().replace("alone, really", "alone");
    fs::write(folder.join("dyes.csv"), text).unwrap();
    let mut args = vec!["fluorophore", "fit", "dyes.csv", "--fluorophore", "fad,protoporphyrin_ix,elastin"];
    args.extend(LIGHT);
    args.extend(["--irradiance", "10"]);
    let json = [&args[..], &["--json", "--out", "fit"]].concat();
    let said = fluorspar(folder, json).json();
    // Bins of 1 nm against samples: 1e-4 of the light; the ripple of 1 % moves a weight by its standard error at most a few times.
    for (spectrum, name, truth) in
        [(0, "fad", 2.0), (0, "protoporphyrin_ix", 0.1), (1, "fad", 1.0), (1, "protoporphyrin_ix", 0.0)]
    {
        let weight = weight(&said, spectrum, name);
        let [low, high] = [0, 1].map(|end| weight["interval"][end].as_f64().unwrap());
        let slack = 1e-3 * truth;
        assert!(low - slack <= truth && truth <= high + slack, "{name}: {weight}");
        assert!(high - low < 0.5, "{weight}");
    }
    assert_eq!(weight(&said, 1, "protoporphyrin_ix")["interval"][0], 0.0);
    let sets = &said["spectra"][0]["sets"];
    assert_eq!(sets["supported"][0]["components"], serde_json::json!(["fad", "protoporphyrin_ix"]));
    assert_eq!(sets["components"][1]["supported_sets"], sets["supported"].as_array().unwrap().len());
    let files: Vec<String> =
        listing(&folder.join("fit")).into_keys().map(|p| p.display().to_string()).collect();
    for name in
        ["fit.csv", "sets.csv", "results.json", "fit_01.svg", "fit_01.png", "fit_02.svg", "fit_02.png"]
    {
        assert!(files.iter().any(|file| file.ends_with(name)), "{name}: {files:?}");
    }
    let written: Value =
        serde_json::from_str(&fs::read_to_string(folder.join("fit/results.json")).unwrap()).unwrap();
    assert_eq!(written, said);
    let table = fs::read_to_string(folder.join("fit/fit.csv")).unwrap();
    assert!(
        table.starts_with("spectrum,wavelength_nm,measured,model,residual,fad,protoporphyrin_ix,elastin\n")
    );
    assert_eq!(table.lines().count(), 1 + 2 * 51);
    let text = fluorspar(folder, args).well().stdout;
    assert!(
        text.contains("in every supported set: ") && text.contains("the unit of the catalogue"),
        "{text}"
    );
    // What the program did not write stays.
    fs::create_dir(folder.join("mine")).unwrap();
    fs::write(folder.join("mine/notes.txt"), "mine").unwrap();
    let mut args =
        vec!["fluorophore", "fit", "dyes.csv", "--fluorophore", "fad", "--relative", "--out", "mine"];
    args.extend(LIGHT);
    assert_eq!(fluorspar(folder, args).code, Some(2));
    assert_eq!(fs::read_to_string(folder.join("mine/notes.txt")).unwrap(), "mine");
}

/// The command says what the library says, to the last bit; relative spectra have weights of the same ratios.
#[test]
fn the_command_has_the_values_of_the_library() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let band = |center: f64, width: f64| move |nm: f64| (-0.5 * ((nm - center) / width).powi(2)).exp();
    let (low, high) = (band(540.0, 30.0), band(635.0, 12.0));
    write_table(&folder.join("parts.csv"), &[("low", &low), ("high", &high)]);
    let covered = |nm: f64| 10f64.powf(-8.0 * oxyhemoglobin_extinction(nm));
    write_table(
        &folder.join("measured.csv"),
        &[("sum", &|nm| 2.0 * low(nm) * covered(nm) + 0.3 * high(nm) + 0.01 * ripple(nm))],
    );
    let args =
        ["fluorophore", "fit", "measured.csv", "--component", "parts.csv", "--below-blood", "low", "--json"];
    let said = fluorspar(folder, args).json();
    let nm: Vec<f64> = (500..=700).step_by(4).map(f64::from).collect();
    // A curve interpolates, which rounds at its own samples, too.
    let of = |name: &str, f: &dyn Fn(f64) -> f64| {
        let curve = Curve::new(nm.clone(), nm.iter().map(|nm| f(*nm)).collect()).unwrap();
        MixtureComponent { name: name.into(), values: nm.iter().map(|nm| curve.at(*nm)).collect() }
    };
    let blood = BloodBefore::Layer {
        extinction: nm.iter().map(|nm| oxyhemoglobin_extinction(*nm)).collect(),
        below: vec![0],
        largest: 40.0,
    };
    let mixture = SpectralMixture::new(nm.clone(), vec![of("low", &low), of("high", &high)], blood).unwrap();
    let measured: Vec<f64> =
        nm.iter().map(|&nm| 2.0 * low(nm) * covered(nm) + 0.3 * high(nm) + 0.01 * ripple(nm)).collect();
    let fit = mixture.fit(&measured, None).unwrap();
    let sets = mixture.sets(&measured, None, &fit, 4.0).unwrap();
    // The same text, read the same way.
    let read = |text: String| serde_json::from_str::<Value>(&text).unwrap();
    assert_eq!(said["spectra"][0]["fit"], read(serde_json::to_string(&fit).unwrap()));
    assert_eq!(said["spectra"][0]["sets"], read(serde_json::to_string(&sets).unwrap()));
    let [from, to] = fit.blood.unwrap().interval;
    assert!(from < 8.0 && 8.0 < to && to - from < 4.0, "{from} {to}");
    let common = fluorspar(folder, args.into_iter().chain(["--common-blood"])).json();
    let density = common["common_blood"].as_f64().unwrap();
    assert!((density / fit.blood.unwrap().amount - 1.0).abs() < 1e-5, "{density}");
    assert!(common["spectra"][0]["fit"]["blood"].is_null());
}

/// A site's own fluorescence, as `tissue solve` computes it, is found again in its layers.
#[test]
fn fluorescence_of_a_tissue_comes_back_in_its_layers() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let args = ["tissue", "solve", "lip", "--light", "led_405", "--step-nm", "4", "--json"];
    let solved = fluorspar(folder, args).json();
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    let exitance = numbers(&solved["fluorescence"][0]["exitance_per_nm"]);
    let exitance = Curve::new(numbers(&solved["wavelength_nm"]), exitance).unwrap();
    // Per unit of the light: radiance under 10 W/m² is 10 / pi of it.
    write_table(
        &folder.join("lip.csv"),
        &[("lip", &|nm| exitance.at(nm) * 10.0 / std::f64::consts::PI * (1.0 + 1e-3 * ripple(nm)))],
    );
    let args = "fluorophore fit lip.csv --tissue lip --light led_405 --irradiance 10 --no-sets --json";
    let said = fluorspar(folder, args.split(' ')).json();
    let blood = &said["spectra"][0]["fit"]["blood"];
    let [from, to] = [0, 1].map(|end| blood["interval"][end].as_f64().unwrap());
    let truth = fluorspar(folder, ["catalog", "show", "tissue", "lip", "--json"]).json();
    let parameters = truth["parameters"].as_array().unwrap();
    let truth = parameters.iter().find(|p| p["name"] == "superficial_blood_fraction").unwrap();
    let truth = truth["value"].as_f64().unwrap();
    assert!(from <= truth && truth <= to, "{blood} {truth}");
    // Solved at other steps, 5 instead of 4 nm, which moves the light by some 1e-3.
    let relative_rms = said["spectra"][0]["fit"]["relative_rms"].as_f64().unwrap();
    assert!(relative_rms < 5e-3, "{relative_rms}");
    let weights = said["spectra"][0]["fit"]["weights"].as_array().unwrap();
    let share: f64 = weights.iter().map(|weight| weight["share"].as_f64().unwrap()).sum();
    assert!((share - 1.0).abs() < 1e-9);
    assert!(preset::fluorophore(weights[0]["name"].as_str().unwrap()).is_ok());
}

#[test]
fn wrong_input_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_table(&folder.join("m.csv"), &[("a", &|nm| 2.0 * nm), ("dark", &|_| 0.0)]);
    write_table(&folder.join("parts.csv"), &[("flat", &|_| 1.0), ("none", &|_| 0.0)]);
    write_table(&folder.join("errors.csv"), &[("a", &|_| 0.0), ("dark", &|_| 1.0)]);
    fs::write(folder.join("short.csv"), "wavelength_nm,a\n500,1\n510,2\n520,1\n").unwrap();
    let fad = "--light led_405 --fluorophore fad";
    for (args, message) in [
        ("m.csv".to_string(), "there is nothing to fit with; give --fluorophore"),
        (
            "m.csv --fluorophore fad".into(),
            "give the light that excites the fluorophores, for instance --light led_405",
        ),
        (
            format!("m.csv {fad}"),
            "give --irradiance, W/m² on the sample, for spectra in W/(sr m² nm), or --relative",
        ),
        (format!("m.csv {fad} --relative --irradiance 1"), "cannot be used with"),
        (format!("m.csv {fad} --irradiance 0"), "--irradiance 0: must be between 1e-9 and 1e9 W/m²"),
        (format!("m.csv {fad} --relative --column b"), "m.csv"),
        (format!("m.csv {fad} --relative --column dark"), "column \"dark\": the spectrum is zero throughout"),
        (format!("m.csv {fad} --relative --from-nm 701"), "column \"a\": 0 samples between 701 and 800 nm"),
        (format!("m.csv {fad} --relative --common-blood"), "--common-blood: there is no blood"),
        (
            format!("m.csv {fad} --relative --below-blood fda"),
            "--below-blood fda: no component has this name; did you mean \"fad\"?",
        ),
        (format!("m.csv {fad},fad --relative"), "two components are named \"fad\""),
        (
            format!("m.csv {fad} --relative --light-filter errors.csv"),
            "nothing of the light passes its filters",
        ),
        (format!("m.csv {fad},flavin --relative"), "there is no fluorophore \"flavin\""),
        (format!("short.csv {fad} --relative"), "3 samples can't fix 1 weights"),
        (
            "m.csv --component parts.csv".into(),
            "none sends no light at these wavelengths; leave it out (500 to 700 nm",
        ),
        ("m.csv --component missing.csv".into(), "missing.csv"),
        (
            format!("m.csv {fad} --relative --standard-errors errors.csv"),
            "standard errors must be above zero",
        ),
        (
            format!("m.csv {fad} --relative --standard-errors short.csv"),
            "short.csv: column \"a\" has no value at 504 nm",
        ),
        ("m.csv --tissue lips --light led_405 --relative".into(), "there is no tissue \"lips\""),
        (
            "m.csv --tissue lip --light led_405 --relative --fluorophore egfp".into(),
            "--fluorophore egfp: lip does not hold it",
        ),
        ("m.csv --tissue tooth --light led_405 --relative".into(), "superficial_blood_fraction"),
        (format!("m.csv {fad} --relative --within -1"), "--within -1: must be between 0 and 1000"),
    ] {
        let said = fluorspar(folder, ["fluorophore", "fit"].into_iter().chain(args.split(' ')));
        assert_eq!(said.code, Some(2), "{args}: {said:?}");
        assert!(said.stderr.contains(message), "{args}: {}", said.stderr);
        assert!(said.stdout.is_empty(), "{args}");
    }
    let many: Vec<String> = (0..13).map(|i| format!("c{i}")).collect();
    let mut text = format!("wavelength_nm,{}\n", many.join(","));
    for nm in (500..=700).step_by(4) {
        let values: Vec<String> =
            (0..13).map(|i| (-(f64::from(nm - 500 - 15 * i) / 20.0).powi(2)).exp().to_string()).collect();
        text += &format!("{nm},{}\n", values.join(","));
    }
    fs::write(folder.join("many.csv"), text).unwrap();
    let args = "fluorophore fit m.csv --column a --component many.csv";
    let said = fluorspar(folder, args.split(' '));
    assert_eq!(said.code, Some(2), "{said:?}");
    assert!(
        said.stderr.contains(
            "13 components make 8192 sets, more than are compared; give 12 components at most, or --no-sets"
        ),
        "{}",
        said.stderr
    );
    fluorspar(folder, args.split(' ').chain(["--no-sets"])).well();
}
