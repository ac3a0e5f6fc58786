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
    let [normal, bloody] = [site(&[]), site(&["--state", "hyperemia"])];
    let upward = |found: &Value| mean(&found["reciprocity"]["upward"]);
    // Ten times the superficial blood: .40 of normal at 520 nm under 405 nm, within .03, here with 3 % of noise.
    let ratio = upward(&bloody) / upward(&normal);
    assert!((ratio - 0.40).abs() < 0.05, "{ratio}");
    let set = ["--set", "superficial_blood_fraction=0.03"];
    assert_eq!(upward(&site(&set)), upward(&bloody));
    let wrong: [(&[&str], &str); 6] = [
        (&["dorsal_tongue"], "give the wavelength of the light, --excitation-nm 405"),
        (&["dorsal_tounge", "--wavelength-nm", "405"], "dorsal_tongue"),
        (&["lip", "--wavelength-nm", "405", "--state", "ill"], "hyperemia"),
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

#[test]
fn sites_are_listed_and_shown() {
    let folder = folder();
    let list = fluorspar(folder.path(), ["catalog", "list", "tissue", "--json"]).json();
    let names: Vec<&str> =
        list.as_array().unwrap().iter().map(|site| site["name"].as_str().unwrap()).collect();
    assert!(names.contains(&"dorsal_tongue_b") && names.contains(&"tooth"), "{names:?}");
    for name in names {
        let shown = fluorspar(folder.path(), ["catalog", "show", "tissue", name]).well().stdout;
        assert!(shown.contains("1/mm") && shown.contains("assumed"), "{shown}");
    }
    let args = [
        "catalog",
        "show",
        "tissue",
        "lip",
        "--state",
        "hyperemia",
        "--set",
        "oxygen_saturation=0.7",
        "--json",
    ];
    let lip = fluorspar(folder.path(), args).json();
    let parameter = |name: &str| {
        let all = lip["parameters"].as_array().unwrap();
        all.iter().find(|parameter| parameter["name"] == name).unwrap().clone()
    };
    assert_eq!(parameter("oxygen_saturation")["value"], 0.7);
    let blood = parameter("superficial_blood_fraction");
    assert!(
        (blood["value"].as_f64().unwrap() - 0.0613).abs() < 1e-9 && blood["basis"] == "fitted",
        "{blood}"
    );
    assert_eq!(lip["states"].as_array().unwrap().len(), 13);
    let deep = lip["layers"].as_array().unwrap().last().unwrap().clone();
    assert_eq!(deep["fluorophores"][0]["parameter"], "deep_collagen_per_mm");
}

#[test]
fn a_tissue_is_solved_to_tables_and_figures() {
    let folder = folder();
    let args =
        ["tissue", "solve", "lip", "--excitation-nm", "405", "--step-nm", "20", "--out", "out", "--json"];
    let found = fluorspar(folder.path(), args).json();
    let read = |name: &str| fs::read_to_string(folder.path().join("out").join(name)).unwrap();
    let written: Value = serde_json::from_str(&read("results.json")).unwrap();
    assert_eq!(written, found);
    let at = |name: &str, nm: f64| {
        let place = found["wavelength_nm"].as_array().unwrap().iter().position(|v| v.as_f64() == Some(nm));
        found[name][place.unwrap()].as_f64().unwrap()
    };
    // Blood makes lips red, and nothing returns that did not come.
    assert!(at("reflectance", 630.0) > 2.0 * at("reflectance", 550.0));
    assert!(at("reflectance_below_surface", 630.0) > at("reflectance", 630.0));
    let under = &found["fluorescence"][0];
    let shares =
        under["emitters"].as_array().unwrap().iter().map(|emitter| emitter["share"].as_f64().unwrap());
    assert!((shares.sum::<f64>() - 1.0).abs() < 1e-9 && under["exitance"].as_f64().unwrap() < 0.1);
    let change = found["own_absorption"]["change_of_reflectance"].as_f64().unwrap();
    assert!((-0.3..0.0).contains(&change), "{change}");
    assert!(read("spectra.csv").starts_with("wavelength_nm,reflectance,"));
    assert!(
        read("fluorescence.csv").lines().next().unwrap().contains("405 nm_collagen_in_deep stroma_per_nm")
    );
    assert!(read("eem.csv").starts_with("# unit: photons\nem_nm\\ex_nm,350,370"));
    for name in ["reflectance", "fluorescence_405_nm", "eem"] {
        assert!(!read(&format!("{name}.svg")).contains("NaN"), "{name}");
        assert!(fs::metadata(folder.path().join(format!("out/{name}.png"))).unwrap().len() > 1000);
    }
}

#[test]
fn red_light_comes_from_deeper_than_green() {
    let folder = folder();
    let args = [
        "tissue",
        "depth",
        "dorsal_tongue",
        "--excitation-nm",
        "405",
        "--emission-nm",
        "520",
        "--emission-nm",
    ];
    let set = [
        "690",
        "--set",
        "biofilm_chlorophyll_per_mm=0",
        "--set",
        "biofilm_porphyrin_per_mm=0",
        "--json",
        "--out",
        "d.svg",
    ];
    let found = fluorspar(folder.path(), args.iter().chain(&set).copied()).json();
    let [green, red] = [0, 1].map(|channel| found[channel]["depth_50_um"].as_f64().unwrap());
    assert!(red > green && green > 100.0, "{green} {red}");
    let shares = found[0]["layers"].as_array().unwrap().iter().map(|layer| layer[1].as_f64().unwrap());
    assert!((shares.sum::<f64>() - 1.0).abs() < 1e-9);
    assert!(fs::read_to_string(folder.path().join("d.svg")).unwrap().contains("superficial stroma"));
    let text = fluorspar(folder.path(), ["tissue", "depth", "lip"]).well().stdout;
    assert!(text.contains("under led_405") && text.contains("deep stroma"), "{text}");
}

/// A lip with more blood is solved, its spectra are fitted, and the file that the fit writes is solved again.
#[test]
fn a_fit_comes_back_as_a_tissue_for_experiments() {
    let folder = folder();
    let run = |args: &str| fluorspar(folder.path(), args.split(' ')).well();
    run(
        "tissue solve lip --set deep_blood_fraction=0.16 --light led_405 --from-nm 380 --step-nm 10 -q --out truth",
    );
    let columns = |file: &str, name: &str| {
        let text = fs::read_to_string(folder.path().join("truth").join(file)).unwrap();
        let at = text.lines().next().unwrap().split(',').position(|head| head == name).unwrap();
        let rows = text.lines().map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            format!("{},{}\n", cells[0], cells[at])
        });
        fs::write(folder.path().join(format!("{name}.csv")), rows.collect::<String>()).unwrap();
    };
    columns("spectra.csv", "reflectance");
    columns("fluorescence.csv", "led_405_per_nm");
    let fit = "tissue fit lip --reflectance reflectance.csv --fluorescence led_405_per_nm.csv --light led_405 --from-nm 500 \
               --to-nm 700 --step-nm 10 --free deep_blood_fraction --free oxygen_saturation --out fit";
    let text = run(fit).stdout;
    assert!(text.contains("deep_blood_fraction") && text.contains("relative rms"), "{text}");
    let results: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("fit/results.json")).unwrap()).unwrap();
    let blood = &results["fitted"][0];
    let interval = [0, 1].map(|end| blood["interval_95"][end].as_f64().unwrap());
    assert!(interval[0] < 0.16 && 0.16 < interval[1] && interval[1] < 2.0 * interval[0], "{blood}");
    for spectrum in results["spectra"].as_array().unwrap() {
        assert!(spectrum["relative_rms"].as_f64().unwrap() < 0.02, "{}", spectrum["name"]);
    }
    let section = fs::read_to_string(folder.path().join("fit/tissue.toml")).unwrap();
    assert!(section.contains("[[tissue]]") && section.contains("with 95 %"), "{section}");
    let again = fluorspar(folder.path(), ["catalog", "show", "tissue", "fit/tissue.toml", "--json"]).json();
    let parameters = again["parameters"].as_array().unwrap();
    let value =
        parameters.iter().find(|p| p["name"] == "deep_blood_fraction").unwrap()["value"].as_f64().unwrap();
    assert!((value / results["parameters"]["deep_blood_fraction"].as_f64().unwrap() - 1.0).abs() < 1e-5);
    let experiment = format!(
        "{section}\n[render]\nwidth_px = 4\n[[material]]\nname = \"m\"\ntype = \"tissue\"\ntissue = \"fitted\"\n"
    )
    .replace("format = 1", "format = 1\nbase = \"flat-patch\"");
    fs::write(folder.path().join("me.toml"), experiment).unwrap();
    fluorspar(folder.path(), ["check", "me.toml"]).well();
}

