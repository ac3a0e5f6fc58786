//! Scenes by name: paths with wildcards, parts, changes written into files, scripts.

#![allow(clippy::unwrap_used, reason = "these are tests")]

use std::fs;
use std::path::Path;

use fluorspar_experiment::preset::{self, PresetKind};
use fluorspar_experiment::schema::ScatteringSection;
use fluorspar_experiment::{
    Experiment, SceneChange, edit_experiment, parse, parse_changed, parse_script, resolve, resolve_shapes,
    scene_nodes, scene_values, script_text,
};

/// A file with comments, an order of its own, and every way to write a table.
const SCENE: &str = r#"# A scene of mine
format = 1
title = "Two balls"   # not more

[[light]]
name = "lamp"
type = "disc"            # flat
spectrum = "led_385"
radius_mm = 2.0
strength.power_mw = 10.0 # measured
position_mm = [0.0, 0.0, 90.0]
aim.direction = [0.0, 0.0, -1.0]

[[light]]
name = "room"
type = "environment"
spectrum = "room_led"
strength = { radiance_w_per_sr_m2 = 0.05 }

# Materials
[[material]]
name = "gray"
reflectance = 0.4

[[material]]
name = "pink"
reflectance = 0.6
[material.gloss]
roughness = 0.3

[camera]
horizontal_field_deg = 30.0

[[object]]
name = "ball_1"
type = "sphere"
radius_mm = 5.0
material = "gray"
[[object]]
name = "ball_2"
type = "sphere"
center_mm = [12.0, 0.0, 0.0]
radius_mm = 5.0
material = "gray"
"#;

fn set(path: &str, value: &str) -> SceneChange {
    SceneChange::Set { path: path.into(), value: value.into() }
}

fn delete(path: &str) -> SceneChange {
    SceneChange::Delete { path: path.into() }
}

fn insert(path: &str, value: &str) -> SceneChange {
    SceneChange::Insert { path: path.into(), value: value.into() }
}

fn changed(text: &str, sets: &[&str]) -> Result<Experiment, String> {
    let sets: Vec<String> = sets.iter().map(|set| set.to_string()).collect();
    parse(text, "mine.toml", Path::new("."), &sets).map_err(|error| error.to_string())
}

fn values(experiment: &Experiment, path: &str) -> Vec<String> {
    scene_values(experiment, path).unwrap().iter().map(|v| format!("{} = {}", v.path, v.value)).collect()
}

/// The file after changes; the test that it says what overrides would.
fn edited(text: &str, changes: &[SceneChange]) -> String {
    let here = Path::new(".");
    let edited = edit_experiment(text, "mine.toml", here, changes).unwrap_or_else(|error| panic!("{error}"));
    let wanted = parse_changed(text, "mine.toml", here, changes).unwrap();
    assert_eq!(parse(&edited, "mine.toml", here, &[]).unwrap().file, wanted.file, "{edited}");
    edited
}

#[test]
fn wildcards_set_everything_that_they_name() {
    let experiment = changed(SCENE, &["object.ball_*.radius_mm=3", "material.*.reflectance=0.25"]).unwrap();
    assert_eq!(
        values(&experiment, "object.*.radius_mm"),
        ["object.ball_1.radius_mm = 3", "object.ball_2.radius_mm = 3"].map(|s| s.replace("= 3", "= 3.0"))
    );
    // `gray` and `pink` have four letters.
    assert_eq!(values(&experiment, "material.????.reflectance").len(), 2);
    assert!(scene_values(&experiment, "material.?????.reflectance").is_err());
    // Below a wildcard what can't have a field is passed over: an environment has no power.
    let experiment = changed(SCENE, &["light.*.strength.power_mw=7", "light.*.group=all"]).unwrap();
    assert_eq!(values(&experiment, "light.*.strength.power_mw"), ["light.lamp.strength.power_mw = 7.0"]);
    assert_eq!(values(&experiment, "light.*.group").len(), 2);
    let mistakes = [
        ("material.x*.reflectance=1", "nothing matches `x*`"),
        ("material.*.reflectence=1", "can have a field `reflectence`"),
        ("light.*.radius_mm.x=1", "radius_mm"),
        ("material.\"*\".reflectance=1", "there is no material \"*\""),
    ];
    for (text, words) in mistakes {
        let said = changed(SCENE, &[text]).unwrap_err();
        assert!(said.contains(words) && said.contains("--set"), "{words}: {said}");
    }
}

