//! Mouths by themselves: what is measured, what is written, how people are numbered.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;

use crate::support::fluorspar;

#[test]
fn every_length_is_measured_or_the_reason_told() {
    let folder = tempfile::tempdir().unwrap();
    let generate = |more: &[&str]| fluorspar(folder.path(), [&["mouth", "generate"], more].concat());
    for (detail, tolerated) in [("0.25", 0.04), ("0.4", 0.02), ("1", 0.02)] {
        let made = generate(&["--detail", detail, "--json"]).json();
        for dimension in made["dimensions"].as_array().unwrap() {
            let (wanted, measured) =
                (dimension["wanted_mm"].as_f64().unwrap(), dimension["measured_mm"].as_f64());
            let off = measured.unwrap_or(f64::NAN) / wanted - 1.0;
            assert!(off.abs() < tolerated, "detail {detail}: {dimension}");
            assert!(dimension["not_measured"].is_null(), "{dimension}");
        }
    }
    let raised = generate(&["--detail", "0.4", "--pose", "ventral-tongue"]).well().stdout;
    assert!(raised.contains("not measured: tongue in front, the tip is raised\n"), "{raised}");
    let gap = generate(&["--detail", "0.4", "--set", "missing_teeth=[31,41,26]"]).well().stdout;
    assert!(gap.contains("not measured: jaw opening, no tooth 31, 41\n"), "{gap}");
    assert!(gap.contains("not measured: palate height, no tooth 26\n"), "{gap}");
}

#[test]
fn what_was_written_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let args = ["mouth", "generate", "--detail=0.25", "--out=a.glb", "--out=a.obj", "--out=parts"];
    let said = fluorspar(folder.path(), args).well().stderr;
    assert!(said.contains("Wrote a.glb\nWrote a.obj and a.mtl\nWrote "), "{said}");
    let names = fs::read_dir(folder.path().join("parts")).unwrap().map(|entry| entry.unwrap().path());
    let parts = names.filter(|path| path.extension().is_some_and(|ending| ending == "ply")).count();
    assert!(said.ends_with(&format!("Wrote {parts} .ply files to parts\n")), "{said}");
    assert_eq!(fluorspar(folder.path(), [&args[..], &["--quiet"]].concat()).well().stderr, "");
}

#[test]
fn people_of_a_table_are_those_of_their_number() {
    let folder = tempfile::tempdir().unwrap();
    fluorspar(folder.path(), ["mouth", "sample", "--count=2", "--seed=7", "--out=people"]).well();
    let table = fs::read_to_string(folder.path().join("people/people.csv")).unwrap();
    let lines: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!((lines.len(), lines[0][0], lines[1][0], lines[2][0]), (3, "person", "7", "8"));
    let column = lines[0].iter().position(|name| *name == "tongue_length_mm").unwrap();
    let json = ["mouth", "generate", "--detail=0.25", "--json", "--person", lines[2][0]];
    let person = fluorspar(folder.path(), json).json();
    let length: f64 = lines[2][column].parse().unwrap();
    assert_eq!(person["parameters"]["tongue_length_mm"].as_f64(), Some(length));
    assert!(folder.path().join("people/person_000008.toml").exists());
}

#[test]
fn a_contact_sheet_has_a_name_above_every_image() {
    let folder = tempfile::tempdir().unwrap();
    let args =
        ["mouth", "view", "--views=lips,open,throat", "--width=64", "--spp=1", "--detail=0.25", "--quiet"];
    fluorspar(folder.path(), args).well();
    let file = fs::read(folder.path().join("mouth.png")).unwrap();
    let size = |at: usize| u32::from_be_bytes(file[at..at + 4].try_into().unwrap());
    // Two images of 64 x 48 above one of twice the width, each below a strip of 20 pixels.
    assert_eq!((size(16), size(20)), (132, 20 + 48 + 4 + 20 + 99));
}