const PHANTOM: &str = "format = 1\n[[tissue]]\nname = \"phantom\"\n[[tissue.layer]]\nname = \"skin\"\nthickness_um = 300.0\n\
    scattering = { anisotropy = 0.9, scattering_per_mm = 20.0, power = 1.2 }\nabsorption = { background = { absorption_per_mm = 0.05 } }\n\
    fluorophores = { keratin = { strength_per_mm = 0.002 } }\n[[tissue.layer]]\nname = \"flesh\"\nthickness_um = 10000.0\n\
    scattering = { anisotropy = 0.9, reduced_per_mm = 1.5 }\nabsorption = { blood = { volume_fraction = 0.05 } }\n";

/// Layers of a file go through every command; the photons of Monte Carlo agree with the deterministic solver.
#[test]
fn layers_of_a_file_are_shown_solved_and_traced() {
    let folder = folder();
    fs::write(folder.path().join("phantom.toml"), PHANTOM).unwrap();
    let run = |words: &str| fluorspar(folder.path(), words.split(' '));
    let shown = run("catalog show tissue phantom.toml").well().stdout;
    assert!(shown.contains("skin") && shown.contains("keratin 0.002000 at 405 nm"), "{shown}");
    assert_eq!(run("catalog show tissue phantom.toml --json").json()["layers"][1]["thickness_um"], 10000.0);
    let solved =
        run("tissue solve phantom.toml --from-nm 400 --to-nm 640 --step-nm 20 --excitation-nm 405 --json")
            .json();
    let reflectance = solved["reflectance"][6].as_f64().unwrap();
    // What lies below is told as it was computed
    assert_eq!(solved["below"], "black: nothing returns from below the last layer");
    let on_air = PHANTOM.replace("\"phantom\"\n", "\"phantom\"\nindex_below = 1.0\n");
    fs::write(folder.path().join("air.toml"), on_air).unwrap();
    let on_air =
        run("tissue solve air.toml --from-nm 400 --to-nm 440 --step-nm 20 --excitation-nm 405").well().stdout;
    assert!(on_air.contains("below it a medium of index 1: its surface reflects"), "{on_air}");
    assert!(run("tissue depth phantom.toml --light led_405").well().stdout.contains("skin"));
    let traced = run("tissue mc phantom.toml --wavelength-nm 520 --diffuse --photons 40000 --json").json();
    let light = &traced["light"]["diffuse_reflectance"];
    let error = light["standard_error"].as_f64().unwrap();
    assert!((mean(light) - reflectance).abs() < 4.0 * error + 5e-4, "{light}, {reflectance}");
    for (words, message) in [
        ("tissue fit phantom.toml --reflectance none.csv", "described by its layers"),
        ("catalog show tissue phantom.toml --state inflammation", "describes its layers itself"),
        ("tissue solve phantom.toml --set oxygen_saturation=0.7", "describes its layers itself"),
        ("tissue mc phantom.toml", "give the wavelength"),
    ] {
        let said = run(words);
        assert!(said.code == Some(2) && said.stderr.contains(message), "{words}: {said:#?}");
    }
}