#[test]
fn parts_are_given_materials_of_their_own() {
    // All parts of a material: the material itself changes.
    let experiment = changed(SCENE, &["ball_*/material.reflectance=0.1"]).unwrap();
    assert_eq!(experiment.file.material.len(), 2);
    assert_eq!(values(&experiment, "material.gray.reflectance"), ["material.gray.reflectance = 0.1"]);
    // One of them: it gets a copy.
    let experiment =
        changed(SCENE, &["ball_2/material.reflectance=0.1", "ball_2/material.gloss.roughness=0.5"]).unwrap();
    assert_eq!(experiment.file.material.len(), 3);
    assert_eq!(
        values(&experiment, "ball_*/material.reflectance"),
        ["ball_1/material.reflectance = 0.4", "ball_2/material.reflectance = 0.1"]
    );
    assert_eq!(values(&experiment, "ball_2/material"), ["ball_2/material = \"gray@ball_2\""]);
    resolve(&experiment).unwrap_or_else(|error| panic!("{error}"));
    // Another material, and another place.
    let experiment =
        changed(SCENE, &["*_1/material=pink", "ball_*/transform.translate_mm=[1, 2, 3]"]).unwrap();
    assert_eq!(
        values(&experiment, "ball_*/material"),
        ["ball_1/material = \"pink\"", "ball_2/material = \"gray\""]
    );
    assert_eq!(values(&experiment, "ball_2/transform.translate_mm").len(), 1);
    let said = changed(SCENE, &["ball_3/material=pink"]).unwrap_err();
    assert!(said.contains("no part is named `ball_3`; did you mean \"ball_2\"?"), "{said}");
}

#[test]
fn teeth_of_a_mouth_are_parts() {
    let text = "format = 1\nbase = \"oraleye-2021-surface\"\nmouth.detail = 0.25\n";
    let experiment = changed(text, &["tooth_1?/material.reflectance=0.7"]).unwrap();
    let copy = experiment.file.material.last().unwrap();
    assert_eq!(copy.name, "tooth@tooth_1?");
    assert!(matches!(&copy.scattering, ScatteringSection::Diffuse(_)));
    let mouth = experiment.file.mouth.as_ref().unwrap();
    assert!(mouth.materials.len() >= 7 && mouth.materials.values().all(|m| m == "tooth@tooth_1?"));
    assert_eq!(values(&experiment, "tooth_1*/material.reflectance").len(), mouth.materials.len());
    let scene = resolve_shapes(&experiment).unwrap();
    let of = |name: &str| {
        let object = scene.objects.iter().find(|object| object.name == name).unwrap();
        scene.materials[object.material].name.clone()
    };
    assert_eq!((of("tooth_11"), of("tooth_21")), ("tooth@tooth_1?".into(), "tooth".into()));
    // The copies keep the maps of the anatomy that their tissue has
    let layered = "format = 1\nbase = \"oraleye-2021\"\nmouth.detail = 0.25\n";
    let lip = changed(layered, &["upper_lip/material.translucent=false"]).unwrap();
    for copied in [&experiment, &lip] {
        resolve(copied).unwrap_or_else(|error| panic!("{error}"));
    }
    let said = changed(text, &["tooth_11/transform.scale=2"]).unwrap_err();
    assert!(said.contains("has a material only; write tooth_11/material"), "{said}");
    // Every part stands in the tree, with its material.
    let nodes = scene_nodes(&experiment).unwrap();
    let tooth = nodes.iter().find(|node| node.path == "tooth_11/").unwrap();
    assert_eq!(tooth.summary, "tooth, material \"tooth@tooth_1?\"");
    assert!(nodes.iter().any(|node| node.path == "light.blue" && node.kind == "light"));
}

