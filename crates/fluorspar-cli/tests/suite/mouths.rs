//! Mouths by themselves: what is measured, what is written, how people are numbered.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;

use fluorspar::spectral::{Curve, Reflectance, StandardObserver, WavelengthGrid, linear_srgb};

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
    // A base that is one person already
    fs::write(folder.path().join("p.toml"), "format = 1\nbase = \"oraleye-2021\"\n[mouth]\nperson = 3\n")
        .unwrap();
    let said = fluorspar(folder.path(), ["mouth", "sample", "--count=1", "--base=p.toml", "--out=none"]);
    assert!(said.code == Some(2) && said.stderr.contains("mouth.person"), "{said:?}");
}

/// The files of people can be opened where they lie, and are the mouths that `mouth.person` gives: in the pose of their base.
#[test]
fn people_of_a_base_are_those_of_its_pose() {
    let folder = tempfile::tempdir().unwrap();
    let base =
        "format = 1\nbase = \"oraleye-2021\"\n[mouth]\nview = \"right-cheek\"\njaw_opening_mm = 41.0\n";
    fs::write(folder.path().join("own.toml"), base).unwrap();
    let args = ["mouth", "sample", "--count=1", "--seed=7", "--base=own.toml", "--out=people"];
    fluorspar(folder.path(), args).well();
    let mouth = |words: [&str; 2]| {
        let paths = ["jaw_opening_mm", "lip_opening_width_mm", "tongue_width_mm", "seed"];
        let paths = paths.map(|field| format!("mouth.{field}"));
        let words = ["scene", "get"].into_iter().chain(words).chain(paths.iter().map(String::as_str));
        fluorspar(folder.path(), words).well().stdout
    };
    let one = mouth(["people/person_000007.toml", "--quiet"]);
    assert!(one.contains("mouth.jaw_opening_mm = 41.0"), "{one}");
    assert_eq!(one, mouth(["own.toml", "--set=mouth.person=7"]));
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

/// What a tissue sends back under diffuse light as `tissue solve` tells it, as a color by the 1931 observer, against what
/// files for Blender and pbrt say. Tissue varies over a surface, so that they are not the same.
#[test]
fn colors_of_meshes_are_those_of_the_tissues() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    fluorspar(
        folder.path(),
        ["mouth", "generate", "--detail=0.25", "--out=m.obj", "--out=m.pbrt", "--out=m.glb"],
    )
    .well();
    let numbers =
        |text: &str| -> Vec<f64> { text.split_whitespace().map_while(|word| word.parse().ok()).collect() };
    let after = |text: &str, start: &str| {
        let rest = text.split_once(start).unwrap_or_else(|| panic!("{start}")).1;
        numbers(rest)
    };
    let grid = WavelengthGrid::uniform(380.0, 750.0, 5.0).unwrap();
    let observer = StandardObserver::new(&grid);
    let srgb = |spectrum: &[f32]| linear_srgb(observer.xyz(spectrum));
    let white = srgb(&vec![1.0; grid.len()]);
    for (material, tissue) in [
        ("cheek", "buccal_mucosa"),
        ("gingiva", "gingiva"),
        ("tongue_ventral", "ventral_tongue"),
        ("hard_palate", "hard_palate"),
        ("lip", "lip"),
        ("floor_of_mouth", "floor_of_mouth"),
    ] {
        let told = fluorspar(folder.path(), ["tissue", "solve", tissue, "--json"]).json();
        let list = |name: &str| -> Vec<f64> {
            told[name].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
        };
        let curve = Curve::new(list("wavelength_nm"), list("reflectance")).unwrap();
        let values: Vec<f32> =
            curve.on_grid::<Reflectance>(&grid).values().iter().map(|value| *value as f32).collect();
        let color = srgb(&values);
        let in_obj = after(&read("m.mtl"), &format!("newmtl {material}\nKd "));
        let in_pbrt = after(
            &read("m.pbrt"),
            &format!("\"{material}\" \"string type\" [ \"diffuse\" ] \"rgb reflectance\" [ "),
        );
        for channel in 0..3 {
            let expected = color[channel] / white[channel];
            assert!((in_obj[channel] - expected).abs() < 0.05, "{material}: {in_obj:?} {color:?} {white:?}");
        }
        assert_eq!(in_obj, in_pbrt, "{material}");
    }
    // Meters in all: a face is 0.05 to 0.2 m wide.
    let width = |xs: Vec<f64>| {
        xs.iter().copied().fold(f64::MIN, f64::max) - xs.iter().copied().fold(f64::MAX, f64::min)
    };
    let obj =
        width(read("m.obj").lines().filter_map(|line| Some(numbers(line.strip_prefix("v ")?)[0])).collect());
    let glb = fluorspar_format::read_gltf(&folder.path().join("m.glb"), 1.0).unwrap().bounds();
    assert!((obj - f64::from(glb.1.x - glb.0.x)).abs() < 1e-5 && (0.05..0.2).contains(&obj), "{obj} {glb:?}");
    // The scene of pbrt is a part without lights, which is read.
    let said = fluorspar(folder.path(), ["scene", "check", "m.pbrt", "--unit=m"]).well();
    assert!(said.stderr.contains("the scene has no lights"), "{}", said.stderr);
    assert!(
        fluorspar(folder.path(), ["render", "m.pbrt", "--unit=m", "--spp=1"])
            .stderr
            .contains("the scene has no lights")
    );
}