#[test]
fn sites_of_the_user_are_named_by_file_and_by_catalogue() {
    let folder = tempfile::tempdir().unwrap();
    let sites = folder.path().join("mine/sites");
    fs::create_dir_all(&sites).unwrap();
    let lip = include_str!("../../../fluorspar-experiment/data/sites/lip.toml");
    let mine = lip
        .replace("name = \"lip\"", "name = \"my_lip\"")
        .replace("parameters.oxygen_saturation = 0.868", "parameters.oxygen_saturation = 0.7");
    assert_ne!(mine, lip);
    fs::write(folder.path().join("lip_of_file.toml"), &mine).unwrap();
    let section = "format = 1\n[[tissue]]\nname = \"of section\"\nsite = \"lip_of_file.toml\"\n";
    fs::write(folder.path().join("section.toml"), section).unwrap();
    let run = |words: &str| fluorspar(folder.path(), words.split(' '));
    let layers = |words: &str| run(words).json()["layers"].clone();
    let expected = layers("catalog show tissue lip --set oxygen_saturation=0.7 --json");
    assert_eq!(layers("catalog show tissue lip_of_file.toml --json"), expected);
    assert_eq!(layers("catalog show tissue section.toml --json"), expected);
    let said = run("tissue fit lip_of_file.toml --reflectance none.csv --out fitted");
    assert!(said.code == Some(2) && said.stderr.contains("is none; put its file into"), "{said:#?}");

    // Beside the catalogue
    fs::write(sites.join("my_lip.toml"), &mine).unwrap();
    let with_catalogue = |words: &str| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_fluorspar"))
            .args(words.split(' '))
            .current_dir(folder.path())
            .env("FLUORSPAR_CATALOGUE", "mine")
            .output()
            .unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code(), text(output.stdout), text(output.stderr))
    };
    assert!(with_catalogue("catalog list tissue").1.contains("my_lip"));
    let shown = with_catalogue("catalog show tissue my_lip --json").1;
    assert_eq!(serde_json::from_str::<Value>(&shown).unwrap()["layers"], expected);

    // The digest of an experiment holds the site and its state
    let states = folder.path().join("mine/states");
    fs::create_dir_all(&states).unwrap();
    let patch = "format = 1\nbase = \"flat-patch\"\n[[tissue]]\nname = \"mine\"\nsite = \"my_lip\"\nstates = [\"my_state\"]\n\
        [[material]]\nname = \"patch\"\ntype = \"tissue\"\ntissue = \"mine\"\n";
    fs::write(folder.path().join("patch.toml"), patch).unwrap();
    let digest = |site: &str, factor: f64| {
        fs::write(sites.join("my_lip.toml"), site).unwrap();
        let state = format!(
            "name = \"my_state\"\ntitle = \"M\"\ndescription = \"m\"\nsource = \"m\"\n[factors]\ndeep_blood_fraction = {factor}\n"
        );
        fs::write(states.join("my_state.toml"), state).unwrap();
        let (code, checked, said) = with_catalogue("check patch.toml --json");
        assert_eq!(code, Some(0), "{said}");
        serde_json::from_str::<Value>(&checked).unwrap()["sha256"].to_string()
    };
    let of_two = digest(&mine, 2.0);
    assert_eq!(of_two, digest(&mine, 2.0));
    assert_ne!(of_two, digest(&mine, 3.0));
    assert_ne!(of_two, digest(&mine.replace("= 0.7\n", "= 0.71\n"), 2.0));
    let shown = with_catalogue("catalog show state my_state").1;
    assert!(shown.contains("deep_blood_fraction x 2\n"), "{shown}");

    // Wrong files
    for (wrong, words) in [
        (mine.replace("= 0.7\n", "= 70.0\n"), "oxygen_saturation is 70, outside 0 to 1"),
        (mine.replace("oxygen_sat", "oxigen_sat"), "did you mean \"oxygen_saturation\"?"),
        (mine.replace("parameters.oxygen_saturation = 0.7\n", ""), "lacks values of oxygen_saturation; give"),
    ] {
        fs::write(sites.join("my_lip.toml"), &wrong).unwrap();
        fs::write(folder.path().join("lip_of_file.toml"), &wrong).unwrap();
        let (code, _, said) = with_catalogue("catalog list tissue");
        assert!(
            code == Some(2) && said.contains("my_lip.toml: tissue 'my_lip'") && said.contains(words),
            "{said}"
        );
        let said = run("catalog show tissue section.toml");
        let places =
            ["section.toml:4: tissue[0] \"of section\": site = ", "lip_of_file.toml\": tissue 'my_lip'"];
        assert!(said.code == Some(2) && said.stderr.contains(words), "{said:#?}");
        assert!(places.iter().all(|place| said.stderr.contains(place)), "{said:#?}");
    }
}

