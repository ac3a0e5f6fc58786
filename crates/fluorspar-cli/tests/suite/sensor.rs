//! `fluorspar sensor`: what it measures, what it writes, what it refuses.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;

use crate::support::{fluorspar, keeps_format, listing};

const SHEET: &str = "format = 1\ntitle = \"Test\"\n[sensor]\ncolumns = 128\nrows = 96\nmosaic = \"mono\"\n\
    quantum_efficiency = { mono = 0.6 }\n[sensor.emva1288]\ngain_e_per_dn = 2.7\ndark_noise_e = 2.3\n\
    saturation_capacity_e = 10300\nbit_depth = 12\ndsnu_e = 0.9\nprnu_percent = 0.5\ndark_current_e_per_s = 5\n";

#[test]
fn a_sheet_is_measured_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("sheet.toml"), SHEET).unwrap();
    let args = [
        "sensor",
        "characterize",
        "sheet.toml",
        "--levels",
        "20",
        "--stack",
        "8",
        "--format",
        "both",
        "--json",
    ];
    let results = fluorspar(folder.path(), args).json();
    keeps_format("sensor-results", &results);
    let close = |key: &str, set: f64, relative: f64| {
        let found = results[key].as_f64().unwrap();
        assert!((found / set - 1.0).abs() < relative, "{key}: {found}, set {set}");
    };
    // 12 288 pixels: a variance has a standard error of 1.3 %, the gain of about 15 levels of 0.4 %; five of them.
    close("gain_e_per_dn", 2.7, 0.02);
    close("dark_noise_e", 2.3, 0.035);
    close("saturation_capacity_e", 10_300.0, 0.03);
    assert_eq!(results["channels"][0]["quantum_efficiency_percent"], 60.0);
    let out = folder.path().join("fluorspar-out/sheet-emva1288");
    let names: Vec<String> =
        listing(&out).keys().map(|path| path.file_name().unwrap().to_string_lossy().into_owned()).collect();
    for name in ["results.json", "sensor.toml", "photon_transfer.svg", "signal_to_noise.png"] {
        assert!(names.iter().any(|n| n == name), "{name} is missing in {names:?}");
    }
    // The file beside the results is the sensor itself, and the same seed gives the same bytes.
    let first = fs::read(out.join("results.json")).unwrap();
    let written = out.join("sensor.toml").to_string_lossy().into_owned();
    let shown = fluorspar(folder.path(), ["catalog", "show", "sensor", &written, "--toml"]).well();
    assert_eq!(shown.stdout.trim(), fs::read_to_string(&written).unwrap().trim());
    fluorspar(folder.path(), args).json();
    assert_eq!(first, fs::read(out.join("results.json")).unwrap());
}

#[test]
fn every_sensor_of_the_catalogue_is_listed_and_shown() {
    let folder = tempfile::tempdir().unwrap();
    let presets = fluorspar(folder.path(), ["catalog", "list", "--json"]).well().stdout;
    let table = fluorspar(folder.path(), ["catalog", "list", "sensor"]).well().stdout;
    let list = fluorspar(folder.path(), ["catalog", "list", "sensor", "--json"]).json();
    // A line of headings, and every sensor.
    assert_eq!(table.lines().count(), 1 + list.as_array().unwrap().len(), "{table}");
    assert!(table.lines().count() >= 9, "{table}");
    let table_1 = &list[0];
    assert_eq!(table_1["name"], "lyu_2021_table_1");
    assert_eq!(table_1["channels"], serde_json::json!(["R", "G", "B"]));
    // 1.39 mV at 0.911 V over 9000 e-.
    assert!((table_1["dark_noise_e"].as_f64().unwrap() - 13.732).abs() < 1e-3, "{table_1}");
    for name in [
        "lyu_2021_table_1",
        "monochrome_4_8um",
        "pi_camera_3",
        "monochrome_3_45um",
        "rgb_nir_3um",
        "multispectral_3x3",
    ] {
        assert!(presets.contains(name) && table.contains(name), "{name}");
        let text = fluorspar(folder.path(), ["catalog", "show", "sensor", name]).well().stdout;
        assert!(text.contains("dynamic range"), "{text}");
        let value = fluorspar(folder.path(), ["catalog", "show", "sensor", name, "--json"]).json();
        assert!(
            value["quantities"].as_array().unwrap().iter().all(|q| q["value"].as_f64().unwrap() > 0.0),
            "{value}"
        );
    }
}

