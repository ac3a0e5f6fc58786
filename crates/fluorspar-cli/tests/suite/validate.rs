//! `fluorspar validate`: cases without a mouth in one go, a damaged camera, wrong input, and the table of the documentation.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::support::{Said, fluorspar, keeps_format, listing};

/// Runs the command without measured data of others, whatever the environment of the test has.
fn validate(folder: &Path, args: &[&str]) -> Said {
    let output = Command::new(env!("CARGO_BIN_EXE_fluorspar"))
        .arg("validate")
        .args(args)
        .current_dir(folder)
        .env_remove("FLUORSPAR_REFERENCE")
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Said { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

fn documentation() -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/validation.md")).unwrap()
}

/// Every case without a mouth passes; the page, the numbers, the figures and the table of docs/validation.md say so.
#[test]
fn cases_without_a_mouth_pass_and_the_documentation_has_their_table() {
    let folder = tempfile::tempdir().unwrap();
    let said = validate(folder.path(), &["--flat-only", "--out", "out", "--json"]).json();
    keeps_format("validation", &said);
    assert_eq!(said["counts"]["failed"], 0, "{said:#}");
    let out = folder.path().join("out");
    let page = fs::read_to_string(out.join("validation.html")).unwrap();
    let written: Value = serde_json::from_slice(&fs::read(out.join("validation.json")).unwrap()).unwrap();
    assert_eq!(written, said);
    let table = fs::read_to_string(out.join("validation.md")).unwrap();
    let documentation = documentation();
    for case in said["cases"].as_array().unwrap() {
        let text = |key: &str| case[key].as_str().unwrap().to_owned();
        assert!(page.contains(&format!("<section id=\"{}\">", text("name"))), "{case:#}");
        // What needs measured data reads otherwise without them.
        if text("verdict") != "skipped" && case["missing"].as_array().unwrap().is_empty() {
            let start = format!("| {} | ", text("name"));
            let row = table.lines().find(|line| line.starts_with(&start)).unwrap();
            assert!(documentation.contains(row), "docs/validation.md lacks this row:\n{row}");
        }
        for figure in case["figures"].as_array().unwrap() {
            let stem = figure.as_str().unwrap();
            for ending in ["svg", "png"] {
                assert!(out.join(format!("{stem}.{ending}")).is_file(), "{stem}.{ending}");
            }
        }
    }
    let skipped = said["cases"].as_array().unwrap().iter().filter(|case| case["verdict"] == "skipped");
    assert_eq!(said["counts"]["skipped"], skipped.count());
    assert_eq!(said["counts"]["skipped"], 2, "figure-6g and figure-8-measured need measured data");
    let listed = validate(folder.path(), &["--list", "--json"]).json();
    for case in listed.as_array().unwrap() {
        let name = case["name"].as_str().unwrap();
        assert!(documentation.contains(&format!("\n| {name} | ")), "docs/validation.md lacks {name}");
    }
}

/// A camera that is not the paper's fails, and the exit code says so; the results are there to be looked at.
#[test]
fn another_camera_fails_its_case() {
    let folder = tempfile::tempdir().unwrap();
    for (case, change, what) in [
        ("table-1", "sensor.read_noise_mv=1.5", "read noise: 1.5 mV instead of 1.385 to 1.395 mV"),
        ("figure-5b", "light.filters=[]", "orders below the peak at 450 nm behind the short-pass"),
        ("figure-4", "light.spectrum=\"led_405\"", "peak of the 385 nm LED"),
    ] {
        let said = validate(folder.path(), &["--case", case, "--set", change, "--out", "out"]);
        assert_eq!(said.code, Some(1), "{said:#?}");
        assert!(said.stdout.contains(what) && said.stdout.contains("1 cases: 1 failed."), "{said:#?}");
        let page = fs::read_to_string(folder.path().join("out/validation.html")).unwrap();
        assert!(page.contains("<b>failed</b>"));
    }
}

#[test]
fn wrong_input_is_told_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for (args, told) in [
        (
            vec!["--case", "figure-7d"],
            "error: --case figure-7d: there is no such case; did you mean \"figure-",
        ),
        (vec!["--reference", "nowhere"], "error: --reference nowhere: there is no such folder"),
        (vec!["--set", "light.spectrum=\"led_386\""], "led_385"),
        (vec!["--case", "figure-2", "--flat-only"], "error: --flat-only leaves none of the named cases"),
    ] {
        let said = validate(folder.path(), &args);
        assert_eq!(said.code, Some(2), "{said:#?}");
        assert!(said.stderr.contains(told), "{said:#?}");
    }
    let without_sensor =
        validate(folder.path(), &["--case", "figure-7b", "--set", "sensor.preset=\"monochrome_4_8um\""]);
    assert_eq!(without_sensor.code, Some(2), "{without_sensor:#?}");
    assert!(listing(folder.path()).is_empty(), "{:?}", listing(folder.path()));
    assert!(fluorspar(folder.path(), ["validate", "--list"]).well().stdout.contains("figure-7c"));
}