#[test]
fn wrong_words_of_tissue_commands_are_told() {
    let folder = folder();
    fs::write(folder.path().join("percent.csv"), "wavelength_nm,r\n400,12\n500,14\n600,300\n").unwrap();
    let before = listing(folder.path());
    let wrong = [
        ("catalog show tissue tongue", "there is no tissue \"tongue\"; did you mean"),
        ("catalog show tissue lip --set oxygen_saturation", "write NAME=VALUE"),
        ("catalog show tissue mucosa.toml", "mucosa.toml"),
        ("tissue solve tooth --state carcinoma", "the state 'carcinoma' is one of mucosa"),
        ("catalog show state cancer", "there is no state of tissue \"cancer\""),
        ("tissue solve lip --from-nm 200", "--from-nm 200: must be between 350 and 800 nm"),
        ("tissue sweep lip blood=0..1", "no parameter 'blood'"),
        ("tissue sweep lip oxygen_saturation=0..2", "oxygen_saturation is 2, outside 0 to 1"),
        ("tissue sweep lip oxygen_saturation=0.5", "\"oxygen_saturation=0.5\": write PARAMETER=FROM..TO"),
        (
            "tissue solve lip --from-nm 500 --to-nm 510",
            "--to-nm 510: must be 20 nm or more above --from-nm 500",
        ),
        ("tissue solve lip --light led_404", "did you mean"),
        ("tissue solve lip --nodes 4", "give a whole number from 8 to 128"),
        ("tissue solve lip --out mucosa.toml", "this is a file"),
        ("tissue depth lip --qe nikon", "nikon"),
        ("tissue depth lip --emission-nm 5", "must be between 355 and 745 nm"),
        ("tissue depth lip --out depth.pdf", ".svg or .png"),
        ("tissue fit lip", "give --reflectance CSV"),
        ("tissue fit lip --fluorescence percent.csv", "give one light for each spectrum"),
        ("tissue fit lip --reflectance percent.csv", "more than 1"),
        ("tissue fit lip --reflectance percent.csv --free blood", "this does not vary in lip"),
        ("tissue fit lip --reflectance none.csv", "none.csv"),
    ];
    for (words, message) in wrong {
        let said = fluorspar(folder.path(), words.split(' '));
        assert!(
            said.code == Some(2) && said.stderr.contains(message) && said.stdout.is_empty(),
            "{words}: {said:#?}"
        );
    }
    assert_eq!(listing(folder.path()), before);
}