#[test]
fn a_tooth_that_is_missing_may_have_a_material() {
    let text = "format = 1\nbase = \"oraleye-2021\"\nmouth.detail = 0.25\n";
    let missing = changed(text, &["mouth.missing_teeth=[13, 18]"]).unwrap();
    let scene = resolve_shapes(&missing).unwrap_or_else(|error| panic!("{error}"));
    let of = |name: &str| scene.objects.iter().find(|object| object.name == name);
    assert!(of("tooth_13").is_none());
    assert_eq!(scene.materials[of("tooth_23").unwrap().material].name, "canine");
    assert_eq!(scene.materials[of("tooth_22").unwrap().material].name, "tooth");
}

#[test]
fn comments_and_order_survive_changes() {
    let text = edited(
        SCENE,
        &[
            set("light.lamp.strength.power_mw", "12.5"),
            set("material.pink.gloss.roughness", "0.2"),
            set("object.ball_1.transform.rotate_deg", "[0, 0, 90]"),
            set("title", "Two balls, turned"),
        ],
    );
    let expected = SCENE
        .replace("power_mw = 10.0", "power_mw = 12.5")
        .replace("roughness = 0.3", "roughness = 0.2")
        .replace("\"Two balls\"", "\"Two balls, turned\"")
        .replacen("material = \"gray\"\n", "material = \"gray\"\ntransform.rotate_deg = [0, 0, 90]\n", 1);
    assert_eq!(text, expected);
}

#[test]
fn entries_come_and_go_and_variants_change() {
    let text = edited(
        SCENE,
        &[
            delete("light.room"),
            insert("object.disc", "{ type = \"disc\", radius_mm = 2.0, material = \"pink\" }"),
            set("light.lamp.strength", "{ irradiance_w_per_m2 = 3.0, at_distance_mm = 100.0 }"),
            set("object.ball_2.type", "\"sphere\""),
            delete("material.pink.gloss"),
            set("ball_1/material.reflectance", "0.9"),
        ],
    );
    assert!(
        !text.contains("room_led") && !text.contains("power_mw") && !text.contains("[material.gloss]"),
        "{text}"
    );
    assert!(text.contains("# Materials") && text.contains("name = \"gray@ball_1\""), "{text}");
    let mistakes = [
        (insert("light.lamp", "{ type = \"disc\" }"), "has an entry \"lamp\" already"),
        (insert("title.x", "{ a = 1 }"), "title"),
        (insert("light.other", "3"), "an entry is a table"),
        (insert("light.*", "{ a = 1 }"), "write LIST.NAME"),
        (delete("light.lamp.filters"), "there is no `light.lamp.filters` here"),
        (delete("light.lamb"), "did you mean \"lamp\"?"),
        (set("render.width_px", "-3"), "render.width_px = -3"),
    ];
    for (change, words) in mistakes {
        let said = edit_experiment(SCENE, "mine.toml", Path::new("."), &[change]).unwrap_err().to_string();
        assert!(said.contains(words), "{words}: {said}");
    }
}