#[test]
fn bad_input_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let bad = SHEET.replace("saturation_capacity_e = 10300", "saturation_capacity_e = 13000");
    fs::write(folder.path().join("bad.toml"), bad).unwrap();
    fs::write(folder.path().join("none.toml"), "format = 1\ntitle = \"no sensor\"\n").unwrap();
    fs::write(folder.path().join("odd.toml"), format!("pixels = 3\n{SHEET}")).unwrap();
    fs::write(folder.path().join("good.toml"), SHEET).unwrap();
    fs::write(folder.path().join("broken.toml"), "sensor = [\n").unwrap();
    fs::create_dir(folder.path().join("inner")).unwrap();
    fs::write(folder.path().join("inner/good.toml"), SHEET).unwrap();
    let before = listing(folder.path());
    for (args, expected) in [
        (vec!["sensor", "characterize", "bad.toml"], "bad.toml:11: sensor.emva1288.saturation_capacity_e"),
        (vec!["sensor", "characterize", "none.toml"], "there is no [sensor] section"),
        (vec!["catalog", "show", "sensor", "odd.toml"], "unknown field `pixels`"),
        (vec!["catalog", "show", "sensor", "missing.toml"], "missing.toml"),
        (vec!["catalog", "show", "sensor", "lyu_2021"], "did you mean \"lyu_2021_table_1\"?"),
        (vec!["catalog", "show", "sensor", "broken.toml"], "broken.toml:1"),
        (
            vec!["catalog", "show", "sensor", "good.toml", "--set", "sensor.full_well=9000"],
            "unknown field `full_well`",
        ),
        (vec!["catalog", "show", "sensor", "good.toml", "--json", "--toml"], "cannot be used with"),
        (
            vec!["sensor", "characterize", "good.toml", "--levels", "2"],
            "invalid value '2' for '--levels <N>': give a whole number from 10 to",
        ),
        (
            vec!["sensor", "characterize", "good.toml", "--stack", "1"],
            "invalid value '1' for '--stack <N>': give a whole number from 4 to",
        ),
        (
            vec!["sensor", "characterize", "good.toml", "--region", "4", "4"],
            "<ROWS>': give a whole number from 16 to",
        ),
        (vec!["sensor", "characterize", "good.toml", "--region", "64"], "2 values required"),
        (vec!["sensor", "characterize", "good.toml", "--gain", "0"], "--gain 0: "),
        (vec!["sensor", "characterize", "good.toml", "--out", "."], "the folder you are in"),
        (
            vec!["sensor", "characterize", "inner/good.toml", "--out", "inner"],
            "inner/good.toml, a file that is read here",
        ),
        (vec!["sensor", "characterize", "inner/good.toml", "--out", "good.toml"], "this is a file"),
        (vec!["sensor", "characterize", "good.toml", "--exposure-ms", "-1"], "--exposure-ms -1: "),
        (
            vec!["sensor", "characterize", "good.toml", "--set", "sensor.mode={ type = \"noise_free\" }"],
            "measure in that mode",
        ),
    ] {
        let said = fluorspar(folder.path(), &args);
        assert_eq!(said.code, Some(2), "{args:?}: {said:?}");
        assert!(said.stderr.contains(expected), "{args:?}: {}", said.stderr);
        let after = listing(folder.path());
        assert!(before == after, "{args:?} left {after:?}");
    }
}

/// The capacity of a sheet is what both the sheet and what is shown of it count from.
#[test]
fn a_sheet_and_what_is_shown_of_it_have_one_dynamic_range() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("sheet.toml"), SHEET).unwrap();
    let shown = fluorspar(folder.path(), ["catalog", "show", "sensor", "sheet.toml", "--json"]).json();
    let value = |name: &str| {
        let rows = shown["quantities"].as_array().unwrap().iter();
        rows.clone().find(|row| row["quantity"] == name).unwrap()["value"].as_f64().unwrap()
    };
    let saturation = value("saturation capacity");
    assert!((saturation / 10_300.0 - 1.0).abs() < 1e-3, "{saturation}");
    assert!((value("largest SNR") - 10.0 * 10_300f64.log10()).abs() < 0.01);
    let range = 20.0 * (10_300.0 / value("sensitivity threshold")).log10();
    assert!((value("dynamic range") - range).abs() < 0.01);
    // What a sheet says of itself by the same definition is accepted, to the digit that is shown
    let own = format!("{SHEET}dynamic_range_db = {range:.2}\nsnr_max_db = 40.13\n");
    fs::write(folder.path().join("own.toml"), own).unwrap();
    fluorspar(folder.path(), ["catalog", "show", "sensor", "own.toml"]).well();
}

#[test]
fn dark_noise_below_quantization_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let coarse = [
        ("gain_e_per_dn = 2.7", "gain_e_per_dn = 10.4"),
        ("bit_depth = 12", "bit_depth = 10"),
        ("10300", "8000"),
    ];
    let coarse = coarse.into_iter().fold(SHEET.to_owned(), |text, (fine, coarse)| text.replace(fine, coarse));
    fs::write(folder.path().join("coarse.toml"), coarse).unwrap();
    let args = ["sensor", "characterize", "coarse.toml", "--levels", "20", "--stack", "8", "--json"];
    let warnings = |found: &serde_json::Value| found["warnings"].to_string();
    let found = fluorspar(folder.path(), args).json();
    assert!(warnings(&found).contains("Quantization hides the dark noise"), "{}", warnings(&found));
    // 0.396 DN of 10.4 e-
    assert!(warnings(&found).contains("below 4.1 e-"), "{}", warnings(&found));
    fs::write(folder.path().join("fine.toml"), SHEET).unwrap();
    let args = ["sensor", "characterize", "fine.toml", "--levels", "20", "--stack", "8", "--json"];
    let found = fluorspar(folder.path(), args).json();
    assert!(!warnings(&found).contains("Quantization"), "{}", warnings(&found));
}