#[test]
fn changes_on_a_base_say_only_what_differs() {
    let text = "format = 1\nbase = \"oraleye-2021-surface\" # the paper's\nmouth.detail = 0.25\n";
    let new = edited(
        text,
        &[
            set("light.blue.strength.power_mw", "500"),
            set("capture.blue.exposure_ms", "12"),
            delete("light.white"),
            set("tooth_21/material.reflectance", "0.5"),
        ]
        .into_iter()
        .filter(|change| !matches!(change, SceneChange::Delete { .. }))
        .collect::<Vec<_>>(),
    );
    assert!(
        new.starts_with(text) && new.contains("[[light]]\nname = \"blue\"\nstrength.power_mw = 500"),
        "{new}"
    );
    assert!(new.contains("[[capture]]\nname = \"blue\"\nexposure_ms = 12"), "{new}");
    assert!(new.len() < 1000, "{new}");
    let gone = edited(text, &[delete("capture.white"), set("analysis.further_frames", "[]")]);
    assert!(gone.contains("name = \"white\"\nremove = true"), "{gone}");
    // Fields and sections of a base are unset, and may be set again on top.
    let gone = edited(text, &[delete("capture.blue.subtract"), delete("analysis"), delete("safety")]);
    assert!(gone.contains(r#"unset = ["capture.blue.subtract", "safety", "analysis"]"#), "{gone}");
    let back = edited(&gone, &[set("analysis", r#"{ frame = "blue" }"#)]);
    assert!(back.contains(r#""safety", "analysis"]"#) && back.contains("frame = \"blue\""), "{back}");
    let list = edited(text, &[delete("analysis"), delete("capture")]);
    assert!(list.contains(r#"unset = ["capture", "analysis"]"#) && !list.contains("remove"), "{list}");
}

#[test]
fn scripts_replay_on_every_built_in_experiment() {
    let script = script_text(&[
        set("light.*.filter_angle_deg", "0"),
        set("render.samples_per_pixel", "2"),
        set("title", "\"again\""),
    ]);
    let changes = parse_script(&script, "changes.toml").unwrap();
    for entry in preset::list(preset::PresetKind::Experiment).unwrap() {
        let text = preset::text(PresetKind::Experiment, &entry.name).unwrap();
        let new = edited(text, &changes);
        // A second time nothing changes.
        assert_eq!(edited(&new, &changes), new, "{}", entry.name);
        let lines = |text: &str| text.lines().filter(|line| line.trim_start().starts_with('#')).count();
        assert_eq!(lines(text), lines(&new), "{}: comments", entry.name);
    }
}

/// Scripts, scenes and paths with damages: whatever they say, an answer comes and no panic, and what is written says what it should.
/// 500 inputs; `FLUORSPAR_MUTATIONS=100000 cargo test -p fluorspar-experiment --test suite damaged_scripts` makes as many.
#[test]
fn damaged_scripts_and_paths_are_refused_or_replayed() {
    let script = script_text(&[
        set("light.*.strength.power_mw", "20.5"),
        set("ball_?/material.gloss.roughness", "0.5"),
        insert("object.\"a b\"", "{ type = \"sphere\", radius_mm = 2.0, material = \"pink\" }"),
        set("object[1].transform", "{ translate_mm = [1.0, 2.0, 3.0] }"),
        delete("light.room"),
    ]);
    let count = std::env::var("FLUORSPAR_MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(500_u64);
    let mut state = 7_u64;
    let mut random = |end: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % end.max(1)
    };
    let pieces: [&str; 16] = [
        "*",
        "?",
        "\"",
        "/",
        ".",
        "[",
        "]",
        "=",
        "{}",
        "[]",
        "-1",
        "1e999",
        "true",
        "\n",
        "\u{1F9B7}",
        "base",
    ];
    let mut replayed = 0;
    for number in 0..count {
        let mut text: Vec<char> = script.chars().collect();
        for _ in 0..(number as usize).min(1 + random(4)) {
            let at = random(text.len());
            match random(4) {
                0 => drop(text.splice(at..at, pieces[random(pieces.len())].chars())),
                1 => drop(text.drain(at..(at + random(12)).min(text.len()))),
                2 => text[at] = ['0', '"', '.', '*', '/', '[', 'x'][random(7)],
                _ => {
                    let end = (at + random(40)).min(text.len());
                    let part = text[at..end].to_vec();
                    let to = random(text.len());
                    drop(text.splice(to..to, part));
                }
            }
        }
        let text: String = text.into_iter().collect();
        let Ok(changes) = parse_script(&text, "script.toml") else { continue };
        let here = Path::new(".");
        if let Ok(new) = edit_experiment(SCENE, "mine.toml", here, &changes) {
            let wanted = parse_changed(SCENE, "mine.toml", here, &changes).unwrap();
            assert_eq!(parse(&new, "mine.toml", here, &[]).unwrap().file, wanted.file, "{text}");
            replayed += 1;
        }
    }
    assert!(replayed * 20 >= count, "{replayed} of {count}");
}

#[test]
fn values_keep_paths_relative_to_the_file() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.csv"), "wavelength_nm,x\n300,0.5\n800,0.5\n").unwrap();
    let text = SCENE.replace("reflectance = 0.6", "reflectance = \"a.csv\"");
    let new = edit_experiment(&text, "mine.toml", folder.path(), &[set("ball_2/material", "pink")]).unwrap();
    let copied =
        edit_experiment(&new, "mine.toml", folder.path(), &[set("ball_2/material.reflectance", "./a.csv")])
            .unwrap();
    assert!(copied.contains("reflectance = \"./a.csv\""), "{copied}");
    let copied = parse(&copied, "mine.toml", folder.path(), &[]).unwrap();
    resolve(&copied).unwrap_or_else(|error| panic!("{error}"));
}
